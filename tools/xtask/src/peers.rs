//! Tests against programs of other projects: tshark, Firefox, and two that are built from source. They take as
//! long as it really does, as a camera on a port does.
//!
//! `ot-rcp` is OpenThread's radio co-processor, here its simulation for a computer: it speaks
//! Spinel on its standard input and output, and its medium is multicast on the loopback interface.
//! The source comes from the registry, in a crate that carries it for bindings; nothing of it is
//! part of this project.
//!
//! `geckodriver` drives Firefox for tests. Debian has Firefox, but not its driver.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::{Context, Result, ensure};
use xshell::{Shell, cmd};

use crate::harness::{self, Suite};

/// A package that only names the crate, so that cargo fetches it and tells its path.
const MANIFEST: &str = "tools/xtask/peers/Cargo.toml";
/// The crate, whose version `tools/xtask/peers/Cargo.lock` tells.
const CRATE: &str = "openthread-sys";

const fn suite(package: &'static str, module: &'static str) -> Suite {
    Suite { package, module }
}

pub(crate) const SUITES: [Suite; 4] = [
    suite("spinel-radio", "ot_rcp"),
    suite("host-sim", "real_time"),
    suite("host-sim", "decryption"),
    suite("zigbee-link", "capture"),
];

/// The page in Firefox.
pub(crate) const FIREFOX: Suite = suite("host-sim", "live::firefox");

/// Firefox's driver.
const GECKODRIVER: &str = "geckodriver@0.37.1";

/// Kept until it is deleted.
const DIRECTORY: &str = "target/peers";

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
///
/// # Errors
/// It cannot be built, or a test fails.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let _peer = sh.push_env("OT_RCP", ot_rcp(sh)?);
    harness::ignored(sh, &SUITES).map(|_| ())
}

/// The same for Firefox and its driver.
///
/// # Errors
/// As of [`run`].
pub(crate) fn firefox(sh: &Shell) -> Result<()> {
    let _driver = sh.push_env("GECKODRIVER", geckodriver(sh)?);
    harness::ignored(sh, &[FIREFOX]).map(|_| ())
}

/// The program `ot-rcp`.
fn ot_rcp(sh: &Shell) -> Result<PathBuf> {
    let directory = sh.current_dir().join(DIRECTORY);
    let (version, source) = source(sh)?;
    let build = directory.join(format!("{CRATE}-{version}"));
    let program = build.join("examples/apps/ncp/ot-rcp");
    if !program.is_file() {
        let start = Instant::now();
        cmd!(sh, "cmake -GNinja {OPTIONS...} -S {source} -B {build}").run()?;
        cmd!(sh, "ninja -C {build} ot-rcp").run()?;
        ensure!(program.is_file(), "{} was not built", program.display());
        eprintln!("ot-rcp: built in {:.0} s", start.elapsed().as_secs_f64());
    }
    Ok(program)
}

/// The program `geckodriver`.
fn geckodriver(sh: &Shell) -> Result<PathBuf> {
    let directory = sh.current_dir().join(DIRECTORY).join(GECKODRIVER);
    let program = directory.join("bin/geckodriver");
    if !program.is_file() {
        let start = Instant::now();
        cmd!(
            sh,
            // It waits for the browser: optimised, it takes twice as long to build.
            "cargo install --locked --quiet --debug --root {directory} {GECKODRIVER}"
        )
        .run()
        .with_context(|| format!("{GECKODRIVER} is built once, from the registry"))?;
        let took = start.elapsed().as_secs_f64();
        eprintln!("geckodriver: built in {took:.0} s");
    }
    Ok(program)
}

/// The version of OpenThread's crate, and the path where cargo has put the source.
fn source(sh: &Shell) -> Result<(String, PathBuf)> {
    let metadata = cmd!(
        sh,
        "cargo metadata --locked --format-version 1 --manifest-path {MANIFEST}"
    )
    .quiet()
    .read()
    .with_context(|| format!("the source of {CRATE} is fetched once, over a network"))?;
    let metadata: serde_json::Value = serde_json::from_str(&metadata)?;
    let package = metadata["packages"]
        .as_array()
        .into_iter()
        .flatten()
        .find(|package| package["name"] == CRATE)
        .with_context(|| format!("cargo tells nothing of {CRATE}"))?;
    let text = |key: &str| package[key].as_str().unwrap_or_default();
    let source = Path::new(text("manifest_path")).with_file_name("openthread");
    ensure!(source.is_dir(), "{} is missing", source.display());
    Ok((text("version").to_owned(), source))
}
