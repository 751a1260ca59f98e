//! Which facts are to be written down.

use crate::facts::{FactKey, KEYS_PER_LIST};

/// Facts that changed since they were written down. None is ever lost, and none is written twice:
/// what is written is what is known when its turn comes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Unsaved {
    /// One bit for each key of a record.
    keys: [u32; LISTS],
}

/// Facts without a list, and three lists.
const LISTS: usize = 4;

/// All of a list.
const ALL: u32 = u32::MAX;

/// The order in which they are written: lists, and which keys of them. A report counts sightings, so
/// these are there before it; and a camera that forgets reports that only when nothing is left.
/// Other references are there when nothing of the former ones is. The network comes last: where the
/// power fails while a former network is forgotten, it is forgotten again.
const ORDER: [(usize, u32); 9] = [
    single(FactKey::Walk),
    single(FactKey::Colours),
    list(FactKey::Sighting(0)),
    list(FactKey::ReferenceStop(0)),
    single(FactKey::Posed),
    single(FactKey::References),
    single(FactKey::Report),
    list(FactKey::Camera(0)),
    single(FactKey::Network),
];

const fn single(key: FactKey) -> (usize, u32) {
    (0, 1 << key.record())
}

const fn list(first: FactKey) -> (usize, u32) {
    ((first.record() / KEYS_PER_LIST) as usize, ALL)
}

impl Unsaved {
    pub(crate) const fn new() -> Self {
        const { assert!(KEYS_PER_LIST as u32 == u32::BITS) };
        Self { keys: [0; LISTS] }
    }

    /// This one is to be written.
    pub(crate) fn insert(&mut self, key: FactKey) {
        let record = key.record();
        if let Some(keys) = self.keys.get_mut(usize::from(record / KEYS_PER_LIST)) {
            *keys |= 1 << (record % KEYS_PER_LIST);
        }
    }

    /// The one whose turn it is.
    pub(crate) fn take(&mut self) -> Option<FactKey> {
        ORDER.iter().find_map(|&(list, which)| {
            let keys = self.keys.get_mut(list)?;
            let first = (*keys & which).trailing_zeros();
            let bit = 1_u32.checked_shl(first)?;
            *keys &= !bit;
            FactKey::of_record(list as u8 * KEYS_PER_LIST + first as u8)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fact_has_its_turn_once() {
        use FactKey::*;
        let order = [
            Walk,
            Colours,
            Sighting(0),
            Sighting(3),
            Sighting(31),
            ReferenceStop(0),
            ReferenceStop(11),
            Posed,
            References,
            Report,
            Camera(0),
            Camera(31),
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
        assert_eq!(count, 6 + 3 * 32);
    }
}
