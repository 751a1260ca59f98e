//! Chance, so that nodes do not act in step. Nothing secret comes from here.

use core::time::Duration;

use crate::time::micros;

/// A generator for waiting times (`SplitMix64`).
#[derive(Clone, Debug)]
pub(crate) struct Jitter(u64);

impl Jitter {
    pub(crate) const fn new(seed: u64) -> Self {
        Self(seed)
    }

    // size
    #[inline(never)]
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
    pub(crate) const fn up_to(&mut self, bound: Duration) -> Duration {
        let micros = self.below(saturating(micros(bound)));
        Duration::from_micros(micros as u64)
    }

    /// Between half and one and a half times `mean`.
    pub(crate) const fn around(&mut self, mean: Duration) -> Duration {
        self.backoff(mean, mean, 0)
    }

    /// [`around`](Self::around) a mean of `first`, doubled so many times, up to `max`.
    pub(crate) const fn backoff(
        &mut self,
        first: Duration,
        max: Duration,
        doublings: u8,
    ) -> Duration {
        // 64-bit divisions would be most of the code.
        let (first, max) = (saturating(micros(first)), saturating(micros(max)));
        let factor = if doublings < 16 {
            1 << doublings
        } else {
            1 << 16
        };
        let doubled = first.saturating_mul(factor);
        let mean = if doubled < max { doubled } else { max };
        let drawn = (mean / 2).saturating_add(self.below(mean));
        Duration::from_micros(drawn as u64)
    }
}

const fn saturating(micros: u64) -> u32 {
    if micros < u32::MAX as u64 {
        micros as u32
    } else {
        u32::MAX
    }
}
