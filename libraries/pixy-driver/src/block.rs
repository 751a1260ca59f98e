//! The blobs of a frame.

use crate::packet::u16_at;

/// Bytes of a block in a packet.
pub const BLOCK_BYTES: usize = 14;

/// A blob of one signature, or of a colour code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Block {
    /// 1 to 7; above, the digits of a colour code in octal.
    pub signature: u16,
    /// Middle, column from 0: of its box, cut to a whole one. OpenMV: of its mass, or of the tag.
    pub x: u16,
    /// Middle, row from 0 at the top.
    pub y: u16,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// Angle of a colour code or tag, degrees: -180 to 360. Otherwise 0.
    pub angle: i16,
    /// The same blob has the same number from frame to frame. Only a Pixy2 tells it.
    pub index: u8,
    /// Frames for which it was followed, at most 255. Only a Pixy2 tells it.
    pub age: u8,
}

impl Block {
    /// From the bytes of a packet. `None` if there are fewer than [`BLOCK_BYTES`].
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        Some(Self {
            signature: u16_at(bytes, 0)?,
            x: u16_at(bytes, 2)?,
            y: u16_at(bytes, 4)?,
            width: u16_at(bytes, 6)?,
            height: u16_at(bytes, 8)?,
            angle: u16_at(bytes, 10)?.cast_signed(),
            index: *bytes.get(12)?,
            age: *bytes.get(13)?,
        })
    }

    /// The sum that a stream tells before it.
    pub(crate) fn sum(&self) -> u16 {
        let angle = self.angle.cast_unsigned();
        let numbers = [self.x, self.y, self.width, self.height, angle];
        let all = numbers.into_iter();
        all.fold(self.signature, u16::wrapping_add)
    }

    /// The leftmost column, as the camera has made `x` of it: the middle is cut.
    pub fn left(&self) -> u16 {
        self.x.saturating_sub(self.width / 2)
    }

    /// The uppermost row.
    pub fn top(&self) -> u16 {
        self.y.saturating_sub(self.height / 2)
    }
}
