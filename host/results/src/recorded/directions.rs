//! In which direction a target was seen: bearings in radians or degrees, or pixel columns.

use std::f64::consts::{PI, TAU};
use std::io::BufRead;

use calib_core::{Ray, camera::Camera};

use super::{
    ReadError,
    rows::{Column, Row, Rows},
};

/// Bearing sigma where a file of bearings says nothing: half a degree, radians. The cameras of small robots
/// reach about that.
pub const USUAL_BEARING_SIGMA: f64 = 0.0087;

/// Names of a direction's column, as bearings in radians, in degrees and as pixel columns.
pub(super) type Names = [&'static str; 3];

/// Form in which directions are written down.
#[derive(Clone, Copy)]
enum Unit {
    Radians,
    Degrees,
    Pixels(Camera<f64>),
}

/// The directions of a file: `N` in each row.
pub(super) struct Directions<const N: usize> {
    names: [Names; N],
    columns: [Column; N],
    unit: Unit,
    /// The first name of the measurements that the file has too, but that are not read.
    pub(super) passed_over: Option<&'static str>,
    read: usize,
    beyond_pi: usize,
    beyond_a_turn: usize,
}

impl<const N: usize> Directions<N> {
    /// With a camera those are pixel columns.
    pub(super) fn find<R: BufRead>(
        rows: &Rows<R>,
        camera: Option<Camera<f64>>,
        names: [Names; N],
    ) -> Result<Self, ReadError> {
        let [radians, degrees, pixels] = names.first().copied().unwrap_or_default();
        let (kind, unit) = if let Some(camera) = camera {
            (2, Unit::Pixels(camera))
        } else if rows.find(radians)?.is_some() {
            (0, Unit::Radians)
        } else if rows.find(degrees)?.is_some() {
            (1, Unit::Degrees)
        } else if rows.find(pixels)?.is_some() {
            return Err(ReadError::NeedsCamera(pixels.to_owned()));
        } else {
            return Err(rows.no_column(&format!("{radians}`, `{degrees}` or `{pixels}")));
        };
        let mut columns = [Column::default(); N];
        for (column, names) in columns.iter_mut().zip(names) {
            *column = rows.need(names[kind])?;
        }
        let mut passed_over = None;
        for other in (0..3).filter(|&other| other != kind) {
            let name = [radians, degrees, pixels][other];
            passed_over = passed_over.or(rows.find(name)?.map(|_| name));
        }
        Ok(Self {
            names,
            columns,
            unit,
            passed_over,
            read: 0,
            beyond_pi: 0,
            beyond_a_turn: 0,
        })
    }

    /// The directions of a row, each with the sigma it has if the file does not say, radians. A
    /// number that is not finite gives a ray that is not.
    pub(super) fn read(&mut self, row: Row<'_>) -> Result<[(Ray<f64>, f64); N], String> {
        let mut measured = [0.0; N];
        for (value, column) in measured.iter_mut().zip(self.columns) {
            *value = row.number(column)?;
        }
        let mut rays = [(Ray::from_bearing(0.0), USUAL_BEARING_SIGMA); N];
        for ((ray, value), names) in rays.iter_mut().zip(measured).zip(self.names) {
            *ray = match &self.unit {
                Unit::Pixels(camera) => {
                    check_column(camera, value)?;
                    (camera.ray(value), camera.whole_pixel_sigma(value))
                }
                Unit::Degrees => (Ray::from_bearing(value.to_radians()), USUAL_BEARING_SIGMA),
                Unit::Radians => {
                    self.read += 1;
                    self.beyond_pi += usize::from(value.abs() > PI);
                    if value.is_finite() && value.abs() > TAU {
                        self.beyond_a_turn += 1;
                        return Err(format!(
                            "`{}` is {value}, more than a whole turn (6.28): it is in radians; call \
                             the column `{}` if these are degrees",
                            names[0], names[1]
                        ));
                    }
                    (Ray::from_bearing(value), USUAL_BEARING_SIGMA)
                }
            };
        }
        Ok(rays)
    }

    /// Returns true if the sigma of a direction comes from the camera.
    pub(super) fn are_pixels(&self) -> bool {
        matches!(self.unit, Unit::Pixels(_))
    }

    /// Refuses a file of bearings that cannot be radians; to be asked when all rows are read. Radians
    /// are within half a turn, or a whole one where they start at 0; of degrees, some are small too.
    pub(super) fn check(&self) -> Result<(), ReadError> {
        if 10 * self.beyond_a_turn > self.read || 10 * self.beyond_pi > 9 * self.read {
            let [radians, degrees, _] = self.names.first().copied().unwrap_or_default();
            return Err(ReadError::Degrees { radians, degrees });
        }
        Ok(())
    }
}

/// Refuses columns that the camera does not have; a value that is no number is refused with its case.
fn check_column(camera: &Camera<f64>, column: f64) -> Result<(), String> {
    if column.is_finite() && !camera.has_column(column) {
        return Err(format!(
            "the camera has no column {column}: columns go from 0 to {}, see --columns",
            camera.last_column()
        ));
    }
    Ok(())
}
