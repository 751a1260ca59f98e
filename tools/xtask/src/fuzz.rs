//! Targets of the package `fuzz`, guided by coverage: built with the flags of cargo-fuzz.

use std::{fs, path::Path, process::Command};

use anyhow::{Context, Result, bail, ensure};
use xshell::{Shell, cmd};

use crate::harness;

/// Inputs per target that take a few seconds.
pub(crate) const BRIEF: u32 = 100_000;

/// Targets that try some hundred inputs a second (long texts, or much to do), and inputs that take them about
/// as long as [`BRIEF`] takes the others.
const SLOW: [&str; 4] = [
    "answers_files",
    "console_line",
    "flash_log_open",
    "site_file",
];
const BRIEF_SLOW: u32 = 10_000;

/// Tries [`BRIEF`] inputs on each target, the same ones in every run.
///
/// # Errors
/// As of [`run`].
pub(crate) fn briefly(sh: &Shell) -> Result<()> {
    let runs = |target: &str| match SLOW.contains(&target) {
        true => BRIEF_SLOW,
        false => BRIEF,
    };
    run(sh, &[], runs, Some(1))
}

/// Flags with which a target tells libFuzzer its way, and ends where memory is misused or an assertion fails:
/// those of cargo-fuzz, but without dead code and complete debug information, which take long to build.
const FLAGS: [&str; 9] = [
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
    "-Cllvm-args=-simplifycfg-branch-fold-threshold=0",
    "-Zsanitizer=address",
    "-Cdebug-assertions",
    "--cfg=fuzzing",
];

/// Folder in which everything is built with these flags.
const BUILT: &str = "target/fuzz";

/// Program that runs one target under libFuzzer.
const PROGRAM: &str = "fuzz";

/// Variable of its environment that names the target.
const TARGET: &str = "FUZZ_TARGET";

/// Number of lines of a target's output that are shown of a finding.
const TAIL: usize = 40;

/// Tries `runs` inputs on each target, starting from its corpus; new inputs stay out of it. With a `seed`, they
/// are the same ones each time as long as the target and its earlier findings are the same.
///
/// # Errors
/// A target does not compile, found something or tried fewer inputs.
pub(crate) fn run(
    sh: &Shell,
    targets: &[String],
    runs: impl Fn(&str) -> u32 + Sync,
    seed: Option<u32>,
) -> Result<()> {
    let all = all_targets(sh)?;
    if let Some(unknown) = targets.iter().find(|&target| !all.contains(target)) {
        bail!("no fuzz target {unknown}; there are {}", all.join(", "));
    }
    let targets = if targets.is_empty() { &all } else { targets };
    let host = host(sh)?;
    cmd!(
        sh,
        "cargo build --locked --package fuzz --bin {PROGRAM} --target-dir {BUILT} --target {host} --release"
    )
    // The sanitizer's flag is not stable yet; its library comes with every compiler.
    .env("RUSTC_BOOTSTRAP", "1")
    .env("RUSTFLAGS", FLAGS.join(" "))
    .run()
    .context("the fuzz targets do not compile")?;
    let root = &sh.current_dir();
    let program = &root.join(BUILT).join(host).join("release").join(PROGRAM);
    harness::side_by_side(targets, |target| {
        try_inputs(root, program, target, runs(target), seed)
    })
}

/// Tries inputs on one target.
fn try_inputs(
    root: &Path,
    program: &Path,
    target: &str,
    runs: u32,
    seed: Option<u32>,
) -> Result<()> {
    let scratch = root.join("target/fuzz-corpus").join(target);
    let findings = root.join("tests/fuzz/artifacts").join(target);
    fs::create_dir_all(&scratch)?;
    fs::create_dir_all(&findings)?;
    let corpus = Some(root.join("tests/fuzz/corpus").join(target)).filter(|corpus| corpus.is_dir());
    let output = Command::new(program)
        .current_dir(root)
        .env(TARGET, target)
        .arg(format!("-artifact_prefix={}/", findings.display()))
        .arg(format!("-runs={runs}"))
        .args(seed.map(|seed| format!("-seed={seed}")))
        // One that takes a minute hangs.
        .args(["-timeout=60", "-print_final_stats=1"])
        .arg(scratch)
        .args(corpus)
        .output()
        .with_context(|| program.display().to_string())?;
    let said = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        bail!(finding(&said, target, program));
    }
    let tried = tried(&said).with_context(|| format!("{target} does not tell what it tried"))?;
    ensure!(
        tried >= runs,
        "{target} tried {tried} inputs in place of {runs}"
    );
    eprintln!("{target}: {tried} inputs without a finding");
    Ok(())
}

/// Number of inputs that a target tried.
fn tried(said: &str) -> Option<u32> {
    said.lines()
        .find_map(|line| line.strip_prefix("stat::number_of_executed_units:"))?
        .trim()
        .parse()
        .ok()
}

/// A target's finding, and the way to see it again.
fn finding(said: &str, target: &str, program: &Path) -> String {
    let lines: Vec<_> = said.lines().collect();
    let tail = lines[lines.len().saturating_sub(TAIL)..].join("\n");
    let program = program.display();
    let again = lines
        .iter()
        .find_map(|line| line.split_once("Test unit written to "))
        .map_or_else(
            || format!("it left no input: `cargo xtask fuzz {target}` tries others"),
            |(_, input)| format!("the input is {input}\nto try it again, type `{TARGET}={target} {program} {input}`"),
        );
    format!("{target} found something; the last that it said is\n{tail}\n\n{again}")
}

/// Names of the files in `tests/fuzz/src/targets`.
fn all_targets(sh: &Shell) -> Result<Vec<String>> {
    let mut names: Vec<_> = sh
        .read_dir("tests/fuzz/src/targets")?
        .iter()
        .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    ensure!(!names.is_empty(), "there is no fuzz target");
    Ok(names)
}

/// The name of this computer's kind, which is that of a folder of the build.
fn host(sh: &Shell) -> Result<String> {
    let version = cmd!(sh, "rustc -vV").quiet().read()?;
    let host = version.lines().find_map(|line| line.strip_prefix("host: "));
    Ok(host.context("the compiler tells no host")?.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_target_tried() {
        let said = "Done 100000 runs in 1 second(s)\nstat::number_of_executed_units: 100000\n\
                    stat::average_exec_per_sec:     50000\n";
        assert_eq!(tried(said), Some(100_000));
        for nothing in ["", "stat::number_of_executed_units: many"] {
            assert_eq!(tried(nothing), None);
        }
    }

    #[test]
    fn a_finding_tells_how_to_see_it_again() {
        let mut said = "INFO: seed corpus\n".repeat(100);
        said += "==1== ERROR: libFuzzer: deadly signal\n\
                 artifact_prefix='a/'; Test unit written to a/crash-12\nBase64: AA==\n";
        let told = finding(&said, "wire", Path::new("b/fuzz"));
        assert!(told.contains("ERROR: libFuzzer: deadly signal"));
        assert!(
            told.contains("type `FUZZ_TARGET=wire b/fuzz a/crash-12`"),
            "{told}"
        );
        assert_eq!(told.matches("seed corpus").count(), TAIL - 3);
        let told = finding("killed", "wire", Path::new("b/fuzz"));
        assert!(told.contains("it left no input"), "{told}");
    }
}
