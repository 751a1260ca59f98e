//! A network solved again from its measurements.
//!
//! Solves for all that its nodes estimate on the way, at once and in double precision: every camera, every
//! stop, the references' headings and the carrier, with covariances, protection levels and the
//! contradictions. See [`calib_core::joint`].
//!
//! Each target's walk is solved by itself, as the node that is carried solves it.
//!
//! Ranges, visits to marks and lenses, which nodes do not estimate yet, are taken where they are
//! measured.
//!
//! # Without displacements
//! Three or more cameras that saw targets together at five places or more are solved from their bearings
//! alone, up to scale: an opportunistic network. Stops of all targets then count together.
//!
//! # Scale
//! A known baseline sets the scale. If it is not known, the carrier's scale does: every length is then as
//! wrong as the carrier's distances are, and sigmas say so. Without displacements nothing sets it: lengths are
//! then in units of the baseline.

use std::collections::BTreeSet;

use calib_core::{
    Status,
    joint::{Lens, Standing},
};
use node_firmware::config::TargetConfig;
use serde::Serialize;

pub use crate::record::Protection;
use crate::record::{
    Estimate, Limits, NodeMount,
    sightings::{References, Sightings},
};

mod estimator;
mod opportunistic;
mod sparse;
#[cfg(test)]
mod tests;
mod walk;

use estimator::Depth;
use walk::Walk;

/// Settings, none of which is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Settings {
    /// Poses whose sigma of position is above this are weak. From bearings alone a tenth of the
    /// baseline if there is none: errors that large are not what sigmas say any more.
    pub max_sigma: Option<f64>,
    /// Estimate how large the errors of displacements are, rather than to believe what they claim.
    pub fit_legs: bool,
    /// Poses and places from all measurements as they are: nothing is looked for that contradicts, and no
    /// residual or protection level is told. Along walks with displacements.
    pub poses_only: bool,
}

impl Settings {
    const fn depth(&self) -> Depth {
        if self.poses_only {
            Depth::Answers
        } else {
            Depth::Checked {
                fit_legs: self.fit_legs,
            }
        }
    }
}

/// Source of the scale of a solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ScaleFrom {
    /// The known distance between the references.
    Baseline,
    /// The carrier's distances.
    Carrier,
    /// Nothing: lengths are in units of the distance between the references.
    Nothing,
}

/// A network as one target's walk tells it. Lengths are in the unit of the measurements, angles in
/// degrees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NetworkSolution {
    /// The network's number.
    pub network: u16,
    /// The target that walked; `null` where stops of several are solved together.
    pub target: Option<u16>,
    /// `calibrated`, `weak` (unchecked), `doubtful`, `refused` or `waiting`.
    pub status: Status,
    /// Why it is not calibrated: [`CONTRADICTORY`](Self::CONTRADICTORY),
    /// [`AMBIGUOUS`](Self::AMBIGUOUS), or the name of a refusal.
    pub reason: Option<&'static str>,
    /// The same for people.
    #[serde(skip)]
    pub advice: Option<String>,
    /// Source of the scale.
    pub scale_from: ScaleFrom,
    /// The cameras that define the frame: the origin, and the one on the x axis.
    pub references: Option<[u16; 2]>,
    /// Distance between them.
    pub baseline: Option<f64>,
    /// Zero where it was given.
    pub sigma_baseline: Option<f64>,
    /// All cameras by ascending number.
    pub cameras: Vec<Camera>,
    /// The target's stops.
    pub stops: Vec<Stop>,
    /// Stops without a place, and of no use for others: nothing ties them to the rest.
    pub left_out: Vec<u32>,
    /// Carrier of the target.
    pub carrier: Option<Carrier>,
    /// Measurements that contradicted the rest and were left out.
    pub findings: Vec<Finding>,
    /// Each bearing of a camera with a pose.
    pub bearings: Vec<BearingResidual>,
    /// Each range of a camera with a pose.
    pub ranges: Vec<RangeResidual>,
    /// Each measured displacement.
    pub legs: Vec<LegResidual>,
    /// By how much displacements err more than they claim; `null` unless that was estimated.
    pub leg_factor: Option<f64>,
    /// Sum of the squared residuals, each over its variance.
    pub chi_squared: Option<f64>,
    /// Measurements beyond the unknowns.
    pub degrees_of_freedom: usize,
}

/// One camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Camera {
    /// Its number.
    pub camera: u16,
    /// It defines the frame.
    pub reference: bool,
    /// Status of its pose.
    pub status: Status,
    /// Why it has none, or is doubtful.
    pub reason: Option<&'static str>,
    /// Its pose.
    pub estimate: Option<Estimate>,
    /// Most that the pose may be off because of one unnoticed wrong measurement: at most so much in 999 of
    /// 1,000 cases.
    pub protection: Option<Protection>,
    /// Share of an error that shows in the residual, of the least checked bearing.
    pub redundancy: Option<f64>,
    /// True if the protection level [is tolerated](Limits::tolerate): by a sigma of position up to the limit of
    /// a weak one, or a tenth of the baseline, and one of heading of 0.1 radians. A reference's is not asked.
    pub checked: bool,
    /// Its lens, where lenses were estimated.
    pub lens: Option<LensEstimate>,
    /// Its mounting, if it is not level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount: Option<NodeMount>,
    /// True if its bearings fit once left and right are exchanged: it hangs upside down, or its picture is mirrored.
    pub mirrored: bool,
    /// Number of bearings that it gave.
    pub bearings: usize,
    /// Number of bearings that count.
    pub used: usize,
}

/// Lens of a camera, estimated from what it saw.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LensEstimate {
    /// True tangents of bearings over those measured: above 1 where the true field of view is wider
    /// than the one that bearings were decoded with.
    pub factor: f64,
    /// Predicted standard deviation.
    pub sigma: f64,
    /// Distance of the estimate from 1, in sigmas of the estimate and of the given value together.
    pub off: f64,
    /// True if it is another lens, or another projection, than was given: off by more than 4.
    pub wrong: bool,
    /// The field of view, where the one that was given is known.
    pub fov_deg: Option<f64>,
    /// Predicted standard deviation.
    pub sigma_fov_deg: Option<f64>,
}

impl LensEstimate {
    fn new(lens: &Lens<f64>, given_deg: Option<f64>) -> Self {
        let tangent = given_deg.map(|given| (given.to_radians() / 2.0).tan());
        Self {
            factor: lens.scale,
            sigma: lens.sigma,
            off: lens.off,
            wrong: lens.is_wrong(),
            fov_deg: tangent.map(|tangent| (2.0 * (lens.scale * tangent).atan()).to_degrees()),
            sigma_fov_deg: tangent.map(|tangent| {
                let slope = 2.0 * tangent / (1.0 + (lens.scale * tangent).powi(2));
                (slope * lens.sigma).to_degrees()
            }),
        }
    }
}

/// Where a target stood.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stop {
    /// Of this target.
    pub target: u16,
    /// Its number.
    pub stop: u32,
    /// Where it was.
    pub x: f64,
    /// As `x`.
    pub y: f64,
    /// Predicted standard deviation of `x`.
    pub sigma_x: f64,
    /// Predicted standard deviation of `y`.
    pub sigma_y: f64,
    /// Covariance `xx, xy, yy`.
    pub covariance: [f64; 3],
}

/// Systematic errors of a carrier.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Carrier {
    /// Length that it reads over the true one.
    pub scale: f64,
    /// Predicted standard deviation.
    pub sigma_scale: f64,
    /// Direction that it reads less the true one, in the frame whose x axis is the baseline.
    pub compass_deg: f64,
    /// Predicted standard deviation.
    pub sigma_compass_deg: f64,
}

/// Measurement that contradicts the rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Finding {
    /// One bearing.
    Bearing {
        /// Of this target.
        target: u16,
        /// At this stop.
        stop: u32,
        /// By this camera.
        camera: u16,
        /// Sigmas that it is off.
        off: f64,
    },
    /// One range.
    Range {
        /// Of this target.
        target: u16,
        /// At this stop.
        stop: u32,
        /// By this camera.
        camera: u16,
        /// Sigmas that it is off.
        off: f64,
    },
    /// The displacement to a stop: the carrier slipped, or a step was not counted.
    Leg {
        /// Of this target.
        target: u16,
        /// The stop that it leads to.
        stop: u32,
        /// By how much, as chi squared.
        chi_squared: f64,
    },
    /// All that a camera saw from a stop on: it was moved, or is stuck.
    Camera {
        /// The camera.
        camera: u16,
        /// The first stop at which it is off.
        from: u32,
        /// By how much, as chi squared.
        chi_squared: f64,
    },
}

/// Residual of a bearing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BearingResidual {
    /// Of this target.
    pub target: u16,
    /// At this stop.
    pub stop: u32,
    /// By this camera.
    pub camera: u16,
    /// Foretold less measured.
    pub residual_deg: f64,
    /// Share of its error that shows in the residual: 0 where nothing checks it.
    pub redundancy: f64,
    /// The residual over its standard deviation; `null` where nothing checks it.
    pub normalised: Option<f64>,
    /// Standing of the bearing: it counts, or is left out.
    pub standing: &'static str,
}

/// Residual of a range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RangeResidual {
    /// Of this target.
    pub target: u16,
    /// At this stop.
    pub stop: u32,
    /// By this camera.
    pub camera: u16,
    /// Foretold less measured.
    pub residual: f64,
    /// Share of its error that shows in the residual: 0 where nothing checks it.
    pub redundancy: f64,
    /// The residual over its standard deviation; `null` where nothing checks it.
    pub normalised: Option<f64>,
    /// Standing of the range: it counts, or is left out.
    pub standing: &'static str,
}

/// Residual of a displacement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LegResidual {
    /// Of this target.
    pub target: u16,
    /// The stop that it leads to.
    pub stop: u32,
    /// Chi squared of the checked directions.
    pub chi_squared: f64,
    /// Number of directions that are checked: 2, 1 or 0.
    pub degrees_of_freedom: usize,
    /// Standing of the displacement: it counts, or is left out.
    pub standing: &'static str,
}

/// Why measurements cannot be solved at all: they are not complete.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// No bearing.
    #[error("has no bearings")]
    NoBearings,
    /// No references define the frame.
    #[error("names no references: say which two cameras define the frame, with --references")]
    NoReferences,
    /// A camera that defines the frame has no bearing.
    #[error(
        "has no bearing of camera {0}, which is to define the frame: name two cameras that saw the target"
    )]
    NeverSaw(u16),
    /// A camera without a heading, or none at all.
    #[error(
        "has no bearing of camera {0}, but a range of it at stop {1}: correct its number, or leave the \
         range out"
    )]
    OnlyRange(u16, u32),
    /// One camera twice.
    #[error("names camera {0} as both references: name two cameras")]
    OneReference(u16),
    /// Ranges or visits without displacements.
    #[error(
        "has {0} and no displacements: without those only bearings are solved, as --bearings-only \
         does"
    )]
    NoWalk(&'static str),
    /// Ranges without a baseline: both would set the scale.
    #[error("has ranges, and the baseline is not known: say how long it is with --baseline")]
    RangesWithoutBaseline,
    /// A number is not finite, or a sigma or length not above zero.
    #[error("{0}: correct it")]
    Number(String),
    /// More than the largest estimator takes.
    #[error(
        "has {cameras} cameras and {stops} stops of target {target}: at most {most} of each can be \
         solved at once"
    )]
    TooMany {
        /// Of this target.
        target: u16,
        /// Number of cameras.
        cameras: usize,
        /// As `cameras`.
        stops: usize,
        /// Most that is allowed of each.
        most: usize,
    },
}

impl NetworkSolution {
    /// Reason of doubt: the measurements do not fit, though what contradicted most was left out.
    pub const CONTRADICTORY: &'static str = "contradictory";
    /// Reason of doubt: another solution is not ruled out.
    pub const AMBIGUOUS: &'static str = "ambiguous";
    /// Reason of doubt: the steps of the carrier contradict the told baseline.
    pub const BASELINE: &'static str = "baseline_or_steps";
    /// Why an answer is weak: there are no more measurements than unknowns, so that any would fit.
    pub const UNCHECKED: &'static str = "unchecked";

    /// Returns true if there are poses, and the measurements that count do not speak against them.
    pub fn is_good(&self) -> bool {
        matches!(self.status, Status::Calibrated | Status::Weak)
    }
}

/// Solves a network, once for each target that walked; without displacements once.
///
/// # Errors
/// [`NetworkError`]. Measurements that are complete, but have no solution, are
/// [`refused`](NetworkSolution::status).
pub fn solve(
    sightings: &Sightings,
    settings: &Settings,
) -> Result<Vec<NetworkSolution>, NetworkError> {
    check(sightings)?;
    if sightings.legs.is_empty() {
        let besides = [
            ("ranges", !sightings.ranges.is_empty()),
            ("visits", !sightings.visits.is_empty()),
            ("a lens to estimate", sightings.lens.is_some()),
        ];
        if let Some((what, _)) = besides.into_iter().find(|(_, is_there)| *is_there) {
            return Err(NetworkError::NoWalk(what));
        }
        return Ok(vec![opportunistic::solve(sightings, settings)?]);
    }
    let references = sightings.references.ok_or(NetworkError::NoReferences)?;
    if !sightings.ranges.is_empty() && references.baseline.is_none() {
        return Err(NetworkError::RangesWithoutBaseline);
    }
    let [first, second] = references.cameras;
    let mut cameras = vec![first, second];
    let seen = sightings.bearings.iter().map(|seen| seen.camera);
    let others: BTreeSet<_> = seen.collect();
    cameras.extend(
        others
            .into_iter()
            .filter(|id| !references.cameras.contains(id)),
    );
    let targets: BTreeSet<_> = sightings.legs.iter().map(|leg| leg.target).collect();
    targets
        .into_iter()
        .map(|target| {
            let mut solution = Walk::new(sightings, target, &cameras).solve(settings)?;
            if contradicts_steps(sightings, target, &solution) {
                solution.doubt();
            }
            Ok(solution)
        })
        .collect()
}

/// Sigmas beyond which the steps of the carrier contradict the told baseline.
const CONTRADICTS: f64 = 5.0;

/// Returns true if the lengths of the carrier's steps and the told baseline contradict each other: nothing else tells
/// which of them is wrong.
fn contradicts_steps(sightings: &Sightings, target: u16, solution: &NetworkSolution) -> bool {
    let told = sightings.carriers.iter().find(|of| of.target == target);
    let (Some(told), Some(carrier)) = (told, &solution.carrier) else {
        return false;
    };
    let survey = { sightings.survey }.map_or(0.0, |survey| survey.baseline_sigma);
    let sigma = told
        .systematic_scale
        .hypot(survey)
        .hypot(carrier.sigma_scale);
    let is_known = { sightings.references }.is_some_and(|of| of.baseline.is_some());
    is_known && (carrier.scale - 1.0).abs() > CONTRADICTS * sigma
}

impl NetworkSolution {
    /// Neither the baseline nor the steps are sure, and so is no pose.
    fn doubt(&mut self) {
        let is_told = |status| [Status::Calibrated, Status::Weak].contains(&status);
        if is_told(self.status) {
            (self.status, self.reason) = (Status::Doubtful, Some(Self::BASELINE));
        }
        for camera in &mut self.cameras {
            if is_told(camera.status) {
                (camera.status, camera.reason) = (Status::Doubtful, Some(Self::BASELINE));
            }
        }
    }
}

/// Leaves out bearings that are there already: of the same camera at the same stop, with the same value. They are no
/// measurements of their own, be it that a file is in it twice or that a column was rounded twice. Returns their number.
pub fn leave_out_repeated(sightings: &mut Sightings) -> usize {
    let before = sightings.bearings.len();
    let mut known = BTreeSet::new();
    sightings.bearings.retain(|seen| {
        let value = (seen.bearing_deg.to_bits(), seen.sigma_deg.to_bits());
        known.insert((seen.target, seen.stop, seen.camera, value))
    });
    before - sightings.bearings.len()
}

fn check(sightings: &Sightings) -> Result<(), NetworkError> {
    if sightings.bearings.is_empty() {
        return Err(NetworkError::NoBearings);
    }
    if let Some(References {
        cameras: [first, second],
        ..
    }) = sightings.references
        && first == second
    {
        return Err(NetworkError::OneReference(first));
    }
    let has_bearing = |camera| sightings.bearings.iter().any(|seen| seen.camera == camera);
    if let Some(far) = sightings.ranges.iter().find(|far| !has_bearing(far.camera)) {
        return Err(NetworkError::OnlyRange(far.camera, far.stop));
    }
    let wrong = |what: String| Err(NetworkError::Number(what));
    for seen in &sightings.bearings {
        if !(seen.bearing_deg.is_finite() && seen.sigma_deg.is_finite() && seen.sigma_deg > 0.0) {
            return wrong(format!(
                "camera {} at stop {} of target {}: its bearing must be finite, and its sigma above 0",
                seen.camera, seen.stop, seen.target
            ));
        }
    }
    let mut ways = BTreeSet::new();
    if let Some(leg) = { sightings.legs.iter() }.find(|leg| !ways.insert((leg.target, leg.stop))) {
        return wrong(format!(
            "stop {} of target {} has two displacements",
            leg.stop, leg.target
        ));
    }
    let is_length = |number: f64| number.is_finite() && number > 0.0;
    let seen = sightings
        .bearings
        .iter()
        .map(|seen| (seen.target, seen.stop));
    let visits = sightings.visits.iter().map(|on| (on.target, on.stop));
    let known: BTreeSet<_> = seen.chain(ways).collect();
    let targets: BTreeSet<_> = known.iter().map(|(target, _)| *target).collect();
    let mut strange = visits
        .clone()
        .filter(|(target, _)| !targets.contains(target));
    let mut far = sightings.ranges.iter().map(|far| (far.target, far.stop));
    let strange = strange.next().or_else(|| {
        far.find(|far| !known.contains(far) && !visits.clone().any(|visit| visit == *far))
    });
    if let Some((target, stop)) = strange {
        return wrong(format!(
            "a range or a visit is of stop {stop} of target {target}, which nothing else is of: check both numbers"
        ));
    }
    for far in &sightings.ranges {
        if !(is_length(far.range) && is_length(far.sigma)) {
            return wrong(format!(
                "camera {} at stop {} of target {}: its range and its sigma must be above 0",
                far.camera, far.stop, far.target
            ));
        }
    }
    for on in &sightings.visits {
        if !is_length(on.sigma) {
            return wrong(format!(
                "the visit of target {} to mark {} at stop {}: its sigma must be above 0",
                on.target, on.mark, on.stop
            ));
        }
    }
    if let Some(lens) = sightings.lens {
        let is_view = |view: f64| view > 0.0 && view < 180.0;
        let is_known =
            lens.fov_deg.is_none_or(is_view) && (0.0..90.0).contains(&lens.principal_deg);
        if !is_length(lens.sigma) || !is_known {
            return wrong(
                "the lens: its sigma must be above 0, its field of view between 0 and 180 degrees, and the sigma of \
                 its axis, `principal_deg`, 0 to 90 degrees"
                    .to_owned(),
            );
        }
    }
    for leg in &sightings.legs {
        let [xx, xy, yy] = leg.covariance;
        let numbers = [leg.dx, leg.dy, xx, xy, yy];
        let is_covariance = xx >= 0.0 && yy >= 0.0 && xy * xy <= xx * yy * (1.0 + 1e-9);
        if !numbers.iter().all(|number| number.is_finite()) || !is_covariance {
            return wrong(format!(
                "the displacement to stop {} of target {}: it must be finite, and its covariance one",
                leg.stop, leg.target
            ));
        }
    }
    for carrier in &sightings.carriers {
        let sigmas = [
            carrier.systematic_scale,
            carrier.systematic_heading_deg,
            carrier.standing_sigma,
        ];
        if !sigmas
            .iter()
            .all(|sigma| sigma.is_finite() && *sigma >= 0.0)
        {
            return wrong(format!(
                "what is known of the carrier of target {}: no sigma is below 0",
                carrier.target
            ));
        }
    }
    let lengths = sightings
        .references
        .and_then(|references| references.baseline);
    if lengths.is_some_and(|length| !(length.is_finite() && length > 0.0)) {
        return wrong("the baseline: it must be above 0".to_owned());
    }
    if sightings
        .frame_heading_deg
        .is_some_and(|heading| !heading.is_finite())
    {
        return wrong("the frame heading: it must be finite".to_owned());
    }
    Ok(())
}

/// Returns the carrier that targets assume where the measurements say nothing of it.
pub fn usual_carrier(target: u16) -> crate::record::sightings::Carrier {
    let usual = TargetConfig::default();
    crate::record::sightings::Carrier {
        target,
        systematic_scale: usual.systematic_scale.into(),
        systematic_heading_deg: usual.systematic_heading_deg.into(),
        // If the measurements say nothing of it, the displacements have it.
        standing_sigma: 0.0,
    }
}

/// Larger sigmas, in baselines and radians, are no longer those of linear equations.
const MOST_SIGMA: f64 = 0.1;

/// Limits of a good pose where the settings give none.
fn limits(settings: &Settings, baseline: f64) -> Limits {
    Limits {
        sigma_position: settings.max_sigma.unwrap_or(MOST_SIGMA * baseline),
        sigma_heading_deg: MOST_SIGMA.to_degrees(),
    }
}

fn standing(standing: Standing) -> &'static str {
    match standing {
        Standing::Counts => "counts",
        Standing::Excluded => "excluded",
        Standing::Distrusted => "distrusted",
    }
}
