//! List of which each entry has a fixed place in the flash.

use crate::{
    limits::TARGETS,
    message::{MemberAddress, StopNumber},
};

/// Entry that belongs to a stop of a target.
pub(super) trait OfStop {
    /// The target and its stop.
    fn key(&self) -> (MemberAddress, StopNumber);
}

/// Up to `N` entries. Each keeps its place until it is dropped. A full list drops the entry that came first.
#[derive(Clone, Debug)]
pub(super) struct Kept<T, const N: usize> {
    list: heapless::Vec<T, N>,
    /// Place of the oldest entry of a full list.
    first: usize,
}

impl<T: OfStop, const N: usize> Kept<T, N> {
    pub(super) const fn new() -> Self {
        Self {
            list: heapless::Vec::new(),
            first: 0,
        }
    }

    pub(super) fn iter(&self) -> core::slice::Iter<'_, T> {
        self.list.iter()
    }

    pub(super) fn iter_mut(&mut self) -> core::slice::IterMut<'_, T> {
        self.list.iter_mut()
    }

    pub(super) fn len(&self) -> usize {
        self.list.len()
    }

    pub(super) fn is_full(&self) -> bool {
        self.list.is_full()
    }

    pub(super) fn get(&self, place: usize) -> Option<&T> {
        self.list.get(place)
    }

    pub(super) fn get_mut(&mut self, place: usize) -> Option<&mut T> {
        self.list.get_mut(place)
    }

    pub(super) fn clear(&mut self) {
        self.list.clear();
        self.first = 0;
    }

    /// Drops all entries that are not `wanted`. Later ones move up.
    pub(super) fn retain(&mut self, wanted: impl FnMut(&T) -> bool) {
        self.list.retain(wanted);
        if !self.list.is_full() {
            self.first = 0;
        }
    }

    /// The place of the entry of this stop.
    pub(super) fn find(&self, key: (MemberAddress, StopNumber)) -> Option<usize> {
        self.list.iter().position(|kept| kept.key() == key)
    }

    /// Adds an entry, and returns its place.
    pub(super) fn add(&mut self, new: T) -> Option<usize> {
        match self.list.push(new) {
            Ok(()) => Some(self.list.len() - 1),
            Err(new) => {
                let place = self.first;
                *self.list.get_mut(place)? = new;
                self.first = (place + 1) % N;
                Some(place)
            }
        }
    }

    /// Finds the oldest entry after a restart: from there on the stops of each target ascend.
    pub(super) fn find_first(&mut self) {
        let mut keys = heapless::Vec::<_, N>::new();
        for kept in &self.list {
            // As many as there are in the list.
            let _ = keys.push(kept.key());
        }
        self.first = first_of(&keys);
    }
}

/// Returns the place at which stops in a ring begin, or 0. One copy of the code serves all lists.
// for less flash
#[inline(never)]
fn first_of(keys: &[(MemberAddress, StopNumber)]) -> usize {
    let is_first = |first: &usize| {
        let (later, sooner) = keys.split_at_checked(*first).unwrap_or_default();
        let mut last: heapless::Vec<(MemberAddress, StopNumber), TARGETS> = heapless::Vec::new();
        sooner.iter().chain(later).all(|key| {
            let known = last.iter_mut().find(|known| known.0 == key.0);
            let Some(known) = known else {
                // Further targets are ignored.
                let _ = last.push(*key);
                return true;
            };
            let step = key.1.wrapping_sub(known.1).cast_signed();
            *known = *key;
            step >= 0
        })
    };
    (0..keys.len()).find(is_first).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    impl OfStop for (MemberAddress, StopNumber) {
        fn key(&self) -> (MemberAddress, StopNumber) {
            *self
        }
    }

    /// With two targets: the numbers of one say nothing of those of the other.
    #[test]
    fn what_came_first_makes_room() {
        let mut kept = Kept::<_, 3>::new();
        let stops = [
            (1, 500),
            (2, 7),
            (1, 501),
            (2, 8),
            (1, 502),
            (2, 9),
            (2, 10),
        ];
        let places: Vec<_> = stops.iter().map(|stop| kept.add(*stop)).collect();
        assert_eq!(places, [0, 1, 2, 0, 1, 2, 0].map(Some));
        assert!(kept.iter().eq([(2, 10), (1, 502), (2, 9)].iter()));
        kept.retain(|stop| *stop != (1, 502));
        let places = [(2, 11), (2, 12)].map(|stop| kept.add(stop));
        assert_eq!(places, [2, 0].map(Some));
    }

    /// However many there were, of one target or of two by turns: after a restart the oldest makes room, as
    /// it would have done without.
    #[test]
    fn what_came_first_is_found_again() {
        for targets in [1, 2] {
            for count in 1..12 {
                let mut kept = Kept::<_, 4>::new();
                for n in 0..count {
                    // The numbers of stops wrap around.
                    kept.add((n % targets, 65_533_u16.wrapping_add(n / targets)));
                }
                let mut again = kept.clone();
                again.first = 0;
                again.find_first();
                assert_eq!(again.first, kept.first, "{targets} {count}");
            }
        }
    }

    #[test]
    fn what_came_first_is_known_after_a_restart() {
        for written in 1..=7 {
            let mut kept = Kept::<(MemberAddress, StopNumber), 3>::new();
            // Over the end of the numbers.
            let stop = |n: u16| (1, n.wrapping_sub(4));
            for n in 0..written {
                kept.add(stop(n));
            }
            let mut restored = Kept::<_, 3>::new();
            for kept in kept.iter() {
                restored.add(*kept);
            }
            restored.find_first();
            let new = stop(written);
            assert_eq!(restored.add(new), kept.add(new), "{written}");
        }
    }
}
