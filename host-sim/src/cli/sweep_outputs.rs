//! Files for the statistics of many runs.

use std::{path::PathBuf, process::ExitCode};

use clap::Args;
use results::plot;
use results::record::{RunRecord, sweep::SweepReport, verdict::Verdict};
use results::report::sweep::sweep_report;

use super::{and, end::End, files::Files, print, run_outputs::write, values};

#[derive(Args)]
pub(super) struct SweepOutputs {
    /// Quantiles of the errors: one row per camera, or stop, and quantity.
    #[arg(long, value_name = "FILE.csv", value_parser = values::result())]
    sweep_csv: Option<PathBuf>,
    /// Draw the quantiles.
    #[arg(long, value_name = "FILE.svg", value_parser = values::result())]
    sweep_plot: Option<PathBuf>,
}

impl SweepOutputs {
    /// Finds out which files cannot be written before there is anything to write. Some files are read.
    pub(super) fn check<'a>(&'a self, read: Files<'a>) -> anyhow::Result<()> {
        let results = [&self.sweep_csv, &self.sweep_plot];
        read.writes(results.into_iter().flatten()).check()
    }

    /// Writes the outputs that were asked for. Each failure is told or returned, and none keeps the
    /// others from being written.
    fn write(&self, report: &SweepReport, end: &End) -> anyhow::Result<()> {
        let mut written = Ok(());
        if let Some(path) = &self.sweep_csv {
            let csv = report.to_csv().map(|csv| end.mark_lines(csv));
            let csv = csv.map_err(anyhow::Error::from);
            written = and(written, write(path, csv));
        }
        if let Some(path) = &self.sweep_plot {
            let svg = plot::sweep(report).map(|svg| end.mark_svg(svg));
            let svg = svg.map_err(anyhow::Error::from);
            written = and(written, write(path, svg));
        }
        written
    }
}

/// Runs in which a camera is not calibrated, or whose true errors are not what the sigmas foretell.
#[derive(Default)]
pub(super) struct Incomplete(Vec<String>);

impl Incomplete {
    /// Number of runs that are named; the others are counted.
    const NAMED: usize = 10;

    /// Keeps the name of such a run.
    pub(super) fn look_at(&mut self, record: &RunRecord) {
        let summary = &record.summary;
        let verdict = Verdict::of(record);
        if !verdict.is_good() {
            let path = record
                .path
                .map_or_else(String::new, |path| format!("path {path}, "));
            let seed = record.seed.unwrap_or_default();
            let errors = if verdict.deceives {
                "; true errors are larger than foretold"
            } else {
                ""
            };
            self.0.push(format!(
                "{path}seed {seed}: {} of {} cameras calibrated{errors}",
                summary.calibrated, summary.expected
            ));
        }
    }
}

/// Ends a sweep: its tables on the screen first, its files, and its exit code.
pub(super) fn finish(
    report: &SweepReport,
    incomplete: &Incomplete,
    outputs: &SweepOutputs,
    end: &End,
) -> anyhow::Result<ExitCode> {
    let Incomplete(names) = incomplete;
    let mut text = end.mark_text(sweep_report(report));
    for name in names.iter().take(Incomplete::NAMED) {
        text += &format!("{name}\n");
    }
    if let Some(more @ 1..) = names.len().checked_sub(Incomplete::NAMED) {
        text += &format!("and {more} runs more\n");
    }
    let printed = print(&text).map_err(anyhow::Error::from);
    and(printed, outputs.write(report, end))?;
    Ok(ExitCode::from(u8::from(!names.is_empty())))
}
