//! Networks on emulated boards. `cargo xtask emulate` builds the image and runs those that need it.
#![cfg(unix)]

use std::{
    env, fs,
    os::unix::fs::PermissionsExt,
    path::Path,
    process::{Command, Output},
};

use host_sim::{
    network::{Emulation, EmulatorError, Options, Simulation},
    record::{Role as Part, RunRecord},
    scenario::{Overrides, Scenario},
};
use node_firmware::{
    config::Role as Configured,
    memory::{Fact, KeptSighting},
    message::{Frame, Message, Report, Sight, State, Stopped},
    role::{
        Output as Wish, Role,
        camera::{Camera, Event, Task},
    },
};
use tempfile::TempDir;
use zigbee_link::{Instant, wire::ShortAddress};

const NOW: Instant = Instant(1_000_000);

/// Two references, another camera that loses its power, a target.
const SMALL: &str = r#"
name = "small"
unit = "inches"

[world]
low = [-12.0, -4.0]
high = [26.0, 30.0]

[camera]
field_of_view_deg = 45.0
range = 40.0

[walk]
speed = 6.0
arrive_within = 0.1
step_length = 1.0

[radio]
medium = "unit-disk"
range = 100.0

[firmware]
weak_sigma = 1.0

[[network]]
channel = 20
references = { cameras = [1, 2] }
camera = [
  { id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 },
  { id = 2, x = 14.0, y = 0.0, heading_deg = 135.0 },
  { id = 3, x = 7.0, y = -2.0, heading_deg = 90.0 },
]
target = [{ id = 20, colour = [230, 105, 35], radius = 0.75 }]

[[event]]
at_s = 25.0
action = { power-cut = { node = 3, for_s = 1.0 } }
"#;

fn emulation() -> Emulation {
    let image = env::var_os("NODE_IMAGE").expect("NODE_IMAGE is not set: `cargo xtask emulate`");
    Emulation::of(Path::new(&image)).unwrap()
}

fn run(scenario: Scenario) -> (Simulation, RunRecord) {
    let options = Options {
        emulation: Some(emulation()),
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
    (simulation, record)
}

/// Every camera knows where it stands: within an inch and two degrees, several times what is
/// usual, for no two runs in real time are the same.
fn check(record: &RunRecord, cameras: usize) {
    let nodes = record.nodes.iter().filter(|node| node.role == Part::Camera);
    let mut count = 0;
    for node in nodes {
        let id = node.id;
        let error = node.error.as_ref().unwrap_or_else(|| panic!("camera {id}"));
        let off = error.x.hypot(error.y);
        assert!(
            off < 1.0 && error.heading_deg.abs() < 2.0,
            "camera {id}: {error:?}"
        );
        count += 1;
    }
    assert_eq!(count, cameras);
}

/// The poses that Cortex-M4Fs found are those that this processor finds from the same sightings,
/// to the last bit: same routines, no arithmetic but IEEE 754's.
fn check_arithmetic(simulation: &Simulation, record: &RunRecord) {
    let mut checked = 0;
    for node in &record.nodes {
        let facts = simulation.memory(node.id);
        let Some(Configured::Camera(config)) =
            simulation.config(node.id).map(|config| &config.role)
        else {
            continue;
        };
        if config.reference.is_some() {
            continue;
        }
        let there = facts.iter().find_map(|fact| match fact {
            Fact::Report(report) => *report,
            _ => None,
        });
        let there = there.unwrap_or_else(|| panic!("node {} has no report", node.id));
        let sightings: Vec<_> = facts
            .iter()
            .filter(|fact| matches!(fact, Fact::Sighting(_, Some(_))))
            .collect();
        let here = again(Camera::new(node.id, config.clone()), &sightings);
        assert!(matches!(here.state, State::Pose(_)));
        assert_eq!(here, there);
        checked += 1;
    }
    assert!(checked > 0);
}

/// A camera's report after these sightings.
fn again(mut camera: Camera, sightings: &[&Fact]) -> Report {
    let (last, before) = sightings.split_last().unwrap();
    for fact in before {
        camera.remember(fact);
    }
    let &&Fact::Sighting(
        _,
        Some(KeptSighting {
            target,
            stop,
            place,
            seen,
        }),
    ) = last
    else {
        unreachable!();
    };
    let stopped = Stopped {
        stop,
        colour: 0,
        frame: Frame::Site,
        place,
    };
    camera.event(NOW, Event::Ready);
    camera.message(NOW, ShortAddress(target), &Message::Stopped(stopped));
    while let Some(wish) = camera.poll(NOW) {
        if let Wish::Task(Task::Look { .. }) = wish {
            camera.event(NOW, Event::Looked(Sight::InView, Some(seen)));
        }
    }
    *camera.report()
}

#[test]
#[ignore = "needs an image: cargo xtask emulate"]
fn lab_calibrates_itself_on_emulated_boards() {
    let lab = Scenario::load("lab", &Overrides::default()).unwrap();
    let (simulation, record) = run(lab);
    check(&record, 7);
    check_arithmetic(&simulation, &record);
}

#[test]
#[ignore = "needs an image: cargo xtask emulate"]
fn a_board_goes_on_after_a_power_cut() {
    let files = TempDir::new().unwrap();
    let file = files.path().join("small.toml");
    fs::write(&file, SMALL).unwrap();
    let small = Scenario::load(file.to_str().unwrap(), &Overrides::default()).unwrap();
    let (simulation, record) = run(small);
    check(&record, 3);
    check_arithmetic(&simulation, &record);
}

#[test]
#[ignore = "needs the emulator: cargo xtask emulate"]
fn what_is_no_image_ends_the_run() {
    let files = TempDir::new().unwrap();
    let image = files.path().join("image.elf");
    fs::write(&image, "no machine code").unwrap();
    let lab = Scenario::load("lab", &Overrides::default()).unwrap();
    let options = Options {
        emulation: Some(Emulation::of(&image).unwrap()),
        ..Options::default()
    };
    let mut simulation = Simulation::new(lab, options).unwrap();
    simulation.run(|_| ());
    let trouble = simulation.trouble();
    assert!(
        matches!(
            trouble,
            Some(EmulatorError::Ended { .. } | EmulatorError::Silent { .. })
        ),
        "{trouble:?}"
    );
}

/// `host-sim run lab --backend qemu` where these are the only programs.
fn host_sim(programs: &Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["run", "lab", "--backend", "qemu"])
        .args(more)
        .env("PATH", programs)
        .output()
        .unwrap()
}

fn refused(output: &Output, expected: &str) {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(expected), "{stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
}

#[test]
fn what_is_missing_is_told_with_what_to_type() {
    let files = TempDir::new().unwrap();
    let nowhere = files.path().join("nowhere.elf");
    let image = files.path().join("image.elf");
    fs::write(&image, "").unwrap();
    let [nowhere, image] = [&nowhere, &image].map(|path| path.to_str().unwrap());
    let output = host_sim(files.path(), &["--image", nowhere]);
    refused(&output, "type `cargo xtask firmware`");
    let output = host_sim(files.path(), &["--image", image]);
    refused(&output, "`sudo apt-get install qemu-system-arm`");
    let output = host_sim(files.path(), &["--image", image, "--speed", "10x"]);
    refused(&output, "leave out --speed");
}

/// The node talks to a camera behind a port of the operating system: as far as it goes without a
/// real one.
#[test]
#[ignore = "takes a minute of real time: cargo xtask emulate"]
fn a_camera_on_a_port_takes_the_place_of_a_simulated_one() {
    let files = TempDir::new().unwrap();
    let [port, log] = ["camera", "log"].map(|name| files.path().join(name));
    let mut camera = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["camera", "--baud", "38400", "--pty"])
        .arg(&port)
        .spawn()
        .unwrap();
    while !port.exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
        assert!(camera.try_wait().unwrap().is_none());
    }
    let file = files.path().join("one.toml");
    fs::write(&file, SMALL).unwrap();
    let ended = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .arg("run")
        .arg(&file)
        .arg("--port")
        .arg(format!("3={}", port.display()))
        .arg("--log")
        .arg(&log)
        .output();
    camera.kill().unwrap();
    camera.wait().unwrap();
    let stderr = String::from_utf8(ended.unwrap().stderr).unwrap();
    let log = fs::read_to_string(log).unwrap();
    // It looks elsewhere, so it finds no pose; but it looks.
    let answers = log
        .lines()
        .filter(|line| line.contains("node 3: ") && line.contains("Look("));
    let mut answers = answers.filter(|line| !line.contains("NotReady") && !line.contains("Failed"));
    assert!(answers.next().is_some(), "{stderr}{log}");
}

#[test]
fn who_has_no_camera_gets_none() {
    for (port, expected) in [
        ("20=/dev/null", "the scenario has no camera 20"),
        ("3=/nowhere", "/nowhere does not exist"),
        ("3", "such as 3=/dev/ttyUSB0"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["run", "lab", "--port", port])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(stderr.contains(expected), "{stderr}");
    }
}

#[test]
fn an_emulator_that_ends_is_told_with_its_status() {
    let files = TempDir::new().unwrap();
    let emulator = files.path().join("qemu-system-arm");
    let script = "#!/bin/sh\n[ \"$1\" = --version ] && exit 0\necho no such machine\nexit 3\n";
    fs::write(&emulator, script).unwrap();
    fs::set_permissions(&emulator, fs::Permissions::from_mode(0o755)).unwrap();
    let image = files.path().join("image.elf");
    fs::write(&image, "").unwrap();
    let output = host_sim(files.path(), &["--image", image.to_str().unwrap()]);
    refused(&output, "ended (exit status: 3)");
    let stderr = String::from_utf8(output.stderr).unwrap();
    let log = stderr.split_once("printed is in ").unwrap().1;
    let log = Path::new(log.split_once(',').unwrap().0);
    assert_eq!(fs::read_to_string(log).unwrap(), "no such machine\n");
    fs::remove_dir_all(log.parent().unwrap()).unwrap();
}
