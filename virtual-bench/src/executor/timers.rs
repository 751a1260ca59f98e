//! What is to happen when: a heap in which each entry knows its place, so that a timer that is
//! dropped leaves nothing behind.

use std::{rc::Weak, task::Waker};

use super::Time;

/// Children of a heap node: flatter than a binary heap, and they share a cache line.
const ARITY: usize = 4;

/// Something in the machinery that is called at a time, without being a task.
pub trait Handler {
    /// The time has come. `token` is what was given to [`Clock::call_at`](super::Clock::call_at).
    fn event(&self, token: u64);
}

pub(super) enum Action {
    Wake(Waker),
    Call(Weak<dyn Handler>, u64),
}

/// An event that was planned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EventId {
    slot: u32,
    sequence: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    at: Time,
    sequence: u64,
    slot: u32,
}

struct Entry {
    sequence: u64,
    place: usize,
    action: Option<Action>,
}

/// Ordered by time; what was planned first comes first.
#[derive(Default)]
pub(super) struct Timers {
    heap: Vec<Key>,
    entries: Vec<Entry>,
    free: Vec<u32>,
    sequence: u64,
}

impl Timers {
    pub(super) fn len(&self) -> usize {
        self.heap.len()
    }

    pub(super) fn next_at(&self) -> Option<Time> {
        self.heap.first().map(|key| key.at)
    }

    pub(super) fn insert(&mut self, at: Time, action: Action) -> EventId {
        self.sequence += 1;
        let sequence = self.sequence;
        let place = self.heap.len();
        let entry = Entry {
            sequence,
            place,
            action: Some(action),
        };
        let slot = match self.free.pop() {
            Some(slot) => {
                self.entries[slot as usize] = entry;
                slot
            }
            None => {
                self.entries.push(entry);
                (self.entries.len() - 1) as u32
            }
        };
        let key = Key { at, sequence, slot };
        self.heap.push(key);
        self.rise(place, key);
        EventId { slot, sequence }
    }

    /// The entry, while it has neither happened nor been removed.
    fn live(&mut self, id: EventId) -> Option<&mut Entry> {
        let entry = self.entries.get_mut(id.slot as usize)?;
        (entry.sequence == id.sequence && entry.action.is_some()).then_some(entry)
    }

    /// Has another task woken instead.
    pub(super) fn rewire(&mut self, id: EventId, waker: &Waker) {
        if let Some(Action::Wake(old)) = self.live(id).and_then(|entry| entry.action.as_mut()) {
            old.clone_from(waker);
        }
    }

    pub(super) fn remove(&mut self, id: EventId) -> Option<Action> {
        let entry = self.live(id)?;
        let (place, action) = (entry.place, entry.action.take());
        self.take_out(place);
        self.free.push(id.slot);
        action
    }

    pub(super) fn pop(&mut self) -> Option<(Time, Action)> {
        let Key { at, sequence, slot } = *self.heap.first()?;
        let action = self.remove(EventId { slot, sequence })?;
        Some((at, action))
    }

    fn take_out(&mut self, place: usize) {
        let Some(last) = self.heap.pop() else {
            return;
        };
        if place < self.heap.len() {
            let settled = self.sink(place, last);
            if settled == place {
                self.rise(place, last);
            }
        }
    }

    fn put(&mut self, place: usize, key: Key) {
        self.heap[place] = key;
        self.entries[key.slot as usize].place = place;
    }

    /// Puts a key into the hole at a place, or above it.
    fn rise(&mut self, mut place: usize, key: Key) {
        while place > 0 {
            let parent = (place - 1) / ARITY;
            if self.heap[parent] < key {
                break;
            }
            self.put(place, self.heap[parent]);
            place = parent;
        }
        self.put(place, key);
    }

    /// Puts a key into the hole at a place, or below it. Where it is then.
    fn sink(&mut self, mut place: usize, key: Key) -> usize {
        loop {
            let first = ARITY * place + 1;
            let end = self.heap.len().min(first + ARITY);
            let Some(least) = (first..end).min_by_key(|&child| self.heap[child]) else {
                break;
            };
            if key < self.heap[least] {
                break;
            }
            self.put(place, self.heap[least]);
            place = least;
        }
        self.put(place, key);
        place
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::mix;

    fn nothing() -> Action {
        Action::Wake(Waker::noop().clone())
    }

    /// Against a sorted list: entries come in the order of time, then of planning, and removed
    /// ones do not come.
    #[test]
    fn order_survives_removals() {
        let mut timers = Timers::default();
        let mut plan = Vec::new();
        for n in 0..2000_u64 {
            let at = mix(n) % 100;
            plan.push((at, timers.insert(at, nothing())));
            if n % 3 == 0 {
                let victim = (mix(n + 7) % plan.len() as u64) as usize;
                let (_, id) = plan.remove(victim);
                assert!(timers.remove(id).is_some());
                assert!(timers.remove(id).is_none());
            }
        }
        plan.sort_by_key(|&(at, id)| (at, id.sequence));
        assert_eq!(timers.len(), plan.len());
        for (at, _) in plan {
            assert_eq!(timers.next_at(), Some(at));
            assert_eq!(timers.pop().map(|(at, _)| at), Some(at));
        }
        assert!(timers.pop().is_none());
        assert!(timers.entries.len() <= 2000);
    }
}
