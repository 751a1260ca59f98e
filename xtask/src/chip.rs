//! The image that is flashed, on an emulated nRF52840 in virtual time. Its crate is a workspace of its
//! own, for it needs a newer compiler than the one whose figures are documented.

use anyhow::{Context, Result};
use xshell::{Shell, cmd};

use crate::{firmware, harness, setup};

/// Where everything is built for it.
const BUILT: &str = "target/chip";
const PACKAGE: &str = "nrf52840";
/// Networks of `host-sim` on it.
pub(crate) const SUITES: [&str; 1] = ["chips"];

/// Checks the crate, tests its models, and runs the image as nodes of a site, at last within a simulation.
///
/// # Errors
/// One of that fails.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let newer = sh.push_env("RUSTUP_TOOLCHAIN", setup::EMULATOR_TOOLCHAIN);
    let manifest = setup::EMULATOR;
    cmd!(sh, "cargo fmt --manifest-path {manifest} --check")
        .run()
        .with_context(|| format!("type `cargo fmt --manifest-path {manifest}`"))?;
    cmd!(
        sh,
        "cargo clippy --locked --manifest-path {manifest} --target-dir {BUILT} --all-targets -- --deny warnings"
    )
    .run()?;
    cmd!(
        sh,
        "cargo test --release --locked --manifest-path {manifest} --target-dir {BUILT}"
    )
    .run()?;
    drop(newer);
    let image = firmware::build(sh, PACKAGE)?;
    cmd!(
        sh,
        "cargo test --release --locked --manifest-path {manifest} --target-dir {BUILT} --test image -- --ignored --nocapture"
    )
    .env("RUSTUP_TOOLCHAIN", setup::EMULATOR_TOOLCHAIN)
    .env("NODE_IMAGE", sh.current_dir().join(&image))
    .run()?;
    let _image = sh.push_env("NODE_IMAGE", sh.current_dir().join(image));
    for suite in SUITES {
        harness::ignored(sh, suite)?;
    }
    Ok(())
}

/// How fast the emulator is, what nodes draw in an hour, and every cut of the power there is.
///
/// # Errors
/// One of that fails.
pub(crate) fn bench(sh: &Shell) -> Result<()> {
    let image = firmware::build(sh, PACKAGE)?;
    let _newer = sh.push_env("RUSTUP_TOOLCHAIN", setup::EMULATOR_TOOLCHAIN);
    let _image = sh.push_env("NODE_IMAGE", sh.current_dir().join(image));
    let _cuts = sh.push_env("NODE_CUTS", "all");
    let manifest = setup::EMULATOR;
    for (site, seconds, test) in [
        ("thesis-13", "612", "the_nodes_of_a_site_join"),
        ("lab", "3600", "what_nodes_draw"),
        ("lab", "20", "faults::power_may_go"),
    ] {
        cmd!(
            sh,
            "cargo test --release --locked --manifest-path {manifest} --target-dir {BUILT} --test image -- --ignored --nocapture {test}"
        )
        .env("NODE_SITE", site)
        .env("NODE_SECONDS", seconds)
        .run()?;
    }
    Ok(())
}
