//! The talk with a coordinator. Input: bytes and the time; output: bytes.
//!
//! The coordinator answers in the order in which it was asked, so an answer belongs to the last
//! question if the line was quiet before. That is why a wish waits until the list of members has
//! come to its end.

use std::{
    collections::{BTreeMap, VecDeque},
    time::Duration,
};

use node_firmware::{
    config::SiteKey,
    console::{FRAME_MAX, Frames, FromPc, KeyChangeReport, ToPc, TrackedObject, encode},
    message::{CameraCommand, CommandOutcome, MemberAddress, Restart, SitePlace, TargetLocation},
};

use results::{
    record::event::{ObjectPlace, What},
    view::NetworkView,
};

/// Silence after which there is no coordinator.
const FIRST_ANSWER: Duration = Duration::from_secs(5);
/// Time after which everything that was not answered is asked for again.
const ASK_AGAIN: Duration = Duration::from_secs(1);
/// Period with which everything is asked for: it brings what the coordinator could not tell before.
const REFRESH: Duration = Duration::from_secs(10);
/// The same while the site key is handed on: the coordinator tells of that only when asked.
const REFRESH_KEY: Duration = Duration::from_secs(2);
/// Time without a new member after which the list of members is at its end.
const SETTLED: Duration = Duration::from_secs(1);
/// Period with which a camera is asked for sightings that it has not told: they are sent by radio, one
/// by one.
const ASK_FOR_SIGHTINGS: Duration = Duration::from_secs(10);
/// Time that a camera takes to tell them all.
const LISTING: Duration = Duration::from_secs(5);
/// Time for which a wish waits for a member that is not on the list.
pub const MISSING: Duration = Duration::from_secs(10);

/// Wish of a person.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
    /// Let new devices join for so many seconds.
    JoinWindow(u16),
    /// Send a node away.
    Remove(u16),
    /// Give all members another site key.
    ChangeKey(SiteKey),
    /// Take another PAN identifier.
    ChangePan,
    /// Have a camera do something.
    Command(u16, CameraCommand),
    /// Have every camera that is a member do something.
    Everybody(CameraCommand),
    /// A target whose steps are not known stands here, in the frame of its network.
    Stands(u16, SitePlace),
}

impl Wish {
    /// Longest time for an answer; for an answer that has begun, until its end.
    fn patience(&self, step: Step) -> Duration {
        Duration::from_secs(match self {
            Self::JoinWindow(_) | Self::Remove(_) | Self::ChangePan | Self::Stands(..) => 10,
            // A camera adapts to the light for seconds, and may be asked again by radio.
            Self::Command(..) | Self::Everybody(_) => 60,
            // One member after the other, also those that cannot be reached.
            Self::ChangeKey(_) if matches!(step, Step::Begun(_)) => 600,
            Self::ChangeKey(_) => 10,
        })
    }
}

/// Reason why a talk or a wish does not go on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// Nothing came.
    #[error(
        "no coordinator answers: check that this is its port, the baud rate, that it is switched on, \
         and that its role is coordinator"
    )]
    Silence,
    /// Bytes came, but no message.
    #[error(
        "what comes makes no sense: check the baud rate, and that this is the port of a coordinator \
         of this version"
    )]
    Garbage,
    /// Text came.
    #[error("what comes is text, so no coordinator talks here: take the port of the coordinator")]
    Text,
    /// Commands of the camera came.
    #[error(
        "this node talks to a camera here: its role is camera, not coordinator; take the port of \
         the coordinator"
    )]
    CameraNode,
    /// Every camera was meant, and there is none.
    #[error("no camera is a member: switch them on, and open the join window")]
    NoCameras,
    /// No such member.
    #[error("node {id} is no member{}", list(.members))]
    NoMember {
        /// The node that was asked for.
        id: u16,
        /// The present members.
        members: Vec<u16>,
    },
    /// Only cameras do commands.
    #[error("node {0} is no camera")]
    NoCamera(u16),
    /// Only targets stand somewhere.
    #[error("node {0} is no target")]
    NoTarget(u16),
    /// No answer within the time.
    #[error("no confirmation came within {} s: {}", .0.as_secs(), .1)]
    Unconfirmed(Duration, &'static str),
    /// A camera did not do what it was told.
    #[error(
        "camera {0} did not do it, or cannot be reached: check that it is switched on, and for \
         learning that the object is in the middle of its view"
    )]
    CommandFailed(u16),
    /// A camera says why it does not do something.
    #[error("camera {0}: {1}")]
    CommandRefused(u16, CommandOutcome),
    /// The coordinator does not take the key.
    #[error(
        "the coordinator refuses the key: the one in use has index {0} too; make one with another \
         index (`host-sim keygen --index`)"
    )]
    KeyRefused(u8),
    /// It has no network, or changes it already.
    #[error(
        "the coordinator takes no other PAN identifier now: its network does not run yet, or is being moved"
    )]
    PanStays,
    /// It forgot about it.
    #[error("the coordinator started again before key {0} was in use: change it once more")]
    KeyLost(u8),
    /// It has another key of that index.
    #[error(
        "the coordinator hands on another key {0} than this one: change the key again, with another \
         index, and provision those that took the wrong one"
    )]
    KeyGarbled(u8),
}

fn list(members: &[u16]) -> String {
    if members.is_empty() {
        return ": there are none".to_owned();
    }
    let members: Vec<_> = members.iter().map(u16::to_string).collect();
    format!("; there are {}", members.join(", "))
}

/// Step of the wish whose turn it is.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// It waits for the end of the list, or for a member since this time.
    Looking(Option<Duration>),
    /// It was sent.
    Sent(Duration),
    /// The coordinator works on it.
    Begun(Duration),
}

/// Something to tell people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum News {
    /// The coordinator told it of its network.
    Network(String),
    /// The line or the coordinator fails.
    Trouble(String),
    /// The line or the coordinator is there again.
    Mended(String),
}

impl News {
    /// Its words.
    pub fn words(&self) -> &str {
        let (Self::Network(words) | Self::Trouble(words) | Self::Mended(words)) = self;
        words
    }
}

/// The talk with a coordinator. Times are since its begin.
#[derive(Debug)]
pub struct Session {
    frames: Frames,
    known: NetworkView,
    wishes: VecDeque<Wish>,
    step: Step,
    /// Time at which everything was asked for.
    asked: Option<Duration>,
    /// It was answered.
    answered: bool,
    /// Time at which a message came.
    heard: Option<Duration>,
    /// Time at which the list of members last grew, or an answer came.
    listed: Duration,
    /// The user was told that the coordinator does not answer any more.
    lost: bool,
    bytes: usize,
    /// Number of these bytes that are text.
    text: usize,
    /// Number of these bytes that a node sends to a CMUcam2.
    commands: usize,
    /// Number of frames that were no messages.
    damaged: u64,
    harm: Harm,
    /// The last byte ended a frame, or none has come.
    is_between: bool,
    failed: Option<Failure>,
    news: VecDeque<News>,
    /// Time at which each camera was last asked for its sightings, by its address.
    listed_sightings: BTreeMap<MemberAddress, Duration>,
    wants_sightings: bool,
    /// Time since which a first answer is waited for.
    patience_from: Duration,
    /// Events that the view does not contain.
    happened: VecDeque<What>,
}

/// Damaged messages of late.
#[derive(Debug, Default)]
struct Harm {
    since: Duration,
    count: usize,
    told: Option<Duration>,
}

/// Time within which damaged messages are counted, and number of them that is told.
const HARM: (Duration, usize) = (Duration::from_secs(30), 5);

impl Harm {
    /// Counts one. Returns news once there are many, and again while it goes on.
    fn counted(&mut self, now: Duration) -> Option<News> {
        let (within, many) = HARM;
        let is_over = |at: Duration| now.saturating_sub(at) > within;
        if is_over(self.since) {
            (self.since, self.count) = (now, 0);
        }
        self.count += 1;
        let is_due = self.count >= many && self.told.is_none_or(is_over);
        is_due.then(|| {
            self.told = Some(now);
            let news = "messages come damaged: what is told of nodes may be of before; check the cable, its length and \
                        its plugs";
            News::Trouble(news.to_owned())
        })
    }
}

/// Number of events that are kept at once: no reader needs more.
const HAPPENED_MAX: usize = 512;

impl Session {
    /// A talk with these wishes, one after the other.
    pub fn new(wishes: impl IntoIterator<Item = Wish>) -> Self {
        Self {
            frames: Frames::default(),
            known: NetworkView::default(),
            wishes: wishes.into_iter().collect(),
            step: Step::Looking(None),
            asked: None,
            answered: false,
            heard: None,
            listed: Duration::ZERO,
            lost: false,
            bytes: 0,
            text: 0,
            commands: 0,
            damaged: 0,
            harm: Harm::default(),
            is_between: true,
            failed: None,
            news: VecDeque::new(),
            listed_sightings: BTreeMap::new(),
            wants_sightings: false,
            patience_from: Duration::ZERO,
            happened: VecDeque::new(),
        }
    }

    /// Tells lengths in this unit.
    pub fn tell_in(&mut self, unit: &str) {
        self.known.tell_in(unit);
    }

    /// Asks every camera for its sightings too, when it has new ones.
    pub const fn want_sightings(&mut self) {
        self.wants_sightings = true;
    }

    /// Returns true if every camera has told the sightings that it was asked for, or will not.
    pub fn has_sightings(&self, now: Duration) -> bool {
        let mut cameras = self.known.cameras().into_iter();
        let asked = |address| self.listed_sightings.get(&address);
        !self.wants_sightings
            || cameras.all(|camera| {
                let waited = |at: &Duration| now.saturating_sub(*at) >= LISTING;
                !camera.has_untold_sightings() || asked(camera.address).is_some_and(waited)
            })
    }

    /// The network as it is known.
    pub fn known(&self) -> &NetworkView {
        &self.known
    }

    /// Returns true if the coordinator has told anything.
    pub fn has_answered(&self) -> bool {
        self.heard.is_some()
    }

    /// Returns true if every wish was confirmed.
    pub fn is_done(&self) -> bool {
        self.wishes.is_empty()
    }

    /// The next thing to tell people.
    pub fn news(&mut self) -> Option<News> {
        self.news.pop_front()
    }

    /// Number of damaged or unknown messages since the last call.
    pub fn damaged(&mut self) -> u64 {
        std::mem::take(&mut self.damaged)
    }

    /// Takes the bytes that came on the line.
    pub fn heard(&mut self, now: Duration, bytes: &[u8]) {
        for &byte in bytes {
            self.bytes += 1;
            if matches!(byte, b' '..=b'~' | b'\r' | b'\n') {
                self.text += 1;
            }
            if matches!(byte, b'A'..=b'Z' | b'0'..=b'9' | b' ' | b'\r') {
                self.commands += 1;
            }
            match self.frames.push(byte) {
                Some(message) => self.take(now, &message),
                // The end of a frame that was none.
                None if byte == 0 => {
                    if !self.is_between {
                        self.damaged += 1;
                        self.news.extend(self.harm.counted(now));
                    }
                    self.known.missed(now);
                }
                None => {}
            }
            self.is_between = byte == 0;
        }
    }

    fn take(&mut self, now: Duration, message: &ToPc) {
        self.heard = Some(now);
        if std::mem::take(&mut self.lost) {
            let news = "the coordinator answers again";
            self.news.push_back(News::Mended(news.to_owned()));
        }
        let members = self.known.members().len();
        // Looked up before the member is forgotten.
        let removed = match *message {
            ToPc::Removed { address, .. } => {
                let mut members = self.known.members().iter();
                members.find(|m| m.address == address).map(|m| m.id)
            }
            _ => None,
        };
        if let Some(what) = self.what(message) {
            self.happened.truncate(HAPPENED_MAX - 1);
            self.happened.push_back(what);
        }
        let before = self.known.health().restart;
        let told = self.known.take(now, message);
        let restart = self.known.health().restart;
        let has_failed = restart != before && restart != Restart::Ordinary;
        self.news.extend(told.map(|words| match has_failed {
            true => News::Trouble(words),
            false => News::Network(words),
        }));
        match message {
            ToPc::KeyChange(_) => {
                self.answered = true;
                self.listed = now;
            }
            ToPc::Network(_) => self.listed = now,
            _ if self.known.members().len() > members => self.listed = now,
            _ => {}
        }
        if let (Some(wish), Step::Sent(_) | Step::Begun(_)) = (self.wishes.front(), self.step) {
            self.confirm(now, *wish, message, removed);
        }
    }

    /// Event of a message that the view does not contain; called before the view takes the message.
    fn what(&self, message: &ToPc) -> Option<What> {
        match message {
            ToPc::Tracked { address, tracked } => {
                Some(What::tracked(self.known.id_of(*address)?, tracked))
            }
            ToPc::Object { id, object } if object.as_ref().is_none_or(TrackedObject::is_usable) => {
                Some(What::Object {
                    network: 0,
                    object: *id,
                    is: object.as_ref().map(ObjectPlace::from),
                })
            }
            ToPc::Sighting { address, sighting } if self.known.is_seen_now(*address, sighting) => {
                Some(What::Seen {
                    node: self.known.id_of(*address)?,
                    target: self.known.id_of(sighting.target)?,
                    stop: Some(sighting.stop.into()),
                    bearing_deg: f64::from(sighting.seen.bearing).to_degrees(),
                    sigma_deg: f64::from(sighting.seen.sigma).to_degrees(),
                })
            }
            _ => None,
        }
    }

    /// Takes in a message that tells the result of the wish.
    fn confirm(&mut self, now: Duration, wish: Wish, message: &ToPc, removed: Option<u16>) {
        match (wish, *message) {
            // The coordinator does not confirm this, but it answers the question that came after it.
            (Wish::JoinWindow(seconds), ToPc::Network(_)) => {
                self.news.push_back(News::Network(match seconds {
                    0 => "join window: asked to close it".to_owned(),
                    _ => format!("join window: asked to open it for {seconds} s"),
                }));
                self.confirmed();
            }
            (Wish::Remove(id), ToPc::Removed { .. }) if removed == Some(id) => {
                if self.known.addresses(id).is_empty() {
                    self.confirmed();
                } else {
                    self.step = Step::Looking(None);
                }
            }
            (Wish::Command(id, command), ToPc::Done { address, done })
                if self.known.addresses(id).last() == Some(&address) && done.command == command =>
            {
                match done.outcome {
                    CommandOutcome::Done | CommandOutcome::Learnt(_) => self.confirmed(),
                    CommandOutcome::Failed => self.failed = Some(Failure::CommandFailed(id)),
                    CommandOutcome::CommonColour(_) | CommandOutcome::PartOfObject => {
                        self.failed = Some(Failure::CommandRefused(id, done.outcome));
                    }
                }
            }
            (
                Wish::Stands(id, (position, _)),
                ToPc::Stopped {
                    address,
                    place: Some((told, _)),
                    ..
                },
            ) if self.known.id_of(address) == Some(id) && told == position => self.confirmed(),
            // Also told without a question, then without a change.
            (Wish::ChangePan, ToPc::Pan { changes, .. }) => match changes {
                true => self.confirmed(),
                false => self.failed = Some(Failure::PanStays),
            },
            (Wish::ChangeKey(key), ToPc::KeyChange(change)) => {
                let index = key.index();
                match (change, self.step) {
                    (
                        Some(KeyChangeReport {
                            index: i,
                            check,
                            done,
                            ..
                        }),
                        _,
                    ) if i == index => {
                        let own = key.key().map(|key| key.check_value());
                        if own != Some(check) {
                            self.failed = Some(Failure::KeyGarbled(index));
                        } else if done {
                            self.confirmed();
                        } else if let Step::Sent(_) = self.step {
                            self.step = Step::Begun(now);
                        }
                    }
                    (_, Step::Begun(_)) => self.failed = Some(Failure::KeyLost(index)),
                    _ => self.failed = Some(Failure::KeyRefused(index)),
                }
            }
            _ => {}
        }
    }

    /// Adds a wish.
    pub fn wish(&mut self, wish: Wish) {
        self.wishes.push_back(wish);
    }

    /// Goes on after a failure: all wishes are given up, and silence is no failure before the time of a
    /// first answer has passed again.
    pub fn go_on(&mut self, now: Duration) {
        self.wishes.clear();
        self.step = Step::Looking(None);
        self.patience_from = now;
    }

    /// Begins anew on a line that was away: what was asked for is asked for again.
    pub fn begin_again(&mut self, now: Duration) {
        self.frames = Frames::default();
        self.step = Step::Looking(None);
        self.asked = None;
        self.answered = false;
        self.patience_from = now;
    }

    /// The next event that the view does not contain, in the network of this number.
    pub fn happening(&mut self, number: u16) -> Option<What> {
        let mut what = self.happened.pop_front()?;
        if let What::Object { network, .. } = &mut what {
            *network = number;
        }
        Some(what)
    }

    fn confirmed(&mut self) {
        self.wishes.pop_front();
        self.step = Step::Looking(None);
    }

    /// Returns true if all members are listed.
    pub fn is_settled(&self, now: Duration) -> bool {
        self.answered && now.saturating_sub(self.listed) >= SETTLED
    }

    /// The next message to send; call it until there is none.
    ///
    /// # Errors
    /// [`Failure`]: the talk cannot go on.
    pub fn poll(&mut self, now: Duration) -> Result<Option<FromPc>, Failure> {
        if let Some(failed) = self.failed.take() {
            return Err(failed);
        }
        match self.heard {
            None if now >= self.patience_from + FIRST_ANSWER => return Err(self.why_nothing()),
            Some(_) if self.known.is_silent(now) && !self.lost => {
                self.lost = true;
                let news =
                    "the coordinator does not answer any more: check its cable and its power";
                self.news.push_back(News::Trouble(news.to_owned()));
            }
            _ => {}
        }
        if let Some(&wish) = self.wishes.front()
            && let Some(sent) = self.pursue(now, wish)?
        {
            return Ok(Some(sent));
        }
        Ok(self.refresh(now).or_else(|| self.ask_for_sightings(now)))
    }

    fn ask_for_sightings(&mut self, now: Duration) -> Option<FromPc> {
        if !self.wants_sightings || !self.wishes.is_empty() || !self.is_settled(now) {
            return None;
        }
        let is_due = |address| {
            let asked = self.listed_sightings.get(&address);
            asked.is_none_or(|&at| now.saturating_sub(at) >= ASK_FOR_SIGHTINGS)
        };
        let cameras = self.known.cameras().into_iter();
        let mut untold = cameras.filter(|camera| camera.has_untold_sightings());
        let address = untold.find(|camera| is_due(camera.address))?.address;
        self.listed_sightings.insert(address, now);
        self.known.asks(now, address);
        Some(FromPc::Sightings(address))
    }

    /// Reason why nothing was understood so far.
    pub fn why_nothing(&self) -> Failure {
        match (self.bytes, self.text) {
            (0, _) => Failure::Silence,
            (bytes, _) if bytes == self.commands => Failure::CameraNode,
            (bytes, text) if bytes == text => Failure::Text,
            _ => Failure::Garbage,
        }
    }

    fn refresh(&mut self, now: Duration) -> Option<FromPc> {
        let every = match (self.wishes.front(), self.step) {
            // Its next answer belongs to the wish.
            (Some(Wish::ChangeKey(_) | Wish::ChangePan), Step::Sent(_)) => return None,
            _ if !self.answered => ASK_AGAIN,
            (Some(Wish::ChangeKey(_)), Step::Begun(_)) => REFRESH_KEY,
            _ => REFRESH,
        };
        let is_due = self
            .asked
            .is_none_or(|asked| now.saturating_sub(asked) >= every);
        is_due.then(|| {
            self.asked = Some(now);
            self.answered = false;
            FromPc::Refresh
        })
    }

    fn pursue(&mut self, now: Duration, wish: Wish) -> Result<Option<FromPc>, Failure> {
        let since = match self.step {
            Step::Looking(since) if self.is_settled(now) => since.unwrap_or(now),
            Step::Looking(_) => return Ok(None),
            Step::Sent(since) | Step::Begun(since) => {
                let patience = wish.patience(self.step);
                if now.saturating_sub(since) < patience {
                    return Ok(None);
                }
                let why = match wish {
                    Wish::JoinWindow(_) => "whether new nodes may join is not known",
                    Wish::Remove(_) => "type it again; a node that is away is removed all the same",
                    Wish::ChangeKey(_) => {
                        "keep both keys; listen to hear when the new one is in use"
                    }
                    Wish::ChangePan => "type it again",
                    Wish::Stands(..) => {
                        "its step sensor works, or it cannot be reached: check that it is switched on"
                    }
                    Wish::Command(..) | Wish::Everybody(_) => {
                        "check that the camera is switched on"
                    }
                };
                return Err(Failure::Unconfirmed(patience, why));
            }
        };
        if let Wish::Everybody(command) = wish {
            let cameras = self.known.cameras();
            if cameras.is_empty() {
                self.step = Step::Looking(Some(since));
                return match now.saturating_sub(since) >= MISSING {
                    true => Err(Failure::NoCameras),
                    false => Ok(None),
                };
            }
            self.wishes.pop_front();
            for camera in cameras.into_iter().rev() {
                self.wishes.push_front(Wish::Command(camera.id, command));
            }
            return Ok(None);
        }
        let address = match wish {
            Wish::Remove(id) => self.known.addresses(id).first().copied(),
            Wish::Command(id, _) | Wish::Stands(id, _) => self.known.addresses(id).last().copied(),
            Wish::JoinWindow(_) | Wish::ChangeKey(_) | Wish::ChangePan | Wish::Everybody(_) => {
                Some(0)
            }
        };
        let Some(address) = address else {
            self.step = Step::Looking(Some(since));
            return match wish {
                Wish::Remove(id) | Wish::Command(id, _) | Wish::Stands(id, _)
                    if now.saturating_sub(since) >= MISSING =>
                {
                    let members = self.known.present().iter().map(|m| m.id).collect();
                    Err(Failure::NoMember { id, members })
                }
                _ => Ok(None),
            };
        };
        let sent = match wish {
            Wish::JoinWindow(seconds) => {
                // The answer to the next question shows that this message came, too.
                self.asked = None;
                FromPc::JoinWindow(seconds)
            }
            Wish::Remove(_) => FromPc::Remove(address),
            Wish::ChangeKey(key) => FromPc::ChangeKey(key),
            Wish::ChangePan => FromPc::ChangePan,
            // Only commands for single cameras are left here.
            Wish::Everybody(_) => return Ok(None),
            Wish::Command(id, command) => {
                let mut members = self.known.present().into_iter();
                if !members.any(|member| member.id == id && member.is_camera()) {
                    return Err(Failure::NoCamera(id));
                }
                FromPc::Command { address, command }
            }
            Wish::Stands(id, place) => {
                let mut members = self.known.present().into_iter();
                if !members.any(|member| member.id == id && !member.is_camera()) {
                    return Err(Failure::NoTarget(id));
                }
                let located = TargetLocation::of_place(place);
                FromPc::Located { address, located }
            }
        };
        self.step = Step::Sent(now);
        Ok(Some(sent))
    }
}

/// A message as bytes for the line. A zero before it ends what noise may have begun.
pub fn frame(message: &FromPc) -> Vec<u8> {
    let mut buffer = [0; FRAME_MAX];
    // The longest message has a third of that.
    let frame = encode(message, &mut buffer).unwrap_or(&[]);
    [&[0], frame].concat()
}

#[cfg(test)]
mod tests {
    use node_firmware::{
        console::NetworkInfo,
        message::{
            CameraState, CommandResult, Health, Hello, ListedSighting, MemberAddress, MemberKind,
            PoseParts, Report, Seen,
        },
    };
    use results::view::are_calibrated;

    use super::*;

    const CAMERA: MemberKind = MemberKind::Camera { reference: None };

    fn member(address: MemberAddress, id: u16, kind: MemberKind) -> ToPc {
        let hello = Hello { id, kind };
        ToPc::Member { address, hello }
    }

    fn reported(address: MemberAddress, id: u16, state: CameraState) -> ToPc {
        let report = Report {
            id,
            duty: None,
            sightings: 4,
            used: 3,
            chi_squared: 1.5,
            done: false,
            joint: None,
            state,
            mount: None,
        };
        ToPc::Report { address, report }
    }

    fn pose() -> CameraState {
        CameraState::Calibrated(PoseParts {
            position: [1.0, -2.0],
            heading: core::f32::consts::FRAC_PI_2,
            covariance: [0.04, 0.0, 0.09, 0.0, 0.0, 0.0001],
        })
    }

    const NETWORK: ToPc = ToPc::Network(Some(NetworkInfo {
        pan: 1,
        channel: 11,
    }));

    fn at(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    fn tell(session: &mut Session, now: u64, messages: &[ToPc]) {
        for message in messages {
            session.heard(at(now), encode(message, &mut [0; FRAME_MAX]).unwrap());
        }
    }

    /// A talk in which camera 7 at address 1 and target 4 at address 2 were listed within 100 ms.
    fn listed(wishes: &[Wish]) -> Session {
        let mut session = Session::new(wishes.iter().copied());
        assert_eq!(session.poll(at(0)), Ok(Some(FromPc::Refresh)));
        let messages = [
            NETWORK,
            ToPc::KeyChange(None),
            member(1, 7, CAMERA),
            member(2, 4, MemberKind::Target),
        ];
        tell(&mut session, 100, &messages);
        assert_eq!(session.poll(at(1_000)), Ok(None), "the list may go on");
        session
    }

    #[test]
    fn why_nobody_is_understood() {
        for (bytes, failure) in [
            (&b""[..], Failure::Silence),
            (b"GV\rRS\r", Failure::CameraNode),
            (b"$GPGGA,101,4807.0,N\r\n", Failure::Text),
            (b"raspberrypi login: ", Failure::Text),
            (b"\xF8\x80\x00\x1C", Failure::Garbage),
        ] {
            let mut session = Session::new([]);
            session.heard(at(10), bytes);
            for second in 0..5 {
                let sent = session.poll(at(1_000 * second));
                assert_eq!(sent, Ok(Some(FromPc::Refresh)), "asked again");
            }
            assert_eq!(session.poll(at(5_000)), Err(failure));
            assert!(!session.has_answered());
        }
    }

    #[test]
    fn everything_is_asked_for_now_and_then_and_silence_is_told() {
        let mut session = listed(&[]);
        assert_eq!(session.poll(at(9_999)), Ok(None));
        assert_eq!(session.poll(at(10_000)), Ok(Some(FromPc::Refresh)));
        while session.news().is_some() {}
        session.poll(at(20_100)).unwrap();
        let news = session.news().unwrap();
        let is_trouble =
            matches!(&news, News::Trouble(words) if words.contains("not answer any more"));
        assert!(is_trouble, "{news:?}");
        session.poll(at(20_200)).unwrap();
        assert_eq!(session.news(), None, "told once");
        tell(&mut session, 30_000, &[NETWORK]);
        let again = News::Mended("the coordinator answers again".to_owned());
        assert_eq!(session.news(), Some(again));
    }

    #[test]
    fn calibrated_when_the_list_is_at_its_end() {
        let mut session = listed(&[]);
        tell(&mut session, 200, &[reported(1, 7, pose())]);
        let is_calibrated = |session: &Session, now| {
            session.is_settled(now) && are_calibrated([session.known()], 1)
        };
        assert!(!is_calibrated(&session, at(900)));
        assert!(is_calibrated(&session, at(1_200)));
        // Another member joins.
        tell(&mut session, 1_300, &[member(3, 8, CAMERA)]);
        assert!(!is_calibrated(&session, at(3_000)));
    }

    #[test]
    fn the_join_window_is_confirmed_by_the_next_answer() {
        let mut session = listed(&[Wish::JoinWindow(60)]);
        assert_eq!(session.poll(at(1_200)), Ok(Some(FromPc::JoinWindow(60))));
        assert_eq!(session.poll(at(1_200)), Ok(Some(FromPc::Refresh)));
        assert!(!session.is_done());
        tell(&mut session, 1_300, &[NETWORK]);
        assert!(session.is_done());
    }

    #[test]
    fn every_address_of_a_node_is_sent_away() {
        let mut session = listed(&[Wish::Remove(7)]);
        tell(&mut session, 1_100, &[member(3, 7, CAMERA)]);
        for (now, address) in [(2_200, 1), (2_400, 3)] {
            assert_eq!(session.poll(at(now)), Ok(Some(FromPc::Remove(address))));
            let removed = |address| ToPc::Removed {
                address,
                success: true,
            };
            tell(&mut session, now, &[removed(2)]);
            assert!(!session.is_done());
            tell(&mut session, now, &[removed(address)]);
        }
        assert!(session.is_done());
        assert!(session.known().addresses(7).is_empty());
    }

    #[test]
    fn who_is_no_member_is_waited_for_a_while() {
        let mut session = listed(&[Wish::Remove(9)]);
        assert_eq!(session.poll(at(1_200)), Ok(None));
        session.poll(at(10_900)).unwrap();
        tell(&mut session, 10_900, &[NETWORK, ToPc::KeyChange(None)]);
        let members = vec![4, 7];
        let failure = Failure::NoMember { id: 9, members };
        assert_eq!(session.poll(at(12_000)), Err(failure));
    }

    #[test]
    fn every_camera_is_told_one_after_the_other() {
        let track = CameraCommand::Track { colour: 0 };
        let done = |address| ToPc::Done {
            address,
            done: CommandResult {
                command: track,
                outcome: CommandOutcome::Done,
            },
        };
        let mut session = listed(&[Wish::Everybody(track)]);
        let cameras = session.known().cameras();
        let cameras: Vec<(u16, u16)> = cameras.iter().map(|m| (m.id, m.address)).collect();
        assert!(!cameras.is_empty());
        let mut now = 1_100;
        for &(_, address) in &cameras {
            let sent = (0..10).find_map(|_| {
                now += 10;
                session
                    .poll(at(now))
                    .unwrap()
                    .filter(|sent| *sent != FromPc::Refresh)
            });
            assert_eq!(
                sent,
                Some(FromPc::Command {
                    address,
                    command: track
                })
            );
            assert!(!session.is_done());
            tell(&mut session, now, &[done(address)]);
        }
        assert!(session.is_done());
        // In a network without any camera it is no success.
        let mut session = Session::new([Wish::Everybody(track)]);
        session.poll(at(0)).unwrap();
        tell(&mut session, 100, &[NETWORK, ToPc::KeyChange(None)]);
        assert_eq!(session.poll(at(1_200)), Ok(None));
        session.poll(at(10_900)).unwrap();
        tell(&mut session, 10_900, &[NETWORK, ToPc::KeyChange(None)]);
        assert_eq!(session.poll(at(12_000)), Err(Failure::NoCameras));
    }

    /// A line may carry any values.
    #[test]
    fn objects_that_are_nowhere_are_not_told() {
        let mut session = listed(&[]);
        let object = |x| TrackedObject {
            place: ([x, 1.0], [0.1, 0.0, 0.1]),
            velocity: [0.0; 2],
            unseen_ms: 0,
        };
        let told = [f32::NAN, 2.0, f32::INFINITY].map(|x| ToPc::Object {
            id: 3,
            object: Some(object(x)),
        });
        tell(&mut session, 2_000, &told);
        let what = What::Object {
            network: 2,
            object: 3,
            is: Some(ObjectPlace::from(&object(2.0))),
        };
        assert_eq!(session.happening(2), Some(what));
        assert_eq!(session.happening(2), None);
    }

    /// A camera lists all its sightings, and again: rays are only of those from the time of listening.
    #[test]
    fn a_sighting_is_told_once_and_only_of_a_stop_that_was_told() {
        let mut session = listed(&[]);
        let sighting = |index, stop| ToPc::Sighting {
            address: 1,
            sighting: ListedSighting {
                index,
                count: 2,
                target: 2,
                stop,
                position: [3.0, 4.0],
                position_sigma: 0.1,
                seen: Seen::direction(0.5, 0.01),
            },
        };
        let stands = ToPc::Stopped {
            address: 2,
            stop: 7,
            place: Some(([3.0, 4.0], [0.01, 0.0, 0.02])),
        };
        let listing = [sighting(0, 6), sighting(1, 7)];
        tell(&mut session, 2_000, &[stands]);
        tell(&mut session, 2_100, &listing);
        tell(&mut session, 2_200, &listing);
        let seen = What::Seen {
            node: 7,
            target: 4,
            stop: Some(7),
            bearing_deg: f64::from(0.5_f32).to_degrees(),
            sigma_deg: f64::from(0.01_f32).to_degrees(),
        };
        assert_eq!(session.happening(1), Some(seen));
        assert_eq!(session.happening(1), None);
    }

    #[test]
    fn a_command_is_confirmed_by_its_camera_only() {
        let forget = Wish::Command(7, CameraCommand::Forget);
        for success in [true, false] {
            let mut session = listed(&[forget]);
            let sent = FromPc::Command {
                address: 1,
                command: CameraCommand::Forget,
            };
            assert_eq!(session.poll(at(1_200)), Ok(Some(sent)));
            let done = |address, command| {
                let done = CommandResult {
                    command,
                    outcome: CommandOutcome::of(success),
                };
                ToPc::Done { address, done }
            };
            tell(&mut session, 1_300, &[done(3, CameraCommand::Forget)]);
            tell(&mut session, 1_300, &[done(1, CameraCommand::Initialise)]);
            assert_eq!(session.poll(at(1_400)), Ok(None));
            assert!(!session.is_done());
            tell(&mut session, 1_500, &[done(1, CameraCommand::Forget)]);
            assert_eq!(session.is_done(), success);
            if !success {
                assert_eq!(session.poll(at(1_600)), Err(Failure::CommandFailed(7)));
            }
        }
        let mut session = listed(&[forget]);
        session.poll(at(1_200)).unwrap();
        session.poll(at(10_000)).unwrap();
        let failure = session.poll(at(61_200)).unwrap_err();
        assert!(matches!(failure, Failure::Unconfirmed(..)), "{failure:?}");
        let mut session = listed(&[Wish::Command(4, CameraCommand::Forget)]);
        assert_eq!(session.poll(at(1_200)), Err(Failure::NoCamera(4)));
    }

    /// The target tells the stop; one at another place, or of another target, is no answer.
    #[test]
    fn a_told_place_is_confirmed_by_the_stop_there() {
        let place = ([2.5, 4.0], [1e-4, 0.0, 1e-4]);
        let stopped = |address, [x, y]: [f32; 2]| ToPc::Stopped {
            address,
            stop: 3,
            place: Some(([x, y], [0.1, 0.0, 0.1])),
        };
        let mut session = listed(&[Wish::Stands(4, place)]);
        let sent = FromPc::Located {
            address: 2,
            located: TargetLocation::of_place(place),
        };
        assert_eq!(session.poll(at(1_200)), Ok(Some(sent)));
        let others = [stopped(2, [2.5, 4.5]), stopped(1, [2.5, 4.0])];
        tell(&mut session, 1_300, &others);
        assert!(!session.is_done());
        tell(&mut session, 1_400, &[stopped(2, [2.5, 4.0])]);
        assert!(session.is_done());

        let mut session = listed(&[Wish::Stands(4, place)]);
        session.poll(at(1_200)).unwrap();
        session.poll(at(10_000)).unwrap();
        let failure = session.poll(at(11_200)).unwrap_err();
        assert!(failure.to_string().contains("its step sensor works"));
        let mut session = listed(&[Wish::Stands(7, place)]);
        assert_eq!(session.poll(at(1_200)), Err(Failure::NoTarget(7)));
    }

    #[test]
    fn a_coordinator_that_its_watchdog_restarted_is_trouble() {
        let mut session = listed(&[]);
        while session.news().is_some() {}
        let health = |restart| {
            let health = Health {
                restart,
                ..Health::default()
            };
            ToPc::Health { address: 0, health }
        };
        tell(&mut session, 1_300, &[health(Restart::Ordinary)]);
        assert_eq!(session.news(), None);
        tell(&mut session, 1_400, &[health(Restart::Program)]);
        assert!(matches!(session.news(), Some(News::Trouble(_))));
        tell(&mut session, 1_500, &[health(Restart::Program)]);
        assert_eq!(session.news(), None);
    }

    #[test]
    fn damaged_messages_are_counted_and_gaps_between_messages_are_not() {
        let mut session = listed(&[]);
        assert_eq!(session.damaged(), 0);
        session.heard(at(1_300), b"\0\0noise\0\0more");
        assert_eq!(session.damaged(), 1);
        session.heard(at(1_400), b"\0");
        tell(&mut session, 1_500, &[NETWORK]);
        assert_eq!((session.damaged(), session.damaged()), (1, 0));
    }

    /// One damaged message is asked for again in silence.
    #[test]
    fn a_line_that_damages_messages_is_named() {
        let mut session = listed(&[]);
        while session.news().is_some() {}
        let mut told = |seconds: u64| {
            session.heard(at(2_000 + 1_000 * seconds), b"noise\0");
            session.news().is_some()
        };
        assert!(!(0..4).any(&mut told));
        assert!(told(4));
        assert!(!(5..30).any(&mut told));
        // It goes on.
        assert!((30..70).any(&mut told));
        assert!(!(200..204).any(&mut told));
    }

    /// Users are told in the words that they type.
    #[test]
    fn what_became_of_a_command_is_told_in_its_words() {
        let mut session = listed(&[]);
        while session.news().is_some() {}
        let done = CommandResult {
            command: CameraCommand::LearnColour { colour: 1 },
            outcome: CommandOutcome::Failed,
        };
        tell(&mut session, 1_300, &[ToPc::Done { address: 1, done }]);
        let news = session.news().unwrap();
        let words = news.words();
        assert!(words.starts_with("camera 7: learn-colour=1: "), "{words}");
    }

    #[test]
    fn a_key_is_changed_when_it_is_in_use() {
        let key = SiteKey::new(2, *b"sixteen secrets!");
        let change = |index, done| {
            ToPc::KeyChange(Some(KeyChangeReport {
                index,
                check: key.key().unwrap().check_value(),
                done,
                unreached: 1,
            }))
        };
        let begin = || {
            let mut session = listed(&[Wish::ChangeKey(key)]);
            let sent = session.poll(at(1_200));
            assert_eq!(sent, Ok(Some(FromPc::ChangeKey(key))));
            // The answer to a question would be taken for that to the key.
            assert_eq!(session.poll(at(11_000)), Ok(None));
            assert!(matches!(
                session.poll(at(11_200)),
                Err(Failure::Unconfirmed(..))
            ));
            session
        };
        let mut session = begin();
        tell(&mut session, 11_100, &[change(2, false)]);
        assert!(!session.is_done());
        assert_eq!(session.poll(at(11_200)), Ok(Some(FromPc::Refresh)));
        tell(&mut session, 11_300, &[NETWORK, change(2, true)]);
        assert!(session.is_done());
        let news = std::iter::from_fn(|| session.news()).last().unwrap();
        assert_eq!(
            news.words(),
            "site key 2: in use; 1 members did not say that they have it"
        );

        let mut session = begin();
        let other = SiteKey::new(2, *b"sixteen secrets?").key().unwrap();
        let other = KeyChangeReport {
            index: 2,
            check: other.check_value(),
            done: false,
            unreached: 0,
        };
        tell(&mut session, 11_100, &[ToPc::KeyChange(Some(other))]);
        assert_eq!(session.poll(at(11_200)), Err(Failure::KeyGarbled(2)));

        let mut session = begin();
        tell(&mut session, 11_100, &[ToPc::KeyChange(None)]);
        assert_eq!(session.poll(at(11_200)), Err(Failure::KeyRefused(2)));
        let mut session = begin();
        tell(&mut session, 11_100, &[change(2, false)]);
        tell(&mut session, 11_200, &[ToPc::KeyChange(None)]);
        assert_eq!(session.poll(at(11_200)), Err(Failure::KeyLost(2)));
    }

    /// A conflict may be told at any time.
    #[test]
    fn another_pan_identifier_is_confirmed() {
        let pan = |changes| ToPc::Pan {
            conflict_s: Some(9),
            changes,
        };
        for changes in [true, false] {
            let mut session = listed(&[Wish::ChangePan]);
            tell(&mut session, 1_100, &[pan(false)]);
            assert_eq!(session.poll(at(2_200)), Ok(Some(FromPc::ChangePan)));
            tell(&mut session, 2_300, &[pan(changes)]);
            if changes {
                assert!(session.is_done());
            } else {
                assert_eq!(session.poll(at(2_400)), Err(Failure::PanStays));
            }
        }
    }

    #[test]
    fn noise_before_a_frame_is_ended() {
        let mut frames = Frames::default();
        let message = FromPc::Command {
            address: 0xFFFF,
            command: CameraCommand::LearnColour { colour: 3 },
        };
        let bytes = [&b"noise"[..], &frame(&message)].concat();
        let came: Vec<FromPc> = bytes.iter().filter_map(|&b| frames.push(b)).collect();
        assert_eq!(came, [message]);
    }
}
