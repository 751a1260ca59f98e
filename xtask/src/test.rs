//! `cargo xtask test`: all that must hold before a change lands. CI runs this and nothing else.

use std::{process::ExitCode, time::Instant};

use anyhow::{Context, Result};
use clap::builder::PossibleValuesParser;
use xshell::{Shell, cmd};

use crate::{chip, cortex_m, firmware, fuzz, harness, peers, setup, size};

/// Everything that must hold, stage by stage
///
/// Installs what is missing where that is allowed, and stops at the first stage that fails. Of each
/// program that is missing and cannot be installed it says what to type; in CI that is an error, and
/// elsewhere the stages that need it are left out and named in the summary. The last line counts:
/// `12 passed, 0 failed`.
#[derive(clap::Args)]
pub(crate) struct Test {
    /// Only this stage; may be given several times
    #[arg(long = "stage", value_name = "NAME", value_parser = PossibleValuesParser::new(STAGES.map(|stage| stage.name)))]
    stages: Vec<String>,
}

/// Libraries that run on a node.
const FIRMWARE_CRATES: [&str; 6] = [
    "calib-core",
    "cmucam2-driver",
    "flash-log",
    "node-firmware",
    "pedestrian",
    "zigbee-link",
];

#[derive(Clone, Copy)]
struct Stage {
    name: &'static str,
    what: &'static str,
    /// Installs what it needs and not every machine has.
    needs: fn(&Shell) -> Result<()>,
    run: fn(&Shell) -> Result<()>,
}

const STAGES: [Stage; 13] = [
    Stage {
        name: "set-up",
        what: "what the others need, and lock files that fit",
        needs: nothing,
        run: set_up,
    },
    Stage {
        name: "format",
        what: "code as rustfmt writes it",
        needs: nothing,
        run: format,
    },
    Stage {
        name: "lint",
        what: "clippy, for this computer, for each processor and for each board",
        needs: nothing,
        run: lint,
    },
    Stage {
        name: "test",
        what: "all tests that need nothing else",
        needs: nothing,
        run: harness::workspace,
    },
    Stage {
        name: "peers",
        what: "tests against programs of other projects",
        needs: setup::packages,
        run: peers::run,
    },
    Stage {
        name: "firmware",
        what: "images of the boards, what they take and where they may panic",
        needs: setup::linker,
        run: |sh| firmware::run(sh, &[]),
    },
    Stage {
        name: "chip",
        what: "the image that is flashed, on an emulated nRF52840",
        needs: packages_and_linker,
        run: chip::run,
    },
    Stage {
        name: "fuzz",
        what: "fuzz targets, briefly",
        needs: compiler_for_fuzzing,
        // The same inputs in every run; `cargo xtask fuzz` tries others.
        run: fuzz::briefly,
    },
    Stage {
        name: "document",
        what: "documentation without a warning",
        needs: nothing,
        run: document,
    },
    Stage {
        name: "count",
        what: "instructions on emulated processors",
        needs: setup::packages,
        run: count,
    },
    Stage {
        name: "size",
        what: "flash and RAM of the link",
        needs: nothing,
        run: measure,
    },
    Stage {
        name: "bench",
        what: "figures of the README that are quickly computed",
        needs: nothing,
        run: bench,
    },
    Stage {
        name: "campaign",
        what: "random sites on which everything goes wrong",
        needs: nothing,
        run: campaign,
    },
];

impl Test {
    pub(crate) fn run(&self, sh: &Shell) -> ExitCode {
        let chosen: Vec<_> = STAGES
            .into_iter()
            .filter(|stage| self.stages.is_empty() || self.stages.iter().any(|s| s == stage.name))
            .collect();
        let count = run(sh, &chosen, setup::is_ci());
        if count.passed == STAGES.len() {
            eprintln!("all {} stages passed", STAGES.len());
        }
        eprintln!("{}", count.line());
        if count.failed == 0 {
            ExitCode::SUCCESS
        } else {
            ExitCode::FAILURE
        }
    }
}

/// Runs stages until one fails, and prints how long each took.
fn run(sh: &Shell, stages: &[Stage], is_ci: bool) -> Count {
    let whole = Instant::now();
    let mut summary = String::new();
    let mut count = Count::default();
    let mut failure = None;
    for stage in stages {
        eprintln!("\n==> {}: {}", stage.name, stage.what);
        let start = Instant::now();
        let outcome = match left_out(stage, sh, is_ci) {
            Ok(None) => (stage.run)(sh).map(|()| None),
            missing => missing,
        };
        let seconds = start.elapsed().as_secs_f64();
        let said = match outcome {
            Ok(None) => {
                count.passed += 1;
                String::new()
            }
            Ok(Some(why)) => {
                count.left_out += 1;
                format!(": LEFT OUT: {why}")
            }
            Err(error) => {
                count.failed += 1;
                failure = Some(error.context(format!("stage `{}`", stage.name)));
                ": FAILED".to_owned()
            }
        };
        eprintln!("==> {}: {seconds:.0} s{said}", stage.name);
        summary += &format!("{seconds:7.0} s  {}{said}\n", stage.name);
        if failure.is_some() {
            break;
        }
    }
    count.not_run = stages.len() - count.passed - count.failed - count.left_out;
    let seconds = whole.elapsed().as_secs_f64();
    eprintln!("\n{summary}{seconds:7.0} s  in all\n");
    if let Some(error) = failure {
        crate::complain(&error);
    }
    count
}

/// How many stages came to which end.
#[derive(Debug, Default, PartialEq)]
struct Count {
    passed: usize,
    failed: usize,
    left_out: usize,
    not_run: usize,
}

impl Count {
    fn line(&self) -> String {
        let mut line = format!("{} passed, {} failed", self.passed, self.failed);
        for (count, what) in [(self.left_out, "left out"), (self.not_run, "not run")] {
            if count > 0 {
                line += &format!(", {count} {what}");
            }
        }
        line
    }
}

/// What is missing for a stage: the one rule of what may be left out, and where.
fn left_out(stage: &Stage, sh: &Shell, is_ci: bool) -> Result<Option<String>> {
    match (stage.needs)(sh) {
        Ok(()) => Ok(None),
        Err(error) if is_ci => Err(error),
        Err(error) => Ok(Some(format!("{error:#}"))),
    }
}

fn nothing(_: &Shell) -> Result<()> {
    Ok(())
}

fn packages_and_linker(sh: &Shell) -> Result<()> {
    setup::packages(sh)?;
    setup::linker(sh)
}

fn compiler_for_fuzzing(sh: &Shell) -> Result<()> {
    setup::nightly(sh).map(|_| ())
}

/// What later stages need, so that what cannot be installed is told at once. Sources and tools that
/// are built are fetched where they are needed.
fn set_up(sh: &Shell) -> Result<()> {
    for manifest in ["Cargo.toml", setup::FUZZ] {
        setup::locked(sh, manifest)?;
    }
    setup::targets(sh)?;
    for stage in &STAGES {
        if let Some(why) = left_out(stage, sh, setup::is_ci())? {
            eprintln!("{} will be left out: {why}", stage.name);
        }
    }
    Ok(())
}

fn format(sh: &Shell) -> Result<()> {
    let fuzz = setup::FUZZ;
    cmd!(sh, "cargo fmt --all --check")
        .run()
        .context("type `cargo fmt --all`")?;
    cmd!(sh, "cargo fmt --manifest-path {fuzz} --check")
        .run()
        .with_context(|| format!("type `cargo fmt --manifest-path {fuzz}`"))
}

fn lint(sh: &Shell) -> Result<()> {
    cmd!(
        sh,
        "cargo clippy --locked --workspace --all-targets --all-features -- --deny warnings"
    )
    .run()?;
    let crates = &FIRMWARE_CRATES.map(|name| ["--package", name]).concat();
    for target in setup::TARGETS {
        // Bare, and with all features. Nothing is linked here, so that checking is enough.
        cmd!(
            sh,
            "cargo clippy --locked {crates...} --package bench-cortex-m --package bench-size --target {target} -- --deny warnings"
        )
        .run()?;
        cmd!(
            sh,
            "cargo clippy --locked {crates...} --target {target} --all-features -- --deny warnings"
        )
        .run()?;
    }
    // One by one: together they would be built with each other's features.
    for board in firmware::packages() {
        cmd!(
            sh,
            "cargo clippy --locked --package {board} --bins --examples --target thumbv7em-none-eabihf -- --deny warnings"
        )
        .run()?;
    }
    // Not part of the workspace. It is run by a nightly compiler, and compiles with any.
    let (fuzz, built) = (setup::FUZZ, fuzz::BUILT);
    cmd!(
        sh,
        "cargo clippy --locked --manifest-path {fuzz} --target-dir {built} --all-targets -- --deny warnings"
    )
    // Nothing is linked: without the fuzzer's library, which takes longer than all else, any file serves.
    .env("CUSTOM_LIBFUZZER_PATH", sh.current_dir().join(fuzz))
    .run()?;
    Ok(())
}

fn document(sh: &Shell) -> Result<()> {
    let _strict = sh.push_env("RUSTDOCFLAGS", "--deny warnings");
    cmd!(
        sh,
        "cargo doc --locked --workspace --no-deps --all-features"
    )
    .run()?;
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

/// Built as tests are, of what is built by then: to build all again for a release takes far longer than
/// what it saves.
fn bench(sh: &Shell) -> Result<()> {
    let program = harness::program(sh, "bench")?;
    cmd!(sh, "{program} brief").run()?;
    Ok(())
}

/// About a minute. The goal is none of both shares; these are what is reached, so that no change makes it
/// worse unseen.
fn campaign(sh: &Shell) -> Result<()> {
    let program = harness::program(sh, "campaign")?;
    let reached = ["--deceiving", "0.02", "--late", "0.15"];
    cmd!(sh, "{program} --runs 100 --minimise 0 {reached...}").run()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use anyhow::bail;

    use super::*;

    fn stage(needs: fn(&Shell) -> Result<()>, run: fn(&Shell) -> Result<()>) -> Stage {
        Stage {
            name: "one",
            what: "for a test",
            needs,
            run,
        }
    }

    fn fails(_: &Shell) -> Result<()> {
        bail!("no")
    }

    fn never(_: &Shell) -> Result<()> {
        panic!("this is not to run");
    }

    #[test]
    fn stages_are_counted() {
        let sh = Shell::new().unwrap();
        let good = stage(nothing, nothing);
        for (stages, is_ci, line) in [
            (vec![good, good], true, "2 passed, 0 failed"),
            (
                vec![good, stage(nothing, fails), stage(never, never)],
                false,
                "1 passed, 1 failed, 1 not run",
            ),
            (
                vec![stage(fails, never), good],
                false,
                "1 passed, 0 failed, 1 left out",
            ),
            // In CI nothing is left out.
            (
                vec![stage(fails, never), good],
                true,
                "0 passed, 1 failed, 1 not run",
            ),
        ] {
            assert_eq!(run(&sh, &stages, is_ci).line(), line);
        }
    }

    #[test]
    fn every_stage_has_a_name_of_its_own() {
        for stage in &STAGES {
            let same = STAGES.iter().filter(|other| other.name == stage.name);
            assert_eq!(same.count(), 1, "{}", stage.name);
        }
    }
}
