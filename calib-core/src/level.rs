//! Cameras that are not level: their mounting, by the rows in which they see the target.
//!
//! All else in the plane assumes that cameras are level. At three stops no test of columns can see that one is
//! not: a camera of pitch `p`, roll `r` and height `h` sees the plane of the ball exactly as a level one that
//! stands `h tan p` behind it and `h tan r / cos p` aside. Rows can. A camera that is level at *any* height `h`
//! above the ball sees it at `b = -h u`, where `b` is the tangent of the row and `u` one over the distance along
//! the optical axis.
//!
//! # The fit
//! Directions are turned [upright](Mounting::upright) by the pitch and roll that are believed so far. The rows that
//! come out are fitted with a height of which nothing is known, what is left of pitch and roll, and the error of the
//! pose in the plane:
//!
//! ```text
//! b = -h u + p (1 + b^2) - r a - h (du/dx dx + du/dy dy + du/dw dw) + noise
//! ```
//!
//! with `a` the tangent of the column. The pose moves with pitch and roll, and its own error is another one. Noise is
//! that of the picture, of a ball that bobs, and of the place of the stop. Chi squared of what is left tells whether
//! the rows fit.
//!
//! # Level, until rows say otherwise
//! A camera is taken for level as long as its rows fit a pitch and a roll within the tolerance of its installer.
//! Then nothing of it is estimated, and `h` tells how much a tilt within the tolerance may move its pose. If they do not
//! fit, its pitch is whatever the rows say; its roll stays one of a bracket. The errors of both are in the covariance
//! that [`Levelness::widening`] adds to that of the pose.

use nalgebra::{Matrix3, Point2, SMatrix, SVector, Vector3};

use crate::{
    Pose, Real,
    fit::{Fit, one_in_a_thousand},
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
/// A pitch beyond this is not believed, radians: 60 degrees. Such fits are mostly those of another pose.
const STEEPEST: f64 = 1.047;
/// Pitch that comes so close to the steepest one runs away: it approaches the limit by halves and never reaches it.
/// Radians.
const CLOSE: f64 = 0.035;
/// Share of the chi squared of one in a thousand up to which a camera is taken for level. A level one whose pitch is
/// found from its rows loses little.
const AS_LEVEL: f64 = 0.5;
/// The same of one that was not: so none goes to and fro.
const LEVEL_AGAIN: f64 = 0.2;
/// Changes of pitch and roll that are none, in their sigmas.
const SETTLED: f64 = 0.05;

/// Times that mountings are improved for one answer, at most.
pub const MOUNTING_ROUNDS: u8 = 8;
/// Pitches of both references from which their mountings are sought, one after the other, radians: level, and down by
/// 25 and by 45 degrees.
pub const PITCHES: [f64; 3] = [0.0, 0.44, 0.79];

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

impl<T: Real> Default for Row<T> {
    /// Of a target right at the origin.
    fn default() -> Self {
        Self {
            target: Point2::origin(),
            target_variance: T::zero(),
            bearing: T::zero(),
            elevation: T::zero(),
            sigma: T::one(),
        }
    }
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

/// Pitch and roll of a camera, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Mounting<T> {
    /// Angle of the optical axis below the horizon.
    pub pitch: T,
    /// Turn about the optical axis, positive where the left side is high.
    pub roll: T,
}

impl<T: Real> Default for Mounting<T> {
    /// Level and upright.
    fn default() -> Self {
        Self::level()
    }
}

/// A direction turned upright: that of a level camera with the same heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Upright<T> {
    /// Along the heading, left of it, and up.
    pub ahead: T,
    /// Left of the heading.
    pub left: T,
    /// Above the horizon.
    pub up: T,
}

impl<T: Real> Upright<T> {
    /// Direction on the floor, radians left of the heading.
    pub fn azimuth(&self) -> T {
        self.left.atan2(self.ahead)
    }

    /// Direction above the horizon, radians.
    pub fn elevation(&self) -> T {
        let along = (self.ahead * self.ahead + self.left * self.left).sqrt();
        self.up.atan2(along)
    }

    /// Change of the azimuth where the direction changes by this.
    pub(crate) fn turn(&self, change: &Self) -> T {
        let length2 = self.ahead * self.ahead + self.left * self.left;
        (self.ahead * change.left - self.left * change.ahead) / length2
    }
}

impl<T: Real> Mounting<T> {
    /// Level and upright.
    pub fn level() -> Self {
        Self {
            pitch: T::zero(),
            roll: T::zero(),
        }
    }

    /// Returns true if it is exactly level.
    pub fn is_level(&self) -> bool {
        self.pitch == T::zero() && self.roll == T::zero()
    }

    /// The middle between two mountings; the other one where either is level. With whole steps both references may go
    /// beyond what is sought, and farther each time: their stops move with their pitch.
    #[must_use]
    pub fn towards(&self, other: &Self) -> Self {
        if self.is_level() || other.is_level() {
            return *other;
        }
        let half = lit::<T>(0.5);
        Self {
            pitch: (self.pitch + other.pitch) * half,
            roll: (self.roll + other.roll) * half,
        }
    }

    /// A direction in the camera's axes, forward, left and up, turned upright.
    #[inline(never)] // for less flash
    pub fn upright(&self, forward: T, left: T, up: T) -> Upright<T> {
        let (sp, cp) = self.pitch.sine_cosine();
        let (sr, cr) = self.roll.sine_cosine();
        let over = left * sr + up * cr;
        Upright {
            ahead: forward * cp + over * sp,
            left: left * cr - up * sr,
            up: over * cp - forward * sp,
        }
    }

    /// The same of what is seen at a bearing and an elevation, radians.
    #[inline(never)] // for less flash
    pub fn seen(&self, bearing: T, elevation: T) -> Upright<T> {
        let (left, forward) = bearing.sine_cosine();
        let (up, level) = elevation.sine_cosine();
        self.upright(forward * level, left * level, up)
    }

    /// Change of the azimuth with the elevation.
    pub fn by_elevation(&self, bearing: T, elevation: T) -> T {
        let above = self.seen(bearing, elevation + T::frac_pi_2());
        self.seen(bearing, elevation).turn(&above)
    }

    /// Changes of an upright direction with pitch and roll.
    fn by_angles(&self, seen: &Upright<T>) -> [Upright<T>; 2] {
        let (sp, cp) = self.pitch.sine_cosine();
        // The height over the camera's own forward and left, before the pitch was taken away.
        let over = seen.up * cp + seen.ahead * sp;
        let zero = T::zero();
        [
            Upright {
                ahead: seen.up,
                left: zero,
                up: -seen.ahead,
            },
            Upright {
                ahead: seen.left * sp,
                left: -over,
                up: seen.left * cp,
            },
        ]
    }
}

/// The mounting that rows tell.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Levelness<T: Real> {
    /// Agreement of the rows: with a level camera, or with any one if this one is not level.
    pub fit: Fit<T>,
    /// Height above the ball.
    pub height: T,
    /// Pitch and roll: none of a level camera.
    pub mounting: Mounting<T>,
    /// Covariance of (x, y, heading) by a pitch and a roll that are not known exactly.
    pub widening: Matrix3<T>,
    /// Variance by them of a place that was given instead, along the heading: all others are off by as much.
    pub shift_variance: T,
}

impl<T: Real> Levelness<T> {
    /// Returns true if the rows contradict it, or do not tell it. One in a thousand right ones is refused by chance.
    pub fn is_refused(&self) -> bool {
        let Fit {
            chi_squared,
            degrees_of_freedom,
        } = self.fit;
        if self.mounting.is_level() {
            // Rows that fit less well tell a pitch.
            let most = one_in_a_thousand::<T>(degrees_of_freedom) * lit(AS_LEVEL);
            return degrees_of_freedom > 0 && !(chi_squared <= most);
        }
        degrees_of_freedom == 0
            || self.fit.is_bad()
            || self.mounting.pitch.abs() >= lit(STEEPEST - CLOSE)
    }
}

/// Judges a pose in the plane that was found with this mounting. `None` where nothing is to be tested: without a
/// tolerance or rows, and where numbers are not finite.
#[inline(never)] // for less flash
pub fn judge<T: Real>(
    pose: &Pose<T>,
    rows: &[Row<T>],
    mounting: Mounting<T>,
    tolerance: &Tolerance<T>,
) -> Option<Levelness<T>> {
    let is_level = mounting.is_level();
    let free = if is_level {
        tolerance.tilt
    } else {
        lit(ANY_PITCH)
    };
    let found = settled(pose, rows, mounting, tolerance, free)?;
    let degrees_of_freedom = found.rows.checked_sub(if is_level { 1 } else { 2 })?;
    let height2 = found.height * found.height;
    let (widening, shift_variance) = if is_level {
        let tilt = tolerance.tilt * tolerance.tilt;
        let place = (height2 + found.spread.m11) * tilt;
        let turn = tilt * lit(TURN * TURN);
        (Matrix3::from_diagonal(&[place, place, turn].into()), place)
    } else {
        let ([by_pitch, by_roll], c) = (found.moves, found.spread);
        let both = by_pitch * by_roll.transpose() * c.m23;
        let (_, cosine) = mounting.pitch.sine_cosine();
        let shift = (cosine * cosine).recip();
        (
            by_pitch * by_pitch.transpose() * c.m22
                + by_roll * by_roll.transpose() * c.m33
                + both
                + both.transpose(),
            height2 * shift * shift * c.m22,
        )
    };
    Some(Levelness {
        fit: Fit {
            chi_squared: found.chi_squared,
            degrees_of_freedom,
        },
        height: found.height,
        mounting,
        widening,
        shift_variance,
    })
    .filter(|found| (found.fit.chi_squared + found.widening.sum()).is_finite())
}

/// Height, pitch and roll of a camera, with their covariance. The pitch is that of the middle row: an optical axis that is
/// elsewhere in the picture is not in its variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hanging<T: Real> {
    /// Height above the ball.
    pub height: T,
    /// Pitch and roll: none of a level camera.
    pub mounting: Mounting<T>,
    /// Covariance of (height, pitch, roll): radians and the unit of the site.
    pub covariance: Matrix3<T>,
    /// Covariance of (x, y, heading), one a row, with (height, pitch, roll).
    pub with_pose: Matrix3<T>,
}

/// Height, pitch and roll of a camera whose pose in the plane was found with this mounting. Those of a level camera are
/// what its installer promises, and its height is what the rows tell. `None` as of [`judge`].
pub fn hanging<T: Real>(
    pose: &Pose<T>,
    rows: &[Row<T>],
    mounting: Mounting<T>,
    tolerance: &Tolerance<T>,
) -> Option<Hanging<T>> {
    let is_level = mounting.is_level();
    let free = if is_level {
        tolerance.tilt
    } else {
        lit(ANY_PITCH)
    };
    let found = settled(pose, rows, mounting, tolerance, free)?;
    let mut covariance = found.spread;
    let mut with_pose = Matrix3::zeros();
    if is_level {
        let tilt = tolerance.tilt * tolerance.tilt;
        covariance = Matrix3::from_diagonal(&[covariance.m11, tilt, tilt].into());
    } else {
        for (moved, spread) in found.moves.iter().zip(covariance.row_iter().skip(1)) {
            with_pose += moved * spread;
        }
    }
    Some(Hanging {
        height: found.height,
        mounting,
        covariance,
        with_pose,
    })
    .filter(|found| (found.height + found.covariance.sum() + found.with_pose.sum()).is_finite())
}

/// A better mounting for the next solution in the plane; `None` if this one stays.
#[inline(never)] // for less flash
pub fn improved<T: Real>(
    pose: &Pose<T>,
    rows: &[Row<T>],
    mounting: Mounting<T>,
    tolerance: &Tolerance<T>,
) -> Option<Mounting<T>> {
    let as_level = settled(pose, rows, mounting, tolerance, tolerance.tilt)?;
    let share = if mounting.is_level() {
        AS_LEVEL
    } else {
        LEVEL_AGAIN
    };
    let most = one_in_a_thousand::<T>(as_level.rows.checked_sub(1)?) * lit(share);
    if as_level.rows < FEWEST || as_level.chi_squared <= most {
        return (!mounting.is_level()).then(Mounting::level);
    }
    let found = settled(pose, rows, mounting, tolerance, lit(ANY_PITCH))?;
    let [pitch, roll] = [mounting.pitch + found.pitch, mounting.roll + found.roll];
    let is_change = { found.pitch.abs() > found.spread.m22.sqrt() * lit(SETTLED) }
        || found.roll.abs() > found.spread.m33.sqrt() * lit(SETTLED);
    let steepest = lit::<T>(STEEPEST);
    (is_change && (pitch + roll).is_finite()).then(|| Mounting {
        pitch: pitch.max(-steepest).min(steepest),
        roll,
    })
}

/// Rows that tell a pitch.
const FEWEST: usize = 3;

/// Result of one fit.
#[derive(Clone, Copy)]
struct Fitted<T: Real> {
    rows: usize,
    chi_squared: T,
    height: T,
    /// Rest of the pitch.
    pitch: T,
    /// Rest of the roll.
    roll: T,
    /// Covariance of (height, pitch, roll).
    spread: Matrix3<T>,
    /// Movement of (x, y, heading) with them.
    moves: [Vector3<T>; 2],
}

/// The fit at the height that it finds.
#[inline(never)] // for less flash
fn settled<T: Real>(
    pose: &Pose<T>,
    rows: &[Row<T>],
    mounting: Mounting<T>,
    tolerance: &Tolerance<T>,
    pitch_sigma: T,
) -> Option<Fitted<T>> {
    if !(tolerance.tilt > T::zero()) {
        return None;
    }
    let moves = moves(pose, rows, mounting)?;
    let mut height = T::zero();
    for _ in 1..ROUNDS {
        let all = (tolerance, pitch_sigma, height);
        height = fitted(pose, rows, mounting, moves, all)?.height;
    }
    fitted(
        pose,
        rows,
        mounting,
        moves,
        (tolerance, pitch_sigma, height),
    )
}

/// A row as a level camera at this pose would have it.
struct Seen<T: Real> {
    /// Over the distance along the heading.
    u: T,
    /// Derivative of `u` by (x, y, heading).
    by_pose: Vector3<T>,
    upright: Upright<T>,
    row: Row<T>,
}

/// `None` of what is not before the camera.
#[inline(never)] // for less flash
fn seen<T: Real>(pose: &Pose<T>, row: &Row<T>, mounting: Mounting<T>) -> Option<Seen<T>> {
    let ahead = plane::unit(pose.heading);
    let own = plane::mul_conj(row.target - pose.position, ahead);
    let upright = mounting.seen(row.bearing, row.elevation);
    let is_before = own.x > T::zero() && upright.ahead > T::zero();
    let u = own.x.recip();
    let by_pose = Vector3::new(ahead.x, ahead.y, -own.y) * (u * u);
    is_before.then_some(Seen {
        u,
        by_pose,
        upright,
        row: *row,
    })
}

/// Movement of the pose with pitch and roll, while the stops stay where they are. Nothing moves where too few rows tell.
#[inline(never)] // for less stack
fn moves<T: Real>(
    pose: &Pose<T>,
    rows: &[Row<T>],
    mounting: Mounting<T>,
) -> Option<[Vector3<T>; 2]> {
    let mut normal = Matrix3::<T>::zeros();
    let mut right = [Vector3::<T>::zeros(); 2];
    let mut count = 0;
    for seen in rows.iter().filter_map(|row| seen(pose, row, mounting)) {
        let to = seen.row.target - pose.position;
        let range2 = plane::dot(to, to);
        let across = plane::quarter_turn(to) / range2;
        // The azimuth of the target less the heading is that of the upright direction.
        let by_pose = Vector3::new(-across.x, -across.y, -T::one());
        let weight = (seen.row.sigma * seen.row.sigma + seen.row.target_variance / range2).recip();
        add_outer(normal.as_mut_slice(), by_pose.as_slice(), weight);
        for (right, change) in right.iter_mut().zip(mounting.by_angles(&seen.upright)) {
            *right += by_pose * (seen.upright.turn(&change) * weight);
        }
        count += 1;
    }
    if count < FEWEST {
        return Some([Vector3::zeros(); 2]);
    }
    // What was given does not move.
    for (i, variance) in pose.covariance.diagonal().iter().enumerate() {
        if *variance == T::zero() {
            for (n, entry) in normal.as_mut_slice().iter_mut().enumerate() {
                if n == 4 * i {
                    *entry = T::one();
                } else if n / 3 == i || n % 3 == i {
                    *entry = T::zero();
                }
            }
            for right in right.iter_mut().filter_map(|right| right.get_mut(i)) {
                *right = T::zero();
            }
        }
    }
    let factor = Cholesky::new(normal);
    let moved = factor.map(|factor| right.map(|right| factor.solve(&right)));
    Some(moved.unwrap_or([Vector3::zeros(); 2]))
}

/// Fits all unknowns, where errors of the pose count as at this height.
#[inline(never)] // for less stack
fn fitted<T: Real>(
    pose: &Pose<T>,
    rows: &[Row<T>],
    mounting: Mounting<T>,
    moves: [Vector3<T>; 2],
    (tolerance, pitch_sigma, height): (&Tolerance<T>, T, T),
) -> Option<Fitted<T>> {
    let root = semi_definite_root(&pose.covariance);
    let (mut matrix, mut right) = (
        SMatrix::<T, UNKNOWNS, UNKNOWNS>::zeros(),
        SVector::<T, UNKNOWNS>::zeros(),
    );
    let (mut count, mut sum, mut farthest) = (0, T::zero(), T::zero());
    for seen in rows.iter().filter_map(|row| seen(pose, row, mounting)) {
        let Seen {
            u,
            by_pose,
            upright,
            row,
        } = seen;
        let b = upright.up / upright.ahead;
        let q = T::one() + b * b;
        let by_angle = mounting
            .by_angles(&upright)
            .map(|change| (change.up - b * change.ahead) / upright.ahead);
        // The row changes by the angle, and by the place that changes with it.
        let [pitch, roll] = [0, 1].map(|n| {
            let (by_angle, moved) = (by_angle.get(n), moves.get(n));
            let moved =
                moved.map_or_else(T::zero, |moved| dot(moved.as_slice(), by_pose.as_slice()));
            -by_angle.copied().unwrap_or_else(T::zero) - moved * height
        });
        let [x, y, turn] = root.map(|column| -dot(&column, by_pose.as_slice()) * height);
        let design = [-u, pitch, roll, x, y, turn];
        let of_place = height * u * u;
        let variance = row.sigma * row.sigma * q * q
            + tolerance.bob * tolerance.bob * u * u
            + of_place * of_place * row.target_variance;
        let weight = variance.recip();
        add_outer(matrix.as_mut_slice(), &design, weight);
        for (to, entry) in right.iter_mut().zip(design) {
            *to += entry * b * weight;
        }
        sum += b * b * weight;
        farthest = farthest.max(u.recip());
        count += 1;
    }
    // What is believed beforehand: any height, and pitch and roll in all.
    let zero = T::zero();
    let sigmas = [farthest * lit(ANY_HEIGHT), pitch_sigma, tolerance.tilt];
    let means = [zero, -mounting.pitch, -mounting.roll];
    let pivots = matrix.as_mut_slice().iter_mut().step_by(UNKNOWNS + 1);
    for (i, (pivot, right)) in pivots.zip(right.iter_mut()).enumerate() {
        let sigma = sigmas.get(i).copied().unwrap_or_else(T::one);
        let mean = means.get(i).copied().unwrap_or(zero);
        let weight = (sigma * sigma).recip();
        *pivot += weight;
        *right += mean * weight;
        sum += mean * mean * weight;
    }
    let factor = Cholesky::new(matrix).filter(|_| count > 0)?;
    let found = factor.solve(&right);
    let inverse = factor.inverse();
    Some(Fitted {
        rows: count,
        chi_squared: at_least_zero(sum - dot(found.as_slice(), right.as_slice())),
        height: found.x,
        pitch: found.y,
        roll: found.z,
        spread: inverse.fixed_view::<3, 3>(0, 0).into_owned(),
        moves,
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
