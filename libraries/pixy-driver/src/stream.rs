//! The stream of a camera that tells blobs without being asked, out of bytes.
//!
//! Words have 16 bits, the lower byte first. A block is a synchronisation word (0xAA55 of a colour, 0xAA56 of a colour
//! code), the sum of the words that follow, signature, x, y, width, height, and of a code its angle. A further 0xAA55
//! before the first block begins a picture. Zero words fill gaps: the end of a picture, or one with nothing in it.
//!
//! The next block is found from any byte on. What looks like a synchronisation word inside a block has no sum
//! that holds; then one byte is dropped, and the next word is looked for. A line may have lost one byte.

use crate::{block::Block, packet::u16_at};

const BLOCK: u16 = 0xAA55;
const CODE: u16 = 0xAA56;

/// Bytes of the longest block.
const HEARD: usize = 16;

/// Zero bytes in a row that are no part of a block.
const ZEROS: u8 = 6;

/// Content of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Event {
    /// A picture begins.
    Picture,
    /// A blob of it.
    Block(Block),
    /// A zero word.
    Zero,
    /// Bytes that make no sense follow the last event.
    Damaged,
}

/// Finds blocks in bytes: after each [`push`](Stream::push), take the [events](Stream::next_event) until there are
/// none.
#[derive(Clone, Debug, Default)]
pub struct Stream {
    /// Bytes that have come, and zeros.
    heard: [u8; HEARD],
    length: u8,
    /// The bytes so far were words.
    is_aligned: bool,
    /// Zero bytes in a row, while they were not.
    zeros: u8,
}

impl Stream {
    /// Takes a byte. The first of 16 bytes that were not taken as events is lost.
    pub fn push(&mut self, byte: u8) {
        if usize::from(self.length) >= HEARD {
            self.drop(1);
        }
        if let Some(place) = self.heard.get_mut(usize::from(self.length)) {
            *place = byte;
        }
        self.length += 1;
    }

    // for less flash
    #[inline(never)]
    fn drop(&mut self, bytes: u8) {
        for place in 0..HEARD {
            let next = self.heard.get(place + usize::from(bytes)).copied();
            if let Some(place) = self.heard.get_mut(place) {
                *place = next.unwrap_or(0);
            }
        }
        self.length = self.length.saturating_sub(bytes);
    }

    /// The next event.
    pub fn next_event(&mut self) -> Option<Event> {
        while self.length >= 2 {
            let word = |place: usize| u16_at(&self.heard, 2 * place).unwrap_or(0);
            let (sync, sum) = (word(0), word(1));
            let bytes = match sync {
                BLOCK if self.length >= 4 && matches!(sum, BLOCK | CODE) => {
                    self.drop(2);
                    self.is_aligned = true;
                    return Some(Event::Picture);
                }
                BLOCK => 14,
                CODE => 16,
                0 if self.is_aligned => {
                    self.drop(2);
                    return Some(Event::Zero);
                }
                _ => 0,
            };
            if self.length < bytes {
                return None;
            }
            if bytes > 0 {
                let block = Block {
                    signature: word(2),
                    x: word(3),
                    y: word(4),
                    width: word(5),
                    height: word(6),
                    angle: if bytes == 16 {
                        word(7).cast_signed()
                    } else {
                        0
                    },
                    index: 0,
                    age: 0,
                };
                if block.signature > 0 && block.sum() == sum {
                    self.drop(bytes);
                    self.is_aligned = true;
                    return Some(Event::Block(block));
                }
            }
            let is_zero = self.heard.first() == Some(&0);
            self.drop(1);
            self.zeros = if is_zero { self.zeros + 1 } else { 0 };
            if core::mem::take(&mut self.is_aligned) {
                self.zeros = u8::from(is_zero);
                return Some(Event::Damaged);
            }
            if self.zeros >= ZEROS {
                self.zeros = 0;
                self.is_aligned = true;
                return Some(Event::Zero);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::{vec, vec::Vec};

    use proptest::prelude::*;

    use super::*;

    fn heard(bytes: &[u8]) -> Vec<Event> {
        let mut stream = Stream::default();
        let mut events = Vec::new();
        for &byte in bytes {
            stream.push(byte);
            while let Some(event) = stream.next_event() {
                events.push(event);
            }
        }
        events
    }

    const fn block(signature: u16, numbers: [u16; 4], angle: i16) -> Block {
        let [x, y, width, height] = numbers;
        Block {
            signature,
            x,
            y,
            width,
            height,
            angle,
            index: 0,
            age: 0,
        }
    }

    /// Bytes that OpenMV's own scripts have sent, see `tests/data/openmv`: nothing in every third picture.
    #[test]
    fn bytes_of_other_programs() {
        let blobs = heard(include_bytes!("../../../tests/data/openmv/blobs.bin"));
        let tags = heard(include_bytes!("../../../tests/data/openmv/tags.bin"));
        let (mut of_blobs, mut of_tags) = (Vec::new(), Vec::new());
        for picture in 2..=8_u16 {
            if picture.is_multiple_of(3) {
                of_blobs.push(Event::Zero);
                of_tags.push(Event::Zero);
                continue;
            }
            let blob = block(3, [100 + picture, 80, 20, 22], 0);
            of_blobs.extend([Event::Picture, Event::Block(blob), Event::Zero]);
            let tag = block(13, [60 + picture, 40, 15, 15], 28);
            of_tags.extend([Event::Picture, Event::Block(tag), Event::Zero]);
        }
        assert_eq!((blobs, tags), (of_blobs, of_tags));
    }

    /// Order of words and sums are those of the maker's porting guide; a code of signatures 1 and 2 that is turned
    /// by -20 degrees.
    #[test]
    fn a_block_and_a_colour_code() {
        let bytes = [
            &[
                0x55, 0xAA, 0x55, 0xAA, 0xFD, 0, 1, 0, 0x9E, 0, 0x34, 0, 0x15, 0, 0x15, 0,
            ][..],
            &[
                0x56, 0xAA, 0x34, 0, 0x0A, 0, 0x10, 0, 0x20, 0, 8, 0, 6, 0, 0xEC, 0xFF,
            ],
            &[0, 0, 0, 0],
        ]
        .concat();
        let events = [
            Event::Picture,
            Event::Block(block(1, [158, 52, 21, 21], 0)),
            Event::Block(block(0o12, [16, 32, 8, 6], -20)),
            Event::Zero,
            Event::Zero,
        ];
        assert_eq!(heard(&bytes), events);
        // Without its first byte the block is found, and the picture's beginning is not.
        assert_eq!(heard(&bytes[1..])[..], events[1..]);
        // A wrong sum, and no signature.
        let mut damaged = bytes.clone();
        damaged[8] ^= 1;
        assert_eq!(heard(&damaged)[..3], [events[0], Event::Damaged, events[2]]);
        let none = [0x55, 0xAA, 3, 0, 0, 0, 1, 0, 1, 0, 1, 0, 0, 0, 9];
        assert_eq!(heard(&none), []);
    }

    fn words(block: &Block, is_code: bool) -> Vec<u8> {
        let mut numbers = vec![block.signature, block.x, block.y, block.width, block.height];
        numbers.extend(is_code.then_some(block.angle.cast_unsigned()));
        let sum = numbers
            .iter()
            .fold(0_u16, |sum, &word| sum.wrapping_add(word));
        let head = [if is_code { CODE } else { BLOCK }, sum];
        let all = head.into_iter().chain(numbers);
        all.flat_map(u16::to_le_bytes).collect()
    }

    fn any_block() -> impl Strategy<Value = (Block, bool)> {
        (
            1..8_u16,
            8..0o7777_u16,
            any::<bool>(),
            0..320_u16,
            0..240_u16,
            1..99_u16,
            -180..=180_i16,
        )
            .prop_map(|(colour, code, is_code, x, y, size, angle)| {
                let (signature, angle) = if is_code { (code, angle) } else { (colour, 0) };
                (block(signature, [x, y, size, 2 * size], angle), is_code)
            })
    }

    proptest! {
        /// Garbage before, after and in between; by chance it would have a sum that holds once in 65,536 times.
        #[test]
        fn every_whole_block_is_found_among_garbage(
            parts in prop::collection::vec((any_block(), prop::collection::vec(any::<u8>(), 0..40), any::<bool>()), 1..8),
            cut in 0..20_usize,
        ) {
            let mut bytes = Vec::new();
            for ((block, is_code), garbage, begins) in &parts {
                bytes.extend(garbage);
                bytes.extend(begins.then_some([0x55, 0xAA]).into_iter().flatten());
                bytes.extend(words(block, *is_code));
            }
            // A listener that connects later loses what had begun, and no more. What waits for bytes that never come
            // gets zeros.
            let cut = cut.min(bytes.len());
            bytes.extend([0; 20]);
            let found: Vec<Block> = heard(&bytes[cut..]).into_iter().filter_map(|event| match event {
                Event::Block(block) => Some(block),
                _ => None,
            }).collect();
            let mut place = 0;
            let whole: Vec<Block> = parts.iter().filter_map(|((block, is_code), garbage, begins)| {
                place += garbage.len() + 2 * usize::from(*begins);
                let whole = place >= cut;
                place += words(block, *is_code).len();
                whole.then_some(*block)
            }).collect();
            prop_assert_eq!(found, whole);
        }

        /// One lost byte costs the block that it was of.
        #[test]
        fn a_lost_byte_costs_one_block(blocks in prop::collection::vec(any_block(), 3..6), lost in 0..200_usize) {
            let mut bytes: Vec<u8> = Vec::new();
            let mut ends = Vec::new();
            for (block, is_code) in &blocks {
                bytes.extend(words(block, *is_code));
                ends.push(bytes.len());
            }
            let lost = lost % bytes.len();
            let hit = ends.iter().position(|&end| lost < end).unwrap();
            bytes.remove(lost);
            bytes.extend([7; 20]);
            let found: Vec<Block> = heard(&bytes).into_iter().filter_map(|event| match event {
                Event::Block(block) => Some(block),
                _ => None,
            }).collect();
            let others = blocks.iter().enumerate().filter(|(n, _)| *n != hit);
            prop_assert_eq!(found, others.map(|(_, (block, _))| *block).collect::<Vec<_>>());
        }
    }
}
