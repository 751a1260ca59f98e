//! A reference camera that dies before the poses of the references are known.

use results::record::{
    RunRecord,
    verdict::{Common, Verdict},
};
use site::{Action, Scenario};

use crate::network::yard::{Yard, node, run, with};

/// Both references are elected: the cameras that see the target first.
fn elected(seed: u64) -> Scenario {
    let yard = Yard {
        references: "cameras = [1, 2], elected = true, baseline_known = false, \
                     frame_heading_known = false",
        tables: "[radio]\nmedium = \"unit-disk\"\nrange = 45.0\nloss = 0.1",
        targets: "{ id = 20, stops = [STOPS, STOPS] }",
        ..Yard::default()
    };
    yard.scenario(seed)
}

/// Permanent failures: without its power, or without its camera.
fn deaths(id: u16) -> [Action; 2] {
    let for_s = 1e6;
    [
        Action::PowerCut {
            node: id,
            for_s,
            in_flash_write: false,
        },
        Action::UnplugCamera {
            node: id,
            for_s,
            with_power: true,
        },
    ]
}

/// Time at which the second stop of the walk is told.
fn second_stop(calm: &RunRecord) -> f64 {
    calm.targets[0].stops[1].seconds.unwrap() + 1.0
}

/// Another camera takes its place, and the poses of all remaining cameras are known.
#[test]
fn another_camera_takes_the_place_of_an_elected_one() {
    for seed in 1..=5 {
        let calm = run(elected(seed));
        let at = second_stop(&calm);
        let references: Vec<u16> = calm
            .cameras()
            .filter(|c| c.reference)
            .map(|c| c.id)
            .collect();
        assert_eq!(references.len(), 2);
        for dead in references {
            for death in deaths(dead) {
                let what = format!("seed {seed}, camera {dead}: {death:?}");
                let record = run(with(elected(seed), at, death));
                for camera in record.cameras().filter(|camera| camera.id != dead) {
                    assert!(camera.estimate.is_some(), "{what}: {}", camera.id);
                    assert!(camera.nees.is_none_or(|nees| nees < 30.7), "{what}");
                }
                let verdict = Verdict::of(&record);
                let is_told = verdict.findings.iter().any(|of| of.camera == dead);
                assert!(is_told, "{what}: {verdict}");
            }
        }
    }
}

/// No camera takes the place of a configured one. The user is told which one failed, and what to do.
#[test]
fn of_a_configured_one_people_are_told() {
    for seed in 1..=5 {
        let yard = || Yard::default().scenario(seed);
        let at = second_stop(&run(yard()));
        for dead in [1, 2] {
            for death in deaths(dead) {
                let what = format!("seed {seed}, camera {dead}: {death:?}");
                let record = run(with(yard(), at, death));
                assert!(node(&record, dead).estimate.is_none(), "{what}");
                let verdict = Verdict::of(&record);
                assert!(verdict.common.contains(&Common::Reference(dead)), "{what}");
                let words = verdict.to_string();
                let told = format!("Reference camera {dead} is not there");
                assert!(words.contains(&told), "{what}: {words}");
            }
        }
    }
}
