//! Reasons why bytes are no frame, or a frame has no bytes.

use core::fmt;

/// Reason why bytes were not understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Malformed {
    /// The frame ends inside a field.
    Truncated,
    /// Bytes follow where the format ends.
    TrailingBytes,
    /// A reserved bit is set, or a field has a reserved value.
    Reserved,
    /// A frame type, version or key identifier mode that this crate does not speak.
    Unsupported,
    /// PAN identifier compression with an address missing.
    PanCompression,
    /// Security in a version 0 frame, whose format is withdrawn.
    ObsoleteSecurity,
    /// An unknown MAC command.
    UnknownCommand,
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Truncated => "the frame ends inside a field",
            Self::TrailingBytes => "bytes follow where the format ends",
            Self::Reserved => "a reserved bit or value is used",
            Self::Unsupported => "a frame type, version or key mode that is not supported",
            Self::PanCompression => "PAN identifier compression without both addresses",
            Self::ObsoleteSecurity => "security of IEEE 802.15.4-2003",
            Self::UnknownCommand => "an unknown MAC command",
        })
    }
}

impl core::error::Error for Malformed {}

/// Reason why a frame cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum EmitError {
    /// The buffer is too short.
    NoRoom,
    /// No frame has these fields together.
    Impossible,
}

impl fmt::Display for EmitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NoRoom => "the frame does not fit the buffer",
            Self::Impossible => "no frame has these fields together",
        })
    }
}

impl core::error::Error for EmitError {}
