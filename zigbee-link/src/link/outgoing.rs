//! Messages on their way out.

use core::{fmt, time::Duration};

use super::{MESSAGE_MAX, packet::Kind};
use crate::{Instant, jitter::Jitter, wire::ShortAddress};

/// Transmissions of a unicast message, challenges to a stranger included, before it counts as
/// unanswered.
pub const ATTEMPTS: u8 = 10;
/// Most transmissions of a broadcast, which is not acknowledged. One is enough where the last messages to members
/// all came at the first attempt.
pub const BROADCAST_COPIES: u8 = 2;
/// Messages in a row that must come at the first attempt before one transmission is enough.
pub(super) const AT_ONCE: u8 = 7;
/// Mean wait after the first attempt; doubled after each, up to [`RETRY_MAX`]. A unicast of 100
/// bytes and its acknowledgement take about 7 ms of airtime.
pub const RETRY_FIRST: Duration = Duration::from_millis(30);
/// Longest mean wait.
pub const RETRY_MAX: Duration = Duration::from_millis(960);

/// Names a message that is being sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ticket(pub(super) u16);

/// Result of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[must_use]
#[non_exhaustive]
pub enum Delivery {
    /// The receiver has it, and said so.
    Delivered,
    /// No answer came. The receiver may have it all the same: the answers may have been lost.
    NoAnswer,
    /// A broadcast, or a unicast that is sent once. It is not known which nodes have it.
    Broadcast,
}

/// Reason why a message was not taken for sending.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SendError {
    /// The node belongs to no network.
    NotJoined,
    /// As many messages as the queue holds are on their way, or their results were not fetched.
    /// Nothing is dropped to make room.
    QueueFull,
    /// More than [`MESSAGE_MAX`] bytes, or not serialisable.
    TooLong,
    /// The address is this node's own, or not that of a device.
    Destination,
}

impl fmt::Display for SendError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotJoined => "the node belongs to no network: wait until it has joined",
            Self::QueueFull => "too many messages are on their way: wait for a result",
            Self::TooLong => "the message is too long for one frame",
            Self::Destination => "the address is the own one or no node's",
        })
    }
}

impl core::error::Error for SendError {}

/// A message from [`Link::send`](super::Link::send) until its result is fetched.
#[derive(Debug)]
pub(super) struct Outgoing {
    pub ticket: Ticket,
    pub kind: Kind,
    pub destination: ShortAddress,
    pub bytes: heapless::Vec<u8, MESSAGE_MAX>,
    /// Frame counters of the first and the last transmission.
    pub counters: Option<(u32, u32)>,
    pub attempts: u8,
    pub due: Instant,
    pub result: Option<Delivery>,
}

impl Outgoing {
    pub(super) const fn is_waiting(&self) -> bool {
        self.result.is_none()
    }

    /// Returns true if the application may have the result.
    pub(super) fn is_settled_message(&self) -> bool {
        !self.is_waiting() && self.kind != Kind::Control
    }

    /// Returns true if this message has to be settled before another to the same destination is sent.
    pub(super) const fn is_before(&self, other: &Self) -> bool {
        // Numbers wrap around; all in a queue are close together.
        let age = other.ticket.0.wrapping_sub(self.ticket.0);
        self.is_waiting() && self.destination.0 == other.destination.0 && 0 < age && age < 1 << 15
    }

    /// Takes note of an attempt, of which a broadcast has so many copies.
    pub(super) fn attempted(&mut self, now: Instant, jitter: &mut Jitter, copies: u8) {
        self.due = now + jitter.backoff(RETRY_FIRST, RETRY_MAX, self.attempts);
        self.attempts += 1;
        if self.kind == Kind::Broadcast && self.attempts >= copies {
            self.result = Some(Delivery::Broadcast);
        }
    }

    /// Takes note of a transmission under this frame counter.
    pub(super) fn transmitted(&mut self, counter: u32) {
        let first = self.counters.map_or(counter, |(first, _)| first);
        self.counters = Some((first, counter));
        if self.kind == Kind::Once {
            self.result = Some(Delivery::Broadcast);
        }
    }

    /// Returns true if an answer to the frame with this counter is one to this message.
    pub(super) fn is_answered_by(&self, counter: u32) -> bool {
        self.counters
            .is_some_and(|(first, last)| first <= counter && counter <= last)
    }
}
