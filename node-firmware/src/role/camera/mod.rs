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
mod inputs;
mod reference;

use core::time::Duration;

use zigbee_link::{Instant, wire::ShortAddress};

pub use self::{calibration::SIGHTINGS, reference::REFERENCE_STOPS};
use self::{
    calibration::{Calibration, is_done, is_news},
    reference::{ReferenceFrame, ReferenceStops},
};
use super::{COORDINATOR, Outbox, Owed};
use crate::{
    arithmetic::root,
    config::{CameraConfig, Duty},
    hardware::Button,
    log::debug,
    memory::{Fact, KeptSighting, ReferenceStop},
    message::{
        Address, Bearing, Command, Done, Frame, Hello, Kind, Located, Look, MEMBERS, Message,
        PoseParts, References, Report, Seen, Sight, Sighted, State, StopNumber, Stopped, Tracked,
    },
};

/// Targets a camera knows at a time. The one heard least recently makes room.
pub const TARGETS: usize = 4;

/// Room for an answer of some 40 bytes, its acknowledgement of 36, both ways' turnaround and
/// clear-channel assessment.
const SLOT: Duration = Duration::from_millis(5);

/// A stop told late comes after the next few were. Farther back are the numbers of a target that
/// began anew.
const OVERTAKEN: StopNumber = 8;
/// A target that says that it stands stays for so long at least: a look that ends later may have
/// seen it leave.
const LOOK_WITHIN: Duration = Duration::from_millis(3_500);

/// A task for the camera's hardware. One at a time is given; the next one after its event. Only
/// [`Command::Track`] goes on until the next task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Task {
    /// Look whether a target of this colour stands in view.
    Look {
        /// The colour.
        colour: u8,
    },
    /// A command of the coordinator or a button.
    Command(Command),
}

/// What the camera's hardware tells.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// The end of [`Task::Look`].
    Looked(Sight, Option<Seen>),
    /// The end of [`Task::Command`].
    Done(Done),
    /// A packet while tracking for the coordinator.
    Tracked(Tracked),
    /// A button was pressed.
    Button(Button),
    /// The camera has started, and can look.
    Ready,
}

/// Why a camera sends a message of which it must know the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Errand {
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
    frame: Frame,
    sight: Sight,
    seen: Option<Seen>,
}

/// A camera's state.
#[derive(Clone, Debug)]
pub struct Camera {
    id: u16,
    config: CameraConfig,
    address: Option<ShortAddress>,
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
    command: Option<Command>,
    last: heapless::Vec<LastLook, TARGETS>,

    outbox: Outbox<Errand, 8>,
    saves: heapless::Deque<Fact, 8>,
    hello: Owed,
    to_coordinator: Owed,
    to_targets: heapless::Vec<KnownTarget, TARGETS>,
    posed: (Owed, Option<PoseParts>),
    located: (Owed, Option<(Address, Located)>),
    bearings: heapless::Vec<(Address, StopNumber, Owed), REFERENCE_STOPS>,
    /// The next of its sightings that the coordinator asked for.
    listing: Option<usize>,
    /// The next of the facts to be erased.
    erasing: Option<usize>,
    target_seen: bool,
}

impl Camera {
    /// A camera that knows nothing yet.
    pub fn new(id: u16, config: CameraConfig) -> Self {
        let report = nothing_known(id);
        Self {
            id,
            config,
            address: None,
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
            saves: heapless::Deque::new(),
            hello: Owed::Nothing,
            to_coordinator: Owed::Nothing,
            to_targets: heapless::Vec::new(),
            posed: (Owed::Nothing, None),
            located: (Owed::Nothing, None),
            bearings: heapless::Vec::new(),
            listing: None,
            erasing: None,
            target_seen: false,
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

    fn save(&mut self, fact: Fact) {
        // Written one after the other as fast as they come; what is lost is learnt again.
        let _ = self.saves.push_back(fact);
    }

    /// Whether a look at this stop would be of use.
    fn wants(&self, stopped: &Stopped) -> bool {
        match stopped.frame {
            Frame::Site => !self.report.done && self.report.duty.is_none(),
            Frame::Own if self.pose().is_some() => true,
            Frame::Own => match self.references {
                Some(_) => self.duty().is_some(),
                None => self.config.reference.is_some() || self.config.may_be_elected,
            },
        }
    }

    fn stopped(&mut self, now: Instant, target: Address, stopped: &Stopped) {
        self.meet(now, target);
        let asked = Asked {
            target,
            stopped: *stopped,
            heard: now,
        };
        let is_past = |stop: StopNumber| (1..=OVERTAKEN).contains(&stop.wrapping_sub(stopped.stop));
        let known = self.last.iter().map(|last| (last.target, last.stop));
        let asked_for = [self.looking, self.next].into_iter().flatten();
        let mut known = known.chain(asked_for.map(|asked| (asked.target, asked.stopped.stop)));
        if known.any(|(of, stop)| of == target && is_past(stop)) {
            // The target stands there no more.
            return;
        }
        let is_last = |last: &&LastLook| last.target == target && last.stop == stopped.stop;
        if let Some(&last) = self.last.iter().find(is_last) {
            // It was looked at. It may be told again because the answer was lost, or because the
            // target now knows where it is.
            if last.sight != Sight::NotLooking && last.frame != stopped.frame {
                self.looked(now, asked, last.sight, last.seen);
                return;
            }
            if last.frame == stopped.frame {
                self.answer(now, asked.target, stopped.stop, last.sight);
                return;
            }
        }
        if !self.wants(stopped) {
            self.looked(now, asked, Sight::NotLooking, None);
        } else if !self.ready {
            self.answer(now, target, stopped.stop, Sight::NotReady);
        } else if self
            .looking
            .is_none_or(|looking| (looking.target, looking.stopped.stop) != (target, stopped.stop))
        {
            // Of two that wait the later one counts; the other target asks again.
            self.next = Some(asked);
        } else {
            self.looking = Some(asked);
        }
    }

    /// Remembers a target, so that it is told when the pose is known.
    fn meet(&mut self, now: Instant, target: Address) {
        let is_known = |known: &KnownTarget| known.address == target;
        let mut known = match self.to_targets.iter().position(is_known) {
            Some(place) => self.to_targets.remove(place),
            None => {
                if self.to_targets.is_full() {
                    self.to_targets.remove(0);
                }
                KnownTarget {
                    address: target,
                    report: Owed::Nothing,
                    missed_report: self.report.state != State::Waiting,
                }
            }
        };
        if known.missed_report {
            known.missed_report = false;
            known.report.tell(now);
        }
        // The one heard last is the last one to make room.
        let _ = self.to_targets.push(known);
    }

    /// Answers in this node's own slot after a question that went to everybody: otherwise all
    /// answers would begin in the same moment.
    fn answer(&mut self, now: Instant, target: Address, stop: StopNumber, sight: Sight) {
        let due = now + self.slot();
        let look = Look {
            stop,
            sight,
            counted: self.report.sightings,
            done: self.report.done,
        };
        self.outbox
            .push(due, ShortAddress(target), Message::Look(look), None);
    }

    /// A look is over.
    fn looked(&mut self, now: Instant, asked: Asked, sight: Sight, seen: Option<Seen>) {
        let Asked {
            target, stopped, ..
        } = asked;
        let seen = seen.filter(|seen| sight == Sight::InView && seen.is_usable());
        if sight != Sight::NotLooking {
            self.target_seen = seen.is_some();
        }
        if let Some(seen) = seen {
            match stopped.frame {
                Frame::Site => self.sighted(now, target, &stopped, seen),
                Frame::Own => self.sighted_lost(now, target, &stopped, seen),
            }
        }
        let last = LastLook {
            target,
            stop: stopped.stop,
            frame: stopped.frame,
            sight,
            seen,
        };
        self.last.retain(|known| known.target != target);
        if self.last.is_full() {
            self.last.remove(0);
        }
        let _ = self.last.push(last);
        self.answer(now, target, stopped.stop, sight);
    }

    /// Three of these make a pose.
    // Not inlined, for the sake of the stack.
    #[inline(never)]
    fn sighted(&mut self, now: Instant, target: Address, stopped: &Stopped, seen: Seen) {
        if self.report.done || self.report.duty.is_some() {
            return;
        }
        let sighting = KeptSighting {
            target,
            stop: stopped.stop,
            place: stopped.place,
            seen,
        };
        let Some(index) = self.calibration.add(sighting) else {
            return;
        };
        self.save(Fact::Sighting(index as u8, Some(sighting)));
        let answer = self.calibration.solve();
        let count = self.calibration.count();
        self.know(
            now,
            Report {
                sightings: count as u8,
                used: answer.used as u8,
                chi_squared: answer.chi_squared,
                done: is_done(&self.config, count, &answer.state),
                state: answer.state,
                ..self.report
            },
        );
    }

    /// The target does not know where it is.
    // Not inlined, for the sake of the stack.
    #[inline(never)]
    fn sighted_lost(&mut self, now: Instant, target: Address, stopped: &Stopped, seen: Seen) {
        let stop = stopped.stop;
        if let Some(pose) = self.pose() {
            let bearing = Bearing {
                target,
                stop,
                seen,
                pose: Some(pose),
            };
            self.outbox
                .push(now, ShortAddress(target), Message::Bearing(bearing), None);
            return;
        }
        if let Some(index) = self.stops.own(target, stop, stopped.place, seen) {
            self.save_reference_stop(index);
        }
        match self.duty() {
            Some(Duty::First) => self.solve_reference(now),
            Some(Duty::Second) => self.owe_bearing(now, target, stop),
            None => {
                let trigger = Message::Trigger { target, stop };
                self.outbox.push(now, COORDINATOR, trigger, None);
            }
        }
    }

    fn save_reference_stop(&mut self, index: usize) {
        let stop = self.stops.iter().nth(index).copied();
        self.save(Fact::ReferenceStop(index as u8, stop));
    }

    fn owe_bearing(&mut self, now: Instant, target: Address, stop: StopNumber) {
        if self.bearings.is_full() {
            self.bearings.remove(0);
        }
        let _ = self.bearings.push((target, stop, Owed::Due(now, 0)));
    }

    // Not inlined, for the sake of the stack.
    #[inline(never)]
    fn solve_reference(&mut self, now: Instant) {
        if self.pose().is_some() {
            return;
        }
        let Some(references) = &self.references else {
            return;
        };
        let frame = ReferenceFrame::new(references, &self.config);
        let wanted = usize::from(self.config.reference_stops);
        match self.stops.solve(&frame, wanted) {
            Ok(answer) => {
                let [first, second] = answer.poses;
                self.posed = (Owed::Due(now, 0), Some(second));
                self.save(Fact::Posed(Some(second)));
                self.located = (Owed::Due(now, 0), Some((answer.target, answer.located)));
                self.posed_as(
                    now,
                    Duty::First,
                    first,
                    answer.stops as u8,
                    answer.chi_squared,
                );
            }
            Err(why) => {
                debug!("no reference solve yet");
                if let reference::NotYet::Refused(refusal) = why {
                    let state = State::Refused(refusal);
                    self.know(
                        now,
                        Report {
                            state,
                            ..self.report
                        },
                    );
                }
            }
        }
    }

    /// This reference camera now knows its pose.
    fn posed_as(&mut self, now: Instant, duty: Duty, pose: PoseParts, stops: u8, chi: f32) {
        let report = Report {
            duty: Some(duty),
            sightings: stops,
            used: stops,
            chi_squared: chi,
            done: true,
            state: State::Pose(pose),
            ..self.report
        };
        self.stops.clear();
        self.know(now, report);
    }

    /// Takes a new state, keeps it and tells it.
    fn know(&mut self, now: Instant, report: Report) {
        if report == self.report {
            return;
        }
        self.report = report;
        self.save(Fact::Report(Some(report)));
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

    fn forget(&mut self, now: Instant) {
        self.calibration.clear();
        self.stops.clear();
        self.last.clear();
        self.bearings.clear();
        self.posed = (Owed::Nothing, None);
        self.know(now, nothing_known(self.id));
        self.erasing = Some(0);
    }

    /// The next of the facts of which a camera that forgot has to get rid.
    fn erase(&mut self) -> Option<Fact> {
        let index = self.erasing?;
        let fact = match index {
            0 => Fact::Posed(None),
            1..=SIGHTINGS => Fact::Sighting((index - 1) as u8, None),
            _ => Fact::ReferenceStop((index - 1 - SIGHTINGS) as u8, None),
        };
        self.erasing = Some(index + 1).filter(|next| *next <= SIGHTINGS + REFERENCE_STOPS);
        Some(fact)
    }

    fn references(&mut self, now: Instant, references: References) {
        if self.references == Some(references) {
            return;
        }
        self.references = Some(references);
        self.bearings.clear();
        self.save(Fact::References(Some(references)));
        match self.duty() {
            Some(Duty::First) => self.solve_reference(now),
            Some(Duty::Second) => self.owe_bearings(now),
            None => {}
        }
    }

    fn owe_bearings(&mut self, now: Instant) {
        let owed = |stop: &ReferenceStop| (stop.target, stop.stop, Owed::Due(now, 0));
        let mine = self.stops.iter().filter(|stop| stop.own.is_some());
        self.bearings.clear();
        for bearing in mine.map(owed) {
            // As many as there are stops.
            let _ = self.bearings.push(bearing);
        }
    }

    fn bearing(&mut self, now: Instant, bearing: &Bearing) {
        if self.duty() != Some(Duty::First) || !bearing.seen.is_usable() {
            return;
        }
        if self.pose().is_some() {
            // The second one has not heard its pose, or lost it.
            if self.posed.1.is_some() {
                self.posed.0.tell(now);
            }
            return;
        }
        if let Some(index) = self.stops.other(bearing.target, bearing.stop, bearing.seen) {
            self.save_reference_stop(index);
        }
        self.solve_reference(now);
    }

    fn list(&mut self) -> Option<Message> {
        let index = self.listing?;
        let Some(kept) = self.calibration.get(index) else {
            self.listing = None;
            return None;
        };
        self.listing = Some(index + 1);
        Some(Message::Sighting(Sighted {
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
    fn debt(&mut self, now: Instant) -> Option<(ShortAddress, Message, Errand)> {
        if self.hello.take(now) {
            let hello = Hello {
                id: self.id,
                kind: Kind::Camera {
                    reference: self.config.reference,
                },
            };
            return Some((COORDINATOR, Message::Hello(hello), Errand::Hello));
        }
        if self.located.0.take(now)
            && let Some((target, located)) = self.located.1
        {
            let to = ShortAddress(target);
            return Some((to, Message::Located(located), Errand::Located));
        }
        if self.posed.0.take(now)
            && let (Some(pose), Some(references)) = (self.posed.1, self.references)
        {
            let to = ShortAddress(references.second);
            return Some((to, Message::Posed(pose), Errand::Posed));
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
                let bearing = Bearing {
                    target,
                    stop,
                    seen,
                    pose: None,
                };
                let to = ShortAddress(references.first);
                let errand = Errand::Bearing(target, stop);
                return Some((to, Message::Bearing(bearing), errand));
            }
        }
        if self.to_coordinator.take(now) {
            let message = Message::Report(self.report);
            return Some((COORDINATOR, message, Errand::ReportToCoordinator));
        }
        let report = self.report;
        self.to_targets.iter_mut().find_map(|target| {
            target.report.take(now).then_some((
                ShortAddress(target.address),
                Message::Report(report),
                Errand::ReportTo(target.address),
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
        state: State::Waiting,
    }
}
