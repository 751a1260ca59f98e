//! Chance, so that nodes do not act in step. Nothing secret comes from here.

use core::time::Duration;

/// A generator for waiting times (`SplitMix64`).
#[derive(Clone, Debug)]
pub(crate) struct Jitter(u64);

impl Jitter {
    pub(crate) const fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(crate) const fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number below `bound`, 0 for none.
    pub(crate) const fn below(&mut self, bound: u32) -> u32 {
        (((self.next() >> 32) * bound as u64) >> 32) as u32
    }

    /// Less than `bound`.
    pub(crate) fn up_to(&mut self, bound: Duration) -> Duration {
        let micros = u32::try_from(bound.as_micros()).unwrap_or(u32::MAX);
        Duration::from_micros(u64::from(self.below(micros)))
    }

    /// Between half and one and a half times `mean`.
    pub(crate) fn around(&mut self, mean: Duration) -> Duration {
        mean / 2 + self.up_to(mean)
    }
}
