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
    numerics::{
        matrix::{add_outer, dot, multiply},
        minimize::{Descent, Problem},
        real::lit,
    },
};

/// Factor from one sigma that is tried to the next one.
const SHORTER: f64 = 0.75;
/// Most times that a sigma is multiplied by it.
const MOST_TIMES: u8 = 60;

/// Shortens the covariance's weakest direction to the length that the profile of the cost allows.
#[inline(never)] // for less stack
pub(super) fn bound<T: Real>(
    problem: &Bearings<'_, T>,
    x: &Vector6<T>,
    covariance: &mut Matrix6<T>,
) {
    let Some(direction) = weakest_direction(covariance) else {
        return;
    };
    let cost = problem.cost(x.as_slice(), x.as_slice());
    let across = times(covariance, &direction);
    let predicted = dot(across.as_slice(), direction.as_slice()).sqrt();
    let sigma = risen_by_one(predicted, |length| {
        profile(problem, x, &(direction * length)) - cost
    });
    if sigma < predicted {
        let shrink = sigma / predicted;
        shorten(covariance, &direction, T::one() - shrink * shrink);
    }
}

/// The sigma at which the cost has risen by one, where it is clearly less than predicted.
fn risen_by_one<T: Real>(predicted: T, rise: impl Fn(T) -> T) -> T {
    // The milder side counts; and a cost that is not a number has not risen.
    let is_above = |sigma: T, limit: T| rise(sigma) > limit && rise(-sigma) > limit;
    // A rise up to 4 is ordinary non-linearity, not a merger.
    if !is_above(predicted, lit(4.0)) {
        return predicted;
    }
    let shortened = |times| (0..times).fold(predicted, |sigma, _| sigma * lit(SHORTER));
    // After so many times it is still above one, and no longer.
    let [mut above, mut below] = [0, MOST_TIMES];
    while below - above > 1 {
        let middle = u8::midpoint(above, below);
        if is_above(shortened(middle), T::one()) {
            above = middle;
        } else {
            below = middle;
        }
    }
    shortened(below)
}

/// Takes this share of the variance along `direction` away, as a measurement of the unknowns along
/// it would: from a positive definite matrix that never leaves an indefinite one, also where the
/// direction is no eigenvector.
fn shorten<T: Real>(covariance: &mut Matrix6<T>, direction: &Vector6<T>, share: T) {
    let across = times(covariance, direction);
    let variance = dot(across.as_slice(), direction.as_slice());
    if variance > T::zero() {
        add_outer(
            covariance.as_mut_slice(),
            across.as_slice(),
            -share / variance,
        );
    }
}

/// The unit vector of the largest variance, by power iteration.
fn weakest_direction<T: Real>(covariance: &Matrix6<T>) -> Option<Vector6<T>> {
    let mut direction = Vector6::zeros();
    // Begins along the axis of the largest.
    *direction.get_mut(covariance.diagonal().imax())? = T::one();
    for _ in 0..17 {
        direction = times(covariance, &normalised(direction)?);
    }
    normalised(direction)
}

/// The unit vector along another one; none along zero.
fn normalised<T: Real>(mut vector: Vector6<T>) -> Option<Vector6<T>> {
    let length = dot(vector.as_slice(), vector.as_slice()).sqrt();
    // Also none along a vector that is not a number.
    if !(length > T::zero()) {
        return None;
    }
    for part in vector.as_mut_slice() {
        *part /= length;
    }
    Some(vector)
}

fn times<T: Real>(matrix: &Matrix6<T>, vector: &Vector6<T>) -> Vector6<T> {
    let mut product = Vector6::zeros();
    multiply(matrix.as_slice(), vector.as_slice(), product.as_mut_slice());
    product
}

/// The cost `offset` away from `x`, after one step that lowers it in all other directions.
fn profile<T: Real>(problem: &Bearings<'_, T>, x: &Vector6<T>, offset: &Vector6<T>) -> T {
    let aside = x + offset;
    // With the same weights everywhere on the profile.
    let cost = |at: &Vector6<T>| problem.cost(at.as_slice(), x.as_slice());
    let mut walk = Descent::new(aside);
    let model = walk.look(problem);
    let stiffness = model.trace() / offset.norm_squared();
    add_outer(model.hessian, offset.as_slice(), stiffness * lit(1e3));
    let here = cost(&aside);
    let lowered = model.step(T::zero());
    lowered.map_or(here, |step| cost(&(aside + Vector6::from(step))).min(here))
}

#[cfg(test)]
mod tests {
    use core::cell::Cell;

    use nalgebra::{Matrix2, Vector2};

    use super::*;
    use crate::{
        Ray,
        reference::{Known, Stop},
    };

    #[test]
    fn only_a_cost_that_rises_on_both_sides_shortens() {
        let looks = Cell::new(0);
        let sigma = |rise: fn(f64) -> f64| {
            looks.set(0);
            risen_by_one(1.0, |length| {
                looks.set(looks.get() + 1);
                rise(length)
            })
        };
        assert_eq!(sigma(|x| 4.0 * x * x), 1.0);
        assert_eq!(sigma(|x| if x > 0.0 { 100.0 } else { 1.0 }), 1.0);
        // Within a step of a quarter.
        let steep = sigma(|x| 100.0 * x * x);
        assert!((0.075..0.1).contains(&steep), "{steep}");
        assert_eq!(sigma(|_| f64::NAN), 1.0);
        assert_eq!(looks.get(), 1);
        assert_eq!(sigma(|x| if x > 0.0 { 100.0 } else { f64::NAN }), 1.0);
    }

    /// Along any direction, not only along an eigenvector of unknowns of one unit.
    #[test]
    fn what_is_shortened_stays_positive_definite() {
        let spread = [1e4, 0.999e4, 1.0, 1e-2, 1e-5, 1e-8];
        let covariance = Matrix6::from_diagonal(&Vector6::from(spread));
        for step in 0..6 {
            let mut direction = Vector6::repeat(0.3);
            direction[step] = 1.0;
            direction[(step + 1) % 6] = -0.9;
            let direction = direction.normalize();
            let variance = |c: &Matrix6<f64>| (c * direction).dot(&direction);
            let mut shortened = covariance;
            shorten(&mut shortened, &direction, 0.9999);
            let ratio = variance(&shortened) / variance(&covariance);
            assert!((ratio - 1e-4).abs() < 1e-9, "{ratio}");
            assert!(shortened.cholesky().is_some(), "direction {step}");
        }
    }

    /// A known quantity has no variance, and keeps none.
    #[test]
    fn nothing_is_not_shortened() {
        let mut covariance = Matrix6::<f64>::zeros();
        shorten(&mut covariance, &Vector6::repeat(0.4), 0.5);
        assert_eq!(covariance, Matrix6::zeros());
    }

    /// Where a covariance claims far too much along one unknown, this unknown keeps what the search by
    /// quarters ends at, and the other unknowns keep theirs.
    #[test]
    fn a_claim_that_the_cost_refutes_is_shortened_to_a_step_of_the_search() {
        let places = [(2.0, 3.0), (4.0, 2.5), (3.0, 4.5)];
        let mut from = Vector2::new(2.0, 3.0);
        let stops = places.map(|(x, y)| {
            let displacement = Vector2::new(x, y) - from;
            from = Vector2::new(x, y);
            Stop {
                rays: [
                    Ray {
                        forward: x,
                        left: y,
                    },
                    Ray {
                        forward: x - 5.0,
                        left: y,
                    },
                ],
                bearing_sigmas: [0.01; 2],
                displacement,
                displacement_covariance: Matrix2::zeros(),
            }
        });
        let known = Known {
            baseline: Some(5.0),
            frame_heading: Some(0.0),
        };
        let problem = Bearings::new(&stops, &known);
        let x = Vector6::new(0.0, 0.0, 2.0, 3.0, 0.0, 5.0);
        assert!(problem.cost(x.as_slice(), x.as_slice()) < 1e-20);
        for k in 0..4 {
            let mut claimed = [1e-6_f64, 1e-6, 1e-6, 1e-6, 0.0, 0.0];
            claimed[k] = 1.0;
            let mut covariance = Matrix6::from_diagonal(&Vector6::from(claimed));
            bound(&problem, &x, &mut covariance);
            let left = f64::sqrt(covariance[(k, k)]);
            let steps = left.ln() / 0.75_f64.ln();
            assert!(
                steps > 0.5 && (steps - steps.round()).abs() < 1e-6,
                "{k}: {left}"
            );
            // There, and not a step before, the cost is within one of the least on one side.
            let rise = |sigma: f64| {
                let rise = |sigma: f64| profile(&problem, &x, &(Vector6::ith(k, sigma)));
                rise(sigma).min(rise(-sigma))
            };
            assert!(rise(left) <= 1.0 && rise(left / 0.75) > 1.0, "{k}: {left}");
            for other in (0..6).filter(|&other| other != k) {
                assert!((covariance[(other, other)] - claimed[other]).abs() < 1e-12);
            }
        }
    }
}
