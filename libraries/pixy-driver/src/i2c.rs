//! A Pixy2 on an I2C bus, in the place of a UART.
//!
//! In `PixyMon` (Configure, Interface) "Data out port" is then I2C, and the address is set there, too. The packets are
//! those of the UART. The camera gives bytes whenever it is asked: those of its answer, and zeros where there is none.

use embedded_hal::i2c::{ErrorKind, I2c};

/// Address of a Pixy2 as it is shipped.
pub const ADDRESS: u8 = 0x54;

/// Bytes that are read at once at most: as many as an answer of one block has.
const CHUNK: usize = 20;

/// A line to the camera on a bus: give it to [`Pixy`](crate::Pixy) as its UART. A bus that is shared is a device of
/// `embedded-hal-bus`.
#[derive(Debug)]
pub struct I2cLine<B> {
    bus: B,
    address: u8,
    /// The bus was asked since the last pause.
    was_asked: bool,
}

impl<B> I2cLine<B> {
    /// A line to the camera of this address.
    pub const fn new(bus: B, address: u8) -> Self {
        Self {
            bus,
            address,
            was_asked: false,
        }
    }

    /// The bus.
    pub fn release(self) -> B {
        self.bus
    }
}

/// Reason why the bus failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BusError(#[cfg_attr(feature = "defmt", defmt(Debug2Format))] pub ErrorKind);

impl core::fmt::Display for BusError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.fmt(f)
    }
}

impl core::error::Error for BusError {}

impl embedded_io::Error for BusError {
    fn kind(&self) -> embedded_io::ErrorKind {
        match self.0 {
            ErrorKind::NoAcknowledge(_) => embedded_io::ErrorKind::NotConnected,
            _ => embedded_io::ErrorKind::Other,
        }
    }
}

fn failed(error: &impl embedded_hal::i2c::Error) -> BusError {
    BusError(error.kind())
}

impl<B> embedded_io::ErrorType for I2cLine<B> {
    type Error = BusError;
}

impl<B: I2c> embedded_io::Read for I2cLine<B> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, BusError> {
        self.was_asked = true;
        let length = buffer.len().min(CHUNK);
        let part = buffer.get_mut(..length).unwrap_or_default();
        self.bus
            .read(self.address, part)
            .map_err(|error| failed(&error))?;
        Ok(length)
    }
}

impl<B> embedded_io::ReadReady for I2cLine<B> {
    /// The camera always gives bytes. A pause comes between two questions, so that time passes.
    fn read_ready(&mut self) -> Result<bool, BusError> {
        Ok(!core::mem::take(&mut self.was_asked))
    }
}

impl<B: I2c> embedded_io::Write for I2cLine<B> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, BusError> {
        self.bus
            .write(self.address, bytes)
            .map_err(|error| failed(&error))?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), BusError> {
        Ok(())
    }
}

impl<B: embedded_hal_async::i2c::I2c> embedded_io_async::Read for I2cLine<B> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, BusError> {
        let length = buffer.len().min(CHUNK);
        let part = buffer.get_mut(..length).unwrap_or_default();
        self.bus
            .read(self.address, part)
            .await
            .map_err(|error| failed(&error))?;
        Ok(length)
    }
}

impl<B: embedded_hal_async::i2c::I2c> embedded_io_async::Write for I2cLine<B> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, BusError> {
        self.bus
            .write(self.address, bytes)
            .await
            .map_err(|error| failed(&error))?;
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), BusError> {
        Ok(())
    }
}
