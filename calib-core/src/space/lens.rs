//! Directions and pixels of a lens with radial distortion.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use crate::{
    Real,
    camera::{Distortion, Projection},
};

/// A lens, with what is known of it.
///
/// [`Distortion`] says where a direction is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Lens<T: Real> {
    /// Spread of directions over the picture, radial.
    pub projection: Projection,
    /// Focal length in columns and in rows.
    pub focal: Vector2<T>,
    /// Column and row of the optical axis.
    pub principal: Vector2<T>,
    /// k1 and k2.
    pub distortion: Vector2<T>,
    /// Standard deviations of the focal length (relative to it), k1 and k2; zero for what is exact.
    pub sigmas: Vector3<T>,
}

/// A direction's picture and its derivatives.
pub(super) struct Picture<T: Real> {
    pub(super) pixel: Vector2<T>,
    /// By forward, left and up.
    pub(super) by_direction: Matrix2x3<T>,
    /// By the factor of the focal length, k1 and k2.
    pub(super) by_lens: Matrix2x3<T>,
}

impl<T: Real> Lens<T> {
    /// Returns true if every number is finite, focal lengths are above zero and sigmas not below.
    pub(super) fn is_usable(&self) -> bool {
        let pairs = [&self.focal, &self.principal, &self.distortion];
        let mut numbers = pairs.into_iter().flatten().chain(self.sigmas.iter());
        numbers.all(T::is_finite)
            && self.focal.iter().all(|focal| *focal > T::zero())
            && self.sigmas.iter().all(|sigma| *sigma >= T::zero())
    }

    /// The same lens with the focal length times the first number, and the others for k1 and k2.
    #[must_use]
    pub fn with(&self, numbers: &Vector3<T>) -> Self {
        Self {
            focal: self.focal * numbers.x,
            distortion: numbers.yz(),
            ..*self
        }
    }

    /// Direction (forward, left, up) that a pixel sees, of any length; `None` beyond the lens's rim.
    pub fn direction(&self, pixel: &Vector2<T>) -> Option<Vector3<T>> {
        let off = (self.principal - pixel).component_div(&self.focal);
        let radius = off.norm();
        if !(radius > T::default_epsilon()) {
            return radius.is_finite().then(Vector3::x);
        }
        let q = self.distorted().direction(radius)?;
        let aside = off / radius;
        let (sine, cosine) = match self.projection {
            Projection::PinHole => (q, T::one()),
            Projection::EqualAngle => q.sine_cosine(),
        };
        Some(Vector3::new(cosine, sine * aside.x, sine * aside.y))
    }

    fn distorted(&self) -> Distortion<T> {
        let [[k1, k2]] = self.distortion.data.0;
        Distortion { k1, k2 }
    }

    /// The pixel that shows a direction (forward, left, up) of any length; `None` behind the camera, or
    /// where the lens would fold the picture back.
    pub fn pixel(&self, direction: &Vector3<T>) -> Option<Vector2<T>> {
        Some(self.picture(direction)?.pixel)
    }

    pub(super) fn picture(&self, direction: &Vector3<T>) -> Option<Picture<T>> {
        let (forward, aside) = (direction.x, direction.yz());
        let h = aside.norm();
        let squared = forward * forward + h * h;
        // The base radius, by forward and by the distance from the axis.
        let (q, by_forward, by_h) = match self.projection {
            Projection::PinHole if forward > T::zero() => {
                (h / forward, -h / (forward * forward), forward.recip())
            }
            Projection::PinHole => return None,
            Projection::EqualAngle => (h.atan2(forward), -h / squared, forward / squared),
        };
        let (value, slope) = self.distorted().radius(q);
        if !(Distortion::is_within_rim(slope) && squared > T::zero()) {
            return None;
        }
        let is_axis = !(h > T::default_epsilon() * forward.abs());
        if is_axis && !(forward > T::zero()) {
            return None;
        }
        // The picture is `s` times the part of the direction beside the axis.
        let (s, s_by_forward, s_by_h, over_h) = if is_axis {
            let s = forward.recip();
            (s, -s * s, T::zero(), T::zero())
        } else {
            let s = value / h;
            (s, slope * by_forward / h, (slope * by_h - s) / h, h.recip())
        };
        let scale = -self.focal;
        let unit = aside * over_h;
        let cube = q * q * q * over_h;
        let column = |part: Vector2<T>| scale.component_mul(&part);
        Some(Picture {
            pixel: self.principal + column(aside * s),
            by_direction: Matrix2x3::from_columns(&[
                column(aside * s_by_forward),
                column(aside * (s_by_h * unit.x) + Vector2::new(s, T::zero())),
                column(aside * (s_by_h * unit.y) + Vector2::new(T::zero(), s)),
            ]),
            by_lens: Matrix2x3::from_columns(&[
                column(aside * s),
                column(aside * cube),
                column(aside * (cube * q * q)),
            ]),
        })
    }
}
