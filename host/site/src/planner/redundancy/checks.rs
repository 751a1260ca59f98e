//! Where to stop so that one wrong measurement cannot do much.

use nalgebra::Point2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{
    super::{
        Noise,
        ground::{ANYWHERE, Ground},
    },
    Level, Redundancy, Survey, Tolerance,
    further::{Further, Influences},
};
use crate::world::World;

/// Places that are tried for each camera that wants a stop.
const TRIED: usize = 12;
/// A stop that lowers levels by less than this part on average is no help.
const LEAST_GAIN: f64 = 0.02;
/// A level this much below the limit is aimed at: predictions are predictions.
const ENOUGH: f64 = 0.7;

/// A camera that wants its pose checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckWish {
    /// Its index.
    pub camera: usize,
    /// Level that may be left.
    pub tolerance: Tolerance,
}

/// Where to stop so that poses are checked.
pub struct Checks<'a> {
    /// The cameras of the survey, in the same order, and obstacles.
    pub world: &'a World,
    /// Radius of the target.
    pub radius: f64,
    /// Places at which a person can stand. No other is asked for, but those of the survey.
    pub may_stand: &'a dyn Fn(Point2<f64>) -> bool,
    /// Noise of the cameras' measurements, in columns.
    pub columns: f64,
    /// The poses that are to be checked.
    pub wishes: Vec<CheckWish>,
}

/// One more stop.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckStop {
    /// Where.
    pub place: Point2<f64>,
    /// The stop of the survey at whose place it is.
    pub again: Option<usize>,
    /// Cameras that see it there.
    pub seen_by: Vec<usize>,
}

impl Checks<'_> {
    /// Stops after those of a walk, `most` at most, with what is known after them. Each stop is the one that most
    /// lowers the levels of the camera that wants that most, for the way that it takes. A camera that wants one
    /// although the survey says that it is checked gets one all the same.
    pub fn stops(&self, begun: Redundancy, most: usize) -> (Vec<CheckStop>, Redundancy) {
        let mut now = begun;
        let mut stops = Vec::new();
        let candidates = self.candidates(now.survey());
        let wishing: Vec<usize> = self.wishes.iter().map(|wish| wish.camera).collect();
        // A camera that has enough does not outweigh another one.
        let is_foretold = self.are_checked(&now);
        let (enough, least) = match is_foretold {
            false => (ENOUGH / 2.0, LEAST_GAIN * wishing.len() as f64),
            true => (0.0, 0.0),
        };
        let worth = |levels: &[Level]| -> f64 {
            let shares = levels.iter().zip(&self.wishes);
            shares
                .map(|(level, wish)| level.share(wish.tolerance).max(enough).ln())
                .sum()
        };
        while stops.len() < most && (stops.is_empty() || !self.are_checked(&now)) {
            let here = now.survey().stops.last().copied();
            let influences = Influences::of(&now, &wishing);
            let before = worth(&influences.levels(&Further::default()));
            let tried = candidates.iter().map(|(stop, looks)| {
                let after = influences.levels(&now.further(stop.place, looks));
                let gain = before - worth(&after);
                let way = here.map_or(0.0, |here| (stop.place - here).norm());
                (stop, looks, gain, gain / (now.survey().range + way))
            });
            let best = tried
                .filter(|(_, _, gain, _)| *gain > least)
                .max_by(|(.., a), (.., b)| a.total_cmp(b));
            let Some((stop, looks, ..)) = best else {
                break;
            };
            stops.push(stop.clone());
            now = now.with_stop(stop.place, looks);
        }
        (stops, now)
    }

    /// Returns true if no camera wants more.
    pub(in super::super) fn are_checked(&self, walk: &Redundancy) -> bool {
        let wishing: Vec<usize> = self.wishes.iter().map(|wish| wish.camera).collect();
        let levels = walk.levels(&wishing);
        let mut shares = levels.iter().zip(&self.wishes);
        shares.all(|(level, wish)| level.share(wish.tolerance) <= ENOUGH)
    }

    /// Places in view of those who want a stop, and where the walk was.
    fn candidates(&self, survey: &Survey) -> Vec<(CheckStop, Vec<(usize, f64)>)> {
        let ground = Ground {
            world: self.world,
            bounds: ANYWHERE,
            radius: self.radius,
            may_stand: Some(self.may_stand),
        };
        let noise = Noise {
            columns: self.columns,
            standing: 0.0,
        };
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let new = self.wishes.iter().flat_map(|wish| {
            let places = ground.candidates(&[wish.camera], &mut random, |_| ());
            let places = places.into_iter().map(|(place, ())| place);
            { places.take(TRIED) }
                .map(|place| (place, None))
                .collect::<Vec<_>>()
        });
        let mut places: Vec<(Point2<f64>, Option<usize>)> = new.collect();
        for (stop, place) in survey.stops.iter().enumerate() {
            let is_new = |(other, _): &(Point2<f64>, _)| (place - other).norm() > self.radius;
            if places.iter().all(is_new) {
                places.push((*place, Some(stop)));
            }
        }
        let cameras = self.world.cameras();
        let sees = |place: Point2<f64>| {
            let seen = (0..cameras.len()).filter(|&camera| ground.suits(camera, place));
            seen.map(|camera| (camera, noise.sigma(&cameras[camera], place)))
                .collect::<Vec<_>>()
        };
        let stops = places.into_iter().map(|(place, again)| {
            let looks = sees(place);
            let seen_by = looks.iter().map(|(camera, _)| *camera).collect();
            let stop = CheckStop {
                place,
                again,
                seen_by,
            };
            (stop, looks)
        });
        stops.filter(|(_, looks)| !looks.is_empty()).collect()
    }
}

/// The way from one place to another on which nothing stands, over places where the target was: only
/// the end where nothing is between, and the places at which to turn before it otherwise. Just the end if
/// there is no such way.
pub fn way_around(
    world: &World,
    radius: f64,
    been: &[Point2<f64>],
    [from, to]: [Point2<f64>; 2],
) -> Vec<Point2<f64>> {
    let is_free = |a: Point2<f64>, b: Point2<f64>| world.obstacle_on_way(a, b, radius).is_none();
    // Dijkstra 1959, over the places by their number; the end is the last one.
    let places: Vec<Point2<f64>> = been.iter().copied().chain([to]).collect();
    let end = places.len() - 1;
    let mut ways: Vec<(f64, Option<usize>)> = { places.iter() }
        .map(|&place| match is_free(from, place) {
            true => ((place - from).norm(), None),
            false => (f64::INFINITY, None),
        })
        .collect();
    let mut left: Vec<usize> = (0..places.len()).collect();
    while let Some(nearest) =
        (0..left.len()).min_by(|&a, &b| ways[left[a]].0.total_cmp(&ways[left[b]].0))
    {
        let here = left.swap_remove(nearest);
        if here == end || ways[here].0.is_infinite() {
            break;
        }
        for &next in &left {
            let way = ways[here].0 + (places[next] - places[here]).norm();
            if way < ways[next].0 && is_free(places[here], places[next]) {
                ways[next] = (way, Some(here));
            }
        }
    }
    let mut path = vec![to];
    let mut at = end;
    while let Some(before) = ways[at].1 {
        path.push(places[before]);
        at = before;
    }
    path.reverse();
    path
}
