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
            let digits = [number / 100, number / 10 % 10, number % 10].map(|digit| b'0' + digit);
            let zeros = usize::from(*number < 100) + usize::from(*number < 10);
            line.push(b' ');
            line.extend_from_slice(&digits[zeros..]);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_told_in_decimal() {
        let numbers: Vec<u8> = (0..=255).collect();
        let words: String = numbers.iter().map(|number| format!(" {number}")).collect();
        let packet = Packet {
            letter: b'T',
            numbers,
        };
        assert_eq!(packet.line(), format!("T{words}\r").into_bytes());
    }
}
