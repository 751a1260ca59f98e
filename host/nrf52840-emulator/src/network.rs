//! Chips that hear each other, each in a thread of its own, of which one runs at a time.
//!
//! A frame is told 130 us before it is on the air, when its radio ramps up. So no chip can be heard sooner than
//! [`AHEAD`] after the instant at which it next does something. Each chip runs for so long after the first instant
//! of all others, or until it does something itself that is seen outside, which may act back on it. An idle one
//! waits for its next event.

use std::{
    any::Any,
    collections::{BTreeMap, VecDeque},
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
};

use crate::{
    node::{self, Node, Outcome},
    one_cpu::OneCpu,
    peripheral::{Arrival, Frame, RAMP_UP, US, Wires},
};

/// A little less than a ramp-up, also of the fastest clock.
const AHEAD: u64 = RAMP_UP - US;

/// Instant until which a chip has run, instant when it next does something, and its deeds since it was last asked.
#[derive(Default)]
pub(crate) struct Report {
    pub(crate) reached: u64,
    pub(crate) next: u64,
    pub(crate) deeds: Vec<(u64, Deed)>,
    /// Number of changes of its flash so far.
    pub(crate) changes: usize,
    /// Contents of the flash, if they were to be shown.
    pub(crate) shown: Option<Contents>,
}

/// Parts of the flash that a program writes: addresses, and the bytes from there on.
pub(crate) type Contents = Vec<(u64, Vec<u8>)>;

/// Order to a chip.
#[derive(Debug)]
pub(crate) enum Order {
    /// To run until an instant, with the events that happen to it by then.
    Run { until: u64, inputs: Vec<Input> },
    /// To show what programs write, and to do nothing else: it is to go on as if it was not looked at.
    Show,
}

/// Event that happens to a chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Input {
    /// A frame arrives. It must not have begun.
    Frame(Frame, Arrival),
    /// A byte on the line of UARTE0 is over at an instant, or now if that has passed.
    Byte(u64, u8),
    /// In the middle of the next work on its flash it stands still, and leaves the flash as it is then: power is
    /// about to go.
    StandInWrite,
    /// A node has lost its power: what it sends now is not received whole.
    CutOff(usize),
    /// Something that is no frame is on a FREQUENCY, or on all, until an instant.
    Jammed(u64, Option<u32>),
    /// From an instant on something pulls these inputs of a port down, a bit each, and no others: buttons.
    Pulls(u64, u8, u32),
    /// Bits of its flash flip: addresses, and numbers of bits there.
    Rot(Vec<(u64, u8)>),
    /// [`MEMORY`](crate::MEMORY) keeps what it holds, though it is written or erased.
    WearOut,
}

impl Input {
    /// Time when the chip has something to do because of it.
    fn at(&self) -> u64 {
        match self {
            Self::Frame(frame, _) => frame.start,
            Self::Byte(at, _) | Self::Pulls(at, ..) => *at,
            Self::CutOff(_) | Self::StandInWrite | Self::Jammed(..) | Self::WearOut => u64::MAX,
            // At once.
            Self::Rot(_) => 0,
        }
    }
}

/// Deed of a chip that is seen outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Deed {
    /// It is about to send a frame.
    Sends(Frame),
    /// It begins to send these bytes on UARTE0, one after the other.
    Bytes(Vec<u8>),
    /// UARTE0 sends and receives over these wires from now on.
    Uart(Wires),
    /// TWIM0 has data and clock on these wires from now on.
    I2c(Wires),
    /// The levels that a port drives have changed: the port, and its pins; those of inputs count as high.
    Pins(u8, u32),
    /// Bytes of the first channel of RTT.
    Log(Vec<u8>),
    /// It stands in the middle of [work on its flash](Input::StandInWrite) that takes so many nanoseconds.
    Writes(u64),
    /// It restarts, by order of `Core` or a peripheral; whether it had written UICR, which is valid from now on.
    Reset(String, bool),
    /// It has ended by itself: the reason.
    Fails(String),
}

/// A chip that has power.
#[derive(Debug)]
struct Running {
    thread: Option<JoinHandle<Result<Outcome, String>>>,
    next: u64,
    inputs: Vec<Input>,
    /// Number of changes of its flash so far, and at the time when it was last shown; and the contents that it
    /// shows.
    changes: usize,
    known: usize,
    shown: Option<Contents>,
    /// Its order, a flag that it is its turn, and the bell that wakes it then.
    order: Option<Order>,
    is_next: bool,
    bell: Arc<Condvar>,
    /// It has something to do, and has not told what came of it.
    is_running: bool,
    /// Its power goes.
    is_off: bool,
    /// Its thread has ended.
    has_ended: bool,
}

/// State that the chips share. The last chip to tell its deeds says which goes on, and goes on itself if it is the
/// one. So a chip that is alone awake wakes no other.
#[derive(Debug, Default)]
struct State {
    chips: BTreeMap<usize, Running>,
    running: usize,
    /// Those of them whose turn comes.
    waiting: VecDeque<usize>,
    /// Instant until which they go on by themselves; not at all once a deed is to be told.
    until: u64,
    reached: u64,
    deeds: Vec<(u64, usize, Deed)>,
}

/// State that the chips share with the thread that runs them.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    state: Mutex<State>,
    /// Rings when no chip runs.
    rest: Arc<Condvar>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A chip tells its deeds, and waits for its next order; none once its power goes. Before it waits, it leaves
    /// what others may need.
    pub(crate) fn report(
        &self,
        number: usize,
        report: Report,
        leave: impl FnOnce(),
    ) -> Option<Order> {
        let mut state = self.lock();
        state.take(number, report);
        let bell = self.rests(&mut state, number);
        let goes_on = { state.chips.get(&number) }.is_none_or(|chip| chip.is_next);
        if !goes_on {
            // A thread that is woken finds everything free.
            drop(state);
            leave();
            bell.notify_one();
            state = self.lock();
        }
        loop {
            let chip = state.chips.get_mut(&number).filter(|chip| !chip.is_off)?;
            if core::mem::take(&mut chip.is_next) {
                return chip.order.take();
            }
            let bell = chip.bell.clone();
            state = bell.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// A chip has nothing to do any more: the last one says which has. Returns the bell of the one to wake.
    fn rests(&self, state: &mut State, number: usize) -> Arc<Condvar> {
        let chip = state.chips.get_mut(&number);
        if chip.is_some_and(|chip| core::mem::take(&mut chip.is_running)) {
            state.running -= 1;
        }
        if state.running == 0 {
            state.go_on();
        }
        state.turn().unwrap_or_else(|| self.rest.clone())
    }

    /// Waits until no chip runs.
    fn rest(&self) -> MutexGuard<'_, State> {
        let is_busy = |state: &mut State| state.running > 0;
        let state = self.rest.wait_while(self.lock(), is_busy);
        state.unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn take(&mut self, number: usize, report: Report) {
        let Report {
            reached,
            next,
            deeds,
            changes,
            shown,
        } = report;
        self.reached = self.reached.max(reached);
        if let Some(chip) = self.chips.get_mut(&number) {
            let input = chip.inputs.iter().map(Input::at).min();
            chip.next = next.min(input.unwrap_or(u64::MAX));
            chip.changes = changes;
            chip.shown = shown;
        }
        let deeds = deeds.into_iter().map(|(at, deed)| (at, number, deed));
        self.deeds.extend(deeds);
    }

    /// Orders what can be done without others, unless there is something to tell.
    fn go_on(&mut self) {
        let [first, second] = self.earliest();
        if !self.deeds.is_empty() || first.0 >= self.until {
            return;
        }
        for (number, chip) in &mut self.chips {
            let other = if *number == first.1 { second } else { first };
            let until = other.0.saturating_add(AHEAD).min(self.until);
            if chip.next < until {
                let inputs = core::mem::take(&mut chip.inputs);
                chip.order = Some(Order::Run { until, inputs });
                chip.is_running = true;
                self.running += 1;
                self.waiting.push_back(*number);
            }
        }
    }

    /// The turn of the next one comes: returns the bell that wakes it.
    fn turn(&mut self) -> Option<Arc<Condvar>> {
        let chip = self.chips.get_mut(&self.waiting.pop_front()?)?;
        chip.is_next = true;
        Some(chip.bell.clone())
    }

    /// Times when the first two chips do something next, and their numbers.
    fn earliest(&self) -> [(u64, usize); 2] {
        let mut two = [(u64::MAX, usize::MAX); 2];
        for (number, chip) in &self.chips {
            let this = (chip.next, *number);
            if this < two[0] {
                two = [this, two[0]];
            } else if this < two[1] {
                two[1] = this;
            }
        }
        two
    }
}

/// Tells that a chip has ended, for any reason.
struct Guard(usize, Arc<Shared>);

impl Drop for Guard {
    fn drop(&mut self) {
        let Self(number, shared) = self;
        let mut state = shared.lock();
        if let Some(chip) = state.chips.get_mut(number) {
            chip.has_ended = true;
            chip.next = u64::MAX;
            // No chip goes on before this has been told.
            state.until = 0;
        }
        let bell = shared.rests(&mut state, *number);
        drop(state);
        bell.notify_one();
    }
}

/// Chips that can be switched on and off. The thread that makes it carries frames between them, and stays on one
/// CPU of the computer with all of them until it drops it.
#[derive(Debug)]
pub struct Network(
    Arc<Shared>,
    #[expect(dead_code, reason = "until it is dropped")] OneCpu,
);

impl Default for Network {
    fn default() -> Self {
        Self(Arc::default(), OneCpu::take())
    }
}

impl Network {
    /// Instant that all have reached.
    pub fn reached(&self) -> u64 {
        self.0.lock().reached
    }

    /// Time when the first of them does something next, if nothing happens to any.
    pub fn next(&self) -> u64 {
        self.0.lock().earliest()[0].0
    }

    /// Power comes to a chip, at an instant, or now if that has passed. It has no power yet.
    ///
    /// # Panics
    /// The system gives it no thread.
    pub fn switch_on(&mut self, number: usize, node: Node, at: u64) {
        let shared = self.0.clone();
        let mut state = self.0.lock();
        let since = state.reached.max(at);
        state.running += 1;
        let chip = Running {
            thread: None,
            next: since,
            inputs: Vec::new(),
            changes: 0,
            known: 0,
            shown: None,
            order: None,
            is_next: false,
            bell: Arc::default(),
            is_running: true,
            is_off: false,
            has_ended: false,
        };
        let chip = state.chips.entry(number).insert_entry(chip).into_mut();
        let thread = thread::Builder::new().name(format!("chip {number}"));
        let thread = thread.spawn(move || {
            let _guard = Guard(number, shared.clone());
            node::run(number, node, since, shared)
        });
        chip.thread = Some(thread.expect("a thread for each chip"));
    }

    /// A chip loses its power, now; none if it has none.
    ///
    /// # Errors
    /// Its image cannot be run.
    pub fn switch_off(&mut self, number: usize) -> Option<Result<Outcome, String>> {
        // It has told that it stands still.
        let mut state = self.0.rest();
        let chip = state.chips.get_mut(&number)?;
        chip.is_off = true;
        chip.bell.notify_one();
        let thread = chip.thread.take();
        drop(state);
        let ended = thread.map(JoinHandle::join);
        self.0.lock().chips.remove(&number);
        Some(ended?.unwrap_or_else(|panic| Err(panicked(panic.as_ref()))))
    }

    /// Contents that programs have written in [`MEMORY`](crate::MEMORY) and [`SETTINGS`](crate::SETTINGS) of a
    /// chip with power, unless nothing has been written there since this was last asked. The chip does not notice.
    pub fn look(&mut self, number: usize) -> Option<Vec<(u64, Vec<u8>)>> {
        let mut state = self.0.rest();
        let chip = state.chips.get_mut(&number)?;
        if chip.changes == chip.known || chip.has_ended {
            return None;
        }
        chip.known = chip.changes;
        chip.order = Some(Order::Show);
        chip.is_next = true;
        chip.is_running = true;
        let bell = chip.bell.clone();
        state.running += 1;
        drop(state);
        bell.notify_one();
        let mut state = self.0.rest();
        state.chips.get_mut(&number)?.shown.take()
    }

    /// Something happens to a chip, if it has power.
    pub fn input(&mut self, number: usize, input: Input) {
        if let Some(chip) = self.0.lock().chips.get_mut(&number) {
            chip.next = chip.next.min(input.at());
            chip.inputs.push(input);
        }
    }

    /// Runs until an instant, or until a chip has done something. Returns their deeds, in the order of time;
    /// frames by their start, which is yet to come. A chip that [fails](Deed::Fails) is no more.
    pub fn run(&mut self, until: u64) -> Vec<(u64, usize, Deed)> {
        drop(self.0.rest());
        let mut state = self.0.lock();
        state.until = until;
        state.go_on();
        let bell = state.turn();
        drop(state);
        if let Some(bell) = bell {
            bell.notify_one();
        }
        let mut state = self.0.rest();
        state.until = 0;
        let mut deeds = core::mem::take(&mut state.deeds);
        let ended: Vec<_> = { state.chips.iter() }
            .filter_map(|(number, chip)| chip.has_ended.then_some(*number))
            .collect();
        for number in ended {
            let chip = state.chips.remove(&number);
            let why = match chip.and_then(|chip| chip.thread).map(JoinHandle::join) {
                Some(Ok(Err(why))) => why,
                Some(Ok(Ok(_))) => "it ended by itself".to_owned(),
                Some(Err(panic)) => panicked(panic.as_ref()),
                None => "it has no thread".to_owned(),
            };
            deeds.push((state.reached, number, Deed::Fails(why)));
        }
        if deeds.is_empty() {
            state.reached = state.reached.max(until);
        }
        deeds.sort_by_key(|(at, number, _)| (*at, *number));
        deeds
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        let numbers: Vec<_> = self.0.lock().chips.keys().copied().collect();
        for number in numbers {
            // A caller that wants to know how it ended has switched it off.
            drop(self.switch_off(number));
        }
    }
}

/// Message for a chip whose thread has panicked.
fn panicked(panic: &(dyn Any + Send)) -> String {
    let text = { panic.downcast_ref::<String>().map(String::as_str) }
        .or_else(|| panic.downcast_ref::<&str>().copied());
    format!(
        "a model panicked: {}",
        text.unwrap_or("it does not say why")
    )
}

/// Runs chips from power-on for so many nanoseconds. `medium` says at which [level](Arrival::level) a node
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
    let mut network = Network::default();
    for (number, node) in nodes.into_iter().enumerate() {
        network.switch_on(number, node, 0);
    }
    let mut frames: Vec<Frame> = Vec::new();
    while network.reached() < until {
        for (_, number, deed) in network.run(until) {
            match deed {
                Deed::Fails(why) => return Err(why),
                Deed::Sends(frame) => {
                    for to in (0..count).filter(|to| *to != number) {
                        if let Some(level) = medium(&frame, to) {
                            network.input(to, Input::Frame(frame.clone(), level.into()));
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
