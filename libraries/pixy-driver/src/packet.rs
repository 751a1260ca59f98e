//! Requests as bytes, and bytes as packets.
//!
//! A packet is a synchronisation word, a type, the length of its payload, a checksum (the sum of the
//! payload's bytes), and the payload. Words are little-endian. The form without a checksum is neither sent,
//! for a damaged request would be obeyed as another one, nor taken: the camera never sends it, and one
//! damaged bit makes it of the other.

/// Begins a packet with a checksum; its lower byte.
const SYNC: u8 = 0xAF;
/// The upper byte.
const SYNC_HIGH: u8 = 0xC1;

/// Bytes before the payload: the two above, type, length and checksum.
const HEAD: u8 = 6;

/// The longest payload: the length is one byte.
pub const PAYLOAD_MAX: usize = 255;

/// Bytes of the longest request.
const REQUEST_MAX: usize = 8;

/// The types of packets that a camera sends.
pub mod kind {
    /// The result of a request that sets or asks for one number: an `i32`.
    pub const RESULT: u8 = 0x01;
    /// Reason why a request was not obeyed: an `i8`.
    pub const ERROR: u8 = 0x03;
    /// Columns and rows.
    pub const RESOLUTION: u8 = 0x0D;
    /// Versions of hardware and firmware.
    pub const VERSION: u8 = 0x0F;
    /// Blobs.
    pub const BLOCKS: u8 = 0x21;
}

/// Signatures whose blobs are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Signatures {
    /// Bit 0 stands for signature 1, bit 7 for colour codes.
    map: u8,
    /// The only colour code; 0: all.
    code: u16,
}

impl Signatures {
    /// All seven, and colour codes.
    pub const ALL: Self = Self { map: 0xFF, code: 0 };

    /// One of 1 to 7; anything else stands for all.
    pub const fn one(signature: u8) -> Self {
        match signature {
            1..=7 => Self {
                map: 1 << (signature - 1),
                code: 0,
            },
            _ => Self::ALL,
        }
    }

    /// One colour code, from 8; anything less stands for all colour codes.
    pub const fn code(signature: u16) -> Self {
        let code = if signature < 8 { 0 } else { signature };
        Self { map: 0x80, code }
    }

    /// The tag of this number, as OpenMV's script tells it: a colour code.
    pub const fn tag(number: u16) -> Self {
        Self::code(number.saturating_add(8))
    }

    /// Returns true if a block of this signature is asked for.
    pub(crate) const fn has(self, signature: u16) -> bool {
        match signature {
            0 => false,
            1..=7 => self.map >> (signature - 1) & 1 != 0,
            _ => self.map & 0x80 != 0 && (self.code == 0 || self.code == signature),
        }
    }
}

/// Something to be asked of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Request {
    /// Version of the camera.
    Version,
    /// Columns and rows of the frames in which blobs are found.
    Resolution,
    /// The largest blobs of the next frame.
    Blocks {
        /// Of these signatures.
        of: Signatures,
        /// At most so many.
        most: u8,
    },
    /// Brightness of the picture that automatic exposure aims at.
    Brightness(u8),
    /// The white lamp on the front, and the coloured one at the bottom.
    Lamp {
        /// The white one.
        upper: bool,
        /// The coloured one.
        lower: bool,
    },
    /// Number of frames a second.
    FramesPerSecond,
}

/// The bytes of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoded {
    bytes: [u8; REQUEST_MAX],
    len: u8,
}

impl Encoded {
    /// Bytes to be sent.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or_default()
    }
}

impl Request {
    /// Its bytes.
    pub fn encode(self) -> Encoded {
        let (kind, [first, second], len) = match self {
            Self::Version => (0x0E, [0; 2], 0),
            Self::Resolution => (0x0C, [0; 2], 1),
            Self::Blocks { of, most } => (0x20, [of.map, most], 2),
            Self::Brightness(level) => (0x10, [level, 0], 1),
            Self::Lamp { upper, lower } => (0x16, [u8::from(upper), u8::from(lower)], 2),
            Self::FramesPerSecond => (0x18, [0; 2], 0),
        };
        let [low, high] = (u16::from(first) + u16::from(second)).to_le_bytes();
        Encoded {
            bytes: [SYNC, SYNC_HIGH, kind, len, low, high, first, second],
            len: HEAD + len,
        }
    }

    /// The type of the packet that answers it.
    pub(crate) const fn answered_by(self) -> u8 {
        match self {
            Self::Version => kind::VERSION,
            Self::Resolution => kind::RESOLUTION,
            Self::Blocks { .. } => kind::BLOCKS,
            Self::Brightness(_) | Self::Lamp { .. } | Self::FramesPerSecond => kind::RESULT,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Before the upper byte of the synchronisation word; whether its lower one came last.
    Sync(bool),
    Kind,
    Length,
    /// Number of its bytes that have come.
    Sum(u8),
    Payload {
        got: u8,
    },
}

/// Result of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Heard {
    /// Nothing yet.
    Nothing,
    /// A packet of this type: its [payload](Parser::payload) is there until the next byte.
    Packet(u8),
    /// A packet whose checksum is wrong.
    Damaged,
}

/// Finds packets in bytes.
#[derive(Clone, Debug)]
pub struct Parser {
    state: State,
    kind: u8,
    length: u8,
    sum: u16,
    payload: [u8; PAYLOAD_MAX],
}

impl Default for Parser {
    fn default() -> Self {
        Self {
            state: State::Sync(false),
            kind: 0,
            length: 0,
            sum: 0,
            payload: [0; PAYLOAD_MAX],
        }
    }
}

impl Parser {
    /// Drops a packet that has begun.
    pub fn clear(&mut self) {
        self.state = State::Sync(false);
    }

    /// Payload of the packet that came last.
    pub fn payload(&self) -> &[u8] {
        self.payload
            .get(..usize::from(self.length))
            .unwrap_or_default()
    }

    /// Takes a byte.
    pub fn push(&mut self, byte: u8) -> Heard {
        self.state = match self.state {
            State::Sync(true) if byte == SYNC_HIGH => State::Kind,
            State::Sync(_) => State::Sync(byte == SYNC),
            State::Kind => {
                self.kind = byte;
                State::Length
            }
            State::Length => {
                self.length = byte;
                State::Sum(0)
            }
            State::Sum(0) => {
                self.sum = byte.into();
                State::Sum(1)
            }
            State::Sum(_) => {
                self.sum |= u16::from(byte) << 8;
                if self.length == 0 {
                    return self.ended();
                }
                State::Payload { got: 0 }
            }
            State::Payload { got } => {
                if let Some(place) = self.payload.get_mut(usize::from(got)) {
                    *place = byte;
                }
                if got + 1 == self.length {
                    return self.ended();
                }
                State::Payload { got: got + 1 }
            }
        };
        Heard::Nothing
    }

    fn ended(&mut self) -> Heard {
        self.state = State::Sync(false);
        // 255 bytes of 255 fit.
        let sum: u16 = self.payload().iter().copied().map(u16::from).sum();
        if self.sum == sum {
            Heard::Packet(self.kind)
        } else {
            Heard::Damaged
        }
    }
}

pub(crate) fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    let pair = bytes.get(at..)?.first_chunk()?;
    Some(u16::from_le_bytes(*pair))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use super::*;

    fn heard(bytes: &[u8]) -> Vec<Heard> {
        let mut parser = Parser::default();
        let all = bytes.iter().map(|&byte| parser.push(byte));
        all.filter(|heard| *heard != Heard::Nothing).collect()
    }

    /// The maker's documentation has these types and payloads.
    #[test]
    fn requests_as_the_maker_writes_them() {
        let blocks = Request::Blocks {
            of: Signatures::one(1),
            most: 2,
        };
        for (request, bytes) in [
            (Request::Version, &[0xAF, 0xC1, 0x0E, 0, 0, 0][..]),
            (Request::Resolution, &[0xAF, 0xC1, 0x0C, 1, 0, 0, 0]),
            (blocks, &[0xAF, 0xC1, 0x20, 2, 3, 0, 1, 2]),
            (
                Request::Lamp {
                    upper: true,
                    lower: false,
                },
                &[0xAF, 0xC1, 0x16, 2, 1, 0, 1, 0],
            ),
        ] {
            assert_eq!(request.encode().as_bytes(), bytes);
        }
        assert_eq!(
            (Signatures::one(7).map, Signatures::one(8)),
            (64, Signatures::ALL)
        );
        let all = Request::Blocks {
            of: Signatures::ALL,
            most: 2,
        };
        assert_eq!(all.encode().as_bytes()[4..], [1, 1, 255, 2]);
    }

    #[test]
    fn packets_with_a_checksum_that_holds_among_other_bytes() {
        let resolution = Heard::Packet(kind::RESOLUTION);
        let plain = [0xAE, 0xC1, 0x0D, 4, 0x3C, 1, 0xD0, 0];
        let summed = [0xAF, 0xC1, 0x0D, 4, 0x0D, 1, 0x3C, 1, 0xD0, 0];
        assert_eq!(heard(&plain), []);
        assert_eq!(heard(&summed), [resolution]);
        for (place, heard_of_it) in [(0, &[][..]), (8, &[Heard::Damaged])] {
            let mut damaged = summed;
            damaged[place] ^= 1;
            assert_eq!(heard(&damaged), heard_of_it);
        }
        let among = [
            &[0xC1, 0xAF, 0xAE, 0xAF][..],
            &summed,
            &[0xC1, 0x55],
            &summed,
        ]
        .concat();
        assert_eq!(heard(&among[..3 + 10]), []);
        assert_eq!(heard(&among[3..]), [Heard::Packet(kind::RESOLUTION); 2]);
        assert_eq!(
            heard(&[0xAF, 0xC1, 0x21, 0, 0, 0]),
            [Heard::Packet(kind::BLOCKS)]
        );
        assert_eq!(heard(&[0xAF, 0xC1, 0x21, 0, 1, 0]), [Heard::Damaged]);
    }
}
