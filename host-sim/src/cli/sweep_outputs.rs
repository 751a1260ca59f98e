//! Where the statistics of many runs go besides the screen.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;
use host_sim::{plot, record::sweep::SweepReport};

use super::{file_name, run_outputs, writable};

#[derive(Args)]
pub(super) struct SweepOutputs {
    /// Quantiles of the errors: one row per camera, or stop, and quantity.
    #[arg(long, value_name = "FILE.csv")]
    sweep_csv: Option<PathBuf>,
    /// Draw the quantiles.
    #[arg(long, value_name = "FILE.svg")]
    sweep_plot: Option<PathBuf>,
}

impl SweepOutputs {
    /// Finds out what cannot be written before there is anything to write.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        let files = [&self.sweep_csv, &self.sweep_plot];
        let files: Vec<&Path> = files.into_iter().flatten().map(PathBuf::as_path).collect();
        writable::check(&files, None)
    }

    /// Writes what was asked for.
    pub(super) fn write(&self, report: &SweepReport) -> anyhow::Result<()> {
        if let Some(path) = &self.sweep_csv {
            run_outputs::write(path, &report.to_csv()?)?;
        }
        if let Some(path) = &self.sweep_plot {
            let svg = plot::sweep(report);
            let svg = svg.with_context(|| format!("{} is not written", file_name(path)))?;
            run_outputs::write(path, &svg)?;
        }
        Ok(())
    }
}
