//! Events that the scenario orders: faults and disturbances.

use std::{cell::RefCell, collections::BTreeSet, rc::Rc};

use cmucam2_emulator::FaultRates;
use nalgebra::Vector2;
use node_firmware::hardware::Button;
use rand::{Rng, RngExt};
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

/// Plans all events of the scenario.
pub(super) fn schedule(simulation: &mut Simulation) {
    let root = Root(simulation.scenario.seed);
    let tape = record(simulation);
    let ears = attack::listen(simulation);
    let events = simulation.scenario.events.clone();
    for (number, event) in (0..).zip(events) {
        let ScriptedEvent { at_s, action } = event;
        let at = nanoseconds(at_s);
        let clock = simulation.executor.clock();
        let until = |for_s: f64| at.saturating_add(nanoseconds(for_s));
        match action {
            Action::Restart { node } => {
                if let Some(node) = find(simulation, node) {
                    simulation.executor.spawn(restart(clock, at, node));
                }
            }
            Action::PowerCut {
                node,
                for_s,
                in_flash_write,
            } => {
                if let Some(node) = find(simulation, node) {
                    let share = in_flash_write
                        .then(|| root.stream("power cut", number).random_range(0.0..1.0));
                    let cut = power_cut(clock, at, node, nanoseconds(for_s), share);
                    simulation.executor.spawn(cut);
                }
            }
            Action::Jam {
                for_s,
                channel,
                at: place,
                reach,
            } => {
                let during = at..until(for_s);
                if simulation.chips.is_some() {
                    let told = jam(clock, during.clone(), simulation.nodes.clone());
                    simulation.executor.spawn(told);
                }
                simulation.medium.disturb(Disturbance {
                    during,
                    kind: Kind::Jammer {
                        channel: channel.and_then(Channel::new),
                        disk: place.zip(reach),
                    },
                });
            }
            Action::Partition { nodes, for_s } => {
                let apart: BTreeSet<_> = nodes
                    .iter()
                    .filter_map(|&id| Some(find(simulation, id)?.antenna))
                    .collect();
                simulation.medium.disturb(Disturbance {
                    during: at..until(for_s),
                    kind: Kind::Partition(apart),
                });
            }
            Action::Loss { share, for_s } => simulation.medium.disturb(Disturbance {
                during: at..until(for_s),
                kind: Kind::Loss(share),
            }),
            Action::UnplugCamera {
                node,
                for_s,
                with_power,
            } => {
                if let Some(node) = find(simulation, node) {
                    let pull = unplug(clock, at..until(for_s), node, with_power);
                    simulation.executor.spawn(pull);
                }
            }
            Action::StickCamera { node, for_s } => {
                if let Some(node) = find(simulation, node) {
                    simulation
                        .executor
                        .spawn(stick(clock, at..until(for_s), node));
                }
            }
            Action::Daylight { level, kelvin } => {
                let light = simulation.light.clone();
                let changes = async move {
                    clock.sleep_until_time(at).await;
                    light.set(cmucam2_emulator::daylight(level, kelvin));
                };
                simulation.executor.spawn(changes);
            }
            Action::CameraFaults {
                node,
                for_s,
                faults,
            } => {
                if let Some(node) = find(simulation, node) {
                    let mut rates = FaultRates::default();
                    for (fault, rate) in faults {
                        // They were checked when the file was read.
                        let _ = rates.set(&fault, rate);
                    }
                    let strike = camera_faults(clock, at..until(for_s), node, rates);
                    simulation.executor.spawn(strike);
                }
            }
            Action::BumpCamera { node, by, turn_deg } => {
                if let Some(node) = find(simulation, node) {
                    let bump = bump(clock, at, node, by.into(), turn_deg.to_radians());
                    simulation.executor.spawn(bump);
                }
            }
            Action::Slip {
                node,
                for_s,
                distance,
                heading_deg,
            } => {
                if let Some(node) = find(simulation, node) {
                    let error = [distance, heading_deg.to_radians()];
                    let slip = slip(clock, at..until(for_s), node, error);
                    simulation.executor.spawn(slip);
                }
            }
            Action::Rest { node, for_s } => {
                if let Some(node) = find(simulation, node) {
                    let rest = rest(clock, at..until(for_s), node);
                    simulation.executor.spawn(rest);
                }
            }
            Action::IgnoreLamp {
                node,
                for_s,
                stand_s,
            } => {
                if let Some(node) = find(simulation, node) {
                    let hurry = hurry(clock, at..until(for_s), node, nanoseconds(stand_s));
                    simulation.executor.spawn(hurry);
                }
            }
            Action::PressButton { node, button } => {
                if let Some(node) = find(simulation, node) {
                    simulation.executor.spawn(press(clock, at, node, button));
                }
            }
            Action::Rot { node, bits } => {
                if let Some(node) = find(simulation, node) {
                    let random = root.stream("rot", number);
                    simulation
                        .executor
                        .spawn(rot(clock, at, node, bits, random));
                }
            }
            Action::WearOut { node } => {
                if let Some(node) = find(simulation, node) {
                    simulation.executor.spawn(wear_out(clock, at, node));
                }
            }
            Action::Replay { node, last_s } => {
                if let Some(node) = find(simulation, node) {
                    let medium = simulation.medium.clone();
                    let sender = (medium, simulation.attacker.clone());
                    let again = replay(clock, at, nanoseconds(last_s), node, sender, tape.clone());
                    simulation.executor.spawn(again);
                }
            }
            Action::Forge {
                frames,
                every_s,
                for_s,
            } => {
                if let Some(ears) = &ears {
                    let random = root.stream("forgery", number);
                    let during = at..until(for_s);
                    let every = nanoseconds(every_s);
                    let forge = attack::forge(clock, during, every, frames, ears.clone(), random);
                    simulation.executor.spawn(forge);
                }
            }
        }
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

async fn restart(clock: Clock, at: Time, node: Rc<Node>) {
    clock.sleep_until_time(at).await;
    node.note("is restarted");
    node.restart();
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

async fn unplug(clock: Clock, during: std::ops::Range<Time>, node: Rc<Node>, with_power: bool) {
    clock.sleep_until_time(during.start).await;
    node.note("has its camera unplugged");
    node.unplug(with_power);
    clock.sleep_until_time(during.end).await;
    node.note("has its camera back");
    node.plug();
}

async fn stick(clock: Clock, during: std::ops::Range<Time>, node: Rc<Node>) {
    clock.sleep_until_time(during.start).await;
    node.note("has a camera that sticks");
    node.stick_camera(true);
    clock.sleep_until_time(during.end).await;
    node.note("has a camera that sees again");
    node.stick_camera(false);
}

async fn camera_faults(
    clock: Clock,
    during: std::ops::Range<Time>,
    node: Rc<Node>,
    rates: FaultRates,
) {
    clock.sleep_until_time(during.start).await;
    node.note("has a camera with other faults");
    node.camera_faults(Some(rates));
    clock.sleep_until_time(during.end).await;
    node.note("has its usual camera");
    node.camera_faults(None);
}

async fn bump(clock: Clock, at: Time, node: Rc<Node>, by: Vector2<f64>, turn: f64) {
    clock.sleep_until_time(at).await;
    node.note("has its camera moved");
    node.bump_camera(by, turn);
}

async fn slip(clock: Clock, during: std::ops::Range<Time>, node: Rc<Node>, error: [f64; 2]) {
    clock.sleep_until_time(during.start).await;
    node.note("slips");
    node.slip(error, true);
    clock.sleep_until_time(during.end).await;
    node.note("slips no more");
    node.slip(error, false);
}

async fn rest(clock: Clock, during: std::ops::Range<Time>, node: Rc<Node>) {
    clock.sleep_until_time(during.start).await;
    node.note("has a carrier who rests");
    node.rest(true);
    clock.sleep_until_time(during.end).await;
    node.note("has a carrier who goes on");
    node.rest(false);
}

async fn hurry(clock: Clock, during: std::ops::Range<Time>, node: Rc<Node>, stand: Time) {
    clock.sleep_until_time(during.start).await;
    node.note("has a carrier who does not heed the lamp");
    node.hurry(stand, true);
    clock.sleep_until_time(during.end).await;
    node.note("has a carrier who heeds the lamp again");
    node.hurry(stand, false);
}

/// Nodes may move meanwhile, and get power: emulated chips are told so often which channels are jammed.
const JAM_TOLD: Time = 100_000_000;

async fn jam(clock: Clock, during: std::ops::Range<Time>, nodes: Vec<Rc<Node>>) {
    let mut at = during.start;
    while at < during.end {
        clock.sleep_until_time(at).await;
        at = during.end.min(at + JAM_TOLD);
        for node in &nodes {
            node.hears_jam(at);
        }
    }
}

async fn press(clock: Clock, at: Time, node: Rc<Node>, button: Button) {
    clock.sleep_until_time(at).await;
    let what = match button {
        Button::JoinWindow => "has its button pressed that lets devices join",
        Button::LearnColour => "has its button pressed that has it learn a colour",
    };
    node.note(what);
    node.press(button);
}

async fn rot(clock: Clock, at: Time, node: Rc<Node>, bits: u32, random: impl Rng) {
    clock.sleep_until_time(at).await;
    node.note("has bits of its flash flip");
    node.rot(bits, random);
}

async fn wear_out(clock: Clock, at: Time, node: Rc<Node>) {
    clock.sleep_until_time(at).await;
    node.note("has a flash that is worn");
    node.wear_out();
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
