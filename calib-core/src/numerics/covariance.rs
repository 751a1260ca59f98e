//! Test of a matrix for being a covariance.

use nalgebra::SMatrix;

use crate::{
    Real,
    numerics::{cholesky, real::lit},
};

/// Rounding, relative to the standard deviations.
const SLACK: f64 = 1e-4;
/// Standard deviations below this square to numbers that have no digits in single precision.
const SMALLEST_SIGMA: f64 = 1e-15;

/// Symmetric and positive semi-definite, but for rounding.
///
/// Judged on the correlations, so that metres and radians may be mixed.
#[inline]
pub(crate) fn is_covariance<T: Real, const N: usize>(m: &SMatrix<T, N, N>) -> bool {
    judge(m.clone_owned().as_mut_slice(), m.diagonal().as_mut_slice()).is_some()
}

/// The same for any number of rows, the diagonal aside.
#[inline(never)]
fn judge<T: Real>(matrix: &mut [T], diagonal: &mut [T]) -> Option<()> {
    if !matrix.iter().all(T::is_finite) || diagonal.iter().any(|&d| d < T::zero()) {
        return None;
    }
    let mut floor = lit::<T>(SMALLEST_SIGMA);
    for d in diagonal.iter_mut() {
        *d = d.sqrt();
        floor = floor.max(*d * T::default_epsilon());
    }
    let n = diagonal.len();
    let slack = lit(SLACK);
    let columns = matrix.chunks_exact_mut(n.max(1));
    for (j, (column, of_column)) in columns.zip(diagonal.iter()).enumerate() {
        for (i, (entry, of_row)) in column.iter_mut().zip(diagonal.iter()).enumerate() {
            *entry /= of_column.max(floor) * of_row.max(floor);
            if i == j {
                *entry += slack;
            }
        }
    }
    for j in 0..n {
        for i in 0..j {
            let skew = *matrix.get(j * n + i)? - *matrix.get(i * n + j)?;
            if skew.abs() > slack {
                return None;
            }
        }
    }
    cholesky::factor(matrix, n)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Matrix3};

    use super::*;

    /// Above the diagonal, too, where no factor looks.
    #[test]
    fn what_is_not_finite_is_none() {
        for place in 0..9 {
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut matrix = Matrix3::identity();
                matrix.as_mut_slice()[place] = bad;
                assert!(!is_covariance(&matrix), "{bad} at {place}");
            }
        }
        assert!(is_covariance(&Matrix3::<f64>::identity()));
    }

    #[test]
    fn it_is_symmetric_but_for_rounding() {
        let skew = |by: f64| is_covariance(&Matrix2::new(4.0, 1.0, 1.0 + by, 9.0));
        // A correlation of a sixth; the slack is a ten-thousandth of a correlation.
        assert!(skew(0.0) && skew(5e-4) && skew(-5e-4));
        assert!(!skew(7e-4) && !skew(-7e-4));
    }
}
