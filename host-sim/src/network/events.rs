//! Events that the scenario orders: faults and disturbances.

use std::{cell::RefCell, collections::BTreeSet, ops::Range, rc::Rc};

use cmucam2_emulator::FaultRates;
use node_firmware::hardware::Button;
use rand::RngExt;
use zigbee_link::{radio::Channel, wire::fcs};

use super::{
    Simulation,
    attack::{self, Attacker},
    node::Node,
};
use site::{Action, ScriptedEvent};
use virtual_hardware::{
    executor::{Clock, Time},
    medium::{Disturbance, Event, Kind, Medium, NodeId},
    random::Root,
};

/// A frame that was on the air.
#[derive(Clone)]
struct Heard {
    at: Time,
    from: NodeId,
    channel: Channel,
    psdu: Vec<u8>,
}

/// Frames of the nodes that some event replays, in their order.
type Tape = Rc<RefCell<Vec<Heard>>>;

/// Plans all events of the scenario: the effect of each, and its words.
pub(super) fn schedule(simulation: &mut Simulation) {
    let root = Root(simulation.scenario.seed);
    let tape = record(simulation);
    let ears = attack::listen(simulation);
    let events = simulation.scenario.events.clone();
    for (number, ScriptedEvent { at_s, action }) in (0..).zip(events) {
        let at = nanoseconds(at_s);
        let for_s = action.duration_s().unwrap_or_default();
        let during = at..at.saturating_add(nanoseconds(for_s));
        let clock = simulation.executor.clock();
        let nodes = action.nodes().iter();
        let nodes: Vec<_> = nodes.filter_map(|&id| find(simulation, id)).collect();
        let plan = Plan {
            simulation,
            node: nodes.first().cloned(),
            during: during.clone(),
        };
        match action {
            Action::Restart { .. } => plan.once("is restarted", Node::restart),
            Action::PowerCut { in_flash_write, .. } => {
                let share =
                    in_flash_write.then(|| root.stream("power cut", number).random_range(0.0..1.0));
                plan.spawn(|node| power_cut(clock, at, node, nanoseconds(for_s), share));
            }
            Action::Jam {
                channel,
                at: place,
                reach,
                ..
            } => {
                if simulation.chips.is_some() {
                    let told = jam(clock, during.clone(), simulation.nodes.clone());
                    simulation.executor.spawn(told);
                }
                let channel = channel.and_then(Channel::new);
                let disk = place.zip(reach);
                let which = channel.map_or("all channels are".into(), |channel| {
                    format!("channel {} is", channel.number())
                });
                let kind = Kind::Jammer { channel, disk };
                disturb(
                    simulation,
                    during,
                    kind,
                    ["jammed", "jammed no more"].map(|how| format!("{which} {how}")),
                );
            }
            Action::Partition { .. } => {
                let apart: BTreeSet<_> = nodes.iter().map(|node| node.antenna).collect();
                let words = [
                    "some nodes and all others do not hear one another",
                    "all nodes can hear one another again",
                ];
                disturb(
                    simulation,
                    during,
                    Kind::Partition(apart),
                    words.map(Into::into),
                );
            }
            Action::Loss { share, .. } => {
                let words = [
                    format!("the radio loses {:.0} % more of the frames", 100.0 * share),
                    "the radio loses no more than usual".into(),
                ];
                disturb(simulation, during, Kind::Loss(share), words);
            }
            Action::UnplugCamera { with_power, .. } => plan.during(
                ["has its camera unplugged", "has its camera back"],
                move |node, begins| match begins {
                    true => node.unplug(with_power),
                    false => node.plug(),
                },
            ),
            Action::UnplugSensor { .. } => plan.during(
                ["has its step sensor unplugged", "has its step sensor back"],
                Node::unplug_sensor,
            ),
            Action::StickCamera { .. } => plan.during(
                ["has a camera that sticks", "has a camera that sees again"],
                Node::stick_camera,
            ),
            Action::Daylight { level, kelvin } => {
                let light = simulation.light.clone();
                let journal = simulation.journal.clone();
                let changes = async move {
                    clock.sleep_until_time(at).await;
                    let words = format!("the light is {level} times as bright, of {kelvin} kelvin");
                    journal.borrow_mut().befalls(&words);
                    light.set(cmucam2_emulator::daylight(level, kelvin));
                };
                simulation.executor.spawn(changes);
            }
            Action::CameraFaults { faults, .. } => {
                let mut rates = FaultRates::default();
                for (fault, rate) in faults {
                    // They were checked when the file was read.
                    let _ = rates.set(&fault, rate);
                }
                plan.during(
                    ["has a camera with other faults", "has its usual camera"],
                    move |node, begins| node.camera_faults(begins.then_some(rates)),
                );
            }
            Action::BumpCamera { by, turn_deg, .. } => {
                plan.once("has its camera moved", move |node| {
                    node.bump_camera(by.into(), turn_deg.to_radians());
                });
            }
            Action::Slip {
                distance,
                heading_deg,
                ..
            } => {
                let error = [distance, heading_deg.to_radians()];
                plan.during(["slips", "slips no more"], move |node, begins| {
                    node.slip(error, begins);
                });
            }
            Action::Rest { .. } => plan.during(
                ["has a carrier who rests", "has a carrier who goes on"],
                Node::rest,
            ),
            Action::IgnoreLamp { stand_s, .. } => plan.during(
                [
                    "has a carrier who does not heed the lamp",
                    "has a carrier who heeds the lamp again",
                ],
                move |node, begins| node.hurry(nanoseconds(stand_s), begins),
            ),
            Action::PressButton { button, .. } => {
                let words = match button {
                    Button::JoinWindow => "has its button pressed that lets devices join",
                    Button::LearnColour => "has its button pressed that has it learn a colour",
                };
                plan.once(words, move |node| node.press(button));
            }
            Action::Rot { bits, .. } => {
                let random = root.stream("rot", number);
                plan.once("has bits of its flash flip", move |node| {
                    node.rot(bits, random);
                });
            }
            Action::WearOut { .. } => {
                plan.once("has a flash that is worn", |node| node.wear_out());
            }
            Action::Replay { last_s, .. } => {
                let simulation = &*plan.simulation;
                let sender = (simulation.medium.clone(), simulation.attacker.clone());
                let tape = tape.clone();
                plan.spawn(|node| replay(clock, at, nanoseconds(last_s), node, sender, tape));
            }
            Action::Forge {
                frames, every_s, ..
            } => {
                if let Some(ears) = &ears {
                    let random = root.stream("forgery", number);
                    let every = nanoseconds(every_s);
                    let words = ["an attacker sends frames", "the attacker is silent"];
                    tell(simulation, during.clone(), words.map(Into::into));
                    let forge = attack::forge(clock, during, every, frames, ears.clone(), random);
                    simulation.executor.spawn(forge);
                }
            }
        }
    }
}

/// Disturbs the radio for a while.
fn disturb(simulation: &mut Simulation, during: Range<Time>, kind: Kind, words: [String; 2]) {
    tell(simulation, during.clone(), words);
    simulation.medium.disturb(Disturbance { during, kind });
}

/// Notes the begin and the end of something that befalls the whole site.
fn tell(simulation: &mut Simulation, during: Range<Time>, words: [String; 2]) {
    let (clock, journal) = (simulation.executor.clock(), simulation.journal.clone());
    simulation.executor.spawn(async move {
        for (at, words) in [during.start, during.end].into_iter().zip(words) {
            clock.sleep_until_time(at).await;
            journal.borrow_mut().befalls(&words);
        }
    });
}

/// An event that befalls a node, if the simulation has that.
struct Plan<'a> {
    simulation: &'a mut Simulation,
    node: Option<Rc<Node>>,
    during: Range<Time>,
}

impl Plan<'_> {
    fn spawn<F: Future<Output = ()> + 'static>(self, event: impl FnOnce(Rc<Node>) -> F) {
        if let Some(node) = self.node {
            self.simulation.executor.spawn(event(node));
        }
    }

    /// Something that is done to the node once.
    fn once(self, words: &'static str, act: impl FnOnce(&Rc<Node>) + 'static) {
        let clock = self.simulation.executor.clock();
        let at = self.during.start;
        self.spawn(|node| async move {
            clock.sleep_until_time(at).await;
            node.note(words);
            act(&node);
        });
    }

    /// Something that begins and ends: `act` is told which of both.
    fn during(self, words: [&'static str; 2], act: impl Fn(&Node, bool) + 'static) {
        let clock = self.simulation.executor.clock();
        let Range { start, end } = self.during;
        self.spawn(|node| async move {
            for ((at, begins), words) in [(start, true), (end, false)].into_iter().zip(words) {
                clock.sleep_until_time(at).await;
                node.note(words);
                act(&node, begins);
            }
        });
    }
}

pub(super) fn nanoseconds(seconds: f64) -> Time {
    (seconds * 1e9) as Time
}

/// The node of this number; 0 is the first network's coordinator.
pub(super) fn find(simulation: &Simulation, id: u16) -> Option<Rc<Node>> {
    let id = match id {
        0 => site::coordinator_id(0),
        id => id,
    };
    simulation.node(id).cloned()
}

/// `share`: share of its next flash operation that is done before, if the cut is to be in one.
async fn power_cut(clock: Clock, at: Time, node: Rc<Node>, lasts: Time, share: Option<f64>) {
    clock.sleep_until_time(at).await;
    if let Some(share) = share {
        let takes = node.next_write().await;
        clock.sleep((takes as f64 * share) as Time).await;
        node.note("loses its power in the middle of a write");
    } else {
        node.note("loses its power");
    }
    node.lose_power();
    clock.sleep(lasts).await;
    node.note("gets its power back");
    node.regain_power();
}

/// Nodes may move meanwhile, and get power: emulated chips are told so often which channels are jammed.
const JAM_TOLD: Time = 100_000_000;

async fn jam(clock: Clock, during: Range<Time>, nodes: Vec<Rc<Node>>) {
    let mut at = during.start;
    while at < during.end {
        clock.sleep_until_time(at).await;
        at = during.end.min(at + JAM_TOLD);
        for node in &nodes {
            node.hears_jam(at);
        }
    }
}

/// Keeps the frames that will be replayed, as nodes send them.
fn record(simulation: &Simulation) -> Tape {
    let tape = Tape::default();
    let replayed: BTreeSet<_> = simulation
        .scenario
        .events
        .iter()
        .filter_map(|event| match event.action {
            Action::Replay { node, .. } => Some(find(simulation, node)?.antenna),
            _ => None,
        })
        .collect();
    if !replayed.is_empty() {
        let tape = tape.clone();
        simulation.medium.watch(move |at: Time, event: Event<'_>| {
            if let Event::Sent {
                from,
                channel,
                frame,
            } = event
                && replayed.contains(&from)
            {
                let mut psdu = frame.to_vec();
                psdu.extend(fcs(frame).to_le_bytes());
                tape.borrow_mut().push(Heard {
                    at,
                    from,
                    channel,
                    psdu,
                });
            }
        });
    }
    tape
}

/// Sends frames again with the pauses that they had.
async fn replay(
    clock: Clock,
    at: Time,
    last: Time,
    node: Rc<Node>,
    (medium, attacker): (Medium, Attacker),
    tape: Tape,
) {
    clock.sleep_until_time(at).await;
    node.note("is heard again");
    let since = at.saturating_sub(last);
    let is_meant = |heard: &&Heard| heard.from == node.antenna && heard.at >= since;
    let again: Vec<Heard> = tape.borrow().iter().filter(is_meant).cloned().collect();
    for heard in again {
        clock.sleep_until_time(at + (heard.at - since)).await;
        attacker.send(&medium, heard.from, heard.channel, &heard.psdu);
    }
}
