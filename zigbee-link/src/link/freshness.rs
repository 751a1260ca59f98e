//! Challenges, and short frames that answer others.

use core::time::Duration;

use crate::{
    Instant,
    wire::{Address, Eui64, ShortAddress},
};

/// A node is not asked again within this time.
const AGAIN: Duration = Duration::from_millis(100);
/// An answer after this time is none.
const EXPIRY: Duration = Duration::from_secs(2);
/// Challenges open at a time.
const CHALLENGES: usize = 8;
/// Least time between two challenges after broadcasts that no peer has proven fresh: every node hears a broadcast,
/// and would ask.
pub(super) const BROADCAST_AGAIN: Duration = Duration::from_secs(5);

/// Content of a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReplyKind {
    Acknowledgement {
        counter: u32,
    },
    /// Under the next key, if it says so and there is one.
    Challenge {
        under_next: bool,
    },
    Response {
        counter: u32,
        challenges: bool,
    },
}

/// A frame that is only a header and a few bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reply {
    pub kind: ReplyKind,
    pub destination: Address,
    pub due: Instant,
}

impl Reply {
    /// Returns true if it asks the receiver for proof.
    pub(super) const fn asks(&self) -> bool {
        matches!(
            self.kind,
            ReplyKind::Challenge { .. }
                | ReplyKind::Response {
                    challenges: true,
                    ..
                }
        )
    }
}

#[derive(Clone, Copy, Debug)]
struct Open {
    target: Address,
    counter: u32,
    asked: Instant,
}

/// Challenges that were sent and not answered.
///
/// Anybody can make a node send challenges: by frames from unknown addresses, by forged and by repeated ones. That
/// costs airtime, no more than the frames themselves, and one of a few places for a short time. A broadcast would
/// make every node ask: see [`BROADCAST_AGAIN`].
#[derive(Clone, Debug, Default)]
pub(super) struct Challenges {
    open: heapless::Vec<Open, CHALLENGES>,
    /// No broadcast is asked after before this.
    broadcast_from: Option<Instant>,
}

impl Challenges {
    pub(super) fn clear(&mut self) {
        self.open.clear();
    }

    /// Returns true if the sender of a broadcast may be asked now, which is once in a while.
    pub(super) fn may_ask_after_broadcast(&mut self, now: Instant) -> bool {
        let may = self.broadcast_from.is_none_or(|from| from <= now);
        if may {
            self.broadcast_from = Some(now + BROADCAST_AGAIN);
        }
        may
    }

    /// Returns true if this node may be asked now: unless the table is full of open challenges, or this node was
    /// asked just now.
    pub(super) fn may_ask(&mut self, now: Instant, target: Address) -> bool {
        self.open.retain(|open| now < open.asked + EXPIRY);
        let just_asked = |open: &Open| open.target == target && now < open.asked + AGAIN;
        !self.open.is_full() && !self.open.iter().any(just_asked)
    }

    /// Takes note of a challenge that goes out with this frame counter.
    pub(super) fn asked(&mut self, now: Instant, target: Address, counter: u32) {
        let open = Open {
            target,
            counter,
            asked: now,
        };
        if let Err(open) = self.open.push(open)
            && let Some(oldest) = self.open.iter_mut().min_by_key(|open| open.asked)
        {
            *oldest = open;
        }
    }

    /// Returns true if a frame of this node, which repeats `counter`, answers an open challenge. An answer counts
    /// once.
    pub(super) fn is_answered(
        &mut self,
        now: Instant,
        extended: Eui64,
        short: ShortAddress,
        counter: u32,
    ) -> bool {
        let names = [Address::Extended(extended), Address::Short(short)];
        let answered = self.open.iter().find(|open| {
            open.counter == counter && names.contains(&open.target) && now < open.asked + EXPIRY
        });
        let Some(&Open { target, .. }) = answered else {
            return false;
        };
        self.open.retain(|open| open.target != target);
        true
    }
}
