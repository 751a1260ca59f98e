//! Everything that real cameras and lines were seen to do wrong, each at its rate.
//!
//! Every fault draws from a random sequence of its own, so that one more fault does not change
//! when the others happen.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::settings::settings;

settings! {
    /// Rates of faults: the probability of each at each occasion.
    pub struct FaultRates of f64 {
        /// A well-formed command is refused; at each command
        nck = 0.0, up to 1.0;
        /// The answer comes 0.1 to 0.7 s late; at each command
        slow = 0.0, up to 1.0;
        /// Nothing is answered for 3 s; at each command and packet
        silence = 0.0, up to 1.0;
        /// The camera restarts by itself, with a banner; at each command and packet
        restart = 0.0, up to 1.0;
        /// The same, and its banner is lost; at each command and packet
        silent_restart = 0.0, up to 1.0;
        /// The rest of a packet is missing; at each packet
        cut = 0.0, up to 1.0;
        /// One byte of a line is another; at each line or row
        corrupt_line = 0.0, up to 1.0;
        /// A byte is another; at each byte
        corrupt_byte = 0.0, up to 1.0;
        /// A byte that was not sent comes before; at each byte
        stray = 0.0, up to 1.0;
        /// The host loses 1 to 16 bytes; at each byte
        overrun = 0.0, up to 1.0;
        /// Something covers a part of an object; at each frame
        clip = 0.0, up to 1.0;
        /// A second object of the same colour stands beside an object; at each frame
        merge = 0.0, up to 1.0;
        /// The frame is half as bright, or half as bright again; at each frame
        flicker = 0.0, up to 1.0;
        /// The camera does not start until its power is cycled; at each power-up
        dead_start = 0.0, up to 1.0;
    }
}

/// A fault that is drawn for each occasion.
#[derive(Clone, Debug)]
pub(super) struct Chance {
    rate: f64,
    random: ChaCha8Rng,
}

impl Chance {
    fn new(rate: f64, seed: u64, stream: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        Self { rate, random }
    }

    /// Returns true if it happens this time.
    pub(super) fn strikes(&mut self) -> bool {
        self.rate > 0.0 && self.random.random_bool(self.rate)
    }

    /// `0..below`, for the way in which it happens.
    pub(super) fn pick(&mut self, below: u64) -> u64 {
        self.random.random_range(0..below.max(1))
    }

    /// 0 to 1, for the way in which it happens.
    pub(super) fn share(&mut self) -> f64 {
        self.random.random_range(0.0..1.0)
    }
}

/// All faults of one camera.
#[derive(Clone, Debug)]
pub(super) struct Faults {
    pub(super) nck: Chance,
    pub(super) slow: Chance,
    pub(super) silence: Chance,
    pub(super) restart: Chance,
    pub(super) silent_restart: Chance,
    pub(super) cut: Chance,
    corrupt_line: Chance,
    corrupt_byte: Chance,
    stray: Chance,
    overrun: Chance,
    pub(super) clip: Chance,
    pub(super) merge: Chance,
    pub(super) flicker: Chance,
    pub(super) dead_start: Chance,
    /// Bytes that the host is still to lose.
    losing: u8,
}

impl Faults {
    pub(super) fn new(rates: &FaultRates, seed: u64) -> Self {
        let chance = |rate, stream| Chance::new(rate, seed, stream);
        Self {
            nck: chance(rates.nck, 1),
            slow: chance(rates.slow, 2),
            silence: chance(rates.silence, 3),
            restart: chance(rates.restart, 4),
            silent_restart: chance(rates.silent_restart, 5),
            cut: chance(rates.cut, 6),
            corrupt_line: chance(rates.corrupt_line, 7),
            corrupt_byte: chance(rates.corrupt_byte, 8),
            stray: chance(rates.stray, 9),
            overrun: chance(rates.overrun, 10),
            clip: chance(rates.clip, 11),
            merge: chance(rates.merge, 12),
            flicker: chance(rates.flicker, 13),
            dead_start: chance(rates.dead_start, 14),
            losing: 0,
        }
    }

    /// Damages a line: one byte of it may be another.
    pub(super) fn damage(&mut self, line: &mut [u8]) {
        if !line.is_empty() && self.corrupt_line.strikes() {
            let place = self.corrupt_line.pick(line.len() as u64) as usize;
            line[place] = other(line[place], &mut self.corrupt_line);
        }
    }

    /// Sends one byte: perhaps one before it, and it or another, or nothing (`None`).
    pub(super) fn transmit(&mut self, byte: u8, mut send: impl FnMut(Option<u8>)) {
        if self.stray.strikes() {
            send(Some(self.stray.pick(256) as u8));
        }
        if self.losing == 0 && self.overrun.strikes() {
            self.losing = 1 + self.overrun.pick(16) as u8;
        }
        if self.losing > 0 {
            self.losing -= 1;
            return send(None);
        }
        send(Some(if self.corrupt_byte.strikes() {
            other(byte, &mut self.corrupt_byte)
        } else {
            byte
        }));
    }
}

/// Any byte but this one.
fn other(byte: u8, chance: &mut Chance) -> u8 {
    byte.wrapping_add(1 + chance.pick(255) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_fault_does_not_change_when_another_happens() {
        let strikes = |rates: FaultRates| -> Vec<bool> {
            let mut faults = Faults::new(&rates, 7);
            (0..200)
                .map(|_| {
                    faults.slow.strikes();
                    faults.nck.strikes()
                })
                .collect()
        };
        let mut rates = FaultRates {
            nck: 0.3,
            ..FaultRates::default()
        };
        let alone = strikes(rates);
        rates.slow = 0.5;
        assert_eq!(strikes(rates), alone);
        let count = alone.iter().filter(|strike| **strike).count();
        assert!((30..90).contains(&count), "{count}");
    }

    #[test]
    fn a_damaged_byte_is_never_the_same() {
        let rates = FaultRates {
            corrupt_byte: 1.0,
            ..FaultRates::default()
        };
        let mut faults = Faults::new(&rates, 1);
        for byte in 0..=255 {
            faults.transmit(byte, |sent| assert_ne!(sent, Some(byte)));
        }
    }
}
