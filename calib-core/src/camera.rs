//! From pixel column to ray and back.

use core::fmt;

use crate::{Ray, Real, numerics::real::lit};

/// Spread of a camera's directions over its columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Projection {
    /// Equal steps of the *tangent* per column: every camera with an ordinary lens (thesis 2.4).
    #[cfg_attr(feature = "serde", serde(alias = "pinhole"))]
    PinHole,
    /// Equal steps of the *angle* per column: the blob finder of the Stage simulator, scanning
    /// sensors, f-theta lenses.
    EqualAngle,
}

/// One row of a camera.
///
/// Columns count from 0 on the left. The field of view spans from the centre of the first column
/// to the centre of the last one, so 88 columns of 60 degrees have their centre at 43.5 and see
/// column 0 exactly 30 degrees to the left. Columns are real numbers: a blob's middle may lie
/// between two.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Camera<T> {
    projection: Projection,
    last_column: T,
    principal_point: T,
    /// Columns per unit of tangent (pin-hole) or per radian (equal-angle).
    focal_length: T,
}

/// Reason why such a camera cannot exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CameraError {
    /// Fewer than two columns have no field of view.
    Columns,
    /// The field of view is not in `(0, pi)` for a pin-hole, `(0, 2 pi]` for equal angles.
    FieldOfView,
    /// The principal point is not a finite number.
    PrincipalPoint,
}

impl fmt::Display for CameraError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Columns => "a camera needs at least two columns",
            Self::FieldOfView => {
                "the field of view must be above 0 and below 180 degrees for a pin-hole camera, \
                 at most 360 degrees for an equal-angle one"
            }
            Self::PrincipalPoint => "the principal point must be a finite column",
        })
    }
}

impl core::error::Error for CameraError {}

impl<T: Real> Camera<T> {
    /// A camera of `columns` columns over `field_of_view` radians, principal point in the middle.
    ///
    /// # Errors
    /// Fewer than two columns; a field of view outside `(0, pi)` (pin-hole) or `(0, 2 pi]`.
    pub fn new(
        projection: Projection,
        columns: u16,
        field_of_view: T,
    ) -> Result<Self, CameraError> {
        if columns < 2 {
            return Err(CameraError::Columns);
        }
        let last_column = T::whole(u32::from(columns - 1));
        let centre = last_column * lit(0.5);
        let half_view = field_of_view * lit(0.5);
        let (possible, half_width) = match projection {
            Projection::PinHole => (half_view < T::frac_pi_2(), tangent(half_view)),
            Projection::EqualAngle => (half_view <= T::pi(), half_view),
        };
        if !(possible && half_view > T::zero()) {
            return Err(CameraError::FieldOfView);
        }
        Ok(Self {
            projection,
            last_column,
            principal_point: centre,
            focal_length: centre / half_width,
        })
    }

    /// [`Camera::new`] with [`Projection::PinHole`].
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn pin_hole(columns: u16, field_of_view: T) -> Result<Self, CameraError> {
        Self::new(Projection::PinHole, columns, field_of_view)
    }

    /// [`Camera::new`] with [`Projection::EqualAngle`].
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn equal_angle(columns: u16, field_of_view: T) -> Result<Self, CameraError> {
        Self::new(Projection::EqualAngle, columns, field_of_view)
    }

    /// The same lens with the optical axis at another column. The focal length stays, so the
    /// field of view is no longer symmetric.
    ///
    /// # Errors
    /// The column is not finite.
    pub fn with_principal_point(self, column: T) -> Result<Self, CameraError> {
        if !column.is_finite() {
            return Err(CameraError::PrincipalPoint);
        }
        Ok(Self {
            principal_point: column,
            ..self
        })
    }

    /// The projection this camera was made with.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// The column of the optical axis.
    pub fn principal_point(&self) -> T {
        self.principal_point
    }

    /// The number of the last column, one less than there are.
    pub fn last_column(&self) -> T {
        self.last_column
    }

    /// Returns true if the column lies between the centres of the first and the last one.
    pub fn has_column(&self, column: T) -> bool {
        column >= T::zero() && column <= self.last_column
    }

    /// The ray through a column. For a pin-hole this is a subtraction and a multiplication:
    /// `(1, (centre - column) / f)`, whose second part is the `tan phi` of thesis 2.4.
    ///
    /// Not limited to the columns there are: see [`Camera::has_column`].
    #[inline]
    pub fn ray(&self, column: T) -> Ray<T> {
        let left = (self.principal_point - column) / self.focal_length;
        match self.projection {
            Projection::PinHole => Ray {
                forward: T::one(),
                left,
            },
            Projection::EqualAngle => Ray::from_bearing(left),
        }
    }

    /// The signed offset `phi` of a column, radians, positive to the left (thesis 2.4).
    pub fn bearing(&self, column: T) -> T {
        self.angle(self.principal_point - column)
    }

    /// The angle off the optical axis of so many columns' widths, along a row or across rows; radians.
    pub fn angle(&self, off: T) -> T {
        let off = off / self.focal_length;
        match self.projection {
            Projection::PinHole => off.atan(),
            Projection::EqualAngle => off,
        }
    }

    /// Direction above the camera's own horizontal plane of what is seen at a bearing, and at this
    /// [angle](Self::angle) above its middle row; radians.
    pub fn elevation(&self, bearing: T, row: T) -> T {
        match self.projection {
            Projection::PinHole => (tangent(row) * bearing.sine_cosine().1).atan(),
            Projection::EqualAngle => row,
        }
    }

    /// Standard deviation of [`Camera::bearing`], radians, when the column's is `column_sigma`.
    /// A pin-hole's columns are narrower towards the border: `cos(phi)^2 / f`.
    pub fn bearing_sigma(&self, column: T, column_sigma: T) -> T {
        let sigma = column_sigma / self.focal_length;
        match self.projection {
            Projection::PinHole => {
                let tan = (self.principal_point - column) / self.focal_length;
                sigma / (T::one() + tan * tan)
            }
            Projection::EqualAngle => sigma,
        }
    }

    /// [`Camera::bearing_sigma`] of a column that was rounded to a whole one, as the CMUcam2 does:
    /// the rounding error is uniform over one column, its standard deviation `1 / sqrt(12)`.
    pub fn whole_pixel_sigma(&self, column: T) -> T {
        self.bearing_sigma(column, lit(0.288_675_134_594_812_9))
    }

    /// The column that a ray falls on, or `None` if the camera does not see it.
    pub fn column(&self, ray: Ray<T>) -> Option<T> {
        let left = match self.projection {
            Projection::PinHole if ray.forward > T::zero() => ray.left / ray.forward,
            Projection::PinHole => return None,
            Projection::EqualAngle => ray.bearing(),
        };
        let column = self.principal_point - left * self.focal_length;
        self.has_column(column).then_some(column)
    }
}

pub(crate) fn tangent<T: Real>(angle: T) -> T {
    let (sine, cosine) = angle.sine_cosine();
    sine / cosine
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    /// The example memory table of the thesis's Appendix B. One camera fits both rows.
    #[test]
    fn appendix_b_known_answers() {
        let camera = Camera::pin_hole(88, 60_f64.to_radians()).unwrap();
        assert_eq!(camera.principal_point(), 43.5);
        assert!((camera.bearing(67.0).to_degrees() - -17.3228).abs() < 5e-5);
        assert!((camera.bearing(38.0).to_degrees() - 4.17509).abs() < 5e-6);
        assert!((camera.bearing(0.0).to_degrees() - 30.0).abs() < 1e-12);
        assert!((camera.bearing(87.0).to_degrees() - -30.0).abs() < 1e-12);
    }

    #[test]
    fn equal_angle_steps_are_equal() {
        let camera = Camera::equal_angle(88, 60_f64.to_radians()).unwrap();
        for column in 0..88_u8 {
            let expected = 30.0 - f64::from(column) * 60.0 / 87.0;
            assert!((camera.bearing(f64::from(column)).to_degrees() - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn there_and_back() {
        for projection in [Projection::PinHole, Projection::EqualAngle] {
            let camera = Camera::new(projection, 176, 1.2_f64)
                .and_then(|c| c.with_principal_point(80.0))
                .unwrap();
            for tenth in 0..=1750_u16 {
                let column = f64::from(tenth) / 10.0;
                let ray = camera.ray(column);
                assert!((camera.column(ray).unwrap() - column).abs() < 1e-9);
                assert!((ray.bearing() - camera.bearing(column)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn what_is_out_of_view_has_no_column() {
        let camera = Camera::pin_hole(88, 60_f64.to_radians()).unwrap();
        assert_eq!(camera.column(Ray::from_bearing(31_f64.to_radians())), None);
        assert_eq!(camera.column(Ray::from_bearing(3.1)), None);
        // Behind a pin-hole, although the tangent is small.
        let behind = Ray {
            forward: -1.0,
            left: 0.01,
        };
        assert_eq!(camera.column(behind), None);
    }

    /// The sigma is the derivative: compare with a difference quotient.
    #[test]
    fn sigma_is_the_slope() {
        for projection in [Projection::PinHole, Projection::EqualAngle] {
            let camera = Camera::new(projection, 88, 1.0_f64).unwrap();
            for column in [0.0, 20.0, 43.5, 87.0] {
                let h = 1e-4;
                let slope = (camera.bearing(column - h) - camera.bearing(column + h)) / (2.0 * h);
                assert!((camera.bearing_sigma(column, 1.0) - slope).abs() < 1e-9);
            }
        }
    }

    /// The rms error of the bearing by rounding to a whole column, over every part of a column.
    #[test]
    fn the_sigma_of_whole_pixels_is_that_of_rounding() {
        for projection in [Projection::PinHole, Projection::EqualAngle] {
            let camera = Camera::new(projection, 88, 1.0_f64).unwrap();
            for column in [0.0, 20.0, 43.0, 87.0] {
                let parts = (-500..500).map(|part| column + (f64::from(part) + 0.5) / 1000.0);
                let errors = parts.map(|at| camera.bearing(at) - camera.bearing(column));
                let rms = (errors.map(|error| error * error).sum::<f64>() / 1000.0).sqrt();
                let sigma = camera.whole_pixel_sigma(column);
                assert!((sigma / rms - 1.0).abs() < 1e-3, "{column}: {sigma} {rms}");
            }
        }
    }

    #[test]
    fn impossible_cameras() {
        let pi = core::f64::consts::PI;
        for view in [0.0, -1.0, pi, 4.0, f64::NAN, f64::INFINITY] {
            assert_eq!(Camera::pin_hole(88, view), Err(CameraError::FieldOfView));
        }
        assert_eq!(Camera::pin_hole(1, 1.0), Err(CameraError::Columns));
        assert!(Camera::equal_angle(360, 2.0 * pi).is_ok());
        assert!(Camera::equal_angle(360, 6.3).is_err());
        // The text names the number to correct.
        for (error, words) in [
            (CameraError::Columns, "two columns"),
            (CameraError::FieldOfView, "field of view"),
            (CameraError::PrincipalPoint, "principal point"),
        ] {
            assert!(error.to_string().contains(words));
        }
        let camera = Camera::pin_hole(88, 1.0).unwrap();
        assert_eq!(
            camera.with_principal_point(f64::NAN),
            Err(CameraError::PrincipalPoint)
        );
    }
}
