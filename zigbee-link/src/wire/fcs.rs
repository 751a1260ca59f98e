//! The frame check sequence.

/// The frame check sequence of a frame, appended to it little-endian.
///
/// IEEE 802.15.4-2006, 7.2.1.9: the 16-bit ITU-T polynomial `x^16 + x^12 + x^5 + 1`, starting from
/// zero, bits in the order of transmission (CRC-16/KERMIT).
pub fn fcs(frame: &[u8]) -> u16 {
    frame.iter().copied().fold(0, crc_16)
}

/// One more byte of a CRC of 16 bits with the ITU-T polynomial, low bits first: of the [`fcs`], and
/// of CRC-16/X-25, which starts from 0xFFFF.
///
/// The eight steps of a byte at once: with `q = d ^ d << 4`, where `d` is the byte and the low half
/// of the CRC, each power of the polynomial is one shift of `q`. No table.
pub fn crc_16(crc: u16, byte: u8) -> u16 {
    let [low, high] = crc.to_le_bytes();
    let d = low ^ byte;
    let q = u16::from(d ^ d << 4);
    u16::from(high) ^ q << 8 ^ q << 3 ^ q >> 4
}

/// Returns true if the last two bytes are the FCS of the others.
pub fn has_good_fcs(psdu: &[u8]) -> bool {
    psdu.split_last_chunk()
        .is_some_and(|(frame, sum)| fcs(frame) == u16::from_le_bytes(*sum))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value_of_crc_16_kermit() {
        assert_eq!(fcs(b"123456789"), 0x2189);
    }

    /// IEEE 802.15.4-2006, 7.2.1.9: the acknowledgement of sequence number 0x6A, whose FCS goes out
    /// as the bits 0010 0111 1001 1110.
    #[test]
    fn example_of_the_standard() {
        assert_eq!(fcs(&[0x02, 0x00, 0x6A]).to_le_bytes(), [0xE4, 0x79]);
        assert!(has_good_fcs(&[0x02, 0x00, 0x6A, 0xE4, 0x79]));
    }

    #[test]
    fn every_flipped_bit_is_seen() {
        let good = [0x02, 0x00, 0x6A, 0xE4, 0x79];
        for bit in 0..40 {
            let mut bad = good;
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(!has_good_fcs(&bad), "bit {bit}");
        }
        assert!(!has_good_fcs(&[0]));
    }
}
