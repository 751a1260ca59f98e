//! Where to stop the target next, so that the cameras that want it learn most.
//!
//! Candidates are those of the planner. The information of a stop, the Fisher information of its sightings,
//! comes on top of what is known already; the best candidate lowers the cameras' scores most, as ratios, over
//! all cameras that want a stop. The choice is greedy: further stops are chosen as if the earlier ones had
//! been made.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Matrix6, Point2, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{
    ground::{ANYWHERE, Ground},
    information::{self, Noise},
    score_of_pair, score_of_pose,
};
use crate::world::World;

/// Stops nearer to one another than this part of a camera's range tell nearly the same.
const APART: f64 = 0.1;

/// A camera that wants to see the target again.
#[derive(Clone, Debug)]
pub struct Wish {
    /// Index of the world's camera, which stands where it is believed to.
    pub camera: usize,
    /// Prior information on its `(x, y, heading)`: positive definite.
    pub known: Matrix3<f64>,
    /// Noise of its measurements.
    pub noise: Noise,
    /// Stops that it certainly still needs.
    pub missing: usize,
}

impl Wish {
    /// Information on a camera of which it is only known that it is somewhere about here, looking anywhere.
    pub fn nothing_known(range: f64) -> Matrix3<f64> {
        Matrix3::from_diagonal(&[range.powi(-2), range.powi(-2), PI.powi(-2)].into())
    }
}

/// References without an answer, who count only stops that both of them see.
#[derive(Clone, Debug)]
pub struct PairWish {
    /// Indices of the world's cameras.
    pub cameras: [usize; 2],
    /// Where the target stood in view of both.
    pub made: Vec<Point2<f64>>,
    /// Noise of their measurements.
    pub noise: Noise,
    /// Stops that they certainly still need.
    pub missing: usize,
}

/// Candidates and aim of the choice of stops.
pub struct Advice<'a> {
    /// The cameras and obstacles.
    pub world: &'a World,
    /// Radius of the target.
    pub radius: f64,
    /// Places at which a person can stand. No other is asked for.
    pub may_stand: &'a dyn Fn(Point2<f64>) -> bool,
    /// The cameras.
    pub wishes: Vec<Wish>,
    /// The references.
    pub pair: Option<PairWish>,
}

/// A place, and its information for each wish and the pair.
struct Offer {
    place: Point2<f64>,
    range: f64,
    tells: Vec<Option<Matrix3<f64>>>,
    tells_pair: Option<Matrix6<f64>>,
}

impl Advice<'_> {
    /// The best stops, `most` at most, each with the world's cameras that want to see it there.
    pub fn stops(mut self, most: usize) -> Vec<(Point2<f64>, Vec<usize>)> {
        let candidates = self.candidates();
        let range = |camera: usize| self.world.cameras()[camera].range;
        let mut pair_known = self.pair.as_ref().map(|pair| self.known_of(pair));
        let mut stops: Vec<(Point2<f64>, Vec<usize>)> = Vec::new();
        while stops.len() < most {
            let gain_of = |candidate: &Offer| {
                let (mut gain, mut seen_by) = (0.0, Vec::new());
                if let (Some(pair), Some(known), Some(tells)) =
                    (&self.pair, &pair_known, &candidate.tells_pair)
                    && pair.missing > 0
                {
                    let range = pair
                        .cameras
                        .map(range)
                        .into_iter()
                        .fold(f64::INFINITY, f64::min);
                    gain +=
                        (score_of_pair(known, range) / score_of_pair(&(known + tells), range)).ln();
                    seen_by.extend(pair.cameras);
                }
                for (wish, tells) in self.wishes.iter().zip(&candidate.tells) {
                    if let (1.., Some(tells)) = (wish.missing, tells) {
                        let score = |known: &_| score_of_pose(known, range(wish.camera));
                        gain += (score(&wish.known) / score(&(wish.known + tells))).ln();
                        seen_by.push(wish.camera);
                    }
                }
                (gain, seen_by)
            };
            let is_new = |candidate: &&Offer| {
                let near = APART * candidate.range;
                { stops.iter() }.all(|(stop, _)| (stop - candidate.place).norm() >= near)
            };
            let best = candidates
                .iter()
                .filter(is_new)
                .map(|candidate| (candidate, gain_of(candidate)))
                .filter(|(_, (gain, _))| *gain > 0.0)
                .max_by(|(_, (a, _)), (_, (b, _))| a.total_cmp(b));
            let Some((candidate, (_, seen_by))) = best else {
                break;
            };
            if let (Some(pair), Some(known), Some(tells)) =
                (&mut self.pair, &mut pair_known, &candidate.tells_pair)
                && pair.missing > 0
            {
                *known += tells;
                pair.missing -= 1;
            }
            for (wish, tells) in self.wishes.iter_mut().zip(&candidate.tells) {
                if let (1.., Some(tells)) = (wish.missing, tells) {
                    wish.known += tells;
                    wish.missing -= 1;
                }
            }
            stops.push((candidate.place, seen_by));
        }
        stops
    }

    fn candidates(&self) -> Vec<Offer> {
        let cameras = self.world.cameras();
        let ground = Ground {
            world: self.world,
            bounds: ANYWHERE,
            radius: self.radius,
            may_stand: Some(self.may_stand),
        };
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let alone = self.wishes.iter().map(|wish| vec![wish.camera]);
        let together = self.pair.iter().map(|pair| pair.cameras.to_vec());
        let groups: Vec<_> = alone.chain(together).collect();
        let places = groups.iter().flat_map(|group| {
            let range = cameras[group[0]].range;
            let places = ground.candidates(group, &mut random, |_| ());
            places.into_iter().map(move |(place, ())| (range, place))
        });
        places
            .map(|(range, place)| Offer {
                place,
                range,
                tells: { self.wishes.iter() }
                    .map(|wish| {
                        let tells =
                            || information::of_sighting(&cameras[wish.camera], place, &wish.noise);
                        ground.suits(wish.camera, place).then(tells)
                    })
                    .collect(),
                tells_pair: self.pair.as_ref().and_then(|pair| {
                    let see = pair
                        .cameras
                        .iter()
                        .all(|&camera| ground.suits(camera, place));
                    see.then(|| self.of_pair(pair, place))
                }),
            })
            .collect()
    }

    fn of_pair(&self, pair: &PairWish, place: Point2<f64>) -> Matrix6<f64> {
        let cameras = pair.cameras.map(|camera| &self.world.cameras()[camera]);
        information::of_reference_stop(cameras, place, &pair.noise)
    }

    /// Information on the references: that they are about here, looking anywhere, and what stops told.
    fn known_of(&self, pair: &PairWish) -> Matrix6<f64> {
        let [heading, place] =
            [PI, self.world.cameras()[pair.cameras[0]].range].map(|s| s.powi(-2));
        let nothing = Vector6::new(heading, heading, place, place, heading, place);
        let made = pair.made.iter().map(|&place| self.of_pair(pair, place));
        Matrix6::from_diagonal(&nothing) + made.sum::<Matrix6<f64>>()
    }
}
