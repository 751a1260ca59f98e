//! Points in time, as told by the caller.

use core::{ops::Add, time::Duration};

/// A point in time: microseconds since an arbitrary one that stays the same until a restart.
///
/// The caller's clock never runs backwards; nothing here reads one. 2^64 us are 584,000 years.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Instant(pub u64);

impl Instant {
    /// The time since an earlier point, zero if that is later.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_micros(self.0.saturating_sub(earlier.0))
    }
}

impl Add<Duration> for Instant {
    type Output = Self;

    fn add(self, duration: Duration) -> Self {
        Self(self.0.saturating_add(micros(duration)))
    }
}

/// Without the division by which [`Duration::as_micros`] is rounded.
pub(crate) const fn micros(duration: Duration) -> u64 {
    let seconds = duration.as_secs().saturating_mul(1_000_000);
    seconds.saturating_add(duration.subsec_micros() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_points() {
        let later = Instant(5) + Duration::new(2, 7_999);
        assert_eq!(later, Instant(2_000_012));
        assert_eq!(later.since(Instant(5)), Duration::from_micros(2_000_007));
        assert_eq!(Instant(5).since(later), Duration::ZERO);
        assert_eq!(later + Duration::MAX, Instant(u64::MAX));
    }
}
