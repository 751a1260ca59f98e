//! Requests out of bytes, and answers as bytes with their times.

use std::collections::VecDeque;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Time;

/// Start bit, eight data bits, stop bit.
const BITS: Time = 10;
const SECOND: Time = 1_000_000_000;

/// Request of a host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Its type.
    pub kind: u8,
    /// Data of the request.
    pub payload: Vec<u8>,
}

/// The longest payload of a request.
const REQUEST_MAX: u8 = 64;

/// Bytes of a request as most are: one of these is damaged.
const USUAL: usize = 8;

/// The camera's end of the line.
#[derive(Clone, Debug)]
pub struct Wire {
    byte_time: Time,
    corrupt: f64,
    random: ChaCha8Rng,
    heard: Vec<u8>,
    /// Byte of the present message that becomes another one, and the bit that does it.
    damage: Option<(usize, u8)>,
    sending: VecDeque<(Time, u8)>,
}

impl Wire {
    /// A line of this rate, bits per second.
    pub fn new(baud: u32, corrupt: f64, seed: u64) -> Self {
        Self {
            byte_time: BITS * (SECOND / Time::from(baud.max(1))),
            corrupt,
            random: ChaCha8Rng::seed_from_u64(seed ^ 0x91),
            heard: Vec::new(),
            damage: None,
            sending: VecDeque::new(),
        }
    }

    pub(crate) fn set_corrupt_line(&mut self, rate: f64) {
        self.corrupt = rate;
    }

    /// Takes a byte: a request, if it is the last one of it.
    pub fn receive(&mut self, byte: u8) -> Option<Request> {
        if self.heard.is_empty() {
            self.damage = self.damage_within(USUAL);
        }
        let (place, bit) = self.damage.unwrap_or_default();
        let is_damaged = place == self.heard.len();
        self.heard.push(if is_damaged { byte ^ bit } else { byte });
        loop {
            // Bytes that do not begin like a request are dropped from their beginning.
            let begins = |heard: &[u8]| match heard {
                [] | [0xAE | 0xAF] => true,
                [first, second, ..] => matches!((first, second), (0xAE | 0xAF, 0xC1)),
                _ => false,
            };
            while !begins(&self.heard) {
                self.heard.remove(0);
            }
            let [sync, _, kind, length, ref rest @ ..] = self.heard[..] else {
                return None;
            };
            if length > REQUEST_MAX {
                self.heard.remove(0);
                continue;
            }
            let summed = sync == 0xAF;
            let before = if summed { 2 } else { 0 };
            let payload = rest.get(before..before + usize::from(length))?.to_vec();
            let sum: u16 = payload.iter().map(|&byte| u16::from(byte)).sum();
            if summed && rest[..2] != sum.to_le_bytes() {
                // It may have been no beginning.
                self.heard.remove(0);
                continue;
            }
            self.heard.clear();
            return Some(Request { kind, payload });
        }
    }

    /// A place below this, and the bit that is another there, as often as the line damages something.
    fn damage_within(&mut self, length: usize) -> Option<(usize, u8)> {
        if self.corrupt <= 0.0 || !self.random.random_bool(self.corrupt.min(1.0)) {
            return None;
        }
        let place = self.random.random_range(0..length);
        Some((place, 1 << self.random.random_range(0..8_u8)))
    }

    /// Returns true if all is sent by this time.
    pub fn is_free(&self, at: Time) -> bool {
        self.sending.back().is_none_or(|&(last, _)| last <= at)
    }

    /// Sends an answer, not before this time. Every answer of a Pixy2's firmware has a checksum.
    pub fn send(&mut self, from: Time, kind: u8, payload: &[u8]) {
        let sum: u16 = payload.iter().map(|&byte| u16::from(byte)).sum();
        let mut packet = vec![0xAF, 0xC1, kind, payload.len() as u8];
        packet.extend(sum.to_le_bytes());
        packet.extend(payload);
        self.send_bytes(from, packet);
    }

    /// Sends bytes, not before this time.
    pub fn send_bytes(&mut self, from: Time, mut packet: Vec<u8>) {
        if let Some((place, bit)) = self.damage_within(packet.len()) {
            packet[place] ^= bit;
        }
        let mut at = self.sending.back().map_or(from, |&(at, _)| at.max(from));
        for byte in packet {
            at += self.byte_time;
            self.sending.push_back((at, byte));
        }
    }

    /// The next byte that is sent until now, with its time.
    pub fn transmit(&mut self, now: Time) -> Option<(Time, u8)> {
        self.sending.pop_front_if(|(at, _)| *at <= now)
    }

    /// Time when so many bytes are sent, or all that there are.
    pub fn sent_at(&self, count: usize) -> Option<Time> {
        let last = self.sending.len().checked_sub(1)?;
        let place = count.saturating_sub(1).min(last);
        self.sending.get(place).map(|&(at, _)| at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(bytes: &[u8]) -> Vec<Request> {
        let mut wire = Wire::new(19_200, 0.0, 0);
        bytes
            .iter()
            .filter_map(|&byte| wire.receive(byte))
            .collect()
    }

    /// The bytes of the maker's documentation: `getVersion`, and all blocks, with and without checksum.
    #[test]
    fn requests_are_found_in_whatever_comes() {
        let version = Request {
            kind: 0x0E,
            payload: vec![],
        };
        assert_eq!(heard(&[0xAE, 0xC1, 14, 0]), std::slice::from_ref(&version));
        assert_eq!(heard(&[0xC1, 0xAE, 0xAE, 0xC1, 14, 0]), [version]);
        let blocks = heard(&[0xAF, 0xC1, 32, 2, 0x00, 0x01, 255, 1]);
        assert_eq!(
            (blocks[0].kind, &blocks[0].payload[..]),
            (32, &[255, 1][..])
        );
        assert!(heard(&[0xAF, 0xC1, 32, 2, 0x01, 0x01, 255, 1]).is_empty());
        // A length that no request has is not waited for.
        assert_eq!(heard(&[0xAE, 0xC1, 14, 65, 0xAE, 0xC1, 14, 0]).len(), 1);
    }

    #[test]
    fn answers_take_their_time() {
        let mut wire = Wire::new(19_200, 0.0, 0);
        wire.send(1_000, 0x0D, &[0x3C, 0x01, 0xD0, 0x00]);
        let byte = 10 * (SECOND / 19_200);
        assert_eq!(wire.transmit(1_000 + byte - 1), None);
        let all: Vec<_> = std::iter::from_fn(|| wire.transmit(SECOND)).collect();
        let bytes: Vec<u8> = all.iter().map(|&(_, byte)| byte).collect();
        assert_eq!(
            bytes,
            [0xAF, 0xC1, 0x0D, 4, 0x0D, 0x01, 0x3C, 0x01, 0xD0, 0x00]
        );
        assert_eq!(all[9].0, 1_000 + 10 * byte);
    }
}
