//! Steps added to a place, with the covariance of the result.

use core::fmt;

use nalgebra::{Matrix2, Point2, Vector2};

use super::{Place, PlaceParts};
use crate::{
    Real,
    numerics::{covariance::is_covariance, plane, real::lit},
};

/// One step: `P e^{j theta}` (thesis 2.6.1), with errors that no other step shares.
///
/// Errors that all steps share belong to [`Systematic`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Step<T> {
    /// Length, in the unit of the world, zero or above.
    pub distance: T,
    /// Direction, radians counter-clockwise from the world's x axis; any finite value.
    pub heading: T,
    /// Standard deviation of the distance, zero or above.
    pub distance_sigma: T,
    /// Standard deviation of the heading, radians, zero or above.
    ///
    /// Where successive headings err together for some time, give the sigma that independent
    /// errors would need for the same growth over many steps.
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
    /// misalignment of the sensor on the body, the rest of hard iron. Default 0.05 (3 degrees), about as much
    /// as a sensor strapped on by eye and a calibrated compass leave.
    pub heading_sigma: T,
    /// Standard deviation of the constant relative error of step lengths. Default 0.08: a step
    /// length model that was not calibrated for the person. About 0.03 after a walk of known length,
    /// if the pace stays.
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

    pub(super) fn check(&self) -> Result<(), TrackError> {
        let sigmas = [self.heading_sigma, self.scale_sigma];
        if !sigmas.iter().all(T::is_finite) {
            return Err(TrackError::NotFinite);
        }
        if sigmas.iter().any(|&sigma| sigma < T::zero()) {
            return Err(TrackError::Negative);
        }
        Ok(())
    }

    /// Cross-covariance of two displacements of one walk, each with its sigmas. These are equal
    /// unless a sensor was calibrated in between; the product keeps the joint covariance one.
    pub fn covariance_with(&self, way: Vector2<T>, other: &Self, its: Vector2<T>) -> Matrix2<T> {
        let turned = plane::quarter_turn(way) * plane::quarter_turn(its).transpose();
        turned * (self.heading_sigma * other.heading_sigma)
            + way * its.transpose() * (self.scale_sigma * other.scale_sigma)
    }

    /// Covariance of a displacement.
    pub fn covariance(&self, way: Vector2<T>) -> Matrix2<T> {
        self.covariance_with(way, self, way)
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

/// Steps, and the covariance of their independent errors.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Odometer<T: Real> {
    walked: Vector2<T>,
    random: Matrix2<T>,
}

impl<T: Real> Odometer<T> {
    fn zero() -> Self {
        Self {
            walked: Vector2::zeros(),
            random: Matrix2::zeros(),
        }
    }

    fn add(&mut self, step: &Step<T>) {
        self.walked += step.displacement();
        self.random += step.covariance();
    }
}

/// A target that walks: where it is, and how sure that is. Its [`place`](Track::place) at a stop can
/// be sent; a copy of it at the stop also gives the [way between](Track::since) two stops of one fix.
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
    since_fix: Odometer<T>,
}

/// Reason why a step, a fix or a place was not taken. A track is as it was before.
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
            Self::NotFinite => {
                "a number of the step, fix or place is not finite, or too large to add"
            }
            Self::Negative => "a distance and a sigma must not be below zero",
            Self::NotACovariance => "a covariance must be symmetric and positive semi-definite",
        })
    }
}

impl core::error::Error for TrackError {}

/// At the origin, which it knows exactly, with steps that share no error.
impl<T: Real> Default for Track<T> {
    fn default() -> Self {
        Self {
            systematic: Systematic::none(),
            fixes: 1,
            fix_position: Point2::origin(),
            fix_covariance: Matrix2::zeros(),
            since_fix: Odometer::zero(),
        }
    }
}

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
        let mut track = Self::default();
        track.relocate(position, covariance, systematic)?;
        Ok(track)
    }

    /// The same with its present fix numbered `fix`, and the next ones after it: a random number,
    /// where others keep places of a walk that this target has forgotten.
    #[must_use]
    pub fn numbered(self, fix: u32) -> Self {
        Self { fixes: fix, ..self }
    }

    /// Goes on from a place that this or another track told of, as if it had never stopped:
    /// later places of the two share their errors.
    pub fn resume(place: &Place<T>) -> Self {
        let parts = place.parts();
        let matrix = |&[xx, xy, yy]: &[T; 3]| Matrix2::new(xx, xy, xy, yy);
        Self {
            systematic: parts.systematic,
            fixes: parts.fix,
            fix_position: parts.position - parts.walked,
            fix_covariance: matrix(&parts.fix_covariance),
            since_fix: Odometer {
                walked: parts.walked,
                random: matrix(&parts.step_covariance),
            },
        }
    }

    /// Adds a step.
    ///
    /// # Errors
    /// A number that is not finite or a distance or sigma below zero.
    pub fn advance(&mut self, step: &Step<T>) -> Result<(), TrackError> {
        step.check()?;
        let mut next = *self;
        next.since_fix.add(step);
        next.keep_if_finite(self)
    }

    /// The target was found again, for example by the reference cameras: the errors of all steps
    /// so far are forgotten, and those to come are `systematic` in this way. Also where it is taken
    /// to another frame.
    ///
    /// # Errors
    /// A number that is not finite, a sigma below zero, a matrix that is no covariance.
    pub fn relocate(
        &mut self,
        position: Point2<T>,
        covariance: Matrix2<T>,
        systematic: Systematic<T>,
    ) -> Result<(), TrackError> {
        systematic.check()?;
        if !(position.coords.iter().all(T::is_finite) && covariance.iter().all(T::is_finite)) {
            return Err(TrackError::NotFinite);
        }
        if !is_covariance(&covariance) {
            return Err(TrackError::NotACovariance);
        }
        let next = Self {
            systematic,
            fixes: self.fixes.wrapping_add(1),
            fix_position: position,
            fix_covariance: covariance,
            since_fix: Odometer::zero(),
        };
        next.keep_if_finite(self)
    }

    fn keep_if_finite(self, kept: &mut Self) -> Result<(), TrackError> {
        let walked = &self.since_fix;
        let sum = self.position().coords.sum()
            + self.covariance().sum()
            + walked.walked.sum()
            + walked.random.sum();
        if !sum.is_finite() {
            return Err(TrackError::NotFinite);
        }
        *kept = self;
        Ok(())
    }

    /// The place where the target is now, of which the carrier stands within `standing_sigma` in
    /// x as in y: a stop, to be sent.
    ///
    /// # Errors
    /// A sigma that is not finite, too large to square, or below zero.
    pub fn place(&self, standing_sigma: T) -> Result<Place<T>, TrackError> {
        self.reckoned().standing_within(standing_sigma)
    }

    /// The place as if the carrier stood right on it.
    fn reckoned(&self) -> Place<T> {
        let triangle = |m: &Matrix2<T>| [m.m11, m.m21, m.m22];
        Place::of_track(PlaceParts {
            position: self.fix_position + self.since_fix.walked,
            fix: self.fixes,
            fix_covariance: triangle(&self.fix_covariance),
            step_covariance: triangle(&self.since_fix.random),
            walked: self.since_fix.walked,
            systematic: self.systematic,
            standing_sigma: T::zero(),
        })
    }

    /// Where the target is.
    pub fn position(&self) -> Point2<T> {
        self.reckoned().position()
    }

    /// Covariance of [`Track::position`], symmetric.
    pub fn covariance(&self) -> Matrix2<T> {
        self.reckoned().covariance()
    }

    /// Cross-covariance of two stops of one walk, see [`Place::covariance_with`].
    pub fn covariance_with(&self, other: &Self) -> Matrix2<T> {
        self.reckoned().covariance_with(&other.reckoned())
    }

    /// Makes it what it was before it came this way: [`since`](Self::since) that a copy from here came as far, with the
    /// covariance of `way` and the systematic one of the present fix.
    pub fn go_back(&mut self, way: &Displacement<T>) {
        self.since_fix.walked -= way.vector;
        self.since_fix.random -= way.covariance;
    }

    /// The way from an earlier copy of this track to here, by the steps alone. None if the target
    /// was found in between: a fix makes it forget the way before.
    pub fn since(&self, earlier: &Self) -> Option<Displacement<T>> {
        if self.fixes != earlier.fixes {
            return None;
        }
        let (now, then) = (&self.since_fix, &earlier.since_fix);
        let vector = now.walked - then.walked;
        Some(Displacement {
            vector,
            covariance: now.random - then.random + self.systematic.covariance(vector),
        })
    }
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for Track<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        self.reckoned().format(f);
    }
}
