//! Random rooms whose cameras see a target together.

use calib_core::{Status, angle::wrap_signed};
use nalgebra::{Point2, Rotation2, Vector3};
use rand::RngExt;
use test_support::{Random, Truth, chi_squared_band, generator, normal};

use crate::network::{Finding, NetworkError, NetworkSolution, ScaleFrom, Settings, solve};
use crate::record::sightings::{Bearing, References, Sightings};

const SIGMA: f64 = 0.0024;

/// Cameras around a room of 10 by 10 that look into it, and places in it.
struct Room {
    cameras: Vec<Truth>,
    places: Vec<Point2<f64>>,
}

impl Room {
    fn random(rng: &mut Random, cameras: usize, places: usize) -> Self {
        let cameras = (0..cameras).map(|n| {
            let turn = (n as f64 + rng.random_range(-0.3..0.3)) / cameras as f64;
            let angle = std::f64::consts::TAU * turn;
            let (x, y) = (5.0 + 6.0 * angle.cos(), 5.0 + 6.0 * angle.sin());
            let heading = angle + std::f64::consts::PI + 0.15 * normal(rng);
            Truth { x, y, heading }
        });
        let cameras = cameras.collect();
        let place =
            |rng: &mut Random| Point2::new(rng.random_range(2.0..8.0), rng.random_range(2.0..8.0));
        let places = (0..places).map(|_| place(rng)).collect();
        Self { cameras, places }
    }

    /// Bearings that cameras of 70 degrees measure.
    fn seen(&self, rng: &mut Random) -> Vec<Bearing> {
        let mut bearings = Vec::new();
        for (stop, place) in (1..).zip(&self.places) {
            for (camera, truth) in (1..).zip(&self.cameras) {
                let bearing = truth.bearing_of(*place);
                if bearing.abs() < 0.6 {
                    bearings.push(Bearing {
                        target: 20,
                        stop,
                        camera,
                        bearing_deg: (bearing + SIGMA * normal(rng)).to_degrees(),
                        sigma_deg: SIGMA.to_degrees(),
                        elevation_deg: None,
                    });
                }
            }
        }
        bearings
    }

    /// A camera's true pose in the frame of two others, in units.
    fn truth(&self, [first, second]: [u16; 2], camera: u16, unit: f64) -> Vector3<f64> {
        let of = |id: u16| self.cameras[usize::from(id) - 1];
        let (first, second, own) = (of(first), of(second), of(camera));
        let baseline = second.position() - first.position();
        let turn = Rotation2::new(-baseline.y.atan2(baseline.x));
        let place = turn * (own.position() - first.position()) / unit;
        Vector3::new(place.x, place.y, own.heading + turn.angle())
    }

    fn baseline(&self, [first, second]: [u16; 2]) -> f64 {
        let of = |id: u16| self.cameras[usize::from(id) - 1].position();
        (of(second) - of(first)).norm()
    }
}

fn solved(bearings: Vec<Bearing>, references: Option<References>) -> NetworkSolution {
    let sightings = Sightings {
        network: 1,
        references,
        bearings,
        ..Sightings::default()
    };
    solve(&sightings, &Settings::default()).unwrap().remove(0)
}

/// Squared errors of all cameras but those of the frame, and of the frame's headings, each over its
/// variance, and how many numbers that are.
fn nees(room: &Room, solution: &NetworkSolution, unit: f64) -> (f64, usize) {
    let (mut sum, mut count) = (0.0, 0);
    for camera in &solution.cameras {
        let Some(estimate) = camera.estimate else {
            continue;
        };
        let truth = room.truth(solution.references.unwrap(), camera.camera, unit);
        let pose = estimate.pose();
        if camera.reference {
            let off = wrap_signed(pose.heading - truth.z);
            sum += off * off / pose.covariance.m33;
            count += 1;
        } else {
            sum += pose
                .normalised_error(Point2::new(truth.x, truth.y), truth.z)
                .unwrap();
            count += 3;
        }
    }
    (sum, count)
}

#[test]
fn cameras_that_see_a_target_together_calibrate_each_other() {
    let (mut sum, mut count, mut poses) = (0.0, 0, 0);
    let (mut chi_squared, mut freedom) = (0.0, 0);
    let (mut ambiguous, mut all) = (0, 0);
    for seed in 0..60 {
        let mut rng = generator(seed);
        let cameras = 4 + seed as usize % 5;
        let room = Room::random(&mut rng, cameras, 12);
        let references = References {
            cameras: [1, 3],
            baseline: Some(room.baseline([1, 3])),
        };
        let solution = solved(room.seen(&mut rng), Some(references));
        all += cameras;
        if solution.status != Status::Calibrated {
            ambiguous += 1;
            continue;
        }
        assert_eq!(solution.scale_from, ScaleFrom::Baseline);
        let (own, numbers) = nees(&room, &solution, 1.0);
        sum += own;
        count += numbers;
        poses += solution
            .cameras
            .iter()
            .filter(|c| c.estimate.is_some())
            .count();
        chi_squared += solution.chi_squared.unwrap();
        freedom += solution.degrees_of_freedom;
    }
    assert!(ambiguous <= 3, "{ambiguous} of 60 without an answer");
    assert!(10 * poses >= 9 * all, "{poses} of {all} cameras");
    // Cameras of one room share their errors: some four numbers of each are independent.
    assert!(
        chi_squared_band(count as f64 / 3.0).contains(&(sum / 3.0)),
        "{sum} of {count}"
    );
    assert!(
        chi_squared_band(freedom as f64).contains(&chi_squared),
        "{chi_squared} of {freedom}"
    );
}

/// One bearing is off by just less than a test notices: no camera moves by more than was foretold. With
/// nothing beyond the unknowns no camera is checked, and no level is worth the name.
#[test]
fn a_wrong_bearing_moves_a_camera_within_its_protection_level() {
    let (mut beyond, mut poses, mut moved) = (0, 0, 0.0_f64);
    for seed in 0..20 {
        let mut rng = generator(seed);
        let room = Room::random(&mut rng, 6, 12);
        let references = References {
            cameras: [1, 3],
            baseline: Some(room.baseline([1, 3])),
        };
        let mut bearings = room.seen(&mut rng);
        let before = solved(bearings.clone(), Some(references));
        let wrong = rng.random_range(0..bearings.len());
        bearings[wrong].bearing_deg += 4.0 * SIGMA.to_degrees();
        let after = solved(bearings, Some(references));
        if !(before.is_good() && after.is_good()) {
            continue;
        }
        for camera in before.cameras.iter().filter(|camera| !camera.reference) {
            let (Some(level), Some(estimate)) = (camera.protection, camera.estimate) else {
                continue;
            };
            assert!(level.position > 3.0 * estimate.pose().sigma_position());
            let told = after.cameras.iter().find(|c| c.camera == camera.camera);
            let Some(now) = told.and_then(|told| told.estimate) else {
                continue;
            };
            let truth = room.truth([1, 3], camera.camera, 1.0);
            let off = (now.x - truth.x).hypot(now.y - truth.y);
            beyond += usize::from(off > level.position);
            moved = moved.max((now.x - estimate.x).hypot(now.y - estimate.y) / level.position);
            poses += 1;
        }
    }
    assert!(poses > 60 && beyond == 0, "{beyond} of {poses}");
    // The level has the size of one bearing's effect.
    assert!((0.1..1.0).contains(&moved), "{moved}");
    let mut rng = generator(3);
    let least = Room::random(&mut rng, 3, 5);
    let solution = solved(least.seen(&mut rng), None);
    assert!(solution.cameras.iter().all(|camera| !camera.checked));
}

/// Three views have two solutions: a solver that reports a single one must be right.
#[test]
fn three_cameras_are_right_or_ambiguous() {
    let (mut sure, mut ambiguous) = (0, 0);
    for seed in 0..40 {
        let mut rng = generator(seed);
        let room = Room::random(&mut rng, 3, 9);
        let solution = solved(room.seen(&mut rng), None);
        assert_eq!(solution.scale_from, ScaleFrom::Nothing);
        if solution.reason == Some(NetworkSolution::AMBIGUOUS) {
            assert!(!solution.is_good() && solution.advice.is_some());
            ambiguous += 1;
        } else if !solution.is_good() {
            assert_eq!(solution.status, Status::Waiting);
        } else if solution.degrees_of_freedom == 0 {
            assert_eq!(solution.reason, Some(NetworkSolution::UNCHECKED));
        } else if solution
            .cameras
            .iter()
            .all(|c| c.status == Status::Calibrated)
        {
            let unit = room.baseline(solution.references.unwrap());
            let (own, numbers) = nees(&room, &solution, unit);
            assert!(own < 40.0, "{seed}: {own} of {numbers}");
            sure += 1;
        }
    }
    assert!(sure >= 20, "{sure} of 40 are sure");
    assert!(ambiguous >= 1, "none of 40 is ambiguous");
}

/// Without a known distance everything is in units of the baseline.
#[test]
fn a_known_distance_gives_the_scale_and_nothing_else() {
    let mut rng = generator(7);
    let room = Room::random(&mut rng, 6, 10);
    let bearings = room.seen(&mut rng);
    let with = |baseline| {
        let cameras = [2, 5];
        solved(bearings.clone(), Some(References { cameras, baseline }))
    };
    let (bare, scaled) = (with(None), with(Some(7.0)));
    assert_eq!((bare.baseline, scaled.baseline), (Some(1.0), Some(7.0)));
    for (bare, scaled) in bare.cameras.iter().zip(&scaled.cameras) {
        let (bare, scaled) = (bare.estimate.unwrap(), scaled.estimate.unwrap());
        assert!((7.0 * bare.x - scaled.x).abs() < 1e-6);
        assert!((7.0 * bare.sigma_y - scaled.sigma_y).abs() < 1e-6);
        assert!((bare.heading_deg - scaled.heading_deg).abs() < 1e-6);
    }
    assert_eq!(bare.chi_squared, scaled.chi_squared);
}

#[test]
fn a_wrong_bearing_is_named() {
    let mut named = 0;
    for seed in 0..10 {
        let mut rng = generator(seed);
        let room = Room::random(&mut rng, 6, 12);
        let mut bearings = room.seen(&mut rng);
        let wrong = bearings.len() / 2;
        bearings[wrong].bearing_deg += 4.0;
        let (stop, camera) = (bearings[wrong].stop, bearings[wrong].camera);
        let solution = solved(bearings, None);
        let is_it = |finding: &Finding| matches!(*finding, Finding::Bearing { stop: s, camera: c, .. } if (s, c) == (stop, camera));
        named += usize::from(solution.is_good() && solution.findings.iter().any(is_it));
    }
    assert!(named >= 9, "{named} of 10");
}

#[test]
fn too_little_to_begin_with_is_said() {
    let mut rng = generator(2);
    let few = Room::random(&mut rng, 4, 4);
    let solution = solved(few.seen(&mut rng), None);
    assert_eq!(solution.status, Status::Waiting);
    assert!(solution.advice.unwrap().contains("5 places"));
    let sightings = Sightings {
        references: Some(References {
            cameras: [1, 9],
            baseline: None,
        }),
        bearings: few.seen(&mut rng),
        ..Sightings::default()
    };
    let refused = solve(&sightings, &Settings::default());
    assert_eq!(refused.unwrap_err(), NetworkError::NeverSaw(9));
}
