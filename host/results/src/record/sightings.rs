//! Measurements of a network: enough to solve it again.
//!
//! Records have them since their nodes tell them; they are left out where they are not known. The same object
//! stands on its own in a file for `host-sim solve-network`, where everything but `bearings` may be left out.
//!
//! `ranges`, `visits` and `lens` are for further measurements; no node tells them yet.

use serde::{Deserialize, Serialize};

/// Measurements of one network.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sightings {
    /// Its number, from 1.
    #[serde(default = "first")]
    pub network: u16,
    /// The two cameras that define its frame; `null` where none were appointed.
    #[serde(default)]
    pub references: Option<References>,
    /// Accuracy of their places; left out where these are exact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub survey: Option<Surveyed>,
    /// Direction of the displacements' x axis in the frame whose x axis is the baseline, degrees;
    /// `null` where it is not known.
    #[serde(default)]
    pub frame_heading_deg: Option<f64>,
    /// Prior knowledge of those who carry targets.
    #[serde(default)]
    pub carriers: Vec<Carrier>,
    /// Bearings that cameras saw: references, calibrated and waiting cameras alike.
    pub bearings: Vec<Bearing>,
    /// Legs by which targets came to their stops.
    #[serde(default)]
    pub legs: Vec<Leg>,
    /// Distances of targets from cameras.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ranges: Vec<Range>,
    /// When targets stood on marks: places that can be found again.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub visits: Vec<Visit>,
    /// Prior knowledge of the cameras' lenses, if they are to be estimated too.
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
    /// Distance between them; `null` where it was not measured.
    #[serde(default)]
    pub baseline: Option<f64>,
}

/// Accuracy of the places of two references.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surveyed {
    /// Standard deviation of the distance between them, as a share of it.
    pub baseline_sigma: f64,
    /// Standard deviation of the place of each, along each axis.
    pub position_sigma: f64,
}

/// Prior knowledge of the carrier of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Carrier {
    /// The number of the target.
    pub target: u16,
    /// Standard deviation of the constant error of distances, as a share of them.
    pub systematic_scale: f64,
    /// Standard deviation of the constant error of directions, degrees.
    pub systematic_heading_deg: f64,
    /// Standing sigma of a target: standard deviation of its place, each axis, when a camera looks. Zero in
    /// records of before it, whose displacements' covariances have it.
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

/// Leg of a target from one stop to the next, as its carrier measured it.
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
    /// Covariance `xx, xy, yy` of this leg's own errors. The errors that all legs of a carrier share are not in
    /// it, see [`Carrier`].
    pub covariance: [f64; 3],
}

/// Distance of a target from a camera, for example by its size in the picture.
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

/// Stop of a target on a mark. The place of the mark need not be known: one that is visited twice closes a
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
    /// Distance beside it that the target may have stood: standard deviation along each axis, above 0.
    pub sigma: f64,
}

/// Prior knowledge of the lenses of pin-hole cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Standard deviation of every camera's focal length, as a share of it, above 0.
    pub sigma: f64,
    /// The field of view that bearings were decoded with, degrees; `null` where it is not known, or
    /// not the same for all.
    #[serde(default)]
    pub fov_deg: Option<f64>,
    /// Standard deviation of every camera's optical axis, degrees; 0 where it is where it is said to be.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub principal_deg: f64,
}
