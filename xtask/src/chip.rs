//! The image that is flashed, on an emulated nRF52840 in virtual time. Its crate is a workspace of its
//! own, for it needs a newer compiler than the one whose figures are documented.

use std::{fs, path::PathBuf};

use anyhow::{Context, Result};
use xshell::{Shell, cmd};

use crate::{firmware, harness, setup};

/// Where everything is built for it.
const BUILT: &str = "target/chip";
const PACKAGE: &str = "nrf52840";

/// Node, and what `host-sim provision` is told of it.
const NODES: [(&str, &[&str]); 3] = [
    ("coordinator", &["--id=1", "--join-window=600"]),
    ("camera", &["--id=2", "--field-of-view=45"]),
    (
        "target",
        &[
            "--id=3",
            "--systematic-heading=3",
            "--systematic-scale=0.08",
        ],
    ),
];

/// Of `host-sim keygen`, and always the same one, so that runs are the same. It protects nothing.
const SITE_KEY: &str = "site-key 1 1 7f2afd3a44945ddae201880dcf2db72c 9c48a76e\n";

/// Checks the crate, tests its models, and runs the image with pages as they are flashed.
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
        "cargo test --locked --manifest-path {manifest} --target-dir {BUILT}"
    )
    .run()?;
    drop(newer);
    let image = firmware::build(sh, PACKAGE)?;
    let pages = pages(sh)?;
    cmd!(
        sh,
        "cargo test --locked --manifest-path {manifest} --target-dir {BUILT} --test image -- --ignored --nocapture"
    )
    .env("RUSTUP_TOOLCHAIN", setup::EMULATOR_TOOLCHAIN)
    .env("NODE_IMAGE", sh.current_dir().join(image))
    .env("NODE_PAGES", pages)
    .run()?;
    Ok(())
}

/// A folder with a page of each node, made as they are for boards.
fn pages(sh: &Shell) -> Result<PathBuf> {
    let program = harness::program(sh, "host-sim")?;
    let folder = sh.current_dir().join(BUILT).join("pages");
    if folder.is_dir() {
        fs::remove_dir_all(&folder)?;
    }
    sh.create_dir(&folder)?;
    let _there = sh.push_dir(&folder);
    sh.write_file("site.sitekey", SITE_KEY)?;
    for (role, options) in NODES {
        let out = format!("{role}.bin");
        cmd!(
            sh,
            "{program} provision --site-key=site.sitekey --role={role} --out={out} {options...}"
        )
        .ignore_stdout()
        .ignore_stderr()
        .run()?;
    }
    Ok(folder)
}
