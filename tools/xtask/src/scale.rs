//! Instructions of short fixed runs of `host-sim`, beside those that are written down: speed is not lost, or
//! won, unnoticed.
//!
//! Valgrind counts them, on a processor of its own, so that they are the same on every machine; hashes in an order
//! of their own change them in the fifth digit. The program is that of the tests.

use std::{collections::BTreeMap, fs, path::PathBuf, process::Command, thread};

use anyhow::{Context, Result, ensure};
use serde_json::{Value, json};
use xshell::Shell;

use crate::harness;

/// Earlier counts, in this repository.
const TABLE: &str = "tools/bench/scale.json";

/// A count that differs by more than this share is told as an error.
const TOLERANCE: f64 = 0.05;

/// Set to anything, the counts are written down instead of compared.
const UPDATE: &str = "UPDATE_SCALE";

/// Runs: a whole network with all that is around it; two that do not hear each other; answers to recorded
/// sightings.
const RUNS: [(&str, &[&str]); 3] = [
    ("run lab", &["run", "lab"]),
    ("run grid --nodes 26", &["run", "grid", "--nodes", "26"]),
    (
        "solve mrclam9",
        &[
            "solve",
            "tests/data/mrclam/mrclam9_every5th_sightings.csv",
            "--json",
        ],
    ),
];

/// Counts, and compares with the earlier counts.
///
/// # Errors
/// A count differs by more than a twentieth, up or down.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let program = harness::program(sh, "host-sim")?;
    let counts = thread::scope(|scope| {
        let program = &program;
        let counting = RUNS
            .map(|(name, arguments)| (name, scope.spawn(move || instructions(program, arguments))));
        let counted = counting.into_iter().map(|(name, thread)| {
            let count = thread.join().ok().context("it could not be counted")?;
            Ok((name.to_owned(), count.with_context(|| name.to_owned())?))
        });
        counted.collect::<Result<BTreeMap<String, u64>>>()
    })?;
    if std::env::var_os(UPDATE).is_some() {
        let table = serde_json::to_string_pretty(&json!({ "instructions": counts }))?;
        fs::write(TABLE, table + "\n").context(TABLE)?;
    }
    let text = fs::read_to_string(TABLE).context(TABLE)?;
    let table: Value = serde_json::from_str(&text).context(TABLE)?;
    let known = |name: &str| table["instructions"][name].as_u64();
    let mut missed = Vec::new();
    for (name, &count) in &counts {
        let before = known(name).with_context(|| format!("{TABLE} has no `{name}`"))?;
        let share = count as f64 / before as f64 - 1.0;
        let is_same = share.abs() <= TOLERANCE;
        let mark = if is_same { "" } else { "  MISSED" };
        println!(
            "  {name:<28} {:>10.1} million, written down {:>10.1}: {:+.1} %{mark}",
            count as f64 / 1e6,
            before as f64 / 1e6,
            share * 100.0
        );
        if !is_same {
            missed.push(format!("`{name}` {:+.1} %", share * 100.0));
        }
    }
    ensure!(
        missed.is_empty(),
        "instructions differ from those of {TABLE}: {}. If that is meant, write them down: run this again with \
         {UPDATE}=1",
        missed.join(", ")
    );
    Ok(())
}

/// Instructions of one run.
fn instructions(program: &PathBuf, arguments: &[&str]) -> Result<u64> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(program)
        .args(arguments)
        .output()?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(
        matches!(output.status.code(), Some(0 | 1)),
        "{said}{}",
        output.status
    );
    collected(&said).with_context(|| format!("valgrind told no count: {said}"))
}

/// Count from the line `==1234== Collected : 5678`.
fn collected(said: &str) -> Option<u64> {
    let line = said.lines().rfind(|line| line.contains("Collected :"))?;
    line.rsplit_once(": ")?.1.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_count_is_read() {
        let said =
            "==7== Events    : Ir\n==7== Collected : 5678\n==7== \n==7== I   refs:      5,678\n";
        assert_eq!(collected(said), Some(5678));
        assert_eq!(collected("==7== Collected : \n"), None);
        assert_eq!(collected("killed"), None);
    }

    /// Every run has its count, and no count is left of a run that went.
    #[test]
    fn what_is_written_down_is_what_is_run() {
        let table = concat!(env!("CARGO_MANIFEST_DIR"), "/../bench/scale.json");
        let table: Value = serde_json::from_str(&fs::read_to_string(table).unwrap()).unwrap();
        let written = table["instructions"].as_object().unwrap();
        let mut run: Vec<_> = RUNS.iter().map(|(name, _)| *name).collect();
        run.sort_unstable();
        assert!(written.keys().eq(run));
    }
}
