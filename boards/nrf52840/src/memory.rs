//! The pages of the flash that are the node's own, at its end. `regions.x` keeps the image out.
//!
//! | address | bytes | what |
//! |---|---|---|
//! | 0x000f7000 | 16 KiB | what the role must not forget |
//! | 0x000fb000 | 16 KiB | what the link must not forget |
//! | 0x000ff000 | 4 KiB | configuration, written by a programmer |

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_nrf::{
    Peri,
    nvmc::{FLASH_SIZE, Nvmc, PAGE_SIZE},
    peripherals,
};
use embedded_storage::nor_flash::ReadNorFlash as _;
use node_firmware::{
    config::{
        Config,
        page::{self, PageError},
    },
    run::Layout,
};

const PAGE: u32 = PAGE_SIZE as u32;
const CONFIG: u32 = FLASH_SIZE as u32 - PAGE;
const RANGE: u32 = 4 * PAGE;
const LINK: u32 = CONFIG - RANGE;
const MEMORY: u32 = LINK - RANGE;

/// Where a node keeps what it must not forget.
pub(crate) const LAYOUT: Layout = Layout {
    link: LINK..LINK + RANGE,
    memory: MEMORY..MEMORY + RANGE,
};

/// The flash. Erasing a page stops the processor for up to 85 ms; what the UART and the radio
/// receive meanwhile goes to memory without it.
pub(crate) type Flash = BlockingAsync<Nvmc<'static>>;

/// The flash and the configuration in it.
pub(crate) fn open(flash: Peri<'static, peripherals::NVMC>) -> (Flash, Result<Config, PageError>) {
    let mut flash = Nvmc::new(flash);
    let config = read_config(&mut flash);
    (BlockingAsync::new(flash), config)
}

fn read_config(flash: &mut Nvmc<'static>) -> Result<Config, PageError> {
    let mut bytes = [0; page::PAGE_MAX];
    // Within the flash.
    let read = flash.read(CONFIG, &mut bytes);
    read.map_err(|_| PageError::Truncated)?;
    page::decode(&bytes)
}
