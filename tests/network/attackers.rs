//! Somebody without the key: what is sent all the time changes no pose, cuts nobody off, and has nodes
//! send little.

use answers::record::{Attack, Radio, RunRecord};
use host_sim::network::{Options, Simulation};
use site::{Action, Forgery, Scenario};

use crate::yard::{Yard, assert_all_calibrated, run, with};

/// Seconds until every node was switched on and has found its network.
const SET_UP_S: f64 = 20.0;

/// What somebody sends, and how often so that it takes about one percent of the air.
const FORGERIES: [(Forgery, f64); 4] = [
    (Forgery::Random, 0.22),
    (Forgery::Flipped, 0.15),
    (Forgery::Broadcast, 0.15),
    (Forgery::Beacon, 0.12),
];

fn forge((frames, every_s): (Forgery, f64)) -> Action {
    Action::Forge {
        frames,
        every_s,
        for_s: 1e4,
    }
}

/// The record, and the share of the time since set-up that nodes belonged to their network.
fn attacked(scenario: Scenario) -> (RunRecord, f64) {
    let mut simulation = Simulation::new(scenario, Options::default()).unwrap();
    let (mut joined, mut nodes) = (0, 0);
    let record = simulation.run(|progress| {
        if progress.seconds > SET_UP_S {
            joined += progress.joined;
            nodes += progress.nodes;
        }
    });
    assert!(nodes > 0);
    (record, joined as f64 / nodes as f64)
}

fn radio(record: &RunRecord) -> (&Radio, &Attack) {
    let radio = record.radio.as_ref().unwrap();
    (radio, radio.attack.as_ref().unwrap())
}

#[test]
fn forged_frames_deceive_nobody_and_cut_nobody_off() {
    for seed in [21, 22] {
        for what in FORGERIES {
            let scenario = with(Yard::default().scenario(seed), 0.0, forge(what));
            let (record, connected) = attacked(scenario);
            assert_all_calibrated(&record, &format!("{what:?}, seed {seed}"));
            assert!(connected >= 0.95, "{what:?}, seed {seed}: {connected}");
            let (_, attack) = radio(&record);
            let share = attack.airtime_share;
            assert!((0.007..0.02).contains(&share), "{what:?}: {share}");
        }
    }
}

/// Bytes that nodes send because of it, over those of the attacker.
#[test]
fn forged_frames_make_nodes_send_little() {
    for what in FORGERIES {
        let calm = run(Yard::default().scenario(21)).radio.unwrap();
        assert_eq!(calm.attack, None);
        let record = run(with(Yard::default().scenario(21), 0.0, forge(what)));
        let (all, attack) = radio(&record);
        let more = all.bytes as f64 - attack.bytes as f64 - calm.bytes as f64;
        let amplification = more / attack.bytes as f64;
        assert!(amplification <= 2.0, "{what:?}: {amplification}");
    }
}

/// What once moved a network to another channel or identifier for ever.
#[test]
fn a_forged_beacon_and_a_jammer_now_and_then_do_not_scatter_a_network() {
    let beacon = forge((Forgery::Beacon, 61.0));
    let mut scenario = with(Yard::default().scenario(21), 20.0, beacon);
    for burst in 0..20 {
        let jam = Action::Jam {
            for_s: 0.4,
            channel: None,
            at: None,
            reach: None,
        };
        scenario = with(scenario, 20.1 + 61.0 * f64::from(burst), jam);
    }
    let (record, connected) = attacked(scenario);
    assert_all_calibrated(&record, "beacons and a jammer");
    assert!(connected >= 0.95, "{connected}");
    assert!(radio(&record).1.airtime_share < 0.01);
}
