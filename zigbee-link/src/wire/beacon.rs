//! Beacons (IEEE 802.15.4-2006, 7.2.2.1).

use super::{EmitError, Malformed, Reader, Writer};

/// The superframe specification of a beacon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Superframe(pub u16);

impl Superframe {
    /// Of a PAN without superframes, sent by its coordinator: beacon order, superframe order and
    /// final slot 15.
    pub const fn beaconless(association_permit: bool) -> Self {
        Self(0x4FFF | if association_permit { 0x8000 } else { 0 })
    }

    /// The sender is the PAN's coordinator.
    pub const fn pan_coordinator(self) -> bool {
        self.0 & 0x4000 != 0
    }

    /// The sender admits devices.
    pub const fn association_permit(self) -> bool {
        self.0 & 0x8000 != 0
    }
}

/// The payload of a beacon frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Beacon<'a> {
    /// The superframe specification.
    pub superframe: Superframe,
    /// The guaranteed time slots, from their specification on, as on the air.
    pub time_slots: &'a [u8],
    /// The devices something waits for, from the specification on, as on the air.
    pub pending: &'a [u8],
    /// Payload that the network chose.
    pub payload: &'a [u8],
}

impl<'a> Beacon<'a> {
    /// A beacon without time slots and pending addresses.
    pub const fn new(superframe: Superframe, payload: &'a [u8]) -> Self {
        Self {
            superframe,
            time_slots: &[0],
            pending: &[0],
            payload,
        }
    }

    /// Reads the payload of a beacon frame.
    ///
    /// # Errors
    /// It ends inside a field, or uses a reserved bit.
    pub fn parse(payload: &'a [u8]) -> Result<Self, Malformed> {
        let mut reader = Reader::new(payload);
        let superframe = Superframe(reader.u16()?);
        let time_slots = list(&mut reader, time_slots_len)?;
        let pending = list(&mut reader, pending_len)?;
        Ok(Self {
            superframe,
            time_slots,
            pending,
            payload: reader.rest(),
        })
    }

    /// Writes the beacon to the start of `buffer` and returns its length.
    ///
    /// # Errors
    /// The buffer is too short; or a list has another length than its specification says.
    pub fn emit(&self, buffer: &mut [u8]) -> Result<usize, EmitError> {
        let mut writer = Writer::new(buffer);
        writer.u16(self.superframe.0)?;
        for (bytes, len) in [
            (self.time_slots, time_slots_len as ListLen),
            (self.pending, pending_len),
        ] {
            let specified = bytes
                .first()
                .and_then(|&specification| len(specification).ok());
            if specified != Some(bytes.len()) {
                return Err(EmitError::Impossible);
            }
            writer.bytes(bytes)?;
        }
        writer.bytes(self.payload)?;
        Ok(writer.len())
    }
}

/// Bytes of a list with its specification, which is given.
type ListLen = fn(u8) -> Result<usize, Malformed>;

fn list<'a>(reader: &mut Reader<'a>, len: ListLen) -> Result<&'a [u8], Malformed> {
    let specification = Reader::new(reader.rest()).u8()?;
    reader.bytes(len(specification)?)
}

/// Specification, and only with slots: directions, and three bytes per slot.
fn time_slots_len(specification: u8) -> Result<usize, Malformed> {
    if specification & 0b0111_1000 != 0 {
        return Err(Malformed::Reserved);
    }
    Ok(match specification & 7 {
        0 => 1,
        slots => 2 + 3 * usize::from(slots),
    })
}

/// Specification, short addresses, extended addresses.
fn pending_len(specification: u8) -> Result<usize, Malformed> {
    if specification & 0b1000_1000 != 0 {
        return Err(Malformed::Reserved);
    }
    let short = usize::from(specification & 7);
    let extended = usize::from((specification >> 4) & 7);
    Ok(1 + 2 * short + 8 * extended)
}
