//! Fuzz targets under `fuzz/`, run by cargo-fuzz.

use std::fs;

use anyhow::{Context, Result, bail, ensure};
use xshell::{Shell, cmd};

use crate::setup;

/// Targets need the compiler's sanitizers.
pub(crate) const NO_NIGHTLY: &str =
    "there is no nightly compiler to fuzz with: type `rustup toolchain install nightly`";

/// Inputs per target that take a few seconds.
pub(crate) const BRIEF: u32 = 100_000;

/// Kept out of the way of an installed one.
const TOOLS: &str = "target/tools";
const VERSION: &str = "0.13.1";

/// Tries `runs` inputs on each target, starting from its corpus; what is new stays out of it. With a
/// `seed`, the same ones each time as long as the target and what was found before are the same.
///
/// # Errors
/// A target found something, or there is no nightly compiler and none can be installed.
pub(crate) fn run(sh: &Shell, targets: &[String], runs: u32, seed: Option<u32>) -> Result<()> {
    ensure!(setup::nightly(sh), NO_NIGHTLY);
    let cargo_fuzz = format!("{TOOLS}/bin/cargo-fuzz");
    if !sh.path_exists(&cargo_fuzz) {
        cmd!(
            sh,
            "cargo install cargo-fuzz --version {VERSION} --locked --root {TOOLS}"
        )
        .run()
        .context("this needs a network once")?;
    }
    let all = all_targets(sh)?;
    if let Some(unknown) = targets.iter().find(|&target| !all.contains(target)) {
        bail!("no fuzz target {unknown}; there are {}", all.join(", "));
    }
    for target in if targets.is_empty() { &all } else { targets } {
        let scratch = sh.current_dir().join("target/fuzz-corpus").join(target);
        fs::create_dir_all(&scratch)?;
        let corpus = Some(sh.current_dir().join("fuzz/corpus").join(target));
        let corpus = corpus.filter(|seeds| seeds.is_dir());
        let runs = format!("-runs={runs}");
        let seed = seed.map(|seed| format!("-seed={seed}"));
        let _nightly = sh.push_env("RUSTUP_TOOLCHAIN", "nightly");
        cmd!(
            sh,
            "{cargo_fuzz} run --fuzz-dir fuzz {target} {scratch} {corpus...} -- {runs} {seed...} -print_final_stats=1"
        )
        .quiet()
        .ignore_stderr()
        .run()
        .with_context(|| format!("{target} found something: `cargo xtask fuzz {target}` shows it"))?;
        eprintln!("{target}: {runs} without a finding");
    }
    Ok(())
}

/// The names of the files in `fuzz/fuzz_targets`.
fn all_targets(sh: &Shell) -> Result<Vec<String>> {
    let mut names: Vec<_> = sh
        .read_dir("fuzz/fuzz_targets")?
        .iter()
        .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    Ok(names)
}
