//! What is to happen when.

use std::{collections::BTreeMap, rc::Weak, task::Waker};

use super::Time;

/// Something in the machinery that is called at a time, without being a task.
pub trait Handler {
    /// The time has come. `token` is what was given to [`Clock::call_at`](super::Clock::call_at).
    fn event(&self, token: u64);
}

pub(super) enum Action {
    Wake(Waker),
    Call(Weak<dyn Handler>, u64),
}

/// An event that was planned. They are ordered by time; what was planned first comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct EventId {
    at: Time,
    sequence: u64,
}

#[derive(Default)]
pub(super) struct Timers {
    plan: BTreeMap<EventId, Action>,
    sequence: u64,
}

impl Timers {
    pub(super) fn len(&self) -> usize {
        self.plan.len()
    }

    pub(super) fn next_at(&self) -> Option<Time> {
        self.plan.first_key_value().map(|(event, _)| event.at)
    }

    pub(super) fn insert(&mut self, at: Time, action: Action) -> EventId {
        self.sequence += 1;
        let event = EventId {
            at,
            sequence: self.sequence,
        };
        self.plan.insert(event, action);
        event
    }

    /// Has another task woken instead.
    pub(super) fn rewire(&mut self, event: EventId, waker: &Waker) {
        if let Some(Action::Wake(old)) = self.plan.get_mut(&event) {
            old.clone_from(waker);
        }
    }

    /// Takes an event off the plan, while it has neither happened nor been removed.
    pub(super) fn remove(&mut self, event: EventId) -> Option<Action> {
        self.plan.remove(&event)
    }

    pub(super) fn pop(&mut self) -> Option<Action> {
        self.plan.pop_first().map(|(_, action)| action)
    }
}
