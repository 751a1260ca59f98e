//! Links the images for a processor, as on a development kit.

fn main() -> std::io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    let os = std::env::var("CARGO_CFG_TARGET_OS").unwrap_or_default();
    if os == "none" {
        let board = board_facts::NRF52840_DK;
        board_facts::memory(&board_facts::Script(&board, false).to_string())?;
        for argument in ["--nmagic", "-Tlink.x"] {
            println!("cargo:rustc-link-arg-bins={argument}");
        }
    }
    Ok(())
}
