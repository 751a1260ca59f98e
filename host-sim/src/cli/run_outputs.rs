//! Where a run's results go besides the screen.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::Context;
use clap::Args;
use host_sim::{
    export, plot,
    record::{RunRecord, difference::Difference},
};

use super::{file_name, values, writable};

/// Heading for the options of every command that ends with a run's record.
pub(super) const FOR_RESULTS: &str = "Results";

#[derive(Args)]
pub(super) struct RunOutputs {
    /// The whole record: poses, errors, residuals, stops, traffic.
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Put `wall_seconds`, the time the computer took, into the record too.
    ///
    /// Without it the record of a scenario and seed is the same every time, byte for byte.
    #[arg(long, requires = "json")]
    wall: bool,
    /// Draw map.svg, errors.svg and residuals.svg into this folder.
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    /// Poses with covariance, truth and errors, one camera per row.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Poses with covariance.
    #[arg(long, value_name = "FILE.yaml")]
    yaml: Option<PathBuf>,
    /// A ROS 2 launch file of static transforms, with covariance: `ros2 launch FILE`.
    #[arg(long, value_name = "FILE.launch.yaml")]
    ros: Option<PathBuf>,
    /// Compare with the record of another run of this scenario; exit code 1 if they differ.
    #[arg(long, value_name = "FILE.json")]
    check: Option<PathBuf>,
    /// Numbers may differ by this times the larger of 1 and their size.
    #[arg(long, value_name = "X", value_parser = values::not_negative, default_value_t = 0.0)]
    tolerance: f64,
}

/// Results that can be written, and the record to compare with.
pub(super) struct Prepared<'a> {
    outputs: &'a RunOutputs,
    other: Option<(&'a Path, RunRecord)>,
}

impl RunOutputs {
    /// Finds out what would go wrong after a run of this scenario and path before it. `more` are
    /// files that are written too.
    pub(super) fn prepare<'a>(
        &'a self,
        (scenario, path): (&str, Option<u32>),
        more: &[&Path],
    ) -> anyhow::Result<Prepared<'a>> {
        let files = [&self.json, &self.csv, &self.yaml, &self.ros];
        let files = files.into_iter().flatten().map(PathBuf::as_path);
        let files: Vec<&Path> = files.chain(more.iter().copied()).collect();
        let drawings = DRAWINGS.map(|(name, _)| name);
        let folder = self.plots.as_deref().map(|folder| (folder, &drawings[..]));
        writable::check(&files, folder)?;
        // A file named for both is read before it is written.
        let other = match &self.check {
            Some(file) => {
                let other = read_record(file)?;
                Difference::is_possible(scenario, path, &other)
                    .with_context(|| cannot_be_compared(file))?;
                Some((file.as_path(), other))
            }
            None => None,
        };
        Ok(Prepared {
            outputs: self,
            other,
        })
    }
}

impl Prepared<'_> {
    /// Writes what was asked for, and compares. The comparison, if one was asked for, is for the
    /// screen.
    pub(super) fn write(&self, record: &RunRecord) -> anyhow::Result<Option<Difference>> {
        let outputs = self.outputs;
        if let Some(path) = &outputs.json {
            write(path, &record.to_json(outputs.wall)?)?;
        }
        if let Some(path) = &outputs.csv {
            write(path, &export::csv(record)?)?;
        }
        if let Some(path) = &outputs.yaml {
            write(path, &export::yaml(record)?)?;
        }
        if let Some(path) = &outputs.ros {
            write(path, &export::ros_launch(record)?)?;
        }
        if let Some(folder) = &outputs.plots {
            for (name, draw) in DRAWINGS {
                let path = folder.join(name);
                let svg =
                    draw(record).with_context(|| format!("{} is not written", file_name(&path)))?;
                write_into(folder, &path, &svg)?;
            }
        }
        match &self.other {
            Some((path, other)) => {
                let difference = Difference::between(record, other, outputs.tolerance);
                Ok(Some(difference.with_context(|| cannot_be_compared(path))?))
            }
            None => Ok(None),
        }
    }
}

type Draw = fn(&RunRecord) -> Result<String, plot::PlotError>;

/// What `--plots` makes.
const DRAWINGS: [(&str, Draw); 3] = [
    ("map.svg", plot::map),
    ("errors.svg", plot::errors),
    ("residuals.svg", plot::residuals),
];

fn cannot_be_compared(path: &Path) -> String {
    format!("the run cannot be compared with {}", file_name(path))
}

/// Reads a record.
pub(super) fn read_record(path: &Path) -> anyhow::Result<RunRecord> {
    let name = || file_name(path);
    let text = fs::read_to_string(path).with_context(|| format!("{} cannot be read", name()))?;
    RunRecord::from_json(&text).with_context(|| format!("{} cannot be used", name()))
}

/// Writes a file.
pub(super) fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    fs::write(path, text).with_context(|| format!("{} cannot be written", file_name(path)))
}

/// Writes a file into a folder, which is made if it is not there.
pub(super) fn write_into(folder: &Path, path: &Path, text: &str) -> anyhow::Result<()> {
    fs::create_dir_all(folder)
        .with_context(|| format!("the folder {} cannot be made", file_name(folder)))?;
    write(path, text)
}
