//! Whether a matrix can be a covariance.

use nalgebra::SMatrix;

use crate::{Real, cholesky::Cholesky, real::lit};

/// Rounding, relative to the standard deviations.
const SLACK: f64 = 1e-4;
/// Standard deviations below this square to numbers that have no digits in single precision.
const SMALLEST_SIGMA: f64 = 1e-15;

/// Symmetric and positive semi-definite, but for rounding.
///
/// Judged on the correlations, so that metres and radians may be mixed.
pub(crate) fn is_covariance<T: Real, const N: usize>(m: &SMatrix<T, N, N>) -> bool {
    if !m.iter().all(T::is_finite) || m.diagonal().iter().any(|&d| d < T::zero()) {
        return false;
    }
    let sigma = m.diagonal().map(nalgebra::ComplexField::sqrt);
    let floor = (sigma.max() * T::default_epsilon()).max(lit(SMALLEST_SIGMA));
    let sigma = sigma.map(|s| s.max(floor));
    let mut correlation = m.component_div(&(sigma * sigma.transpose()));
    let skew = correlation - correlation.transpose();
    if skew.amax() > lit(SLACK) {
        return false;
    }
    for k in 0..N {
        if let Some(d) = correlation.get_mut((k, k)) {
            *d += lit(SLACK);
        }
    }
    Cholesky::new(correlation).is_some()
}
