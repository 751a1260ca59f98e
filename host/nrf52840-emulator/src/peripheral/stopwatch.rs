//! Time for which a part of the chip needs something, which is what an account of its current is made of.

/// A time that is counted while it runs, nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stopwatch {
    counted: u64,
    since: Option<u64>,
}

impl Stopwatch {
    /// Starts it, unless it runs.
    pub(super) fn start(&mut self, now: u64) {
        self.since.get_or_insert(now);
    }

    /// Stops it, if it runs.
    pub(crate) fn stop(&mut self, now: u64) {
        self.counted = self.until(now);
        self.since = None;
    }

    /// The time until now.
    pub(crate) fn until(&self, now: u64) -> u64 {
        let since = self.since.unwrap_or(now);
        self.counted + now.saturating_sub(since)
    }
}
