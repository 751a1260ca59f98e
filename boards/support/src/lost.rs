//! Bytes of a UART that found no room.

use core::fmt;

use embedded_io_async::{Error, ErrorKind};

/// Bytes were lost, and perhaps some of those before and after them. A camera is asked for another picture then, and a
/// PC repeats what is not confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost;

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the UART lost bytes")
    }
}

impl core::error::Error for Lost {}

impl Error for Lost {
    /// Another attempt may succeed.
    fn kind(&self) -> ErrorKind {
        ErrorKind::Interrupted
    }
}
