//! Chips of the crate `nrf52840-emulator` for a simulation.

use std::{
    collections::BTreeMap,
    net::{Ipv4Addr, TcpListener},
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use defmt_decoder::{DecodeError, Encoding, Table};
use nrf52840_emulator::{
    self as emulator, Input, Network, Node, Outcome, Time,
    device::{self, NOT_ACKNOWLEDGED, Samples, World},
    peripheral::{self, Arrival, Wire},
};

use super::outside::{
    Contents, Deed, Emulator, End, Frame, Motion, Order, Reception, Reports, Wires,
};

/// Sensitivity of the scale of levels, dBm (Product Specification, "RADIO", `ED_RSSIOFFS`), and its end.
const WEAKEST: i16 = -92;
const STRONGEST: i16 = 63;

/// Channel 11 is at 2405 MHz, and all are 5 MHz apart (IEEE 802.15.4-2020, 10.1.3.3).
const SPACING: u32 = 5;
const BELOW: u32 = 10;

/// A chip, with power or without.
#[derive(Default)]
struct Chip {
    /// Contents of its flash when its power went, and what else was known then.
    flash: Vec<Contents>,
    end: End,
    /// Bytes that it has sent of the next line of its log.
    log: Vec<u8>,
    /// Time on its clocks, and the motions that its step sensor feels by them.
    time: Time,
    world: Arc<Samples>,
    has_no_sensor: Arc<AtomicBool>,
    is_worn: bool,
}

/// A chip of a step sensor, which may be taken off its bus.
#[derive(Debug)]
struct Pluggable {
    chip: Box<dyn device::Chip>,
    is_out: Arc<AtomicBool>,
}

impl device::Chip for Pluggable {
    fn write(&mut self, bytes: &[u8], now: u64) -> Result<(), &'static str> {
        match self.is_out.load(Ordering::Relaxed) {
            true => Err(NOT_ACKNOWLEDGED),
            false => self.chip.write(bytes, now),
        }
    }

    fn read(&mut self, into: &mut [u8], now: u64) {
        self.chip.read(into, now);
    }
}

/// All chips of a simulation.
pub(super) struct Chips {
    image: PathBuf,
    /// Table that turns the program's log into text.
    table: Arc<Table>,
    network: Network,
    all: BTreeMap<u32, Chip>,
    /// Deeds that chips leave whose power has just gone.
    left: Vec<(u64, u32, Deed)>,
    /// The chip that waits for GDB, its port, and the flag that ends this.
    debugged: Option<(u32, u16, Arc<AtomicBool>)>,
}

impl Chips {
    /// Chips with this program, of which these are the bytes; `None` if its log cannot be read.
    pub(super) fn new(image: PathBuf, bytes: &[u8]) -> Option<Self> {
        let table = Table::parse(bytes).ok().flatten();
        let table = table.filter(|table| table.encoding() == Encoding::Rzcobs)?;
        Some(Self {
            image,
            table: Arc::new(table),
            network: Network::default(),
            all: BTreeMap::new(),
            left: Vec::new(),
            debugged: None,
        })
    }

    fn obey(&mut self, number: u32, order: Order) {
        let index = number as usize;
        match order {
            Order::On {
                at,
                seed,
                drift_ppb,
                has_sensor,
                programmed,
            } => {
                let chip = self.all.entry(number).or_default();
                chip.log.clear();
                chip.time = Time {
                    since: self.network.reached().max(at),
                    drift_ppb,
                };
                chip.world = Arc::default();
                let world: Arc<dyn World> = chip.world.clone();
                let sensor = has_sensor.then(|| device::step_sensor(&world, seed));
                let chips = sensor.unwrap_or_default().into_iter();
                let chips = chips.map(|(address, inner)| {
                    let is_out = chip.has_no_sensor.clone();
                    let chip: Box<dyn device::Chip> = Box::new(Pluggable {
                        chip: inner,
                        is_out,
                    });
                    (address, chip)
                });
                let mut flash = chip.flash.clone();
                for (address, bytes) in programmed {
                    program(&mut flash, address, &bytes);
                }
                let debugged = self.debugged.as_ref();
                let debugged = debugged.filter(|(chip, ..)| *chip == number);
                let debugger = debugged
                    .map(|(_, port, _)| TcpListener::bind((Ipv4Addr::LOCALHOST, *port)))
                    .transpose();
                let debugger = match debugger {
                    Ok(debugger) => debugger,
                    Err(error) => {
                        let why = format!("GDB cannot connect to it: {error}");
                        let now = self.network.reached();
                        return self.left.push((now, number, Deed::Fails(why)));
                    }
                };
                let node = Node {
                    image: self.image.clone(),
                    flash,
                    debugger,
                    end: debugged.map(|(.., end)| end.clone()),
                    peer: Some(Box::new(Wire::default())),
                    chips: chips.collect(),
                    seed,
                    drift_ppb,
                    ..Node::default()
                };
                self.network.switch_on(index, node, at);
                if chip.is_worn {
                    self.network.input(index, Input::WearOut);
                }
            }
            Order::Off => {
                if let Some(outcome) = self.network.switch_off(index)
                    && let Some(chip) = self.all.get_mut(&number)
                {
                    let left = match outcome {
                        Ok(outcome) => {
                            chip.ends(outcome);
                            Deed::Memory(chip.flash.clone())
                        }
                        Err(why) => Deed::Fails(why),
                    };
                    self.left.push((self.network.reached(), number, left));
                }
            }
            Order::Bytes { at, every, bytes } => {
                for (place, byte) in (0..).zip(bytes) {
                    let input = Input::Byte(at + place * every, byte);
                    self.network.input(index, input);
                }
            }
            Order::Frame(frame, reception) => {
                let Reception {
                    from,
                    level,
                    is_lost,
                    is_faint,
                    stands_out,
                    spoils,
                } = reception;
                let arrival = Arrival {
                    level: (i16::from(level) - WEAKEST).clamp(0, STRONGEST) as u8,
                    is_faint,
                    stands_out,
                    spoils: Some(spoils.into_iter().map(|node| node as usize).collect()),
                };
                let mut psdu = frame.psdu;
                if is_lost && let Some(last) = psdu.last_mut() {
                    // Its frame check sequence does not fit.
                    *last = !*last;
                }
                let frame = peripheral::Frame {
                    start: frame.start,
                    node: from as usize,
                    frequency: frequency(frame.channel),
                    power: 0,
                    psdu,
                };
                self.network.input(index, Input::Frame(frame, arrival));
            }
            Order::CutOff(from) => {
                for &other in self.all.keys().filter(|other| **other != number) {
                    let input = Input::CutOff(from as usize);
                    self.network.input(other as usize, input);
                }
            }
            Order::StandInWrite => self.network.input(index, Input::StandInWrite),
            Order::Jammed { until, channel } => {
                let input = Input::Jammed(until, channel.map(frequency));
                self.network.input(index, input);
            }
            Order::Pulls { at, port, low } => {
                self.network.input(index, Input::Pulls(at, port, low));
            }
            Order::Rot(bits) => {
                // Without power, bits flip in the contents that it left.
                if let Some(chip) = self.all.get_mut(&number) {
                    chip.rot(&bits);
                }
                self.network.input(index, Input::Rot(bits));
            }
            Order::WearOut => {
                if let Some(chip) = self.all.get_mut(&number) {
                    chip.is_worn = true;
                }
                self.network.input(index, Input::WearOut);
            }
            Order::UnplugSensor(out) => {
                let chip = self.all.entry(number).or_default();
                chip.has_no_sensor.store(out, Ordering::Relaxed);
            }
            Order::Moves(motions) => {
                if let Some(chip) = self.all.get(&number) {
                    chip.moves(&motions);
                }
            }
        }
    }

    /// Returns true if it waits for GDB no longer, and does not go on.
    fn is_given_up(&self, number: u32) -> bool {
        let debugged = self.debugged.as_ref();
        debugged.is_some_and(|(chip, _, end)| *chip == number && end.load(Ordering::Relaxed))
    }
}

impl Emulator for Chips {
    fn debug(&mut self, chip: u32, port: u16, end: Arc<AtomicBool>) {
        self.debugged = Some((chip, port, end));
    }

    fn run(&mut self, orders: Vec<(u32, Order)>, until: u64) -> Reports {
        for (number, order) in orders {
            self.obey(number, order);
        }
        let mut deeds = core::mem::take(&mut self.left);
        for (at, index, deed) in self.network.run(until) {
            let number = index as u32;
            let deed = match deed {
                emulator::Deed::Sends(frame) => {
                    let power = frame.power;
                    let channel = (frame.frequency / SPACING + BELOW) as u8;
                    let (start, psdu) = (frame.start, frame.psdu);
                    Deed::Sends(
                        Frame {
                            start,
                            channel,
                            psdu,
                        },
                        power,
                    )
                }
                emulator::Deed::Bytes(bytes) => Deed::Bytes(bytes),
                emulator::Deed::Pins(port, level) => Deed::Pins(port, level),
                emulator::Deed::Writes(takes) => Deed::Writes(takes),
                emulator::Deed::Uart(wires) => Deed::Uart(seen(wires)),
                emulator::Deed::I2c(wires) => Deed::I2c(seen(wires)),
                emulator::Deed::Reset(by, has_settings) => Deed::Restarts { by, has_settings },
                // This failure was ordered.
                emulator::Deed::Fails(_) if self.is_given_up(number) => continue,
                emulator::Deed::Fails(why) => Deed::Fails(why),
                emulator::Deed::Log(bytes) => {
                    let chip = self.all.get_mut(&number);
                    let lines = chip.map(|chip| chip.lines(&bytes, &self.table));
                    let lines = lines.into_iter().flatten();
                    deeds.extend(lines.map(|line| (at, number, Deed::Logs(line))));
                    continue;
                }
            };
            deeds.push((at, number, deed));
        }
        Reports {
            reached: self.network.reached(),
            next: self.network.next(),
            deeds,
        }
    }

    /// Contents of those flashes that have changed since the last call.
    fn look(&mut self) -> Reports {
        let reached = self.network.reached();
        let numbers = self.all.keys().copied();
        let deeds = numbers.filter_map(|number| {
            let contents = self.network.look(number as usize)?;
            Some((reached, number, Deed::Memory(contents)))
        });
        Reports {
            deeds: deeds.collect(),
            reached,
            next: self.network.next(),
        }
    }

    fn end(&mut self) -> Reports {
        let reached = self.network.reached();
        let mut deeds = Vec::new();
        for (&number, chip) in &mut self.all {
            match self.network.switch_off(number as usize) {
                Some(Ok(outcome)) => chip.ends(outcome),
                Some(Err(why)) => deeds.push((reached, number, Deed::Fails(why))),
                None => {}
            }
            // Without power bits may have flipped.
            chip.end.memory.clone_from(&chip.flash);
            deeds.push((reached, number, Deed::Ends(Box::new(chip.end.clone()))));
        }
        Reports {
            reached,
            next: u64::MAX,
            deeds,
        }
    }
}

/// FREQUENCY of a channel.
fn frequency(channel: u8) -> u32 {
    u32::from(channel).saturating_sub(BELOW) * SPACING
}

impl Chip {
    /// Takes in the end of its power.
    fn ends(&mut self, outcome: Outcome) {
        // A chip that was given up leaves nothing.
        if !outcome.flash.is_empty() {
            self.flash.clone_from(&outcome.flash);
        }
        self.end.add(end(outcome));
    }

    /// Moves its step sensor: the bus asks for the motion by the chip's own clock.
    fn moves(&self, motions: &[Motion]) {
        for motion in motions {
            let known = device::Motion {
                acceleration: motion.acceleration,
                angular_rate: motion.angular_rate,
                field: motion.field,
            };
            self.world.push(self.time.local(motion.at), known);
        }
    }

    /// Flips bits in the flash that it left.
    fn rot(&mut self, bits: &[(u64, u8)]) {
        for (address, bit) in bits {
            let place = self.flash.iter_mut().find_map(|(start, known)| {
                known.get_mut(usize::try_from(address.checked_sub(*start)?).ok()?)
            });
            if let Some(byte) = place {
                *byte ^= 1 << (bit & 7);
            }
        }
    }

    /// Lines of its log that these bytes complete.
    fn lines(&mut self, bytes: &[u8], table: &Table) -> Vec<String> {
        self.log.extend(bytes);
        // Each line ends with the only zero in it.
        let Some(end) = self.log.iter().rposition(|byte| *byte == 0) else {
            return Vec::new();
        };
        let mut decoder = table.new_stream_decoder();
        decoder.received(&self.log[..=end]);
        self.log.drain(..=end);
        let mut lines = Vec::new();
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("", |level| level.as_str());
                    let text = format!("{level} {}", frame.display_message());
                    lines.push(text.trim_start().to_owned());
                }
                // A restart cuts a line off.
                Err(DecodeError::Malformed) => {}
                Err(DecodeError::UnexpectedEof) => return lines,
            }
        }
    }
}

fn seen(wires: emulator::Wires) -> Wires {
    let emulator::Wires { pins, rate } = wires;
    Wires { pins, rate }
}

/// Puts bytes where they belong; unknown parts of the flash are blank.
fn program(flash: &mut Vec<Contents>, address: u64, bytes: &[u8]) {
    let place = flash.iter_mut().find_map(|(start, known)| {
        let offset = usize::try_from(address.checked_sub(*start)?).ok()?;
        known.get_mut(offset..)?.get_mut(..bytes.len())
    });
    match place {
        Some(place) => place.copy_from_slice(bytes),
        None => flash.push((address, bytes.to_vec())),
    }
}

fn end(outcome: Outcome) -> End {
    let forbidden = outcome.forbidden.iter();
    let forbidden = forbidden.map(|(who, register, what)| format!("{who} {register}: {what}"));
    End {
        forbidden: forbidden.chain(outcome.unmapped).collect(),
        memory: outcome.flash,
        stack: [
            outcome.stack.saturating_sub(outcome.untouched),
            outcome.stack,
        ],
        radio_on: outcome.radio_on,
        received: outcome.received,
        flash: [outcome.erased.len() as u64, outcome.written],
        overruns: outcome.overruns,
        instructions: outcome.instructions,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After hours, too, a carrier's motion begins when it is told, and not when a wrong clock shows that time.
    #[test]
    fn motion_is_felt_when_it_begins() {
        let hour = 3_600_000_000_000;
        for drift_ppb in [0, 500_000, -500_000] {
            let time = Time {
                since: 7,
                drift_ppb,
            };
            let chip = Chip {
                time,
                ..Chip::default()
            };
            let motion = Motion {
                at: hour,
                acceleration: [0.0; 3],
                angular_rate: [1.0, 0.0, 0.0],
                field: [0.0; 3],
            };
            chip.moves(&[motion]);
            let turns = |at| chip.world.at(time.local(at)).angular_rate[0];
            assert_eq!(
                [turns(hour - 1_000), turns(hour)],
                [0.0, 1.0],
                "{drift_ppb}"
            );
        }
    }
}
