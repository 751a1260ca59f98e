//! Boards on which a node runs: their chips, the owners of the parts of their flash, and the way to flash them.
//!
//! Each fact is here and nowhere else: the linker's script, the image's own memory, the checks of images, and the
//! tools that flash are made of it. The pins of a board are in its folder.
//!
//! | module | |
//! |---|---|
//! | [`chip`] | chips, and their memories |
//! | [`regions`] | owners of the parts of a flash |
//! | `link` | the linker's view of a board; with the feature of that name, for build scripts |
#![no_std]
#![forbid(unsafe_code)]

#[cfg(any(test, feature = "link"))]
extern crate std;

pub mod chip;
#[cfg(feature = "link")]
mod link;
pub mod regions;
mod script;

#[cfg(feature = "link")]
pub use link::{link, link_loader, memory};

use chip::{Chip, NRF52833, NRF52840, STM32L476RG};
use regions::{Regions, Updated};
pub use script::Script;

/// A board.
#[derive(Debug)]
pub struct Board {
    /// Name of its folder, its package and its image, and its name on the command line.
    pub name: &'static str,
    /// Name by which its maker sells it.
    pub title: &'static str,
    /// Its chip.
    pub chip: &'static Chip,
    /// Owners of the parts of its flash.
    pub regions: Regions,
    /// The boot loader that it is sold with, if any.
    pub loader: Option<Loader>,
    /// Parts of its flash where it is updated by radio, if it can be.
    pub updated: Option<Updated>,
}

/// Place of the public key with which a node checks images: behind the longest configuration page.
pub const KEY_BEHIND_CONFIG: u32 = 512;

/// Seconds after which a watchdog restarts a node. Watched tasks report every second; none of their work takes as
/// long as this.
pub const WATCHDOG_S: u32 = 8;

/// A boot loader, which takes an image over the USB plug of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loader {
    /// Shows a volume, to which a file is copied (UF2).
    Uf2 {
        /// Number that the blocks of the file must have.
        family: u32,
        /// `Board-ID` in the file `INFO_UF2.TXT` of the volume begins with one of these.
        ids: &'static [&'static str],
        /// The `SoftDevice` behind which an image begins, its name and its version. That file has it so, or with the
        /// word `version` between both.
        soft_device: &'static str,
        /// Action that starts it.
        press: &'static str,
    },
    /// Takes a package over a serial line (Nordic's DFU).
    Dfu {
        /// `hw_version` that it demands.
        hardware: u32,
        /// Vendor and product of its USB device.
        usb: (u16, u16),
        /// Action that starts it.
        press: &'static str,
    },
}

impl Board {
    /// The board of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        BOARDS.iter().find(|board| board.name == name).copied()
    }

    /// The address of a place in its flash.
    pub const fn address(&self, place: u32) -> u32 {
        self.chip.flash + place
    }

    /// The first address and the number of bytes that the node writes.
    pub fn memory(&self) -> (u32, u32) {
        let Regions { facts, link, .. } = &self.regions;
        (self.address(facts.start), link.end - facts.start)
    }

    /// The region of an image that is updated by radio, or of another one.
    pub const fn image(&self, is_updated: bool) -> &core::ops::Range<u32> {
        match &self.updated {
            Some(updated) if is_updated => &updated.image,
            _ => &self.regions.image,
        }
    }

    /// The address of the configuration page.
    pub const fn config(&self) -> u32 {
        self.address(self.regions.config.start)
    }
}

/// Family of the nRF52840 in UF2 files (Adafruit's boot loader, `CFG_UF2_FAMILY_APP_ID`).
const ADAFRUIT_NRF52840: u32 = 0xada5_2840;

/// Nordic's development kit, with a debug probe.
pub const NRF52840_DK: Board = Board {
    name: "nrf52840",
    title: "nRF52840-DK",
    chip: &NRF52840,
    regions: Regions::nrf52(0..0x000e_d000, 0x000e_d000, 0x000f_f000),
    loader: None,
    updated: Some(Updated::nrf52(384 << 10)),
};

/// Nordic's dongle.
///
/// Its boot loader begins at 0xe0000, and the page before 0x1000 is the master boot record. The loader writes a new
/// image behind the old one before it takes it: so much is kept free behind the image. It takes one piece only, so
/// that the configuration is within the image, behind the table of vectors.
pub const PCA10059: Board = Board {
    name: "pca10059",
    title: "nRF52840 dongle (PCA10059)",
    chip: &NRF52840,
    regions: Regions {
        config: 0x1200..0x1400,
        ..Regions::nrf52(0x1000..0x0006_7000, 0x000c_e000, 0)
    },
    loader: Some(Loader::Dfu {
        hardware: 52,
        usb: (0x1915, 0x521f),
        press: "press its reset button, the one that lies on its side: its red lamp pulses",
    }),
    updated: None,
};

/// Adafruit's board. Its `SoftDevice` ends at 0x26000.
pub const FEATHER_NRF52840: Board = Board {
    name: "feather-nrf52840",
    title: "Adafruit Feather nRF52840 Express",
    chip: &NRF52840,
    regions: Regions::uf2(0x0002_6000),
    loader: Some(Loader::Uf2 {
        family: ADAFRUIT_NRF52840,
        ids: &["nRF52840-Feather-"],
        soft_device: "S140 6.1.1",
        press: "press its button RESET twice, quickly",
    }),
    updated: None,
};

/// Seeed's board, and its variant with sensors. Its `SoftDevice` ends at 0x27000.
pub const XIAO_NRF52840: Board = Board {
    name: "xiao-nrf52840",
    title: "Seeed XIAO nRF52840",
    chip: &NRF52840,
    regions: Regions::uf2(0x0002_7000),
    loader: Some(Loader::Uf2 {
        family: ADAFRUIT_NRF52840,
        ids: &["nRF52840-SeeedXiao", "Seeed_XIAO_nRF52840"],
        soft_device: "S140 7.3.0",
        press: "press its button RST twice, quickly",
    }),
    updated: None,
};

/// Nordic's development kit of the smaller chip, with a debug probe.
pub const NRF52833_DK: Board = Board {
    name: "nrf52833",
    title: "nRF52833-DK",
    chip: &NRF52833,
    regions: Regions::nrf52(0..0x0006_d000, 0x0006_d000, 0x0007_f000),
    loader: None,
    updated: None,
};

/// ST's board, with a debug probe, beside a radio co-processor.
///
/// The image is in the first bank, and all that is written while it runs in the second one.
pub const NUCLEO_L476RG: Board = Board {
    name: "nucleo-l476rg",
    title: "NUCLEO-L476RG",
    chip: &STM32L476RG,
    regions: Regions {
        image: 0..0x0008_0000,
        facts: 0x000e_d800..0x000f_b800,
        link: 0x000f_b800..0x000f_f800,
        config: 0x000f_f800..0x0010_0000,
    },
    loader: None,
    updated: None,
};

/// All boards.
pub const BOARDS: [&Board; 6] = [
    &NRF52840_DK,
    &PCA10059,
    &FEATHER_NRF52840,
    &XIAO_NRF52840,
    &NRF52833_DK,
    &NUCLEO_L476RG,
];

#[cfg(test)]
mod tests {
    use core::ops::Range;
    use std::{collections::BTreeSet, fs, path::Path, vec, vec::Vec};

    use super::*;

    /// Parts of the flash that are another program's.
    fn of_others(board: &Board) -> Vec<Range<u32>> {
        match board.loader {
            None => vec![],
            // Adafruit's boot loader, `dfu_types.h`: master boot record and SoftDevice (of which the end is checked
            // below), boot loader and its settings.
            Some(Loader::Uf2 { .. }) => vec![0..0x0002_6000, 0x000f_4000..0x0010_0000],
            // Nordic's SDK, `open_bootloader/pca10059_usb`: master boot record; boot loader and its settings.
            Some(Loader::Dfu { .. }) => vec![0..0x1000, 0x000e_0000..0x0010_0000],
        }
    }

    fn meet(one: &Range<u32>, other: &Range<u32>) -> bool {
        one.start < other.end && other.start < one.end
    }

    #[test]
    fn every_part_has_one_owner() {
        for board in BOARDS {
            let Regions {
                image,
                facts,
                link,
                config,
            } = &board.regions;
            let mut parts = of_others(board);
            parts.extend([image, facts, link].map(Clone::clone));
            // Of a package in one piece it is a part.
            let is_in_image = image.start < config.start && config.end <= image.end;
            if !is_in_image {
                parts.push(config.clone());
            }
            for (number, part) in parts.iter().enumerate() {
                let name = board.name;
                assert!(part.start < part.end, "{name}: {part:x?}");
                assert!(part.end <= board.chip.flash_bytes, "{name}: {part:x?}");
                for other in &parts[number + 1..] {
                    assert!(!meet(part, other), "{name}: {part:x?}, {other:x?}");
                }
            }
            // What is erased is whole pages, of which no other part has a piece.
            let page = board.chip.page;
            for place in [facts.start, facts.end, link.end, image.start] {
                assert!(place.is_multiple_of(page), "{}: {place:x}", board.name);
            }
            assert_eq!(
                (facts.end, facts.len(), link.len()),
                (link.start, 0xe000, 0x4000)
            );
            assert!(is_in_image || config.start.is_multiple_of(page));
            // `node_firmware::config::page::PAGE_MAX`.
            assert!(config.len() >= 512, "{}", board.name);
        }
    }

    /// Flash and pages: nRF52840 and nRF52833 Product Specifications, "NVMC"; RM0351, "FLASH main features". RAM:
    /// the same, "Memory"; of the STM32 SRAM1.
    #[test]
    fn chips_have_these_memories() {
        for (board, flash, ram) in [
            (NRF52840_DK, (0, 1024, 4), (0x2000_0000, 256)),
            (NRF52833_DK, (0, 512, 4), (0x2000_0000, 128)),
            (NUCLEO_L476RG, (0x0800_0000, 1024, 2), (0x2000_0000, 96)),
        ] {
            let Chip {
                flash: start,
                flash_bytes,
                page,
                ram: (ram_start, ram_bytes),
                ..
            } = *board.chip;
            assert_eq!((start, flash_bytes >> 10, page >> 10), flash);
            assert_eq!((ram_start, ram_bytes >> 10), ram);
        }
    }

    /// Parts for updates: whole pages, none of which is another's, before the memory of the node; the spare part is a
    /// page longer than the image, and the state of the loader has a word for each copy (`embassy-boot`).
    #[test]
    fn an_updated_board_has_room_for_two_images() {
        for board in BOARDS {
            let Some(updated) = &board.updated else {
                continue;
            };
            let Updated {
                loader,
                state,
                image,
                spare,
                header,
            } = updated;
            let page = board.chip.page;
            let parts = [loader, state, image, spare, header];
            for (number, part) in parts.iter().enumerate() {
                assert!(part.start.is_multiple_of(page) && part.end.is_multiple_of(page));
                assert!(part.start < part.end && part.end <= board.regions.facts.start);
                for other in &parts[number + 1..] {
                    assert!(!meet(part, other), "{part:x?}, {other:x?}");
                }
            }
            assert_eq!(spare.len(), image.len() + page as usize);
            assert!(2 + 4 * (image.len() / page as usize) <= state.len() / 4);
            assert_eq!((state.len(), header.len()), (page as usize, page as usize));
            assert!(board.regions.config.len() >= KEY_BEHIND_CONFIG as usize + 64);
        }
    }

    /// The loader of a dongle writes a new image behind the old one.
    #[test]
    fn a_dongle_has_room_for_a_second_image() {
        let Regions { image, facts, .. } = PCA10059.regions;
        assert!(image.end + (image.end - image.start) <= facts.start);
    }

    /// Older boot loaders of Adafruit take nothing from 0xad000 on (`uf2.h`, `USER_FLASH_END`).
    #[test]
    fn all_boot_loaders_write_all_of_a_uf2_board() {
        for board in [&FEATHER_NRF52840, &XIAO_NRF52840] {
            assert!(board.regions.config.end <= 0x000a_d000);
        }
        // S140 6.1.1 and 7.3.0.
        assert_eq!(FEATHER_NRF52840.regions.image.start, 0x0002_6000);
        assert_eq!(XIAO_NRF52840.regions.image.start, 0x0002_7000);
    }

    #[test]
    fn each_board_is_a_folder_of_its_name() {
        let boards = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        let mut names = BTreeSet::new();
        for board in BOARDS {
            assert!(names.insert(board.name));
            let manifest = boards.join(board.name).join("Cargo.toml");
            let manifest = fs::read_to_string(&manifest).expect(board.name);
            assert!(manifest.contains(&std::format!("name = \"{}\"", board.name)));
        }
        let folders = fs::read_dir(boards)
            .unwrap()
            .map(|entry| entry.unwrap().path());
        let images = folders
            .filter(|folder| folder.join("src/main.rs").is_file() && !folder.ends_with("loader"));
        assert_eq!(images.count(), BOARDS.len());
    }
}
