//! Simulated Gaussian bearings: a check that the answer's spread reaches the Cramer-Rao bound, and that the
//! predicted covariance agrees.

use calib_core::{Ray, Sighting, resection};
use nalgebra::Point2;
use test_support::{Truth, generator, normal};

use crate::figure::{Estimate, Goal, Sheet};

/// In full, and in brief.
const RUNS: [u32; 2] = [20_000, 4_000];
/// Scenes whose bound is worse, in units per radian of bearing noise, are close to degenerate,
/// where no bound is attained.
const REGULAR: f64 = 15.0;

pub(crate) fn run(sheet: &mut Sheet, is_brief: bool) {
    let runs = RUNS[usize::from(is_brief)];
    sheet.heading("Gaussian bearings against the Cramer-Rao bound (1 to 8 units, 60 degrees)");
    for (n, degrees) in [(3, 0.1), (3, 0.5), (3, 1.0), (6, 0.5), (10, 1.0)] {
        let (ratio, nees) = simulate(n, f64::to_radians(degrees), runs);
        let name = format!("{n} sightings, {degrees} deg:");
        // Both sides: an answer that is better than the bound is no answer to these bearings.
        let of = format!("{name} rms error / bound");
        sheet.estimate(&of, ratio, "", &Goal::Within(0.95, 1.05), is_brief);
        // Its standard error is 0.017 in full; curvature adds a little at one degree.
        let of = format!("{name} NEES (3 is right)");
        sheet.estimate(&of, nees, "", &Goal::Within(2.85, 3.15), is_brief);
    }
}

/// Root of the mean of squared position error over squared bound, and the mean NEES.
fn simulate(n: usize, sigma: f64, most: u32) -> (Estimate, Estimate) {
    let mut rng = generator(2026);
    let (mut ratio, mut nees, mut runs) = (0.0, 0.0, 0);
    while runs < most {
        let truth = Truth::random(&mut rng);
        let targets: [Point2<f64>; 10] = truth.targets(&mut rng);
        let mut sightings = |noise: f64| -> Vec<_> {
            targets
                .iter()
                .take(n)
                .map(|&target| {
                    let bearing = truth.bearing_of(target) + noise * normal(&mut rng);
                    Sighting::new(target, Ray::from_bearing(bearing), sigma)
                })
                .collect()
        };
        let Ok(bound) = resection::solve(&sightings(0.0)) else {
            continue;
        };
        if bound.pose.sigma_position() > REGULAR * sigma {
            continue;
        }
        let noisy = sightings(sigma);
        let Ok(solution) = resection::solve(&noisy) else {
            continue;
        };
        let error = solution.pose.position - truth.position();
        ratio += error.norm_squared() / bound.pose.sigma_position().powi(2);
        nees += solution
            .pose
            .normalised_error(truth.position(), truth.heading)
            .unwrap_or(f64::INFINITY);
        runs += 1;
    }
    let runs = f64::from(most);
    // Chi squared of two and of three degrees of freedom: variances of 4 (of the mean 2) and 6.
    let ratio = Estimate {
        value: (ratio / runs).sqrt(),
        standard_error: 0.5 / runs.sqrt(),
    };
    let nees = Estimate {
        value: nees / runs,
        standard_error: (6.0 / runs).sqrt(),
    };
    (ratio, nees)
}
