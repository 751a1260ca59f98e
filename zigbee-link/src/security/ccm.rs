//! One frame, one key: CCM* (IEEE 802.15.4-2006, annex B), for nonces of 13 bytes.
//!
//! Written out here over the AES of a library, because both lengths of the integrity code then
//! share their code. Besides the examples of the standard, the tests compare it with another
//! implementation.

use core::hint::black_box;

use aes::{Aes128, Block, cipher::BlockCipherEncrypt};

use crate::wire::{Eui64, Level};

/// Protection of frames: always encrypted, always with an integrity code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Protection {
    /// Level 5: an integrity code of 4 bytes. A forger succeeds once in 2^32 frames, which at the
    /// full rate of the medium takes months, not ages.
    EncMic32,
    /// Level 6: an integrity code of 8 bytes.
    #[default]
    EncMic64,
}

impl Protection {
    /// The level in the frame.
    pub const fn level(self) -> Level {
        match self {
            Self::EncMic32 => Level::EncMic32,
            Self::EncMic64 => Level::EncMic64,
        }
    }
}

/// The 13 bytes of a nonce: EUI-64, frame counter, level (7.6.3.2).
pub(super) fn nonce(sender: Eui64, counter: u32, level: Level) -> [u8; 13] {
    let mut nonce = [0; 13];
    let [a, b, c, d] = counter.to_be_bytes();
    for (place, byte) in nonce
        .iter_mut()
        .zip(sender.0.into_iter().chain([a, b, c, d, level as u8]))
    {
        *place = byte;
    }
    nonce
}

/// The frame is longer than CCM* allows, or its integrity code is wrong.
#[derive(Debug)]
pub(super) struct Failed;

/// Bytes of a block of AES.
const BLOCK: usize = 16;

/// The CBC-MAC and the key stream of one frame.
struct Blocks<'c> {
    cipher: &'c Aes128,
    nonce: &'c [u8; 13],
    mac: [u8; BLOCK],
}

impl Blocks<'_> {
    fn encrypt(&self, bytes: [u8; BLOCK]) -> [u8; BLOCK] {
        let mut block = Block::from(bytes);
        self.cipher.encrypt_block(&mut block);
        block.into()
    }

    /// Flags, nonce and a number: the form of the first block and of the counters (B.4.1).
    fn formatted(&self, flags: u8, number: u16) -> [u8; BLOCK] {
        let mut block = [flags; BLOCK];
        let [high, low] = number.to_be_bytes();
        let content = self.nonce.iter().copied().chain([high, low]);
        for (place, byte) in block.iter_mut().skip(1).zip(content) {
            *place = byte;
        }
        block
    }

    /// Block `counter` of the key stream. Its flags are those of a length field of two bytes.
    fn key_stream(&self, counter: u16) -> [u8; BLOCK] {
        self.encrypt(self.formatted(1, counter))
    }

    /// Takes in up to a block, padded with zeros.
    fn authenticate(&mut self, bytes: &[u8]) {
        xor(&mut self.mac, bytes);
        self.mac = self.encrypt(self.mac);
    }
}

fn xor(bytes: &mut [u8], with: &[u8]) {
    for (byte, with) in bytes.iter_mut().zip(with) {
        *byte ^= with;
    }
}

/// Direction: the payload is in clear before (sealing) or after (opening).
#[derive(Clone, Copy, PartialEq, Eq)]
enum Direction {
    Seal,
    Open,
}

/// Encrypts or decrypts the payload, and returns its integrity code.
fn crypt(
    cipher: &Aes128,
    protection: Protection,
    nonce: &[u8; 13],
    associated: &[u8],
    payload: &mut [u8],
    direction: Direction,
) -> Result<[u8; BLOCK], Failed> {
    let associated_len = u8::try_from(associated.len()).map_err(|_| Failed)?;
    let payload_len = u8::try_from(payload.len()).map_err(|_| Failed)?;
    let mut blocks = Blocks {
        cipher,
        nonce,
        mac: [0; BLOCK],
    };
    // B.4.1.1: flag of associated data; bytes of the code; a length field of two.
    let has_associated = if associated.is_empty() { 0 } else { 0x40 };
    let mic_len = match protection {
        Protection::EncMic32 => 1 << 3,
        Protection::EncMic64 => 3 << 3,
    };
    let flags = has_associated | mic_len | 1;
    let first = blocks.formatted(flags, payload_len.into());
    blocks.authenticate(&first);
    if !associated.is_empty() {
        // Its length, two bytes, goes before it.
        let (head, tail) = associated
            .split_at_checked(BLOCK - 2)
            .unwrap_or((associated, &[]));
        let [_, len, rest @ ..] = &mut blocks.mac;
        *len ^= associated_len;
        xor(rest, head);
        blocks.authenticate(&[]);
        for block in tail.chunks(BLOCK) {
            blocks.authenticate(block);
        }
    }
    for (counter, block) in (1..).zip(payload.chunks_mut(BLOCK)) {
        let stream = blocks.key_stream(counter);
        if direction == Direction::Seal {
            blocks.authenticate(block);
        }
        xor(block, &stream);
        if direction == Direction::Open {
            blocks.authenticate(block);
        }
    }
    let mut mac = blocks.key_stream(0);
    xor(&mut mac, &blocks.mac);
    Ok(mac)
}

/// Encrypts `payload` and writes the integrity code to `mic`.
pub(super) fn seal(
    cipher: &Aes128,
    protection: Protection,
    nonce: &[u8; 13],
    associated: &[u8],
    payload: &mut [u8],
    mic: &mut [u8],
) -> Result<(), Failed> {
    let code = crypt(
        cipher,
        protection,
        nonce,
        associated,
        payload,
        Direction::Seal,
    )?;
    for (place, byte) in mic.iter_mut().zip(code) {
        *place = byte;
    }
    Ok(())
}

/// Checks the integrity code and decrypts `payload`, which is zeroed when the code is wrong.
pub(super) fn open(
    cipher: &Aes128,
    protection: Protection,
    nonce: &[u8; 13],
    associated: &[u8],
    payload: &mut [u8],
    mic: &[u8],
) -> Result<(), Failed> {
    let code = crypt(
        cipher,
        protection,
        nonce,
        associated,
        payload,
        Direction::Open,
    )?;
    // All bytes are compared: how many are right is not to be seen in the time it takes.
    let differ = |all, (byte, code)| all | (byte ^ code);
    let difference = black_box(mic.iter().zip(code).fold(0, differ));
    if difference == 0 && mic.len() == protection.level().mic_len() {
        Ok(())
    } else {
        payload.fill(0);
        Err(Failed)
    }
}

#[cfg(test)]
mod tests {
    use std::vec;

    use aes::cipher::KeyInit;
    use ccm::{
        AeadInOut, Ccm,
        consts::{U4, U8, U13},
    };
    use proptest::{array::uniform13, array::uniform16, collection, prelude::*};

    use super::*;

    const DEVICE: Eui64 = Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0, 1]);

    /// The key of all examples of IEEE 802.15.4-2006, annex C.
    fn annex_c() -> Aes128 {
        let key: [u8; 16] = core::array::from_fn(|i| 0xC0 + i as u8);
        Aes128::new(&key.into())
    }

    /// C.2.3: the MAC command frame, level 6.
    const COMMAND_HEADER: [u8; 29] = [
        0x2B, 0xDC, 0x84, 0x21, 0x43, 0x02, 0, 0, 0, 0, 0x48, 0xDE, 0xAC, 0xFF, 0xFF, 0x01, 0, 0,
        0, 0, 0x48, 0xDE, 0xAC, 0x06, 0x05, 0, 0, 0, 0x01,
    ];

    #[test]
    fn nonce_of_annex_c() {
        assert_eq!(
            nonce(DEVICE, 5, Level::EncMic64),
            [0xAC, 0xDE, 0x48, 0, 0, 0, 0, 1, 0, 0, 0, 5, 6]
        );
    }

    #[test]
    fn command_of_annex_c() {
        let nonce = nonce(DEVICE, 5, Level::EncMic64);
        let mut payload = [0xCE];
        let mut mic = [0; 8];
        seal(
            &annex_c(),
            Protection::EncMic64,
            &nonce,
            &COMMAND_HEADER,
            &mut payload,
            &mut mic,
        )
        .unwrap();
        assert_eq!(payload, [0xD8]);
        assert_eq!(mic, [0x4F, 0xDE, 0x52, 0x90, 0x61, 0xF9, 0xC6, 0xF1]);
        let opened = open(
            &annex_c(),
            Protection::EncMic64,
            &nonce,
            &COMMAND_HEADER,
            &mut payload,
            &mic,
        );
        assert!(opened.is_ok());
        assert_eq!(payload, [0xCE]);
    }

    #[test]
    fn a_wrong_code_opens_nothing() {
        for protection in [Protection::EncMic32, Protection::EncMic64] {
            let nonce = nonce(DEVICE, 5, protection.level());
            let len = protection.level().mic_len();
            let mut sealed = *b"payload";
            let mut mic = [0; 8];
            let mic = &mut mic[..len];
            seal(&annex_c(), protection, &nonce, b"header", &mut sealed, mic).unwrap();
            for bit in 0..8 * len {
                let mut wrong = mic.to_vec();
                wrong[bit / 8] ^= 1 << (bit % 8);
                let mut payload = sealed;
                let opened = open(
                    &annex_c(),
                    protection,
                    &nonce,
                    b"header",
                    &mut payload,
                    &wrong,
                );
                assert!(opened.is_err());
                assert_eq!(payload, [0; 7]);
            }
            for short in 0..len {
                let opened = open(
                    &annex_c(),
                    protection,
                    &nonce,
                    b"header",
                    &mut sealed,
                    &mic[..short],
                );
                assert!(opened.is_err());
            }
        }
    }

    proptest! {
        /// The `ccm` crate, which has a type for each length of the code.
        #[test]
        fn as_another_implementation(
            key in uniform16(any::<u8>()),
            nonce in uniform13(any::<u8>()),
            associated in collection::vec(any::<u8>(), 0..128),
            payload in collection::vec(any::<u8>(), 0..128),
        ) {
            let cipher = Aes128::new(&key.into());
            for protection in [Protection::EncMic32, Protection::EncMic64] {
                let mut ours = payload.clone();
                let mut mic = vec![0; protection.level().mic_len()];
                seal(&cipher, protection, &nonce, &associated, &mut ours, &mut mic).unwrap();
                let mut theirs = payload.clone();
                let inout = theirs.as_mut_slice().into();
                let expected = match protection {
                    Protection::EncMic32 => Ccm::<_, U4, U13>::from(cipher.clone())
                        .encrypt_inout_detached(&nonce.into(), &associated, inout)
                        .unwrap()
                        .to_vec(),
                    Protection::EncMic64 => Ccm::<_, U8, U13>::from(cipher.clone())
                        .encrypt_inout_detached(&nonce.into(), &associated, inout)
                        .unwrap()
                        .to_vec(),
                };
                prop_assert_eq!((&ours, &mic), (&theirs, &expected));
                open(&cipher, protection, &nonce, &associated, &mut ours, &mic).unwrap();
                prop_assert_eq!(&ours, &payload);
            }
        }
    }
}
