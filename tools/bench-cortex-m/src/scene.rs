//! Random cameras that see three targets well.

use calib_core::{Ray, Real, Sighting};
use nalgebra::{Point2, Rotation2, Vector2};
use rand::{Rng, RngExt, distr::uniform::SampleUniform};

/// Half of the camera's field of view, radians.
const HALF_VIEW: f64 = core::f64::consts::FRAC_PI_6;

/// Nearest and farthest target.
const RANGES: (f64, f64) = (1.0, 8.0);

/// Largest move of the position by a bearing error of one radian, lengths, to first order: scenes nearer to the
/// danger circle are left out. One degree then moves it by about one length.
const LARGEST_POSITION_PER_RADIAN: f64 = 60.0;

/// A camera's true pose, and three targets in its view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scene<T: Real> {
    /// Place of the camera, within 10 of the origin along each axis.
    pub position: Point2<T>,
    /// Direction of its axis, radians in `[0, 2 pi)`.
    pub heading: T,
    /// Three places 1 to 8 from the camera, at most 30 degrees off its axis, in random order.
    pub targets: [Point2<T>; 3],
    /// The rays they are seen along, without error, as a pin-hole camera gives them:
    /// `forward` is 1.
    pub rays: [Ray<T>; 3],
}

impl<T: Real + SampleUniform> Scene<T> {
    /// Draws until the camera is away from the danger circle of its targets.
    pub fn random(random: &mut impl Rng) -> Self {
        loop {
            let scene = Self::anywhere(random);
            if scene.position_per_radian() < nalgebra::convert(LARGEST_POSITION_PER_RADIAN) {
                return scene;
            }
        }
    }

    fn anywhere(random: &mut impl Rng) -> Self {
        let mut between = |low: f64, high: f64| -> T {
            random.random_range(nalgebra::convert(low)..nalgebra::convert(high))
        };
        let position = Point2::new(between(-10.0, 10.0), between(-10.0, 10.0));
        let heading = between(0.0, core::f64::consts::TAU);
        let frame = Rotation2::new(heading);
        let [first, second, third] = core::array::from_fn(|_| {
            let bearing = between(-HALF_VIEW, HALF_VIEW);
            let range = between(RANGES.0, RANGES.1);
            let ray = Ray {
                forward: T::one(),
                left: bearing.tan(),
            };
            (position + frame * polar(range, bearing), ray)
        });
        Self {
            position,
            heading,
            targets: [first.0, second.0, third.0],
            rays: [first.1, second.1, third.1],
        }
    }
}

impl<T: Real> Scene<T> {
    /// Input of a solver that works with rays.
    pub fn sightings(&self, bearing_sigma: T) -> [Sighting<T>; 3] {
        core::array::from_fn(|i| Sighting::new(self.targets[i], self.rays[i], bearing_sigma))
    }

    /// Input of a solver that works with angles: the targets, and their bearings relative to the camera's axis,
    /// radians, counter-clockwise.
    pub fn bearings(&self) -> ([Point2<T>; 3], [T; 3]) {
        (self.targets, self.rays.map(Ray::bearing))
    }

    /// Standard deviation of the position for bearings with one of a radian:
    /// `sqrt(sum r_i^2 d_jk^2) / |sum r_i s_jk|`, the Cramer-Rao bound of three bearings. `r_i` are
    /// the ranges of the targets, `d_jk` the distance of the other two, `s_jk` the sine between
    /// their rays; the sum in the denominator vanishes on the danger circle.
    fn position_per_radian(&self) -> T {
        let to_target = self.targets.map(|target| target - self.position);
        let (mut squares, mut determinant) = (T::zero(), T::zero());
        for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
            let (r_i, r_j, r_k) = (to_target[i], to_target[j], to_target[k]);
            squares += r_i.norm_squared() * (r_j - r_k).norm_squared();
            determinant += r_i.norm() * r_j.perp(&r_k) / (r_j.norm() * r_k.norm());
        }
        squares.sqrt() / determinant.abs()
    }
}

fn polar<T: Real>(length: T, angle: T) -> Vector2<T> {
    let (sin, cos) = angle.sin_cos();
    Vector2::new(cos, sin) * length
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::total;

    fn scenes() -> impl Iterator<Item = Scene<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        core::iter::repeat_with(move || Scene::random(&mut random)).take(1000)
    }

    #[test]
    fn rays_point_from_the_camera_to_the_targets() {
        for scene in scenes() {
            for (target, ray) in scene.targets.iter().zip(scene.rays) {
                let to_target = target - scene.position;
                let range = to_target.norm();
                assert!((1.0 - 1e-12..8.0 + 1e-12).contains(&range));
                let along = scene.heading + ray.left.atan2(ray.forward);
                assert!((to_target.x - range * along.cos()).abs() < 1e-12);
                assert!((to_target.y - range * along.sin()).abs() < 1e-12);
                assert!(ray.forward == 1.0 && ray.left.abs() < 30_f64.to_radians().tan());
            }
        }
    }

    /// The bound on the sensitivity holds for the difference quotient of a solver: no scene is
    /// near the danger circle.
    #[test]
    fn no_scene_is_near_the_danger_circle() {
        let error = 1e-7;
        let mut largest = 0.0_f64;
        for scene in scenes() {
            let (targets, bearings) = scene.bearings();
            let squares = (0..3).map(|i| {
                let mut bearings = bearings;
                bearings[i] += error;
                let moved = total::position(&targets, &bearings).unwrap() - scene.position;
                moved.norm_squared() / (error * error)
            });
            largest = largest.max(squares.sum::<f64>().sqrt());
        }
        assert!((50.0..60.1).contains(&largest), "{largest}");
    }
}
