//! The frame check sequence.

/// The frame check sequence of a frame, appended to it little-endian.
///
/// IEEE 802.15.4-2006, 7.2.1.9: the 16-bit ITU-T polynomial `x^16 + x^12 + x^5 + 1`, starting from
/// zero, bits in the order of transmission (CRC-16/KERMIT).
///
/// One nibble at a time: a table of 32 bytes instead of 512.
pub fn fcs(frame: &[u8]) -> u16 {
    frame.iter().fold(0, |crc, &byte| {
        let crc = nibble(crc, byte);
        nibble(crc, byte >> 4)
    })
}

fn nibble(crc: u16, bits: u8) -> u16 {
    /// The remainder of each nibble by `x^16 + x^12 + x^5 + 1`, lowest power in the highest bit.
    const TABLE: [u16; 16] = [
        0x0000, 0x1081, 0x2102, 0x3183, 0x4204, 0x5285, 0x6306, 0x7387, 0x8408, 0x9489, 0xA50A,
        0xB58B, 0xC60C, 0xD68D, 0xE70E, 0xF78F,
    ];
    let index = usize::from((crc ^ u16::from(bits)) & 0xF);
    (crc >> 4) ^ TABLE.get(index).copied().unwrap_or(0)
}

/// Whether the last two bytes are the FCS of the others.
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
