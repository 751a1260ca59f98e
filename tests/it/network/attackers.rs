//! An attacker without the key: permanent sending changes no pose, cuts no node off, and has nodes
//! send little.

use host_sim::network::{Options, Simulation};
use results::record::{Attack, Radio, RunRecord};
use site::{Action, Forgery, Overrides, Scenario};

use crate::network::yard::{Yard, assert_all_calibrated, run, with};

/// Time until every node was switched on and has found its network, seconds.
const SET_UP_S: f64 = 20.0;

/// Forgeries, and periods with which each takes about one percent of the air.
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

/// Thirty-one nodes of one hop: cameras on a ring that look inwards, a coordinator and a target.
fn ring(seed: u64) -> Scenario {
    let camera = |n: u32| {
        let angle = f64::from(n) * 360.0 / 29.0;
        let (sin, cos) = angle.to_radians().sin_cos();
        format!(
            "{{ id = {}, x = {}, y = {}, heading_deg = {} }}",
            n + 1,
            10.0 + 8.0 * cos,
            10.0 + 8.0 * sin,
            (angle + 180.0) % 360.0
        )
    };
    let cameras: Vec<String> = (0..29).map(camera).collect();
    let text = format!(
        r#"
        name = "ring"
        [camera]
        field_of_view_sigma = 0
        principal_sigma = 0
        range = 15.0
        [[network]]
        references = {{ cameras = [1, 8], baseline_sigma = 0, position_sigma = 0 }}
        camera = [{}]
        target = [{{ id = 40, stops = [STOPS] }}]
        "#,
        cameras.join(", ")
    );
    let stops = "[9.0, 8.8], [11.0, 9.1], [10.2, 11.0], [8.8, 10.6], [11.1, 11.2], [9.3, 9.6], [12.0, 10.1]";
    let seed = Overrides {
        seed: Some(seed),
        ..Overrides::default()
    };
    Scenario::from_toml(&text.replace("STOPS", stops), &seed).unwrap()
}

/// All members once answered each forged broadcast with requests: 38 to 65 times its bytes.
#[test]
fn thirty_one_nodes_answer_little_and_stay() {
    let calm = run(ring(1));
    let posed = |record: &RunRecord| record.cameras().filter(|c| c.estimate.is_some()).count();
    assert_eq!(posed(&calm), 29);
    let sent = calm.radio.unwrap().bytes as f64;
    for what in FORGERIES {
        let (record, connected) = attacked(with(ring(1), 0.0, forge(what)));
        assert!(connected >= 0.95, "{what:?}: {connected}");
        let (all, attack) = radio(&record);
        let more = all.bytes as f64 - attack.bytes as f64 - sent;
        let amplification = more / attack.bytes as f64;
        println!("{what:?}: {connected:.3} of the time, {amplification:.2} times");
        assert!(amplification <= 2.0, "{what:?}: {amplification}");
        for camera in record.cameras() {
            let wrong = camera.nees.is_some_and(|nees| nees > 30.7);
            assert!(!wrong, "{what:?}: camera {}: {:?}", camera.id, camera.error);
        }
        assert_eq!(posed(&record), 29, "{what:?}");
    }
}

/// Bytes that nodes send because of the attacker, over the attacker's own.
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

/// These once moved a network to another channel or identifier for ever.
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
