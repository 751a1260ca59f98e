//! Measurements of a network: bearings, and displacements from stop to stop.
//!
//! Bearings, a row for each:
//!
//! | column | meaning |
//! |---|---|
//! | `stop` | at which stop, a whole number: stops count up in the order in which they were made |
//! | `camera` | by which camera, a whole number |
//! | `bearing_deg` | in which direction the target was seen, degrees, positive to the left |
//! | `bearing_rad` | or: the same in radians |
//! | `column` | or: in which pixel column |
//! | `sigma_deg`, `sigma_rad` | optional: standard deviation of the direction, above 0 |
//! | `target` | optional: which target, a whole number; 1 if there is no such column |
//!
//! Displacements, a row for each stop but a target's first:
//!
//! | column | meaning |
//! |---|---|
//! | `stop` | the stop that it leads to, from the one before |
//! | `dx`, `dy` | the displacement |
//! | `sigma` | optional: its standard deviation in x and in y |
//! | `cov_xx`, `cov_xy`, `cov_yy` | or: its covariance |
//! | `target` | optional: which target |
//!
//! Ranges, a row for each, and visits to marks:
//!
//! | column | meaning |
//! |---|---|
//! | `stop` | at which stop |
//! | `camera`, `range` | how far the target was from which camera, above 0 |
//! | `mark` | or: on which mark it stood, a whole number |
//! | `sigma` | the standard deviation of the range, or of the place on the mark along each axis, above 0 |
//! | `target` | optional where there is one: which target |
//!
//! One wrong row may spoil all poses: it is an error.

use std::io::BufRead;

use calib_core::camera::Camera;

use super::{
    ReadError,
    directions::Directions,
    rows::{Column, Row, Rows},
};
use crate::record::sightings::{Bearing, Leg, Range, Visit};

/// Number of the target where there is no column `target`.
const ONLY_TARGET: u16 = 1;

/// Assumptions about what a file of bearings does not say.
#[derive(Clone, Copy, Debug, Default)]
pub struct Assumptions {
    /// The camera that pixel columns are of, the same model for all; with it, `column` is read
    /// rather than bearings.
    pub camera: Option<Camera<f64>>,
    /// Bearing sigma, radians, where there is no such column. Without it that of whole pixels is
    /// taken, or [`USUAL_BEARING_SIGMA`](super::USUAL_BEARING_SIGMA) for bearings.
    pub bearing_sigma: Option<f64>,
}

/// The bearings of a file.
#[derive(Debug)]
pub struct Bearings {
    /// In the order of the file.
    pub bearings: Vec<Bearing>,
    /// True if [`USUAL_BEARING_SIGMA`](super::USUAL_BEARING_SIGMA) had to be assumed.
    pub sigma_assumed: bool,
    /// The measurements that the file has too, but that were not read.
    pub passed_over: Option<&'static str>,
}

/// Reads bearings.
///
/// # Errors
/// Errors of the file or of any row of it.
pub fn bearings(input: impl BufRead, assumptions: &Assumptions) -> Result<Bearings, ReadError> {
    let mut rows = Rows::new(input)?;
    let target = rows.find("target")?;
    let (stop, camera) = (rows.need("stop")?, rows.need("camera")?);
    let names = [["bearing_rad", "bearing_deg", "column"]];
    let mut directions = Directions::find(&rows, assumptions.camera, names)?;
    let (sigma_deg, sigma_rad) = (rows.find("sigma_deg")?, rows.find("sigma_rad")?);
    let mut all = Bearings {
        bearings: Vec::new(),
        sigma_assumed: sigma_deg.is_none()
            && sigma_rad.is_none()
            && assumptions.bearing_sigma.is_none()
            && !directions.are_pixels(),
        passed_over: directions.passed_over,
    };
    while let Some(row) = rows.next()? {
        let mut read = || {
            let [(ray, usual)] = directions.read(row)?;
            let sigma_deg = match (sigma_deg, sigma_rad) {
                (Some(column), _) => row.number(column)?,
                (_, Some(column)) => row.number(column)?.to_degrees(),
                _ => assumptions.bearing_sigma.unwrap_or(usual).to_degrees(),
            };
            let bearing_deg = ray.bearing().to_degrees();
            if !bearing_deg.is_finite() {
                return Err("the bearing must be finite".to_owned());
            }
            if !(sigma_deg > 0.0 && sigma_deg.is_finite()) {
                return Err("the sigma must be finite and above 0".to_owned());
            }
            Ok(Bearing {
                target: target_of(row, target, ONLY_TARGET)?,
                stop: whole(row, stop, "stop")?,
                camera: whole(row, camera, "camera")?,
                bearing_deg,
                sigma_deg,
                elevation_deg: None,
            })
        };
        let bearing = read().map_err(|what| ReadError::Row(row.complaint(what)))?;
        all.bearings.push(bearing);
    }
    if all.bearings.is_empty() {
        return Err(ReadError::NoRows);
    }
    directions.check()?;
    Ok(all)
}

/// Reads displacements. `sigma` is their standard deviation where the file has none.
///
/// # Errors
/// Errors of the file or of any row of it.
pub fn legs(input: impl BufRead, sigma: Option<f64>) -> Result<Vec<Leg>, ReadError> {
    let mut rows = Rows::new(input)?;
    let target = rows.find("target")?;
    let stop = rows.need("stop")?;
    let way = [rows.need("dx")?, rows.need("dy")?];
    let own_sigma = rows.find("sigma")?;
    let covariance = match rows.find("cov_xx")? {
        Some(xx) => Some([xx, rows.need("cov_xy")?, rows.need("cov_yy")?]),
        None => None,
    };
    if own_sigma.is_none() && covariance.is_none() && sigma.is_none() {
        return Err(rows.no_column("sigma` (or --displacement-sigma), nor a column `cov_xx"));
    }
    let mut legs = Vec::<Leg>::new();
    while let Some(row) = rows.next()? {
        let read = || {
            let [dx, dy] = way.map(|column| row.number(column));
            let covariance = match (covariance, own_sigma) {
                (Some([xx, xy, yy]), _) => [row.number(xx)?, row.number(xy)?, row.number(yy)?],
                (_, Some(column)) => round(row.number(column)?),
                _ => round(sigma.unwrap_or_default()),
            };
            let leg = Leg {
                target: target_of(row, target, ONLY_TARGET)?,
                stop: whole(row, stop, "stop")?,
                dx: dx?,
                dy: dy?,
                covariance,
            };
            let [xx, xy, yy] = covariance;
            if ![leg.dx, leg.dy, xx, xy, yy]
                .iter()
                .all(|number| number.is_finite())
            {
                return Err("a displacement and its sigma must be finite".to_owned());
            }
            if !(xx >= 0.0 && yy >= 0.0 && xy * xy <= xx * yy * (1.0 + 1e-9)) {
                return Err("`cov_xx`, `cov_xy` and `cov_yy` are no covariance".to_owned());
            }
            if legs
                .iter()
                .any(|known| (known.target, known.stop) == (leg.target, leg.stop))
            {
                return Err(format!(
                    "stop {} of target {} has a displacement already: leave one out",
                    leg.stop, leg.target
                ));
            }
            Ok(leg)
        };
        let leg = read().map_err(|what| ReadError::Row(row.complaint(what)))?;
        legs.push(leg);
    }
    if legs.is_empty() {
        return Err(ReadError::NoRows);
    }
    Ok(legs)
}

/// Reads ranges. `only` is the target of the measurements that they belong to, if there is one.
///
/// # Errors
/// Errors of the file or of any row of it; no column `target`, where there are several.
pub fn ranges(input: impl BufRead, only: Option<u16>) -> Result<Vec<Range>, ReadError> {
    let mut rows = Rows::new(input)?;
    let (target, only) = target_or_only(&rows, only)?;
    let (stop, camera) = (rows.need("stop")?, rows.need("camera")?);
    let (range, sigma) = (rows.need("range")?, rows.need("sigma")?);
    all(&mut rows, |row| {
        Ok(Range {
            target: target_of(row, target, only)?,
            stop: whole(row, stop, "stop")?,
            camera: whole(row, camera, "camera")?,
            range: above_zero(row, range, "range")?,
            sigma: above_zero(row, sigma, "sigma")?,
        })
    })
}

/// Reads visits to marks. `only` as of [`ranges`].
///
/// # Errors
/// Errors of the file or of any row of it; no column `target`, where there are several.
pub fn visits(input: impl BufRead, only: Option<u16>) -> Result<Vec<Visit>, ReadError> {
    let mut rows = Rows::new(input)?;
    let (target, only) = target_or_only(&rows, only)?;
    let (stop, mark) = (rows.need("stop")?, rows.need("mark")?);
    let sigma = rows.need("sigma")?;
    all(&mut rows, |row| {
        Ok(Visit {
            target: target_of(row, target, only)?,
            stop: whole(row, stop, "stop")?,
            mark: whole(row, mark, "mark")?,
            sigma: above_zero(row, sigma, "sigma")?,
        })
    })
}

/// One thing a row, one at least.
fn all<O>(
    rows: &mut Rows<impl BufRead>,
    read: impl Fn(Row<'_>) -> Result<O, String>,
) -> Result<Vec<O>, ReadError> {
    let mut all = Vec::new();
    while let Some(row) = rows.next()? {
        all.push(read(row).map_err(|what| ReadError::Row(row.complaint(what)))?);
    }
    if all.is_empty() {
        return Err(ReadError::NoRows);
    }
    Ok(all)
}

fn above_zero(row: Row<'_>, column: Column, name: &str) -> Result<f64, String> {
    let number = row.number(column)?;
    if number.is_finite() && number > 0.0 {
        Ok(number)
    } else {
        Err(format!("`{name}` must be finite and above 0"))
    }
}

fn round(sigma: f64) -> [f64; 3] {
    [sigma * sigma, 0.0, sigma * sigma]
}

fn target_of(row: Row<'_>, column: Option<Column>, only: u16) -> Result<u16, String> {
    column.map_or(Ok(only), |column| whole(row, column, "target"))
}

/// The target of rows without a column that says it: the only one of the measurements that they belong to.
fn target_or_only(
    rows: &Rows<impl BufRead>,
    only: Option<u16>,
) -> Result<(Option<Column>, u16), ReadError> {
    match (rows.find("target")?, only) {
        (column @ Some(_), _) => Ok((column, ONLY_TARGET)),
        (None, Some(only)) => Ok((None, only)),
        (None, None) => Err(rows.no_column("target")),
    }
}

fn whole<N: std::str::FromStr>(row: Row<'_>, column: Column, name: &str) -> Result<N, String> {
    let text = row.text(column);
    let most = (1_u64 << (8 * size_of::<N>())) - 1;
    let needed = |_| format!("`{name}` is {text:?}: a whole number from 0 to {most} belongs there");
    text.parse().map_err(needed)
}
