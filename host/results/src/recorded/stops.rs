//! The stops of a reference solve: one row per stop, in the order in which they were made.
//!
//! | column | meaning |
//! |---|---|
//! | `stop` | its name: any text |
//! | `bearing_0_rad`, `bearing_1_rad` | directions in which the two cameras saw the target, radians |
//! | `bearing_0_deg`, `bearing_1_deg` | or: the same in degrees |
//! | `column_0`, `column_1` | or: the pixel columns |
//! | `dx`, `dy` | displacement from the previous stop; not needed in the first row |
//! | `sigma_rad` | optional: standard deviation of both directions, radians, above 0 |
//!
//! A stop hangs on the one before it, so one wrong row makes the file useless: it is an error.

use std::io::BufRead;

use calib_core::{camera::Camera, reference::Stop};
use nalgebra::{Matrix2, Vector2};

use super::{
    ReadError,
    directions::Directions,
    rows::{Column, Row, Rows},
};

/// Assumptions about what the file itself does not say.
#[derive(Clone, Copy, Debug, Default)]
pub struct Assumptions {
    /// The camera that pixel columns are of, the same model for both; with it, `column_0` and
    /// `column_1` are read rather than the bearings.
    pub camera: Option<Camera<f64>>,
    /// Bearing sigma, radians, where there is no column `sigma_rad`. Without it that of whole
    /// pixels is taken, or [`USUAL_BEARING_SIGMA`](super::USUAL_BEARING_SIGMA) for bearings.
    pub bearing_sigma: Option<f64>,
    /// Sigma of each displacement in x and in y.
    pub displacement_sigma: f64,
}

/// The stops of a file.
#[derive(Debug)]
pub struct Stops {
    /// Their names.
    pub names: Vec<String>,
    /// Measurements at each stop.
    pub stops: Vec<Stop<f64>>,
    /// True if [`USUAL_BEARING_SIGMA`](super::USUAL_BEARING_SIGMA) had to be assumed.
    pub sigma_assumed: bool,
    /// The measurements that the file has too, but that were not read, such as `column_0` beside
    /// bearings.
    pub passed_over: Option<&'static str>,
}

struct Layout<'a> {
    stop: Column,
    directions: Directions<2>,
    displacement: [Column; 2],
    sigma: Option<Column>,
    assumptions: &'a Assumptions,
}

impl<'a> Layout<'a> {
    fn find<R: BufRead>(rows: &Rows<R>, assumptions: &'a Assumptions) -> Result<Self, ReadError> {
        let names = [
            ["bearing_0_rad", "bearing_0_deg", "column_0"],
            ["bearing_1_rad", "bearing_1_deg", "column_1"],
        ];
        Ok(Self {
            stop: rows.need("stop")?,
            directions: Directions::find(rows, assumptions.camera, names)?,
            displacement: [rows.need("dx")?, rows.need("dy")?],
            sigma: rows.find("sigma_rad")?,
            assumptions,
        })
    }

    fn stop(&mut self, row: Row<'_>, is_first: bool) -> Result<Stop<f64>, String> {
        let sigma = match self.sigma {
            Some(column) => Some(row.number(column)?),
            None => self.assumptions.bearing_sigma,
        };
        if sigma.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
            return Err("`sigma_rad` must be finite and above 0".to_owned());
        }
        let directions = self.directions.read(row)?;
        let displacement = if is_first {
            Vector2::zeros()
        } else {
            let [dx, dy] = self.displacement.map(|column| row.number(column));
            Vector2::new(dx?, dy?)
        };
        Ok(Stop {
            rays: directions.map(|(ray, _)| ray),
            bearing_sigmas: directions.map(|(_, usual)| sigma.unwrap_or(usual)),
            displacement,
            displacement_covariance: Matrix2::from_diagonal_element(
                self.assumptions.displacement_sigma.powi(2),
            ),
        })
    }
}

/// Reads stops.
///
/// # Errors
/// Errors of the file or of any row of it.
pub fn read(input: impl BufRead, assumptions: &Assumptions) -> Result<Stops, ReadError> {
    let mut rows = Rows::new(input)?;
    let mut layout = Layout::find(&rows, assumptions)?;
    let mut all = Stops {
        names: Vec::new(),
        stops: Vec::new(),
        sigma_assumed: layout.sigma.is_none()
            && assumptions.bearing_sigma.is_none()
            && !layout.directions.are_pixels(),
        passed_over: layout.directions.passed_over,
    };
    while let Some(row) = rows.next()? {
        let stop = layout
            .stop(row, all.stops.is_empty())
            .map_err(|what| ReadError::Row(row.complaint(what)))?;
        all.names.push(row.text(layout.stop).into_owned());
        all.stops.push(stop);
    }
    if all.stops.is_empty() {
        return Err(ReadError::NoRows);
    }
    layout.directions.check()?;
    Ok(all)
}
