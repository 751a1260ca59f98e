//! The auxiliary security header (IEEE 802.15.4-2006, 7.6.2; 2015, 9.4).

use super::{EmitError, Malformed, Reader, Version, Writer};

/// The security level of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Level {
    /// 0: nothing.
    None = 0,
    /// 1: an integrity code of 4 bytes.
    Mic32 = 1,
    /// 2: an integrity code of 8 bytes.
    Mic64 = 2,
    /// 3: an integrity code of 16 bytes.
    Mic128 = 3,
    /// 4: encrypted, but not protected: anybody may flip bits of it.
    Enc = 4,
    /// 5: encrypted, with an integrity code of 4 bytes.
    EncMic32 = 5,
    /// 6: encrypted, with an integrity code of 8 bytes.
    EncMic64 = 6,
    /// 7: encrypted, with an integrity code of 16 bytes.
    EncMic128 = 7,
}

impl Level {
    const fn from_bits(bits: u8) -> Self {
        match bits & 7 {
            0 => Self::None,
            1 => Self::Mic32,
            2 => Self::Mic64,
            3 => Self::Mic128,
            4 => Self::Enc,
            5 => Self::EncMic32,
            6 => Self::EncMic64,
            _ => Self::EncMic128,
        }
    }

    /// Bytes of the message integrity code.
    pub const fn mic_len(self) -> usize {
        match self {
            Self::None | Self::Enc => 0,
            Self::Mic32 | Self::EncMic32 => 4,
            Self::Mic64 | Self::EncMic64 => 8,
            Self::Mic128 | Self::EncMic128 => 16,
        }
    }
}

/// Which key a frame is secured with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KeyId {
    /// Mode 0: told by who talks to whom.
    Implicit,
    /// Mode 1: the key with this index of the default source.
    Index(u8),
    /// Mode 2: the key with this index of a source of 4 bytes, as on the air.
    Source4([u8; 4], u8),
    /// Mode 3: the key with this index of a source of 8 bytes, as on the air.
    Source8([u8; 8], u8),
}

/// The auxiliary security header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AuxHeader {
    /// The security level.
    pub level: Level,
    /// The key.
    pub key: KeyId,
    /// The frame counter. Absent only in version 2, where it may be suppressed.
    pub counter: Option<u32>,
    /// The nonce has the slot number of a time-slotted network. Version 2 only.
    pub asn_in_nonce: bool,
}

const COUNTER_SUPPRESSED: u8 = 1 << 5;
const ASN_IN_NONCE: u8 = 1 << 6;
const RESERVED: u8 = 1 << 7;

impl AuxHeader {
    pub(super) fn parse(reader: &mut Reader<'_>, version: Version) -> Result<Self, Malformed> {
        let control = reader.u8()?;
        let reserved = match version {
            Version::V2003 => return Err(Malformed::ObsoleteSecurity),
            Version::V2006 => RESERVED | ASN_IN_NONCE | COUNTER_SUPPRESSED,
            Version::V2015 => RESERVED,
        };
        if control & reserved != 0 {
            return Err(Malformed::Reserved);
        }
        let counter = if control & COUNTER_SUPPRESSED == 0 {
            Some(reader.u32()?)
        } else {
            None
        };
        let key = match (control >> 3) & 3 {
            0 => KeyId::Implicit,
            1 => KeyId::Index(reader.u8()?),
            2 => KeyId::Source4(reader.array()?, reader.u8()?),
            _ => KeyId::Source8(reader.array()?, reader.u8()?),
        };
        Ok(Self {
            level: Level::from_bits(control),
            key,
            counter,
            asn_in_nonce: control & ASN_IN_NONCE != 0,
        })
    }

    pub(super) fn emit(&self, writer: &mut Writer<'_>, version: Version) -> Result<(), EmitError> {
        let only_2015 = self.counter.is_none() || self.asn_in_nonce;
        if version == Version::V2003 || (only_2015 && version != Version::V2015) {
            return Err(EmitError::Impossible);
        }
        let mode = match self.key {
            KeyId::Implicit => 0,
            KeyId::Index(_) => 1,
            KeyId::Source4(..) => 2,
            KeyId::Source8(..) => 3,
        };
        let mut control = self.level as u8 | mode << 3;
        if self.counter.is_none() {
            control |= COUNTER_SUPPRESSED;
        }
        if self.asn_in_nonce {
            control |= ASN_IN_NONCE;
        }
        writer.u8(control)?;
        if let Some(counter) = self.counter {
            writer.u32(counter)?;
        }
        match self.key {
            KeyId::Implicit => Ok(()),
            KeyId::Index(index) => writer.u8(index),
            KeyId::Source4(source, index) => {
                writer.bytes(&source)?;
                writer.u8(index)
            }
            KeyId::Source8(source, index) => {
                writer.bytes(&source)?;
                writer.u8(index)
            }
        }
    }
}
