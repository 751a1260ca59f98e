//! Answers as JSON. The names and their meaning are an interface: they stay.

use calib_core::{
    Refusal, Status,
    reference::{self, Stop},
};
use serde::Serialize;

use crate::answer::{Answer, Reason};

/// One case's answer. Values are null where there is no pose.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseLine<'a> {
    /// Name of the case as it stands in the file; always a string.
    pub case: &'a str,
    /// Status of its answer.
    pub status: Status,
    /// Why there is no pose: `unreadable` (a row of the case), or the name of a refusal. Why it is
    /// doubtful: `contradictory` or `ambiguous`.
    pub reason: Option<&'static str>,
    /// In the unit of the targets' places, as all lengths here.
    pub x: Option<f64>,
    /// As `x`.
    pub y: Option<f64>,
    /// In `[0, 2 pi)`.
    pub heading_rad: Option<f64>,
    /// Predicted standard deviation of `x`.
    pub sigma_x: Option<f64>,
    /// Predicted standard deviation of `y`.
    pub sigma_y: Option<f64>,
    /// Predicted standard deviation of `heading_rad`.
    pub sigma_heading_rad: Option<f64>,
    /// Recorded sightings of this case, dropped ones included.
    pub sightings: usize,
    /// Number of sightings that were dropped as outliers.
    pub dropped: usize,
    /// Sum of the squared residuals, each over its variance: about `sightings - dropped - 3` where
    /// the sigmas are right.
    pub chi_squared: Option<f64>,
}

impl<'a> PoseLine<'a> {
    /// The line of this answer.
    pub fn new(answer: &Answer<'a>) -> Self {
        let pose = answer.solution.map(|s| s.pose);
        Self {
            case: answer.case,
            status: answer.status,
            reason: answer.reason.map(Reason::name),
            x: pose.map(|p| p.position.x),
            y: pose.map(|p| p.position.y),
            heading_rad: pose.map(|p| p.heading),
            sigma_x: pose.map(|p| p.sigma_x()),
            sigma_y: pose.map(|p| p.sigma_y()),
            sigma_heading_rad: pose.map(|p| p.sigma_heading()),
            sightings: answer.sightings,
            dropped: answer.dropped,
            chi_squared: answer.solution.map(|s| s.chi_squared),
        }
    }
}

/// The answer of a reference solve.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReferenceLine<'a> {
    /// Status of its answer: `calibrated`, `doubtful`, `refused` or `waiting`.
    pub status: Status,
    /// Why it is not calibrated: [`CONTRADICTORY`](Self::CONTRADICTORY),
    /// [`AMBIGUOUS`](Self::AMBIGUOUS), or the name of a refusal.
    pub reason: Option<&'static str>,
    /// Number of different answers that are physically possible; 0 where there is none.
    pub candidates: usize,
    /// The answer that fits best.
    pub best: Option<ReferenceSolution<'a>>,
    /// Another one that fits about as well.
    pub alternative: Option<ReferenceSolution<'a>>,
}

/// One answer of a reference solve. Camera 0 is at the origin, camera 1 at `(baseline, 0)`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReferenceSolution<'a> {
    /// Of camera 0, in `[0, 2 pi)`.
    pub heading_0_rad: f64,
    /// Of camera 1, in `[0, 2 pi)`.
    pub heading_1_rad: f64,
    /// Predicted standard deviation.
    pub sigma_heading_0_rad: f64,
    /// Predicted standard deviation.
    pub sigma_heading_1_rad: f64,
    /// In the unit of the displacements, as all lengths here.
    pub baseline: f64,
    /// Zero where the baseline was known.
    pub sigma_baseline: f64,
    /// Direction of the displacements' x axis against the baseline, in `[0, 2 pi)`.
    pub frame_heading_rad: f64,
    /// Zero where it was known.
    pub sigma_frame_heading_rad: f64,
    /// Where the target stopped, in the order of the file.
    pub stops: Vec<StopLine<'a>>,
    /// Sum of the squared residuals, each over its variance.
    pub chi_squared: f64,
    /// Equations beyond the unknowns.
    pub degrees_of_freedom: usize,
    /// Steps from the closed form to the minimum.
    pub iterations: usize,
    /// Condition number of the scaled normal matrix; 1 is best.
    pub condition: f64,
}

/// One stop of a reference solve.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StopLine<'a> {
    /// Its name in the file.
    pub stop: &'a str,
    /// Where it was.
    pub x: f64,
    /// As `x`.
    pub y: f64,
    /// Predicted standard deviation of `x`.
    pub sigma_x: f64,
    /// Predicted standard deviation of `y`.
    pub sigma_y: f64,
}

impl<'a> ReferenceLine<'a> {
    /// Reason of doubt: the answer does not fit, though no other fits better.
    pub const CONTRADICTORY: &'static str = "contradictory";
    /// Reason of doubt: there is an `alternative` that is not ruled out.
    pub const AMBIGUOUS: &'static str = "ambiguous";

    /// The outcome of solving these stops, with their names.
    pub fn new(
        outcome: &Result<reference::ReferenceOutcome<f64>, Refusal>,
        names: &'a [String],
        stops: &[Stop<f64>],
    ) -> Self {
        let line = |solution| ReferenceSolution::new(solution, names, stops);
        match outcome {
            Ok(outcome) => {
                let reason = if outcome.best.fit().is_bad() {
                    Some(Self::CONTRADICTORY)
                } else {
                    outcome.alternative.as_ref().map(|_| Self::AMBIGUOUS)
                };
                Self {
                    status: reason.map_or(Status::Calibrated, |_| Status::Doubtful),
                    reason,
                    candidates: outcome.candidates,
                    best: Some(line(&outcome.best)),
                    alternative: outcome.alternative.as_ref().map(line),
                }
            }
            Err(refusal) => Self {
                status: (*refusal).into(),
                reason: Some(refusal.name()),
                candidates: 0,
                best: None,
                alternative: None,
            },
        }
    }
}

impl<'a> ReferenceSolution<'a> {
    /// One solution for these stops, with their names.
    pub fn new(
        solution: &reference::ReferenceSolution<f64>,
        names: &'a [String],
        stops: &[Stop<f64>],
    ) -> Self {
        let [heading_0_rad, heading_1_rad] = solution.headings;
        let [sigma_heading_0_rad, sigma_heading_1_rad] = solution.heading_sigmas();
        let sigma = |variance: f64| variance.max(0.0).sqrt();
        Self {
            heading_0_rad,
            heading_1_rad,
            sigma_heading_0_rad,
            sigma_heading_1_rad,
            baseline: solution.baseline,
            sigma_baseline: solution.baseline_sigma(),
            frame_heading_rad: solution.frame_heading,
            sigma_frame_heading_rad: solution.frame_heading_sigma(),
            stops: names
                .iter()
                .zip(solution.places(stops))
                .map(|(name, (place, covariance))| StopLine {
                    stop: name,
                    x: place.x,
                    y: place.y,
                    sigma_x: sigma(covariance.m11),
                    sigma_y: sigma(covariance.m22),
                })
                .collect(),
            chi_squared: solution.chi_squared,
            degrees_of_freedom: solution.degrees_of_freedom,
            iterations: solution.iterations,
            condition: solution.condition,
        }
    }
}
