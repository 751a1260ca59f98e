//! Transfer of a package over a serial line (nRF5 SDK 17, "DFU protocol", "DFU serial transport"; frames as in RFC
//! 1055), without input or output.

use crc::{CRC_32_ISO_HDLC, Crc};

use super::Package;

/// Times that an object is sent again, if its checksum is wrong.
const REPEATS: u8 = 3;

/// End of a frame.
pub const END: u8 = 0xc0;
const ESCAPE: u8 = 0xdb;
const ESCAPED_END: u8 = 0xdc;
const ESCAPED_ESCAPE: u8 = 0xdd;

const CREATE: u8 = 0x01;
const SET_RECEIPTS: u8 = 0x02;
const CHECKSUM: u8 = 0x03;
const EXECUTE: u8 = 0x04;
const SELECT: u8 = 0x06;
const LENGTH: u8 = 0x07;
const WRITE: u8 = 0x08;
const PING: u8 = 0x09;
const ANSWER: u8 = 0x60;
const SUCCESS: u8 = 0x01;
/// The code of the reason is behind it.
const EXTENDED: u8 = 0x0b;

/// Number that a ping is answered with.
const MARK: u8 = 42;
/// Frames that are longer are none.
const LONGEST: usize = 1024;

/// Reason why a boot loader did not take a package.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DfuError {
    /// It refuses a request.
    #[error("the boot loader refuses {what}: {}", reason(*.code))]
    Refused {
        /// The request.
        what: &'static str,
        /// Its result, and the extended error.
        code: (u8, u8),
    },
    /// It answers other than it should.
    #[error("the boot loader answers to {0} in a way that is not known: is it Nordic's?")]
    Unexpected(&'static str),
    /// Bytes of an object are damaged, again and again.
    #[error("bytes were damaged on the way to the boot loader, {REPEATS} times: try another cable")]
    Damaged,
}

/// Words for a result (nRF5 SDK, `nrf_dfu_req_handler.h`, `nrf_dfu_handling_error.h`).
fn reason(code: (u8, u8)) -> String {
    match code {
        (0x04, _) => "it has no room for that".into(),
        (EXTENDED, 0x05) => "the image is older than the one it has".into(),
        (EXTENDED, 0x06) => "the package is for other hardware".into(),
        (EXTENDED, 0x07) => "the package is for another SoftDevice".into(),
        (EXTENDED, 0x08) => "it asks for a signed package".into(),
        (EXTENDED, 0x0c) => "the image is not the one of the package".into(),
        (EXTENDED, 0x0d) => "it has no room for the image".into(),
        (EXTENDED, extended) => format!("extended error {extended:#04x}"),
        (result, _) => format!("result {result:#04x}"),
    }
}

/// Part of a package.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Init,
    Image,
}

impl Part {
    const fn kind(self) -> u8 {
        match self {
            Self::Init => 1,
            Self::Image => 2,
        }
    }
}

/// A request, with the part and the begin of the object that it is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Ping,
    Receipts,
    Length,
    Select(Part),
    Create(Part, usize),
    Check(Part, usize),
    Execute(Part, usize),
    Done,
}

/// The transfer of a package. [`request`](Self::request) is to be sent; the frame that comes then goes to
/// [`on_answer`](Self::on_answer), and so on until [`is_done`](Self::is_done).
#[derive(Clone, Debug)]
pub struct Transfer {
    package: Package,
    step: Step,
    /// Bytes of an object and of a write, at most.
    object: usize,
    write: usize,
    repeats: u8,
}

impl Transfer {
    /// Nothing is sent yet.
    pub const fn new(package: Package) -> Self {
        Self {
            package,
            step: Step::Ping,
            object: 0,
            write: 0,
            repeats: 0,
        }
    }

    /// Returns true when the boot loader has all, and starts the image.
    pub fn is_done(&self) -> bool {
        self.step == Step::Done
    }

    /// Bytes of the image that the boot loader has confirmed, and all of them.
    pub fn progress(&self) -> [usize; 2] {
        let confirmed = match self.step {
            Step::Create(Part::Image, from)
            | Step::Check(Part::Image, from)
            | Step::Execute(Part::Image, from) => from,
            Step::Done => self.package.image.len(),
            _ => 0,
        };
        [confirmed, self.package.image.len()]
    }

    fn bytes(&self, part: Part) -> &[u8] {
        match part {
            Part::Init => &self.package.init,
            Part::Image => &self.package.image,
        }
    }

    /// End of the object that begins there.
    fn end(&self, part: Part, from: usize) -> usize {
        self.bytes(part).len().min(from + self.object)
    }

    /// Bytes for the line; none when it is done.
    pub fn request(&self) -> Vec<u8> {
        match self.step {
            Step::Ping => frame(&[PING, MARK]),
            Step::Receipts => frame(&[SET_RECEIPTS, 0, 0]),
            Step::Length => frame(&[LENGTH]),
            Step::Select(part) => frame(&[SELECT, part.kind()]),
            Step::Create(part, from) => {
                let length = (self.end(part, from) - from) as u32;
                let [a, b, c, d] = length.to_le_bytes();
                frame(&[CREATE, part.kind(), a, b, c, d])
            }
            Step::Check(part, from) => {
                let object = &self.bytes(part)[from..self.end(part, from)];
                let writes = object.chunks(self.write.max(1));
                let writes = writes.flat_map(|bytes| frame(&[&[WRITE], bytes].concat()));
                writes.chain(frame(&[CHECKSUM])).collect()
            }
            Step::Execute(..) => frame(&[EXECUTE]),
            Step::Done => Vec::new(),
        }
    }

    /// Takes the frame that answers to the request.
    ///
    /// # Errors
    /// [`DfuError`]. The transfer is over.
    pub fn on_answer(&mut self, frame: &[u8]) -> Result<(), DfuError> {
        let (request, what) = match self.step {
            Step::Ping => (PING, "a greeting"),
            Step::Receipts => (SET_RECEIPTS, "receipts"),
            Step::Length => (LENGTH, "a question for its longest frame"),
            Step::Select(_) => (SELECT, "a question for its room"),
            Step::Create(Part::Init, _) => (CREATE, "a package"),
            Step::Create(..) => (CREATE, "an image of this size"),
            Step::Check(..) => (CHECKSUM, "a question for what it has"),
            Step::Execute(Part::Init, _) => (EXECUTE, "the package"),
            Step::Execute(..) => (EXECUTE, "a part of the image"),
            Step::Done => return Ok(()),
        };
        let told = match *frame {
            [ANSWER, of, SUCCESS, ref told @ ..] if of == request => told,
            [ANSWER, of, code, ref more @ ..] if of == request => {
                let code = (code, more.first().copied().unwrap_or(0));
                return Err(DfuError::Refused { what, code });
            }
            _ => return Err(DfuError::Unexpected(what)),
        };
        let next = self.next(told).ok_or(DfuError::Unexpected(what))?;
        match (self.step, next) {
            (Step::Check(..), Step::Create(..)) => {
                self.repeats += 1;
                if self.repeats > REPEATS {
                    return Err(DfuError::Damaged);
                }
            }
            (Step::Execute(..), _) => self.repeats = 0,
            _ => {}
        }
        self.step = next;
        Ok(())
    }

    fn next(&mut self, told: &[u8]) -> Option<Step> {
        Some(match (self.step, told) {
            (Step::Ping, &[MARK, ..]) => Step::Receipts,
            (Step::Receipts, _) => Step::Length,
            (Step::Length, &[low, high, ..]) => {
                // Each byte may take two, and the end one; the request is the first.
                let length = usize::from(u16::from_le_bytes([low, high]));
                self.write = (length.checked_sub(1)? / 2).checked_sub(1)?;
                (self.write > 0).then_some(Step::Select(Part::Init))?
            }
            (Step::Select(part), &[a, b, c, d, ..]) => {
                self.object = usize::try_from(u32::from_le_bytes([a, b, c, d])).ok()?;
                let fits = part == Part::Image || self.bytes(part).len() <= self.object;
                (fits && self.object > 0).then_some(Step::Create(part, 0))?
            }
            (Step::Create(part, from), _) => Step::Check(part, from),
            (Step::Check(part, from), &[o0, o1, o2, o3, c0, c1, c2, c3, ..]) => {
                let end = self.end(part, from);
                let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&self.bytes(part)[..end]);
                let told = [[o0, o1, o2, o3], [c0, c1, c2, c3]].map(u32::from_le_bytes);
                match told == [end as u32, crc] {
                    true => Step::Execute(part, from),
                    false => Step::Create(part, from),
                }
            }
            (Step::Execute(part, from), _) => match (self.end(part, from), part) {
                (end, _) if end < self.bytes(part).len() => Step::Create(part, end),
                (_, Part::Init) => Step::Select(Part::Image),
                (_, Part::Image) => Step::Done,
            },
            _ => return None,
        })
    }
}

/// Bytes between ends.
fn frame(bytes: &[u8]) -> Vec<u8> {
    let escaped = bytes.iter().flat_map(|&byte| match byte {
        END => vec![ESCAPE, ESCAPED_END],
        ESCAPE => vec![ESCAPE, ESCAPED_ESCAPE],
        byte => vec![byte],
    });
    escaped.chain([END]).collect()
}

/// Frames of a line.
#[derive(Clone, Debug, Default)]
pub struct Frames {
    bytes: Vec<u8>,
    is_escaped: bool,
}

impl Frames {
    /// Takes a byte. Returns a frame when it was its last one; empty ones, and those that are too long, are none.
    pub fn push(&mut self, byte: u8) -> Option<Vec<u8>> {
        let byte = match (core::mem::take(&mut self.is_escaped), byte) {
            (_, END) => {
                let frame = core::mem::take(&mut self.bytes);
                return (1..=LONGEST).contains(&frame.len()).then_some(frame);
            }
            (false, ESCAPE) => {
                self.is_escaped = true;
                return None;
            }
            (true, ESCAPED_END) => END,
            (true, ESCAPED_ESCAPE) => ESCAPE,
            (_, byte) => byte,
        };
        if self.bytes.len() <= LONGEST {
            self.bytes.push(byte);
        }
        None
    }
}
