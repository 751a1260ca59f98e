//! One frame, one key: CCM*.

use aes::Aes128;
use ccm::{
    AeadInOut, Ccm, Tag,
    aead::inout::InOutBuf,
    consts::{U4, U8, U13},
};

use crate::wire::{Eui64, Level};

/// How frames are secured: always encrypted, always with an integrity code.
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
pub(super) struct Failed;

/// Encrypts `payload` and returns the integrity code, its first [`Level::mic_len`] bytes.
pub(super) fn seal(
    cipher: &Aes128,
    protection: Protection,
    nonce: &[u8; 13],
    associated: &[u8],
    payload: &mut [u8],
) -> Result<[u8; 8], Failed> {
    let nonce = nonce.into();
    let payload = InOutBuf::from(payload);
    Ok(match protection {
        Protection::EncMic32 => {
            let tag = Ccm::<&Aes128, U4, U13>::from(cipher)
                .encrypt_inout_detached(nonce, associated, payload)
                .map_err(|_| Failed)?;
            let [a, b, c, d] = tag.0;
            [a, b, c, d, 0, 0, 0, 0]
        }
        Protection::EncMic64 => {
            Ccm::<&Aes128, U8, U13>::from(cipher)
                .encrypt_inout_detached(nonce, associated, payload)
                .map_err(|_| Failed)?
                .0
        }
    })
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
    let nonce = nonce.into();
    let payload = InOutBuf::from(payload);
    match protection {
        Protection::EncMic32 => {
            let tag = Tag::try_from(mic).map_err(|_| Failed)?;
            Ccm::<&Aes128, U4, U13>::from(cipher)
                .decrypt_inout_detached(nonce, associated, payload, &tag)
        }
        Protection::EncMic64 => {
            let tag = Tag::try_from(mic).map_err(|_| Failed)?;
            Ccm::<&Aes128, U8, U13>::from(cipher)
                .decrypt_inout_detached(nonce, associated, payload, &tag)
        }
    }
    .map_err(|_| Failed)
}

#[cfg(test)]
mod tests {
    use aes::cipher::KeyInit;

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
        let mic = seal(
            &annex_c(),
            Protection::EncMic64,
            &nonce,
            &COMMAND_HEADER,
            &mut payload,
        );
        assert_eq!(payload, [0xD8]);
        let mic = mic.ok().unwrap();
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
            let mic = seal(&annex_c(), protection, &nonce, b"header", &mut sealed);
            let mic = mic.ok().unwrap();
            for bit in 0..8 * len {
                let mut wrong = mic;
                wrong[bit / 8] ^= 1 << (bit % 8);
                let mut payload = sealed;
                let opened = open(
                    &annex_c(),
                    protection,
                    &nonce,
                    b"header",
                    &mut payload,
                    &wrong[..len],
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
}
