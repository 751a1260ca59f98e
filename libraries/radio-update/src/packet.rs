//! Messages between the side that sends and a node.
//!
//! The first byte is the kind; numbers are little-endian. A packet of an unknown kind is ignored, so that kinds can be
//! added.
//!
//! | kind | then |
//! |---|---|
//! | 1, offer | package (4), bytes of its header (2), first block to be listed (2; 0xFFFF: no answer), time to spread answers over, ms (2) |
//! | 2, block | package (4), number of the block (2), its bytes |
//! | 3, mix | package (4), count (1), numbers of blocks (2 each), the exclusive or of their bytes |
//! | 4, install | package (4) |
//! | 5, status | package (4), version that runs (4), phase (1), missing blocks (2), [ranges](Ranges) of them |

use crate::BLOCK;

/// Bytes of the longest packet.
pub const PACKET_MAX: usize = 92;

/// Most blocks in one mix.
pub const MIX_MAX: usize = (PACKET_MAX - 6 - BLOCK) / 2;

/// Bytes for ranges in one status.
pub const RANGES_MAX: usize = PACKET_MAX - 12;

/// Ranges of missing blocks, in order: of each the number of blocks since the end of the one before, and its length.
/// Numbers have seven bits in a byte, the lowest first, and the highest bit where more follow.
#[derive(Clone, Copy, Debug)]
pub struct Ranges<'a> {
    bytes: &'a [u8],
    end: u16,
}

impl<'a> Ranges<'a> {
    /// The ranges in these bytes.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, end: 0 }
    }

    fn number(&mut self) -> Option<u16> {
        let mut number = 0_u32;
        for shift in [0, 7, 14] {
            let (&byte, rest) = self.bytes.split_first()?;
            self.bytes = rest;
            number |= u32::from(byte & 0x7F) << shift;
            if byte & 0x80 == 0 {
                return u16::try_from(number).ok();
            }
        }
        None
    }
}

impl Iterator for Ranges<'_> {
    /// The first block of a range, and the one behind it.
    type Item = (u16, u16);

    fn next(&mut self) -> Option<(u16, u16)> {
        let start = self.end.checked_add(self.number()?)?;
        self.end = start.checked_add(self.number()?)?;
        Some((start, self.end))
    }
}

/// Writes ranges into a status.
#[derive(Clone, Debug)]
pub(crate) struct RangeWriter {
    bytes: [u8; RANGES_MAX],
    length: usize,
    end: usize,
}

impl RangeWriter {
    pub(crate) const fn new() -> Self {
        Self {
            bytes: [0; RANGES_MAX],
            length: 0,
            end: 0,
        }
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    /// Adds a range. Returns false if there is no room.
    pub(crate) fn push(&mut self, start: usize, count: usize) -> bool {
        let before = self.length;
        let is_written = self.number(start - self.end.min(start)) && self.number(count);
        if is_written {
            self.end = start + count;
        } else {
            self.length = before;
        }
        is_written
    }

    fn number(&mut self, mut number: usize) -> bool {
        loop {
            let more = if number > 0x7F { 0x80 } else { 0 };
            let Some(place) = self.bytes.get_mut(self.length) else {
                return false;
            };
            *place = (number & 0x7F) as u8 | more;
            self.length += 1;
            number >>= 7;
            if more == 0 {
                return true;
            }
        }
    }
}

/// No answer to an offer is wanted.
pub const NO_ANSWER: u16 = u16::MAX;

/// A message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Packet<'a> {
    /// There is a package: tell what is missing of it.
    Offer {
        /// Name of the package.
        package: u32,
        /// Bytes of its header.
        header: u16,
        /// The first block to be listed in the answer; [`NO_ANSWER`]: none is wanted.
        from: u16,
        /// Each node waits up to this time before it answers, milliseconds.
        spread_ms: u16,
    },
    /// A block.
    Block {
        /// Name of the package.
        package: u32,
        /// Number of the block.
        number: u16,
        /// Its bytes.
        bytes: &'a [u8; BLOCK],
    },
    /// The exclusive or of several blocks: a node that misses one of them has it then.
    Mix {
        /// Name of the package.
        package: u32,
        /// Numbers of the blocks, two bytes each.
        numbers: &'a [u8],
        /// The bytes.
        bytes: &'a [u8; BLOCK],
    },
    /// Change to the new image now.
    Install {
        /// Name of the package.
        package: u32,
    },
    /// A node's answer.
    Status {
        /// Name of the package that it knows of; 0: none.
        package: u32,
        /// Version of the image that runs.
        version: u32,
        /// State of the update.
        phase: Phase,
        /// Number of the blocks that it misses.
        missing: u16,
        /// [`Ranges`] of them.
        ranges: &'a [u8],
    },
}

/// State of the update of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
#[repr(u8)]
pub enum Phase {
    /// Nothing was offered.
    Idle = 0,
    /// It takes the header.
    Header = 1,
    /// It erases, or looks for what it has.
    Preparing = 2,
    /// It takes blocks.
    Receiving = 3,
    /// It has all, and checks the hash.
    Checking = 4,
    /// It has all, and waits for the word to change images.
    Complete = 5,
    /// It restarts to change images.
    Installing = 6,
    /// The new image runs on trial.
    Trial = 7,
    /// The image of this package runs.
    Installed = 8,
    /// The new image did not find its network, and the node went back to the former one.
    Reverted = 9,
    /// The header is not signed by the owner of this site.
    Forged = 16,
    /// The image is not newer than the one that runs.
    Older = 17,
    /// The image is for another board, or lacks the role of the node.
    Foreign = 18,
    /// The image is longer than its place.
    TooLong = 19,
    /// The node was given no key to check images with.
    NoKey = 20,
    /// The hash of the image is another one.
    Damaged = 21,
    /// The flash fails.
    Flash = 22,
}

impl Phase {
    const ALL: [Self; 17] = [
        Self::Idle,
        Self::Header,
        Self::Preparing,
        Self::Receiving,
        Self::Checking,
        Self::Complete,
        Self::Installing,
        Self::Trial,
        Self::Installed,
        Self::Reverted,
        Self::Forged,
        Self::Older,
        Self::Foreign,
        Self::TooLong,
        Self::NoKey,
        Self::Damaged,
        Self::Flash,
    ];

    fn of(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|phase| *phase as u8 == number)
    }

    /// Returns true if the node has refused the package.
    pub const fn is_refusal(self) -> bool {
        self as u8 >= Self::Forged as u8
    }
}

impl core::fmt::Display for Phase {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Idle => "knows of no update",
            Self::Header => "takes the header",
            Self::Preparing => "prepares its flash",
            Self::Receiving => "takes blocks",
            Self::Checking => "checks the image",
            Self::Complete => "has the image",
            Self::Installing => "changes images",
            Self::Trial => "tries the new image",
            Self::Installed => "runs the new image",
            Self::Reverted => {
                "went back to its former image: the new one did not find its network in time"
            }
            Self::Forged => {
                "refuses the image: it is not signed with the key that the node was provisioned with"
            }
            Self::Older => "refuses the image: it is not newer than the one that runs",
            Self::Foreign => "refuses the image: it is for another board, or lacks the node's role",
            Self::TooLong => "refuses the image: it is longer than its place in the flash",
            Self::NoKey => {
                "refuses the image: the node has no key to check it with; provision it anew"
            }
            Self::Damaged => "refuses the image: its hash is not the one in its header",
            Self::Flash => "cannot take the image: its flash fails",
        })
    }
}

/// Splits a number off.
fn number2(bytes: &[u8]) -> Option<(u16, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u16::from_le_bytes(*number), rest))
}

fn number4(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u32::from_le_bytes(*number), rest))
}

impl<'a> Packet<'a> {
    /// Reads a packet; `None`: these bytes are none, or of an unknown kind.
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (&kind, rest) = bytes.split_first()?;
        let (package, rest) = number4(rest)?;
        Some(match kind {
            1 => {
                let (header, rest) = number2(rest)?;
                let (from, rest) = number2(rest)?;
                let (spread_ms, _) = number2(rest)?;
                Self::Offer {
                    package,
                    header,
                    from,
                    spread_ms,
                }
            }
            2 => {
                let (number, rest) = number2(rest)?;
                Self::Block {
                    package,
                    number,
                    bytes: rest.first_chunk()?,
                }
            }
            3 => {
                let (&count, rest) = rest.split_first()?;
                let (numbers, rest) = rest.split_at_checked(2 * usize::from(count))?;
                Self::Mix {
                    package,
                    numbers,
                    bytes: rest.first_chunk()?,
                }
            }
            4 => Self::Install { package },
            5 => {
                let (version, rest) = number4(rest)?;
                let (&phase, rest) = rest.split_first()?;
                let (missing, ranges) = number2(rest)?;
                Self::Status {
                    package,
                    version,
                    phase: Phase::of(phase)?,
                    missing,
                    ranges,
                }
            }
            _ => return None,
        })
    }

    /// Writes it, and returns its length. What does not fit is left out.
    pub fn write(&self, buffer: &mut [u8; PACKET_MAX]) -> usize {
        let mut writer = Writer { buffer, length: 0 };
        match *self {
            Self::Offer {
                package,
                header,
                from,
                spread_ms,
            } => {
                writer.start(1, package);
                for number in [header, from, spread_ms] {
                    writer.put(&number.to_le_bytes());
                }
            }
            Self::Block {
                package,
                number,
                bytes,
            } => {
                writer.start(2, package);
                writer.put(&number.to_le_bytes());
                writer.put(bytes);
            }
            Self::Mix {
                package,
                numbers,
                bytes,
            } => {
                writer.start(3, package);
                writer.put(&[(numbers.len() / 2) as u8]);
                writer.put(numbers);
                writer.put(bytes);
            }
            Self::Install { package } => writer.start(4, package),
            Self::Status {
                package,
                version,
                phase,
                missing,
                ranges,
            } => {
                writer.start(5, package);
                writer.put(&version.to_le_bytes());
                writer.put(&[phase as u8]);
                writer.put(&missing.to_le_bytes());
                writer.put(ranges);
            }
        }
        writer.length
    }
}

struct Writer<'a> {
    buffer: &'a mut [u8; PACKET_MAX],
    length: usize,
}

impl Writer<'_> {
    fn start(&mut self, kind: u8, package: u32) {
        self.put(&[kind]);
        self.put(&package.to_le_bytes());
    }

    fn put(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Some(place) = self.buffer.get_mut(self.length) {
                *place = *byte;
                self.length += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    #[test]
    fn packets_are_read_as_they_were_written() {
        let bytes = [0xA5; BLOCK];
        let (numbers, ranges) = ([7; 2 * MIX_MAX], [9; RANGES_MAX]);
        for packet in [
            Packet::Offer {
                package: 0x0102_0304,
                header: 116,
                from: 5,
                spread_ms: 1500,
            },
            Packet::Block {
                package: 1,
                number: 0x1234,
                bytes: &bytes,
            },
            Packet::Mix {
                package: 1,
                numbers: &numbers,
                bytes: &bytes,
            },
            Packet::Install { package: u32::MAX },
            Packet::Status {
                package: 1,
                version: 2,
                phase: Phase::Damaged,
                missing: 700,
                ranges: &ranges,
            },
        ] {
            let mut buffer = [0; PACKET_MAX];
            let length = packet.write(&mut buffer);
            assert_eq!(Packet::parse(&buffer[..length]), Some(packet));
            for short in 0..5 {
                assert_eq!(Packet::parse(&buffer[..short]), None);
            }
        }
        assert_eq!(Packet::parse(&[77, 0, 0, 0, 0]), None);
        for phase in Phase::ALL {
            assert_eq!(Phase::of(phase as u8), Some(phase));
        }
    }

    #[test]
    fn ranges_are_read_as_they_were_written() {
        let mut writer = RangeWriter::new();
        let ranges = [(0, 1), (1, 2), (130, 1), (6000, 152)];
        assert!(
            ranges
                .iter()
                .all(|&(start, count)| writer.push(start, count))
        );
        let read: Vec<_> = Ranges::new(writer.bytes()).collect();
        assert_eq!(read, [(0, 1), (1, 3), (130, 131), (6000, 6152)]);
        // One block in eighty: forty of them fit.
        let mut writer = RangeWriter::new();
        let pushed = (1..100)
            .take_while(|number| writer.push(80 * number, 1))
            .count();
        assert_eq!(pushed, RANGES_MAX / 2);
        assert_eq!(Ranges::new(writer.bytes()).count(), pushed);
        for wrong in [
            &[0x80][..],
            &[5],
            &[0xFF, 0xFF, 0xFF, 1],
            &[0xFF, 0xFF, 3, 1],
        ] {
            assert_eq!(Ranges::new(wrong).next(), None, "{wrong:?}");
        }
    }

    /// The bytes are the format: they do not change.
    #[test]
    fn golden_bytes() {
        let mut buffer = [0; PACKET_MAX];
        let offer = Packet::Offer {
            package: 0x0403_0201,
            header: 0x0605,
            from: 0x0807,
            spread_ms: 0x0a09,
        };
        let length = offer.write(&mut buffer);
        assert_eq!(buffer[..length], [1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10]);
        let status = Packet::Status {
            package: 0x0403_0201,
            version: 0x0807_0605,
            phase: Phase::Complete,
            missing: 1,
            ranges: &[2, 1],
        };
        let length = status.write(&mut buffer);
        assert_eq!(buffer[..length], [5, 1, 2, 3, 4, 5, 6, 7, 8, 5, 1, 0, 2, 1]);
    }
}
