//! True poses: columns `case`, `x`, `y`, `theta_rad` (heading, radians).

use std::io::BufRead;

use nalgebra::Point2;

use super::{Complaint, ReadError, rows::Rows, sightings::Recording};

/// Where a camera really stands and looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Its centre.
    pub position: Point2<f64>,
    /// Direction of its optical axis, radians.
    pub heading: f64,
}

/// Reads the true poses of a recording's cases, in the order of [`Recording::cases`]; cases that
/// the recording does not have are passed over.
///
/// # Errors
/// Errors of the file as a whole. Single rows go to `complain`.
pub fn read(
    input: impl BufRead,
    recording: &Recording,
    complain: impl FnMut(Complaint),
) -> Result<Vec<Option<Truth>>, ReadError> {
    let position = |case: &str| recording.position(case);
    read_for(input, recording.len(), position, complain)
}

/// Reads so many true poses, each to the place that `position` tells of its case, if it does.
///
/// # Errors
/// Errors of the file as a whole. Single rows go to `complain`.
pub fn read_for(
    input: impl BufRead,
    count: usize,
    position: impl Fn(&str) -> Option<usize>,
    mut complain: impl FnMut(Complaint),
) -> Result<Vec<Option<Truth>>, ReadError> {
    let mut rows = Rows::new(input)?;
    let case = rows.need("case")?;
    let columns = [rows.need("x")?, rows.need("y")?, rows.need("theta_rad")?];
    let mut truths = vec![None; count];
    let mut any = false;
    while let Some(row) = rows.next()? {
        any = true;
        let place = position(&row.text(case));
        let Some(truth) = place.and_then(|place| truths.get_mut(place)) else {
            continue;
        };
        let mut read = || {
            let mut values = [0.0; 3];
            for (value, column) in values.iter_mut().zip(columns) {
                *value = row.number(column)?;
                if !value.is_finite() {
                    return Err("a true pose must be finite".to_owned());
                }
            }
            if truth.is_some() {
                return Err("the case has a true pose already: the first one counts".to_owned());
            }
            let [x, y, heading] = values;
            *truth = Some(Truth {
                position: Point2::new(x, y),
                heading,
            });
            Ok(())
        };
        if let Err(what) = read() {
            complain(row.complaint(format!("{what}; this row is left out")));
        }
    }
    if any {
        Ok(truths)
    } else {
        Err(ReadError::NoRows)
    }
}
