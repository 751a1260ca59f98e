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

    /// What cameras of 70 degrees measure.
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
            println!(
                "{seed}: {} {:?} {:?}",
                solution.status, solution.reason, solution.advice
            );
            ambiguous += 1;
            continue;
        }
        assert_eq!(solution.scale_from, ScaleFrom::Baseline);
        let (own, numbers) = nees(&room, &solution, 1.0);
        println!(
            "{seed}: nees {:.2} of {numbers}, chi {:.1}/{}",
            own / numbers as f64,
            solution.chi_squared.unwrap(),
            solution.degrees_of_freedom
        );
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
    println!("{ambiguous} not, {poses} of {all}, {sum} of {count}, {chi_squared} of {freedom}");
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
