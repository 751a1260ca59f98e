//! `cargo xtask test`: all that must hold before a change lands. CI runs this and nothing else.

use std::time::Instant;

use anyhow::{Context, Result};
use xshell::{Shell, cmd};

use crate::{cortex_m, emulate, firmware, fuzz, peers, setup, size};

/// Libraries that run on a node. Each is built for every processor, bare and with all features.
const FIRMWARE_CRATES: [&str; 4] = [
    "calib-core",
    "cmucam2-driver",
    "node-firmware",
    "zigbee-link",
];

type Stage = (&'static str, fn(&Shell) -> Result<()>);

const STAGES: [Stage; 12] = [
    ("set-up", set_up),
    ("format", format),
    ("lint", lint),
    ("test", test),
    ("test against real peers", peers::run),
    ("test on an emulated board", emulate::run),
    ("build and check firmware", firmware::run),
    ("fuzz, briefly", |sh| fuzz::run(sh, &[], fuzz::BRIEF)),
    ("document", document),
    ("cross-build", cross_build),
    ("count instructions on emulated processors", count),
    ("measure flash and RAM", measure),
];

pub(crate) fn run(sh: &Shell) -> Result<()> {
    for (name, stage) in STAGES {
        eprintln!("\n==> {name}");
        let start = Instant::now();
        stage(sh).with_context(|| format!("`cargo xtask test` stopped at: {name}"))?;
        eprintln!("==> {name}: {:.0} s", start.elapsed().as_secs_f64());
    }
    eprintln!("\nall {} stages passed", STAGES.len());
    Ok(())
}

fn set_up(sh: &Shell) -> Result<()> {
    setup::targets(sh)?;
    setup::packages(sh)
}

fn format(sh: &Shell) -> Result<()> {
    cmd!(sh, "cargo fmt --all --check")
        .run()
        .context("type `cargo fmt --all`")
}

fn lint(sh: &Shell) -> Result<()> {
    cmd!(
        sh,
        "cargo clippy --workspace --all-targets --all-features -- --deny warnings"
    )
    .run()?;
    for target in setup::TARGETS {
        let crates = &firmware_crates();
        cmd!(
            sh,
            "cargo clippy {crates...} --package bench-cortex-m --package bench-size --target {target} -- --deny warnings"
        )
        .run()?;
    }
    // One by one: together they would be built with each other's features.
    for board in firmware::packages() {
        cmd!(
            sh,
            "cargo clippy --package {board} --target thumbv7em-none-eabihf -- --deny warnings"
        )
        .run()?;
    }
    Ok(())
}

fn test(sh: &Shell) -> Result<()> {
    cmd!(sh, "cargo test --workspace --all-features").run()?;
    Ok(())
}

fn document(sh: &Shell) -> Result<()> {
    let _strict = sh.push_env("RUSTDOCFLAGS", "--deny warnings");
    cmd!(sh, "cargo doc --workspace --no-deps --all-features").run()?;
    Ok(())
}

fn cross_build(sh: &Shell) -> Result<()> {
    let crates = &firmware_crates();
    for target in setup::TARGETS {
        cmd!(sh, "cargo build {crates...} --target {target}").run()?;
        cmd!(
            sh,
            "cargo build {crates...} --target {target} --all-features"
        )
        .run()?;
    }
    Ok(())
}

fn count(sh: &Shell) -> Result<()> {
    let measurements = cortex_m::run(sh)?;
    println!("{}", cortex_m::table(&measurements));
    cortex_m::within_budget(&measurements)
}

fn measure(sh: &Shell) -> Result<()> {
    let measurements = size::run(sh)?;
    println!("{}", size::table(&measurements));
    size::within_budget(&measurements)
}

fn firmware_crates() -> Vec<&'static str> {
    FIRMWARE_CRATES
        .into_iter()
        .flat_map(|name| ["--package", name])
        .collect()
}
