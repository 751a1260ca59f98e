//! Nodes on emulated nRF52840s, which run the image that is flashed, in virtual time.
//!
//! The world outside a board is here: the medium, cameras and consoles at the far end of lines, lamps. The
//! chips themselves are behind [`Emulator`]: those of the crate `nrf52840-emulator`, which only the feature
//! `chip` builds. Each side goes on until it does something that the other one sees; in [`Outside`] the
//! executor waits for the chips. The same scenario goes the same way each time.
//!
//! A target's steps are made by a [`carrier`], whose motion the chips of its step sensor feel.
//!
//! Such a node is not watched from within. Its notes are read from its flash as the run goes on, which
//! changes nothing for the chips.
//!
//! Bytes come to a chip once all of a burst have come to the end of the simulated line, as far apart as they
//! were there.

mod carrier;
#[cfg(feature = "chip")]
mod emulator;
#[cfg(feature = "chip")]
mod image;
pub mod outside;
mod wires;

use std::{
    any::Any,
    cell::{Cell, RefCell},
    collections::{BTreeMap, VecDeque},
    future::poll_fn,
    mem,
    net::{Ipv4Addr, TcpListener},
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    rc::Rc,
    sync::{Arc, atomic::AtomicBool},
    task::{Poll, Waker},
};

use board_facts::NRF52840_DK;
use embassy_futures::select::{Either4, select4};
use embassy_sync::{blocking_mutex::raw::NoopRawMutex, signal::Signal};
use embedded_io_async::{Read, Write};
use node_firmware::{
    config::{
        CheckedConfig, RoleConfig,
        page::{self, PageError},
    },
    facts::Fact,
    hardware::{Button, Indication},
    limits::CONSOLE_BAUD,
};
use rand::{Rng, RngExt};
use virtual_hardware::{
    executor::{Clock, Outside, Time},
    medium::{Arrival, Medium, Reason},
};
use zigbee_link::{radio::Channel, wire::Eui64};

use self::{
    carrier::Carrier,
    outside::{Contents, Deed, Emulator, End, Frame, Motion, Order, Reception, Reports},
};
use super::{
    super::{Trouble, journal::SharedJournal},
    EmulatorError, Surroundings, memory,
};

/// Path at which `cargo xtask firmware` puts the image.
pub const CHIP_IMAGE: &str = "target/firmware/nrf52840-node.elf";

/// Delay from the report of a frame to its start: chips stand still between two instructions.
const NOTICE: Time = 1_000;

/// Number of bytes that are read from a line at once.
const BURST: usize = 64;

const SECOND: Time = 1_000_000_000;

/// Bytes of a frame on the air before its PSDU, and time of each byte (IEEE 802.15.4-2020, 12.1, 12.3.3).
const PHY_HEADER: Time = 6;
const AIR_PER_BYTE: Time = 32_000;

/// Pins of the first port that the board connects to lamps, which shine while they are low: joined, target
/// seen, calibrated, may walk (`boards/nrf52840/src/main.rs`).
const LAMPS: [u32; 4] = [13, 14, 15, 16];

/// Pins of its buttons: the one that lets devices join, and the one that has a camera learn a colour.
const BUTTONS: [u32; 2] = [11, 12];
/// Time for which a button is pressed.
const PRESSED: Time = 200_000_000;

/// Chips with their program, ready to run.
pub struct Chips(Box<dyn Emulator>);

impl Chips {
    /// Emulated nRF52840s that run this image.
    ///
    /// # Errors
    /// The image is missing or is not for these chips, or this program was built without them.
    #[cfg(feature = "chip")]
    pub fn of(image: &Path) -> Result<Self, EmulatorError> {
        let found = image.canonicalize().ok().filter(|image| image.is_file());
        let image = found.ok_or_else(|| EmulatorError::NoImage {
            image: image.to_owned(),
            usual: CHIP_IMAGE,
        })?;
        let bytes = std::fs::read(&image).ok();
        let bytes = bytes.filter(|bytes| image::is_ours(bytes));
        let chips = bytes.and_then(|bytes| emulator::Chips::new(image.clone(), &bytes));
        let chips = chips.ok_or(EmulatorError::NoProgram {
            image,
            usual: CHIP_IMAGE,
        })?;
        Ok(Self::emulated_by(chips))
    }

    /// Emulated nRF52840s that run this image.
    ///
    /// # Errors
    /// This program was built without them.
    #[cfg(not(feature = "chip"))]
    pub fn of(_: &Path) -> Result<Self, EmulatorError> {
        Err(EmulatorError::NotIncluded)
    }

    /// Chips of another emulator.
    pub fn emulated_by(emulator: impl Emulator + 'static) -> Self {
        Self(Box::new(emulator))
    }

    /// Lets GDB into this node: whenever power comes, its first instruction waits for GDB, which connects to this
    /// port of this computer, until `end` is set. All other chips wait while GDB looks at it.
    ///
    /// # Errors
    /// The port is taken.
    pub fn debug(
        &mut self,
        node: u16,
        port: u16,
        end: Arc<AtomicBool>,
    ) -> Result<(), EmulatorError> {
        // Tried now: the chip opens the port only once it has power.
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port));
        drop(listener.map_err(|source| EmulatorError::PortTaken { node, port, source })?);
        self.0.debug(node.into(), port, end);
        Ok(())
    }
}

/// Message of a panic.
fn message(panic: &(dyn Any + Send)) -> String {
    let text = { panic.downcast_ref::<String>().cloned() }
        .or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
    text.unwrap_or_else(|| "it does not say why".to_owned())
}

/// All chips of a simulation.
pub(in crate::network) struct Pool {
    /// `None` after it has panicked.
    emulator: RefCell<Option<Box<dyn Emulator>>>,
    clock: Clock,
    medium: Medium,
    journal: SharedJournal,
    trouble: Trouble,
    boards: RefCell<BTreeMap<u32, Rc<Board>>>,
    /// Deeds of the chips that the simulation has not handled yet.
    deeds: RefCell<VecDeque<(Time, u32, Deed)>>,
    queue: Rc<Queue>,
    is_over: Cell<bool>,
}

/// Orders for chips, until they are passed on.
#[derive(Default)]
struct Queue {
    orders: RefCell<Vec<(u32, Order)>>,
    /// Time until which all chips have run.
    reached: Cell<Time>,
    /// Time at which the first chip does something next, unless something is ordered.
    next: Cell<Time>,
}

impl Queue {
    fn push(&self, number: u32, order: Order) {
        self.next.set(self.next.get().min(order.at()));
        self.orders.borrow_mut().push((number, order));
    }
}

impl Pool {
    pub(in crate::network) fn new(
        chips: Chips,
        clock: Clock,
        medium: Medium,
        journal: SharedJournal,
        trouble: Trouble,
    ) -> Rc<Self> {
        Rc::new(Self {
            emulator: RefCell::new(Some(chips.0)),
            clock,
            medium,
            journal,
            trouble,
            boards: RefCell::default(),
            deeds: RefCell::default(),
            queue: Rc::default(),
            is_over: Cell::new(false),
        })
    }

    /// A board that is still switched off, with its configuration, and clocks that run faster than true by this
    /// many parts in 1e9. `step_length` is that of the steps which are reported, if it is a target's.
    pub(in crate::network) fn board(
        &self,
        config: &CheckedConfig,
        drift_ppb: i32,
        step_length: f64,
    ) -> Rc<Board> {
        let (config, carrier) = carried(config, step_length).unwrap_or_else(|error| {
            self.trouble.borrow_mut().get_or_insert(error);
            (config.clone(), None)
        });
        let board = Rc::new(Board {
            config,
            drift_ppb,
            carrier: RefCell::new(carrier),
            queue: self.queue.clone(),
            bytes: RefCell::default(),
            came: Signal::new(),
            lamps: Signal::new(),
            last_words: RefCell::default(),
            has_restarted: Cell::new(false),
            on_air: Cell::new(0),
            is_to_stand: Cell::new(false),
            stood: Cell::default(),
            waiting: RefCell::default(),
            antenna: Cell::new(None),
            end: RefCell::default(),
            has_changed: Cell::new(false),
        });
        let number = board.number();
        self.boards.borrow_mut().insert(number, board.clone());
        board
    }

    /// Notes that a board cannot go on; then the simulation cannot either.
    fn stops(&self, board: &Board, error: EmulatorError) {
        let mut journal = self.journal.borrow_mut();
        journal.failed(board.config.settings().id, &error.to_string());
        self.trouble.borrow_mut().get_or_insert(error);
    }

    /// Takes the power of all chips: their ends can be asked for from now on.
    pub(in crate::network) fn end(&self) {
        if self.is_over.replace(true) {
            return;
        }
        match self.ask(|emulator| emulator.end()) {
            Ok(reports) => {
                for (_, number, deed) in reports.deeds {
                    match (deed, self.of(number)) {
                        (Deed::Ends(end), Some(board)) => {
                            self.looks(&board, &end.memory);
                            board.end.replace(*end);
                        }
                        (deed, _) => self.happens(number, deed),
                    }
                }
            }
            Err(error) => self.fail(error),
        }
    }

    /// Reads the flash of all chips with power, so that its contents can be asked for. Returns true if any of it
    /// has changed. The chips do not notice this.
    pub(in crate::network) fn look(&self) -> bool {
        if self.is_over.get() {
            return false;
        }
        match self.ask(|emulator| emulator.look()) {
            Ok(reports) => self.take(reports),
            Err(error) => self.fail(error),
        }
        let boards = self.boards.borrow();
        // Every flag is taken, not only the first.
        let changed = boards.values().filter(|board| board.has_changed.take());
        changed.count() > 0
    }

    /// Takes the deeds of chips, to be seen at their times.
    fn take(&self, reports: Reports) {
        self.queue.reached.set(reports.reached);
        self.queue.next.set(reports.next);
        let mut deeds = Vec::new();
        for (at, number, deed) in reports.deeds {
            match deed {
                Deed::Memory(contents) => {
                    if let Some(board) = self.of(number) {
                        self.looks(&board, &contents);
                        board.end.borrow_mut().memory = contents;
                        board.has_changed.set(true);
                    }
                }
                Deed::Sends(..) => deeds.push((at - NOTICE, number, deed)),
                _ => deeds.push((at, number, deed)),
            }
        }
        let mut all = self.deeds.borrow_mut();
        all.extend(deeds);
        all.make_contiguous()
            .sort_by_key(|(at, number, _)| (*at, *number));
    }

    /// Checks that contents of a flash include the image's memory; otherwise none would ever be found.
    fn looks(&self, board: &Board, contents: &[Contents]) {
        if !contents.is_empty() && memory_in(contents).is_none() {
            let id = board.config.settings().id;
            self.stops(board, EmulatorError::NoMemory { id });
        }
    }

    fn of(&self, number: u32) -> Option<Rc<Board>> {
        self.boards.borrow().get(&number).cloned()
    }

    fn fail(&self, error: EmulatorError) {
        self.is_over.set(true);
        self.trouble.borrow_mut().get_or_insert(error);
    }

    /// Has chips do something; returns what comes of it. A panic of the emulator ends it, and nothing else.
    fn ask(
        &self,
        what: impl FnOnce(&mut dyn Emulator) -> Reports,
    ) -> Result<Reports, EmulatorError> {
        let mut emulator = self.emulator.borrow_mut();
        let Some(chips) = emulator.as_mut() else {
            return Ok(Reports::default());
        };
        catch_unwind(AssertUnwindSafe(|| what(chips.as_mut()))).map_err(|panic| {
            // To drop it could wait for ever.
            mem::forget(emulator.take());
            EmulatorError::Panicked(message(panic.as_ref()))
        })
    }

    fn run(&self, until: Time) -> Result<Reports, EmulatorError> {
        let orders = self.queue.orders.take();
        self.ask(|emulator| emulator.run(orders, until))
    }

    fn happens(&self, number: u32, deed: Deed) {
        let Some(board) = self.of(number) else {
            return;
        };
        let id = board.config.settings().id;
        let note = |what: &str| {
            let mut journal = self.journal.borrow_mut();
            journal.note(id, format_args!("{what}"));
        };
        match deed {
            Deed::Sends(frame, power) => {
                let channel = Channel::new(frame.channel);
                if let Some((channel, antenna)) = channel.zip(board.antenna.get()) {
                    let bytes = PHY_HEADER + frame.psdu.len() as Time;
                    board.on_air.set(frame.start + bytes * AIR_PER_BYTE);
                    self.medium.transmit(antenna, channel, power, &frame.psdu);
                }
            }
            Deed::Bytes(bytes) => {
                board.bytes.borrow_mut().extend(bytes);
                board.came.signal(());
            }
            Deed::Pins(0, level) => board.lamps.signal(indication(level)),
            Deed::Uart(wires) => {
                let rate = Some(board.baud());
                if let Err(why) = wires::check("its UART", &wires, board.uart_pins(), rate) {
                    self.stops(&board, EmulatorError::Wires { id, why });
                }
            }
            Deed::I2c(wires) => {
                if let Err(why) = wires::check("its I2C bus", &wires, wires::BUS, None) {
                    self.stops(&board, EmulatorError::Wires { id, why });
                }
            }
            Deed::Logs(line) => {
                note(&line);
                self.says(&board, &line);
            }
            Deed::Writes(takes) => {
                board.is_to_stand.set(false);
                let (often, _) = board.stood.get();
                board.stood.set((often + 1, takes));
                board.waiting.borrow_mut().drain(..).for_each(Waker::wake);
            }
            Deed::Restarts { by, has_settings } => {
                board.lamps.signal(Indication::default());
                let before = board.last_words.take();
                // Settings are written at the first start, and valid from the next one on.
                if has_settings {
                    return note(&format!("restarts, by {by}, with new settings"));
                }
                board.has_restarted.set(true);
                let by = match by.as_str() {
                    "Core" => "its program",
                    r#"Model("WDT")"# => "its watchdog",
                    other => other,
                };
                let why = format!("{by} restarts it{before}");
                self.journal.borrow_mut().failed(id, &why);
            }
            Deed::Fails(why) => self.stops(&board, EmulatorError::Chip { id, why }),
            Deed::Pins(..) | Deed::Memory(_) | Deed::Ends(_) => {}
        }
    }
}

impl Pool {
    /// Takes in a line of the log in which the image says why it cannot go on.
    fn says(&self, board: &Board, line: &str) {
        let id = board.config.settings().id;
        if let Some(why) = line.strip_prefix("error no configuration: ") {
            let why = why.to_owned();
            self.stops(board, EmulatorError::NoConfiguration { id, why });
        } else if let Some(why) = line.strip_prefix("error stopped: ") {
            board.last_words.replace(format!(": {why}"));
        } else if let Some(why) = line.strip_prefix("error before that: ")
            && board.has_restarted.take()
        {
            // It tells the reason only after a restart.
            self.journal.borrow_mut().failed_since(id, why);
        }
    }
}

/// The node's configuration with the page's entries about its carrier, and the carrier of a target.
fn carried(
    config: &CheckedConfig,
    step_length: f64,
) -> Result<(CheckedConfig, Option<Carrier>), EmulatorError> {
    let mut written = config.settings().clone();
    let RoleConfig::Target(target) = &mut written.role else {
        return Ok((config.clone(), None));
    };
    let sensor = &mut target.sensor;
    let carrier = Carrier::new(step_length, sensor.step_length, sensor.hard_iron);
    sensor.step_length = carrier.step_length;
    let checked = written.check().map_err(|error| EmulatorError::Config {
        id: config.settings().id,
        reason: PageError::Value(error),
    })?;
    Ok((checked, Some(carrier)))
}

/// The image's memory, in the contents of a flash.
fn memory_in(contents: &[Contents]) -> Option<&[u8]> {
    let (start, length) = NRF52840_DK.memory();
    contents.iter().find_map(|(address, bytes)| {
        let from = usize::try_from(u64::from(start).checked_sub(*address)?).ok()?;
        bytes.get(from..from + length as usize)
    })
}

fn indication(level: u32) -> Indication {
    let [joined, target_seen, calibrated, may_walk] = LAMPS.map(|pin| level >> pin & 1 == 0);
    let mut shown = Indication::default();
    shown.joined = joined;
    shown.target_seen = target_seen;
    shown.calibrated = calibrated;
    shown.may_walk = may_walk;
    shown
}

/// Place where the executor waits for the chips.
pub(in crate::network) struct Lockstep(pub(in crate::network) Rc<Pool>);

impl Outside for Lockstep {
    fn run_until(&mut self, until: Time) -> Time {
        let Self(pool) = self;
        let now = pool.clock.time();
        let queue = &pool.queue;
        let is_idle = pool.deeds.borrow().is_empty();
        // If no chip does anything by then, the emulator is not asked.
        if is_idle && queue.next.get() < until && !pool.is_over.get() {
            match pool.run(until) {
                Ok(reports) => pool.take(reports),
                Err(error) => pool.fail(error),
            }
        }
        let first = pool.deeds.borrow().front().map(|(at, ..)| *at);
        first.map_or(until, |first| first.max(now))
    }

    fn happens(&mut self) -> bool {
        let Self(pool) = self;
        let now = pool.clock.time();
        let mut happened = false;
        loop {
            let due = pool.deeds.borrow_mut().pop_front_if(|(at, ..)| *at <= now);
            let Some((_, number, deed)) = due else {
                return happened;
            };
            happened = true;
            pool.happens(number, deed);
        }
    }
}

/// A board with such a chip. Its flash keeps its contents when it is switched off.
pub(in crate::network) struct Board {
    config: CheckedConfig,
    drift_ppb: i32,
    /// Carrier of a target.
    carrier: RefCell<Option<Carrier>>,
    queue: Rc<Queue>,
    /// Bytes that have gone out on its line.
    bytes: RefCell<VecDeque<u8>>,
    came: Signal<NoopRawMutex, ()>,
    lamps: Signal<NoopRawMutex, Indication>,
    /// Reason why it stopped, if it said so since it last started.
    last_words: RefCell<String>,
    /// It may still tell the reason for its last restart.
    has_restarted: Cell<bool>,
    /// Time until which its last frame is on the air.
    on_air: Cell<Time>,
    /// It is to stand still in the middle of the next work on its flash.
    is_to_stand: Cell<bool>,
    /// Number of times that it stood still and duration of the last time; and tasks that wait for the next one.
    stood: Cell<(u64, Time)>,
    waiting: RefCell<Vec<Waker>>,
    antenna: Cell<Option<virtual_hardware::medium::NodeId>>,
    end: RefCell<End>,
    /// Its flash has changed since the last look.
    has_changed: Cell<bool>,
}

/// Power of a board, until it is dropped.
struct Power<'a> {
    board: &'a Board,
    medium: &'a Medium,
    clock: &'a Clock,
}

impl Drop for Power<'_> {
    fn drop(&mut self) {
        let Self {
            board,
            medium,
            clock,
        } = self;
        if let Some(antenna) = board.antenna.take() {
            medium.set_ear(antenna, None);
            if board.on_air.get() > clock.time() {
                board.queue.push(board.number(), Order::CutOff(antenna.0));
            }
        }
        board.queue.push(board.number(), Order::Off);
        board.bytes.borrow_mut().clear();
        board.lamps.reset();
        board.last_words.take();
        board.has_restarted.set(false);
    }
}

impl Board {
    fn number(&self) -> u32 {
        self.config.settings().id.into()
    }

    /// Runs the board until this is dropped, which switches it off, or fails.
    pub(in crate::network) async fn run<U: Read + Write>(
        &self,
        surroundings: Surroundings<'_, U>,
    ) -> EmulatorError {
        let Surroundings {
            clock,
            medium,
            antenna,
            mut device,
            panel,
            seed,
        } = surroundings;
        let id = self.config.settings().id;
        let mut written = vec![0; page::PAGE_MAX];
        if let Err(reason) = page::encode(&self.config, &mut written) {
            return EmulatorError::Config { id, reason };
        }
        let order = Order::On {
            at: clock.time(),
            seed,
            drift_ppb: self.drift_ppb,
            has_sensor: self.carrier.borrow().is_some(),
            programmed: vec![(NRF52840_DK.config().into(), written)],
        };
        self.queue.push(self.number(), order);
        self.antenna.set(Some(antenna));
        let _power = Power {
            board: self,
            medium,
            clock,
        };
        medium.set_ear(antenna, Some(Box::new(self.ear(clock))));
        self.moves(|carrier| vec![carrier.stand(clock.time())]);
        if self.is_to_stand.get() {
            self.queue.push(self.number(), Order::StandInWrite);
        }
        let every = self.byte_time();
        let mut free = 0;
        let mut buffer = [0; BURST];
        loop {
            let happened = select4(
                device.read(&mut buffer),
                self.came.wait(),
                self.lamps.wait(),
                panel.steps.receive(),
            );
            match happened.await {
                Either4::First(Ok(count @ 1..)) => {
                    let bytes = buffer[..count].to_vec();
                    let at = clock.time().max(free);
                    free = at + count as Time * every;
                    self.queue
                        .push(self.number(), Order::Bytes { at, every, bytes });
                }
                Either4::First(_) => return EmulatorError::LineClosed { id },
                Either4::Second(()) => {
                    let bytes: Vec<u8> = self.bytes.borrow_mut().drain(..).collect();
                    if device.write_all(&bytes).await.is_err() {
                        return EmulatorError::LineClosed { id };
                    }
                }
                Either4::Third(indication) => panel.show(indication),
                Either4::Fourth(Some(step)) => {
                    self.moves(|carrier| carrier.step(clock.time(), &step));
                }
                Either4::Fourth(None) => {}
            }
        }
    }

    /// Duration of ten bits on its line.
    fn byte_time(&self) -> Time {
        10 * SECOND / Time::from(self.baud().max(1))
    }

    /// Rate of its line.
    fn baud(&self) -> u32 {
        match &self.config.settings().role {
            RoleConfig::Camera(camera) => camera.baud,
            _ => CONSOLE_BAUD,
        }
    }

    /// Pins to which its line is connected, to send and to receive.
    fn uart_pins(&self) -> [u32; 2] {
        match &self.config.settings().role {
            RoleConfig::Coordinator(_) => wires::CONSOLE,
            RoleConfig::Camera(_) | RoleConfig::Target(_) => wires::CAMERA,
        }
    }

    /// Flips bits of the part of its flash that it writes.
    pub(in crate::network) fn rot(&self, bits: u32, random: &mut impl Rng) {
        let (start, length) = NRF52840_DK.memory();
        let mut flip = || {
            let at = start + random.random_range(0..length);
            (u64::from(at), random.random_range(0..8))
        };
        let bits = (0..bits).map(|_| flip()).collect();
        self.queue.push(self.number(), Order::Rot(bits));
    }

    /// Connects the pin of a button to ground for a moment.
    pub(in crate::network) fn press(&self, clock: &Clock, button: Button) {
        let pin = match button {
            Button::JoinWindow => BUTTONS[0],
            Button::LearnColour => BUTTONS[1],
        };
        let now = clock.time();
        for (at, low) in [(now, 1 << pin), (now + PRESSED, 0)] {
            self.queue
                .push(self.number(), Order::Pulls { at, port: 0, low });
        }
    }

    /// Its flash keeps its present contents from now on.
    pub(in crate::network) fn wear_out(&self) {
        self.queue.push(self.number(), Order::WearOut);
    }

    /// Takes its step sensor off its bus, or puts it back.
    pub(in crate::network) fn unplug_sensor(&self, out: bool) {
        self.queue.push(self.number(), Order::UnplugSensor(out));
    }

    /// Jams these channels until a time, where it has power.
    pub(in crate::network) fn jam(&self, until: Time, channels: &[Channel]) {
        for channel in channels {
            let channel = Some(channel.number());
            self.queue
                .push(self.number(), Order::Jammed { until, channel });
        }
    }

    /// Its carrier moves, if it has one.
    fn moves(&self, how: impl FnOnce(&mut Carrier) -> Vec<Motion>) {
        if let Some(carrier) = &mut *self.carrier.borrow_mut() {
            self.queue.push(self.number(), Order::Moves(how(carrier)));
        }
    }

    /// Waits until its chip works on its flash, and has it stand still in the middle of that: its power is about
    /// to go. Returns how long the work would have taken.
    pub(in crate::network) async fn next_write(&self) -> Time {
        self.is_to_stand.set(true);
        self.queue.push(self.number(), Order::StandInWrite);
        let (before, _) = self.stood.get();
        // Several tasks may wait.
        poll_fn(|context| {
            let (often, takes) = self.stood.get();
            if often != before {
                return Poll::Ready(takes);
            }
            self.waiting.borrow_mut().push(context.waker().clone());
            Poll::Pending
        })
        .await
    }

    /// Summary of its chip, once the simulation has ended.
    pub(in crate::network) fn end(&self) -> End {
        self.end.borrow().clone()
    }

    /// Tells its chip of frames that arrive.
    fn ear(&self, clock: &Clock) -> impl FnMut(Arrival<'_>) + 'static {
        let (queue, clock, number) = (self.queue.clone(), clock.clone(), self.number());
        move |arrival| {
            let frame = Frame {
                start: clock.time().max(queue.reached.get()) + NOTICE,
                channel: arrival.channel.number(),
                psdu: arrival.psdu.to_vec(),
            };
            let reception = Reception {
                from: arrival.from.0,
                // The conversion saturates.
                level: arrival.strength.round() as i8,
                is_lost: arrival.lost.is_some(),
                is_faint: arrival.lost == Some(Reason::OutOfRange),
                stands_out: arrival.stands_out,
                spoils: arrival.spoils.iter().map(|node| node.0).collect(),
            };
            queue.push(number, Order::Frame(frame, reception));
        }
    }

    /// The part of its flash that it writes, from [`memory::LINK`] and the role's on.
    fn memory(&self) -> Vec<u8> {
        // Empty until the first look.
        memory_in(&self.end.borrow().memory)
            .unwrap_or_default()
            .to_vec()
    }

    /// The extended address that the node has drawn.
    pub(in crate::network) fn extended(&self, clock: &Clock) -> Option<Eui64> {
        memory::extended(memory::LINK, &self.memory(), clock)
    }

    /// Facts that the node's role has written down, in the order of its records.
    pub(in crate::network) fn facts(&self, clock: &Clock) -> Vec<Fact> {
        memory::facts(&self.memory(), self.config.settings().owner(), clock)
    }
}

// The parts of both flashes are in the same order.
const _: () =
    assert!(NRF52840_DK.regions.link.start - NRF52840_DK.regions.facts.start == memory::LINK.start);
