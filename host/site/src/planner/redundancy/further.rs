//! Levels with one more stop, of many places at which it could be: its measurements change the covariance by a few
//! ranks, and no covariance is made for each place.

use nalgebra::{Matrix2, Matrix3};

use super::{
    super::symmetric::Symmetric, DETECTED, LEAST_REDUNDANCY, Level, Look, RARE, Redundancy, Row,
    Survey,
};

/// Half the exponent of the norm of all measurements' effects.
const NORM: i32 = 4;

/// One more stop, and what it would change. By default none.
#[derive(Default)]
pub(super) struct Further {
    /// Covariance of the way to it.
    pub(super) leg: Matrix2<f64>,
    /// Covariance of its place, as the way foretells it, with each unknown, those of the place at the end.
    pub(super) place_with: [Vec<f64>; 2],
    /// Looks at it.
    pub(super) looks: Vec<Look>,
    /// Its measurements.
    pub(super) rows: Vec<Row>,
    /// Of each of its looks.
    pub(super) gains: Vec<Gain>,
}

/// Fall of the covariance by a measurement: a multiple of the square of a vector.
pub(super) struct Gain {
    /// Covariance of what it measures with each unknown, after the measurements before it.
    pub(super) with: Vec<f64>,
    /// One over the variance of what is measured.
    pub(super) weight: f64,
}

impl Gain {
    /// Multiple of the vector that goes from what is foretold of another measurement.
    pub(super) fn share(&self, row: &Row) -> f64 {
        row.along(&self.with) * self.weight
    }
}

impl Further {
    /// Covariance of an unknown with all, before the looks.
    pub(super) fn row<'a>(
        &'a self,
        covariance: &'a Symmetric,
        unknown: usize,
    ) -> impl Iterator<Item = &'a f64> {
        let (known, place) = match unknown.checked_sub(covariance.width()) {
            Some(axis) => (&self.place_with[axis][..], None),
            None => (covariance.row(unknown), Some(unknown)),
        };
        let with_place = { self.place_with.iter() }.filter_map(move |with| with.get(place?));
        known.iter().chain(with_place)
    }

    /// One entry of it.
    fn entry(&self, covariance: &Symmetric, row: usize, column: usize) -> f64 {
        let (low, high) = (row.min(column), row.max(column));
        match high.checked_sub(covariance.width()) {
            Some(axis) => self.place_with[axis][low],
            None => covariance[(low, high)],
        }
    }
}

/// Influence of the measurements of a walk on the poses of some cameras, none of them a reference.
pub(super) struct Influences<'a> {
    walk: &'a Redundancy,
    cameras: &'a [usize],
    /// Leverage of each row.
    leverages: Vec<f64>,
    /// Covariance of each row with the pose of each camera: all of a camera, then those of the next.
    effects: Vec<[f64; 3]>,
}

impl<'a> Influences<'a> {
    pub(super) fn of(walk: &'a Redundancy, cameras: &'a [usize]) -> Self {
        let leverages = walk.rows.iter().map(|row| row.leverage(&walk.covariance));
        let effects = cameras.iter().flat_map(|camera| {
            let column = Survey::camera_column(*camera);
            let own = [0, 1, 2].map(|n| walk.covariance.row(column + n));
            walk.rows
                .iter()
                .map(move |row| own.map(|own| row.along(own)))
        });
        Self {
            walk,
            cameras,
            leverages: leverages.collect(),
            effects: effects.collect(),
        }
    }

    /// Most that one wrong measurement could do to each camera, with one more stop.
    pub(super) fn levels(&self, further: &Further) -> Vec<Level> {
        let covariance = &self.walk.covariance;
        let rows: Vec<&Row> = self.walk.rows.iter().chain(&further.rows).collect();
        let leverage = |row: &Row| {
            let of = |at| {
                { row.entries() }.map(move |(other, by)| by * further.entry(covariance, at, other))
            };
            { row.entries() }
                .map(|(at, by)| by * of(at).sum::<f64>())
                .sum()
        };
        let leverages = { self.leverages.iter().copied() }.chain(further.rows.iter().map(leverage));
        let shares: Vec<f64> = { rows.iter() }
            .flat_map(|row| further.gains.iter().map(|gain| gain.share(row)))
            .collect();
        let shares = |row: usize| {
            let count = further.gains.len();
            &shares[row * count..][..count]
        };
        let sizes: Vec<f64> = { leverages.enumerate() }
            .map(|(row, leverage)| {
                let taken = { shares(row).iter().zip(&further.gains) }
                    .map(|(share, gain)| share * share / gain.weight);
                let checked = 1.0 - taken.fold(leverage, |left, taken| left - taken);
                DETECTED / checked.max(LEAST_REDUNDANCY).sqrt()
            })
            .collect();
        let level = |(place, &camera): (usize, &usize)| {
            let column = Survey::camera_column(camera);
            let effects = self.effects[place * self.leverages.len()..].iter().copied();
            let new = further.rows.iter().map(|row| {
                [0, 1, 2].map(|n| {
                    { row.entries() }
                        .map(|(at, by)| further.entry(covariance, column + n, at) * by)
                        .sum()
                })
            });
            let effects = effects.take(self.leverages.len()).chain(new);
            let (mut position, mut heading) = ((0.0, None), (0.0, None));
            let mut all = [0.0; 2];
            for (row, (effect, size)) in effects.zip(&sizes).enumerate() {
                let mut effect: [f64; 3] = effect;
                for (share, gain) in shares(row).iter().zip(&further.gains) {
                    for (n, effect) in effect.iter_mut().enumerate() {
                        *effect -= gain.with[column + n] * share;
                    }
                }
                let [x, y, turn] = effect.map(|effect| effect * size);
                // The square of the place is compared: there are many rows, and roots take long.
                let squares = [x * x + y * y, turn * turn];
                for ((worst, sum), now) in
                    { [&mut position, &mut heading].into_iter().zip(&mut all) }.zip(squares)
                {
                    *sum += now.powi(NORM);
                    if now > worst.0 {
                        *worst = (now, Some(rows[row].of));
                    }
                }
            }
            position.0 = f64::sqrt(position.0);
            heading.0 = f64::sqrt(heading.0);
            let all = all.map(|sum: f64| sum.powf(0.5 / f64::from(NORM)));
            let pose = Matrix3::from_fn(|i, j| {
                let taken = { further.gains.iter() }
                    .map(|gain| gain.with[column + i] * gain.with[column + j] * gain.weight);
                taken.fold(covariance[(column + i, column + j)], |left, taken| {
                    left - taken
                })
            });
            // As a target tells it: the frame's error comes on top of what its own measurements leave open.
            let (places, turned) = self.walk.survey.of_frame(camera);
            let noise = [pose.m11 + pose.m22, pose.m33, places.trace(), turned];
            let [own, heading_own, frame, frame_turned] =
                noise.map(|variance| RARE * variance.max(0.0).sqrt());
            // The measurement that turns it most matters if it turns it by more than it moves it, seen from afar.
            let by = if heading.0 * self.walk.survey.range > position.0 {
                heading.1
            } else {
                position.1
            };
            let noise = [own + frame, heading_own + frame_turned];
            Level {
                position: position.0 + noise[0],
                heading: heading.0 + noise[1],
                by,
                all: [all[0] + noise[0], all[1] + noise[1]],
            }
        };
        self.cameras.iter().enumerate().map(level).collect()
    }
}
