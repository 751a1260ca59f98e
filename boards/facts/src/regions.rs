//! Owners of the parts of a flash.

use core::ops::Range;

/// Bytes of the role's memory, and of the link's.
const FACTS: u32 = 56 << 10;
const LINK: u32 = 16 << 10;
/// Bytes that an nRF52 erases together.
const PAGE: u32 = 4096;

/// The parts that are the node's, in bytes from the start of the flash, as drivers count. All others are never
/// written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Regions {
    /// Part in which the image is, or is to fit.
    pub image: Range<u32>,
    /// Memory of the role: what it must not forget.
    pub facts: Range<u32>,
    /// Memory of the link, directly behind that of the role.
    pub link: Range<u32>,
    /// The configuration page, which is written from outside. Where a boot loader takes one piece only it is a part
    /// of the image.
    pub config: Range<u32>,
}

/// The parts of a flash that are used for updates by radio: then this project's own boot loader starts the image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Updated {
    /// The boot loader.
    pub loader: Range<u32>,
    /// Its state: one page.
    pub state: Range<u32>,
    /// The image that runs.
    pub image: Range<u32>,
    /// The image that is taken, one page longer.
    pub spare: Range<u32>,
    /// Header of the image that is taken: one page.
    pub header: Range<u32>,
}

impl Updated {
    /// The parts from the start of the flash of an nRF52 on, for images of so many bytes.
    pub(crate) const fn nrf52(image: u32) -> Self {
        const LOADER: u32 = 28 << 10;
        let start = LOADER + PAGE;
        let spare = start + image;
        let header = spare + image + PAGE;
        Self {
            loader: 0..LOADER,
            state: LOADER..start,
            image: start..spare,
            spare: spare..header,
            header: header..header + PAGE,
        }
    }
}

impl Regions {
    /// The regions of an nRF52 whose memory begins at `memory`, with a page of the flash for its configuration.
    pub(crate) const fn nrf52(image: Range<u32>, memory: u32, config: u32) -> Self {
        let link = memory + FACTS;
        Self {
            image,
            facts: memory..link,
            link: link..link + LINK,
            config: config..config + PAGE,
        }
    }

    /// The regions of an nRF52840 with Adafruit's boot loader, whose image begins where the `SoftDevice` ends. All
    /// versions of the loader write up to 0xad000, where older ones have a file system.
    pub(crate) const fn uf2(image: u32) -> Self {
        Self::nrf52(image..0x0009_a000, 0x0009_a000, 0x000a_c000)
    }
}
