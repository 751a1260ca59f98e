//! Parts of the solvers: numbers, angles, small systems of equations, and candidates.
//!
//! | module | job |
//! |---|---|
//! | `real` | the scalar, and functions of it |
//! | [`angle`] | angles that wrap |
//! | `plane` | vectors of the plane as complex numbers |
//! | `matrix` | products |
//! | `cholesky` | symmetric positive definite systems of up to six unknowns |
//! | `covariance` | whether a matrix can be one |
//! | `minimize` | least squares: Gauss-Newton, steepest descent, Levenberg-Marquardt |
//! | `subsets` | pairs and triples of observations |
//! | `ranking` | the few best of many candidates |
//!
//! Functions of matrices work on their numbers, of any size: a node has the code once instead of once for
//! each number of unknowns. All of it is deterministic; it depends on the order of the input only.

pub mod angle;
pub(crate) mod cholesky;
pub(crate) mod covariance;
pub(crate) mod matrix;
pub(crate) mod minimize;
pub(crate) mod plane;
pub(crate) mod ranking;
pub(crate) mod real;
pub(crate) mod subsets;
