//! Hardware that the compiler knows nothing about.

use core::{
    future::{Future, ready},
    hint::black_box,
};

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use zigbee_link::{
    Instant,
    radio::{Channel, PSDU_MAX, Radio, RadioConfig, Received, TxOutcome},
    runner::Clock,
};

/// The end of an image.
pub fn idle() -> ! {
    loop {
        black_box(());
    }
}

/// Error of any hardware.
#[derive(Debug)]
pub(crate) struct Failed;

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

fn outcome<T>(good: T) -> Result<T, Failed> {
    if black_box(true) {
        Ok(good)
    } else {
        Err(Failed)
    }
}

/// A flash as the nRF52840's.
pub(crate) struct Flash;

/// 16 KiB.
pub(crate) const FLASH_LEN: u32 = 4 * 4096;

impl ErrorType for Flash {
    type Error = Failed;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 4;

    async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        black_box((at, bytes));
        outcome(())
    }

    fn capacity(&self) -> usize {
        FLASH_LEN as usize
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = 4096;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        black_box((from, to));
        outcome(())
    }

    async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), Failed> {
        black_box((at, bytes));
        outcome(())
    }
}

/// A radio that does everything itself, as the nRF52840's with its driver.
pub(crate) struct Transceiver;

impl Radio for Transceiver {
    type Error = Failed;

    async fn configure(&mut self, config: &RadioConfig) -> Result<(), Failed> {
        black_box(config);
        outcome(())
    }

    async fn transmit(&mut self, frame: &[u8]) -> Result<TxOutcome, Failed> {
        black_box(frame);
        outcome(TxOutcome::Sent)
    }

    async fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Result<Received, Failed> {
        outcome(Received {
            len: black_box(buffer).len(),
            channel: Channel::FIRST,
            rssi: None,
            lqi: None,
        })
    }
}

pub(crate) struct Timer;

impl Clock for Timer {
    fn now(&self) -> Instant {
        Instant(black_box(0))
    }

    fn sleep_until(&self, time: Instant) -> impl Future<Output = ()> {
        black_box(time);
        ready(())
    }
}
