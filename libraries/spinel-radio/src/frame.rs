//! Content of a frame: header, command and the data of the command.

use super::property::{Property, PropertyKey};
use zigbee_link::wire::{EmitError, Malformed, Reader, Writer};

/// A transaction identifier, by which an answer belongs to a command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tid(u8);

impl Tid {
    /// Of frames that the co-processor sends unasked, and of commands that want no answer.
    pub const UNSOLICITED: Self = Self(0);

    /// This identifier, if it has 4 bits.
    pub const fn new(tid: u8) -> Option<Self> {
        if tid < 16 { Some(Self(tid)) } else { None }
    }

    /// The number, 0 to 15.
    pub const fn number(self) -> u8 {
        self.0
    }

    /// The one after this: 1 to 15, in turn.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0 % 15 + 1)
    }
}

/// The first byte of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SpinelHeader {
    interface: u8,
    /// The exchange it belongs to.
    pub tid: Tid,
}

impl SpinelHeader {
    /// On the first interface.
    pub const fn new(tid: Tid) -> Self {
        Self { interface: 0, tid }
    }

    /// On one of the four interfaces of a co-processor for several networks.
    pub const fn on_interface(interface: u8, tid: Tid) -> Option<Self> {
        if interface < 4 {
            Some(Self { interface, tid })
        } else {
            None
        }
    }

    /// The interface, 0 to 3.
    pub const fn interface(self) -> u8 {
        self.interface
    }

    pub(crate) const fn to_byte(self) -> u8 {
        0x80 | self.interface << 4 | self.tid.0
    }

    const fn from_byte(byte: u8) -> Option<Self> {
        if byte >> 6 == 0b10 {
            Some(Self {
                interface: byte >> 4 & 3,
                tid: Tid(byte & 0xF),
            })
        } else {
            None
        }
    }
}

/// Parts that are to restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Reset {
    /// The usual parts, by the co-processor's choice.
    Default,
    /// The whole processor.
    Platform,
    /// The radio's software. A USB connection stays.
    Stack,
    /// A value this crate has no name for.
    Other(u8),
}

/// Command of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Body<'a> {
    /// Is a co-processor there?
    Noop,
    /// Restart. The answer is an unsolicited [`Property::LastStatus`].
    Reset(Reset),
    /// Tell this property.
    Get(PropertyKey),
    /// Make the property this. The answer tells it, or a [`Property::LastStatus`].
    Set(Property<'a>),
    /// The property is this: an answer, or unasked.
    Is(Property<'a>),
}

/// The content of an HDLC frame: interface and exchange, and a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SpinelMessage<'a> {
    /// Its header.
    pub header: SpinelHeader,
    /// Its command.
    pub body: Body<'a>,
}

const NOOP: u32 = 0;
const RESET: u32 = 1;
const GET: u32 = 2;
const SET: u32 = 3;
const IS: u32 = 6;

impl<'a> SpinelMessage<'a> {
    /// Reads the content of an HDLC frame.
    ///
    /// Bytes after the fields that are known are ignored, as the protocol demands.
    ///
    /// # Errors
    /// [`Malformed::Truncated`], [`Malformed::Reserved`] for a header that is not Spinel's or a
    /// number of more than 21 bits, [`Malformed::Unsupported`] for any other command.
    pub fn parse(content: &'a [u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(content);
        let header = SpinelHeader::from_byte(reader.u8()?).ok_or(Malformed::Reserved)?;
        let body = match read_packed(&mut reader)? {
            NOOP => Body::Noop,
            RESET => Body::Reset(match reader.u8() {
                Err(_) => Reset::Default,
                Ok(1) => Reset::Platform,
                Ok(2) => Reset::Stack,
                Ok(other) => Reset::Other(other),
            }),
            GET => Body::Get(PropertyKey(read_packed(&mut reader)?)),
            SET => Body::Set(Property::parse_set(&mut reader)?),
            IS => Body::Is(Property::parse_is(&mut reader)?),
            _ => return Err(Malformed::Unsupported),
        };
        Ok(Self { header, body })
    }

    /// Writes the content of an HDLC frame to the start of `buffer` and returns its length.
    ///
    /// # Errors
    /// [`EmitError::NoRoom`], or [`EmitError::Impossible`] for a number of more than 21 bits or data
    /// of more than 65535 bytes.
    pub fn emit(&self, buffer: &mut [u8]) -> Result<usize, EmitError> {
        let mut writer = Writer::new(buffer);
        writer.u8(self.header.to_byte())?;
        match &self.body {
            Body::Noop => write_packed(&mut writer, NOOP)?,
            Body::Reset(reset) => {
                write_packed(&mut writer, RESET)?;
                match *reset {
                    Reset::Default => {}
                    Reset::Platform => writer.u8(1)?,
                    Reset::Stack => writer.u8(2)?,
                    Reset::Other(other) => writer.u8(other)?,
                }
            }
            Body::Get(key) => {
                write_packed(&mut writer, GET)?;
                write_packed(&mut writer, key.0)?;
            }
            Body::Set(property) => {
                write_packed(&mut writer, SET)?;
                property.emit(&mut writer)?;
            }
            Body::Is(property) => {
                write_packed(&mut writer, IS)?;
                property.emit(&mut writer)?;
            }
        }
        Ok(writer.len())
    }
}

/// Bits of the largest packed number, in three bytes of seven.
const PACKED_BITS: u32 = 21;

/// A number in groups of seven bits, lowest first; the highest bit of a byte says that more follow.
pub(crate) fn read_packed(reader: &mut Reader<'_>) -> Result<u32, Malformed> {
    let mut value = 0;
    for shift in (0..PACKED_BITS).step_by(7) {
        let byte = reader.u8()?;
        value |= u32::from(byte & 0x7F) << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(Malformed::Reserved)
}

pub(crate) fn write_packed(writer: &mut Writer<'_>, value: u32) -> Result<(), EmitError> {
    if value >> PACKED_BITS != 0 {
        return Err(EmitError::Impossible);
    }
    let mut rest = value;
    while rest >= 0x80 {
        writer.u8(rest as u8 | 0x80)?;
        rest >>= 7;
    }
    writer.u8(rest as u8)
}

#[cfg(test)]
mod tests {
    use std::{vec, vec::Vec};

    use proptest::prelude::*;

    use super::*;

    fn packed(value: u32) -> Result<Vec<u8>, EmitError> {
        let mut buffer = [0; 3];
        let mut writer = Writer::new(&mut buffer);
        write_packed(&mut writer, value)?;
        let len = writer.len();
        Ok(buffer[..len].to_vec())
    }

    /// 1337 is the example of the draft.
    #[test]
    fn packed_numbers() {
        for (value, bytes) in [
            (0, vec![0]),
            (127, vec![0x7F]),
            (128, vec![0x80, 1]),
            (1337, vec![0xB9, 0x0A]),
            (16383, vec![0xFF, 0x7F]),
            (16384, vec![0x80, 0x80, 1]),
            (2_097_151, vec![0xFF, 0xFF, 0x7F]),
        ] {
            assert_eq!(packed(value).unwrap(), bytes);
            assert_eq!(read_packed(&mut Reader::new(&bytes)), Ok(value));
            let cut = &bytes[..bytes.len() - 1];
            assert_eq!(
                read_packed(&mut Reader::new(cut)),
                Err(Malformed::Truncated)
            );
        }
        assert_eq!(packed(2_097_152), Err(EmitError::Impossible));
        let long = [0x80, 0x80, 0x80, 0];
        assert_eq!(
            read_packed(&mut Reader::new(&long)),
            Err(Malformed::Reserved)
        );
    }

    #[test]
    fn transactions_never_use_the_unsolicited_one() {
        let mut tid = Tid::UNSOLICITED;
        for expected in (1..=15).chain(1..=15) {
            tid = tid.next();
            assert_eq!(tid.number(), expected);
        }
        assert_eq!(Tid::new(16), None);
        assert_eq!(SpinelHeader::on_interface(4, tid), None);
    }

    #[test]
    fn commands() {
        for (bytes, body) in [
            (&[0x81, 0][..], Body::Noop),
            (&[0x81, 1], Body::Reset(Reset::Default)),
            (&[0x81, 1, 1], Body::Reset(Reset::Platform)),
            (&[0x81, 1, 2], Body::Reset(Reset::Stack)),
            (&[0x81, 1, 3], Body::Reset(Reset::Other(3))),
            (&[0x81, 2, 0x83, 0x26], Body::Get(PropertyKey(0x1303))),
        ] {
            let header = SpinelHeader::new(Tid(1));
            assert_eq!(
                SpinelMessage::parse(bytes),
                Ok(SpinelMessage { header, body })
            );
            let mut buffer = [0; 8];
            let len = SpinelMessage { header, body }.emit(&mut buffer).unwrap();
            assert_eq!(&buffer[..len], bytes);
        }
        assert_eq!(SpinelMessage::parse(&[]), Err(Malformed::Truncated));
        assert_eq!(SpinelMessage::parse(&[0x81]), Err(Malformed::Truncated));
        assert_eq!(SpinelMessage::parse(&[0x41, 0]), Err(Malformed::Reserved));
        assert_eq!(
            SpinelMessage::parse(&[0x81, 18]),
            Err(Malformed::Unsupported)
        );
    }

    proptest! {
        #[test]
        fn every_header(byte: u8) {
            match SpinelHeader::from_byte(byte) {
                Some(header) => prop_assert_eq!(header.to_byte(), byte),
                None => prop_assert!(!(0x80..0xC0).contains(&byte)),
            }
        }
    }
}
