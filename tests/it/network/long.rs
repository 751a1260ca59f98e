//! Effects that take long, or pass unnoticed: idle days, restarts in them, flash that rots and wears, clocks
//! that drift, carriers who rest or hurry.

use std::collections::BTreeMap;

use results::record::{Estimate, RunRecord};
use site::{Action, Overrides, Scenario};
use test_support::amount;

use crate::network::yard::{
    COORDINATOR, OTHERS, TARGET, Yard, assert_all_calibrated, assert_fair,
    assert_nothing_forgotten, logged, run, with,
};

const HOUR_S: f64 = 3600.0;
const DAY_S: f64 = 24.0 * HOUR_S;

/// Number of erasures that a page lasts for at least (nRF52840 Product Specification, "Flash").
const ENDURANCE: f64 = 10_000.0;

fn yard() -> Scenario {
    Yard::default().scenario(31)
}

/// In the middle of its walk, the target stands for that long, while another node restarts every hour. After its
/// own restarts the target asks the cameras again for their measurements, again and again at one place.
fn idle(days: f64) -> Scenario {
    let calm = run(yard());
    let at = calm.targets[0].stops[4].seconds.unwrap();
    let rest = Action::Rest {
        node: TARGET,
        for_s: days * DAY_S,
    };
    let all = [COORDINATOR, 1, 2, 3, 4, 5, TARGET];
    let hours = 1..(days * 24.0) as usize;
    hours.fold(with(yard(), at, rest), |scenario, hour| {
        let node = all[hour % all.len()];
        let at = at + hour as f64 * HOUR_S;
        with(scenario, at, Action::Restart { node })
    })
}

/// However often a target asks at one place, repeated answers are not taken for news: errors agree with sigmas.
#[test]
fn who_asks_again_and_again_learns_no_more() {
    let records: Vec<_> = (0..8)
        .map(|seed| {
            let walk = || Yard::default().scenario(seed);
            let at = run(walk()).targets[0].stops[4].seconds.unwrap();
            let rest = Action::Rest {
                node: TARGET,
                for_s: 2.0 * DAY_S,
            };
            let asks = (1..48).fold(with(walk(), at, rest), |scenario, hour| {
                let at = at + f64::from(hour) * HOUR_S;
                with(scenario, at, Action::Restart { node: TARGET })
            });
            run(asks)
        })
        .collect();
    for (seed, record) in (0..).zip(&records) {
        assert_all_calibrated(record, "asked again and again");
        let calm = run(Yard::default().scenario(seed));
        let sigmas = |record: &RunRecord| -> f64 {
            let estimates = record
                .cameras()
                .filter_map(|camera| camera.estimate.as_ref());
            estimates.map(Estimate::sigma_position).sum()
        };
        // Cost of the first restart: the way from one stop to the next.
        assert!(sigmas(record) < 1.5 * sigmas(&calm), "seed {seed}");
    }
    assert_fair(&records);
}

/// No node forgets anything, every camera is found at the end, and flash lasts for years.
#[test]
fn seven_idle_days_with_a_restart_every_hour() {
    let days = 7.0;
    let (record, log) = logged(idle(days));
    assert!(record.sim_seconds > days * DAY_S);
    assert_all_calibrated(&record, "idle days");
    assert_nothing_forgotten(&log, "idle days");
    for node in &record.nodes {
        assert!(node.failures.is_empty(), "{:?}", node.failures);
        let erasures = f64::from(node.page_erasures.unwrap() - 1);
        let years = ENDURANCE / erasures * days / 365.25;
        println!(
            "node {}: {erasures} erasures of a page, {years:.1} years",
            node.id
        );
        assert!(years > 5.0, "node {}: {years} years", node.id);
    }
}

/// Three walks an hour apart. Between them nodes and their cameras sleep, and are woken when the target leaves. A camera
/// sees it as often as one that never sleeps, but for a look or two that are a matter of chance.
#[test]
fn cameras_that_sleep_between_walks_miss_none_of_their_stops() {
    for seed in 0..amount(3, 30) {
        let [awake, asleep] = [false, true].map(|sleep| {
            let overrides = Overrides {
                seed: Some(seed),
                path: Some(1 + seed % 3),
                ..Overrides::default()
            };
            let mut scenario = Scenario::load("lab", &overrides).unwrap();
            scenario.firmware.sleep = Some(sleep);
            scenario.walk.walks = 3;
            scenario.walk.every_s = HOUR_S;
            let record = run(scenario);
            assert!(record.sim_seconds > 2.0 * HOUR_S);
            assert_all_calibrated(&record, "walks an hour apart");
            let mut seen = BTreeMap::<u16, usize>::new();
            for bearing in &record.sightings[0].bearings {
                *seen.entry(bearing.camera).or_default() += 1;
            }
            seen
        });
        for (camera, stops) in awake {
            let kept = asleep.get(&camera).copied().unwrap_or_default();
            assert!(
                kept + 2 >= stops,
                "seed {seed}, camera {camera}: {kept} of {stops}"
            );
        }
    }
}

/// Before each day's walk through an office some cameras were moved: more of them than a target has numbers to spare, and
/// one of them twice. That walk and the next find all of them again.
#[test]
fn cameras_move_again_and_again() {
    let mut scenario = Scenario::load("office", &Overrides::default()).unwrap();
    let moves = [(1, 14), (1, 5), (1, 8), (2, 16), (2, 12), (3, 14), (3, 10)];
    scenario.walk.walks = 5;
    scenario.walk.every_s = DAY_S;
    scenario.walk.arrive_within = 0.2;
    for (day, node) in moves {
        let bump = Action::BumpCamera {
            node,
            by: [0.1, -0.1],
            turn_deg: 9.0,
        };
        scenario = with(scenario, (f64::from(day) - 0.5) * DAY_S, bump);
    }
    let record = run(scenario);
    assert!(record.sim_seconds > 4.0 * DAY_S);
    assert_all_calibrated(&record, "moved");
    for camera in record.cameras() {
        if !moves.iter().any(|(_, node)| *node == camera.id) {
            continue;
        }
        let error = camera.error.as_ref().unwrap();
        let sigma = camera.estimate.as_ref().unwrap().sigma_heading_deg;
        assert!(
            camera.nees.unwrap() < 30.0 && error.heading_deg.abs() < 5.0 * sigma,
            "{camera:?}"
        );
    }
}

#[test]
fn a_carrier_who_rests_changes_nothing() {
    let calm = run(yard());
    for at in [0.0, 40.0, 65.0] {
        let rest = Action::Rest {
            node: TARGET,
            for_s: 2.0 * HOUR_S,
        };
        let record = run(with(yard(), at, rest));
        assert_all_calibrated(&record, &format!("a rest at {at}"));
        assert_eq!(record.targets[0].stops.len(), calm.targets[0].stops.len());
        assert!(record.sim_seconds > 2.0 * HOUR_S);
    }
}

/// The target is away before most cameras have looked. Their measurements of it are not taken for measurements
/// at the stop: no pose deceives.
#[test]
fn a_carrier_who_ignores_the_lamp_deceives_nobody() {
    let mut calibrated = 0;
    for (seed, stand_s) in (0..).zip([0.1, 0.3, 0.6, 1.0, 2.0, 3.0]) {
        let hurry = Action::IgnoreLamp {
            node: TARGET,
            for_s: 1e4,
            stand_s,
        };
        let record = run(with(Yard::default().scenario(seed), 0.0, hurry));
        for camera in record.cameras() {
            let wrong = camera.nees.is_some_and(|nees| nees > 30.7);
            assert!(!wrong, "{stand_s} s at each stop: {:?}", camera.error);
        }
        calibrated += record.summary.calibrated;
    }
    // A carrier who stands for some seconds is seen.
    assert!(calibrated >= OTHERS.len());
}

/// Flipped bits cost only the data in which they are, and never make a pose wrong.
#[test]
fn flash_that_rots_deceives_nobody() {
    for id in [COORDINATOR, 1, 2, 3, TARGET] {
        for (bits, at) in [(1, 30.0), (20, 60.0), (1000, 60.0)] {
            let rot = with(yard(), at, Action::Rot { node: id, bits });
            let record = run(with(rot, at + 1.0, Action::Restart { node: id }));
            for camera in record.cameras() {
                let wrong = camera.nees.is_some_and(|nees| nees > 30.7);
                assert!(!wrong, "{bits} bits of node {id}: {:?}", camera.error);
            }
        }
    }
}

/// 500 millionths are more than an oscillator without a crystal has.
#[test]
fn clocks_may_drift() {
    for seed in [1, 2, 3] {
        let mut scenario = Yard::default().scenario(seed);
        scenario.clock_ppm = 500.0;
        assert_all_calibrated(&run(scenario), "clocks that drift");
    }
}

/// While its fault lasts a camera answers nothing, and for others the walk goes on.
#[test]
fn faults_of_a_camera_end() {
    let calm = run(yard());
    let faults = Action::CameraFaults {
        node: 4,
        for_s: 20.0,
        faults: [("corrupt_line".into(), 1.0)].into(),
    };
    let at = calm.targets[0].stops[4].seconds.unwrap() + 1.0;
    let record = run(with(yard(), at, faults));
    assert_all_calibrated(&record, "faults for a while");
    assert!(record.sim_seconds > calm.sim_seconds);
}
