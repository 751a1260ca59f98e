//! Exact answers, the frame, and questions that cannot be answered.

use calib_core::{
    Limits, Refusal,
    joint::{JointError, JointSettings, Leg, Prior, Undetermined},
};
use nalgebra::{Matrix2, Point2, Vector2};
use proptest::prelude::*;
use test_support::{
    generator, turn,
    walk::{CarrierErrors, SeenAt, Walk, WalkedLeg},
};

use crate::joint::support::{Joint, WIDE, filled, memory};

/// The measurements without noise.
fn exact(seed: u64, scale: f64, compass: f64) -> Walk {
    let mut walk = Walk::random(&mut generator(seed), 8, 16, CarrierErrors::UNKNOWN, 0.0024);
    walk.carrier = [scale, compass];
    for seen in &mut walk.bearings {
        seen.bearing = walk.cameras[seen.camera].bearing_of(walk.places[seen.stop]);
    }
    walk.legs = { walk.places.windows(2) }
        .map(|ends| {
            let way = ends[1] - ends[0];
            let (sin, cos) = compass.sin_cos();
            WalkedLeg {
                displacement: Vector2::new(cos * way.x - sin * way.y, sin * way.x + cos * way.y)
                    * scale,
                covariance: Matrix2::from_diagonal_element(1e-4),
            }
        })
        .collect();
    // So that the pull of the priors is too small for the tests.
    walk.errors.scale = 0.29;
    walk.errors.compass = 0.29;
    walk
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Without noise the truth comes out, whatever carrier and geometry, but for the priors' pull.
    #[test]
    fn exact_measurements_have_exact_answers(
        seed in 0_u64..10_000, scale in 0.9_f64..1.1, compass in -0.1_f64..0.1,
    ) {
        let walk = exact(seed, scale, compass);
        let mut joint = filled::<f64>(&walk, WIDE);
        joint.solve().unwrap();
        let carrier = joint.carrier().unwrap();
        prop_assert!((carrier.scale - scale).abs() < 0.2 * carrier.sigma_scale() + 1e-9);
        prop_assert!((carrier.compass - compass).abs() < 0.2 * carrier.sigma_compass() + 1e-9);
        for (n, truth) in walk.cameras.iter().enumerate() {
            let Ok(pose) = joint.pose(n) else { continue };
            // The pull of the priors is a small part of the posterior sigma.
            prop_assert!((pose.position - truth.position()).norm() < 0.2 * pose.sigma_position() + 1e-9);
            prop_assert!(turn(pose.heading, truth.heading).abs() < 0.2 * pose.sigma_heading() + 1e-9);
        }
    }

    /// Units of length do not matter.
    #[test]
    fn any_unit_of_length(seed in 0_u64..1000, unit in prop::sample::select(vec![0.01, 1.0, 39.37, 1000.0])) {
        let walk = Walk::random(&mut generator(seed), 7, 14, CarrierErrors::UNKNOWN, 0.0024);
        let mut other = walk.clone();
        other.cameras[1].x *= unit;
        for leg in &mut other.legs {
            leg.displacement *= unit;
            leg.covariance *= unit * unit;
        }
        let limits = Limits { position: WIDE.position * unit, ..WIDE };
        let (mut joint, mut scaled) = (filled::<f64>(&walk, WIDE), filled::<f64>(&other, limits));
        prop_assert_eq!(
            joint.solve().map(|solution| solution.cameras),
            scaled.solve().map(|solution| solution.cameras)
        );
        for n in 0..7 {
            let (Ok(a), Ok(b)) = (joint.pose(n), scaled.pose(n)) else { continue };
            prop_assert!((a.position * unit - b.position).norm() <= 2e-3 * b.sigma_position());
            prop_assert!(turn(a.heading, b.heading).abs() < 2e-3 * b.sigma_heading());
            prop_assert!((a.sigma_position() * unit - b.sigma_position()).abs() <= 1e-3 * b.sigma_position());
        }
    }

    /// No number that is put in makes it panic, or answer with a value that is no number.
    #[test]
    fn wild_numbers_are_refused_or_answered(
        numbers in prop::collection::vec(prop::num::f32::ANY, 60),
        ordinary in prop::collection::vec(-3.0_f32..3.0, 60),
        share in 0.0_f32..1.0,
    ) {
        let mut next = numbers.iter().zip(&ordinary).cycle().map(|(wild, tame)| {
            if tame.abs() < 3.0 * share { *tame } else { *wild }
        });
        let mut number = || next.next().unwrap();
        let Ok(mut joint) = Joint::new(memory::<f32>(4, 8, 20, 1), number(), JointSettings::default()) else { return Ok(()) };
        for stop in 0..6 {
            let leg = Leg {
                displacement: Vector2::new(number(), number()),
                covariance: Matrix2::from_diagonal_element(number()),
            };
            let _refused = joint.add_stop(Some(leg)).or_else(|_| joint.add_stop(None));
            for camera in 0..4 {
                let _refused = joint.add_bearing(stop, camera, number(), number());
            }
            let _refused = joint.add_visit(stop, 0, number());
        }
        if joint.solve().is_ok() {
            for camera in 0..4 {
                if let Ok(pose) = joint.pose(camera) {
                    prop_assert!(pose.position.x.is_finite() && pose.heading.is_finite());
                    prop_assert!(pose.covariance.iter().all(|c| c.is_finite()));
                }
            }
        }
    }
}

/// Camera 0 is the origin and camera 1 on the x axis, exactly; all else is relative to that.
#[test]
fn the_frame_is_that_of_the_references() {
    let walk = Walk::random(&mut generator(3), 8, 16, CarrierErrors::UNKNOWN, 0.0024);
    let mut joint = filled::<f64>(&walk, WIDE);
    joint.solve().unwrap();
    for (n, place) in [(0, Point2::origin()), (1, Point2::new(10.0, 0.0))] {
        let pose = joint.pose(n).unwrap();
        assert_eq!(pose.position, place);
        assert_eq!(pose.sigma_position(), 0.0);
        let headings = joint.reference_headings().unwrap();
        assert_eq!(pose.heading, headings.headings[n]);
        assert!((pose.sigma_heading() - headings.sigmas()[n]).abs() < 1e-12);
    }
}

/// Nothing is known of the carrier: the references' sightings tell its scale and its compass, or that
/// the baseline's own direction is not the compass's.
#[test]
fn a_compass_that_points_anywhere() {
    let mut walk = exact(5, 1.4, 2.5);
    (walk.errors.scale, walk.errors.compass) = (10.0, 10.0);
    let mut joint = filled::<f64>(&walk, WIDE);
    joint.solve().unwrap();
    let carrier = joint.carrier().unwrap();
    assert!((carrier.scale - 1.4).abs() < 1e-3);
    assert!(turn(carrier.compass, 2.5).abs() < 1e-3);
}

#[test]
fn two_stops_give_no_frame() {
    let walk = Walk::random(&mut generator(3), 8, 16, CarrierErrors::UNKNOWN, 0.0024);
    let mut part = walk.clone();
    part.places.truncate(2);
    let mut joint = filled::<f64>(&part, WIDE);
    assert_eq!(joint.solve(), Err(JointError::Start(Refusal::TooFew)));
    assert_eq!(joint.pose(2), Err(Refusal::TooFew));
    assert_eq!(joint.place(0), Err(Refusal::TooFew));
    assert_eq!(joint.carrier(), Err(Refusal::TooFew));
}

#[test]
fn a_target_that_does_not_move_gives_no_frame() {
    let mut walk = exact(3, 1.0, 0.0);
    let first = walk.places[0];
    walk.places.fill(first);
    walk.legs
        .iter_mut()
        .for_each(|leg| leg.displacement.fill(0.0));
    let mut joint = filled::<f64>(&walk, WIDE);
    assert_eq!(
        joint.solve(),
        Err(JointError::Start(Refusal::CoincidentTargets))
    );
}

#[test]
fn cameras_seen_twice_or_from_one_place_wait() {
    let mut walk = exact(3, 1.0, 0.0);
    let seen_twice = 2;
    let mut left = 2;
    walk.bearings.retain(|seen| {
        let keeps = seen.camera != seen_twice || left > 0;
        left -= usize::from(seen.camera == seen_twice && left > 0);
        keeps
    });
    let mut joint = filled::<f64>(&walk, WIDE);
    joint.solve().unwrap();
    assert_eq!(joint.pose(seen_twice), Err(Refusal::TooFew));
    assert!(joint.pose(3).is_ok());
}

/// A camera with exactly three bearings has a pose, and no other camera's pose changes.
#[test]
fn three_bearings_tell_nothing_about_others() {
    let walk = Walk::random(&mut generator(11), 8, 16, CarrierErrors::UNKNOWN, 0.0024);
    let camera = (2..8).find(|&camera| walk.seen_by(camera) >= 4).unwrap();
    let with = |bearings: usize| {
        let (mut walk, mut left) = (walk.clone(), bearings);
        walk.bearings.retain(|seen| {
            let keeps = seen.camera != camera || left > 0;
            left -= usize::from(seen.camera == camera && left > 0);
            keeps
        });
        let mut joint = filled::<f64>(&walk, WIDE);
        joint.solve().unwrap();
        joint
    };
    let (mut without, mut three) = (with(0), with(3));
    assert!(three.pose(camera).is_ok());
    for other in (2..8).filter(|&other| other != camera) {
        let (Ok(a), Ok(b)) = (without.pose(other), three.pose(other)) else {
            continue;
        };
        assert!((a.position - b.position).norm() < 1e-4 * a.sigma_position());
        assert!((a.covariance - b.covariance).norm() < 1e-5 * a.covariance.norm());
    }
}

#[test]
fn what_is_not_a_measurement_is_not_taken() {
    let settings = JointSettings::<f64>::default();
    for baseline in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(
            Joint::new(memory::<f64>(2, 1, 1, 0), baseline, settings).err(),
            Some(JointError::NotFinite)
        );
    }
    let mut unsure = settings;
    unsure.scale = Prior {
        mean: 1.0,
        sigma: 0.0,
    };
    assert_eq!(
        Joint::new(memory::<f64>(2, 1, 1, 0), 1.0, unsure).err(),
        Some(JointError::NotFinite)
    );

    let mut joint = Joint::new(memory::<f64>(3, 2, 2, 1), 1.0, settings).unwrap();
    let leg = |xx: f64, x: f64| Leg {
        displacement: Vector2::new(x, 0.0),
        covariance: Matrix2::new(xx, 0.0, 0.0, 1.0),
    };
    assert_eq!(joint.add_stop(None), Ok(0));
    for wrong in [
        leg(0.0, 1.0),
        leg(-1.0, 1.0),
        leg(f64::NAN, 1.0),
        leg(1.0, f64::INFINITY),
    ] {
        assert_eq!(joint.add_stop(Some(wrong)), Err(JointError::NotFinite));
    }
    assert_eq!(joint.add_bearing(1, 0, 0.1, 0.1), Err(JointError::Unknown));
    assert_eq!(joint.add_bearing(0, 3, 0.1, 0.1), Err(JointError::Unknown));
    assert_eq!(
        joint.add_bearing(0, 0, f64::NAN, 0.1),
        Err(JointError::NotFinite)
    );
    assert_eq!(
        joint.add_bearing(0, 0, 0.1, 0.0),
        Err(JointError::NotFinite)
    );
    assert_eq!(joint.add_visit(0, 1, 0.1), Err(JointError::Unknown));
    assert_eq!(joint.add_visit(0, 0, 0.0), Err(JointError::NotFinite));
    assert_eq!(joint.add_stop(Some(leg(1.0, 1.0))), Ok(1));
    assert_eq!(joint.add_stop(None), Err(JointError::Full));
    assert_eq!(joint.add_bearing(0, 0, 0.1, 0.1), Ok(()));
    assert_eq!(joint.add_bearing(0, 1, 0.1, 0.1), Ok(()));
    assert_eq!(joint.add_bearing(0, 2, 0.1, 0.1), Err(JointError::Full));
}

/// Bearings from a stop on go to the other camera, those that are told late too.
#[test]
fn a_split_camera_is_two() {
    let walk = Walk::random(&mut generator(11), 8, 24, CarrierErrors::UNKNOWN, 0.0024);
    let camera = (2..8).max_by_key(|&camera| walk.seen_by(camera)).unwrap();
    let from = 12;
    let mut renamed = walk.clone();
    for seen in &mut renamed.bearings {
        if seen.camera == camera && seen.stop >= from {
            seen.camera = 9;
        }
    }
    let mut expected = filled::<f64>(&renamed, WIDE);
    expected.solve().unwrap();

    // One of its bearings is told after the split, also one from before the move.
    let is_late = |seen: &&SeenAt| seen.camera == camera;
    let late: Vec<_> = walk
        .bearings
        .iter()
        .filter(is_late)
        .step_by(3)
        .copied()
        .collect();
    let mut early = walk.clone();
    early.bearings.retain(|seen| {
        { late.iter() }.all(|late| (late.stop, late.camera) != (seen.stop, seen.camera))
    });
    let mut joint = filled::<f64>(&early, WIDE);
    joint.solve().unwrap();
    joint.split(camera, from, 9).unwrap();
    for seen in &late {
        joint
            .add_bearing(seen.stop, seen.camera, seen.bearing, seen.sigma)
            .unwrap();
    }
    joint.solve().unwrap();
    for camera in [camera, 9] {
        let (a, b) = (joint.pose(camera), expected.pose(camera));
        assert_eq!(a.is_ok(), b.is_ok(), "{camera}");
        let (Ok(a), Ok(b)) = (a, b) else { continue };
        assert!((a.position - b.position).norm() < 1e-3 * a.sigma_position());
    }
    assert!(joint.pose(9).is_ok());

    for (camera, into, why) in [
        (16, 10, JointError::Unknown),
        (3, 16, JointError::Unknown),
        (3, 1, JointError::Taken),
        (3, 4, JointError::Taken),
        (10, 10, JointError::Taken),
        (3, 9, JointError::Taken),
    ] {
        assert_eq!(joint.split(camera, 5, into), Err(why), "{camera} {into}");
    }
}

/// A camera whose former place is forgotten is estimated as one that was never there, and may be moved again.
#[test]
fn a_moved_camera_forgets_its_past() {
    let walk = Walk::random(&mut generator(11), 8, 24, CarrierErrors::UNKNOWN, 0.0024);
    let camera = (2..8).max_by_key(|&camera| walk.seen_by(camera)).unwrap();
    let from = 8;
    let mut later = walk.clone();
    later
        .bearings
        .retain(|seen| seen.camera != camera || seen.stop >= from);
    let mut expected = filled::<f64>(&later, WIDE);
    expected.solve().unwrap();

    let mut joint = filled::<f64>(&walk, WIDE);
    joint.solve().unwrap();
    for unmoved in [0, camera, 16] {
        assert_eq!(
            joint.forget_past(unmoved),
            Err(JointError::Unknown),
            "{unmoved}"
        );
    }
    joint.split(camera, from, 9).unwrap();
    joint.solve().unwrap();
    joint.forget_past(camera).unwrap();
    assert_eq!(joint.moved(camera), None);
    joint.solve().unwrap();
    assert!(joint.pose(9).is_err());
    for camera in 2..8 {
        let (a, b) = (joint.pose(camera), expected.pose(camera));
        assert_eq!(a.is_ok(), b.is_ok(), "{camera}");
        let (Ok(a), Ok(b)) = (a, b) else { continue };
        assert!((a.position - b.position).norm() < 1e-3 * a.sigma_position());
    }
    // The number is free for the next move.
    joint.split(camera, 16, 9).unwrap();
    joint.solve().unwrap();
    joint.forget_past(camera).unwrap();
    // Where a reference was says what the frame is.
    joint.split(1, 12, 9).unwrap();
    joint.solve().unwrap();
    assert_eq!(joint.forget_past(1), Err(JointError::Unknown));
}

/// A stop to which nothing was measured, and where no camera saw the target, is named with all that depends
/// on it, and nothing else is worse for it.
#[test]
fn what_is_not_determined_is_named() {
    let walk = Walk::random(&mut generator(7), 8, 16, CarrierErrors::UNKNOWN, 0.0024);
    let mut whole = filled::<f32>(&walk, WIDE);
    whole.solve().unwrap();
    assert_eq!(whole.undetermined(), None);
    let mut joint = filled::<f32>(&walk, WIDE);
    let lost = joint.add_stop(None).unwrap();
    let leg = Leg {
        displacement: Vector2::new(1.0, 0.5),
        covariance: Matrix2::from_diagonal_element(1e-4),
    };
    let after = joint.add_stop(Some(leg)).unwrap();
    joint.solve().unwrap();
    assert_eq!(
        joint.undetermined(),
        Some(Undetermined::Stop(lost.try_into().unwrap()))
    );
    for stop in [lost, after] {
        assert_eq!(joint.place(stop), Err(Refusal::Undetermined));
    }
    // The way between both is the measured one, and nothing checks that.
    let between = joint.leg_residual(after).unwrap();
    assert_eq!(between.degrees_of_freedom, 0);
    assert!(joint.place(lost - 1).is_ok() && joint.carrier().is_ok());
    joint.protect().unwrap();
    whole.protect().unwrap();
    for camera in 0..8 {
        let (a, b) = (joint.pose(camera), whole.pose(camera));
        assert_eq!(a.is_ok(), b.is_ok(), "{camera}");
        let (Ok(a), Ok(b)) = (a, b) else { continue };
        assert!((a.covariance - b.covariance).norm() <= 1e-3 * b.covariance.norm());
        let [a, b] = [&joint, &whole].map(|joint| joint.protection(camera));
        if let (Some(a), Some(b)) = (a, b) {
            assert!((a.position_bearing / b.position_bearing - 1.0).abs() < 1e-2);
            assert!((a.position_leg / b.position_leg - 1.0).abs() < 1e-2);
        }
    }
}
