//! Cameras that do not stand where the file has them.

use nalgebra::{Point2, Vector2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{
    check::refuse,
    error::ScenarioError,
    file::{PlacedCamera, ScatterTable, Scenario},
    put_up::{Site, obstacles},
};
use crate::world::World;

/// The first stream of this generator that no grid uses.
const STREAM: u64 = 1 << 32;
/// Places that are tried for a camera.
const TRIES: usize = 100;
/// So near to an obstacle it does not get.
const CLEARANCE: f64 = 0.01;
/// Cameras are all drawn anew so many times where no stops can be planned for them.
const ATTEMPTS: u64 = 10;

impl ScatterTable {
    /// By how much a sweep moves cameras where the file does not say it: no two seeds are then
    /// of one geometry.
    pub const USUAL: Self = Self {
        position: 0.3,
        heading_deg: 3.0,
    };

    /// Returns true if nothing is moved.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

impl Scenario {
    /// The site as it may really be, and put up: each camera stands as far from where the file has it
    /// as [`Scenario::scatter`] says, by normal distributions drawn from the seed, and other stops are
    /// planned. All else follows: the frame of the network, and the references' distance; one that the file states
    /// errs by as much as before, relative to it. A place outside of the world, or beyond an obstacle, is drawn again; all of
    /// them are, ten times at most, where no stops can be planned.
    ///
    /// # Errors
    /// As [`Scenario::put_up`].
    pub fn rehearsed(&self) -> Result<(Self, Site), ScenarioError> {
        let attempt = |number| {
            let site = self.scattered(number)?;
            let world = site.put_up()?;
            Ok((site, world))
        };
        match attempt(0) {
            Err(_) if !self.scatter.is_none() => {
                (1..ATTEMPTS).fold(attempt(1), |site, next| site.or_else(|_| attempt(next)))
            }
            only => only,
        }
    }

    fn scattered(&self, attempt: u64) -> Result<Self, ScenarioError> {
        let mut site = self.clone();
        let by = std::mem::take(&mut site.scatter);
        if by.is_none() {
            return Ok(site);
        }
        site.scattered_by = Some(self.seed);
        let solid = World::new(Vec::new(), obstacles(self), Vec::new());
        let [low, high] = [self.world.low, self.world.high].map(Point2::from);
        for camera in site.networks.iter_mut().flat_map(|n| &mut n.cameras) {
            // By their numbers, so that one camera more moves no other.
            let mut random = ChaCha8Rng::seed_from_u64(self.seed);
            random.set_stream(STREAM * (1 + attempt) + u64::from(camera.id));
            let mut drawn = || -> f64 { StandardNormal.sample(&mut random) };
            let turn = by.heading_deg * drawn();
            camera.heading_deg = camera.heading_deg.map(|heading| heading + turn);
            let Some(place) = PlacedCamera::place(camera) else {
                continue;
            };
            let mut draws =
                (0..TRIES).map(|_| place + Vector2::new(drawn(), drawn()) * by.position);
            let found = draws.find(|to| {
                let inside = *to >= low && *to <= high;
                inside && solid.obstacle_on_way(place, *to, CLEARANCE).is_none()
            });
            let Some(place) = found else {
                // Errors of the site itself are told first.
                Self {
                    scatter: ScatterTable::default(),
                    ..self.clone()
                }
                .put_up()?;
                let allowed = format!(
                    "less: camera {} then stands outside of the world, or beyond an obstacle, {TRIES} \
                     times of {TRIES}",
                    camera.id
                );
                return Err(refuse("scatter.position", by.position, allowed));
            };
            (camera.x, camera.y) = (Some(place.x), Some(place.y));
        }
        for (moved, planned) in site.networks.iter_mut().zip(&self.networks) {
            if let (Some(before), Some(now)) = (planned.baseline(), moved.baseline())
                && let Some(told) = &mut moved.references.baseline
            {
                *told *= now / before;
            }
        }
        Ok(site)
    }
}
