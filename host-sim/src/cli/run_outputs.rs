//! Files for a run's results, besides the screen.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail, ensure};
use clap::{Args, ValueEnum};
use results::export::{self, Frame};
use results::plot;
use results::record::{RunRecord, difference::Difference, event, verdict::Verdict};
use results::report;

use super::{OfFile, and, end::End, file_name, files::Files, values, whole_file};

/// Heading for the options of every command that ends with a run's record.
pub(super) const FOR_RESULTS: &str = "Results";

/// Outputs of every record, of a rehearsal and of a real network.
#[derive(Args)]
pub(super) struct RecordOutputs {
    /// Tell everything else too: the whole verdict, true poses, statistics, traffic, times.
    #[arg(long)]
    details: bool,
    /// The whole record: poses, status, errors, residuals, stops, traffic.
    #[arg(long, value_name = "FILE.json", value_parser = values::result())]
    json: Option<PathBuf>,
    /// Draw map.svg, errors.svg and residuals.svg into this folder.
    #[arg(long, value_name = "DIR", value_parser = values::result())]
    plots: Option<PathBuf>,
    /// Poses with status and covariance, truth and errors where known, one camera per row.
    #[arg(long, value_name = "FILE.csv", value_parser = values::result())]
    csv: Option<PathBuf>,
    /// Poses with status and covariance.
    #[arg(long, value_name = "FILE.yaml", value_parser = values::result())]
    yaml: Option<PathBuf>,
    /// A ROS 2 launch file of static transforms of calibrated cameras, with covariance: `ros2 launch
    /// FILE`.
    #[arg(long, value_name = "FILE.launch.yaml", value_parser = values::result())]
    ros: Option<PathBuf>,
    /// Coordinates in which --csv, --yaml and --ros tell poses. Default: the building's, where the site file
    /// tells the places of the references, or else the network's.
    #[arg(long, value_name = "WHOSE")]
    frame: Option<FrameOption>,
}

#[derive(Clone, Copy, ValueEnum)]
enum FrameOption {
    /// Each network's: the first reference is the origin, the second one on the x axis.
    Network,
    /// The building's, in which the site file has its places.
    Building,
}

impl From<FrameOption> for Frame {
    fn from(option: FrameOption) -> Self {
        match option {
            FrameOption::Network => Self::Network,
            FrameOption::Building => Self::Building,
        }
    }
}

impl RecordOutputs {
    /// The screen of a run with this verdict: the answer, and all details if they were asked for.
    pub(super) fn screen(&self, record: &RunRecord, verdict: &Verdict) -> String {
        let answer = report::run::answer(record, verdict);
        match self.details {
            true => format!("{answer}\n{}", report::run::details(record, verdict)),
            false => answer,
        }
    }

    /// Finds out which files cannot be written before there is anything to write. There may be other
    /// files besides.
    pub(super) fn check<'a>(&'a self, others: Files<'a>) -> anyhow::Result<()> {
        let results = [&self.json, &self.csv, &self.yaml, &self.ros];
        let files = others.writes(results.into_iter().flatten());
        files.writes_into(&self.plots, &DRAWING_NAMES).check()
    }

    /// Writes the outputs that were asked for. Each failure is told or returned, and none keeps the
    /// others from being written.
    pub(super) fn write(&self, record: &RunRecord, wall: bool, end: &End) -> anyhow::Result<()> {
        let told = self.frame.map(Frame::from);
        let frame = told.unwrap_or_else(|| Frame::for_people(record));
        let texts: [(&Option<PathBuf>, Make<'_>); 4] = [
            (&self.json, &|| Ok(end.mark_json(record.to_json(wall)?))),
            (&self.csv, &|| {
                Ok(end.mark_lines(export::csv(record, frame)?))
            }),
            (&self.yaml, &|| {
                Ok(end.mark_lines(export::yaml(record, frame)?))
            }),
            (&self.ros, &|| {
                Ok(end.mark_lines(export::ros_launch(record, frame)?))
            }),
        ];
        let mut written = Ok(());
        for (path, make) in texts {
            if let Some(path) = path {
                written = and(written, write(path, make()));
            }
        }
        if let Some(folder) = &self.plots {
            let made = fs::create_dir_all(folder).with_context(|| OfFile::unmade(folder));
            let is_there = made.is_ok();
            written = and(written, made);
            for (name, draw) in DRAWINGS.iter().filter(|_| is_there) {
                let svg = draw(record).map(|svg| end.mark_svg(svg));
                let svg = svg.map_err(anyhow::Error::from);
                written = and(written, write(&folder.join(name), svg));
            }
        }
        written
    }
}

#[derive(Args)]
pub(super) struct RunOutputs {
    #[command(flatten)]
    record: RecordOutputs,
    /// Put `wall_seconds`, the time the computer took, into the record too.
    ///
    /// Without it the record of a scenario and seed is the same every time, byte for byte.
    #[arg(long, requires = "json")]
    wall: bool,
    /// Compare with the record of another run of this scenario; exit code 1 if they differ.
    #[arg(long, value_name = "FILE.json")]
    check: Option<PathBuf>,
    /// Numbers may differ by this times the larger of 1 and their size.
    #[arg(long, value_name = "X", value_parser = values::not_negative, default_value_t = 0.0,
        requires = "check")]
    tolerance: f64,
}

/// Results that can be written, and the record to compare with.
pub(super) struct Prepared<'a> {
    outputs: &'a RunOutputs,
    other: Option<(&'a Path, RunRecord)>,
}

impl RunOutputs {
    /// Finds out before a run of this scenario and path what would go wrong after it. There may be
    /// other files besides the results.
    pub(super) fn prepare<'a>(
        &'a self,
        (scenario, path): (&str, Option<u32>),
        others: Files<'a>,
    ) -> anyhow::Result<Prepared<'a>> {
        self.record.check(others.reads(&self.check))?;
        let other = match &self.check {
            Some(file) => {
                whole_file::check_regular(file)?;
                let other = read_whole(file)?;
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
    /// The screen of a run with this verdict.
    pub(super) fn screen(&self, record: &RunRecord, verdict: &Verdict) -> String {
        self.outputs.record.screen(record, verdict)
    }

    /// Writes the outputs that were asked for. Each failure is told or returned, and none keeps the
    /// others from being written.
    pub(super) fn write(&self, record: &RunRecord, end: &End) -> anyhow::Result<()> {
        self.outputs.record.write(record, self.outputs.wall, end)
    }

    /// The comparison for the screen, if one was asked for.
    pub(super) fn compare(&self, record: &RunRecord) -> anyhow::Result<Option<Difference>> {
        match &self.other {
            Some((path, other)) => {
                let difference = Difference::between(record, other, self.outputs.tolerance);
                Ok(Some(difference.with_context(|| cannot_be_compared(path))?))
            }
            None => Ok(None),
        }
    }
}

/// Makes the text of a result.
type Make<'m> = &'m dyn Fn() -> anyhow::Result<String>;
type Draw = fn(&RunRecord) -> Result<String, plot::PlotError>;

/// Drawings that `--plots` makes.
const DRAWINGS: [(&str, Draw); 3] = [
    ("map.svg", plot::map),
    ("errors.svg", plot::errors),
    ("residuals.svg", plot::residuals),
];

const DRAWING_NAMES: [&str; 3] = [DRAWINGS[0].0, DRAWINGS[1].0, DRAWINGS[2].0];

fn cannot_be_compared(path: &Path) -> String {
    format!("the run cannot be compared with {}", file_name(path))
}

/// Far longer than the record of the largest network, and far less than a computer's memory.
const RECORD_MAX: u64 = 1 << 30;

/// Reads a record, and how its run ended.
pub(super) fn read_record(path: &Path) -> anyhow::Result<(RunRecord, End)> {
    let text = whole_file::read(path, RECORD_MAX)?;
    let record = RunRecord::from_json(&text).map_err(anyhow::Error::from);
    ensure!(
        record.is_ok() || event::read(text.as_bytes()).is_err(),
        "{0} is a file of events: `host-sim live {0}` shows it",
        file_name(path)
    );
    let both = record.and_then(|record| Ok((record, End::of_json(&text)?)));
    both.with_context(|| format!("{} cannot be used", file_name(path)))
}

/// Reads the record of a run that was not cut short: others are neither compared nor counted.
pub(super) fn read_whole(path: &Path) -> anyhow::Result<RunRecord> {
    match read_record(path)? {
        (record, End::Whole) => Ok(record),
        (_, End::CutShort(why)) => {
            let name = file_name(path);
            bail!(
                "{name} cannot be used: its run was cut short, {why}: leave it out, or run it again"
            )
        }
    }
}

/// Writes a file, if its text could be made.
pub(super) fn write(path: &Path, text: anyhow::Result<String>) -> anyhow::Result<()> {
    let text = text.with_context(|| format!("{} is not written", file_name(path)))?;
    whole_file::write(path, text)
}
