//! Where a target should stop, so that every camera learns its pose well.
//!
//! # How stops are chosen
//! 1. **Candidates** for a camera are random places in its view at which the whole ball is seen,
//!    four columns or more from the border, not nearer than [`NEAREST`] radii (a blob that fills the
//!    picture), within the camera's range and the world, and clear of obstacles.
//! 2. Each tells something about the camera's place and heading: the Fisher information of one
//!    bearing, from the noise of a column, seen at that bearing, and from how far the target may
//!    stand off the place that it tells.
//! 3. An **exchange** algorithm picks the `k` candidates whose summed information bounds the
//!    camera's covariance best (Cramer and Rao): the sum of the variances of place and heading, in
//!    units of 1 % of the range and of 0.01 rad.
//! 4. Cameras come one after the other. Stops that were chosen for others and that a camera sees
//!    count for it: it needs so many fewer of its own, as long as the prediction stays within
//!    [`SHARING`] of what `k` stops of its own would give. The references' stops do not count: the
//!    target does not know where it stands there before the last of them.
//! 5. The references' stops are chosen first, in the same way, from places that both see whole, for
//!    the two headings and for the place of the walk, and, where they are unknown, for the frame's
//!    heading and the baseline. A choice that [`calib_core::reference`] finds ambiguous is dropped.
//! 6. The **order**: the references' stops, then always the nearest one next, improved by 2-opt. Then
//!    detours are made, but only for cameras whose *first* `k` sightings would be poor ones, such as
//!    stops for others in a corner of their view: a camera's first report should be within [`FIRST`] of
//!    what it can get from `k` stops.
//!
//! 7. With [`Placement::Checked`], further stops follow: new ones, or places of before, so that ways and
//!    bearings check each other ([`Checks`]). Each is the one that lowers the cameras' protection levels
//!    most for the way that it takes. They go on until all levels are tolerated, but are at most as many
//!    as there are already: the same path back.
//!
//! Where to stop once more, [`Advice`], comes of the same candidates and the same information.
//!
//! [`Placement::Anywhere`] leaves out steps 3 and 4 and the detours: the thesis's target stops "at three
//! distinct locations in the field of view" of each camera (section 4.3), and the thesis says no more of them.
//!
//! All random numbers come from the number of the path: other paths are other local optima, and the same path
//! is the same on every run, whatever the scenario's seed. Only if cameras are scattered does the seed matter
//! too, so that no two seeds have stops in the same directions of a camera, whose columns would round them
//! alike.

use calib_core::{
    Ray,
    reference::{self, Known, ReferenceSettings, Stop},
};
use nalgebra::{Matrix2, Matrix3, Matrix6, Point2, Vector2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::world::World;
use node_firmware::limits::REFERENCE_STOPS;

mod exchange;
mod first_sightings;
mod ground;
mod information;
mod next;
mod redundancy;
mod route;
mod symmetric;

use exchange::{Choice, Design};
use first_sightings::{FirstSightings, Prices};
pub(crate) use ground::Ground;
pub use ground::NEAREST;
pub(crate) use information::bound;
pub use information::{Noise, column_angle, of_sighting};
pub use next::{Advice, PairWish, Wish};
pub use redundancy::{
    CheckStop, CheckWish, Checks, Level, Look, Measurement, RARE, Redundancy, Steps, Survey, Told,
    Tolerance, UNCHECKED, way_around,
};
use route::Route;

/// Sharing stops may cost this factor of the score.
pub const SHARING: f64 = 1.25;
/// The first sightings may cost this factor of the score.
pub const FIRST: f64 = 2.0;

/// Random starts of an exchange.
const STARTS: usize = 6;

/// Method by which stops are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Placement {
    /// Where they tell most.
    #[default]
    Planned,
    /// There, and then at further ones: until one unnoticed wrong measurement could do no harm to any pose.
    Checked,
    /// At any places in view; only the references' stops are planned.
    Anywhere,
}

/// Task of the planner.
#[derive(Clone, Debug)]
pub struct Task<'a> {
    /// Its cameras and obstacles; its targets do not matter.
    pub world: &'a World,
    /// Lowest and highest corner of where the target may go.
    pub bounds: [Point2<f64>; 2],
    /// The references, and what is known of them; indices of the world's cameras.
    pub references: [usize; 2],
    /// Prior knowledge of the references.
    pub known: Known<f64>,
    /// The other cameras, as indices of the world's.
    pub cameras: &'a [usize],
    /// Radius of the target.
    pub radius: f64,
    /// Stops in view of each camera, 3 or more, and of both references up to [`REFERENCE_STOPS`].
    pub stops: usize,
    /// Method by which they are chosen.
    pub placement: Placement,
    /// Errors to plan for.
    pub noise: Noise,
    /// Of the carrier.
    pub steps: Steps,
    /// Of lenses and references.
    pub told: Told,
    /// Protection levels that may be left.
    pub tolerance: Tolerance,
    /// Number of the path.
    pub path: u64,
    /// Another way on the same path: 0, or a scenario's seed where its cameras are scattered.
    pub seed: u64,
    /// Number of the target: each takes a way of its own.
    pub target: u64,
}

/// A place to stop at.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedStop {
    /// Where.
    pub place: Point2<f64>,
    /// Both references see it: one of the first stops.
    pub for_references: bool,
    /// The cameras that see the whole ball there, four columns from the border: indices of the
    /// world's cameras.
    pub seen_by: Vec<usize>,
}

/// Stops in their order, and what to expect.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// In the order of the walk.
    pub stops: Vec<PlannedStop>,
    /// Bound on the covariance of `(heading 0, heading 1, x, y, frame heading, baseline)` of the
    /// reference solve.
    pub references: Matrix6<f64>,
    /// Index of each camera, and the bound on the covariance of its `(x, y, heading)` from all stops
    /// that it sees; `None` if they leave something undetermined. The error of the reference solve,
    /// which moves all alike, is not in it.
    pub cameras: Vec<(usize, Option<Matrix3<f64>>)>,
}

/// Why there is no plan.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PlanError {
    /// The references have too few places in common.
    #[error(
        "the reference cameras see too few places together where the target can stand for {stops} \
         stops: turn them towards each other, bring them nearer or choose others; look at their \
         `range`, the network's `area`, `world.low` and `world.high`, and obstacles; or want fewer \
         `stops`, or a target of smaller `radius`"
    )]
    References {
        /// Number of stops that were wanted.
        stops: usize,
    },
    /// A camera has too few places.
    #[error(
        "camera number {} of the world has no {stops} places in view where the target can stand: \
         look at its heading and pitch, at its range, at the borders of the world and at obstacles",
        camera + 1
    )]
    Camera {
        /// Index of the world's camera.
        camera: usize,
        /// Number of stops that were wanted.
        stops: usize,
    },
    /// Obstacles are in the way.
    #[error(
        "no order of the stops was found that avoids obstacle {}: try another `--path`, move it, or give the \
         target's stops yourself",
        obstacle + 1
    )]
    Blocked {
        /// Index of the obstacle.
        obstacle: usize,
    },
}

/// Chooses stops and their order.
///
/// # Errors
/// [`PlanError`].
///
/// # Panics
/// A camera that the world does not have.
pub fn plan(task: &Task<'_>) -> Result<Plan, PlanError> {
    // Paths are less than 2^32.
    let mut random = ChaCha8Rng::seed_from_u64(task.path ^ task.seed.rotate_left(32));
    random.set_stream(task.target);
    let (reference_stops, references) = task.for_references(&mut random)?;
    let first = reference_stops.len();
    let mut others = Vec::new();
    let mut enough = Vec::new();
    for &camera in task.cameras {
        let (own, score) = task.for_camera(camera, &others, &mut random)?;
        others.extend(own);
        enough.push(score * FIRST);
    }
    let mut places = reference_stops;
    places.extend(others);

    let mut stops = task.in_order(&places, first, &enough)?;
    if task.placement == Placement::Checked {
        task.check(&mut stops);
    }
    let cameras = task.cameras.iter().map(|&camera| {
        (
            camera,
            information::bound(&task.information(camera, &stops)),
        )
    });
    Ok(Plan {
        cameras: cameras.collect(),
        references,
        stops: (0..)
            .zip(&stops)
            .map(|(index, &place)| PlannedStop {
                place,
                for_references: index < first,
                seen_by: task.seen_by(place),
            })
            .collect(),
    })
}

/// Variances of a place and of headings, in units of 1 % of the range and of 0.01 rad.
fn score_of(place: f64, headings: f64, range: f64) -> f64 {
    place / (0.01 * range).powi(2) + headings / 0.01_f64.powi(2)
}

fn score_of_pose(information: &Matrix3<f64>, range: f64) -> f64 {
    information::variances(information).map_or(f64::INFINITY, |v| score_of(v.x + v.y, v.z, range))
}

/// Score of the references' headings, and of places that they find.
fn score_of_pair(information: &Matrix6<f64>, range: f64) -> f64 {
    information::variances(information).map_or(f64::INFINITY, |v| {
        // The frame's heading moves what is far away.
        let place = v[2] + v[3] + v[4] * (2.0 * range).powi(2);
        score_of(place, v[0] + v[1], range)
    })
}

impl Task<'_> {
    fn ground(&self) -> Ground<'_> {
        Ground {
            world: self.world,
            bounds: self.bounds,
            radius: self.radius,
            may_stand: None,
        }
    }

    fn separation(&self) -> f64 {
        2.0 * self.radius
    }

    /// See [`Ground::suits`].
    fn suits(&self, camera: usize, place: Point2<f64>) -> bool {
        self.ground().suits(camera, place)
    }

    fn for_references(
        &self,
        random: &mut ChaCha8Rng,
    ) -> Result<(Vec<Point2<f64>>, Matrix6<f64>), PlanError> {
        let cameras = self.references.map(|index| &self.world.cameras()[index]);
        let candidates = self.ground().candidates(&self.references, random, |place| {
            information::of_reference_stop(cameras, place, &self.noise)
        });
        let range = cameras[0].range.min(cameras[1].range);
        let choice = Choice {
            candidates: &candidates,
            before: information::known_beforehand(&self.known),
            taken: &[],
            separation: self.separation(),
            score: |information: &Matrix6<f64>| score_of_pair(information, range),
        };
        let stops = self.stops.min(REFERENCE_STOPS);
        let refused = PlanError::References { stops };
        let mut designs: Vec<Design<6>> = (0..STARTS)
            .filter_map(|_| choice.best(stops, 1, random))
            .collect();
        designs.sort_by(|a, b| a.score.total_cmp(&b.score));
        designs
            .into_iter()
            .find_map(|design| {
                let places: Vec<_> = design.chosen.iter().map(|&i| candidates[i].0).collect();
                let bound = information::bound(&design.information)?;
                self.is_unambiguous(&places).then_some((places, bound))
            })
            .ok_or(refused)
    }

    /// Returns true if the reference solve has one answer, even were all noise twice as much.
    fn is_unambiguous(&self, places: &[Point2<f64>]) -> bool {
        let cameras = self.references.map(|index| &self.world.cameras()[index]);
        let baseline = cameras[1].place - cameras[0].place;
        let frame = nalgebra::Rotation2::rotation_between(&baseline, &Vector2::x());
        let mut before = places[0];
        let stops: Vec<_> = places
            .iter()
            .map(|&place| {
                let displacement = frame * (place - before);
                before = place;
                let bearings = cameras.map(|camera| {
                    let to = place - camera.place;
                    to.y.atan2(to.x) - camera.heading
                });
                let sigmas = cameras
                    .map(|camera| 2.0 * information::bearing_sigma(camera, place, &self.noise));
                Stop {
                    rays: bearings.map(Ray::from_bearing),
                    bearing_sigmas: sigmas,
                    displacement,
                    displacement_covariance: Matrix2::zeros(),
                }
            })
            .collect();
        reference::solve(&stops, &self.known, &ReferenceSettings::default())
            .is_ok_and(|outcome| outcome.alternative.is_none())
    }

    /// Information about a camera, from all of some stops that suit it.
    fn information(&self, camera: usize, stops: &[Point2<f64>]) -> Matrix3<f64> {
        stops
            .iter()
            .filter(|&&place| self.suits(camera, place))
            .map(|&place| {
                information::of_sighting(&self.world.cameras()[camera], place, &self.noise)
            })
            .sum()
    }

    /// The places in the order of the walk. The first ones are the references' stops; `enough` is the
    /// score that each camera should have from its first sightings.
    fn in_order(
        &self,
        places: &[Point2<f64>],
        first: usize,
        enough: &[f64],
    ) -> Result<Vec<Point2<f64>>, PlanError> {
        let blocked = |a, b| self.world.obstacle_on_way(a, b, self.radius);
        let is_blocked = |a, b| blocked(a, b).is_some();
        let gate = Route::new(places[0], &places[1..first], is_blocked);
        let mut order = vec![0];
        order.extend(gate.shortest().into_iter().map(|index| index + 1));
        let walk = Route::new(places[order[first - 1]], &places[first..], is_blocked);
        let firsts = self.first_sightings(places, first, enough);
        let mut prices = Prices::new(&firsts, &order, self.stops, score_of_pose);
        let mut rest = walk.shortest();
        if self.placement != Placement::Anywhere {
            walk.improve(&mut rest, &mut prices);
        }
        order.extend(rest.into_iter().map(|index| index + first));
        let stops: Vec<_> = order.into_iter().map(|index| places[index]).collect();
        for leg in stops.windows(2) {
            if let Some(obstacle) = blocked(leg[0], leg[1]) {
                return Err(PlanError::Blocked { obstacle });
            }
        }
        Ok(stops)
    }

    /// Goes on with the walk until it checks every pose, as far as that can be.
    fn check(&self, stops: &mut Vec<Point2<f64>>) {
        let indices: Vec<usize> = { self.references.iter() }
            .chain(self.cameras)
            .copied()
            .collect();
        let cameras = indices.iter().map(|&index| self.world.cameras()[index]);
        let world = World::new(
            cameras.collect(),
            self.world.obstacles().to_vec(),
            Vec::new(),
        );
        let ground = Ground {
            world: &world,
            ..self.ground()
        };
        let survey = Survey::of_walk(&ground, stops, &self.noise, self.steps, self.told);
        let tolerance = self.tolerance;
        let wishes = (2..indices.len()).map(|camera| CheckWish { camera, tolerance });
        let walked = stops.clone();
        let ranges = world.cameras().iter().map(|camera| camera.range);
        let range = ranges.fold(0.0, f64::max);
        let may_stand = |place: Point2<f64>| {
            let is_near = |been: &Point2<f64>| (place - been).norm() < range;
            self.ground().is_free(place) && walked.iter().any(is_near)
        };
        let checks = Checks {
            world: &world,
            radius: self.radius,
            may_stand: &may_stand,
            columns: self.noise.columns,
            wishes: wishes.collect(),
        };
        let Some(known) = survey.redundancy().filter(|walk| !checks.are_checked(walk)) else {
            return;
        };
        let (further, _) = checks.stops(known, stops.len());
        for stop in further {
            let Some(&here) = stops.last() else { break };
            let way = way_around(self.world, self.radius, stops, [here, stop.place]);
            stops.extend(way);
        }
    }

    /// Sightings that each camera would count at these places, the first ones being the references'.
    fn first_sightings(
        &self,
        places: &[Point2<f64>],
        first: usize,
        enough: &[f64],
    ) -> Vec<FirstSightings> {
        let cameras = self.cameras.iter().zip(enough);
        cameras
            .map(|(&index, &enough)| {
                let camera = &self.world.cameras()[index];
                let tells = |(number, &place): (usize, &Point2<f64>)| {
                    if number < first {
                        return None;
                    }
                    let sight = self.world.sight(index, place, self.radius)?;
                    // A blob that does not touch the border.
                    let clear = sight.bearing.abs() + sight.half_width < camera.lens.bearing(0.0);
                    (clear && sight.is_whole())
                        .then(|| information::of_sighting(camera, place, &self.noise))
                };
                FirstSightings {
                    tells: places.iter().enumerate().map(tells).collect(),
                    enough,
                    range: camera.range,
                }
            })
            .collect()
    }

    /// Stops for a camera besides those there are, and the score that it can get from stops of its
    /// own.
    fn for_camera(
        &self,
        index: usize,
        stops: &[Point2<f64>],
        random: &mut ChaCha8Rng,
    ) -> Result<(Vec<Point2<f64>>, f64), PlanError> {
        let camera = &self.world.cameras()[index];
        let candidates = self.ground().candidates(&[index], random, |place| {
            information::of_sighting(camera, place, &self.noise)
        });
        let score = |information: &Matrix3<f64>| score_of_pose(information, camera.range);
        let alone = Choice {
            candidates: &candidates,
            before: Matrix3::zeros(),
            taken: stops,
            separation: self.separation(),
            score,
        };
        let refused = PlanError::Camera {
            camera: index,
            stops: self.stops,
        };
        let own = alone.best(self.stops, STARTS, random).ok_or(refused)?;
        let seen = stops
            .iter()
            .filter(|&&place| self.suits(index, place))
            .count();
        let shared = Choice {
            before: self.information(index, stops),
            ..alone
        };
        let enough = own.score * SHARING;
        if seen >= self.stops && score(&shared.before) <= enough {
            return Ok((Vec::new(), own.score));
        }
        let fewest = self.stops.saturating_sub(seen).max(1);
        let attainable = own.score;
        let design = (fewest..self.stops)
            .filter_map(|count| shared.best(count, STARTS, random))
            .find(|design| design.score <= enough)
            .unwrap_or(own);
        let places = design.chosen.iter().map(|&i| candidates[i].0).collect();
        Ok((places, attainable))
    }

    fn seen_by(&self, place: Point2<f64>) -> Vec<usize> {
        let mut cameras = self.world.cameras_that_see(place, self.radius);
        cameras.retain(|&camera| self.suits(camera, place));
        cameras
    }
}
