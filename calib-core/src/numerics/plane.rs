//! Vectors of the plane as complex numbers: products that turn and stretch instead of sines.

use nalgebra::Vector2;

use crate::Real;

/// `a b`
#[inline(always)]
pub(crate) fn mul<T: Real>(a: Vector2<T>, b: Vector2<T>) -> Vector2<T> {
    Vector2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

/// `a conj(b)`: `a` turned back by the angle of `b`.
#[inline(always)]
pub(crate) fn mul_conj<T: Real>(a: Vector2<T>, b: Vector2<T>) -> Vector2<T> {
    Vector2::new(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y)
}

/// `Re(a conj(b))`
#[inline(always)]
pub(crate) fn dot<T: Real>(a: Vector2<T>, b: Vector2<T>) -> T {
    a.x * b.x + a.y * b.y
}

/// `Im(conj(a) b)`: positive when `b` is counter-clockwise of `a`.
#[inline(always)]
pub(crate) fn cross<T: Real>(a: Vector2<T>, b: Vector2<T>) -> T {
    a.x * b.y - a.y * b.x
}

/// `j a`: a quarter turn counter-clockwise.
#[inline(always)]
pub(crate) fn quarter_turn<T: Real>(a: Vector2<T>) -> Vector2<T> {
    Vector2::new(-a.y, a.x)
}

/// The unit vector in a direction.
#[inline]
pub(crate) fn unit<T: Real>(angle: T) -> Vector2<T> {
    let (sin, cos) = angle.sine_cosine();
    Vector2::new(cos, sin)
}

/// A size without a square root, within `[|a|, sqrt(2) |a|]`: for comparing magnitudes.
#[inline(always)]
pub(crate) fn taxicab<T: Real>(a: Vector2<T>) -> T {
    a.x.abs() + a.y.abs()
}
