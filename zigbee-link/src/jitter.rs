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

    // for less flash
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers that the published generator draws from this seed.
    #[test]
    fn split_mix_64() {
        let mut jitter = Jitter::new(1_234_567);
        let drawn: [u64; 3] = core::array::from_fn(|_| jitter.next());
        let published = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
        ];
        assert_eq!(drawn, published);
    }

    /// The least and the most of many draws, microseconds.
    fn range(mut draw: impl FnMut(&mut Jitter) -> Duration) -> (u64, u64) {
        let mut jitter = Jitter::new(1);
        let draws = core::iter::repeat_with(|| micros(draw(&mut jitter))).take(2000);
        draws.fold((u64::MAX, 0), |(least, most), drawn| {
            (least.min(drawn), most.max(drawn))
        })
    }

    #[test]
    fn waits_are_spread_over_their_whole_range() {
        let ms = Duration::from_millis;
        let (least, most) = range(|jitter| jitter.up_to(ms(20)));
        assert!(least < 200 && (19_800..20_000).contains(&most));
        for (doublings, mean) in [(0, 30_000), (1, 60_000), (4, 480_000), (5, 900_000)] {
            let (least, most) = range(|jitter| jitter.backoff(ms(30), ms(900), doublings));
            assert!((mean / 2..mean / 2 + mean / 50).contains(&least), "{least}");
            assert!((mean / 2 * 3 - mean / 50..mean / 2 * 3).contains(&most));
        }
        let (least, most) = range(|jitter| jitter.around(ms(300)));
        assert!((150_000..155_000).contains(&least) && (445_000..450_000).contains(&most));
    }

    #[test]
    fn nothing_overflows() {
        let day = Duration::from_secs(86_400);
        let (least, most) = range(|jitter| jitter.backoff(day, day, 255));
        let longest = u64::from(u32::MAX);
        assert!((longest / 2..longest * 51 / 100).contains(&least));
        assert!((longest * 99 / 100..=longest).contains(&most));
        let (_, most) = range(|jitter| jitter.backoff(Duration::from_micros(1), day, 255));
        assert!(most < 3 << 15, "{most}");
        assert_eq!(Jitter::new(1).below(0), 0);
        assert_eq!(Jitter::new(1).below(1), 0);
    }
}
