//! Products of vectors and small matrices, by their numbers: a matrix's by columns.
//!
//! They add up in the order in which nalgebra does, so that the choice between both changes no bit.

use crate::Real;

/// `a . b`
pub(crate) fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::zero(), |sum, (a, b)| sum + *a * *b)
}

/// Adds `weight v v^T`.
#[inline]
pub(crate) fn add_outer<T: Real>(matrix: &mut [T], vector: &[T], weight: T) {
    let columns = matrix.chunks_exact_mut(vector.len().max(1));
    for (column, factor) in columns.zip(vector) {
        for (entry, other) in column.iter_mut().zip(vector) {
            *entry += *other * (*factor * weight);
        }
    }
}

/// Adds `a b^T weight`, of vectors of one length, the product of both first.
#[inline(never)] // for less flash
pub(crate) fn add_outer_of_two<T: Real>(matrix: &mut [T], a: &[T], b: &[T], weight: T) {
    let columns = matrix.chunks_exact_mut(a.len().max(1));
    for (column, of_column) in columns.zip(b) {
        for (entry, of_row) in column.iter_mut().zip(a) {
            *entry += *of_row * *of_column * weight;
        }
    }
}

/// `matrix x`, of a matrix with as many rows as `product` has numbers.
#[inline(never)] // for less flash
pub(crate) fn multiply<T: Real>(matrix: &[T], x: &[T], product: &mut [T]) {
    let columns = matrix.chunks_exact(product.len().max(1));
    for (n, (column, factor)) in columns.zip(x).enumerate() {
        for (sum, entry) in product.iter_mut().zip(column) {
            let part = *entry * *factor;
            *sum = if n == 0 { part } else { *sum + part };
        }
    }
}

/// `a b`, of square matrices with `n` rows.
pub(crate) fn multiply_square<T: Real>(a: &[T], b: &[T], product: &mut [T], n: usize) {
    let columns = product.chunks_exact_mut(n.max(1));
    for (column, x) in columns.zip(b.chunks_exact(n.max(1))) {
        multiply(a, x, column);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{SMatrix, SVector};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// The linear algebra library is the oracle, to the last bit.
        #[test]
        fn same_as_the_library(
            a in prop::array::uniform32(-1.0_f32..1.0),
            b in prop::array::uniform32(-1.0_f32..1.0),
            weight in -1.0_f32..1.0,
        ) {
            let (a, b) = (
                SMatrix::<f32, 5, 5>::from_iterator(a),
                SMatrix::<f32, 5, 5>::from_iterator(b),
            );
            let (v, w): (SVector<f32, 5>, SVector<f32, 5>) =
                (a.column(0).into_owned(), b.column(1).into_owned());
            let mut product = [f32::NAN; 5];
            multiply(a.as_slice(), w.as_slice(), &mut product);
            prop_assert_eq!(SVector::from(product), a * w);
            prop_assert_eq!(dot(v.as_slice(), w.as_slice()), v.dot(&w));
            let mut square = SMatrix::<f32, 5, 5>::repeat(f32::NAN);
            multiply_square(a.as_slice(), b.as_slice(), square.as_mut_slice(), 5);
            prop_assert_eq!(square, a * b);
            let mut sum = a;
            add_outer_of_two(sum.as_mut_slice(), v.as_slice(), w.as_slice(), weight);
            prop_assert_eq!(sum, a + v * w.transpose() * weight);
            let mut sum = a;
            add_outer(sum.as_mut_slice(), v.as_slice(), weight);
            prop_assert!((sum - (a + v * v.transpose() * weight)).norm() < 1e-6);
        }
    }
}
