//! Promises to tell a receiver something. Each is kept until its message is delivered.
//!
//! A role names the messages that it may have to tell with an enum, its [`Notification`]. It promises a
//! message with [`notify`](Notifications::notify), builds it from its present knowledge when
//! [`take_due`](Notifications::take_due) says that it is time, and hands back the result:
//! [`on_sent`](Notifications::on_sent). So no message is out of date, and a message that must be told is one
//! variant of that enum, and one arm where it is built.

use core::time::Duration;

use zigbee_link::Instant;

/// After this a message that was not delivered is sent again. Doubled with each failure, up to
/// [`RETRY_DOUBLINGS`] times: a receiver that is away costs little airtime.
pub(crate) const RETRY: Duration = Duration::from_secs(2);

/// From 2 s to 32 s.
const RETRY_DOUBLINGS: u8 = 4;

/// The name of a message that a role may have to tell, and of its receiver.
pub(crate) trait Notification: Copy + PartialEq {
    /// The lowest one that is due is sent first; among equals, the one that was promised first.
    fn priority(self) -> u8;
}

/// Promises that are not kept yet, each once, at most `N`.
///
/// `N` is the number of different messages that the role may have to tell at a time. One more promise would
/// be lost, and none of the earlier ones.
#[derive(Clone, Debug)]
pub(crate) struct Notifications<K, const N: usize> {
    pending: heapless::Vec<Pending<K>, N>,
}

#[derive(Clone, Copy, Debug)]
struct Pending<K> {
    key: K,
    delivery: Delivery,
}

/// Progress of the delivery of one message.
#[derive(Clone, Copy, Debug)]
struct Delivery {
    phase: Phase,
    /// Number of failures in a row.
    failures: u8,
    /// Not to be sent before.
    due: Instant,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Waits for its time.
    Due,
    /// Sent; the result is not known yet.
    InFlight,
    /// In flight, but there is something newer to tell already.
    Superseded,
}

impl<K, const N: usize> Default for Notifications<K, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<K, const N: usize> Notifications<K, N> {
    pub(crate) const fn new() -> Self {
        Self {
            pending: heapless::Vec::new(),
        }
    }
}

impl<K: Notification, const N: usize> Notifications<K, N> {
    /// There is something new to tell, from this time on. A message in flight is told again.
    pub(crate) fn notify(&mut self, key: K, due: Instant) {
        if let Some(known) = self.find(key) {
            known.supersede(due);
            return;
        }
        let delivery = Delivery {
            phase: Phase::Due,
            failures: 0,
            due,
        };
        let has_room = self.pending.push(Pending { key, delivery }).is_ok();
        debug_assert!(has_room, "more to tell than there are messages");
    }

    /// The message to send now, if any is due. It counts as in flight then.
    pub(crate) fn take_due(&mut self, now: Instant) -> Option<K> {
        let pending = self.pending.iter_mut();
        let due = pending.filter(|pending| pending.delivery.is_due(now));
        let first = due.min_by_key(|pending| pending.key.priority())?;
        first.delivery.phase = Phase::InFlight;
        Some(first.key)
    }

    /// A message was delivered, or not: then it is sent again after a while.
    pub(crate) fn on_sent(&mut self, key: K, now: Instant, delivered: bool) {
        if let Some(known) = self.find(key)
            && known.on_sent(now, delivered)
        {
            self.cancel(key);
        }
    }

    /// Time when something is due next.
    pub(crate) fn next_due(&self) -> Option<Instant> {
        let waiting = self.pending.iter().map(|pending| pending.delivery);
        waiting
            .filter(|delivery| delivery.phase == Phase::Due)
            .map(|delivery| delivery.due)
            .min()
    }

    /// Returns true if this was promised and is not known to be delivered.
    pub(crate) fn is_pending(&self, key: K) -> bool {
        self.pending.iter().any(|pending| pending.key == key)
    }

    /// This is not to be told any more.
    pub(crate) fn cancel(&mut self, key: K) {
        self.retain(|pending| pending != key);
    }

    /// Only these are still to be told.
    pub(crate) fn retain(&mut self, mut is_kept: impl FnMut(K) -> bool) {
        self.pending.retain(|pending| is_kept(pending.key));
    }

    fn find(&mut self, key: K) -> Option<&mut Delivery> {
        let mut pending = self.pending.iter_mut();
        let known = pending.find(|pending| pending.key == key)?;
        Some(&mut known.delivery)
    }
}

impl Delivery {
    fn is_due(&self, now: Instant) -> bool {
        self.phase == Phase::Due && self.due <= now
    }

    fn supersede(&mut self, due: Instant) {
        self.due = due;
        self.failures = 0;
        if self.phase == Phase::InFlight {
            self.phase = Phase::Superseded;
        }
    }

    /// Returns true if there is nothing to tell any more.
    // for less flash
    #[inline(never)]
    fn on_sent(&mut self, now: Instant, delivered: bool) -> bool {
        match self.phase {
            // Promised anew after it had been given up.
            Phase::Due => return false,
            Phase::InFlight if delivered => return true,
            Phase::InFlight => {
                let doublings = self.failures.min(RETRY_DOUBLINGS);
                self.due = now + RETRY.saturating_mul(1 << doublings);
                self.failures = doublings + 1;
            }
            Phase::Superseded => {}
        }
        self.phase = Phase::Due;
        false
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Told {
        Late(u8),
        First,
    }

    impl Notification for Told {
        fn priority(self) -> u8 {
            match self {
                Self::First => 0,
                Self::Late(_) => 1,
            }
        }
    }

    const fn at(seconds: u64) -> Instant {
        Instant(seconds * 1_000_000)
    }

    #[test]
    fn failures_are_repeated_less_and_less() {
        let mut told = Notifications::<Told, 1>::new();
        told.notify(Told::First, at(0));
        let mut now = at(0);
        let mut pauses = Vec::new();
        for _ in 0..7 {
            assert_eq!(told.take_due(now), Some(Told::First));
            assert_eq!((told.take_due(now), told.next_due()), (None, None));
            told.on_sent(Told::First, now, false);
            let next = told.next_due().unwrap();
            pauses.push(next.since(now).as_secs());
            assert_eq!(told.take_due(Instant(next.0 - 1)), None);
            now = next;
        }
        assert_eq!(pauses, [2, 4, 8, 16, 32, 32, 32]);
        // News begin from the start.
        told.notify(Told::First, now);
        assert_eq!(told.take_due(now), Some(Told::First));
        told.on_sent(Told::First, now, false);
        assert_eq!(told.next_due(), Some(now + RETRY));
        assert!(told.is_pending(Told::First));
        told.notify(Told::First, now);
        assert_eq!(told.take_due(now), Some(Told::First));
        told.on_sent(Told::First, now, true);
        assert!(!told.is_pending(Told::First));
        assert_eq!(told.next_due(), None);
    }

    #[test]
    fn what_is_new_while_the_old_is_in_flight_is_told_too() {
        let mut told = Notifications::<Told, 1>::new();
        for delivered in [true, false] {
            told.notify(Told::First, at(0));
            assert_eq!(told.take_due(at(0)), Some(Told::First));
            told.notify(Told::First, at(5));
            // Only when the result of the old one is known.
            assert_eq!((told.next_due(), told.take_due(at(6))), (None, None));
            told.on_sent(Told::First, at(3), delivered);
            assert_eq!(told.next_due(), Some(at(5)));
            assert_eq!(told.take_due(at(5)), Some(Told::First));
            told.on_sent(Told::First, at(6), true);
            assert!(!told.is_pending(Told::First));
        }
    }

    #[test]
    fn they_go_by_priority_and_then_in_the_order_in_which_they_were_promised() {
        let mut told = Notifications::<Told, 4>::new();
        told.notify(Told::Late(7), at(1));
        told.notify(Told::Late(3), at(0));
        told.notify(Told::Late(5), at(0));
        told.notify(Told::First, at(0));
        // Promised again: it keeps its place.
        told.notify(Told::Late(3), at(1));
        assert_eq!(told.next_due(), Some(at(0)));
        let turns = core::iter::from_fn(|| told.take_due(at(0)));
        assert!(turns.eq([Told::First, Told::Late(5)]));
        let turns = core::iter::from_fn(|| told.take_due(at(1)));
        assert!(turns.eq([Told::Late(7), Told::Late(3)]));
    }

    #[test]
    fn what_was_given_up_is_not_told_whatever_becomes_of_it() {
        let mut told = Notifications::<Told, 2>::new();
        told.notify(Told::First, at(0));
        told.notify(Told::Late(1), at(0));
        assert_eq!(told.take_due(at(0)), Some(Told::First));
        told.cancel(Told::First);
        told.on_sent(Told::First, at(1), false);
        assert!(!told.is_pending(Told::First) && told.is_pending(Told::Late(1)));
        // Promised anew meanwhile: the result is of the one before.
        told.notify(Told::First, at(4));
        told.on_sent(Told::First, at(2), true);
        assert_eq!(told.take_due(at(4)), Some(Told::First));
    }
}
