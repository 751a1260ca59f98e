//! Reading and writing little-endian fields one after the other.

use super::{EmitError, Malformed};

/// The bytes not yet read, of a frame of whatever protocol.
#[derive(Clone, Copy, Debug)]
pub struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    /// Over these bytes, from their start.
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// The bytes that follow, which stay to be read.
    pub const fn rest(self) -> &'a [u8] {
        self.0
    }

    /// The next `count` bytes.
    ///
    /// # Errors
    /// [`Malformed::Truncated`], here and below: there are fewer. Nothing is read then.
    pub fn bytes(&mut self, count: usize) -> Result<&'a [u8], Malformed> {
        let (head, tail) = self.0.split_at_checked(count).ok_or(Malformed::Truncated)?;
        self.0 = tail;
        Ok(head)
    }

    /// The next `N` bytes.
    ///
    /// # Errors
    /// There are fewer.
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        let (head, tail) = self.0.split_first_chunk().ok_or(Malformed::Truncated)?;
        self.0 = tail;
        Ok(*head)
    }

    /// The next byte.
    ///
    /// # Errors
    /// There is none.
    pub fn u8(&mut self) -> Result<u8, Malformed> {
        self.array().map(|[byte]| byte)
    }

    /// The next two bytes as a number.
    ///
    /// # Errors
    /// There are fewer.
    pub fn u16(&mut self) -> Result<u16, Malformed> {
        self.array().map(u16::from_le_bytes)
    }

    /// The next four bytes as a number.
    ///
    /// # Errors
    /// There are fewer.
    pub fn u32(&mut self) -> Result<u32, Malformed> {
        self.array().map(u32::from_le_bytes)
    }

    /// Ends the reading.
    ///
    /// # Errors
    /// [`Malformed::TrailingBytes`]: bytes are left.
    pub fn end(self) -> Result<(), Malformed> {
        if self.0.is_empty() {
            Ok(())
        } else {
            Err(Malformed::TrailingBytes)
        }
    }
}

/// A buffer that is filled from its start.
#[derive(Debug)]
pub struct Writer<'a> {
    buffer: &'a mut [u8],
    len: usize,
}

impl<'a> Writer<'a> {
    /// Over this buffer, from its start.
    pub const fn new(buffer: &'a mut [u8]) -> Self {
        Self { buffer, len: 0 }
    }

    /// Number of bytes written.
    #[expect(
        clippy::len_without_is_empty,
        reason = "a length is what an emitter returns"
    )]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Writes these bytes.
    ///
    /// # Errors
    /// [`EmitError::NoRoom`], here and below: the buffer is too short. Nothing is written then.
    // for less flash
    #[inline(never)]
    pub fn bytes(&mut self, bytes: &[u8]) -> Result<(), EmitError> {
        let place = self
            .buffer
            .get_mut(self.len..)
            .and_then(|free| free.get_mut(..bytes.len()))
            .ok_or(EmitError::NoRoom)?;
        copy(place, bytes);
        self.len += bytes.len();
        Ok(())
    }

    /// Writes a byte.
    ///
    /// # Errors
    /// There is no room.
    pub fn u8(&mut self, value: u8) -> Result<(), EmitError> {
        self.bytes(&[value])
    }

    /// Writes two bytes.
    ///
    /// # Errors
    /// There is no room.
    pub fn u16(&mut self, value: u16) -> Result<(), EmitError> {
        self.bytes(&value.to_le_bytes())
    }

    /// Writes four bytes.
    ///
    /// # Errors
    /// There is no room.
    pub fn u32(&mut self, value: u32) -> Result<(), EmitError> {
        self.bytes(&value.to_le_bytes())
    }
}

/// Copies as much as both have. Unlike `copy_from_slice` it leaves no branch to a panic where it is
/// not inlined.
pub(crate) fn copy(to: &mut [u8], from: &[u8]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}
