//! An onlooker's view of a simulation while it runs, and commands to it.

use nalgebra::Point2;
use node_firmware::{
    console::FromPc,
    message::{CameraCommand, CommandOutcome, MemberAddress},
};
use results::record::{
    RunRecord,
    event::{CommandState, Event, Looker, ObjectPlace, What},
};
use site::{Action, ScriptedEvent};
use virtual_hardware::executor::Time;

use results::view::command_name;

use super::{
    Simulation, events,
    journal::Moment,
    outcome::{frame, record},
};

/// An onlooker: makes events of everything that is new since the last look.
#[derive(Default)]
pub struct Onlooker {
    looker: Looker,
    /// Number of changes in the journal at the last look.
    changes: Option<u64>,
    /// Places of targets at the last look.
    places: Vec<Point2<f64>>,
}

/// Distance after which a target's new place is told, in metres.
const PLACES: f64 = 0.05;

impl Onlooker {
    /// Events since the last look.
    pub fn look(&mut self, simulation: &Simulation) -> Vec<Event> {
        let mut events = self.places(simulation);
        let moments = simulation.moments();
        let changes = Some(simulation.journal.borrow().changes);
        if self.changes == changes {
            return events;
        }
        self.changes = changes;
        let with_sightings = self.looker.uses_sightings(simulation.seconds());
        let record = record(simulation, 0.0, with_sightings);
        let mut all = self.looker.look(&RunRecord {
            wall_seconds: None,
            ..record
        });
        // The stream begins with the record.
        all.extend(moments);
        all.append(&mut events);
        all
    }

    /// Events since the last look, and the end.
    pub fn end(
        &mut self,
        simulation: &Simulation,
        record: &RunRecord,
        why: Option<&str>,
    ) -> Vec<Event> {
        let mut events = Vec::new();
        if self.changes.is_none() {
            events.extend(self.looker.look(record));
        }
        events.extend(simulation.moments());
        events.extend(self.looker.end(record, why));
        events
    }

    fn places(&mut self, simulation: &Simulation) -> Vec<Event> {
        let world = simulation.world.borrow();
        let least = PLACES / simulation.scenario.metres_per_unit();
        let mut events = Vec::new();
        let networks = simulation.site.networks.iter().zip(&simulation.consoles);
        for (network, console) in networks {
            for target in &network.targets {
                let is = world.targets()[target.index].place;
                if self.places.len() <= target.index {
                    let unknown = Point2::new(f64::INFINITY, f64::INFINITY);
                    self.places.resize(target.index + 1, unknown);
                }
                let was = &mut self.places[target.index];
                if self.changes.is_some() && (is - *was).norm() >= least {
                    *was = is;
                    let place = frame(simulation, network, console).place(is);
                    let what = What::Place {
                        target: target.id,
                        x: place.x,
                        y: place.y,
                    };
                    events.push(Event::new(simulation.seconds(), what));
                }
            }
        }
        events
    }
}

impl Simulation {
    /// The record so far, compared with the truth.
    pub fn record(&self) -> RunRecord {
        RunRecord {
            wall_seconds: None,
            ..record(self, 0.0, true)
        }
    }

    /// Makes coordinators take [orders](Self::order) from now on. Nothing has run yet.
    pub fn take_orders(&self) {
        for console in &self.consoles {
            console.take_orders();
        }
    }

    /// Tells a camera something by way of its coordinator, as a PC on the coordinator's line would.
    /// Returns true if it is a member of a network.
    pub fn order(&self, node: u16, command: CameraCommand) -> bool {
        self.send(node, |address| FromPc::Command { address, command })
    }

    /// Sends a member away. Returns true if it was a member.
    pub fn remove(&self, node: u16) -> bool {
        self.send(node, FromPc::Remove)
    }

    /// Lets new nodes join every network for so many seconds.
    pub fn let_join(&self, seconds: u16) {
        for console in &self.consoles {
            console.order(&FromPc::JoinWindow(seconds));
        }
    }

    /// The number of the network of this coordinator, from 1.
    fn network_of(&self, coordinator: u16) -> Option<u16> {
        let mut consoles = (1..).zip(&self.consoles);
        let (number, _) = consoles.find(|(_, console)| console.id() == coordinator)?;
        Some(number)
    }

    fn send(&self, node: u16, message: impl Fn(MemberAddress) -> FromPc) -> bool {
        self.consoles.iter().any(|console| {
            let address = console.view().addresses(node).last().copied();
            if let Some(address) = address {
                console.order(&message(address));
            }
            address.is_some()
        })
    }

    /// Keeps moments for an onlooker from now on.
    pub fn watch(&self) {
        let mut journal = self.journal.borrow_mut();
        journal.moments.get_or_insert_default();
    }

    /// Does something to the network now, as a scenario can; frames that were sent before are not heard
    /// again.
    pub fn act(&mut self, action: Action) {
        let now = ScriptedEvent {
            at_s: self.seconds(),
            action,
        };
        let planned = std::mem::replace(&mut self.scenario.events, vec![now]);
        events::schedule(self);
        self.scenario.events = planned;
    }

    /// Sets the pace of time from now on: `pace` is called with the next moment and may wait.
    pub fn set_pace(&mut self, pace: impl FnMut(Time) + 'static) {
        self.executor.set_pace(pace);
    }

    /// Everything that happened since the last call, except records.
    fn moments(&self) -> Vec<Event> {
        let mut journal = self.journal.borrow_mut();
        let moments = journal.moments.as_mut().map(std::mem::take);
        drop(journal);
        let events = { moments.unwrap_or_default().into_iter() }
            .filter_map(|(at, node, moment)| self.event(at, node, moment));
        events.collect()
    }

    fn event(&self, at: Time, node: u16, moment: Moment) -> Option<Event> {
        let what = match moment {
            Moment::Seen(address, seen) => {
                let mut networks = self.site.networks.iter().zip(&self.consoles);
                let (_, console) =
                    networks.find(|(network, _)| network.cameras.iter().any(|c| c.id == node))?;
                What::Seen {
                    node,
                    target: console.view().id_of(address)?,
                    stop: None,
                    bearing_deg: f64::from(seen.bearing).to_degrees(),
                    sigma_deg: f64::from(seen.sigma).to_degrees(),
                }
            }
            Moment::Tracked(tracked) => What::tracked(node, &tracked),
            Moment::Object(object, is) => What::Object {
                network: self.network_of(node)?,
                object,
                is: is.as_ref().map(ObjectPlace::from),
            },
            Moment::Truth(object, place) => What::Truth {
                network: self.network_of(node)?,
                object,
                x: place.x,
                y: place.y,
            },
            Moment::Done(command, outcome) => What::Command {
                node: Some(node),
                command: command_name(command),
                state: match outcome.is_success() {
                    true => CommandState::Done,
                    false => CommandState::Failed,
                },
                words: match outcome {
                    CommandOutcome::Done | CommandOutcome::Failed => String::new(),
                    told => told.to_string(),
                },
            },
            Moment::StopEnds => What::StopEnds { target: node },
            Moment::Said(words) => What::Said {
                node: Some(node),
                words,
            },
            Moment::Befalls(words) => What::Said { node: None, words },
        };
        Some(Event::new(at as f64 * 1e-9, what))
    }
}
