//! Facts that changed and are not yet written down.

use core::ops::Range;

/// Set of facts, each with a record of its own, that are to be written down: up to 32 for each of `WORDS`.
///
/// A set and no queue: its owner knows the present value of a fact when the fact's turn comes. So nothing is lost
/// with any number of changes, and a fact that changes twice is written once.
///
/// Facts are written in the order of their numbers: one that must be written before another has the
/// lower number, or is asked for first with [`first_in`](Self::first_in).
///
/// ```
/// use flash_log::DirtySet;
///
/// const POSE: usize = 0;
/// let mut pose = 1.5;
/// let mut unsaved = DirtySet::<1>::new();
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
pub struct DirtySet<const WORDS: usize>([u32; WORDS]);

/// Facts in a word.
const WORD: usize = u32::BITS as usize;

impl<const WORDS: usize> DirtySet<WORDS> {
    /// Facts are numbered below this.
    pub const FACTS: usize = WORDS * WORD;

    /// Everything is written down.
    pub const fn new() -> Self {
        Self([0; WORDS])
    }

    /// A fact, below [`FACTS`](Self::FACTS), has changed.
    pub fn mark(&mut self, fact: usize) {
        debug_assert!(fact < Self::FACTS, "fact {fact} of {}", Self::FACTS);
        if let Some(word) = self.0.get_mut(fact / WORD) {
            *word |= 1 << (fact % WORD);
        }
    }

    /// A fact, below [`FACTS`](Self::FACTS), has been written down as it is.
    pub fn clear(&mut self, fact: usize) {
        debug_assert!(fact < Self::FACTS, "fact {fact} of {}", Self::FACTS);
        if let Some(word) = self.0.get_mut(fact / WORD) {
            *word &= !(1 << (fact % WORD));
        }
    }

    /// The fact to write next: the one with the lowest number.
    pub fn first(&self) -> Option<usize> {
        self.first_in(&(0..Self::FACTS))
    }

    /// The one of these with the lowest number.
    pub fn first_in(&self, facts: &Range<usize>) -> Option<usize> {
        // Most are empty, most of the time.
        let mut marked = self.0.iter().enumerate().filter(|(_, word)| **word != 0);
        marked.find_map(|(place, &word)| {
            let first = place * WORD;
            let wanted = below(facts.end, first) & !below(facts.start, first);
            let bit = (word & wanted).trailing_zeros();
            (bit < u32::BITS).then_some(first + bit as usize)
        })
    }
}

/// Those bits of the word from fact `first` on that stand for facts below `fact`.
fn below(fact: usize, first: usize) -> u32 {
    let bits = fact.saturating_sub(first).min(WORD) as u32;
    // All of them: more than can be shifted out.
    1_u32.checked_shl(bits).map_or(u32::MAX, |bit| bit - 1)
}

impl<const WORDS: usize> Default for DirtySet<WORDS> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_in_their_order() {
        let mut dirty = DirtySet::<1>::new();
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

    #[test]
    fn some_before_others() {
        let mut dirty = DirtySet::<3>::new();
        let marked = [0, 31, 32, 63, 64, 95];
        for fact in marked {
            dirty.mark(fact);
        }
        for from in 0..=96 {
            for to in 0..=96 {
                let first = marked.into_iter().find(|fact| (from..to).contains(fact));
                assert_eq!(dirty.first_in(&(from..to)), first, "{from}..{to}");
            }
        }
        dirty.clear(0);
        dirty.clear(31);
        assert_eq!(dirty.first(), Some(32));
    }
}
