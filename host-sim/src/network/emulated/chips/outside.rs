//! The two sides of a board: what happens to a chip, and what it does that is seen outside. The chips'
//! emulator is behind [`Emulator`].
//!
//! Frames on the air, bytes on its line, the levels of its pins, and power. Times are nanoseconds since the
//! simulation began; any numbers may identify the chips.

use std::sync::{Arc, atomic::AtomicBool};

/// Contents of a chip's memory: an address, and the bytes from there on.
pub type Contents = (u64, Vec<u8>);

/// A frame on the air.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Time at which its preamble begins.
    pub start: u64,
    /// IEEE 802.15.4, 11 to 26.
    pub channel: u8,
    /// With its frame check sequence.
    pub psdu: Vec<u8>,
}

/// Fate of a frame at a receiver.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reception {
    /// Number of the sender, different from all other senders' numbers.
    pub from: u32,
    /// Level of its energy, dBm.
    pub level: i8,
    /// It is not received whole, even if nothing else is on the air there.
    pub is_lost: bool,
    /// It is too weak to be taken for a frame: only a carrier.
    pub is_faint: bool,
    /// It stands out from all that is on the air there when it begins.
    pub stands_out: bool,
    /// Senders whose frames no longer stand out there, now that it has begun.
    pub spoils: Vec<u32>,
}

/// Forces and fields on a step sensor from an instant on, along the axes printed on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Time of the instant.
    pub at: u64,
    /// Specific force, m/s^2: at rest, 9.81 along the axis that points up.
    pub acceleration: [f64; 3],
    /// Angular rate, rad/s.
    pub angular_rate: [f64; 3],
    /// Magnetic field, uT.
    pub field: [f64; 3],
}

/// Something that happens to a chip.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// It has power from now on.
    On {
        /// Time at which the power comes; if that has passed, now.
        at: u64,
        /// Seed of its random numbers.
        seed: u64,
        /// Excess rate of its clocks over true time, 1e-9.
        drift_ppb: i32,
        /// A step sensor is on its bus.
        has_sensor: bool,
        /// Contents that a programmer has written to its flash since it last had power.
        programmed: Vec<Contents>,
    },
    /// It has no power any more.
    Off,
    /// Bytes on its line end one after the other.
    Bytes {
        /// Time at which the first byte ends; if that has passed, now.
        at: u64,
        /// Duration of each other byte.
        every: u64,
        /// The bytes.
        bytes: Vec<u8>,
    },
    /// A frame arrives. It must not have begun.
    Frame(Frame, Reception),
    /// The frame that it sends now, by this [number](Reception::from), is not received whole: its power is about
    /// to go.
    CutOff(u32),
    /// It stands still in the middle of the next work on its flash: power is about to go, and it leaves the
    /// contents of that moment.
    StandInWrite,
    /// Its step sensor moves so, in the order of times, none of which has passed.
    Moves(Vec<Motion>),
    /// Its step sensor is off its bus, or back.
    UnplugSensor(bool),
    /// Something else than frames is on a channel, or on all, until then.
    Jammed {
        /// Time at which it is over.
        until: u64,
        /// IEEE 802.15.4, 11 to 26.
        channel: Option<u8>,
    },
    /// Something outside pulls inputs of a port down, and no others: buttons. Without power it
    /// does not notice.
    Pulls {
        /// Time from which on they are low; if that has passed, from now on.
        at: u64,
        /// The port.
        port: u8,
        /// The pins, a bit each.
        low: u32,
    },
    /// Bits of its flash flip: addresses, and numbers of bits there.
    Rot(Vec<(u64, u8)>),
    /// The part of its flash that programs write keeps its present contents from now on, whatever they do.
    WearOut,
}

impl Order {
    /// Time at which the order gives a chip something to do.
    pub fn at(&self) -> u64 {
        match self {
            Self::Bytes { at, .. } | Self::Pulls { at, .. } => *at,
            Self::Frame(frame, _) => frame.start,
            Self::CutOff(_)
            | Self::StandInWrite
            | Self::Moves(_)
            | Self::UnplugSensor(_)
            | Self::Jammed { .. }
            | Self::WearOut => u64::MAX,
            Self::On { .. } | Self::Off | Self::Rot(_) => 0,
        }
    }
}

/// Emulated chips, as the simulation sees them.
///
/// It takes turns with them: what happens to chips is ordered first, then they run.
pub trait Emulator {
    /// Whenever power comes to this chip its first instruction waits for GDB at this port of this computer,
    /// until `end` is set.
    fn debug(&mut self, chip: u32, port: u16, end: Arc<AtomicBool>);

    /// Hands orders to chips, in this sequence; then all chips run until an instant, or until one of them does
    /// something that is seen outside.
    fn run(&mut self, orders: Vec<(u32, Order)>, until: u64) -> Reports;

    /// Tells the contents of each flash that has changed since it was last told. The chips notice nothing.
    fn look(&mut self) -> Reports;

    /// Takes the power of all chips: tells how each of them ended.
    fn end(&mut self) -> Reports;
}

/// Something that a chip does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Deed {
    /// It sends a frame, with this power, dBm. It is told before it begins.
    Sends(Frame, i8),
    /// It begins to send these bytes on its line, one after the other.
    Bytes(Vec<u8>),
    /// Wires over which its UART sends and receives from now on.
    Uart(Wires),
    /// Wires over which its I2C bus has data and clock from now on.
    I2c(Wires),
    /// New levels of a port's pins: the port, and a bit a pin; those of inputs count as high.
    Pins(u8, u32),
    /// It says something in its log.
    Logs(String),
    /// It stands in the middle of work on its flash that takes so many nanoseconds.
    Writes(u64),
    /// Contents of the part of its flash that programs write: at a look, or when its power went.
    Memory(Vec<Contents>),
    /// It has restarted, by order of this part of it.
    Restarts {
        /// `Core`, or a peripheral.
        by: String,
        /// It had written settings that are valid from the next start on.
        has_settings: bool,
    },
    /// It cannot be emulated.
    Fails(String),
    /// Summary of it after it has ended.
    Ends(Box<End>),
}

/// Wires over which bytes go, and their rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wires {
    /// Numbers of pins, those of the second port from 32 on; [`NOT_CONNECTED`](Self::NOT_CONNECTED) or above: none.
    pub pins: [u32; 2],
    /// Bits per second.
    pub rate: u32,
}

impl Wires {
    /// No pin.
    pub const NOT_CONNECTED: u32 = 1 << 31;
}

/// Summary of a chip in the end, over all times that it had power.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct End {
    /// Last contents of the part of its flash that programs write.
    pub memory: Vec<Contents>,
    /// Acts that its product specification forbids, or that are not modelled, and accesses where nothing is.
    pub forbidden: Vec<String>,
    /// Bytes of its stack: the most that were in use, and all.
    pub stack: [u64; 2],
    /// Time for which its radio received and sent, nanoseconds.
    pub radio_on: [u64; 2],
    /// Frames received well, and spoilt.
    pub received: [u64; 2],
    /// Pages erased, and words written.
    pub flash: [u64; 2],
    /// Bytes that found no room in its UART.
    pub overruns: u64,
    /// Number of instructions.
    pub instructions: u64,
}

#[cfg(any(feature = "chip", test))]
impl End {
    /// Adds the summary of a later time with power.
    pub(super) fn add(&mut self, later: Self) {
        let Self {
            memory,
            forbidden,
            stack,
            radio_on,
            received,
            flash,
            overruns,
            instructions,
        } = later;
        self.memory = memory;
        for what in forbidden {
            if !self.forbidden.contains(&what) {
                self.forbidden.push(what);
            }
        }
        for (most, one) in self.stack.iter_mut().zip(stack) {
            *most = one.max(*most);
        }
        let sums = [
            (&mut self.radio_on, radio_on),
            (&mut self.received, received),
            (&mut self.flash, flash),
        ];
        for (sums, ones) in sums {
            for (sum, one) in sums.iter_mut().zip(ones) {
                *sum += one;
            }
        }
        self.overruns += overruns;
        self.instructions += instructions;
    }
}

/// Deeds of the chips in one run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reports {
    /// Time until which they ran.
    pub reached: u64,
    /// Time at which the first of them does something next, if nothing happens to any.
    pub next: u64,
    /// Time, chip and deed of each, in the order of times.
    pub deeds: Vec<(u64, u32, Deed)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forbidden acts are kept for good, also those before a loss of power; each of them once.
    #[test]
    fn ends_add_up() {
        let end = |memory, forbidden: &[&str], number| End {
            memory: vec![(0, vec![memory])],
            forbidden: forbidden.iter().map(|what| (*what).to_owned()).collect(),
            stack: [number, 100],
            radio_on: [number, 1],
            received: [number, 2],
            flash: [number, 3],
            overruns: number,
            instructions: number,
        };
        let mut all = End::default();
        all.add(end(1, &["a"], 7));
        all.add(end(2, &["b", "a"], 5));
        let expected = End {
            stack: [7, 100],
            radio_on: [12, 2],
            received: [12, 4],
            flash: [12, 6],
            ..end(2, &["a", "b"], 12)
        };
        assert_eq!(all, expected);
    }
}
