//! `host-sim solve-network`

use std::{
    collections::{BTreeMap, BTreeSet},
    io::{self, BufRead, BufWriter, Read, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, anyhow, bail, ensure};
use clap::Args;
use nalgebra::Point2;
use results::accuracy::Comparisons;
use results::network::{self, NetworkError, NetworkSolution, ScaleFrom, Settings, usual_carrier};
use results::plot::{self, Map, MapCamera};
use results::record::{
    RunRecord,
    sightings::{Lens, References, Sightings},
};
use results::recorded::{
    self, ReadError,
    network::{self as rows, Assumptions},
    truth::{self, Truth},
};
use results::report::network::network_report;

use super::{
    camera_options::{CameraOptions, FOR_COLUMNS, USUAL_COLUMNS},
    file_name,
    files::Files,
    messages::{Messages, tell_assumed_sigma, tell_passed_over},
    of_file, print,
    run_outputs::write,
    tell, unless_gone, values,
};

/// All cameras, stops and the carrier of a network at once, from what was measured in it.
///
/// Bearings, displacements and two references give poses with their uncertainty, how far each is
/// protected against one wrong measurement, and what contradicts, by name.
#[derive(Args)]
#[command(after_long_help = EPILOGUE)]
pub(super) struct Arguments {
    /// The record of a run, its `sightings`, or bearings; `-` for the standard input.
    #[arg(value_name = "FILE.json|FILE.csv")]
    file: PathBuf,
    /// Displacements from stop to stop.
    #[arg(long, value_name = "FILE.csv")]
    legs: Option<PathBuf>,
    /// Distances between cameras and the target.
    #[arg(long, value_name = "FILE.csv")]
    ranges: Option<PathBuf>,
    /// Stops at marks: a mark that is visited twice closes a loop.
    #[arg(long, value_name = "FILE.csv")]
    visits: Option<PathBuf>,
    /// Estimate every (pin-hole) camera's lens too: its focal length is known to this share, one
    /// sigma.
    #[arg(long, value_name = "SHARE", value_parser = values::positive)]
    lens_sigma: Option<f64>,
    /// Standard deviation of each displacement, per axis, for files without such a column.
    #[arg(long, value_name = "LENGTH", value_parser = values::positive, requires = "legs")]
    displacement_sigma: Option<f64>,
    /// The cameras that define the frame: the origin, and the one on the x axis.
    #[arg(long, value_name = "A,B", value_parser = values::two_cameras)]
    references: Option<[u16; 2]>,
    /// Distance between them, or `unknown`: then the carrier's distances set the scale.
    #[arg(long, value_name = "LENGTH", value_parser = values::Known::length)]
    baseline: Option<values::Known>,
    /// Direction of the displacements' x axis against the baseline, degrees, or `unknown` [default:
    /// what FILE.json says, 0 for FILE.csv].
    #[arg(long, value_name = "DEGREES", value_parser = values::Known::angle)]
    frame_heading_deg: Option<values::Known>,
    /// Share by which all distances of the carrier may be wrong, one sigma [default: what FILE.json
    /// says, or 0.08].
    #[arg(long, value_name = "SHARE", value_parser = values::not_negative)]
    systematic_scale: Option<f64>,
    /// Constant error of its compass, one sigma [default: what FILE.json says, or 3].
    #[arg(long, value_name = "DEGREES", value_parser = values::not_negative)]
    systematic_heading: Option<f64>,
    /// Standard deviation of bearings, radians, for files without such a column.
    ///
    /// Without it: that of whole pixels for `column`, 0.0087 (half a degree) for bearings.
    #[arg(long, value_name = "RAD", value_parser = values::positive)]
    bearing_sigma: Option<f64>,
    /// Solve from bearings alone, as if nothing else had been measured.
    #[arg(long, conflicts_with_all = ["legs", "ranges", "visits", "lens_sigma"])]
    bearings_only: bool,
    /// Estimate how large the errors of displacements are, rather than to believe their sigmas.
    #[arg(long)]
    fit_legs: bool,
    /// Poses and places from all measurements as they are, and nothing else: nothing is looked for that
    /// contradicts, and no residual or protection level is told.
    #[arg(long, conflicts_with_all = ["fit_legs", "bearings_only"])]
    poses_only: bool,
    /// Call poses weak whose predicted standard deviation of position is above this.
    #[arg(long, value_name = "LENGTH", value_parser = values::positive)]
    max_sigma: Option<f64>,
    /// True poses to compare with: columns `case` (the camera), `x`, `y`, `theta_rad`.
    ///
    /// The record of a simulated run has them.
    #[arg(long, value_name = "FILE.csv")]
    truth: Option<PathBuf>,
    /// Draw a map of the answers.
    #[arg(long, value_name = "FILE.svg", value_parser = values::result())]
    plot: Option<PathBuf>,
    /// One JSON object per walk and line instead of tables.
    #[arg(long)]
    json: bool,
    /// Name of the unit of length of the file, for headings and axes [default: the record's, or m].
    #[arg(long, value_name = "NAME")]
    unit: Option<String>,
    #[command(flatten, next_help_heading = FOR_COLUMNS)]
    camera: CameraOptions,
}

const EPILOGUE: &str = "\
FILE.json: what `host-sim run --json` wrote, or one of its `sightings`, or several in a list:
  references     {\"cameras\": [1, 2], \"baseline\": 10}; baseline null: not known
  bearings       [{\"target\": 20, \"stop\": 1, \"camera\": 3, \"bearing_deg\": -4.5, \"sigma_deg\": 0.3}]
  legs           [{\"target\": 20, \"stop\": 2, \"dx\": 1.5, \"dy\": 0.2, \"covariance\": [1e-4, 0, 1e-4]}]
  carriers       optional: [{\"target\": 20, \"systematic_scale\": 0.08, \"systematic_heading_deg\": 3,
                 \"standing_sigma\": 0.02}]
  ranges         optional: [{\"target\": 20, \"stop\": 1, \"camera\": 3, \"range\": 4.2, \"sigma\": 0.1}]
  visits         optional: [{\"target\": 20, \"stop\": 1, \"mark\": 7, \"sigma\": 0.02}]
  lens           optional: {\"sigma\": 0.02, \"fov_deg\": 45, \"principal_deg\": 1}: focal lengths are unknowns too
  frame_heading_deg, network  optional
FILE.csv: bearings. The first line names the columns, in any order; others are ignored.
  stop, camera   whole numbers; stops count up in the order in which they were made
  bearing_deg    the direction the target was seen in, positive to the left
  bearing_rad    or the same in radians
  column         or the pixel column, from 0 on the left: needs --fov-deg
  sigma_deg, sigma_rad  optional: its standard deviation
  target         optional: which target, a whole number
--legs: a row for each stop but a target's first.
  stop           the stop that it leads to
  dx, dy         displacement from the stop before, in the carrier's own frame
  sigma          optional: its standard deviation in x and in y; or cov_xx, cov_xy, cov_yy
  target         optional
--ranges: a row for each distance between a camera and the target.
  stop, camera   whole numbers
  range, sigma   the distance and its standard deviation, above 0
  target         optional
--visits: a row for each stop at a mark. Where marks are need not be known.
  stop, mark     whole numbers
  sigma          how far beside it the target may have stood, along each axis, above 0
  target         optional

Examples:
  host-sim solve-network run.json
  host-sim solve-network bearings.csv --legs legs.csv --references 1,2 --baseline 10 --displacement-sigma 0.05

Each target's walk is solved by itself. Where a way was not measured, a walk goes on once two cameras
with a pose see the target.
Protected to: one wrong measurement that no test notices moves the pose by no more, in 999 of 1,000
cases. Many times the sigma where nothing checks what the pose rests on.
JSON: as the tables, with covariances (upper triangles by rows), every residual, and findings.

Exit codes:
  0  every walk has a solution that its measurements fit, but for those that are named as left out
  1  a walk has none, or only a contradictory one
  2  wrong options, or a file could not be read";

/// Far longer than the record of the largest network.
const MOST_BYTES: u64 = 1 << 30;

/// Measurements that were read.
struct Measured {
    sightings: Vec<Sightings>,
    unit: Option<String>,
    /// True poses by network and camera.
    truths: BTreeMap<(u16, u16), Truth>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    Files::default()
        .reads([&arguments.file])
        .reads(&arguments.legs)
        .reads(&arguments.ranges)
        .reads(&arguments.visits)
        .reads(&arguments.truth)
        .writes(&arguments.plot)
        .check()?;
    let name = file_name(&arguments.file);
    let mut measured = read(arguments)?;
    for sightings in &mut measured.sightings {
        arguments.put_into(sightings);
        if arguments.bearings_only {
            sightings.legs.clear();
            sightings.ranges.clear();
            sightings.visits.clear();
            sightings.lens = None;
        }
    }
    if let Some(path) = &arguments.truth {
        measured.truths = read_truth(path, &measured.sightings)?;
    }
    if let (Some(references), [only]) = (arguments.references, &measured.sightings[..]) {
        let has_bearing = |camera| only.bearings.iter().any(|seen| seen.camera == camera);
        if let Some(camera) = references.into_iter().find(|&camera| !has_bearing(camera)) {
            bail!("{name} {}", NetworkError::NeverSaw(camera));
        }
    }
    let unit = { arguments.unit.as_deref() }
        .or(measured.unit.as_deref())
        .unwrap_or("m");
    let settings = Settings {
        max_sigma: arguments.max_sigma,
        fit_legs: arguments.fit_legs,
        poses_only: arguments.poses_only,
    };
    let mut solutions = Vec::new();
    let repeated: usize = { measured.sightings.iter_mut() }
        .map(network::leave_out_repeated)
        .sum();
    if repeated > 0 {
        tell(format_args!(
            "bearings that repeat another one of the same camera at the same stop count once: {repeated} are left out"
        ));
    }
    for sightings in &measured.sightings {
        let solved = network::solve(sightings, &settings);
        solutions.extend(solved.map_err(|error| anyhow!("{name} {error}"))?);
    }
    unless_gone(tell_all(arguments, &solutions, &measured, unit))?;
    let fails = |solution: &NetworkSolution| solution.stops.is_empty();
    let has_visits = { measured.sightings.iter() }.any(|own| !own.visits.is_empty());
    if has_visits && solutions.iter().any(fails) {
        tell(
            "one visit of a wrong mark or stop spoils everything: try without the visits, and if that \
             has a solution, look for the wrong row",
        );
    }
    if let Some(path) = &arguments.plot {
        write(path, draw(&solutions, &name, unit))?;
    }
    let is_good = solutions.iter().all(NetworkSolution::is_good);
    Ok(ExitCode::from(if is_good { 0 } else { 1 }))
}

impl Arguments {
    /// Puts in the options of the command line, which count more than the file.
    fn put_into(&self, sightings: &mut Sightings) {
        let known = sightings.references.take();
        let cameras = self.references.or(known.map(|known| known.cameras));
        sightings.references = cameras.map(|cameras| References {
            cameras,
            baseline: match self.baseline {
                Some(baseline) => baseline.0,
                // The file's baseline is that of the cameras that it names.
                None => { known.filter(|known| known.cameras == cameras) }
                    .and_then(|known| known.baseline),
            },
        });
        if let Some(sigma) = self.lens_sigma {
            let fov_deg = self.camera.field_of_view().map(f64::to_degrees);
            let known = sightings.lens;
            sightings.lens = Some(Lens {
                sigma,
                fov_deg: fov_deg.or(known.and_then(|lens| lens.fov_deg)),
                principal_deg: known.map_or(0.0, |lens| lens.principal_deg),
            });
        }
        if let Some(heading) = self.frame_heading_deg {
            sightings.frame_heading_deg = heading.0;
        }
        for leg in &sightings.legs {
            if !sightings
                .carriers
                .iter()
                .any(|known| known.target == leg.target)
            {
                sightings.carriers.push(usual_carrier(leg.target));
            }
        }
        for carrier in &mut sightings.carriers {
            if let Some(scale) = self.systematic_scale {
                carrier.systematic_scale = scale;
            }
            if let Some(heading) = self.systematic_heading {
                carrier.systematic_heading_deg = heading;
            }
        }
    }
}

fn read(arguments: &Arguments) -> anyhow::Result<Measured> {
    let path = &arguments.file;
    let mut text = String::new();
    let read = recorded::open(path, |input, _| input).and_then(|input| {
        let read = input.take(MOST_BYTES + 1).read_to_string(&mut text);
        read.map_err(ReadError::Io)
    });
    read.map_err(|error| of_file(path, error))?;
    ensure!(
        text.len() as u64 <= MOST_BYTES,
        "{} has more than {MOST_BYTES} bytes",
        file_name(path)
    );
    match text
        .trim_start_matches('\u{feff}')
        .trim_start()
        .chars()
        .next()
    {
        Some('{' | '[') => {
            let mut measured = read_json(path, &text)?;
            let besides = [
                ("--legs", &arguments.legs),
                ("--ranges", &arguments.ranges),
                ("--visits", &arguments.visits),
            ];
            match measured.sightings.as_mut_slice() {
                [only] => read_besides(only, arguments)?,
                _ => {
                    if let Some((what, _)) = besides.iter().find(|(_, file)| file.is_some()) {
                        bail!(
                            "{what} are of one network, and {} has several",
                            file_name(path)
                        );
                    }
                }
            }
            Ok(measured)
        }
        _ => read_csv(arguments, &text),
    }
}

fn read_json(path: &Path, text: &str) -> anyhow::Result<Measured> {
    let name = file_name(path);
    let wrong = |error: serde_json::Error| {
        let place = format!("{name}:{}", error.line());
        anyhow::Error::from(error).context(format!(
            "{place}: it is neither the record of a run nor what was measured in one"
        ))
    };
    let value: serde_json::Value = serde_json::from_str(text).map_err(wrong)?;
    let mut measured = Measured {
        sightings: Vec::new(),
        unit: None,
        truths: BTreeMap::new(),
    };
    if value.get("format").is_some() {
        let record = RunRecord::from_json(text);
        let record = record.with_context(|| format!("{name} cannot be used"))?;
        for camera in record.cameras() {
            if let Some(truth) = camera.truth {
                let truth = Truth {
                    position: truth.position(),
                    heading: truth.heading_deg.to_radians(),
                };
                measured.truths.insert((camera.network, camera.id), truth);
            }
        }
        measured.unit = Some(record.unit.name);
        measured.sightings = record.sightings;
        ensure!(
            !measured.sightings.is_empty(),
            "{name} does not have what its nodes measured: make the run again"
        );
    } else if value.is_array() {
        measured.sightings = serde_json::from_str(text).map_err(wrong)?;
        ensure!(!measured.sightings.is_empty(), "{name} is empty");
    } else {
        measured.sightings = vec![serde_json::from_str(text).map_err(wrong)?];
    }
    Ok(measured)
}

fn read_csv(arguments: &Arguments, text: &str) -> anyhow::Result<Measured> {
    let path = &arguments.file;
    let assumptions = Assumptions {
        camera: arguments.camera.camera(USUAL_COLUMNS)?,
        bearing_sigma: arguments.bearing_sigma,
    };
    let read = rows::bearings(text.as_bytes(), &assumptions);
    let read = read.map_err(|error| of_file(path, error))?;
    if read.sigma_assumed {
        tell_assumed_sigma(path);
    }
    tell_passed_over(path, read.passed_over);
    let mut sightings = Sightings {
        network: 1,
        frame_heading_deg: Some(0.0),
        bearings: read.bearings,
        ..Sightings::default()
    };
    read_besides(&mut sightings, arguments)?;
    Ok(Measured {
        sightings: vec![sightings],
        unit: None,
        truths: BTreeMap::new(),
    })
}

/// Reads the measurements that are in files of their own.
fn read_besides(sightings: &mut Sightings, arguments: &Arguments) -> anyhow::Result<()> {
    fn read<O>(
        path: &Path,
        rows: impl FnOnce(Box<dyn BufRead>) -> Result<O, ReadError>,
    ) -> anyhow::Result<O> {
        recorded::open(path, |input, _| input)
            .and_then(rows)
            .map_err(|error| of_file(path, error))
    }
    if let Some(path) = &arguments.legs {
        sightings.legs = read(path, |input| {
            rows::legs(input, arguments.displacement_sigma)
        })?;
    }
    let targets: BTreeSet<_> = sightings.bearings.iter().map(|seen| seen.target).collect();
    let only = targets.first().copied().filter(|_| targets.len() == 1);
    if let Some(path) = &arguments.ranges {
        sightings.ranges = read(path, |input| rows::ranges(input, only))?;
    }
    if let Some(path) = &arguments.visits {
        sightings.visits = read(path, |input| rows::visits(input, only))?;
    }
    Ok(())
}

/// Reads the truth for a file of one network.
fn read_truth(path: &Path, all: &[Sightings]) -> anyhow::Result<BTreeMap<(u16, u16), Truth>> {
    let [only] = all else {
        bail!("--truth is of one network, and the file has several");
    };
    let mut cameras: Vec<_> = only.bearings.iter().map(|seen| seen.camera).collect();
    cameras.sort_unstable();
    cameras.dedup();
    let position = |case: &str| {
        let id: u16 = case.parse().ok()?;
        cameras.binary_search(&id).ok()
    };
    let mut messages = Messages::new(file_name(path));
    let truths =
        recorded::open(path, |input, length| messages.watch(input, length)).and_then(|input| {
            truth::read_for(input, cameras.len(), position, |what| {
                messages.complain(&what);
            })
        });
    messages.finish();
    let truths = truths.map_err(|error| of_file(path, error))?;
    let known = cameras.iter().zip(truths);
    Ok(known
        .filter_map(|(camera, truth)| Some(((only.network, *camera), truth?)))
        .collect())
}

/// The truth of a camera in the frame of the solution: that of its references, wherever they are.
fn truth_of(solution: &NetworkSolution, measured: &Measured, camera: u16) -> Option<Truth> {
    let own = |camera| measured.truths.get(&(solution.network, camera)).copied();
    let [first, second] = solution.references?.map(own);
    let (first, second) = (first?, second?);
    let baseline = second.position - first.position;
    let turn = nalgebra::Rotation2::new(-baseline.y.atan2(baseline.x));
    let truth = own(camera)?;
    // Without a scale, in units of the true baseline.
    let unit = match solution.scale_from {
        ScaleFrom::Nothing => baseline.norm(),
        _ => 1.0,
    };
    Some(Truth {
        position: Point2::from(turn * (truth.position - first.position) / unit),
        heading: truth.heading + turn.angle(),
    })
}

fn compare(solution: &NetworkSolution, measured: &Measured, unit: &str) -> Option<String> {
    if measured.truths.is_empty() || solution.stops.is_empty() {
        return None;
    }
    let mut comparisons = Comparisons::default();
    let others = solution.cameras.iter().filter(|camera| !camera.reference);
    for camera in others {
        if let Some(estimate) = &camera.estimate {
            let truth = truth_of(solution, measured, camera.camera);
            comparisons.add(&estimate.pose(), truth.as_ref());
        }
    }
    Some(match comparisons.finish() {
        Some(accuracy) => accuracy.display(unit).to_string(),
        None => "No pose has a truth to compare with.\n".to_owned(),
    })
}

fn tell_all(
    arguments: &Arguments,
    solutions: &[NetworkSolution],
    measured: &Measured,
    unit: &str,
) -> io::Result<()> {
    if arguments.json {
        let mut out = BufWriter::new(io::stdout().lock());
        for solution in solutions {
            serde_json::to_writer(&mut out, solution)?;
            out.write_all(b"\n")?;
        }
        out.flush()?;
    }
    for (n, solution) in solutions.iter().enumerate() {
        let comparison = compare(solution, measured, unit);
        if arguments.json {
            // A comparison does not belong between lines of JSON.
            if let Some(text) = comparison {
                tell(text.trim_end());
            }
            if let Some(advice) = &solution.advice {
                tell(format_args!("{}: {advice}", file_name(&arguments.file)));
            }
            continue;
        }
        let between = if n > 0 { "\n" } else { "" };
        let compared = comparison.map(|text| format!("\n{text}"));
        print(&format!(
            "{between}{}{}",
            network_report(solution, unit),
            compared.unwrap_or_default()
        ))?;
    }
    Ok(())
}

/// A map of the first network: those of others have frames of their own.
fn draw(solutions: &[NetworkSolution], name: &str, unit: &str) -> anyhow::Result<String> {
    let first = solutions.first().context("there is no solution")?;
    let cameras = first.cameras.iter().filter_map(|camera| {
        Some(MapCamera {
            name: camera.camera.to_string(),
            pose: camera.estimate?.pose(),
            status: camera.status,
        })
    });
    let targets = first.stops.iter().map(|stop| Point2::new(stop.x, stop.y));
    Ok(plot::svg(&Map {
        title: format!("Network {} from {name}", first.network),
        unit: unit.to_owned(),
        cameras: cameras.collect(),
        targets: targets.collect(),
    })?)
}
