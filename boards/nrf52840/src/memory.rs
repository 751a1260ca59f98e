//! The flash. Its pages are those of [`board_support::flash`].

use board_support::{flash::NRF52840, memory::Paged};
use embassy_nrf::nvmc::{FLASH_SIZE, Nvmc, PAGE_SIZE};

// The chip has the flash that is divided there.
const _: () = assert!(NRF52840.end as usize == FLASH_SIZE);
const _: () = assert!(NRF52840.config as usize == FLASH_SIZE - PAGE_SIZE);

/// The flash. Erasing a page stops the processor for up to 85 ms (Product Specification, "NVMC"). Bytes that the
/// UART receives meanwhile go to memory without it, and so does one frame of the radio; later frames are lost as
/// on the air.
pub(crate) type Flash = Paged<Nvmc<'static>>;
