//! Information of sightings about a pose, whatever they turn out to be.

use nalgebra::{ComplexField, Matrix3, Point2, Vector2, Vector3};

use crate::{
    Pose, Real, Refusal, Sighting,
    numerics::{
        angle,
        cholesky::Cholesky,
        matrix::add_outer_of_two,
        plane::{dot, quarter_turn},
        real::lit,
    },
};

/// Part of a sighting in a least squares fit.
pub(crate) struct Row<T: Real> {
    /// Derivatives of world bearing minus heading by x, y, heading.
    pub slope: Vector3<T>,
    /// One over the variance of the bearing.
    pub weight: T,
}

impl<T: Real> Row<T> {
    #[inline]
    pub(crate) fn new(sighting: &Sighting<T>, to_target: Vector2<T>) -> Self {
        let range2 = dot(to_target, to_target);
        let variance_range4 = sighting.bearing_variance_range4(to_target) + rounding(range2);
        Self {
            slope: slope(to_target),
            weight: range2 * range2 / variance_range4,
        }
    }
}

/// The sightings that are not dropped; an empty slice drops none.
pub(crate) fn kept<'a, T: Real>(
    sightings: &'a [Sighting<T>],
    dropped: &'a [bool],
) -> impl Iterator<Item = &'a Sighting<T>> {
    let dropped = dropped.iter().copied().chain(core::iter::repeat(false));
    sightings
        .iter()
        .zip(dropped)
        .filter_map(|(sighting, dropped)| (!dropped).then_some(sighting))
}

/// Derivatives of a bearing by the camera's x, y and heading.
#[inline]
pub(crate) fn slope<T: Real>(to_target: Vector2<T>) -> Vector3<T> {
    let across = quarter_turn(to_target) / dot(to_target, to_target);
    Vector3::new(-across.x, -across.y, -T::one())
}

/// Arithmetic has a noise of its own: it bounds the weight of a claim to be exact. A variance, times
/// the fourth power of the range.
#[inline]
pub(crate) fn rounding<T: Real>(range2: T) -> T {
    range2 * range2 * lit(256.0) * T::default_epsilon() * T::default_epsilon()
}

/// Inverse of the sum of the rows' information.
///
/// # Errors
/// [`Refusal::NotFinite`]; [`Refusal::Undetermined`] where rounding leaves no digit of it.
pub(crate) fn covariance<T: Real>(
    rows: impl Iterator<Item = Row<T>>,
) -> Result<Matrix3<T>, Refusal> {
    let mut information = Matrix3::zeros();
    for Row { slope, weight } in rows {
        let slope = slope.as_slice();
        add_outer_of_two(information.as_mut_slice(), slope, slope, weight);
    }
    if !information.iter().all(ComplexField::is_finite) {
        return Err(Refusal::NotFinite);
    }
    // Scaled to a unit diagonal, a squared pivot is the part of an unknown that the others before
    // it do not explain.
    let scale = information.diagonal().map(|d| {
        if d > T::zero() {
            d.sqrt().recip()
        } else {
            T::zero()
        }
    });
    let scaling = scale * scale.transpose();
    let factor = Cholesky::new(information.component_mul(&scaling)).ok_or(Refusal::Undetermined)?;
    let noise = lit::<T>(8.0) * T::default_epsilon();
    if !factor.diagonal().iter().all(|&l| l * l > noise) {
        return Err(Refusal::Undetermined);
    }
    let covariance = factor.inverse().component_mul(&scaling);
    if !covariance.iter().all(ComplexField::is_finite) {
        return Err(Refusal::NotFinite);
    }
    Ok(covariance)
}

/// Fisher information of one sighting about the `(x, y, heading)` of a camera that stands at `position`. Sums
/// of it, inverted, are the covariance that [`predict`] gives.
///
/// Only the place and the sigmas of the sighting count, as in `predict`. Not finite for a target right on the
/// camera, or for an unusable number.
#[must_use]
pub fn information<T: Real>(position: Point2<T>, sighting: &Sighting<T>) -> Matrix3<T> {
    let Row { slope, weight } = Row::new(sighting, sighting.target - position);
    slope * slope.transpose() * weight
}

/// The pose of a camera known to stand at `position` and to look along `heading`, with the covariance that
/// these sightings would give it: the Cramer-Rao bound, in which no noise has a part.
///
/// Tells beforehand what stops are worth, and whether one more is worth the walk. Only the places and sigmas
/// of the sightings count; [`Ray::towards`](crate::Ray::towards) makes rays for stops not yet seen. It does
/// not check that the camera would see them.
///
/// # Errors
/// [`Refusal::TooFew`] below three; [`Refusal::NotFinite`] for an unusable number or a target
/// right on the camera; [`Refusal::Undetermined`] where the geometry leaves no digit: coincident
/// targets, danger circle, danger line.
///
/// # Example
/// ```
/// # use calib_core::{resection, Ray, Sighting};
/// # use nalgebra::Point2;
/// let (camera, heading) = (Point2::new(0.0, 0.0), 0.0);
/// let stop = |x, y| {
///     let target = Point2::new(x, y);
///     Sighting::new(target, Ray::towards(camera, heading, target), 0.01)
/// };
/// let seen = [stop(4.0, 1.0), stop(5.0, -2.0), stop(3.0, 0.0)];
/// let now = resection::predict(camera, heading, &seen)?;
/// let then = resection::predict(camera, heading, seen.iter().chain([&stop(1.5, -0.5)]))?;
/// assert!(then.sigma_position() < 0.6 * now.sigma_position());
/// # Ok::<(), calib_core::Refusal>(())
/// ```
pub fn predict<'a, T: Real>(
    position: Point2<T>,
    heading: T,
    sightings: impl IntoIterator<Item = &'a Sighting<T>>,
) -> Result<Pose<T>, Refusal> {
    let (mut count, mut usable) = (0, heading.is_finite());
    let rows = sightings.into_iter().map(|sighting| {
        count += 1;
        usable &= sighting.is_usable();
        Row::new(sighting, sighting.target - position)
    });
    let covariance = covariance(rows);
    if !usable {
        return Err(Refusal::NotFinite);
    }
    if count < 3 {
        return Err(Refusal::TooFew);
    }
    Ok(Pose {
        position,
        heading: angle::wrap_positive(heading),
        covariance: covariance?,
    })
}
