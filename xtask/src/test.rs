//! `cargo xtask test`: all that must hold before a change lands. CI runs this and nothing else.

use std::time::Instant;

use anyhow::{Context, Result, ensure};
use xshell::{Shell, cmd};

use crate::{cortex_m, emulate, firmware, fuzz, peers, setup, size};

/// Libraries that run on a node. Each is built for every processor, bare and with all features.
const FIRMWARE_CRATES: [&str; 4] = [
    "calib-core",
    "cmucam2-driver",
    "node-firmware",
    "zigbee-link",
];

/// The workspace of the fuzz targets.
const FUZZ: &str = "fuzz/Cargo.toml";

type Stage = (&'static str, fn(&Shell) -> Result<Outcome>);

enum Outcome {
    Passed,
    /// What is missing here for it. Not in CI: there it is an error.
    LeftOut(&'static str),
}

const STAGES: [Stage; 12] = [
    ("set-up", |sh| passed(set_up(sh))),
    ("format", |sh| passed(format(sh))),
    ("lint", |sh| passed(lint(sh))),
    ("test", |sh| passed(test(sh))),
    ("test against real peers", |sh| passed(peers::run(sh))),
    ("test on an emulated board", |sh| passed(emulate::run(sh))),
    ("build and check firmware", |sh| passed(firmware::run(sh))),
    ("fuzz, briefly", fuzz_briefly),
    ("document", |sh| passed(document(sh))),
    ("cross-build", |sh| passed(cross_build(sh))),
    ("count instructions on emulated processors", |sh| {
        passed(count(sh))
    }),
    ("measure flash and RAM", |sh| passed(measure(sh))),
];

pub(crate) fn run(sh: &Shell) -> Result<()> {
    let whole = Instant::now();
    let mut summary = String::new();
    let mut left_out = 0;
    for (name, stage) in STAGES {
        eprintln!("\n==> {name}");
        let start = Instant::now();
        let outcome =
            stage(sh).with_context(|| format!("`cargo xtask test` stopped at: {name}"))?;
        let seconds = start.elapsed().as_secs_f64();
        eprintln!("==> {name}: {seconds:.0} s");
        summary += &format!("{seconds:7.0} s  {name}");
        if let Outcome::LeftOut(why) = outcome {
            left_out += 1;
            summary += &format!(": LEFT OUT: {why}");
        }
        summary.push('\n');
    }
    eprint!(
        "\n{summary}{:7.0} s  in all\n\n",
        whole.elapsed().as_secs_f64()
    );
    match left_out {
        0 => eprintln!("all {} stages passed", STAGES.len()),
        _ => eprintln!(
            "{left_out} of {} stages left out, the others passed",
            STAGES.len()
        ),
    }
    Ok(())
}

fn passed(result: Result<()>) -> Result<Outcome> {
    result.map(|()| Outcome::Passed)
}

/// What later stages need, so that what cannot be installed is told at once. Sources and tools that
/// are built are fetched where they are needed.
fn set_up(sh: &Shell) -> Result<()> {
    setup::targets(sh)?;
    setup::linker(sh)?;
    ensure!(!setup::is_ci() || setup::nightly(sh), fuzz::NO_NIGHTLY);
    setup::packages(sh)
}

fn fuzz_briefly(sh: &Shell) -> Result<Outcome> {
    if setup::nightly(sh) {
        // The same inputs in every run; `cargo xtask fuzz` tries others.
        return passed(fuzz::run(sh, &[], fuzz::BRIEF, Some(1)));
    }
    ensure!(!setup::is_ci(), fuzz::NO_NIGHTLY);
    Ok(Outcome::LeftOut(fuzz::NO_NIGHTLY))
}

fn format(sh: &Shell) -> Result<()> {
    cmd!(sh, "cargo fmt --all --check")
        .run()
        .context("type `cargo fmt --all`")?;
    cmd!(sh, "cargo fmt --manifest-path {FUZZ} --check")
        .run()
        .with_context(|| format!("type `cargo fmt --manifest-path {FUZZ}`"))
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
    // Not part of the workspace. It is run by a nightly compiler, and compiles with any.
    cmd!(
        sh,
        "cargo clippy --manifest-path {FUZZ} --target-dir target/fuzz --all-targets -- --deny warnings"
    )
    .run()?;
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
