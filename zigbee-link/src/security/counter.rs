//! The own frame counter.

use core::fmt;

/// Counters reserved by one write to the store.
pub const BLOCK: u32 = 1000;

/// The own frame counter: hands out each number once, and only below a persisted limit.
///
/// It is never told the next number, only limits: a restart continues where the last reservation
/// ended, so that at most [`BLOCK`] numbers per restart are lost, of 4 billion.
#[derive(Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counter {
    next: u32,
    limit: u32,
}

/// Reason why there is no counter for a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CounterError {
    /// The store has not yet written down the next reservation.
    NotReserved,
    /// Every counter of this key has been used: the node needs another key.
    Exhausted,
}

impl fmt::Display for CounterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotReserved => "the next frame counters are not yet in the store",
            Self::Exhausted => "every frame counter has been used: give the site another key",
        })
    }
}

impl core::error::Error for CounterError {}

impl Counter {
    /// The counter of a node whose store says that everything below `limit` may have been used.
    pub const fn resume(limit: u32) -> Self {
        Self { next: limit, limit }
    }

    /// The next number. 0xFFFFFFFF is never handed out.
    ///
    /// # Errors
    /// The numbers are not reserved, or used up.
    pub const fn take(&mut self) -> Result<u32, CounterError> {
        if self.next == u32::MAX {
            return Err(CounterError::Exhausted);
        }
        if self.next >= self.limit {
            return Err(CounterError::NotReserved);
        }
        let taken = self.next;
        self.next += 1;
        Ok(taken)
    }

    /// The number that is next, reserved or not.
    pub const fn upcoming(&self) -> u32 {
        self.next
    }

    /// The limit to write down now, if one should be: when less than half a block is left.
    pub const fn wanted(&self) -> Option<u32> {
        if self.limit == u32::MAX || self.limit - self.next > BLOCK / 2 {
            None
        } else {
            Some(self.limit.saturating_add(BLOCK))
        }
    }

    /// Takes note that the store has written down `limit`, for good.
    pub const fn reserved(&mut self, limit: u32) {
        if limit > self.limit {
            self.limit = limit;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_before_the_reservation() {
        let mut counter = Counter::resume(0);
        assert_eq!(counter.take(), Err(CounterError::NotReserved));
        assert_eq!(counter.wanted(), Some(BLOCK));
        counter.reserved(BLOCK);
        for expected in 0..BLOCK {
            assert_eq!(counter.wanted().is_some(), expected >= BLOCK / 2);
            assert_eq!(counter.take(), Ok(expected));
        }
        assert_eq!(counter.take(), Err(CounterError::NotReserved));
    }

    #[test]
    fn stops_before_the_last() {
        let mut counter = Counter::resume(u32::MAX - 2);
        assert_eq!(counter.wanted(), Some(u32::MAX));
        counter.reserved(u32::MAX);
        assert_eq!(counter.take(), Ok(u32::MAX - 2));
        assert_eq!(counter.take(), Ok(u32::MAX - 1));
        assert_eq!(counter.take(), Err(CounterError::Exhausted));
        assert_eq!(counter.wanted(), None);
        assert_eq!(
            Counter::resume(u32::MAX).take(),
            Err(CounterError::Exhausted)
        );
    }

    #[test]
    fn a_limit_never_shrinks() {
        let mut counter = Counter::resume(5000);
        counter.reserved(6000);
        counter.reserved(10);
        assert_eq!(counter.take(), Ok(5000));
    }
}
