//! The coordinator: the members, the references, and the reports for people.
//!
//! It computes no poses. It tells targets which cameras to expect, appoints the reference cameras
//! (those configured, or the first two that saw a target), collects poses for the PC on its line,
//! and hands the PC's commands on, as the coordinator of the thesis did (3.4.4, Appendix A). It combines the
//! looks of cameras that track to objects and their places.

mod appointment;
mod pc;
mod roll_calls;
#[cfg(test)]
mod tests;
mod tracking;

use core::time::Duration;

use calib_core::Status;
use zigbee_link::{Instant, wire::ShortAddress};

use self::{
    appointment::{Appointment, Trigger},
    pc::Tasks,
    roll_calls::RollCalls,
    tracking::Tracking,
};
use super::{Notification, Notifications, Outbox, Output, RETRY, Reports, Role, Unsaved, earliest};
use crate::{
    config::{CoordinatorConfig, SiteKey},
    console::{FromPc, ToPc},
    facts::{Fact, FactKey},
    hardware::{Button, Indication},
    limits::ROSTER,
    message::{
        CameraCommand, CommandOutcome, CommandResult, Eye, Health, Hello, MemberAddress,
        MemberKind, Memory, Message, References, Report, Restart, SitePlace, StopNumber, Stopped,
        Tracked,
    },
    network::Attachment,
};

/// Time for which a button opens the join window.
const BUTTON_WINDOW: Duration = Duration::from_secs(60);

/// A roster is sent when no new member came for so long.
const ROSTER_AFTER: Duration = Duration::from_millis(500);

/// A message of which the coordinator must know whether it was delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CoordinatorNotification {
    /// A member has to be told something.
    Member(MemberAddress, MemberNotification),
    /// A camera is given a command.
    Command(MemberAddress, CameraCommand),
    /// A packet of an update is handed on.
    Update,
}

/// Message that a member has to be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MemberNotification {
    /// The question who it is.
    WhoIsThere,
    /// A target: the list of cameras.
    Roster,
    /// A camera: the references.
    References,
}

impl Notification for MemberNotification {
    fn priority(self) -> u8 {
        self as u8
    }
}

/// A task for the surroundings of the coordinator.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CoordinatorTask {
    /// Tell the PC.
    Tell(ToPc),
    /// Let new devices join for a while.
    OpenJoinWindow(Duration),
    /// Send a member away, and tell the PC.
    Remove(MemberAddress),
    /// Begin to change the site key, and tell the PC.
    ChangeKey(SiteKey),
    /// Tell the PC identifier and channel of the network.
    TellNetwork,
    /// Tell the PC the progress of the change of the site key.
    TellKeyChange,
    /// Take another PAN identifier, and tell the PC.
    ChangePan,
    /// Tell the PC if another network has the same PAN identifier.
    TellConflict,
}

/// Events from the surroundings of the coordinator.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CoordinatorEvent {
    /// The PC wants something.
    Pc(FromPc),
    /// A button was pressed.
    Button(Button),
}

/// Knowledge about a member besides its report.
#[derive(Clone, Debug, Default)]
struct Known {
    hello: Option<Hello>,
    /// Messages that it has to be told.
    notifications: Notifications<MemberNotification, 3>,
    /// A target: number of cameras that it was told since one was new.
    roster_told: u8,
    /// As it told after its hello.
    health: Health,
    /// A camera: number of messages in a row about the references that did not reach it.
    unreached: u8,
}

impl Known {
    fn is_camera(&self) -> bool {
        self.hello
            .is_some_and(|hello| hello.kind != MemberKind::Target)
    }

    fn is_target(&self) -> bool {
        self.hello
            .is_some_and(|hello| hello.kind == MemberKind::Target)
    }
}

/// The coordinator's state.
#[derive(Clone, Debug)]
pub struct CoordinatorRole {
    members: Reports<Known>,
    is_attached: bool,
    appointment: Appointment,
    /// Facts that are not written down yet.
    unsaved: Unsaved,
    outbox: Outbox<CoordinatorNotification, 8>,
    tasks: Tasks,
    roll_calls: RollCalls,
    /// The stop of a target that the PC was told last.
    stopped: Option<(MemberAddress, StopNumber, Option<SitePlace>)>,
    tracking: Tracking,
    /// Its own.
    health: Health,
}

impl Default for CoordinatorRole {
    fn default() -> Self {
        Self::new()
    }
}

impl CoordinatorRole {
    /// A coordinator that knows nothing yet.
    pub const fn new() -> Self {
        Self {
            members: Reports::new(),
            is_attached: false,
            appointment: Appointment::new(),
            unsaved: Unsaved::new(),
            outbox: Outbox::new(),
            tasks: Tasks::new(),
            roll_calls: RollCalls::new(),
            stopped: None,
            tracking: Tracking::new(),
            health: Health {
                memory: Memory::Flash,
                camera: Eye::Sees,
                restart: Restart::Ordinary,
                steps: None,
            },
        }
    }

    /// From now on objects of this kind are tracked, in this unit.
    pub fn track(&mut self, config: &CoordinatorConfig) {
        self.tracking.configure(config);
    }

    /// Reports of cameras, with their addresses.
    pub fn reports(&self) -> impl Iterator<Item = (MemberAddress, &Report)> {
        self.members
            .iter()
            .filter_map(|member| Some((member.address, member.report.as_ref()?)))
    }

    /// A member sent something. If it never presented itself, it is asked.
    fn meet(&mut self, now: Instant, address: MemberAddress) {
        if let Some(member) = self.members.of(address)
            && member.more.hello.is_none()
        {
            let notifications = &mut member.more.notifications;
            if !notifications.is_pending(MemberNotification::WhoIsThere) {
                // It says so by itself when it has just joined.
                notifications.notify(MemberNotification::WhoIsThere, now + RETRY);
            }
        }
    }

    /// A target repeats itself while it stands: only news goes to the PC.
    fn tell_stop(&mut self, address: MemberAddress, stopped: &Stopped) {
        let (stop, place) = (stopped.stop, stopped.told());
        let news = (address, stop, place);
        if self.stopped.replace(news) != Some(news) {
            self.tasks.tell(ToPc::Stopped {
                address,
                stop,
                place,
            });
        }
    }

    /// Takes the look of a camera that tracks.
    fn on_tracked(&mut self, now: Instant, address: MemberAddress, tracked: &Tracked) {
        self.tasks.tell(ToPc::Tracked {
            address,
            tracked: *tracked,
        });
        let mut members = self.members.iter();
        let member = members.find(|member| member.address == address);
        let report = member.and_then(|member| member.report.as_ref());
        self.tracking.on_tracked(now, address, tracked, report);
    }

    /// The next fact to write down.
    fn unsaved_fact(&mut self) -> Option<Fact> {
        match self.unsaved.take()? {
            FactKey::References => Some(Fact::References(self.appointment.references())),
            FactKey::Camera(slot) => Some(self.members.fact(slot)),
            other => {
                debug_assert!(false, "no fact of a coordinator: {other:?}");
                None
            }
        }
    }

    fn on_hello(&mut self, now: Instant, address: MemberAddress, hello: Hello) {
        if let MemberKind::Camera {
            reference: Some(reference),
        } = hello.kind
            && !reference.is_usable()
        {
            return;
        }
        let Some(member) = self.members.of(address) else {
            return;
        };
        let member = &mut member.more;
        let notifications = &mut member.notifications;
        notifications.cancel(MemberNotification::WhoIsThere);
        let is_news = member.hello.replace(hello) != Some(hello);
        // Its health follows.
        member.health = Health::default();
        match hello.kind {
            MemberKind::Target => {
                notifications.notify(MemberNotification::Roster, now);
                member.roster_told = 0;
            }
            MemberKind::Camera { .. } if is_news => {
                let members = self.members.iter_mut().map(|member| &mut member.more);
                for target in members.filter(|member| member.is_target()) {
                    let due = now + ROSTER_AFTER;
                    target.notifications.notify(MemberNotification::Roster, due);
                    target.roster_told = 0;
                }
            }
            MemberKind::Camera { .. } => {}
        }
        self.tasks.tell(ToPc::Member { address, hello });
        if matches!(hello.kind, MemberKind::Camera { reference: Some(_) }) {
            self.appoint_configured(now);
        }
        if hello.kind != MemberKind::Target && self.appointment.concerns(address, is_news) {
            self.notify(now, address, MemberNotification::References);
        }
    }

    /// A member has to be told this.
    fn notify(&mut self, now: Instant, member: MemberAddress, what: MemberNotification) {
        if let Some(member) = self.members.get(member) {
            member.notifications.notify(what, now);
        }
    }

    fn on_report(&mut self, now: Instant, address: MemberAddress, report: &Report) {
        let known = self.members.report(address, *report, &mut self.unsaved);
        if known.is_none() {
            return;
        }
        self.tasks.tell(ToPc::Report {
            address,
            report: *report,
        });
        if !self.has_frame() {
            self.appointment.watch(now);
        }
    }

    /// The cameras that a target is told of next.
    fn roster(&self, told: usize) -> heapless::Vec<MemberAddress, ROSTER> {
        let mut roster = heapless::Vec::new();
        let members = self.members.iter();
        let cameras = members.filter(|member| member.more.is_camera());
        for camera in cameras.skip(told).take(ROSTER) {
            let has_room = roster.push(camera.address).is_ok();
            debug_assert!(has_room, "no more are taken");
        }
        roster
    }

    /// Members that have presented themselves; the first ones if there is no room for all.
    fn heard(&self) -> heapless::Vec<MemberAddress, ROSTER> {
        let heard = self
            .members
            .iter()
            .filter(|member| member.more.hello.is_some());
        heard.map(|member| member.address).take(ROSTER).collect()
    }

    /// The next message that a member has to be told.
    fn next_notification(&mut self, now: Instant) -> Option<(MemberAddress, MemberNotification)> {
        self.members.iter_mut().find_map(|member| {
            let due = member.more.notifications.take_due(now)?;
            Some((member.address, due))
        })
    }

    /// The message to a member, as it is known now.
    fn message_of(&mut self, member: MemberAddress, what: MemberNotification) -> Option<Message> {
        Some(match what {
            MemberNotification::WhoIsThere => Message::WhoIsThere(heapless::Vec::new()),
            MemberNotification::Roster => {
                let told = self.members.get(member)?.roster_told;
                Message::Roster(self.roster(told.into()))
            }
            MemberNotification::References => {
                Message::References(self.appointment.references().unwrap_or(References::NONE))
            }
        })
    }
}

impl Role for CoordinatorRole {
    type Notification = CoordinatorNotification;
    type Task = CoordinatorTask;
    type Event = CoordinatorEvent;

    fn restore(&mut self, fact: &Fact) {
        match fact {
            Fact::References(references) => {
                self.appointment.restore(*references);
            }
            Fact::Camera(slot, Some((address, report))) => {
                let known = self.members.restore(*slot, *address, *report);
                debug_assert!(known.is_some(), "it has room for all that were written");
            }
            _ => {}
        }
    }

    fn on_attached(&mut self, now: Instant, network: Option<Attachment>) {
        self.is_attached = network.is_some();
        self.tasks.tell_network();
        if self.is_attached {
            self.roll_calls.begin(now);
            if !self.has_frame() {
                self.appointment.watch(now);
            }
        }
    }

    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        let address = from.0;
        self.meet(now, address);
        self.on_reached(now, address, true);
        match message {
            Message::Hello(hello) => self.on_hello(now, address, *hello),
            Message::Report(report) => self.on_report(now, address, report),
            Message::Health(health) => self.on_health(now, address, *health),
            Message::Trigger { target, stop } => self.on_trigger(
                now,
                Trigger {
                    camera: address,
                    target: *target,
                    stop: *stop,
                },
            ),
            Message::Done(done) => self.tasks.tell(ToPc::Done {
                address,
                done: *done,
            }),
            Message::Tracked(tracked) => self.on_tracked(now, address, tracked),
            Message::Stopped(stopped) => self.tell_stop(address, stopped),
            Message::Update(packet) => self.tasks.tell(ToPc::Update {
                address,
                packet: *packet,
            }),
            Message::Sighting(sighting) => self.tasks.tell(ToPc::Sighting {
                address,
                sighting: *sighting,
            }),
            _ => {}
        }
    }

    fn on_sent(&mut self, now: Instant, notification: CoordinatorNotification, delivered: bool) {
        match notification {
            CoordinatorNotification::Member(address, what) => {
                let cameras = self.members.iter();
                let cameras = cameras.filter(|member| member.more.is_camera()).count();
                if let Some(member) = self.members.get(address) {
                    // A member that cannot be reached says hello when it is back.
                    let is_settled = delivered || what == MemberNotification::WhoIsThere;
                    member.notifications.on_sent(what, now, is_settled);
                    let is_part = what == MemberNotification::Roster && delivered;
                    // Otherwise there is a new one, and all are told again.
                    if is_part && !member.notifications.is_pending(what) {
                        member.roster_told = member.roster_told.saturating_add(ROSTER as u8);
                        if usize::from(member.roster_told) < cameras {
                            member.notifications.notify(what, now);
                        }
                    }
                }
                if what == MemberNotification::References {
                    self.on_reached(now, address, delivered);
                }
            }
            CoordinatorNotification::Command(address, command) => {
                if !delivered {
                    let done = CommandResult {
                        command,
                        outcome: CommandOutcome::Failed,
                    };
                    self.tasks.tell(ToPc::Done { address, done });
                }
            }
            CoordinatorNotification::Update => self.tasks.tell(ToPc::UpdateSent),
        }
    }

    fn on_event(&mut self, now: Instant, event: CoordinatorEvent) {
        match event {
            CoordinatorEvent::Pc(wish) => self.on_pc(now, wish),
            CoordinatorEvent::Button(Button::JoinWindow) => {
                self.tasks.open_join_window(BUTTON_WINDOW);
            }
            CoordinatorEvent::Button(Button::LearnColour) => {}
        }
    }

    fn on_node(&mut self, _: Instant, memory: Memory, restart: Restart) {
        self.health.memory = memory;
        self.health.restart = restart;
        if self.health != Health::default() {
            self.tell_own_health();
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<CoordinatorNotification, CoordinatorTask>> {
        self.next_line();
        if let Some(told) = self.tracking.take_due(now) {
            self.tasks.tell(told);
        }
        if let Some(fact) = self.unsaved_fact() {
            return Some(Output::Save(fact));
        }
        if let Some(task) = self.tasks.take() {
            return Some(Output::Task(task));
        }
        if !self.is_attached {
            return None;
        }
        self.probe(now);
        if let Some(message) = self.outbox.take_due(now) {
            return Some(message);
        }
        if self.roll_calls.take_due(now) {
            return Some(Output::Send {
                to: ShortAddress::BROADCAST,
                message: Message::WhoIsThere(self.heard()),
                notification: None,
            });
        }
        while let Some((member, what)) = self.next_notification(now) {
            if let Some(message) = self.message_of(member, what) {
                return Some(Output::Send {
                    to: ShortAddress(member),
                    message,
                    notification: Some(CoordinatorNotification::Member(member, what)),
                });
            }
            debug_assert!(false, "cancelled when there was nothing to tell: {what:?}");
            if let Some(member) = self.members.get(member) {
                member.notifications.cancel(what);
            }
        }
        None
    }

    fn next_deadline(&self) -> Option<Instant> {
        if !self.is_attached {
            return None;
        }
        let members = self.members.iter();
        let members = members.filter_map(|member| member.more.notifications.next_due());
        earliest([
            self.roll_calls.next_due(),
            self.appointment.next_probe(),
            self.outbox.next_due(),
            self.tracking.next_due(),
            members.min(),
        ])
    }

    fn indication(&self) -> Indication {
        Indication {
            joined: self.is_attached,
            target_seen: self.appointment.is_triggered(),
            calibrated: self
                .reports()
                .any(|(_, report)| report.status() == Status::Calibrated),
            may_walk: false,
        }
    }
}
