//! Is the network calibrated, and if not, what is to be done?
//!
//! | module | job |
//! |---|---|
//! | `causes` | Causes of problems of most cameras: lens, carrier, sigmas |
//! | `judge` | Verdicts one after the other, which change little |
//! | `in_view` | Test of whether a camera could have seen the target, or stands in a sealed room |
//! | `words` | The verdict in sentences |

use std::collections::{BTreeMap, BTreeSet};

use calib_core::{Refusal, Status};
use nalgebra::{Isometry2, Point2};
use node_firmware::message::Health;

use super::{
    Node, NodeLens, NodeMount, NodeMove, Protection, Role, RunRecord, checks,
    next_stop::{Proposed, Wish},
};

mod causes;
mod in_view;
mod judge;
mod words;

pub use causes::deceives;
pub use in_view::InView;
pub(super) use in_view::{Edge, Floor, edges, is_free};
pub use judge::Judge;
pub(crate) use words::move_words;
pub use words::{check_words, health_words, status_words};

/// A sighting this many sigmas off its camera's pose is worth a look.
const WILD: f64 = 5.0;

/// Verdict on a run, or on a real network.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Cameras that are meant to be calibrated.
    pub expected: usize,
    /// Number of them that have the status `calibrated`.
    pub calibrated: usize,
    /// Number of these that are [checkable](Node::is_checkable), and of these [checked](Node::is_checked).
    pub checkable: usize,
    /// See `checkable`.
    pub checked: usize,
    /// The largest protection levels of those that are checked.
    pub protection: Option<Protection>,
    /// True if true errors are known and are not what the sigmas foretell: one is beyond five of them, or all
    /// together are too large. Such poses deceive those who rely on them.
    pub deceives: bool,
    /// Problems of single cameras, by ascending number.
    pub findings: Vec<Finding>,
    /// Problems of most of them.
    pub common: Vec<Common>,
    /// Targets that never joined their network, by ascending number.
    pub absent: Vec<u16>,
    /// Coordinators and targets that do not answer any more, and when they were last heard.
    pub silent: Vec<(u16, Role, Option<f64>)>,
    /// Nodes that say that something is the matter with them, by ascending number.
    pub unwell: Vec<(u16, Role, Health)>,
    /// Cameras that were moved, and have another pose since.
    pub moved: Vec<(u16, NodeMove)>,
    /// Nodes whose firmware could not go on, by ascending number.
    pub failing: Vec<Failing>,
    /// Where to stop the target next: by ascending network, the best place first.
    pub next_stops: Vec<NextStop>,
    /// Changes that help cameras that no stop helps, the best one first.
    pub instead: Vec<Instead>,
    /// True if it asks for no stop because the last ones improved nothing.
    pub stops_in_vain: bool,
    /// Where the frames of the networks are in that of the site's file, as far as that is known.
    frames: BTreeMap<u16, Isometry2<f64>>,
    references: BTreeSet<u16>,
    /// Where targets stood at their stops.
    stood: BTreeMap<(u16, u32), (u16, [f64; 2])>,
    unit: String,
    has_networks: bool,
    is_rehearsal: bool,
}

/// Problem of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Number of the camera.
    pub camera: u16,
    /// Kind of problem.
    pub trouble: Trouble,
}

/// Kinds of problems of a camera.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Trouble {
    /// No pose: it never was part of the network.
    NeverJoined,
    /// No pose: its board fails again and again, this often.
    Fails(usize),
    /// It does not answer any more; when it was last heard, seconds.
    Silent(Option<f64>),
    /// No pose: it has not seen the standing target.
    NeverSaw(InView),
    /// No pose: it has seen it at too few stops.
    TooFew(usize),
    /// No pose: the solver refused its sightings.
    Refused(Refusal),
    /// No pose: the target's places are not known before the reference cameras know where they look.
    NoReferences,
    /// No pose: its network has no references, and no target has come from another network.
    NoTarget,
    /// No pose, and no reason.
    NoPose,
    /// Its sightings contradict each other, so neither pose nor sigmas can be relied on.
    Doubtful {
        /// Residuals are this many times too large, as far as that is known.
        ratio: Option<f64>,
        /// Predicted, of the position.
        sigma_position: f64,
        /// Cause, where a rehearsal tells it.
        cause: Option<Cause>,
        /// Number of sightings that agree with all measurements, and number of all, where some do not.
        agreeing: Option<[usize; 2]>,
    },
    /// Its sightings contradict each other, and fit once left and right are exchanged.
    Mirrored,
    /// Its sightings contradict the configured lens, and fit this one.
    OtherLens(NodeLens),
    /// It is not level, and its rows contradict each other: so they tell that it hangs.
    Tilted(NodeMount),
    /// Too little tests its pose, however small its predicted sigmas are: [`Node::is_untested`].
    Untested {
        /// A pair of references was solved, and no target has estimated it with everything else.
        is_reference: bool,
    },
    /// Its predicted sigmas are above the limits.
    Weak {
        /// Of the position.
        sigma_position: f64,
        /// Of the heading.
        sigma_heading_deg: f64,
    },
    /// One sighting is this many sigmas off. A camera leaves such ones out.
    Wild {
        /// At which stop.
        stop: u32,
        /// Size of the error.
        sigmas: f64,
    },
    /// It is calibrated, but one unnoticed wrong measurement could do more than is
    /// [tolerated](super::Limits::tolerate).
    Unchecked {
        /// Protection level; `None` if no target has told it yet.
        protection: Option<Protection>,
        /// Measurement that could do most, where that is known.
        weakness: Option<Weakness>,
    },
    /// Its pose is this many predicted sigmas off the truth: beyond five, as chance allows in one of
    /// two million poses.
    Deceives(f64),
}

/// Measurement that could be wrong unnoticed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Weakness {
    /// Any of the camera's own sightings: it has too few.
    TooFew,
    /// A sighting of a camera.
    Sightings {
        /// Number of the camera.
        camera: u16,
    },
    /// The way that a target measured from one stop to another: nothing else says how far apart these
    /// are.
    Leg {
        /// Number of the target.
        target: u16,
        /// The stop from which it leads.
        from: u32,
        /// The stop to which it leads.
        to: u32,
    },
}

/// Why sightings of one camera contradict each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// It does not see the target where it is: its lens, or the colour that it takes for the target's.
    Sight,
    /// The target was not where it believed to be.
    Carrier,
}

/// Kinds of problems of the whole network.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Common {
    /// The cameras do not see the target where they would with their lenses: true bearings are this
    /// many times farther off than foretold. Only a rehearsal can tell.
    Lens(f64),
    /// This target believed to be where it was not: this many times farther off than foretold. Only a
    /// rehearsal can tell.
    Carrier(u16, f64),
    /// Residuals are this many times larger than foretold, for whatever reason.
    Misfit(f64),
    /// This reference camera of a network in which no camera has a pose is not there: no other gets one.
    Reference(u16),
    /// This reference camera is not level, its rows contradict each other, and all poses of its network hang on it.
    TiltedReference(u16),
    /// No pose of this network is checked: no target estimated its cameras together.
    Unchecked(u16),
    /// The same of one that has no references: a target brought its frame from another network.
    UncheckedGuests(u16),
    /// True errors are this many times larger than foretold.
    Overconfident(f64),
    /// True errors are this many times smaller than foretold. This deceives no reader.
    Underconfident(f64),
}

/// A node whose firmware could not go on, and was started again.
#[derive(Clone, Debug, PartialEq)]
pub struct Failing {
    /// Number of the node.
    pub node: u16,
    /// Role of the node.
    pub role: Role,
    /// Number of times.
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
    /// The stop that was there before, if one was.
    pub again: Option<u32>,
    /// The cameras that want to see it there.
    pub seen_by: Vec<u16>,
    /// Camera that gains most by it, as far as that is foretold.
    pub helps: Option<Gain>,
}

/// Improvement of a camera, foretold by the information of all measurements, with those of a carrier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain {
    /// Number of the camera.
    pub camera: u16,
    /// Number that improves.
    pub of: Gained,
    /// Its value now.
    pub from: f64,
    /// Its value then.
    pub to: f64,
}

/// Number that improves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gained {
    /// Predicted sigma of its place.
    Sigma,
    /// Most that one wrong measurement could move it unnoticed.
    Protection,
}

/// Change of the site that helps where no further stop does.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Instead {
    /// The carrier of this target is measured: 1 % of its ways and 1 deg of its compass.
    Carrier(u16, Gain),
    /// These two cameras are the references.
    References([u16; 2], Gain),
    /// All cameras have lenses of one and a half times the field of view.
    Lens(Gain),
    /// One more camera stands half way between these, and looks as one of them does.
    Camera([u16; 2], Gain),
    /// A tape measure tells, to 1 cm or 1 %, how far from a camera the target stood. Only a solution on a computer
    /// takes that.
    Tape {
        /// Number of the camera.
        camera: u16,
        /// Number of the target.
        target: u16,
        /// Number of the stop.
        stop: u32,
        /// Improvement.
        gain: Gain,
    },
}

impl Verdict {
    /// On a run, or a real network.
    pub fn of(record: &RunRecord) -> Self {
        Judge::default().verdict(record)
    }

    fn found(record: &RunRecord, judge: &mut Judge) -> Self {
        let networks = Networks::of(record);
        let mut by_camera = BTreeMap::<u16, Vec<Trouble>>::new();
        let mut common = causes::common(record);
        common.extend(networks.missing(record).map(Common::Reference));
        let tilted = record.cameras().filter(|camera| {
            let is_doubtful = camera.status == Some(Status::Doubtful);
            camera.reference && camera.mount.is_some() && is_doubtful
        });
        common.extend(tilted.map(|camera| Common::TiltedReference(camera.id)));
        let (mut to_check, mut instead) = (Vec::new(), Vec::new());
        for network in record.networks.iter().map(|network| network.network) {
            let Unchecked {
                troubles,
                stops,
                common: own,
                instead: other,
            } = judge.unchecked(record, network);
            common.extend(own);
            to_check.extend(stops);
            instead.extend(other);
            for (camera, trouble) in troubles {
                by_camera.entry(camera).or_default().push(trouble);
            }
        }
        // Of members of a coordinator that never spoke nothing is known.
        let is_told = |node: &&Node| !record.is_unheard(node.network);
        for camera in record
            .cameras()
            .filter(|camera| camera.expected)
            .filter(is_told)
        {
            let troubles = troubles(record, &networks, camera);
            if !troubles.is_empty() {
                by_camera.entry(camera.id).or_default().extend(troubles);
            }
        }
        let mut wishes = BTreeMap::<u16, Vec<Wish<'_>>>::new();
        for camera in record.cameras() {
            let troubles = by_camera.get(&camera.id);
            if let Some(wish) = troubles.and_then(|own| networks.wish(camera, own)) {
                wishes.entry(camera.network).or_default().push(wish);
            }
        }
        let mut next_stops = Vec::new();
        for (network, wishes) in &wishes {
            let Proposed {
                stops,
                instead: other,
            } = judge.propose(record, *network, wishes);
            next_stops.extend(stops);
            instead.extend(other);
        }
        next_stops.extend(to_check);
        if record.stops_in_vain {
            next_stops.clear();
            instead = remedies(record);
        }
        // Those that help the least certain camera, where no stop does.
        let worst = { instead.iter() }.map(|other: &Instead| other.gain().from);
        let worst = worst.fold(0.0, f64::max);
        instead.retain(|other| next_stops.is_empty() && other.gain().from >= worst);
        next_stops.sort_by_key(|stop| stop.network);
        if common.iter().any(Common::comes_first) {
            // Stops with wrong lenses make wrong poses sure.
            (next_stops, instead) = (Vec::new(), Vec::new());
        }
        let frames: BTreeMap<u16, Isometry2<f64>> = { record.networks.iter() }
            .filter_map(|own| Some((own.network, record.building(own.network)?)))
            .collect();
        let findings: Vec<_> = by_camera
            .into_iter()
            .flat_map(|(camera, troubles)| {
                let finding = move |trouble| Finding { camera, trouble };
                troubles.into_iter().map(finding)
            })
            .collect();
        let checkable = || {
            record
                .cameras()
                .filter(|camera| camera.is_checkable(&record.limits))
        };
        let checked = || checkable().filter(|camera| camera.is_checked(&record.limits));
        let levels = checked().filter_map(|camera| camera.protection);
        let others = || record.nodes.iter().filter(|node| !node.is_camera());
        let is_target = |node: &&Node| node.role == Role::Target;
        Self {
            expected: record.summary.expected,
            calibrated: record.summary.calibrated,
            checkable: checkable().count(),
            checked: checked().count(),
            protection: levels.reduce(Protection::or),
            deceives: findings
                .iter()
                .any(|f| matches!(f.trouble, Trouble::Deceives(_)))
                || common.iter().any(|c| matches!(c, Common::Overconfident(_))),
            common,
            absent: others()
                .filter(|node| is_target(node) && node.never_joined() && is_told(node))
                .map(|target| target.id)
                .collect(),
            silent: others()
                .filter(|node| node.silent)
                .map(|node| (node.id, node.role, node.heard_seconds))
                .collect(),
            moved: { record.nodes.iter() }
                .filter_map(|node| Some((node.id, node.moved?)))
                .collect(),
            unwell: { record.nodes.iter() }
                .filter(|node| node.health != Health::default())
                .map(|node| (node.id, node.role, node.health))
                .collect(),
            failing: record.nodes.iter().filter_map(Failing::of).collect(),
            next_stops,
            instead,
            stops_in_vain: record.stops_in_vain,
            findings,
            stood: { record.targets.iter() }
                .flat_map(|target| target.stops.iter().map(move |stop| (target, stop)))
                .map(|(target, stop)| {
                    let place = (target.network, [stop.x, stop.y]);
                    ((target.id, stop.stop), place)
                })
                .collect(),
            frames,
            references: { record.cameras() }
                .filter(|camera| camera.reference)
                .map(|camera| camera.id)
                .collect(),
            unit: record.unit.name.clone(),
            has_networks: record.has_networks(),
            is_rehearsal: record.seed.is_some(),
        }
    }

    /// A place of a network as people are told it: in the frame of the site's file, where that is known.
    pub fn told_place(&self, network: u16, [x, y]: [f64; 2]) -> [f64; 2] {
        let place = Point2::new(x, y);
        let frame = self.frames.get(&network);
        frame.map_or(place, |frame| frame * place).into()
    }

    /// Returns true if every camera that should be calibrated is.
    pub fn is_complete(&self) -> bool {
        self.calibrated == self.expected
    }

    /// Returns true if every pose that is estimated is checked too.
    pub fn is_checked(&self) -> bool {
        self.checked == self.checkable
    }

    /// Returns true if every camera that should be calibrated is, and no true error is known that the sigmas do
    /// not foretell.
    pub fn is_good(&self) -> bool {
        self.is_complete() && !self.deceives
    }

    /// 0 if [all is good](Self::is_good), otherwise 1.
    pub fn exit_code(&self) -> u8 {
        u8::from(!self.is_good())
    }
}

/// Changes of the site that help cameras that have a pose, but not a good one.
fn remedies(record: &RunRecord) -> Vec<Instead> {
    let networks = record.networks.iter().map(|network| network.network);
    let found = networks.flat_map(|network| {
        let is_poor = |camera: &&Node| {
            let is_unchecked =
                camera.is_checkable(&record.limits) && !camera.is_checked(&record.limits);
            camera.network == network && (checks::is_weak(camera, &record.limits) || is_unchecked)
        };
        let poor: Vec<&Node> = record.cameras().filter(is_poor).collect();
        checks::remedies(record, network, &poor)
    });
    found.collect()
}

/// Poses of a network that are not checked: the reasons, and where to stop next.
#[derive(Clone, Debug, Default)]
struct Unchecked {
    troubles: Vec<(u16, Trouble)>,
    stops: Vec<NextStop>,
    common: Vec<Common>,
    instead: Vec<Instead>,
}

fn unchecked(record: &RunRecord, network: u16) -> Unchecked {
    let own = || record.cameras().filter(|camera| camera.network == network);
    let unchecked: Vec<&Node> = own()
        .filter(|camera| camera.is_checkable(&record.limits) && !camera.is_checked(&record.limits))
        .collect();
    if unchecked.is_empty() {
        return Unchecked::default();
    }
    if own().all(|camera| camera.protection.is_none()) {
        let common = match own().any(|camera| camera.reference) {
            true => Common::Unchecked(network),
            false => Common::UncheckedGuests(network),
        };
        return Unchecked {
            common: vec![common],
            ..Unchecked::default()
        };
    }
    let checks = checks::of(record, network, &unchecked);
    let troubles = unchecked.iter().map(|camera| {
        let trouble = Trouble::Unchecked {
            protection: camera.protection,
            weakness: checks.weaknesses.get(&camera.id).copied(),
        };
        (camera.id, trouble)
    });
    Unchecked {
        troubles: troubles.collect(),
        stops: checks.stops,
        common: Vec::new(),
        instead: checks.instead,
    }
}

/// Problems of a camera that should be calibrated.
fn troubles(record: &RunRecord, networks: &Networks, camera: &Node) -> Vec<Trouble> {
    let mut troubles = Vec::new();
    let Some(estimate) = &camera.estimate else {
        troubles.push(why_no_pose(record, networks, camera));
        return troubles;
    };
    let sigma_position = estimate.sigma_position();
    match camera.status {
        Some(Status::Doubtful) if let Some(mount) = camera.mount => {
            troubles.push(Trouble::Tilted(mount));
        }
        Some(Status::Doubtful) if let Some(lens) = camera.lens => {
            troubles.push(Trouble::OtherLens(lens));
        }
        Some(Status::Doubtful) if causes::is_mirrored(record, camera) => {
            troubles.push(Trouble::Mirrored);
        }
        Some(Status::Doubtful) => troubles.push(Trouble::Doubtful {
            ratio: camera.fit().ratio(),
            sigma_position,
            cause: causes::of_doubt(record, camera),
            agreeing: { camera.protection }
                .filter(|_| camera.used < camera.sightings)
                .map(|_| [camera.used, camera.sightings]),
        }),
        Some(Status::Weak) if camera.is_untested(&record.limits) => {
            troubles.push(Trouble::Untested {
                is_reference: camera.reference,
            });
        }
        Some(Status::Weak) => troubles.push(Trouble::Weak {
            sigma_position,
            sigma_heading_deg: estimate.sigma_heading_deg,
        }),
        _ => {}
    }
    let is_explained = troubles.contains(&Trouble::Mirrored);
    if camera.fit().is_bad() && !is_explained {
        for residual in &camera.residuals {
            let sigmas = residual.normalised.unwrap_or_default().abs();
            if sigmas > WILD {
                let stop = residual.stop;
                troubles.push(Trouble::Wild { stop, sigmas });
            }
        }
    }
    if let Some(sigmas) = causes::deceives(camera) {
        troubles.push(Trouble::Deceives(sigmas));
    }
    if camera.silent {
        troubles.push(Trouble::Silent(camera.heard_seconds));
    }
    troubles
}

/// The first cause that the data do not exclude.
fn why_no_pose(record: &RunRecord, networks: &Networks, camera: &Node) -> Trouble {
    if camera.never_joined() {
        return Trouble::NeverJoined;
    }
    if !camera.failures.is_empty() {
        return Trouble::Fails(camera.failures.len());
    }
    if camera.silent {
        return Trouble::Silent(camera.heard_seconds);
    }
    if networks.awaiting.contains(&camera.network) {
        return Trouble::NoTarget;
    }
    let waits = networks.unanswered.contains(&camera.network);
    match (camera.reason, camera.sightings) {
        (None, _) if waits && !camera.reference => Trouble::NoReferences,
        (None | Some(Refusal::TooFew), 0) => match in_view::of(record, camera) {
            // They are seen together, or not at all.
            InView::Stops(_) | InView::Unknown if waits => Trouble::NoReferences,
            in_view => Trouble::NeverSaw(in_view),
        },
        (None | Some(Refusal::TooFew), few @ 1..=2) => Trouble::TooFew(few),
        (Some(Refusal::Inconsistent), _) if causes::is_mirrored(record, camera) => {
            Trouble::Mirrored
        }
        (Some(refusal), _) => Trouble::Refused(refusal),
        (None, _) if waits => Trouble::NoReferences,
        (None, _) => Trouble::NoPose,
    }
}

/// Facts about a network that decide for all its cameras.
struct Networks {
    /// The references have no answer.
    unanswered: BTreeSet<u16>,
    /// A reference never joined.
    halved: BTreeSet<u16>,
    /// There are no references, as there are in another network, and no camera saw anything.
    awaiting: BTreeSet<u16>,
    /// Some target joined, or it is not known whether one did.
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
        let has_references = of(&is_reference);
        let saw = of(&|node| node.is_camera() && (node.sightings > 0 || node.estimate.is_some()));
        let awaiting = match has_references.is_empty() {
            true => BTreeSet::new(),
            false => &(&of(&Node::is_camera) - &has_references) - &saw,
        };
        Self {
            awaiting,
            unanswered: of(&|node| is_reference(node) && node.estimate.is_none()),
            halved: of(&|node| is_reference(node) && node.never_joined()),
            visited: &of(&|_| true) - &(&empty - &visited),
        }
    }

    /// References that are not there, of networks in which they are waited for.
    fn missing(&self, record: &RunRecord) -> impl Iterator<Item = u16> {
        let cameras = record.cameras().filter(|camera| {
            let is_awaited = camera.reference && self.unanswered.contains(&camera.network);
            let is_told = !record.is_unheard(camera.network);
            is_awaited && camera.estimate.is_none() && is_gone(camera) && is_told
        });
        cameras.map(|camera| camera.id)
    }

    /// Wish of a camera with these problems. A stop does not help a camera that never joined, and the references
    /// see nothing together while one of them is missing.
    fn wish<'a>(&self, camera: &'a Node, troubles: &[Trouble]) -> Option<Wish<'a>> {
        let network = &camera.network;
        let in_pair = camera.reference && self.unanswered.contains(network);
        let helped = troubles.iter().any(Trouble::asks_for_a_stop);
        let hopeless = troubles.iter().any(Trouble::is_hopeless);
        let is_alone = in_pair && self.halved.contains(network);
        let is_out_of_reach = hopeless || is_alone || camera.never_joined();
        let can_help = self.visited.contains(network) && !is_out_of_reach;
        ((in_pair || helped) && can_help).then_some(Wish {
            camera,
            believes: camera.status != Some(Status::Doubtful),
            in_pair,
        })
    }
}

/// Returns true if a reference camera cannot do its duty.
fn is_gone(camera: &Node) -> bool {
    camera.never_joined()
        || camera.silent
        || !camera.failures.is_empty()
        || !camera.health.camera.works()
}

impl Trouble {
    /// Returns true if one more stop would help.
    fn asks_for_a_stop(&self) -> bool {
        matches!(
            self,
            Self::NeverSaw(_)
                | Self::TooFew(_)
                | Self::Refused(_)
                | Self::NoPose
                | Self::Doubtful { .. }
                | Self::Tilted(_)
                | Self::Weak { .. }
        )
    }

    /// Returns true if no stop at all would help.
    fn is_hopeless(&self) -> bool {
        matches!(
            self,
            Self::NeverJoined
                | Self::Fails(_)
                | Self::Silent(_)
                | Self::NeverSaw(InView::Sealed)
                | Self::Mirrored
        )
    }
}

impl Common {
    /// Returns true of a cause that has to be mended before anything else helps.
    fn comes_first(&self) -> bool {
        matches!(self, Self::Lens(_))
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
