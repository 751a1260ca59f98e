//! Addresses for chips to which nobody gave one.

use zigbee_link::wire::Eui64;

/// Bits that no other chip has, as an address that no manufacturer gives: locally administered, of
/// one device.
pub const fn local_address(bits: u64) -> Eui64 {
    let group = 0x01 << 56;
    let local = 0x02 << 56;
    Eui64((bits & !group | local).to_be_bytes())
}

/// A chip's own number as 64 bits, to which each of its bits contributes: FNV-1a. Numbers of one
/// wafer differ in a few bits only, so no part of them will do.
pub fn digest(number: &[u8]) -> u64 {
    number.iter().fold(0xcbf2_9ce4_8422_2325, |sum, &byte| {
        (sum ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn addresses_are_local_and_of_one_device() {
        for bits in [0, u64::MAX, 0x0123_4567_89ab_cdef] {
            let Eui64([first, rest @ ..]) = local_address(bits);
            assert_eq!(first & 0x03, 0x02);
            assert_eq!(rest, bits.to_be_bytes()[1..]);
        }
    }

    /// Published for this sum (draft-eastlake-fnv). A node's address must stay what it is.
    #[test]
    fn the_sum_is_the_published_one() {
        for (text, sum) in [
            ("", 0xcbf2_9ce4_8422_2325),
            ("a", 0xaf63_dc4c_8601_ec8c),
            ("foobar", 0x8594_4171_f739_67e8),
        ] {
            assert_eq!(digest(text.as_bytes()), sum, "{text}");
        }
    }

    /// Coordinates on the wafer, its number, and the lot's as text (RM0351, "Unique device ID
    /// register").
    fn number(x: u16, y: u16, wafer: u8) -> [u8; 12] {
        let [x0, x1] = x.to_le_bytes();
        let [y0, y1] = y.to_le_bytes();
        let [a, b, c, d, e, f, g] = *b"Q123456";
        [x0, x1, y0, y1, wafer, a, b, c, d, e, f, g]
    }

    #[test]
    fn all_chips_of_a_lot_have_their_own() {
        let addresses: BTreeSet<_> = (0..64_u16)
            .flat_map(|x| (0..64).map(move |y| (x, y)))
            .flat_map(|(x, y)| (1..=25).map(move |wafer| number(x, y, wafer)))
            .map(|number| local_address(digest(&number)).0)
            .collect();
        assert_eq!(addresses.len(), 64 * 64 * 25);
    }

    proptest! {
        #[test]
        fn each_bit_counts(number: [u8; 12], bit in 0_usize..96) {
            let mut other = number;
            other[bit / 8] ^= 1 << (bit % 8);
            prop_assert_ne!(
                local_address(digest(&number)).0,
                local_address(digest(&other)).0
            );
        }
    }
}
