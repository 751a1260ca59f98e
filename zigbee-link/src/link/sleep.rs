//! Sleep of devices while their network is quiet, and how they are woken.
//!
//! A device that sleeps listens for [`SAMPLE`](crate::radio::SAMPLE) of each
//! [`SAMPLE_PERIOD`](crate::radio::SAMPLE_PERIOD), and at most [`ANSWER`] after it has sent. A node that has a message
//! for it first sends empty frames, one close to the other, for two periods: the device hears some of them,
//! and listens all the time for [`WAKE_FOR`]. Coordinated sampled listening of IEEE 802.15.4-2015 (6.12.2) and X-MAC
//! (Buettner et al. 2006) do likewise.
//!
//! A coordinator never sleeps, so that messages to it go out at once. The empty frames are not secured: an attacker
//! who sends them keeps devices awake, which costs their batteries. One who pretends that a device wakes others costs
//! each message to that device its first attempts: then a node counts on its own waking alone.

use core::time::Duration;

use crate::{
    Instant,
    radio::{SAMPLE, SAMPLE_PERIOD},
    wire::ShortAddress,
};

/// Time for which a node that was woken listens. Other nodes count on three quarters of it.
pub const WAKE_FOR: Duration = Duration::from_secs(120);

/// Time after it was woken for which a node counts as awake: what is begun then comes to its end before the node
/// sleeps again.
const COUNTED_ON: Duration = Duration::from_secs(90);

/// Time for which a node is woken: whenever in a period a device listens, it does so twice, and each time some two or
/// three whole frames come. With 30 % loss one device of 400 hears none of them.
pub const WAKING: Duration = SAMPLE_PERIOD.saturating_add(SAMPLE).saturating_mul(2);

/// Time for which a device listens after it has sent, unless its answer comes before.
const ANSWER: Duration = Duration::from_millis(100);

/// Attempts of a message, all without answer, after which a node that should be awake is woken: with 30 % loss each
/// way, one message of 60.
const DOUBTED: u8 = 6;

/// A node that does not answer is woken again after so long at the earliest.
const AGAIN: Duration = Duration::from_secs(10);

/// Time of what never was.
const START: Instant = Instant(0);

/// Sleep of a node, and its knowledge of that of others.
#[derive(Clone, Debug)]
pub(super) struct Sleep {
    /// False: all nodes of the network listen always.
    is_used: bool,
    is_asleep: bool,
    /// It sleeps, but for answers to its own questions.
    is_quiet: bool,
    /// It listens until then, at least.
    awake: Instant,
    /// An answer may come until then.
    answer: Instant,
    /// All are awake until then: this node woke them.
    all: Instant,
    /// The same where another node woke all. That one may reach fewer nodes than this one does.
    others: Instant,
    /// The node that was last woken alone, or that last woke this one and is awake itself; and until when.
    one: (ShortAddress, Instant),
    /// The node that this one woke alone last, and until when it is awake.
    woken: (ShortAddress, Instant),
    /// The node that this one wakes, or all, and until when.
    waking: (ShortAddress, Instant),
}

impl Sleep {
    pub(super) const fn new() -> Self {
        Self {
            is_used: false,
            is_asleep: false,
            is_quiet: false,
            awake: START,
            answer: START,
            all: START,
            others: START,
            one: (ShortAddress::UNASSIGNED, START),
            woken: (ShortAddress::UNASSIGNED, START),
            waking: (ShortAddress::UNASSIGNED, START),
        }
    }

    /// Devices of the network sleep from now on.
    pub(super) const fn begin(&mut self) {
        self.is_used = true;
    }

    /// Listens for a while: it has just started or joined, was woken, or woke others.
    // for less flash
    #[inline(never)]
    pub(super) fn stay_awake(&mut self, now: Instant) {
        self.awake = now + WAKE_FOR;
    }

    /// Takes note of the time. At first the node has just started.
    pub(super) fn poll(&mut self, now: Instant) {
        if self.awake == START {
            self.stay_awake(now);
        }
        let (to, until) = self.waking;
        if to != ShortAddress::UNASSIGNED && until <= now {
            self.waking.0 = ShortAddress::UNASSIGNED;
            if to == ShortAddress::BROADCAST {
                self.all = now + COUNTED_ON;
            } else {
                self.one = (to, now + COUNTED_ON);
                self.woken = self.one;
            }
            self.stay_awake(now);
        }
        self.is_quiet = self.is_used && self.awake <= now;
        self.is_asleep = self.is_quiet && self.answer <= now;
    }

    /// Something is to be sent, to which an answer may come.
    pub(super) fn on_asking(&mut self, now: Instant) {
        self.answer = now + ANSWER;
        self.is_asleep = false;
    }

    /// Returns true if the node sleeps, unless it is a coordinator.
    pub(super) const fn is_asleep(&self) -> bool {
        self.is_asleep
    }

    /// Returns true if it sleeps, or only listens for the answer to a question of its own.
    pub(super) const fn is_quiet(&self) -> bool {
        self.is_quiet
    }

    /// Time to [`poll`](Self::poll).
    pub(super) fn deadline(&self) -> Option<Instant> {
        let may_sleep = self.is_used && !self.is_asleep;
        may_sleep.then_some(self.awake.max(self.answer))
    }

    /// The node that is being woken, or all.
    pub(super) fn waking(&self) -> Option<ShortAddress> {
        let (to, _) = self.waking;
        (to != ShortAddress::UNASSIGNED).then_some(to)
    }

    /// Wakes a node, or all.
    pub(super) fn wake(&mut self, now: Instant, to: ShortAddress) {
        self.waking = (to, now + WAKING);
    }

    /// Wakes no other node any more, as it left their network.
    pub(super) const fn give_up(&mut self) {
        self.waking.0 = ShortAddress::UNASSIGNED;
    }

    /// Wakes the receiver of a message after so many attempts without answer; or all, where another one has just been
    /// woken: there is something to tell to several.
    pub(super) fn wake_for(&mut self, now: Instant, to: ShortAddress, attempts: u8) {
        let (one, until) = self.one;
        let all = attempts == 0 && one != to && now < until;
        self.wake(now, if all { ShortAddress::BROADCAST } else { to });
    }

    /// A node wakes this one, or all.
    pub(super) fn on_wake(&mut self, now: Instant, from: ShortAddress, is_broadcast: bool) {
        let until = now + COUNTED_ON;
        if is_broadcast {
            self.others = until;
        }
        self.one = (from, until);
        self.stay_awake(now);
    }

    /// An answer came.
    pub(super) const fn on_answered(&mut self) {
        self.answer = START;
    }

    /// Returns true if a message to this node, or to all, has to wait until the receiver is woken, after so many
    /// attempts without answer.
    // for less flash
    #[inline(never)]
    pub(super) fn has_to_wake(&self, now: Instant, to: ShortAddress, attempts: u8) -> bool {
        if !self.is_used || to == ShortAddress::COORDINATOR {
            return false;
        }
        let is_doubted = attempts >= DOUBTED;
        let (one, until) = if is_doubted { self.woken } else { self.one };
        let one = if one == to { until } else { START };
        let (until, now) = match to {
            ShortAddress::BROADCAST => (self.all, now),
            _ if is_doubted => (one, now + (COUNTED_ON - AGAIN)),
            _ => (self.all.max(self.others).max(one), now),
        };
        until <= now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Long after the start.
    const NOW: Instant = Instant(3_600_000_000);
    const CAMERA: ShortAddress = ShortAddress(7);

    /// Of a node that was started long ago.
    fn used() -> Sleep {
        let mut sleep = Sleep::new();
        sleep.begin();
        sleep.poll(Instant(0));
        assert_eq!(sleep.deadline(), Some(Instant(0) + WAKE_FOR));
        sleep.poll(NOW);
        assert!(sleep.is_asleep());
        sleep
    }

    /// Has this node wake others, and returns the time when that is over.
    fn wakes(sleep: &mut Sleep, now: Instant, to: ShortAddress) -> Instant {
        sleep.wake(now, to);
        assert_eq!(sleep.waking(), Some(to));
        let over = now + WAKING;
        sleep.poll(Instant(over.0 - 1));
        assert_eq!(sleep.waking(), Some(to));
        sleep.poll(over);
        assert_eq!(sleep.waking(), None);
        over
    }

    #[test]
    fn a_network_that_does_not_sleep_wakes_none() {
        let mut sleep = Sleep::new();
        sleep.poll(NOW);
        assert!(!sleep.is_asleep());
        for to in [CAMERA, ShortAddress::BROADCAST] {
            assert!(!sleep.has_to_wake(NOW, to, 9));
        }
        assert_eq!((sleep.waking(), sleep.deadline()), (None, None));
    }

    #[test]
    fn it_sleeps_when_nothing_has_happened_for_two_minutes() {
        let mut sleep = used();
        sleep.stay_awake(NOW);
        sleep.poll(NOW);
        let until = sleep.deadline().unwrap();
        assert_eq!(until, NOW + WAKE_FOR);
        sleep.poll(Instant(until.0 - 1));
        assert!(!sleep.is_asleep());
        sleep.poll(until);
        assert!(sleep.is_asleep());
        assert_eq!(sleep.deadline(), None);
        // It asks whether its coordinator is there, and listens until the answer.
        sleep.on_asking(until);
        assert!(!sleep.is_asleep());
        // Which is no reason for others to wake.
        sleep.poll(until);
        assert!(!sleep.is_asleep() && sleep.is_quiet());
        sleep.on_answered();
        sleep.poll(until);
        assert!(sleep.is_asleep());
        sleep.on_asking(until);
        assert_eq!(sleep.deadline(), Some(until + ANSWER));
        sleep.poll(until + ANSWER);
        assert!(sleep.is_asleep());
        sleep.on_wake(until, CAMERA, false);
        sleep.poll(until);
        assert!(!sleep.is_quiet());
        assert_eq!(sleep.deadline(), Some(until + WAKE_FOR));
    }

    #[test]
    fn receivers_are_woken_unless_they_were_just_now() {
        let mut sleep = used();
        assert!(!sleep.has_to_wake(NOW, ShortAddress::COORDINATOR, 9));
        for to in [CAMERA, ShortAddress::BROADCAST] {
            assert!(sleep.has_to_wake(NOW, to, 0));
        }
        let alone = wakes(&mut sleep, NOW, CAMERA);
        assert!(!sleep.has_to_wake(alone, CAMERA, 0));
        assert!(sleep.has_to_wake(alone, ShortAddress(8), 0));
        assert!(sleep.has_to_wake(alone, ShortAddress::BROADCAST, 0));
        let all = wakes(&mut sleep, alone, ShortAddress::BROADCAST);
        for to in [CAMERA, ShortAddress(8), ShortAddress::BROADCAST] {
            assert!(!sleep.has_to_wake(all, to, 0));
            assert!(sleep.has_to_wake(all + COUNTED_ON, to, 0));
        }
        assert!(COUNTED_ON < WAKE_FOR);
    }

    /// Frames that wake are not secured: an attacker who sends them in the name of a device keeps no other node from waking it.
    #[test]
    fn a_device_that_does_not_answer_is_woken_whatever_was_heard_of_it() {
        let mut sleep = used();
        sleep.on_wake(NOW, CAMERA, true);
        assert!(!sleep.has_to_wake(NOW, CAMERA, 0));
        assert!(!sleep.has_to_wake(NOW, CAMERA, DOUBTED - 1));
        assert!(sleep.has_to_wake(NOW, CAMERA, DOUBTED));
        let woken = wakes(&mut sleep, NOW, CAMERA);
        sleep.on_wake(woken, CAMERA, false);
        // It takes a while until this node may wake it again.
        assert!(!sleep.has_to_wake(woken, CAMERA, DOUBTED));
        assert!(sleep.has_to_wake(woken + AGAIN, CAMERA, DOUBTED));
    }

    /// Frames that it has to send in its next network do not wait.
    #[test]
    fn a_node_that_leaves_its_network_wakes_none() {
        let mut sleep = used();
        sleep.wake(NOW, ShortAddress::BROADCAST);
        sleep.give_up();
        assert_eq!(sleep.waking(), None);
        sleep.poll(NOW + WAKING);
        assert!(sleep.has_to_wake(NOW + WAKING, ShortAddress::BROADCAST, 0));
    }

    #[test]
    fn the_second_of_two_receivers_is_woken_with_all() {
        let mut sleep = used();
        sleep.wake_for(NOW, CAMERA, 0);
        assert_eq!(sleep.waking(), Some(CAMERA));
        sleep.poll(NOW + WAKING);
        let other = ShortAddress(8);
        // One that does not answer is no reason to wake all.
        for (attempts, later, woken) in [
            (DOUBTED, WAKING, other),
            (0, WAKING, ShortAddress::BROADCAST),
            (0, COUNTED_ON + WAKING, other),
        ] {
            let mut sleep = sleep.clone();
            sleep.wake_for(NOW + later, other, attempts);
            assert_eq!(sleep.waking(), Some(woken), "{attempts} {later:?}");
        }
    }

    /// Another node may reach fewer: what goes to all is not left to it.
    #[test]
    fn nodes_that_another_woke_are_awake_for_a_message_to_one() {
        let mut sleep = used();
        sleep.on_wake(NOW, CAMERA, true);
        assert!(!sleep.has_to_wake(NOW, ShortAddress(8), 0));
        assert!(sleep.has_to_wake(NOW, ShortAddress::BROADCAST, 0));
        let mut sleep = used();
        sleep.on_wake(NOW, CAMERA, false);
        assert!(!sleep.has_to_wake(NOW, CAMERA, 0));
        assert!(sleep.has_to_wake(NOW, ShortAddress(8), 0));
    }

    #[test]
    fn a_node_that_does_not_answer_is_woken_again_but_not_for_ever() {
        let mut sleep = used();
        let all = wakes(&mut sleep, NOW, ShortAddress::BROADCAST);
        assert!(!sleep.has_to_wake(all, CAMERA, DOUBTED - 1));
        assert!(sleep.has_to_wake(all, CAMERA, DOUBTED));
        let alone = wakes(&mut sleep, all, CAMERA);
        assert!(!sleep.has_to_wake(alone, CAMERA, DOUBTED));
        assert!(sleep.has_to_wake(alone + AGAIN, CAMERA, DOUBTED));
    }
}
