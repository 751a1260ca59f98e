//! What nodes do: coordinator, camera, moving target.
//!
//! A role is a state machine without input or output. What happens is told to it with the time;
//! what it wants is asked from it, until it wants nothing more. [`run`](crate::run) connects it to
//! radio, flash and devices; tests connect roles to each other.

mod home;
mod outbox;
mod reports;

pub mod camera;
pub mod coordinator;
pub mod moving_target;

pub(crate) use home::Home;
pub(crate) use outbox::Outbox;
pub(crate) use reports::Reports;

use core::time::Duration;

use zigbee_link::{Instant, store::Membership, wire::ShortAddress};

use crate::{hardware::Indication, memory::Fact, message::Message};

/// The coordinator's address.
pub const COORDINATOR: ShortAddress = ShortAddress(0);

/// After this a message that was not delivered is sent again, if it still matters. Doubled with
/// each failure, up to [`RETRY_DOUBLINGS`] times: somebody who is away costs little airtime.
pub(crate) const RETRY: Duration = Duration::from_secs(2);

/// From 2 s to 32 s.
const RETRY_DOUBLINGS: u8 = 4;

/// Something a role wants done.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
pub enum Output<Notification, Task> {
    /// Send a message. With a `notification`, tell what became of it: [`Role::on_sent`].
    Send {
        /// The receiver, or [`ShortAddress::BROADCAST`].
        to: ShortAddress,
        /// What it is told.
        message: Message,
        /// Handed back with the result.
        notification: Option<Notification>,
    },
    /// Write this down before anything else is done.
    Save(Fact),
    /// A task for the role's devices.
    Task(Task),
}

/// The state machine of a node.
pub trait Role {
    /// Names a message of which the role must know whether it was delivered.
    type Notification: Copy;
    /// What the devices of this role are asked to do.
    type Task;
    /// What they tell.
    type Event;

    /// Takes a fact that was written down before a restart. Called before all others.
    fn restore(&mut self, fact: &Fact);

    /// The node joined, or formed, this network, or lost it.
    fn on_attached(&mut self, now: Instant, network: Option<Membership>);

    /// A message came.
    fn on_message(&mut self, now: Instant, from: ShortAddress, message: &Message);

    /// A message was delivered, or not. A broadcast counts as delivered.
    fn on_sent(&mut self, now: Instant, notification: Self::Notification, delivered: bool);

    /// A device told something.
    fn on_event(&mut self, now: Instant, event: Self::Event);

    /// Computes what needs time and stack. Call it after the others and before [`poll`](Self::poll),
    /// from where little of the stack is in use.
    fn compute(&mut self, _now: Instant) {}

    /// What is to be done next. Call it until it returns `None`.
    fn poll(&mut self, now: Instant) -> Option<Output<Self::Notification, Self::Task>>;

    /// When to call [`poll`](Self::poll) again, if nothing happens before.
    fn next_deadline(&self) -> Option<Instant>;

    /// What the lamps show.
    fn indication(&self) -> Indication;
}

/// The earliest of several deadlines.
pub(crate) struct Earliest(Option<Instant>);

impl Earliest {
    pub(crate) const fn new(deadline: Option<Instant>) -> Self {
        Self(deadline)
    }

    // Not inlined: for the sake of flash.
    #[inline(never)]
    pub(crate) fn or(&mut self, other: Option<Instant>) {
        if let Some(other) = other
            && self.0.is_none_or(|earliest| other < earliest)
        {
            self.0 = Some(other);
        }
    }

    pub(crate) const fn get(self) -> Option<Instant> {
        self.0
    }
}

/// Something that has to be told to a member until it is delivered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Owed {
    /// Nothing to tell.
    #[default]
    Nothing,
    /// From this time on, after so many failures.
    Due(Instant, u8),
    /// On its way, after so many failures.
    Sending(u8),
    /// On its way, but there is something newer to tell already.
    SendingOld,
}

impl Owed {
    /// There is something new to tell.
    pub(crate) fn tell(&mut self, now: Instant) {
        *self = match self {
            Self::Nothing | Self::Due(..) => Self::Due(now, 0),
            Self::Sending(_) | Self::SendingOld => Self::SendingOld,
        };
    }

    /// Whether to send now. It counts as on its way then.
    pub(crate) fn take(&mut self, now: Instant) -> bool {
        match *self {
            Self::Due(at, failures) if at <= now => {
                *self = Self::Sending(failures);
                true
            }
            _ => false,
        }
    }

    /// What became of it.
    pub(crate) fn sent(&mut self, now: Instant, delivered: bool) {
        *self = match self {
            Self::SendingOld => Self::Due(now, 0),
            Self::Sending(failures) if !delivered => {
                let doublings = (*failures).min(RETRY_DOUBLINGS);
                let pause = RETRY.saturating_mul(1 << doublings);
                Self::Due(now + pause, doublings + 1)
            }
            // Something newer came up after it was settled.
            Self::Due(..) => return,
            Self::Nothing | Self::Sending(_) => Self::Nothing,
        };
    }

    pub(crate) const fn deadline(&self) -> Option<Instant> {
        match self {
            Self::Due(at, _) => Some(*at),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn at(seconds: u64) -> Instant {
        Instant(seconds * 1_000_000)
    }

    #[test]
    fn failures_are_repeated_less_and_less() {
        let mut owed = Owed::Nothing;
        owed.tell(at(0));
        let mut now = at(0);
        let mut pauses = std::vec::Vec::new();
        for _ in 0..7 {
            assert!(owed.take(now) && !owed.take(now));
            owed.sent(now, false);
            let next = owed.deadline().unwrap();
            pauses.push(next.since(now).as_secs());
            now = next;
        }
        assert_eq!(pauses, [2, 4, 8, 16, 32, 32, 32]);
        // News begin from the start.
        owed.tell(now);
        assert!(owed.take(now));
        owed.sent(now, true);
        assert_eq!(owed, Owed::Nothing);
    }

    #[test]
    fn what_is_new_while_the_old_is_on_its_way_is_told_too() {
        let mut owed = Owed::Nothing;
        owed.tell(at(0));
        assert!(owed.take(at(0)));
        owed.tell(at(1));
        assert_eq!(owed.deadline(), None);
        owed.sent(at(2), true);
        assert!(owed.take(at(2)));
        // Put off to a later time meanwhile.
        owed = Owed::Due(at(5), 0);
        owed.sent(at(3), true);
        assert_eq!(owed.deadline(), Some(at(5)));
    }
}
