//! The part of an image that is written to a flash.

use std::{fs, ops::Range, path::Path};

use anyhow::{Context, Result, bail};
use object::{
    Object, elf,
    read::elf::{ElfFile32, ProgramHeader},
};

/// Range from the first address that a programmer writes to the flash, of an image for an ARM
/// processor, to behind the last one.
pub(super) fn flash_range(path: &Path) -> Result<Range<u64>> {
    let name = path.display();
    let bytes = fs::read(path).with_context(|| format!("{name} cannot be read"))?;
    let file = ElfFile32::<object::Endianness>::parse(&*bytes)
        .with_context(|| format!("{name} is no image for a board"))?;
    if file.architecture() != object::Architecture::Arm {
        bail!("{name} is no image for an ARM processor");
    }
    let endian = file.endian();
    let parts = file
        .elf_program_headers()
        .iter()
        .filter(|part| part.p_type(endian) == elf::PT_LOAD && part.p_filesz(endian) > 0)
        .map(|part| {
            let start = u64::from(part.p_paddr(endian));
            start..start + u64::from(part.p_filesz(endian))
        });
    parts
        .reduce(|all, part| all.start.min(part.start)..all.end.max(part.end))
        .with_context(|| format!("{name} has nothing to write to a flash"))
}
