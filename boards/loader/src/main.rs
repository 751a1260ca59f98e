//! The boot loader of an nRF52840 that is updated by radio: `embassy-boot` over the parts of the board's flash.
//!
//! It changes images when the node has asked for that, goes back where the new image did not say that it found its
//! network, and starts the image. A loss of power at any moment costs nothing: it goes on at the next start.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]

#[cfg(target_os = "none")]
mod on_board {
    use core::{ops::Range, panic::PanicInfo};

    use board_facts::{NRF52840_DK, WATCHDOG_S, regions::Updated};
    use cortex_m::peripheral::SCB;
    use embassy_boot::{AlignedBuffer, BootLoader, BootLoaderConfig, State};
    use embassy_nrf::{
        nvmc::{Error, Nvmc, PAGE_SIZE},
        pac::WDT,
    };
    use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

    /// Value that feeds the watchdog (Product Specification, "WDT", RR).
    const FEED: u32 = 0x6e52_4635;
    const LFCLK_HZ: u32 = 32_768;

    /// A part of the flash. The watchdog of the image goes on through a restart: whatever is written feeds it.
    struct Part {
        flash: Nvmc<'static>,
        range: Range<u32>,
    }

    fn feed() {
        WDT.rr(0).write(|register| register.0 = FEED);
    }

    impl Part {
        #[allow(
            unsafe_code,
            reason = "each part has the controller of the flash for itself"
        )]
        fn new(range: Range<u32>) -> Self {
            // SAFETY: there are no interrupts, and one part is used at a time.
            let peripherals = unsafe { embassy_nrf::Peripherals::steal() };
            Self {
                flash: Nvmc::new(peripherals.NVMC),
                range,
            }
        }
    }

    impl ErrorType for Part {
        type Error = Error;
    }

    impl ReadNorFlash for Part {
        const READ_SIZE: usize = <Nvmc<'static> as ReadNorFlash>::READ_SIZE;

        fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
            self.flash.read(self.range.start + offset, bytes)
        }

        fn capacity(&self) -> usize {
            self.range.len()
        }
    }

    impl NorFlash for Part {
        const WRITE_SIZE: usize = <Nvmc<'static> as NorFlash>::WRITE_SIZE;
        const ERASE_SIZE: usize = PAGE_SIZE;

        fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
            feed();
            let start = self.range.start;
            self.flash.erase(start + from, start + to)
        }

        fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
            feed();
            self.flash.write(self.range.start + offset, bytes)
        }
    }

    /// Starts the watchdog as the image does, for an image that does not come as far as that.
    fn watch() {
        if WDT.runstatus().read().runstatus() {
            return;
        }
        WDT.config().write(|config| {
            config.set_sleep(embassy_nrf::wdt::SleepConfig::Run);
            config.set_halt(embassy_nrf::wdt::HaltConfig::Pause);
        });
        WDT.crv().write_value(WATCHDOG_S * LFCLK_HZ);
        WDT.rren().write(|register| register.0 = 1);
        WDT.tasks_start().write_value(1);
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let Some(Updated {
            state,
            image,
            spare,
            ..
        }) = &NRF52840_DK.updated
        else {
            SCB::sys_reset()
        };
        let mut loader = BootLoader::new(BootLoaderConfig {
            active: Part::new(image.clone()),
            dfu: Part::new(spare.clone()),
            state: Part::new(state.clone()),
        });
        // A flash that fails is tried again: half an image is not to be started.
        let Ok(state) = loader.prepare_boot(&mut AlignedBuffer([0; PAGE_SIZE]).0) else {
            SCB::sys_reset()
        };
        if state == State::Swap {
            watch();
        }
        start(image.start)
    }

    /// Starts the image at an address.
    #[allow(unsafe_code, reason = "the image begins with its table of vectors")]
    fn start(address: u32) -> ! {
        // SAFETY: nothing of this program is used any more.
        unsafe {
            (*SCB::PTR).vtor.write(address);
            cortex_m::asm::bootload(address as *const u32)
        }
    }

    #[panic_handler]
    fn panic(_: &PanicInfo<'_>) -> ! {
        SCB::sys_reset()
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("a boot loader for an nRF52840: `cargo xtask firmware --update` makes it");
}
