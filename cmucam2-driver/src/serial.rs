//! The UART of a blocking HAL that gives one byte or none: `embedded-hal-nb`.
//!
//! The blocking driver must know whether a byte is there ([`embedded_io::ReadReady`]), which few
//! blocking HALs can tell. All of them can try to read one: [`Peek`] tries, and keeps the byte.

use core::fmt;

use embedded_hal_nb::{
    nb,
    serial::{self, Error, ErrorKind},
};

/// A UART of `embedded-hal-nb` with the traits of `embedded-io`.
///
/// Without a receive buffer of its own: the bytes that the UART holds must last from one look to the next. So
/// keep [`poll_us`](crate::session::Policy::poll_us) below the time of a character (87 us at 115,200 baud),
/// and use [poll mode](crate::Command::PollMode), so that nothing comes between two calls.
#[derive(Debug)]
pub struct Peek<S> {
    serial: S,
    byte: Option<u8>,
}

impl<S> Peek<S> {
    /// A peek over a UART with 8 data bits, no parity and one stop bit.
    pub fn new(serial: S) -> Self {
        Self { serial, byte: None }
    }

    /// The UART. A byte that was peeked and not read is lost.
    pub fn release(self) -> S {
        self.serial
    }
}

/// The UART failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialError(pub ErrorKind);

impl fmt::Display for SerialError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl core::error::Error for SerialError {}

impl embedded_io::Error for SerialError {
    fn kind(&self) -> embedded_io::ErrorKind {
        match self.0 {
            ErrorKind::FrameFormat | ErrorKind::Parity | ErrorKind::Noise => {
                embedded_io::ErrorKind::InvalidData
            }
            _ => embedded_io::ErrorKind::Other,
        }
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for SerialError {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{}", defmt::Display2Format(self));
    }
}

impl SerialError {
    fn of(error: &impl Error) -> Self {
        Self(error.kind())
    }
}

impl<S> embedded_io::ErrorType for Peek<S> {
    type Error = SerialError;
}

impl<S: serial::Read> embedded_io::ReadReady for Peek<S> {
    fn read_ready(&mut self) -> Result<bool, SerialError> {
        if self.byte.is_none() {
            self.byte = match self.serial.read() {
                Ok(byte) => Some(byte),
                Err(nb::Error::WouldBlock) => None,
                Err(nb::Error::Other(error)) => return Err(SerialError::of(&error)),
            };
        }
        Ok(self.byte.is_some())
    }
}

impl<S: serial::Read> embedded_io::Read for Peek<S> {
    /// One byte: to try for more would delay this one.
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, SerialError> {
        let Some(place) = buffer.first_mut() else {
            return Ok(0);
        };
        *place = match self.byte.take() {
            Some(byte) => byte,
            None => nb::block!(self.serial.read()).map_err(|error| SerialError::of(&error))?,
        };
        Ok(1)
    }
}

impl<S: serial::Write> embedded_io::Write for Peek<S> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, SerialError> {
        for &byte in bytes {
            nb::block!(self.serial.write(byte)).map_err(|error| SerialError::of(&error))?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), SerialError> {
        nb::block!(self.serial.flush()).map_err(|error| SerialError::of(&error))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use embedded_hal_mock::eh1::serial::{Mock, Transaction};
    use embedded_io::{Read, ReadReady, Write};

    use super::*;

    #[test]
    fn a_peeked_byte_is_read_once() {
        let overrun = || Transaction::read_error(nb::Error::Other(ErrorKind::Overrun));
        let some = |byte| {
            let nothing = Transaction::read_error(nb::Error::WouldBlock);
            [nothing, Transaction::read(byte)]
        };
        let script = [some(2), some(4), some(6), [overrun(), overrun()]];
        let mut port = Peek::new(Mock::new(script.as_flattened()));
        let mut buffer = [0; 4];
        assert_eq!(port.read_ready(), Ok(false));
        assert_eq!(port.read_ready(), Ok(true));
        assert_eq!(port.read_ready(), Ok(true));
        assert_eq!((port.read(&mut buffer), buffer[0]), (Ok(1), 2));
        // Without a look before, it waits.
        assert_eq!((port.read(&mut buffer), buffer[0]), (Ok(1), 4));
        assert_eq!(port.read(&mut []), Ok(0));
        assert_eq!(port.read_ready(), Ok(false));
        assert_eq!(port.read_ready(), Ok(true));
        assert_eq!((port.read(&mut buffer), buffer[0]), (Ok(1), 6));
        let overrun = SerialError(ErrorKind::Overrun);
        assert_eq!(port.read_ready(), Err(overrun));
        assert_eq!(port.read(&mut buffer), Err(overrun));
        port.release().done();
    }

    #[test]
    fn all_is_sent() {
        let full = |byte| Transaction::write_error(byte, nb::Error::WouldBlock);
        let sent = [1, 2, 3].map(|byte| [full(byte), Transaction::write(byte)]);
        let script: Vec<_> = sent
            .into_iter()
            .flatten()
            .chain([Transaction::flush()])
            .collect();
        let mut port = Peek::new(Mock::new(&script));
        assert_eq!(port.write(&[1, 2, 3]), Ok(3));
        assert_eq!(port.flush(), Ok(()));
        port.release().done();
    }
}
