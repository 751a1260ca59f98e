//! The baseline: three-object triangulation by the power centre of three circles.
//!
//! V. Pierlot and M. Van Droogenbroeck, "A New Three Object Triangulation Algorithm for Mobile
//! Robot Positioning" (`ToTal`), IEEE Transactions on Robotics 30(3), 2014. Two beacons and the
//! angle between them put the robot on a circle; the three circles' radical axes meet in the
//! robot. Written from the published formulas.

use calib_core::Real;
use nalgebra::{Point2, Vector2};

/// Position and heading of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TotalPose<T: Real> {
    /// The robot's place, in the frame and the unit of the beacons.
    pub position: Point2<T>,
    /// The direction the angles count from, radians, not wrapped.
    pub heading: T,
}

/// Place of the robot that sees `beacons` at `angles`: radians, counter-clockwise, from any common direction.
///
/// `None` where the three circles are one, to the last bit. Close to there, on the circle through
/// the beacons or on one line with all of them, the answer is a bad one, as published.
#[inline]
pub fn position<T: Real>(beacons: &[Point2<T>; 3], angles: &[T; 3]) -> Option<Point2<T>> {
    let cot_12 = limited((angles[1] - angles[0]).tan().recip());
    let cot_23 = limited((angles[2] - angles[1]).tan().recip());
    let cot_31 = limited((T::one() - cot_12 * cot_23) / (cot_12 + cot_23));

    // Relative to the second beacon, and twice as far from it as the centres are.
    let to_1 = beacons[0] - beacons[1];
    let to_3 = beacons[2] - beacons[1];
    let centre_12 = to_1 - quarter_turn(to_1) * cot_12;
    let centre_23 = to_3 + quarter_turn(to_3) * cot_23;
    let centre_31 = to_3 + to_1 - quarter_turn(to_3 - to_1) * cot_31;
    let power = to_1.dot(&to_3) + cot_31 * to_1.perp(&to_3);

    let axis = centre_12 - centre_23;
    let determinant = axis.perp(&(centre_23 - centre_31));
    if determinant == T::zero() {
        return None;
    }
    Some(beacons[1] - quarter_turn(axis) * (power / determinant))
}

/// Beacons seen in the same or in opposite directions have an infinite cotangent. Here it is
/// limited to that of an angle far below what is measured: 1e-8 rad in `f64`. In `f32` the like,
/// half of the digits, is 3e-4 rad: less than a fiftieth of a degree.
#[inline(always)]
fn limited<T: Real>(cotangent: T) -> T {
    let half_of_the_digits = nalgebra::convert(1e-8);
    let limit: T = nalgebra::convert(if T::default_epsilon() < half_of_the_digits {
        1e8
    } else {
        3e3
    });
    cotangent.clamp(-limit, limit)
}

/// [`position`], and from it the heading by way of the first beacon.
#[inline]
pub fn pose<T: Real>(beacons: &[Point2<T>; 3], angles: &[T; 3]) -> Option<TotalPose<T>> {
    let position = position(beacons, angles)?;
    let to_first = beacons[0] - position;
    Some(TotalPose {
        position,
        heading: to_first.y.atan2(to_first.x) - angles[0],
    })
}

#[inline(always)]
fn quarter_turn<T: Real>(a: Vector2<T>) -> Vector2<T> {
    Vector2::new(-a.y, a.x)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::scene::Scene;

    fn angles(position: Point2<f64>, heading: f64, beacons: &[Point2<f64>; 3]) -> [f64; 3] {
        beacons.map(|beacon| {
            let to_beacon = beacon - position;
            to_beacon.y.atan2(to_beacon.x) - heading
        })
    }

    fn turn_between(a: f64, b: f64) -> f64 {
        let rest = (a - b).rem_euclid(TAU);
        rest.min(TAU - rest)
    }

    /// Beacons all around, in any order. Rounding is amplified without bound towards the circle
    /// through the beacons, so places within a tenth of its radius are left out.
    #[test]
    fn the_true_pose_anywhere_in_f64() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut point = || -> Point2<f64> {
            Point2::new(
                random.random_range(-10.0..10.0),
                random.random_range(-10.0..10.0),
            )
        };
        let mut solved = 0;
        for _ in 0..10_000 {
            let beacons = [point(), point(), point()];
            let position = point();
            let heading = position.x; // any angle, also beyond one turn
            let [a, b, c] = beacons;
            let doubled_area = (b - a).perp(&(c - a));
            let radius =
                (b - a).norm() * (c - b).norm() * (a - c).norm() / (2.0 * doubled_area.abs());
            // The circle's centre, from b: |v|^2 = 2 v . centre for both other corners.
            let (u, v) = (a - b, c - b);
            let centre =
                b - quarter_turn(u * v.norm_squared() - v * u.norm_squared()) / (2.0 * u.perp(&v));
            if ((position - centre).norm() / radius - 1.0).abs() < 0.1 || radius > 100.0 {
                continue;
            }
            solved += 1;
            let pose = pose(&beacons, &angles(position, heading, &beacons)).unwrap();
            assert!((pose.position - position).norm() < 1e-9);
            assert!(turn_between(pose.heading, heading) < 1e-9);
        }
        assert!(solved > 5_000, "{solved}");
    }

    /// Single precision is enough but for pairs of beacons in almost the same direction, whose
    /// large cotangents cost digits.
    #[test]
    fn the_true_pose_in_view_in_f32() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut beyond_a_thousandth = 0;
        for _ in 0..10_000 {
            let scene = Scene::<f32>::random(&mut random);
            let (beacons, angles) = scene.bearings();
            let pose = pose(&beacons, &angles).unwrap();
            let error = (pose.position - scene.position).norm();
            let turn = turn_between(pose.heading.into(), scene.heading.into());
            assert!(error < 0.05 && turn < 0.01);
            beyond_a_thousandth += u32::from(error > 1e-3 || turn > 1e-3);
        }
        assert!(beyond_a_thousandth < 20, "{beyond_a_thousandth}");
    }

    /// Each pair in turn seen in the same and in opposite directions. The limit on the cotangent
    /// is an angle error of 1e-8 or 3e-4, and the range of the beacons is a few lengths.
    #[test]
    fn collinear_with_two_beacons() {
        let position = Point2::new(1.0, -2.0);
        for opposite in [0.0, PI] {
            for [first, second, third] in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
                let mut angles = [0.0; 3];
                angles[first] = 0.3;
                angles[second] = 0.3 + opposite;
                angles[third] = 1.5;
                let mut beacons = [position; 3];
                for (i, range) in [(first, 3.0), (second, 4.0), (third, 2.0)] {
                    beacons[i] += Vector2::new(angles[i].cos(), angles[i].sin()) * range;
                }
                let double = pose(&beacons, &angles).unwrap();
                assert!((double.position - position).norm() < 5e-7);
                assert!(turn_between(double.heading, 0.0) < 5e-7);

                let single = pose(
                    &beacons.map(Point2::cast::<f32>),
                    &angles.map(|angle| angle as f32),
                )
                .unwrap();
                assert!((single.position - position.cast()).norm() < 0.01);
                assert!(turn_between(single.heading.into(), 0.0) < 0.01);
            }
        }
    }

    /// A known answer: three corners of a square, each a quarter turn from the next.
    #[test]
    fn in_the_middle_of_a_square() {
        let beacons = [
            Point2::new(4.0, 4.0),
            Point2::new(0.0, 4.0),
            Point2::new(0.0, 0.0),
        ];
        let angles = [-FRAC_PI_4, FRAC_PI_4, FRAC_PI_4 + FRAC_PI_2];
        let pose = pose(&beacons, &angles).unwrap();
        assert!((pose.position - Point2::new(2.0, 2.0)).norm() < 5e-8);
        assert!(turn_between(pose.heading, FRAC_PI_2) < 5e-8);
    }

    #[test]
    fn no_answer_from_one_place() {
        let beacon = Point2::new(3.0, 1.0);
        assert_eq!(position(&[beacon; 3], &[0.5, 0.6, 0.7]), None);
    }
}
