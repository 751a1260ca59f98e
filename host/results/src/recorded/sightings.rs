//! Recorded sightings, grouped by case.
//!
//! | column | meaning |
//! |---|---|
//! | `case` | whose sightings belong together: any text |
//! | `target_x`, `target_y` | where the target stood |
//! | `bearing_rad` | in which direction it was seen, radians, positive to the left |
//! | `bearing_deg` | or: the same in degrees |
//! | `column` | or: in which pixel column, counted from 0 on the left |
//! | `sigma_rad` | optional: standard deviation of the direction, radians, above 0 |
//! | `target_sigma` | optional: standard deviation of the target's place in x and in y, 0 or more |
//!
//! The rows of a case may stand anywhere in the file. A row that repeats the place and the direction of another one of
//! its case does not count.

use std::{
    collections::{HashSet, hash_map::RandomState},
    hash::BuildHasher,
    io::BufRead,
};

use calib_core::{Sighting, camera::Camera};
use indexmap::IndexMap;
use nalgebra::Point2;

use super::{
    Complaint, ReadError,
    directions::Directions,
    rows::{Column, Row, Rows, shortened},
};

/// Assumptions about what the file itself does not say.
#[derive(Clone, Copy, Debug, Default)]
pub struct Assumptions {
    /// The camera that pixel columns are of; with it, `column` is read rather than bearings.
    pub camera: Option<Camera<f64>>,
    /// Bearing sigma, radians, where there is no column `sigma_rad`. Without it that of whole
    /// pixels is taken, or [`USUAL_BEARING_SIGMA`](super::USUAL_BEARING_SIGMA) for bearings.
    pub bearing_sigma: Option<f64>,
    /// Sigma of the targets' places where there is no column `target_sigma`.
    pub target_sigma: f64,
}

/// The sightings of a file, by case, in the order in which the cases first appear.
#[derive(Debug)]
pub struct Recording {
    cases: IndexMap<Box<str>, Case>,
    sigma_assumed: bool,
    passed_over: Option<&'static str>,
}

/// Recorded sightings of one case.
#[derive(Clone, Debug, Default)]
pub struct Case {
    /// Those of its rows that could be read, in the order of the file.
    pub sightings: Vec<Sighting<f64>>,
    /// Number of its rows that could not be read.
    pub unreadable: usize,
    /// Number of its rows that repeat the place and the direction of another one. They tell nothing new: a target
    /// that stands still is seen in the same whole column again and again.
    pub repeated: usize,
    /// The places and directions so far, once there are [`FEW`] or more.
    known: HashSet<[u64; 3]>,
}

/// Sightings of a case that are compared one by one.
const FEW: usize = 32;

impl Recording {
    /// Number of cases.
    pub fn len(&self) -> usize {
        self.cases.len()
    }

    /// Returns true if there is no case.
    pub fn is_empty(&self) -> bool {
        self.cases.is_empty()
    }

    /// Returns true if [`USUAL_BEARING_SIGMA`](super::USUAL_BEARING_SIGMA) had to be assumed.
    pub fn sigma_assumed(&self) -> bool {
        self.sigma_assumed
    }

    /// The measurements that the file has too, but that were not read, such as `column` beside
    /// `bearing_rad`.
    pub fn passed_over(&self) -> Option<&'static str> {
        self.passed_over
    }

    /// The cases with their names, in the order of their first rows.
    pub fn cases(&self) -> impl ExactSizeIterator<Item = (&str, &Case)> {
        self.cases.iter().map(|(id, case)| (&**id, case))
    }

    /// The case at a place in [`Recording::cases`], with its name.
    pub fn case(&self, place: usize) -> Option<(&str, &Case)> {
        let case = self.cases.get_index(place);
        case.map(|(id, case)| (&**id, case))
    }

    /// The place of a case in [`Recording::cases`].
    pub fn position(&self, id: &str) -> Option<usize> {
        self.cases.get_index_of(id)
    }

    /// Usually the rows of a case are neighbours.
    fn case_of(&mut self, id: &str) -> &mut Case {
        let place = match self.cases.last() {
            Some((last, _)) if **last == *id => self.cases.len() - 1,
            _ => match self.cases.get_index_of(id) {
                Some(place) => place,
                None => self.cases.insert_full(id.into(), Case::default()).0,
            },
        };
        &mut self.cases[place]
    }
}

/// Where everything is in a row.
struct Layout<'a> {
    case: Column,
    target: [Column; 2],
    directions: Directions<1>,
    bearing_sigma: Option<Column>,
    target_sigma: Option<Column>,
    assumptions: &'a Assumptions,
}

impl<'a> Layout<'a> {
    fn find<R: BufRead>(rows: &Rows<R>, assumptions: &'a Assumptions) -> Result<Self, ReadError> {
        Ok(Self {
            case: rows.need("case")?,
            target: [rows.need("target_x")?, rows.need("target_y")?],
            directions: Directions::find(
                rows,
                assumptions.camera,
                [["bearing_rad", "bearing_deg", "column"]],
            )?,
            bearing_sigma: rows.find("sigma_rad")?,
            target_sigma: rows.find("target_sigma")?,
            assumptions,
        })
    }

    /// A sighting, and whether all of its numbers are finite.
    fn sighting(&mut self, row: Row<'_>) -> Result<(Sighting<f64>, bool), String> {
        // In the usual order of columns, so that the first wrong one is named.
        let [x, y] = self.target.map(|column| row.number(column));
        let target = Point2::new(x?, y?);
        let [(ray, usual_sigma)] = self.directions.read(row)?;
        let bearing_sigma = match self.bearing_sigma {
            Some(column) => row.number(column)?,
            None => self.assumptions.bearing_sigma.unwrap_or(usual_sigma),
        };
        if bearing_sigma <= 0.0 {
            return Err(format!(
                "`sigma_rad` is {bearing_sigma}: it must be above 0"
            ));
        }
        let target_sigma = match self.target_sigma {
            Some(column) => row.number(column)?,
            None => self.assumptions.target_sigma,
        };
        if target_sigma < 0.0 {
            return Err(format!(
                "`target_sigma` is {target_sigma}: it must not be negative"
            ));
        }
        let numbers = [
            target.x,
            target.y,
            ray.bearing(),
            bearing_sigma,
            target_sigma,
        ];
        let is_finite = numbers.iter().all(|number| number.is_finite());
        let sighting = Sighting::new(target, ray, bearing_sigma);
        Ok((sighting.with_target_sigma(target_sigma), is_finite))
    }
}

/// Reads sightings. Errors of single rows go to `complain`; their cases are marked.
///
/// # Errors
/// Errors of the file as a whole.
pub fn read(
    input: impl BufRead,
    assumptions: &Assumptions,
    complain: impl FnMut(Complaint),
) -> Result<Recording, ReadError> {
    let mut recording = Recording {
        cases: IndexMap::new(),
        sigma_assumed: false,
        passed_over: None,
    };
    let told = rows(input, assumptions, complain, |id, sighting| {
        recording.case_of(id).add(sighting);
        Ok::<_, ReadError>(())
    })?;
    recording.sigma_assumed = told.sigma_assumed;
    recording.passed_over = told.passed_over;
    Ok(recording)
}

/// Overview of a file before its cases are read [one by one](each).
#[derive(Clone, Copy, Debug)]
pub struct Survey {
    /// Number of cases; if they are not [together](Self::are_together), the number of times that one begins.
    pub cases: usize,
    /// Characters of the longest name of a case.
    pub widest: usize,
    /// True if the rows of each case follow one another.
    pub are_together: bool,
    /// See [`Recording::sigma_assumed`].
    pub sigma_assumed: bool,
    /// See [`Recording::passed_over`].
    pub passed_over: Option<&'static str>,
}

/// Reads sightings as [`read`] does, and keeps none of them.
///
/// # Errors
/// Those of [`read`].
pub fn survey(
    input: impl BufRead,
    assumptions: &Assumptions,
    complain: impl FnMut(Complaint),
) -> Result<Survey, ReadError> {
    // Two names with the same hash are taken for one, so that the file is not read case by case: that is
    // right too.
    let hasher = RandomState::new();
    let mut begun = HashSet::new();
    let mut last: Option<String> = None;
    let (mut cases, mut widest, mut are_together) = (0, 0, true);
    let told = rows(input, assumptions, complain, |id, _| {
        if last.as_deref() != Some(id) {
            let name = last.get_or_insert_default();
            name.clear();
            name.push_str(id);
            cases += 1;
            widest = widest.max(id.chars().count());
            are_together = are_together && begun.insert(hasher.hash_one(id));
        }
        Ok::<_, ReadError>(())
    })?;
    Ok(Survey {
        cases,
        widest,
        are_together,
        sigma_assumed: told.sigma_assumed,
        passed_over: told.passed_over,
    })
}

/// Reads sightings and hands on each case once its rows are over, for a file in which
/// [they follow one another](Survey::are_together). Nothing is said about rows that are wrong.
///
/// # Errors
/// Those of [`read`], and those of `take`.
pub fn each<E: From<ReadError>>(
    input: impl BufRead,
    assumptions: &Assumptions,
    mut take: impl FnMut(&str, &Case) -> Result<(), E>,
) -> Result<(), E> {
    let mut name = String::new();
    let mut case: Option<Case> = None;
    rows(
        input,
        assumptions,
        |_| (),
        |id, sighting| {
            match &mut case {
                Some(case) if name == id => case.add(sighting),
                _ => {
                    let mut next = case.take().unwrap_or_default();
                    if !name.is_empty() {
                        take(&name, &next)?;
                    }
                    next.clear();
                    next.add(sighting);
                    case = Some(next);
                    name.clear();
                    name.push_str(id);
                }
            }
            Ok::<_, E>(())
        },
    )?;
    match case {
        Some(case) => take(&name, &case),
        None => Ok(()),
    }
}

/// Content of a file besides its rows.
struct Told {
    sigma_assumed: bool,
    passed_over: Option<&'static str>,
}

/// Reads row by row: the case, and the sighting if it can be read.
fn rows<E: From<ReadError>>(
    input: impl BufRead,
    assumptions: &Assumptions,
    mut complain: impl FnMut(Complaint),
    mut take: impl FnMut(&str, Option<Sighting<f64>>) -> Result<(), E>,
) -> Result<Told, E> {
    let mut rows = Rows::new(input)?;
    let mut layout = Layout::find(&rows, assumptions)?;
    let told = Told {
        sigma_assumed: layout.bearing_sigma.is_none()
            && assumptions.bearing_sigma.is_none()
            && !layout.directions.are_pixels(),
        passed_over: layout.directions.passed_over,
    };
    let mut any = false;
    while let Some(row) = rows.next()? {
        any = true;
        let id = row.text(layout.case);
        if id.is_empty() {
            complain(row.complaint("`case` is empty, so the row is left out".to_owned()));
            continue;
        }
        let (sighting, wrong) = match layout.sighting(row) {
            Ok((sighting, is_finite)) => {
                let wrong = (!is_finite).then(|| {
                    let case = shortened(&id);
                    format!("a number is not finite; case {case} is refused until it is corrected")
                });
                (Some(sighting), wrong)
            }
            Err(what) => {
                let case = shortened(&id);
                let wrong = format!("{what}; case {case} is left out until it is corrected");
                (None, Some(wrong))
            }
        };
        take(&id, sighting)?;
        if let Some(wrong) = wrong {
            complain(row.complaint(wrong));
        }
    }
    if !any {
        return Err(ReadError::NoRows.into());
    }
    layout.directions.check()?;
    Ok(told)
}

impl Case {
    /// One more of its rows.
    fn add(&mut self, sighting: Option<Sighting<f64>>) {
        match sighting {
            Some(sighting) if self.has(&sighting) => self.repeated += 1,
            Some(sighting) => self.sightings.push(sighting),
            None => self.unreadable += 1,
        }
    }

    fn has(&mut self, sighting: &Sighting<f64>) -> bool {
        let of =
            |one: &Sighting<f64>| [one.target.x, one.target.y, one.ray.bearing()].map(f64::to_bits);
        if self.sightings.len() < FEW {
            let mut all = self.sightings.iter();
            return all.any(|other| other.target == sighting.target && other.ray == sighting.ray);
        }
        if self.known.is_empty() {
            self.known.extend(self.sightings.iter().map(of));
        }
        !self.known.insert(of(sighting))
    }

    fn clear(&mut self) {
        self.sightings.clear();
        self.known.clear();
        (self.unreadable, self.repeated) = (0, 0);
    }
}
