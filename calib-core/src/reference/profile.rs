//! Uncertainty where the linear prediction fails: next to two answers that merge.
//!
//! Two circles that touch, or that noise made miss each other, meet in one answer instead of two.
//! There the bearings have no first-order grip on one direction of the unknowns, and the inverse
//! of the normal matrix claims an absurd variance along it. The second order does bound it: along
//! that direction the sigma is where the cost, minimised over everything else, has risen by one
//! (profile likelihood).

use nalgebra::{Matrix6, Vector6};

use super::model::Bearings;
use crate::{
    Real,
    minimize::{Problem, Quadratic, add_outer},
    real::lit,
};

/// Shortens the covariance's weakest direction to what the profile of the cost allows.
// Not inlined, for the sake of the stack.
#[inline(never)]
pub(super) fn bound<T: Real>(
    problem: &Bearings<'_, T>,
    x: &Vector6<T>,
    covariance: &mut Matrix6<T>,
) {
    let Some(direction) = weakest_direction(covariance) else {
        return;
    };
    let cost = problem.cost(x, x);
    let rise = |length: T| profile(problem, x, &(direction * length)) - cost;
    let predicted = (*covariance * direction).dot(&direction).sqrt();
    let mut sigma = predicted;
    // The milder side counts, and a rise up to 4 is ordinary non-linearity, not a merger.
    let limit = lit::<T>(4.0);
    if rise(sigma).min(rise(-sigma)) <= limit {
        return;
    }
    for _ in 0..60 {
        sigma *= lit(0.75);
        if rise(sigma).min(rise(-sigma)) <= T::one() {
            break;
        }
    }
    let excess = predicted * predicted - sigma * sigma;
    add_outer(covariance, &direction, -excess);
}

/// The unit vector of the largest variance, by power iteration.
fn weakest_direction<T: Real>(covariance: &Matrix6<T>) -> Option<Vector6<T>> {
    let mut direction = Vector6::zeros();
    // Begins along the axis of the largest.
    *direction.get_mut(covariance.diagonal().imax())? = T::one();
    for _ in 0..17 {
        direction = covariance * direction.try_normalize(T::zero())?;
    }
    direction.try_normalize(T::zero())
}

/// The cost `offset` away from `x`, after one step that lowers it in all other directions.
fn profile<T: Real>(problem: &Bearings<'_, T>, x: &Vector6<T>, offset: &Vector6<T>) -> T {
    let aside = x + offset;
    let mut model = Quadratic::zero();
    problem.model(&aside, &mut model);
    // With the same weights as everywhere else on the profile.
    let cost = problem.cost(&aside, x);
    let stiffness = model.hessian.trace() / offset.norm_squared();
    add_outer(&mut model.hessian, offset, stiffness * lit(1e3));
    let lowered = model.step(T::zero());
    lowered.map_or(cost, |step| problem.cost(&(aside + step), x).min(cost))
}
