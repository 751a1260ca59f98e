//! Cameras that do not stand exactly where the file has them.

use nalgebra::{Point2, Vector2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::file::{ScatterTable, Scenario};
use crate::world::World;

/// Draws of one camera's place until one is inside the world and on the same side of every obstacle.
const DRAWS: usize = 100;
/// So near to an obstacle it does not get.
const CLEARANCE: f64 = 0.01;

impl ScatterTable {
    /// By how much a sweep moves cameras where the file does not say it: no two seeds are then
    /// of one geometry.
    pub const USUAL: Self = Self {
        position: 0.3,
        heading_deg: 3.0,
    };

    /// Whether nothing is moved.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

/// The scenario with its cameras moved, by normal distributions; other numbers of the `attempt` are
/// other draws. A camera stays where it was if no place for it is found.
pub(super) fn scattered(scenario: &Scenario, world: &World, attempt: u64) -> Scenario {
    let mut moved = scenario.clone();
    let ScatterTable {
        position,
        heading_deg,
    } = scenario.scatter;
    let [low, high] = [scenario.world.low, scenario.world.high].map(Point2::from);
    for camera in moved.networks.iter_mut().flat_map(|n| &mut n.cameras) {
        // Each camera has a stream of its own, and none that a grid's cells have: one camera more
        // changes nothing for the others.
        let mut random = ChaCha8Rng::seed_from_u64(scenario.seed);
        random.set_stream(u64::MAX - (attempt << 16 | u64::from(camera.id)));
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        camera.heading_deg = (camera.heading_deg + heading_deg * normal()).rem_euclid(360.0);
        let place = Point2::new(camera.x, camera.y);
        let mut draws = (0..DRAWS).map(|_| place + Vector2::new(normal(), normal()) * position);
        let found = draws.find(|to| {
            *to >= low && *to <= high && world.obstacle_on_way(place, *to, CLEARANCE).is_none()
        });
        if let Some(place) = found {
            (camera.x, camera.y) = (place.x, place.y);
        }
    }
    moved
}
