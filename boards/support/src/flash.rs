//! Owners of the parts of a board's flash: for the image, for the linker's `memory.x`, and for the tools that
//! write configuration pages.

use node_firmware::hardware::FlashLayout;

/// The node's own part of the flash of the nRF52840: its last nineteen pages of 4 KiB. `memory.x` keeps images out
/// of them.
///
/// | address | bytes | what |
/// |---|---|---|
/// | 0x000ed000 | 56 KiB | what the role must not forget |
/// | 0x000fb000 | 16 KiB | what the link must not forget |
/// | 0x000ff000 | 4 KiB | the configuration page, written by a programmer |
pub const NRF52840: Regions = Regions {
    start: 0,
    layout: FlashLayout {
        facts: 0x000e_d000..0x000f_b000,
        link: 0x000f_b000..0x000f_f000,
    },
    config: 0x000f_f000,
    end: 0x0010_0000,
};

/// The node's own part of the flash of the STM32L476RG: its last 37 pages of 2 KiB. The `memory.x` of the board
/// keeps images out of them, and out of their bank.
///
/// | address | bytes | what |
/// |---|---|---|
/// | 0x080ed800 | 56 KiB | what the role must not forget |
/// | 0x080fb800 | 16 KiB | what the link must not forget |
/// | 0x080ff800 | 2 KiB | the configuration page, written by a programmer |
pub const STM32L476RG: Regions = Regions {
    start: 0x0800_0000,
    layout: FlashLayout {
        facts: 0x000e_d800..0x000f_b800,
        link: 0x000f_b800..0x000f_f800,
    },
    config: 0x000f_f800,
    end: 0x0010_0000,
};

/// The parts, in bytes from the start of the flash, as drivers count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Regions {
    /// The address at which the processor, and a programmer, see the start of the flash.
    pub start: u32,
    /// Part that the node writes.
    pub layout: FlashLayout,
    /// The configuration page.
    pub config: u32,
    /// The first byte behind the flash.
    pub end: u32,
}

impl Regions {
    /// The address where images end at the latest.
    pub fn image_end(&self) -> u32 {
        self.start + self.layout.facts.start.min(self.layout.link.start)
    }

    /// The first address and the number of bytes that the node writes.
    pub fn memory(&self) -> (u32, u32) {
        let start = self.image_end();
        let end = self.start + self.layout.facts.end.max(self.layout.link.end);
        (start, end.saturating_sub(start))
    }

    /// The address of the configuration page.
    pub fn config_address(&self) -> u32 {
        self.start + self.config
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `ORIGIN` and `LENGTH` of a region.
    fn region(script: &str, name: &str) -> (u32, u32) {
        let line = script.lines().find(|line| line.contains(name));
        let (start, length) = line
            .and_then(|line| line.split_once("ORIGIN = "))
            .and_then(|(_, rest)| rest.split_once(", LENGTH = "))
            .unwrap();
        let start = u32::from_str_radix(start.strip_prefix("0x").unwrap(), 16).unwrap();
        let kib: u32 = length.trim().strip_suffix('K').unwrap().parse().unwrap();
        (start, kib * 1024)
    }

    #[test]
    fn the_linker_keeps_images_out() {
        let script = include_str!("../../../memory.x");
        let (start, length) = region(script, "FLASH (rx)");
        assert_eq!((start, length), (NRF52840.start, NRF52840.image_end()));
    }

    /// Reference manual RM0351, "FLASH main features": two banks of 512 KiB. While the node writes to
    /// the second one, it runs from the first one.
    #[test]
    fn the_linker_keeps_images_in_another_bank() {
        let script = include_str!("../../nucleo-l476rg/memory.x");
        let (start, length) = region(script, "FLASH (rx)");
        let bank = 512 * 1024;
        assert_eq!((start, length), (STM32L476RG.start, bank));
        assert!(STM32L476RG.image_end() >= start + bank);
        // Data sheet, "Memory mapping": SRAM1.
        assert_eq!(region(script, "RAM   (rwx)"), (0x2000_0000, 96 * 1024));
    }

    /// Pages and their number: nRF52840 Product Specification, "NVMC"; RM0351, "FLASH main features".
    #[test]
    fn regions_are_pages_one_behind_the_other() {
        for (regions, page) in [(&NRF52840, 4096), (&STM32L476RG, 2048)] {
            let FlashLayout { facts, link } = &regions.layout;
            for (part, len) in [(facts, node_firmware::facts::BYTES), (link, 0x4000)] {
                // An even number of pages, and the same for both chips.
                assert_eq!((part.start % page, part.len()), (0, len as usize));
                assert!(len.is_multiple_of(2 * page));
            }
            assert_eq!((facts.end, link.end), (link.start, regions.config));
            assert_eq!((regions.config + page, regions.end), (1 << 20, 1 << 20));
        }
        assert_eq!(NRF52840.memory(), (0x000e_d000, 0x1_2000));
        assert_eq!(NRF52840.config_address(), 0x000f_f000);
        assert_eq!(STM32L476RG.memory(), (0x080e_d800, 0x1_2000));
        assert_eq!(STM32L476RG.config_address(), 0x080f_f800);
    }
}
