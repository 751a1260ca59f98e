//! Angles that wrap.

use nalgebra::Matrix2;

use crate::Real;

/// The matrix that turns vectors counter-clockwise.
pub fn rotation<T: Real>(angle: T) -> Matrix2<T> {
    let (sine, cosine) = angle.sine_cosine();
    Matrix2::new(cosine, -sine, sine, cosine)
}

/// The covariance of a vector that is turned by a [`rotation`].
#[inline(never)] // size
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
#[inline(never)] // size
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
#[inline(never)] // size
pub fn wrap_signed<T: Real>(angle: T) -> T {
    let half = T::pi();
    if angle >= -half && angle < half {
        return angle;
    }
    let turn = T::two_pi();
    let rest = angle - ((angle + half) / turn).floor() * turn;
    if rest < half { rest } else { -half }
}
