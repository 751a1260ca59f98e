//! Is the network calibrated, and if not, what is to be done?

use std::fmt;

use calib_core::Refusal;

use super::{Node, Role, RunRecord, next_stop, summary::Fit};

/// A sighting this many sigmas off its camera's pose is worth a look.
const WILD: f64 = 5.0;

/// What there is to say about a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Cameras that are meant to be calibrated.
    pub expected: usize,
    /// How many of them have a pose.
    pub calibrated: usize,
    /// What is the matter with single cameras, by ascending number.
    pub findings: Vec<Finding>,
    /// What is the matter with most of them.
    pub common: Vec<Common>,
    /// Nodes whose firmware could not go on, by ascending number.
    pub failing: Vec<Failing>,
    /// Where to stop the target next, the best place first.
    pub next_stops: Vec<NextStop>,
    unit: String,
}

/// What is the matter with a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Which.
    pub camera: u16,
    /// What.
    pub trouble: Trouble,
}

/// What can be the matter with a camera.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Trouble {
    /// No pose: it has not seen the standing target.
    NeverSaw,
    /// No pose: it has seen it at too few stops.
    TooFew(usize),
    /// No pose: the solver refused its sightings.
    Refused(Refusal),
    /// No pose: nobody knows where the target stands before the reference cameras know where they
    /// look.
    NoReferences,
    /// No pose, and no reason.
    NoPose,
    /// Its predicted sigmas are above the limits.
    Weak {
        /// Of the position.
        sigma_position: f64,
        /// Of the heading.
        sigma_heading_deg: f64,
    },
    /// Its sightings fit its pose badly: residuals are this many times too large.
    Misfit(f64),
    /// One sighting is this many sigmas off.
    Wild {
        /// At which stop.
        stop: u32,
        /// How far.
        sigmas: f64,
    },
    /// Its true error is this many times larger than foretold.
    Overconfident(f64),
}

/// What can be the matter with the whole network.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Common {
    /// Residuals are this many times larger than foretold.
    Misfit(f64),
    /// True errors are this many times larger than foretold.
    Overconfident(f64),
}

/// A node whose firmware could not go on, and was started again.
#[derive(Clone, Debug, PartialEq)]
pub struct Failing {
    /// Which.
    pub node: u16,
    /// What it is.
    pub role: Role,
    /// How often.
    pub times: usize,
    /// Why, the last time.
    pub why: String,
}

/// A place where the target should stop.
#[derive(Clone, Debug, PartialEq)]
pub struct NextStop {
    /// Place.
    pub x: f64,
    /// Place.
    pub y: f64,
    /// The cameras that want to see it there.
    pub seen_by: Vec<u16>,
}

impl Verdict {
    /// On a run.
    pub fn of(record: &RunRecord) -> Self {
        let common = common(record);
        let is_common = |of: fn(&Common) -> bool| common.iter().any(of);
        let (all_misfit, all_overconfident) = (
            is_common(|c| matches!(c, Common::Misfit(_))),
            is_common(|c| matches!(c, Common::Overconfident(_))),
        );
        let references_known = record
            .cameras()
            .all(|camera| !camera.reference || camera.estimate.is_some());
        let mut findings = Vec::new();
        for camera in record.cameras().filter(|camera| camera.expected) {
            let mut find = |trouble| {
                findings.push(Finding {
                    camera: camera.id,
                    trouble,
                });
            };
            let Some(estimate) = &camera.estimate else {
                find(match references_known || camera.refusal.is_some() {
                    true => why_no_pose(camera),
                    false => Trouble::NoReferences,
                });
                continue;
            };
            let sigma_position = estimate.sigma_position();
            let sigma_heading_deg = estimate.sigma_heading_deg;
            let limits = &record.limits;
            if sigma_position > limits.sigma_position
                || sigma_heading_deg > limits.sigma_heading_deg
            {
                find(Trouble::Weak {
                    sigma_position,
                    sigma_heading_deg,
                });
            }
            let fit = Fit::of(camera);
            if let (false, true, Some(ratio)) = (all_misfit, fit.is_bad(), fit.ratio()) {
                find(Trouble::Misfit(ratio));
                for residual in &camera.residuals {
                    let sigmas = residual.normalised.unwrap_or_default().abs();
                    if sigmas > WILD {
                        let stop = residual.stop;
                        find(Trouble::Wild { stop, sigmas });
                    }
                }
            }
            let truth = truth_fit(camera).filter(|truth| !all_overconfident && truth.is_bad());
            if let Some(ratio) = truth.and_then(|truth| truth.ratio()) {
                find(Trouble::Overconfident(ratio));
            }
        }
        let wanting = |camera: &&Node| {
            let mut own = findings.iter().filter(|f| f.camera == camera.id);
            let come_first = camera.reference && !references_known;
            own.any(|finding| come_first || finding.trouble.asks_for_a_stop())
        };
        let next_stops = next_stop::propose(record, record.cameras().filter(wanting));
        Self {
            expected: record.summary.expected,
            calibrated: record.summary.calibrated,
            findings,
            common,
            failing: record.nodes.iter().filter_map(Failing::of).collect(),
            next_stops,
            unit: record.unit.name.clone(),
        }
    }

    /// Whether every camera that should be calibrated is.
    pub fn is_complete(&self) -> bool {
        self.calibrated == self.expected
    }

    /// 0 if every camera that should be calibrated is, otherwise 1. Weak cameras are calibrated.
    pub fn exit_code(&self) -> u8 {
        u8::from(!self.is_complete())
    }
}

fn why_no_pose(camera: &Node) -> Trouble {
    match (camera.refusal, camera.sightings) {
        (None | Some(Refusal::TooFew), 0) => Trouble::NeverSaw,
        (None | Some(Refusal::TooFew), few @ 1..=2) => Trouble::TooFew(few),
        (Some(refusal), _) => Trouble::Refused(refusal),
        (None, _) => Trouble::NoPose,
    }
}

/// The true error against the predicted covariance, as a fit of three numbers.
fn truth_fit(camera: &Node) -> Option<Fit> {
    camera.nees.map(|chi_squared| Fit {
        chi_squared,
        degrees_of_freedom: 3,
    })
}

/// What is bad as a whole, and not only because of the worst quarter of the cameras.
fn common(record: &RunRecord) -> Vec<Common> {
    let judge = |mut fits: Vec<Fit>| {
        fits.sort_by(|a, b| f64::total_cmp(&b.excess(), &a.excess()));
        let sum = |fits: &[Fit]| fits.iter().copied().fold(Fit::default(), Fit::and);
        let rest = fits.get(fits.len().div_ceil(4)..).unwrap_or_default();
        sum(&fits).ratio().filter(|_| sum(rest).is_bad())
    };
    let residuals = record.cameras().map(Fit::of);
    let residuals = judge(residuals.filter(|f| f.degrees_of_freedom > 0).collect());
    let errors = judge(record.cameras().filter_map(truth_fit).collect());
    let misfit = residuals.map(Common::Misfit);
    misfit
        .into_iter()
        .chain(errors.map(Common::Overconfident))
        .collect()
}

impl Trouble {
    /// Whether the camera has no pose.
    pub fn is_uncalibrated(&self) -> bool {
        matches!(
            self,
            Self::NeverSaw | Self::TooFew(_) | Self::Refused(_) | Self::NoReferences | Self::NoPose
        )
    }

    /// Whether one more stop would help.
    fn asks_for_a_stop(&self) -> bool {
        let waits = matches!(self, Self::NoReferences);
        !waits && (self.is_uncalibrated() || matches!(self, Self::Weak { .. }))
    }
}

impl Failing {
    fn of(node: &Node) -> Option<Self> {
        let last = node.failures.last()?;
        Some(Self {
            node: node.id,
            role: node.role,
            times: node.failures.len(),
            why: last.why.clone(),
        })
    }
}

impl fmt::Display for Failing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let role = match self.role {
            Role::Coordinator => "coordinator",
            Role::Camera => "camera",
            Role::Target => "target",
        };
        let Self {
            node, times, why, ..
        } = self;
        write!(f, "  {role} {node}: its firmware could not go on ")?;
        match times {
            1 => write!(f, "once, and was started again: {why}"),
            _ => write!(
                f,
                "{times} times, and was started again; the last time: {why}"
            ),
        }
    }
}

impl Finding {
    fn write(&self, f: &mut fmt::Formatter<'_>, unit: &str) -> fmt::Result {
        write!(f, "  camera {}: ", self.camera)?;
        match &self.trouble {
            Trouble::NeverSaw => {
                f.write_str("not calibrated: it never saw the target standing still")
            }
            Trouble::TooFew(n) => write!(f, "not calibrated: {n} of the 3 sightings it needs"),
            Trouble::Refused(Refusal::Inconsistent) => write!(
                f,
                "not calibrated: {}; if that does not help, check the projection and the field of \
                 view",
                Refusal::Inconsistent
            ),
            Trouble::Refused(refusal) => write!(f, "not calibrated: {refusal}"),
            Trouble::NoReferences => f.write_str(
                "not calibrated: the two reference cameras come first, and have no answer yet",
            ),
            Trouble::NoPose => f.write_str("not calibrated: its pose did not arrive"),
            Trouble::Weak {
                sigma_position,
                sigma_heading_deg,
            } => write!(
                f,
                "weak: predicted sigma {sigma_position:.3} {unit}, {sigma_heading_deg:.2} deg"
            ),
            Trouble::Misfit(ratio) => write!(
                f,
                "its sightings do not fit the camera model: residuals {ratio:.1} times too large"
            ),
            Trouble::Wild { stop, sigmas } => {
                write!(f, "its sighting at stop {stop} is {sigmas:.0} sigmas off")
            }
            Trouble::Overconfident(ratio) => write!(
                f,
                "its true error is {ratio:.1} times what its sigmas foretell"
            ),
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            expected,
            calibrated,
            unit,
            ..
        } = self;
        write!(f, "{calibrated} of {expected} cameras are calibrated")?;
        if self.findings.is_empty() && self.common.is_empty() && self.failing.is_empty() {
            return writeln!(f, "; nothing is left to do.");
        }
        writeln!(f, ".")?;
        for common in &self.common {
            match common {
                Common::Misfit(ratio) => writeln!(
                    f,
                    "  The residuals do not fit the camera model: {ratio:.1} times larger than \
                     foretold. Check the projection and the field of view."
                )?,
                Common::Overconfident(ratio) => writeln!(
                    f,
                    "  The true errors are {ratio:.1} times larger than foretold: the camera \
                     model, or the places the target believed in, are wrong."
                )?,
            }
        }
        for finding in &self.findings {
            finding.write(f, unit)?;
            writeln!(f)?;
        }
        for failing in &self.failing {
            writeln!(f, "{failing}")?;
        }
        for (k, stop) in self.next_stops.iter().enumerate() {
            let lead = if k == 0 { "Next: stop" } else { "Then stop" };
            writeln!(
                f,
                "{lead} the target about ({:.1}, {:.1}), in view of {}",
                stop.x,
                stop.y,
                cameras(&stop.seen_by)
            )?;
        }
        Ok(())
    }
}

/// `camera 3`, `cameras 3 and 4`, `cameras 3, 4 and 5`
fn cameras(ids: &[u16]) -> String {
    let names: Vec<String> = ids.iter().map(u16::to_string).collect();
    match names.split_last() {
        Some((last, [])) => format!("camera {last}"),
        Some((last, rest)) => format!("cameras {} and {last}", rest.join(", ")),
        None => "no camera".to_owned(),
    }
}
