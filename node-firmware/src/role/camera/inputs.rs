//! A camera as a [`Role`]: what comes in, what goes out.

use calib_core::Status;
use zigbee_link::{Instant, store::Membership, wire::ShortAddress};

use super::{Camera, Errand, Event, KnownTarget, Task, facts::COLOURS, stops::LOOK_WITHIN};
use crate::{
    hardware::{Button, Indication},
    memory::Fact,
    message::{Command, Done, Duty, Message, PoseParts, Sight, State},
    role::{COORDINATOR, Earliest, Output, Role},
};

impl Role for Camera {
    type Errand = Errand;
    type Task = Task;
    type Event = Event;

    fn remember(&mut self, fact: &Fact) {
        self.recall(fact);
    }

    fn attached(&mut self, now: Instant, network: Option<Membership>) {
        let own = network.map(|network| network.short);
        let before = core::mem::replace(&mut self.address, own);
        let Some(network) = network else {
            return;
        };
        if self.home.enter(before.is_some(), &network) {
            self.forget_network();
        }
        self.hello.tell(now);
        if self.report.state != State::Waiting {
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

    fn message(&mut self, now: Instant, from: ShortAddress, message: &Message) {
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
                if self.report.state != State::Waiting {
                    self.to_coordinator.tell(due);
                }
            }
            Message::Command(command) if is_coordinator => match command {
                Command::Forget => {
                    self.forget(now);
                    let done = Done {
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

    fn sent(&mut self, now: Instant, errand: Errand, delivered: bool) {
        match errand {
            Errand::Hello => self.hello.sent(now, delivered),
            Errand::ReportToCoordinator => self.to_coordinator.sent(now, delivered),
            Errand::ReportTo(target) => {
                let known = |known: &&mut KnownTarget| known.address == target;
                if let Some(target) = self.to_targets.iter_mut().find(known) {
                    // A target that is away is told when it is heard again.
                    target.report.sent(now, true);
                    target.missed_report = !delivered;
                }
            }
            Errand::Posed => self.posed.0.sent(now, delivered),
            Errand::Located => self.located.0.sent(now, delivered),
            Errand::Bearing(target, stop) => {
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

    fn event(&mut self, now: Instant, event: Event) {
        match event {
            Event::Looked(sight, seen) => {
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
            Event::Done(done) => {
                self.busy &= matches!(done.command, Command::Track { .. });
                self.outbox
                    .push(now, COORDINATOR, Message::Done(done), None);
            }
            Event::Tracked(tracked) => {
                self.outbox
                    .push(now, COORDINATOR, Message::Tracked(tracked), None);
            }
            Event::Learnt(colour, window) => {
                if let Some(learnt) = self.colours.learnt.get_mut(usize::from(colour))
                    && *learnt != Some(window)
                {
                    *learnt = Some(window);
                    self.unsaved.add(COLOURS);
                }
            }
            Event::Button(Button::LearnColour) => {
                self.command(now, Command::LearnColour { colour: 0 });
            }
            Event::Button(Button::JoinWindow) => {}
            Event::Ready => self.ready = true,
        }
    }

    fn compute(&mut self, now: Instant) {
        if core::mem::take(&mut self.to_solve) {
            self.solve_reference(now);
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<Errand, Task>> {
        if let Some(fact) = self.unsaved() {
            return Some(Output::Save(fact));
        }
        if core::mem::take(&mut self.recalled) {
            return Some(Output::Task(Task::Recall(self.colours.learnt)));
        }
        if !self.busy {
            if let Some(command) = self.command.take() {
                // Tracking goes on until the next task.
                self.busy = !matches!(command, Command::Track { .. });
                return Some(Output::Task(Task::Command(command)));
            }
            if let Some(asked) = self.next.take() {
                self.busy = true;
                self.looking = Some(asked);
                let colour = asked.stopped.colour;
                return Some(Output::Task(Task::Look { colour }));
            }
        }
        self.address?;
        if let Some((to, message, errand)) = self.outbox.pop(now) {
            return Some(Output::Send {
                to,
                message,
                errand,
            });
        }
        if let Some((to, message, errand)) = self.debt(now) {
            let errand = Some(errand);
            return Some(Output::Send {
                to,
                message,
                errand,
            });
        }
        self.list().map(|message| Output::Send {
            to: COORDINATOR,
            message,
            errand: None,
        })
    }

    fn deadline(&self) -> Option<Instant> {
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
