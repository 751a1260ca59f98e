//! Networks on emulated nRF52840s that run the image that is flashed. `cargo xtask test --stage chip` builds
//! both and runs these.

use std::{cell::RefCell, env, io, path::Path, rc::Rc};

use answers::record::{Role, RunRecord};
use host_sim::network::{CHIP_IMAGE, Chips, Options, Simulation};
use site::{Overrides, Scenario};

/// Two references, one of which loses its power, and a target.
const SMALL: &str = r#"
name = "small"
unit = "inches"
unit_metres = 0.0254

[world]
low = [-12.0, -4.0]
high = [26.0, 30.0]

[camera]
projection = "pin-hole"
field_of_view_deg = 45.0
range = 40.0

[walk]
speed = 6.0
arrive_within = 0.1
step_length = 1.0

[radio]
medium = "unit-disk"
range = 100.0

[sensor]
measures = false

[firmware]
systematic_heading_deg = 0.0
systematic_scale = 0.0
standing_sigma = 0.05
weak_sigma = 1.4

[[network]]
channel = 20
references = { cameras = [1, 2], baseline = 14.0 }
camera = [
  { id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 },
  { id = 2, x = 14.0, y = 0.0, heading_deg = 135.0 },
]
target = [{ id = 20, colour = [230, 105, 35], radius = 0.75 }]

[[event]]
at_s = 3.0
action = { power-cut = { node = 2, for_s = 0.5 } }
"#;

/// A file that can be read again.
#[derive(Clone, Default)]
struct Pages(Rc<RefCell<Vec<u8>>>);

impl io::Write for Pages {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Pages {
    fn text(&self) -> String {
        String::from_utf8(self.0.borrow().clone()).unwrap()
    }
}

/// A run, with all frames on the air and its log.
fn run(scenario: Scenario) -> (RunRecord, Pages, Pages) {
    // What emulates chips is found from there.
    env::set_current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("..")).unwrap();
    let image = env::var_os("NODE_IMAGE").unwrap_or_else(|| CHIP_IMAGE.into());
    let (pcap, log) = (Pages::default(), Pages::default());
    let options = Options {
        chips: Some(Chips::of(Path::new(&image)).unwrap()),
        pcap: Some(Box::new(pcap.clone())),
        log: Some(Box::new(log.clone())),
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options).unwrap();
    let record = simulation.run(|_| ());
    if let Some(trouble) = simulation.trouble() {
        panic!("{trouble}");
    }
    println!(
        "{}: {:.0} s of the network in {:.0} s",
        record.scenario,
        record.sim_seconds,
        record.wall_seconds.unwrap_or_default()
    );
    (record, pcap, log)
}

fn small() -> Scenario {
    Scenario::from_toml(SMALL, &Overrides::default()).unwrap()
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_network_does_the_same_each_time() {
    let (record, pcap, log) = run(small());
    for node in &record.nodes {
        let is_known = node.address.is_some() || node.id >= 60_000;
        assert!(is_known, "node {} has not joined", node.id);
        assert!(node.frames_sent > Some(5), "node {}", node.id);
    }
    let text = log.text();
    assert!(text.contains("node 2: loses its power"), "{text}");
    let (_, same, same_log) = run(small());
    assert!(pcap.0.borrow().len() > 1_000);
    assert!(*pcap.0.borrow() == *same.0.borrow(), "other frames");
    assert_eq!(text, same_log.text());
}

/// With twice the stops of somebody who measures exactly, for a carrier's steps are uncertain by a tenth.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn lab_calibrates() {
    let changes = Overrides {
        stops: Some(6),
        ..Overrides::default()
    };
    let (record, ..) = run(Scenario::load("lab", &changes).unwrap());
    let cameras: Vec<_> = { record.nodes.iter() }
        .filter(|node| node.role == Role::Camera)
        .collect();
    assert_eq!(cameras.len(), 7);
    for camera in cameras {
        let error = camera.error.as_ref();
        let error = error.unwrap_or_else(|| panic!("camera {} has no pose", camera.id));
        let off = error.x.hypot(error.y);
        assert!(
            off < 3.0 && error.heading_deg.abs() < 6.0,
            "{}: {error:?}",
            camera.id
        );
        assert!(camera.nees.is_none_or(|nees| nees < 25.0), "{}", camera.id);
    }
    assert_eq!(record.summary.calibrated, 7);
}
