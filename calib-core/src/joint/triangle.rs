//! The R factor of a QR decomposition, kept packed and grown row by row.
//!
//! Rows are inserted by Givens rotations, so what is kept is never larger than the unknowns, however
//! many rows there are. That is the square-root form: its condition is the root of that of the
//! normal equations, which in single precision decides between an answer and none. Golub and Van
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

    /// Two rows, the first before the second.
    pub(super) fn two_rows_mut(&mut self, i: usize, j: usize) -> Option<(&mut [T], &mut [T])> {
        let (first, second) = (self.begin(i), self.begin(j));
        let (before, from_second) = self.rows.split_at_mut_checked(second)?;
        let first = before.get_mut(first..first + self.width.saturating_sub(i))?;
        let second = from_second.get_mut(..self.width.saturating_sub(j))?;
        Some((first, second))
    }

    fn begin(&self, i: usize) -> usize {
        // The sum of the lengths before it.
        (i * (2 * self.width + 1)).saturating_sub(i * i) / 2
    }

    /// Adds the equation `row`, right side last; what it held is used up. Tells what is left of the
    /// right side: the part of the residual that no unknown explains.
    pub(super) fn insert(&mut self, row: &mut [T]) -> T {
        let mut rest = &mut *self.rows;
        for j in 0..self.width.saturating_sub(1) {
            let Some((own, next)) = rest.split_at_mut_checked(self.width - j) else {
                break;
            };
            rest = next;
            let Some(row) = row.get_mut(j..) else { break };
            rotate(own, row);
        }
        row.last().copied().unwrap_or_else(T::zero)
    }

    /// The unknowns, from the last to the first, in `x`, which is as long as a row. An unknown
    /// without a pivot is left at zero.
    pub(super) fn solve(&self, x: &mut [T]) {
        let unknowns = self.width.saturating_sub(1);
        for i in 0..unknowns {
            if let (Some(to), Some(right)) = (x.get_mut(i), self.row(i).last()) {
                *to = *right;
            }
        }
        self.back_substitute(x);
    }

    /// The `x` of `R x = x`, in place.
    pub(super) fn back_substitute(&self, x: &mut [T]) {
        for i in (0..self.width.saturating_sub(1)).rev() {
            let (Some((pivot, row)), Some(x)) = (self.row(i).split_first(), x.get_mut(i..)) else {
                continue;
            };
            let Some((value, below)) = x.split_first_mut() else {
                continue;
            };
            let known = { row.iter().zip(below.iter()) }
                .take(row.len().saturating_sub(1))
                .fold(T::zero(), |sum, (r, x)| sum + *r * *x);
            *value = if *pivot == T::zero() {
                T::zero()
            } else {
                (*value - known) / *pivot
            };
        }
    }

    /// The `u` of `R^T u = g`, in place: `u . u` is then the variance of `g . x`. The right side's
    /// place is left alone. `None` if it takes an unknown that is not determined: its pivot is zero,
    /// or rounding.
    pub(super) fn forward_substitute(&self, g: &mut [T]) -> Option<()> {
        for i in 0..self.width.saturating_sub(1) {
            let (value, below) = g.get_mut(i..)?.split_first_mut()?;
            if *value == T::zero() {
                continue;
            }
            let (pivot, row) = self.row(i).split_first()?;
            if !self.is_determined(i) {
                return None;
            }
            *value /= *pivot;
            let value = *value;
            let others = row.len().saturating_sub(1);
            for (g, r) in below.iter_mut().zip(row).take(others) {
                *g -= *r * value;
            }
        }
        Some(())
    }

    /// Whether the pivot of an unknown is more than rounding of what all rows say about it.
    pub(super) fn is_determined(&self, i: usize) -> bool {
        let square = |j: usize| {
            let entry = self.row(j).get(i.saturating_sub(j)).copied();
            entry.map_or_else(T::zero, |entry| entry * entry)
        };
        let pivot = square(i);
        let column = (0..=i).fold(T::zero(), |sum, j| sum + square(j));
        let noise = lit::<T>(NOISE) * T::default_epsilon();
        pivot > column * (noise * noise)
    }

    /// The sum of the squared right sides: what the step to the minimum is worth in chi squared.
    pub(super) fn worth(&self, rows: core::ops::Range<usize>) -> T {
        rows.fold(T::zero(), |sum, i| {
            let right = self.row(i).last().copied().unwrap_or_else(T::zero);
            sum + right * right
        })
    }
}

/// Turns two rows so that the first number of the second vanishes.
#[inline]
fn rotate<T: Real>(own: &mut [T], row: &mut [T]) {
    let (Some(&a), Some(&b)) = (own.first(), row.first()) else {
        return;
    };
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
            let mut left = 0.0_f64;
            for row in rows.row_iter() {
                let mut row: Vec<f64> = row.iter().copied().collect();
                left += triangle.insert(&mut row).powi(2);
            }
            let mut x = [0.0; 5];
            triangle.solve(&mut x);
            for i in 0..4 {
                prop_assert!((x[i] - expected[i]).abs() < 1e-8);
                let mut unit = [0.0; 5];
                unit[i] = 1.0;
                triangle.forward_substitute(&mut unit).unwrap();
                let variance: f64 = unit[..4].iter().map(|u| u * u).sum();
                prop_assert!((variance / covariance[(i, i)] - 1.0).abs() < 1e-8);
            }
            prop_assert!((left - (a * expected - b).norm_squared()).abs() < 1e-8);
            let worth = triangle.worth(0..4);
            prop_assert!((worth + left - b.norm_squared()).abs() < 1e-8);
        }
    }

    #[test]
    fn an_unknown_that_nobody_asked_about_stays_where_it_is() {
        let mut store = [0.0_f32; packed(4)];
        let mut triangle = Triangle::new(&mut store, 4).unwrap();
        for mut row in [[1.0, 0.0, 2.0, 3.0], [0.0, 0.0, 4.0, 4.0]] {
            assert_eq!(triangle.insert(&mut row), 0.0);
        }
        let mut x = [0.0; 4];
        triangle.solve(&mut x);
        assert_eq!(x, [1.0, 0.0, 1.0, 0.0]);
        assert!(!triangle.is_determined(1));
        assert_eq!(triangle.forward_substitute(&mut [0.0, 1.0, 0.0, 0.0]), None);
        assert!(
            triangle
                .forward_substitute(&mut [1.0, 0.0, 1.0, 0.0])
                .is_some()
        );
    }
}
