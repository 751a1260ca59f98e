//! The scalar that everything is generic over.

use nalgebra::RealField;

/// A real number: `f32` on a node, `f64` on a computer.
///
/// Implemented for every [`RealField`] that can be copied; there is nothing to implement.
pub trait Real: RealField + Copy {}

impl<T: RealField + Copy> Real for T {}

/// A literal in the scalar at hand. Folds to a constant.
#[inline(always)]
pub(crate) fn lit<T: Real>(value: f64) -> T {
    nalgebra::convert(value)
}
