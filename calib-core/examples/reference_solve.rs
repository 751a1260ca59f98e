//! Where two cameras look that see a target together: `cargo run -p calib-core --example reference_solve`.
//!
//! Known are the distance of the cameras, and how far and in which direction the target walked between its stops. Not
//! known are the headings of the cameras, where the target is, and how its compass is turned.

use calib_core::{
    Ray,
    nalgebra::{Matrix2, Point2, Rotation2},
    reference::{self, Known, ReferenceSettings, Stop},
};

/// The truth, of which the solver is told only what was measured.
const HEADINGS: [f64; 2] = [0.9, 2.2];
const BASELINE: f64 = 10.0;
const COMPASS: f64 = 0.3;
const STOPS: [[f64; 2]; 4] = [[5.0, 5.0], [3.6, 7.5], [6.4, 7.0], [4.5, 4.6]];

fn main() -> Result<(), Box<dyn core::error::Error>> {
    let cameras = [Point2::origin(), Point2::new(BASELINE, 0.0)];
    let mut before = Point2::from(STOPS[0]);
    let stops = STOPS.map(|place| {
        let target = Point2::from(place);
        let walked = Rotation2::new(-COMPASS) * (target - before);
        before = target;
        Stop {
            rays: [0, 1].map(|n| Ray::towards(cameras[n], HEADINGS[n], target)),
            bearing_sigmas: [0.005; 2],
            displacement: walked,
            displacement_covariance: Matrix2::from_diagonal_element(0.05_f64.powi(2)),
        }
    });
    let known = Known {
        baseline: Some(BASELINE),
        frame_heading: None,
    };
    let outcome = reference::solve(&stops, &known, &ReferenceSettings::default())?;
    let (best, sigmas) = (outcome.best, outcome.best.heading_sigmas());
    for n in [0, 1] {
        let (heading, sigma) = (best.headings[n].to_degrees(), sigmas[n].to_degrees());
        println!("camera {n} looks to {heading:.2} +/- {sigma:.2} deg");
        assert!((best.headings[n] - HEADINGS[n]).abs() < 1e-6);
    }
    for (n, (place, _)) in best.places(&stops).enumerate() {
        println!("stop {n}: {:.3}, {:.3}", place.x, place.y);
        assert!((place - Point2::from(STOPS[n])).norm() < 1e-6);
    }
    println!(
        "another answer fits as well: {}",
        outcome.alternative.is_some()
    );
    Ok(())
}
