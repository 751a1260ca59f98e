//! The frame control field.

use super::Malformed;

/// Type of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameType {
    /// Announces a PAN.
    Beacon,
    /// Carries a payload.
    Data,
    /// Carries a [`MacCommand`](super::MacCommand).
    Command,
}

/// The frame version. Both have the same header; only version 1 can be secured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameVersion {
    /// 0, IEEE 802.15.4-2003: the beacons of Zigbee networks, which a scan has to know.
    V2003,
    /// 1, IEEE 802.15.4-2006 and 2011: every frame of this crate.
    V2006,
}

/// Length of an address, as two bits.
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
    pub destination: AddressMode,
    pub version: FrameVersion,
    pub source: AddressMode,
}

const SECURITY: u16 = 1 << 3;
const FRAME_PENDING: u16 = 1 << 4;
const ACK_REQUEST: u16 = 1 << 5;
const PAN_COMPRESSION: u16 = 1 << 6;
/// Bits 7 to 9: of these, version 2 makes the suppression of the sequence number and information
/// elements.
const RESERVED: u16 = 7 << 7;

/// Returns true if the frame says that it is secured.
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
            3 => FrameType::Command,
            _ => return Err(Malformed::Unsupported),
        };
        let version = match (bits >> 12) & 3 {
            0 => FrameVersion::V2003,
            1 => FrameVersion::V2006,
            _ => return Err(Malformed::Unsupported),
        };
        if bits & RESERVED != 0 {
            return Err(Malformed::Reserved);
        }
        let is_set = |bit| bits & bit != 0;
        Ok(Self {
            frame_type,
            security: is_set(SECURITY),
            frame_pending: is_set(FRAME_PENDING),
            ack_request: is_set(ACK_REQUEST),
            pan_compression: is_set(PAN_COMPRESSION),
            destination: AddressMode::from_bits(bits >> 10)?,
            version,
            source: AddressMode::from_bits(bits >> 14)?,
        })
    }

    pub(super) fn bits(self) -> u16 {
        let frame_type = match self.frame_type {
            FrameType::Beacon => 0,
            FrameType::Data => 1,
            FrameType::Command => 3,
        };
        let version = match self.version {
            FrameVersion::V2003 => 0,
            FrameVersion::V2006 => 1,
        };
        let bit = |is_set, bit| if is_set { bit } else { 0 };
        frame_type
            | bit(self.security, SECURITY)
            | bit(self.frame_pending, FRAME_PENDING)
            | bit(self.ack_request, ACK_REQUEST)
            | bit(self.pan_compression, PAN_COMPRESSION)
            | self.destination.bits() << 10
            | version << 12
            | self.source.bits() << 14
    }

    /// Presence of the destination and of the source PAN identifier (IEEE 802.15.4-2006, 7.2.1.1.5).
    pub(super) fn pans(self) -> Result<(bool, bool), Malformed> {
        let destination = self.destination != AddressMode::None;
        let source = self.source != AddressMode::None;
        if self.pan_compression && !(destination && source) {
            return Err(Malformed::PanCompression);
        }
        Ok((destination, source && !self.pan_compression))
    }

    /// Security came with version 1; that of version 0 is withdrawn.
    pub(super) fn check(self) -> Result<(), Malformed> {
        if self.security && self.version == FrameVersion::V2003 {
            return Err(Malformed::ObsoleteSecurity);
        }
        Ok(())
    }
}
