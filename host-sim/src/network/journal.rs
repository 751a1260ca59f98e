//! Messages and knowledge of nodes, with times.

use std::{
    cell::RefCell,
    collections::{BTreeMap, BTreeSet, HashMap},
    fmt::Arguments,
    io::Write,
    rc::Rc,
};

use calib_core::dead_reckoning::{Displacement, Step};
use nalgebra::{Matrix2, Point2, Vector2};
use node_firmware::{
    console::TrackedObject,
    facts::{Fact, KeptSighting, Walk},
    hardware::Observer,
    message::{
        CameraCommand, CommandOutcome, CoordinateFrame, MemberAddress, Message, Seen, StopNumber,
        Tracked,
    },
};
use zigbee_link::wire::ShortAddress;

use virtual_hardware::executor::{Clock, Time};

pub(super) type SharedJournal = Rc<RefCell<Journal>>;

/// Knowledge about one stop of a target.
#[derive(Clone, Debug)]
pub(super) struct StopEntry {
    /// Time at which the target first told of it.
    pub(super) at: Time,
    /// True place of the target at that time.
    pub(super) truth: Point2<f64>,
    /// Place that the target believed, in the frame of the site, when it told last.
    pub(super) believed: Option<calib_core::dead_reckoning::Place<f32>>,
    /// The way from the stop before, as its step sensor measured it; unknown if the sensor was off on
    /// the way.
    pub(super) way: Option<Displacement<f64>>,
}

/// Steps since a target last told of a new stop.
#[derive(Clone, Debug)]
pub(super) struct Way {
    walked: Displacement<f64>,
    /// Steps were made while it was off.
    has_gap: bool,
}

impl Default for Way {
    fn default() -> Self {
        Self {
            walked: Displacement {
                vector: Vector2::zeros(),
                covariance: Matrix2::zeros(),
            },
            has_gap: false,
        }
    }
}

/// Knowledge about one node.
#[derive(Clone, Debug, Default)]
pub(super) struct NodeEntry {
    /// Time at which it first reported a pose.
    pub(super) calibrated: Option<Time>,
    /// A camera's sightings by their place in its list.
    pub(super) sightings: BTreeMap<u8, KeptSighting>,
    /// A camera's measurements, by the target's address and its number of the stop.
    pub(super) seen: BTreeMap<(MemberAddress, StopNumber), Seen>,
    /// A target's way since its last stop.
    pub(super) way: Way,
    /// A target's stops by their number.
    pub(super) stops: BTreeMap<u16, StopEntry>,
    /// Times and places at which a target's carrier came to stand.
    pub(super) arrivals: Vec<(Time, Point2<f64>)>,
    /// Bytes of all messages it handed to its link.
    pub(super) payload_bytes: u64,
    /// Time at which it last said anything.
    pub(super) said: Option<Time>,
    /// A target: time at which it last asked each member for itself, by the member's address.
    pub(super) asked: BTreeMap<u16, Time>,
    /// Each failure that kept it from going on.
    pub(super) failures: Vec<(Time, String)>,
}

impl NodeEntry {
    /// Takes in facts from the memory of a node that is not watched. Returns the measurements that are new since
    /// the last call, each with its target.
    pub(super) fn learns_late(&mut self, facts: &[Fact]) -> Vec<(MemberAddress, Seen)> {
        let mut news = Vec::new();
        for fact in facts {
            match fact {
                Fact::Sighting(place, Some(sighting)) => {
                    self.sightings.insert(*place, *sighting);
                    news.extend(self.sees(fact));
                }
                Fact::ReferenceStop(..) => news.extend(self.sees(fact)),
                Fact::Walk(walk) => self.number_stops(walk),
                _ => {}
            }
        }
        news
    }

    /// Takes in a measurement that a camera keeps of a stop. Returns it with its target, if it was not known.
    fn sees(&mut self, fact: &Fact) -> Option<(MemberAddress, Seen)> {
        let seen = match fact {
            Fact::Sighting(_, Some(kept)) => Some(((kept.target, kept.stop), kept.seen)),
            Fact::ReferenceStop(_, Some(kept)) => {
                kept.own.map(|own| ((kept.target, kept.stop), own))
            }
            _ => None,
        };
        let (stop, seen) = seen?;
        let known = self.seen.insert(stop, seen);
        known.is_none().then_some((stop.0, seen))
    }

    /// Numbers the stops: the last arrival was the last stop that was written down, and none is left out.
    fn number_stops(&mut self, walk: &Walk) {
        for (back, (at, truth)) in (0..).zip(self.arrivals.iter().rev()) {
            let believed = (back == 0 && walk.located).then_some(walk.place);
            self.stops
                .entry(walk.stop.wrapping_sub(back))
                .or_insert(StopEntry {
                    at: *at,
                    truth: *truth,
                    believed,
                    way: None,
                });
        }
    }
}

/// Event at a moment, for an onlooker.
#[derive(Clone, Debug)]
pub(super) enum Moment {
    /// A camera saw the target at this address.
    Seen(MemberAddress, Seen),
    /// A camera that was told to track sees this.
    Tracked(Tracked),
    /// A coordinator knows the place of an object.
    Object(u16, Option<TrackedObject>),
    /// True place of an object, in the frame of the coordinator's network.
    Truth(u16, Point2<f64>),
    /// A target goes on from its stop.
    StopEnds,
    /// A message in words.
    Said(String),
    /// Something that befalls the whole site, in words.
    Befalls(String),
    /// A camera has done a command, or has not.
    Done(CameraCommand, CommandOutcome),
}

/// The journal of a run.
pub(super) struct Journal {
    clock: Clock,
    /// Number of times that something was written down.
    pub(super) changes: u64,
    /// Time, node and event of each moment, if there is an onlooker.
    pub(super) moments: Option<Vec<(Time, u16, Moment)>>,
    log: Option<Box<dyn Write>>,
    pub(super) nodes: HashMap<u16, NodeEntry>,
    /// Entry of a node of which nothing is known.
    blank: NodeEntry,
    /// Members of which coordinators told something, each with the coordinators that did.
    tellers: BTreeMap<u16, BTreeSet<u16>>,
    /// Members told of since the last [`take_told`](Self::take_told).
    told: BTreeSet<u16>,
    /// Stops that targets have left, or ended with.
    pub(super) stops_ended: usize,
    /// Targets that have walked their whole way.
    pub(super) walked: usize,
}

impl Journal {
    pub(super) fn new(clock: Clock, log: Option<Box<dyn Write>>) -> Self {
        Self {
            clock,
            changes: 0,
            moments: None,
            log,
            nodes: HashMap::new(),
            blank: NodeEntry::default(),
            tellers: BTreeMap::new(),
            told: BTreeSet::new(),
            stops_ended: 0,
            walked: 0,
        }
    }

    pub(super) fn node(&mut self, id: u16) -> &mut NodeEntry {
        self.changes += 1;
        self.nodes.entry(id).or_default()
    }

    /// Knowledge about a node.
    pub(super) fn entry(&self, id: u16) -> &NodeEntry {
        self.nodes.get(&id).unwrap_or(&self.blank)
    }

    /// Notes that a coordinator told its PC of a member.
    pub(super) fn told(&mut self, member: u16, coordinator: u16) {
        self.told.insert(member);
        self.tellers.entry(member).or_default().insert(coordinator);
    }

    /// Members of which coordinators told something since the last call.
    pub(super) fn take_told(&mut self) -> BTreeSet<u16> {
        std::mem::take(&mut self.told)
    }

    /// The coordinators that told of a member.
    pub(super) fn tellers(&self, member: u16) -> impl Iterator<Item = u16> + '_ {
        self.tellers.get(&member).into_iter().flatten().copied()
    }

    /// Notes that a pose of this node is known from now on, if it was not before.
    pub(super) fn calibrated(&mut self, id: u16) {
        let now = self.clock.time();
        self.node(id).calibrated.get_or_insert(now);
    }

    /// Notes that a target's carrier stands here from now on.
    pub(super) fn arrived(&mut self, id: u16, place: Point2<f64>) {
        let now = self.clock.time();
        self.node(id).arrivals.push((now, place));
    }

    /// Notes that a target's step sensor measured a step, and whether it was on.
    pub(super) fn stepped(&mut self, id: u16, step: &Step<f32>, is_on: bool) {
        let way = &mut self.node(id).way;
        way.has_gap |= !is_on;
        way.walked.vector += step.displacement().cast::<f64>();
        way.walked.covariance += step.covariance().cast::<f64>();
    }

    /// Tells an onlooker.
    pub(super) fn moment(&mut self, id: u16, moment: impl FnOnce() -> Moment) {
        self.changes += 1;
        if let Some(moments) = &mut self.moments {
            moments.push((self.clock.time(), id, moment()));
        }
    }

    /// Notes that a target goes on from its stop.
    pub(super) fn left(&mut self, id: u16) {
        self.stops_ended += 1;
        self.moment(id, || Moment::StopEnds);
    }

    /// Notes that a node cannot go on.
    pub(super) fn failed(&mut self, id: u16, why: &str) {
        let now = self.clock.time();
        self.note(id, format_args!("stops: {why}"));
        self.node(id).failures.push((now, why.to_owned()));
    }

    /// Adds the reason why a node could not go on when it last [failed](Self::failed): it tells that only now.
    pub(super) fn failed_since(&mut self, id: u16, why: &str) {
        if let Some((_, known)) = self.node(id).failures.last_mut() {
            *known = format!("{known}: {why}");
        }
    }

    /// A line of the log about a node.
    pub(super) fn note(&mut self, id: u16, what: Arguments<'_>) {
        self.line(format_args!("node {id}: {what}"));
    }

    /// Notes something that befalls the whole site.
    pub(super) fn befalls(&mut self, what: &str) {
        self.line(format_args!("site: {what}"));
        self.moment(0, || Moment::Befalls(what.to_owned()));
    }

    fn line(&mut self, what: Arguments<'_>) {
        if let Some(log) = &mut self.log {
            let at = self.clock.time();
            let (seconds, micros) = (at / 1_000_000_000, at / 1_000 % 1_000_000);
            let line = format!("{seconds}.{micros:06} {what}\n");
            // In one piece, so that a program that is killed leaves whole lines. A full disk spoils the
            // log, not the run. The owner of the file learns of it.
            let _ = log.write_all(line.as_bytes());
        }
    }
}

/// Writes down a node's messages and knowledge.
pub(super) struct Witness {
    pub(super) id: u16,
    pub(super) journal: SharedJournal,
    /// True place of a target.
    pub(super) truth: Box<dyn Fn() -> Option<Point2<f64>>>,
}

impl Observer for Witness {
    fn sends(&mut self, to: ShortAddress, message: &Message) {
        let mut journal = self.journal.borrow_mut();
        if journal.log.is_some() {
            journal.note(self.id, format_args!("to {:04x}: {message:?}", to.0));
        }
        let now = journal.clock.time();
        let bytes = postcard::experimental::serialized_size(message).unwrap_or_default();
        let node = journal.node(self.id);
        node.payload_bytes += bytes as u64;
        node.said = Some(now);
        match message {
            Message::Report(report) if report.pose().is_some() => {
                journal.calibrated(self.id);
            }
            Message::Stopped(stopped) => {
                if to != ShortAddress::BROADCAST {
                    journal.node(self.id).asked.insert(to.0, now);
                }
                let Some(truth) = (self.truth)() else {
                    return;
                };
                let NodeEntry { stops, way, .. } = journal.node(self.id);
                let stop = stops.entry(stopped.stop).or_insert_with(|| {
                    let Way { walked, has_gap } = std::mem::take(way);
                    StopEntry {
                        at: now,
                        truth,
                        believed: None,
                        way: (!has_gap).then_some(walked),
                    }
                });
                if stopped.frame == CoordinateFrame::Site {
                    stop.believed = Some(stopped.place);
                }
            }
            Message::Look(answer) => {
                if let Some(seen) = answer.seen {
                    journal.moment(self.id, || Moment::Seen(to.0, seen));
                }
                let seen = answer.seen.map(|seen| ((to.0, answer.stop), seen));
                journal.node(self.id).seen.extend(seen);
            }
            Message::Bearing(bearing) => {
                journal.moment(self.id, || Moment::Seen(bearing.target, bearing.seen));
                let seen = &mut journal.node(self.id).seen;
                seen.insert((bearing.target, bearing.stop), bearing.seen);
            }
            _ => {}
        }
    }

    fn learns(&mut self, fact: &Fact) {
        let mut journal = self.journal.borrow_mut();
        if journal.log.is_some() {
            journal.note(self.id, format_args!("learns {fact:?}"));
        }
        journal.node(self.id).sees(fact);
        if let Fact::Sighting(place, sighting) = fact {
            let sightings = &mut journal.node(self.id).sightings;
            match sighting {
                Some(sighting) => sightings.insert(*place, *sighting),
                None => sightings.remove(place),
            };
        }
    }
}
