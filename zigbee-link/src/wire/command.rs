//! MAC commands (IEEE 802.15.4-2006, 7.3).

use super::{EmitError, Malformed, PanId, Reader, ShortAddress, Writer};

/// Capabilities of a joining device, as the bits of an association request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DeviceCapabilities(pub u8);

impl DeviceCapabilities {
    /// A full-function device, mains powered or not, that listens always, speaks secured frames
    /// and wants a short address.
    pub const LISTENING: Self = Self(0b1100_1010);
}

/// Decision of a coordinator on a joining device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AssociationStatus {
    /// 0x00: welcome.
    Successful,
    /// 0x01: the PAN is full.
    AtCapacity,
    /// 0x02: not welcome.
    Denied,
    /// Any other value.
    Other(u8),
}

impl AssociationStatus {
    const fn from_byte(byte: u8) -> Self {
        match byte {
            0 => Self::Successful,
            1 => Self::AtCapacity,
            2 => Self::Denied,
            other => Self::Other(other),
        }
    }

    const fn byte(self) -> u8 {
        match self {
            Self::Successful => 0,
            Self::AtCapacity => 1,
            Self::Denied => 2,
            Self::Other(other) => other,
        }
    }
}

/// The answer to an association request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Association {
    /// The device's short address; meaningless unless successful.
    pub short: ShortAddress,
    /// Admission, or the reason for a refusal.
    pub status: AssociationStatus,
}

/// A MAC command: the payload of a command frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MacCommand {
    /// 0x01: a device wants to join.
    AssociationRequest(DeviceCapabilities),
    /// 0x02: the coordinator's decision.
    AssociationResponse(Association),
    /// 0x03: a device leaves (reason 2) or is sent away (reason 1).
    Disassociation {
        /// 1: sent away; 2: leaves of its own accord.
        reason: u8,
    },
    /// 0x04: a device asks for what waits for it.
    DataRequest,
    /// 0x05: a device hears two PANs of the same identifier.
    PanIdConflict,
    /// 0x06: a device lost its coordinator.
    Orphan,
    /// 0x07: who is there?
    BeaconRequest,
    /// 0x08: the PAN is, or will be, as said here.
    CoordinatorRealignment {
        /// The PAN identifier.
        pan: PanId,
        /// The coordinator's short address.
        coordinator: ShortAddress,
        /// The number of the channel.
        channel: u8,
        /// The orphan's short address, or broadcast.
        short: ShortAddress,
        /// The channel page, if told.
        page: Option<u8>,
    },
}

impl MacCommand {
    /// The command frame identifier.
    pub const fn id(&self) -> u8 {
        match self {
            Self::AssociationRequest(_) => 0x01,
            Self::AssociationResponse(_) => 0x02,
            Self::Disassociation { .. } => 0x03,
            Self::DataRequest => 0x04,
            Self::PanIdConflict => 0x05,
            Self::Orphan => 0x06,
            Self::BeaconRequest => 0x07,
            Self::CoordinatorRealignment { .. } => 0x08,
        }
    }

    /// Reads a command from the payload of a command frame, in clear and without integrity code.
    ///
    /// # Errors
    /// An unknown identifier, or a length that is not that of the command.
    pub fn parse(payload: &[u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(payload);
        let command = match reader.u8()? {
            0x01 => Self::AssociationRequest(DeviceCapabilities(reader.u8()?)),
            0x02 => Self::AssociationResponse(Association {
                short: ShortAddress(reader.u16()?),
                status: AssociationStatus::from_byte(reader.u8()?),
            }),
            0x03 => Self::Disassociation {
                reason: reader.u8()?,
            },
            0x04 => Self::DataRequest,
            0x05 => Self::PanIdConflict,
            0x06 => Self::Orphan,
            0x07 => Self::BeaconRequest,
            0x08 => Self::CoordinatorRealignment {
                pan: PanId(reader.u16()?),
                coordinator: ShortAddress(reader.u16()?),
                channel: reader.u8()?,
                short: ShortAddress(reader.u16()?),
                page: match reader.rest() {
                    [] => None,
                    _ => Some(reader.u8()?),
                },
            },
            _ => return Err(Malformed::UnknownCommand),
        };
        reader.end()?;
        Ok(command)
    }

    /// Writes the command to the start of `buffer` and returns its length.
    ///
    /// # Errors
    /// The buffer is too short.
    pub fn emit(&self, buffer: &mut [u8]) -> Result<usize, EmitError> {
        let mut writer = Writer::new(buffer);
        writer.u8(self.id())?;
        match *self {
            Self::AssociationRequest(DeviceCapabilities(bits)) => writer.u8(bits)?,
            Self::AssociationResponse(Association { short, status }) => {
                writer.u16(short.0)?;
                writer.u8(status.byte())?;
            }
            Self::Disassociation { reason } => writer.u8(reason)?,
            Self::DataRequest | Self::PanIdConflict | Self::Orphan | Self::BeaconRequest => {}
            Self::CoordinatorRealignment {
                pan,
                coordinator,
                channel,
                short,
                page,
            } => {
                writer.u16(pan.0)?;
                writer.u16(coordinator.0)?;
                writer.u8(channel)?;
                writer.u16(short.0)?;
                if let Some(page) = page {
                    writer.u8(page)?;
                }
            }
        }
        Ok(writer.len())
    }
}
