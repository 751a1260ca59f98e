//! Reasons why there is no answer.

use core::fmt;

/// Reason why a pose cannot be told from these sightings, or a place from these bearings.
///
/// The texts say what to do about it; [`Refusal::name`] is for machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Refusal {
    /// Fewer sightings, or stops, than unknowns need.
    TooFew,
    /// Two of three targets stand on the same place, or two of two stops do.
    CoincidentTargets,
    /// The camera stands, as far as the arithmetic can tell, on the circle through the targets.
    /// There every place of the circle explains the bearings equally well.
    DangerCircle,
    /// The same for targets on one line, with the camera on it too; or for two cameras on one line
    /// with a target.
    DangerLine,
    /// At the minimum some unknown makes no difference to the bearings.
    Undetermined,
    /// The only pose that fits has a target behind the camera, opposite to the ray it was seen
    /// along. Usually a sighting is wrong or belongs to another target.
    TargetBehind,
    /// An input is not a finite number, a ray has no direction, or a sigma is not above zero.
    NotFinite,
    /// The iteration did not reach a minimum.
    DidNotConverge,
    /// The sightings contradict each other. Where wrong ones may be left out, no majority of at
    /// least four agrees.
    Inconsistent,
}

impl Refusal {
    /// The reason in `snake_case`, as it stands in files. Stable.
    pub const fn name(self) -> &'static str {
        match self {
            Self::TooFew => "too_few",
            Self::CoincidentTargets => "coincident_targets",
            Self::DangerCircle => "danger_circle",
            Self::DangerLine => "danger_line",
            Self::Undetermined => "undetermined",
            Self::TargetBehind => "target_behind",
            Self::NotFinite => "not_finite",
            Self::DidNotConverge => "did_not_converge",
            Self::Inconsistent => "inconsistent",
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooFew => "too few sightings: stop the target at more places",
            Self::CoincidentTargets => {
                "two sightings are of the same place: stop the target at another one"
            }
            Self::DangerCircle => {
                "the camera is on the circle through the targets: stop the target nearer or farther"
            }
            Self::DangerLine => {
                "the camera is on one line with the targets: stop the target beside that line"
            }
            Self::Undetermined => {
                "these stops leave something undetermined: stop the target elsewhere too"
            }
            Self::TargetBehind => {
                "the only pose that fits has a target behind the camera: take the wrong sighting out"
            }
            Self::NotFinite => "a number is not finite, a ray is zero or a sigma is not above zero: correct it",
            Self::DidNotConverge => "no pose fits these sightings well enough to settle on: stop the target elsewhere too",
            Self::Inconsistent => {
                "the sightings contradict each other: stop the target at more places"
            }
        })
    }
}

impl core::error::Error for Refusal {}
