//! Files with which boards are flashed. An [`Image`] is an image for a board, of which every byte is within the
//! board's own region; boot loaders take it as a file, together with the configuration page.
//!
//! | module | |
//! |---|---|
//! | [`uf2`] | a file that is copied to the volume of a boot loader |
//! | [`dfu`] | a package for Nordic's boot loader, and its way there |
#![forbid(unsafe_code)]

pub mod dfu;
pub mod uf2;

use std::{collections::BTreeMap, ops::Range};

use board_facts::{Board, Loader};
use object::{
    Object, elf,
    read::elf::{ElfFile32, ProgramHeader},
};

/// An image for a board, checked to be for it.
#[derive(Clone, Debug)]
pub struct Image {
    board: &'static Board,
    /// Bytes by their addresses.
    parts: BTreeMap<u32, Vec<u8>>,
}

/// Reason why a file is no image for a board.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// No ELF file of 32 bits.
    #[error("it is no image for a board")]
    NoElf,
    /// An ELF file that lacks its end, or is damaged.
    #[error("it is cut off or damaged: copy it again, or build it again")]
    CutOff,
    /// Of another processor.
    #[error("it is no image for an ARM processor")]
    NotArm,
    /// No part of it is to be written.
    #[error("it has nothing to write to a flash")]
    Empty,
    /// A part of it is before the region.
    #[error(
        "it begins at {0:#x}, before the board's image at {1:#x}: is it an image for this board?"
    )]
    Before(u64, u32),
    /// Nothing of it is where the region begins, and a board starts there.
    #[error("it begins at {0:#x}, and the board's image at {1:#x}: is it an image for this board?")]
    Elsewhere(u64, u32),
    /// Its stack is not in the RAM of the chip.
    #[error(
        "its stack begins at {0:#x}, outside of the chip's RAM: is it an image for this board?"
    )]
    Stack(u32),
    /// A part of its memory is not in the RAM of the chip.
    #[error(
        "it needs RAM from {0:#x} to {1:#x}, which the chip does not have: is it an image for this board?"
    )]
    Memory(u32, u64),
    /// A part of it is behind the region.
    #[error(
        "it reaches up to {0:#x}, behind the part for images, which ends at {1:#x}: is it an image \
         for this board?"
    )]
    Behind(u64, u32),
    /// A part of it is where the configuration is to be.
    #[error(
        "it is at {0:#x}, where the configuration page is to be: is it an image for this board?"
    )]
    OnPage(u32),
}

/// The bytes that a node takes by radio: those of an image that is updated so, from the start of its region.
///
/// # Errors
/// It is none for this board, or the board is not updated by radio.
pub fn updated(board: &'static Board, elf: &[u8]) -> Result<Vec<u8>, ImageError> {
    let updated = board.updated.as_ref().ok_or(ImageError::Empty)?;
    flat(board, elf, &updated.image)
}

/// The bytes of the boot loader of a board that is updated by radio.
///
/// # Errors
/// It is none for this board, or the board is not updated by radio.
pub fn loader(board: &'static Board, elf: &[u8]) -> Result<Vec<u8>, ImageError> {
    let updated = board.updated.as_ref().ok_or(ImageError::Empty)?;
    flat(board, elf, &updated.loader)
}

/// All bytes of a program from the start of its region on.
fn flat(board: &'static Board, elf: &[u8], region: &Range<u32>) -> Result<Vec<u8>, ImageError> {
    let image = Image::within(board, elf, region)?;
    Ok(in_one_piece(&image.parts))
}

impl Image {
    /// The image that an ELF file holds. That for updates by radio is one, too: it begins behind its boot loader.
    ///
    /// # Errors
    /// It is none for this board.
    pub fn of(board: &'static Board, elf: &[u8]) -> Result<Self, ImageError> {
        let regions = [false, true].map(|is_updated| board.image(is_updated));
        let [usual, updated] = regions.map(|region| Self::within(board, elf, region));
        match usual {
            Err(ImageError::Elsewhere(start, _))
                if start == u64::from(board.address(regions[1].start)) =>
            {
                updated
            }
            usual => usual,
        }
    }

    fn within(board: &'static Board, elf: &[u8], region: &Range<u32>) -> Result<Self, ImageError> {
        let file = ElfFile32::<object::Endianness>::parse(elf).map_err(|_| {
            match elf.starts_with(b"\x7fELF\x01") {
                true => ImageError::CutOff,
                false => ImageError::NoElf,
            }
        })?;
        if file.architecture() != object::Architecture::Arm {
            return Err(ImageError::NotArm);
        }
        let endian = file.endian();
        let [least, most] = [region.start, region.end].map(|place| board.address(place));
        let mut parts = BTreeMap::new();
        for header in file.elf_program_headers() {
            if header.p_type(endian) != elf::PT_LOAD || header.p_filesz(endian) == 0 {
                continue;
            }
            let start = header.p_paddr(endian);
            let end = u64::from(start) + u64::from(header.p_filesz(endian));
            if start < least {
                return Err(ImageError::Before(start.into(), least));
            }
            if end > most.into() {
                return Err(ImageError::Behind(end, most));
            }
            let page = page(board);
            if start < page.end && end > page.start.into() {
                return Err(ImageError::OnPage(page.start));
            }
            let data = header.data(endian, elf).map_err(|()| ImageError::CutOff)?;
            parts.insert(start, data.to_vec());
        }
        let (&first, vectors) = parts.first_key_value().ok_or(ImageError::Empty)?;
        if first != least {
            return Err(ImageError::Elsewhere(first.into(), least));
        }
        let stack = vectors
            .first_chunk()
            .map_or(0, |word| u32::from_le_bytes(*word));
        let (ram, bytes) = board.chip.ram;
        // It grows down from there.
        if !(1..=bytes).contains(&stack.wrapping_sub(ram)) {
            return Err(ImageError::Stack(stack));
        }
        for header in file.elf_program_headers() {
            let [start, length] = [header.p_vaddr(endian), header.p_memsz(endian)];
            let end = u64::from(start) + u64::from(length);
            let is_within = |from: u32, to: u32| from <= start && end <= to.into();
            let is_loaded = header.p_type(endian) == elf::PT_LOAD && length > 0;
            if is_loaded && !is_within(least, most) && !is_within(ram, ram + bytes) {
                return Err(ImageError::Memory(start, end));
            }
        }
        Ok(Self { board, parts })
    }

    /// The file that the boot loader of the board takes, and the ending of its name: the image, and a configuration
    /// page in the same file; and an erased memory, if the node is to forget. `None` if the board has no boot loader,
    /// or it takes one piece only, which does not reach to the memory.
    ///
    /// A package for a dongle has room for the page within the image: without one, the node has no configuration.
    pub fn file(&self, page: Option<&[u8]>, forgets: bool) -> Option<(&'static str, Vec<u8>)> {
        let mut parts = self.with(page);
        if forgets {
            let (memory, bytes) = self.board.memory();
            parts.insert(memory, vec![0xff; bytes as usize]);
        }
        match self.board.loader? {
            Loader::Uf2 { family, .. } => Some(("uf2", uf2::file(family, &parts))),
            Loader::Dfu { .. } if forgets => None,
            Loader::Dfu { .. } => Some(("zip", self.package(page)?.file())),
        }
    }

    /// The image and a configuration page as a package for a boot loader that takes one over a serial line; `None` if
    /// the board has no such boot loader.
    pub fn package(&self, page: Option<&[u8]>) -> Option<dfu::Package> {
        match self.board.loader? {
            Loader::Dfu { hardware, .. } => {
                let image = in_one_piece(&self.with(page));
                Some(dfu::Package::new(hardware, image))
            }
            Loader::Uf2 { .. } => None,
        }
    }

    /// Its parts, and a configuration page.
    fn with(&self, page: Option<&[u8]>) -> BTreeMap<u32, Vec<u8>> {
        let mut parts = self.parts.clone();
        parts.extend(page.map(|page| (self.board.config(), page.to_vec())));
        parts
    }
}

/// Addresses of the configuration page.
fn page(board: &Board) -> Range<u32> {
    let page = &board.regions.config;
    board.address(page.start)..board.address(page.end)
}

/// The parts with erased flash between them.
fn in_one_piece(parts: &BTreeMap<u32, Vec<u8>>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut start = None;
    for (&at, part) in parts {
        let start = *start.get_or_insert(at);
        bytes.resize((at - start) as usize, 0xff);
        bytes.extend(part);
    }
    bytes
}

#[cfg(test)]
mod tests;
