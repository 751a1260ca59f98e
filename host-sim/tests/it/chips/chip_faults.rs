//! Faults by order of a scenario, on emulated chips.
//!
//! `NODE_CUTS` is the number of power cuts, `NODE_SEED` the first of their seeds.

use std::{collections::BTreeMap, env};

use node_firmware::{
    facts::{Fact, FactKey, KeptSighting},
    limits::SIGHTINGS,
};
use rand::RngExt;
use results::record::Role;
use site::{Action, ScriptedEvent};
use virtual_hardware::random::Root;

use super::*;

/// Power cuts of one calibration.
const AT_ONCE: u64 = 100;
/// Number of them in the stage, besides those of other tests.
const USUAL: u64 = 30;

/// Facts of a node that must not vanish, by their keys. They may become better, but a measurement at a stop
/// does not change.
type Known = BTreeMap<u8, Fact>;

fn known(facts: &[Fact]) -> Known {
    let says = |fact: &&Fact| {
        !matches!(
            fact,
            Fact::Report(None)
                | Fact::References(None)
                | Fact::Sighting(_, None)
                | Fact::ReferenceStop(_, None)
                | Fact::Camera(_, None)
                | Fact::Posed(None)
        )
    };
    let facts = facts.iter().filter(says);
    facts.map(|fact| (fact.key().record(), *fact)).collect()
}

/// Facts that are no longer known, or are of another network. A reference's stops are given up for the pose that
/// they led to, and a camera's sightings once it is a reference.
fn lost(before: &Known, now: &Known) -> Vec<FactKey> {
    let report = match now.get(&FactKey::Report.record()) {
        Some(Fact::Report(report)) => *report,
        _ => None,
    };
    let is_posed = report.is_some_and(|report| report.pose().is_some());
    let has_duty = report.is_some_and(|report| report.duty.is_some());
    let kept = |fact: &Fact| match fact {
        Fact::Sighting(_, kept) => *kept,
        _ => None,
    };
    // A camera that has more than it has room for keeps the last ones.
    let is_full = now.values().filter_map(kept).count() == SIGHTINGS;
    let is_known = |was: &KeptSighting| {
        let mut all = now.values().filter_map(kept);
        let key = |kept: &KeptSighting| (kept.target, kept.stop);
        all.any(|is| key(&is) == key(was) && is.seen == was.seen)
    };
    let is_lost = |(record, was): &(&u8, &Fact)| match (was, now.get(*record)) {
        (Fact::ReferenceStop(..), None) => !is_posed,
        (Fact::Sighting(_, Some(was)), _) => !(has_duty || is_full || is_known(was)),
        (_, None) => true,
        (Fact::Network(was), Some(Fact::Network(is))) => is != was,
        (Fact::Report(Some(was)), Some(Fact::Report(Some(is)))) => {
            was.pose().is_some() && is.pose().is_none()
        }
        _ => false,
    };
    let lost = before.iter().filter(is_lost);
    lost.map(|(_, fact)| fact.key()).collect()
}

/// Cuts at random instants of a calibration, every other one in the middle of a write to the flash. A target
/// that is off misses its carrier's steps, as a real one does: it loses its power where it writes, which it
/// does when it has come to a stop, and when it leaves one.
fn cuts(nodes: &[(u16, Role)], count: u64, seed: u64) -> Vec<ScriptedEvent> {
    let mut random = Root(seed).stream("cuts", 0);
    let mut cut = || {
        let (node, role) = nodes[random.random_range(0..nodes.len())];
        ScriptedEvent {
            at_s: random.random_range(0.5..215.0),
            action: Action::PowerCut {
                node,
                for_s: random.random_range(0.05..0.5),
                in_flash_write: random.random() || role == Role::Target,
            },
        }
    };
    (0..count).map(|_| cut()).collect()
}

/// A calibration of `lab` with cuts, of a target too where the seed is odd. Returns the numbers of cuts, of
/// cuts that tore a write, and of facts that were there before a cut.
fn calibration_with_cuts(count: u64, seed: u64) -> [usize; 3] {
    let mut scenario = Scenario::load("lab", &planned()).unwrap();
    let nodes: Vec<_> = [(site::coordinator_id(0), Role::Coordinator)]
        .into_iter()
        .chain((1..=7).map(|id| (id, Role::Camera)))
        .chain([(20, Role::Target)])
        .collect();
    // The target is the last.
    let has_cut_target = seed % 2 == 1;
    let cut = &nodes[..nodes.len() - usize::from(!has_cut_target)];
    scenario.events = cuts(cut, count, seed);
    let mut before: BTreeMap<u16, Known> = BTreeMap::new();
    let mut most = 0;
    let mut look = |simulation: &mut Simulation| {
        for (node, _) in &nodes {
            let now = known(&simulation.memory(*node));
            let was = before.entry(*node).or_default();
            let lost = lost(was, &now);
            assert!(
                lost.is_empty(),
                "{} s: node {node} has lost {lost:?}",
                simulation.seconds()
            );
            *was = now;
        }
        most = most.max(before.values().map(BTreeMap::len).sum());
    };
    let (_, record, [_, log]) = run_watched(scenario, 12, Some(&mut look));
    for node in &record.nodes {
        let is_known = node.address.is_some() || node.role == Role::Coordinator;
        assert!(is_known, "seed {seed}: node {} is no member", node.id);
    }
    println!("{} of 7 cameras are calibrated", record.summary.calibrated);
    // The stage's few cuts, which spare the target, keep no camera from its pose. A target that missed steps does
    // not know its place any more, and poses stay less certain than asked for. With a cut every two seconds, as in
    // the bench, cameras do not see enough. There it is asserted only that some are calibrated.
    let is_spared = !has_cut_target && count <= USUAL;
    assert!(record.summary.calibrated >= if is_spared { 7 } else { 1 });
    let log = String::from_utf8_lossy(&log);
    let made = log.matches("loses its power").count();
    let torn = log.matches("in the middle of a write").count();
    [made, torn, most]
}

/// All faults that a scenario may have, one after the other, with clocks as wrong as a site may have them.
const ALL: &str = r#"
clock_ppm = 500.0

[[event]]
at_s = 0.5
action = { wear-out = { node = 3 } }

[[event]]
at_s = 3.0
action = { jam = { for_s = 3.0, channel = 20 } }

[[event]]
at_s = 8.0
action = { partition = { nodes = [2], for_s = 1.0 } }

[[event]]
at_s = 9.0
action = { loss = { share = 0.5, for_s = 1.0 } }

[[event]]
at_s = 10.0
action = { restart = { node = 1 } }

[[event]]
at_s = 12.0
action = { unplug-camera = { node = 2, for_s = 1.0 } }

[[event]]
at_s = 14.0
action = { stick-camera = { node = 1, for_s = 1.0 } }

[[event]]
at_s = 15.0
action = { daylight = { level = 0.8, kelvin = 5000.0 } }

[[event]]
at_s = 16.0
action = { camera-faults = { node = 1, for_s = 1.0, faults = { corrupt_line = 0.01 } } }

[[event]]
at_s = 17.0
action = { bump-camera = { node = 3, by = [0.5, 0.0], turn_deg = 1.0 } }

[[event]]
at_s = 18.0
action = { slip = { node = 20, for_s = 1.0, distance = 0.1 } }

[[event]]
at_s = 18.5
action = { unplug-sensor = { node = 20, for_s = 3.0 } }

[[event]]
at_s = 19.0
action = { rest = { node = 20, for_s = 1.0 } }

[[event]]
at_s = 20.0
action = { ignore-lamp = { node = 20, for_s = 1.0 } }

[[event]]
at_s = 20.5
action = { press-button = { node = 1, button = "learn-colour" } }

[[event]]
at_s = 21.0
action = { rot = { node = 2, bits = 20000 } }

[[event]]
at_s = 22.0
action = { replay = { node = 1, last_s = 5.0 } }

[[event]]
at_s = 24.0
action = { forge = { frames = "beacon", every_s = 0.2, for_s = 2.0 } }
"#;

/// Times at which frames began, seconds.
fn sent(pcap: &[u8]) -> Vec<f64> {
    let word = |at: usize| u32::from_le_bytes(pcap[at..at + 4].try_into().unwrap());
    let (mut at, mut times) = (24, Vec::new());
    while at < pcap.len() {
        times.push(f64::from(word(at)) + 1e-6 * f64::from(word(at + 4)));
        at += 16 + word(at + 8) as usize;
    }
    times
}

/// Each fault reaches the chips and their surroundings; one that concerns the chip alone is felt there.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn whatever_a_scenario_has_go_wrong_does() {
    // The small network's own events come at its end.
    let (network, _) = SMALL.split_once("[[event]]").unwrap();
    let (first, rest) = ALL.trim_start().split_once('\n').unwrap();
    let text = format!("{first}\n{network}{rest}");
    let scenario = Scenario::from_toml(&text, &planned()).unwrap();
    let events = scenario.events.len();
    let (_, record, [pcap, log]) = run(scenario, 0);
    let log = String::from_utf8_lossy(&log);
    for words in [
        "has a flash that is worn",
        "is restarted",
        "has its camera unplugged",
        "has a camera that sticks",
        "has a camera with other faults",
        "has its camera moved",
        "slips",
        "has its step sensor unplugged",
        "has its step sensor back",
        "has a carrier who rests",
        "has a carrier who does not heed the lamp",
        "has its button pressed",
        "has bits of its flash flip",
        "is heard again",
    ] {
        assert_eq!(
            log.matches(words).count(),
            1 + usize::from(words == "slips"),
            "{words}"
        );
    }
    assert_eq!(events, 18);
    // A node that assesses a jammed channel finds it busy, and does not send.
    let sent = sent(&pcap);
    let within = |from: f64, to: f64| sent.iter().filter(|at| (from..to).contains(*at)).count();
    let counts = [within(0.0, 3.0), within(3.001, 6.0), within(6.0, 9.0)];
    assert!(
        counts[0] > 5 && counts[1] == 0 && counts[2] > 2,
        "{counts:?}"
    );
    // A node with worn flash works from RAM, and says so.
    assert!(log.contains("memory: Ram"), "{log}");
    // A target without its step sensor names it.
    assert!(log.contains("fault: Absent"), "{log}");
    assert!(record.nodes.iter().all(|node| node.failures.is_empty()));
}

/// Cameras that were told the wrong colour. One of them learns the right one at the press of a button, from the
/// person in the middle of its view.
const WRONG_COLOUR: &str = r#"
name = "wrong-colour"

[[network]]
references = { cameras = [1, 2] }
camera = [
  { id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 },
  { id = 2, x = 8.0, y = 0.0, heading_deg = 135.0 },
  { id = 3, x = 4.0, y = 9.0, heading_deg = 270.0 },
]

[[network.target]]
id = 20
radius = 0.8
stops = [[4.0, 6.3], [4.0, 5.5], [4.4, 5.0]]
window = { red = [16, 60], green = [16, 60], blue = [180, 240] }

[[event]]
at_s = 1.0
action = { rest = { node = 20, for_s = 40.0 } }

[[event]]
at_s = 25.0
action = { press-button = { node = 3, button = "learn-colour" } }
"#;

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_button_has_a_camera_learn_a_colour() {
    let nothing = Overrides::default();
    let scenario = Scenario::from_toml(WRONG_COLOUR, &nothing).unwrap();
    let (simulation, _, _) = run(scenario, 0);
    let has_learnt = |node: u16| {
        let memory = simulation.memory(node);
        memory.iter().any(|fact| matches!(fact, Fact::Colours(_)))
    };
    assert_eq!([1, 2, 3].map(has_learnt), [false, false, true]);
}

/// The facts outlast every loss of power, all nodes are members in the end, and all cameras calibrated where cuts
/// are few and the target is spared.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn power_cuts_over_a_calibration_lose_nothing() {
    let number = |name, usual| env::var(name).map_or(usual, |text| text.parse().unwrap());
    let (mut left, mut seed) = (number("NODE_CUTS", USUAL), number("NODE_SEED", 2));
    let mut all = [0; 2];
    while left > 0 {
        let [made, torn, facts] = calibration_with_cuts(left.min(AT_ONCE), seed);
        println!("seed {seed}: {made} cuts, {torn} in a write; {facts} facts, none lost");
        assert!(made > 0 && torn > 0);
        left = left.saturating_sub(made as u64);
        seed += 1;
        all = [all[0] + made, all[1] + torn];
    }
    println!("{} power cuts, {} in a write: nothing lost", all[0], all[1]);
}
