//! A log is opened over any contents of a flash, over and over: a record written then is there, and stays when it
//! is opened again.
//!
//! The first byte: 1 the slots in which something stands have right checksums.

use std::convert::Infallible;

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use flash_log::{Crc32, Entry, Log, LogError};

const PAGE: usize = 128;
const SLOT: usize = 32;

struct Flash([u8; 4 * PAGE]);

impl ErrorType for Flash {
    type Error = Infallible;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 4;

    async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        bytes.copy_from_slice(&self.0[at as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        self.0[from as usize..to as usize].fill(0xFF);
        Ok(())
    }

    async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), Infallible> {
        for (place, byte) in self.0[at as usize..].iter_mut().zip(bytes) {
            assert!(*place == 0xFF, "written twice");
            *place = *byte;
        }
        Ok(())
    }
}

/// Tries one input.
pub(crate) fn run(bytes: &[u8]) {
    let [kind, contents @ ..] = bytes else { return };
    let mut flash = Flash([0xFF; 4 * PAGE]);
    for (place, byte) in flash.0.iter_mut().zip(contents) {
        *place = *byte;
    }
    if kind & 1 != 0 {
        for slot in flash.0.as_chunks_mut::<SLOT>().0 {
            if slot.iter().any(|byte| *byte != 0xFF) {
                slot[0] = 1;
                let sum = Crc32::of(&slot[..SLOT - 4]);
                slot[SLOT - 4..].copy_from_slice(&sum.to_le_bytes());
            }
        }
    }
    block_on(check(flash));
}

async fn check(flash: Flash) {
    let end = flash.0.len() as u32;
    {
        // A user that must not lose anything is told, or has it.
        let mut log = Log::<_, SLOT>::new(Flash(flash.0), 0..end).expect("it fits");
        let _ = log.recover(|_, _| ()).await;
    }
    let mut log = Log::<_, SLOT>::new(flash, 0..end).expect("it fits");
    if log.open().await.is_err() {
        return;
    }
    for round in 0..12_u8 {
        let entry = Entry::new(round % 3, &[round; 20]).expect("it fits");
        match log.append(&entry).await {
            Ok(()) => {
                assert_eq!(log.find(round % 3).await, Ok(Some(entry)));
                log = Log::new(log.into_flash(), 0..end).expect("it fits");
                log.open().await.expect("it was open before");
                assert_eq!(log.find(round % 3).await, Ok(Some(entry)));
            }
            Err(LogError::Full) => return,
            Err(error) => panic!("{error:?}"),
        }
    }
}
