//! Three sightings as the thesis solves them: equations (7) to (9) and the quadrant fix-up.
//!
//! `resection::three_point` answers the same question with less work and without the detour over a
//! heading known only modulo 180 degrees; this form is here because it is the original.
//!
//! With signed offsets all three equations read `tan(theta + phi_i) = (y_i - y) / (x_i - x)`.
//! Multiplied out with `t_i = tan phi_i` and `T = tan theta` they are linear in `T`,
//! `a = T x - y` and `b = x + T y`:
//! ```text
//! T (x_i + t_i y_i) - a - t_i b = y_i - t_i x_i
//! ```
//! The thesis had MATLAB solve them; Cramer's rule does. Numerators and denominator are kept
//! apart, so a heading of 90 degrees, where `T` is infinite, needs no special care.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use calib_core::{Refusal, Sighting, angle};
use nalgebra::{Matrix3, Point2, Vector3};

/// Place, and heading modulo a half turn, before the fix-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SlopeFix {
    /// The camera's centre.
    pub(crate) position: Point2<f64>,
    /// `theta` in `(-pi/2, pi/2]`: the heading, or its opposite.
    pub(crate) theta: f64,
}

/// Solves (7) to (9). Every target must be less than 90 degrees off the axis, as in any pin-hole
/// camera. [`fix_up`] makes the heading whole.
///
/// # Errors
/// [`Refusal::DangerCircle`] for every degenerate geometry (this form does not tell them apart);
/// [`Refusal::TargetBehind`] for a ray 90 degrees or more off the axis;
/// [`Refusal::NotFinite`].
pub(crate) fn solve(sightings: &[Sighting<f64>; 3]) -> Result<SlopeFix, Refusal> {
    if !sightings.iter().all(Sighting::is_usable) {
        return Err(Refusal::NotFinite);
    }
    if !sightings.iter().all(|s| s.ray.forward > 0.0) {
        return Err(Refusal::TargetBehind);
    }
    // Seen from the first target, so that large coordinates cost no digits.
    let [s1, _, _] = sightings;
    let origin = s1.target;
    let t = sightings.each_ref().map(|s| s.ray.left / s.ray.forward);
    let d = sightings.each_ref().map(|s| s.target - origin);
    let column = |f: fn(f64, f64, f64) -> f64| {
        let ([t1, t2, t3], [d1, d2, d3]) = (t, d);
        Vector3::new(f(t1, d1.x, d1.y), f(t2, d2.x, d2.y), f(t3, d3.x, d3.y))
    };
    let of_slope = column(|t, x, y| x + t * y);
    let of_a = column(|_, _, _| -1.0);
    let of_b = column(|t, _, _| -t);
    let right = column(|t, x, y| y - t * x);
    let determinant = |c1, c2, c3| Matrix3::from_columns(&[c1, c2, c3]).determinant();
    // T = sin / cos, a = na / cos, b = nb / cos, all with one common factor.
    let cos = determinant(of_slope, of_a, of_b);
    let sin = determinant(right, of_a, of_b);
    let na = determinant(of_slope, right, of_b);
    let nb = determinant(of_slope, of_a, right);

    let norm2 = cos * cos + sin * sin;
    let noise = (of_slope.amax() + right.amax()) * (f64::EPSILON * 32.0);
    if !(norm2 > noise * noise) {
        return Err(Refusal::DangerCircle);
    }
    let position = Point2::new(
        origin.x + (nb * cos + sin * na) / norm2,
        origin.y + (sin * nb - na * cos) / norm2,
    );
    let theta = if cos == 0.0 {
        FRAC_PI_2
    } else {
        (sin / cos).atan()
    };
    // Coordinates too large to multiply.
    if !(position.coords.sum() + theta).is_finite() {
        return Err(Refusal::NotFinite);
    }
    Ok(SlopeFix { position, theta })
}

/// Lifts `theta` to the full circle, `[0, 2 pi)`.
///
/// The idea is the thesis's: take the sighting closest to the optical axis; the camera looks
/// roughly towards that target. The print compares the *quadrant* of the target with the sign of
/// cosine of the heading, which fails in two cases ([`fix_up_as_printed`]). Here `theta` is turned
/// around exactly when the target would otherwise be behind the camera, which agrees with `atan2`
/// everywhere.
pub(crate) fn fix_up(fix: &SlopeFix, sightings: &[Sighting<f64>; 3]) -> f64 {
    let (sin, cos) = fix.theta.sin_cos();
    let to_target = nearest_to_axis(sightings).target - fix.position;
    let ahead = cos * to_target.x + sin * to_target.y;
    angle::wrap_positive(if ahead < 0.0 {
        fix.theta + PI
    } else {
        fix.theta
    })
}

/// The five cases of the thesis as printed, for study. Do not use it to calibrate.
///
/// 1. When heading and target lie on different sides of the vertical, the result is wrong by 180
///    degrees: for a heading of 95 degrees and a target at a bearing of 85, `theta` is -85, the
///    target is in the first quadrant, and the rule keeps -85.
/// 2. When the target is exactly above or below the camera, the rule returns its bearing, 90 or
///    270 degrees, and not the heading.
///
/// The first case also returns a negative `theta` as it is, outside `[0, 2 pi)`.
pub(crate) fn fix_up_as_printed(fix: &SlopeFix, sightings: &[Sighting<f64>; 3]) -> f64 {
    let d = nearest_to_axis(sightings).target - fix.position;
    if d.x > 0.0 && d.y >= 0.0 {
        fix.theta
    } else if d.x > 0.0 {
        TAU + fix.theta
    } else if d.x < 0.0 {
        PI + fix.theta
    } else if d.y > 0.0 {
        FRAC_PI_2
    } else {
        3.0 * FRAC_PI_2
    }
}

/// The sighting with the smallest `|phi|`; all rays point forward.
fn nearest_to_axis(sightings: &[Sighting<f64>; 3]) -> &Sighting<f64> {
    let slope = |s: &Sighting<f64>| (s.ray.left / s.ray.forward).abs();
    let [a, b, c] = sightings;
    let ab = if slope(b) < slope(a) { b } else { a };
    if slope(c) < slope(ab) { c } else { ab }
}
