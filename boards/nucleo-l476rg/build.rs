//! Links for the board; a host build has nothing to link.

use std::{env, fs, io, path::PathBuf};

/// Read by the linker behind `memory.x`.
const CHECK: &str = "ASSERT(ORIGIN(FLASH) == 0x08000000,
\"ERROR(nucleo-l476rg): memory.x is another board's: type `cargo xtask firmware`\");
";

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=memory.x");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return Ok(());
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    fs::write(out.join("check-memory.x"), CHECK)?;
    println!("cargo:rustc-link-search={}", out.display());
    // `memory.x` is the one here: `cargo xtask firmware` has the linker work in this folder.
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x", "-Tcheck-memory.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    Ok(())
}
