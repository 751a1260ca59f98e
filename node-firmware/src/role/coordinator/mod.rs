//! The coordinator: who is there, who the references are, and what people want to know.
//!
//! It computes nothing. It tells targets which cameras to expect, appoints the reference cameras
//! (those configured, or the first two that saw a target), collects poses for the PC on its line,
//! and hands the PC's commands on, as the coordinator of the thesis did (3.4.4, Appendix A).

use core::time::Duration;

use calib_core::Status;
use zigbee_link::{Instant, store::Membership, wire::ShortAddress};

use super::{Earliest, Outbox, Output, Owed, Reports, Role};
use crate::{
    config::SiteKey,
    console::{FromPc, Network, ToPc},
    hardware::{Button, Indication},
    limits::MEMBERS,
    memory::Fact,
    message::{
        Address, CameraCommand, CommandResult, Duty, Hello, MemberKind, Message, References,
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

/// Why the coordinator sends a message of which it must know the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CoordinatorNotification {
    /// A member was asked who it is.
    Who(Address),
    /// A target was told which cameras there are.
    Roster(Address),
    /// A camera was told who the references are.
    References(Address),
    /// A camera was given a command.
    Command(Address, CameraCommand),
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
    Remove(Address),
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
    /// It has to be asked who it is.
    who: Owed,
    /// It is a target that has to be told the roster.
    roster: Owed,
    /// It is a camera that has to be told who the references are.
    references: Owed,
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
    network: Option<Network>,
    references: Option<References>,
    /// The references are not written down yet.
    unsaved: bool,
    /// References were appointed in a former run.
    recalled: bool,
    /// The camera that saw a target first, and at which stop.
    trigger: Option<(Address, Address, StopNumber)>,
    outbox: Outbox<CoordinatorNotification, 8>,
    tasks: heapless::Deque<CoordinatorTask, 16>,
    /// To be opened.
    join_window: Option<Duration>,
    refresh: Option<usize>,
    /// When to ask everybody next who they are, and how often that was done: after a start, the
    /// members of the former run are known to the link only.
    roll_call: Option<(Instant, usize)>,
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
            unsaved: false,
            recalled: false,
            trigger: None,
            outbox: Outbox::new(),
            tasks: heapless::Deque::new(),
            join_window: None,
            refresh: None,
            roll_call: None,
        }
    }

    /// What cameras reported, with their addresses.
    pub fn reports(&self) -> impl Iterator<Item = (Address, &Report)> {
        self.members
            .iter()
            .filter_map(|member| Some((member.address, member.report.as_ref()?)))
    }

    /// Somebody sent something. A member that never said who it is, is asked.
    fn meet(&mut self, now: Instant, address: Address) {
        if let Some(member) = self.members.of(address)
            && member.more.hello.is_none()
            && member.more.who == Owed::Nothing
        {
            // It says so by itself when it has just joined.
            member.more.who = Owed::Due(now + super::RETRY, 0);
        }
    }

    /// The next fact to write down.
    fn unsaved(&mut self) -> Option<Fact> {
        if core::mem::take(&mut self.unsaved) {
            return Some(Fact::References(self.references));
        }
        self.members.unsaved()
    }

    /// Knows nothing of a member any more. If it was a reference camera, there are none.
    fn forget(&mut self, address: Address) {
        self.members.remove(address);
        let is_it = |references: &mut References| {
            let duty = references.duty_of(ShortAddress(address));
            duty.is_some()
        };
        if self.references.take_if(is_it).is_some() {
            self.unsaved = true;
            // Nobody is to be told any more: what stays due would keep the node awake.
            for member in self.members.iter_mut() {
                member.more.references = Owed::Nothing;
            }
        }
        self.trigger
            .take_if(|(camera, target, _)| [*camera, *target].contains(&address));
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

    fn hello(&mut self, now: Instant, address: Address, hello: Hello) {
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
        member.who = Owed::Nothing;
        let is_news = member.hello != Some(hello);
        member.hello = Some(hello);
        match hello.kind {
            MemberKind::Target => member.roster.tell(now),
            MemberKind::Camera { .. } if is_news => {
                let members = self.members.iter_mut().map(|member| &mut member.more);
                for target in members.filter(|member| member.is_target()) {
                    target.roster = Owed::Due(now + ROSTER_AFTER, 0);
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
            && (is_news && self.recalled || references.duty_of(ShortAddress(address)).is_some())
            && let Some(member) = self.members.get(address)
        {
            member.references.tell(now);
        }
    }

    /// The camera that is configured as this reference, and its position. Of several the one that
    /// was met last, which is there in place of the others.
    fn camera_with(&self, wanted: Duty) -> Option<(Address, Option<[f32; 2]>)> {
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
        self.unsaved = true;
        // Those that are none any more, too.
        for references in former.into_iter().chain([references]) {
            for camera in [references.first, references.second] {
                if let Some(member) = self.members.get(camera) {
                    member.references.tell(now);
                }
            }
        }
    }

    /// The first camera to see a target triggers; the next one that sees it at the same stop
    /// becomes its helper (thesis 2.3). Not where cameras know their poses, as they may from a former
    /// network: the target finds its place from them, and a second frame would begin here.
    fn trigger(&mut self, now: Instant, camera: Address, target: Address, stop: StopNumber) {
        let is_configured = [Duty::First, Duty::Second]
            .iter()
            .any(|&duty| self.camera_with(duty).is_some());
        if self.references.is_some() || is_configured || self.has_frame() {
            return;
        }
        match self.trigger {
            Some((first, of, at)) if (of, at) == (target, stop) => {
                if first != camera {
                    let references = References {
                        first,
                        second: camera,
                        positions: None,
                    };
                    self.appoint(now, references);
                }
            }
            _ => self.trigger = Some((camera, target, stop)),
        }
    }

    fn report(&mut self, address: Address, report: &Report) {
        if self.members.report(address, *report).is_none() {
            return;
        }
        self.tell_pc(ToPc::Report {
            address,
            report: *report,
        });
    }

    fn pc(&mut self, now: Instant, wish: FromPc) {
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

    fn next_roll_call(&self, now: Instant, count: usize) -> Option<(Instant, usize)> {
        if count > ROLL_CALLS.len() {
            return None;
        }
        let next = match ROLL_CALLS.get(count) {
            Some(&after) => now + after,
            None => Instant(u64::MAX),
        };
        Some((next, count + 1))
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

    fn roster(&self) -> heapless::Vec<Address, MEMBERS> {
        let mut roster = heapless::Vec::new();
        for camera in self.members.iter().filter(|member| member.more.is_camera()) {
            // As many as there are members.
            let _ = roster.push(camera.address);
        }
        roster
    }

    /// What is owed to members and due.
    fn debt(
        &mut self,
        now: Instant,
    ) -> Option<(ShortAddress, Message, Option<CoordinatorNotification>)> {
        if let Some((at, count)) = self.roll_call
            && at <= now
            && let Some(again) = self.next_roll_call(now, count)
        {
            self.roll_call = Some(again);
            return Some((ShortAddress::BROADCAST, Message::WhoIsThere, None));
        }
        let roster = self.roster();
        for member in self.members.iter_mut() {
            let address = member.address;
            let to = ShortAddress(address);
            let member = &mut member.more;
            if member.who.take(now) {
                return Some((
                    to,
                    Message::WhoIsThere,
                    Some(CoordinatorNotification::Who(address)),
                ));
            }
            if member.roster.take(now) {
                let notification = Some(CoordinatorNotification::Roster(address));
                return Some((to, Message::Roster(roster), notification));
            }
            if let Some(references) = self.references
                && member.references.take(now)
            {
                let notification = Some(CoordinatorNotification::References(address));
                return Some((to, Message::References(references), notification));
            }
        }
        None
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
                self.recalled = references.is_some();
            }
            Fact::Camera(slot, Some((address, report))) => {
                let _ = self.members.restore(*slot, *address, *report);
            }
            _ => {}
        }
    }

    fn on_attached(&mut self, now: Instant, network: Option<Membership>) {
        self.network = network.map(|network| Network {
            pan: network.pan.0,
            channel: network.channel.number(),
        });
        self.tell_pc(ToPc::Network(self.network));
        if network.is_some() && self.roll_call.is_none() {
            self.roll_call = Some((now, 0));
        }
    }

    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        let address = from.0;
        self.meet(now, address);
        match message {
            Message::Hello(hello) => self.hello(now, address, *hello),
            Message::Report(report) => self.report(address, report),
            Message::Trigger { target, stop } => self.trigger(now, address, *target, *stop),
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
            CoordinatorNotification::Who(address) => {
                if let Some(member) = self.members.get(address) {
                    // A member that cannot be reached says hello when it is back.
                    member.who.sent(now, true);
                }
            }
            CoordinatorNotification::Roster(address) => {
                if let Some(member) = self.members.get(address) {
                    member.roster.sent(now, delivered);
                }
            }
            CoordinatorNotification::References(address) => {
                if let Some(member) = self.members.get(address) {
                    member.references.sent(now, delivered);
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
            CoordinatorEvent::Pc(wish) => self.pc(now, wish),
            CoordinatorEvent::Button(Button::JoinWindow) => {
                self.join_window = Some(BUTTON_WINDOW);
            }
            CoordinatorEvent::Button(Button::LearnColour) => {}
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<CoordinatorNotification, CoordinatorTask>> {
        self.next_line();
        if let Some(fact) = self.unsaved() {
            return Some(Output::Save(fact));
        }
        if let Some(window) = self.join_window.take() {
            return Some(Output::Task(CoordinatorTask::OpenJoinWindow(window)));
        }
        if let Some(task) = self.tasks.pop_front() {
            return Some(Output::Task(task));
        }
        self.network?;
        if let Some((to, message, notification)) = self.outbox.pop(now) {
            return Some(Output::Send {
                to,
                message,
                notification,
            });
        }
        let (to, message, notification) = self.debt(now)?;
        Some(Output::Send {
            to,
            message,
            notification,
        })
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.network?;
        let roll_call = self
            .roll_call
            .map(|(at, _)| at)
            .filter(|at| *at < Instant(u64::MAX));
        let mut next = Earliest::new(roll_call);
        next.or(self.outbox.deadline());
        for member in self.members.iter() {
            let known = &member.more;
            for owed in [&known.who, &known.roster, &known.references] {
                next.or(owed.deadline());
            }
        }
        next.get()
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
