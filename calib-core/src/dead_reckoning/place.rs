//! The place of one stop, in a form that can be sent.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{Systematic, TrackError};
use crate::{
    Real,
    numerics::{covariance::is_covariance, real::lit},
};

/// The numbers of a [`Place`], as they go into a message.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PlaceParts<T: Real> {
    /// Where the target is.
    pub position: Point2<T>,
    /// Number of the fix of the walk from which this place was reckoned. Places with the same number share
    /// the error of that fix.
    pub fix: u32,
    /// Covariance of that fix: `xx, xy, yy`.
    pub fix_covariance: [T; 3],
    /// Covariance of the independent errors of the steps since that fix: `xx, xy, yy`.
    pub step_covariance: [T; 3],
    /// Displacement since that fix.
    pub walked: Vector2<T>,
    /// The errors that all steps share, before and after the fix.
    pub systematic: Systematic<T>,
    /// Standard deviation, in x as in y, of the carrier's true place about the reckoned one. Own to each
    /// stop: it does not accumulate.
    pub standing_sigma: T,
}

/// Where a target stood at one stop, with the parts of its error kept apart, so that any two
/// places of one walk give their cross-covariance.
///
/// A target makes it with [`Track::place`](super::Track::place), sends its [`parts`](Place::parts),
/// and a camera makes it again with [`Place::new`]. The position errs, to first order, by
/// ```text
/// a + sum u_k + b j W + s W + z
/// ```
/// with the first four as in [`Track`](super::Track), and `z` from standing beside the place.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(
    feature = "serde",
    serde(
        try_from = "PlaceParts<T>",
        into = "PlaceParts<T>",
        bound(
            serialize = "T: Real + serde::Serialize",
            deserialize = "T: Real + serde::Deserialize<'de>"
        )
    )
)]
pub struct Place<T: Real>(PlaceParts<T>);

impl<T: Real> Place<T> {
    /// The place that these numbers describe.
    ///
    /// # Errors
    /// [`TrackError::NotFinite`] for a number that is not finite, or parts too large to add;
    /// [`TrackError::Negative`] for a sigma below zero; [`TrackError::NotACovariance`] for parts
    /// that are not positive semi-definite.
    pub fn new(parts: PlaceParts<T>) -> Result<Self, TrackError> {
        let place = Self(parts);
        parts.systematic.check()?;
        place.check_standing()?;
        let covariances = [parts.fix_covariance, parts.step_covariance];
        let mut numbers = parts.position.iter().chain(&parts.walked);
        if !(numbers.all(T::is_finite)
            && covariances.iter().flatten().all(T::is_finite)
            && place.covariance().sum().is_finite())
        {
            return Err(TrackError::NotFinite);
        }
        if !covariances.iter().all(|c| is_covariance(&symmetric(c))) {
            return Err(TrackError::NotACovariance);
        }
        Ok(place)
    }

    /// From a track, whose numbers are in order.
    pub(super) fn of_track(parts: PlaceParts<T>) -> Self {
        Self(parts)
    }

    /// The same place, stood on to within `sigma`.
    ///
    /// # Errors
    /// A sigma that is not finite, too large to square, or below zero.
    pub(super) fn standing_within(mut self, sigma: T) -> Result<Self, TrackError> {
        self.0.standing_sigma = sigma;
        self.check_standing()?;
        Ok(self)
    }

    fn check_standing(&self) -> Result<(), TrackError> {
        let sigma = self.0.standing_sigma;
        if sigma < T::zero() {
            return Err(TrackError::Negative);
        }
        if !self.covariance().trace().is_finite() {
            return Err(TrackError::NotFinite);
        }
        Ok(())
    }

    /// The numbers to send.
    pub fn parts(&self) -> &PlaceParts<T> {
        &self.0
    }

    /// Where the target is.
    pub fn position(&self) -> Point2<T> {
        self.0.position
    }

    /// Covariance of [`Place::position`], symmetric, with the part that comes from standing beside
    /// the place.
    pub fn covariance(&self) -> Matrix2<T> {
        self.covariance_with(self) + self.standing()
    }

    /// Cross-covariance `E[e_self e_other^T]` of the position errors of two different stops of one
    /// walk: all but the part from standing, which two stops do not share.
    ///
    /// Fixes count as independent of each other. Places of two targets have no cross-covariance;
    /// their numbers do not tell, the caller must.
    pub fn covariance_with(&self, other: &Self) -> Matrix2<T> {
        let (a, b) = (&self.0, &other.0);
        let systematic = a
            .systematic
            .covariance_with(a.walked, &b.systematic, b.walked);
        if steps_between(a, b).is_none() {
            return systematic;
        }
        let (earlier, _) = in_order(a, b);
        symmetric(&earlier.fix_covariance) + symmetric(&earlier.step_covariance) + systematic
    }

    /// The part of this place's covariance that it does not share with `first`: that of the walk between the
    /// two and of the standing at this one. All of it if a fix came in between, or if one walk cannot have
    /// made both.
    ///
    /// Meant for [`Sighting::target_covariance`](crate::Sighting::target_covariance), see the
    /// [module](crate::dead_reckoning#from-stops-to-a-cameras-pose).
    pub fn own_covariance(&self, first: &Self) -> Matrix2<T> {
        let (a, b) = (&self.0, &first.0);
        let Some(between) = steps_between(a, b) else {
            return self.covariance();
        };
        between + a.systematic.covariance(a.walked - b.walked) + self.standing()
    }

    fn standing(&self) -> Matrix2<T> {
        let sigma = self.0.standing_sigma;
        Matrix2::from_diagonal_element(sigma * sigma)
    }
}

/// The earlier and the later of two places of one fix. The trace never falls along a walk.
fn in_order<'a, T: Real>(
    a: &'a PlaceParts<T>,
    b: &'a PlaceParts<T>,
) -> (&'a PlaceParts<T>, &'a PlaceParts<T>) {
    let trace = |[xx, _, yy]: [T; 3]| xx + yy;
    if trace(a.step_covariance) <= trace(b.step_covariance) {
        (a, b)
    } else {
        (b, a)
    }
}

/// Covariance that the steps between two places add, if both are of one fix. A walk that was begun anew may
/// number its fixes as another one did. Two places are not of one walk where neither is less certain than the
/// other in every direction, for steps add up.
fn steps_between<T: Real>(a: &PlaceParts<T>, b: &PlaceParts<T>) -> Option<Matrix2<T>> {
    let (earlier, later) = in_order(a, b);
    let later = symmetric(&later.step_covariance);
    let between = later - symmetric(&earlier.step_covariance);
    // The loss by rounding over many small steps.
    let rounding = later.trace() * lit(1e-4);
    let [xx, yy] = [between.m11, between.m22].map(|v| v + rounding);
    let added = xx >= T::zero() && yy >= T::zero() && xx * yy >= between.m12 * between.m12;
    (a.fix == b.fix && added).then_some(between)
}

fn symmetric<T: Real>(&[xx, xy, yy]: &[T; 3]) -> Matrix2<T> {
    Matrix2::new(xx, xy, xy, yy)
}

impl<T: Real> TryFrom<PlaceParts<T>> for Place<T> {
    type Error = TrackError;

    fn try_from(parts: PlaceParts<T>) -> Result<Self, TrackError> {
        Self::new(parts)
    }
}

impl<T: Real> From<Place<T>> for PlaceParts<T> {
    fn from(place: Place<T>) -> Self {
        place.0
    }
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for PlaceParts<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(
            f,
            "({}, {}), ({}, {}) from fix {} of {}, steps {}, {}, standing {}",
            self.position.x,
            self.position.y,
            self.walked.x,
            self.walked.y,
            self.fix,
            self.fix_covariance,
            self.step_covariance,
            self.systematic,
            self.standing_sigma
        );
    }
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for Place<T> {
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
