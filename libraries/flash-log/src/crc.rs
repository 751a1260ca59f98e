//! The checksum of slots.

/// CRC-32 (ISO-HDLC, that of Ethernet and zip), bit by bit: the covered bytes are few and read rarely.
#[derive(Clone, Copy, Debug)]
pub struct Crc32(u32);

impl Default for Crc32 {
    fn default() -> Self {
        Self::new()
    }
}

impl Crc32 {
    /// The checksum of no bytes.
    pub const fn new() -> Self {
        Self(u32::MAX)
    }

    /// The checksum of these bytes.
    pub fn of(bytes: &[u8]) -> u32 {
        let mut crc = Self::new();
        crc.add(bytes);
        crc.sum()
    }

    /// Covers these bytes, too.
    // for less flash
    #[inline(never)]
    pub fn add(&mut self, bytes: &[u8]) {
        self.0 = bytes.iter().fold(self.0, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| shifted(crc))
        });
    }

    /// The checksum of all bytes so far.
    pub const fn sum(self) -> u32 {
        !self.0
    }
}

/// A CRC-32 one bit later.
pub(super) const fn shifted(crc: u32) -> u32 {
    (crc >> 1) ^ (0xEDB8_8320 * (crc & 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value_of_crc_32() {
        assert_eq!(Crc32::of(b"123456789"), 0xCBF4_3926);
        let mut crc = Crc32::new();
        crc.add(b"1234");
        crc.add(b"56789");
        assert_eq!(crc.sum(), 0xCBF4_3926);
    }
}
