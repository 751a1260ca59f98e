//! Events that are to happen, and their times.

use std::{cmp::Reverse, collections::BinaryHeap, rc::Weak, task::Waker};

use slab::Slab;

use super::Time;

/// Something in the machinery that is called at a time, without being a task.
pub trait Handler {
    /// The time has come. `token` is the one given to [`Clock::call_at`](super::Clock::call_at).
    fn event(&self, token: u64);
}

pub(super) enum Action {
    Wake(Waker),
    Call(Weak<dyn Handler>, u64),
}

/// An event that was planned. They are ordered by time; at one time the event planned first comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct EventId {
    /// Its time, and its number among all events: one number, which takes one comparison.
    order: u128,
    slot: usize,
}

impl EventId {
    fn new(at: Time, sequence: u64, slot: usize) -> Self {
        Self {
            order: u128::from(at) << u64::BITS | u128::from(sequence),
            slot,
        }
    }

    const fn at(self) -> Time {
        (self.order >> u64::BITS) as Time
    }

    const fn sequence(self) -> u64 {
        self.order as u64
    }
}

/// With fewer events than these in the order, nothing is gained by leaving some out.
const SMALL: usize = 64;

/// Most timers are taken off the plan before their time, so that costs least: the action goes, and its place in
/// the order stays until it comes up, or until most places are such.
#[derive(Default)]
pub(super) struct Timers {
    order: BinaryHeap<Reverse<EventId>>,
    /// Each with the number of its event: a slot serves many.
    actions: Slab<(u64, Action)>,
    sequence: u64,
}

impl Timers {
    pub(super) fn len(&self) -> usize {
        self.actions.len()
    }

    pub(super) fn next_at(&mut self) -> Option<Time> {
        loop {
            let Reverse(event) = self.order.peek()?;
            if is_planned(&self.actions, event) {
                return Some(event.at());
            }
            self.order.pop();
        }
    }

    pub(super) fn insert(&mut self, at: Time, action: Action) -> EventId {
        self.sequence += 1;
        let slot = self.actions.insert((self.sequence, action));
        let event = EventId::new(at, self.sequence, slot);
        if self.order.len() >= SMALL && self.order.len() > 2 * self.actions.len() {
            let actions = &self.actions;
            self.order
                .retain(|Reverse(event)| is_planned(actions, event));
        }
        self.order.push(Reverse(event));
        event
    }

    /// Has another task woken instead.
    pub(super) fn rewire(&mut self, event: EventId, waker: &Waker) {
        if let Some((sequence, Action::Wake(old))) = self.actions.get_mut(event.slot)
            && *sequence == event.sequence()
        {
            old.clone_from(waker);
        }
    }

    /// Takes an event off the plan, while it has neither happened nor been removed.
    pub(super) fn remove(&mut self, event: EventId) -> Option<Action> {
        let is_planned = is_planned(&self.actions, &event);
        is_planned.then(|| self.actions.remove(event.slot).1)
    }

    pub(super) fn pop(&mut self) -> Option<Action> {
        loop {
            let Reverse(event) = self.order.pop()?;
            if let Some(action) = self.remove(event) {
                return Some(action);
            }
        }
    }
}

fn is_planned(actions: &Slab<(u64, Action)>, event: &EventId) -> bool {
    let own = actions.get(event.slot);
    own.is_some_and(|(sequence, _)| *sequence == event.sequence())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::random::mix;

    /// Against a map in the order of time, while most planned events are taken off again.
    #[test]
    fn what_is_planned_comes_in_its_order() {
        let (mut timers, mut expected) = (Timers::default(), BTreeMap::new());
        let mut came = 0;
        for step in 0..20_000_u64 {
            let random = mix(step);
            match random % 8 {
                0 => {
                    assert_eq!(
                        timers.next_at(),
                        expected.keys().next().map(|e: &EventId| e.at())
                    );
                    let first = expected.pop_first();
                    match (timers.pop(), &first) {
                        (Some(Action::Call(_, token)), Some((_, other))) => {
                            assert_eq!(token, *other);
                            came += 1;
                        }
                        (None, None) => {}
                        _ => panic!("one of them is at its end"),
                    }
                    // It has happened.
                    if let Some((event, _)) = first {
                        assert!(timers.remove(event).is_none());
                    }
                }
                1..=3 if !expected.is_empty() => {
                    let at = (random >> 8) as usize % expected.len();
                    let event = *expected.keys().nth(at).unwrap();
                    expected.remove(&event);
                    assert!(timers.remove(event).is_some());
                    assert!(timers.remove(event).is_none());
                }
                _ => {
                    let nothing = Weak::<Nothing>::new();
                    let event = timers.insert((random >> 8) % 50, Action::Call(nothing, step));
                    expected.insert(event, step);
                }
            }
            assert_eq!(timers.len(), expected.len());
        }
        assert!(came > 1000, "{came}");
    }

    struct Nothing;

    impl Handler for Nothing {
        fn event(&self, _: u64) {}
    }

    /// Timers that are planned and taken off for ever need no more room.
    #[test]
    fn what_is_taken_off_leaves_nothing_behind() {
        let mut timers = Timers::default();
        for step in 0..100_000 {
            let nothing = Weak::<Nothing>::new();
            let event = timers.insert(u64::MAX - step, Action::Call(nothing, step));
            timers.remove(event);
        }
        assert_eq!(timers.len(), 0);
        assert!(timers.order.len() <= SMALL, "{}", timers.order.len());
    }
}
