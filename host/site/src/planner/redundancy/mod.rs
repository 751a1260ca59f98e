//! Effect of one unnoticed wrong measurement of a walk, and where to stop so that it cannot do much.
//!
//! The covariance of everything that is unknown (carrier, references' headings, cameras, lenses, stops) from
//! bearings and legs, as the [joint estimator](calib_core::joint) has them, but dense and in double
//! precision: then a further stop is an update of a few ranks, and hundreds of them can be tried. The measured
//! values do not matter, only which camera saw which stop, so a walk that is only planned has its sigmas and
//! protection levels too. The tests hold them against those of the estimator.

use calib_core::Pose;
use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use super::{Noise, ground::Ground, symmetric::Symmetric};
use crate::world::Camera;

mod checks;
mod further;
#[cfg(test)]
mod tests;

pub use calib_core::fit::RARE;
pub use checks::{CheckStop, CheckWish, Checks, way_around};
use further::{Further, Gain, Influences};

/// Sigmas of a test that one good measurement in 100,000 fails, plus those by which a fault has to
/// exceed them to be missed once in a thousand. As [`calib_core::joint`] has them.
const DETECTED: f64 = 4.42 + RARE;
/// A redundancy below this counts as this much, as there.
const LEAST_REDUNDANCY: f64 = 1e-4;
/// A measurement of less redundancy than this is not checked at all, as there.
pub const UNCHECKED: f64 = 0.02;
/// Nothing is known better, as a target believes: rounding.
const LEAST_SIGMA: f64 = 1e-3;
/// Sigma of an unknown value: so many ranges, and radians.
const VAGUE: f64 = 100.0;

/// Unknowns that every survey has: scale and compass of the carrier, headings of the references, their distance.
const COMMON: usize = 5;
const SCALE: usize = 0;
const COMPASS: usize = 1;
const HEADINGS: usize = 2;
const BASELINE: usize = 4;
/// A distance of the references that is not estimated is known to this part of the range.
const EXACT: f64 = 1e-6;

/// Accuracy with which a carrier measures its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// Standard deviation of the constant error of distances, as a share of them.
    pub scale: f64,
    /// Standard deviation of the constant error of directions, radians.
    pub compass: f64,
    /// Standard deviation of a leg's own error, along and across, as a share of its length.
    pub leg: [f64; 2],
    /// Standard deviation that is added to that along each axis, whatever its length.
    pub least: f64,
}

impl Steps {
    /// Takes over how well these legs were measured: each to its stop from the one before.
    pub fn learn(&mut self, stops: &[Point2<f64>], legs: &[Option<Matrix2<f64>>]) {
        let measured: Vec<(f64, f64)> = { stops.windows(2).zip(legs.iter().skip(1)) }
            .filter_map(|(ends, leg)| {
                let variance = leg.as_ref()?.trace() / 2.0;
                Some(((ends[1] - ends[0]).norm_squared(), variance))
            })
            .collect();
        let least = measured.iter().map(|(_, variance)| *variance);
        let Some(least) = least.reduce(f64::min) else {
            return;
        };
        let mut shares: Vec<f64> = { measured.iter() }
            .filter(|(length, _)| *length > 0.0)
            .map(|(length, variance)| ((variance - least) / length).sqrt())
            .collect();
        shares.sort_unstable_by(f64::total_cmp);
        self.least = least.sqrt();
        self.leg = [shares.get(shares.len() / 2).copied().unwrap_or_default(); 2];
    }

    /// Covariance of a leg of this length and direction.
    pub fn covariance(&self, way: Vector2<f64>) -> Matrix2<f64> {
        let least = self.least.hypot(LEAST_SIGMA).powi(2);
        let [along, across] = self.leg.map(|share| share.powi(2));
        let turned = Vector2::new(-way.y, way.x);
        Matrix2::identity() * least
            + way * way.transpose() * along
            + turned * turned.transpose() * across
    }
}

/// A bearing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Index of the stop.
    pub stop: usize,
    /// Index of the camera.
    pub camera: usize,
    /// Standard deviation, radians.
    pub sigma: f64,
}

/// Prior knowledge of what a network is told, as its target counts with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// Standard deviations of every lens: of the focal length, relative, and of the tangent that the principal column
    /// adds. Zero where it is exact.
    pub lens: [f64; 2],
    /// Standard deviation of the references' distance, as a share of it; `None` where the walk alone tells it.
    pub baseline: Option<f64>,
    /// Standard deviation of each reference's place, each axis.
    pub place: f64,
}

impl Told {
    /// A site whose lenses and references are exactly as told.
    pub const EXACT: Self = Self {
        lens: [0.0; 2],
        baseline: Some(0.0),
        place: 0.0,
    };
}

/// Measurements of a walk.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Where cameras stand and look; the references first.
    pub cameras: Vec<Pose<f64>>,
    /// About how far they see.
    pub range: f64,
    /// Where the target stops.
    pub stops: Vec<Point2<f64>>,
    /// Covariance of the way to each stop from the one before, where it was measured; that of the
    /// first one does not matter.
    pub legs: Vec<Option<Matrix2<f64>>>,
    /// Sightings: which camera sees the target where.
    pub looks: Vec<Look>,
    /// Standing sigma of the target at its stops, each axis.
    pub standing: f64,
    /// Accuracy of the carrier's steps.
    pub steps: Steps,
    /// Accuracy of lenses and references.
    pub told: Told,
    /// Standard deviation of the first stop's place, where that is known otherwise than from the
    /// references.
    pub anchor: Option<f64>,
}

/// A measurement that could be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Measurement {
    /// A camera's bearing.
    Bearing {
        /// Index of the stop.
        stop: usize,
        /// Index of the camera.
        camera: usize,
    },
    /// The way to a stop.
    Leg {
        /// Index of the stop that it leads to.
        stop: usize,
    },
}

/// Most that one wrong measurement could do to a camera's pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Most that it could move the place.
    pub position: f64,
    /// Most that it could turn the heading, radians.
    pub heading: f64,
    /// Measurement that could do most.
    pub by: Option<Measurement>,
    /// Place and heading, with what all other measurements could do: a norm that comes down with every large one.
    all: Tolerance,
}

/// Highest allowed level: place and heading, radians.
pub type Tolerance = [f64; 2];

impl Level {
    /// The level as a share of the tolerated one.
    pub fn share(&self, tolerance: Tolerance) -> f64 {
        let [position, heading] = tolerance;
        (self.position / position).max(self.heading / heading)
    }

    /// The same of all measurements together.
    fn share_of_all(&self, tolerance: Tolerance) -> f64 {
        let [position, heading] = tolerance;
        let [moved, turned] = self.all;
        (moved / position).max(turned / heading)
    }
}

/// One row of the measurements' Jacobian, over its standard deviation.
#[derive(Clone, Copy, Debug)]
struct Row {
    of: Measurement,
    count: usize,
    at: [usize; WIDEST],
    by: [f64; WIDEST],
}

/// Unknowns of a bearing: place of the target, pose, lens.
const WIDEST: usize = 7;

impl Row {
    fn new(of: Measurement) -> Self {
        Self {
            of,
            count: 0,
            at: [0; WIDEST],
            by: [0.0; WIDEST],
        }
    }

    fn put(&mut self, at: usize, by: f64) {
        self.at[self.count] = at;
        self.by[self.count] = by;
        self.count += 1;
    }

    fn entries(&self) -> impl Iterator<Item = (usize, f64)> + Clone + '_ {
        let count = self.count.min(self.at.len());
        let at = self.at[..count].iter().copied();
        at.zip(self.by[..count].iter().copied())
    }

    /// One entry of the covariance times this row.
    fn times(&self, covariance: &Symmetric, unknown: usize) -> f64 {
        { self.entries() }
            .map(|(at, by)| covariance[(at, unknown)] * by)
            .sum()
    }

    /// The same of a row of it: faster where many measurements meet few unknowns.
    fn along(&self, covariance: &[f64]) -> f64 {
        self.entries().map(|(at, by)| covariance[at] * by).sum()
    }

    /// The variance of what everything together foretells of it.
    fn leverage(&self, covariance: &Symmetric) -> f64 {
        { self.entries() }
            .map(|(at, by)| by * self.times(covariance, at))
            .sum()
    }
}

/// Unknowns that a survey determines, and how well they are checked.
#[derive(Clone, Debug)]
pub struct Redundancy {
    survey: Survey,
    rows: Vec<Row>,
    covariance: Symmetric,
}

impl Survey {
    /// Survey of a walk that is planned: all cameras of a world, the references first, look at it where it suits them.
    pub(crate) fn of_walk(
        ground: &Ground<'_>,
        stops: &[Point2<f64>],
        noise: &Noise,
        steps: Steps,
        told: Told,
    ) -> Self {
        let cameras = ground.world.cameras();
        let looks = stops.iter().enumerate().flat_map(|(stop, &place)| {
            let seen = (0..cameras.len()).filter(move |&camera| ground.suits(camera, place));
            seen.map(move |camera| Look {
                stop,
                camera,
                sigma: noise.sigma(&cameras[camera], place),
            })
        });
        let ways = { stops.windows(2) }.map(|leg| Some(steps.covariance(leg[1] - leg[0])));
        let pose = |camera: &Camera| Pose {
            position: camera.place,
            heading: camera.heading,
            covariance: Matrix3::zeros(),
        };
        Self {
            cameras: cameras.iter().map(pose).collect(),
            range: { cameras.iter().map(|camera| camera.range) }.fold(f64::INFINITY, f64::min),
            stops: stops.to_vec(),
            legs: std::iter::once(None).chain(ways).collect(),
            looks: looks.collect(),
            standing: noise.standing,
            steps,
            told,
            anchor: None,
        }
    }

    fn camera_column(camera: usize) -> usize {
        COMMON + 3 * (camera - 2)
    }

    fn lens_column(&self, camera: usize) -> usize {
        let unknown = self.told.lens.iter().filter(|sigma| **sigma > 0.0).count();
        Self::camera_column(self.cameras.len()) + unknown * camera
    }

    /// Columns of what is unknown of a camera's lens, each with its sigma and which of the two numbers it is.
    fn lens_columns(&self, camera: usize) -> impl Iterator<Item = (usize, usize, f64)> + use<> {
        let first = self.lens_column(camera);
        let given = (0..).zip(self.told.lens).filter(|(_, sigma)| *sigma > 0.0);
        (first..)
            .zip(given)
            .map(|(column, (which, sigma))| (column, which, sigma))
    }

    fn stop_column(&self, stop: usize) -> usize {
        self.lens_column(self.cameras.len()) + 2 * stop
    }

    /// Row of a look at a stop at this place.
    fn bearing_row(&self, look: &Look, place: Point2<f64>) -> Option<Row> {
        let Look {
            stop,
            camera,
            sigma,
        } = *look;
        let pose = self.cameras.get(camera)?;
        let to = place - pose.position;
        let range = to.norm();
        if !(range > 0.0 && sigma > 0.0) {
            return None;
        }
        let weight = sigma.hypot(self.standing / range).recip();
        let across = Vector2::new(-to.y, to.x) / (range * range) * weight;
        let mut row = Row::new(Measurement::Bearing { stop, camera });
        let place = self.stop_column(stop);
        row.put(place, across.x);
        row.put(place + 1, across.y);
        if camera < 2 {
            row.put(HEADINGS + camera, -weight);
            if camera == 1 {
                let along = pose.position - self.cameras[0].position;
                row.put(BASELINE, -across.dot(&along.try_normalize(0.0)?));
            }
        } else {
            let column = Self::camera_column(camera);
            row.put(column, -across.x);
            row.put(column + 1, -across.y);
            row.put(column + 2, -weight);
        }
        let (sin, cos) = (to.y.atan2(to.x) - pose.heading).sin_cos();
        for (column, which, _) in self.lens_columns(camera) {
            row.put(column, -[sin * cos, cos * cos][which] * weight);
        }
        Some(row)
    }

    /// Change of a way with the carrier's scale and compass.
    fn by_carrier(way: Vector2<f64>) -> Matrix2<f64> {
        Matrix2::from_columns(&[way, Vector2::new(-way.y, way.x)])
    }

    fn leg_rows(&self, stop: usize) -> Option<[Row; 2]> {
        let covariance = (*self.legs.get(stop)?)?;
        let way = self.stops[stop] - self.stops[stop.checked_sub(1)?];
        self.rows_of_way(stop, way, &covariance)
    }

    /// Rows of a way to a stop.
    fn rows_of_way(
        &self,
        stop: usize,
        way: Vector2<f64>,
        covariance: &Matrix2<f64>,
    ) -> Option<[Row; 2]> {
        let before = stop.checked_sub(1)?;
        let whitened = covariance.cholesky()?.l().try_inverse()?;
        let carrier = whitened * Self::by_carrier(way);
        let (from, to) = (self.stop_column(before), self.stop_column(stop));
        Some([0, 1].map(|n| {
            let mut row = Row::new(Measurement::Leg { stop });
            for axis in 0..2 {
                row.put(from + axis, -whitened[(n, axis)]);
                row.put(to + axis, whitened[(n, axis)]);
            }
            row.put(SCALE, carrier[(n, 0)]);
            row.put(COMPASS, carrier[(n, 1)]);
            row
        }))
    }

    /// Covariance of a camera's place, and variance of its heading, by the error of the references' places. The frame of
    /// the nodes errs as they do: its places are linear in theirs.
    fn of_frame(&self, camera: usize) -> (Matrix2<f64>, f64) {
        let [first, second] = [self.cameras[0].position, self.cameras[1].position];
        let (place, told) = (self.cameras[camera].position, self.told);
        let square = (second - first).norm_squared();
        let stretched = (place - first) * told.baseline.unwrap_or(0.0);
        let share = told.place * told.place / square;
        let moved = share * ((place - first).norm_squared() + (place - second).norm_squared());
        let places = stretched * stretched.transpose() + Matrix2::from_diagonal_element(moved);
        (places, 2.0 * share)
    }

    /// `None` where nothing is determined: no references, no stop, or numbers that are none.
    pub fn redundancy(self) -> Option<Redundancy> {
        if self.cameras.len() < 2 || self.stops.is_empty() || self.legs.len() != self.stops.len() {
            return None;
        }
        let bearings = { self.looks.iter() }
            .filter_map(|look| self.bearing_row(look, *self.stops.get(look.stop)?));
        let legs = (1..self.stops.len()).filter_map(|stop| self.leg_rows(stop));
        let rows: Vec<Row> = bearings.chain(legs.flatten()).collect();
        let width = self.stop_column(self.stops.len());
        let mut information = Symmetric::zeros(width);
        for row in &rows {
            for (i, a) in row.entries() {
                for (j, b) in row.entries() {
                    information[(i, j)] += a * b;
                }
            }
        }
        // So that whatever nothing determines has a covariance too. It checks nothing.
        let about = (VAGUE * self.range).powi(-2);
        let turned = VAGUE.powi(-2);
        let mut know = |unknown: usize, by: f64| information[(unknown, unknown)] += by;
        know(SCALE, self.steps.scale.max(LEAST_SIGMA).powi(-2));
        know(COMPASS, self.steps.compass.max(LEAST_SIGMA).powi(-2));
        (HEADINGS..BASELINE).for_each(|heading| know(heading, turned));
        know(
            BASELINE,
            self.told
                .baseline
                .map_or(about, |_| (EXACT * self.range).powi(-2)),
        );
        for camera in 0..self.cameras.len() {
            for (column, _, sigma) in self.lens_columns(camera) {
                know(column, sigma.powi(-2));
            }
        }
        for camera in 2..self.cameras.len() {
            let column = Self::camera_column(camera);
            know(column, about);
            know(column + 1, about);
            know(column + 2, turned);
        }
        for stop in 0..self.stops.len() {
            let known = self.anchor.filter(|_| stop == 0);
            let by = known.map_or(about, |sigma| sigma.max(LEAST_SIGMA).powi(-2));
            let column = self.stop_column(stop);
            know(column, by);
            know(column + 1, by);
        }
        let covariance = information.inverse()?;
        Some(Redundancy {
            survey: self,
            rows,
            covariance,
        })
    }
}

impl Redundancy {
    /// Survey that was looked at.
    pub fn survey(&self) -> &Survey {
        &self.survey
    }

    /// Each measurement with the share of its error that would show: of a leg in its worst direction.
    pub fn shares(&self) -> Vec<(Measurement, f64)> {
        let mut shares: Vec<(Measurement, f64)> = Vec::new();
        let mut rows = self.rows.iter();
        while let Some(row) = rows.next() {
            let checked = 1.0 - row.leverage(&self.covariance);
            shares.push((row.of, checked));
            if matches!(row.of, Measurement::Leg { .. })
                && let (Some(other), Some((_, share))) = (rows.next(), shares.last_mut())
            {
                let across = 1.0 - other.leverage(&self.covariance);
                let both: f64 = { row.entries() }
                    .map(|(at, by)| by * other.times(&self.covariance, at))
                    .sum();
                let (mean, half) = ((checked + across) / 2.0, (checked - across) / 2.0);
                *share = mean - half.hypot(both);
            }
        }
        shares
    }

    /// Most that one wrong measurement could do to each of these cameras, none of them a reference.
    pub fn levels(&self, cameras: &[usize]) -> Vec<Level> {
        Influences::of(self, cameras).levels(&Further::default())
    }

    /// Sigma of a camera's place, along both axes together; `None` of a reference.
    pub fn sigma(&self, camera: usize) -> Option<f64> {
        let covariance = (camera >= 2).then(|| self.covariance(camera))?;
        Some((covariance.m11 + covariance.m22).sqrt())
    }

    /// Covariance of `(x, y, heading)` of a camera, the error of the references' places included.
    pub fn covariance(&self, camera: usize) -> Matrix3<f64> {
        let Survey { cameras, told, .. } = &self.survey;
        let baseline = cameras[1].position - cameras[0].position;
        let square = baseline.norm_squared();
        let mut covariance = match camera {
            0 | 1 => {
                let mut own = Matrix3::zeros();
                own.m33 = self.covariance[(HEADINGS + camera, HEADINGS + camera)];
                if camera == 1 && told.baseline.is_none() {
                    let along = baseline * baseline.transpose() / square;
                    let along = along * self.covariance[(BASELINE, BASELINE)];
                    own.fixed_view_mut::<2, 2>(0, 0).copy_from(&along);
                }
                own
            }
            _ => {
                let column = Survey::camera_column(camera);
                Matrix3::from_fn(|i, j| self.covariance[(column + i, column + j)])
            }
        };
        let (places, heading) = self.survey.of_frame(camera);
        let mut own = covariance.fixed_view_mut::<2, 2>(0, 0);
        own += places;
        covariance.m33 += heading;
        covariance
    }

    /// Sigma of a camera's place, as [`sigma`](Self::sigma) tells it, if the distance between a stop and a camera were
    /// measured too, to this sigma.
    pub fn sigma_with_range(
        &self,
        of: usize,
        [stop, camera]: [usize; 2],
        sigma: f64,
    ) -> Option<f64> {
        let (before, survey) = (self.sigma(of)?, &self.survey);
        let to = survey.stops.get(stop)? - survey.cameras.get(camera)?.position;
        let along = to.try_normalize(0.0)? / sigma;
        let mut row = Row::new(Measurement::Bearing { stop, camera });
        let place = survey.stop_column(stop);
        row.put(place, along.x);
        row.put(place + 1, along.y);
        if camera >= 2 {
            let column = Survey::camera_column(camera);
            row.put(column, -along.x);
            row.put(column + 1, -along.y);
        }
        let column = Survey::camera_column(of);
        let gain = [0, 1].map(|n| row.times(&self.covariance, column + n).powi(2));
        let lowered = gain.iter().sum::<f64>() / (1.0 + row.leverage(&self.covariance));
        Some((before.powi(2) - lowered).max(0.0).sqrt())
    }

    /// One more stop, where these cameras see the target.
    fn further(&self, place: Point2<f64>, looks: &[(usize, f64)]) -> Further {
        let (survey, covariance) = (&self.survey, &self.covariance);
        let last = survey.stops.len() - 1;
        let (stop, from, width) = (last + 1, survey.stop_column(last), covariance.width());
        let way = place - survey.stops[last];
        let leg = survey.steps.covariance(way);
        // It stands where the way leads from the last one, as far as that is known.
        let by = -Survey::by_carrier(way);
        let mut place_with = [0, 1].map(|axis| {
            let [own, scale, compass] =
                [from + axis, SCALE, COMPASS].map(|unknown| covariance.row(unknown));
            let carried = scale.iter().zip(compass);
            { own.iter().zip(carried) }
                .map(|(own, (scale, compass))| {
                    own + by[(axis, 0)] * scale + by[(axis, 1)] * compass
                })
                .collect::<Vec<f64>>()
        });
        let own = Matrix2::from_fn(|axis, other| {
            let with = &place_with[other];
            let carried = by[(axis, 0)] * with[SCALE] + by[(axis, 1)] * with[COMPASS];
            with[from + axis] + carried + leg[(axis, other)]
        });
        for (axis, with) in place_with.iter_mut().enumerate() {
            with.extend(own.row(axis).iter());
        }
        let mut further = Further {
            leg,
            place_with,
            ..Further::default()
        };
        let ways = survey.rows_of_way(stop, way, &leg).into_iter().flatten();
        further.rows.extend(ways);
        for &(camera, sigma) in looks {
            let look = Look {
                stop,
                camera,
                sigma,
            };
            let Some(row) = survey.bearing_row(&look, place) else {
                continue;
            };
            let mut with = vec![0.0; width + 2];
            for (at, by) in row.entries() {
                for (sum, number) in with.iter_mut().zip(further.row(covariance, at)) {
                    *sum += number * by;
                }
            }
            for gain in &further.gains {
                let share = gain.share(&row);
                for (sum, number) in with.iter_mut().zip(&gain.with) {
                    *sum -= number * share;
                }
            }
            let weight = (1.0 + row.along(&with)).recip();
            further.gains.push(Gain { with, weight });
            further.rows.push(row);
            further.looks.push(look);
        }
        further
    }

    /// The same walk, gone on with to one more stop, where these cameras see the target.
    #[must_use]
    pub fn with_stop(&self, place: Point2<f64>, looks: &[(usize, f64)]) -> Self {
        let further = self.further(place, looks);
        let mut survey = self.survey.clone();
        survey.stops.push(place);
        survey.legs.push(Some(further.leg));
        survey.looks.extend(further.looks);
        let mut rows = self.rows.clone();
        rows.extend(further.rows);
        let mut covariance = self.covariance.widened(2);
        let width = self.covariance.width();
        for (axis, with) in further.place_with.iter().enumerate() {
            for (unknown, &value) in with.iter().enumerate() {
                covariance[(width + axis, unknown)] = value;
                covariance[(unknown, width + axis)] = value;
            }
        }
        for gain in &further.gains {
            covariance.subtract(&gain.with, gain.weight);
        }
        Self {
            survey,
            rows,
            covariance,
        }
    }
}
