//! Build scripts of images.

use std::{env, format, fs, io, path::PathBuf, println, string::String};

use crate::{Board, Script};

/// Has the linker put the images of the package that is built into their region on the board of this name, with
/// `cortex-m-rt` and `defmt`. A build for a computer has nothing to link.
///
/// # Errors
/// There is no such board, or the folder of the build cannot be written.
pub fn link(name: &str) -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    if variable("CARGO_CFG_TARGET_OS") != "none" {
        return Ok(());
    }
    let board = Board::named(name).ok_or_else(|| {
        let why = format!("no board of boards/facts/src/lib.rs is called {name}");
        io::Error::new(io::ErrorKind::NotFound, why)
    })?;
    let is_updated = !variable("CARGO_FEATURE_UPDATE").is_empty();
    memory(&format!("{}", Script(board, is_updated)))?;
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg={argument}");
    }
    Ok(())
}

/// Has the linker put the boot loader of a board into its region.
///
/// # Errors
/// The board is not updated by radio, or the folder of the build cannot be written.
pub fn link_loader(board: &Board) -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    if variable("CARGO_CFG_TARGET_OS") != "none" {
        return Ok(());
    }
    let updated = board.updated.as_ref().ok_or(io::ErrorKind::NotFound)?;
    let (ram, ram_bytes) = board.chip.ram;
    memory(&format!(
        "MEMORY\n{{\n  FLASH : ORIGIN = {:#010x}, LENGTH = {:#x}\n  RAM : ORIGIN = {ram:#010x}, LENGTH = {ram_bytes:#x}\n}}\n",
        board.address(updated.loader.start),
        updated.loader.len()
    ))?;
    for argument in ["--nmagic", "-Tlink.x"] {
        println!("cargo:rustc-link-arg={argument}");
    }
    Ok(())
}

/// Has the linker find this as `memory.x`, or by way of the `memory.x` at the top of the repository.
///
/// # Errors
/// The folder of the build cannot be written.
pub fn memory(script: &str) -> io::Result<()> {
    let out = PathBuf::from(variable("OUT_DIR"));
    for name in ["memory.x", "board-memory.x"] {
        fs::write(out.join(name), script)?;
    }
    println!("cargo:rustc-link-search={}", out.display());
    Ok(())
}

fn variable(name: &str) -> String {
    env::var(name).unwrap_or_default()
}
