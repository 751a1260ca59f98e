//! A target: it walks, stands, and tells cameras where (thesis 2.3, Appendix B).
//!
//! Steps move it. When none came for a while it stands, and says so to everybody. Cameras answer;
//! those of the roster that did not are asked one by one. When all have answered or cannot be
//! reached it shows that its carrier may walk on. Nothing but the carrier makes it walk.
//!
//! It does not know where it is before the first reference camera tells it, or before two cameras
//! that know their poses see it at one stop. From then on it reckons.

mod table;

use core::time::Duration;

use calib_core::{
    angle,
    dead_reckoning::{Place, PlaceParts, Step, Systematic, Track},
    intersection,
};
use nalgebra::{Matrix2, Point2, RealField, Rotation2, Vector2};
use zigbee_link::{Instant, store::Membership, wire::ShortAddress};

use self::table::Table;
pub use self::table::{CAMERAS, CameraEntry};
use super::{COORDINATOR, Output, Owed, Role};
use crate::{
    arithmetic::root,
    config::TargetConfig,
    hardware::Indication,
    memory::{Fact, Walk},
    message::{Bearing, Frame, Hello, Kind, Located, Message, Sight, StopNumber, Stopped, matrix},
};

/// After the broadcast of a stop, before cameras that did not answer are asked one by one: a look
/// takes a camera some 0.6 s, and there may be many.
const ASK_AFTER: Duration = Duration::from_millis(1500);

/// After an answer was asked for and the question delivered, before the camera counts as silent.
const ANSWER_WITHIN: Duration = Duration::from_secs(4);

/// A camera that is still starting is asked again after this.
const READY_AFTER: Duration = Duration::from_secs(2);

/// Cameras asked at a time.
const ASKED_AT_A_TIME: usize = 2;

/// While cameras see a target that does not know its place, it waits so long for being told.
const LOCATED_WITHIN: Duration = Duration::from_secs(2);

/// Stops that the first reference camera may still tell the place of.
const STOOD: usize = 4;

/// After a camera's bearing, before it is used: those of other cameras make the place better. The
/// first two may look along one line.
const BEARINGS_WITHIN: Duration = Duration::from_millis(400);

/// Why a target sends a message of which it must know the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Errand {
    /// It presents itself.
    Hello,
    /// It asks a camera of this place in its table for an answer.
    Ask(u8, StopNumber),
}

/// What the devices of a target tell.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// A step.
    Step(Step<f32>),
    /// The step sensor failed: from now on nobody knows where the target is.
    SensorFailed,
}

/// A target's state.
#[derive(Clone, Debug)]
pub struct Target {
    id: u16,
    config: TargetConfig,
    address: Option<ShortAddress>,
    track: Track<f32>,
    fixes: u32,
    located: bool,
    /// Direction of the sensor's x axis in the frame of the site, and its sigma.
    frame_heading: Option<(f32, f32)>,
    stop: StopNumber,
    state: State,
    /// The track at the last stop, in the frame it had there.
    at_stop: Track<f32>,
    /// The same of the last stops, for an answer that comes late.
    stood: heapless::Deque<(StopNumber, Track<f32>), STOOD>,
    /// The last place found from bearings, for the direction of the sensor: stop and track.
    found: Option<(Point2<f32>, Track<f32>)>,
    bearings: heapless::Vec<(ShortAddress, Bearing), 4>,
    /// When to find its place from them.
    locate_at: Option<Instant>,
    table: Table,
    /// The coordinator told which cameras there are, since the start.
    knows_cameras: bool,
    saves: heapless::Deque<Fact, 8>,
    hello: Owed,
    seen: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// The last step was then; `None`: nothing yet.
    Walking { last: Option<Instant> },
    /// It stands, and tells so.
    Standing(Standing),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Standing {
    since: Instant,
    /// Its stop is not written down yet; then it is told to everybody.
    announced: bool,
    /// Nothing before this.
    ask_at: Instant,
    /// Not told of its place yet, although cameras see it.
    wait_until: Option<Instant>,
    may_walk: bool,
}

impl Target {
    /// A target that knows nothing yet. `first_stop` should be random: a target that lost its
    /// memory must not use the numbers of former stops again.
    pub fn new(id: u16, config: TargetConfig, first_stop: StopNumber) -> Self {
        let track = nowhere(&config);
        Self {
            id,
            config,
            address: None,
            track,
            fixes: 0,
            located: false,
            frame_heading: None,
            stop: first_stop,
            state: State::Walking { last: None },
            at_stop: track,
            stood: heapless::Deque::new(),
            found: None,
            bearings: heapless::Vec::new(),
            locate_at: None,
            table: Table::new(),
            knows_cameras: false,
            saves: heapless::Deque::new(),
            hello: Owed::Nothing,
            seen: false,
        }
    }

    /// The cameras it knows of, with what they told of themselves: the table of Appendix B.
    pub fn cameras(&self) -> impl Iterator<Item = &CameraEntry> {
        self.table.iter()
    }

    /// Where it reckons to be, and whether that is in the frame of the site.
    pub fn position(&self) -> (Point2<f32>, bool) {
        (self.track.position(), self.located)
    }

    /// Where it stands, with its own count of fixes: a track that is begun anew does not know of
    /// those before.
    fn place(&self) -> Option<Place<f32>> {
        let reckoned = self.track.place(self.config.standing_sigma).ok()?;
        Place::new(PlaceParts {
            fix: self.fixes,
            ..*reckoned.parts()
        })
        .ok()
    }

    fn still_after(&self) -> Duration {
        Duration::from_millis(self.config.still_after_ms.into())
    }

    fn standing_deadline(&self, standing: &Standing) -> Option<Instant> {
        if !standing.announced {
            return Some(standing.since);
        }
        if standing.may_walk {
            return None;
        }
        let dwell = |ms: u32| standing.since + Duration::from_millis(ms.into());
        let mut deadline = dwell(self.config.dwell_most_ms);
        let next = if self.table.can_ask(ASKED_AT_A_TIME) {
            Some(standing.ask_at)
        } else if self.table.is_settled() && !self.knows_cameras {
            None
        } else if self.table.is_settled() {
            // The rest is time.
            let until = standing.wait_until.unwrap_or(standing.since);
            Some(
                dwell(self.config.dwell_least_ms)
                    .max(until)
                    .max(standing.ask_at),
            )
        } else {
            self.table.deadline()
        };
        if let Some(next) = next {
            deadline = deadline.min(next);
        }
        // Nothing is done before this.
        Some(deadline.max(standing.ask_at))
    }

    /// After a restart.
    fn resume(&mut self, walk: &Walk) {
        self.stop = walk.stop;
        if let Some(heading) = walk.frame_heading {
            self.frame_heading = Some((heading, walk.frame_heading_sigma));
        }
        let place = walk.place;
        self.fixes = place.parts().fix;
        if !walk.standing {
            // It walked, and nobody counted the steps since.
            self.fixes = self.fixes.wrapping_add(1);
            return;
        }
        self.track = Track::resume(&place);
        self.at_stop = self.track;
        let _ = self.stood.push_back((self.stop, self.track));
        self.located = walk.located;
        self.state = State::Standing(Standing {
            since: Instant(0),
            announced: false,
            ask_at: Instant(0),
            wait_until: None,
            may_walk: false,
        });
    }

    fn save(&mut self, fact: Fact) {
        let _ = self.saves.push_back(fact);
    }

    fn save_walk(&mut self) {
        let Some(place) = self.place() else {
            return;
        };
        let (heading, sigma) = self.frame_heading.unzip();
        self.save(Fact::Walk(Walk {
            stop: self.stop,
            standing: matches!(self.state, State::Standing(standing) if !standing.may_walk),
            place,
            located: self.located,
            frame_heading: heading,
            frame_heading_sigma: sigma.unwrap_or_default(),
        }));
    }

    fn stepped(&mut self, now: Instant, step: &Step<f32>) {
        if let State::Standing(standing) = self.state {
            self.state = State::Walking { last: Some(now) };
            if !standing.may_walk {
                self.save_walk();
            }
        }
        self.state = State::Walking { last: Some(now) };
        let turn = match (self.located, self.frame_heading) {
            (true, Some((heading, _))) => heading,
            _ => 0.0,
        };
        let step = Step {
            heading: step.heading + turn,
            ..*step
        };
        // A track may also grow too long for a place that can be sent.
        if self.track.advance(&step).is_err() || self.place().is_none() {
            self.lose(now);
        }
    }

    /// The place is not known any more: the sensor failed, or the target was carried unawares.
    fn lose(&mut self, now: Instant) {
        // A sensor that goes on failing makes no new stops.
        let was_lost = !self.located && self.track == nowhere(&self.config);
        self.located = false;
        self.found = None;
        self.fixes = self.fixes.wrapping_add(1);
        self.track = nowhere(&self.config);
        self.at_stop = self.track;
        self.stood.clear();
        if matches!(self.state, State::Standing(_)) && !was_lost {
            self.stand(now);
        }
    }

    fn stand(&mut self, now: Instant) {
        self.stop = self.stop.wrapping_add(1);
        self.bearings.clear();
        self.locate_at = None;
        self.at_stop = self.track;
        if self.stood.is_full() {
            let _ = self.stood.pop_front();
        }
        let _ = self.stood.push_back((self.stop, self.track));
        self.seen = false;
        self.state = State::Standing(Standing {
            since: now,
            announced: false,
            ask_at: now,
            wait_until: None,
            may_walk: false,
        });
        self.table.new_stop(!self.located);
        self.save_walk();
    }

    /// Told again, since the place is known now.
    fn tell_again(&mut self, now: Instant) {
        self.table.new_stop(!self.located);
        if let State::Standing(standing) = &mut self.state {
            standing.since = now;
            standing.announced = false;
            standing.ask_at = now;
            standing.wait_until = None;
            standing.may_walk = false;
        }
        self.save_walk();
    }

    fn stopped(&self) -> Option<Message> {
        Some(Message::Stopped(Stopped {
            stop: self.stop,
            colour: self.config.colour,
            frame: if self.located {
                Frame::Site
            } else {
                Frame::Own
            },
            place: self.place()?,
        }))
    }

    /// The target was found where its track was so. It may have walked on since.
    fn fix(
        &mut self,
        now: Instant,
        then: &Track<f32>,
        position: Point2<f32>,
        covariance: Matrix2<f32>,
        (heading, heading_sigma): (f32, f32),
    ) {
        let turn = Rotation2::new(heading);
        let since = self.track.since(then);
        let walked = turn * since.vector;
        let covariance = covariance + turn * since.covariance * turn.transpose();
        let systematic_heading = heading_sigma;
        let track = Track::start(
            position + walked,
            symmetric(covariance),
            systematic(&self.config, systematic_heading),
        );
        let Ok(track) = track else {
            return;
        };
        self.fixes = self.fixes.wrapping_add(1);
        self.track = track;
        self.at_stop = track;
        self.stood.clear();
        self.located = true;
        self.frame_heading = Some((heading, heading_sigma));
        if matches!(self.state, State::Standing(standing) if !standing.may_walk) {
            self.tell_again(now);
        } else {
            self.save_walk();
        }
    }

    fn located(&mut self, now: Instant, located: &Located) {
        let then = self.stood.iter().find(|(stop, _)| *stop == located.stop);
        let Some(&(_, then)) = then.filter(|_| located.is_usable() && !self.located) else {
            return;
        };
        self.fix(
            now,
            &then,
            Point2::from(located.position),
            matrix(located.covariance),
            (located.frame_heading, located.frame_heading_sigma),
        );
    }

    /// A camera that knows its pose saw this target, which does not know its place.
    fn bearing(&mut self, now: Instant, from: ShortAddress, bearing: &Bearing) {
        let is_mine = self.address.is_some_and(|own| own.0 == bearing.target);
        let is_of_use =
            bearing.seen.is_usable() && bearing.pose.is_some_and(|p| p.pose().is_some());
        if self.located || !is_mine || bearing.stop != self.stop || !is_of_use {
            return;
        }
        self.bearings.retain(|(known, _)| *known != from);
        if self.bearings.is_full() {
            return;
        }
        let _ = self.bearings.push((from, *bearing));
        let at = now + BEARINGS_WITHIN;
        self.locate_at = Some(at);
        if let State::Standing(standing) = &mut self.state {
            let until = standing.wait_until.map_or(at, |until| until.max(at));
            standing.wait_until = Some(until);
        }
    }

    /// From the bearings of all cameras that saw this target and know their poses.
    fn locate(&mut self, now: Instant) {
        if self.located {
            return;
        }
        let mut stations = heapless::Vec::<intersection::Bearing<f32>, 4>::new();
        for (_, bearing) in &self.bearings {
            if let Some(pose) = bearing.pose.and_then(|pose| pose.pose()) {
                // As many as there are bearings.
                let _ = stations.push(intersection::Bearing {
                    pose,
                    ray: bearing.seen.ray(),
                    bearing_sigma: bearing.seen.sigma,
                });
            }
        }
        let Ok(found) = intersection::locate(&stations) else {
            return;
        };
        let at_stop = self.at_stop;
        if let Some(heading) = self.frame_heading {
            self.fix(now, &at_stop, found.position, found.covariance, heading);
            return;
        }
        // The direction of the sensor follows from two places.
        if let Some((before, track)) = &self.found {
            let walked = self.at_stop.since(track);
            let apart = found.position - before;
            let distance = root(walked.vector.norm_squared());
            let sigma = root(found.covariance.trace() * 2.0 + walked.covariance.trace()) / distance;
            if distance > 0.0 && sigma < HEADING_LIMIT {
                let heading = angle::wrap_signed(direction(apart) - direction(walked.vector));
                self.fix(
                    now,
                    &at_stop,
                    found.position,
                    found.covariance,
                    (heading, sigma),
                );
                return;
            }
        }
        self.found = Some((found.position, self.at_stop));
    }

    fn standing(&mut self, now: Instant) -> Option<Output<Errand, ()>> {
        let message = self.stopped()?;
        let stop = self.stop;
        let State::Standing(standing) = &mut self.state else {
            return None;
        };
        if !standing.announced {
            standing.announced = true;
            standing.ask_at = now + ASK_AFTER;
            return Some(Output::Send {
                to: ShortAddress::BROADCAST,
                message,
                errand: None,
            });
        }
        // The carrier may have left already: nobody must look now.
        if now < standing.ask_at || standing.may_walk {
            return None;
        }
        self.table.give_up(now);
        let waited = now.since(standing.since);
        let most = Duration::from_millis(self.config.dwell_most_ms.into());
        if waited.saturating_add(ANSWER_WITHIN) >= most {
            // Whoever is asked now would not have the time to look.
            self.table.close();
        }
        if let Some((place, address)) = self.table.ask(ASKED_AT_A_TIME) {
            return Some(Output::Send {
                to: address,
                message,
                errand: Some(Errand::Ask(place, stop)),
            });
        }
        let is_done = self.table.is_settled()
            && self.knows_cameras
            && standing.wait_until.is_none_or(|until| until <= now)
            && waited >= Duration::from_millis(self.config.dwell_least_ms.into());
        if is_done || waited >= most {
            standing.may_walk = true;
            // Written down before the lamp goes on: after a restart nobody knows whether it left.
            self.save_walk();
            return self.saves.pop_front().map(Output::Save);
        }
        None
    }
}

/// The direction of a displacement, radians.
fn direction(of: Vector2<f32>) -> f32 {
    RealField::atan2(of.y, of.x)
}

/// A direction that is not known to this, radians, is none.
const HEADING_LIMIT: f32 = 0.1;

fn systematic(config: &TargetConfig, frame_heading_sigma: f32) -> Systematic<f32> {
    let own = config.systematic_heading_deg.to_radians();
    Systematic {
        heading_sigma: root(own * own + frame_heading_sigma * frame_heading_sigma),
        scale_sigma: config.systematic_scale,
    }
}

/// A track in the target's own frame, which begins where it is.
fn nowhere(config: &TargetConfig) -> Track<f32> {
    let origin = (Point2::origin(), Matrix2::zeros());
    Track::start(origin.0, origin.1, systematic(config, 0.0)).unwrap_or_default()
}

impl Role for Target {
    type Errand = Errand;
    type Task = ();
    type Event = Event;

    fn remember(&mut self, fact: &Fact) {
        match fact {
            Fact::Walk(walk) => self.resume(walk),
            Fact::Camera(slot, Some((address, report))) => {
                self.table.restore(*slot, *address, *report);
            }
            _ => {}
        }
    }

    fn attached(&mut self, now: Instant, network: Option<Membership>) {
        self.address = network.map(|network| network.short);
        if network.is_none() {
            return;
        }
        self.hello.tell(now);
        match self.state {
            // From now on: it may have stood for long.
            State::Walking { last: None } => self.state = State::Walking { last: Some(now) },
            State::Walking { .. } => {}
            State::Standing(standing) if standing.may_walk => {}
            State::Standing(_) => self.tell_again(now),
        }
    }

    fn message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        match message {
            Message::Look(look) if look.stop == self.stop => {
                self.table.answered(now, from.0, look);
                self.seen |= look.sight == Sight::InView;
                if let State::Standing(standing) = &mut self.state
                    && !self.located
                    && look.sight == Sight::InView
                {
                    standing.wait_until = Some(now + LOCATED_WITHIN);
                }
            }
            Message::Report(report) => {
                if let Some(slot) = self.table.report(from.0, *report) {
                    self.save(Fact::Camera(slot, Some((from.0, *report))));
                }
            }
            Message::Located(located) => self.located(now, located),
            Message::Bearing(bearing) => self.bearing(now, from, bearing),
            Message::Roster(cameras) if from == COORDINATOR => {
                self.knows_cameras = true;
                for &camera in cameras {
                    let _ = self.table.place(camera);
                }
            }
            Message::WhoIsThere if from == COORDINATOR => self.hello.tell(now),
            _ => {}
        }
    }

    fn sent(&mut self, now: Instant, errand: Errand, delivered: bool) {
        match errand {
            Errand::Hello => self.hello.sent(now, delivered),
            Errand::Ask(place, stop) if stop == self.stop => {
                self.table.asked(now, place, delivered);
            }
            Errand::Ask(..) => {}
        }
    }

    fn event(&mut self, now: Instant, event: Event) {
        match event {
            Event::Step(step) => self.stepped(now, &step),
            Event::SensorFailed => self.lose(now),
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<Errand, ()>> {
        if self.locate_at.is_some_and(|at| at <= now) {
            self.locate_at = None;
            self.locate(now);
        }
        if let State::Walking { last: Some(last) } = self.state
            && now >= last + self.still_after()
            && self.address.is_some()
        {
            self.stand(now);
        }
        if let Some(fact) = self.saves.pop_front() {
            return Some(Output::Save(fact));
        }
        self.address?;
        if self.hello.take(now) {
            let hello = Hello {
                id: self.id,
                kind: Kind::Target,
            };
            return Some(Output::Send {
                to: COORDINATOR,
                message: Message::Hello(hello),
                errand: Some(Errand::Hello),
            });
        }
        self.standing(now)
    }

    fn deadline(&self) -> Option<Instant> {
        self.address?;
        let state = match &self.state {
            State::Walking { last } => last.map(|last| last + self.still_after()),
            State::Standing(standing) => self.standing_deadline(standing),
        };
        [state, self.hello.deadline(), self.locate_at]
            .into_iter()
            .flatten()
            .min()
    }

    fn indication(&self) -> Indication {
        Indication {
            joined: self.address.is_some(),
            target_seen: self.seen,
            calibrated: self.located,
            may_walk: matches!(self.state, State::Standing(standing) if standing.may_walk),
        }
    }
}

fn symmetric(matrix: Matrix2<f32>) -> Matrix2<f32> {
    (matrix + matrix.transpose()) * 0.5
}
