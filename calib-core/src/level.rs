//! Test of the assumption that a camera is level, by the rows in which it sees the target.
//!
//! All else in the plane assumes that cameras are level. At three stops no test of columns can see that one is
//! not: a camera of pitch `p`, roll `r` and height `h` sees the plane of the ball exactly as a level one that
//! stands `h tan p` behind it and `h tan r / cos p` aside. Rows can. A camera that is level at *any* height `h`
//! above the ball sees it at `b = -h u`, where `b` is the tangent of the row and `u` one over the distance along
//! the optical axis.
//!
//! # The test
//! Rows are fitted with a height of which nothing is known, a pitch and a roll within the tolerance of whoever
//! put the camera up, and the error of the pose in the plane:
//!
//! ```text
//! b = -h u + p (1 + b^2) + r a + h (du/dx dx + du/dy dy + du/dw dw) + noise
//! ```
//!
//! with `a` the tangent of the column. Noise is that of the picture, of a ball that bobs, and of the place of the
//! stop. What is left is chi squared with one degree of freedom less than there are rows.
//!
//! Of a camera that passes, `h` tells how much a tilt within the tolerance may move its pose: [`Levelness::widen`].

use nalgebra::{Matrix3, Point2, SMatrix, SVector, Vector2};

use crate::{
    Pose, Real,
    fit::Fit,
    numerics::{
        cholesky::Cholesky,
        matrix::{add_outer, dot},
        plane,
        real::{at_least_zero, lit},
    },
};

/// Unknowns of the fit: height, pitch, roll, and the error of the pose in the plane.
const UNKNOWNS: usize = 6;
/// Times that the height is found, from none: it decides how much errors of the pose count.
const ROUNDS: usize = 6;
/// Standard deviation of a pitch of which nothing is known, radians.
const ANY_PITCH: f64 = 1.0;
/// Standard deviation of the height, over the distance of the farthest stop: nothing is known of it.
const ANY_HEIGHT: f64 = 4.0;
/// Share of the tolerance by which a tilt turns the heading.
const TURN: f64 = 0.25;

/// Direction of a target above a camera's own horizontal plane, in tenths of a milliradian, if it is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Elevation(i16);

impl Elevation {
    /// The row is not known: the blob is cut off at its top or bottom, or the camera tells no rows.
    pub const UNKNOWN: Self = Self(i16::MIN);
    /// Radians.
    const UNIT: f64 = 1e-4;

    /// From radians, positive above the optical axis. An angle beyond a quarter turn is unknown.
    pub fn from_radians(angle: f32) -> Self {
        if angle.abs() <= core::f32::consts::FRAC_PI_2 {
            let half = if angle < 0.0 { -0.5 } else { 0.5 };
            Self((angle / Self::UNIT as f32 + half) as i16)
        } else {
            Self::UNKNOWN
        }
    }

    /// In radians, if it is known.
    pub fn radians<T: Real>(self) -> Option<T> {
        (self != Self::UNKNOWN).then(|| lit::<T>(f64::from(self.0)) * lit(Self::UNIT))
    }
}

impl Default for Elevation {
    fn default() -> Self {
        Self::UNKNOWN
    }
}

/// The row in which a camera saw the target at a stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row<T: Real> {
    /// Place of the target.
    pub target: Point2<T>,
    /// Variance of that place, along any axis.
    pub target_variance: T,
    /// Direction off the optical axis in the camera's horizontal plane, radians, positive to the left.
    pub bearing: T,
    /// Direction above that plane, radians.
    pub elevation: T,
    /// Standard deviation of the elevation, radians, above zero.
    pub sigma: T,
}

/// Assumptions about how a camera is put up, and about the ball.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tolerance<T> {
    /// Standard deviation of a level camera's pitch and roll, radians, above zero.
    pub tilt: T,
    /// Standard deviation of the ball's height at a stop, in the unit of the site.
    pub bob: T,
}

/// Result of the test.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Levelness<T> {
    /// Agreement of the rows with a level camera. Bad: it is not level.
    pub fit: Fit<T>,
    /// Height of a level camera above the ball that fits best, and its variance.
    pub height: T,
    /// Variance of that height.
    pub height_variance: T,
    /// Standard deviation of the tilt that was allowed, radians.
    pub tilt_sigma: T,
}

/// A mounting that the rows tell, whatever it is. For people: the pose that it is told with is wrong by it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Mounting<T> {
    /// Height above the ball.
    pub height: T,
    /// Angle of the optical axis below the horizon, radians.
    pub pitch: T,
}

/// Tests whether a camera with this pose is level. `None` where nothing is to be tested: without a tolerance or rows,
/// and where numbers are not finite.
pub fn test<T: Real>(
    pose: &Pose<T>,
    rows: &(impl Iterator<Item = Row<T>> + Clone),
    tolerance: &Tolerance<T>,
) -> Option<Levelness<T>> {
    let mut found = Fitted::default();
    for _ in 0..ROUNDS {
        found = fitted(pose, rows.clone(), tolerance, tolerance.tilt, found.height)?;
    }
    Some(Levelness {
        fit: Fit {
            chi_squared: found.chi_squared,
            degrees_of_freedom: found.rows.checked_sub(1)?,
        },
        height: found.height,
        height_variance: found.height_variance,
        tilt_sigma: tolerance.tilt,
    })
    .filter(|found| (found.fit.chi_squared + found.height_variance).is_finite())
}

/// The mounting that rows tell of a camera that is not level.
pub fn mounting<T: Real>(
    pose: &Pose<T>,
    rows: &(impl Iterator<Item = Row<T>> + Clone),
    tolerance: &Tolerance<T>,
) -> Option<Mounting<T>> {
    let mut found = Fitted::default();
    for _ in 0..ROUNDS {
        found = fitted(pose, rows.clone(), tolerance, lit(ANY_PITCH), found.height)?;
    }
    Some(Mounting {
        height: found.height,
        pitch: found.pitch,
    })
    .filter(|found| (found.height + found.pitch).is_finite())
}

impl<T: Real> Levelness<T> {
    /// Returns true if the camera is not level: one in a thousand level ones is told so by chance.
    pub fn is_refused(&self) -> bool {
        self.fit.degrees_of_freedom > 0 && self.fit.is_bad()
    }

    /// Covariance of (x, y, heading) by a tilt within the tolerance: at a height above the ball it moves the pose.
    pub fn widen(&self) -> Matrix3<T> {
        let tilt = self.tilt_sigma * self.tilt_sigma;
        let place = (self.height * self.height + self.height_variance) * tilt;
        let turn = tilt * lit(TURN * TURN);
        Matrix3::from_diagonal(&[place, place, turn].into())
    }
}

/// Result of one fit.
#[derive(Clone, Copy)]
struct Fitted<T> {
    rows: usize,
    chi_squared: T,
    height: T,
    height_variance: T,
    pitch: T,
}

impl<T: Real> Default for Fitted<T> {
    fn default() -> Self {
        let zero = T::zero();
        Self {
            rows: 0,
            chi_squared: zero,
            height: zero,
            height_variance: zero,
            pitch: zero,
        }
    }
}

/// Fits all unknowns, where errors of the pose count as at this height.
#[inline(never)] // for less stack
fn fitted<T: Real>(
    pose: &Pose<T>,
    rows: impl Iterator<Item = Row<T>>,
    tolerance: &Tolerance<T>,
    pitch_sigma: T,
    height: T,
) -> Option<Fitted<T>> {
    if !(tolerance.tilt > T::zero()) {
        return None;
    }
    let root = semi_definite_root(&pose.covariance);
    let ahead = plane::unit(pose.heading);
    let (mut matrix, mut right) = (
        SMatrix::<T, UNKNOWNS, UNKNOWNS>::zeros(),
        SVector::<T, UNKNOWNS>::zeros(),
    );
    let (mut count, mut sum, mut farthest) = (0, T::zero(), T::zero());
    for row in rows {
        let own = plane::mul_conj(row.target - pose.position, ahead);
        let (forward, left) = (own.x, own.y);
        let (sine, cosine) = row.bearing.sine_cosine();
        let (up, level) = row.elevation.sine_cosine();
        let along = level * cosine;
        if !(forward > T::zero() && along > T::zero()) {
            continue;
        }
        let (u, a, b) = (forward.recip(), sine / cosine, up / along);
        let (uu, q) = (u * u, T::one() + b * b);
        // Movement of u with the pose.
        let moved = Vector2::new(ahead.x, ahead.y) * uu;
        let moved = SVector::<T, 3>::new(moved.x, moved.y, -left * uu);
        let [x, y, turn] = root.map(|column| dot(&column, moved.as_slice()) * height);
        let design = [-u, q, a, x, y, turn];
        let of_place = height * uu;
        let variance = row.sigma * row.sigma * q * q
            + tolerance.bob * tolerance.bob * uu
            + of_place * of_place * row.target_variance;
        let weight = variance.recip();
        add_outer(matrix.as_mut_slice(), &design, weight);
        for (to, entry) in right.iter_mut().zip(design) {
            *to += entry * b * weight;
        }
        sum += b * b * weight;
        farthest = farthest.max(forward);
        count += 1;
    }
    let any = farthest * lit(ANY_HEIGHT);
    let sigmas = [any, pitch_sigma, tolerance.tilt];
    for (i, pivot) in matrix
        .as_mut_slice()
        .iter_mut()
        .step_by(UNKNOWNS + 1)
        .enumerate()
    {
        *pivot += match sigmas.get(i) {
            Some(sigma) => (*sigma * *sigma).recip(),
            None => T::one(),
        };
    }
    let factor = Cholesky::new(matrix).filter(|_| count > 0)?;
    let found = factor.solve(&right);
    let first = factor.solve(&SVector::<T, UNKNOWNS>::x());
    Some(Fitted {
        rows: count,
        chi_squared: at_least_zero(sum - dot(found.as_slice(), right.as_slice())),
        height: found.x,
        height_variance: first.x,
        pitch: found.y,
    })
}

/// The columns of a root of a covariance, of which any direction may be known exactly.
fn semi_definite_root<T: Real>(covariance: &Matrix3<T>) -> [[T; 3]; 3] {
    let mut columns = [[T::zero(); 3]; 3];
    let mut left = *covariance;
    for (k, column) in columns.iter_mut().enumerate() {
        let pivot = left.get((k, k)).copied().unwrap_or_else(T::zero);
        let scale = covariance.get((k, k)).copied().unwrap_or_else(T::zero);
        if pivot > scale * T::default_epsilon() * lit(16.0) {
            for (i, entry) in column.iter_mut().enumerate().skip(k) {
                let of = left.get((i, k)).copied().unwrap_or_else(T::zero);
                *entry = of / pivot.sqrt();
            }
            let own = *column;
            add_outer(left.as_mut_slice(), &own, -T::one());
        }
    }
    columns
}
