//! Cost of single precision: the same three sightings solved in `f32` and in `f64`.
//!
//! The difference is stated as the bearing noise that would do as much harm: distance between the
//! two answers over the position's sigma per radian of bearing noise. That is comparable over all
//! geometries, good and bad; conditioning is that sigma itself.

use calib_core::{Ray, Sighting, resection::three_point};
use nalgebra::Matrix2;
use test_support::{Truth, generator};

use crate::figure::{Goal, Sheet, quantile};

/// In full, and in brief.
const GEOMETRIES: [usize; 2] = [1_000_000, 100_000];
/// Upper ends of the classes, in units of length per radian of bearing noise.
const CLASSES: [f64; 5] = [10.0, 30.0, 100.0, 1000.0, f64::INFINITY];

pub(crate) fn run(sheet: &mut Sheet, is_brief: bool) {
    let geometries = GEOMETRIES[usize::from(is_brief)];
    sheet.heading(&format!(
        "f32 against f64, {geometries} random geometries, as equivalent bearing noise"
    ));
    let mut rng = generator(32);
    let mut by_class: [Vec<f64>; CLASSES.len()] = Default::default();
    let (mut refused, mut all) = (0, Vec::with_capacity(geometries));
    for _ in 0..geometries {
        let truth = Truth::random(&mut rng);
        let targets: [_; 3] = truth.targets(&mut rng);
        // A sigma of one radian: the covariance is per radian.
        let double = targets.map(|t| Sighting::new(t, Ray::from_bearing(truth.bearing_of(t)), 1.0));
        let single = double.map(|s| Sighting {
            target: s.target.cast(),
            ray: Ray {
                forward: s.ray.forward as f32,
                left: s.ray.left as f32,
            },
            bearing_sigma: 1.0,
            target_covariance: Matrix2::zeros(),
        });
        let (Ok(double), Ok(single)) = (three_point::solve(&double), three_point::solve(&single))
        else {
            refused += 1;
            continue;
        };
        let condition = double.sigma_position();
        let noise = (single.position.cast::<f64>() - double.position).norm() / condition;
        all.push(noise);
        let class = CLASSES.iter().position(|&limit| condition <= limit);
        by_class[class.unwrap_or(CLASSES.len() - 1)].push(noise);
    }
    let mut lower = 0.0;
    for (upper, mut noises) in CLASSES.into_iter().zip(by_class) {
        if !noises.is_empty() {
            let share = noises.len() as f64 / geometries as f64 * 100.0;
            let name = format!("{lower} to {upper} units per rad ({share:.1} %)");
            for (what, p) in [("median", 0.5), ("p99.9", 0.999)] {
                let value = quantile(&mut noises, p);
                sheet.figure(&format!("{name}, {what}"), value * 1e6, "urad", &Goal::None);
            }
        }
        lower = upper;
    }
    let p999 = quantile(&mut all, 0.999);
    sheet.figure("all, p99.9", p999 * 1e6, "urad", &Goal::AtMost(1.0));
    let share = f64::from(refused) / geometries as f64 * 100.0;
    sheet.figure("refused by one or the other", share, "%", &Goal::None);
}
