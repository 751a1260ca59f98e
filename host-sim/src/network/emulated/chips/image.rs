//! Check that a file is an image for these chips.

use std::ops::RangeInclusive;

use object::{Architecture, Object, ObjectSegment};

/// Memory of an nRF52840 (Product Specification, "Memory map"): where the stack may begin, and the flash.
const STACKS: RangeInclusive<u32> = 0x2000_0000..=0x2004_0000;
const FLASH: u32 = 0x10_0000;

/// Returns true for an ELF file for ARM with vectors at the beginning of the flash, and a log that can be read.
pub(super) fn is_ours(bytes: &[u8]) -> bool {
    let Ok(file) = object::File::parse(bytes) else {
        return false;
    };
    file.architecture() == Architecture::Arm
        && file.section_by_name(".defmt").is_some()
        && has_vectors(&file) == Some(true)
}

/// Checks the stack, and the first instruction, whose lowest bit says that it is Thumb.
fn has_vectors(file: &object::File<'_>) -> Option<bool> {
    let mut segments = file.segments();
    let segment = segments.find(|segment| segment.address() == 0 && segment.size() > 0)?;
    let ([stack, start], _) = segment.data().ok()?.as_chunks().0.split_first_chunk()?;
    let [stack, start] = [*stack, *start].map(u32::from_le_bytes);
    Some(STACKS.contains(&stack) && start < FLASH && start & 1 == 1)
}
