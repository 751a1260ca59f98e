//! The mark in an image: its board, its roles, its version.
//!
//! | bytes | contents |
//! |---|---|
//! | 0 to 7 | `CNodImag` |
//! | 8 to 11 | board: CRC-32 of its name, little-endian |
//! | 12 to 15 | version, little-endian |
//! | 16 | roles, a bit for each |
//! | 17 to 19 | bytes of the whole image, little-endian; 0: not told |
//! | 20 to 23 | CRC-32 of the bytes before, little-endian |

use crate::CRC;

/// Bytes of a stamp.
pub const STAMP: usize = 24;

const MAGIC: [u8; 8] = *b"CNodImag";

/// Kind and version of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stamp {
    /// Its board: [`board_number`].
    pub board: u32,
    /// Its roles, a bit for each, by an order of the firmware's own.
    pub roles: u8,
    /// Its version: a higher one is newer.
    pub version: u32,
}

/// Number of the board of this name.
pub const fn board_number(name: &str) -> u32 {
    CRC.checksum(name.as_bytes())
}

impl Stamp {
    /// Its bytes, for a constant of the image.
    #[allow(
        clippy::indexing_slicing,
        reason = "a constant: an index out of range would not compile"
    )]
    pub const fn bytes(&self) -> [u8; STAMP] {
        let mut bytes = [0; STAMP];
        let (board, version) = (self.board.to_le_bytes(), self.version.to_le_bytes());
        let mut i = 0;
        while i < 8 {
            bytes[i] = MAGIC[i];
            i += 1;
        }
        let mut i = 0;
        while i < 4 {
            bytes[8 + i] = board[i];
            bytes[12 + i] = version[i];
            i += 1;
        }
        bytes[16] = self.roles;
        let (covered, _) = bytes.split_at(20);
        let sum = CRC.checksum(covered).to_le_bytes();
        let mut i = 0;
        while i < 4 {
            bytes[20 + i] = sum[i];
            i += 1;
        }
        bytes
    }

    /// Reads a stamp; `None`: these bytes are none.
    pub fn read(bytes: &[u8; STAMP]) -> Option<Self> {
        let (covered, sum) = bytes.split_last_chunk::<4>()?;
        if CRC.checksum(covered) != u32::from_le_bytes(*sum) {
            return None;
        }
        let (magic, rest) = covered.split_first_chunk::<8>()?;
        let (board, rest) = rest.split_first_chunk::<4>()?;
        let (version, rest) = rest.split_first_chunk::<4>()?;
        (*magic == MAGIC).then_some(Self {
            board: u32::from_le_bytes(*board),
            roles: *rest.first()?,
            version: u32::from_le_bytes(*version),
        })
    }

    /// The stamp in an image and its place there; `None`: it has none, or more than one.
    #[cfg(any(test, feature = "alloc"))]
    pub fn find(image: &[u8]) -> Option<(usize, Self)> {
        let mut found = image.windows(STAMP).enumerate().filter_map(|(at, bytes)| {
            let bytes = bytes.first_chunk()?;
            bytes
                .starts_with(&MAGIC)
                .then(|| Some((at, Self::read(bytes)?)))?
        });
        let first = found.next()?;
        found.next().is_none().then_some(first)
    }

    /// Gives an image, or a file with an image in it, another version, and the number of bytes of the image. Returns
    /// false if it has no stamp.
    #[cfg(any(test, feature = "alloc"))]
    pub fn set_version(file: &mut [u8], version: u32, length: usize) -> bool {
        let Some((at, stamp)) = Self::find(file) else {
            return false;
        };
        let mut bytes = Self { version, ..stamp }.bytes();
        if let Some((covered, sum)) = bytes.split_last_chunk_mut::<4>() {
            let length = (length as u32).to_le_bytes();
            for (to, from) in covered.iter_mut().skip(17).zip(length) {
                *to = from;
            }
            *sum = CRC.checksum(covered).to_le_bytes();
        }
        let place = file.get_mut(at..at + STAMP);
        place.is_some_and(|place| {
            place.copy_from_slice(&bytes);
            true
        })
    }

    /// Bytes of a whole image as its stamp tells them, if it does.
    #[cfg(any(test, feature = "alloc"))]
    pub fn length_of(image: &[u8]) -> Option<usize> {
        let (at, _) = Self::find(image)?;
        let &[l0, l1, l2] = image.get(at + 17..)?.first_chunk::<3>()?;
        let length = u32::from_le_bytes([l0, l1, l2, 0]) as usize;
        (length > 0).then_some(length)
    }
}

#[cfg(test)]
mod tests {
    use std::vec;

    use super::*;

    #[test]
    fn an_image_is_stamped_once() {
        let stamp = Stamp {
            board: board_number("nrf52840"),
            roles: 7,
            version: 12,
        };
        let mut image = vec![0xFF; 4000];
        assert_eq!(Stamp::find(&image), None);
        image[1001..][..STAMP].copy_from_slice(&stamp.bytes());
        assert_eq!(Stamp::find(&image), Some((1001, stamp)));
        assert_eq!(Stamp::length_of(&image), None);
        assert!(Stamp::set_version(&mut image, 13, 4000));
        assert_eq!(Stamp::length_of(&image), Some(4000));
        assert_eq!(
            Stamp::find(&image),
            Some((
                1001,
                Stamp {
                    version: 13,
                    ..stamp
                }
            ))
        );
        // One flipped bit, and a second stamp.
        image[1012] ^= 1;
        assert_eq!(Stamp::find(&image), None);
        image[1012] ^= 1;
        image[3000..][..STAMP].copy_from_slice(&stamp.bytes());
        assert_eq!(Stamp::find(&image), None);
    }

    /// CRC-32 of "nrf52840" by Python's `zlib.crc32`.
    #[test]
    fn a_board_has_a_number() {
        assert_eq!(board_number("nrf52840"), 0x8171_300a);
    }
}
