//! One chip with its image, and its outcome.

use std::{
    collections::BTreeMap,
    fmt,
    net::TcpListener,
    ops::Range,
    path::{Path, PathBuf},
    sync::{Arc, atomic::AtomicBool},
};

use object::{Object, ObjectSymbol};
use rigless::{
    device::Told,
    emulator::{self, AccessKind, Driver, Host, Settled, Start, Stop, StopReason},
    image::Image,
    mcu::Operate,
    session::Session,
    soc::Width,
    time::VirtualNanos,
};

use crate::{
    device::Chip,
    network::{Deed, Input, Order, Report, Shared},
    peripheral::{Names, Pc, Peer},
    processor::{Lease, Program},
    soc::{self, Board, Soc},
};

/// Part of the flash that programs write here: its last 76 KiB.
pub const MEMORY: Range<u64> = 0xe_d000..0x10_0000;
/// UICR.
pub const SETTINGS: Range<u64> = 0x1000_1000..0x1000_2000;

/// A loop that reads the same value so often waits for a model: time goes on to its next event.
const POLLS: u32 = 8;
/// Time that is not worth that, nanoseconds.
const SHORT: u64 = 2_000;

/// A chip and what is around it.
#[derive(Default)]
pub struct Node {
    /// Program, an ELF file.
    pub image: PathBuf,
    /// Other contents of the flash and UICR when power comes: addresses and bytes.
    pub flash: Vec<(u64, Vec<u8>)>,
    /// The program, where it is written while it runs, and the rest of the flash that is: both are in `flash` then. By
    /// default the program is not written, and the rest is [`MEMORY`].
    pub parts: Option<[Range<u64>; 2]>,
    /// At the other end of UARTE0.
    pub peer: Option<Box<dyn Peer>>,
    /// At the USB plug, from power-on.
    pub pc: Option<Pc>,
    /// On the bus of TWIM0, by their addresses.
    pub chips: BTreeMap<u32, Box<dyn Chip>>,
    /// Seed of the chip's random numbers, besides its number.
    pub seed: u64,
    /// Error of its clocks, 1e-9, positive if they are fast.
    pub drift_ppb: i32,
    /// Fault of the chip.
    pub faults: Option<fn(&mut Soc)>,
    /// Port where GDB connects, for which the first instruction waits: this chip stands still while GDB looks at
    /// it, and so does the time of all others.
    pub debugger: Option<TcpListener>,
    /// Once this is set it ends by itself, also while it waits for GDB.
    pub end: Option<Arc<AtomicBool>>,
}

impl fmt::Debug for Node {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("Node")
            .field("image", &self.image)
            .finish_non_exhaustive()
    }
}

/// Time as a chip's clocks show it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Time {
    /// Time when power came.
    pub since: u64,
    /// Error of the clocks, 1e-9, positive if they are fast.
    pub drift_ppb: i32,
}

impl Time {
    const BILLION: u128 = 1_000_000_000;

    fn rate(self) -> u128 {
        Self::BILLION.saturating_add_signed(self.drift_ppb.into())
    }

    /// Nanoseconds since power came, as they count at an instant.
    pub fn local(self, truth: u64) -> u64 {
        let passed = u128::from(truth.saturating_sub(self.since));
        (passed * self.rate() / Self::BILLION) as u64
    }

    /// The first instant at which they show that time.
    fn truth(self, local: u64) -> u64 {
        let passed = (u128::from(local) * Self::BILLION).div_ceil(self.rate());
        let passed = u64::try_from(passed).unwrap_or(u64::MAX);
        self.since.saturating_add(passed)
    }
}

/// A restart of the chip.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reset {
    /// Time, nanoseconds.
    pub at: u64,
    /// Cause: `Core` for the program, `Lockup`, or the peripheral.
    pub by: String,
}

/// Outcome of a chip's run.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Bytes on UARTE0, and the times when they were out.
    pub line: Vec<(u64, u8)>,
    /// Bytes to the PC at the USB plug, and the times.
    pub plug: Vec<(u64, u8)>,
    /// Names that the PC at the plug heard of its device.
    pub names: Option<Names>,
    /// Bytes of the first channel of RTT.
    pub log: Vec<u8>,
    /// Uses that the Product Specification forbids, or that are not modelled: the peripheral, the register and the
    /// use.
    pub forbidden: Vec<(&'static str, &'static str, &'static str)>,
    /// Accesses where nothing is.
    pub unmapped: Vec<String>,
    /// Restarts.
    pub resets: Vec<Reset>,
    /// Pages erased: times and addresses.
    pub erased: Vec<(u64, u64)>,
    /// Words written to the flash.
    pub written: u64,
    /// Times from begin to end of its writes and erasures; those that a loss of power interrupts are torn.
    pub operations: Vec<Range<u64>>,
    /// Frames received well, and spoilt.
    pub received: [u64; 2],
    /// Time for which it had power, nanoseconds.
    pub powered: u64,
    /// Times for which the radio received and sent, nanoseconds.
    pub radio_on: [u64; 2],
    /// Times for which receiver or transmitter of UARTE0 were started and had not stopped, and bytes were on its line,
    /// nanoseconds.
    pub uart_on: [u64; 2],
    /// Times for which TIMER1 needed its clock, and the program asked for the high-frequency crystal, nanoseconds.
    pub clock_on: [u64; 2],
    /// The pin over which UARTE0 has sent is driven by nothing at the end: what listens there hears noise.
    pub floats: bool,
    /// Number of times that the watchdog was fed.
    pub fed: u64,
    /// Bytes that found no room in UARTE0.
    pub overruns: u64,
    /// Transfers of TWIM0.
    pub transfers: u64,
    /// Instructions.
    pub instructions: u64,
    /// [`MEMORY`] and [`SETTINGS`] at the end, for [`Node::flash`]: power may have been cut there.
    pub flash: Vec<(u64, Vec<u8>)>,
    /// Bytes at the start of the RAM, where the stack ends, that were never written.
    pub untouched: u64,
    /// Bytes from there to the begin of the stack.
    pub stack: u64,
}

/// Runs one chip, which has had power since an instant, until it is told to stop.
pub(crate) fn run(
    number: usize,
    node: Node,
    since: u64,
    shared: Arc<Shared>,
) -> Result<Outcome, String> {
    let text = |error: &dyn fmt::Display| error.to_string();
    let mut soc = Soc::new(number, node.peer, node.pc, node.chips).map_err(|error| text(&error))?;
    soc.draw_from(node.seed ^ (number as u64 + 1), since);
    if let Some(faults) = node.faults {
        faults(&mut soc);
    }
    // A program that is written while it runs is in the flash already: the file only tells where its log is.
    let program = match node.parts {
        None => vec![Image::read(&node.image, None).map_err(|error| text(&error))?],
        Some(_) => Vec::new(),
    };
    let addresses = { node.parts.as_ref() }.map_or(0..MEMORY.start, |[program, _]| program.clone());
    let pieces = { node.flash.iter() }
        .filter(|(at, _)| addresses.contains(at))
        .flat_map(|(at, bytes)| [at.to_le_bytes().to_vec(), bytes.clone()]);
    let pieces: Vec<_> = { program.iter() }
        .map(|program| program.bytes().to_vec())
        .chain(pieces)
        .collect();
    let processor = Lease::default();
    let board = Board {
        soc,
        processor: processor.clone(),
        program: Program::new(pieces.iter().map(Vec::as_slice), addresses),
    };
    let session = Session::new(Box::new(board), 0, VirtualNanos(1));
    let session = session.map_err(|error| text(&error))?;
    let mut images = program;
    let info = (soc::FICR, soc::ficr(number));
    for (address, bytes) in node.flash.into_iter().chain([info]) {
        let name = format!("{address:#x}");
        let image = Image::new(Path::new(&name), bytes, Some(address));
        images.push(image.map_err(|error| text(&error))?);
    }
    let driver = Run {
        number,
        memory: node.parts.map_or_else(|| vec![MEMORY], Vec::from),
        time: Time {
            since,
            drift_ppb: node.drift_ppb,
        },
        resets: 0,
        flips: 0,
        is_to_stand: false,
        stands: None,
        told: [0; 2],
        shared,
        processor,
        rtt: rtt(&node.image),
        outcome: Outcome::default(),
        last: (0, 0, 0),
        polls: 0,
        hold: None,
    };
    let mut start = Start::new(&images);
    start.debugger = node.debugger.as_ref();
    start.wait_for_debugger = start.debugger.is_some();
    start.interrupt = node.end.as_deref();
    let finished = emulator::run(session, &start, driver);
    let finished = finished.map_err(|error| text(&error))?;
    let session = &finished.session;
    let soc = &session.board().soc;
    let end = finished.stop.map_or(0, |stop| stop.at.0);
    let told = session
        .told()
        .map(|told: &Told| (told.instance, told.register, told.reason));
    Ok(Outcome {
        forbidden: told.collect(),
        unmapped: session.unmapped().iter().map(ToString::to_string).collect(),
        resets: (session.resets().iter())
            .map(|reset| Reset {
                at: reset.at.0,
                by: soc.by(reset.at, reset.cause),
            })
            .collect(),
        line: soc.uarte.model.sent.clone(),
        plug: soc.usbd.model.sent.clone(),
        names: soc.usbd.model.pc().and_then(|pc| pc.names().cloned()),
        overruns: soc.uarte.model.overruns,
        erased: soc.nvmc.model.erased.clone(),
        written: soc.nvmc.model.words,
        operations: soc.nvmc.model.operations.clone(),
        received: soc.radio.model.received,
        radio_on: soc.radio.model.on_until(end),
        uart_on: [
            soc.uarte.model.started_until(end),
            soc.uarte.model.transferred,
        ],
        clock_on: [
            soc.timer.model.clocked.until(end),
            soc.clock.model.asked.until(end),
        ],
        floats: { soc.uarte.model.left() }.is_some_and(|pin| !soc.gpio.model.drives(pin)),
        powered: end,
        fed: soc.watchdog.model.fed,
        transfers: soc.twim.model.transfers,
        instructions: finished.stop.map_or(0, |stop| stop.instruction_count),
        ..finished.driver.outcome
    })
}

/// Address of the control block of RTT, if the image has one.
fn rtt(image: &Path) -> Option<u64> {
    let bytes = std::fs::read(image).ok()?;
    let file = object::File::parse(bytes.as_slice()).ok()?;
    let symbol = file.symbol_by_name("_SEGGER_RTT")?;
    Some(symbol.address())
}

struct Run {
    number: usize,
    /// Parts of the flash that the program writes.
    memory: Vec<Range<u64>>,
    time: Time,
    /// Number of resets that were told.
    resets: usize,
    /// Number of times that bits of its flash have flipped.
    flips: usize,
    /// True if it is to stand in the middle of the next work on the flash; since when it does, and the duration of
    /// that work.
    is_to_stand: bool,
    stands: Option<(u64, u64)>,
    /// Amounts of the pins' changes and of the log that were told.
    told: [usize; 2],
    shared: Arc<Shared>,
    processor: Lease,
    rtt: Option<u64>,
    outcome: Outcome,
    /// Address, value and program counter of the last read.
    last: (u64, u64, u64),
    polls: u32,
    /// Time until which the processor stands still, and true if nothing wakes it.
    hold: Option<(u64, bool)>,
}

impl Run {
    /// Bytes that the program wrote to the first channel (SEGGER RTT: the control block, and a ring).
    fn drain(&mut self, host: &mut dyn Host) -> Option<()> {
        let mut word = |at: u64| host.read(at, Width::W32).ok();
        let block = self.rtt?;
        if !(1..=16).contains(&word(block + 16)?) {
            return None;
        }
        let [buffer, size, write, mut read] =
            [28, 32, 36, 40].map(|at| word(block + at).unwrap_or(0));
        if write >= size || read >= size || write == read {
            return None;
        }
        while read != write {
            let byte = host.read(buffer + read, Width::W8).ok()?;
            self.outcome.log.push(byte as u8);
            read = (read + 1) % size;
        }
        host.write(block + 40, Width::W32, read).ok()
    }

    fn hold(&mut self, until: u64, is_firm: bool, host: &mut dyn Host) {
        host.hold(true);
        self.hold = Some((until, is_firm));
    }

    /// Deeds since this was last asked.
    fn deeds(&mut self, session: &mut Session<Board>, now: u64) -> Vec<(u64, Deed)> {
        let resets = session.resets().iter().skip(self.resets);
        let soc = &session.board().soc;
        let resets: Vec<_> = resets
            .map(|reset| (reset.at.0, soc.by(reset.at, reset.cause)))
            .collect();
        self.resets += resets.len();
        let soc = &mut session.board_mut().soc;
        let settings = &mut soc.nvmc.model.has_settings;
        let mut deeds = Vec::new();
        for (at, by) in resets {
            deeds.push((at, Deed::Reset(by, core::mem::take(settings))));
        }
        let time = self.time;
        for mut frame in core::mem::take(&mut soc.radio.model.sent) {
            let starts = frame.start;
            frame.start = time.truth(starts);
            deeds.push((starts, Deed::Sends(frame)));
        }
        let begun = core::mem::take(&mut soc.uarte.model.begun);
        deeds.extend(
            begun
                .into_iter()
                .map(|(at, bytes)| (at, Deed::Bytes(bytes))),
        );
        let uart = core::mem::take(&mut soc.uarte.model.wired);
        deeds.extend(uart.into_iter().map(|(at, wires)| (at, Deed::Uart(wires))));
        let i2c = core::mem::take(&mut soc.twim.model.wired);
        deeds.extend(i2c.into_iter().map(|(at, wires)| (at, Deed::I2c(wires))));
        let [pins, log] = &mut self.told;
        let changes = soc.gpio.model.changes.iter().skip(*pins);
        deeds.extend(changes.map(|&(at, port, level)| (at, Deed::Pins(port, level))));
        *pins = soc.gpio.model.changes.len();
        if *log < self.outcome.log.len() {
            deeds.push((now, Deed::Log(self.outcome.log[*log..].to_vec())));
            *log = self.outcome.log.len();
        }
        if let Some((since, takes)) = self.stands.take() {
            deeds.push((since, Deed::Writes(takes)));
        }
        for (at, _) in &mut deeds {
            *at = time.truth(*at);
        }
        deeds
    }

    /// Returns true if it did something that others may answer.
    fn is_seen(&self, soc: &Soc) -> bool {
        !soc.radio.model.sent.is_empty()
            || !soc.uarte.model.begun.is_empty()
            || soc.gpio.model.changes.len() > self.told[0]
            || self.stands.is_some()
    }

    /// Parts of the flash that programs write.
    fn memory(&self, host: &mut dyn Host) -> Vec<(u64, Vec<u8>)> {
        let mut word = |at| host.read(at, Width::W32).unwrap_or(0) as u32;
        let ranges = self.memory.iter().cloned().chain([SETTINGS]);
        let contents = ranges.map(|range| {
            let start = range.start;
            let words = range.step_by(4).flat_map(|at| word(at).to_le_bytes());
            (start, words.collect())
        });
        contents.collect()
    }

    /// Contents of the flash when power goes.
    fn end(&mut self, host: &mut dyn Host) {
        self.outcome.flash = self.memory(host);
        let mut word = |at| host.read(at, Width::W32).unwrap_or(0) as u32;
        let (start, size) = soc::RAM;
        let words = (start..start + size).step_by(4);
        let begins = u64::from(word(0));
        self.outcome.stack = begins.saturating_sub(start);
        self.outcome.untouched = 4 * words.take_while(|&at| word(at) == 0).count() as u64;
    }
}

impl Driver<Board> for Run {
    fn on_settled(&mut self, session: &mut Session<Board>, host: &mut dyn Host, settled: Settled) {
        match settled {
            Settled::Access { access, value } => {
                let now = access.virtual_time.0;
                let soc = &mut session.board_mut().soc;
                let busy = soc.nvmc.model.busy_until();
                let key = (access.address, value, access.program_counter.unwrap_or(0));
                let is_same = access.kind == AccessKind::Read && key == self.last;
                self.polls = if is_same { self.polls + 1 } else { 0 };
                self.last = key;
                if busy > now && core::mem::take(&mut self.is_to_stand) {
                    self.end(host);
                    self.stands = Some((now, busy - now));
                    self.hold(u64::MAX, true, host);
                } else if busy > now {
                    // The processor cannot fetch (Product Specification, "NVMC").
                    self.hold(busy, true, host);
                } else if self.polls >= POLLS {
                    self.polls = 0;
                    soc.wake(access.virtual_time, access.address);
                    // Here nothing happens until another chip or the caller does something.
                    let next = soc.next_event().map_or(u64::MAX, |next| next.0);
                    if next > now + SHORT {
                        self.hold(next, false, host);
                    }
                }
            }
            Settled::Stop(stop) => {
                let is_over = self.hold.is_some_and(|(until, _)| stop.at.0 >= until);
                if is_over {
                    self.hold = None;
                    host.hold(false);
                }
                self.drain(host);
            }
            _ => {}
        }
        if self.is_seen(&session.board().soc) {
            // At once.
            session.run_until(VirtualNanos(0));
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Board>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        self.drain(host);
        let deeds = self.deeds(session, stop.at.0);
        let now = self.time.truth(stop.at.0);
        let soc = &session.board().soc;
        let is_idle = stop.reason == StopReason::Idle || self.hold.is_some();
        let next = if is_idle && !soc.is_interrupted() {
            let next = soc.next_event();
            next.map_or(u64::MAX, |next| self.time.truth(next.0))
        } else {
            now
        };
        let mut report = Report {
            reached: now,
            next: next.max(now),
            deeds,
            changes: soc.nvmc.model.operations.len() + self.flips,
            shown: None,
        };
        let (until, inputs) = loop {
            let (next, changes) = (report.next, report.changes);
            let leave = || self.processor.leave();
            match self.shared.report(self.number, report, leave) {
                Some(Order::Run { until, inputs }) => break (until, inputs),
                Some(Order::Show) => {
                    report = Report {
                        reached: now,
                        next,
                        deeds: Vec::new(),
                        changes,
                        shown: Some(self.memory(host)),
                    };
                }
                None => {
                    // Unless power has gone before, as far as the flash is concerned.
                    if self.outcome.flash.is_empty() {
                        self.end(host);
                    }
                    return None;
                }
            }
        };
        for input in inputs {
            self.take(input, session, stop.at, host);
        }
        if let Some((until, false)) = &mut self.hold {
            // The next event may be what the program waits for.
            let next = session.board().soc.next_event();
            *until = (*until).min(next.map_or(u64::MAX, |next| next.0));
        }
        Some(VirtualNanos(self.time.local(until)))
    }
}

impl Run {
    /// Something happens to the chip.
    fn take(
        &mut self,
        input: Input,
        session: &mut Session<Board>,
        now: VirtualNanos,
        host: &mut dyn Host,
    ) {
        let time = self.time;
        let soc = &mut session.board_mut().soc;
        match input {
            Input::Frame(mut frame, arrival) => {
                frame.start = time.local(frame.start);
                soc.hear(now, frame, arrival);
            }
            Input::CutOff(node) => soc.radio.model.cut_off(node, now.0),
            Input::Byte(at, byte) => soc.deliver(now, byte, time.local(at)),
            Input::StandInWrite => self.is_to_stand = true,
            Input::Jammed(until, frequency) => {
                soc.radio.model.jam(time.local(until), frequency);
            }
            Input::Pulls(at, port, low) => soc.pull(now, time.local(at), port, low),
            Input::WearOut => soc.nvmc.model.worn = Some(MEMORY),
            Input::Rot(bits) => {
                for (address, bit) in bits {
                    let at = address & !3;
                    let turned = 1 << (8 * (address - at) + u64::from(bit & 7));
                    // Where there is no flash nothing can flip.
                    if let Ok(word) = host.read(at, Width::W32) {
                        let _ = host.program(at, Width::W32, word ^ turned);
                    }
                }
                self.flips += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use tempfile::{NamedTempFile, TempPath};

    use super::*;
    use crate::Network;

    /// CLOCK, RTC1, and some registers of NVMC and GPIO.
    const CLOCK: u32 = 0x4000_0000;
    const RTC: u32 = 0x4001_1000;
    const NVMC: u32 = 0x4001_e500;
    const PINS: u32 = 0x5000_0500;
    const DIRSET: u16 = 0x18;
    /// Sleeps for ever.
    const STAY: [u16; 2] = [0xbf30, 0xe7fd];
    const MS: u64 = 1_000_000;

    /// Puts a number into a register.
    fn set(register: u16, number: u32) -> [u16; 4] {
        let half = |code: u16, half: u16| {
            let code = code | (half >> 11 & 1) << 10 | half >> 12;
            [code, (half >> 8 & 7) << 12 | register << 8 | half & 0xff]
        };
        let ([a, b], [c, d]) = (
            half(0xf240, number as u16),
            half(0xf2c0, (number >> 16) as u16),
        );
        [a, b, c, d]
    }

    /// Stores R1 to where R0 points, and loads R3 from where R2 does.
    fn store(offset: u16) -> u16 {
        0x6001 | (offset / 4) << 6
    }

    fn load(offset: u16) -> u16 {
        0x6813 | (offset / 4) << 6
    }

    /// R3 is loaded until it is R4 at least.
    fn until(offset: u16) -> [u16; 3] {
        [load(offset), 0x42a3, 0xd3fc]
    }

    /// An image of a program, as long as it is kept; `fault` is where it goes on after a fault, in halves of a word.
    fn image(code: &[u16], fault: usize) -> TempPath {
        const VECTORS: u32 = 64;
        let mut bytes: Vec<u8> = (0..VECTORS / 4)
            .map(|vector| match vector {
                0 => 0x2000_1000,
                1 => VECTORS | 1,
                _ => (VECTORS + 2 * fault as u32) | 1,
            })
            .flat_map(u32::to_le_bytes)
            .collect();
        bytes.extend(code.iter().flat_map(|half| half.to_le_bytes()));
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        // System V ABI, "ELF Header", "Program Header": one segment, for an ARM.
        let length = bytes.len() as u32;
        let halves = |ones: [u16; 2]| u32::from(ones[0]) | u32::from(ones[1]) << 16;
        let header = [
            &[u32::from_le_bytes(*b"\x7fELF"), 0x0001_0101, 0, 0][..],
            &[halves([2, 40]), 1, VECTORS | 1, 52, 0, 0x0500_0200],
            &[halves([52, 32]), halves([1, 40]), 0],
            &[1, 84, 0, 0, length, length, 5, 4],
        ]
        .concat();
        let header = header.into_iter().flat_map(u32::to_le_bytes);
        let image = NamedTempFile::new().unwrap().into_temp_path();
        fs::write(&image, header.chain(bytes).collect::<Vec<_>>()).unwrap();
        image
    }

    /// Runs a program, for so long. Returns the times when it changed its pins, and its outcome.
    fn run(code: &[u16], fault: usize, time: u64) -> (Vec<u64>, Outcome) {
        let image = image(code, fault);
        let mut network = Network::default();
        let node = Node {
            image: image.to_path_buf(),
            ..Node::default()
        };
        network.switch_on(0, node, 0);
        let mut changed = Vec::new();
        while network.reached() < time {
            for (at, _, deed) in network.run(time) {
                match deed {
                    Deed::Pins(..) => changed.push(at),
                    Deed::Fails(why) => panic!("{why}"),
                    _ => {}
                }
            }
        }
        let outcome = network.switch_off(0).unwrap().unwrap();
        (changed, outcome)
    }

    /// A loop that waits for the counter is as long as it should be, though nothing else happens, and one that
    /// waits for an event is skipped.
    #[test]
    fn a_busy_wait_ends_in_its_time() {
        let code = [
            &set(0, CLOCK)[..],
            &set(1, 1),
            &[store(8)],
            &set(2, CLOCK + 0x104),
            &set(4, 1),
            &until(0),
            &set(0, RTC),
            &[store(0)],
            &set(2, RTC + 0x504),
            &set(4, 1_000),
            &until(0),
            &set(0, PINS),
            &[store(DIRSET)],
            &STAY,
        ]
        .concat();
        let (changed, outcome) = run(&code, 0, 100 * MS);
        // After the oscillator starts, 1,000 ticks of 32,768 Hz.
        let [at] = changed[..] else {
            panic!("{changed:?}");
        };
        let waited = at - 600_000;
        assert!((30_517_578..30_530_000).contains(&waited), "{waited}");
        // A tick is 1,953 instructions.
        assert!(
            outcome.instructions < 100 * 1_000,
            "{}",
            outcome.instructions
        );
    }

    /// An event at the first instant at which a clock shows a time is seen at that time.
    #[test]
    fn clocks_drift_and_come_back() {
        for drift_ppb in [0, 40_000, -40_000, 500_000] {
            let time = Time {
                since: 7_000_000_000,
                drift_ppb,
            };
            for truth in [
                7_000_000_000,
                7_000_000_001,
                8_000_000_000,
                3_607_000_000_000,
            ] {
                let local = time.local(truth);
                let first = time.truth(local);
                assert!(first <= truth && time.local(first) == local, "{truth}");
            }
            let hour = time.local(3_607_000_000_000) as i64 - 3_600_000_000_000;
            assert_eq!(hour, 3_600 * i64::from(drift_ppb));
        }
    }

    /// STM to the flash: the processor stands still until both words are written.
    #[test]
    fn an_instruction_writes_two_words() {
        let at = MEMORY.start as u32;
        let code = [
            &set(0, NVMC)[..],
            &set(1, 1),
            &[store(4)],
            &set(0, at),
            &set(1, 0x1234_5678),
            &set(2, 0x9abc_def0),
            &[0xc006],
            &set(0, PINS),
            &set(1, 1),
            &[store(DIRSET)],
            &STAY,
        ]
        .concat();
        let (changed, outcome) = run(&code, 0, MS);
        let [first, second] = &outcome.operations[..] else {
            panic!("{:?}", outcome.operations);
        };
        assert_eq!(first.end, second.start);
        assert!(changed[0] > second.end && changed[0] < second.end + 1_000);
        let (start, bytes) = &outcome.flash[0];
        assert_eq!(*start, u64::from(at));
        assert_eq!(bytes[..8], 0x9abc_def0_1234_5678_u64.to_le_bytes());
        assert_eq!(outcome.forbidden, []);
    }

    /// UDF, here and in the handler of what it raises: the processor locks up, and RESETREAS says so.
    #[test]
    fn a_lockup_restarts_the_chip() {
        let code = [
            &set(2, CLOCK + 0x400)[..],
            &set(1, 1),
            &set(0, PINS),
            &set(4, 8),
            // Once it says so, a pin changes.
            &[load(0), 0x42a3, 0xd102, store(DIRSET)],
            &STAY,
            &[0xde00],
        ]
        .concat();
        let fault = code.len() - 1;
        let (changed, outcome) = run(&code, fault, MS);
        assert_eq!(changed.len(), 1);
        assert_eq!(outcome.resets.len(), 1, "{:?}", outcome.resets);
        assert_eq!(outcome.resets[0].by, "Lockup");
    }

    /// An access to nothing ends in the handler of a fault, and is told.
    #[test]
    fn nowhere_is_a_bus_fault() {
        for (address, is_fault) in [
            (0x6000_0000, true),
            (0x2004_0000, true),
            (0x10_0000, true),
            (0x4000_0400, false),
            (0x2003_fffc, false),
            (0xf_fffc, false),
        ] {
            let code = [
                &set(0, PINS)[..],
                &set(1, 1),
                &set(2, address),
                &[load(0)],
                &STAY,
                &[store(DIRSET)],
                &STAY,
            ]
            .concat();
            let (changed, outcome) = run(&code, code.len() - 3, MS);
            assert_eq!(changed.len(), usize::from(is_fault), "{address:x}");
            assert_eq!(outcome.unmapped.len(), usize::from(is_fault), "{address:x}");
        }
    }

    /// Something at the end of the line that panics when this much is over.
    #[derive(Debug)]
    struct Panics(u64);

    impl Peer for Panics {
        fn receive(&mut self, _: u8, _: u64) {}

        fn transmit(&mut self, now: u64) -> Option<u8> {
            assert!(now < self.0, "planted at {now}");
            None
        }

        fn next(&self) -> Option<u64> {
            Some(self.0)
        }
    }

    /// A panic of a model ends its chip with its words. Others go on, also with the same processor, and the chip can
    /// have power again.
    #[test]
    fn a_model_that_panics_ends_its_chip_alone() {
        // A pin changes every 64 ms, by RTC1; UARTE0 listens.
        const UARTE: u32 = 0x4000_2000;
        let code = [
            &set(0, UARTE)[..],
            &set(1, 1),
            &set(2, UARTE + 0x500),
            &set(3, 8),
            // STR R3, [R2]: ENABLE; PSEL.RXD; RXD.PTR and MAXCNT; STARTRX.
            &[0x6013],
            &set(2, UARTE + 0x514),
            &[0x6011],
            &set(2, UARTE + 0x534),
            &set(3, 0x2000_0000),
            &[0x6013],
            &set(2, UARTE + 0x538),
            &[0x6011],
            &[store(0)],
            &STAY,
        ]
        .concat();
        let image = image(&code, 0);
        let node = |peer: Option<u64>| Node {
            image: image.to_path_buf(),
            peer: peer.map(|at| Box::new(Panics(at)) as Box<dyn Peer>),
            ..Node::default()
        };
        let mut network = Network::default();
        network.switch_on(0, node(Some(35 * MS)), 0);
        network.switch_on(1, node(None), 0);
        let mut failed = Vec::new();
        while network.reached() < 100 * MS {
            for (at, number, deed) in network.run(100 * MS) {
                if let Deed::Fails(why) = deed {
                    failed.push((at, number, why));
                }
            }
        }
        let [(at, 0, why)] = &failed[..] else {
            panic!("{failed:?}");
        };
        // Told as of when all others had run.
        assert!(*at < 36 * MS, "{at}");
        assert!(why.contains("a model panicked: planted at 35"), "{why}");
        assert!(network.switch_off(0).is_none());
        network.switch_on(0, node(None), 0);
        while network.reached() < 150 * MS {
            for (_, number, deed) in network.run(150 * MS) {
                assert!(!matches!(deed, Deed::Fails(_)), "{number}: {deed:?}");
            }
        }
        for number in [0, 1] {
            let outcome = network.switch_off(number).unwrap().unwrap();
            assert!(outcome.instructions > 10, "{number}");
        }
    }

    /// After any error of a program, it restarts or stays where it is; what emulates it goes on.
    #[test]
    fn a_program_that_goes_wrong_ends_nothing_but_itself() {
        // BX R0, of an address of Thumb code; then what a fault leads to.
        let jump = |to: u32| [&set(0, to | 1)[..], &[0x4700]].concat();
        let programs = [
            // To nowhere, a peripheral, RAM that holds nothing, the processor's own registers.
            ("nowhere", jump(0x6000_0000)),
            ("peripheral", jump(CLOCK)),
            ("ram", jump(0x2000_2000)),
            ("own", jump(0xe000_e000)),
            // To ARM code, of which there is none: BX R0 with an even address.
            ("arm", [&set(0, 64)[..], &[0x4700]].concat()),
            // BKPT without a debugger; and the one of semihosting.
            ("breakpoint", vec![0xbe00]),
            ("semihosting", vec![0xbeab]),
            // SVC.
            ("call", vec![0xdf00]),
            // The stack is nowhere when a fault comes: MOV SP, R0, UDF.
            (
                "stack",
                [&set(0, 0x6000_0000)[..], &[0x4685, 0xde00]].concat(),
            ),
            // It restarts itself: AIRCR, SYSRESETREQ.
            (
                "restart",
                [
                    &set(2, 0xe000_ed0c)[..],
                    &set(1, 0x05fa_0004),
                    &[0x6011, 0xbf30, 0xe7fd],
                ]
                .concat(),
            ),
            // It writes to its own flash without asking: STR R1, [R0].
            (
                "overwrites",
                [&set(0, 64)[..], &set(1, 0), &[0x6001], &STAY].concat(),
            ),
        ];
        for (name, mut code) in programs {
            let fault = code.len();
            code.extend(STAY);
            let (_, outcome) = run(&code, fault, 2 * MS);
            // A breakpoint without a debugger stands still.
            assert!(outcome.powered > 0, "{name}");
        }
    }
}
