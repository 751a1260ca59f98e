//! Raw frames with their metadata.

use super::{
    frame::{read_packed, write_packed},
    property::{read_bool, read_i8, write_i8},
};
use zigbee_link::{
    radio::CSMA_BACKOFFS,
    wire::{EmitError, Malformed, Reader, Writer},
};

/// `macMaxFrameRetries`: repetitions of a frame that asks for an acknowledgement and gets none.
const FRAME_RETRIES: u8 = 3;

/// A frame to be sent, and the way to send it.
///
/// Only the PSDU and the channel must be there; what is missing has the value that
/// [`new`](Self::new) gives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TxFrame<'a> {
    /// The frame and two bytes of any value in the place of its FCS.
    pub psdu: &'a [u8],
    /// The number of the channel, 11 to 26.
    pub channel: u8,
    /// Backoffs before the channel counts as busy.
    pub csma_backoffs: u8,
    /// Repetitions if it is not acknowledged.
    pub retries: u8,
    /// Listen before sending.
    pub csma: bool,
    /// The frame counter and the key index in the header are final.
    pub header_updated: bool,
    /// It was sent before.
    pub retransmission: bool,
    /// It is encrypted and authenticated.
    pub security_processed: bool,
    /// To be sent so long after `delay_base`, microseconds; at once if zero.
    pub delay: u32,
    /// A moment on the radio's clock, microseconds.
    pub delay_base: u32,
    /// The channel to listen on afterwards.
    pub channel_after: u8,
}

impl<'a> TxFrame<'a> {
    /// A frame sent at once with CSMA and retries, that the co-processor is to secure.
    pub const fn new(psdu: &'a [u8], channel: u8) -> Self {
        Self {
            psdu,
            channel,
            csma_backoffs: CSMA_BACKOFFS,
            retries: FRAME_RETRIES,
            csma: true,
            header_updated: false,
            retransmission: false,
            security_processed: false,
            delay: 0,
            delay_base: 0,
            channel_after: channel,
        }
    }

    pub(crate) fn parse(reader: &mut Reader<'a>) -> Result<Self, Malformed> {
        let psdu = read_data(reader)?;
        let mut frame = Self::new(psdu, reader.u8()?);
        optional(reader, &mut frame.csma_backoffs, Reader::u8)?;
        optional(reader, &mut frame.retries, Reader::u8)?;
        optional(reader, &mut frame.csma, read_bool)?;
        optional(reader, &mut frame.header_updated, read_bool)?;
        optional(reader, &mut frame.retransmission, read_bool)?;
        optional(reader, &mut frame.security_processed, read_bool)?;
        optional(reader, &mut frame.delay, Reader::u32)?;
        optional(reader, &mut frame.delay_base, Reader::u32)?;
        optional(reader, &mut frame.channel_after, Reader::u8)?;
        Ok(frame)
    }

    pub(crate) fn emit(&self, writer: &mut Writer<'_>) -> Result<(), EmitError> {
        write_len(writer, self.psdu.len())?;
        writer.bytes(self.psdu)?;
        writer.u8(self.channel)?;
        writer.u8(self.csma_backoffs)?;
        writer.u8(self.retries)?;
        writer.u8(self.csma.into())?;
        writer.u8(self.header_updated.into())?;
        writer.u8(self.retransmission.into())?;
        writer.u8(self.security_processed.into())?;
        writer.u32(self.delay)?;
        writer.u32(self.delay_base)?;
        writer.u8(self.channel_after)
    }
}

/// A frame that was received, and its metadata.
///
/// Only the PSDU must be there; what is missing has the value that [`new`](Self::new) gives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RxFrame<'a> {
    /// The frame and two bytes in the place of its FCS. Empty if only an error is told.
    pub psdu: &'a [u8],
    /// Signal strength, dBm; [`Self::NO_RSSI`] if it was not measured.
    pub rssi: i8,
    /// Noise, dBm; -128 if it was not measured.
    pub noise: i8,
    /// [`Self::BAD_FCS`] and others.
    pub flags: u16,
    /// The channel, 0 if unknown.
    pub channel: u8,
    /// Link quality, 1 to 255; 0 if it was not measured.
    pub lqi: u8,
    /// Time when it came, on the radio's clock, microseconds.
    pub timestamp: u64,
    /// 0, or the reason why it was not received; the numbers are the implementation's.
    pub error: u32,
}

impl<'a> RxFrame<'a> {
    /// The value of `rssi` that means nothing.
    pub const NO_RSSI: i8 = 127;
    /// Flag: the FCS was wrong.
    pub const BAD_FCS: u16 = 0x0004;
    /// Flag: it was acknowledged, and the acknowledgement said that a frame is pending.
    pub const ACKNOWLEDGED_PENDING: u16 = 0x0010;

    /// A good frame of which nothing else is known.
    pub const fn new(psdu: &'a [u8]) -> Self {
        Self {
            psdu,
            rssi: Self::NO_RSSI,
            noise: -128,
            flags: 0,
            channel: 0,
            lqi: 0,
            timestamp: 0,
            error: 0,
        }
    }

    pub(crate) fn parse(reader: &mut Reader<'a>) -> Result<Self, Malformed> {
        let mut frame = Self::new(read_data(reader)?);
        optional(reader, &mut frame.rssi, read_i8)?;
        optional(reader, &mut frame.noise, read_i8)?;
        optional(reader, &mut frame.flags, Reader::u16)?;
        let mut phy: &[u8] = &[];
        optional(reader, &mut phy, read_data)?;
        let mut vendor: &[u8] = &[];
        optional(reader, &mut vendor, read_data)?;

        let phy = &mut Reader::new(phy);
        optional(phy, &mut frame.channel, Reader::u8)?;
        optional(phy, &mut frame.lqi, Reader::u8)?;
        optional(phy, &mut frame.timestamp, read_timestamp)?;
        optional(&mut Reader::new(vendor), &mut frame.error, read_packed)?;
        Ok(frame)
    }

    pub(crate) fn emit(&self, writer: &mut Writer<'_>) -> Result<(), EmitError> {
        write_len(writer, self.psdu.len())?;
        writer.bytes(self.psdu)?;
        write_i8(writer, self.rssi)?;
        write_i8(writer, self.noise)?;
        writer.u16(self.flags)?;
        write_len(writer, 2 + size_of_val(&self.timestamp))?;
        writer.u8(self.channel)?;
        writer.u8(self.lqi)?;
        writer.bytes(&self.timestamp.to_le_bytes())?;

        let mut error = [0; 3];
        let mut vendor = Writer::new(&mut error);
        write_packed(&mut vendor, self.error)?;
        let len = vendor.len();
        write_len(writer, len)?;
        writer.bytes(error.get(..len).unwrap_or_default())
    }
}

/// Metadata may end after any field.
fn optional<'a, T>(
    reader: &mut Reader<'a>,
    value: &mut T,
    read: impl FnOnce(&mut Reader<'a>) -> Result<T, Malformed>,
) -> Result<(), Malformed> {
    if !reader.rest().is_empty() {
        *value = read(reader)?;
    }
    Ok(())
}

/// Microseconds in 64 bits. OpenThread of before August 2019 has milliseconds in 32 bits and microseconds in 16
/// in their place; the length tells which.
fn read_timestamp(reader: &mut Reader<'_>) -> Result<u64, Malformed> {
    if reader.rest().len() != 6 {
        return reader.array().map(u64::from_le_bytes);
    }
    let milliseconds = u64::from(reader.u32()?);
    Ok(milliseconds * 1000 + u64::from(reader.u16()?))
}

/// Bytes after their number.
fn read_data<'a>(reader: &mut Reader<'a>) -> Result<&'a [u8], Malformed> {
    let len = reader.u16()?;
    reader.bytes(len.into())
}

fn write_len(writer: &mut Writer<'_>, len: usize) -> Result<(), EmitError> {
    writer.u16(u16::try_from(len).map_err(|_| EmitError::Impossible)?)
}
