//! `host-sim sweep`

use std::{
    collections::BTreeSet,
    num::NonZeroUsize,
    process::ExitCode,
    sync::atomic::{AtomicBool, Ordering},
    thread,
};

use anyhow::{Context, ensure};
use clap::Args;
use host_sim::network::run_all_until;
use indicatif::{ProgressBar, ProgressStyle};
use results::record::sweep::Sweep;
use site::{ScatterTable, Scenario};

use super::{
    end::End,
    files::Files,
    interrupt,
    run_outputs::FOR_RESULTS,
    scenario_options::{FOR_SCENARIO, ScenarioOptions},
    sweep_outputs::{self, Incomplete, SweepOutputs},
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
    #[arg(long, value_name = "A..B", value_parser = values::seeds, allow_hyphen_values = true)]
    seeds: Seeds,
    /// All these paths with every seed, such as `1,2,3`.
    #[arg(long, value_name = "K,...", value_delimiter = ',', conflicts_with = "path",
        value_parser = values::path)]
    paths: Vec<u64>,
    /// Scatter of cameras around where the scenario has them, standard deviations in its unit and in
    /// degrees, drawn for each seed; 0 for not at all. Default: the scenario's own `scatter`, or 0.3
    /// and 3, so that seeds are not all of one geometry.
    #[arg(long, value_name = "D,DEG", value_parser = values::scatter, allow_hyphen_values = true)]
    scatter: Option<ScatterTable>,
    /// Runs at a time. Default: one for each processor.
    #[arg(long, value_name = "N", value_parser = values::jobs)]
    jobs: Option<NonZeroUsize>,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: SweepOutputs,
}

const EPILOGUE: &str = "\
Exit codes:
  0    every camera that should be calibrated is, in every run, and true errors are what the sigmas
       foretell
  1    one is not, or errors are larger
  2    wrong options, an impossible scenario, or a file could not be written
  130  ended by Ctrl-C or SIGTERM: the results are of the runs before, and say so; a second one ends
       it at once";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let files = Files::default().reads(arguments.scenario.file());
    arguments.outputs.check(files)?;
    let stop = interrupt::watch()?;
    let scenarios = scenarios(arguments, &stop)?;
    let jobs = match arguments.jobs {
        Some(jobs) => jobs,
        None => thread::available_parallelism().unwrap_or(NonZeroUsize::MIN),
    };
    let bar = bar(scenarios.len());
    let (mut sweep, mut incomplete) = (Sweep::default(), Incomplete::default());
    let mut runs = 0;
    run_all_until(&scenarios, jobs, &stop, |record| {
        bar.inc(1);
        runs += 1;
        incomplete.look_at(&record);
        sweep.add(&record).map_err(anyhow::Error::from)
    })
    .map_err(|error| match error.downcast() {
        Ok(error) => arguments.scenario.named(error),
        Err(error) => error,
    })?;
    bar.finish_and_clear();
    let seeds = arguments.seeds.clone().count();
    let all = seeds * arguments.paths.len().max(1);
    let is_stopped = stop.load(Ordering::Relaxed) && runs < all;
    let end = match is_stopped {
        true => End::CutShort(format!("interrupted after {runs} of {all} runs")),
        false => End::Whole,
    };
    if is_stopped && runs == 0 {
        return Ok(interrupt::told());
    }
    let report = sweep.finish().context("there are no seeds")?;
    let ended = sweep_outputs::finish(&report, &incomplete, &arguments.outputs, &end)?;
    Ok(if is_stopped { interrupt::told() } else { ended })
}

/// One scenario for every path and seed, until `stop` is set.
fn scenarios(arguments: &Arguments, stop: &AtomicBool) -> anyhow::Result<Vec<Scenario>> {
    let mut seen = BTreeSet::new();
    for path in &arguments.paths {
        ensure!(
            seen.insert(path),
            "path {path} is named twice: leave one out"
        );
    }
    let paths: Vec<_> = match arguments.paths.as_slice() {
        [] => vec![None],
        paths => paths.iter().copied().map(Some).collect(),
    };
    let mut scenarios = Vec::new();
    for path in paths {
        for seed in arguments.seeds.clone() {
            if stop.load(Ordering::Relaxed) {
                return Ok(scenarios);
            }
            let mut scenario = (arguments.scenario).load(Some(seed), path, arguments.scatter)?;
            if arguments.scatter.is_none() && scenario.scatter.is_none() {
                scenario.scatter = ScatterTable::USUAL;
            }
            scenarios.push(scenario);
        }
    }
    if let Some(first) = scenarios.first() {
        arguments.scenario.tell_assumptions(first);
    }
    Ok(scenarios)
}

/// Only on a terminal: `indicatif` hides it otherwise.
fn bar(runs: usize) -> ProgressBar {
    let bar = ProgressBar::new(runs as u64);
    match ProgressStyle::with_template("{bar:30} run {pos} of {len}, {eta} left") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
