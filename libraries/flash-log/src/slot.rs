//! The bytes of a slot, of any size.

use crate::crc::{Crc32, shifted};

/// Bytes of a slot before the value, and behind it.
pub(super) const HEAD: usize = 2;
pub(super) const SUM: usize = 4;
/// Version of the format, first byte of each slot.
const VERSION: u8 = 1;
/// Key of a bank's header; its value starts with the generation.
pub(super) const HEADER: u8 = 0xFF;

/// Content of a slot.
#[derive(Clone, Copy)]
pub(super) enum Content {
    Erased,
    /// A record.
    Entry {
        /// Something of it was put right.
        is_mended: bool,
    },
    /// A write that lost its power, or a record that rotted.
    Bad,
}

/// Makes it a record whose checksum is right.
pub(super) fn fill(slot: &mut [u8], key: u8, value: &[u8]) {
    let content = [VERSION, key].into_iter().chain(value.iter().copied());
    let content = content.chain(core::iter::repeat(0));
    for (place, byte) in slot.iter_mut().zip(content) {
        *place = byte;
    }
    seal(slot);
}

/// Puts the checksum behind the rest.
pub(super) fn seal(slot: &mut [u8]) {
    if let Some((body, sum)) = slot.split_last_chunk_mut() {
        *sum = Crc32::of(body).to_le_bytes();
    }
}

/// The checksum behind the rest.
pub(super) fn sum(slot: &[u8]) -> Option<[u8; SUM]> {
    slot.last_chunk().copied()
}

pub(super) const fn key(slot: &[u8]) -> u8 {
    match slot {
        [_, key, ..] => *key,
        _ => HEADER,
    }
}

/// The value, with zeros behind it.
pub(super) fn value_mut(slot: &mut [u8]) -> &mut [u8] {
    let end = slot.len().saturating_sub(SUM);
    debug_assert!(HEAD <= end, "a slot of {} bytes", slot.len());
    slot.get_mut(HEAD..end).unwrap_or_default()
}

/// With `mends`, one wrong bit or a wrong key is put right.
pub(super) fn inspect(slot: &mut [u8], mends: bool) -> Content {
    // Without an early end: so many bytes are looked at together.
    if slot.iter().fold(0xFF, |all, byte| all & byte) == 0xFF {
        return Content::Erased;
    }
    let difference = difference(slot);
    let is_whole = difference == 0 || mends && mend(slot, difference);
    match slot.first() {
        Some(&VERSION) if is_whole => Content::Entry {
            is_mended: difference != 0,
        },
        _ => Content::Bad,
    }
}

/// Generation in the header of a bank.
pub(super) fn generation(slot: &[u8]) -> Option<u32> {
    let value = slot.get(HEAD..).filter(|_| key(slot) == HEADER)?;
    Some(u32::from_le_bytes(*value.first_chunk()?))
}

/// Between the checksum that a slot should have and its own; 0 if it is whole.
// for less flash
#[inline(never)]
fn difference(slot: &[u8]) -> u32 {
    match slot.split_last_chunk() {
        Some((body, sum)) => Crc32::of(body) ^ u32::from_le_bytes(*sum),
        None => u32::MAX,
    }
}

/// Flips the bit of a slot, or the bits of its key, that alone make this difference, if there are
/// such.
// for less flash
#[inline(never)]
fn mend(slot: &mut [u8], difference: u32) -> bool {
    let body = 8 * slot.len().saturating_sub(SUM);
    let in_sum = body + difference.trailing_zeros() as usize;
    let mut wrong = difference.is_power_of_two().then_some((in_sum, 1));
    // The effect of a flip on the checksum is shifted once for each bit that follows.
    let mut effect = 1;
    let mut of_key = [0; 8];
    for bit in (0..body).rev() {
        effect = shifted(effect);
        if effect == difference {
            wrong = Some((bit, 1));
        }
        if let Some(place) = bit.checked_sub(8).and_then(|bit| of_key.get_mut(bit)) {
            *place = effect;
        }
    }
    let key = || {
        (1..=u8::MAX).find(|flips| {
            let bits = of_key.iter().enumerate();
            let bits = bits.filter(|(bit, _)| flips >> bit & 1 != 0);
            bits.fold(0, |sum, (_, effect)| sum ^ effect) == difference
        })
    };
    // A single bit is the likelier one.
    let wrong = wrong.or_else(|| Some((8, key()?)));
    match wrong.and_then(|(bit, flips)| Some((slot.get_mut(bit / 8)?, flips << (bit % 8)))) {
        Some((byte, flips)) => *byte ^= flips,
        None => return false,
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Any wrong bit, or any wrong key, in slots of the sizes in use: nothing looks like another.
    #[test]
    fn a_wrong_bit_or_key_is_put_right() {
        for len in [32, 96, 128] {
            let mut whole = std::vec![0xFF; len];
            fill(&mut whole, 0x5A, &[1, 2, 3]);
            let bits = (0..len * 8).map(|bit| (bit / 8, 1 << (bit % 8)));
            for (byte, flips) in bits.chain((1..=255).map(|flips| (1, flips))) {
                let mut slot = whole.clone();
                slot[byte] ^= flips;
                let difference = difference(&slot);
                assert!(mend(&mut slot, difference));
                assert_eq!(slot, whole, "{flips:#x} of byte {byte}");
            }
        }
    }
}
