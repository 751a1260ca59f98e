//! The two sides of a board: what happens to a chip, and what it does that is seen outside. What emulates chips
//! is behind [`Emulator`].
//!
//! Frames on the air, bytes on its line, the levels of its pins, and power. Times are nanoseconds since the
//! simulation began; chips are told by any number.

use std::sync::{Arc, atomic::AtomicBool};

/// Contents of a chip's memory: an address, and what is there and behind it.
pub type Contents = (u64, Vec<u8>);

/// A frame on the air.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// When its preamble begins.
    pub start: u64,
    /// IEEE 802.15.4, 11 to 26.
    pub channel: u8,
    /// With its frame check sequence.
    pub psdu: Vec<u8>,
}

/// What becomes of a frame at a receiver.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reception {
    /// Whose frame it is: any number that is no other sender's.
    pub from: u32,
    /// Of its energy, dBm.
    pub level: i8,
    /// It is not received whole, even if nothing else is on the air there.
    pub is_lost: bool,
    /// It is too weak to be taken for a frame: only a carrier.
    pub is_faint: bool,
    /// It stands out from all that is on the air there when it begins.
    pub stands_out: bool,
    /// Whose frames do not stand out there any more, now that it has begun.
    pub spoils: Vec<u32>,
}

/// What acts on a step sensor from an instant on, along the axes printed on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// When.
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
        /// When; if that has passed, now.
        at: u64,
        /// Of what it draws at random.
        seed: u64,
        /// How much faster than true its clocks run, 1e-9.
        drift_ppb: i32,
        /// A step sensor is on its bus.
        has_sensor: bool,
        /// What a programmer has written to its flash since it last had power.
        programmed: Vec<Contents>,
    },
    /// It has no power any more.
    Off,
    /// Bytes on its line end one after the other.
    Bytes {
        /// When the first one does; if that has passed, now.
        at: u64,
        /// How long each of the others takes.
        every: u64,
        /// Which.
        bytes: Vec<u8>,
    },
    /// A frame arrives. It must not have begun.
    Frame(Frame, Reception),
    /// What it sends now, by this [number](Reception::from), is not received whole: its power is about to go.
    CutOff(u32),
    /// In the middle of the next work on its flash it stands still: power is about to go, and what is there then
    /// is what it leaves.
    StandInWrite,
    /// Its step sensor moves so, in the order of times, none of which has passed.
    Moves(Vec<Motion>),
    /// Something else than frames is on a channel, or on all, until then.
    Jammed {
        /// When it is over.
        until: u64,
        /// IEEE 802.15.4, 11 to 26.
        channel: Option<u8>,
    },
    /// Something outside pulls inputs of a port down, and no others: buttons. Without power it
    /// does not notice.
    Pulls {
        /// From when on; if that has passed, from now on.
        at: u64,
        /// The port.
        port: u8,
        /// Which, a bit a pin.
        low: u32,
    },
    /// Bits of its flash flip: addresses, and numbers of bits there.
    Rot(Vec<(u64, u8)>),
    /// What programs write in its flash keeps what it holds from now on, whatever they do.
    WearOut,
}

impl Order {
    /// When a chip has something to do because of it.
    pub fn at(&self) -> u64 {
        match self {
            Self::Bytes { at, .. } | Self::Pulls { at, .. } => *at,
            Self::Frame(frame, _) => frame.start,
            Self::CutOff(_)
            | Self::StandInWrite
            | Self::Moves(_)
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

    /// These orders reach chips, in this order; then all run until an instant, or until one of them does something
    /// that is seen outside.
    fn run(&mut self, orders: Vec<(u32, Order)>, until: u64) -> Reports;

    /// Tells what is in those flashes where that has changed since it was last told. The chips notice nothing.
    fn look(&mut self) -> Reports;

    /// All chips lose their power: tells how each of them ended.
    fn end(&mut self) -> Reports;
}

/// Something that a chip does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Deed {
    /// It sends a frame, with this power, dBm. It is told before it begins.
    Sends(Frame, i8),
    /// It begins to send these bytes on its line, one after the other.
    Bytes(Vec<u8>),
    /// Over which wires its UART sends and receives from now on.
    Uart(Wires),
    /// Over which ones its I2C bus has data and clock from now on.
    I2c(Wires),
    /// What a port's pins drive has changed: the port, and a bit a pin; those of inputs count as high.
    Pins(u8, u32),
    /// It says something in its log.
    Logs(String),
    /// It stands in the middle of work on its flash that takes so many nanoseconds.
    Writes(u64),
    /// What programs write in its flash: as somebody looked at it, or when its power went.
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
    /// How it ended.
    Ends(Box<End>),
}

/// Over which wires bytes go, and how fast.
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

/// What is known of a chip in the end, of all times that it had power.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct End {
    /// What programs write in its flash, as it was last.
    pub memory: Vec<Contents>,
    /// What its product specification forbids, or is not modelled, and accesses where nothing is.
    pub forbidden: Vec<String>,
    /// Bytes of its stack that were in use at most, and all.
    pub stack: [u64; 2],
    /// How long its radio received and sent, nanoseconds.
    pub radio_on: [u64; 2],
    /// Frames received well, and spoilt.
    pub received: [u64; 2],
    /// Pages erased, and words written.
    pub flash: [u64; 2],
    /// Bytes that found no room in its UART.
    pub overruns: u64,
    /// Instructions.
    pub instructions: u64,
}

#[cfg(any(feature = "chip", test))]
impl End {
    /// It has had power once more.
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

/// What the chips did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reports {
    /// Until when they ran.
    pub reached: u64,
    /// When the first of them does something next, if nothing happens to any.
    pub next: u64,
    /// When, who and what; in the order of times.
    pub deeds: Vec<(u64, u32, Deed)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is forbidden is known for good, also if it was done before a loss of power; each of it once.
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
