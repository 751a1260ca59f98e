//! The pose covariance of a camera that saw dead-reckoned stops, whose errors are correlated.

use nalgebra::{Matrix3, Matrix3x2, Vector2, Vector3};

use super::Track;
use crate::{Pose, Real, Refusal, Sighting, plane};

/// The same pose with the covariance it has when the stops err as their tracks say: together.
///
/// `pose` is the weighted least squares answer to the sightings; `target_covariance` of each is
/// what it was weighted by, and counts for nothing else here. With `G_i` the pose's response to
/// the place of stop `i` and `C_ij` from [`Track::covariance_with`], the result is
/// `sum G_i C_ij G_j^T`, plus what the bearings' own errors make: the usual propagation of
/// covariance through a linearised estimator. Exact to first order, whatever the weights.
///
/// Stops may come in any order and from several fixes. Costs `n^2` products of 2x3 matrices.
///
/// # Errors
/// [`Refusal::TooFew`] for fewer than three; [`Refusal::NotFinite`] for unusable sightings or
/// tracks too wide for the scalar; [`Refusal::Undetermined`] where the stops do not determine the pose.
pub fn correlate<T: Real>(
    pose: &Pose<T>,
    seen: &[(Sighting<T>, Track<T>)],
) -> Result<Pose<T>, Refusal> {
    if seen.len() < 3 {
        return Err(Refusal::TooFew);
    }
    if !seen.iter().all(|(sighting, _)| sighting.is_usable()) {
        return Err(Refusal::NotFinite);
    }
    let mut information = Matrix3::zeros();
    for (sighting, _) in seen {
        let (g, weight) = gradient(pose, sighting);
        information += g * g.transpose() * weight;
    }
    let inverse = information.try_inverse().ok_or(Refusal::Undetermined)?;

    let mut covariance = Matrix3::zeros();
    for (sighting, track) in seen {
        let (g, weight) = gradient(pose, sighting);
        let by_bearing = inverse * g * (weight * sighting.bearing_sigma);
        covariance += by_bearing * by_bearing.transpose();
        let by_place = response(&inverse, &g, weight);
        for (other, other_track) in seen {
            let (g, weight) = gradient(pose, other);
            let by_other = response(&inverse, &g, weight);
            covariance += by_place * track.covariance_with(other_track) * by_other.transpose();
        }
    }
    if !covariance.iter().all(T::is_finite) {
        return Err(Refusal::NotFinite);
    }
    Ok(Pose {
        covariance,
        ..*pose
    })
}

/// Derivative of the predicted bearing by the pose, and the weight of the sighting.
fn gradient<T: Real>(pose: &Pose<T>, sighting: &Sighting<T>) -> (Vector3<T>, T) {
    let to_target = sighting.target - pose.position;
    let range2 = plane::dot(to_target, to_target);
    let g = Vector3::new(to_target.y / range2, -to_target.x / range2, -T::one());
    let weight = range2 * range2 / sighting.bearing_variance_range4(to_target);
    (g, weight)
}

/// How the pose answers to the place of one target. Moving the target changes its bearing by just
/// the opposite of moving the camera.
fn response<T: Real>(inverse: &Matrix3<T>, g: &Vector3<T>, weight: T) -> Matrix3x2<T> {
    inverse * g * (Vector2::new(g.x, g.y) * weight).transpose()
}
