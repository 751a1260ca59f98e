//! The auxiliary security header (IEEE 802.15.4-2006, 7.6.2), with key identifier mode 1.

use super::{EmitError, Malformed, Reader, Writer};

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

/// The auxiliary security header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AuxHeader {
    /// The security level.
    pub level: Level,
    /// The sender's frame counter.
    pub counter: u32,
    /// The index of the key, of those that the network has: key identifier mode 1.
    pub key_index: u8,
}

/// Bits 3 and 4 of the security control.
const KEY_MODES: u8 = 3 << 3;
const KEY_MODE_INDEX: u8 = 1 << 3;
/// Bits 5 to 7: of these, the 2015 edition makes the suppression of the counter and other nonces.
const RESERVED: u8 = 7 << 5;

impl AuxHeader {
    pub(super) fn parse(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        let control = reader.u8()?;
        if control & RESERVED != 0 {
            return Err(Malformed::Reserved);
        }
        if control & KEY_MODES != KEY_MODE_INDEX {
            return Err(Malformed::Unsupported);
        }
        Ok(Self {
            level: Level::from_bits(control),
            counter: reader.u32()?,
            key_index: reader.u8()?,
        })
    }

    pub(super) fn emit(&self, writer: &mut Writer<'_>) -> Result<(), EmitError> {
        writer.u8(self.level as u8 | KEY_MODE_INDEX)?;
        writer.u32(self.counter)?;
        writer.u8(self.key_index)
    }
}
