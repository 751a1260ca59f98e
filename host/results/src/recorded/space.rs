//! Recorded pixels of cameras in space, grouped by camera and height.
//!
//! | column | meaning |
//! |---|---|
//! | `camera` | number of the camera that saw it |
//! | `height_slab` | optional: height that its targets stood at, about; each is a case of its own |
//! | `point` | optional, not read: number of the target |
//! | `target_x`, `target_y`, `target_z` | where the target stood |
//! | `column`, `row` | at which pixel it was seen, from 0 at the upper left |

use std::io::BufRead;

use calib_core::space::Sighting;
use indexmap::IndexMap;
use nalgebra::{Point3, Vector2, Vector3};

use super::{
    Complaint, ReadError,
    rows::{Row, Rows, shortened},
};

/// Standard deviations that a file does not say.
#[derive(Clone, Copy, Debug)]
pub struct Sigmas {
    /// Of columns and rows.
    pub pixel: f64,
    /// Of the targets' places along x, y and z.
    pub target: f64,
}

/// A camera's sightings of targets at about one height.
#[derive(Clone, Debug, Default)]
pub struct Case {
    /// Number of the camera, as it stands in the file.
    pub camera: String,
    /// The height, as it stands in the file; empty without that column.
    pub height_slab: String,
    /// In the order of the file.
    pub sightings: Vec<Sighting<f64>>,
    /// Number of its rows that could not be read.
    pub unreadable: usize,
}

/// Reads the cases, in the order of their first rows. Errors of single rows go to `complain`.
///
/// # Errors
/// Errors of the file as a whole.
pub fn read(
    input: impl BufRead,
    sigmas: Sigmas,
    mut complain: impl FnMut(Complaint),
) -> Result<Vec<Case>, ReadError> {
    let mut rows = Rows::new(input)?;
    let camera = rows.need("camera")?;
    let slab = rows.find("height_slab")?;
    let target = [
        rows.need("target_x")?,
        rows.need("target_y")?,
        rows.need("target_z")?,
    ];
    let pixel = [rows.need("column")?, rows.need("row")?];
    let mut cases: IndexMap<(String, String), Case> = IndexMap::new();
    let mut any = false;
    while let Some(row) = rows.next()? {
        any = true;
        let name = row.text(camera).into_owned();
        if name.is_empty() {
            complain(row.complaint("`camera` is empty, so the row is left out".to_owned()));
            continue;
        }
        let height_slab = slab.map(|slab| row.text(slab).into_owned());
        let key = (name, height_slab.unwrap_or_default());
        let case = cases.entry(key).or_insert_with_key(|key| Case {
            camera: key.0.clone(),
            height_slab: key.1.clone(),
            ..Case::default()
        });
        let numbers = |columns: &[super::rows::Column]| finite(&row, columns);
        match numbers(&target).and_then(|place| Ok((place, numbers(&pixel)?))) {
            Ok((place, pixel)) => case.sightings.push(Sighting {
                target: Point3::from(Vector3::from_iterator(place)),
                target_sigma: Vector3::repeat(sigmas.target),
                pixel: Vector2::from_iterator(pixel),
                pixel_sigma: sigmas.pixel,
            }),
            Err(what) => {
                case.unreadable += 1;
                let name = shortened(&case.camera);
                complain(row.complaint(format!(
                    "{what}; this case of camera {name} is left out until it is corrected"
                )));
            }
        }
    }
    if !any {
        return Err(ReadError::NoRows);
    }
    Ok(cases.into_values().collect())
}

fn finite(row: &Row<'_>, columns: &[super::rows::Column]) -> Result<Vec<f64>, String> {
    let number = |column: &super::rows::Column| {
        let number = row.number(*column)?;
        match number.is_finite() {
            true => Ok(number),
            false => Err("a number is not finite".to_owned()),
        }
    };
    columns.iter().map(number).collect()
}
