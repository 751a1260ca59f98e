//! A board of one's own for a coordinator or a camera: every seam of such a node. Where a driver of the HAL would be awaited, this one waits for ever.

use core::future::{Future, pending};

use embedded_io_async::{ErrorKind, Read, Write};
use embedded_storage_async::nor_flash::{NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use node_firmware::{
    facts,
    hardware::{FlashLayout, Hardware, Indication, Indicator, Line, Peripherals},
};
use zigbee_link::{
    Instant,
    radio::{PSDU_MAX, Radio, RadioConfig, Received, TxOutcome},
    runner::Clock,
};

/// Bytes that the flash erases at once.
pub const PAGE: u32 = 4096;

/// A part of the hardware failed.
#[derive(Debug)]
pub struct Failed;

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// The line to the camera or the PC.
pub struct Uart;

impl Line for Uart {}

impl embedded_io_async::ErrorType for Uart {
    type Error = ErrorKind;
}

impl Read for Uart {
    async fn read(&mut self, _: &mut [u8]) -> Result<usize, ErrorKind> {
        pending().await
    }
}

impl Write for Uart {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

/// The radio.
pub struct Transceiver;

impl Radio for Transceiver {
    type Error = Failed;

    async fn configure(&mut self, _: &RadioConfig) -> Result<(), Failed> {
        Ok(())
    }

    async fn transmit(&mut self, _: &[u8]) -> Result<TxOutcome, Failed> {
        Ok(TxOutcome::Sent)
    }

    async fn receive(&mut self, _: &mut [u8; PSDU_MAX]) -> Result<Received, Failed> {
        pending().await
    }
}

/// The timer: everything else that needs the time gets it from here.
pub struct Ticks;

impl Clock for Ticks {
    fn now(&self) -> Instant {
        Instant(0)
    }

    fn sleep_until(&self, _: Instant) -> impl Future<Output = ()> {
        pending()
    }
}

/// The flash.
pub struct Flash;

impl embedded_storage_async::nor_flash::ErrorType for Flash {
    type Error = Failed;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 4;

    async fn read(&mut self, _: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        bytes.fill(0xFF);
        Ok(())
    }

    fn capacity(&self) -> usize {
        Board::LAYOUT.facts.end as usize
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE as usize;

    async fn erase(&mut self, _: u32, _: u32) -> Result<(), Failed> {
        Ok(())
    }

    async fn write(&mut self, _: u32, _: &[u8]) -> Result<(), Failed> {
        Ok(())
    }
}

/// A lamp.
pub struct Lamp;

impl Indicator for Lamp {
    fn show(&mut self, _: Indication) {}
}

/// Stands for the board: its drivers are named nowhere.
pub struct Board;

impl Board {
    const LAYOUT: FlashLayout = FlashLayout {
        link: 0..2 * PAGE,
        facts: 2 * PAGE..2 * PAGE + facts::BYTES,
    };

    /// All parts, with what a random number generator gave at this start.
    pub fn peripherals(seed: u64) -> Peripherals<impl Hardware> {
        Peripherals::new(Transceiver, Ticks, Flash, Self::LAYOUT, seed)
            .with_uart(Uart)
            .with_indicator(Lamp)
    }
}
