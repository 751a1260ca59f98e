//! Times of the question to all members who they are.

use core::time::Duration;

use zigbee_link::Instant;

/// After a start all members are asked who they are, and again after these times, for broadcasts may be lost.
const ROLL_CALLS: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(25)];

/// Times of the question to all members who they are.
#[derive(Clone, Debug)]
pub(super) struct RollCalls {
    made: usize,
    next: Option<Instant>,
}

impl RollCalls {
    pub(super) const fn new() -> Self {
        Self {
            made: 0,
            next: None,
        }
    }

    /// The first one, unless that was before.
    pub(super) fn begin(&mut self, now: Instant) {
        if self.made == 0 {
            self.next.get_or_insert(now);
        }
    }

    pub(super) fn take_due(&mut self, now: Instant) -> bool {
        let is_due = self.next.take_if(|at| *at <= now).is_some();
        if is_due {
            self.next = ROLL_CALLS.get(self.made).map(|&after| now + after);
            self.made += 1;
        }
        is_due
    }

    /// When the next one is due.
    pub(super) const fn next_due(&self) -> Option<Instant> {
        self.next
    }
}
