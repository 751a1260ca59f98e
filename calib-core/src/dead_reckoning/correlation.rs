//! The pose covariance of a camera that saw dead-reckoned stops, whose errors are correlated.

use nalgebra::{Matrix2, Matrix3};

use super::Place;
use crate::{
    Pose, Real, Refusal, Sighting,
    numerics::matrix::{add_outer_of_two, multiply_square},
    resection::information::{self, Row},
};

/// The same pose with the covariance that it has when the stops err together, as their places say.
///
/// `pose` is the weighted least squares answer to the sightings, one of each stop;
/// `target_covariance` of each is its weight there, and counts for nothing else here. With `G_i` the pose's
/// response to the place of stop `i`, `C_ii` from [`Place::covariance`] and `C_ij` from
/// [`Place::covariance_with`], the result is `sum G_i C_ij G_j^T`, plus the part of the bearings' own errors:
/// the usual propagation of covariance through a linearised estimator. Exact to first
/// order, whatever the weights.
///
/// Stops may come in any order, from several fixes, and of several walks: `is_one_walk` tells
/// whether two of them, by their indices, are of one. Those of different walks err independently
/// of each other. Costs `n^2` products of a few numbers.
///
/// # Errors
/// [`Refusal::TooFew`] for fewer than three; [`Refusal::NotFinite`] for unusable sightings or
/// places too wide for the scalar; [`Refusal::Undetermined`] where the stops do not determine the
/// pose; [`Refusal::Inconsistent`] for places that are not of one walk.
pub fn correlate<T: Real>(
    pose: &Pose<T>,
    seen: &[(Sighting<T>, Place<T>)],
    is_one_walk: impl Fn(usize, usize) -> bool,
) -> Result<Pose<T>, Refusal> {
    if seen.len() < 3 {
        return Err(Refusal::TooFew);
    }
    if !seen.iter().all(|(sighting, _)| sighting.is_usable()) {
        return Err(Refusal::NotFinite);
    }
    let inverse = information::covariance(seen.iter().map(|(sighting, _)| row(pose, sighting)))?;

    // In units of the bearings: `G_i = H^-1 g_i w_i s_i^T` with `H^-1` the `inverse`. So two stops add one
    // number times `g_i g_j^T`.
    let mut spread = Matrix3::zeros();
    for (i, (sighting, place)) in seen.iter().enumerate() {
        let a = row(pose, sighting);
        let sigma = sighting.bearing_sigma;
        let own = sigma * sigma + joint(&a, &place.covariance(), &a);
        add(&mut spread, &a, &a, own);
        for (j, (other, other_place)) in seen.iter().enumerate() {
            if i != j && is_one_walk(i, j) {
                let b = row(pose, other);
                let shared = joint(&a, &place.covariance_with(other_place), &b);
                add(&mut spread, &a, &b, shared);
            }
        }
    }
    let mut half = Matrix3::zeros();
    multiply_square(
        inverse.as_slice(),
        spread.as_slice(),
        half.as_mut_slice(),
        3,
    );
    let mut covariance = Matrix3::zeros();
    multiply_square(
        half.as_slice(),
        inverse.as_slice(),
        covariance.as_mut_slice(),
        3,
    );
    if !covariance.iter().all(T::is_finite) {
        return Err(Refusal::NotFinite);
    }
    if covariance.diagonal().iter().any(|&d| d <= T::zero()) {
        return Err(Refusal::Inconsistent);
    }
    Ok(Pose {
        covariance,
        ..*pose
    })
}

#[inline(never)] // for less flash
fn row<T: Real>(pose: &Pose<T>, sighting: &Sighting<T>) -> Row<T> {
    Row::new(sighting, sighting.target - pose.position)
}

/// Adds the contribution of two bearings whose errors have this covariance to the right sides.
fn add<T: Real>(spread: &mut Matrix3<T>, a: &Row<T>, b: &Row<T>, covariance: T) {
    let weight = a.weight * b.weight * covariance;
    add_outer_of_two(
        spread.as_mut_slice(),
        a.slope.as_slice(),
        b.slope.as_slice(),
        weight,
    );
}

/// Contribution of the errors of two targets' places to the product of their bearings' errors. A movement of
/// a target changes its bearing by just the opposite of the same movement of the camera.
fn joint<T: Real>(a: &Row<T>, covariance: &Matrix2<T>, b: &Row<T>) -> T {
    a.slope.xy().dot(&(covariance * b.slope.xy()))
}
