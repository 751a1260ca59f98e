//! `host-sim sweep`

use std::{
    io::{self, Write},
    num::NonZeroUsize,
    process::ExitCode,
    thread,
};

use anyhow::Context;
use clap::Args;
use host_sim::{
    network::run_all,
    record::{RunRecord, sweep::Sweep},
    report::sweep::sweep_report,
    scenario::Scenario,
};
use indicatif::{ProgressBar, ProgressStyle};

use super::{
    run_outputs::FOR_RESULTS,
    scenario_options::{FOR_SCENARIO, ScenarioOptions},
    sweep_outputs::SweepOutputs,
    values::{self, Seeds},
};

/// Runs a scenario with many seeds, several at a time: how its errors are spread.
///
/// The result is the same for any number of jobs.
#[derive(Args)]
#[command(after_help = EPILOGUE)]
pub(super) struct Arguments {
    #[command(flatten, next_help_heading = FOR_SCENARIO)]
    scenario: ScenarioOptions,
    /// The seeds, both ends included: `1..50` are fifty runs.
    #[arg(long, value_name = "A..B", value_parser = values::seeds)]
    seeds: Seeds,
    /// All these paths with every seed, such as `1,2,3`.
    #[arg(long, value_name = "K,...", value_delimiter = ',', conflicts_with = "path",
        value_parser = values::path)]
    paths: Vec<u64>,
    /// Runs at a time. Default: one for each processor.
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: SweepOutputs,
}

const EPILOGUE: &str = "\
Exit codes:
  0  every camera that should be calibrated is, in every run
  1  one is not
  2  wrong options, an impossible scenario, or a file could not be written";

/// Runs that are named when not all of their cameras were calibrated.
const NAMED: usize = 10;

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    arguments.outputs.check()?;
    let scenarios = scenarios(arguments)?;
    let jobs = match arguments.jobs {
        Some(jobs) => jobs,
        None => thread::available_parallelism().unwrap_or(NonZeroUsize::MIN),
    };
    let bar = bar(scenarios.len());
    let mut sweep = Sweep::default();
    let mut incomplete = Vec::new();
    run_all(&scenarios, jobs, |record| {
        bar.inc(1);
        if record.summary.calibrated < record.summary.expected {
            incomplete.push(name(&record));
        }
        sweep.add(&record).map_err(anyhow::Error::from)
    })?;
    bar.finish_and_clear();
    let report = sweep.finish().context("there are no seeds")?;
    arguments.outputs.write(&report)?;
    let mut text = sweep_report(&report);
    for name in incomplete.iter().take(NAMED) {
        text += &format!("{name}\n");
    }
    if let Some(more @ 1..) = incomplete.len().checked_sub(NAMED) {
        text += &format!("and {more} runs more\n");
    }
    io::stdout().write_all(text.as_bytes())?;
    Ok(ExitCode::from(u8::from(!incomplete.is_empty())))
}

/// One for every path and seed.
fn scenarios(arguments: &Arguments) -> anyhow::Result<Vec<Scenario>> {
    let paths: Vec<_> = match arguments.paths.as_slice() {
        [] => vec![None],
        paths => paths.iter().copied().map(Some).collect(),
    };
    let mut scenarios = Vec::new();
    for path in paths {
        for seed in arguments.seeds.clone() {
            let mut scenario = arguments.scenario.load(Some(seed))?;
            scenario.path = path.unwrap_or(scenario.path);
            scenarios.push(scenario);
        }
    }
    Ok(scenarios)
}

fn name(record: &RunRecord) -> String {
    let path = record
        .path
        .map_or_else(String::new, |path| format!("path {path}, "));
    format!(
        "{path}seed {}: {} of {} cameras calibrated",
        record.seed, record.summary.calibrated, record.summary.expected
    )
}

/// Only where somebody looks: `indicatif` hides it otherwise.
fn bar(runs: usize) -> ProgressBar {
    let bar = ProgressBar::new(runs as u64);
    match ProgressStyle::with_template("{bar:30} run {pos} of {len}, {eta} left") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
