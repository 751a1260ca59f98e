//! Registers of peripherals.
#![allow(unsafe_code, reason = "registers are memory outside the language")]

/// A peripheral at an address.
#[derive(Clone, Copy)]
pub(crate) struct Block(usize);

impl Block {
    /// # Safety
    /// At this address and the 4 KiB after it are registers of a peripheral of this board, and reading
    /// or writing them has no effect on memory.
    pub(crate) const unsafe fn new(address: usize) -> Self {
        Self(address)
    }

    /// Reads the register at this offset, below 4096.
    pub(crate) fn read(self, offset: u16) -> u32 {
        // SAFETY: see `new`; the offset is aligned by the callers' constants.
        unsafe { self.at(offset).read_volatile() }
    }

    /// Writes the register at this offset, below 4096.
    pub(crate) fn write(self, offset: u16, value: u32) {
        // SAFETY: see `new`.
        unsafe { self.at(offset).write_volatile(value) }
    }

    const fn at(self, offset: u16) -> *mut u32 {
        // Whole words, and not beyond the peripheral.
        (self.0 + (offset as usize & 0xffc)) as *mut u32
    }
}

macro_rules! peripherals {
    ($($name:ident = $address:literal, $what:literal;)*) => { $(
        #[doc = $what]
        // SAFETY: ARM application note 386, "Memory map": there it is. It has no DMA.
        pub(crate) const $name: Block = unsafe { Block::new($address) };
    )* };
}

peripherals! {
    TIMER0 = 0x4000_0000, "CMSDK timer.";
    TIMER1 = 0x4000_1000, "CMSDK timer.";
    UART0 = 0x4000_4000, "CMSDK UART.";
    UART1 = 0x4000_5000, "CMSDK UART.";
    UART2 = 0x4000_6000, "CMSDK UART.";
}
