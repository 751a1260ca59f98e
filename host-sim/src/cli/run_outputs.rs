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

use super::{file_name, values};

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

impl RunOutputs {
    /// Writes what was asked for, and compares. The comparison, if one was asked for, is for the
    /// screen.
    pub(super) fn write(&self, record: &RunRecord) -> anyhow::Result<Option<Difference>> {
        // A file named for both is read before it is written.
        let difference = match &self.check {
            Some(path) => Some(self.compare(record, path)?),
            None => None,
        };
        if let Some(path) = &self.json {
            write(path, &record.to_json(self.wall)?)?;
        }
        if let Some(path) = &self.csv {
            write(path, &export::csv(record)?)?;
        }
        if let Some(path) = &self.yaml {
            write(path, &export::yaml(record)?)?;
        }
        if let Some(path) = &self.ros {
            write(path, &export::ros_launch(record)?)?;
        }
        if let Some(folder) = &self.plots {
            let drawings: [(&str, Draw); 3] = [
                ("map.svg", plot::map),
                ("errors.svg", plot::errors),
                ("residuals.svg", plot::residuals),
            ];
            for (name, draw) in drawings {
                let path = folder.join(name);
                let svg =
                    draw(record).with_context(|| format!("{} is not written", file_name(&path)))?;
                write_into(folder, &path, &svg)?;
            }
        }
        Ok(difference)
    }

    fn compare(&self, record: &RunRecord, path: &Path) -> anyhow::Result<Difference> {
        let other = read_record(path)?;
        Difference::between(record, &other, self.tolerance)
            .with_context(|| format!("the run cannot be compared with {}", file_name(path)))
    }
}

type Draw = fn(&RunRecord) -> Result<String, plot::PlotError>;

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
