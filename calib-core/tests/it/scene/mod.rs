//! Cameras whose truth is known, and their sightings.

use calib_core::{Ray, Sighting};
use nalgebra::Point2;
use test_support::{Truth, clearance, generator};

pub(crate) fn sighting(
    truth: &Truth,
    target: Point2<f64>,
    noise: f64,
    sigma: f64,
) -> Sighting<f64> {
    let bearing = truth.bearing_of(target) + noise;
    Sighting::new(target, Ray::from_bearing(bearing), sigma)
}

/// A camera and three targets, not too near to their circle.
pub(crate) fn regular_scene(seed: u64) -> (Truth, [Point2<f64>; 3]) {
    let mut rng = generator(seed);
    loop {
        let truth = Truth::random(&mut rng);
        let targets = truth.targets::<3>(&mut rng);
        if clearance(truth.position(), &targets) > 1e-3 {
            return (truth, targets);
        }
    }
}
