//! `host-sim report`

use std::{
    io::{self, Write},
    path::PathBuf,
    process::ExitCode,
};

use anyhow::bail;
use clap::{Args, Subcommand};
use host_sim::{
    record::{RunRecord, sweep::Sweep, verdict::Verdict},
    report::{
        run::{run_report, runs_report},
        sweep::sweep_report,
    },
};

use super::{
    run_outputs::{FOR_RESULTS, Prepared, RunOutputs, read_record},
    sweep_outputs::SweepOutputs,
};

/// Tables, drawings and exports from the records of finished runs.
#[derive(Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Run(One),
    Runs(Many),
    Sweep(Swept),
}

/// One run: its tables and verdict again, and everything that can be made of it.
#[derive(Args)]
#[command(after_help = RUN_EPILOGUE)]
struct One {
    /// What `--json` wrote.
    #[arg(value_name = "RUN.json")]
    file: PathBuf,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: RunOutputs,
}

/// Runs of one scenario in one table, such as the five placements of `lab`.
#[derive(Args)]
struct Many {
    /// What `--json` wrote.
    #[arg(value_name = "RUN.json", required = true)]
    files: Vec<PathBuf>,
}

/// Quantiles of the errors over many runs of one scenario.
#[derive(Args)]
struct Swept {
    /// What `--json` wrote.
    #[arg(value_name = "RUN.json", required = true)]
    files: Vec<PathBuf>,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: SweepOutputs,
}

const RUN_EPILOGUE: &str = "\
Exit codes:
  0  every camera that should be calibrated is
  1  one is not, or --check found a difference
  2  wrong options, or a file could not be read or written";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match &arguments.what {
        What::Run(one) => {
            let record = read_record(&one.file)?;
            let which = (record.scenario.as_str(), record.path);
            finish(&record, &one.outputs.prepare(which, &[])?)
        }
        What::Runs(many) => together(&many.files),
        What::Sweep(swept) => sweep(swept),
    }
}

/// How every run ends: its report on the screen, its files, and its exit code.
pub(super) fn finish(record: &RunRecord, outputs: &Prepared<'_>) -> anyhow::Result<ExitCode> {
    let difference = outputs.write(record)?;
    let mut code = Verdict::of(record).exit_code();
    let mut text = run_report(record);
    if let Some(difference) = difference {
        text += &format!("\n{difference}");
        code = code.max(difference.exit_code());
    }
    io::stdout().write_all(text.as_bytes())?;
    Ok(ExitCode::from(code))
}

fn together(files: &[PathBuf]) -> anyhow::Result<ExitCode> {
    let records: Vec<RunRecord> = files
        .iter()
        .map(|f| read_record(f))
        .collect::<Result<_, _>>()?;
    let first = records.first().map(|record| &record.scenario);
    if records.iter().any(|record| Some(&record.scenario) != first) {
        bail!("the runs are of different scenarios");
    }
    let text = runs_report(&records.iter().collect::<Vec<_>>());
    io::stdout().write_all(text.as_bytes())?;
    let complete = records
        .iter()
        .all(|record| Verdict::of(record).is_complete());
    Ok(ExitCode::from(u8::from(!complete)))
}

fn sweep(swept: &Swept) -> anyhow::Result<ExitCode> {
    let mut sweep = Sweep::default();
    for file in &swept.files {
        sweep.add(&read_record(file)?)?;
    }
    if let Some(report) = sweep.finish() {
        swept.outputs.write(&report)?;
        io::stdout().write_all(sweep_report(&report).as_bytes())?;
    }
    Ok(ExitCode::SUCCESS)
}
