//! Symmetric positive definite systems of a few unknowns.
//!
//! Cholesky's factors as any linear algebra has them. These work on the numbers of a matrix of any
//! size, so that a node has the code once instead of once for each number of unknowns.

use nalgebra::{SMatrix, SVector};

use crate::Real;

/// The factor `L` of `L L^T`, in the lower triangle. The numbers above it mean nothing.
pub(crate) struct Cholesky<T: Real, const N: usize>(SMatrix<T, N, N>);

impl<T: Real, const N: usize> Cholesky<T, N> {
    /// The factor of a matrix of which the lower triangle is read; `None` if it is not positive
    /// definite.
    #[inline]
    pub(crate) fn new(matrix: SMatrix<T, N, N>) -> Option<Self> {
        let mut factor = Self(matrix);
        self::factor(factor.0.as_mut_slice(), N)?;
        Some(factor)
    }

    /// The `x` of `L L^T x = b`.
    #[inline]
    pub(crate) fn solve(&self, b: &SVector<T, N>) -> SVector<T, N> {
        let mut x = *b;
        solve(self.0.as_slice(), x.as_mut_slice());
        x
    }

    /// The roots of the pivots.
    #[inline]
    pub(crate) fn diagonal(&self) -> SVector<T, N> {
        self.0.diagonal()
    }

    /// The inverse of `L L^T`, symmetric to rounding.
    #[inline]
    pub(crate) fn inverse(&self) -> SMatrix<T, N, N> {
        let mut inverse = SMatrix::<T, N, N>::identity();
        for column in inverse.as_mut_slice().as_chunks_mut::<N>().0 {
            solve(self.0.as_slice(), column);
        }
        inverse
    }
}

/// Column by column, each less the part that the columns before it explain.
#[inline(never)]
pub(crate) fn factor<T: Real>(matrix: &mut [T], n: usize) -> Option<()> {
    for k in 0..n {
        let (before, rest) = matrix.split_at_mut_checked(k * n)?;
        let column = rest.get_mut(..n)?;
        for earlier in before.chunks_exact(n) {
            let share = *earlier.get(k)?;
            for (entry, other) in column.iter_mut().zip(earlier).skip(k) {
                *entry -= share * *other;
            }
        }
        let pivot = *column.get(k)?;
        if !(pivot > T::zero() && pivot.is_finite()) {
            return None;
        }
        let root = pivot.sqrt();
        for entry in column.iter_mut().skip(k) {
            *entry /= root;
        }
    }
    Some(())
}

/// Forwards through the columns of `L`, then backwards through the rows of its transpose.
#[inline(never)]
pub(crate) fn solve<T: Real>(factor: &[T], x: &mut [T]) {
    let n = x.len();
    for (k, column) in factor.chunks_exact(n.max(1)).enumerate() {
        let mut below = x.iter_mut().zip(column).skip(k);
        if let Some((value, pivot)) = below.next() {
            *value /= *pivot;
            let value = *value;
            for (other, share) in below {
                *other -= *share * value;
            }
        }
    }
    for (k, column) in factor.chunks_exact(n.max(1)).enumerate().rev() {
        let below = x.iter().zip(column).skip(k + 1);
        let known = below.fold(T::zero(), |sum, (value, share)| sum + *value * *share);
        if let (Some(value), Some(pivot)) = (x.get_mut(k), column.get(k)) {
            *value = (*value - known) / *pivot;
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, SMatrix, Vector3};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// The linear algebra library is the oracle.
        #[test]
        fn same_as_the_library(entries in prop::array::uniform32(-1.0_f64..1.0)) {
            let root = SMatrix::<f64, 5, 5>::from_iterator(entries);
            let matrix = root * root.transpose() + SMatrix::identity() * 1e-3;
            let b = root.column(0).into_owned();
            let ours = Cholesky::new(matrix).unwrap();
            let theirs = matrix.cholesky().unwrap();
            prop_assert!((ours.0.lower_triangle() - theirs.l()).norm() < 1e-12);
            prop_assert!((ours.solve(&b) - theirs.solve(&b)).norm() < 1e-9);
            prop_assert!((ours.inverse() - theirs.inverse()).norm() < 1e-7);
        }
    }

    /// Six unknowns in single precision, as on a node, with scales as far apart as radians and
    /// metres may be.
    #[test]
    fn single_precision_keeps_its_digits() {
        let sizes = [1.0, 1.0, 1e-3, 1e-3, 10.0, 1e-2];
        let root = SMatrix::<f64, 6, 6>::from_fn(|row, column| {
            sizes[column] * (((7 * row + 3 * column) % 11) as f64 - 5.0)
        });
        let matrix = root.transpose() * root;
        let exact = matrix.cholesky().unwrap().inverse();
        let ours = Cholesky::new(matrix.cast::<f32>()).unwrap().inverse();
        for row in 0..6 {
            for column in 0..6 {
                let error = f64::from(ours[(row, column)]) - exact[(row, column)];
                let scale = (exact[(row, row)] * exact[(column, column)]).sqrt();
                assert!(error.abs() < 1e-4 * scale, "{row}, {column}: {error:e}");
            }
        }
    }

    #[test]
    fn what_is_not_positive_definite_has_none() {
        let saddle = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
        assert!(Cholesky::new(saddle).is_none());
        assert!(Cholesky::new(Matrix3::<f32>::zeros()).is_none());
        assert!(Cholesky::new(Matrix3::repeat(f32::NAN)).is_none());
        assert!(Cholesky::new(Matrix3::from_diagonal_element(f32::INFINITY)).is_none());
        assert!(Cholesky::new(Matrix3::<f32>::repeat(1.0)).is_none());
    }
}
