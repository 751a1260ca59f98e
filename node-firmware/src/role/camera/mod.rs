//! A camera: uncalibrated, reference, calibrated.
//!
//! It rests until a target says that it stands. Then it looks, and what it saw becomes
//!
//! | the target knows its place | this camera | |
//! |---|---|---|
//! | yes | needs stops | a sighting; from three on a pose |
//! | no | is a reference | a bearing for the reference solve |
//! | no | knows its pose | a bearing with its pose, from which the target finds itself |
//! | no | may become a reference | a trigger for the coordinator |
//!
//! Every stop is answered, so that the target knows when it may walk on. A stop that is told twice
//! is answered twice and counted once. The count goes with every answer: the target never has to
//! keep one in step.

mod calibration;
mod duty;
mod facts;
mod inputs;
mod kept;
mod reference;
mod stops;

use core::time::Duration;

use zigbee_link::{Instant, wire::ShortAddress};

use self::{
    calibration::{Calibration, is_news},
    facts::{REPORT, Unsaved},
    reference::ReferenceStops,
};
use super::{COORDINATOR, Home, Outbox, Owed};
use crate::{
    arithmetic::root,
    config::CameraConfig,
    hardware::Button,
    limits::{COLOURS_MAX, MEMBERS, REFERENCE_STOPS, TARGETS},
    memory::Colours,
    message::{
        Address, CameraCommand, CameraState, CommandResult, CoordinateFrame, Duty, Hello,
        ListedSighting, MemberKind, Message, PoseParts, References, Report, Seen, Sight,
        StopBearing, StopNumber, Stopped, TargetLocation, TrackedBlob,
    },
    sight::ColourWindow,
};

/// Room for an answer of some 40 bytes, its acknowledgement of 36, both ways' turnaround and
/// clear-channel assessment.
const SLOT: Duration = Duration::from_millis(5);

/// A task for the camera's hardware. One at a time is given; the next one after its event. Only
/// [`CameraCommand::Track`] goes on until the next task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraTask {
    /// Look whether a target of this colour stands in view.
    Look {
        /// The colour.
        colour: u8,
    },
    /// A command of the coordinator or a button.
    Command(CameraCommand),
    /// Colours were learnt in a former run: look for these. No event ends this.
    Recall([Option<ColourWindow>; COLOURS_MAX]),
}

/// What the camera's hardware tells.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraEvent {
    /// The end of [`CameraTask::Look`].
    Looked(Sight, Option<Seen>),
    /// The end of [`CameraTask::Command`].
    Done(CommandResult),
    /// A packet while tracking for the coordinator.
    Tracked(TrackedBlob),
    /// This colour is looked for in this window from now on.
    Learnt(u8, ColourWindow),
    /// A button was pressed.
    Button(Button),
    /// The camera has started, and can look.
    Ready,
}

/// Why a camera sends a message of which it must know the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraNotification {
    /// It presents itself.
    Hello,
    /// Its report to the coordinator.
    ReportToCoordinator,
    /// Its report to a target.
    ReportTo(Address),
    /// The pose of the second reference camera.
    Posed,
    /// Where a target stood, for that target.
    Located,
    /// Its bearings for the first reference camera, that of a stop.
    Bearing(Address, StopNumber),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Asked {
    target: Address,
    stopped: Stopped,
    /// When the target said so.
    heard: Instant,
}

/// A target that is told how far this camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
struct KnownTarget {
    address: Address,
    report: Owed,
    missed_report: bool,
}

/// What was seen at the last stop of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LastLook {
    target: Address,
    stop: StopNumber,
    /// The answer was about this frame; the same stop may be told again in the other one.
    frame: CoordinateFrame,
    sight: Sight,
    seen: Option<Seen>,
}

/// A camera's state.
#[derive(Clone, Debug)]
pub struct CameraRole {
    id: u16,
    config: CameraConfig,
    address: Option<ShortAddress>,
    home: Home,
    references: Option<References>,
    calibration: Calibration,
    stops: ReferenceStops,
    report: Report,
    /// What others were told last.
    told: Report,

    /// The camera has started.
    ready: bool,
    /// It has a task.
    busy: bool,
    looking: Option<Asked>,
    next: Option<Asked>,
    command: Option<CameraCommand>,
    last: heapless::Vec<LastLook, TARGETS>,

    outbox: Outbox<CameraNotification, 8>,
    hello: Owed,
    to_coordinator: Owed,
    to_targets: heapless::Vec<KnownTarget, TARGETS>,
    posed: (Owed, Option<Report>),
    located: (Owed, Option<(Address, TargetLocation)>),
    bearings: heapless::Vec<(Address, StopNumber, Owed), REFERENCE_STOPS>,
    /// The next of its sightings that the coordinator asked for.
    listing: Option<usize>,
    target_seen: bool,
    /// Facts that are not written down yet.
    unsaved: Unsaved,
    /// What the configuration says, and what was learnt instead.
    colours: Colours,
    /// Learnt before the start; the hardware does not know yet.
    recalled: bool,
    /// The stops of both references have changed.
    to_solve: bool,
}

impl CameraRole {
    /// A camera that knows nothing yet.
    pub fn new(id: u16, config: CameraConfig) -> Self {
        let report = nothing_known(id);
        let colours = Colours {
            configured: config.subjects.checksum(),
            learnt: Default::default(),
        };
        Self {
            id,
            config,
            address: None,
            home: Home::new(),
            references: None,
            calibration: Calibration::new(),
            stops: ReferenceStops::new(),
            report,
            told: report,
            ready: false,
            busy: false,
            looking: None,
            next: None,
            command: None,
            last: heapless::Vec::new(),
            outbox: Outbox::new(),
            hello: Owed::Nothing,
            to_coordinator: Owed::Nothing,
            to_targets: heapless::Vec::new(),
            posed: (Owed::Nothing, None),
            located: (Owed::Nothing, None),
            bearings: heapless::Vec::new(),
            listing: None,
            target_seen: false,
            unsaved: Unsaved::new(),
            colours,
            recalled: false,
            to_solve: false,
        }
    }

    /// How far the camera is.
    pub const fn report(&self) -> &Report {
        &self.report
    }

    /// The pose, if it is known.
    fn pose(&self) -> Option<PoseParts> {
        self.report.pose().copied()
    }

    fn duty(&self) -> Option<Duty> {
        self.references?.duty_of(self.address?)
    }

    /// Waiting time that spreads the answers of all members.
    fn slot(&self) -> Duration {
        let place = self.address.map_or(0, |address| address.0 % MEMBERS as u16);
        SLOT.saturating_mul(u32::from(place))
    }

    /// Takes a new state, keeps it and tells it.
    fn know(&mut self, now: Instant, report: Report) {
        if report == self.report {
            return;
        }
        self.report = report;
        self.unsaved.add(REPORT);
        if is_news(&self.told, &report) {
            self.tell(now);
        }
    }

    fn tell(&mut self, now: Instant) {
        self.told = self.report;
        self.to_coordinator.tell(now);
        for target in &mut self.to_targets {
            target.report.tell(now);
        }
    }

    /// Has a command carried out next. Another one that waits is given up; and before the camera has
    /// started, this one: nobody knows when it will, and what is in its view then.
    fn command(&mut self, now: Instant, command: CameraCommand) {
        let given_up = if self.ready {
            self.command.replace(command)
        } else {
            Some(command)
        };
        if let Some(command) = given_up {
            let done = CommandResult {
                command,
                success: false,
            };
            self.outbox
                .push(now, COORDINATOR, Message::Done(done), None);
        }
    }

    fn list(&mut self) -> Option<Message> {
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

    /// What is owed to others and due.
    fn debt(&mut self, now: Instant) -> Option<(ShortAddress, Message, CameraNotification)> {
        if self.hello.take(now) {
            let hello = Hello {
                id: self.id,
                kind: MemberKind::Camera {
                    reference: self.config.reference,
                },
            };
            return Some((
                COORDINATOR,
                Message::Hello(hello),
                CameraNotification::Hello,
            ));
        }
        if self.located.0.take(now)
            && let Some((target, located)) = self.located.1
        {
            let to = ShortAddress(target);
            return Some((to, Message::Located(located), CameraNotification::Located));
        }
        if self.posed.0.take(now)
            && let (Some(pose), Some(references)) = (self.posed.1, self.references)
        {
            let to = ShortAddress(references.second);
            return Some((to, Message::Posed(pose), CameraNotification::Posed));
        }
        if let Some(references) = self.references {
            let stops = &self.stops;
            let seen_at = |target: Address, stop: StopNumber| {
                let mut all = stops.iter();
                all.find(|kept| kept.target == target && kept.stop == stop)?
                    .own
            };
            // The stop may have made room for others.
            self.bearings
                .retain(|(target, stop, _)| seen_at(*target, *stop).is_some());
            let mut bearings = self.bearings.iter_mut();
            if let Some((target, stop)) =
                bearings.find_map(|(target, stop, owed)| owed.take(now).then_some((*target, *stop)))
                && let Some(seen) = seen_at(target, stop)
            {
                let bearing = StopBearing {
                    target,
                    stop,
                    seen,
                    pose: None,
                };
                let to = ShortAddress(references.first);
                let notification = CameraNotification::Bearing(target, stop);
                return Some((to, Message::Bearing(bearing), notification));
            }
        }
        if self.to_coordinator.take(now) {
            let message = Message::Report(self.report);
            return Some((
                COORDINATOR,
                message,
                CameraNotification::ReportToCoordinator,
            ));
        }
        let report = self.report;
        self.to_targets.iter_mut().find_map(|target| {
            target.report.take(now).then_some((
                ShortAddress(target.address),
                Message::Report(report),
                CameraNotification::ReportTo(target.address),
            ))
        })
    }
}

const fn nothing_known(id: u16) -> Report {
    Report {
        id,
        duty: None,
        sightings: 0,
        used: 0,
        chi_squared: 0.0,
        done: false,
        state: CameraState::Waiting,
    }
}
