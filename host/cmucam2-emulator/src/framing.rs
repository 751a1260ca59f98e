//! A receiver that listens at another baud rate than the sender's: it samples the real levels of
//! the line at its own times, and gets framing garbage.

use std::collections::VecDeque;

/// Start bit, eight data bits, stop bit.
const BITS: u64 = 10;
const SECOND: u64 = 1_000_000_000;

/// The receiver.
#[derive(Clone, Debug)]
pub(super) struct Framing {
    sender_bit: u64,
    receiver_bit: u64,
    /// Bytes on the line: when their start bit began.
    line: VecDeque<(u64, u8)>,
    /// It looks for a start bit from here on.
    from: u64,
}

impl Framing {
    /// `None` if both rates are the same.
    pub(super) fn new(sender_baud: u32, receiver_baud: u32) -> Option<Self> {
        (sender_baud != receiver_baud).then(|| Self {
            sender_bit: SECOND / u64::from(sender_baud.max(1)),
            receiver_bit: SECOND / u64::from(receiver_baud.max(1)),
            line: VecDeque::new(),
            from: 0,
        })
    }

    /// A byte whose stop bit is over at this time.
    pub(super) fn push(&mut self, end: u64, byte: u8) {
        self.line
            .push_back((end.saturating_sub(BITS * self.sender_bit), byte));
    }

    fn level(&self, at: u64) -> bool {
        self.line
            .iter()
            .find(|(start, _)| (*start..start + BITS * self.sender_bit).contains(&at))
            .is_none_or(|(start, byte)| match (at - start) / self.sender_bit {
                0 => false,
                bit @ 1..=8 => byte >> (bit - 1) & 1 != 0,
                _ => true,
            })
    }

    /// Time when the line falls next, from a time on.
    fn falls(&self, from: u64) -> Option<u64> {
        self.line.iter().find_map(|&(start, byte)| {
            let mut before = true;
            (0..BITS).find_map(|bit| {
                let level = match bit {
                    0 => false,
                    1..=8 => byte >> (bit - 1) & 1 != 0,
                    _ => true,
                };
                let falls = before && !level;
                before = level;
                let at = start + bit * self.sender_bit;
                (falls && at >= from).then_some(at)
            })
        })
    }

    /// Time when the receiver has its next byte, if nothing more is sent.
    pub(super) fn next_at(&self) -> Option<u64> {
        self.falls(self.from)
            .map(|start| start + (2 * BITS - 1) * self.receiver_bit / 2)
    }

    /// The next byte that the receiver believes to have got.
    pub(super) fn receive(&mut self, now: u64) -> Option<(u64, u8)> {
        let start = self.falls(self.from)?;
        let end = self.next_at().filter(|&end| end <= now)?;
        let mut byte = 0;
        for bit in 0..8 {
            let sample = start + (3 + 2 * bit) * self.receiver_bit / 2;
            byte |= u8::from(self.level(sample)) << bit;
        }
        self.from = end;
        while let Some(&(start, _)) = self.line.front() {
            if start + BITS * self.sender_bit > end {
                break;
            }
            self.line.pop_front();
        }
        Some((end, byte))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(sender: u32, receiver: u32, bytes: &[u8]) -> Vec<u8> {
        let mut framing = Framing::new(sender, receiver).unwrap();
        let byte_time = BITS * (SECOND / u64::from(sender));
        for (place, &byte) in (1..).zip(bytes) {
            framing.push(place * byte_time, byte);
        }
        std::iter::from_fn(|| framing.receive(u64::MAX))
            .map(|(_, byte)| byte)
            .collect()
    }

    #[test]
    fn a_few_per_cent_do_not_matter() {
        assert_eq!(heard(115_200, 113_000, b"ACK\r:"), b"ACK\r:");
    }

    /// By hand: at half the rate every bit of `U` lasts two bits of the receiver: 0011001100.
    #[test]
    fn half_and_double_rates_are_garbage() {
        assert_eq!(heard(19_200, 38_400, b"U"), [0x66, 0xE6]);
        let halved = heard(38_400, 19_200, b"ACK\r:");
        assert!(halved.len() < 5 && halved != b"ACK\r:", "{halved:?}");
    }

    #[test]
    fn equal_rates_need_no_receiver() {
        assert!(Framing::new(9600, 9600).is_none());
    }
}
