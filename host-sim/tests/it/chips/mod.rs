//! Networks on emulated nRF52840s that run the image that is flashed. `cargo xtask test --stage chip` builds
//! it and runs these.
#![cfg(feature = "chip")]

mod chip_faults;

use std::{
    cell::RefCell,
    env, io,
    path::{Path, PathBuf},
    rc::Rc,
};

use crate::small::{SMALL, check_arithmetic};
use host_sim::network::{CHIP_IMAGE, Chips, Onlooker, Options, Simulation};
use node_firmware::facts::Fact;
use results::record::{
    Role, RunRecord,
    event::{Event, What},
};
use site::{Overrides, Scenario};

/// Two more power cuts in the small network: in the middle of the writes to flash when a node joins.
const CUTS: &str = r#"
[[event]]
at_s = 0.5
action = { power-cut = { node = 1, for_s = 0.5, in_flash_write = true } }

[[event]]
at_s = 2.0
action = { power-cut = { node = 0, for_s = 0.2, in_flash_write = true } }
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

/// Time between two looks of the onlooker, nanoseconds.
const LOOKS: u64 = 300_000_000;

/// A run, with all frames on the air and its log.
pub(crate) fn run(
    scenario: Scenario,
    further_stops: usize,
) -> (Simulation, RunRecord, [Vec<u8>; 2]) {
    run_watched(scenario, further_stops, None)
}

/// A run with an onlooker, if wanted.
fn run_watched(
    scenario: Scenario,
    further_stops: usize,
    look: Option<&mut dyn FnMut(&mut Simulation)>,
) -> (Simulation, RunRecord, [Vec<u8>; 2]) {
    let usual = || {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("..")
            .join(CHIP_IMAGE)
    };
    let image = env::var_os("NODE_IMAGE").map_or_else(usual, PathBuf::from);
    let (pcap, log) = (Pages::default(), Pages::default());
    let options = Options {
        chips: Some(Chips::of(&image).unwrap()),
        pcap: Some(Box::new(pcap.clone())),
        log: Some(Box::new(log.clone())),
        further_stops,
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options).unwrap();
    let record = match look {
        Some(look) => {
            simulation.watch();
            simulation.run_watched(LOOKS, |_| (), look)
        }
        None => simulation.run(|_| ()),
    };
    if let Some(trouble) = simulation.trouble() {
        panic!("{trouble}");
    }
    println!(
        "{}: {:.0} s of the network in {:.0} s",
        record.scenario,
        record.sim_seconds,
        record.wall_seconds.unwrap_or_default()
    );
    for (id, chip) in simulation.chips() {
        let [used, all] = chip.stack;
        println!(
            "node {id}: {used} of {all} bytes of stack; {} instructions; radio on for {:?} ms; flash {:?}",
            chip.instructions,
            chip.radio_on.map(|on| on / 1_000_000),
            chip.flash
        );
        assert_eq!(chip.forbidden, [""; 0], "node {id}");
        assert_eq!(chip.overruns, 0, "node {id}");
        assert!((1_000..all).contains(&used), "node {id}: {used} {all}");
    }
    for node in &record.nodes {
        // A chip restarts by itself only when its settings are new.
        assert_eq!(node.failures, [], "node {}", node.id);
        let role = match node.role {
            Role::Coordinator => "coordinator",
            Role::Camera if node.reference => "reference",
            Role::Camera => "camera",
            Role::Target => "target",
        };
        let [used, _] = simulation.chips()[&node.id].stack;
        println!("{role} {used} bytes of stack were used");
    }
    let files = [pcap, log].map(|file| file.0.take());
    (simulation, record, files)
}

/// With twice the stops of a carrier who measures exactly, because this one's steps are uncertain by a tenth.
fn planned() -> Overrides {
    Overrides {
        stops: Some(6),
        ..Overrides::default()
    }
}

/// This also holds where power goes while flash is written. The poses of its cameras are, to the last bit,
/// those that this processor finds from the same sightings.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_network_does_the_same_each_time() {
    let text = format!("{SMALL}{CUTS}");
    let small = || Scenario::from_toml(&text, &planned()).unwrap();
    let (mut looks, mut onlooker) = (0, Onlooker::default());
    let (simulation, record, files) = run_watched(
        small(),
        2,
        Some(&mut |simulation| looks += onlooker.look(simulation).len()),
    );
    assert!(looks > 20);
    // The verdict was made from the flash of the chips while they ran.
    assert_eq!(simulation.further_stops(), 2);
    check_arithmetic(&simulation, &record);
    for node in &record.nodes {
        // The bytes that it sends are not seen before they are encrypted.
        assert_eq!(node.payload_bytes, None);
        let is_known = node.address.is_some() || node.role == Role::Coordinator;
        assert!(is_known, "node {} has not joined", node.id);
    }
    let log = String::from_utf8_lossy(&files[1]);
    assert_eq!(log.matches("loses its power").count(), 3, "{log}");
    // An onlooker, and the number of its looks, change nothing.
    let (_, again, same) = run(small(), 2);
    assert!(files[0].len() > 1_000);
    assert!(files == same, "something else happened");
    let told = |record: RunRecord| RunRecord {
        wall_seconds: None,
        ..record
    };
    assert_eq!(
        told(again).to_json(false).unwrap(),
        told(record).to_json(false).unwrap()
    );
}

/// Facts that only flash has are told while the run goes on: a sighting soon after its stop began, a stop before
/// the next one begins.
fn told_as_it_happens(record: &RunRecord, events: &[Event]) {
    let begins = |event: &Event| match &event.what {
        What::Stop { begins, is, .. } if *begins => Some((event.seconds, is.stop)),
        _ => None,
    };
    let stops: Vec<_> = events.iter().filter_map(begins).collect();
    let ended = record.sim_seconds;
    let early = stops.iter().filter(|(at, _)| *at < ended - 10.0);
    assert!(early.count() > 5, "{stops:?} of {ended} s");
    let sees = |event: &Event| match event.what {
        What::Seen { node, .. } => Some((event.seconds, node)),
        _ => None,
    };
    let seen: Vec<_> = events.iter().filter_map(sees).collect();
    let whole: std::collections::BTreeSet<_> = seen.iter().map(|(at, _)| *at as u64).collect();
    assert!(whole.len() > 5, "{seen:?}");
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn lab_calibrates() {
    let scenario = Scenario::load("lab", &Overrides::default()).unwrap();
    let mut onlooker = Onlooker::default();
    let mut events = Vec::new();
    let (simulation, record, _) = run_watched(
        scenario,
        0,
        Some(&mut |simulation| events.extend(onlooker.look(simulation))),
    );
    told_as_it_happens(&record, &events);
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
    // The target's chip has estimated all of them together.
    for node in &record.nodes {
        let facts = simulation.memory(node.id);
        let mut reports = facts.iter().filter_map(|fact| match fact {
            Fact::Report(report) => *report,
            _ => None,
        });
        let is_joint = reports.any(|report| report.joint.is_some());
        assert_eq!(is_joint, node.role == Role::Camera, "node {}", node.id);
    }
}
