//! The facts that are to be written down.

use core::ops::Range;

use flash_log::DirtySet;

use crate::{
    facts::{BEARING_RECORDS, FactKey, STOP_RECORDS},
    limits::{MEMBERS_MOST, REFERENCE_STOPS, SIGHTINGS},
};

/// Facts that changed since they were written down, by the keys of their records. None is ever lost, and none
/// is written twice: the value known at its turn is written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Unsaved(DirtySet<WORDS>);

/// Words of 32 facts.
const WORDS: usize = 8;

/// The order in which they are written: the keys of one after the other. A report counts sightings, so these
/// are there before it; and a camera that forgets reports that only when nothing is left. Other references
/// are written when nothing of the former ones is left. The network comes last: where the power fails while a
/// former network is forgotten, it is forgotten again. A stop of a walk is there before the record that the
/// target stands at it.
const ORDER: [Range<usize>; 11] = [
    records(FactKey::WalkStops(0), STOP_RECORDS),
    single(FactKey::Walk),
    records(FactKey::WalkBearings(0), BEARING_RECORDS),
    single(FactKey::Colours),
    records(FactKey::Sighting(0), SIGHTINGS as u8),
    records(FactKey::ReferenceStop(0), REFERENCE_STOPS as u8),
    single(FactKey::Posed),
    single(FactKey::References),
    single(FactKey::Report),
    records(FactKey::Camera(0), MEMBERS_MOST as u8),
    single(FactKey::Network),
];

const fn single(key: FactKey) -> Range<usize> {
    let key = key.record() as usize;
    key..key + 1
}

const fn records(first: FactKey, count: u8) -> Range<usize> {
    let first = first.record() as usize;
    first..first + count as usize
}

impl Unsaved {
    pub(crate) const fn new() -> Self {
        const { assert!(DirtySet::<WORDS>::FACTS > u8::MAX as usize) };
        Self(DirtySet::new())
    }

    /// This one is to be written.
    pub(crate) fn insert(&mut self, key: FactKey) {
        self.0.mark(key.record().into());
    }

    /// The one whose turn it is.
    pub(crate) fn take(&mut self) -> Option<FactKey> {
        let record = ORDER.iter().find_map(|keys| self.0.first_in(keys))?;
        self.0.clear(record);
        FactKey::of_record(record as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fact_has_its_turn_once() {
        use FactKey::*;
        let order = [
            WalkStops(0),
            WalkStops(STOP_RECORDS - 1),
            Walk,
            WalkBearings(0),
            WalkBearings(BEARING_RECORDS - 1),
            Colours,
            Sighting(0),
            Sighting(3),
            Sighting(SIGHTINGS as u8 - 1),
            ReferenceStop(0),
            ReferenceStop(11),
            Posed,
            References,
            Report,
            Camera(0),
            Camera(MEMBERS_MOST as u8 - 1),
            Network,
        ];
        let mut unsaved = Unsaved::new();
        for key in order.iter().rev().chain(&order) {
            unsaved.insert(*key);
        }
        assert!(core::iter::from_fn(|| unsaved.take()).eq(order));
        assert_eq!(unsaved, Unsaved::new());
    }

    #[test]
    fn the_key_of_a_record_says_which_fact_it_is() {
        let keys = (0..=u8::MAX).filter_map(|record| Some((record, FactKey::of_record(record)?)));
        let mut count = 0;
        for (record, key) in keys {
            assert_eq!(key.record(), record);
            count += 1;
        }
        assert_eq!(
            count,
            6 + SIGHTINGS + REFERENCE_STOPS + MEMBERS_MOST + 34 + 77
        );
    }
}
