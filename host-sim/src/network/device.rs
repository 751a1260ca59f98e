//! Devices on a node's UART: a simulated line, or a real device.

use std::io;

use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use serialport::SerialPort;

use virtual_hardware::{executor::Clock, line, polled::Polled};

/// A real serial port whose calls do not wait.
pub(super) type Serial = Box<dyn SerialPort>;

/// The far end of a node's UART.
pub(super) enum Device {
    /// A simulated line.
    Line(line::Port),
    /// A real device, in real time.
    Real(Polled<Serial>),
}

impl Device {
    /// Another handle to an open port.
    pub(super) fn real(port: &Serial, clock: &Clock) -> io::Result<Self> {
        Ok(Self::Real(Polled::new(port.try_clone()?, clock.clone())))
    }
}

impl node_firmware::hardware::Line for Device {}

impl ErrorType for Device {
    type Error = ErrorKind;
}

fn kind(error: &impl embedded_io_async::Error) -> ErrorKind {
    error.kind()
}

impl Read for Device {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        match self {
            Self::Line(port) => port.read(buffer).await.map_err(|error| kind(&error)),
            Self::Real(port) => port.read(buffer).await.map_err(|error| kind(&error)),
        }
    }
}

impl Write for Device {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        match self {
            Self::Line(port) => port.write(bytes).await.map_err(|error| kind(&error)),
            Self::Real(port) => port.write(bytes).await.map_err(|error| kind(&error)),
        }
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        match self {
            Self::Line(port) => port.flush().await.map_err(|error| kind(&error)),
            Self::Real(port) => port.flush().await.map_err(|error| kind(&error)),
        }
    }
}
