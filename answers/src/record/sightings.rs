//! What was measured in a network: enough to solve it again.
//!
//! Records have it since their nodes tell it; it is left out where nobody knows. The same object
//! stands on its own in a file for `host-sim solve-network`, where everything but `bearings` may be
//! left out.
//!
//! `ranges`, `visits` and `lens` are for what was measured besides; no node tells them yet.

use serde::{Deserialize, Serialize};

/// What was measured in one network.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sightings {
    /// Its number, from 1.
    #[serde(default = "first")]
    pub network: u16,
    /// The two cameras that define its frame; `null` where none were appointed.
    #[serde(default)]
    pub references: Option<References>,
    /// Direction of the displacements' x axis in the frame whose x axis is the baseline, degrees;
    /// `null` where it is not known.
    #[serde(default)]
    pub frame_heading_deg: Option<f64>,
    /// What is known of those who carry targets.
    #[serde(default)]
    pub carriers: Vec<Carrier>,
    /// What cameras saw: references, calibrated and waiting cameras alike.
    pub bearings: Vec<Bearing>,
    /// How targets came to their stops.
    #[serde(default)]
    pub legs: Vec<Leg>,
    /// How far from cameras targets were.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ranges: Vec<Range>,
    /// When targets stood on marks: places that can be found again.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub visits: Vec<Visit>,
    /// What is known of the cameras' lenses, if they are to be estimated too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<Lens>,
}

fn first() -> u16 {
    1
}

/// The two cameras that define a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct References {
    /// Their numbers: the origin, and the one on the x axis.
    pub cameras: [u16; 2],
    /// How far they are apart; `null` where nobody measured that.
    #[serde(default)]
    pub baseline: Option<f64>,
}

/// What is known beforehand of somebody who carries a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Carrier {
    /// The number of the target.
    pub target: u16,
    /// Standard deviation of the constant error of distances, as a share of them.
    pub systematic_scale: f64,
    /// Standard deviation of the constant error of directions, degrees.
    pub systematic_heading_deg: f64,
    /// How still a target stands: standard deviation of its place, each axis, when a camera looks.
    /// Zero in records of before it, whose displacements' covariances have it.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub standing_sigma: f64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_zero(number: &f64) -> bool {
    *number == 0.0
}

/// In which direction a camera saw a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bearing {
    /// The number of the target.
    pub target: u16,
    /// At which of its stops. Stops are numbered in the order in which they were made.
    pub stop: u32,
    /// The number of the camera.
    pub camera: u16,
    /// From the optical axis, positive to the left.
    pub bearing_deg: f64,
    /// Its standard deviation.
    pub sigma_deg: f64,
}

/// How a target came to a stop from the one before, as its carrier measured it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Leg {
    /// The number of the target.
    pub target: u16,
    /// The stop that it leads to.
    pub stop: u32,
    /// The displacement, in the carrier's own frame.
    pub dx: f64,
    /// As `dx`.
    pub dy: f64,
    /// Covariance `xx, xy, yy` of what is this leg's own. What all legs of a carrier share is not in
    /// it, see [`Carrier`].
    pub covariance: [f64; 3],
}

/// How far from a camera a target was, for example by its size in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// The number of the target.
    pub target: u16,
    /// At which of its stops.
    pub stop: u32,
    /// The number of the camera.
    pub camera: u16,
    /// The distance, above 0.
    pub range: f64,
    /// Its standard deviation, above 0.
    pub sigma: f64,
}

/// A target stood on a mark. Where that is nobody needs to know: one that is visited twice closes a
/// loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Visit {
    /// The number of the target.
    pub target: u16,
    /// At which of its stops.
    pub stop: u32,
    /// The number of the mark.
    pub mark: u32,
    /// How far beside it the target may have stood: standard deviation along each axis, above 0.
    pub sigma: f64,
}

/// What is known of the lenses of pin-hole cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Standard deviation of every camera's focal length, as a share of it, above 0.
    pub sigma: f64,
    /// The field of view that bearings were decoded with, degrees; `null` where it is not known, or
    /// not the same for all.
    #[serde(default)]
    pub fov_deg: Option<f64>,
}
