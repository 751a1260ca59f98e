//! The MAC header.

use super::control::{AddressMode, Control};
use super::{
    Address, AuxHeader, EmitError, Eui64, FrameType, FrameVersion, Malformed, PanId, Reader,
    ShortAddress, Writer,
};

/// An address field and the PAN identifier field before it. Either may be absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Panned {
    /// The PAN identifier, if this field is present.
    pub pan: Option<PanId>,
    /// The address, if this field is present.
    pub address: Option<Address>,
}

impl Panned {
    /// Neither field.
    pub const NONE: Self = Self {
        pan: None,
        address: None,
    };

    /// An address in a PAN: both fields.
    pub const fn new(pan: PanId, address: Address) -> Self {
        Self {
            pan: Some(pan),
            address: Some(address),
        }
    }

    /// An address whose PAN identifier is that of the other address.
    pub const fn compressed(address: Address) -> Self {
        Self {
            pan: None,
            address: Some(address),
        }
    }

    fn mode(&self) -> AddressMode {
        match self.address {
            None => AddressMode::None,
            Some(Address::Short(_)) => AddressMode::Short,
            Some(Address::Extended(_)) => AddressMode::Extended,
        }
    }

    fn parse(reader: &mut Reader<'_>, has_pan: bool, mode: AddressMode) -> Result<Self, Malformed> {
        let pan = if has_pan {
            Some(PanId(reader.u16()?))
        } else {
            None
        };
        let address = match mode {
            AddressMode::None => None,
            AddressMode::Short => Some(Address::Short(ShortAddress(reader.u16()?))),
            AddressMode::Extended => {
                let mut bytes = reader.array()?;
                bytes.reverse();
                Some(Address::Extended(Eui64(bytes)))
            }
        };
        Ok(Self { pan, address })
    }

    fn emit(&self, writer: &mut Writer<'_>) -> Result<(), EmitError> {
        if let Some(pan) = self.pan {
            writer.u16(pan.0)?;
        }
        match self.address {
            None => Ok(()),
            Some(Address::Short(short)) => writer.u16(short.0),
            Some(Address::Extended(Eui64(mut bytes))) => {
                bytes.reverse();
                writer.bytes(&bytes)
            }
        }
    }
}

/// A MAC header.
///
/// PAN identifier compression is not a field: it follows from which identifiers are present.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Header {
    /// Type of the frame.
    pub frame_type: FrameType,
    /// The edition of the standard that it follows.
    pub version: FrameVersion,
    /// The sender has more for the receiver.
    pub frame_pending: bool,
    /// The sender waits for an immediate acknowledgement. No frame of this crate asks for one.
    pub ack_request: bool,
    /// The sequence number.
    pub sequence: u8,
    /// Destination of the frame; none for the coordinator of the source's PAN.
    pub destination: Panned,
    /// Source of the frame.
    pub source: Panned,
    /// The auxiliary security header of a secured frame.
    pub security: Option<AuxHeader>,
}

impl Header {
    /// An unsecured header of version 1 without addresses.
    pub const fn new(frame_type: FrameType, sequence: u8) -> Self {
        Self {
            frame_type,
            version: FrameVersion::V2006,
            frame_pending: false,
            ack_request: false,
            sequence,
            destination: Panned::NONE,
            source: Panned::NONE,
            security: None,
        }
    }

    /// Writes the header to the start of `buffer` and returns its length.
    ///
    /// # Errors
    /// The buffer is too short; or no header has these fields together, for example an address
    /// without a PAN identifier, or security in version 0.
    pub fn emit(&self, buffer: &mut [u8]) -> Result<usize, EmitError> {
        let mut writer = Writer::new(buffer);
        writer.u16(self.control()?.bits())?;
        writer.u8(self.sequence)?;
        self.destination.emit(&mut writer)?;
        self.source.emit(&mut writer)?;
        if let Some(security) = &self.security {
            security.emit(&mut writer)?;
        }
        Ok(writer.len())
    }

    /// The bytes of the integrity code at the frame's end.
    pub fn mic_len(&self) -> usize {
        self.security.map_or(0, |security| security.level.mic_len())
    }

    fn control(&self) -> Result<Control, EmitError> {
        let control = Control {
            frame_type: self.frame_type,
            security: self.security.is_some(),
            frame_pending: self.frame_pending,
            ack_request: self.ack_request,
            pan_compression: self.source.address.is_some() && self.source.pan.is_none(),
            destination: self.destination.mode(),
            version: self.version,
            source: self.source.mode(),
        };
        let present = (self.destination.pan.is_some(), self.source.pan.is_some());
        let is_possible = control.pans() == Ok(present) && control.check().is_ok();
        is_possible.then_some(control).ok_or(EmitError::Impossible)
    }

    fn parse(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        let control = Control::parse(reader.u16()?)?;
        control.check()?;
        let sequence = reader.u8()?;
        let (destination_pan, source_pan) = control.pans()?;
        let destination = Panned::parse(reader, destination_pan, control.destination)?;
        let source = Panned::parse(reader, source_pan, control.source)?;
        let security = if control.security {
            Some(AuxHeader::parse(reader)?)
        } else {
            None
        };
        Ok(Self {
            frame_type: control.frame_type,
            version: control.version,
            frame_pending: control.frame_pending,
            ack_request: control.ack_request,
            sequence,
            destination,
            source,
            security,
        })
    }
}

/// A frame whose header was understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame<'a> {
    header: Header,
    header_bytes: &'a [u8],
    payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Takes a frame without FCS apart.
    ///
    /// # Errors
    /// The header is cut off, of an unknown kind, or uses what is reserved; or a secured frame is
    /// shorter than its integrity code.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(bytes);
        let header = Header::parse(&mut reader)?;
        let payload = reader.rest();
        if payload.len() < header.mic_len() {
            return Err(Malformed::Truncated);
        }
        let header_bytes = bytes
            .get(..bytes.len() - payload.len())
            .ok_or(Malformed::Truncated)?;
        Ok(Self {
            header,
            header_bytes,
            payload,
        })
    }

    /// Returns the header.
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// The header as it is on the air: with the auxiliary security header.
    pub const fn header_bytes(&self) -> &'a [u8] {
        self.header_bytes
    }

    /// Bytes after the header, with the integrity code of a secured frame.
    pub const fn payload(&self) -> &'a [u8] {
        self.payload
    }
}
