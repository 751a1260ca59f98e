//! The coordinator: who is there, who the references are, and what people want to know.
//!
//! It computes nothing. It tells targets which cameras to expect, appoints the reference cameras
//! (those configured, or the first two that saw a target), collects poses for the PC on its line,
//! and hands the PC's commands on, as the coordinator of the thesis did (3.4.4, Appendix A).

#[cfg(test)]
mod tests;

use core::time::Duration;

use calib_core::Status;
use zigbee_link::{Instant, store::Membership, wire::ShortAddress};

use super::{Notification, Notifications, Outbox, Output, RETRY, Reports, Role, Unsaved, earliest};
use crate::{
    config::SiteKey,
    console::{FromPc, NetworkInfo, ToPc},
    facts::{Fact, FactKey},
    hardware::{Button, Indication},
    limits::MEMBERS,
    message::{
        CameraCommand, CommandResult, Duty, Hello, MemberAddress, MemberKind, Message, References,
        Report, StopNumber,
    },
};

/// How long a button opens the join window.
const BUTTON_WINDOW: Duration = Duration::from_secs(60);

/// After a start everybody is asked who they are, and again after these times, for broadcasts may
/// be lost.
const ROLL_CALLS: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(25)];

/// A roster is sent when nobody new came for so long.
const ROSTER_AFTER: Duration = Duration::from_millis(500);

/// A message of which the coordinator must know whether it was delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CoordinatorNotification {
    /// A member has to be told something.
    Member(MemberAddress, MemberNotification),
    /// A camera is given a command.
    Command(MemberAddress, CameraCommand),
}

/// What a member has to be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MemberNotification {
    /// The question who it is.
    WhoIsThere,
    /// A target: which cameras there are.
    Roster,
    /// A camera: who the references are.
    References,
}

impl Notification for MemberNotification {
    fn priority(self) -> u8 {
        self as u8
    }
}

/// A task for what surrounds the coordinator.
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
    /// Tell the PC how the change of the site key goes.
    TellKeyChange,
}

/// What surrounds the coordinator tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CoordinatorEvent {
    /// The PC wants something.
    Pc(FromPc),
    /// A button was pressed.
    Button(Button),
}

/// What is known of a member besides its report.
#[derive(Clone, Debug, Default)]
struct Known {
    hello: Option<Hello>,
    /// What it has to be told.
    notifications: Notifications<MemberNotification, 3>,
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

/// The first camera that saw a target, at this stop of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Trigger {
    camera: MemberAddress,
    target: MemberAddress,
    stop: StopNumber,
}

/// The coordinator's state.
#[derive(Clone, Debug)]
pub struct CoordinatorRole {
    members: Reports<Known>,
    network: Option<NetworkInfo>,
    references: Option<References>,
    /// References were appointed in a former run.
    restored: bool,
    trigger: Option<Trigger>,
    /// Facts that are not written down yet.
    unsaved: Unsaved,
    outbox: Outbox<CoordinatorNotification, 8>,
    tasks: heapless::Deque<CoordinatorTask, 16>,
    /// To be opened.
    join_window: Option<Duration>,
    /// The PC asked for everything: the next line of the table of members.
    refresh: Option<usize>,
    roll_calls: RollCalls,
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
            network: None,
            references: None,
            restored: false,
            trigger: None,
            unsaved: Unsaved::new(),
            outbox: Outbox::new(),
            tasks: heapless::Deque::new(),
            join_window: None,
            refresh: None,
            roll_calls: RollCalls::new(),
        }
    }

    /// What cameras reported, with their addresses.
    pub fn reports(&self) -> impl Iterator<Item = (MemberAddress, &Report)> {
        self.members
            .iter()
            .filter_map(|member| Some((member.address, member.report.as_ref()?)))
    }

    /// Somebody sent something. A member that never said who it is, is asked.
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

    /// The next fact to write down.
    fn unsaved_fact(&mut self) -> Option<Fact> {
        match self.unsaved.take()? {
            FactKey::References => Some(Fact::References(self.references)),
            FactKey::Camera(slot) => Some(self.members.fact(slot)),
            other => {
                debug_assert!(false, "no fact of a coordinator: {other:?}");
                None
            }
        }
    }

    /// Knows nothing of a member any more. If it was a reference camera, there are none.
    fn forget(&mut self, address: MemberAddress) {
        self.members.remove(address, &mut self.unsaved);
        let is_it = |references: &mut References| {
            let duty = references.duty_of(ShortAddress(address));
            duty.is_some()
        };
        if self.references.take_if(is_it).is_some() {
            self.unsaved.insert(FactKey::References);
            // Nobody is to be told any more: what stays due would keep the node awake.
            for member in self.members.iter_mut() {
                let notifications = &mut member.more.notifications;
                notifications.cancel(MemberNotification::References);
            }
        }
        self.trigger
            .take_if(|trigger| [trigger.camera, trigger.target].contains(&address));
    }

    /// Whether a camera knows its pose, so that there is a frame of the site.
    fn has_frame(&self) -> bool {
        let mut reports = self.reports();
        reports.any(|(_, report)| report.pose().is_some())
    }

    /// Full, the PC misses something until it asks for everything again.
    fn tell_pc(&mut self, message: ToPc) {
        let _ = self.tasks.push_back(CoordinatorTask::Tell(message));
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
        match hello.kind {
            MemberKind::Target => notifications.notify(MemberNotification::Roster, now),
            MemberKind::Camera { .. } if is_news => {
                let members = self.members.iter_mut().map(|member| &mut member.more);
                for target in members.filter(|member| member.is_target()) {
                    let due = now + ROSTER_AFTER;
                    target.notifications.notify(MemberNotification::Roster, due);
                }
            }
            MemberKind::Camera { .. } => {}
        }
        self.tell_pc(ToPc::Member { address, hello });
        if matches!(hello.kind, MemberKind::Camera { reference: Some(_) }) {
            self.appoint_configured(now);
        }
        // A reference may have missed it, or forgotten. After a restart of this node nobody knows
        // who was one before, and was not told.
        if let Some(references) = self.references
            && hello.kind != MemberKind::Target
            && (is_news && self.restored || references.duty_of(ShortAddress(address)).is_some())
        {
            self.notify(now, address, MemberNotification::References);
        }
    }

    /// A member has to be told this.
    fn notify(&mut self, now: Instant, member: MemberAddress, what: MemberNotification) {
        if let Some(member) = self.members.get(member) {
            member.notifications.notify(what, now);
        }
    }

    /// The camera that is configured as this reference, and its position. Of several the one that
    /// was met last, which is there in place of the others.
    fn camera_with(&self, wanted: Duty) -> Option<(MemberAddress, Option<[f32; 2]>)> {
        self.members
            .iter()
            .rev()
            .find_map(|member| match member.more.hello?.kind {
                MemberKind::Camera {
                    reference: Some(reference),
                } if reference.duty == wanted => Some((member.address, reference.position)),
                _ => None,
            })
    }

    fn appoint_configured(&mut self, now: Instant) {
        if let (Some((first, at)), Some((second, to))) = (
            self.camera_with(Duty::First),
            self.camera_with(Duty::Second),
        ) {
            let references = References {
                first,
                second,
                positions: at.zip(to).map(|(at, to)| [at, to]),
            };
            self.appoint(now, references);
        }
    }

    fn appoint(&mut self, now: Instant, references: References) {
        if self.references == Some(references) {
            return;
        }
        let former = self.references.replace(references);
        self.unsaved.insert(FactKey::References);
        // Those that are none any more, too.
        for references in former.into_iter().chain([references]) {
            for camera in [references.first, references.second] {
                self.notify(now, camera, MemberNotification::References);
            }
        }
    }

    /// The first camera to see a target triggers; the next one that sees it at the same stop
    /// becomes its helper (thesis 2.3). Not where cameras know their poses, as they may from a former
    /// network: the target finds its place from them, and a second frame would begin here.
    fn on_trigger(&mut self, now: Instant, trigger: Trigger) {
        let is_configured = [Duty::First, Duty::Second]
            .iter()
            .any(|&duty| self.camera_with(duty).is_some());
        if self.references.is_some() || is_configured || self.has_frame() {
            return;
        }
        let Trigger {
            camera,
            target,
            stop,
        } = trigger;
        match self.trigger {
            Some(first) if (first.target, first.stop) == (target, stop) => {
                if first.camera != camera {
                    let references = References {
                        first: first.camera,
                        second: camera,
                        positions: None,
                    };
                    self.appoint(now, references);
                }
            }
            _ => self.trigger = Some(trigger),
        }
    }

    fn on_report(&mut self, address: MemberAddress, report: &Report) {
        let known = self.members.report(address, *report, &mut self.unsaved);
        if known.is_none() {
            return;
        }
        self.tell_pc(ToPc::Report {
            address,
            report: *report,
        });
    }

    fn on_pc(&mut self, now: Instant, wish: FromPc) {
        match wish {
            FromPc::Refresh => {
                self.refresh = Some(0);
                self.tell_pc(ToPc::Network(self.network));
                let _ = self.tasks.push_back(CoordinatorTask::TellKeyChange);
            }
            FromPc::JoinWindow(seconds) => {
                self.join_window = Some(Duration::from_secs(seconds.into()));
            }
            FromPc::Command { address, command } => {
                let notification = CoordinatorNotification::Command(address, command);
                let message = Message::Command(command);
                let to = ShortAddress(address);
                if !self.outbox.push(now, to, message, Some(notification)) {
                    self.on_sent(now, notification, false);
                }
            }
            FromPc::Sightings(address) => {
                // Full, they are asked for again: none came.
                let to = ShortAddress(address);
                let _ = self.outbox.push(now, to, Message::Sightings, None);
            }
            // Full, the PC hears nothing of these, and asks again.
            FromPc::Remove(address) => {
                if self
                    .tasks
                    .push_back(CoordinatorTask::Remove(address))
                    .is_ok()
                {
                    self.forget(address);
                }
            }
            FromPc::ChangeKey(key) => {
                let _ = self.tasks.push_back(CoordinatorTask::ChangeKey(key));
            }
        }
    }

    /// The next line of the table for the PC, when it asked for everything.
    fn next_line(&mut self) {
        let Some(line) = self.refresh else {
            return;
        };
        if !self.tasks.is_empty() {
            return;
        }
        let Some(member) = self.members.iter().nth(line) else {
            self.refresh = None;
            return;
        };
        let (address, report, hello) = (member.address, member.report, member.more.hello);
        self.refresh = Some(line + 1);
        if let Some(hello) = hello {
            self.tell_pc(ToPc::Member { address, hello });
        }
        if let Some(report) = report {
            self.tell_pc(ToPc::Report { address, report });
        }
    }

    fn roster(&self) -> heapless::Vec<MemberAddress, MEMBERS> {
        let mut roster = heapless::Vec::new();
        for camera in self.members.iter().filter(|member| member.more.is_camera()) {
            let has_room = roster.push(camera.address).is_ok();
            debug_assert!(has_room, "it has room for all members");
        }
        roster
    }

    /// The next message that a member has to be told.
    fn next_notification(&mut self, now: Instant) -> Option<(MemberAddress, MemberNotification)> {
        self.members.iter_mut().find_map(|member| {
            let due = member.more.notifications.take_due(now)?;
            Some((member.address, due))
        })
    }

    /// What a member is told, as it is known now.
    fn message_of(&self, notification: MemberNotification) -> Option<Message> {
        Some(match notification {
            MemberNotification::WhoIsThere => Message::WhoIsThere,
            MemberNotification::Roster => Message::Roster(self.roster()),
            MemberNotification::References => Message::References(self.references?),
        })
    }
}

/// When everybody is asked who they are.
#[derive(Clone, Debug)]
struct RollCalls {
    made: usize,
    next: Option<Instant>,
}

impl RollCalls {
    const fn new() -> Self {
        Self {
            made: 0,
            next: None,
        }
    }

    /// The first one, unless that was before.
    fn begin(&mut self, now: Instant) {
        if self.made == 0 {
            self.next.get_or_insert(now);
        }
    }

    fn take_due(&mut self, now: Instant) -> bool {
        let is_due = self.next.take_if(|at| *at <= now).is_some();
        if is_due {
            self.next = ROLL_CALLS.get(self.made).map(|&after| now + after);
            self.made += 1;
        }
        is_due
    }
}

impl Role for CoordinatorRole {
    type Notification = CoordinatorNotification;
    type Task = CoordinatorTask;
    type Event = CoordinatorEvent;

    fn restore(&mut self, fact: &Fact) {
        match fact {
            Fact::References(references) => {
                self.references = *references;
                self.restored = references.is_some();
            }
            Fact::Camera(slot, Some((address, report))) => {
                let known = self.members.restore(*slot, *address, *report);
                debug_assert!(known.is_some(), "it has room for all that were written");
            }
            _ => {}
        }
    }

    fn on_attached(&mut self, now: Instant, network: Option<Membership>) {
        self.network = network.map(|network| NetworkInfo {
            pan: network.pan.0,
            channel: network.channel.number(),
        });
        self.tell_pc(ToPc::Network(self.network));
        if network.is_some() {
            self.roll_calls.begin(now);
        }
    }

    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        let address = from.0;
        self.meet(now, address);
        match message {
            Message::Hello(hello) => self.on_hello(now, address, *hello),
            Message::Report(report) => self.on_report(address, report),
            Message::Trigger { target, stop } => self.on_trigger(
                now,
                Trigger {
                    camera: address,
                    target: *target,
                    stop: *stop,
                },
            ),
            Message::Done(done) => self.tell_pc(ToPc::Done {
                address,
                done: *done,
            }),
            Message::Tracked(tracked) => self.tell_pc(ToPc::Tracked {
                address,
                tracked: *tracked,
            }),
            Message::Sighting(sighting) => self.tell_pc(ToPc::Sighting {
                address,
                sighting: *sighting,
            }),
            _ => {}
        }
    }

    fn on_sent(&mut self, now: Instant, notification: CoordinatorNotification, delivered: bool) {
        match notification {
            CoordinatorNotification::Member(address, what) => {
                if let Some(member) = self.members.get(address) {
                    // A member that cannot be reached says hello when it is back.
                    let is_settled = delivered || what == MemberNotification::WhoIsThere;
                    member.notifications.on_sent(what, now, is_settled);
                }
            }
            CoordinatorNotification::Command(address, command) => {
                if !delivered {
                    let done = CommandResult {
                        command,
                        success: false,
                    };
                    self.tell_pc(ToPc::Done { address, done });
                }
            }
        }
    }

    fn on_event(&mut self, now: Instant, event: CoordinatorEvent) {
        match event {
            CoordinatorEvent::Pc(wish) => self.on_pc(now, wish),
            CoordinatorEvent::Button(Button::JoinWindow) => {
                self.join_window = Some(BUTTON_WINDOW);
            }
            CoordinatorEvent::Button(Button::LearnColour) => {}
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<CoordinatorNotification, CoordinatorTask>> {
        self.next_line();
        if let Some(fact) = self.unsaved_fact() {
            return Some(Output::Save(fact));
        }
        if let Some(window) = self.join_window.take() {
            return Some(Output::Task(CoordinatorTask::OpenJoinWindow(window)));
        }
        if let Some(task) = self.tasks.pop_front() {
            return Some(Output::Task(task));
        }
        self.network?;
        if let Some(message) = self.outbox.take_due(now) {
            return Some(message);
        }
        if self.roll_calls.take_due(now) {
            return Some(Output::Send {
                to: ShortAddress::BROADCAST,
                message: Message::WhoIsThere,
                notification: None,
            });
        }
        while let Some((member, what)) = self.next_notification(now) {
            if let Some(message) = self.message_of(what) {
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
        self.network?;
        let members = self.members.iter();
        let members = members.filter_map(|member| member.more.notifications.next_due());
        earliest([self.roll_calls.next, self.outbox.next_due(), members.min()])
    }

    fn indication(&self) -> Indication {
        Indication {
            joined: self.network.is_some(),
            target_seen: self.trigger.is_some(),
            calibrated: self
                .reports()
                .any(|(_, report)| report.status() == Status::Calibrated),
            may_walk: false,
        }
    }
}
