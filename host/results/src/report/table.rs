//! Answers as tables for people: lengths in a named unit, angles in degrees.

use std::{
    fmt,
    io::{self, Write},
};

use calib_core::Status;

use crate::answer::{Answer, Reason};
use crate::report::json::ReferenceSolution;

/// Longer names of cases push their row to the right rather than widen every row.
const WIDEST_CASE: usize = 24;

/// A table of poses, written row by row: all widths are fixed beforehand.
#[derive(Debug)]
pub struct PoseTable<W> {
    out: W,
    case_width: usize,
}

impl<W: Write> PoseTable<W> {
    /// Writes the heading. `longest_case` is the number of characters of the longest name.
    ///
    /// # Errors
    /// Those of writing.
    pub fn begin(mut out: W, unit: &str, longest_case: usize) -> io::Result<Self> {
        let case_width = longest_case.clamp("case".len(), WIDEST_CASE);
        writeln!(
            out,
            "{:case_width$}  {:>10} {:>10}  {:>10} {:>10}  {:>9} {:>9}  {:>4} {:>7} {:>11}  status",
            "case",
            format!("x [{unit}]"),
            "+/-",
            format!("y [{unit}]"),
            "+/-",
            "heading",
            "+/- [deg]",
            "used",
            "dropped",
            "chi squared",
        )?;
        Ok(Self { out, case_width })
    }

    /// Writes one row.
    ///
    /// # Errors
    /// Those of writing.
    pub fn row(&mut self, answer: &Answer<'_>) -> io::Result<()> {
        let Self { out, case_width } = self;
        write!(out, "{:case_width$}  ", answer.case)?;
        match &answer.solution {
            Some(solution) => {
                let pose = &solution.pose;
                write!(
                    out,
                    "{} {}  {} {}  {} {}  {:>4}",
                    length(pose.position.x),
                    length(pose.sigma_x()),
                    length(pose.position.y),
                    length(pose.sigma_y()),
                    degrees(pose.heading),
                    degrees(pose.sigma_heading()),
                    solution.used,
                )?;
            }
            None => write!(
                out,
                "{:>10} {:>10}  {:>10} {:>10}  {:>9} {:>9}  {:>4}",
                "-", "-", "-", "-", "-", "-", "-"
            )?,
        }
        let chi_squared = answer
            .solution
            .map_or_else(|| "-".to_owned(), |s| chi_squared(s.chi_squared));
        writeln!(
            out,
            " {:>7} {chi_squared:>11}  {}",
            answer.dropped,
            Words(answer.status, answer.reason.map(Reason::name))
        )
    }

    /// Writer that the table was written to.
    pub fn into_inner(self) -> W {
        self.out
    }
}

/// A status with its reason: `refused: danger_circle`.
pub struct Words(pub Status, pub Option<&'static str>);

impl fmt::Display for Words {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self(status, Some(reason)) => write!(f, "{status}: {}", reason.replace('_', " ")),
            Self(status, None) => write!(f, "{status}"),
        }
    }
}

/// Ten characters.
fn length(value: f64) -> String {
    if value.abs() < 1e5 {
        format!("{value:10.3}")
    } else {
        format!("{value:10.2e}")
    }
}

fn chi_squared(value: f64) -> String {
    if value < 1e6 {
        format!("{value:.1}")
    } else {
        format!("{value:.1e}")
    }
}

/// Nine characters.
fn degrees(radians: f64) -> String {
    let degrees = radians.to_degrees();
    if degrees < 1e5 {
        format!("{degrees:9.2}")
    } else {
        format!("{degrees:9.1e}")
    }
}

/// Writes one answer of a reference solve.
///
/// # Errors
/// Those of writing.
pub fn write_reference(
    mut out: impl Write,
    solution: &ReferenceSolution<'_>,
    unit: &str,
) -> io::Result<()> {
    let rows = [
        (
            "camera 0 heading",
            solution.heading_0_rad,
            solution.sigma_heading_0_rad,
        ),
        (
            "camera 1 heading",
            solution.heading_1_rad,
            solution.sigma_heading_1_rad,
        ),
        (
            "frame heading",
            solution.frame_heading_rad,
            solution.sigma_frame_heading_rad,
        ),
    ];
    for (name, value, sigma) in rows {
        let sigma = uncertainty(sigma, degrees);
        writeln!(out, "{name:18}{:>10} {sigma} [deg]", degrees(value))?;
    }
    let sigma = uncertainty(solution.sigma_baseline, length);
    let value = length(solution.baseline);
    writeln!(out, "{:18}{value} {sigma} [{unit}]", "baseline")?;
    for stop in &solution.stops {
        let name = format!("stop {}", stop.stop);
        let [x, y, sigma_x, sigma_y] = [stop.x, stop.y, stop.sigma_x, stop.sigma_y].map(length);
        writeln!(
            out,
            "{name:18}{x} +/- {}, {} +/- {} [{unit}]",
            sigma_x.trim_start(),
            y.trim_start(),
            sigma_y.trim_start(),
        )?;
    }
    writeln!(
        out,
        "chi squared {:.3}, degrees of freedom {}, condition number {:.1}, iterations {}",
        solution.chi_squared, solution.degrees_of_freedom, solution.condition, solution.iterations,
    )
}

/// Zero says that the value was given.
fn uncertainty(sigma: f64, print: fn(f64) -> String) -> String {
    if sigma > 0.0 {
        format!("+/- {}", print(sigma).trim_start())
    } else {
        "given".to_owned()
    }
}
