//! Steps added to a place, with the covariance of the result.

use core::fmt;

use nalgebra::{Matrix2, Point2, Vector2};

use crate::{Real, plane, real::lit};

/// One step: `P e^{j theta}` (thesis 2.6.1), with errors that no other step shares.
///
/// What all steps share belongs to [`Systematic`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Step<T> {
    /// How far, in the unit of the world, zero or above.
    pub distance: T,
    /// Which way, radians counter-clockwise from the world's x axis; any finite value.
    pub heading: T,
    /// Standard deviation of the distance, zero or above.
    pub distance_sigma: T,
    /// Standard deviation of the heading, radians, zero or above.
    ///
    /// Where successive headings err together for some time, give the sigma that independent
    /// errors would need for the same growth over many steps; [`Pedestrian`](super::Pedestrian)
    /// does.
    pub heading_sigma: T,
}

impl<T: Real> Step<T> {
    /// The step as a vector of the world.
    pub fn displacement(&self) -> Vector2<T> {
        plane::unit(self.heading) * self.distance
    }

    /// Covariance of [`Step::displacement`], to first order: `R diag(s_d^2, d^2 s_h^2) R^T`.
    pub fn covariance(&self) -> Matrix2<T> {
        let along = plane::unit(self.heading);
        let across = plane::quarter_turn(along) * (self.distance * self.heading_sigma);
        let along = along * self.distance_sigma;
        along * along.transpose() + across * across.transpose()
    }

    fn check(&self) -> Result<(), TrackError> {
        let sizes = [self.distance, self.distance_sigma, self.heading_sigma];
        if !(self.heading.is_finite() && sizes.iter().all(T::is_finite)) {
            return Err(TrackError::NotFinite);
        }
        if sizes.iter().any(|&size| size < T::zero()) {
            return Err(TrackError::Negative);
        }
        Ok(())
    }
}

/// Errors that every step of a walk makes in the same way.
///
/// They do not average out: they turn and stretch the whole walk about its start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Systematic<T> {
    /// Standard deviation of the constant part of the heading error, radians: declination,
    /// misalignment of the sensor on the body, what is left of hard iron. Default 0.05 (3 degrees),
    /// about what a sensor strapped on by eye and a calibrated compass leave.
    pub heading_sigma: T,
    /// Standard deviation of the constant relative error of step lengths. Default 0.08: a step
    /// length model that was not calibrated for the person. About 0.03 after
    /// [`StepLength::calibrated`](super::StepLength::calibrated), if the pace stays.
    pub scale_sigma: T,
}

impl<T: Real> Default for Systematic<T> {
    fn default() -> Self {
        Self {
            heading_sigma: lit(0.05),
            scale_sigma: lit(0.08),
        }
    }
}

impl<T: Real> Systematic<T> {
    /// Steps that share no error at all.
    pub fn none() -> Self {
        Self {
            heading_sigma: T::zero(),
            scale_sigma: T::zero(),
        }
    }

    /// Cross-covariance of two displacements.
    fn covariance(&self, a: Vector2<T>, b: Vector2<T>) -> Matrix2<T> {
        let turned = plane::quarter_turn(a) * plane::quarter_turn(b).transpose();
        turned * (self.heading_sigma * self.heading_sigma)
            + a * b.transpose() * (self.scale_sigma * self.scale_sigma)
    }
}

/// A displacement between two stops.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Displacement<T: Real> {
    /// From the earlier stop to the later one.
    pub vector: Vector2<T>,
    /// Covariance of `vector`, symmetric; to first order.
    pub covariance: Matrix2<T>,
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for Displacement<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        let c = &self.covariance;
        defmt::write!(
            f,
            "({}, {}) covariance ({}, {}; {})",
            self.vector.x,
            self.vector.y,
            c.m11,
            c.m12,
            c.m22
        );
    }
}

/// All steps so far, and the covariance of their independent errors. Never reset, so that any two
/// stops can be compared.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Odometer<T: Real> {
    walked: Vector2<T>,
    random: Matrix2<T>,
}

impl<T: Real> Odometer<T> {
    fn since(&self, earlier: &Self) -> Self {
        Self {
            walked: self.walked - earlier.walked,
            random: self.random - earlier.random,
        }
    }
}

/// A target that walks: where it is, and how sure that is. A copy of it at a stop is the stop.
///
/// Its position errs, to first order, by
/// ```text
/// a + sum u_k + b j W + s W        W: the displacement since the last fix
/// ```
/// with `a` the error of the fix, `u_k` the independent errors of the steps, and one `b` and one
/// `s` for the whole walk. That `b` and `s` act through `W` alone is exact: a heading bias turns
/// every step by the same angle, so it turns their sum, and a scale error stretches it. The path
/// in between does not matter, and on a closed path both vanish (Kelly, "General solution for
/// linearized systematic error propagation in vehicle odometry", IROS 2001, has this for scale
/// errors; "Linearized error propagation in odometry", IJRR 23(2), 2004, the random part). The
/// four parts are kept apart, so that covariances of one stop and between any two are exact to
/// first order in the errors.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Track<T: Real> {
    systematic: Systematic<T>,
    fixes: u32,
    fix_position: Point2<T>,
    fix_covariance: Matrix2<T>,
    odometer_at_fix: Odometer<T>,
    odometer: Odometer<T>,
}

/// Why a step or a fix was not taken. The track is as it was before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum TrackError {
    /// A number is not finite, or the sum would not be.
    NotFinite,
    /// A distance or a sigma is below zero.
    Negative,
    /// The matrix is not symmetric and positive semi-definite.
    NotACovariance,
}

impl fmt::Display for TrackError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite => "a number of the step or fix is not finite, or too large to add",
            Self::Negative => "a distance and a sigma must not be below zero",
            Self::NotACovariance => "a covariance must be symmetric and positive semi-definite",
        })
    }
}

impl core::error::Error for TrackError {}

impl<T: Real> Track<T> {
    /// A target at a place known to within a covariance, which then walks with `systematic`
    /// errors. There is no start heading: each step brings its own.
    ///
    /// # Errors
    /// A number that is not finite, a sigma below zero, a matrix that is no covariance.
    pub fn start(
        position: Point2<T>,
        covariance: Matrix2<T>,
        systematic: Systematic<T>,
    ) -> Result<Self, TrackError> {
        let sigmas = [systematic.heading_sigma, systematic.scale_sigma];
        if !sigmas.iter().all(T::is_finite) {
            return Err(TrackError::NotFinite);
        }
        if sigmas.iter().any(|&sigma| sigma < T::zero()) {
            return Err(TrackError::Negative);
        }
        let nothing = Odometer {
            walked: Vector2::zeros(),
            random: Matrix2::zeros(),
        };
        let mut track = Self {
            systematic,
            fixes: 0,
            fix_position: Point2::origin(),
            fix_covariance: Matrix2::zeros(),
            odometer_at_fix: nothing,
            odometer: nothing,
        };
        track.relocate(position, covariance)?;
        Ok(track)
    }

    /// Adds a step.
    ///
    /// # Errors
    /// A number that is not finite or a distance or sigma below zero.
    pub fn advance(&mut self, step: &Step<T>) -> Result<(), TrackError> {
        step.check()?;
        let mut next = *self;
        next.odometer.walked += step.displacement();
        next.odometer.random += step.covariance();
        next.keep_if_finite(self)
    }

    /// The target was found again, for example by the reference cameras: the errors of all steps
    /// so far are forgotten. [`Track::since`] still works across it.
    ///
    /// # Errors
    /// A number that is not finite or a matrix that is no covariance.
    pub fn relocate(
        &mut self,
        position: Point2<T>,
        covariance: Matrix2<T>,
    ) -> Result<(), TrackError> {
        if !(position.coords.iter().all(T::is_finite) && covariance.iter().all(T::is_finite)) {
            return Err(TrackError::NotFinite);
        }
        if !is_covariance(&covariance) {
            return Err(TrackError::NotACovariance);
        }
        let mut next = *self;
        next.fixes = self.fixes.wrapping_add(1);
        next.fix_position = position;
        next.fix_covariance = covariance;
        next.odometer_at_fix = self.odometer;
        next.keep_if_finite(self)
    }

    fn keep_if_finite(self, kept: &mut Self) -> Result<(), TrackError> {
        let sum = self.position().coords.sum() + self.covariance().sum();
        if !sum.is_finite() {
            return Err(TrackError::NotFinite);
        }
        *kept = self;
        Ok(())
    }

    fn since_fix(&self) -> Odometer<T> {
        self.odometer.since(&self.odometer_at_fix)
    }

    /// Where the target is.
    pub fn position(&self) -> Point2<T> {
        self.fix_position + self.since_fix().walked
    }

    /// Covariance of [`Track::position`], symmetric.
    pub fn covariance(&self) -> Matrix2<T> {
        self.covariance_with(self)
    }

    /// Cross-covariance `E[e_self e_other^T]` of the position errors of two stops of one walk.
    ///
    /// Fixes count as independent of each other.
    pub fn covariance_with(&self, other: &Self) -> Matrix2<T> {
        let (a, b) = (self.since_fix(), other.since_fix());
        let systematic = self.systematic.covariance(a.walked, b.walked);
        if self.fixes != other.fixes {
            return systematic;
        }
        // Steps up to the earlier of the two are in both. The trace never falls along a walk.
        let common = if a.random.trace() <= b.random.trace() {
            a.random
        } else {
            b.random
        };
        self.fix_covariance + common + systematic
    }

    /// The way from an earlier copy of this track to here, by the steps alone: fixes, before or in
    /// between, change neither it nor its covariance.
    pub fn since(&self, earlier: &Self) -> Displacement<T> {
        let between = self.odometer.since(&earlier.odometer);
        Displacement {
            vector: between.walked,
            covariance: between.random + self.systematic.covariance(between.walked, between.walked),
        }
    }
}

/// Symmetric and positive semi-definite, but for rounding.
fn is_covariance<T: Real>(m: &Matrix2<T>) -> bool {
    let slack = lit::<T>(1e-4);
    let largest = m.m11.max(m.m22);
    m.m11 >= T::zero()
        && m.m22 >= T::zero()
        && (m.m12 - m.m21).abs() <= largest * slack
        && m.m12 * m.m12 <= m.m11 * m.m22 + largest * largest * slack
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for Track<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        let (p, c) = (self.position(), self.covariance());
        defmt::write!(
            f,
            "({}, {}) covariance ({}, {}; {})",
            p.x,
            p.y,
            c.m11,
            c.m12,
            c.m22
        );
    }
}
