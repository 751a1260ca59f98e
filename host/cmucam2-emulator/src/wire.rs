//! The camera's end of the serial line: the time when each byte has gone over it.

use std::collections::VecDeque;

/// Start bit, eight data bits, stop bit.
const BITS: u64 = 10;

const SECOND: u64 = 1_000_000_000;

/// The rates that the jumpers select.
pub const BAUD_RATES: [u32; 8] = [1200, 2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200];

#[derive(Clone, Copy, Debug)]
struct Sent {
    start: u64,
    /// `None`: the receiver loses it.
    byte: Option<u8>,
}

/// Bytes on their way to the host.
#[derive(Clone, Debug)]
pub(super) struct Wire {
    bit: u64,
    /// Pause after each byte, bit times.
    pub(super) pause_bits: u8,
    queue: VecDeque<Sent>,
    free_at: u64,
}

impl Wire {
    pub(super) fn new(baud: u32) -> Self {
        Self {
            bit: SECOND / u64::from(baud.max(1)),
            pause_bits: 0,
            queue: VecDeque::new(),
            free_at: 0,
        }
    }

    fn byte_time(&self) -> u64 {
        BITS * self.bit
    }

    /// Sends a byte as soon as the line is free, not before `now`.
    pub(super) fn send(&mut self, now: u64, byte: Option<u8>) {
        let start = self.free_at.max(now);
        self.queue.push_back(Sent { start, byte });
        self.free_at = start + self.byte_time() + u64::from(self.pause_bits) * self.bit;
    }

    /// Time when the last byte is over.
    pub(super) fn free_at(&self) -> u64 {
        self.free_at
    }

    /// Drops the bytes that have not begun.
    pub(super) fn cut(&mut self, now: u64) {
        let begun = self.queue.partition_point(|sent| sent.start < now);
        self.queue.truncate(begun);
        let byte_time = self.byte_time();
        self.free_at = self
            .queue
            .back()
            .map_or(now, |sent| sent.start + byte_time)
            .max(now);
    }

    /// Time when the next byte is complete.
    pub(super) fn next_at(&self) -> Option<u64> {
        self.queue.front().map(|sent| sent.start + self.byte_time())
    }

    /// Time when so many bytes are complete; if there are fewer, time when the last one is.
    pub(super) fn complete_at(&self, count: usize) -> Option<u64> {
        let last = self.queue.len().checked_sub(1)?;
        let sent = self.queue.get(count.saturating_sub(1).min(last))?;
        Some(sent.start + self.byte_time())
    }

    /// The next byte that is complete, with the time at which it was.
    pub(super) fn receive(&mut self, now: u64) -> Option<(u64, u8)> {
        while let Some(at) = self.next_at().filter(|&at| at <= now) {
            let sent = self.queue.pop_front()?;
            if let Some(byte) = sent.byte {
                return Some((at, byte));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_takes_ten_bits_and_the_pause() {
        let mut wire = Wire::new(9600);
        wire.pause_bits = 3;
        for byte in *b"ab" {
            wire.send(1000, Some(byte));
        }
        let bit = 104_166;
        assert_eq!(wire.receive(1000 + 10 * bit - 1), None);
        assert_eq!(wire.receive(u64::MAX), Some((1000 + 10 * bit, b'a')));
        assert_eq!(wire.receive(u64::MAX), Some((1000 + 23 * bit, b'b')));
    }

    #[test]
    fn a_cut_lets_the_byte_under_way_pass() {
        let mut wire = Wire::new(100_000);
        for byte in *b"abc" {
            wire.send(0, Some(byte));
        }
        wire.cut(150_000);
        assert_eq!(wire.free_at(), 200_000);
        let all: Vec<_> = std::iter::from_fn(|| wire.receive(u64::MAX)).collect();
        assert_eq!(all, [(100_000, b'a'), (200_000, b'b')]);
    }
}
