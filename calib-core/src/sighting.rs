//! A camera's sighting: a direction, and the target's place as the target says.

use nalgebra::{Matrix2, Point2, Vector2};

use crate::{
    Real,
    numerics::{plane, real::at_least_zero},
};

/// A direction in the camera's frame, of any positive length.
///
/// A vector rather than an angle, because a pin-hole camera measures its tangent: from column to
/// pose no trigonometric function is needed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ray<T> {
    /// Along the optical axis.
    pub forward: T,
    /// Towards smaller columns, perpendicular to the axis.
    pub left: T,
}

impl<T: Real> Ray<T> {
    /// The ray at an offset `phi` from the optical axis, radians, positive to the left.
    pub fn from_bearing(phi: T) -> Self {
        let (left, forward) = phi.sine_cosine();
        Self { forward, left }
    }

    /// The ray along which a camera at `position` that looks along `heading` sees `target`. As long
    /// as the target is far.
    pub fn towards(position: Point2<T>, heading: T, target: Point2<T>) -> Self {
        let ray = plane::mul_conj(target - position, plane::unit(heading));
        Self {
            forward: ray.x,
            left: ray.y,
        }
    }

    /// The signed offset `phi` from the optical axis, radians in `(-pi, pi]`.
    pub fn bearing(self) -> T {
        self.left.atan2(self.forward)
    }

    /// World bearing of a point at `to_target` from the camera, minus that of the ray; wrapped by
    /// construction.
    #[inline]
    pub(crate) fn residual(self, heading: T, to_target: Vector2<T>) -> T {
        let ray = plane::mul(plane::unit(heading), self.vector());
        plane::cross(ray, to_target).atan2(plane::dot(ray, to_target))
    }

    /// Returns true if it is finite and has a direction.
    pub(crate) fn is_usable(self) -> bool {
        let length = plane::taxicab(self.vector());
        length.is_finite() && length > T::zero()
    }

    /// The ray as a complex number, the optical axis being real.
    #[inline(always)]
    pub(crate) fn vector(self) -> Vector2<T> {
        Vector2::new(self.forward, self.left)
    }
}

/// One sighting of the target by one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sighting<T: Real> {
    /// Place of the target, in the world.
    pub target: Point2<T>,
    /// The direction in which the camera saw it.
    pub ray: Ray<T>,
    /// Standard deviation of that direction, radians, above zero.
    pub bearing_sigma: T,
    /// Covariance of `target`, as far as it is this sighting's own. Along a direction in which it
    /// is below zero it counts as zero.
    ///
    /// An error that all sightings of a solve share (the target started from a place it did not
    /// know well) does not belong here: it moves the camera by just as much, and says nothing
    /// about which sighting to believe. See [`correlate`](crate::dead_reckoning::correlate).
    pub target_covariance: Matrix2<T>,
}

impl<T: Real> Sighting<T> {
    /// A sighting of a target whose place is known exactly.
    pub fn new(target: Point2<T>, ray: Ray<T>, bearing_sigma: T) -> Self {
        Self {
            target,
            ray,
            bearing_sigma,
            target_covariance: Matrix2::zeros(),
        }
    }

    /// The same sighting of a target that stands within `sigma` of its place in every direction.
    #[must_use]
    pub fn with_target_sigma(self, sigma: T) -> Self {
        Self {
            target_covariance: Matrix2::from_diagonal_element(sigma * sigma),
            ..self
        }
    }

    /// Returns true if every number is usable: finite, the ray not zero, the sigma above zero.
    pub fn is_usable(&self) -> bool {
        let all =
            plane::taxicab(self.target.coords) + self.bearing_sigma + self.target_covariance.sum();
        all.is_finite() && self.ray.is_usable() && self.bearing_sigma > T::zero()
    }

    /// Variance of the bearing, times the fourth power of the range `|to_target|`: the camera's
    /// own part and that of the target's place, seen across the line of sight. No division.
    #[inline(always)]
    pub(crate) fn bearing_variance_range4(&self, to_target: Vector2<T>) -> T {
        let range2 = plane::dot(to_target, to_target);
        let own = self.bearing_sigma * range2;
        let across = plane::quarter_turn(to_target);
        let c = &self.target_covariance;
        let twice_xy = c.m12 + c.m21;
        let of_target =
            across.x * (across.x * c.m11 + across.y * twice_xy) + across.y * across.y * c.m22;
        own * own + at_least_zero(of_target)
    }
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for Sighting<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(
            f,
            "({}, {}) along {} +/- {}",
            self.target.x,
            self.target.y,
            self.ray,
            self.bearing_sigma
        );
    }
}
