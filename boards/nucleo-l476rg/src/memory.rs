//! The flash. The owners of its parts are those of [`board_facts`].

use board_facts::NUCLEO_L476RG;
use board_support::{last_words::LastWords, memory::Paged, retained::say_and_restart};
use cortex_m_rt::exception;
use embassy_stm32::{
    Peri,
    flash::{self, Blocking, FLASH_BASE, FLASH_SIZE, MAX_ERASE_SIZE},
    pac::FLASH,
    peripherals,
};

// The chip has the flash that is divided there.
const _: () = assert!(NUCLEO_L476RG.chip.flash as usize == FLASH_BASE);
const _: () = assert!(NUCLEO_L476RG.chip.flash_bytes as usize == FLASH_SIZE);
const _: () = assert!(NUCLEO_L476RG.chip.page as usize == MAX_ERASE_SIZE);

/// The flash. Erasing a page stops the program for up to 25 ms, but no interrupt: the program is in
/// the other bank.
pub(crate) type Flash = Paged<flash::Flash<'static, Blocking>>;

/// The driver of the flash.
pub(crate) fn open(flash: Peri<'static, peripherals::FLASH>) -> flash::Flash<'static, Blocking> {
    // The cache of data knows nothing of what is erased, and writing to one bank while the program
    // reads from the other can spoil it (errata sheet ES0250, "Data cache might be corrupted during
    // Flash memory read while write operation").
    FLASH.acr().modify(|access| access.set_dcen(false));
    flash::Flash::new_blocking(flash)
}

/// Among others, a word read from the flash has two wrong bits. Where power was lost in the middle of a write this
/// is no surprise, and the store can handle such bytes.
#[allow(unsafe_code, reason = "an exception")]
#[exception]
unsafe fn NonMaskableInt() {
    let error = FLASH.eccr().read();
    // The program is in the first bank.
    if !(error.eccd() && error.bk_ecc()) {
        say_and_restart(LastWords::decision("not maskable interrupt"));
    }
    // Writing it back clears it.
    FLASH.eccr().write_value(error);
}
