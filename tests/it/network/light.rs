//! Cameras in another light than the one to which they adapted.

use std::{fs, path::Path};

use results::record::verdict::Verdict;
use site::{Action, Overrides, Scenario};

use crate::network::yard::{Yard, assert_all_calibrated, logged, node, run, with};

/// Three rounds of the same stops.
fn rounds(seed: u64) -> Scenario {
    let yard = Yard {
        targets: "{ id = 20, stops = [STOPS, STOPS, STOPS] }",
        ..Yard::default()
    };
    yard.scenario(seed)
}

/// White balance and gain are frozen after a start: all cameras are blinded at once.
#[test]
fn cameras_adapt_to_another_daylight() {
    for (seed, level, kelvin) in [(1, 0.4, 3_200.0), (2, 0.35, 6_504.0), (3, 2.0, 6_504.0)] {
        let calm = run(rounds(seed));
        let at = calm.targets[0].stops[1].seconds.unwrap() + 2.0;
        let (record, log) = logged(with(rounds(seed), at, Action::Daylight { level, kelvin }));
        let what = format!("seed {seed}, {level} at {kelvin} K");
        assert!(log.contains("NotReady"), "{what}: nobody had to adapt");
        assert_all_calibrated(&record, &what);
    }
}

/// There is no light: a camera that had a pose says that it is blind.
#[test]
fn a_camera_that_stays_blind_says_so() {
    let calm = run(rounds(4));
    let at = calm.targets[0].stops[9].seconds.unwrap() + 2.0;
    let dark = Action::Daylight {
        level: 0.0,
        kelvin: 6_504.0,
    };
    let record = run(with(rounds(4), at, dark));
    let verdict = Verdict::of(&record);
    assert!(!verdict.unwell.is_empty(), "{verdict}");
    assert!(
        verdict.to_string().contains("blind: it adapted"),
        "{verdict}"
    );
    assert!(Verdict::of(&calm).unwell.is_empty());
}

/// Its power came back while the target stood before its lens, so it took the ball's orange for white.
#[test]
fn a_camera_that_started_with_the_target_before_its_lens_sees_again() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/faults/D_blind_after_restart.toml");
    let text = fs::read_to_string(file).unwrap();
    let scenario = Scenario::from_toml(&text, &Overrides::default()).unwrap();
    let record = run(scenario);
    // Camera 9 had no power for a while, and the target comes by twice more.
    let camera = node(&record, 9);
    assert!(camera.sightings >= 3, "{}", camera.sightings);
    assert!(camera.estimate.is_some());
}

/// A target that is too far away, as in most of a walk for most cameras, makes no camera blind.
#[test]
fn nobody_is_unwell_where_nothing_is_wrong() {
    for name in ["lab", "thesis-13", "office"] {
        for seed in 1..=3 {
            let seed = Overrides {
                seed: Some(seed),
                ..Overrides::default()
            };
            let record = run(Scenario::load(name, &seed).unwrap());
            let verdict = Verdict::of(&record);
            assert!(verdict.unwell.is_empty(), "{name}: {verdict}");
        }
    }
}
