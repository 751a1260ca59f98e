//! The ground that a camera sees: its field of view as far as walls let it.

use nalgebra::{Point2, Vector2};

/// Steps of the arc where nothing is in the way.
const STEP: f64 = 0.04;
/// Rays pass the end of a wall on both sides of it.
const BESIDE: f64 = 1e-6;

/// A straight wall.
pub(super) type Wall = [Point2<f64>; 2];

/// Outline of the ground that is seen from `eye` within `half` a field of view to both sides of `heading`,
/// radians, not farther than `range`: a ray to each end of a wall and all along the arc, each up to the first
/// wall.
pub(super) fn outline(
    eye: Point2<f64>,
    heading: f64,
    half: f64,
    range: f64,
    walls: &[Wall],
) -> Vec<Point2<f64>> {
    let near: Vec<&Wall> = walls.iter().filter(|w| distance(eye, w) < range).collect();
    let steps = (2.0 * half / STEP).ceil().max(1.0);
    let mut bearings: Vec<f64> = (0..=steps as u32)
        .map(|k| half * (2.0 * f64::from(k) / steps - 1.0))
        .collect();
    for end in near.iter().copied().flatten() {
        let to = end - eye;
        let bearing = calib_core::angle::wrap_signed(to.y.atan2(to.x) - heading);
        let rays = [bearing - BESIDE, bearing + BESIDE];
        bearings.extend(rays.into_iter().filter(|bearing| bearing.abs() < half));
    }
    bearings.sort_unstable_by(f64::total_cmp);
    let arc = bearings.into_iter().map(|bearing| {
        let (sin, cos) = (heading + bearing).sin_cos();
        let ray = Vector2::new(cos, sin);
        let hits = near.iter().filter_map(|wall| hit(eye, ray, wall));
        eye + ray * hits.fold(range, f64::min)
    });
    std::iter::once(eye).chain(arc).collect()
}

/// Distance that a ray along a unit vector runs until it hits a wall.
fn hit(eye: Point2<f64>, ray: Vector2<f64>, [a, b]: &Wall) -> Option<f64> {
    let (along, to) = (b - a, a - eye);
    let determinant = ray.perp(&along);
    let distance = to.perp(&along) / determinant;
    let share = to.perp(&ray) / determinant;
    ((0.0..=1.0).contains(&share) && distance >= 0.0).then_some(distance)
}

fn distance(from: Point2<f64>, [a, b]: &Wall) -> f64 {
    let along = b - a;
    let share = (from - a).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
    (a + along * share.clamp(0.0, 1.0) - from).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(outline: &[Point2<f64>]) -> f64 {
        let next = outline.iter().cycle().skip(1);
        let parts = outline
            .iter()
            .zip(next)
            .map(|(a, b)| a.coords.perp(&b.coords));
        parts.sum::<f64>() / 2.0
    }

    /// A wall of one unit across the axis at a distance of 1, seen under 2 atan(1/2): a triangle in
    /// front of it stays of the sector.
    #[test]
    fn nothing_is_seen_behind_a_wall() {
        let half = 0.8;
        let whole = outline(Point2::new(3.0, 3.0), 1.0, half, 5.0, &[]);
        assert!((area(&whole) - 25.0 * half).abs() < 0.02);
        let wall = [Point2::new(1.0, -0.5), Point2::new(1.0, 0.5)];
        let behind = [Point2::new(6.0, -9.0), Point2::new(6.0, 9.0)];
        let seen = outline(Point2::origin(), 0.0, half, 5.0, &[wall, behind]);
        let hidden = 25.0 * 0.5_f64.atan() - 0.5;
        assert!((area(&seen) - (25.0 * half - hidden)).abs() < 0.02);
        assert!(
            seen.iter()
                .all(|p| p.x <= 1.0 + 1e-9 || p.y.abs() > 0.499 * p.x)
        );
    }
}
