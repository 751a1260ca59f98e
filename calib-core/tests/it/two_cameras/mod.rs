//! Random scenes of two reference cameras and a target.

use nalgebra::Point2;
use rand::RngExt;
use test_support::{Truth, generator};

/// Two cameras and a target's path, in the reference frame.
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) cameras: [Truth; 2],
    pub(crate) baseline: f64,
    pub(crate) stops: Vec<Point2<f64>>,
}

/// Both stops inside both views of 60 degrees and within 8 units of both cameras.
pub(crate) fn scene(seed: u64, stops: usize) -> Scene {
    let mut rng = generator(seed);
    loop {
        let baseline = rng.random_range(2.0..10.0);
        let camera = |x, heading| Truth { x, y: 0.0, heading };
        let cameras = [
            camera(0.0, rng.random_range(0.0..core::f64::consts::TAU)),
            camera(baseline, rng.random_range(0.0..core::f64::consts::TAU)),
        ];
        let mut places = Vec::new();
        for _ in 0..60 {
            let place = cameras[0].place(rng.random_range(1.0..8.0), rng.random_range(-0.5..0.5));
            let range = (place - Point2::new(baseline, 0.0)).norm();
            let spread = places
                .iter()
                .all(|p: &Point2<f64>| (p - place).norm() > 0.5);
            if (1.0..8.0).contains(&range) && cameras[1].bearing_of(place).abs() < 0.5 && spread {
                places.push(place);
            }
            if places.len() == stops {
                return Scene {
                    cameras,
                    baseline,
                    stops: places,
                };
            }
        }
    }
}
