//! Is the network calibrated, and if not, what is to be done?

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
};

use calib_core::{Refusal, fit::Fit};

use super::{
    Node, Role, RunRecord,
    next_stop::{self, Wish},
};

const NEVER_JOINED: &str = "it never joined: look at `radio`, at distances and at events";

/// A sighting this many sigmas off its camera's pose is worth a look.
const WILD: f64 = 5.0;

/// What there is to say about a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Cameras that are meant to be calibrated.
    pub expected: usize,
    /// How many of them have a pose that their sightings do not [contradict](Trouble::Contradicted).
    pub calibrated: usize,
    /// What is the matter with single cameras, by ascending number.
    pub findings: Vec<Finding>,
    /// What is the matter with most of them.
    pub common: Vec<Common>,
    /// Targets that never joined their network, by ascending number.
    pub absent: Vec<u16>,
    /// Nodes whose firmware could not go on, by ascending number.
    pub failing: Vec<Failing>,
    /// Where to stop the target next: by ascending network, the best place first.
    pub next_stops: Vec<NextStop>,
    unit: String,
    has_networks: bool,
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
    /// No pose: it never was part of the network.
    NeverJoined,
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
    /// Its pose is not to be believed: its sightings contradict each other, and it says itself that
    /// it is weak.
    Contradicted {
        /// Residuals are this many times too large.
        ratio: f64,
        /// Predicted, of the position.
        sigma_position: f64,
    },
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
    /// For which network, and in its frame.
    pub network: u16,
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
        let networks = Networks::of(record);
        let mut findings = Vec::new();
        for camera in record.cameras().filter(|camera| camera.expected) {
            let mut find = |trouble| {
                findings.push(Finding {
                    camera: camera.id,
                    trouble,
                });
            };
            let Some(estimate) = &camera.estimate else {
                let waits = networks.unanswered.contains(&camera.network);
                find(match camera.refusal {
                    _ if camera.never_joined() => Trouble::NeverJoined,
                    None if waits => Trouble::NoReferences,
                    _ => why_no_pose(camera),
                });
                continue;
            };
            let sigma_position = estimate.sigma_position();
            let sigma_heading_deg = estimate.sigma_heading_deg;
            let limits = &record.limits;
            if let Some(ratio) = camera.contradicted(limits) {
                find(Trouble::Contradicted {
                    ratio,
                    sigma_position,
                });
                continue;
            }
            if estimate.is_weak(limits) {
                find(Trouble::Weak {
                    sigma_position,
                    sigma_heading_deg,
                });
            }
            let fit = camera.fit();
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
        let mut by_camera = BTreeMap::<u16, Vec<&Trouble>>::new();
        for finding in &findings {
            let own = by_camera.entry(finding.camera).or_default();
            own.push(&finding.trouble);
        }
        let mut wishes = BTreeMap::<u16, Vec<Wish<'_>>>::new();
        for camera in record.cameras() {
            let troubles = by_camera.get(&camera.id);
            if let Some(wish) = troubles.and_then(|own| networks.wish(camera, own)) {
                wishes.entry(camera.network).or_default().push(wish);
            }
        }
        let next_stops = wishes
            .iter()
            .flat_map(|(network, wishes)| next_stop::propose(record, *network, wishes))
            .collect();
        // Of each there is one such finding.
        let uncalibrated = findings.iter().filter(|f| f.trouble.is_uncalibrated());
        let targets = record.nodes.iter().filter(|n| n.role == Role::Target);
        Self {
            expected: record.summary.expected,
            calibrated: record.summary.expected - uncalibrated.count(),
            common,
            absent: targets.filter(|t| t.never_joined()).map(|t| t.id).collect(),
            failing: record.nodes.iter().filter_map(Failing::of).collect(),
            next_stops,
            findings,
            unit: record.unit.name.clone(),
            has_networks: record.has_networks(),
        }
    }

    /// Whether every camera that should be calibrated is.
    pub fn is_complete(&self) -> bool {
        self.calibrated == self.expected
    }

    /// 0 if every camera that should be calibrated is, otherwise 1. Weak cameras are calibrated, as
    /// long as their sightings agree.
    pub fn exit_code(&self) -> u8 {
        u8::from(!self.is_complete())
    }
}

/// What of a network decides for all its cameras.
struct Networks {
    /// The references have no answer.
    unanswered: BTreeSet<u16>,
    /// A reference never joined.
    halved: BTreeSet<u16>,
    /// Some target joined, or nobody knows.
    visited: BTreeSet<u16>,
}

impl Networks {
    fn of(record: &RunRecord) -> Self {
        let of = |nodes: &dyn Fn(&Node) -> bool| {
            let nodes = record.nodes.iter().filter(|node| nodes(node));
            nodes.map(|node| node.network).collect::<BTreeSet<_>>()
        };
        let is_reference = |node: &Node| node.is_camera() && node.reference;
        let is_target = |node: &Node| node.role == Role::Target;
        let empty = of(&|node| is_target(node) && node.never_joined());
        let visited = of(&|node| is_target(node) && !node.never_joined());
        Self {
            unanswered: of(&|node| is_reference(node) && node.estimate.is_none()),
            halved: of(&|node| is_reference(node) && node.never_joined()),
            visited: &of(&|_| true) - &(&empty - &visited),
        }
    }

    /// What a camera of which this was found asks for. Where to stop is not what is the matter with
    /// whoever never joined, and the references see nothing together while one of them is missing.
    fn wish<'a>(&self, camera: &'a Node, troubles: &[&Trouble]) -> Option<Wish<'a>> {
        let network = &camera.network;
        let in_pair = camera.reference && self.unanswered.contains(network);
        let asks = in_pair || troubles.iter().any(|trouble| trouble.asks_for_a_stop());
        let mut contradicted = troubles.iter();
        let believes = !contradicted.any(|t| matches!(t, Trouble::Contradicted { .. }));
        let can_help = !camera.never_joined()
            && self.visited.contains(network)
            && !(in_pair && self.halved.contains(network));
        (asks && can_help).then_some(Wish {
            camera,
            believes,
            in_pair,
        })
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
fn truth_fit(camera: &Node) -> Option<Fit<f64>> {
    camera.nees.map(|chi_squared| Fit {
        chi_squared,
        degrees_of_freedom: 3,
    })
}

/// What is bad as a whole, and not only because of the worst quarter of the cameras.
fn common(record: &RunRecord) -> Vec<Common> {
    let judge = |mut fits: Vec<Fit<f64>>| {
        // How much larger than foretold chi squared is.
        let excess = |fit: &Fit<f64>| fit.chi_squared - fit.degrees_of_freedom as f64;
        fits.sort_by(|a, b| f64::total_cmp(&excess(b), &excess(a)));
        let sum = |fits: &[Fit<f64>]| fits.iter().copied().fold(Fit::default(), Fit::and);
        let rest = fits.get(fits.len().div_ceil(4)..).unwrap_or_default();
        sum(&fits).ratio().filter(|_| sum(rest).is_bad())
    };
    let residuals = record.cameras().map(Node::fit);
    let residuals = judge(residuals.filter(|f| f.degrees_of_freedom > 0).collect());
    let errors = judge(record.cameras().filter_map(truth_fit).collect());
    let misfit = residuals.map(Common::Misfit);
    misfit
        .into_iter()
        .chain(errors.map(Common::Overconfident))
        .collect()
}

impl Trouble {
    /// Whether the camera has no pose, or none to be believed.
    pub fn is_uncalibrated(&self) -> bool {
        matches!(
            self,
            Self::NeverJoined
                | Self::NeverSaw
                | Self::TooFew(_)
                | Self::Refused(_)
                | Self::NoReferences
                | Self::NoPose
                | Self::Contradicted { .. }
        )
    }

    /// Whether one more stop would help.
    fn asks_for_a_stop(&self) -> bool {
        let waits = matches!(self, Self::NoReferences | Self::NeverJoined);
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
            Trouble::NeverJoined => write!(f, "not calibrated: {NEVER_JOINED}"),
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
            Trouble::Contradicted {
                ratio,
                sigma_position,
            } => write!(
                f,
                "not calibrated: its sightings contradict each other, residuals {ratio:.1} times \
                 too large, predicted sigma {sigma_position:.3} {unit}: look at what it takes for \
                 the target, and at the camera model"
            ),
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
        let nothing = self.findings.is_empty() && self.common.is_empty();
        if nothing && self.absent.is_empty() && self.failing.is_empty() {
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
        for target in &self.absent {
            writeln!(f, "  target {target}: {NEVER_JOINED}")?;
        }
        for failing in &self.failing {
            writeln!(f, "{failing}")?;
        }
        let mut before = None;
        for stop in &self.next_stops {
            let first = before.replace(stop.network) != Some(stop.network);
            let lead = if first { "Next" } else { "Then" };
            match (self.has_networks, first) {
                (true, _) => write!(f, "{lead} in network {}: stop", stop.network)?,
                (false, true) => write!(f, "{lead}: stop")?,
                (false, false) => write!(f, "{lead} stop")?,
            }
            writeln!(
                f,
                " the target about ({:.1}, {:.1}), in view of {}",
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
