//! The image that is flashed, on an emulated nRF52840 in virtual time. Its crate is a workspace of its
//! own, for it needs a newer compiler than the one whose figures are documented.

use anyhow::{Context, Result, ensure};
use xshell::{Shell, cmd};

use crate::{
    documented::{self, Table, number},
    firmware, harness, setup,
};

/// Where everything is built for it.
const BUILT: &str = "target/chip";
const PACKAGE: &str = "nrf52840";
/// Networks of `host-sim` on it.
pub(crate) const SUITES: [&str; 1] = ["chips"];

/// In the documentation.
const TABLE: &str = "chip: stack";
/// What a test says behind a role, the node's number and the bytes that it used.
const USED: &str = " bytes of stack;";
const ROLES: [&str; 3] = ["coordinator", "camera", "target"];

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
    let bound = firmware::stack_bound(&image)?;
    cmd!(
        sh,
        "cargo test --release --locked --manifest-path {manifest} --target-dir {BUILT} --test image -- --ignored --nocapture"
    )
    .env("RUSTUP_TOOLCHAIN", setup::EMULATOR_TOOLCHAIN)
    .env("NODE_IMAGE", sh.current_dir().join(&image))
    .run()?;
    let _image = sh.push_env("NODE_IMAGE", sh.current_dir().join(image));
    let mut said = String::new();
    for suite in SUITES {
        said += &harness::ignored(sh, suite)?;
    }
    stack(sh, bound, &said)
}

/// Compares the deepest stack of each role, as tests told it, with what was computed and with the documentation.
fn stack(sh: &Shell, bound: u64, said: &str) -> Result<()> {
    let head = [
        "bytes of stack, `cargo xtask test --stage chip`",
        "nRF52840",
    ];
    let mut rows = vec![
        head.map(str::to_owned).to_vec(),
        vec!["deepest, computed".to_owned(), number(bound)],
    ];
    for role in ROLES {
        let used = deepest(said, role).with_context(|| format!("no test told of a {role}"))?;
        ensure!(
            used <= bound,
            "a {role} used {used} bytes, of {bound} computed"
        );
        rows.push(vec![format!("deepest, measured: {role}"), number(used)]);
    }
    documented::agree(sh, "test --stage chip", &[Table { name: TABLE, rows }])
}

/// The most that nodes of a role used.
fn deepest(said: &str, role: &str) -> Option<u64> {
    let used = said.lines().filter_map(|line| {
        let (node, used) = line.split_once(USED)?.0.split_once(": ")?;
        node.rsplit(' ').nth(1).filter(|word| *word == role)?;
        used.split(' ').next()?.parse().ok()
    });
    used.max()
}

/// How fast the emulator is, what nodes draw in an hour, every cut of the power there is while nodes join, and a
/// thousand at random instants of calibrations.
///
/// # Errors
/// One of that fails.
pub(crate) fn bench(sh: &Shell) -> Result<()> {
    let image = firmware::build(sh, PACKAGE)?;
    let newer = sh.push_env("RUSTUP_TOOLCHAIN", setup::EMULATOR_TOOLCHAIN);
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
    drop(newer);
    // The first of a hundred at a time may be told with `NODE_SEED`.
    cmd!(
        sh,
        "cargo test --locked --package host-sim --all-features --test chips -- --ignored --nocapture power_cuts_over_a_calibration"
    )
    .env("NODE_CUTS", "1000")
    .run()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deepest_stack_of_each_role_is_found() {
        let said = "test a ... camera 3: 512 of 9000 bytes of stack; 7 instructions\n\
                    camera 4: 700 of 9000 bytes of stack; 8\ntarget 20: 800 of 9000 bytes of stack; 9\n";
        assert_eq!(deepest(said, "camera"), Some(700));
        assert_eq!(deepest(said, "target"), Some(800));
        assert_eq!(deepest(said, "coordinator"), None);
    }
}
