//! A PC at the USB plug: it asks a device what it is, as Linux does, and opens its serial port (USB 2.0, chapter 9;
//! USB CDC 1.2 and PSTN 1.2).

use std::ops::Range;

use super::super::Peer;

/// Time from the pull-up to the reset (USB 2.0, 7.1.7.3), and of the reset; nanoseconds.
pub(super) const SETTLES: u64 = 100_000_000;
pub(super) const RESETS: u64 = 50_000_000;
/// The device has time to take its address (USB 2.0, 9.2.6.3).
pub(super) const RECOVERS: u64 = 10_000_000;

/// Address that the device gets.
const ADDRESS: u16 = 7;
/// Requests.
const GET_STATUS: u8 = 0;
pub(super) const SET_ADDRESS: u8 = 5;
const GET_DESCRIPTOR: u8 = 6;
const SET_CONFIGURATION: u8 = 9;
const SET_LINE_CODING: u8 = 0x20;
const SET_CONTROL_LINE_STATE: u8 = 0x22;
/// Kinds of descriptors.
const DEVICE: u16 = 1;
const CONFIGURATION: u16 = 2;
const STRING: u16 = 3;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;
/// An endpoint that an nRF52840 has not.
const STRANGE: u16 = 0x8a;
/// Classes of interfaces.
const COMMUNICATION: u8 = 2;
const DATA: u8 = 10;
/// 115,200 bits per second, 8 bits, no parity, 1 stop bit.
const CODING: [u8; 7] = [0, 0xc2, 1, 0, 0, 0, 8];
/// English of the United States.
const LANGUAGE: u16 = 0x0409;
/// Bytes that the driver of Linux asks for at once: they reach the program when they are complete, or behind a packet
/// that is not full (`drivers/usb/class/cdc-acm.c`: twice the size of a packet).
const ASKED: usize = 128;

/// A control transfer that the PC wants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Request {
    /// bmRequestType, bRequest, wValue, wIndex, wLength.
    pub(super) setup: [u8; 8],
    /// Bytes for the device.
    pub(super) out: Vec<u8>,
}

impl Request {
    fn new(kind: u8, request: u8, value: u16, index: u16, length: u16) -> Self {
        let [[v0, v1], [i0, i1], [l0, l1]] = [value, index, length].map(u16::to_le_bytes);
        Self {
            setup: [kind, request, v0, v1, i0, i1, l0, l1],
            out: Vec::new(),
        }
    }

    fn descriptor(kind: u16, number: u8, language: u16, length: u16) -> Self {
        let value = kind << 8 | u16::from(number);
        Self::new(0x80, GET_DESCRIPTOR, value, language, length)
    }

    /// Bytes that the device may send.
    pub(super) fn asked(&self) -> usize {
        let [kind, .., l0, l1] = self.setup;
        match kind & 0x80 {
            0 => 0,
            _ => u16::from_le_bytes([l0, l1]).into(),
        }
    }
}

/// Names that a device tells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names {
    /// Vendor and product, as numbers.
    pub numbers: [u16; 2],
    /// Manufacturer, product, serial number.
    pub texts: [String; 3],
}

/// Interfaces and endpoints of a serial port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Port {
    configuration: u8,
    control: u8,
    /// Numbers of the endpoints for data, to the PC and from it, and bytes of their packets.
    pub(super) to_pc: (u8, usize),
    pub(super) from_pc: (u8, usize),
}

/// Progress of the PC with a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Address,
    Device,
    Length,
    Configuration(u16),
    Text(usize),
    Configure,
    Coding,
    Strange,
    Open,
    Done,
    Failed,
}

/// A PC, and the program on it that has the serial port open.
#[derive(Debug)]
pub struct Pc {
    program: Box<dyn Peer>,
    /// Time at which the program opens the port, and the time when it does not read; nanoseconds.
    opens: u64,
    busy: Range<u64>,
    step: Step,
    names: Names,
    indices: [u8; 3],
    port: Port,
    read: Vec<u8>,
}

impl Pc {
    /// A PC whose program opens the port as soon as it appears.
    pub fn new(program: Box<dyn Peer>) -> Self {
        Self {
            program,
            opens: 0,
            busy: 0..0,
            step: Step::Address,
            names: Names::default(),
            indices: [0; 3],
            port: Port::default(),
            read: Vec::new(),
        }
    }

    /// The same, whose program opens the port at an instant, and does not read during a time; nanoseconds.
    #[must_use]
    pub fn with_times(self, opens: u64, busy: Range<u64>) -> Self {
        Self {
            opens,
            busy,
            ..self
        }
    }

    /// The same with another program.
    #[cfg(test)]
    pub(super) fn with_program(self, program: Box<dyn Peer>) -> Self {
        Self { program, ..self }
    }

    /// The program does not read before an instant.
    #[cfg(test)]
    pub(super) fn busy_until(&mut self, until: u64) {
        self.busy = 0..until;
    }

    /// Names of the device, once the PC knows it.
    pub fn names(&self) -> Option<&Names> {
        matches!(self.step, Step::Open | Step::Done).then_some(&self.names)
    }

    /// The device was reset.
    pub(super) fn begin(&mut self) {
        self.step = Step::Address;
        self.names = Names::default();
        self.read.clear();
    }

    /// The next request; `None` before the time that is returned, or where nothing is left to ask.
    pub(super) fn request(&self, now: u64) -> Result<Option<Request>, u64> {
        let [control, configuration] = [self.port.control, self.port.configuration].map(u16::from);
        Ok(Some(match self.step {
            Step::Address => Request::new(0, SET_ADDRESS, ADDRESS, 0, 0),
            Step::Device => Request::descriptor(DEVICE, 0, 0, 18),
            Step::Length => Request::descriptor(CONFIGURATION, 0, 0, 9),
            Step::Configuration(length) => Request::descriptor(CONFIGURATION, 0, 0, length),
            Step::Text(number) => Request::descriptor(STRING, self.indices[number], LANGUAGE, 255),
            Step::Configure => Request::new(0, SET_CONFIGURATION, configuration, 0, 0),
            Step::Coding => Request {
                out: CODING.to_vec(),
                ..Request::new(0x21, SET_LINE_CODING, 0, control, CODING.len() as u16)
            },
            // Of an endpoint that no device of this kind has. It may refuse.
            Step::Strange => Request::new(0x82, GET_STATUS, 0, STRANGE, 2),
            Step::Open if now < self.opens => return Err(self.opens),
            // Both lines that a terminal sets: it is there, and wants to send.
            Step::Open => Request::new(0x21, SET_CONTROL_LINE_STATE, 3, control, 0),
            Step::Done | Step::Failed => return Ok(None),
        }))
    }

    /// The answer to the last request; `None` if it was refused.
    ///
    /// # Errors
    /// It is not what the standard asks for. The PC gives the device up.
    pub(super) fn on_answer(&mut self, answer: Option<&[u8]>) -> Result<(), &'static str> {
        self.step = self
            .next(answer)
            .inspect_err(|_| self.step = Step::Failed)?;
        Ok(())
    }

    fn next(&mut self, answer: Option<&[u8]>) -> Result<Step, &'static str> {
        if self.step == Step::Strange {
            return Ok(Step::Open);
        }
        let answer = answer.ok_or("the device refuses a request that it must answer")?;
        Ok(match self.step {
            Step::Address => Step::Device,
            Step::Device => {
                let [18, 1, ..] = answer else {
                    return Err("the device descriptor is wrong");
                };
                let [.., v0, v1, p0, p1, _, _, maker, product, serial, 1] = *answer else {
                    return Err("the device descriptor tells other than one configuration");
                };
                self.names.numbers = [[v0, v1], [p0, p1]].map(u16::from_le_bytes);
                self.indices = [maker, product, serial];
                Step::Length
            }
            Step::Length => {
                let [9, 2, low, high, ..] = *answer else {
                    return Err("the configuration descriptor is wrong");
                };
                Step::Configuration(u16::from_le_bytes([low, high]))
            }
            Step::Configuration(length) => {
                if answer.len() != usize::from(length) {
                    return Err("the configuration is not as long as it says");
                }
                self.port = port(answer).ok_or("the configuration has no serial port")?;
                Step::Text(0)
            }
            Step::Text(number) => {
                self.names.texts[number] = text(answer).ok_or("a string descriptor is wrong")?;
                match number {
                    0 | 1 => Step::Text(number + 1),
                    _ => Step::Configure,
                }
            }
            Step::Configure => Step::Coding,
            Step::Coding => Step::Strange,
            Step::Strange | Step::Open | Step::Done => Step::Done,
            Step::Failed => Step::Failed,
        })
    }

    /// The serial port that is open.
    pub(super) fn port(&self) -> Option<Port> {
        (self.step == Step::Done).then_some(self.port)
    }

    /// Returns true if the program reads at an instant; else the time from which on it does.
    pub(super) fn reads(&self, now: u64) -> Result<(), u64> {
        match self.busy.contains(&now) {
            true => Err(self.busy.end),
            false => Ok(()),
        }
    }

    /// A packet of the device. Bytes reach the program when a transfer is over.
    pub(super) fn on_packet(&mut self, packet: &[u8], now: u64) {
        self.read.extend(packet);
        let (_, full) = self.port.to_pc;
        if packet.len() < full || self.read.len() >= ASKED {
            for byte in self.read.drain(..) {
                self.program.receive(byte, now);
            }
        }
    }

    /// Bytes for the device, as many as a packet takes; those that have been sent by now.
    pub(super) fn packet(&mut self, now: u64) -> Vec<u8> {
        let (_, most) = self.port.from_pc;
        (0..most)
            .map_while(|_| self.program.transmit(now))
            .collect()
    }

    /// Time when there will be bytes for the device.
    pub(super) fn next_byte(&self) -> Option<u64> {
        self.program.next()
    }
}

/// The serial port of a configuration.
fn port(mut bytes: &[u8]) -> Option<Port> {
    let mut port = Port {
        configuration: *bytes.get(5)?,
        ..Port::default()
    };
    let mut class = 0;
    while let [length, kind, ..] = *bytes {
        let (descriptor, rest) = bytes.split_at_checked(length.max(2).into())?;
        bytes = rest;
        match (kind, descriptor) {
            (INTERFACE, &[9, _, number, _, _, of, ..]) => {
                class = of;
                if class == COMMUNICATION {
                    port.control = number;
                }
            }
            // Bulk.
            (ENDPOINT, &[7, _, address, 2, low, high, _]) if class == DATA => {
                let end = match address & 0x80 {
                    0 => &mut port.from_pc,
                    _ => &mut port.to_pc,
                };
                *end = (address & 0xf, u16::from_le_bytes([low, high]).into());
            }
            _ => {}
        }
    }
    let is_whole = [port.from_pc, port.to_pc]
        .iter()
        .all(|(number, size)| (1..8).contains(number) && [8, 16, 32, 64].contains(size));
    is_whole.then_some(port)
}

/// Text of a string descriptor, UTF-16.
fn text(bytes: &[u8]) -> Option<String> {
    let (&[length, 3], units) = bytes.split_first_chunk()? else {
        return None;
    };
    let units = (usize::from(length) == bytes.len()).then_some(units)?;
    let (pairs, _) = units.as_chunks();
    let units = pairs.iter().map(|&pair| u16::from_le_bytes(pair));
    String::from_utf16(&units.collect::<Vec<_>>()).ok()
}
