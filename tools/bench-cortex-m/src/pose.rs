//! Poses from three sightings, to compare between machines.

use calib_core::resection::three_point;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::{measure::INPUTS, scene::Scene};

const SEED: u64 = 2001;
/// Standard deviation of a bearing, radians.
const BEARING_SIGMA: f32 = 0.005;

/// Random scenes.
pub fn scenes() -> impl Iterator<Item = Scene<f32>> {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    core::iter::repeat_with(move || Scene::random(&mut random)).take(INPUTS)
}

/// The pose from three sightings, as bits: x, y, heading, and the lower triangle of their
/// covariance by rows. All zero when it was refused.
pub fn solve(scene: &Scene<f32>) -> [u32; 9] {
    let Ok(pose) = three_point::solve(&scene.sightings(BEARING_SIGMA)) else {
        return [0; 9];
    };
    let [xx, xy, yy, xh, yh, hh] = pose.covariance_triangle();
    let [x, y] = pose.position.coords.into();
    [x, y, pose.heading, xx, xy, yy, xh, yh, hh].map(f32::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bearings without error give the true pose, to rounding.
    #[test]
    fn they_are_right() {
        assert_eq!(scenes().count(), INPUTS);
        for scene in scenes() {
            let [x, y, heading, ..] = solve(&scene).map(f32::from_bits);
            assert!((x - scene.position.x).abs() < 2e-3, "{x} {scene:?}");
            assert!((y - scene.position.y).abs() < 2e-3, "{y} {scene:?}");
            let turn = heading - scene.heading;
            assert!(turn.sin().abs() < 1e-3 && turn.cos() > 0.0, "{scene:?}");
        }
    }
}
