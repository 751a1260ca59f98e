//! A camera: uncalibrated, reference, calibrated.
//!
//! It rests until a target says that it stands. Then it looks, and its sighting becomes
//!
//! | the target knows its place | this camera | |
//! |---|---|---|
//! | yes | needs stops | a sighting; from three on a pose |
//! | no | is a reference | a bearing for the reference solve |
//! | no | knows its pose | a bearing with its pose, from which the target finds itself |
//! | no | may become a reference | a trigger for the coordinator |
//!
//! A camera answers a stop, so that the target knows when it may walk on. If the target was not in view the
//! last time and is not now, it answers only when the target asks. A stop that is told twice is answered
//! twice and counted once. The count goes with every answer: the target never has to keep one in step.
//!
//! A camera that sees nothing at many stops, or at a few where its pose says that the target is in view,
//! adapts to the light again after its answer.
//!
//! A look is not used before the target has [confirmed](crate::message::Confirmation) that the answer came
//! while it still stood there.

mod calibration;
mod colours;
mod device;
mod duty;
mod facts;
mod kept;
mod light;
mod progress;
mod reference;
mod stops;
mod stream;
mod targets;
#[cfg(test)]
mod tests;

use core::time::Duration;

use calib_core::Status;
use zigbee_link::{Instant, wire::ShortAddress};

use self::{
    calibration::Calibration,
    colours::LearntColours,
    device::Device,
    duty::ReferenceDuty,
    light::Light,
    progress::Progress,
    stream::Stream,
    targets::{KnownTargets, LastLooks},
};
use super::{
    COORDINATOR, LastNetwork, Notification, Notifications, Outbox, Output, Role, Unsaved, earliest,
};
use crate::{
    arithmetic::root,
    config::CameraConfig,
    facts::{Fact, FactKey},
    hardware::{Button, Indication},
    limits::{COLOURS_MAX, MEMBERS, REFERENCE_STOPS, TARGETS},
    message::{
        CameraCommand, CommandOutcome, CommandResult, Duty, Eye, Health, Hello, ListedSighting,
        MemberAddress, MemberKind, Memory, Message, PoseParts, Report, Restart, Seen, Sight,
        StopBearing, StopNumber, Tracked,
    },
    network::Attachment,
    vision::ColourWindow,
};

/// Room for an answer of some 40 bytes, its acknowledgement of 36, both ways' turnaround and
/// clear-channel assessment.
const SLOT: Duration = Duration::from_millis(5);

/// A task for the camera's hardware. One at a time is given; the next one after its event. Only
/// [`CameraCommand::Track`] goes on until the next task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraTask {
    /// Look for a target of this colour that stands in view.
    Look {
        /// Number of the colour in the configuration.
        colour: u8,
    },
    /// Start anew, to adapt to the light. [`CameraEvent::Ready`] ends this.
    Adapt,
    /// A command of the coordinator or a button.
    Command(CameraCommand),
    /// Colours were learnt in a former run: look for these. No event ends this.
    Recall([Option<ColourWindow>; COLOURS_MAX]),
}

/// Events of the camera's hardware.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraEvent {
    /// The end of [`CameraTask::Look`].
    Looked(Sight, Option<Seen>),
    /// The end of [`CameraTask::Command`].
    Done(CommandResult),
    /// View of one frame while tracking for the coordinator.
    Tracked(Tracked),
    /// This colour is looked for in this window from now on.
    Learnt(u8, ColourWindow),
    /// A button was pressed.
    Button(Button),
    /// The camera has started, and can look.
    Ready,
    /// The camera has to start anew, and cannot look before [`Ready`](Self::Ready): the end of a
    /// [`CameraTask::Look`]. Tracking goes on after it.
    Starting,
    /// The camera does not start. It is tried again and again.
    Failed,
}

/// A message of which a camera must know whether it was delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraNotification {
    /// It presents itself to the coordinator.
    Hello,
    /// Place of a target, for that target.
    Located,
    /// The pose of the second reference camera, for that one.
    Posed,
    /// Its sighting of this target at this stop, for the first reference camera.
    Bearing(MemberAddress, StopNumber),
    /// Its status, for the coordinator or a target.
    Report(MemberAddress),
    /// Its health, for the coordinator.
    Health,
}

/// There is one of each of these, but for bearings and for reports to targets.
const NOTIFICATIONS: usize = 5 + REFERENCE_STOPS + TARGETS;

impl Notification for CameraNotification {
    fn priority(self) -> u8 {
        match self {
            Self::Hello => 0,
            Self::Located => 1,
            Self::Posed => 2,
            Self::Bearing(..) => 3,
            Self::Report(to) if ShortAddress(to) == COORDINATOR => 4,
            Self::Health => 5,
            Self::Report(_) => 6,
        }
    }
}

/// A camera's state.
#[derive(Clone, Debug)]
pub struct CameraRole {
    id: u16,
    config: CameraConfig,
    address: Option<ShortAddress>,
    last_network: LastNetwork,
    /// Facts that are not written down yet.
    unsaved: Unsaved,

    device: Device,
    colours: LearntColours,

    looks: LastLooks,
    light: Light,
    target_seen: bool,
    /// Bearings that did not fit the pose, less those since that did.
    misses: u8,
    /// The one of these that was farthest off, radians.
    missed: f32,
    /// They make the pose doubtful.
    is_watched_doubtful: bool,
    /// The target that solved the pose doubts it, too.
    is_told_doubtful: bool,
    /// It looks elsewhere than it did, and stood at a place that it was given: its place is not known now.
    was_moved: bool,
    /// It was told to forget its pose and has seen no target since: targets know what it forgot.
    has_forgotten: bool,
    calibration: Calibration,
    duty: ReferenceDuty,
    progress: Progress,

    targets: KnownTargets,
    /// The target that solved the pose last.
    solved_by: Option<MemberAddress>,
    notifications: Notifications<CameraNotification, NOTIFICATIONS>,
    outbox: Outbox<CameraNotification, 8>,
    stream: Stream,
    /// The next of its sightings that the coordinator asked for.
    listing: Option<usize>,
    health: Health,
}

impl CameraRole {
    /// A camera that knows nothing yet.
    pub fn new(id: u16, config: CameraConfig) -> Self {
        let colours = LearntColours::new(config.subjects.checksum());
        Self {
            id,
            config,
            address: None,
            last_network: LastNetwork::new(),
            unsaved: Unsaved::new(),
            device: Device::new(),
            colours,
            looks: LastLooks::new(),
            light: Light::new(),
            target_seen: false,
            misses: 0,
            missed: 0.0,
            is_watched_doubtful: false,
            is_told_doubtful: false,
            was_moved: false,
            has_forgotten: false,
            calibration: Calibration::new(),
            duty: ReferenceDuty::new(),
            progress: Progress::new(id),
            targets: KnownTargets::new(),
            solved_by: None,
            notifications: Notifications::new(),
            outbox: Outbox::new(),
            stream: Stream::new(),
            listing: None,
            health: Health::default(),
        }
    }

    /// Status of the camera.
    pub const fn report(&self) -> &Report {
        self.progress.report()
    }

    fn own_duty(&self) -> Option<Duty> {
        self.duty.of(self.address)
    }

    /// Waiting time that spreads the answers of all members.
    fn slot(&self) -> Duration {
        let place = self.address.map_or(0, |address| address.0 % MEMBERS as u16);
        SLOT.saturating_mul(u32::from(place))
    }

    /// Takes a new state, keeps it and tells it.
    fn update(&mut self, now: Instant, report: Report) {
        if self.progress.update(report, &mut self.unsaved) {
            self.notify(CameraNotification::Report(COORDINATOR.0), now);
            // The one that solved it knows.
            let others =
                |target: &MemberAddress| report.joint.is_none() || self.solved_by != Some(*target);
            for target in self.targets.addresses().filter(others) {
                let notification = CameraNotification::Report(target);
                self.notifications.notify(notification, now);
            }
        }
    }

    // for less flash
    #[inline(never)]
    fn notify(&mut self, notification: CameraNotification, due: Instant) {
        self.notifications.notify(notification, due);
    }

    /// Presents itself to the coordinator, and reports if there is anything to report.
    fn present(&mut self, due: Instant) {
        self.notify(CameraNotification::Hello, due);
        if self.progress.has_report() {
            self.notify(CameraNotification::Report(COORDINATOR.0), due);
        }
        if self.health != Health::default() {
            self.notify(CameraNotification::Health, due);
        }
    }

    /// Takes its health: the coordinator hears of news.
    fn on_health(&mut self, now: Instant, health: Health) {
        if core::mem::replace(&mut self.health, health) != health {
            self.notify(CameraNotification::Health, now);
        }
    }

    /// Takes the state of its camera.
    fn on_eye(&mut self, now: Instant, camera: Eye) {
        let health = Health {
            camera,
            ..self.health
        };
        self.on_health(now, health);
    }

    /// Has a command carried out next. The coordinator hears of one that is given up.
    fn command(&mut self, now: Instant, command: CameraCommand) {
        if let Some(command) = self.device.command(command) {
            self.tell_done(
                now,
                CommandResult {
                    command,
                    outcome: CommandOutcome::Failed,
                },
            );
        }
    }

    fn tell_done(&mut self, now: Instant, done: CommandResult) {
        self.outbox
            .push(now, COORDINATOR, Message::Done(done), None);
    }

    /// The next of its sightings, if the coordinator asked for them.
    fn next_listed(&mut self) -> Option<Message> {
        let index = self.listing?;
        let Some(kept) = self.calibration.get(index) else {
            self.listing = None;
            return None;
        };
        self.listing = Some(index + 1);
        Some(Message::Sighting(ListedSighting {
            index: index as u8,
            count: self.calibration.count() as u8,
            target: kept.target,
            stop: kept.stop,
            position: kept.place.position().into(),
            position_sigma: root(kept.place.covariance().trace()),
            seen: kept.seen,
        }))
    }

    /// A message that has to be told, as it is known now, and its receiver. `None`: there is nothing to tell
    /// any more.
    fn message_of(&self, notification: CameraNotification) -> Option<(ShortAddress, Message)> {
        Some(match notification {
            CameraNotification::Hello => {
                let hello = Hello {
                    id: self.id,
                    kind: MemberKind::Camera {
                        reference: self.config.reference,
                    },
                };
                (COORDINATOR, Message::Hello(hello))
            }
            CameraNotification::Located => {
                let (target, location) = self.duty.location()?;
                (ShortAddress(target), Message::Located(location))
            }
            CameraNotification::Posed => {
                let to = ShortAddress(self.duty.references()?.second);
                (to, Message::Posed(self.duty.second()?))
            }
            CameraNotification::Bearing(target, stop) => {
                let bearing = StopBearing {
                    target,
                    stop,
                    // The stop may have made room for others.
                    seen: self.duty.own_at(target, stop)?,
                    pose: None,
                };
                let to = ShortAddress(self.duty.references()?.first);
                (to, Message::Bearing(bearing))
            }
            CameraNotification::Report(to) => {
                (ShortAddress(to), Message::Report(*self.progress.report()))
            }
            CameraNotification::Health => (COORDINATOR, Message::Health(self.health)),
        })
    }
}

impl Role for CameraRole {
    type Notification = CameraNotification;
    type Task = CameraTask;
    type Event = CameraEvent;

    fn restore(&mut self, fact: &Fact) {
        self.restore_fact(fact);
    }

    fn on_attached(&mut self, now: Instant, network: Option<Attachment>) {
        let own = network.map(|network| ShortAddress(network.own));
        let was_attached = core::mem::replace(&mut self.address, own).is_some();
        let Some(network) = network else {
            return;
        };
        let unsaved = &mut self.unsaved;
        if (self.last_network).on_attached(was_attached, network, unsaved) {
            self.forget_network();
        }
        self.present(now);
        match self.own_duty() {
            // It is not known which ones were delivered before a restart.
            Some(Duty::Second) if self.progress.pose().is_none() => self.notify_bearings(now),
            // Or it is not known whether the last ones written down were solved.
            Some(Duty::First) => self.duty.solve_again(),
            _ => {}
        }
    }

    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        let is_coordinator = from == COORDINATOR;
        let duty_of_sender = self.duty.of(Some(from));
        match message {
            Message::Stopped(stopped) => self.on_stopped(now, from.0, stopped),
            Message::Confirmed(confirmation) => self.on_confirmed(now, from.0, confirmation),
            Message::References(references) if is_coordinator => {
                self.on_references(now, references);
            }
            Message::Bearing(bearing) if duty_of_sender == Some(Duty::Second) => {
                self.on_bearing(now, bearing);
            }
            Message::Posed(solved)
                if solved.is_usable() && solved.pose().is_some_and(PoseParts::is_usable) =>
            {
                if self.own_duty() == Some(Duty::Second) && duty_of_sender == Some(Duty::First) {
                    self.on_posed(now, solved);
                } else if solved.joint.is_some() {
                    // Only a target solves that. It may not have stopped since this camera started, and does
                    // not tell the pose again.
                    self.on_heard(now, from.0);
                    if !self.has_forgotten {
                        self.on_joint(now, from.0, solved);
                    }
                }
            }
            Message::WhoIsThere(heard) if is_coordinator => {
                let is_heard = self.address.is_some_and(|own| heard.contains(&own.0));
                if !is_heard {
                    self.present(now + self.slot());
                }
            }
            Message::Command(CameraCommand::Forget) if is_coordinator => {
                self.forget(now);
                self.tell_done(
                    now,
                    CommandResult {
                        command: CameraCommand::Forget,
                        outcome: CommandOutcome::Done,
                    },
                );
            }
            Message::Command(command) if is_coordinator => self.command(now, *command),
            Message::Sightings if is_coordinator => self.listing = Some(0),
            _ => {}
        }
    }

    fn on_sent(&mut self, now: Instant, notification: CameraNotification, delivered: bool) {
        let is_settled = match notification {
            CameraNotification::Report(to) if ShortAddress(to) != COORDINATOR => {
                // A target that is away is told when it is heard again.
                self.targets.on_report_sent(to, delivered);
                true
            }
            _ => delivered,
        };
        self.notifications.on_sent(notification, now, is_settled);
    }

    fn on_event(&mut self, now: Instant, event: CameraEvent) {
        match event {
            CameraEvent::Looked(sight, seen) => self.on_looked(now, sight, seen),
            CameraEvent::Done(done) => {
                self.device.on_done(done.command);
                self.tell_done(now, done);
            }
            CameraEvent::Tracked(tracked) => {
                let report = self.progress.report();
                let seen = tracked.seen.and_then(|seen| report.upright(seen));
                self.stream.on_frame(now, Tracked { seen, ..tracked });
            }
            CameraEvent::Learnt(colour, window) => {
                if self.colours.on_learnt(colour, window) {
                    self.unsaved.insert(FactKey::Colours);
                }
            }
            CameraEvent::Button(Button::LearnColour) => {
                self.command(now, CameraCommand::LearnColour { colour: 0 });
            }
            CameraEvent::Button(Button::JoinWindow) => {}
            CameraEvent::Ready => {
                self.device.on_ready();
                if self.health.camera == Eye::Failed {
                    self.on_eye(now, Eye::Sees);
                }
            }
            CameraEvent::Starting => self.on_starting(now),
            CameraEvent::Failed => {
                self.device.on_failed();
                self.on_eye(now, Eye::Failed);
            }
        }
    }

    fn on_node(&mut self, now: Instant, memory: Memory, restart: Restart) {
        let health = Health {
            memory,
            restart,
            ..self.health
        };
        self.on_health(now, health);
    }

    fn compute(&mut self, now: Instant) {
        if self.duty.take_to_solve() {
            self.solve_reference(now);
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<CameraNotification, CameraTask>> {
        if let Some(fact) = self.unsaved_fact() {
            return Some(Output::Save(fact));
        }
        let task = self.colours.next_task();
        if let Some(task) = task.or_else(|| self.device.next_task()) {
            return Some(Output::Task(task));
        }
        self.address?;
        self.repeat_answers(now);
        if let Some(message) = self.outbox.take_due(now) {
            return Some(message);
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
        let listed = self.next_listed();
        let message = listed.or_else(|| self.stream.take_due(now).map(Message::Tracked))?;
        Some(Output::Send {
            to: COORDINATOR,
            message,
            notification: None,
        })
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.address?;
        earliest([
            self.outbox.next_due(),
            self.notifications.next_due(),
            self.looks.next_due(),
            self.stream.next_due(),
        ])
    }

    fn indication(&self) -> Indication {
        Indication {
            joined: self.address.is_some(),
            target_seen: self.target_seen,
            calibrated: self.report().status() == Status::Calibrated,
            may_walk: false,
        }
    }
}
