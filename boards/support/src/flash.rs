//! Which part of a board's flash is whose: for the image, for the linker's `memory.x`, and for the
//! tools that write configuration pages.

use node_firmware::run::Layout;

/// What is the node's own in the flash of the nRF52840: its last nine pages. `memory.x` keeps images
/// out of them.
///
/// | address | bytes | what |
/// |---|---|---|
/// | 0x000f7000 | 16 KiB | what the role must not forget |
/// | 0x000fb000 | 16 KiB | what the link must not forget |
/// | 0x000ff000 | 4 KiB | the configuration page, written by a programmer |
pub const NRF52840: Regions = Regions {
    layout: Layout {
        memory: 0x000f_7000..0x000f_b000,
        link: 0x000f_b000..0x000f_f000,
    },
    config: 0x000f_f000,
    end: 0x0010_0000,
};

/// Where the emulator of the mps2-an386 loads the configuration page: into the last page of the
/// 4 MiB of code memory (ARM application note 386, "Memory map").
pub const MPS2_AN386_CONFIG: u32 = 0x003f_f000;

/// Addresses of the parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Regions {
    /// What the node writes.
    pub layout: Layout,
    /// The configuration page.
    pub config: u32,
    /// The first address behind the flash.
    pub end: u32,
}

impl Regions {
    /// Where images end at the latest.
    pub fn image_end(&self) -> u32 {
        self.layout.memory.start.min(self.layout.link.start)
    }

    /// The first address and the number of bytes that the node writes.
    pub fn memory(&self) -> (u32, u32) {
        let start = self.image_end();
        let end = self.layout.memory.end.max(self.layout.link.end);
        (start, end.saturating_sub(start))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `LENGTH` of the region `FLASH`, which begins at 0.
    fn flash_of_linker() -> u32 {
        let script = include_str!("../../../memory.x");
        let line = script.lines().find(|line| line.contains("FLASH (rx)"));
        let (start, length) = line
            .and_then(|line| line.split_once("ORIGIN = "))
            .and_then(|(_, rest)| rest.split_once(", LENGTH = "))
            .unwrap();
        assert_eq!(start, "0x00000000");
        let kib: u32 = length.trim().strip_suffix('K').unwrap().parse().unwrap();
        kib * 1024
    }

    #[test]
    fn the_linker_keeps_images_out() {
        assert_eq!(flash_of_linker(), NRF52840.image_end());
    }

    /// Product Specification, "NVMC": pages of 4 KiB, 256 of them.
    #[test]
    fn regions_are_pages_one_behind_the_other() {
        let Layout { memory, link } = NRF52840.layout;
        for address in [
            memory.start,
            memory.end,
            link.start,
            link.end,
            NRF52840.config,
        ] {
            assert_eq!(address % 4096, 0);
        }
        assert_eq!((memory.end, link.end), (link.start, NRF52840.config));
        assert_eq!((NRF52840.config + 4096, NRF52840.end), (1 << 20, 1 << 20));
        assert_eq!(NRF52840.memory(), (0x000f_7000, 0x8000));
    }
}
