//! Carriers whose steps and compass have errors that the nodes may not know.

use calib_core::camera::Projection;
use rand::RngExt;
use results::record::{
    Node, RunRecord,
    verdict::{Common, Verdict},
};
use site::{Overrides, Scenario, world::Variant};
use test_support::generator;

use crate::network::yard::{Yard, run};

/// Chi squared that three numbers exceed as rarely as one number exceeds five sigmas.
const FIVE_SIGMAS: f64 = 31.8;

/// Systematic errors: the firmware's usual values, and none.
const SYSTEMATIC: [&str; 2] = ["3.0, 0.08", "0.0, 0.0"];

fn deceives(camera: &&Node) -> bool {
    let heading = || {
        let (error, estimate) = (camera.error?, camera.estimate?);
        (estimate.sigma_heading_deg > 0.0)
            .then(|| (error.heading_deg / estimate.sigma_heading_deg).abs() > 5.0)
    };
    match camera.nees {
        Some(nees) => nees > FIVE_SIGMAS,
        None => heading().unwrap_or(false),
    }
}

fn rehearsal(seed: u64, systematic: &str, scale: f64, turn: f64) -> RunRecord {
    let (heading, share) = systematic.split_once(", ").unwrap();
    let tables =
        format!("[sensor]\nmeasures = true\nscale_bias = {scale}\nheading_bias_deg = {turn}\n");
    let yard = Yard {
        tables: &tables,
        systematic: (heading, share),
        ..Yard::default()
    };
    run(yard.scenario(seed))
}

/// No carrier error, declared or not, ends well with a pose five sigmas off.
#[test]
fn no_carrier_deceives_with_exit_code_0() {
    let mut random = generator(12);
    let (mut failed, mut blamed) = (0, 0);
    for seed in 1..=20 {
        let scale = random.random_range(-0.1..0.1);
        let turn = random.random_range(-6.0..6.0);
        for systematic in SYSTEMATIC {
            let record = rehearsal(seed, systematic, scale, turn);
            let verdict = Verdict::of(&record);
            let what = format!("{systematic}: {scale}, {turn}: {verdict}");
            let wrong = record.cameras().filter(deceives).count();
            if wrong > 0 {
                failed += 1;
                assert_eq!(verdict.exit_code(), 1, "{what}");
                blamed += usize::from(what.contains("carrier"));
            }
            let is_lens = |common: &Common| matches!(common, Common::Lens(_));
            assert!(!verdict.common.iter().any(is_lens), "{what}");
        }
    }
    assert!(
        failed > 0,
        "no carrier did any harm: the test shows nothing"
    );
    // Where poses are wrong, the verdict names the carrier.
    assert!(4 * blamed >= 3 * failed, "{blamed} of {failed}");
}

/// Of a carrier that is as good as it says, the verdict does not say that errors are too large or too small.
#[test]
fn a_good_carrier_is_not_blamed() {
    for seed in 1..=10 {
        let verdict = Verdict::of(&rehearsal(seed, SYSTEMATIC[1], 0.0, 0.0));
        assert!(!verdict.to_string().contains("carrier"), "{verdict}");
        assert!(!verdict.deceives, "{verdict}");
    }
}

/// A target may be unsure of its place when a camera sees it. Such places say nothing against a pose that
/// was estimated later, together with all others. They hide no wrong lens either.
#[test]
fn places_that_were_not_sure_are_not_held_against_sightings() {
    let is_lens = |common: &Common| matches!(common, Common::Lens(_));
    let (mut joint, mut blamed) = (0, 0);
    for seed in 1..=10 {
        let changes = Overrides {
            seed: Some(seed),
            drift: true,
            ..Overrides::default()
        };
        let right = run(Scenario::load("thesis-13", &changes).unwrap());
        joint += { right.cameras() }
            .filter(|c| c.protection.is_some())
            .count();
        let verdict = Verdict::of(&right);
        assert_eq!(verdict.common, [], "{seed}: {verdict}");

        let wrong = Overrides {
            variant: Some(Variant::Stage),
            model: Some(Projection::PinHole),
            ..changes
        };
        let wrong = run(Scenario::load("thesis-13", &wrong).unwrap());
        // With such a lens some references get no answer at all, and then no camera does.
        if wrong.summary.calibrated > 0 {
            let verdict = Verdict::of(&wrong);
            assert!(verdict.common.iter().any(is_lens), "{seed}: {verdict}");
            blamed += 1;
        }
    }
    assert!(
        blamed >= 3,
        "{blamed} with an answer: the test shows little"
    );
    assert!(joint > 50, "{joint} joint poses: the test shows little");
}
