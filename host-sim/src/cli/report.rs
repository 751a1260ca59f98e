//! `host-sim report`

use std::{path::PathBuf, process::ExitCode};

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use results::record::{
    RunRecord,
    event::{Event, of_record},
    sweep::Sweep,
    verdict::Verdict,
};
use results::report::run::runs_report;

use super::{
    and,
    end::End,
    files::{Files, check_different},
    print,
    run_outputs::{FOR_RESULTS, Prepared, RunOutputs, read_record, read_whole, write},
    sweep_outputs::{self, Incomplete, SweepOutputs},
    values,
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
    /// Record that `--json` wrote.
    #[arg(value_name = "RUN.json")]
    file: PathBuf,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: RunOutputs,
    /// Events, as far as the record tells when they happened, one line of JSON each (docs/events.md).
    #[arg(long, value_name = "FILE", value_parser = values::result())]
    events: Option<PathBuf>,
    /// The page of `host-sim live` with it, in one file that a browser opens anywhere.
    #[arg(long, value_name = "FILE.html", value_parser = values::result())]
    report: Option<PathBuf>,
}

/// Runs of one scenario in one table, such as the five placements of `lab`.
#[derive(Args)]
#[command(after_help = MANY_EPILOGUE)]
struct Many {
    /// Records that `--json` wrote.
    #[arg(value_name = "RUN.json", required = true)]
    files: Vec<PathBuf>,
}

/// Quantiles of the errors over many runs of one scenario.
#[derive(Args)]
#[command(after_help = SWEPT_EPILOGUE)]
struct Swept {
    /// Records that `--json` wrote.
    #[arg(value_name = "RUN.json", required = true)]
    files: Vec<PathBuf>,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: SweepOutputs,
}

const RUN_EPILOGUE: &str = "\
Exit codes:
  0  every camera that should be calibrated is, and true errors are what the sigmas foretell
  1  one is not, or errors are larger, the run was cut short, or --check found a difference
  2  wrong options, or a file could not be read or written";

const MANY_EPILOGUE: &str = "\
Exit codes:
  0  every camera that should be calibrated is, in every run, and true errors are what the sigmas
     foretell
  1  one is not, or errors are larger
  2  wrong options, runs of different scenarios, or a file could not be read";

const SWEPT_EPILOGUE: &str = "\
Exit codes:
  0  every camera that should be calibrated is, in every run, and true errors are what the sigmas
     foretell
  1  one is not, or errors are larger
  2  wrong options, runs of different scenarios, or a file could not be read or written";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    match &arguments.what {
        What::Run(one) => {
            let (record, end) = read_record(&one.file)?;
            let which = (record.scenario.as_str(), record.path);
            let files = Files::default()
                .reads([&one.file])
                .writes([&one.events, &one.report].into_iter().flatten());
            let ended = finish(&record, &one.outputs.prepare(which, files)?, &end);
            and(ended, happened(one, &record, &end))
        }
        What::Runs(many) => together(&many.files),
        What::Sweep(swept) => sweep(swept),
    }
}

/// Ends every run: its report on the screen, its files, and its exit code. The report comes first,
/// because it may have taken long and no file can be in its way; each failure is told or
/// returned.
pub(super) fn finish(
    record: &RunRecord,
    outputs: &Prepared<'_>,
    end: &End,
) -> anyhow::Result<ExitCode> {
    let verdict = Verdict::of(record);
    let mut code = verdict.exit_code();
    let mut text = end.mark_text(outputs.screen(record, &verdict));
    if *end != End::Whole {
        code = code.max(1);
    }
    let compared = outputs.compare(record).map(|difference| {
        if let Some(difference) = difference {
            text += &format!("\n{difference}");
            code = code.max(difference.exit_code());
        }
    });
    let ended = and(compared, print(&text).map_err(anyhow::Error::from));
    and(ended, outputs.write(record, end)).map(|()| ExitCode::from(code))
}

/// Writes the events that a record tells, and the page of them.
fn happened(one: &One, record: &RunRecord, end: &End) -> anyhow::Result<()> {
    if one.events.is_none() && one.report.is_none() {
        return Ok(());
    }
    let events = of_record(record, end.why());
    let mut written = Ok(());
    if let Some(path) = &one.events {
        let lines: Result<String, _> = events.iter().map(Event::to_line).collect();
        written = and(written, write(path, lines.map_err(Into::into)));
    }
    if let Some(path) = &one.report {
        let page = host_sim::live::report(&events).map_err(Into::into);
        written = and(written, write(path, page));
    }
    written
}

fn together(files: &[PathBuf]) -> anyhow::Result<ExitCode> {
    // A run that is named twice would count twice.
    check_different(files)?;
    let records: Vec<RunRecord> = files
        .iter()
        .map(|f| read_whole(f))
        .collect::<Result<_, _>>()?;
    let first = records.first().map(|record| &record.scenario);
    if records.iter().any(|record| Some(&record.scenario) != first) {
        bail!("the runs are of different scenarios");
    }
    print(&runs_report(&records.iter().collect::<Vec<_>>()))?;
    let codes = records.iter().map(|record| Verdict::of(record).exit_code());
    Ok(ExitCode::from(codes.max().unwrap_or_default()))
}

fn sweep(swept: &Swept) -> anyhow::Result<ExitCode> {
    check_different(&swept.files)?;
    swept.outputs.check(Files::default().reads(&swept.files))?;
    let (mut sweep, mut incomplete) = (Sweep::default(), Incomplete::default());
    for file in &swept.files {
        let record = read_whole(file)?;
        incomplete.look_at(&record);
        sweep.add(&record)?;
    }
    let report = sweep.finish().context("there are no runs")?;
    sweep_outputs::finish(&report, &incomplete, &swept.outputs, &End::Whole)
}
