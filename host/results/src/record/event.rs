//! Events of a network as they happen: one line of JSON an event.
//!
//! The stream is made of the [record's](super) own types. [`What::Begin`] has the record as it is when a
//! reader begins; every later change of a node, a stop or a network comes as an event with its new state, so
//! that [`RunRecord::apply`] makes the record of any later moment. Other events tell what
//! a record does not keep: rays, places between stops, commands, words. `docs/events.md` describes all.
//!
//! [`Looker`] makes the events: it compares records. It is the same for a simulation, a coordinator's
//! line and a finished record, because all of them are told as records.

use std::{collections::HashMap, fmt, io};

use calib_core::Status;
use node_firmware::{
    console::TrackedObject,
    message::{Seen, Tracked, TrackedBlob},
};
use serde::{Deserialize, Serialize};
use serde_json::{Number, Value, error::Category};

use super::{
    FORMAT, Network, Node, Radio, RunRecord, Stop, Target, Tracking,
    sightings::Sightings,
    summary::Summary,
    verdict::{Judge, NextStop},
};

/// The format of the stream that this library writes, and the only one that it reads.
pub const EVENT_FORMAT: u32 = 1;

/// Time between verdicts while things change, seconds.
const VERDICT_EVERY: f64 = 5.0;
/// Time between reports of traffic, seconds.
const TRAFFIC_EVERY: f64 = 10.0;

/// One line of the stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// When, seconds since the start of the run, or of listening.
    pub seconds: f64,
    /// Kind of event, with its data.
    #[serde(flatten)]
    pub what: What,
}

/// Kind of event, with its data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum What {
    /// The first line: all that is known by then.
    Begin {
        /// [`EVENT_FORMAT`]
        events: u32,
        /// The record so far.
        record: Box<RunRecord>,
    },
    /// Something about a node changed.
    Node {
        /// Changes of the node.
        news: Vec<News>,
        /// All of it, as in the record.
        is: Box<Node>,
    },
    /// A node is no part of any list any more.
    Gone {
        /// Number of the camera.
        node: u16,
    },
    /// A network has a channel, an identifier, or another frame.
    Network {
        /// As in the record.
        is: Network,
    },
    /// The frame of the first network, and with it every obstacle, is told otherwise.
    Obstacles {
        /// As in the record.
        outlines: Vec<Vec<[f64; 2]>>,
        /// As in the record.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        area: Vec<[f64; 2]>,
    },
    /// A stop began, or its target knows better where it is.
    Stop {
        /// Of which target.
        target: u16,
        /// It was not known before.
        begins: bool,
        /// As in the record.
        is: Stop,
    },
    /// A target goes on from its stop.
    StopEnds {
        /// Number of the target.
        target: u16,
    },
    /// A target, where its stops do not tell all that changed.
    Target {
        /// As in the record.
        is: Target,
    },
    /// Where a target really is while it walks, in the frame of its network; simulations only.
    Place {
        /// Number of the target.
        target: u16,
        /// Place.
        x: f64,
        /// Place.
        y: f64,
    },
    /// A camera saw a target that stood. From a coordinator's line: when it tells.
    Seen {
        /// Number of the camera.
        node: u16,
        /// Number of the target.
        target: u16,
        /// At which stop; `None`: where it stands now.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stop: Option<u32>,
        /// Positive to the left of the optical axis.
        bearing_deg: f64,
        /// Standard deviation.
        sigma_deg: f64,
    },
    /// Sightings of a camera that was told to track.
    Tracked {
        /// Number of the camera.
        node: u16,
        /// Middle mass column and row.
        middle: [u16; 2],
        /// Left, upper, right, lower edge.
        edges: [u16; 4],
        /// As the camera counts them.
        pixels: u8,
        /// Of 255.
        confidence: u8,
        /// Positive to the left of the optical axis; none where nothing is in view, or a part only.
        #[serde(default)]
        bearing_deg: Option<f64>,
        /// Standard deviation.
        #[serde(default)]
        sigma_deg: Option<f64>,
        /// It is wider than an object of its height: there may be several in it.
        #[serde(default)]
        is_wide: bool,
    },
    /// Where something is that cameras that track see, by the coordinator of a network.
    Object {
        /// Number of the network.
        network: u16,
        /// Its number there.
        object: u16,
        /// Place in the frame of the network; `None`: no camera sees it any more.
        is: Option<ObjectPlace>,
    },
    /// Where an object of the scenario really is, in the frame of a network; simulations only.
    Truth {
        /// Number of the network.
        network: u16,
        /// Number of the object, counted from 1.
        object: u16,
        /// Place.
        x: f64,
        /// Place.
        y: f64,
    },
    /// Quality of a network's tracking of objects; simulations only.
    Tracking {
        /// As in the record.
        is: Tracking,
    },
    /// A user wants something of a network or a node, or it came to an end.
    Command {
        /// Of whom, if of one.
        node: Option<u16>,
        /// The command, as people type it.
        command: String,
        /// Progress of the command.
        state: CommandState,
        /// More about it.
        words: String,
    },
    /// Something in words: what a coordinator tells people, and what befalls a node.
    Said {
        /// About whom, if about one.
        node: Option<u16>,
        /// For people.
        words: String,
    },
    /// Verdict on the whole run.
    Verdict {
        /// Every camera that is expected is calibrated, and nothing speaks against it.
        good: bool,
        /// Cameras that are calibrated.
        calibrated: usize,
        /// Cameras that should be.
        expected: usize,
        /// For people.
        words: String,
        /// Findings about single cameras.
        findings: Vec<Advice>,
        /// Where to stop next, the best place first.
        walk_to: Vec<WalkTo>,
    },
    /// Changes of the verdict since it was told last: `host-sim live` tells its page these in the place of a
    /// whole one.
    VerdictChange {
        /// As of the verdict.
        good: bool,
        /// As of the verdict.
        calibrated: usize,
        /// As of the verdict.
        expected: usize,
        /// Its lines.
        words: Vec<Piece<String>>,
        /// As of the verdict.
        findings: Vec<Piece<Advice>>,
        /// As of the verdict.
        walk_to: Vec<Piece<WalkTo>>,
    },
    /// Radio traffic so far.
    Traffic {
        /// As in the record.
        radio: Radio,
    },
    /// Measurements in a network, as its cameras and targets keep them.
    Measured {
        /// As in the record.
        is: Sightings,
    },
    /// The last line.
    End {
        /// Radio traffic.
        radio: Option<Radio>,
        /// Duration of the run.
        sim_seconds: f64,
        /// As in the record: left out where it is false.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        stops_in_vain: bool,
        /// Why it ended before its time.
        cut_short: Option<String>,
    },
}

/// Where an object is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectPlace {
    /// Place.
    pub x: f64,
    /// Place.
    pub y: f64,
    /// Covariance: xx, xy, yy.
    pub covariance: [f64; 3],
    /// Units per second.
    pub velocity: [f64; 2],
    /// Time since a camera saw it.
    pub unseen_s: f64,
}

impl From<&TrackedObject> for ObjectPlace {
    fn from(object: &TrackedObject) -> Self {
        let ([x, y], covariance) = object.place;
        Self {
            x: x.into(),
            y: y.into(),
            covariance: covariance.map(f64::from),
            velocity: object.velocity.map(f64::from),
            unseen_s: f64::from(object.unseen_ms) * 1e-3,
        }
    }
}

impl What {
    /// Event for the sightings of a camera that was told to track.
    pub fn tracked(node: u16, tracked: &Tracked) -> Self {
        let TrackedBlob {
            middle,
            edges,
            pixels,
            confidence,
        } = tracked.blob;
        let degrees = |of: fn(&Seen) -> f32| {
            let seen = tracked.seen.as_ref();
            seen.map(|seen| f64::from(of(seen)).to_degrees())
        };
        Self::Tracked {
            node,
            middle,
            edges,
            pixels,
            confidence,
            bearing_deg: degrees(|seen| seen.bearing),
            sigma_deg: degrees(|seen| seen.sigma),
            is_wide: tracked.is_wide,
        }
    }
}

/// Change of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum News {
    /// It is a member.
    Joined,
    /// It is a member no more.
    Left,
    /// Its status.
    Status,
    /// Its pose or the covariance of it.
    Pose,
    /// Why it has none.
    Refusal,
    /// Most that one unnoticed fault could do to its pose.
    Protection,
    /// Its sightings, or which of them its pose uses.
    Sightings,
    /// It became a reference, or is none any more.
    Reference,
    /// It does not answer, or answers again.
    Silent,
    /// Its firmware could not go on.
    Failure,
    /// It stands elsewhere, or its frame does.
    Moved,
    /// Traffic, and when it was heard.
    Traffic,
    /// Anything else.
    Other,
}

/// Progress of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CommandState {
    /// It was asked for.
    Asked,
    /// It is done, and confirmed.
    Done,
    /// It was refused, or failed.
    Failed,
}

/// Advice about a camera.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Advice {
    /// Number of the camera.
    pub node: u16,
    /// Description of the problem, with advice.
    pub words: String,
}

/// Where to stop the target next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WalkTo {
    /// For which network, and in its frame.
    pub network: u16,
    /// Place.
    pub x: f64,
    /// Place.
    pub y: f64,
    /// The cameras that want to see it there.
    pub seen_by: Vec<u16>,
}

/// A piece of a list, as a part of the former list or as an item.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Piece<T> {
    /// From this place of the list before, so many.
    Kept([usize; 2]),
    /// This one.
    New(T),
}

/// A list, told by one that was before.
fn pieces<T: Clone + PartialEq + Serialize>(before: &[T], now: &[T]) -> Vec<Piece<T>> {
    let key = |item: &T| serde_json::to_string(item).unwrap_or_default();
    let mut places = HashMap::new();
    for (place, item) in before.iter().enumerate().rev() {
        places.insert(key(item), place);
    }
    let mut pieces = Vec::new();
    let mut rest = now;
    while let Some((first, others)) = rest.split_first() {
        let place = places.get(&key(first));
        let same = place.map_or(0, |&place| {
            let pairs = before[place..].iter().zip(rest);
            pairs.take_while(|(a, b)| a == b).count()
        });
        match (place, same) {
            (Some(&place), 1..) => {
                pieces.push(Piece::Kept([place, same]));
                rest = &rest[same..];
            }
            _ => {
                pieces.push(Piece::New(first.clone()));
                rest = others;
            }
        }
    }
    pieces
}

/// The list that was told so; `None` if there was another one before.
fn put_together<T: Clone>(before: &[T], pieces: &[Piece<T>]) -> Option<Vec<T>> {
    let mut now = Vec::new();
    for piece in pieces {
        match piece {
            Piece::New(item) => now.push(item.clone()),
            Piece::Kept([from, count]) => {
                now.extend_from_slice(before.get(*from..from.checked_add(*count)?)?);
            }
        }
    }
    Some(now)
}

fn lines(words: &str) -> Vec<String> {
    words.split('\n').map(str::to_owned).collect()
}

impl What {
    /// A verdict, told by one that was before; `None` if one of them is none.
    pub fn verdict_change(before: &Self, now: &Self) -> Option<Self> {
        let (
            Self::Verdict {
                words: old_words,
                findings: old_findings,
                walk_to: old_walk,
                ..
            },
            Self::Verdict {
                good,
                calibrated,
                expected,
                words,
                findings,
                walk_to,
            },
        ) = (before, now)
        else {
            return None;
        };
        Some(Self::VerdictChange {
            good: *good,
            calibrated: *calibrated,
            expected: *expected,
            words: pieces(&lines(old_words), &lines(words)),
            findings: pieces(old_findings, findings),
            walk_to: pieces(old_walk, walk_to),
        })
    }

    /// The verdict that was told by this one before it; `None` if that was another one.
    pub fn verdict_now(&self, before: &Self) -> Option<Self> {
        let (
            Self::VerdictChange {
                good,
                calibrated,
                expected,
                words,
                findings,
                walk_to,
            },
            Self::Verdict {
                words: old_words,
                findings: old_findings,
                walk_to: old_walk,
                ..
            },
        ) = (self, before)
        else {
            return None;
        };
        Some(Self::Verdict {
            good: *good,
            calibrated: *calibrated,
            expected: *expected,
            words: put_together(&lines(old_words), words)?.join("\n"),
            findings: put_together(old_findings, findings)?,
            walk_to: put_together(old_walk, walk_to)?,
        })
    }
}

impl From<&NextStop> for WalkTo {
    fn from(stop: &NextStop) -> Self {
        let NextStop {
            network,
            x,
            y,
            ref seen_by,
            ..
        } = *stop;
        Self {
            network,
            x,
            y,
            seen_by: seen_by.clone(),
        }
    }
}

impl Event {
    /// Something that happens at a time.
    pub fn new(seconds: f64, what: What) -> Self {
        Self { seconds, what }
    }

    /// Reads a line.
    ///
    /// Fields that are flattened or tagged are kept aside until their type is known, and numbers of `serde_json`
    /// with `arbitrary_precision`, which crates of the same build may ask for, are no numbers there unless they
    /// are written as they would be written here. So lines are always read by this function.
    ///
    /// # Errors
    /// It is not JSON, or no event.
    pub fn from_line(line: &str) -> Result<Self, serde_json::Error> {
        let mut value = serde_json::from_str(line)?;
        write_numbers_anew(&mut value);
        Self::deserialize(value)
    }

    /// The event as a line, ending with a line feed.
    ///
    /// # Errors
    /// Those of the JSON writer, which events do not give cause for.
    pub fn to_line(&self) -> Result<String, serde_json::Error> {
        let mut line = serde_json::to_string(self)?;
        line.push('\n');
        Ok(line)
    }
}

/// Why a stream cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StreamError {
    /// It cannot be read at all.
    #[error("it cannot be read: {0}")]
    Io(#[from] io::Error),
    /// A line is no event.
    #[error("line {0} is no event: {words}", words = in_words(.1))]
    Line(usize, serde_json::Error),
    /// The first line is not that of a stream.
    #[error("it does not begin as a stream of events does")]
    NoBegin,
    /// A stream with a record of another version.
    #[error("its record has format {0}, and only format {FORMAT} can be read: make it again")]
    Record(u32),
    /// A stream of another version.
    #[error("it has event format {0}, and only format {EVENT_FORMAT} can be read: make it again")]
    Format(u32),
}

/// An error in one line, without the number that the line has for its own parser.
fn in_words(error: &serde_json::Error) -> String {
    match error.classify() {
        Category::Syntax => "it is no JSON".to_owned(),
        Category::Eof => "it is cut off".to_owned(),
        _ => error.to_string(),
    }
}

/// Writes all floating-point numbers of a value in the shortest form.
fn write_numbers_anew(value: &mut Value) {
    match value {
        Value::Number(number) if !number.is_i64() && !number.is_u64() => {
            if let Some(again) = number.as_f64().and_then(Number::from_f64) {
                *number = again;
            }
        }
        Value::Array(values) => values.iter_mut().for_each(write_numbers_anew),
        Value::Object(fields) => fields.values_mut().for_each(write_numbers_anew),
        _ => {}
    }
}

/// Reads a stream; one that ends in the middle of its last line, as of a program that was killed, is
/// taken without that.
///
/// # Errors
/// [`StreamError`]
pub fn read(stream: impl io::BufRead) -> Result<Vec<Event>, StreamError> {
    let mut events = Vec::new();
    let mut lines = (1..).zip(stream.lines()).peekable();
    while let Some((number, line)) = lines.next() {
        let line = line?;
        match Event::from_line(&line) {
            Ok(event) => events.push(event),
            Err(_) if lines.peek().is_none() && !events.is_empty() => break,
            Err(error) => return Err(StreamError::Line(number, error)),
        }
    }
    match events.first().map(|event| &event.what) {
        Some(What::Begin { events: format, .. }) if *format != EVENT_FORMAT => {
            Err(StreamError::Format(*format))
        }
        Some(What::Begin { record, .. }) if record.format != FORMAT => {
            Err(StreamError::Record(record.format))
        }
        Some(What::Begin { .. }) => Ok(events),
        _ => Err(StreamError::NoBegin),
    }
}

/// The record that events come to; `None` if they do not begin.
pub fn fold<'e>(events: impl IntoIterator<Item = &'e Event>) -> Option<RunRecord> {
    let mut events = events.into_iter();
    let What::Begin { record, .. } = &events.next()?.what else {
        return None;
    };
    let mut record = RunRecord::clone(record);
    for event in events {
        record.apply(event);
    }
    Some(record)
}

impl RunRecord {
    /// Takes over what an event changes.
    pub fn apply(&mut self, event: &Event) {
        self.take(event);
        if let What::Node { .. } | What::Gone { .. } = event.what {
            self.summary = Summary::of(&self.nodes);
        }
    }

    /// All of it but the summary.
    fn take(&mut self, event: &Event) {
        self.sim_seconds = self.sim_seconds.max(event.seconds);
        match &event.what {
            What::Begin { record, .. } => self.clone_from(record),
            What::Node { is, .. } => {
                match self.nodes.binary_search_by_key(&is.id, |node| node.id) {
                    Ok(place) => self.nodes[place].clone_from(is),
                    Err(place) => self.nodes.insert(place, Node::clone(is)),
                }
            }
            What::Gone { node } => {
                self.nodes.retain(|other| other.id != *node);
                self.targets.retain(|target| target.id != *node);
            }
            What::Network { is } => {
                match { self.networks.iter_mut() }.find(|own| own.network == is.network) {
                    Some(own) => *own = *is,
                    None => self.networks.push(*is),
                }
            }
            What::Obstacles { outlines, area } => {
                self.obstacles.clone_from(outlines);
                self.area.clone_from(area);
            }
            What::Target { is } => self.set_target(is),
            What::Stop { target, is, .. } => {
                let mut targets = self.targets.iter_mut();
                if let Some(target) = targets.find(|own| own.id == *target) {
                    target.set_stop(is);
                }
            }
            What::Traffic { radio } => self.radio = Some(radio.clone()),
            What::Measured { is } => {
                let mut all = self.sightings.iter_mut();
                match all.find(|own| own.network == is.network) {
                    Some(own) => own.clone_from(is),
                    None => self.sightings.push(is.clone()),
                }
            }
            What::Tracking { is } => {
                self.tracking.retain(|own| own.network != is.network);
                self.tracking.push(*is);
            }
            What::End {
                radio,
                sim_seconds,
                stops_in_vain,
                ..
            } => {
                self.radio.clone_from(radio);
                self.sim_seconds = *sim_seconds;
                self.stops_in_vain = *stops_in_vain;
            }
            What::StopEnds { .. }
            | What::Place { .. }
            | What::Seen { .. }
            | What::Tracked { .. }
            | What::Object { .. }
            | What::Truth { .. }
            | What::Command { .. }
            | What::Said { .. }
            | What::Verdict { .. }
            | What::VerdictChange { .. } => {}
        }
    }

    fn set_target(&mut self, is: &Target) {
        match self.targets.binary_search_by_key(&is.id, |own| own.id) {
            Ok(place) => self.targets[place].clone_from(is),
            Err(place) => self.targets.insert(place, is.clone()),
        }
    }
}

impl Target {
    fn set_stop(&mut self, is: &Stop) {
        match self.stops.binary_search_by_key(&is.stop, |stop| stop.stop) {
            Ok(place) => self.stops[place] = *is,
            Err(place) => self.stops.insert(place, *is),
        }
        self.path = self.stops.iter().map(|stop| [stop.x, stop.y]).collect();
    }
}

/// Compares a record with the one before, and tells the difference as events.
#[derive(Clone, Debug, Default)]
pub struct Looker {
    known: Option<RunRecord>,
    /// Something changed since the verdict was told, which was then.
    owes_verdict: bool,
    verdict_at: Option<f64>,
    traffic_at: f64,
    judge: Judge,
}

impl Looker {
    /// Returns true if a look at this time may use the [sightings](RunRecord::sightings) of the record, of which there
    /// are many after months: the stream begins, or a verdict is due.
    pub fn uses_sightings(&self, seconds: f64) -> bool {
        self.known.is_none() || self.is_verdict_due(seconds)
    }

    fn is_verdict_due(&self, seconds: f64) -> bool {
        self.verdict_at
            .is_none_or(|at| seconds - at >= VERDICT_EVERY)
    }

    /// Events since the last look at a network that goes on. The time when a node was last heard and its traffic
    /// are told at the end only.
    pub fn look(&mut self, record: &RunRecord) -> Vec<Event> {
        let mut events = self.changes(record, false);
        let seconds = record.sim_seconds;
        if let Some(radio) = &record.radio
            && seconds - self.traffic_at >= TRAFFIC_EVERY
        {
            self.traffic_at = seconds;
            let radio = radio.clone();
            events.push(Event::new(seconds, What::Traffic { radio }));
        }
        if self.owes_verdict && self.is_verdict_due(seconds) {
            events.push(self.verdict(record));
        }
        events
    }

    /// The verdict on a record that was looked at, if it was not told since something changed.
    pub fn owed_verdict(&mut self, record: &RunRecord) -> Option<Event> {
        self.owes_verdict.then(|| self.verdict(record))
    }

    /// Events since the last look, and the end.
    pub fn end(&mut self, record: &RunRecord, cut_short: Option<&str>) -> Vec<Event> {
        let mut events = self.changes(record, true);
        let seconds = record.sim_seconds;
        let known = self.known.iter().flat_map(|known| &known.sightings);
        let known: Vec<_> = known.collect();
        let measured = record.sightings.iter().filter(|own| !known.contains(own));
        events.extend(measured.map(|own| Event::new(seconds, What::Measured { is: own.clone() })));
        let known = self.known.iter().flat_map(|known| &known.tracking);
        let known: Vec<_> = known.collect();
        let tracking = record.tracking.iter().filter(|own| !known.contains(own));
        events.extend(tracking.map(|own| Event::new(seconds, What::Tracking { is: *own })));
        events.push(self.verdict(record));
        let end = What::End {
            radio: record.radio.clone(),
            sim_seconds: seconds,
            stops_in_vain: record.stops_in_vain,
            cut_short: cut_short.map(str::to_owned),
        };
        events.push(Event::new(seconds, end));
        events
    }

    fn verdict(&mut self, record: &RunRecord) -> Event {
        self.owes_verdict = false;
        self.verdict_at = Some(record.sim_seconds);
        let verdict = self.judge.verdict(record);
        let what = What::Verdict {
            good: verdict.is_good(),
            calibrated: verdict.calibrated,
            expected: verdict.expected,
            words: verdict.to_string().trim_end().to_owned(),
            findings: verdict
                .findings
                .iter()
                .map(|finding| Advice {
                    node: finding.camera,
                    words: verdict.words_on(finding),
                })
                .collect(),
            walk_to: verdict.next_stops.iter().map(WalkTo::from).collect(),
        };
        Event::new(record.sim_seconds, what)
    }

    fn changes(&mut self, record: &RunRecord, with_traffic: bool) -> Vec<Event> {
        // No event tells that a network has gone, such as one whose coordinator turned out to have another number.
        let is_there = |network: &Network| {
            let mut networks = record.networks.iter();
            networks.any(|own| own.network == network.network)
        };
        self.known
            .take_if(|known| !known.networks.iter().all(is_there));
        let Some(known) = &mut self.known else {
            // What runs take the computer is never twice the same.
            let begin = RunRecord {
                wall_seconds: None,
                ..record.clone()
            };
            self.known = Some(begin.clone());
            self.owes_verdict = true;
            let what = What::Begin {
                events: EVENT_FORMAT,
                record: Box::new(begin),
            };
            return vec![Event::new(record.sim_seconds, what)];
        };
        let mut whats = Vec::new();
        for network in &record.networks {
            if !known.networks.contains(network) {
                whats.push(What::Network { is: *network });
            }
        }
        if (&known.obstacles, &known.area) != (&record.obstacles, &record.area) {
            let (outlines, area) = (record.obstacles.clone(), record.area.clone());
            whats.push(What::Obstacles { outlines, area });
        }
        let is_there = |id: u16| {
            record
                .nodes
                .binary_search_by_key(&id, |node| node.id)
                .is_ok()
        };
        let gone = known.nodes.iter().filter(|node| !is_there(node.id));
        whats.extend(gone.map(|node| What::Gone { node: node.id }));
        for node in &record.nodes {
            let place = known.nodes.binary_search_by_key(&node.id, |n| n.id);
            let before = place.ok().map(|place| &known.nodes[place]);
            let news = news(before, node, with_traffic);
            if !news.is_empty() {
                let is = Box::new(node.clone());
                whats.push(What::Node { news, is });
            }
        }
        for target in &record.targets {
            let place = known.targets.binary_search_by_key(&target.id, |own| own.id);
            let before = place.ok().map(|place| &known.targets[place]);
            whats.extend(target_changes(before, target));
        }
        let events = whats.into_iter();
        let events: Vec<_> = { events.map(|what| Event::new(record.sim_seconds, what)) }.collect();
        for event in &events {
            known.take(event);
        }
        known.summary = Summary::of(&known.nodes);
        self.owes_verdict |= !events.is_empty();
        events
    }
}

/// Changes of a node against what was known before.
fn news(before: Option<&Node>, now: &Node, with_traffic: bool) -> Vec<News> {
    let blank;
    let before = match before {
        Some(before) => before,
        None => {
            blank = Node::new(now.id, now.role);
            &blank
        }
    };
    if now.is_like(before) {
        let is_new = with_traffic && now != before;
        return if is_new {
            vec![News::Traffic]
        } else {
            Vec::new()
        };
    }
    let is_member = |node: &Node| node.address.is_some();
    let told = [
        (News::Joined, is_member(now) && !is_member(before)),
        (News::Left, is_member(before) && !is_member(now)),
        (News::Status, now.status != before.status),
        (News::Pose, now.estimate != before.estimate),
        (News::Refusal, now.reason != before.reason),
        (News::Protection, now.protection != before.protection),
        (
            News::Sightings,
            (now.sightings, now.used) != (before.sightings, before.used)
                || now.residuals != before.residuals,
        ),
        (News::Reference, now.reference != before.reference),
        (News::Silent, now.silent != before.silent),
        (News::Failure, now.failures != before.failures),
        (News::Moved, now.truth != before.truth),
    ];
    let mut news: Vec<_> = { told.into_iter() }
        .filter_map(|(news, is_so)| is_so.then_some(news))
        .collect();
    if news.is_empty() {
        news.push(News::Other);
    }
    news
}

fn target_changes(before: Option<&Target>, now: &Target) -> Vec<What> {
    let whole = || vec![What::Target { is: now.clone() }];
    let Some(before) = before else {
        return whole();
    };
    if before == now {
        return Vec::new();
    }
    let mut folded = before.clone();
    let mut whats = Vec::new();
    // Mostly each is where it was: to search for all of them takes long after months.
    let is_there = |place: usize, stop: &Stop| {
        before.stops.get(place) == Some(stop) || before.stops.contains(stop)
    };
    let stops = now.stops.iter().enumerate();
    for (_, stop) in stops.filter(|(place, stop)| !is_there(*place, stop)) {
        folded.set_stop(stop);
        whats.push(What::Stop {
            target: now.id,
            begins: !before.stops.iter().any(|own| own.stop == stop.stop),
            is: *stop,
        });
    }
    if folded == *now { whats } else { whole() }
}

/// The events of a run that is over, as far as its record tells when things happened: stops as they
/// began, poses when they were first known, with their last values.
pub fn of_record(record: &RunRecord, cut_short: Option<&str>) -> Vec<Event> {
    let posed = record.nodes.iter().filter_map(|n| n.calibrated_seconds);
    let stops = record.targets.iter().flat_map(|target| &target.stops);
    let mut instants: Vec<f64> = posed.chain(stops.filter_map(|stop| stop.seconds)).collect();
    instants.push(0.0);
    instants.sort_by(f64::total_cmp);
    instants.dedup();
    let mut looker = Looker::default();
    let mut events = Vec::new();
    for seconds in instants {
        let mut then = RunRecord {
            sim_seconds: seconds,
            radio: None,
            sightings: Vec::new(),
            ..record.clone()
        };
        for node in &mut then.nodes {
            if node.calibrated_seconds.is_none_or(|at| at > seconds) {
                *node = as_put_up(node);
            }
        }
        for target in &mut then.targets {
            let has_begun = |stop: &Stop| stop.seconds.is_some_and(|at| at <= seconds);
            target.stops.retain(has_begun);
            target.path = target.stops.iter().map(|stop| [stop.x, stop.y]).collect();
        }
        then.summary = Summary::of(&then.nodes);
        events.extend(looker.look(&then));
    }
    events.extend(looker.end(record, cut_short));
    events
}

/// A node before anything is known of it but where it was put.
fn as_put_up(node: &Node) -> Node {
    Node {
        network: node.network,
        reference: node.reference,
        expected: node.expected,
        truth: node.truth,
        planned: node.planned,
        view: node.view,
        address: node.address,
        status: (node.status.is_some()).then_some(Status::Waiting),
        ..Node::new(node.id, node.role)
    }
}

impl fmt::Display for CommandState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Asked => "asked for",
            Self::Done => "done",
            Self::Failed => "failed",
        })
    }
}
