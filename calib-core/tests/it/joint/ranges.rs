//! Ranges from the target's size, beside bearings.

use calib_core::{
    joint::{Finding, JointError, Leg, Quantity},
    level::Elevation,
};
use test_support::{
    chi_squared_band, generator, normal,
    walk::{CarrierErrors, Walk},
};

use crate::joint::support::{WIDE, add, filled};

/// Sigma of a range as a share of it: a blob some thirty pixels high.
const SHARE: f64 = 0.03;

fn ranged(seed: u64) -> Walk {
    let mut walk = Walk::random(&mut generator(seed), 8, 20, CarrierErrors::UNKNOWN, 0.0024);
    walk.range(&mut generator(seed ^ 0x4a), SHARE);
    walk
}

/// Lenses that are 5 % off at one sigma spoil all ranges of a camera alike: sigmas of poses say so.
#[test]
fn ranges_through_a_lens_share_its_error() {
    let (mut sum, mut poses) = (0.0, 0.0);
    for seed in 0..60 {
        let mut walk = ranged(seed);
        let mut rng = generator(seed ^ 0x1e45);
        walk.lens_sigma = 0.05;
        for camera in 0..walk.cameras.len() {
            let scale = 1.0 + walk.lens_sigma * normal(&mut rng);
            walk.look_through(camera, scale, 0.0);
            let own = walk.ranges.iter_mut().filter(|far| far.camera == camera);
            own.for_each(|far| far.range *= scale);
        }
        let mut joint = filled::<f32>(&walk, WIDE);
        joint.solve().unwrap();
        for camera in 2..walk.cameras.len() {
            let Ok(pose) = joint.pose(camera) else {
                continue;
            };
            let truth = &walk.cameras[camera];
            let heading = truth.heading as f32;
            sum += f64::from(
                pose.normalised_error(truth.position().cast(), heading)
                    .unwrap(),
            );
            poses += 1.0;
        }
    }
    let nees = sum / poses;
    assert!((2.4..3.6).contains(&nees), "{nees} of {poses}");
}

/// The target is carried to a place, by a way that was not measured, where one camera sees it.
#[test]
fn one_camera_with_a_range_localises_the_target() {
    let (mut sum, mut degrees) = (0.0, 0.0);
    for seed in 0..80 {
        let walk = ranged(seed);
        let last = walk.places.len() - 1;
        let mut known = walk.clone();
        known.places.truncate(last);
        let mut joint = filled::<f32>(&known, WIDE);
        joint.solve().unwrap();
        let sees = |camera: &usize| {
            walk.bearings
                .iter()
                .any(|s| (s.stop, s.camera) == (last, *camera))
        };
        let Some(camera) = (2..8)
            .filter(sees)
            .find(|&camera| joint.pose(camera).is_ok())
        else {
            continue;
        };
        let stop = joint.add_stop(None).unwrap();
        let of = |s: usize, c: usize| (s, c) == (last, camera);
        let seen = walk.bearings.iter().find(|s| of(s.stop, s.camera)).unwrap();
        let range = walk.ranges.iter().find(|s| of(s.stop, s.camera)).unwrap();
        joint
            .add_bearing(stop, camera, seen.bearing as f32, seen.sigma as f32)
            .unwrap();
        joint
            .add_range(stop, camera, range.range as f32, range.sigma as f32)
            .unwrap();
        joint.solve().unwrap();
        let place = joint.place(stop).unwrap();
        let covariance = place.covariance.cast::<f64>();
        let off = place.position.cast::<f64>() - walk.places[last];
        sum += off.dot(&(covariance.try_inverse().unwrap() * off));
        degrees += 2.0;
        // Along the ray it is as sure as the range, and surer than that across.
        assert!(f64::from(place.sigma()) > 0.9 * range.sigma, "{seed}");
    }
    assert!(
        degrees > 100.0 && chi_squared_band(degrees).contains(&sum),
        "{sum} of {degrees}"
    );
}

#[test]
fn ranges_make_everything_surer() {
    for seed in 0..10 {
        let walk = ranged(seed);
        let mut bare = walk.clone();
        bare.ranges.clear();
        let (mut with, mut without) = (filled::<f64>(&walk, WIDE), filled::<f64>(&bare, WIDE));
        with.solve().unwrap();
        without.solve().unwrap();
        let sigma = [&mut with, &mut without].map(|joint| joint.carrier().unwrap().sigma_scale());
        assert!(sigma[0] < sigma[1], "{seed}: {sigma:?}");
    }
}

/// A range is that from the eye to the ball. A camera that hangs above it tells by its row how far away it is along the
/// floor: in the estimate it is the range of a camera at the height of the ball.
#[test]
fn a_range_from_above_counts_along_the_floor() {
    for seed in 0..5 {
        let walk = ranged(seed);
        let mut above = walk.clone();
        let mut rows = Vec::new();
        for seen in &mut above.ranges {
            // Exactly one tenth of a milliradian, as rows are told.
            let elevation = Elevation::from_radians(-0.4 - 0.02 * (seen.stop % 7) as f32);
            let share = elevation.radians::<f64>().unwrap().cos();
            seen.range /= share;
            seen.sigma /= share;
            rows.push((seen.stop, seen.camera, elevation));
        }
        let flat = filled::<f64>(&walk, WIDE);
        let empty = Walk {
            places: Vec::new(),
            ..above.clone()
        };
        let mut level = filled::<f64>(&empty, WIDE);
        for stop in 0..above.places.len() {
            let leg = stop.checked_sub(1).map(|before| &above.legs[before]);
            let leg = leg.map(|leg| Leg {
                displacement: leg.displacement,
                covariance: leg.covariance,
            });
            level.add_stop(leg).unwrap();
            for seen in above.bearings.iter().filter(|seen| seen.stop == stop) {
                level
                    .add_bearing(stop, seen.camera, seen.bearing, seen.sigma)
                    .unwrap();
                let row = rows
                    .iter()
                    .find(|row| (row.0, row.1) == (stop, seen.camera));
                level.add_elevation(row.unwrap().2).unwrap();
            }
            for seen in above.ranges.iter().filter(|seen| seen.stop == stop) {
                level
                    .add_range(stop, seen.camera, seen.range, seen.sigma)
                    .unwrap();
            }
        }
        let [flat, level] = [flat, level].map(|mut joint| {
            joint.solve().unwrap();
            let last = joint.stops() - 1;
            joint.place(last).unwrap().position
        });
        assert!((flat - level).norm() < 1e-6, "{seed}: {flat} {level}");
    }
}

#[test]
fn a_wrong_range_is_named() {
    let mut named = 0;
    for seed in 0..20 {
        let mut walk = ranged(seed);
        let camera = (2..8).max_by_key(|&camera| walk.seen_by(camera)).unwrap();
        let wrong = walk
            .ranges
            .iter_mut()
            .rfind(|ranged| ranged.camera == camera)
            .unwrap();
        wrong.range *= 1.5;
        let stop = wrong.stop;
        let mut joint = filled::<f32>(&walk, WIDE);
        joint.solve().unwrap();
        let is_it = |finding| matches!(finding, Some(Finding::Range { stop: s, camera: c, .. }) if (s, c) == (stop, camera));
        named += usize::from(is_it(joint.check().unwrap()));
        let left: Vec<_> = (0..joint.bearings())
            .filter_map(|n| joint.bearing_residual(n).ok())
            .collect();
        assert!(left.iter().any(|left| left.quantity == Quantity::Range));
    }
    assert!(named >= 19, "{named} of 20");
}

#[test]
fn a_range_is_above_zero() {
    let walk = ranged(1);
    let mut joint = filled::<f64>(
        &Walk {
            places: Vec::new(),
            ..walk.clone()
        },
        WIDE,
    );
    add(&mut joint, &walk, 0);
    for range in [0.0, -1.0, f64::NAN] {
        assert_eq!(
            joint.add_range(0, 0, range, 0.1),
            Err(JointError::NotFinite)
        );
    }
    assert_eq!(joint.add_range(1, 0, 1.0, 0.1), Err(JointError::Unknown));
}
