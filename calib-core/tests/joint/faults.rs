//! Planted faults are found and named; without one nothing is thrown out.

use calib_core::{
    Limits,
    joint::{Finding, Standing},
};
use test_support::{
    Random, generator,
    walk::{CarrierErrors, Walk},
};

use crate::support::{Joint, filled};

const LIMITS: Limits<f64> = Limits {
    position: 0.5,
    heading: 0.087,
};
const WALKS: u64 = 40;

/// There and back, so that every leg is checked by something.
fn walk(seed: u64) -> Walk {
    let errors = CarrierErrors::UNKNOWN;
    let there = Walk::random(&mut generator(seed), 8, 14, errors, 0.0024);
    let mut places = there.places.clone();
    places.extend(there.places.iter().rev().skip(1));
    let mut rng: Random = generator(seed ^ 0xbac_c);
    Walk::measured(&mut rng, there.cameras, places, errors, 0.0024)
}

/// A camera that is seen often before and after the middle of the walk.
fn often_seen(walk: &Walk) -> Option<usize> {
    let middle = walk.places.len() / 2;
    (2..walk.cameras.len()).find(|&camera| {
        let stops = { walk.bearings.iter() }.filter(|seen| seen.camera == camera);
        let before = stops.clone().filter(|seen| seen.stop < middle).count();
        before >= 5 && stops.count() >= before + 5
    })
}

/// All that is found, one after the other.
fn check(joint: &mut Joint<f32>) -> Vec<Finding<f32>> {
    let mut found = Vec::new();
    while let Some(finding) = joint.check().unwrap() {
        found.push(finding);
        assert!(found.len() < 40, "{found:?}");
    }
    found
}

/// Cameras, but for one, that are more than five sigmas off.
fn wrong(joint: &mut Joint<f32>, walk: &Walk, but: usize) -> usize {
    let cameras = walk.cameras.iter().enumerate().skip(2);
    let wrong = cameras.filter(|(n, truth)| {
        let Ok(pose) = joint.pose(*n) else {
            return false;
        };
        let nees = pose.normalised_error(truth.position().cast(), truth.heading as f32);
        *n != but && nees.unwrap() > 30.0
    });
    wrong.count()
}

#[test]
fn nothing_is_thrown_out_without_reason() {
    let mut findings = 0;
    for seed in 0..WALKS {
        let walk = walk(seed);
        let mut joint = filled::<f32>(&walk, LIMITS);
        joint.solve().unwrap();
        findings += check(&mut joint).len();
        assert_eq!(wrong(&mut joint, &walk, 0), 0, "{seed}");
    }
    // Some 80 bearings a walk, tested once in 100,000 each.
    assert!(findings <= 1, "{findings}");
}

#[test]
fn a_wrong_bearing_is_found() {
    let mut found = 0;
    for seed in 0..WALKS {
        let mut walk = walk(seed);
        let Some(camera) = often_seen(&walk) else {
            continue;
        };
        let n = walk
            .bearings
            .iter()
            .rposition(|seen| seen.camera == camera)
            .unwrap();
        walk.bearings[n].bearing += 0.1;
        let stop = walk.bearings[n].stop;
        let mut joint = filled::<f32>(&walk, LIMITS);
        joint.solve().unwrap();
        // By the consensus with which the camera was let in, or by the test.
        for finding in check(&mut joint) {
            assert!(
                matches!(finding, Finding::Bearing { camera: c, stop: s, .. } if (c, s) == (camera, stop)),
                "{seed}: {finding:?}"
            );
        }
        for other in 0..walk.bearings.len() {
            let Ok(residual) = joint.bearing_residual(other) else {
                continue;
            };
            let counts = residual.standing == Standing::Counts;
            let wrong = (residual.camera, residual.stop) == (camera, stop);
            assert!(counts != wrong, "{seed}: {residual:?}");
        }
        assert_eq!(wrong(&mut joint, &walk, 0), 0, "{seed}");
        found += 1;
    }
    assert!(found > 10);
}

/// As a node sees it: stop after stop. Bumped by five degrees half way, it is named within two
/// bearings, and keeps the pose that it had.
#[test]
fn a_bumped_camera_is_named() {
    let mut named = 0;
    for seed in 0..WALKS {
        let mut walk = walk(seed);
        let Some(camera) = often_seen(&walk) else {
            continue;
        };
        let middle = walk.places.len() / 2;
        for seen in &mut walk.bearings {
            if seen.camera == camera && seen.stop >= middle {
                seen.bearing -= 5_f64.to_radians();
            }
        }
        let after: Vec<_> = { walk.bearings.iter() }
            .filter(|seen| seen.camera == camera && seen.stop >= middle)
            .map(|seen| seen.stop)
            .collect();
        let mut joint = filled::<f32>(&empty(&walk), LIMITS);
        let mut noticed = None;
        for stop in 0..walk.places.len() {
            crate::support::add(&mut joint, &walk, stop);
            if joint.solve().is_err() {
                assert!(stop < 5);
                continue;
            }
            for finding in check(&mut joint) {
                match finding {
                    Finding::Bearing { camera: c, .. } if c == camera => {}
                    Finding::Camera {
                        camera: c, from, ..
                    } if c == camera => {
                        assert!(from >= middle, "{seed}: {finding:?}");
                        noticed = noticed.or(Some(stop));
                    }
                    _ => panic!("{seed}, stop {stop}: {finding:?}, camera {camera} was bumped"),
                }
            }
        }
        let noticed = noticed.unwrap_or_else(|| panic!("{seed}: not noticed"));
        let seen = after.iter().filter(|&&stop| stop <= noticed).count();
        assert!(seen <= 3, "{seed}: after {seen} sightings");
        let truth = walk.cameras[camera];
        let pose = joint.pose(camera).unwrap();
        let nees = pose
            .normalised_error(truth.position().cast(), truth.heading as f32)
            .unwrap();
        assert!(nees < 30.0, "{seed}: its old pose stays, {nees}");
        assert_eq!(wrong(&mut joint, &walk, camera), 0, "{seed}");
        named += 1;
    }
    assert!(named > 10);
}

/// One that repeats its bearing from the middle on is named too.
#[test]
fn a_stuck_camera_is_named() {
    let mut named = 0;
    for seed in 0..WALKS {
        let mut walk = walk(seed);
        let Some(camera) = often_seen(&walk) else {
            continue;
        };
        let middle = walk.places.len() / 2;
        let mut stuck = None;
        for seen in walk
            .bearings
            .iter_mut()
            .filter(|seen| seen.camera == camera)
        {
            if seen.stop < middle {
                stuck = Some(seen.bearing);
            } else {
                seen.bearing = stuck.unwrap();
            }
        }
        let mut joint = filled::<f32>(&empty(&walk), LIMITS);
        let mut is_named = false;
        for stop in 0..walk.places.len() {
            crate::support::add(&mut joint, &walk, stop);
            if joint.solve().is_ok() {
                for finding in check(&mut joint) {
                    match finding {
                        Finding::Bearing { camera: c, .. } if c == camera => {}
                        Finding::Camera { camera: c, .. } if c == camera => is_named = true,
                        _ => panic!("{seed}, stop {stop}: {finding:?}, camera {camera} is stuck"),
                    }
                }
            }
        }
        assert!(is_named, "{seed}");
        assert_eq!(wrong(&mut joint, &walk, camera), 0, "{seed}");
        named += 1;
    }
    assert!(named > 10);
}

#[test]
fn a_slipped_leg_is_named() {
    let (mut named, mut slipped, mut others) = (0, 0, 0);
    for seed in 0..WALKS {
        let mut walk = walk(seed);
        // Half as long again.
        let leg = 5 + seed as usize % 8;
        walk.legs[leg].displacement *= 1.5;
        let mut joint = filled::<f32>(&walk, LIMITS);
        if joint.solve().is_err() {
            continue;
        }
        slipped += 1;
        let found = check(&mut joint);
        let is_it = |f: &Finding<f32>| matches!(f, Finding::Leg { stop, .. } if *stop == leg + 1);
        named += usize::from(found.first().is_some_and(is_it));
        others += wrong(&mut joint, &walk, 0);
    }
    // A leg that too few bearings check cannot be told from them.
    assert!(
        slipped > 30 && named * 10 >= slipped * 8,
        "{named} of {slipped}"
    );
    assert!(others <= 6, "{others} cameras wrong");
}

/// The error that one fault leaves, noticed or not, is within the protection level.
#[test]
fn protection_levels_hold() {
    let (mut beyond, mut cameras, mut protected) = (0, 0, 0);
    for seed in 0..WALKS {
        for size in [0.0, 0.004, 0.008, 0.012, 0.02] {
            let mut walk = walk(seed);
            let n = (7 * seed as usize + (size * 1e4) as usize) % walk.bearings.len();
            walk.bearings[n].bearing += size;
            let mut joint = filled::<f32>(&walk, LIMITS);
            if joint.solve().is_err() {
                continue;
            }
            check(&mut joint);
            joint.protect().unwrap();
            for (n, truth) in walk.cameras.iter().enumerate().skip(2) {
                let Ok(pose) = joint.pose(n) else { continue };
                let level = joint.protection(n).unwrap();
                let off = (pose.position.cast::<f64>() - truth.position()).norm();
                assert!(f64::from(level.position_bearing) > 3.0 * f64::from(pose.sigma_position()));
                cameras += 1;
                protected += usize::from(level.position_bearing < 1.5);
                beyond += usize::from(off > f64::from(level.position_bearing));
            }
        }
    }
    assert_eq!(beyond, 0, "of {cameras}");
    assert!(
        protected * 2 > cameras,
        "{protected} of {cameras} have a level that means something"
    );
}

/// Legs that err twice as much as they claim are noticed.
#[test]
fn the_noise_of_legs_is_told_by_their_residuals() {
    for times in [1.0, 2.0] {
        let (mut sum, mut started) = (0.0, 0.0);
        for seed in 0..24 {
            let mut walk = walk(seed);
            walk.errors.length *= times;
            walk.errors.direction *= times;
            walk.carry(&mut generator(seed));
            for leg in &mut walk.legs {
                leg.covariance /= times * times;
            }
            let mut joint = filled::<f32>(&walk, LIMITS);
            // The worse ones contradict the references too often for a frame.
            if joint.solve().is_err() {
                continue;
            }
            sum += f64::from(joint.fit_leg_noise().unwrap()).ln();
            started += 1.0;
        }
        let mean = (sum / started).exp();
        assert!(started >= 16.0, "{times}: {started}");
        assert!((0.85..1.1).contains(&(mean / times)), "{times}: {mean}");
    }
}

fn empty(walk: &Walk) -> Walk {
    Walk {
        places: Vec::new(),
        ..walk.clone()
    }
}
