//! A target: it walks, stands, and tells cameras where (thesis 2.3, Appendix B).
//!
//! Steps move it. When none came for a while it stands, and says so to all. Cameras answer. It asks those of
//! the roster that did not answer one by one, but not those that did not see it at the stop before. It
//! confirms the answers that came while it stood there: only those count. When all have answered or cannot be
//! reached it shows that its carrier may walk on. Nothing but the carrier makes it walk.
//!
//! If no camera saw it at a stop, and it [roams](TargetConfig::roams), it looks for another network of the site before
//! it walks on. It keeps its place, its direction and the scale of its steps, so that the cameras there calibrate in
//! the same frame. It drops the cameras of the network that it left, and their measurements.
//!
//! If its step sensor fails, its place is unknown until a person tells it where it stands. This place is a stop like
//! any other. So it goes on from place to place until its sensor works again.
//!
//! It does not know its place before the first reference camera tells it, or two cameras with known poses see it at one
//! stop; one camera is enough if the size of the ball is known. From then on it uses dead reckoning.

mod confirmations;
mod estimate;
mod frame;
mod history;
mod place;
mod sizes;
mod table;
#[cfg(test)]
mod tests;

use core::time::Duration;

use calib_core::dead_reckoning::{Step, Track};
use nalgebra::{Matrix2, Point2};
use zigbee_link::{Instant, wire::ShortAddress};

use self::{
    confirmations::Confirmations, estimate::Estimate, frame::Arrival, place::nowhere, table::Table,
};
pub use self::{
    estimate::{CAMERAS, EstimateMemory, WORKSPACE},
    table::CameraEntry,
};
use super::{
    COORDINATOR, LastNetwork, Notification, Notifications, Output, Role, Unsaved, earliest,
};
use crate::{
    config::TargetConfig,
    facts::{Fact, FactKey, Walk},
    hardware::Indication,
    message::{
        Confirmation, CoordinateFrame, Health, Hello, MemberAddress, MemberKind, Memory, Message,
        Restart, Sight, StopAnswer, StopBearing, StopNumber, Stopped,
    },
    network::Attachment,
    steps::SensorError,
};

/// Time from the broadcast of a stop until cameras that did not answer are asked one by one. A look takes about 0.6 s,
/// and there may be many cameras.
const ASK_AFTER: Duration = Duration::from_millis(1500);

/// Time from the delivery of a question until the camera counts as silent.
const ANSWER_WITHIN: Duration = Duration::from_secs(4);

/// Time until a camera that is still starting is asked again.
const READY_AFTER: Duration = Duration::from_secs(2);

/// Cameras that are asked at a time.
const ASKED_AT_A_TIME: usize = 2;

/// Time that a target without a place waits to be told its place, while cameras see it.
const LOCATED_WITHIN: Duration = Duration::from_secs(2);

/// Time by which the network has begun to look for another one. It reports the result.
const ROAM_WITHIN: Duration = Duration::from_secs(1);

/// Pause between two slices of the estimate, in which messages are taken.
const BREATH: Duration = Duration::from_millis(1);

/// Stops of which the first reference camera may still tell the place.
const STOOD: usize = 4;

/// A message of which a target must know whether it was delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TargetNotification {
    /// The target's hello.
    Hello,
    /// Question to a camera about this stop.
    Ask(MemberAddress, StopNumber),
    /// Pose of a camera, for that camera.
    Posed(MemberAddress),
    /// Health, for the coordinator.
    Health,
}

/// One of each of these, except for poses. The table knows the cameras that are asked.
const NOTIFICATIONS: usize = 2 + estimate::CAMERAS;

impl Notification for TargetNotification {
    fn priority(self) -> u8 {
        match self {
            Self::Hello | Self::Ask(..) => 0,
            Self::Posed(_) | Self::Health => 1,
        }
    }
}

/// Task for the target's node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TargetTask {
    /// Join the network that is heard best.
    Roam,
}

/// Events of the devices of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TargetEvent {
    /// Step of the carrier.
    Step(Step<f32>),
    /// The step sensor has this fault, or works again. The place of the target is unknown from then on.
    Sensor(Option<SensorError>),
}

/// A target's state.
#[derive(Debug)]
pub struct TargetRole<'m> {
    id: u16,
    config: TargetConfig,
    address: Option<ShortAddress>,
    last_network: LastNetwork,
    track: Track<f32>,
    located: bool,
    /// Direction of the sensor's x axis in the frame of the site, and its sigma.
    frame_heading: Option<(f32, f32)>,
    /// True if two places gave it, and no third one has confirmed it.
    is_heading_provisional: bool,
    stop: StopNumber,
    state: State,
    /// The track at the last stop, in the frame it had there.
    at_stop: Track<f32>,
    /// Tracks at the last stops, for answers that come late.
    stood: heapless::Deque<(StopNumber, Track<f32>), STOOD>,
    /// Last place that was found from bearings, its covariance, and the track there. With another place they give the
    /// direction of the sensor.
    found: Option<(Point2<f32>, Matrix2<f32>, Track<f32>)>,
    bearings: heapless::Vec<(ShortAddress, StopBearing), 4>,
    /// Time to find the place from bearings.
    locate_at: Option<Instant>,
    table: Table,
    /// Cameras that saw it at this stop.
    confirmations: Confirmations,
    /// True if the coordinator has sent the list of cameras since the start.
    knows_cameras: bool,
    /// Facts that are not saved yet.
    unsaved: Unsaved,
    notifications: Notifications<TargetNotification, NOTIFICATIONS>,
    /// Joint estimate, if there is memory for it.
    estimate: Option<Estimate<'m>>,
    /// Ratio of the step sensor's reading to the true length, as estimated so far. Above zero.
    scale: f32,
    /// Time from which on the target estimates: its stop is over.
    estimate_at: Option<Instant>,
    is_estimating: bool,
    seen: bool,
    health: Health,
    /// True if it looked for another network at this stop.
    has_roamed: bool,
    /// True if it knew its place when it came into this network.
    has_arrived: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    /// Time of the last step, if there was one.
    Walking { last: Option<Instant> },
    /// It stands at a stop, and tells cameras.
    Standing(Standing),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Standing {
    since: Instant,
    /// All were told of the stop.
    announced: bool,
    /// Time before which nothing is sent.
    ask_at: Instant,
    /// Time until which it waits to be told its place, while cameras see it.
    wait_until: Option<Instant>,
    may_walk: bool,
}

impl<'m> TargetRole<'m> {
    /// A target that knows nothing. `first_stop` should be random: a target that lost its memory must not use the
    /// numbers of former stops again.
    pub fn new(id: u16, config: TargetConfig, first_stop: StopNumber) -> Self {
        // Random as well: the cameras' records of a former walk must not look like one of this.
        let track = nowhere(&config).numbered(first_stop.into());
        Self {
            id,
            config,
            address: None,
            last_network: LastNetwork::new(),
            track,
            located: false,
            frame_heading: None,
            is_heading_provisional: false,
            stop: first_stop,
            state: State::Walking { last: None },
            at_stop: track,
            stood: heapless::Deque::new(),
            found: None,
            bearings: heapless::Vec::new(),
            locate_at: None,
            table: Table::new(),
            confirmations: Confirmations::new(),
            knows_cameras: false,
            unsaved: Unsaved::new(),
            notifications: Notifications::new(),
            estimate: None,
            scale: 1.0,
            estimate_at: None,
            is_estimating: false,
            seen: false,
            health: Health::default(),
            has_roamed: false,
            has_arrived: false,
        }
    }

    /// Gives it the memory for the joint estimate. Without, it uses dead reckoning alone, and cameras solve their own
    /// poses.
    // for less stack
    #[inline(never)]
    pub fn estimate_in(&mut self, memory: EstimateMemory<'m>) {
        self.estimate = Estimate::new(memory);
    }

    /// Returns the cameras that it knows, with their reports: the table of Appendix B.
    pub fn cameras(&self) -> impl Iterator<Item = CameraEntry> {
        self.table.iter()
    }

    /// Returns its place by dead reckoning, and its frame.
    pub fn position(&self) -> (Point2<f32>, bool) {
        (self.track.position(), self.located)
    }

    fn still_after(&self) -> Duration {
        Duration::from_millis(self.config.still_after_ms.into())
    }

    fn standing_deadline(&self, standing: &Standing) -> Option<Instant> {
        // Without a stop there is nothing to tell.
        self.place()?;
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
            // The rest depends on time.
            let until = standing.wait_until.unwrap_or(standing.since);
            Some(
                dwell(self.config.dwell_least_ms)
                    .max(until)
                    .max(standing.ask_at)
                    .max(self.confirmations.settled_at(standing.ask_at)),
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

    /// Goes on after a restart.
    fn resume(&mut self, walk: &Walk) {
        self.stop = walk.stop;
        if let Some(estimate) = &mut self.estimate {
            estimate.resume(walk.standing);
        }
        if is_length(walk.scale) {
            self.scale = walk.scale;
        }
        if let Some(heading) = walk.frame_heading {
            self.frame_heading = Some((heading, walk.frame_heading_sigma));
            if let Some(estimate) = &mut self.estimate {
                estimate.on_sensor(heading, walk.frame_heading_sigma);
            }
        }
        let place = walk.place;
        if !walk.standing {
            // It walked during the restart, and these steps were not counted.
            let fix = place.parts().fix.wrapping_add(1);
            self.track = nowhere(&self.config).numbered(fix);
            self.at_stop = self.track;
            return;
        }
        self.track = Track::resume(&place);
        self.at_stop = self.track;
        self.remember_stop();
        self.located = walk.located;
        self.state = State::Standing(Standing {
            since: Instant(0),
            announced: false,
            ask_at: Instant(0),
            wait_until: None,
            may_walk: false,
        });
    }

    /// Returns the next fact to save.
    fn unsaved_fact(&mut self) -> Option<Fact> {
        while let Some(key) = self.unsaved.take() {
            let fact = match key {
                FactKey::Walk => self.walk().map(Fact::Walk),
                FactKey::Camera(slot) => Some(self.table.fact(slot)),
                FactKey::Network => self.last_network.fact(),
                FactKey::WalkStops(_) | FactKey::WalkBearings(_) => self.history_fact(key),
                other => {
                    debug_assert!(false, "no fact of a target: {other:?}");
                    None
                }
            };
            if fact.is_some() {
                return fact;
            }
        }
        None
    }

    /// Returns its walk, if its place can be sent.
    fn walk(&self) -> Option<Walk> {
        let (heading, sigma) = self.frame_heading.unzip();
        Some(Walk {
            stop: self.stop,
            standing: matches!(self.state, State::Standing(standing) if !standing.may_walk),
            place: self.place()?,
            located: self.located,
            frame_heading: heading,
            frame_heading_sigma: sigma.unwrap_or_default(),
            scale: self.scale,
        })
    }

    /// Remembers the track at this stop, of which the first reference camera may still tell the place. A full list
    /// drops the oldest.
    fn remember_stop(&mut self) {
        if self.stood.is_full() {
            self.stood.pop_front();
        }
        let has_room = self.stood.push_back((self.stop, self.track)).is_ok();
        debug_assert!(has_room);
    }

    fn stand(&mut self, now: Instant) {
        self.stop = self.stop.wrapping_add(1);
        self.bearings.clear();
        self.locate_at = None;
        self.at_stop = self.track;
        self.remember_stop();
        if let Some(estimate) = &mut self.estimate {
            estimate.on_stop(self.stop, &mut self.unsaved);
        }
        self.arrive();
        self.seen = false;
        self.has_roamed = false;
        self.confirmations.clear();
        self.state = State::Standing(Standing {
            since: now,
            announced: false,
            ask_at: now,
            wait_until: None,
            may_walk: false,
        });
        self.table.new_stop(!self.located);
        self.unsaved.insert(FactKey::Walk);
    }

    /// Begins a stop in a network to which it brings its frame.
    fn arrive(&mut self) {
        let heading = self
            .frame_heading
            .filter(|_| self.has_arrived && self.located);
        if let (Some((heading, _)), Some(place), Some(estimate)) =
            (heading, self.place(), &mut self.estimate)
        {
            let carried = (heading, self.scale);
            estimate.arrive(Arrival::new(self.stop, place, carried));
        }
    }

    /// Tells the stop again, since its place is known now.
    fn tell_again(&mut self, now: Instant) {
        self.table.new_stop(!self.located);
        self.confirmations.clear();
        if let State::Standing(standing) = &mut self.state {
            standing.since = now;
            standing.announced = false;
            standing.ask_at = now;
            standing.wait_until = None;
            standing.may_walk = false;
        }
        self.unsaved.insert(FactKey::Walk);
    }

    fn stopped(&self) -> Option<Message> {
        Some(Message::Stopped(Stopped {
            stop: self.stop,
            colour: self.config.colour,
            frame: if self.located {
                CoordinateFrame::Site
            } else {
                CoordinateFrame::Own
            },
            place: self.place()?,
        }))
    }

    /// Takes an answer of a camera to the present stop.
    fn on_look(&mut self, now: Instant, from: ShortAddress, look: &StopAnswer) {
        let is_in_view = look.sight == Sight::InView;
        self.table.on_answer(now, from.0, look);
        let State::Standing(standing) = &mut self.state else {
            self.confirmations.repeat(now, from.0);
            return;
        };
        // The carrier may have left.
        if standing.may_walk {
            self.confirmations.repeat(now, from.0);
            return;
        }
        if look.sight == Sight::NotReady {
            self.confirmations.on_missed(now, standing.ask_at);
        }
        if !is_in_view {
            return;
        }
        let at = self.confirmations.add(now, from.0, standing.ask_at);
        if !self.located {
            standing.wait_until = Some(at + LOCATED_WITHIN);
        }
        self.seen = true;
        self.on_seen(from, look);
    }

    /// Sends its hello, and its health if anything is wrong.
    fn present(&mut self, now: Instant) {
        self.notifications.notify(TargetNotification::Hello, now);
        if self.health != Health::default() {
            self.notifications.notify(TargetNotification::Health, now);
        }
    }

    /// Takes the state of the step sensor. After a change, steps may have been missed.
    fn on_sensor(&mut self, now: Instant, steps: Option<SensorError>) {
        let before = core::mem::replace(&mut self.health.steps, steps);
        if before == steps {
            return;
        }
        self.notifications.notify(TargetNotification::Health, now);
        // A sensor that still fails makes no new stop.
        if before.is_some() != steps.is_some() {
            self.lose(now);
        }
    }

    /// Returns true if its sensor fails: then the target may be elsewhere by the time that it is found.
    const fn has_no_steps(&self) -> bool {
        self.health.steps.is_some()
    }

    /// Builds a message from what is known now. Returns it with its receiver.
    fn message_of(&self, notification: TargetNotification) -> Option<(ShortAddress, Message)> {
        Some(match notification {
            TargetNotification::Hello => {
                let hello = Hello {
                    id: self.id,
                    kind: MemberKind::Target,
                };
                (COORDINATOR, Message::Hello(hello))
            }
            TargetNotification::Posed(camera) => {
                let mut reports = self.estimate.as_ref()?.reports();
                let (_, report) = reports.find(|(of, _)| *of == camera)?;
                (ShortAddress(camera), Message::Posed(*report))
            }
            TargetNotification::Health => (COORDINATOR, Message::Health(self.health)),
            TargetNotification::Ask(..) => return None,
        })
    }

    fn standing(&mut self, now: Instant) -> Option<Output<TargetNotification, TargetTask>> {
        let message = self.stopped()?;
        let stop = self.stop;
        let State::Standing(standing) = &mut self.state else {
            return None;
        };
        if !standing.announced {
            standing.announced = true;
            standing.ask_at = now + ASK_AFTER;
            // Also if no camera was heard: one that missed the stop hears of it now.
            self.confirmations.due(standing.ask_at);
            return Some(Output::Send {
                to: ShortAddress::BROADCAST,
                message,
                notification: None,
            });
        }
        // The carrier may have left: no camera must look now.
        if now < standing.ask_at || standing.may_walk {
            return None;
        }
        self.table.give_up(now);
        let waited = now.since(standing.since);
        let most = Duration::from_millis(self.config.dwell_most_ms.into());
        if waited.saturating_add(ANSWER_WITHIN) >= most {
            // A camera that is asked now has no time to look.
            self.table.close();
        }
        if let Some(address) = self.table.ask(ASKED_AT_A_TIME) {
            return Some(Output::Send {
                to: ShortAddress(address),
                message,
                notification: Some(TargetNotification::Ask(address, stop)),
            });
        }
        let is_done = self.table.is_settled()
            && self.knows_cameras
            && standing.wait_until.is_none_or(|until| until <= now)
            && self.confirmations.settled_at(standing.ask_at) <= now
            && waited >= Duration::from_millis(self.config.dwell_least_ms.into());
        if is_done && self.config.roams && !self.seen && !self.has_roamed {
            // A camera that sees it may be in another network.
            self.has_roamed = true;
            standing.ask_at = now + ROAM_WITHIN;
            return Some(Output::Task(TargetTask::Roam));
        }
        if is_done || waited >= most {
            standing.may_walk = true;
            self.estimate_at = Some(now + BREATH);
            self.save_history();
            // It is saved before the lamp goes on: after a restart it is unknown whether the carrier left.
            self.unsaved.insert(FactKey::Walk);
            return self.unsaved_fact().map(Output::Save);
        }
        None
    }
}

/// Returns true if a number can be the factor of a length.
fn is_length(number: f32) -> bool {
    number.is_finite() && number > 0.0
}

impl Role for TargetRole<'_> {
    type Notification = TargetNotification;
    type Task = TargetTask;
    type Event = TargetEvent;

    fn restore(&mut self, fact: &Fact) {
        match fact {
            Fact::Walk(walk) => self.resume(walk),
            Fact::Camera(slot, Some((address, report))) => {
                self.table.restore(*slot, *address, *report);
            }
            Fact::Network(network) => self.last_network.restore(*network),
            _ => self.restore_history(fact),
        }
    }

    fn on_attached(&mut self, now: Instant, network: Option<Attachment>) {
        let own = network.map(|network| ShortAddress(network.own));
        let before = core::mem::replace(&mut self.address, own);
        let Some(network) = network else {
            return;
        };
        let was_attached = before.is_some();
        let unsaved = &mut self.unsaved;
        if let Some(estimate) = &mut self.estimate {
            estimate.sort_restored(self.stop, unsaved);
        }
        if (self.last_network).on_attached(was_attached, network, unsaved) {
            // It stands at the same place, in another network.
            self.table.clear(unsaved);
            self.has_arrived = self.located;
            let stands = matches!(self.state, State::Standing(standing) if !standing.may_walk);
            if let Some(estimate) = &mut self.estimate {
                estimate.clear(unsaved);
                if stands {
                    estimate.on_stop(self.stop, unsaved);
                }
            }
            if stands {
                self.arrive();
            }
            self.estimate_at = None;
            self.bearings.clear();
            self.locate_at = None;
            self.knows_cameras = false;
            // Addresses belong to other nodes here.
            (self.notifications).retain(|told| !matches!(told, TargetNotification::Posed(_)));
        }
        self.present(now);
        // Cameras of a former network do not report any more.
        self.find_references();
        match self.state {
            // The wait begins now: it may have stood for long.
            State::Walking { last: None } => {
                self.state = State::Walking { last: Some(now) };
                // Cameras may not have heard of measurements before a restart.
                let is_new = self
                    .estimate
                    .as_ref()
                    .is_some_and(|estimate| estimate.is_new);
                self.estimate_at = is_new.then_some(now + BREATH);
            }
            State::Walking { .. } => {}
            State::Standing(standing) if standing.may_walk => {}
            State::Standing(_) => self.tell_again(now),
        }
    }

    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        match message {
            Message::Look(look) if look.stop == self.stop => self.on_look(now, from, look),
            // It has left the stop: a camera that answers now may have looked too late.
            Message::Look(_) => {}
            Message::Report(report) => {
                self.table.report(from.0, *report, &mut self.unsaved);
                if let Some(estimate) = &mut self.estimate {
                    estimate.on_report(from.0, report);
                    self.estimate_news(now);
                }
                self.find_references();
            }
            Message::Located(told) if from == COORDINATOR => self.on_placed(now, told),
            // Only the first reference and targets solve.
            Message::Located(located) if self.table.may_be_first(from.0) => {
                self.on_located(now, located);
            }
            Message::Bearing(bearing) => self.on_bearing(now, from, bearing),
            Message::Roster(cameras) if from == COORDINATOR => {
                self.knows_cameras = true;
                for &camera in cameras {
                    self.table.meet(camera);
                }
            }
            Message::WhoIsThere(heard) if from == COORDINATOR => {
                let is_heard = self.address.is_some_and(|own| heard.contains(&own.0));
                if !is_heard {
                    self.present(now);
                }
            }
            _ => {}
        }
    }

    fn on_sent(&mut self, now: Instant, notification: TargetNotification, delivered: bool) {
        match notification {
            TargetNotification::Hello | TargetNotification::Health => {
                self.notifications.on_sent(notification, now, delivered);
            }
            TargetNotification::Posed(camera) => {
                self.notifications.on_sent(notification, now, delivered);
                if delivered {
                    self.on_told(camera);
                }
            }
            TargetNotification::Ask(address, stop) if stop == self.stop => {
                self.table.on_asked(now, address, delivered);
            }
            TargetNotification::Ask(..) => {}
        }
    }

    fn on_event(&mut self, now: Instant, event: TargetEvent) {
        match event {
            // These are not all steps of a person.
            TargetEvent::Step(_) if self.has_no_steps() => {}
            TargetEvent::Step(step) => self.on_step(now, &step),
            TargetEvent::Sensor(fault) => self.on_sensor(now, fault),
        }
    }

    fn on_node(&mut self, now: Instant, memory: Memory, restart: Restart) {
        let health = Health {
            memory,
            restart,
            ..self.health
        };
        if core::mem::replace(&mut self.health, health) != health {
            self.notifications.notify(TargetNotification::Health, now);
        }
    }

    fn compute(&mut self, now: Instant) {
        if self.estimate_at.is_some_and(|at| at <= now) {
            self.estimate(now);
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<TargetNotification, TargetTask>> {
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
        if let Some(fact) = self.unsaved_fact() {
            return Some(Output::Save(fact));
        }
        self.address?;
        if let Some((to, seen_by)) = self.confirmations.take_due(now) {
            let stop = self.stop;
            return Some(Output::Send {
                to,
                message: Message::Confirmed(Confirmation { stop, seen_by }),
                notification: None,
            });
        }
        while let Some(notification) = self.notifications.take_due(now) {
            if let Some((to, message)) = self.message_of(notification) {
                return Some(Output::Send {
                    to,
                    message,
                    notification: Some(notification),
                });
            }
            self.notifications.cancel(notification);
        }
        self.standing(now)
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.address?;
        let state = match &self.state {
            State::Walking { last } => last.map(|last| last + self.still_after()),
            State::Standing(standing) => self.standing_deadline(standing),
        };
        earliest([
            state,
            self.notifications.next_due(),
            self.confirmations.next_due(),
            self.locate_at,
            self.estimate_at,
        ])
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
