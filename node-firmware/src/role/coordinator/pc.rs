//! Requests of the PC on the coordinator's line, and answers to it.

use core::time::Duration;

use zigbee_link::{Instant, wire::ShortAddress};

use super::{CoordinatorNotification, CoordinatorRole, CoordinatorTask};
use crate::{
    config::SiteKey,
    console::{FromPc, ToPc},
    message::{MemberAddress, Message},
    role::{COORDINATOR, Role},
};

/// Tasks of the surroundings, most of them for the PC.
#[derive(Clone, Debug)]
pub(super) struct Tasks {
    queue: heapless::Deque<CoordinatorTask, 16>,
    /// To be opened.
    join_window: Option<Duration>,
    /// The PC asked for everything: the next line of the table of members.
    refresh: Option<usize>,
}

impl Tasks {
    pub(super) const fn new() -> Self {
        Self {
            queue: heapless::Deque::new(),
            join_window: None,
            refresh: None,
        }
    }

    /// If it is full, the PC misses something until it asks for everything again.
    pub(super) fn tell(&mut self, message: ToPc) {
        let _ = self.queue.push_back(CoordinatorTask::Tell(message));
    }

    /// If it is full, the PC asks again.
    pub(super) fn tell_network(&mut self) {
        let _ = self.queue.push_back(CoordinatorTask::TellNetwork);
    }

    pub(super) const fn open_join_window(&mut self, time: Duration) {
        self.join_window = Some(time);
    }

    /// Returns true if it is done. If it is full, the PC hears nothing of it, and asks again.
    fn remove(&mut self, address: MemberAddress) -> bool {
        let removed = self.queue.push_back(CoordinatorTask::Remove(address));
        removed.is_ok()
    }

    /// If it is full, the PC hears nothing of it, and asks again.
    fn change_key(&mut self, key: SiteKey) {
        let _ = self.queue.push_back(CoordinatorTask::ChangeKey(key));
    }

    /// The next task.
    pub(super) fn take(&mut self) -> Option<CoordinatorTask> {
        if let Some(window) = self.join_window.take() {
            return Some(CoordinatorTask::OpenJoinWindow(window));
        }
        self.queue.pop_front()
    }
}

impl CoordinatorRole {
    pub(super) fn on_pc(&mut self, now: Instant, wish: FromPc) {
        match wish {
            FromPc::Refresh => {
                self.tasks.refresh = Some(0);
                self.stopped = None;
                self.tasks.tell_network();
                let _ = self.tasks.queue.push_back(CoordinatorTask::TellKeyChange);
                let _ = self.tasks.queue.push_back(CoordinatorTask::TellConflict);
                self.tell_own_health();
                if self.appointment.references().is_some() {
                    self.tell_elected();
                }
            }
            FromPc::JoinWindow(seconds) => {
                let time = Duration::from_secs(seconds.into());
                self.tasks.open_join_window(time);
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
                // If it is full, they are asked for again: none came.
                let to = ShortAddress(address);
                let _ = self.outbox.push(now, to, Message::Sightings, None);
            }
            FromPc::Remove(address) => {
                if self.tasks.remove(address) {
                    self.forget(now, address);
                }
            }
            FromPc::ChangeKey(key) => self.tasks.change_key(key),
            // If it is full, the PC hears nothing of it, and asks again.
            FromPc::ChangePan => drop(self.tasks.queue.push_back(CoordinatorTask::ChangePan)),
            FromPc::Located { address, located } => {
                // If it is full, the PC does not hear of the stop, and tells it again.
                let to = ShortAddress(address);
                let _ = (self.outbox).push(now, to, Message::Located(located), None);
            }
            FromPc::Update { to, packet } => {
                let (to, notification) = (ShortAddress(to), CoordinatorNotification::Update);
                // What is for the coordinator alone its line has taken.
                let is_for_others = to != COORDINATOR;
                let message = Message::Update(packet);
                if !is_for_others || !self.outbox.push(now, to, message, Some(notification)) {
                    self.on_sent(now, notification, false);
                }
            }
        }
    }

    /// The next line of the table for the PC, when it asked for everything.
    pub(super) fn next_line(&mut self) {
        let Some(line) = self.tasks.refresh else {
            return;
        };
        if !self.tasks.queue.is_empty() {
            return;
        }
        let Some(member) = self.members.iter().nth(line) else {
            self.tasks.refresh = None;
            return;
        };
        let (address, report, hello) = (member.address, member.report, member.more.hello);
        let health = member.more.health;
        self.tasks.refresh = Some(line + 1);
        if let Some(hello) = hello {
            self.tasks.tell(ToPc::Member { address, hello });
        }
        if let Some(report) = report {
            self.tasks.tell(ToPc::Report { address, report });
        }
        self.tasks.tell(ToPc::Health { address, health });
    }

    pub(super) fn tell_own_health(&mut self) {
        let (address, health) = (COORDINATOR.0, self.health);
        self.tasks.tell(ToPc::Health { address, health });
    }
}
