//! The linker's view of a board.

use core::fmt;

use crate::Board;

/// A board's `memory.x`, which keeps the image in its region; the region where it is updated by radio, if that is said.
#[derive(Clone, Copy, Debug)]
pub struct Script<'a>(pub &'a Board, pub bool);

impl fmt::Display for Script<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(board, is_updated) = self;
        let (image, config) = (board.image(*is_updated), &board.regions.config);
        let (ram, ram_bytes) = board.chip.ram;
        writeln!(f, "MEMORY\n{{")?;
        writeln!(
            f,
            "  FLASH : ORIGIN = {:#010x}, LENGTH = {:#x}",
            board.address(image.start),
            image.end - image.start
        )?;
        writeln!(f, "  RAM : ORIGIN = {ram:#010x}, LENGTH = {ram_bytes:#x}")?;
        writeln!(f, "}}")?;
        // Code begins behind a configuration that is within the image.
        if image.contains(&config.start) {
            writeln!(f, "_stext = {:#010x};", board.address(config.end))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;
    use crate::{NUCLEO_L476RG, PCA10059};

    #[test]
    fn scripts_of_boards() {
        let nucleo = "MEMORY\n{\n  FLASH : ORIGIN = 0x08000000, LENGTH = 0x80000\n  RAM : ORIGIN = 0x20000000, LENGTH = 0x18000\n}\n";
        assert_eq!(Script(&NUCLEO_L476RG, false).to_string(), nucleo);
        let dongle = "MEMORY\n{\n  FLASH : ORIGIN = 0x00001000, LENGTH = 0x66000\n  RAM : ORIGIN = 0x20000000, LENGTH = 0x40000\n}\n_stext = 0x00001400;\n";
        assert_eq!(Script(&PCA10059, false).to_string(), dongle);
    }
}
