//! The same random numbers and bytes everywhere.

use rand::RngExt;

pub(crate) struct Random(test_support::Random);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(test_support::generator(seed))
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0.random()
    }

    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.0.random_range(0..end)
    }

    pub(crate) fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }
}

/// Bytes of any kind, of the kind that lines are made of, or both.
pub(crate) fn garbage(random: &mut Random, length: usize, bytes: &mut Vec<u8>) {
    const ALPHABET: &[u8] = b"TSHANCK :\r0123456789  T\x01\x02\x03\xAA\xFD\xFE\xFFCMUcam2 v1.0 c6";
    let any = random.below(101);
    for _ in 0..length {
        bytes.push(if random.chance(any) {
            random.next() as u8
        } else {
            ALPHABET[random.below(ALPHABET.len() as u64) as usize]
        });
    }
}
