//! The R factor of a QR decomposition, kept packed and grown row by row.
//!
//! Rows are inserted by Givens rotations, so the kept part is never larger than the unknowns, however many
//! rows there are. That is the square-root form: its condition is the root of that of the normal equations,
//! which in single precision decides between an answer and none. Golub and Van
//! Loan, "Matrix Computations", 5.1.9 and 5.2.5; Bierman, "Factorization Methods for Discrete
//! Sequential Estimation", 1977.

use crate::{
    Real,
    numerics::{plane, real::lit},
};
use nalgebra::Vector2;

/// A pivot that is so many units in the last place of its column is rounding.
const NOISE: f64 = 256.0;

/// Upper triangular equations over `width - 1` unknowns, the right side in the last column. Row `i`
/// begins at its diagonal.
pub(super) struct Triangle<'a, T> {
    rows: &'a mut [T],
    width: usize,
}

/// Numbers that a triangle of so many columns takes, that of the right side included.
pub(super) const fn packed(width: usize) -> usize {
    width * (width + 1) / 2
}

impl<'a, T: Real> Triangle<'a, T> {
    /// Over numbers that are a triangle of this width, or are about to be; `None` if they are too
    /// few.
    pub(super) fn new(numbers: &'a mut [T], width: usize) -> Option<Self> {
        let rows = numbers.get_mut(..packed(width))?;
        Some(Self { rows, width })
    }

    pub(super) fn clear(&mut self) {
        self.rows.fill(T::zero());
    }

    /// Row `i`, from its diagonal to the right side.
    pub(super) fn row(&self, i: usize) -> &[T] {
        let begin = self.begin(i);
        let end = begin + self.width.saturating_sub(i);
        self.rows.get(begin..end).unwrap_or_default()
    }

    fn begin(&self, i: usize) -> usize {
        // The sum of the lengths before it.
        (i * (2 * self.width + 1)).saturating_sub(i * i) / 2
    }

    /// Adds the equation `row`, right side last; `row` is used up.
    pub(super) fn insert(&mut self, row: &mut [T]) {
        let mut rest = &mut *self.rows;
        for j in 0..self.width.saturating_sub(1) {
            let Some((own, next)) = rest.split_at_mut_checked(self.width - j) else {
                break;
            };
            rest = next;
            let Some(row) = row.get_mut(j..) else { break };
            if let (Some(&a), Some(&b)) = (own.first(), row.first()) {
                rotate([a, b], own, row);
            }
        }
    }

    /// The right side of the determined unknowns.
    pub(super) fn right_side(&self, right: &mut [T]) {
        for (i, to) in right.iter_mut().enumerate() {
            *to = self.row(i).last().copied().unwrap_or_else(T::zero);
        }
    }

    /// Drops the unknowns without a pivot, or with one that is rounding: these stay where they are. `row` is as
    /// long as a row.
    pub(super) fn drop_undetermined(&mut self, row: &mut [T]) {
        for i in 0..self.width.saturating_sub(1) {
            if self.is_determined(i) {
                continue;
            }
            // Its information about the unknowns behind it stays.
            row.fill(T::zero());
            let begin = self.begin(i);
            let own = self.rows.get_mut(begin..begin + self.width - i);
            for (to, from) in row.iter_mut().skip(i).zip(own.unwrap_or_default()) {
                *to = core::mem::replace(from, T::zero());
            }
            if let Some(pivot) = row.get_mut(i) {
                *pivot = T::zero();
            }
            self.insert(row);
        }
    }

    /// Returns true if an unknown was dropped.
    pub(super) fn has_dropped(&self) -> bool {
        let mut unknowns = 0..self.width.saturating_sub(1);
        unknowns.any(|i| self.row(i).first() == Some(&T::zero()))
    }

    /// The `x` of `R x = x`, in place, of the unknowns alone. Zero for one that was dropped.
    pub(super) fn back_substitute(&self, x: &mut [T]) {
        for i in (0..self.width.saturating_sub(1)).rev() {
            let (Some((pivot, row)), Some(x)) = (self.row(i).split_first(), x.get_mut(i..)) else {
                continue;
            };
            let Some((value, below)) = x.split_first_mut() else {
                continue;
            };
            let known =
                { row.iter().zip(below.iter()) }.fold(T::zero(), |sum, (r, x)| sum + *r * *x);
            *value = if *pivot == T::zero() {
                T::zero()
            } else {
                (*value - known) / *pivot
            };
        }
    }

    /// The `u` of `R^T u = g`, in place, of the unknowns alone: `u . u` is then the variance of `g . x`. Zero for
    /// an unknown that was dropped.
    pub(super) fn reduce(&self, g: &mut [T]) {
        for i in 0..self.width.saturating_sub(1) {
            let Some((value, below)) = g.get_mut(i..).and_then(<[T]>::split_first_mut) else {
                return;
            };
            let Some((pivot, row)) = self.row(i).split_first() else {
                return;
            };
            *value = if *pivot == T::zero() {
                T::zero()
            } else {
                *value / *pivot
            };
            for (g, r) in below.iter_mut().zip(row) {
                *g -= *r * *value;
            }
        }
    }

    /// Returns true if the pivot of an unknown is more than the rounding of all rows' information about it.
    fn is_determined(&self, i: usize) -> bool {
        let square = |j: usize| {
            let entry = self.row(j).get(i.saturating_sub(j)).copied();
            entry.map_or_else(T::zero, |entry| entry * entry)
        };
        let pivot = square(i);
        let column = (0..=i).fold(T::zero(), |sum, j| sum + square(j));
        let noise = lit::<T>(NOISE) * T::default_epsilon();
        pivot > column * (noise * noise)
    }
}

/// Turns two rows so that the second one of `pivot`, which are numbers of both, vanishes.
#[inline]
pub(super) fn rotate<T: Real>([a, b]: [T; 2], own: &mut [T], row: &mut [T]) {
    if b == T::zero() {
        return;
    }
    let length = plane::dot(Vector2::new(a, b), Vector2::new(a, b)).sqrt();
    if length == T::zero() {
        // Too small to have a square.
        return;
    }
    let (cosine, sine) = (a / length, b / length);
    for (own, row) in own.iter_mut().zip(row) {
        let (a, b) = (*own, *row);
        *own = cosine * a + sine * b;
        *row = cosine * b - sine * a;
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use nalgebra::{SMatrix, SVector};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// The linear algebra library is the oracle: least squares, what is left, the covariance.
        #[test]
        fn same_as_least_squares(numbers in prop::collection::vec(-1.0_f64..1.0, 40)) {
            let rows = SMatrix::<f64, 8, 5>::from_row_slice(&numbers);
            let (a, b) = (rows.fixed_columns::<4>(0), rows.column(4));
            let Some(covariance) = (a.transpose() * a).try_inverse() else { return Ok(()) };
            prop_assume!(covariance.norm() < 1e3);
            let expected: SVector<f64, 4> = covariance * a.transpose() * b;

            let mut store = [0.0; packed(5)];
            let mut triangle = Triangle::new(&mut store, 5).unwrap();
            for row in rows.row_iter() {
                let mut row: Vec<f64> = row.iter().copied().collect();
                triangle.insert(&mut row);
            }
            triangle.drop_undetermined(&mut [0.0; 5]);
            prop_assert!(!triangle.has_dropped());
            let mut x = [0.0; 4];
            triangle.right_side(&mut x);
            triangle.back_substitute(&mut x);
            for i in 0..4 {
                prop_assert!((x[i] - expected[i]).abs() < 1e-8);
                let mut unit = [0.0; 4];
                unit[i] = 1.0;
                triangle.reduce(&mut unit);
                let variance: f64 = unit.iter().map(|u| u * u).sum();
                prop_assert!((variance / covariance[(i, i)] - 1.0).abs() < 1e-8);
            }
        }
    }

    /// Only the sum of the first two unknowns is measured: one is dropped, and nothing that was said of the
    /// third is lost.
    #[test]
    fn an_unknown_that_is_not_determined_stays_where_it_is() {
        let mut store = [0.0_f32; packed(4)];
        let mut triangle = Triangle::new(&mut store, 4).unwrap();
        for mut row in [
            [1.0, 1.0, 0.0, 3.0],
            [1.0, 1.0, 2.0, 7.0],
            [0.0, 0.0, 1.0, 2.0],
        ] {
            triangle.insert(&mut row);
        }
        triangle.drop_undetermined(&mut [0.0; 4]);
        assert!(triangle.has_dropped());
        let mut x = [0.0; 3];
        triangle.right_side(&mut x);
        triangle.back_substitute(&mut x);
        for (x, expected) in x.iter().zip([3.0, 0.0, 2.0]) {
            assert!((x - expected).abs() < 1e-6, "{x}");
        }
        let mut g = [0.0, 1.0, 0.0];
        triangle.reduce(&mut g);
        assert_eq!(g, [0.0; 3]);
    }
}
