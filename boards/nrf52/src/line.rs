//! The UART to the camera or the PC, without lost bytes.

use board_support::{last_words::LastWords, retained::say_and_restart};
use embassy_nrf::buffered_uarte::{BufferedUarte, Error};
use embedded_io_async::{ErrorType, Read, Write};

/// A UART that restarts the node where bytes were lost.
///
/// The driver finds its place in the ring by counting all bytes that arrive, also those for which
/// there was no room: after an overrun it would return old bytes for new ones for ever. The ring is
/// long enough that this does not happen at the rates of a camera.
pub struct Lossless(pub(crate) BufferedUarte<'static>);

impl ErrorType for Lossless {
    type Error = Error;
}

impl Read for Lossless {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Error> {
        match self.0.read(buffer).await {
            Err(Error::Overrun) => say_and_restart(LastWords::decision("the UART lost bytes")),
            result => result,
        }
    }
}

impl Write for Lossless {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        self.0.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), Error> {
        self.0.flush().await
    }
}
