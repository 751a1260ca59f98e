//! OpenMV's own scripts as cameras of nodes. They run on `MicroPython` for computers, with stand-ins for the modules of
//! the camera.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
};

use host_sim::network::{Onlooker, Options, Simulation};
use nalgebra::Point2;
use results::record::event::What;
use site::{Overrides, Scenario, world::World};
use tempfile::TempDir;

use crate::common::LineEnd;

const SCENARIO: &str = r#"
name = "openmv"

[world]
low = [-3.0, -3.0]
high = [11.0, 11.0]

[walk]
speed = 1.0
arrive_within = 0.001

[sensor]
measures = false

[camera]
kind = "pixy2"

[firmware]
systematic_heading_deg = 0.0
systematic_scale = 0.0
standing_sigma = 0.01

[[network]]
references = { cameras = [1, 2] }
camera = [
  { id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 },
  { id = 2, x = 8.0, y = 0.0, heading_deg = 135.0 },
  { id = 3, x = 4.0, y = 9.0, heading_deg = 270.0, kind = "openmv" },
  { id = 4, x = -1.0, y = 5.0, heading_deg = 0.0, kind = "openmv-tags" },
]
target = [{ id = 20, radius = 0.4, stops = [[3.0, 3.2], [5.0, 3.4], [4.2, 5.2], [2.8, 4.8], [5.2, 5.0]] }]
"#;

/// A target nearer to a stop stands there.
const NEAR: f64 = 0.06;

/// A script that plays a camera.
struct Script {
    node: u16,
    /// Of the world.
    index: usize,
    size: [f64; 2],
    scene: PathBuf,
    process: Child,
    port: String,
    _open: LineEnd,
}

impl Script {
    fn start(
        (node, index, size): (u16, usize, [u16; 2]),
        text: &str,
        micropython: &Path,
        files: &Path,
    ) -> Self {
        let stand_ins = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/data/openmv/stand-ins"
        );
        let (device, open, port) = LineEnd::pair();
        let [program, scene] = ["py", "scene"].map(|name| files.join(format!("{node}.{name}")));
        fs::write(&program, text).unwrap();
        fs::write(&scene, "").unwrap();
        let has_methods = text.contains(".cx()");
        let process = Command::new(micropython)
            .arg(&program)
            .env("MICROPYPATH", stand_ins)
            .env("SCENE", &scene)
            .env("METHODS", if has_methods { "1" } else { "" })
            .stdout(Stdio::null())
            .stderr(Stdio::from(device.0))
            .spawn()
            .unwrap();
        Self {
            node,
            index,
            size: size.map(f64::from),
            scene,
            process,
            port,
            _open: open,
        }
    }

    /// Shows the camera what the world's one has in view.
    fn show(&self, world: &World) {
        let view = world.look(self.index);
        let [columns, rows] = self.size;
        let line = |extent: &cmucam2_emulator::Extent| {
            let [width, height] = [
                (extent.right - extent.left) * columns,
                (extent.bottom - extent.top) * rows,
            ];
            let x = f64::midpoint(extent.left, extent.right) * columns - 0.5;
            let y = f64::midpoint(extent.top, extent.bottom) * rows - 0.5;
            let pixels = width * height * std::f64::consts::FRAC_PI_4;
            // Number 0 is that of the tag and of the threshold.
            format!("0 {x:.0} {y:.0} {width:.0} {height:.0} {pixels:.0}\n")
        };
        let lines: String = { view.patches().iter() }
            .map(|patch| line(&patch.extent))
            .collect();
        // In one piece: the other program may read at any time.
        let new = self.scene.with_extension("new");
        fs::write(&new, lines).unwrap();
        fs::rename(new, &self.scene).unwrap();
    }
}

impl Drop for Script {
    fn drop(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }
}

/// The script for blobs with the two lines changed that `docs/real-parts.md` names: the threshold of signature 1 is
/// that of no colour code, and small blobs count.
fn edited(script: &str) -> String {
    let threshold = "    (30, 80, 20, 80, 20, 80, False, True),";
    let lines = script.lines().map(|line| {
        if line.contains("# Generic Red Threshold") {
            threshold
        } else if line.starts_with("fb_pixels_threshold = ") {
            "fb_pixels_threshold = 20"
        } else {
            line
        }
    });
    let lines: Vec<&str> = lines.collect();
    assert!(lines.contains(&threshold) && lines.contains(&"fb_pixels_threshold = 20"));
    lines.join("\n")
}

/// The bytes are those of programs that are no part of this project, and the nodes find their places by them.
#[test]
#[ignore = "takes minutes of real time, and OpenMV's scripts: cargo xtask peers"]
fn scripts_of_openmv_calibrate_their_nodes() {
    let given = |name| env::var_os(name).map(PathBuf::from);
    let (Some(micropython), Some(scripts)) = (given("MICROPYTHON"), given("OPENMV_SCRIPTS")) else {
        eprintln!(
            "OpenMV's scripts are left out: MICROPYTHON is to be the path of MicroPython, OPENMV_SCRIPTS that of the \
             folder with pixy_uart_emulation.py and apriltags_pixy_uart_emulation.py"
        );
        return;
    };
    let seed = Overrides {
        seed: Some(1),
        ..Overrides::default()
    };
    let scenario = Scenario::from_toml(SCENARIO, &seed).unwrap().exact();
    let mut world = scenario.put_up().unwrap().world;
    let stops: Vec<[f64; 2]> = scenario.networks[0].targets[0].stops.clone().unwrap();
    let files = TempDir::new().unwrap();
    let read = |name: &str| fs::read_to_string(scripts.join(name)).unwrap();
    let blobs = edited(&read("pixy_uart_emulation.py"));
    let tags = read("apriltags_pixy_uart_emulation.py");
    let start = |camera, text: &str| Script::start(camera, text, &micropython, files.path());
    let cameras = [
        start((3, 2, [320, 240]), &blobs),
        start((4, 3, [160, 120]), &tags),
    ];
    let options = Options {
        speed: Some(1.0),
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options).unwrap();
    for camera in &cameras {
        simulation
            .connect_camera(camera.node, &camera.port)
            .unwrap();
    }
    let mut onlooker = Onlooker::default();
    let every = 100_000_000;
    let record = simulation.run_watched(
        every,
        |_| (),
        |simulation| {
            for event in onlooker.look(simulation) {
                // The network's frame is that of the world: its references were told so.
                let place = match event.what {
                    What::Place { x, y, .. } => Point2::new(x, y),
                    What::Stop { is, .. } => Point2::new(is.x, is.y),
                    _ => continue,
                };
                let stops = stops.iter().map(|&stop| Point2::from(stop));
                let near = { stops }.find(|stop| (stop - place).norm() < NEAR);
                world.move_target(0, near.unwrap_or(place));
                cameras.iter().for_each(|camera| camera.show(&world));
            }
        },
    );
    for camera in &cameras {
        let node = record
            .cameras()
            .find(|node| node.id == camera.node)
            .unwrap();
        let told = format!(
            "node {}: {} sightings, error {:?}, {:?}",
            node.id, node.sightings, node.error, node.estimate
        );
        let (Some(estimate), Some(error)) = (&node.estimate, node.error) else {
            panic!("not calibrated: {told}");
        };
        println!("{told}");
        for (error, sigma) in [
            (error.x, estimate.sigma_x),
            (error.y, estimate.sigma_y),
            (error.heading_deg, estimate.sigma_heading_deg),
        ] {
            assert!(error.abs() <= 5.0 * sigma + 1e-6, "{told}");
        }
        assert!(estimate.sigma_position() < 0.3, "{told}");
    }
}
