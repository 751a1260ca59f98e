//! Cameras that do not stand where the file has them.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{
    file::{PlacedCamera, ScatterTable, Scenario},
    put_up::obstacles,
};

/// The first stream of this generator that no grid uses.
const STREAM: u64 = 1 << 32;
/// Places that are tried for a camera.
const TRIES: usize = 100;

impl Scenario {
    /// The site as it may really be: each camera stands as far from where the file has it as
    /// [`Scenario::scatter`] says, drawn from the seed. All else follows: the frame of the network,
    /// and the references' distance unless the file states it. A place in an obstacle or outside of
    /// the world is drawn again.
    #[must_use]
    pub fn scattered(&self) -> Self {
        let mut site = self.clone();
        let by = std::mem::take(&mut site.scatter);
        if by == ScatterTable::default() {
            return site;
        }
        let solid: Vec<_> = self.world.obstacles.iter().flat_map(obstacles).collect();
        let is_free = |camera: &PlacedCamera| {
            camera.place().is_some_and(|place| {
                (0..2).all(|i| (self.world.low[i]..=self.world.high[i]).contains(&place[i]))
                    && !solid.iter().any(|obstacle| obstacle.contains(place))
            })
        };
        let cameras = site.networks.iter_mut().flat_map(|n| &mut n.cameras);
        for camera in cameras {
            // By their numbers, so that one camera more moves no other.
            let mut random = ChaCha8Rng::seed_from_u64(self.seed);
            random.set_stream(STREAM + u64::from(camera.id));
            let mut drawn = || -> f64 { StandardNormal.sample(&mut random) };
            let turn = by.heading_deg * drawn();
            camera.heading_deg = camera.heading_deg.map(|heading| heading + turn);
            for _ in 0..TRIES {
                let mut moved = camera.clone();
                moved.x = camera.x.map(|x| x + by.position * drawn());
                moved.y = camera.y.map(|y| y + by.position * drawn());
                if is_free(&moved) {
                    *camera = moved;
                    break;
                }
            }
        }
        site
    }
}
