//! Networks of every kind.

use calib_core::camera::Projection;
use host_sim::{
    record::{
        RunRecord,
        verdict::{Common, Verdict},
    },
    scenario::{Overrides, Scenario},
    world::Variant,
};

use crate::yard::{TARGET, Yard, assert_all_calibrated, assert_calibrated_within, node, run};

#[test]
fn references_that_are_given() {
    for seed in 1..=5 {
        let record = run(Yard::default().scenario(seed));
        assert_all_calibrated(&record, &format!("seed {seed}"));
        assert!(node(&record, 1).reference && node(&record, 2).reference);
    }
}

/// Nobody knows who the references are, how far they are from each other, or where the target's
/// compass points. The frame is that of whoever was elected.
#[test]
fn references_that_are_elected() {
    for seed in 1..=5 {
        let yard = Yard {
            references: "cameras = [1, 2], elected = true, baseline_known = false, \
                         frame_heading_known = false, compass_deg = 30.0",
            ..Yard::default()
        };
        let record = run(yard.scenario(seed));
        assert_all_calibrated(&record, &format!("seed {seed}"));
        let references: Vec<_> = record.cameras().filter(|c| c.reference).collect();
        assert_eq!(references.len(), 2);
        let origin = references
            .iter()
            .filter_map(|camera| camera.truth)
            .filter(|truth| truth.x == 0.0 && truth.y == 0.0);
        assert_eq!(origin.count(), 1);
    }
}

#[test]
fn two_targets_of_two_colours() {
    for seed in 1..=5 {
        let yard = Yard {
            targets: "{ id = 20, stops = [STOPS] }, { id = 21, colour = [40, 200, 60], stops = \
                      [[5.0, 4.1], [3.1, 4.4], [4.0, 3.4], [3.5, 5.1], [5.3, 4.6], [4.4, 3.7], \
                      [2.9, 3.8], [4.7, 5.5]] }",
            ..Yard::default()
        };
        let record = run(yard.scenario(seed));
        // The second target finds its place and compass from cameras that are calibrated, and
        // knows them less well.
        assert_calibrated_within(&record, &format!("seed {seed}"), 0.6);
        for target in &record.targets {
            let last = target.stops.last().unwrap();
            let believed = last.believed.unwrap_or_else(|| {
                panic!("seed {seed}: target {} never learnt where it is", target.id)
            });
            let error = (believed.x - last.x).hypot(believed.y - last.y);
            assert!(error < 5.0 * believed.sigma_x.hypot(believed.sigma_y));
        }
        let seen_by_all = |id| {
            let mut cameras = record.cameras().filter(|camera| !camera.reference);
            cameras.all(|camera| camera.residuals.iter().any(|r| r.target == id))
        };
        assert!(seen_by_all(TARGET) || seen_by_all(21));
    }
}

/// The background is learnt while the target is still outside. Blocks of pixels are compared, in
/// one channel, so that sightings are coarse, and the target must be brighter than what is behind.
#[test]
fn targets_that_are_found_by_motion() {
    let yard = Yard {
        tables: "[firmware]\nmotion = true",
        targets: "{ id = 20, radius = 0.4, colour = [240, 240, 240], stops = [[4.0, -2.5], STOPS] }",
        ..Yard::default()
    };
    for seed in 1..=3 {
        let record = run(yard.scenario(seed));
        assert_calibrated_within(&record, &format!("seed {seed}"), 0.6);
    }
}

/// The thesis's cameras, and what their nodes take them for.
fn stage(model: Projection) -> RunRecord {
    let changes = Overrides {
        seed: Some(3),
        stops: Some(10),
        variant: Some(Variant::Stage),
        model: Some(model),
        ..Overrides::default()
    };
    run(Scenario::load("thesis-13", &changes).unwrap())
}

#[test]
fn cameras_of_equal_angles_need_that_model() {
    let right = stage(Projection::EqualAngle);
    assert_all_calibrated(&right, "equal angles");
    let is_misfit = |common: &Common| matches!(common, Common::Misfit(_));
    assert!(!Verdict::of(&right).common.iter().any(is_misfit));

    let wrong = stage(Projection::PinHole);
    let verdict = Verdict::of(&wrong);
    assert!(verdict.common.iter().any(is_misfit), "{verdict}");
    let rms = |record: &RunRecord| {
        let cameras = record.summary.cameras.as_ref();
        cameras.map_or(f64::INFINITY, |cameras| cameras.position.rms)
    };
    assert!(rms(&wrong) > 2.0 * rms(&right));
}

/// Refining goes on with more stops, and makes poses better.
#[test]
fn more_stops_make_better_poses() {
    let sigma = |stops: usize| {
        let changes = Overrides {
            seed: Some(1),
            stops: Some(stops),
            ..Overrides::default()
        };
        let record = run(Scenario::load("thesis-13", &changes).unwrap());
        assert_all_calibrated(&record, &format!("{stops} stops"));
        let mut cameras = record.cameras().filter(|camera| !camera.reference);
        cameras.try_fold(0.0, |sum, camera| {
            Some(sum + camera.estimate.as_ref()?.sigma_heading_deg)
        })
    };
    assert!(sigma(3) > sigma(10));
}
