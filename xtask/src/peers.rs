//! Tests against programs of other projects, built from source.
//!
//! `ot-rcp` is OpenThread's radio co-processor, here its simulation for a computer: it speaks
//! Spinel on its standard input and output, and its medium is multicast on the loopback interface.
//! The source comes from the registry, in a crate that carries it for bindings; nothing of it is
//! part of this project.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::{Context, Result, ensure};
use xshell::{Shell, cmd};

const CRATE: &str = "openthread-sys";
const VERSION: &str = "0.4.0";

/// Kept until it is deleted.
const DIRECTORY: &str = "target/peers";

/// A package only so that cargo fetches the crate and tells where it is.
const MANIFEST: &str = r#"[package]
name = "peers"
version = "0.0.0"
edition = "2024"

[workspace]

[dependencies]
CRATE = { version = "=VERSION", default-features = false }
"#;

/// Only the radio co-processor, for the simulation.
const OPTIONS: [&str; 8] = [
    "-DOT_PLATFORM=simulation",
    "-DOT_APP_CLI=OFF",
    "-DOT_APP_NCP=OFF",
    "-DOT_APP_RCP=ON",
    "-DOT_FTD=OFF",
    "-DOT_MTD=OFF",
    "-DOT_RCP=ON",
    "-DBUILD_TESTING=OFF",
];

/// Builds what is missing, and runs the tests that need it.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let _peer = sh.push_env("OT_RCP", ot_rcp(sh)?);
    cmd!(
        sh,
        "cargo test --package zigbee-link --test ot_rcp -- --ignored"
    )
    .run()?;
    Ok(())
}

/// The program `ot-rcp`.
pub(crate) fn ot_rcp(sh: &Shell) -> Result<PathBuf> {
    let directory = sh.current_dir().join(DIRECTORY);
    let build = directory.join(format!("{CRATE}-{VERSION}"));
    let program = build.join("examples/apps/ncp/ot-rcp");
    if !program.is_file() {
        let start = Instant::now();
        let source = source(sh, &directory)?;
        cmd!(sh, "cmake -GNinja {OPTIONS...} -S {source} -B {build}").run()?;
        cmd!(sh, "ninja -C {build} ot-rcp").run()?;
        ensure!(program.is_file(), "{} was not built", program.display());
        eprintln!("ot-rcp: built in {:.0} s", start.elapsed().as_secs_f64());
    }
    Ok(program)
}

/// Where cargo has put OpenThread's source.
fn source(sh: &Shell, directory: &Path) -> Result<PathBuf> {
    let package = directory.join("source");
    let manifest = package.join("Cargo.toml");
    fs::create_dir_all(package.join("src"))?;
    fs::write(package.join("src/lib.rs"), "")?;
    fs::write(
        &manifest,
        MANIFEST.replace("CRATE", CRATE).replace("VERSION", VERSION),
    )?;
    let metadata = cmd!(
        sh,
        "cargo metadata --format-version 1 --manifest-path {manifest}"
    )
    .quiet()
    .read()
    .with_context(|| format!("the source of {CRATE} {VERSION} is fetched once, over a network"))?;
    let metadata: serde_json::Value = serde_json::from_str(&metadata)?;
    let manifest = metadata["packages"]
        .as_array()
        .into_iter()
        .flatten()
        .find(|package| package["name"] == CRATE && package["version"] == VERSION)
        .and_then(|package| package["manifest_path"].as_str())
        .with_context(|| format!("cargo tells nothing of {CRATE} {VERSION}"))?;
    let source = Path::new(manifest).with_file_name("openthread");
    ensure!(source.is_dir(), "{} is missing", source.display());
    Ok(source)
}
