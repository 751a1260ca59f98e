//! `host-sim solve-reference`

use std::{
    io::{self, BufWriter, Write},
    path::PathBuf,
    process::ExitCode,
};

use calib_core::{
    Method,
    reference::{self, Known, ReferenceSettings},
};
use clap::{Args, ValueEnum};
use results::recorded::{
    self,
    stops::{self, Assumptions},
};
use results::report::{json::ReferenceLine, table};

use super::{
    camera_options::{CameraOptions, FOR_COLUMNS, USUAL_COLUMNS},
    file_name,
    messages::{tell_assumed_sigma, tell_passed_over},
    of_file, tell, unless_gone, values,
};

/// Headings of two reference cameras from stops of a target that both saw.
///
/// Camera 0 is the origin and camera 1 is on the x axis. Two stops are enough if the baseline and
/// the frame heading are known, but may leave two answers; otherwise three are needed.
#[derive(Args)]
#[command(after_long_help = EPILOGUE)]
pub(super) struct Arguments {
    /// Stops in the order in which they were made, or `-` for the standard input.
    #[arg(value_name = "FILE.csv")]
    file: PathBuf,
    /// Distance between the two cameras, or `unknown`.
    #[arg(long, value_name = "LENGTH", value_parser = values::Known::length)]
    baseline: values::Known,
    /// Direction of the displacements' x axis against the baseline, degrees, or `unknown`.
    #[arg(
        long, value_name = "DEGREES", value_parser = values::Known::angle, default_value = "0"
    )]
    frame_heading_deg: values::Known,
    /// Standard deviation of bearings, radians, for files without a column `sigma_rad`.
    ///
    /// Without it: that of whole pixels for columns, 0.0087 (half a degree) for bearings.
    #[arg(long, value_name = "RAD", value_parser = values::positive)]
    bearing_sigma: Option<f64>,
    /// Standard deviation of each displacement, per axis.
    #[arg(long, value_name = "LENGTH", value_parser = values::not_negative, default_value_t = 0.0)]
    displacement_sigma: f64,
    /// Method of getting from the closed form to the minimum.
    #[arg(long, value_enum, default_value_t)]
    method: MethodOption,
    /// One JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Name of the unit of length of the file.
    #[arg(long, value_name = "NAME", default_value = "m")]
    unit: String,
    #[command(flatten, next_help_heading = FOR_COLUMNS)]
    camera: CameraOptions,
}

const EPILOGUE: &str = "\
FILE.csv: the first line names the columns, in any order; columns not listed here are ignored.
  stop                          the name of the stop: any text
  bearing_0_rad, bearing_1_rad  the directions in which the cameras saw the target, radians,
                                positive to the left
  bearing_0_deg, bearing_1_deg  or the same in degrees
  column_0, column_1            or the pixel columns, from 0 on the left: needs --fov-deg
  dx, dy                        displacement from the previous stop; ignored in the first row
  sigma_rad                     optional: standard deviation of both directions, radians

Examples:
  host-sim solve-reference stops.csv --baseline 10 --displacement-sigma 0.05
  host-sim solve-reference blobs.csv --baseline unknown --fov-deg 60 --projection equal-angle

JSON: status (calibrated, doubtful, refused, or waiting with fewer than three stops), reason
(contradictory or ambiguous where it is doubtful, or why it was refused; otherwise null), candidates,
best and alternative (or null), each with heading_0_rad, heading_1_rad, sigma_heading_0_rad, sigma_heading_1_rad, baseline,
sigma_baseline, frame_heading_rad, sigma_frame_heading_rad (sigmas of what was given are 0), stops
(stop, x, y, sigma_x, sigma_y), chi_squared, degrees_of_freedom, iterations, condition.
Ambiguous: the alternative is not ruled out. Contradictory: only one in a thousand answers would fit as badly by chance, so a stop, the baseline,
the frame heading, the camera or the sigmas given are wrong, and so may be the answer and its sigmas.

Exit codes:
  0  there is an answer to rely on
  1  the stops were read, but have no answer, or only a doubtful one (contradictory or ambiguous)
  2  wrong options, or the file could not be read";

#[derive(Clone, Copy, Default, ValueEnum)]
enum MethodOption {
    /// Gauss-Newton with damping where it is needed.
    #[default]
    Levenberg,
    /// Equation (5) of the thesis.
    GaussNewton,
    /// Equation (6) of the thesis: thousands of steps.
    SteepestDescent,
}

impl MethodOption {
    fn settings(self) -> ReferenceSettings {
        let mut settings = ReferenceSettings::default();
        settings.method = match self {
            Self::Levenberg => Method::Levenberg,
            Self::GaussNewton => Method::GaussNewton,
            Self::SteepestDescent => {
                // It creeps along valleys; each step costs microseconds.
                settings.iteration_limit = 100_000;
                Method::SteepestDescent
            }
        };
        settings
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let assumptions = Assumptions {
        camera: arguments.camera.camera(USUAL_COLUMNS)?,
        bearing_sigma: arguments.bearing_sigma,
        displacement_sigma: arguments.displacement_sigma,
    };
    let path = &arguments.file;
    let read = recorded::open(path, |input, _| input)
        .and_then(|input| stops::read(input, &assumptions))
        .map_err(|error| of_file(path, error))?;
    if read.sigma_assumed {
        tell_assumed_sigma(path);
    }
    tell_passed_over(path, read.passed_over);
    let known = Known {
        baseline: arguments.baseline.0,
        frame_heading: arguments.frame_heading_deg.0.map(f64::to_radians),
    };
    let outcome = reference::solve(&read.stops, &known, &arguments.method.settings());
    let line = ReferenceLine::new(&outcome, &read.names, &read.stops);

    unless_gone(write(&line, arguments))?;
    let name = file_name(path);
    Ok(match outcome {
        Ok(outcome) if line.reason == Some(ReferenceLine::CONTRADICTORY) => {
            let best = &outcome.best;
            tell(format_args!(
                "{name}: {}: the stops contradict each other (chi squared {:.1}, degrees of \
                 freedom {}), so neither headings nor sigmas can be relied on: check --baseline, \
                 --frame-heading-deg, the camera and the sigmas given, look for a wrong stop, or \
                 stop the target at more places",
                line.status, best.chi_squared, best.degrees_of_freedom
            ));
            ExitCode::from(1)
        }
        Ok(outcome) if outcome.alternative.is_some() => {
            tell(format_args!(
                "{name}: {}: two answers fit about as well: stop the target at one more place",
                line.status
            ));
            ExitCode::from(1)
        }
        Ok(_) => ExitCode::SUCCESS,
        Err(refusal) => {
            tell(format_args!("{name}: {}: {refusal}", line.status));
            ExitCode::from(1)
        }
    })
}

fn write(line: &ReferenceLine<'_>, arguments: &Arguments) -> io::Result<()> {
    let mut out = BufWriter::new(io::stdout().lock());
    if arguments.json {
        serde_json::to_writer(&mut out, line)?;
        writeln!(out)?;
    } else if let Some(best) = &line.best {
        table::write_reference(&mut out, best, &arguments.unit)?;
        if line.reason == Some(ReferenceLine::CONTRADICTORY) {
            writeln!(
                out,
                "doubtful, contradictory: the stops do not fit this answer"
            )?;
        }
        match &line.alternative {
            None => writeln!(out, "candidates: {}", line.candidates)?,
            Some(other) => {
                writeln!(
                    out,
                    "candidates: {}, of which this one fits about as well; one more stop decides:\n",
                    line.candidates
                )?;
                table::write_reference(&mut out, other, &arguments.unit)?;
            }
        }
    }
    out.flush()
}
