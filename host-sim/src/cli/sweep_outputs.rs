//! Where the statistics of many runs go.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use answers::plot;
use answers::record::{RunRecord, sweep::SweepReport, verdict::Verdict};
use answers::report::sweep::sweep_report;
use clap::Args;

use super::{and, print, run_outputs::write, values, writable};

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
    /// Finds out what cannot be written before there is anything to write.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        let files = [&self.sweep_csv, &self.sweep_plot];
        let files: Vec<&Path> = files.into_iter().flatten().map(PathBuf::as_path).collect();
        writable::check(&files, None)
    }

    /// Writes what was asked for. Each failure is told or returned, and none keeps the others from
    /// being written.
    fn write(&self, report: &SweepReport) -> anyhow::Result<()> {
        let mut written = Ok(());
        if let Some(path) = &self.sweep_csv {
            let csv = report.to_csv().map_err(anyhow::Error::from);
            written = and(written, write(path, csv));
        }
        if let Some(path) = &self.sweep_plot {
            let svg = plot::sweep(report).map_err(anyhow::Error::from);
            written = and(written, write(path, svg));
        }
        written
    }
}

/// Runs not all of whose cameras were calibrated, or whose true errors are not what the sigmas foretell.
#[derive(Default)]
pub(super) struct Incomplete(Vec<String>);

impl Incomplete {
    /// So many are named, the others counted.
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

/// How a sweep ends: its tables on the screen first, its files, and its exit code.
pub(super) fn finish(
    report: &SweepReport,
    incomplete: &Incomplete,
    outputs: &SweepOutputs,
) -> anyhow::Result<ExitCode> {
    let Incomplete(names) = incomplete;
    let mut text = sweep_report(report);
    for name in names.iter().take(Incomplete::NAMED) {
        text += &format!("{name}\n");
    }
    if let Some(more @ 1..) = names.len().checked_sub(Incomplete::NAMED) {
        text += &format!("and {more} runs more\n");
    }
    let printed = print(&text).map_err(anyhow::Error::from);
    and(printed, outputs.write(report))?;
    Ok(ExitCode::from(u8::from(!names.is_empty())))
}
