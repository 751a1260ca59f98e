//! Packets as they go over the line.

/// A packet: its letter and its numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packet {
    /// `T`, `S` or `H`.
    pub letter: u8,
    /// Numbers that follow it, masked as the host wants it.
    pub numbers: Vec<u8>,
}

impl Packet {
    /// The numbers whose bit is set in the mask, the first in the lowest bit.
    pub(super) fn masked(letter: u8, numbers: &[u8], mask: u8) -> Self {
        let numbers = (0..)
            .zip(numbers)
            .filter(|(bit, _)| mask >> bit & 1 != 0)
            .map(|(_, &number)| number)
            .collect();
        Self { letter, numbers }
    }

    /// As text, with its carriage return.
    pub fn line(&self) -> Vec<u8> {
        let mut line = vec![self.letter];
        for number in &self.numbers {
            line.extend(format!(" {number}").bytes());
        }
        line.push(b'\r');
        line
    }

    /// As raw output: 255, the letter, and each number as a byte, of which none is 255.
    pub fn raw(&self) -> Vec<u8> {
        let mut bytes = vec![0xFF, self.letter];
        bytes.extend(self.numbers.iter().map(|number| number.min(&254)));
        bytes
    }
}
