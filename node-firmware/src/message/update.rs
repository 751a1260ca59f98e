//! Parts of an update by radio. Their contents are the matter of the crate `radio-update`.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

#[cfg(feature = "update")]
use radio_update::packet::PACKET_MAX;

/// One packet of an update. Without the feature `update` there is none: such a message does not decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct UpdatePacket(Contents);

#[cfg(feature = "update")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Contents {
    length: u8,
    bytes: [u8; PACKET_MAX],
}

#[cfg(feature = "update")]
impl Contents {
    fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length.into()).unwrap_or_default()
    }
}

#[cfg(not(feature = "update"))]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
enum Contents {}

#[cfg(not(feature = "update"))]
impl Contents {
    const fn bytes(&self) -> &[u8] {
        match *self {}
    }
}

impl UpdatePacket {
    /// A packet of these bytes; `None`: they are too many, or the feature `update` is off.
    #[cfg(feature = "update")]
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let mut contents = Contents {
            length: bytes.len() as u8,
            bytes: [0; PACKET_MAX],
        };
        contents
            .bytes
            .get_mut(..bytes.len())?
            .copy_from_slice(bytes);
        Some(Self(contents))
    }

    /// A packet of these bytes; `None`: they are too many, or the feature `update` is off.
    #[cfg(not(feature = "update"))]
    pub fn new(_: &[u8]) -> Option<Self> {
        None
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        self.0.bytes()
    }
}

impl Serialize for UpdatePacket {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(self.bytes())
    }
}

impl<'de> Deserialize<'de> for UpdatePacket {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Without the feature it costs nothing to refuse it.
        #[cfg(feature = "update")]
        let packet = <&[u8]>::deserialize(deserializer).map(Self::new)?;
        #[cfg(not(feature = "update"))]
        let packet = {
            let _ = deserializer;
            None
        };
        packet.ok_or_else(|| D::Error::custom("no packet of an update"))
    }
}
