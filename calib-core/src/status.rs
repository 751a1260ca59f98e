//! Status of a camera: one word, everywhere.

use core::fmt;

use crate::{
    Pose, Real, Refusal,
    fit::{Fit, RARE},
    numerics::real::lit,
};

/// Status of a camera. Only [`Status::Calibrated`] counts as calibrated, anywhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Status {
    /// It has a pose, whose predicted sigmas are within the limits, and the sightings fit it.
    Calibrated,
    /// It has a pose, and the sightings fit it, but a predicted sigma is above its limit: more
    /// sightings are wanted.
    Weak,
    /// It has a pose, but neither the pose nor its sigmas can be relied on, however small these are:
    /// its sightings contradict it, so that a sighting, the lens or a sigma is wrong; or they allow
    /// [another place](crate::resection::alternative) far off.
    Doubtful,
    /// Its sightings give no pose; a [`Refusal`] says why.
    Refused,
    /// It has fewer sightings than a pose needs, or has not told anything yet.
    Waiting,
}

impl Status {
    /// Status of a pose and of the fit of its sightings.
    pub fn of<T: Real>(pose: &Pose<T>, fit: &Fit<T>, limits: &Limits<T>) -> Self {
        if fit.is_bad() {
            Self::Doubtful
        } else if limits.allow(pose) {
            Self::Calibrated
        } else {
            Self::Weak
        }
    }

    /// The status in one lower-case word, as it stands in files. Stable.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Calibrated => "calibrated",
            Self::Weak => "weak",
            Self::Doubtful => "doubtful",
            Self::Refused => "refused",
            Self::Waiting => "waiting",
        }
    }
}

impl From<Refusal> for Status {
    /// Too few sightings are waited for; anything else is refused.
    fn from(refusal: Refusal) -> Self {
        match refusal {
            Refusal::TooFew => Self::Waiting,
            _ => Self::Refused,
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The predicted sigmas that a pose may have; infinite for any.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits<T> {
    /// Most of [`Pose::sigma_position`].
    pub position: T,
    /// Most of [`Pose::sigma_heading`], radians.
    pub heading: T,
}

impl<T: Real> Limits<T> {
    /// Returns true if a pose is as certain as that.
    pub fn allow(&self, pose: &Pose<T>) -> bool {
        pose.sigma_position() <= self.position && pose.sigma_heading() <= self.heading
    }

    /// Returns true if a pose with these protection levels is checked: with one wrong measurement it errs no more
    /// than the least certain pose that is allowed may err by chance.
    pub fn tolerate(&self, position: T, heading: T) -> bool {
        let rare = lit::<T>(RARE);
        position <= self.position * rare && heading <= self.heading * rare
    }
}
