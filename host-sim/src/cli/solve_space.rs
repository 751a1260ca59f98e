//! `host-sim solve --lenses`: cameras in space.

use std::{
    collections::BTreeMap,
    fs,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, bail, ensure};
use calib_core::{
    Limits, Refusal, Status,
    camera::Projection,
    space::{self, Lens, Priors, Solution, Told},
};
use clap::Args;
use nalgebra::{Vector2, Vector3};
use results::recorded::{
    self,
    space::{Case, Sigmas},
};
use serde::{Deserialize, Serialize};

use super::{OfFile, file_name, messages::Messages, of_file, tell, unless_gone, values};

/// Options of cameras in space.
#[derive(Args)]
pub(super) struct SpaceOptions {
    /// Lenses of cameras in space: solves place, height, heading, pitch and roll from columns and rows.
    #[arg(long, value_name = "CAMERAS.toml", conflicts_with_all = NOT_IN_SPACE)]
    pub(super) lenses: Option<PathBuf>,
    /// Standard deviation of columns and rows.
    #[arg(
        long, value_name = "PIXELS", value_parser = values::positive, default_value_t = 0.3,
        requires = "lenses"
    )]
    pixel_sigma: f64,
    /// Standard deviation of focal lengths, relative to them; 0 for exact ones.
    #[arg(
        long, value_name = "SHARE", value_parser = values::not_negative, default_value_t = 0.0,
        requires = "lenses"
    )]
    focal_sigma: f64,
    /// Standard deviation of k1; 0 if exact.
    #[arg(
        long, value_name = "K1", value_parser = values::not_negative, default_value_t = 0.0,
        requires = "lenses"
    )]
    k1_sigma: f64,
    /// Standard deviation of k2; 0 if exact.
    #[arg(
        long, value_name = "K2", value_parser = values::not_negative, default_value_t = 0.0,
        requires = "lenses"
    )]
    k2_sigma: f64,
    /// Standard deviation of the roll around 0, degrees, for cameras that stand upright.
    #[arg(long, value_name = "DEG", value_parser = values::positive, requires = "lenses")]
    roll_sigma_deg: Option<f64>,
    /// Height (z) of every camera, as with a tape.
    #[arg(long, value_name = "LENGTH", value_parser = values::finite, requires = "lenses")]
    height: Option<f64>,
    /// Standard deviation of --height.
    #[arg(
        long, value_name = "LENGTH", value_parser = values::positive, default_value_t = 0.02,
        requires = "height"
    )]
    height_sigma: f64,
}

/// Options of the plane.
const NOT_IN_SPACE: [&str; 5] = ["truth", "plot", "fov_deg", "bearing_sigma", "reject"];

/// Standard deviation of a target's place where none is given: 0.5 mm, in metres.
const USUAL_TARGET_SIGMA: f64 = 0.0005;

/// File of lenses.
#[derive(Deserialize)]
struct Lenses {
    camera: Vec<LensTable>,
}

/// One camera of it; other keys are for others.
#[derive(Deserialize)]
struct LensTable {
    id: i64,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    #[serde(default)]
    k1: f64,
    #[serde(default)]
    k2: f64,
    #[serde(default = "pin_hole")]
    projection: Projection,
}

fn pin_hole() -> Projection {
    Projection::PinHole
}

/// One case's answer. Values are null where there is no pose.
#[derive(Default, Serialize)]
struct Line<'a> {
    case: String,
    camera: &'a str,
    height_slab: Option<&'a str>,
    status: &'static str,
    reason: Option<&'static str>,
    x: Option<f64>,
    y: Option<f64>,
    z: Option<f64>,
    heading_deg: Option<f64>,
    pitch_deg: Option<f64>,
    roll_deg: Option<f64>,
    sigma_x: Option<f64>,
    sigma_y: Option<f64>,
    sigma_z: Option<f64>,
    sigma_heading_deg: Option<f64>,
    sigma_pitch_deg: Option<f64>,
    sigma_roll_deg: Option<f64>,
    sightings: usize,
    chi_squared: Option<f64>,
    focal_factor: Option<f64>,
    sigma_focal_factor: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
}

pub(super) struct Task<'a> {
    pub(super) file: &'a Path,
    pub(super) lenses: &'a Path,
    pub(super) options: &'a SpaceOptions,
    pub(super) target_sigma: Option<f64>,
    pub(super) max_sigma: Option<f64>,
    pub(super) json: bool,
    pub(super) unit: &'a str,
}

pub(super) fn run(task: &Task<'_>) -> anyhow::Result<ExitCode> {
    let lenses = read_lenses(task.lenses, task.options)?;
    let sigmas = Sigmas {
        pixel: task.options.pixel_sigma,
        target: task.target_sigma.unwrap_or(USUAL_TARGET_SIGMA),
    };
    let mut messages = Messages::new(file_name(task.file));
    let read = recorded::open(task.file, |input, length| messages.watch(input, length))
        .and_then(|input| recorded::space::read(input, sigmas, |what| messages.complain(&what)));
    messages.finish();
    let cases = read.map_err(|error| of_file(task.file, error))?;
    for case in &cases {
        ensure!(
            lenses.contains_key(&case.camera),
            "{} has sightings of camera {}, but {} has no lens of it: add a [[camera]] with id = {}",
            file_name(task.file),
            case.camera,
            file_name(task.lenses),
            case.camera,
        );
    }
    let priors = task.options.priors();
    let limits = Limits {
        position: task.max_sigma.unwrap_or(f64::INFINITY),
        heading: f64::INFINITY,
    };
    let mut out = BufWriter::new(io::stdout().lock());
    let mut written = match task.json {
        true => Ok(()),
        false => heading(&mut out, task.unit),
    };
    let (mut usable, mut readable) = (0, 0);
    for case in &cases {
        let Some(lens) = lenses.get(&case.camera) else {
            continue;
        };
        let solved = match case.unreadable {
            0 => Some(space::solve(&case.sightings, lens, &priors)),
            _ => None,
        };
        readable += usize::from(solved.is_some());
        let line = line(case, solved.as_ref(), &limits);
        usable += usize::from(["calibrated", "weak"].contains(&line.status));
        written = written.and_then(|()| match task.json {
            true => {
                serde_json::to_writer(&mut out, &line)?;
                out.write_all(b"\n")
            }
            false => row(&mut out, &line),
        });
        if let Some(Ok(solution)) = &solved {
            tell_doubts(&line.case, solution, lens, task.unit);
        }
        if let Some(Err(refusal)) = &solved {
            tell(format_args!("  {}: {refusal}", line.case));
        }
    }
    unless_gone(written.and_then(|()| out.flush()))?;
    Ok(ExitCode::from(match (readable, usable) {
        (0, _) => 2,
        (_, 0) => 1,
        _ => 0,
    }))
}

impl SpaceOptions {
    fn priors(&self) -> Priors<f64> {
        let told = |value, sigma| Told { value, sigma };
        Priors {
            height: self.height.map(|height| told(height, self.height_sigma)),
            pitch: None,
            roll: self
                .roll_sigma_deg
                .map(|sigma| told(0.0, sigma.to_radians())),
        }
    }
}

fn read_lenses(path: &Path, options: &SpaceOptions) -> anyhow::Result<BTreeMap<String, Lens<f64>>> {
    let name = file_name(path);
    let text = fs::read_to_string(path).with_context(|| OfFile::unread(path))?;
    let file: Lenses = toml::from_str(&text).with_context(|| format!("{name} cannot be used"))?;
    let mut lenses = BTreeMap::new();
    for table in file.camera {
        let numbers = [table.fx, table.fy, table.cx, table.cy, table.k1, table.k2];
        if !numbers.iter().all(|number| number.is_finite()) || table.fx <= 0.0 || table.fy <= 0.0 {
            bail!(
                "{name}: camera {}: fx and fy must be above 0, and every number finite",
                table.id
            );
        }
        let lens = Lens {
            projection: table.projection,
            focal: Vector2::new(table.fx, table.fy),
            principal: Vector2::new(table.cx, table.cy),
            distortion: Vector2::new(table.k1, table.k2),
            sigmas: Vector3::new(options.focal_sigma, options.k1_sigma, options.k2_sigma),
        };
        if lenses.insert(table.id.to_string(), lens).is_some() {
            bail!("{name} has camera {} twice: remove one of them", table.id);
        }
    }
    Ok(lenses)
}

fn line<'a>(
    case: &'a Case,
    solved: Option<&Result<Solution<f64>, Refusal>>,
    limits: &Limits<f64>,
) -> Line<'a> {
    let slab = Some(case.height_slab.as_str()).filter(|slab| !slab.is_empty());
    let name = match slab {
        Some(slab) => format!("{}@{slab}", case.camera),
        None => case.camera.clone(),
    };
    let empty = Line {
        case: name,
        camera: &case.camera,
        height_slab: slab,
        sightings: case.sightings.len() + case.unreadable,
        status: Status::Refused.name(),
        ..Line::default()
    };
    let solution = match solved {
        None => {
            return Line {
                reason: Some("unreadable"),
                ..empty
            };
        }
        Some(Err(refusal)) => {
            return Line {
                status: Status::from(*refusal).name(),
                reason: Some(refusal.name()),
                ..empty
            };
        }
        Some(Ok(solution)) => solution,
    };
    let [x, y, z, heading, pitch, roll] = solution.sigmas();
    let pose = &solution.pose;
    Line {
        status: solution.status(limits).name(),
        reason: reason(solution),
        x: Some(pose.position.x),
        y: Some(pose.position.y),
        z: Some(pose.position.z),
        heading_deg: Some(pose.heading.to_degrees()),
        pitch_deg: Some(pose.pitch.to_degrees()),
        roll_deg: Some(pose.roll.to_degrees()),
        sigma_x: Some(x),
        sigma_y: Some(y),
        sigma_z: Some(z),
        sigma_heading_deg: Some(heading.to_degrees()),
        sigma_pitch_deg: Some(pitch.to_degrees()),
        sigma_roll_deg: Some(roll.to_degrees()),
        chi_squared: Some(solution.fit.chi_squared),
        focal_factor: Some(solution.fitting_focal.unwrap_or(solution.lens.x)),
        sigma_focal_factor: Some(solution.lens_sigmas.x),
        k1: Some(solution.lens.y),
        k2: Some(solution.lens.z),
        ..empty
    }
}

/// Reason why a pose is doubtful.
fn reason(solution: &Solution<f64>) -> Option<&'static str> {
    if solution.fitting_focal.is_some() {
        Some("focal_length")
    } else if solution.fit.is_bad() {
        Some("contradictory")
    } else {
        solution.rival.map(|_| "ambiguous")
    }
}

fn tell_doubts(case: &str, solution: &Solution<f64>, lens: &Lens<f64>, unit: &str) {
    if let Some(factor) = solution.fitting_focal {
        tell(format_args!(
            "  {case}: a focal length of {:.1} columns fits much better than {:.1}: correct fx and fy, or \
             give --focal-sigma",
            factor * lens.focal.x,
            lens.focal.x
        ));
    } else if solution.fit.is_bad() {
        tell(format_args!(
            "  {case}: the sightings contradict each other or the lens (chi squared {:.1}, {} expected): \
             look for wrong sightings, check the lens and the sigmas given",
            solution.fit.chi_squared, solution.fit.degrees_of_freedom
        ));
    } else if let Some(other) = &solution.rival {
        tell(format_args!(
            "  {case}: ({:.3}, {:.3}, {:.3}) {unit} fits nearly as well: stop the target once more, or give \
             --height or --roll-sigma-deg",
            other.position.x, other.position.y, other.position.z
        ));
    }
}

fn heading(out: &mut impl Write, unit: &str) -> io::Result<()> {
    let names = ["x", "y", "z"].map(|axis| format!("{axis} [{unit}]"));
    write!(out, "{:12}", "case")?;
    for name in names {
        write!(out, "  {name:>10} {:>8}", "+/-")?;
    }
    for name in ["heading", "pitch", "roll"] {
        write!(out, "  {name:>8} {:>7}", "+/- deg")?;
    }
    writeln!(out, "  used chi squared  status")
}

fn row(out: &mut impl Write, line: &Line<'_>) -> io::Result<()> {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    write!(out, "{:12}", line.case)?;
    let lengths = [
        (line.x, line.sigma_x),
        (line.y, line.sigma_y),
        (line.z, line.sigma_z),
    ];
    for (value, sigma) in lengths {
        write!(out, "  {:>10} {:>8}", number(value, 4), number(sigma, 4))?;
    }
    let angles = [
        (line.heading_deg, line.sigma_heading_deg),
        (line.pitch_deg, line.sigma_pitch_deg),
        (line.roll_deg, line.sigma_roll_deg),
    ];
    for (value, sigma) in angles {
        write!(out, "  {:>8} {:>7}", number(value, 2), number(sigma, 2))?;
    }
    let status = match line.reason {
        Some(reason) => format!("{}: {}", line.status, reason.replace('_', " ")),
        None => line.status.to_owned(),
    };
    let chi_squared = number(line.chi_squared, 1);
    writeln!(out, "  {:>4} {chi_squared:>11}  {status}", line.sightings)
}
