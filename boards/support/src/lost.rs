//! Bytes of a UART that found no room.

use core::fmt;

use embedded_io_async::{Error, ErrorKind};

/// Bytes were lost: those that were not read yet, and some that came after them. The next ones are whole again. Of a
/// camera a picture is lost, and it is asked for another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost;

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the UART lost bytes")
    }
}

impl core::error::Error for Lost {}

impl Error for Lost {
    /// Whoever tries again may succeed.
    fn kind(&self) -> ErrorKind {
        ErrorKind::Interrupted
    }
}
