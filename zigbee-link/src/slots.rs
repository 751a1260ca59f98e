//! Lists whose order does not matter.

/// Up to `N` things. Each stays where it is until it is taken: on a processor without a large
/// code memory, moving the others up is not cheap.
#[derive(Clone, Debug)]
pub(crate) struct Slots<T, const N: usize>([Option<T>; N]);

impl<T, const N: usize> Slots<T, N> {
    pub(crate) const fn new() -> Self {
        Self([const { None }; N])
    }

    /// Puts a thing into a free place. Returns true if there was room.
    #[must_use]
    pub(crate) fn put(&mut self, thing: T) -> bool {
        let free = self.0.iter_mut().find(|slot| slot.is_none());
        let has_room = free.is_some();
        if let Some(slot) = free {
            *slot = Some(thing);
        }
        has_room
    }

    /// Takes out one that is as wanted.
    pub(crate) fn take(&mut self, mut is_wanted: impl FnMut(&T) -> bool) -> Option<T> {
        self.0
            .iter_mut()
            .find_map(|slot| slot.take_if(|thing| is_wanted(thing)))
    }

    pub(crate) fn clear(&mut self) {
        for slot in &mut self.0 {
            *slot = None;
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> {
        self.0.iter().flatten()
    }

    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.0.iter_mut().flatten()
    }

    /// The thing in a place, of `N`.
    pub(crate) fn get_mut(&mut self, place: usize) -> Option<&mut T> {
        self.0.get_mut(place)?.as_mut()
    }

    pub(crate) fn get(&self, place: usize) -> Option<&T> {
        self.0.get(place)?.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_and_empty() {
        let mut slots = Slots::<u8, 2>::new();
        assert!(slots.put(1) && slots.put(2) && !slots.put(3));
        assert_eq!(slots.take(|&thing| thing > 1), Some(2));
        assert_eq!(slots.take(|&thing| thing > 1), None);
        assert!(slots.put(4));
        assert_eq!(slots.iter().sum::<u8>(), 5);
        assert_ne!(slots.iter().count(), 0);
        slots.clear();
        assert_eq!(slots.iter().count(), 0);
        assert_eq!(slots.iter().next(), None);
    }
}
