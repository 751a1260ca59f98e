//! Parts of a linked image that take memory.

use anyhow::{Result, bail};
use object::{Object, ObjectSection, SectionFlags, SectionKind, elf};

/// Bytes that an image takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Size {
    /// Bytes written to the flash: code, constants, and first values of variables.
    pub(crate) flash: u64,
    /// Variables.
    pub(crate) ram: u64,
}

/// Adds up the sections of an image.
///
/// # Errors
/// It has none that would be written to a flash.
pub(crate) fn size(file: &object::File<'_>) -> Result<Size> {
    let mut size = Size::default();
    for section in file.sections().filter(is_loaded) {
        if is_writable(&section) {
            size.ram += section.size();
        }
        if is_in_flash(&section) {
            size.flash += section.size();
        }
    }
    if size.flash == 0 {
        bail!("there is no code in it");
    }
    Ok(size)
}

/// It takes memory of the node; names and lines for tools do not.
pub(crate) fn is_loaded(section: &object::Section<'_, '_>) -> bool {
    has_flag(section, elf::SHF_ALLOC)
}

/// It is written to the flash. Variables that begin with zero, or with anything, are in memory only.
pub(crate) fn is_in_flash(section: &object::Section<'_, '_>) -> bool {
    is_loaded(section) && section.kind() != SectionKind::UninitializedData
}

/// It holds variables.
pub(crate) fn is_writable(section: &object::Section<'_, '_>) -> bool {
    has_flag(section, elf::SHF_WRITE)
}

fn has_flag(section: &object::Section<'_, '_>, flag: elf::SectionFlags) -> bool {
    match section.flags() {
        SectionFlags::Elf { sh_flags, .. } => sh_flags.contains(flag),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// Of this very program.
    #[test]
    fn sections_are_found() {
        let bytes = fs::read(std::env::current_exe().unwrap()).unwrap();
        let size = size(&object::File::parse(&*bytes).unwrap()).unwrap();
        assert!(size.flash > 10_000 && size.ram > 0, "{size:?}");
    }
}
