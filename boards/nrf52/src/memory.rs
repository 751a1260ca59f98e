//! The flash. The owners of its parts are those of [`board_facts`].

use board_support::memory::Paged;
use embassy_nrf::nvmc::Nvmc;

/// The flash. Erasing a page stops the processor for up to 85 ms (Product Specification, "NVMC"). Bytes that the
/// UART receives meanwhile go to memory without it, and so does one frame of the radio; later frames are lost as
/// on the air.
pub(crate) type Flash = Paged<Nvmc<'static>>;
