//! What a simulation and the emulated chips in another process tell each other.
//!
//! They take turns: the simulation writes [`Orders`] to the process's standard input, and waits for the
//! [`Reports`] on its standard output. What crosses is what is outside a board: frames on the air, bytes
//! on its line, the levels of its pins, power. Times are nanoseconds since the simulation began, chips are
//! told by any number.
//!
//! Each message is its length, four bytes, the lowest first, and that many bytes of postcard. Both ends
//! are built from one source, so there are no versions.

pub mod one_cpu;

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// No message is longer: a chip's flash, several times.
const LONGEST: u32 = 64 << 20;

/// Contents of a chip's memory: an address, and what is there and behind it.
pub type Contents = (u64, Vec<u8>);

/// A frame on the air.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Frame {
    /// When its preamble begins.
    pub start: u64,
    /// IEEE 802.15.4, 11 to 26.
    pub channel: u8,
    /// With its frame check sequence.
    pub psdu: Vec<u8>,
}

/// What becomes of a frame at a receiver.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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

/// What the chips are to do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Orders {
    /// First of all: the program of all chips, an ELF file.
    Load(String),
    /// Which chip waits for GDB whenever power comes, and at which port of this computer.
    Debug(u32, u16),
    /// What happens to which of them, and then until when they run.
    Run {
        /// In this order.
        orders: Vec<(u32, Order)>,
        /// They stop earlier where one of them does something that others see.
        until: u64,
    },
    /// They tell what is in those flashes where that has changed since it was last told, and notice nothing.
    Look,
    /// All lose their power, and their ends are told.
    End,
}

/// Something that a chip does.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
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

impl End {
    /// It has had power once more.
    pub fn add(&mut self, later: Self) {
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
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reports {
    /// Until when they ran.
    pub reached: u64,
    /// When the first of them does something next, if nothing happens to any.
    pub next: u64,
    /// When, who and what; in the order of times.
    pub deeds: Vec<(u64, u32, Deed)>,
}

/// Writes a message.
///
/// # Errors
/// The pipe's, or the message is too long.
pub fn write(pipe: &mut impl Write, message: &impl Serialize) -> io::Result<()> {
    let bytes = postcard::to_extend(message, Vec::new()).map_err(io::Error::other)?;
    let length = u32::try_from(bytes.len()).ok();
    let length = length.filter(|length| *length <= LONGEST);
    let length = length.ok_or_else(|| io::Error::other("a message is too long"))?;
    pipe.write_all(&[&length.to_le_bytes(), bytes.as_slice()].concat())?;
    pipe.flush()
}

/// Reads a message; none where the pipe has ended between two of them.
///
/// # Errors
/// The pipe's, or what comes is no such message.
pub fn read<T: DeserializeOwned>(pipe: &mut impl Read) -> io::Result<Option<T>> {
    let mut length = [0; 4];
    match pipe.read(&mut length[..1])? {
        0 => return Ok(None),
        _ => pipe.read_exact(&mut length[1..])?,
    }
    let length = u32::from_le_bytes(length);
    if length > LONGEST {
        return Err(io::ErrorKind::InvalidData.into());
    }
    let mut bytes = vec![0; length as usize];
    pipe.read_exact(&mut bytes)?;
    let message = postcard::from_bytes(&bytes);
    message
        .map(Some)
        .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_as_they_went() {
        let frame = Frame {
            start: 1 << 40,
            channel: 15,
            psdu: vec![1, 2, 3],
        };
        let reception = Reception {
            from: 3,
            level: -60,
            is_lost: true,
            is_faint: false,
            stands_out: true,
            spoils: vec![7, 1],
        };
        let sent = [
            Orders::Load("image.elf".into()),
            Orders::Run {
                orders: vec![(7, Order::Frame(frame, reception)), (8, Order::Off)],
                until: 5,
            },
            Orders::End,
        ];
        let mut pipe = Vec::new();
        for orders in &sent {
            write(&mut pipe, orders).unwrap();
        }
        let mut rest = pipe.as_slice();
        for orders in sent {
            assert_eq!(read(&mut rest).unwrap(), Some(orders));
        }
        assert_eq!(read::<Orders>(&mut rest).unwrap(), None);
    }

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

    #[test]
    fn what_is_cut_off_or_too_long_is_refused() {
        let mut pipe = Vec::new();
        write(&mut pipe, &Orders::Load("image.elf".into())).unwrap();
        for end in 1..pipe.len() {
            assert!(read::<Orders>(&mut &pipe[..end]).is_err(), "{end}");
        }
        assert!(read::<Orders>(&mut [0xff; 8].as_slice()).is_err());
        assert!(read::<Orders>(&mut [1, 0, 0, 0, 0xff].as_slice()).is_err());
    }
}
