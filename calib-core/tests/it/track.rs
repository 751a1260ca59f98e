//! The covariance of a dead-reckoned target, against walks that are really taken.

use std::f64::consts::TAU;

use calib_core::dead_reckoning::{Step, Systematic, Track, TrackError};
use nalgebra::{Matrix2, Matrix4, Point2, Vector4};
use proptest::prelude::*;
use test_support::generator;

use crate::walk;
use walk::{SYSTEMATIC, Walk, step};

#[test]
fn a_square_leads_back_to_its_start() {
    let start = Point2::new(2.0, 5.0);
    let fix = Matrix2::new(0.04, 0.01, 0.01, 0.09);
    let mut track = Track::start(start, fix, SYSTEMATIC).unwrap();
    let first = track;
    for side in 0..4 {
        for _ in 0..10 {
            let heading = f64::from(side) * TAU / 4.0 + 0.3;
            track.advance(&step(0.7, heading)).unwrap();
        }
    }
    assert!((track.position() - start).norm() < 1e-12);
    assert!(track.since(&first).unwrap().vector.norm() < 1e-12);
    // Bias and scale cancel on a closed path. Each axis saw 20 steps along and 20 across.
    let along = 0.7 * 0.001_f64;
    let across = 0.7 * 0.002_f64;
    let walked = 20.0 * (along * along + across * across);
    let expected = fix + Matrix2::from_diagonal_element(walked);
    assert!((track.covariance() - expected).norm() < 1e-12);
}

#[test]
fn bias_and_scale_grow_with_the_way_from_the_fix() {
    let exact = |distance| Step {
        distance,
        heading: 0.0,
        distance_sigma: 0.0,
        heading_sigma: 0.0,
    };
    let mut track = Track::start(Point2::origin(), Matrix2::zeros(), SYSTEMATIC).unwrap();
    for _ in 0..100 {
        track.advance(&exact(0.5)).unwrap();
    }
    let c = track.covariance();
    assert!((c.m11.sqrt() - 50.0 * 0.0015).abs() < 1e-12);
    assert!((c.m22.sqrt() - 50.0 * 0.001).abs() < 1e-12);
    // A new fix takes it all away, also the way to it.
    let before = track;
    track
        .relocate(Point2::new(49.0, 0.1), Matrix2::identity(), SYSTEMATIC)
        .unwrap();
    assert_eq!(track.covariance(), Matrix2::identity());
    assert_eq!(track.since(&before), None);
    let found = track;
    track.advance(&exact(10.0)).unwrap();
    assert!((track.position().x - 59.0).abs() < 1e-12);
    let leg = track.since(&found).unwrap();
    assert!((leg.vector.x - 10.0).abs() < 1e-12);
    assert!((leg.covariance.m11.sqrt() - 0.015).abs() < 1e-12);
}

/// Positions at two stops, before and after a second fix: the joint covariance of their errors.
#[test]
fn errors_are_as_large_and_as_correlated_as_predicted() {
    for second_fix in [false, true] {
        let mut rng = generator(1);
        let runs = 10_000;
        let mut sample = Matrix4::zeros();
        let mut predicted = Matrix4::zeros();
        let mut leg_nees = 0.0;
        for _ in 0..runs {
            let mut walk = Walk::start(&mut rng, SYSTEMATIC);
            walk.fix(&mut rng, 0.005, 0.008);
            walk.go(&mut rng, Point2::new(9.0, 2.0));
            let (first, error_1, truth_1) = (walk.track, walk.error(), walk.truth);
            if second_fix {
                walk.fix(&mut rng, 0.003, 0.002);
            }
            walk.go(&mut rng, Point2::new(5.0, 7.0));
            let (last, error_2) = (walk.track, walk.error());

            let both = Vector4::new(error_1.x, error_1.y, error_2.x, error_2.y);
            sample += both * both.transpose();
            let leg = last.since(&first);
            assert_eq!(leg.is_none(), second_fix);
            if let Some(leg) = leg {
                let off = leg.vector - (walk.truth - truth_1);
                leg_nees += off.dot(&leg.covariance.cholesky().unwrap().solve(&off));
            }
            for (row, a) in [first, last].iter().enumerate() {
                for (column, b) in [first, last].iter().enumerate() {
                    let mut block = predicted.fixed_view_mut::<2, 2>(2 * row, 2 * column);
                    block += a.covariance_with(b);
                }
            }
        }
        let n = f64::from(runs);
        (sample, predicted) = (sample / n, predicted / n);
        for i in 0..4 {
            for j in 0..4 {
                // Standard error of a sample covariance of Gaussians, and a little second order.
                let scale = predicted[(i, i)] * predicted[(j, j)];
                let se = ((scale + predicted[(i, j)].powi(2)) / n).sqrt();
                let off = (sample[(i, j)] - predicted[(i, j)]).abs();
                assert!(
                    off < 4.0 * se + 0.005 * scale.sqrt(),
                    "{i}, {j}: {off} {se}"
                );
            }
        }
        // Chi squared of two degrees of freedom: mean 2, variance 4.
        leg_nees /= n;
        assert!(
            second_fix || (leg_nees - 2.0).abs() < 4.0 * 2.0 / n.sqrt() + 0.01,
            "{leg_nees}"
        );
    }
}

#[test]
fn what_is_no_step_or_fix_changes_nothing() {
    let mut track = Track::start(Point2::origin(), Matrix2::identity(), SYSTEMATIC).unwrap();
    let before = track;
    let good = step(0.7, 1.0);
    for (bad, error) in [
        (
            Step {
                distance: f64::NAN,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            Step {
                heading: f64::INFINITY,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            Step {
                heading_sigma: f64::NAN,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            Step {
                distance: 1e200,
                ..good
            },
            TrackError::NotFinite,
        ),
        (
            Step {
                distance: -0.1,
                ..good
            },
            TrackError::Negative,
        ),
        (
            Step {
                distance_sigma: -0.1,
                ..good
            },
            TrackError::Negative,
        ),
        (
            Step {
                heading_sigma: -0.1,
                ..good
            },
            TrackError::Negative,
        ),
    ] {
        assert_eq!(track.advance(&bad), Err(error), "{bad:?}");
    }
    let place = Point2::new(1.0, 2.0);
    for (bad, error) in [
        (Matrix2::new(1.0, f64::NAN, 0.0, 1.0), TrackError::NotFinite),
        (
            Matrix2::new(-1.0, 0.0, 0.0, 1.0),
            TrackError::NotACovariance,
        ),
        (Matrix2::new(1.0, 2.0, 2.0, 1.0), TrackError::NotACovariance),
        (
            Matrix2::new(1.0, 0.5, -0.5, 1.0),
            TrackError::NotACovariance,
        ),
    ] {
        assert_eq!(track.relocate(place, bad, SYSTEMATIC), Err(error), "{bad}");
    }
    let nowhere = Point2::new(f64::NAN, 0.0);
    assert_eq!(
        track.relocate(nowhere, Matrix2::zeros(), SYSTEMATIC),
        Err(TrackError::NotFinite)
    );
    assert_eq!(track, before);
    let negative = Systematic {
        heading_sigma: -0.1,
        scale_sigma: 0.0,
    };
    assert_eq!(
        Track::start(place, Matrix2::zeros(), negative),
        Err(TrackError::Negative)
    );
}

fn any_step() -> impl Strategy<Value = Step<f64>> {
    (0.0..2.0_f64, -10.0..10.0_f64, 0.0..0.2_f64, 0.0..0.5_f64).prop_map(
        |(distance, heading, distance_sigma, heading_sigma)| Step {
            distance,
            heading,
            distance_sigma,
            heading_sigma,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever is fed, the covariance stays one, and refused input changes nothing.
    #[test]
    fn no_input_breaks_a_track(numbers in prop::collection::vec(any::<[f32; 4]>(), 0..40)) {
        let mut track = Track::start(
            Point2::new(1.0_f32, 2.0), Matrix2::identity(), Systematic::default()).unwrap();
        for [distance, heading, distance_sigma, heading_sigma] in numbers {
            let before = track;
            let step = Step { distance, heading, distance_sigma, heading_sigma };
            if track.advance(&step).is_err() {
                prop_assert_eq!(track, before);
            }
            let c = track.covariance();
            prop_assert!(c.iter().all(|x| x.is_finite()) && c.m11 >= 0.0 && c.m22 >= 0.0);
            prop_assert!(track.position().coords.iter().all(|x| x.is_finite()));
        }
    }

    /// Own parts and shared part are covariances, whatever the walk, and so is their joint one.
    #[test]
    fn every_covariance_is_one(steps in prop::collection::vec(any_step(), 2..40), cut in 0_usize..40) {
        let mut track = Track::start(
            Point2::origin(), Matrix2::identity() * 0.01, Systematic::default()).unwrap();
        let mut first = track;
        for (i, step) in steps.iter().enumerate() {
            track.advance(step).unwrap();
            if i == cut % steps.len() {
                first = track;
            }
        }
        let (a, b) = (first.covariance(), track.covariance());
        let ab = first.covariance_with(&track);
        prop_assert_eq!(ab.transpose(), track.covariance_with(&first));
        let joint = Matrix4::new(
            a.m11, a.m12, ab.m11, ab.m12,
            a.m21, a.m22, ab.m21, ab.m22,
            ab.m11, ab.m21, b.m11, b.m12,
            ab.m12, ab.m22, b.m21, b.m22,
        );
        prop_assert!(joint.symmetric_eigenvalues().min() > -1e-12);
        let leg = track.since(&first).unwrap().covariance;
        prop_assert!(leg.symmetric_eigenvalues().min() > -1e-12);
        // Var(b - a) = Var(b) + Var(a) - Cov - Cov^T, without the fix, which cancels.
        let expected = b + a - ab - ab.transpose();
        prop_assert!((leg - expected).norm() < 1e-12 * (1.0 + b.norm()));
    }

    #[test]
    fn single_precision_is_enough(steps in prop::collection::vec(any_step(), 1..200)) {
        let mut wide = Track::start(Point2::origin(), Matrix2::zeros(), Systematic::default()).unwrap();
        let mut narrow = Track::start(Point2::origin(), Matrix2::zeros(), Systematic::default()).unwrap();
        for s in &steps {
            wide.advance(s).unwrap();
            narrow.advance(&Step {
                distance: s.distance as f32,
                heading: s.heading as f32,
                distance_sigma: s.distance_sigma as f32,
                heading_sigma: s.heading_sigma as f32,
            }).unwrap();
        }
        prop_assert!((narrow.position().cast::<f64>() - wide.position()).norm() < 1e-3);
        let c = wide.covariance();
        prop_assert!((narrow.covariance().cast::<f64>() - c).norm() < 1e-4 * (1.0 + c.norm()));
    }
}
