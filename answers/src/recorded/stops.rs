//! The stops of a reference solve: one row per stop, in the order in which they were made.
//!
//! | column | meaning |
//! |---|---|
//! | `stop` | its name: any text |
//! | `bearing_0_rad`, `bearing_1_rad` | directions in which the two cameras saw the target, radians |
//! | `column_0`, `column_1` | or: the pixel columns |
//! | `dx`, `dy` | displacement from the previous stop; not needed in the first row |
//! | `sigma_rad` | optional: standard deviation of both directions, radians, above 0 |
//!
//! A stop hangs on the one before it, so one wrong row makes the file useless: it is an error.

use std::io::BufRead;

use calib_core::{Ray, camera::Camera, reference::Stop};
use nalgebra::{Matrix2, Vector2};

use super::{
    ReadError,
    rows::{Column, Row, Rows},
    sightings::{USUAL_BEARING_SIGMA, check_column},
};

/// What the file itself does not say.
#[derive(Clone, Copy, Debug, Default)]
pub struct Assumptions {
    /// The camera that pixel columns are of, the same model for both; with it, `column_0` and
    /// `column_1` are read rather than the bearings.
    pub camera: Option<Camera<f64>>,
    /// Bearing sigma, radians, where there is no column `sigma_rad`. Without it that of whole
    /// pixels is taken, or [`USUAL_BEARING_SIGMA`] for bearings.
    pub bearing_sigma: Option<f64>,
    /// Sigma of each displacement in x and in y.
    pub displacement_sigma: f64,
}

/// The stops of a file.
#[derive(Debug)]
pub struct Stops {
    /// Their names.
    pub names: Vec<String>,
    /// What was measured there.
    pub stops: Vec<Stop<f64>>,
    /// Whether [`USUAL_BEARING_SIGMA`] had to be assumed.
    pub sigma_assumed: bool,
    /// The measurements that the file has too, but that were not read: `column_0` beside bearings,
    /// or `bearing_0_rad` beside columns.
    pub passed_over: Option<&'static str>,
}

struct Layout<'a> {
    stop: Column,
    measured: [Column; 2],
    passed_over: Option<&'static str>,
    displacement: [Column; 2],
    sigma: Option<Column>,
    assumptions: &'a Assumptions,
}

impl<'a> Layout<'a> {
    fn find<R: BufRead>(rows: &Rows<R>, assumptions: &'a Assumptions) -> Result<Self, ReadError> {
        let stop = rows.need("stop")?;
        let measured = if assumptions.camera.is_some() {
            [rows.need("column_0")?, rows.need("column_1")?]
        } else if let Some(first) = rows.find("bearing_0_rad")? {
            [first, rows.need("bearing_1_rad")?]
        } else if rows.find("column_0")?.is_some() {
            return Err(ReadError::NeedsCamera("column_0".to_owned()));
        } else {
            return Err(rows.no_column("bearing_0_rad` or `column_0"));
        };
        let other = match assumptions.camera {
            Some(_) => "bearing_0_rad",
            None => "column_0",
        };
        Ok(Self {
            stop,
            measured,
            passed_over: rows.find(other)?.map(|_| other),
            displacement: [rows.need("dx")?, rows.need("dy")?],
            sigma: rows.find("sigma_rad")?,
            assumptions,
        })
    }

    fn stop(&self, row: Row<'_>, is_first: bool) -> Result<Stop<f64>, String> {
        let sigma = match self.sigma {
            Some(column) => Some(row.number(column)?),
            None => self.assumptions.bearing_sigma,
        };
        if sigma.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
            return Err("`sigma_rad` must be finite and above 0".to_owned());
        }
        let mut rays = [Ray::from_bearing(0.0); 2];
        let mut bearing_sigmas = [0.0; 2];
        for ((ray, bearing_sigma), column) in
            rays.iter_mut().zip(&mut bearing_sigmas).zip(self.measured)
        {
            let measured = row.number(column)?;
            let whole_pixel;
            (*ray, whole_pixel) = match &self.assumptions.camera {
                Some(camera) => {
                    check_column(camera, measured)?;
                    (camera.ray(measured), camera.whole_pixel_sigma(measured))
                }
                None => (Ray::from_bearing(measured), USUAL_BEARING_SIGMA),
            };
            *bearing_sigma = sigma.unwrap_or(whole_pixel);
        }
        let displacement = if is_first {
            Vector2::zeros()
        } else {
            let [dx, dy] = self.displacement.map(|column| row.number(column));
            Vector2::new(dx?, dy?)
        };
        Ok(Stop {
            rays,
            bearing_sigmas,
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
/// What is wrong with the file or with any row of it.
pub fn read(input: impl BufRead, assumptions: &Assumptions) -> Result<Stops, ReadError> {
    let mut rows = Rows::new(input)?;
    let layout = Layout::find(&rows, assumptions)?;
    let mut all = Stops {
        names: Vec::new(),
        stops: Vec::new(),
        sigma_assumed: layout.sigma.is_none()
            && assumptions.bearing_sigma.is_none()
            && assumptions.camera.is_none(),
        passed_over: layout.passed_over,
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
    Ok(all)
}
