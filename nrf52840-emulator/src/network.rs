//! Chips that hear each other, each in a thread of its own.
//!
//! A frame is told 130 us before it is on the air, when its radio ramps up. So no chip can be heard
//! sooner than [`AHEAD`] after the earliest instant at which any of them does something: until then all
//! of those that have something to do run beside one another. An idle one waits for its next event.

use std::{
    collections::BTreeMap,
    sync::mpsc::{self, Receiver, Sender},
    thread::{self, JoinHandle},
};

use crate::{
    node::{self, Node, Outcome},
    peripheral::{Frame, RAMP_UP, US},
};

/// A little less than a ramp-up.
const AHEAD: u64 = RAMP_UP - US;
/// Where there is nobody else.
const ALONE: u64 = 1_000_000_000;

/// When a chip does something next, and what it did since it was last asked.
#[derive(Default)]
pub(crate) struct Report {
    pub(crate) next: u64,
    pub(crate) deeds: Vec<(u64, Deed)>,
}

/// Until when a chip runs, and what happens to it by then.
pub(crate) struct Order {
    pub(crate) until: u64,
    pub(crate) inputs: Vec<Input>,
}

/// What happens to a chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Input {
    /// A frame arrives, at this level: 0 to 63, in steps of 1 dB from -92 dBm (Product Specification,
    /// "RADIO"). It must not have begun.
    Frame(Frame, u8),
    /// A byte on the line of UARTE0 is over at an instant, or now if that has passed.
    Byte(u64, u8),
    /// In the middle of the next work on its flash it stands still, and what is there then is what it leaves:
    /// power is about to go.
    StandInWrite,
    /// It is to show its memory.
    Show,
}

impl Input {
    /// When there is something to do because of it.
    fn at(&self) -> u64 {
        match self {
            Self::Frame(frame, _) => frame.start,
            Self::Byte(at, _) => *at,
            Self::StandInWrite => u64::MAX,
            // At once.
            Self::Show => 0,
        }
    }
}

/// What a chip does that is seen outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Deed {
    /// It is about to send a frame.
    Sends(Frame),
    /// A byte has gone out on UARTE0.
    Byte(u8),
    /// What the pins of a port drive has changed: the port, and its pins; those of inputs count as high.
    Pins(u8, u32),
    /// Bytes of the first channel of RTT.
    Log(Vec<u8>),
    /// It stands in the middle of [work on its flash](Input::StandInWrite) that takes so many nanoseconds.
    Writes(u64),
    /// [`MEMORY`](crate::MEMORY) and [`SETTINGS`](crate::SETTINGS), as it was to show.
    Memory(Vec<(u64, Vec<u8>)>),
    /// It restarts, by order of `Core` or a peripheral.
    Reset(String),
    /// It has ended by itself: why.
    Fails(String),
}

/// Tells that a chip has ended, whatever the reason.
struct Guard(usize, Sender<(usize, Option<Report>)>);

impl Drop for Guard {
    fn drop(&mut self) {
        // Nobody listens any more where all end.
        let _ = self.1.send((self.0, None));
    }
}

/// A chip that has power.
#[derive(Debug)]
struct Running {
    orders: Sender<Order>,
    thread: JoinHandle<Result<Outcome, String>>,
    next: u64,
    inputs: Vec<Input>,
}

/// Chips that can be switched on and off, and whoever carries frames between them.
#[derive(Debug)]
pub struct Network {
    reports: Sender<(usize, Option<Report>)>,
    reported: Receiver<(usize, Option<Report>)>,
    chips: BTreeMap<usize, Running>,
    reached: u64,
    ahead: u64,
    /// Those that have just been switched on, and have not yet told what they do.
    starting: usize,
}

impl Default for Network {
    fn default() -> Self {
        let (reports, reported) = mpsc::channel();
        Self {
            reports,
            reported,
            chips: BTreeMap::new(),
            reached: 0,
            ahead: AHEAD,
            starting: 0,
        }
    }
}

impl Network {
    /// Until when all have run.
    pub fn reached(&self) -> u64 {
        self.reached
    }

    /// Power comes to a chip, now. It has no power yet.
    pub fn switch_on(&mut self, number: usize, node: Node) {
        let (orders, received) = mpsc::channel();
        let reports = self.reports.clone();
        let since = self.reached;
        let thread = thread::spawn(move || {
            let _guard = Guard(number, reports.clone());
            node::run(number, node, since, reports, received)
        });
        self.starting += 1;
        let chip = Running {
            orders,
            thread,
            next: since,
            inputs: Vec::new(),
        };
        self.chips.insert(number, chip);
    }

    /// A chip loses its power, now; none if it has none.
    ///
    /// # Errors
    /// Its image cannot be run.
    pub fn switch_off(&mut self, number: usize) -> Option<Result<Outcome, String>> {
        // It has told that it stands still.
        self.settle(0, &mut Vec::new());
        let Running { orders, thread, .. } = self.chips.remove(&number)?;
        drop(orders);
        let outcome = match thread.join() {
            Ok(outcome) => outcome,
            Err(_) => Err("a model panicked".to_owned()),
        };
        // Its last word, after which it may be switched on again.
        while self
            .reported
            .recv()
            .is_ok_and(|(who, report)| who != number || report.is_some())
        {}
        Some(outcome)
    }

    /// Something happens to a chip, if it has power.
    pub fn input(&mut self, number: usize, input: Input) {
        if let Some(chip) = self.chips.get_mut(&number) {
            chip.next = chip.next.min(input.at());
            chip.inputs.push(input);
        }
    }

    /// Runs until an instant, or until a chip has done something. What they did, in the order of time;
    /// frames by their start, which is yet to come. A chip that [fails](Deed::Fails) is no more.
    pub fn run(&mut self, until: u64) -> Vec<(u64, usize, Deed)> {
        let mut deeds = Vec::new();
        self.settle(0, &mut deeds);
        while deeds.is_empty() {
            let next = self.chips.values().map(|chip| chip.next);
            let first = next.min().unwrap_or(u64::MAX);
            if first >= until {
                self.reached = self.reached.max(until);
                break;
            }
            let horizon = first
                .max(self.reached)
                .saturating_add(self.ahead)
                .min(until);
            let mut running = 0;
            for chip in self.chips.values_mut().filter(|chip| chip.next < horizon) {
                let inputs = core::mem::take(&mut chip.inputs);
                let until = horizon;
                running += usize::from(chip.orders.send(Order { until, inputs }).is_ok());
            }
            self.settle(running, &mut deeds);
            self.reached = self.reached.max(horizon);
        }
        deeds.sort_by_key(|(at, number, _)| (*at, *number));
        deeds
    }

    /// Waits until so many chips, and those that have just been switched on, have told what they did.
    fn settle(&mut self, running: usize, deeds: &mut Vec<(u64, usize, Deed)>) {
        for _ in 0..running + core::mem::take(&mut self.starting) {
            // There is always a sender: this one's own.
            let Ok((number, report)) = self.reported.recv() else {
                return;
            };
            match report {
                Some(Report { next, deeds: new }) => {
                    if let Some(chip) = self.chips.get_mut(&number) {
                        let input = chip.inputs.iter().map(Input::at).min();
                        chip.next = next.min(input.unwrap_or(u64::MAX));
                    }
                    deeds.extend(new.into_iter().map(|(at, deed)| (at, number, deed)));
                }
                None => {
                    let chip = self.chips.remove(&number);
                    let why = match chip.map(|chip| chip.thread.join()) {
                        Some(Ok(Err(why))) => why,
                        Some(Ok(Ok(_))) => "it ended by itself".to_owned(),
                        _ => "a model panicked".to_owned(),
                    };
                    deeds.push((self.reached, number, Deed::Fails(why)));
                }
            }
        }
    }
}

/// Runs chips from power-on for so many nanoseconds. `medium` says at which [level](Input::Frame) a node
/// hears a frame, if it does. Also returned are all frames.
///
/// # Errors
/// A chip's image cannot be run.
pub fn run(
    nodes: Vec<Node>,
    until: u64,
    mut medium: impl FnMut(&Frame, usize) -> Option<u8>,
) -> Result<(Vec<Outcome>, Vec<Frame>), String> {
    let count = nodes.len();
    let mut network = Network {
        ahead: if count > 1 { AHEAD } else { ALONE },
        ..Network::default()
    };
    for (number, node) in nodes.into_iter().enumerate() {
        network.switch_on(number, node);
    }
    let mut frames: Vec<Frame> = Vec::new();
    while network.reached() < until {
        for (_, number, deed) in network.run(until) {
            match deed {
                Deed::Fails(why) => return Err(why),
                Deed::Sends(frame) => {
                    for to in (0..count).filter(|to| *to != number) {
                        if let Some(level) = medium(&frame, to) {
                            network.input(to, Input::Frame(frame.clone(), level));
                        }
                    }
                    frames.push(frame);
                }
                _ => {}
            }
        }
    }
    let outcomes = (0..count).filter_map(|number| network.switch_off(number));
    outcomes
        .collect::<Result<_, _>>()
        .map(|outcomes| (outcomes, frames))
}
