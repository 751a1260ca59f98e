//! Check that every task still runs.
//!
//! Each task reports; the watchdog is fed only when all have since the last time. This proves that a task is
//! polled and comes back: an endless loop anywhere, or an executor that stands still, ends the feeding. The node's
//! own [`Liveness`](node_firmware::liveness::Liveness) tells if a task waits for something that never comes.

use core::{
    future::Future,
    pin::Pin,
    sync::atomic::{AtomicU32, Ordering},
};

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};
use node_firmware::message::Restart;
use zigbee_link::runner::Clock;

use crate::clock::EmbassyClock;

/// Longest time between two reports of a watched task.
const PERIOD: Duration = Duration::from_secs(1);
/// Interval at which it is looked if all have. A watchdog waits longer.
const LOOK: Duration = Duration::from_secs(2);

/// Reports of up to 32 tasks.
#[derive(Debug)]
pub struct Heartbeats {
    expected: u32,
    reported: AtomicU32,
}

impl Heartbeats {
    /// For tasks 0 to `tasks - 1`, at most 32.
    pub const fn new(tasks: u32) -> Self {
        let expected = match 1_u32.checked_shl(tasks) {
            Some(next) => next - 1,
            None => u32::MAX,
        };
        Self {
            expected,
            reported: AtomicU32::new(0),
        }
    }

    /// This task runs.
    pub fn report(&self, task: u32) {
        let bit = 1_u32.checked_shl(task).unwrap_or(0);
        self.reported.fetch_or(bit, Ordering::Relaxed);
    }

    /// Returns true if all tasks have reported since this was last true.
    pub fn all_reported(&self) -> bool {
        let all = self.reported.load(Ordering::Relaxed) & self.expected == self.expected;
        if all {
            self.reported.store(0, Ordering::Relaxed);
        }
        all
    }

    /// Feeds a watchdog as long as all tasks run, until radio or camera work no more. Returns the reason.
    pub async fn feed(
        &self,
        node: &node_firmware::liveness::Liveness,
        mut feed: impl FnMut(),
    ) -> Restart {
        loop {
            if let Err(why) = node.check(EmbassyClock.now()) {
                return why;
            }
            if self.all_reported() {
                feed();
            }
            Timer::after(LOOK).await;
        }
    }

    /// Runs a future as a task that reports at least once a second, after it was polled.
    ///
    /// Pinned by the caller: a future passed by value is kept twice, and that of a node is large.
    pub async fn watch<F: Future>(&self, task: u32, mut future: Pin<&mut F>) -> F::Output {
        loop {
            match select(future.as_mut(), Timer::after(PERIOD)).await {
                Either::First(output) => return output,
                Either::Second(()) => self.report(task),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_must_report_each_time() {
        let tasks = Heartbeats::new(2);
        assert!(!tasks.all_reported());
        tasks.report(0);
        tasks.report(0);
        assert!(!tasks.all_reported());
        tasks.report(1);
        assert!(tasks.all_reported());
        assert!(!tasks.all_reported());
    }

    #[test]
    fn reports_of_nobody_count_for_nobody() {
        let tasks = Heartbeats::new(32);
        for task in 0..31 {
            tasks.report(task);
        }
        tasks.report(32);
        assert!(!tasks.all_reported());
        tasks.report(31);
        assert!(tasks.all_reported());
    }
}
