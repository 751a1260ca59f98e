//! Properties of a co-processor and their values.

use core::fmt;

use super::{
    frame::{read_packed, write_packed},
    status::SpinelStatus,
    stream::{RxFrame, TxFrame},
};
use zigbee_link::wire::{EmitError, Eui64, Malformed, PanId, Reader, ShortAddress, Writer};

/// The number by which commands name a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PropertyKey(pub u32);

impl PropertyKey {
    /// Result of the last command.
    pub const LAST_STATUS: Self = Self(0);
    /// Version of the protocol.
    pub const PROTOCOL_VERSION: Self = Self(1);
    /// Version of the firmware.
    pub const NCP_VERSION: Self = Self(2);
    /// Capabilities of the co-processor.
    pub const CAPS: Self = Self(5);
    /// Its extended address from the factory.
    pub const HWADDR: Self = Self(8);
    /// True if the radio is on.
    pub const PHY_ENABLED: Self = Self(0x20);
    /// The number of the channel, 11 to 26.
    pub const PHY_CHAN: Self = Self(0x21);
    /// Transmit power, dBm.
    pub const PHY_TX_POWER: Self = Self(0x25);
    /// The extended address frames are accepted for.
    pub const MAC_15_4_LADDR: Self = Self(0x34);
    /// The short address frames are accepted for.
    pub const MAC_15_4_SADDR: Self = Self(0x35);
    /// The PAN frames are accepted for.
    pub const MAC_15_4_PANID: Self = Self(0x36);
    /// True if raw frames are received and may be sent.
    pub const MAC_RAW_STREAM_ENABLED: Self = Self(0x37);
    /// True if frames for others are received, too.
    pub const MAC_PROMISCUOUS_MODE: Self = Self(0x38);
    /// Raw frames, both ways.
    pub const STREAM_RAW: Self = Self(0x71);
    /// True if acknowledgements announce pending frames only to listed devices, instead of to all.
    pub const MAC_SRC_MATCH_ENABLED: Self = Self(0x1303);
}

/// Capabilities of a co-processor, as numbers in packed form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Capabilities<'a>(pub &'a [u8]);

impl Capabilities<'_> {
    /// It is a radio co-processor: the network is the host's.
    pub const CONFIG_RADIO: u32 = 34;
    /// It sends and receives raw frames.
    pub const MAC_RAW: u32 = 513;

    /// The numbers, up to the first that is malformed.
    pub fn iter(&self) -> impl Iterator<Item = u32> {
        let mut reader = Reader::new(self.0);
        core::iter::from_fn(move || read_packed(&mut reader).ok())
    }

    /// Returns true if this number is among them.
    pub fn contains(&self, capability: u32) -> bool {
        self.iter().any(|other| other == capability)
    }
}

/// Addresses whose frames are received.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Promiscuity {
    /// For the own addresses.
    Off,
    /// For every address of the own PAN.
    Network,
    /// For every address, of any PAN.
    Full,
}

/// Facts about a transmission besides its status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TxReport<'a> {
    /// The acknowledgement said that a frame is pending.
    pub frame_pending: bool,
    /// The frame was sent with the counter and key that the host had put in. False where the co-processor
    /// is too old to tell.
    pub header_updated: bool,
    /// The acknowledgement; its PSDU is empty when none was requested. Absent unless the status is
    /// [`SpinelStatus::OK`].
    pub acknowledgement: Option<RxFrame<'a>>,
}

/// Version of the protocol that a co-processor speaks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ProtocolVersion {
    /// Changes when the protocol becomes another one. 4 is OpenThread's.
    pub major: u32,
    /// Changes when something is added.
    pub minor: u32,
}

impl fmt::Display for ProtocolVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

/// A property and its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Property<'a> {
    /// [`PropertyKey::LAST_STATUS`]; with a report if it is the result of a transmission.
    LastStatus(SpinelStatus, Option<TxReport<'a>>),
    /// [`PropertyKey::PROTOCOL_VERSION`].
    ProtocolVersion(ProtocolVersion),
    /// [`PropertyKey::NCP_VERSION`], UTF-8 without the zero at its end.
    NcpVersion(&'a [u8]),
    /// [`PropertyKey::CAPS`].
    Capabilities(Capabilities<'a>),
    /// [`PropertyKey::HWADDR`].
    HardwareAddress(Eui64),
    /// [`PropertyKey::PHY_ENABLED`].
    PhyEnabled(bool),
    /// [`PropertyKey::PHY_CHAN`].
    PhyChannel(u8),
    /// [`PropertyKey::PHY_TX_POWER`], dBm.
    PhyTxPower(i8),
    /// [`PropertyKey::MAC_15_4_LADDR`].
    MacExtended(Eui64),
    /// [`PropertyKey::MAC_15_4_SADDR`].
    MacShort(ShortAddress),
    /// [`PropertyKey::MAC_15_4_PANID`].
    MacPan(PanId),
    /// [`PropertyKey::MAC_RAW_STREAM_ENABLED`].
    MacRawStream(bool),
    /// [`PropertyKey::MAC_PROMISCUOUS_MODE`].
    MacPromiscuous(Promiscuity),
    /// [`PropertyKey::MAC_SRC_MATCH_ENABLED`].
    MacSourceMatch(bool),
    /// [`PropertyKey::STREAM_RAW`] when it is set: send this.
    Send(TxFrame<'a>),
    /// [`PropertyKey::STREAM_RAW`] when it is told: this was received.
    Received(RxFrame<'a>),
    /// Anything else, uninterpreted.
    Other(PropertyKey, &'a [u8]),
}

impl<'a> Property<'a> {
    /// The key of the property.
    pub const fn key(&self) -> PropertyKey {
        match self {
            Self::LastStatus(..) => PropertyKey::LAST_STATUS,
            Self::ProtocolVersion(_) => PropertyKey::PROTOCOL_VERSION,
            Self::NcpVersion(_) => PropertyKey::NCP_VERSION,
            Self::Capabilities(_) => PropertyKey::CAPS,
            Self::HardwareAddress(_) => PropertyKey::HWADDR,
            Self::PhyEnabled(_) => PropertyKey::PHY_ENABLED,
            Self::PhyChannel(_) => PropertyKey::PHY_CHAN,
            Self::PhyTxPower(_) => PropertyKey::PHY_TX_POWER,
            Self::MacExtended(_) => PropertyKey::MAC_15_4_LADDR,
            Self::MacShort(_) => PropertyKey::MAC_15_4_SADDR,
            Self::MacPan(_) => PropertyKey::MAC_15_4_PANID,
            Self::MacRawStream(_) => PropertyKey::MAC_RAW_STREAM_ENABLED,
            Self::MacPromiscuous(_) => PropertyKey::MAC_PROMISCUOUS_MODE,
            Self::MacSourceMatch(_) => PropertyKey::MAC_SRC_MATCH_ENABLED,
            Self::Send(_) | Self::Received(_) => PropertyKey::STREAM_RAW,
            Self::Other(key, _) => *key,
        }
    }

    /// The property of a command that sets it.
    pub(crate) fn parse_set(reader: &mut Reader<'a>) -> Result<Self, Malformed> {
        let key = PropertyKey(read_packed(reader)?);
        if key == PropertyKey::STREAM_RAW {
            return Ok(Self::Send(TxFrame::parse(reader)?));
        }
        Self::parse_value(key, reader)
    }

    /// The property of a command that tells it.
    pub(crate) fn parse_is(reader: &mut Reader<'a>) -> Result<Self, Malformed> {
        let key = PropertyKey(read_packed(reader)?);
        if key == PropertyKey::STREAM_RAW {
            return Ok(Self::Received(RxFrame::parse(reader)?));
        }
        Self::parse_value(key, reader)
    }

    fn parse_value(key: PropertyKey, reader: &mut Reader<'a>) -> Result<Self, Malformed> {
        Ok(match key {
            PropertyKey::LAST_STATUS => {
                let status = SpinelStatus(read_packed(reader)?);
                let report = if reader.rest().is_empty() {
                    None
                } else {
                    Some(TxReport::parse(reader)?)
                };
                Self::LastStatus(status, report)
            }
            PropertyKey::PROTOCOL_VERSION => Self::ProtocolVersion(ProtocolVersion {
                major: read_packed(reader)?,
                minor: read_packed(reader)?,
            }),
            PropertyKey::NCP_VERSION => {
                let text = reader.rest().split(|&byte| byte == 0).next();
                Self::NcpVersion(text.unwrap_or_default())
            }
            PropertyKey::CAPS => Self::Capabilities(Capabilities(reader.rest())),
            PropertyKey::HWADDR => Self::HardwareAddress(Eui64(reader.array()?)),
            PropertyKey::PHY_ENABLED => Self::PhyEnabled(read_bool(reader)?),
            PropertyKey::PHY_CHAN => Self::PhyChannel(reader.u8()?),
            PropertyKey::PHY_TX_POWER => Self::PhyTxPower(read_i8(reader)?),
            PropertyKey::MAC_15_4_LADDR => Self::MacExtended(Eui64(reader.array()?)),
            PropertyKey::MAC_15_4_SADDR => Self::MacShort(ShortAddress(reader.u16()?)),
            PropertyKey::MAC_15_4_PANID => Self::MacPan(PanId(reader.u16()?)),
            PropertyKey::MAC_RAW_STREAM_ENABLED => Self::MacRawStream(read_bool(reader)?),
            PropertyKey::MAC_PROMISCUOUS_MODE => Self::MacPromiscuous(match reader.u8()? {
                0 => Promiscuity::Off,
                1 => Promiscuity::Network,
                2 => Promiscuity::Full,
                _ => return Err(Malformed::Reserved),
            }),
            PropertyKey::MAC_SRC_MATCH_ENABLED => Self::MacSourceMatch(read_bool(reader)?),
            key => Self::Other(key, reader.rest()),
        })
    }

    pub(crate) fn emit(&self, writer: &mut Writer<'_>) -> Result<(), EmitError> {
        write_packed(writer, self.key().0)?;
        match *self {
            Self::LastStatus(status, ref report) => {
                write_packed(writer, status.0)?;
                report.as_ref().map_or(Ok(()), |report| report.emit(writer))
            }
            Self::ProtocolVersion(ProtocolVersion { major, minor }) => {
                write_packed(writer, major)?;
                write_packed(writer, minor)
            }
            Self::NcpVersion(text) => {
                writer.bytes(text)?;
                writer.u8(0)
            }
            Self::Capabilities(Capabilities(bytes)) | Self::Other(_, bytes) => writer.bytes(bytes),
            Self::HardwareAddress(address) | Self::MacExtended(address) => writer.bytes(&address.0),
            Self::PhyEnabled(on) | Self::MacRawStream(on) | Self::MacSourceMatch(on) => {
                writer.u8(on.into())
            }
            Self::PhyChannel(channel) => writer.u8(channel),
            Self::PhyTxPower(dbm) => write_i8(writer, dbm),
            Self::MacShort(address) => writer.u16(address.0),
            Self::MacPan(pan) => writer.u16(pan.0),
            Self::MacPromiscuous(promiscuity) => writer.u8(match promiscuity {
                Promiscuity::Off => 0,
                Promiscuity::Network => 1,
                Promiscuity::Full => 2,
            }),
            Self::Send(ref frame) => frame.emit(writer),
            Self::Received(ref frame) => frame.emit(writer),
        }
    }
}

impl<'a> TxReport<'a> {
    fn parse(reader: &mut Reader<'a>) -> Result<Self, Malformed> {
        let frame_pending = read_bool(reader)?;
        // OpenThread of before 2020 does not tell; the length of the acknowledgement follows, which is
        // zero or more than a boolean.
        let is_told = !matches!(reader.rest(), [0, 0] | [2..=u8::MAX, ..]);
        let header_updated = is_told && read_bool(reader)?;
        let acknowledgement = if reader.rest().is_empty() {
            None
        } else {
            Some(RxFrame::parse(reader)?)
        };
        Ok(Self {
            frame_pending,
            header_updated,
            acknowledgement,
        })
    }

    fn emit(&self, writer: &mut Writer<'_>) -> Result<(), EmitError> {
        writer.u8(self.frame_pending.into())?;
        writer.u8(self.header_updated.into())?;
        self.acknowledgement
            .as_ref()
            .map_or(Ok(()), |frame| frame.emit(writer))
    }
}

pub(crate) fn read_bool(reader: &mut Reader<'_>) -> Result<bool, Malformed> {
    reader.u8().map(|byte| byte != 0)
}

pub(crate) fn read_i8(reader: &mut Reader<'_>) -> Result<i8, Malformed> {
    reader.array().map(i8::from_le_bytes)
}

pub(crate) fn write_i8(writer: &mut Writer<'_>, value: i8) -> Result<(), EmitError> {
    writer.bytes(&value.to_le_bytes())
}
