//! HDLC-lite: frames on a line of bytes.
//!
//! A frame is its content and a CRC-16/X-25 of it, little-endian, between two flags. Bytes with a meaning on the
//! line are escaped. RFC 1662 describes this for PPP; Spinel's form also escapes XON, XOFF and 0xF8
//! (draft-rquattle-spinel-unified, HDLC-Lite).

use zigbee_link::wire::crc_16;

const FLAG: u8 = 0x7E;
const ESCAPE: u8 = 0x7D;
/// Bit that is flipped in an escaped byte.
const FLIP: u8 = 0x20;
const XON: u8 = 0x11;
const XOFF: u8 = 0x13;
/// Kept free for the vendor of a line.
const VENDOR: u8 = 0xF8;

const CRC_START: u16 = 0xFFFF;
/// The CRC over content and its own CRC, before the final complement.
const CRC_GOOD: u16 = 0xF0B8;
const CRC_LEN: usize = 2;

const fn is_special(byte: u8) -> bool {
    matches!(byte, FLAG | ESCAPE | XON | XOFF | VENDOR)
}

/// The frame around `content`, one byte after the other.
pub fn encode(content: &[u8]) -> impl Iterator<Item = u8> {
    let mut encoder = Encoder::new();
    core::iter::from_fn(move || encoder.next(content))
}

/// A frame that is being written. The content is handed in each time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Encoder {
    place: Place,
    crc: u16,
    /// The second half of an escaped byte.
    escaped: Option<u8>,
}

#[derive(Clone, Copy, Debug)]
enum Place {
    Opening,
    Content(usize),
    CrcHigh,
    Closing,
    End,
}

impl Encoder {
    pub(crate) const fn new() -> Self {
        Self {
            place: Place::Opening,
            crc: CRC_START,
            escaped: None,
        }
    }

    /// Returns true if the closing flag was given.
    pub(crate) const fn is_at_end(&self) -> bool {
        matches!(self.place, Place::End)
    }

    pub(crate) fn next(&mut self, content: &[u8]) -> Option<u8> {
        if let Some(byte) = self.escaped.take() {
            return Some(byte);
        }
        let [low, high] = (!self.crc).to_le_bytes();
        let (byte, next) = match self.place {
            // Also ends the rest of a broken write on the line.
            Place::Opening => {
                self.place = Place::Content(0);
                return Some(FLAG);
            }
            Place::Content(index) => match content.get(index) {
                Some(&byte) => {
                    self.crc = crc_16(self.crc, byte);
                    (byte, Place::Content(index + 1))
                }
                None => (low, Place::CrcHigh),
            },
            Place::CrcHigh => (high, Place::Closing),
            Place::Closing => {
                self.place = Place::End;
                return Some(FLAG);
            }
            Place::End => return None,
        };
        self.place = next;
        if is_special(byte) {
            self.escaped = Some(byte ^ FLIP);
            Some(ESCAPE)
        } else {
            Some(byte)
        }
    }
}

/// Frames that were not delivered. Counters stay at their maximum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DroppedFrames {
    /// Wrong CRC, too short for one, or ended by a flag after an escape.
    pub damaged: u32,
    /// Longer than the buffer.
    pub oversized: u32,
}

/// Finds frames among bytes. `N` is the length of the longest content and 2 for its CRC.
///
/// Starts, and starts again after anything wrong, at the next flag.
#[derive(Clone, Debug)]
pub struct Decoder<const N: usize> {
    buffer: [u8; N],
    len: usize,
    crc: u16,
    state: State,
    dropped: DroppedFrames,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Nothing counts before the next flag.
    Lost,
    Inside,
    Escaped,
}

impl<const N: usize> Decoder<N> {
    /// A decoder that has seen no byte yet.
    pub const fn new() -> Self {
        Self {
            buffer: [0; N],
            len: 0,
            crc: CRC_START,
            state: State::Lost,
            dropped: DroppedFrames {
                damaged: 0,
                oversized: 0,
            },
        }
    }

    /// Counts of frames that were not delivered so far.
    pub const fn dropped(&self) -> DroppedFrames {
        self.dropped
    }

    /// Takes the next byte of the line. Returns the content of the frame that it ends.
    pub fn push(&mut self, byte: u8) -> Option<&[u8]> {
        match (byte, self.state) {
            (FLAG, state) => {
                let len = self.len;
                let is_good = state == State::Inside && self.crc == CRC_GOOD;
                let is_empty = len == 0 && state == State::Inside;
                self.begin();
                if is_good && len > CRC_LEN {
                    return self.buffer.get(..len - CRC_LEN);
                }
                if state != State::Lost && !is_empty {
                    self.dropped.damaged = self.dropped.damaged.saturating_add(1);
                }
            }
            (_, State::Lost) => {}
            (ESCAPE, State::Inside) => self.state = State::Escaped,
            (byte, State::Inside) => self.store(byte),
            (byte, State::Escaped) => {
                self.state = State::Inside;
                self.store(byte ^ FLIP);
            }
        }
        None
    }

    fn begin(&mut self) {
        self.state = State::Inside;
        self.len = 0;
        self.crc = CRC_START;
    }

    fn store(&mut self, byte: u8) {
        if let Some(place) = self.buffer.get_mut(self.len) {
            *place = byte;
            self.len += 1;
            self.crc = crc_16(self.crc, byte);
        } else {
            self.state = State::Lost;
            self.dropped.oversized = self.dropped.oversized.saturating_add(1);
        }
    }
}

impl<const N: usize> Default for Decoder<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use std::{vec, vec::Vec};

    use proptest::{collection::vec as bytes, prelude::*};

    use super::*;

    fn decode<const N: usize>(decoder: &mut Decoder<N>, line: &[u8]) -> Vec<Vec<u8>> {
        line.iter()
            .filter_map(|&byte| decoder.push(byte).map(<[u8]>::to_vec))
            .collect()
    }

    fn encoded(content: &[u8]) -> Vec<u8> {
        encode(content).collect()
    }

    /// The check value 0x906E of the catalogue of CRCs.
    #[test]
    fn crc_16_x_25() {
        let line = encoded(b"123456789");
        assert_eq!(line, b"\x7E123456789\x6E\x90\x7E");
    }

    /// A reset, and the message of an `ot-rcp` after it.
    #[test]
    fn golden_frames() {
        let line = [0x7E, 0x80, 0x01, 0x02, 0xEA, 0xF0, 0x7E];
        assert_eq!(encoded(&[0x80, 0x01, 0x02]), line);
        let reset = [0x7E, 0x80, 0x06, 0x00, 0x70, 0xEE, 0x74, 0x7E];
        assert_eq!(encoded(&[0x80, 0x06, 0x00, 0x70]), reset);
        let mut decoder = Decoder::<8>::new();
        assert_eq!(decode(&mut decoder, &reset), [[0x80, 0x06, 0x00, 0x70]]);
    }

    #[test]
    fn special_bytes_are_escaped_and_only_they() {
        for byte in 0..=255_u8 {
            let line = encoded(&[byte, 0]);
            let special = [0x7E, 0x7D, 0x11, 0x13, 0xF8].contains(&byte);
            assert_eq!(line[1] == 0x7D, special, "{byte:#x}");
            assert_eq!(
                line[1 + usize::from(special)],
                byte ^ (0x20 * u8::from(special))
            );
        }
    }

    #[test]
    fn one_flag_between_two_frames_is_enough() {
        let mut line = encoded(b"one");
        line.pop();
        line.extend(encoded(b"two"));
        let mut decoder = Decoder::<8>::new();
        assert_eq!(decode(&mut decoder, &line), [b"one", b"two"]);
        assert_eq!(decoder.dropped(), DroppedFrames::default());
    }

    #[test]
    fn the_buffer_is_the_longest_frame() {
        let mut decoder = Decoder::<8>::new();
        assert_eq!(decode(&mut decoder, &encoded(&[1; 6])), [[1; 6]]);
        assert!(decode(&mut decoder, &encoded(&[1; 7])).is_empty());
        assert_eq!(decode(&mut decoder, &encoded(&[2; 6])), [[2; 6]]);
        assert_eq!(decoder.dropped().oversized, 1);
        assert_eq!(decoder.dropped().damaged, 0);
    }

    #[test]
    fn what_is_no_frame_is_counted_once() {
        let mut decoder = Decoder::<8>::new();
        // Noise before the first flag, nothing, too short, cut off in an escape, a CRC of nothing.
        assert!(decode(&mut decoder, b"noise\x7E\x7E\x7E").is_empty());
        assert_eq!(decoder.dropped().damaged, 0);
        assert!(decode(&mut decoder, b"a\x7Eab\x7Eab\x7D\x7E\x00\x00\x7E").is_empty());
        assert_eq!(decoder.dropped().damaged, 4);
        assert_eq!(decode(&mut decoder, &encoded(b"good")), [b"good"]);
    }

    #[test]
    fn counters_stay_at_their_maximum() {
        let mut decoder = Decoder::<8>::new();
        let full = DroppedFrames {
            damaged: u32::MAX,
            oversized: u32::MAX,
        };
        decoder.dropped = full;
        let line = [&[FLAG, 1, 2, 3, FLAG][..], &[9; 20], &[FLAG]].concat();
        assert!(decode(&mut decoder, &line).is_empty());
        assert_eq!(decoder.dropped(), full);
    }

    proptest! {
        #[test]
        fn encoding_then_decoding_is_the_identity(
            contents in bytes(bytes(any::<u8>(), 1..40), 1..5)
        ) {
            let line: Vec<u8> = contents.iter().flat_map(|content| encode(content)).collect();
            let mut decoder = Decoder::<48>::new();
            prop_assert_eq!(decode(&mut decoder, &line), contents);
            prop_assert_eq!(decoder.dropped(), DroppedFrames::default());
        }

        /// The opening flag ends any bytes that came before.
        #[test]
        fn resynchronises_after_any_bytes(
            noise in bytes(any::<u8>(), 0..200), content in bytes(any::<u8>(), 1..40)
        ) {
            let mut decoder = Decoder::<48>::new();
            decode(&mut decoder, &noise);
            prop_assert_eq!(decode(&mut decoder, &encoded(&content)), vec![content]);
        }

        /// Up to three flipped bits within a frame of this length are always seen (X-25 has a
        /// Hamming distance of 4 up to 32751 bits), unless they touch the framing itself.
        #[test]
        fn flipped_bits_are_seen(
            content in bytes(0x20..0x70_u8, 4..40),
            flips in bytes((0..1000_usize, 0..3_u32), 1..4),
        ) {
            let mut line = encoded(&content);
            let inner = line.len() - 2;
            prop_assume!(line[1..=inner].iter().all(|&byte| !is_special(byte)));
            let good = line.clone();
            for (index, bit) in flips {
                line[1 + index % inner] ^= 1 << bit;
            }
            prop_assume!(line[1..=inner].iter().all(|&byte| !is_special(byte)));
            let mut decoder = Decoder::<48>::new();
            prop_assert_eq!(decode(&mut decoder, &line).is_empty(), line != good);
        }
    }
}
