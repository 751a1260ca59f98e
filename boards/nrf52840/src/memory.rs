//! The flash, and the configuration in it. Its pages are those of [`board_support::flash`].

use board_support::flash::NRF52840;
use embassy_futures::yield_now;
use embassy_nrf::{
    Peri,
    nvmc::{Error, FLASH_SIZE, Nvmc, PAGE_SIZE},
    peripherals,
};
use embedded_storage::nor_flash::{self, ErrorType, NorFlashErrorKind};
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use node_firmware::config::{
    Config,
    page::{self, PageError},
};

// The chip has the flash that is divided there.
const _: () = assert!(NRF52840.end as usize == FLASH_SIZE);
const _: () = assert!(NRF52840.config as usize == FLASH_SIZE - PAGE_SIZE);

/// The flash. Erasing a page stops the processor for up to 85 ms (Product Specification, "NVMC").
/// What the UART receives meanwhile goes to memory without it, and so does one frame of the radio;
/// later frames are lost as on the air. After each page the other tasks run.
pub(crate) struct Flash(Nvmc<'static>);

impl ErrorType for Flash {
    type Error = Error;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = <Nvmc<'static> as nor_flash::ReadNorFlash>::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        nor_flash::ReadNorFlash::read(&mut self.0, offset, bytes)
    }

    fn capacity(&self) -> usize {
        nor_flash::ReadNorFlash::capacity(&self.0)
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = <Nvmc<'static> as nor_flash::NorFlash>::WRITE_SIZE;
    const ERASE_SIZE: usize = PAGE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        nor_flash::check_erase(&self.0, from, to).map_err(|kind| match kind {
            NorFlashErrorKind::OutOfBounds => Error::OutOfBounds,
            _ => Error::Unaligned,
        })?;
        for page in (from..to).step_by(PAGE_SIZE) {
            nor_flash::NorFlash::erase(&mut self.0, page, page + PAGE_SIZE as u32)?;
            yield_now().await;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        nor_flash::NorFlash::write(&mut self.0, offset, bytes)
    }
}

/// The flash and the configuration in it.
pub(crate) fn open(flash: Peri<'static, peripherals::NVMC>) -> (Flash, Result<Config, PageError>) {
    let mut flash = Nvmc::new(flash);
    let config = read_config(&mut flash);
    (Flash(flash), config)
}

fn read_config(flash: &mut Nvmc<'static>) -> Result<Config, PageError> {
    let mut bytes = [0; page::PAGE_MAX];
    // Within the flash.
    let read = nor_flash::ReadNorFlash::read(flash, NRF52840.config, &mut bytes);
    read.map_err(|_| PageError::Truncated)?;
    page::decode(&bytes)
}
