//! Keys and their change.

use core::{fmt, time::Duration};

use aes::{
    Aes128,
    cipher::{BlockCipherEncrypt, KeyInit},
};
use zeroize::Zeroize;

use crate::Instant;

/// A site key: 128 random bits with an index, 1 to 255, by which frames name it.
///
/// There is no default one. It is not printed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Key {
    index: u8,
    bytes: [u8; 16],
}

impl Key {
    /// A key. `None` for index 0, which the standard reserves, and for keys that were not drawn at random: all
    /// bytes the same, as erased or forgotten memory has them.
    pub fn new(index: u8, bytes: [u8; 16]) -> Option<Self> {
        let [first, rest @ ..] = bytes;
        if index == 0 || rest.iter().all(|&byte| byte == first) {
            return None;
        }
        Some(Self { index, bytes })
    }

    /// Its index, 1 to 255.
    pub const fn index(&self) -> u8 {
        self.index
    }

    /// Value that tells this key from others without giving it away: the first three bytes of zeros encrypted with
    /// it, the key check value of ISO 9797. No frame's cipher encrypts zeros.
    pub fn check_value(&self) -> [u8; 3] {
        let mut block = aes::Block::default();
        Ready::new(*self).cipher.encrypt_block(&mut block);
        let [a, b, c, ..] = <[u8; 16]>::from(block);
        [a, b, c]
    }

    /// The secret, for the store and for handing on the next key.
    pub(crate) const fn secret(&self) -> &[u8; 16] {
        &self.bytes
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Key {}", self.index)
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Key {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "Key {}", self.index);
    }
}

/// A key that is ready to use. It is overwritten when it is used no longer, and so is the cipher, by its
/// crate.
struct Ready {
    key: Key,
    cipher: Aes128,
}

impl Ready {
    fn new(key: Key) -> Self {
        Self {
            key,
            cipher: Aes128::new(&key.bytes.into()),
        }
    }
}

impl Drop for Ready {
    fn drop(&mut self) {
        self.key.bytes.zeroize();
    }
}

/// The key in use and, during a change, one more.
///
/// A change has two phases, so that no node speaks a key that its peers lack: the next key is
/// [installed](Self::install) everywhere and accepted, then [activated](Self::activate); from then
/// on the former is accepted for a bounded window.
pub struct Keyring {
    active: Ready,
    other: Option<Other>,
}

enum Other {
    /// Accepted, not yet used.
    Next(Ready),
    /// No longer used, accepted until then, and after that by a coordinator from members that missed the
    /// change.
    Former(Ready, Instant),
}

/// Reason why a key change was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RotationError {
    /// The key in use has this index already.
    SameIndex,
    /// There is no such next key.
    NotInstalled,
}

impl fmt::Display for RotationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SameIndex => "the key in use has this index: give the next one another",
            Self::NotInstalled => "install the next key first",
        })
    }
}

impl core::error::Error for RotationError {}

impl Keyring {
    /// With one key.
    pub fn new(active: Key) -> Self {
        Self {
            active: Ready::new(active),
            other: None,
        }
    }

    /// The key in use.
    pub const fn active(&self) -> Key {
        self.active.key
    }

    /// The key installed for later, if any.
    pub const fn next(&self) -> Option<Key> {
        match &self.other {
            Some(Other::Next(next)) => Some(next.key),
            _ => None,
        }
    }

    /// The key that was in use before, if it is still known.
    pub const fn former(&self) -> Option<Key> {
        match &self.other {
            Some(Other::Former(former, _)) => Some(former.key),
            _ => None,
        }
    }

    /// Knows a former key for those that missed its end, after a restart.
    pub(crate) fn recall(&mut self, former: Key) {
        if self.other.is_none() && former.index != self.active.key.index {
            self.other = Some(Other::Former(Ready::new(former), Instant(0)));
        }
    }

    /// Forgets a former key that is accepted no longer. Returns true if there was one.
    pub(crate) fn expire(&mut self, now: Instant) -> bool {
        let is_over = |other: &mut Other| matches!(other, Other::Former(_, until) if *until <= now);
        self.other.take_if(is_over).is_some()
    }

    /// The former key with this index, accepted or not.
    pub(super) fn former_cipher(&self) -> Option<(u8, &Aes128)> {
        match &self.other {
            Some(Other::Former(ready, _)) => Some((ready.key.index, &ready.cipher)),
            _ => None,
        }
    }

    /// Accepts frames under `next` from now on. It takes the place of a former key and of another
    /// next one.
    ///
    /// # Errors
    /// The key in use has the same index and is another.
    pub fn install(&mut self, next: Key) -> Result<(), RotationError> {
        if next == self.active.key {
            return Ok(());
        }
        if next.index == self.active.key.index {
            return Err(RotationError::SameIndex);
        }
        self.other = Some(Other::Next(Ready::new(next)));
        Ok(())
    }

    /// Uses the next key, and accepts the former one for `window` more.
    ///
    /// # Errors
    /// No next key with this index is installed.
    pub fn activate(
        &mut self,
        index: u8,
        now: Instant,
        window: Duration,
    ) -> Result<(), RotationError> {
        match self.other.take() {
            Some(Other::Next(next)) if next.key.index == index => {
                let former = core::mem::replace(&mut self.active, next);
                self.other = Some(Other::Former(former, now + window));
                Ok(())
            }
            other => {
                self.other = other;
                Err(RotationError::NotInstalled)
            }
        }
    }

    /// Index and cipher for a frame to send: of the next key if that is wanted and there is one.
    pub(super) const fn speaker(&self, wants_next: bool) -> (u8, &Aes128) {
        let ready = match &self.other {
            Some(Other::Next(next)) if wants_next => next,
            _ => &self.active,
        };
        (ready.key.index, &ready.cipher)
    }

    /// The cipher for a received frame, if its key is acceptable now.
    pub(super) fn cipher(&self, index: u8, now: Instant) -> Option<&Aes128> {
        if index == self.active.key.index {
            return Some(&self.active.cipher);
        }
        match &self.other {
            Some(Other::Next(ready)) if ready.key.index == index => Some(&ready.cipher),
            Some(Other::Former(ready, until)) if ready.key.index == index && now < *until => {
                Some(&ready.cipher)
            }
            _ => None,
        }
    }
}

impl fmt::Debug for Keyring {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Keyring")
            .field("active", &self.active.key)
            .finish_non_exhaustive()
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Keyring {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "active {}", self.active.key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// FIPS 197, appendix C.1, has the key; the value is that of OpenSSL:
    /// `openssl enc -aes-128-ecb -nopad -K 000102...0f`, of 16 zero bytes.
    #[test]
    fn a_key_is_known_by_its_check_value() {
        let key = Key::new(1, core::array::from_fn(|i| i as u8)).unwrap();
        assert_eq!(key.check_value(), [0xC6, 0xA1, 0x3B]);
        let other = Key::new(2, core::array::from_fn(|i| i as u8)).unwrap();
        assert_eq!(other.check_value(), key.check_value());
    }
}
