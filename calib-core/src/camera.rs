//! From pixel column to ray and back.

use core::fmt;

use nalgebra::{Vector2, Vector3};

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

/// Radial distortion of a lens: a direction `q` off the axis (its tangent with a pin-hole, its angle with equal angles)
/// is seen `q (1 + k1 q^2 + k2 q^4)` focal lengths from the principal point. `OpenCV` measures the same k1 and k2 of a
/// pin-hole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Distortion<T> {
    /// Of the third power: below zero where lines bend like a barrel.
    pub k1: T,
    /// Of the fifth power.
    pub k2: T,
}

/// A picture that grows less than this with the direction is that of a lens's rim, or folded back.
const LEAST_SLOPE: f64 = 0.05;

/// Directions from the axis to a corner at which the picture has to grow.
const SAMPLES: u32 = 16;

/// Height of a picture over its width: a CMUcam2's, the highest one known here.
const HEIGHT: f64 = 0.82;

impl<T: Real> Distortion<T> {
    /// Returns true if there is none.
    pub fn is_none(&self) -> bool {
        self.k1 == T::zero() && self.k2 == T::zero()
    }

    /// Distance from the principal point in focal lengths of a direction, and its derivative.
    pub fn radius(&self, q: T) -> (T, T) {
        let (u, k1, k2) = (q * q, self.k1, self.k2);
        (
            q * (T::one() + u * (k1 + u * k2)),
            T::one() + u * (lit::<T>(3.0) * k1 + lit::<T>(5.0) * u * k2),
        )
    }

    /// Returns true if the picture of such a direction grows with the direction.
    pub(crate) fn is_within_rim(slope: T) -> bool {
        slope > lit(LEAST_SLOPE)
    }

    /// The direction that is seen at this distance from the principal point, focal lengths from 0; `None` beyond the
    /// lens's rim.
    #[inline(never)] // for less flash
    pub fn direction(&self, radius: T) -> Option<T> {
        let mut q = radius;
        for _ in 0..12 {
            let (value, slope) = self.radius(q);
            if !Self::is_within_rim(slope) {
                // Too far out for a lens that folds back: nearer, where it does not.
                q *= lit(0.8);
                continue;
            }
            q = (q + (radius - value) / slope).max(T::zero());
        }
        let (value, slope) = self.radius(q);
        let is_found = (value - radius).abs() < lit::<T>(1e-3) * (T::one() + radius);
        (slope > T::zero() && is_found).then_some(q)
    }
}

/// One row of a camera, and the rows above and below it.
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
    /// Columns per unit of tangent (pin-hole) or per radian (equal-angle), on the axis.
    focal_length: T,
    distortion: Distortion<T>,
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
    /// A lens of this distortion would fold the border of the picture back.
    Distortion,
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
            Self::Distortion => {
                "k1 and k2 fold the corners of the picture back: check their signs, and that they are those of this field \
                 of view"
            }
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
            distortion: Distortion {
                k1: T::zero(),
                k2: T::zero(),
            },
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

    /// A lens without distortion with this one, and the same field of view. The focal length on the axis becomes another
    /// one.
    ///
    /// # Errors
    /// The lens would fold back what is seen at a corner of a picture that is nearly as high as wide.
    #[inline(never)] // for less flash
    pub fn with_distortion(mut self, distortion: Distortion<T>) -> Result<Self, CameraError> {
        if !distortion.is_none() {
            let centre = self.last_column * lit(0.5);
            let border = centre / self.focal_length;
            self.focal_length = centre / distortion.radius(border).0;
            self.distortion = distortion;
            let aside = (self.principal_point - centre).abs() + centre + T::one();
            let corner = Vector2::new(aside, centre * lit(HEIGHT)).norm() / self.focal_length;
            let corner = distortion
                .direction(corner)
                .ok_or(CameraError::Distortion)?;
            let far = corner.max(border) / T::whole(SAMPLES);
            let is_within = |n: u32| {
                let (_, slope) = distortion.radius(far * T::whole(n));
                Distortion::<T>::is_within_rim(slope)
            };
            if !(corner > T::zero() && (1..=SAMPLES).all(is_within)) {
                return Err(CameraError::Distortion);
            }
        }
        Ok(self)
    }

    /// The distortion of its lens.
    pub fn distortion(&self) -> Distortion<T> {
        self.distortion
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
        let left = self.undistorted(self.principal_point - column, T::zero()).x;
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
        let off = self.undistorted(off, T::zero()).x;
        match self.projection {
            Projection::PinHole => off.atan(),
            Projection::EqualAngle => off,
        }
    }

    /// Tangents or angles left of and above the axis of so many columns' widths. Beyond the lens's rim they are those of
    /// a lens without distortion.
    #[inline(never)] // for less flash
    fn undistorted(&self, left: T, above: T) -> Vector2<T> {
        let off = Vector2::new(left, above) / self.focal_length;
        let radius = off.norm();
        if self.distortion.is_none() || !(radius > T::zero()) {
            return off;
        }
        let found = self.distortion.direction(radius).unwrap_or(radius);
        off * (found / radius)
    }

    /// Direction (forward, left, up) of a column, so many columns' widths above the middle row.
    #[inline(never)] // for less flash
    fn seen(&self, column: T, above: T) -> Vector3<T> {
        let off = self.undistorted(self.principal_point - column, above);
        match self.projection {
            Projection::PinHole => Vector3::new(T::one(), off.x, off.y),
            Projection::EqualAngle => {
                let angle = off.norm();
                let (sine, cosine) = angle.sine_cosine();
                let aside = off * over(sine, angle);
                Vector3::new(cosine, aside.x, aside.y)
            }
        }
    }

    /// [`Camera::bearing`] of what is seen so many columns' widths above the middle row. Beside the middle row, only a
    /// pin-hole without distortion has the same bearing in all of a column.
    #[inline(never)] // for less flash
    pub fn bearing_above(&self, column: T, above: T) -> T {
        if self.projection == Projection::PinHole && self.distortion.is_none() {
            return self.bearing(column);
        }
        let seen = self.seen(column, above);
        seen.y.atan2(seen.x)
    }

    /// Direction above the camera's own horizontal plane of the middle between two rows of a column, so many columns'
    /// widths above the middle one; radians. `bearing` is that of the middle.
    #[inline(never)] // for less flash
    pub fn elevation(&self, bearing: T, column: T, rows: [T; 2]) -> T {
        let is_pin_hole = self.projection == Projection::PinHole;
        let [top, bottom] = rows.map(|row| {
            let seen = self.seen(column, row);
            let along = if is_pin_hole {
                seen.x
            } else {
                seen.xy().norm()
            };
            seen.z.atan2(along)
        });
        let middle = (top + bottom) * lit(0.5);
        if is_pin_hole {
            (tangent(middle) * bearing.sine_cosine().1).atan()
        } else {
            middle
        }
    }

    /// Standard deviation of [`Camera::bearing`], radians, when the column's is `column_sigma`.
    /// A pin-hole's columns are narrower towards the border: `cos(phi)^2 / f`.
    pub fn bearing_sigma(&self, column: T, column_sigma: T) -> T {
        let mut sigma = column_sigma / self.focal_length;
        let off = self.undistorted(self.principal_point - column, T::zero()).x;
        if !self.distortion.is_none() {
            sigma /= self.distortion.radius(off).1.max(lit(LEAST_SLOPE));
        }
        match self.projection {
            Projection::PinHole => sigma / (T::one() + off * off),
            Projection::EqualAngle => sigma,
        }
    }

    /// Width of a ball over its height, both as pictured, where its middle is at a column and so many columns' widths
    /// above the middle row: the lens stretches it along the radius, and across it.
    #[inline(never)] // for less flash
    pub fn stretch(&self, column: T, above: T) -> T {
        let off = self.undistorted(self.principal_point - column, above);
        let q = off.norm();
        if !(q > T::zero()) {
            return T::one();
        }
        // Growth of the picture along the radius over that across it: of the projection, then of the lens.
        let across = match self.projection {
            Projection::PinHole => (T::one() + q * q).sqrt(),
            Projection::EqualAngle => q.sine_cosine().0 / q,
        };
        let (radius, slope) = self.distortion.radius(q);
        let growth = slope * across * q / radius;
        let excess = (growth * growth - T::one()) / (q * q);
        let part = |aside: T| T::one() + excess * aside * aside;
        (part(off.x) / part(off.y)).sqrt()
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
        let (shown, slope) = self.distortion.radius(left);
        if !Distortion::is_within_rim(slope) {
            return None;
        }
        let column = self.principal_point - shown * self.focal_length;
        self.has_column(column).then_some(column)
    }
}

/// A quotient of two numbers that vanish together, where it is 1.
fn over<T: Real>(number: T, by: T) -> T {
    if by.abs() > T::default_epsilon() {
        number / by
    } else {
        T::one()
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

    /// The columns and rows of a direction by the formula of a distorted lens, and back.
    #[test]
    fn a_distorted_picture_is_seen_as_it_is() {
        for (projection, [k1, k2]) in [
            (Projection::PinHole, [-0.3, 0.08]),
            (Projection::PinHole, [0.2, 0.0]),
            (Projection::EqualAngle, [0.0, 0.0]),
            (Projection::EqualAngle, [-0.05, 0.01]),
        ] {
            let plain = Camera::new(projection, 161, 80_f64.to_radians()).unwrap();
            let camera = plain.with_distortion(Distortion { k1, k2 }).unwrap();
            // The field of view is still that from the first column to the last one.
            assert!((camera.bearing(0.0).to_degrees() - 40.0).abs() < 1e-9);
            assert!((camera.bearing(160.0).to_degrees() + 40.0).abs() < 1e-9);
            let focal = camera.focal_length;
            for (bearing, elevation) in [
                (0.5, 0.0),
                (0.5, 0.35),
                (-0.3, -0.4),
                (0.0, 0.3),
                (0.0, 0.0),
            ] {
                let (forward, left, up) = (
                    f64::cos(elevation) * f64::cos(bearing),
                    f64::cos(elevation) * f64::sin(bearing),
                    f64::sin(elevation),
                );
                let (x, y) = match projection {
                    Projection::PinHole => (left / forward, up / forward),
                    Projection::EqualAngle => {
                        let share = over(forward.acos(), left.hypot(up));
                        (left * share, up * share)
                    }
                };
                let r2 = x * x + y * y;
                let factor = focal * (1.0 + k1 * r2 + k2 * r2 * r2);
                let (column, row) = (80.0 - x * factor, y * factor);
                assert!((camera.bearing_above(column, row) - bearing).abs() < 1e-9);
                let found = camera.elevation(bearing, column, [row, row]);
                assert!((found - elevation).abs() < 1e-9, "{found} {elevation}");
                if elevation == 0.0 {
                    assert!((camera.bearing(column) - bearing).abs() < 1e-9);
                    let back = camera.column(camera.ray(column)).unwrap();
                    assert!((back - column).abs() < 1e-9);
                }
                // Columns and rows of a small ball's outline, from a circle of directions around its middle.
                let outline = |turn: f64| {
                    let (sine, cosine) = turn.sin_cos();
                    let (small, own) = (1e-4, nalgebra::Vector3::new(forward, left, up));
                    let aside = own.cross(&nalgebra::Vector3::z()).normalize();
                    let seen = own + (aside * cosine + own.cross(&aside) * sine) * small;
                    let (x, y) = match projection {
                        Projection::PinHole => (seen.y / seen.x, seen.z / seen.x),
                        Projection::EqualAngle => {
                            let aside = seen.y.hypot(seen.z);
                            let share = aside.atan2(seen.x) / aside;
                            (seen.y * share, seen.z * share)
                        }
                    };
                    let r2 = x * x + y * y;
                    let factor = 1.0 + k1 * r2 + k2 * r2 * r2;
                    (x * factor, y * factor)
                };
                let points = (0..720).map(|n| outline(f64::from(n).to_radians() / 2.0));
                let [mut from, mut to] = [[f64::MAX; 2], [f64::MIN; 2]];
                for (x, y) in points {
                    for (axis, value) in [x, y].into_iter().enumerate() {
                        from[axis] = from[axis].min(value);
                        to[axis] = to[axis].max(value);
                    }
                }
                let stretched = (to[0] - from[0]) / (to[1] - from[1]);
                let found = camera.stretch(column, row);
                assert!(
                    (found / stretched - 1.0).abs() < 1e-3,
                    "{found} {stretched}"
                );
            }
        }
    }

    /// A lens that shows its border nearer to the axis than what is within.
    #[test]
    fn a_lens_that_folds_back_is_refused() {
        let camera = Camera::pin_hole(88, 90_f64.to_radians()).unwrap();
        for (k1, k2) in [
            (-0.5, 0.0),
            (0.0, -0.3),
            (f64::NAN, 0.0),
            // The corners would be seen within the fold.
            (-3.0, 0.0),
            (-20.0, 0.0),
            (-1.0, 0.3),
        ] {
            let folded = camera.with_distortion(Distortion { k1, k2 });
            assert_eq!(folded, Err(CameraError::Distortion), "{k1} {k2}");
        }
        let none = Distortion { k1: 0.0, k2: 0.0 };
        assert_eq!(camera.with_distortion(none), Ok(camera));
        let barrel = Distortion { k1: -0.1, k2: 0.0 };
        let distorted = camera.with_distortion(barrel).unwrap();
        assert_eq!(distorted.distortion(), barrel);
        // Beyond the rim, where the tangent is 1.8.
        assert_eq!(distorted.column(Ray::from_bearing(1.2)), None);
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
        let plain = [Projection::PinHole, Projection::EqualAngle]
            .map(|projection| Camera::new(projection, 88, 1.0_f64).unwrap());
        let barrel = Distortion { k1: -0.3, k2: 0.02 };
        let distorted = plain.map(|camera| camera.with_distortion(barrel).unwrap());
        for camera in plain.into_iter().chain(distorted) {
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
            (CameraError::Distortion, "k1 and k2"),
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
