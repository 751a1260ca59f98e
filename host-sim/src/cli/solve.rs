//! `host-sim solve`

use std::{
    fs::File,
    io::{self, BufReader, BufWriter, Read, Seek, StdoutLock, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::bail;
use calib_core::{Status, camera::Projection, resection::USUAL_LENS_SIGMA};
use clap::Args;
use nalgebra::Point2;
use results::accuracy::Comparisons;
use results::answer::{self, Answer, Reason, Settings, Solver, Tally};
use results::lens::{self, Misfit};
use results::plot::{self, Map, MapCamera};
use results::recorded::{
    self, ReadError,
    sightings::{self, Assumptions, Case, Recording, Survey},
    truth::{self, Truth},
};
use results::report::{
    json::PoseLine,
    table::{PoseTable, Words},
};

use super::{
    camera_options::{CameraOptions, FOR_COLUMNS, USUAL_COLUMNS},
    file_name,
    files::Files,
    messages::{self, Messages, tell_assumed_sigma, tell_passed_over},
    of_file,
    run_outputs::write,
    solve_space::{self, SpaceOptions},
    tell, unless_gone, values,
};

/// Poses of cameras from recorded sightings of targets at known places.
///
/// Every case gets one answer, in the order of the file: a pose with its predicted standard
/// deviations, or the reason why there is none. Three sightings of a case are the least.
#[derive(Args)]
#[command(after_long_help = EPILOGUE)]
pub(super) struct Arguments {
    /// Sightings, or `-` for the standard input.
    #[arg(value_name = "FILE.csv")]
    file: PathBuf,
    /// Standard deviation of bearings, radians, for files without a column `sigma_rad`.
    ///
    /// Without it: that of whole pixels for `column`, 0.0087 (half a degree) for `bearing_rad`.
    #[arg(long, value_name = "RAD", value_parser = values::positive)]
    bearing_sigma: Option<f64>,
    /// Standard deviation of the targets' places, for files without a column `target_sigma`.
    ///
    /// Without it: 0 in the plane, 0.0005 with --lenses.
    #[arg(long, value_name = "LENGTH", value_parser = values::not_negative)]
    target_sigma: Option<f64>,
    /// Drop sightings more than this many sigmas off the pose that most others agree on.
    ///
    /// Needs five sightings of a case to find a wrong one, four to notice it. 3 to 5 are usual.
    #[arg(long, value_name = "SIGMAS", value_parser = values::positive)]
    reject: Option<f64>,
    /// Call poses weak whose predicted standard deviation of position is above this.
    #[arg(long, value_name = "LENGTH", value_parser = values::positive)]
    max_sigma: Option<f64>,
    /// True poses to compare with: columns `case`, `x`, `y`, `theta_rad`.
    #[arg(long, value_name = "FILE.csv")]
    truth: Option<PathBuf>,
    /// Draw a map of the answers.
    #[arg(long, value_name = "FILE.svg", value_parser = values::result())]
    plot: Option<PathBuf>,
    /// One JSON object per line instead of a table.
    #[arg(long)]
    json: bool,
    /// Name of the unit of length of the file, for headings and axes.
    #[arg(long, value_name = "NAME", default_value = "m")]
    unit: String,
    #[command(flatten, next_help_heading = FOR_COLUMNS)]
    camera: CameraOptions,
    /// Standard deviation of the lens's focal length, relative to it.
    #[arg(
        long, value_name = "SHARE", value_parser = values::positive, requires = "fov_deg",
        default_value_t = USUAL_LENS_SIGMA
    )]
    lens_sigma: f64,
    #[command(flatten, next_help_heading = "Cameras in space")]
    space: SpaceOptions,
}

const EPILOGUE: &str = "\
FILE.csv: the first line names the columns, in any order; columns not listed here are ignored.
  case                whose sightings belong together: any text
  target_x, target_y  where the target stood
  bearing_rad         the direction it was seen in, radians, positive to the left
  bearing_deg         or the same in degrees
  column              or the pixel column, from 0 on the left: needs --fov-deg
  sigma_rad           optional: standard deviation of the direction, radians
  target_sigma        optional: standard deviation of the target's place in x and in y

With --lenses, instead: camera, target_x, target_y, target_z, column, row, and optional height_slab. One
case is a camera and a height_slab. CAMERAS.toml: for each [[camera]] id, fx, fy, cx, cy (pixels), and
optional k1, k2, projection (pin-hole or equal-angle).

Examples:
  host-sim solve sightings.csv --bearing-sigma 0.0086
  host-sim solve sightings.csv --truth truth.csv --max-sigma 0.5 --plot map.svg
  host-sim solve blobs.csv --fov-deg 60 --columns 88 --projection equal-angle --json
  host-sim solve sightings.csv --lenses cameras.toml --json

JSON: case (always a string, as it stands in the file), status, reason (why there is no pose, or
why it is doubtful; otherwise null), x, y, heading_rad (0 to 2 pi),
sigma_x, sigma_y, sigma_heading_rad (null where there is no pose), sightings (without rows that repeat the
place and the direction of another one of their case), dropped, chi_squared (about sightings - dropped - 3
where the sigmas are right, null where there is no pose).
With --lenses: case, camera, height_slab, status, reason, x, y, z, heading_deg, pitch_deg (down is
positive), roll_deg (positive where the left side is high), sigma_ of each, sightings, chi_squared,
focal_factor (of fx and fy), sigma_focal_factor, k1, k2. Reason focal_length: a lens told to be exact fits
much worse than one with focal_factor.

Status:
  calibrated  a pose
  weak        a pose whose predicted sigma is above --max-sigma
  doubtful    a pose that cannot be relied on, nor can its sigmas. Contradictory: the sightings do
              not fit it; only one in a thousand would fit as badly by chance, so a sighting, the
              camera or the sigmas given are wrong; three sightings always fit. Ambiguous: they fit
              another place more than five sigmas off nearly as well
  refused     no pose: a row of the case could not be read (reason unreadable), or the reason why the
              sightings give none
  waiting     no pose: fewer than three sightings
With --fov-deg, the cases of four sightings or more are asked together whether they fit that lens.
Where they do not, the field of view and the projection that fit are told; no pose can be relied on
before the lens is put right.
--truth compares poses that are calibrated or contradictory, and counts them as kept.
Messages, the count of cases and, with --json, the comparison with the truth go to the standard
error output.

Exit codes:
  0  every case has its answer, and at least one a pose to rely on (calibrated or weak)
  1  every case has its answer, but none a pose to rely on, or the lens does not fit
  2  wrong options, or nothing could be read";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    Files::default()
        .reads([&arguments.file])
        .reads(&arguments.truth)
        .reads(&arguments.space.lenses)
        .writes(&arguments.plot)
        .check()?;
    if let Some(lenses) = &arguments.space.lenses {
        return solve_space::run(&solve_space::Task {
            file: &arguments.file,
            lenses,
            options: &arguments.space,
            target_sigma: arguments.target_sigma,
            max_sigma: arguments.max_sigma,
            json: arguments.json,
            unit: &arguments.unit,
        });
    }
    let report;
    let mut is_lens_off = false;
    match read_sightings(arguments)? {
        Sightings::Streamed(cases) => {
            report = answer_all(arguments, cases, None)?;
            print_summary(&report, arguments);
        }
        Sightings::Kept(recording) => {
            let truths = match &arguments.truth {
                Some(path) => Some(read_truth(path, &recording)?),
                None => None,
            };
            report = answer_all(arguments, &recording, truths.as_deref())?;
            print_summary(&report, arguments);
            if let Some(path) = &arguments.plot {
                write(path, draw(arguments, &recording, &report.answered))?;
            }
            is_lens_off = check_lens(arguments, &recording)?;
        }
    }
    let nothing_read = report.tally.because(Reason::Unreadable) == report.tally.total();
    let usable = [Status::Calibrated, Status::Weak].map(|status| report.tally.count(status));
    Ok(ExitCode::from(match usable {
        _ if nothing_read => 2,
        [0, 0] => 1,
        _ => u8::from(is_lens_off),
    }))
}

/// Cases to answer.
enum Sightings {
    /// All sightings, where all cases are needed together or their rows are mixed.
    Kept(Recording),
    /// A file that was looked through, and is read again case by case: memory for one case is enough.
    Streamed(Streamed),
}

/// See [`Sightings::Streamed`].
struct Streamed {
    file: File,
    assumptions: Assumptions,
    survey: Survey,
}

fn read_sightings(arguments: &Arguments) -> anyhow::Result<Sightings> {
    let assumptions = Assumptions {
        camera: arguments.camera.camera(USUAL_COLUMNS)?,
        bearing_sigma: arguments.bearing_sigma,
        target_sigma: arguments.target_sigma.unwrap_or_default(),
    };
    let path = &arguments.file;
    let mut messages = Messages::new(file_name(path));
    let needs_all =
        arguments.truth.is_some() || arguments.plot.is_some() || assumptions.camera.is_some();
    let read = match needs_all {
        true => recorded::open(path, |input, length| messages.watch(input, length))
            .and_then(|input| sightings::read(input, &assumptions, |what| messages.complain(&what)))
            .map(Sightings::Kept),
        false => look_through(path, &assumptions, &mut messages),
    };
    messages.finish();
    let read = read.map_err(|error| of_file(path, error))?;
    let (cases, sigma_assumed, passed_over) = match &read {
        Sightings::Kept(all) => (all.len(), all.sigma_assumed(), all.passed_over()),
        Sightings::Streamed(Streamed { survey, .. }) => {
            (survey.cases, survey.sigma_assumed, survey.passed_over)
        }
    };
    if cases == 0 {
        bail!("{} has no row with a case", file_name(path));
    }
    if sigma_assumed {
        tell_assumed_sigma(path);
    }
    tell_passed_over(path, passed_over);
    Ok(read)
}

/// Reads a file without keeping it, or all of it if the rows of its cases are mixed.
fn look_through(
    path: &Path,
    assumptions: &Assumptions,
    messages: &mut Messages,
) -> Result<Sightings, ReadError> {
    let mut file = twice_readable(path)?;
    let length = file.metadata()?.len();
    let input = BufReader::with_capacity(
        BUFFER,
        messages.watch(Box::new(file.try_clone()?), Some(length)),
    );
    let survey = sightings::survey(input, assumptions, |what| messages.complain(&what))?;
    file.rewind()?;
    if !survey.are_together {
        let input = BufReader::with_capacity(BUFFER, file);
        return sightings::read(input, assumptions, |_| ()).map(Sightings::Kept);
    }
    Ok(Sightings::Streamed(Streamed {
        file,
        assumptions: *assumptions,
        survey,
    }))
}

/// A file that can be read again; a stream is copied into a file that no other program sees.
fn twice_readable(path: &Path) -> io::Result<File> {
    let mut stream: Box<dyn Read> = match path == Path::new("-") {
        true => Box::new(io::stdin()),
        false => {
            let file = File::open(path)?;
            if file.metadata()?.is_file() {
                return Ok(file);
            }
            Box::new(file)
        }
    };
    let mut kept = tempfile::tempfile()?;
    io::copy(&mut stream, &mut kept)?;
    kept.rewind()?;
    Ok(kept)
}

/// Cases, one after the other.
trait Cases {
    /// Number of cases.
    fn count(&self) -> usize;

    /// Characters of the longest name.
    fn widest(&self) -> usize;

    /// All of them, in the order of the file.
    fn each(self, take: impl FnMut(&str, &Case) -> anyhow::Result<()>) -> anyhow::Result<()>;
}

impl Cases for &Recording {
    fn count(&self) -> usize {
        self.len()
    }

    fn widest(&self) -> usize {
        let widths = self.cases().map(|(id, _)| id.chars().count());
        widths.max().unwrap_or_default()
    }

    fn each(self, mut take: impl FnMut(&str, &Case) -> anyhow::Result<()>) -> anyhow::Result<()> {
        self.cases().try_for_each(|(id, case)| take(id, case))
    }
}

impl Cases for Streamed {
    fn count(&self) -> usize {
        self.survey.cases
    }

    fn widest(&self) -> usize {
        self.survey.widest
    }

    fn each(self, take: impl FnMut(&str, &Case) -> anyhow::Result<()>) -> anyhow::Result<()> {
        let input = BufReader::with_capacity(BUFFER, self.file);
        sightings::each(input, &self.assumptions, take)
    }
}

fn read_truth(path: &Path, recording: &Recording) -> anyhow::Result<Vec<Option<Truth>>> {
    let mut messages = Messages::new(file_name(path));
    let truths = recorded::open(path, |input, length| messages.watch(input, length))
        .and_then(|input| truth::read(input, recording, |what| messages.complain(&what)));
    messages.finish();
    truths.map_err(|error| of_file(path, error))
}

/// Remarks that follow the answers.
struct Report {
    tally: Tally,
    /// The cases that have a pose, if they are to be drawn.
    answered: Vec<usize>,
    /// The first of the cases that fit another place, which is given here, about as well as their own.
    ambiguous: Vec<(String, Point2<f64>)>,
    /// Number of such cases.
    ambiguous_count: usize,
}

/// Number of bytes that are read at once.
const BUFFER: usize = 1 << 16;

/// Number of ambiguous cases that are told one by one.
const TOLD: usize = 5;

fn answer_all(
    arguments: &Arguments,
    cases: impl Cases,
    truths: Option<&[Option<Truth>]>,
) -> anyhow::Result<Report> {
    let mut output = Output::begin(arguments, &cases)?;
    let mut solver = solver(arguments);
    let mut tally = Tally::default();
    let mut comparisons = Comparisons::default();
    let (mut answered, mut ambiguous, mut ambiguous_count) = (Vec::new(), Vec::new(), 0);
    let bar = messages::solving_bar(cases.count());
    let mut places = 0..;
    cases.each(|id, case| {
        let place = places.next().unwrap_or_default();
        let answer = solver.answer(id, case);
        output.write(&answer)?;
        tally.add(&answer);
        if let Some(solution) = &answer.solution {
            if let (Some(truths), true) = (truths, answer.is_kept()) {
                comparisons.add(&solution.pose, truths.get(place).and_then(Option::as_ref));
            }
            if arguments.plot.is_some() {
                answered.push(place);
            }
        }
        if let Some(other) = answer.alternative {
            ambiguous_count += 1;
            if ambiguous.len() < TOLD {
                ambiguous.push((id.to_owned(), other));
            }
        }
        bar.inc(1);
        Ok(())
    })?;
    bar.finish_and_clear();
    let comparison = truths.map(|_| describe(comparisons, &tally, &arguments.unit));
    unless_gone(output.finish(comparison))?;
    Ok(Report {
        tally,
        answered,
        ambiguous,
        ambiguous_count,
    })
}

fn describe(comparisons: Comparisons, tally: &Tally, unit: &str) -> String {
    let all = tally.total();
    let sorted = tally.sorted();
    let kept = sorted
        .iter()
        .filter(|((status, reason), _)| answer::is_kept(*status, *reason));
    let kept: usize = kept.map(|(_, count)| count).sum();
    let share = 100.0 * kept as f64 / all as f64;
    let kept = format!("Kept {share:.1} %: {kept} of {all} cases\n");
    match comparisons.finish() {
        Some(accuracy) => format!("{}{kept}", accuracy.display(unit)),
        None => {
            format!("No answer has a truth to compare with: are the case names the same?\n{kept}")
        }
    }
}

/// Output of answers.
enum Output<'a> {
    Table(PoseTable<BufWriter<StdoutLock<'a>>>),
    Json(BufWriter<StdoutLock<'a>>),
}

impl Output<'_> {
    fn begin(arguments: &Arguments, cases: &impl Cases) -> io::Result<Self> {
        let out = BufWriter::with_capacity(1 << 16, io::stdout().lock());
        if arguments.json {
            return Ok(Self::Json(out));
        }
        PoseTable::begin(out, &arguments.unit, cases.widest()).map(Self::Table)
    }

    fn write(&mut self, answer: &Answer<'_>) -> io::Result<()> {
        match self {
            Self::Table(table) => table.row(answer),
            Self::Json(out) => {
                serde_json::to_writer(&mut *out, &PoseLine::new(answer))?;
                out.write_all(b"\n")
            }
        }
    }

    /// A comparison belongs to the table, but not between lines of JSON.
    fn finish(self, comparison: Option<String>) -> io::Result<()> {
        match self {
            Self::Table(table) => {
                let mut out = table.into_inner();
                if let Some(text) = comparison {
                    write!(out, "\n{text}")?;
                }
                out.flush()
            }
            Self::Json(mut out) => {
                out.flush()?;
                if let Some(text) = comparison {
                    tell(text.trim_end());
                }
                Ok(())
            }
        }
    }
}

fn print_summary(report: &Report, arguments: &Arguments) {
    let (tally, file) = (&report.tally, file_name(&arguments.file));
    let counts: Vec<String> = tally
        .sorted()
        .iter()
        .map(|(what, count)| format!("{count} {}", words(*what)))
        .collect();
    let cases = if tally.total() == 1 { "case" } else { "cases" };
    tell(format_args!(
        "{file}: {} {cases}: {}",
        tally.total(),
        counts.join(", ")
    ));
    for (what, _) in tally.sorted() {
        let (status, reason) = what;
        if let Some(advice) = answer::advice(status, reason) {
            tell(format_args!("  {}: {advice}", words(what)));
        }
    }
    if let rows @ 1.. = tally.repeated {
        tell(format_args!(
            "  {rows} {} the place and the direction of another one of the same case: each counts once",
            if rows == 1 {
                "row repeats"
            } else {
                "rows repeat"
            }
        ));
    }
    for (case, other) in &report.ambiguous {
        tell(format_args!(
            "  {}: ({:.3}, {:.3}) {} fits nearly as well",
            case, other.x, other.y, arguments.unit
        ));
    }
    if let more @ 1.. = report.ambiguous_count.saturating_sub(TOLD) {
        tell(format_args!("  and {more} more"));
    }
}

/// Tells which lens fits, if the given one does not. Returns true if the given one does not fit.
fn check_lens(arguments: &Arguments, recording: &Recording) -> anyhow::Result<bool> {
    let given = arguments.camera.field_of_view();
    let (Some(camera), Some(given)) = (arguments.camera.camera(USUAL_COLUMNS)?, given) else {
        return Ok(false);
    };
    let found = match lens::check(recording, &camera, given, arguments.lens_sigma) {
        None => return Ok(false),
        Some(Misfit::Lens(found)) => found,
        Some(Misfit::Mirrored {
            chi_squared,
            chi_squared_as_given,
            cases,
        }) => {
            tell(format_args!(
                "  mirrored: the sightings fit once left and right are exchanged (chi squared of {cases} {} \
                 {chi_squared:.1}, as given {chi_squared_as_given:.1}): y runs downwards in the plan, or the cameras \
                 hang upside down. No pose can be relied on before y, or the columns, count from the other side",
                if cases == 1 { "case" } else { "cases" },
            ));
            return Ok(true);
        }
    };
    let name = |projection| match projection {
        Projection::PinHole => "pinhole",
        Projection::EqualAngle => "equal-angle",
    };
    let (view, sigma) = (found.field_of_view, found.field_of_view_sigma);
    let projection = match found.projection == camera.projection() {
        true => String::new(),
        false => format!(
            " with --projection {}, configured {}",
            name(found.projection),
            name(camera.projection())
        ),
    };
    tell(format_args!(
        "  lens: the field of view fits {:.1} +/- {:.1} deg, configured {}{projection} (chi squared of \
         {} {} {:.1}, as configured {:.1}): no pose can be relied on before --fov-deg and \
         --projection are put right, in the cameras' configuration too",
        view.to_degrees(),
        sigma.to_degrees(),
        (given.to_degrees() * 1e6).round() / 1e6,
        found.cases,
        if found.cases == 1 { "case" } else { "cases" },
        found.chi_squared,
        found.chi_squared_as_given,
    ));
    Ok(true)
}

fn words((status, reason): (Status, Option<Reason>)) -> Words {
    Words(status, reason.map(Reason::name))
}

fn solver(arguments: &Arguments) -> Solver {
    Solver::new(Settings {
        reject: arguments.reject,
        max_sigma: arguments.max_sigma,
    })
}

/// A map of the cases that have a pose, or of some of them.
fn draw(arguments: &Arguments, recording: &Recording, all: &[usize]) -> anyhow::Result<String> {
    let count = all.len().min(plot::MOST_CAMERAS);
    let chosen = (0..count).filter_map(|k| all.get(k * all.len() / count));
    let mut solver = solver(arguments);
    let (mut cameras, mut targets) = (Vec::new(), Vec::new());
    for (id, case) in chosen.filter_map(|&place| recording.case(place)) {
        let answer = solver.answer(id, case);
        cameras.extend(answer.solution.map(|solution| MapCamera {
            name: id.to_owned(),
            pose: solution.pose,
            status: answer.status,
        }));
        targets.extend(case.sightings.iter().map(|sighting| sighting.target));
    }
    let name = arguments
        .file
        .file_name()
        .map_or_else(|| "standard input".into(), |name| name.to_string_lossy());
    let title = if count < all.len() {
        format!("Poses from {name}: {count} of {}, evenly chosen", all.len())
    } else {
        format!("Poses from {name}")
    };
    Ok(plot::svg(&Map {
        title,
        unit: arguments.unit.clone(),
        cameras,
        targets,
    })?)
}
