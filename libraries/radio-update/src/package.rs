//! The signed header that goes before an image.
//!
//! | bytes | contents |
//! |---|---|
//! | 0 to 3 | `CUpd` |
//! | 4 | 1, the version of this format |
//! | 5 | roles of the image, a bit for each |
//! | 6, 7 | 0 |
//! | 8 to 11 | board of the image: [`board_number`](crate::stamp::board_number) |
//! | 12 to 15 | version of the image |
//! | 16 to 19 | length of the image, bytes |
//! | 20 to 51 | the first half of its SHA-512 |
//! | 52 to 51 + 4 n | CRC-32 of each of its n pages; the last one is filled with 0xFF |
//! | the last 64 | Ed25519 signature of all bytes before |
//!
//! Numbers are little-endian. The header and then the image are cut into blocks of [`BLOCK`] bytes; the
//! last block of each is filled with 0xFF. The CRC-32 of the header names the package.

use salty::{PublicKey, Sha512, Signature};

use crate::{BLOCK, CRC, PAGE, PAGES_MAX, stamp::Stamp};

/// Bytes of a signature.
const SIGNATURE: usize = 64;
/// Bytes before the checksums of pages.
const FIXED: usize = 52;

/// Bytes of the longest header.
pub const HEADER_MAX: usize = FIXED + 4 * PAGES_MAX + SIGNATURE;

/// Blocks of the longest header.
pub const HEADER_BLOCKS: usize = HEADER_MAX.div_ceil(BLOCK);

const MAGIC: [u8; 4] = *b"CUpd";
const FORMAT: u8 = 1;

/// A public key (Ed25519), with which nodes check headers.
pub type Key = [u8; 32];

/// Bytes of a record of a public key in a flash: `CUKy`, the key, CRC-32 of both.
pub const KEY_RECORD: usize = 40;

const KEY_MAGIC: [u8; 4] = *b"CUKy";

/// The key in a record; `None`: these bytes are none.
pub fn read_key(record: &[u8; KEY_RECORD]) -> Option<Key> {
    let (covered, sum) = record.split_last_chunk::<4>()?;
    let (magic, key) = covered.split_first_chunk::<4>()?;
    let is_one = *magic == KEY_MAGIC && CRC.checksum(covered) == u32::from_le_bytes(*sum);
    key.first_chunk().copied().filter(|_| is_one)
}

/// The record of a key.
pub fn key_record(key: &Key) -> [u8; KEY_RECORD] {
    let mut record = [0; KEY_RECORD];
    let bytes = KEY_MAGIC.iter().chain(key);
    for (to, from) in record.iter_mut().zip(bytes) {
        *to = *from;
    }
    if let Some((covered, sum)) = record.split_last_chunk_mut::<4>() {
        *sum = CRC.checksum(covered).to_le_bytes();
    }
    record
}

/// A header that is whole, but perhaps forged.
#[derive(Clone, Copy, Debug)]
pub struct Header<'a> {
    bytes: &'a [u8],
    /// Kind and version of the image.
    pub stamp: Stamp,
    /// Bytes of the image.
    pub length: u32,
}

impl<'a> Header<'a> {
    /// Reads a header, and nothing behind it. `None`: these bytes are none.
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (magic, rest) = bytes.split_first_chunk::<4>()?;
        let (&[format, roles, 0, 0], rest) = rest.split_first_chunk::<4>()? else {
            return None;
        };
        let (board, rest) = rest.split_first_chunk::<4>()?;
        let (version, rest) = rest.split_first_chunk::<4>()?;
        let (length, _) = rest.split_first_chunk::<4>()?;
        let length = u32::from_le_bytes(*length);
        let header = Self {
            bytes,
            stamp: Stamp {
                board: u32::from_le_bytes(*board),
                roles,
                version: u32::from_le_bytes(*version),
            },
            length,
        };
        let is_whole = (1..=PAGES_MAX).contains(&header.pages())
            && bytes.len() == FIXED + 4 * header.pages() + SIGNATURE;
        (*magic == MAGIC && format == FORMAT && is_whole).then_some(header)
    }

    /// Name of the package.
    pub fn package(&self) -> u32 {
        CRC.checksum(self.bytes)
    }

    /// Its own bytes.
    pub(crate) const fn length_of_header(&self) -> usize {
        self.bytes.len()
    }

    /// Pages of the image.
    pub fn pages(&self) -> usize {
        (self.length as usize).div_ceil(PAGE)
    }

    /// Blocks of the image.
    pub fn blocks(&self) -> usize {
        (self.length as usize).div_ceil(BLOCK)
    }

    /// Checksum of a page of the image.
    pub(crate) fn checksum(&self, page: usize) -> Option<u32> {
        let at = FIXED + 4 * page;
        let is_one = page < self.pages();
        let bytes = self.bytes.get(at..).filter(|_| is_one)?;
        bytes.first_chunk().map(|sum| u32::from_le_bytes(*sum))
    }

    /// Returns true if this is the hash of the image.
    pub(crate) fn is_hash(&self, hash: Sha512) -> bool {
        let hash = hash.finalize();
        self.bytes.get(20..FIXED) == hash.get(..32)
    }

    /// Returns true if the owner of the key signed it.
    // Once in an image, and its stack is away from its callers'.
    #[inline(never)]
    pub fn is_signed(&self, key: &Key) -> bool {
        let Some((signed, signature)) = self.bytes.split_last_chunk::<SIGNATURE>() else {
            return false;
        };
        PublicKey::try_from(key)
            .is_ok_and(|key| key.verify(signed, &Signature::from(signature)).is_ok())
    }
}

#[cfg(any(test, feature = "alloc"))]
mod made {
    use alloc::{format, string::String, vec::Vec};

    use salty::Keypair;

    use super::*;

    /// A package: a signed header and its image.
    #[derive(Clone)]
    pub struct Package {
        header: Vec<u8>,
        image: Vec<u8>,
    }

    impl core::fmt::Debug for Package {
        fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
            let stamp = self.stamp();
            f.debug_struct("Package")
                .field("stamp", &stamp)
                .finish_non_exhaustive()
        }
    }

    /// The public key of a secret one, its seed.
    pub fn public_key(secret: &[u8; 32]) -> Key {
        Keypair::from(secret).public.to_bytes()
    }

    impl Package {
        /// Signs an image with a secret key, its seed.
        ///
        /// # Errors
        /// The image has no stamp, is too long, or is not as long as its stamp tells.
        pub fn sign(image: &[u8], secret: &[u8; 32]) -> Result<Self, String> {
            let (_, stamp) = Stamp::find(image).ok_or(
                "the image does not say its board and version: make one by `cargo xtask firmware --update`",
            )?;
            if let Some(length) = Stamp::length_of(image)
                && length != image.len()
            {
                return Err(format!(
                    "the image has {} bytes, and its stamp tells {length}: the file was cut off or changed, make it anew",
                    image.len()
                ));
            }
            if image.len() > PAGES_MAX * PAGE {
                return Err(format!(
                    "the image has {} bytes, and nodes take {}",
                    image.len(),
                    PAGES_MAX * PAGE
                ));
            }
            let mut header = Vec::from(MAGIC);
            header.extend([FORMAT, stamp.roles, 0, 0]);
            for number in [stamp.board, stamp.version, image.len() as u32] {
                header.extend(number.to_le_bytes());
            }
            header.extend(Sha512::new().updated(image).finalize().iter().take(32));
            for page in image.chunks(PAGE) {
                let mut page = page.to_vec();
                page.resize(PAGE, 0xFF);
                header.extend(CRC.checksum(&page).to_le_bytes());
            }
            let signature = Keypair::from(secret).sign(&header).to_bytes();
            header.extend(signature);
            Ok(Self {
                header,
                image: image.to_vec(),
            })
        }

        /// Its header's bytes.
        pub fn header(&self) -> &[u8] {
            &self.header
        }

        /// Its image.
        pub fn image(&self) -> &[u8] {
            &self.image
        }

        /// Its name.
        pub fn name(&self) -> u32 {
            CRC.checksum(&self.header)
        }

        /// Kind and version of its image.
        pub fn stamp(&self) -> Option<Stamp> {
            Some(Header::parse(&self.header)?.stamp)
        }

        /// Number of blocks of its header.
        pub fn header_blocks(&self) -> usize {
            self.header.len().div_ceil(BLOCK)
        }

        /// Number of blocks, those of its header included.
        pub fn blocks(&self) -> usize {
            self.header_blocks() + self.image.len().div_ceil(BLOCK)
        }

        /// A block of it: of its header, and then of its image.
        pub fn block(&self, number: usize) -> [u8; BLOCK] {
            let (bytes, number) = match number.checked_sub(self.header_blocks()) {
                None => (&self.header, number),
                Some(number) => (&self.image, number),
            };
            let mut block = [0xFF; BLOCK];
            let bytes = bytes.chunks(BLOCK).nth(number).unwrap_or_default();
            for (to, from) in block.iter_mut().zip(bytes) {
                *to = *from;
            }
            block
        }
    }
}
#[cfg(any(test, feature = "alloc"))]
pub use made::{Package, public_key};

#[cfg(test)]
mod tests {
    use std::{vec, vec::Vec};

    use super::*;
    use crate::stamp::board_number;

    pub(crate) fn image(length: usize, version: u32) -> Vec<u8> {
        let mut image: Vec<u8> = (0..length as u32)
            .map(|at| (at.wrapping_mul(2_654_435_761) >> 24) as u8)
            .collect();
        let stamp = Stamp {
            board: board_number("nrf52840"),
            roles: 7,
            version,
        };
        image[100..][..crate::stamp::STAMP].copy_from_slice(&stamp.bytes());
        image
    }

    #[test]
    fn a_header_is_signed_and_whole() {
        let secret = [7; 32];
        let package = Package::sign(&image(10_000, 3), &secret).unwrap();
        let header = Header::parse(package.header()).unwrap();
        assert_eq!(
            (header.pages(), header.blocks(), header.length),
            (3, 157, 10_000)
        );
        assert_eq!(header.stamp.version, 3);
        assert!(header.is_signed(&public_key(&secret)));
        assert!(!header.is_signed(&public_key(&[8; 32])));
        assert!(header.is_hash(Sha512::new().updated(package.image())));
        for at in 0..package.header().len() {
            let mut bytes = package.header().to_vec();
            bytes[at] ^= 0x10;
            let forged = Header::parse(&bytes);
            assert!(
                forged.is_none_or(|header| !header.is_signed(&public_key(&secret))),
                "byte {at}"
            );
        }
        for length in 0..package.header().len() {
            assert!(Header::parse(&package.header()[..length]).is_none());
        }
    }

    /// Test vector 3 of RFC 8032, 7.1.
    #[test]
    fn the_signature_is_that_of_the_standard() {
        let bytes = |text: &str| -> Vec<u8> {
            let digits = text.as_bytes().chunks(2);
            digits
                .map(|two| u8::from_str_radix(core::str::from_utf8(two).unwrap(), 16).unwrap())
                .collect()
        };
        let seed = bytes("c5aa8df43f9f837bedb7442f31dcb7b166d38535076f094b85ce3a2e0b4458f7");
        let key = bytes("fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025");
        let signature = bytes(
            "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac18ff9b538d16f290ae67f760984dc6594a7c15e9716ed28dc027beceea1ec40a",
        );
        let seed: [u8; 32] = seed.try_into().unwrap();
        assert_eq!(public_key(&seed).to_vec(), key);
        let key = PublicKey::try_from(&public_key(&seed)).unwrap();
        let signature: [u8; 64] = signature.try_into().unwrap();
        assert!(
            key.verify(&[0xaf, 0x82], &Signature::from(&signature))
                .is_ok()
        );
    }

    #[test]
    fn a_key_has_a_record() {
        let record = key_record(&[9; 32]);
        assert_eq!(read_key(&record), Some([9; 32]));
        for at in 0..KEY_RECORD {
            let mut spoilt = record;
            spoilt[at] ^= 4;
            assert_eq!(read_key(&spoilt), None);
        }
        assert_eq!(read_key(&[0xFF; KEY_RECORD]), None);
    }

    #[test]
    fn what_is_no_image_is_refused() {
        assert!(Package::sign(&vec![0; 5000], &[1; 32]).is_err());
        assert!(Package::sign(&image(PAGES_MAX * PAGE + 1, 3), &[1; 32]).is_err());
        // Cut off.
        let mut whole = image(9000, 3);
        assert!(Stamp::set_version(&mut whole, 4, 9000));
        assert!(Package::sign(&whole, &[1; 32]).is_ok());
        assert!(Package::sign(&whole[..8999], &[1; 32]).is_err());
    }
}
