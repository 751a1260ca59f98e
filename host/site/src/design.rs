//! Worth of a site before anything is mounted: who sees what, how well cameras would know their poses, how
//! well they would then tell where a target is, and where one more would help most.
//!
//! All of it is Fisher information, whose inverse bounds the covariance (Cramer-Rao), with the noise
//! that the [planner](crate::planner) counts with.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};
use serde::Serialize;

use crate::{
    CameraNode, Network, Scenario, ScenarioError, Site, TargetNode,
    planner::{Ground, Noise, Redundancy, Survey, Wish, bound, of_sighting},
    put_up,
    world::{Camera, World},
};

/// Description of the method by which the advice is found.
pub const METHOD: &str = "grid search: of each place (and, of a camera, each direction), the predicted \
    gain of Fisher information in bits; a camera's is that about the direction of which least was known, mean \
    over the places where a target can stand";

/// Cells along the longer side of the site.
const CELLS: f64 = 40.0;
/// Places along the longer side where one more camera might be.
const PLACES: f64 = 16.0;
/// Directions into which it might look.
const DIRECTIONS: u32 = 16;
/// A target where no network has one.
const RADIUS: f64 = 0.15;

/// Predicted worth of a site.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Design {
    /// Why it cannot be calibrated as it is, if so.
    pub problem: Option<String>,
    /// The worst that is to be expected, in a sentence.
    pub verdict: String,
    /// Every pose is expected to be as certain as asked for.
    pub good: bool,
    /// Its cameras, network by network.
    pub cameras: Vec<Expected>,
    /// Where targets stop in the rehearsal, of all networks.
    pub stops: Vec<[f64; 2]>,
    /// Places where a target can be seen, and by how many cameras.
    pub coverage: Coverage,
}

/// Predicted worth of a camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Expected {
    /// The network that it belongs to, from 0.
    pub network: usize,
    /// Its number.
    pub id: u16,
    /// It defines the frame.
    pub reference: bool,
    /// Field of view, degrees.
    pub field_of_view_deg: f64,
    /// Distance up to which it sees.
    pub range: f64,
    /// Number of the stops that it would measure.
    pub stops: usize,
    /// Standard deviation of its place, as the root of the sum over both axes, that the joint estimate of a target
    /// would tell: carrier, lenses and references included. `None` of a camera that sees too few stops.
    pub sigma_position: Option<f64>,
    /// The same of its heading, degrees.
    pub sigma_heading_deg: Option<f64>,
    /// Covariance of its `(x, y)`.
    pub covariance: Option<[[f64; 2]; 2]>,
}

/// A grid over the site.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Its lowest corner.
    pub low: [f64; 2],
    /// Side of a cell.
    pub step: f64,
    /// Cells along x.
    pub columns: usize,
    /// Cells along y.
    pub rows: usize,
    /// Number of cameras that would measure a target in the middle of each cell, row by row from the lowest;
    /// `None` where none can stand.
    pub seen_by: Vec<Option<u16>>,
    /// Bound on the standard deviation of the place of a target there, as the root of the sum over both
    /// axes: of the network that tells it best. `None` where fewer than two of its cameras of known
    /// pose see it.
    pub sigma: Vec<Option<f64>>,
}

/// Where one more would help most, the best first, each with those before it in place.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advice {
    /// Method by which it was found: [`METHOD`].
    pub method: &'static str,
    /// Cameras like the first one of the site, whose poses would be known.
    pub cameras: Vec<FurtherCamera>,
    /// Stops.
    pub stops: Vec<FurtherStop>,
}

/// A camera that there might be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FurtherCamera {
    /// Where.
    pub x: f64,
    /// Where.
    pub y: f64,
    /// Direction, degrees from the x axis.
    pub heading_deg: f64,
    /// The network that it would best belong to, from 0: the one of whose stops it would measure most, or else
    /// that of the nearest camera.
    pub network: usize,
    /// Information that it would give on a target's place, mean over the places where one can stand.
    pub gain_bits: f64,
}

/// A stop that there might be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FurtherStop {
    /// Where.
    pub x: f64,
    /// Where.
    pub y: f64,
    /// Information that it would give on the poses of all cameras that see it.
    pub gain_bits: f64,
    /// Numbers of these cameras.
    pub seen_by: Vec<u16>,
}

/// A site with the known poses of its cameras.
struct Prospect {
    site: Site,
    problem: Option<String>,
    radius: f64,
    noise: Noise,
    bounds: [Point2<f64>; 2],
    /// Network, place among its cameras, information about its pose from the stops, and covariance of each of the
    /// world's cameras.
    known: Vec<Known>,
}

#[derive(Clone)]
struct Known {
    network: usize,
    id: u16,
    reference: bool,
    stops: usize,
    information: Matrix3<f64>,
    covariance: Option<Matrix3<f64>>,
}

impl Design {
    /// Predicts the worth of a site.
    ///
    /// # Errors
    /// It cannot be put up at all: a camera has no place, or stands in an obstacle. If no way for its targets can
    /// be planned, that is a [`problem`](Design::problem).
    pub fn of(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let prospect = Prospect::new(scenario)?;
        let cameras = prospect.known.iter().zip(prospect.site.world.cameras());
        let cameras: Vec<_> = { cameras }
            .map(|(known, camera)| Expected {
                network: known.network,
                id: known.id,
                reference: known.reference,
                field_of_view_deg: (camera.lens.bearing(0.0).abs() * 2.0).to_degrees(),
                range: camera.range,
                stops: known.stops,
                sigma_position: known.covariance.map(|v| (v.m11 + v.m22).sqrt()),
                sigma_heading_deg: known.covariance.map(|v| v.m33.sqrt().to_degrees()),
                covariance: known.covariance.map(|v| [[v.m11, v.m12], [v.m21, v.m22]]),
            })
            .collect();
        let (verdict, good) = match &prospect.problem {
            Some(problem) => (problem.clone(), false),
            None => judged(scenario, &cameras),
        };
        let targets = prospect.site.networks.iter().flat_map(|n| &n.targets);
        let stops = targets.flat_map(|target| &target.stops);
        Ok(Self {
            verdict,
            good,
            cameras,
            stops: stops.map(|&stop| stop.into()).collect(),
            coverage: prospect.coverage(),
            problem: prospect.problem,
        })
    }
}

/// The worst that is to be expected of these cameras, and true if no pose would be weak.
fn judged(scenario: &Scenario, cameras: &[Expected]) -> (String, bool) {
    let [place, heading] = put_up::limits(scenario);
    let unit = &scenario.unit;
    let named = |chosen: &[&Expected]| -> (String, bool) {
        let ids: Vec<_> = chosen.iter().map(|camera| camera.id.to_string()).collect();
        match ids.as_slice() {
            [one] => (format!("camera {one}"), true),
            many => (format!("cameras {}", many.join(", ")), false),
        }
    };
    let worst = |chosen: &[&Expected]| {
        let sigmas = chosen.iter().filter_map(|camera| camera.sigma_position);
        sigmas.fold(0.0, f64::max)
    };
    let all: Vec<&Expected> = cameras.iter().collect();
    let is_lost = |camera: &&&Expected| camera.sigma_position.is_none();
    let lost: Vec<&Expected> = all.iter().filter(is_lost).copied().collect();
    let is_weak = |camera: &&&Expected| {
        let is_beyond = |sigma: Option<f64>, limit: f64| sigma.is_some_and(|sigma| sigma > limit);
        is_beyond(camera.sigma_position, place)
            || is_beyond(camera.sigma_heading_deg, heading.to_degrees())
    };
    let weak: Vec<&Expected> = all.iter().filter(is_weak).copied().collect();
    if lost.len() == all.len() {
        return ("No stops: nothing is known of poses.".to_owned(), false);
    }
    if !lost.is_empty() {
        let (names, is_one) = named(&lost);
        let pose = if is_one { "pose" } else { "poses" };
        return (
            format!("The stops do not tell the {pose} of {names}."),
            false,
        );
    }
    if !weak.is_empty() {
        let (names, _) = named(&weak);
        let to = worst(&weak);
        let asked = format!("{place} {unit} and {:.1} degrees", heading.to_degrees());
        let what = format!(
            "The stops leave {names} weak: to {to:.3} {unit} at worst, where {asked} are asked for."
        );
        return (what, false);
    }
    let what = format!(
        "Each pose can be found, to {:.3} {unit} at worst.",
        worst(&all)
    );
    (what, true)
}

impl Advice {
    /// Where so many further cameras, and so many further stops, would help most.
    ///
    /// # Errors
    /// As of [`Design::of`].
    pub fn on(scenario: &Scenario, most: usize) -> Result<Self, ScenarioError> {
        let prospect = Prospect::new(scenario)?;
        Ok(Self {
            method: METHOD,
            cameras: prospect.further_cameras(most),
            stops: prospect.further_stops(most),
        })
    }
}

/// Middles of cells of a grid, row by row.
struct Grid {
    low: Point2<f64>,
    step: f64,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new([low, high]: [Point2<f64>; 2], along: f64) -> Self {
        let size = high - low;
        let step = size.max() / along;
        let count = |length: f64| ((length / step).round() as usize).max(1);
        Self {
            low,
            step,
            columns: count(size.x),
            rows: count(size.y),
        }
    }

    fn places(&self) -> impl Iterator<Item = Point2<f64>> + use<> {
        let &Self {
            low,
            step,
            columns,
            rows,
        } = self;
        let middle = move |n: usize| (n as f64 + 0.5) * step;
        (0..rows * columns)
            .map(move |n| low + Vector2::new(middle(n % columns), middle(n / columns)))
    }
}

/// Information about the place of a target, from one bearing of a camera whose pose has this covariance.
fn of_bearing(
    camera: &Camera,
    covariance: &Matrix3<f64>,
    place: Point2<f64>,
    noise: &Noise,
) -> Matrix2<f64> {
    let to = place - camera.place;
    let across = Vector2::new(-to.y, to.x) / to.norm_squared();
    let of_pose = Vector3::new(-across.x, -across.y, -1.0);
    let variance = noise.sigma(camera, place).powi(2) + of_pose.dot(&(covariance * of_pose));
    across * across.transpose() / variance
}

/// Information about the least known direction: the smaller eigenvalue. One bearing tells nothing of it, and
/// so a single camera tells nothing of where a target is.
fn least(information: &Matrix2<f64>) -> f64 {
    let half = (information.m11 + information.m22) / 2.0;
    let apart = (information.m11 - information.m22) / 2.0;
    half - apart.hypot(information.m12)
}

fn sigma(information: &Matrix2<f64>) -> Option<f64> {
    bound(information).map(|covariance| covariance.trace().sqrt())
}

/// Places of a network's cameras in the order of a survey: the references first.
fn survey_order(network: &Network) -> Vec<usize> {
    let others = (0..network.cameras.len()).filter(|place| !network.references.contains(place));
    network.references.into_iter().chain(others).collect()
}

impl Prospect {
    fn new(scenario: &Scenario) -> Result<Self, ScenarioError> {
        let bare = put_up::furnish(scenario).map_err(|error| scenario.located(error))?;
        let (site, problem) = match put_up::with_stops(scenario, bare.clone()) {
            Ok(site) => (site, None),
            Err(error) => (bare, Some(scenario.located(error).to_string())),
        };
        let radius = site.world.targets().first().map_or(RADIUS, |t| t.radius);
        let mut targets = site.networks.iter().flat_map(|network| &network.targets);
        let standing = targets.next().map_or(0.0, |t| t.gait.standing_sigma());
        let world = &scenario.world;
        let mut prospect = Self {
            problem,
            radius,
            noise: Noise {
                columns: Noise::COLUMNS,
                standing,
            },
            bounds: [world.low, world.high].map(Point2::from),
            known: Vec::new(),
            site,
        };
        let networks = prospect.site.networks.iter().enumerate();
        prospect.known = networks
            .flat_map(|(number, network)| prospect.known(number, network))
            .collect();
        Ok(prospect)
    }

    fn ground<'a>(&self, world: &'a World) -> Ground<'a> {
        Ground {
            world,
            bounds: self.bounds,
            radius: self.radius,
            may_stand: None,
        }
    }

    fn known(&self, number: usize, network: &Network) -> Vec<Known> {
        let world = &self.site.world;
        let ground = self.ground(world);
        // Targets of another network may bring the frame.
        let visitors = self.site.networks.iter().enumerate();
        let visitors = visitors.filter(|(n, _)| *n == number || network.home == Some(*n));
        let stops: Vec<_> = visitors
            .flat_map(|(_, network)| network.targets.iter().flat_map(|t| t.stops.clone()))
            .collect();
        let walks: Vec<_> = { network.targets.iter() }
            .filter(|_| network.home.is_none())
            .filter_map(|target| self.walk(network, target))
            .collect();
        let of = |(place, node): (usize, &CameraNode)| {
            let camera = &world.cameras()[node.index];
            let seen = stops.iter().filter(|&&stop| ground.suits(node.index, stop));
            let seen: Vec<_> = seen.collect();
            let information = { seen.iter() }
                .map(|&&stop| of_sighting(camera, stop, &self.noise))
                .sum();
            let reference = network.home.is_none() && network.references.contains(&place);
            let least = if reference { 1 } else { 3 };
            let order = survey_order(network);
            let own = order.iter().position(|&other| other == place);
            let place_of = |covariance: &Matrix3<f64>| covariance.m11 + covariance.m22;
            let told = walks.iter().filter_map(|walk| Some(walk.covariance(own?)));
            let best = told.min_by(|a, b| place_of(a).total_cmp(&place_of(b)));
            // Less certain than the camera sees far, nothing is told.
            let best = best.filter(|told| place_of(told) < camera.range.powi(2));
            Known {
                network: number,
                id: node.id,
                reference,
                stops: seen.len(),
                information,
                covariance: match network.home {
                    _ if seen.len() < least => None,
                    None => best,
                    // Its own sightings of a target that knows where it is.
                    Some(_) => bound(&information),
                },
            }
        };
        network.cameras.iter().enumerate().map(of).collect()
    }

    /// Everything that a target would know at the end of its walk, as its joint estimate has it.
    fn walk(&self, network: &Network, target: &TargetNode) -> Option<Redundancy> {
        let world = &self.site.world;
        let order = survey_order(network);
        let cameras = order
            .iter()
            .map(|&place| world.cameras()[network.cameras[place].index]);
        let obstacles = world.obstacles().to_vec();
        let own = World::new(cameras.collect(), obstacles, Vec::new());
        let noise = Noise {
            standing: target.standing_sigma,
            ..self.noise
        };
        let ground = self.ground(&own);
        let survey = Survey::of_walk(&ground, &target.stops, &noise, target.steps, network.told);
        survey.redundancy()
    }

    /// Cameras that would measure a target there.
    fn seen_by(&self, place: Point2<f64>) -> Vec<usize> {
        let world = &self.site.world;
        let mut cameras = world.cameras_that_see(place, self.radius);
        cameras.retain(|&camera| self.ground(world).suits(camera, place));
        cameras
    }

    /// Information of a network's cameras on the place of a target, and number of these cameras.
    fn information(
        &self,
        seen_by: &[usize],
        network: usize,
        place: Point2<f64>,
    ) -> (Matrix2<f64>, usize) {
        let own = seen_by.iter().filter_map(|&camera| {
            let known = &self.known[camera];
            let covariance = known
                .covariance
                .as_ref()
                .filter(|_| known.network == network)?;
            let camera = &self.site.world.cameras()[camera];
            Some(of_bearing(camera, covariance, place, &self.noise))
        });
        own.fold((Matrix2::zeros(), 0), |(sum, count), one| {
            (sum + one, count + 1)
        })
    }

    fn coverage(&self) -> Coverage {
        let grid = Grid::new(self.bounds, CELLS);
        let ground = self.ground(&self.site.world);
        let of = |place: Point2<f64>| {
            if !ground.is_free(place) {
                return (None, None);
            }
            let cameras = self.seen_by(place);
            let networks = 0..self.site.networks.len();
            let sigmas = networks.filter_map(|network| {
                let (information, count) = self.information(&cameras, network, place);
                if count < 2 { None } else { sigma(&information) }
            });
            let best = sigmas.min_by(f64::total_cmp);
            (u16::try_from(cameras.len()).ok(), best)
        };
        let (seen_by, sigma) = grid.places().map(of).unzip();
        Coverage {
            low: grid.low.into(),
            step: grid.step,
            columns: grid.columns,
            rows: grid.rows,
            seen_by,
            sigma,
        }
    }

    fn further_cameras(&self, most: usize) -> Vec<FurtherCamera> {
        let world = &self.site.world;
        let Some(&like) = world.cameras().first() else {
            return Vec::new();
        };
        let ground = self.ground(world);
        // Before anything is seen, a target is somewhere in a camera's range.
        let before = Matrix2::identity() / like.range.powi(2);
        let free = Grid::new(self.bounds, CELLS)
            .places()
            .filter(|&place| ground.is_free(place));
        let mut cells: Vec<_> = free
            .map(|place| {
                let seen_by = self.seen_by(place);
                let networks = 0..self.site.networks.len();
                let told = networks.map(|network| self.information(&seen_by, network, place).0);
                let best = told.max_by(|a, b| {
                    (a + before)
                        .determinant()
                        .total_cmp(&(b + before).determinant())
                });
                (place, before + best.unwrap_or_default())
            })
            .collect();
        let obstacles = world.obstacles().to_vec();
        let mut alone = World::new(vec![like], obstacles, Vec::new());
        let places = Grid::new(self.bounds, PLACES).places();
        let inside =
            |place: &Point2<f64>| !world.obstacles().iter().any(|o| o.shape.contains(*place));
        let places: Vec<_> = places.filter(inside).collect();
        let certain = Matrix3::zeros();
        let mut found = Vec::new();
        while found.len() < most {
            let mut best: Option<(f64, Point2<f64>, f64)> = None;
            for &place in &places {
                for n in 0..DIRECTIONS {
                    let heading = f64::from(n) / f64::from(DIRECTIONS) * TAU;
                    alone.move_camera(0, place, heading);
                    let gain = self.gain_of(&alone, &cells);
                    if gain > best.map_or(0.0, |(gain, ..)| gain) {
                        best = Some((gain, place, heading));
                    }
                }
            }
            let Some((gain, place, heading)) = best else {
                break;
            };
            alone.move_camera(0, place, heading);
            let seen = self.ground(&alone);
            for (cell, information) in &mut cells {
                if seen.suits(0, *cell) {
                    *information += of_bearing(&alone.cameras()[0], &certain, *cell, &self.noise);
                }
            }
            found.push(FurtherCamera {
                x: place.x,
                y: place.y,
                heading_deg: heading.to_degrees(),
                network: self.network_for(&alone),
                gain_bits: gain / cells.len().max(1) as f64,
            });
        }
        found
    }

    /// The network that the one camera of a world would best belong to.
    fn network_for(&self, alone: &World) -> usize {
        let ground = self.ground(alone);
        let place = alone.cameras()[0].place;
        let worth = |number: usize| {
            let stops = { self.site.networks[number].targets.iter() }.flat_map(|t| &t.stops);
            let seen = stops.filter(|&&stop| ground.suits(0, stop)).count();
            let cameras = self.known.iter().zip(self.site.world.cameras());
            let own = cameras.filter(|(known, _)| known.network == number);
            let nearest = own.map(|(_, camera)| (camera.place - place).norm());
            (seen, -nearest.fold(f64::INFINITY, f64::min))
        };
        let all = (0..self.site.networks.len()).map(|number| (worth(number), number));
        let best = all.max_by(|((a, x), _), ((b, y), _)| a.cmp(b).then(x.total_cmp(y)));
        best.map_or(0, |(_, number)| number)
    }

    /// Bits that the one camera of a world adds, in all.
    fn gain_of(&self, alone: &World, cells: &[(Point2<f64>, Matrix2<f64>)]) -> f64 {
        let camera = &alone.cameras()[0];
        let ground = self.ground(alone);
        let ahead = Vector2::new(camera.heading.cos(), camera.heading.sin());
        let near = |place: Point2<f64>| {
            let to = place - camera.place;
            // Cheaper than a look, and no lens sees behind itself.
            to.norm_squared() <= camera.range.powi(2) && to.dot(&ahead) > 0.0
        };
        let seen = cells
            .iter()
            .filter(|(place, _)| near(*place) && ground.suits(0, *place));
        seen.map(|(place, before)| {
            let more = of_bearing(camera, &Matrix3::zeros(), *place, &self.noise);
            0.5 * (least(&(before + more)) / least(before)).log2()
        })
        .sum()
    }

    fn further_stops(&self, most: usize) -> Vec<FurtherStop> {
        let world = &self.site.world;
        let ground = self.ground(world);
        let cameras = self.known.iter().zip(world.cameras());
        let mut known: Vec<_> = cameras
            .map(|(known, camera)| known.information + Wish::nothing_known(camera.range))
            .collect();
        let free = Grid::new(self.bounds, CELLS)
            .places()
            .filter(|&place| ground.is_free(place));
        let looks: Vec<_> = free
            .map(|place| {
                let mut seen_by = self.seen_by(place);
                // References have their places by definition.
                seen_by.retain(|&camera| !self.known[camera].reference);
                (place, seen_by)
            })
            .collect();
        let of = |camera: usize, place| of_sighting(&world.cameras()[camera], place, &self.noise);
        let mut found = Vec::new();
        while found.len() < most {
            let gains = looks.iter().map(|(place, seen_by)| {
                let gain = |&camera: &usize| {
                    let before: &Matrix3<f64> = &known[camera];
                    let after = before + of(camera, *place);
                    0.5 * (after.determinant() / before.determinant()).log2()
                };
                (seen_by.iter().map(gain).sum::<f64>(), place, seen_by)
            });
            let best = gains.max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((gain_bits, &place, seen_by)) = best.filter(|(gain, ..)| *gain > 0.0) else {
                break;
            };
            for &camera in seen_by {
                known[camera] += of(camera, place);
            }
            found.push(FurtherStop {
                x: place.x,
                y: place.y,
                gain_bits,
                seen_by: seen_by
                    .iter()
                    .map(|&camera| self.known[camera].id)
                    .collect(),
            });
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use calib_core::{
        Pose, Ray,
        intersection::{StationBearing, locate},
    };

    use super::*;
    use crate::Overrides;

    fn thesis() -> Scenario {
        Scenario::load("thesis-13", &Overrides::default()).unwrap()
    }

    #[test]
    fn a_design_says_what_is_weak_and_what_is_lost() {
        let design = Design::of(&thesis()).unwrap();
        assert_eq!(design.problem, None);
        let starts = |design: &Design, with: &str| {
            assert!(design.verdict.starts_with(with), "{}", design.verdict);
        };
        starts(&design, "Each pose can be found, to 0.");
        assert!(design.good);
        let references = design.cameras.iter().filter(|camera| camera.reference);
        let of_references: Vec<_> = references.map(|camera| camera.sigma_position).collect();
        // The thesis promises their places.
        assert_eq!(of_references, [Some(0.0); 2]);
        let mut asked = thesis();
        asked.firmware.weak_sigma = Some(1e-3);
        let design = Design::of(&asked).unwrap();
        starts(
            &design,
            "The stops leave cameras 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13 weak: to 0.",
        );
        assert!(!design.good);
        let mut few = thesis();
        let all = few.put_up().unwrap().networks[0].targets[0].stops.clone();
        few.networks[0].targets[0].stops = Some(
            all[..all.len() - 3]
                .iter()
                .map(|&stop| stop.into())
                .collect(),
        );
        let design = Design::of(&few).unwrap();
        starts(&design, "The stops do not tell the pose");
        assert!(!design.good);
        few.networks[0].targets[0].stops = Some(vec![all[0].into()]);
        assert!(!Design::of(&few).unwrap().good);
    }

    /// The oracle solves for the place of a target.
    #[test]
    fn places_are_as_well_known_as_an_intersection_of_their_bearings() {
        let prospect = Prospect::new(&thesis()).unwrap();
        let coverage = prospect.coverage();
        let grid = Grid::new(prospect.bounds, CELLS);
        let mut count = 0;
        for (place, sigma) in grid.places().zip(&coverage.sigma) {
            let seen_by = prospect.seen_by(place);
            let bearing = |&index: &usize| {
                let camera = &prospect.site.world.cameras()[index];
                StationBearing {
                    pose: Pose {
                        position: camera.place,
                        heading: camera.heading,
                        covariance: prospect.known[index].covariance.unwrap(),
                    },
                    ray: Ray::towards(camera.place, camera.heading, place),
                    bearing_sigma: prospect.noise.sigma(camera, place),
                    range: None,
                }
            };
            let bearings: Vec<_> = seen_by.iter().map(bearing).collect();
            let Some(sigma) = sigma else {
                assert!(
                    bearings.len() < 2 || !prospect.ground(&prospect.site.world).is_free(place)
                );
                continue;
            };
            let solved = locate(&bearings).unwrap().covariance.trace().sqrt();
            assert!(
                (sigma / solved - 1.0).abs() < 1e-6,
                "{place}: {sigma} {solved}"
            );
            count += 1;
        }
        assert!(count > 50, "{count}");
    }

    #[test]
    fn advice_sees_what_nobody_sees_and_helps() {
        let mut scenario = thesis();
        let advice = Advice::on(&scenario, 2).unwrap();
        assert_eq!([advice.cameras.len(), advice.stops.len()], [2, 2]);
        assert!(advice.cameras[0].gain_bits >= advice.cameras[1].gain_bits);
        assert!(advice.stops[0].gain_bits >= advice.stops[1].gain_bits);
        let seen = |scenario: &Scenario| {
            let coverage = Design::of(scenario).unwrap().coverage;
            coverage
                .seen_by
                .iter()
                .flatten()
                .map(|&n| usize::from(n))
                .sum::<usize>()
        };
        let told = |scenario: &Scenario| {
            let sigma = Design::of(scenario).unwrap().coverage.sigma;
            sigma.iter().flatten().count()
        };
        let (before, told_before) = (seen(&scenario), told(&scenario));
        let best = &advice.cameras[0];
        scenario.networks[0].cameras.push(crate::PlacedCamera {
            id: 14,
            x: Some(best.x),
            y: Some(best.y),
            heading_deg: Some(best.heading_deg),
            ..Default::default()
        });
        assert!(seen(&scenario) > before + 10);
        // It does not only see what no other camera does: places are told there that were not.
        assert!(told(&scenario) > told_before);
        // Not all gain is of the grid's making: with that camera there, the next one gains less.
        let next = Advice::on(&scenario, 1).unwrap();
        assert!(next.cameras[0].gain_bits <= best.gain_bits);
    }

    #[test]
    fn a_further_camera_belongs_to_the_network_before_it() {
        let two = "name = \"two\"\n[camera]\nfield_of_view_deg = 60.0\nrange = 8.0\n\
            [grid]\nnodes = 8\ncell_nodes = 4\n";
        let scenario = Scenario::from_toml(two, &Overrides::default()).unwrap();
        let advice = Advice::on(&scenario, 4).unwrap();
        let mut networks = Vec::new();
        for camera in &advice.cameras {
            let ahead = camera.x + 4.0 * camera.heading_deg.to_radians().cos();
            assert_eq!(camera.network, usize::from(ahead > 24.0), "{camera:?}");
            networks.push(camera.network);
        }
        assert!(networks.contains(&0) && networks.contains(&1), "{advice:?}");
    }
}
