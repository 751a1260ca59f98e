//! Looks of cameras that track, and their cost for the coordinator.

use core::fmt;

use calib_core::{
    Pose, Ray,
    angle::wrap_positive,
    intersection::StationBearing,
    tracking::{Look, OBJECTS, Settings, Tracker},
};
use nalgebra::{Matrix3, Point2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::measure::{Bench, Counter, Error};

const SEED: u64 = 2031;
const CAMERAS: usize = 20;
/// Microseconds between two looks: twenty cameras tell five a second each.
const APART: u64 = 10_000;
/// Looks until all objects are known.
const SETTLE: usize = 1_000;
/// Looks that are counted.
const COUNTED: usize = 900;
const SIGMA: f32 = 0.004;

/// Counts each look: at first, while objects are found, and when all are known.
///
/// # Errors
/// As [`Bench::measure`].
pub fn measure_all<C: Counter, W: fmt::Write>(bench: &mut Bench<C, W>) -> Result<(), Error> {
    let mut scene = Scene::new();
    let mut left = SETTLE;
    bench.measure_steps("tracker_look_while_4_are_found", || {
        scene.take();
        left -= 1;
        left > 0
    })?;
    assert_eq!(scene.tracker.objects().count(), OBJECTS, "all are found");
    let mut left = COUNTED;
    bench.measure_steps("tracker_look_of_4_objects", || {
        scene.take();
        left -= 1;
        left > 0
    })
}

/// Four that stand in a hall, and cameras around them that look at one after the other.
struct Scene {
    tracker: Tracker<f32>,
    random: ChaCha8Rng,
    looks: usize,
}

const PLACES: [[f32; 2]; OBJECTS] = [[6.0, 6.0], [14.0, 6.0], [6.0, 14.0], [13.0, 15.0]];

impl Scene {
    fn new() -> Self {
        Self {
            tracker: Tracker::new(Settings::WALKING),
            random: ChaCha8Rng::seed_from_u64(SEED),
            looks: 0,
        }
    }

    /// Draws a look and takes it in. Drawing is in the count: some hundred instructions.
    fn take(&mut self) {
        let n = self.looks;
        self.looks += 1;
        let at = n as u64 * APART;
        let camera = n % CAMERAS;
        let place = PLACES[(n / CAMERAS + camera) % OBJECTS];
        let angle = camera as f32 * (core::f32::consts::TAU / CAMERAS as f32);
        let position = Point2::new(
            10.0 + 9.0 * libm::cosf(angle),
            10.0 + 9.0 * libm::sinf(angle),
        );
        let towards = libm::atan2f(place[1] - position.y, place[0] - position.x);
        let heading = wrap_positive(angle + core::f32::consts::PI);
        let noise: f32 = (0..3)
            .map(|_| self.random.random_range(-1.0..1.0_f32))
            .sum();
        let look = Look {
            camera: camera as u16,
            at,
            bearing: StationBearing {
                pose: Pose {
                    position,
                    heading,
                    covariance: Matrix3::from_diagonal(&[1e-3, 1e-3, 1e-5].into()),
                },
                ray: Ray::from_bearing(towards - heading + noise * SIGMA),
                bearing_sigma: SIGMA,
                range: None,
            },
            half_width: 0.01,
            is_wide: false,
        };
        self.tracker.take(at, &look);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The counted scene fits its name.
    #[test]
    fn all_four_are_found_and_stay() {
        let mut scene = Scene::new();
        for _ in 0..SETTLE {
            scene.take();
        }
        let ids = || scene.tracker.objects().map(|object| object.id);
        assert_eq!(ids().count(), OBJECTS);
        let before: std::vec::Vec<u16> = ids().collect();
        for _ in 0..COUNTED {
            scene.take();
        }
        let after = scene.tracker.objects();
        assert!(after.map(|object| object.id).eq(before));
        for place in PLACES {
            let off = |at: Point2<f32>| (at - Point2::from(place)).norm();
            assert!(scene.tracker.objects().any(|o| off(o.position) < 0.2));
        }
    }
}
