//! Angles that wrap.

use nalgebra::Matrix2;

use crate::Real;

/// The matrix that turns vectors counter-clockwise.
pub fn rotation<T: Real>(angle: T) -> Matrix2<T> {
    let (sine, cosine) = angle.sine_cosine();
    Matrix2::new(cosine, -sine, sine, cosine)
}

/// The covariance of a vector that is turned by a [`rotation`].
#[inline(never)] // for less flash
pub fn turned<T: Real>(covariance: &Matrix2<T>, rotation: &Matrix2<T>) -> Matrix2<T> {
    rotation * covariance * rotation.transpose()
}

/// The same direction in `[0, 2 pi)`, for any finite angle.
///
/// ```
/// # use calib_core::angle::wrap_positive;
/// assert_eq!(wrap_positive(-0.5_f64), core::f64::consts::TAU - 0.5);
/// assert_eq!(wrap_positive(-1e-30_f64), 0.0); // 2 pi minus nothing is not below 2 pi
/// ```
#[inline(never)] // for less flash
pub fn wrap_positive<T: Real>(angle: T) -> T {
    let turn = T::two_pi();
    let rest = angle - (angle / turn).floor() * turn;
    // Rounding may leave a little less than nothing, or a whole turn.
    let rest = if rest < T::zero() { rest + turn } else { rest };
    if rest < turn { rest } else { T::zero() }
}

/// The same direction in `[-pi, pi)`, for any finite angle.
///
/// ```
/// # use calib_core::angle::wrap_signed;
/// # use core::f64::consts::{PI, TAU};
/// assert_eq!(wrap_signed(PI), -PI);
/// assert!((wrap_signed(3.0 - TAU) - 3.0).abs() < 1e-15);
/// ```
#[inline(never)] // for less flash
pub fn wrap_signed<T: Real>(angle: T) -> T {
    let half = T::pi();
    if angle >= -half && angle < half {
        return angle;
    }
    let turn = T::two_pi();
    let rest = angle - ((angle + half) / turn).floor() * turn;
    // Rounding may leave a little less than minus half a turn, or half a turn.
    if rest >= -half && rest < half {
        rest
    } else {
        -half
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{PI, TAU};

    use super::*;

    /// Next to whole turns, where rounding may leave a little less than nothing or a whole turn; and
    /// next to half ones.
    #[test]
    fn wrapped_angles_are_in_range_and_the_same_direction() {
        for half_turns in -2000..=2000 {
            let near = f64::from(half_turns) * PI;
            for ulps in -4..=4_i64 {
                let double = f64::from_bits(near.to_bits().wrapping_add_signed(ulps));
                let single =
                    f32::from_bits((near as f32).to_bits().wrapping_add_signed(ulps as i32));
                if !(double.abs() < 1e4 && single.abs() < 1e4) {
                    continue; // beside zero there are no neighbours in this way
                }
                let (positive, signed) = (wrap_positive(double), wrap_signed(double));
                assert!((0.0..TAU).contains(&positive), "{double:e}: {positive:e}");
                assert!((-PI..PI).contains(&signed), "{double:e}: {signed:e}");
                for wrapped in [positive, signed] {
                    let off = (wrapped - double) / TAU;
                    assert!((off - off.round()).abs() < 1e-12, "{double:e}: {wrapped:e}");
                }
                let (positive, signed) = (wrap_positive(single), wrap_signed(single));
                let (tau, pi) = (core::f32::consts::TAU, core::f32::consts::PI);
                assert!((0.0..tau).contains(&positive), "{single:e}: {positive:e}");
                assert!((-pi..pi).contains(&signed), "{single:e}: {signed:e}");
                for wrapped in [positive, signed] {
                    let off = f64::from(wrapped - single) / TAU;
                    assert!((off - off.round()).abs() < 2e-4, "{single:e}: {wrapped:e}");
                }
            }
        }
    }
}
