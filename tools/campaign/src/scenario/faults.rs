//! Faults: events, and lines that err all the time.

use std::collections::BTreeMap;

use rand::{Rng, RngExt, seq::IndexedRandom};
use site::{Action, Forgery, Scenario, ScriptedEvent};

use super::{SAGS, between, happens, is_reference, is_target};

/// Time until the network is formed, seconds.
const SET_UP_S: f64 = 12.0;

/// Approximate duration of a stop, seconds.
const STOP_S: f64 = 4.0;

/// Longer than any run, seconds.
const FOR_EVER_S: f64 = 1e6;

/// Faults of lines between node and camera, with their largest rates.
const LINES: [(&str, f64); 9] = [
    ("corrupt_line", 0.1),
    ("corrupt_byte", 0.005),
    ("stray", 0.005),
    ("overrun", 0.002),
    ("cut", 0.03),
    ("nck", 0.05),
    ("slow", 0.03),
    ("silence", 0.003),
    ("restart", 0.002),
];

/// Approximate duration of the walk, seconds.
pub(super) fn walk_s(scenario: &Scenario) -> f64 {
    let walks = scenario.networks[0].targets.iter().map(|target| {
        let stops = target.stops.as_deref().unwrap_or_default();
        let legs = stops.windows(2);
        let way = legs.map(|leg| (leg[1][0] - leg[0][0]).hypot(leg[1][1] - leg[0][1]));
        way.sum::<f64>() / scenario.walk.speed + stops.len() as f64 * STOP_S
    });
    walks.fold(0.0, f64::max)
}

/// Draws faults of a walk of so many rounds. None begins in the last one and a quarter of them.
pub(super) fn draw(random: &mut impl Rng, scenario: &mut Scenario, rounds: usize) {
    if happens(random, 0.3) {
        for (fault, most) in LINES {
            if happens(random, 0.3) {
                let rate = between(random, 0.0, most);
                scenario.camera.faults.insert(fault.into(), rate);
            }
        }
    }
    let round_s = walk_s(scenario) / rounds as f64;
    let last_s = SET_UP_S + round_s * (rounds as f64 - 1.25);
    let network = &scenario.networks[0];
    let cameras: Vec<u16> = network.cameras.iter().map(|camera| camera.id).collect();
    let targets: Vec<u16> = network.targets.iter().map(|target| target.id).collect();
    let references = match network.references.elected {
        true => cameras.clone(),
        false => network.references.cameras.to_vec(),
    };
    // Many runs have few faults: they show the effect of each.
    let events = random.random_range(0..=3) * random.random_range(0..=3);
    for _ in 0..events {
        let at_s = between(random, 0.1, last_s);
        let lasts_s = between(random, 1.0, (last_s - at_s).clamp(1.001, 60.0));
        for action in actions(random, &cameras, &targets, (at_s, lasts_s)) {
            // The places of references when the network begins are its frame: no fault, but another site.
            let begins_anew = matches!(&action, Action::BumpCamera { node, .. }
                if references.contains(node) && at_s < SET_UP_S + round_s);
            if !begins_anew {
                scenario.events.push(ScriptedEvent { at_s, action });
            }
        }
    }
}

/// Events at a time, for as long as that.
fn actions(
    random: &mut impl Rng,
    cameras: &[u16],
    targets: &[u16],
    (at_s, for_s): (f64, f64),
) -> Vec<Action> {
    let mut one = |nodes: &[u16]| nodes.choose(random).copied().unwrap_or_default();
    let (camera, target) = (one(cameras), one(targets));
    let everybody: Vec<u16> = [&[0], cameras, targets].concat();
    // The coordinator and targets as often as all cameras together.
    let node = match random.random_range(0..3) {
        0 => 0,
        1 => target,
        _ => camera,
    };
    // Some are never mended.
    let mended_s = if happens(random, 0.15) {
        FOR_EVER_S
    } else {
        for_s
    };
    let action = match random.random_range(0..16) {
        0 => {
            return everybody
                .iter()
                .map(|&node| Action::Restart { node })
                .collect();
        }
        1 => Action::Restart { node: target },
        2 => Action::Restart { node },
        3 => Action::PowerCut {
            node,
            for_s,
            in_flash_write: happens(random, 0.5),
        },
        4 => Action::Jam {
            for_s,
            channel: None,
            at: None,
            reach: None,
        },
        5 => {
            let share = random.random_range(0.1..0.9);
            let apart = everybody
                .iter()
                .copied()
                .filter(|_| random.random_bool(share));
            let nodes: Vec<u16> = apart.collect();
            if nodes.is_empty() || nodes.len() == everybody.len() {
                return Vec::new();
            }
            Action::Partition { nodes, for_s }
        }
        6 => Action::Loss {
            share: between(random, 0.3, 0.9),
            for_s,
        },
        7 => Action::UnplugCamera {
            node: camera,
            for_s: mended_s,
            with_power: happens(random, 0.5),
        },
        8 => Action::StickCamera {
            node: camera,
            for_s: mended_s,
        },
        9 => Action::BumpCamera {
            node: camera,
            by: match happens(random, 0.5) {
                true => [(); 2].map(|()| between(random, -0.8, 0.8)),
                false => [0.0; 2],
            },
            turn_deg: between(random, -25.0, 25.0),
        },
        10 => Action::Slip {
            node: target,
            for_s: for_s.min(10.0),
            distance: between(random, -0.5, 0.5),
            heading_deg: between(random, -30.0, 30.0),
        },
        11 => Action::Forge {
            frames: match random.random_range(0..4) {
                0 => Forgery::Random,
                1 => Forgery::Flipped,
                2 => Forgery::Broadcast,
                _ => Forgery::Beacon,
            },
            every_s: between(random, 0.05, 2.0),
            for_s,
        },
        12 => Action::Rest {
            node: target,
            for_s: for_s * 10.0,
        },
        13 => Action::IgnoreLamp {
            node: target,
            for_s,
            stand_s: between(random, 0.5, 5.0),
        },
        14 => Action::Rot {
            node,
            bits: random.random_range(1..=20),
        },
        _ => Action::Replay {
            node,
            last_s: between(random, 0.05, at_s + 0.001),
        },
    };
    vec![action]
}

/// The name of each event of a scenario, for people.
pub(super) fn names(scenario: &Scenario) -> impl Iterator<Item = &'static str> {
    let mut bumps = BTreeMap::<u16, usize>::new();
    for event in &scenario.events {
        if let Action::BumpCamera { node, .. } = event.action {
            *bumps.entry(node).or_default() += 1;
        }
    }
    let name = move |event: &ScriptedEvent| match event.action {
        Action::Restart { node } if is_target(scenario, node) => "restart of a target",
        Action::Restart { .. } => "restart",
        Action::PowerCut {
            in_flash_write: true,
            ..
        } => "torn write",
        Action::PowerCut { .. } => "power cut",
        Action::Jam { .. } => "jam",
        Action::Partition { .. } => "partition",
        Action::Loss { .. } => "loss for a while",
        Action::UnplugCamera { .. } => "unplugged",
        Action::UnplugSensor { .. } => "unplugged step sensor",
        Action::StickCamera { node, .. } if is_reference(scenario, node) => "stuck reference",
        Action::StickCamera { .. } => "stuck camera",
        Action::Daylight { .. } => "daylight",
        Action::BumpCamera { node, .. } if bumps[&node] >= SAGS => "sagging mount",
        Action::BumpCamera { node, .. } if is_reference(scenario, node) => "bumped reference",
        Action::BumpCamera { .. } => "bumped camera",
        Action::Slip { .. } => "slip",
        Action::Replay { .. } => "replay",
        Action::CameraFaults { .. } => "camera faults for a while",
        Action::Rest { .. } => "carrier who rests",
        Action::IgnoreLamp { .. } => "carrier who ignores the lamp",
        Action::PressButton { .. } => "pressed button",
        Action::Rot { .. } => "rot",
        Action::WearOut { .. } => "worn flash",
        Action::Forge { .. } => "forged frames",
    };
    scenario.events.iter().map(name)
}
