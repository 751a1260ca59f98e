//! The frame control field.

use super::Malformed;

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameType {
    /// Announces a PAN.
    Beacon,
    /// Carries a payload.
    Data,
    /// Acknowledges a frame: immediate (versions 0 and 1) or enhanced (version 2).
    Acknowledgement,
    /// Carries a [`Command`](super::Command).
    Command,
}

/// The frame version, which is the format of the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Version {
    /// IEEE 802.15.4-2003.
    V2003,
    /// IEEE 802.15.4-2006 and 2011.
    V2006,
    /// IEEE 802.15.4-2015 and later.
    V2015,
}

/// How long an address is, as two bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AddressMode {
    None,
    Short,
    Extended,
}

/// The bits of the frame control field.
#[derive(Clone, Copy)]
pub(super) struct Control {
    pub frame_type: FrameType,
    pub security: bool,
    pub frame_pending: bool,
    pub ack_request: bool,
    pub pan_compression: bool,
    pub sequence_suppressed: bool,
    pub elements: bool,
    pub destination: AddressMode,
    pub version: Version,
    pub source: AddressMode,
}

const SECURITY: u16 = 1 << 3;
const FRAME_PENDING: u16 = 1 << 4;
const ACK_REQUEST: u16 = 1 << 5;
const PAN_COMPRESSION: u16 = 1 << 6;
const RESERVED: u16 = 1 << 7;
const SEQUENCE_SUPPRESSED: u16 = 1 << 8;
const ELEMENTS: u16 = 1 << 9;

/// Whether the frame says that it is secured.
pub(crate) const fn is_secured(frame: &[u8]) -> bool {
    matches!(frame, [first, ..] if *first as u16 & SECURITY != 0)
}

impl AddressMode {
    const fn from_bits(bits: u16) -> Result<Self, Malformed> {
        match bits & 3 {
            0 => Ok(Self::None),
            2 => Ok(Self::Short),
            3 => Ok(Self::Extended),
            _ => Err(Malformed::Reserved),
        }
    }

    const fn bits(self) -> u16 {
        match self {
            Self::None => 0,
            Self::Short => 2,
            Self::Extended => 3,
        }
    }
}

impl Control {
    pub(super) fn parse(bits: u16) -> Result<Self, Malformed> {
        let frame_type = match bits & 7 {
            0 => FrameType::Beacon,
            1 => FrameType::Data,
            2 => FrameType::Acknowledgement,
            3 => FrameType::Command,
            _ => return Err(Malformed::Unsupported),
        };
        let version = match (bits >> 12) & 3 {
            0 => Version::V2003,
            1 => Version::V2006,
            2 => Version::V2015,
            _ => return Err(Malformed::Unsupported),
        };
        let reserved = match version {
            Version::V2015 => RESERVED,
            Version::V2003 | Version::V2006 => RESERVED | SEQUENCE_SUPPRESSED | ELEMENTS,
        };
        if bits & reserved != 0 {
            return Err(Malformed::Reserved);
        }
        let is_set = |bit| bits & bit != 0;
        Ok(Self {
            frame_type,
            security: is_set(SECURITY),
            frame_pending: is_set(FRAME_PENDING),
            ack_request: is_set(ACK_REQUEST),
            pan_compression: is_set(PAN_COMPRESSION),
            sequence_suppressed: is_set(SEQUENCE_SUPPRESSED),
            elements: is_set(ELEMENTS),
            destination: AddressMode::from_bits(bits >> 10)?,
            version,
            source: AddressMode::from_bits(bits >> 14)?,
        })
    }

    pub(super) fn bits(self) -> u16 {
        let frame_type = match self.frame_type {
            FrameType::Beacon => 0,
            FrameType::Data => 1,
            FrameType::Acknowledgement => 2,
            FrameType::Command => 3,
        };
        let version = match self.version {
            Version::V2003 => 0,
            Version::V2006 => 1,
            Version::V2015 => 2,
        };
        let bit = |is_set, bit| if is_set { bit } else { 0 };
        frame_type
            | bit(self.security, SECURITY)
            | bit(self.frame_pending, FRAME_PENDING)
            | bit(self.ack_request, ACK_REQUEST)
            | bit(self.pan_compression, PAN_COMPRESSION)
            | bit(self.sequence_suppressed, SEQUENCE_SUPPRESSED)
            | bit(self.elements, ELEMENTS)
            | self.destination.bits() << 10
            | version << 12
            | self.source.bits() << 14
    }

    /// Whether the destination and the source PAN identifier are present.
    ///
    /// IEEE 802.15.4-2006, 7.2.1.1.5, and 802.15.4-2015, table 7-2.
    pub(super) fn pans(self) -> Result<(bool, bool), Malformed> {
        use AddressMode::{Extended, None};
        let compressed = self.pan_compression;
        match (self.version, self.destination, self.source) {
            (Version::V2003 | Version::V2006, destination, source) => {
                let both = destination != None && source != None;
                if compressed && !both {
                    return Err(Malformed::PanCompression);
                }
                Ok((destination != None, source != None && !compressed))
            }
            (Version::V2015, None, None) => Ok((compressed, false)),
            (Version::V2015, _, None) | (Version::V2015, Extended, Extended) => {
                Ok((!compressed, false))
            }
            (Version::V2015, None, _) => Ok((false, !compressed)),
            (Version::V2015, _, _) => Ok((true, !compressed)),
        }
    }
}
