//! What changed and is not yet written down.

/// Which of `N` facts, each with a record of its own, are to be written down.
///
/// A set and no queue: what a fact is now, its owner knows when the fact's turn comes. So nothing is
/// lost however much changes, and a fact that changes twice is written once.
///
/// Facts are written in the order of their numbers: one that must be written before another has the
/// lower number.
///
/// ```
/// use flash_log::DirtySet;
///
/// const POSE: usize = 0;
/// let mut pose = 1.5;
/// let mut unsaved = DirtySet::<4>::new();
/// unsaved.mark(POSE);
/// while let Some(fact) = unsaved.first() {
///     let written = pose;
///     // Writing takes a while. What changes meanwhile is written again.
///     if written == pose {
///         unsaved.clear(fact);
///     }
/// }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DirtySet<const N: usize>([bool; N]);

impl<const N: usize> DirtySet<N> {
    /// Everything is written down.
    pub const fn new() -> Self {
        Self([false; N])
    }

    /// A fact, below `N`, has changed.
    pub fn mark(&mut self, fact: usize) {
        self.set(fact, true);
    }

    /// A fact, below `N`, has been written down as it is.
    pub fn clear(&mut self, fact: usize) {
        self.set(fact, false);
    }

    /// The fact to write next: the one with the lowest number.
    pub fn first(&self) -> Option<usize> {
        self.0.iter().position(|&is_dirty| is_dirty)
    }

    fn set(&mut self, fact: usize, is_dirty: bool) {
        debug_assert!(fact < N, "fact {fact} of {N}");
        if let Some(place) = self.0.get_mut(fact) {
            *place = is_dirty;
        }
    }
}

impl<const N: usize> Default for DirtySet<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_in_their_order() {
        let mut dirty = DirtySet::<3>::new();
        assert_eq!(dirty.first(), None);
        dirty.mark(2);
        dirty.mark(1);
        dirty.mark(1);
        assert_eq!(dirty.first(), Some(1));
        dirty.clear(1);
        assert_eq!(dirty.first(), Some(2));
        dirty.clear(2);
        assert_eq!(dirty, DirtySet::default());
    }
}
