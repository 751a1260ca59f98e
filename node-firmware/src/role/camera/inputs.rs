//! A camera as a [`Role`]: what comes in, what goes out.

use zigbee_link::{Instant, store::Membership, wire::ShortAddress};

use super::{Camera, Errand, Event, KnownTarget, LOOK_WITHIN, Task};
use crate::{
    config::Duty,
    hardware::{Button, Indication},
    memory::Fact,
    message::{Command, Done, Message, Report, Sight, State},
    role::{COORDINATOR, Output, Owed, Role},
};

impl Role for Camera {
    type Errand = Errand;
    type Task = Task;
    type Event = Event;

    fn remember(&mut self, fact: &Fact) {
        match fact {
            Fact::Report(Some(report)) => {
                self.report = Report {
                    id: self.id,
                    ..*report
                };
                self.told = self.report;
            }
            Fact::References(references) => self.references = *references,
            Fact::Sighting(_, Some(sighting)) => {
                let _ = self.calibration.add(*sighting);
            }
            Fact::Posed(second) => self.posed.1 = *second,
            Fact::ReferenceStop(index, Some(stop)) if self.pose().is_none() => {
                self.stops.restore(usize::from(*index), *stop);
            }
            _ => {}
        }
    }

    fn attached(&mut self, now: Instant, network: Option<Membership>) {
        self.address = network.map(|network| network.short);
        if network.is_some() {
            self.hello.tell(now);
            if self.report.state != State::Waiting {
                self.to_coordinator.tell(now);
            }
            if self.duty() == Some(Duty::Second) && self.pose().is_none() {
                // Nobody knows which ones were delivered before a restart.
                self.owe_bearings(now);
            }
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
            Message::Posed(pose)
                if self.duty() == Some(Duty::Second)
                    && self.references.is_some_and(|r| r.first == from.0)
                    && pose.pose().is_some() =>
            {
                if self.report.duty == Some(Duty::Second) && self.pose() == Some(*pose) {
                    // Told twice: the stops that made it are not here any more to be counted.
                    return;
                }
                let stops = self.stops.iter().filter(|stop| stop.own.is_some()).count();
                self.bearings.clear();
                self.posed_as(now, Duty::Second, *pose, stops as u8, 0.0);
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
                other => {
                    if let Some(command) = self.command.replace(*other) {
                        let done = Done {
                            command,
                            success: false,
                        };
                        self.outbox
                            .push(now, COORDINATOR, Message::Done(done), None);
                    }
                }
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
            Event::Button(Button::LearnColour) => {
                self.command = Some(Command::LearnColour { colour: 0 });
            }
            Event::Button(Button::JoinWindow) => {}
            Event::Ready => self.ready = true,
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Output<Errand, Task>> {
        if let Some(fact) = self.saves.pop_front().or_else(|| self.erase()) {
            return Some(Output::Save(fact));
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
        let targets = self.to_targets.iter().filter_map(|t| t.report.deadline());
        let bearings = self.bearings.iter().filter_map(|(_, _, o)| o.deadline());
        let [hello, report] = [&self.hello, &self.to_coordinator];
        [hello, report, &self.posed.0, &self.located.0]
            .into_iter()
            .filter_map(Owed::deadline)
            .chain(self.outbox.deadline())
            .chain(targets)
            .chain(bearings)
            .min()
    }

    fn indication(&self) -> Indication {
        Indication {
            joined: self.address.is_some(),
            target_seen: self.target_seen,
            calibrated: self.pose().is_some(),
            may_walk: false,
        }
    }
}
