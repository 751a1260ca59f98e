//! The site key.

use core::fmt;

use serde::{Deserialize, Serialize, Serializer, ser::Error};
use zigbee_link::security::Key;

/// A site key as it is provisioned. It is neither printed nor written as text.
#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct SiteKey {
    index: u8,
    bytes: [u8; 16],
}

impl SiteKey {
    /// 128 random bits with an index, 1 to 255. [`Config::check`](super::Config::check) refuses bits that are
    /// no [`Key`].
    pub const fn new(index: u8, bytes: [u8; 16]) -> Self {
        Self { index, bytes }
    }

    /// The index.
    pub const fn index(&self) -> u8 {
        self.index
    }

    /// Index and bytes.
    pub(super) fn parts(&self) -> (u8, &[u8; 16]) {
        (self.index, &self.bytes)
    }

    /// The key as the network takes it. `None` for index 0, and for bytes that were not drawn at random.
    pub fn key(&self) -> Option<Key> {
        Key::new(self.index, self.bytes)
    }
}

impl Serialize for SiteKey {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() {
            return Err(S::Error::custom("the site key is not written as text"));
        }
        (self.index, self.bytes).serialize(serializer)
    }
}

impl fmt::Debug for SiteKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SiteKey {}", self.index)
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for SiteKey {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "SiteKey {}", self.index);
    }
}

#[cfg(test)]
mod tests {
    use std::{format, string::ToString};

    use super::*;

    #[test]
    fn nobody_reads_it() {
        let key = SiteKey::new(7, *b"sixteen secrets!");
        assert_eq!(format!("{key:?} {:?}", key.key()), "SiteKey 7 Some(Key 7)");
        let text = serde_json::to_string(&key).unwrap_err().to_string();
        assert_eq!(text, "the site key is not written as text");
    }
}
