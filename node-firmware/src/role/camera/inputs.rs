//! A camera as a [`Role`]: what comes in, what goes out.

use calib_core::Status;
use zigbee_link::{Instant, store::Membership, wire::ShortAddress};

use super::{
    CameraEvent, CameraNotification, CameraRole, CameraTask, KnownTarget, facts::COLOURS,
    stops::LOOK_WITHIN,
};
use crate::{
    hardware::{Button, Indication},
    memory::Fact,
    message::{CameraCommand, CameraState, CommandResult, Duty, Message, PoseParts, Sight},
    role::{COORDINATOR, Earliest, Output, Role},
};

impl Role for CameraRole {
    type Notification = CameraNotification;
    type Task = CameraTask;
    type Event = CameraEvent;

    fn restore(&mut self, fact: &Fact) {
        self.recall(fact);
    }

    fn on_attached(&mut self, now: Instant, network: Option<Membership>) {
        let own = network.map(|network| network.short);
        let before = core::mem::replace(&mut self.address, own);
        let Some(network) = network else {
            return;
        };
        if self.home.enter(before.is_some(), &network) {
            self.forget_network();
        }
        self.hello.tell(now);
        if self.report.state != CameraState::Waiting {
            self.to_coordinator.tell(now);
        }
        match self.duty() {
            // Nobody knows which ones were delivered before a restart.
            Some(Duty::Second) if self.pose().is_none() => self.owe_bearings(now),
            // Or whether the last ones written down were solved.
            Some(Duty::First) => self.to_solve = true,
            _ => {}
        }
    }

    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
        let is_coordinator = from == COORDINATOR;
        match message {
            Message::Stopped(stopped) => self.stopped(now, from.0, stopped),
            Message::References(references) if is_coordinator => self.references(now, *references),
            Message::Bearing(bearing) if self.references.is_some_and(|r| r.second == from.0) => {
                self.bearing(now, bearing);
            }
            Message::Posed(solved)
                if self.duty() == Some(Duty::Second)
                    && self.references.is_some_and(|r| r.first == from.0)
                    && solved.is_usable()
                    && solved.pose().is_some_and(PoseParts::is_usable) =>
            {
                self.bearings.clear();
                self.posed_as(now, Duty::Second, solved);
            }
            Message::WhoIsThere if is_coordinator => {
                let due = now + self.slot();
                self.hello.tell(due);
                if self.report.state != CameraState::Waiting {
                    self.to_coordinator.tell(due);
                }
            }
            Message::Command(command) if is_coordinator => match command {
                CameraCommand::Forget => {
                    self.forget(now);
                    let done = CommandResult {
                        command: *command,
                        success: true,
                    };
                    self.outbox
                        .push(now, COORDINATOR, Message::Done(done), None);
                }
                other => self.command(now, *other),
            },
            Message::Sightings if is_coordinator => self.listing = Some(0),
            _ => {}
        }
    }

    fn on_sent(&mut self, now: Instant, notification: CameraNotification, delivered: bool) {
        match notification {
            CameraNotification::Hello => self.hello.sent(now, delivered),
            CameraNotification::ReportToCoordinator => self.to_coordinator.sent(now, delivered),
            CameraNotification::ReportTo(target) => {
                let known = |known: &&mut KnownTarget| known.address == target;
                if let Some(target) = self.to_targets.iter_mut().find(known) {
                    // A target that is away is told when it is heard again.
                    target.report.sent(now, true);
                    target.missed_report = !delivered;
                }
            }
            CameraNotification::Posed => self.posed.0.sent(now, delivered),
            CameraNotification::Located => self.located.0.sent(now, delivered),
            CameraNotification::Bearing(target, stop) => {
                for (_, _, owed) in self
                    .bearings
                    .iter_mut()
                    .filter(|(t, s, _)| (*t, *s) == (target, stop))
                {
                    owed.sent(now, delivered);
                }
                if delivered {
                    self.bearings.retain(|(t, s, _)| (*t, *s) != (target, stop));
                }
            }
        }
    }

    fn on_event(&mut self, now: Instant, event: CameraEvent) {
        match event {
            CameraEvent::Looked(sight, seen) => {
                self.busy = false;
                match self.looking.take() {
                    // The target may have left meanwhile.
                    Some(asked) if now > asked.heard + LOOK_WITHIN => {
                        let stop = asked.stopped.stop;
                        self.answer(now, asked.target, stop, Sight::NotReady);
                    }
                    Some(asked) => self.looked(now, asked, sight, seen),
                    None => {}
                }
            }
            CameraEvent::Done(done) => {
                self.busy &= matches!(done.command, CameraCommand::Track { .. });
                self.outbox
                    .push(now, COORDINATOR, Message::Done(done), None);
            }
            CameraEvent::Tracked(tracked) => {
                self.outbox
                    .push(now, COORDINATOR, Message::Tracked(tracked), None);
            }
            CameraEvent::Learnt(colour, window) => {
                if let Some(learnt) = self.colours.learnt.get_mut(usize::from(colour))
                    && *learnt != Some(window)
                {
                    *learnt = Some(window);
                    self.unsaved.add(COLOURS);
                }
            }
            CameraEvent::Button(Button::LearnColour) => {
                self.command(now, CameraCommand::LearnColour { colour: 0 });
            }
            CameraEvent::Button(Button::JoinWindow) => {}
            CameraEvent::Ready => self.ready = true,
        }
    }

    fn compute(&mut self, now: Instant) {
        if core::mem::take(&mut self.to_solve) {
            self.solve_reference(now);
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<CameraNotification, CameraTask>> {
        if let Some(fact) = self.unsaved() {
            return Some(Output::Save(fact));
        }
        if core::mem::take(&mut self.recalled) {
            return Some(Output::Task(CameraTask::Recall(self.colours.learnt)));
        }
        if !self.busy {
            if let Some(command) = self.command.take() {
                // Tracking goes on until the next task.
                self.busy = !matches!(command, CameraCommand::Track { .. });
                return Some(Output::Task(CameraTask::Command(command)));
            }
            if let Some(asked) = self.next.take() {
                self.busy = true;
                self.looking = Some(asked);
                let colour = asked.stopped.colour;
                return Some(Output::Task(CameraTask::Look { colour }));
            }
        }
        self.address?;
        if let Some((to, message, notification)) = self.outbox.pop(now) {
            return Some(Output::Send {
                to,
                message,
                notification,
            });
        }
        if let Some((to, message, notification)) = self.debt(now) {
            let notification = Some(notification);
            return Some(Output::Send {
                to,
                message,
                notification,
            });
        }
        self.list().map(|message| Output::Send {
            to: COORDINATOR,
            message,
            notification: None,
        })
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.address?;
        let mut next = Earliest::new(self.outbox.deadline());
        let single = [
            &self.hello,
            &self.to_coordinator,
            &self.posed.0,
            &self.located.0,
        ];
        for owed in single {
            next.or(owed.deadline());
        }
        for target in &self.to_targets {
            next.or(target.report.deadline());
        }
        for (_, _, owed) in &self.bearings {
            next.or(owed.deadline());
        }
        next.get()
    }

    fn indication(&self) -> Indication {
        Indication {
            joined: self.address.is_some(),
            target_seen: self.target_seen,
            calibrated: self.report.status() == Status::Calibrated,
            may_walk: false,
        }
    }
}
