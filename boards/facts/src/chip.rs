//! Chips.

/// A chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chip {
    /// Name in probe-rs.
    pub probe: &'static str,
    /// Its kin: chips whose debug ports are closed in the same way.
    pub family: Family,
    /// Address of its flash.
    pub flash: u32,
    /// Bytes of its flash.
    pub flash_bytes: u32,
    /// Bytes that are erased together.
    pub page: u32,
    /// Address and bytes of the RAM of an image.
    pub ram: (u32, u32),
}

/// Kin of a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Nordic's nRF52, with the radio on the chip.
    Nrf52,
    /// ST's STM32L4.
    Stm32l4,
}

/// Nordic's chip with 1 MiB of flash.
pub const NRF52840: Chip = Chip {
    probe: "nRF52840_xxAA",
    family: Family::Nrf52,
    flash: 0,
    flash_bytes: 1024 << 10,
    page: 4096,
    ram: (0x2000_0000, 256 << 10),
};

/// Nordic's chip with 512 KiB of flash.
pub const NRF52833: Chip = Chip {
    probe: "nRF52833_xxAA",
    flash_bytes: 512 << 10,
    ram: (0x2000_0000, 128 << 10),
    ..NRF52840
};

/// ST's chip, of whose RAM an image uses SRAM1.
pub const STM32L476RG: Chip = Chip {
    probe: "STM32L476RGTx",
    family: Family::Stm32l4,
    flash: 0x0800_0000,
    flash_bytes: 1024 << 10,
    page: 2048,
    ram: (0x2000_0000, 96 << 10),
};
