//! The answer: a place, a heading, and how sure both are.

use core::fmt;

use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use crate::{
    Real,
    numerics::{
        angle,
        cholesky::Cholesky,
        covariance::is_covariance,
        real::{lit, root},
    },
};

/// Where a camera stands and looks, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pose<T: Real> {
    /// The camera's centre.
    pub position: Point2<T>,
    /// Direction of the optical axis, radians in `[0, 2 pi)`.
    pub heading: T,
    /// Covariance of `(x, y, heading)`, symmetric; to first order.
    pub covariance: Matrix3<T>,
}

/// A region of confidence in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ellipse<T> {
    /// The longer half axis.
    pub semi_major: T,
    /// The shorter half axis.
    pub semi_minor: T,
    /// Direction of the longer axis, radians in `(-pi/2, pi/2]`.
    pub angle: T,
}

/// Reason why numbers are no [`Pose`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PoseError {
    /// A number is not finite.
    NotFinite,
    /// The matrix is not positive semi-definite.
    NotACovariance,
}

impl fmt::Display for PoseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite => "a number of the pose is not finite",
            Self::NotACovariance => "the pose's covariance is not positive semi-definite",
        })
    }
}

impl core::error::Error for PoseError {}

impl<T: Real> Pose<T> {
    /// The pose that these numbers, from a message or a memory, describe. `covariance` is the lower
    /// triangle by rows, as [`covariance_triangle`](Pose::covariance_triangle) gives it; the heading
    /// may be any finite angle.
    ///
    /// # Errors
    /// A number that is not finite; a matrix that is not, but for rounding, positive semi-definite.
    pub fn from_parts(
        position: Point2<T>,
        heading: T,
        covariance: [T; 6],
    ) -> Result<Self, PoseError> {
        let mut numbers = position.iter().chain([&heading]).chain(&covariance);
        if !numbers.all(T::is_finite) {
            return Err(PoseError::NotFinite);
        }
        let [xx, xy, yy, xh, yh, hh] = covariance;
        let covariance = Matrix3::new(xx, xy, xh, xy, yy, yh, xh, yh, hh);
        if !is_covariance(&covariance) {
            return Err(PoseError::NotACovariance);
        }
        Ok(Self {
            position,
            heading: angle::wrap_positive(heading),
            covariance,
        })
    }

    /// The same pose seen from a frame in which the origin of its own is at `origin`, and the x axis of
    /// its own points to `direction`, radians.
    #[must_use]
    pub fn seen_from(&self, origin: Point2<T>, direction: T) -> Self {
        let turn = angle::rotation(direction);
        let c = &self.covariance;
        let place = angle::turned(&Matrix2::new(c.m11, c.m12, c.m21, c.m22), &turn);
        let with_heading = turn * Vector2::new(c.m13, c.m23);
        let (x, y) = (with_heading.x, with_heading.y);
        Self {
            position: origin + turn * self.position.coords,
            heading: angle::wrap_positive(self.heading + direction),
            covariance: Matrix3::new(
                place.m11, place.m12, x, place.m21, place.m22, y, x, y, c.m33,
            ),
        }
    }

    /// The six different numbers of the covariance: `xx, xy, yy, xh, yh, hh`, with `h` the heading.
    pub fn covariance_triangle(&self) -> [T; 6] {
        let c = &self.covariance;
        [c.m11, c.m21, c.m22, c.m31, c.m32, c.m33]
    }

    /// Standard deviation of x.
    pub fn sigma_x(&self) -> T {
        root(self.covariance.m11)
    }

    /// Standard deviation of y.
    pub fn sigma_y(&self) -> T {
        root(self.covariance.m22)
    }

    /// Standard deviation of the place: `sqrt(sigma_x^2 + sigma_y^2)`, the expected rms distance
    /// between answer and truth, whichever way the frame is turned.
    pub fn sigma_position(&self) -> T {
        root(self.covariance.m11 + self.covariance.m22)
    }

    /// Standard deviation of the heading, radians.
    pub fn sigma_heading(&self) -> T {
        root(self.covariance.m33)
    }

    /// The ellipse that holds the camera's true place with the given probability in `(0, 1)`, if
    /// errors are Gaussian.
    pub fn ellipse(&self, probability: T) -> Ellipse<T> {
        // Two degrees of freedom: the quantile of chi squared is -2 ln(1 - p).
        let scale = root(-lit::<T>(2.0) * (T::one() - probability).ln());
        let (xx, xy, yy) = (
            self.covariance.m11,
            self.covariance.m12,
            self.covariance.m22,
        );
        let half = lit::<T>(0.5);
        let mean = (xx + yy) * half;
        let difference = (xx - yy) * half;
        let radius = root(difference * difference + xy * xy);
        Ellipse {
            semi_major: scale * root(mean + radius),
            semi_minor: scale * root(mean - radius),
            angle: half * xy.atan2(difference),
        }
    }

    /// The squared error against a known truth in units of the predicted covariance (NEES). It
    /// averages 3 over many poses whose predictions are right. `None` for a singular covariance.
    pub fn normalised_error(&self, position: Point2<T>, heading: T) -> Option<T> {
        let d: Vector2<T> = self.position - position;
        let error = nalgebra::Vector3::new(d.x, d.y, angle::wrap_signed(self.heading - heading));
        Some((Cholesky::new(self.covariance)?.solve(&error)).dot(&error))
    }
}

impl<T: Real + fmt::Display> fmt::Display for Pose<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let degrees = |radians: T| radians * lit(180.0) / T::pi();
        write!(
            f,
            "x {:.3} +/- {:.3}, y {:.3} +/- {:.3}, heading {:.2} +/- {:.2} deg",
            self.position.x,
            self.sigma_x(),
            self.position.y,
            self.sigma_y(),
            degrees(self.heading),
            degrees(self.sigma_heading()),
        )
    }
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for Pose<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(
            f,
            "x {} +/- {}, y {} +/- {}, heading {} +/- {} rad",
            self.position.x,
            self.sigma_x(),
            self.position.y,
            self.sigma_y(),
            self.heading,
            self.sigma_heading()
        );
    }
}
