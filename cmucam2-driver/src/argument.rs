//! Reasons why an argument cannot be sent.

use core::fmt;

/// An argument that the camera has no meaning for. Found before anything is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ArgumentError {
    /// A lower bound above its upper bound.
    BoundsOrder,
    /// A window whose left or upper edge lies behind its right or lower one.
    WindowOrder,
    /// A down-sampling factor of zero.
    DownSampling,
    /// More pairs than one register command carries, or an odd number of values.
    Registers,
    /// A servo other than 0 to 4.
    Servo,
    /// A servo position outside `46..=210`.
    ServoPosition,
    /// A mask with bits that no packet field has.
    Mask,
}

impl fmt::Display for ArgumentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::BoundsOrder => "a lower bound must not exceed its upper bound",
            Self::WindowOrder => "a window must have its first corner above and left of its second",
            Self::DownSampling => "a down-sampling factor must be at least 1",
            Self::Registers => "one command carries at most 5 pairs of register and value",
            Self::Servo => "a servo must be 0 to 4",
            Self::ServoPosition => "a servo position must be 46 to 210",
            Self::Mask => "a mask may only have bits of existing packet fields",
        })
    }
}

impl core::error::Error for ArgumentError {}
