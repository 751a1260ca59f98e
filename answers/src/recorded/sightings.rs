//! Recorded sightings, grouped by case.
//!
//! | column | meaning |
//! |---|---|
//! | `case` | whose sightings belong together: any text |
//! | `target_x`, `target_y` | where the target stood |
//! | `bearing_rad` | in which direction it was seen, radians, positive to the left |
//! | `column` | or: in which pixel column, counted from 0 on the left |
//! | `sigma_rad` | optional: standard deviation of the direction, radians, above 0 |
//! | `target_sigma` | optional: standard deviation of the target's place in x and in y, 0 or more |
//!
//! The rows of a case may stand anywhere in the file.

use std::io::BufRead;

use calib_core::{Ray, Sighting, camera::Camera};
use indexmap::IndexMap;
use nalgebra::Point2;

use super::{
    Complaint, ReadError,
    rows::{Column, Row, Rows, shortened},
};

/// Bearing sigma where a file of bearings says nothing: half a degree, radians. About what the
/// cameras of small robots reach.
pub const USUAL_BEARING_SIGMA: f64 = 0.0087;

/// What the file itself does not say.
#[derive(Clone, Copy, Debug, Default)]
pub struct Assumptions {
    /// The camera that pixel columns are of; with it, `column` is read rather than `bearing_rad`.
    pub camera: Option<Camera<f64>>,
    /// Bearing sigma, radians, where there is no column `sigma_rad`. Without it that of whole
    /// pixels is taken, or [`USUAL_BEARING_SIGMA`] for bearings.
    pub bearing_sigma: Option<f64>,
    /// Sigma of the targets' places where there is no column `target_sigma`.
    pub target_sigma: f64,
}

/// The sightings of a file, by case, in the order in which the cases first appear.
#[derive(Debug)]
pub struct Recording {
    cases: IndexMap<Box<str>, Chain>,
    links: Vec<Link>,
    camera: Option<Camera<f64>>,
    sigma_assumed: bool,
    passed_over: Option<&'static str>,
}

/// The sightings of one case: a chain through [`Recording::links`], so that millions of cases cost
/// no allocation beyond their names.
#[derive(Clone, Copy, Debug)]
struct Chain {
    first: u32,
    last: u32,
    rows: u32,
    readable: bool,
}

#[derive(Clone, Copy, Debug)]
struct Link {
    x: f64,
    y: f64,
    /// Bearing or pixel column.
    measured: f64,
    bearing_sigma: f64,
    target_sigma: f64,
    next: u32,
}

const NONE: u32 = u32::MAX;

impl Link {
    fn is_finite(&self) -> bool {
        let numbers = [
            self.x,
            self.y,
            self.measured,
            self.bearing_sigma,
            self.target_sigma,
        ];
        numbers.iter().all(|number| number.is_finite())
    }
}

/// One case of a [`Recording`].
#[derive(Clone, Copy, Debug)]
pub struct Case<'a> {
    recording: &'a Recording,
    id: &'a str,
    chain: Chain,
}

impl Recording {
    /// How many cases there are.
    pub fn len(&self) -> usize {
        self.cases.len()
    }

    /// Whether there is no case.
    pub fn is_empty(&self) -> bool {
        self.cases.is_empty()
    }

    /// Whether [`USUAL_BEARING_SIGMA`] had to be assumed.
    pub fn sigma_assumed(&self) -> bool {
        self.sigma_assumed
    }

    /// The measurements that the file has too, but that were not read: `column` beside
    /// `bearing_rad`, or the other way round.
    pub fn passed_over(&self) -> Option<&'static str> {
        self.passed_over
    }

    /// The cases in the order of their first rows.
    pub fn cases(&self) -> impl ExactSizeIterator<Item = Case<'_>> {
        self.cases.iter().map(|(id, &chain)| Case {
            recording: self,
            id,
            chain,
        })
    }

    /// The place of a case in [`Recording::cases`].
    pub fn position(&self, id: &str) -> Option<usize> {
        self.cases.get_index_of(id)
    }
}

impl<'a> Case<'a> {
    /// Its name.
    pub fn id(&self) -> &'a str {
        self.id
    }

    /// How many rows it has, unreadable ones included.
    pub fn rows(&self) -> usize {
        self.chain.rows as usize
    }

    /// Whether all of its rows could be read.
    pub fn is_readable(&self) -> bool {
        self.chain.readable
    }

    /// The sightings of its readable rows, in the order of the file.
    pub fn sightings(&self) -> impl Iterator<Item = Sighting<f64>> + use<'a> {
        let recording = self.recording;
        let mut next = self.chain.first;
        std::iter::from_fn(move || {
            let link = recording.links.get(next as usize)?;
            next = link.next;
            let ray = match &recording.camera {
                Some(camera) => camera.ray(link.measured),
                None => Ray::from_bearing(link.measured),
            };
            let target = Point2::new(link.x, link.y);
            let sighting = Sighting::new(target, ray, link.bearing_sigma);
            Some(sighting.with_target_sigma(link.target_sigma))
        })
    }
}

/// Where everything is in a row.
struct Layout<'a> {
    case: Column,
    target_x: Column,
    target_y: Column,
    measured: Column,
    passed_over: Option<&'static str>,
    bearing_sigma: Option<Column>,
    target_sigma: Option<Column>,
    assumptions: &'a Assumptions,
}

impl<'a> Layout<'a> {
    fn find<R: BufRead>(rows: &Rows<R>, assumptions: &'a Assumptions) -> Result<Self, ReadError> {
        let case = rows.need("case")?;
        let target_x = rows.need("target_x")?;
        let target_y = rows.need("target_y")?;
        let measured = if assumptions.camera.is_some() {
            rows.need("column")?
        } else if let Some(bearing) = rows.find("bearing_rad")? {
            bearing
        } else if rows.find("column")?.is_some() {
            return Err(ReadError::NeedsCamera("column".to_owned()));
        } else {
            return Err(rows.no_column("bearing_rad` or `column"));
        };
        let other = match assumptions.camera {
            Some(_) => "bearing_rad",
            None => "column",
        };
        let passed_over = rows.find(other)?.map(|_| other);
        Ok(Self {
            case,
            target_x,
            target_y,
            measured,
            passed_over,
            bearing_sigma: rows.find("sigma_rad")?,
            target_sigma: rows.find("target_sigma")?,
            assumptions,
        })
    }

    fn link(&self, row: Row<'_>) -> Result<Link, String> {
        // In the usual order of columns, so that the first wrong one is named.
        let (x, y) = (row.number(self.target_x)?, row.number(self.target_y)?);
        let measured = row.number(self.measured)?;
        let camera = self.assumptions.camera.as_ref();
        if let Some(camera) = camera {
            check_column(camera, measured)?;
        }
        let bearing_sigma = match (self.bearing_sigma, self.assumptions.bearing_sigma, camera) {
            (Some(column), ..) => row.number(column)?,
            (None, Some(sigma), _) => sigma,
            (None, None, Some(camera)) => camera.whole_pixel_sigma(measured),
            (None, None, None) => USUAL_BEARING_SIGMA,
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
        Ok(Link {
            x,
            y,
            measured,
            bearing_sigma,
            target_sigma,
            next: NONE,
        })
    }
}

/// Refuses columns that the camera does not have; what is no number is refused with its case.
pub(super) fn check_column(camera: &Camera<f64>, column: f64) -> Result<(), String> {
    if column.is_finite() && !camera.has_column(column) {
        return Err(format!(
            "the camera has no column {column}: columns go from 0 to {}, see --columns",
            camera.last_column()
        ));
    }
    Ok(())
}

/// Reads sightings. What is wrong with single rows goes to `complain`; their cases are marked.
///
/// # Errors
/// What is wrong with the file as a whole.
pub fn read(
    input: impl BufRead,
    assumptions: &Assumptions,
    mut complain: impl FnMut(Complaint),
) -> Result<Recording, ReadError> {
    let mut rows = Rows::new(input)?;
    let layout = Layout::find(&rows, assumptions)?;
    let mut recording = Recording {
        cases: IndexMap::new(),
        links: Vec::new(),
        camera: assumptions.camera,
        sigma_assumed: layout.bearing_sigma.is_none()
            && assumptions.bearing_sigma.is_none()
            && assumptions.camera.is_none(),
        passed_over: layout.passed_over,
    };
    let mut any = false;
    while let Some(row) = rows.next()? {
        any = true;
        let id = row.text(layout.case);
        if id.is_empty() {
            complain(row.complaint("`case` is empty, so the row is left out".to_owned()));
            continue;
        }
        let link = layout.link(row).map_err(|what| {
            complain(row.complaint(format!(
                "{what}; case {} is left out until it is corrected",
                shortened(&id)
            )));
        });
        if link.as_ref().is_ok_and(|link| !link.is_finite()) {
            complain(row.complaint(format!(
                "a number is not finite; case {} is refused until it is corrected",
                shortened(&id)
            )));
        }
        recording.add(&id, link.ok())?;
    }
    if any {
        Ok(recording)
    } else {
        Err(ReadError::NoRows)
    }
}

impl Recording {
    /// Adds a row to its case; `None` for one that could not be read.
    fn add(&mut self, id: &str, link: Option<Link>) -> Result<(), ReadError> {
        // Usually the rows of a case are neighbours.
        let neighbour = self.cases.last().is_some_and(|(last, _)| **last == *id);
        let case = if neighbour {
            self.cases.len().checked_sub(1)
        } else {
            self.cases.get_index_of(id)
        };
        let case = case.unwrap_or_else(|| {
            let chain = Chain {
                first: NONE,
                last: NONE,
                rows: 0,
                readable: true,
            };
            self.cases.insert_full(id.into(), chain).0
        });
        let Some((_, chain)) = self.cases.get_index_mut(case) else {
            return Ok(());
        };
        chain.rows = chain.rows.checked_add(1).ok_or(ReadError::TooLong)?;
        let Some(link) = link else {
            chain.readable = false;
            return Ok(());
        };
        let here = u32::try_from(self.links.len()).map_err(|_| ReadError::TooLong)?;
        match self.links.get_mut(chain.last as usize) {
            Some(last) => last.next = here,
            None => chain.first = here,
        }
        chain.last = here;
        self.links.push(link);
        Ok(())
    }
}
