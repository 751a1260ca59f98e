//! Where to stop so that one wrong measurement cannot do much.

use std::collections::BTreeMap;

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
/// So many stops are asked for together where none of them lowers levels by enough alone.
const TOGETHER: usize = 3;
/// A level this much below the limit is aimed at: predictions are predictions.
const ENOUGH: f64 = 0.9;

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
    /// lowers the levels of the camera that wants that most, for the way that it takes. Up to three that lower them by
    /// enough only together are asked for together. A camera that wants one although the survey says that it is checked
    /// gets one all the same.
    pub fn stops(&self, begun: Redundancy, most: usize) -> (Vec<CheckStop>, Redundancy) {
        let mut now = begun;
        let mut stops: Vec<CheckStop> = Vec::new();
        let candidates = self.candidates(now.survey());
        let wishing: Vec<usize> = self.wishes.iter().map(|wish| wish.camera).collect();
        // A camera that has enough does not outweigh another one.
        let is_foretold = self.are_checked(&now);
        let (enough, least) = match is_foretold {
            false => (ENOUGH / 2.0, LEAST_GAIN * wishing.len() as f64),
            true => (0.0, 0.0),
        };
        let worth = |levels: &[Level], share: fn(&Level, Tolerance) -> f64| -> f64 {
            let wanted = levels.iter().zip(&self.wishes);
            wanted
                .map(|(level, wish)| share(level, wish.tolerance).max(enough).ln())
                .sum()
        };
        // Number of the stops that are worth their ways, with what is known after them, and its worth.
        let mut kept: Option<(usize, Redundancy, f64)> = None;
        loop {
            let influences = Influences::of(&now, &wishing);
            let levels = influences.levels(&Further::default());
            // Stops are chosen by what all measurements could do, and kept for what the worst one could: several may be
            // as bad, and each stop deals with one of them.
            let told = worth(&levels, Level::share);
            let alone = stops.len() - kept.as_ref().map_or(0, |(count, ..)| *count);
            let is_kept =
                { kept.as_ref() }.is_none_or(|(.., before)| before - told > least * alone as f64);
            if is_kept {
                kept = Some((stops.len(), now.clone(), told));
            }
            let has_all = !stops.is_empty() && self.are_enough(&levels);
            if stops.len() >= most || has_all || (!is_kept && alone >= TOGETHER) {
                break;
            }
            let here = now.survey().stops.last().copied();
            let before = worth(&levels, Level::share_of_all);
            let tried = candidates.iter().map(|(stop, looks)| {
                let after = influences.levels(&now.further(stop.place, looks));
                let gain = before - worth(&after, Level::share_of_all);
                let way = here.map_or(0.0, |here| (stop.place - here).norm());
                (stop, looks, gain / (now.survey().range + way))
            });
            let best = { tried.filter(|(.., gain)| *gain > 0.0) }
                .max_by(|(.., a), (.., b)| a.total_cmp(b));
            let Some((stop, looks, _)) = best else {
                break;
            };
            stops.push(stop.clone());
            now = now.with_stop(stop.place, looks);
        }
        let (count, now) = kept.map_or((0, now), |(count, known, _)| (count, known));
        stops.truncate(count);
        (stops, now)
    }

    /// Returns true if no camera wants more.
    pub(in super::super) fn are_checked(&self, walk: &Redundancy) -> bool {
        let wishing: Vec<usize> = self.wishes.iter().map(|wish| wish.camera).collect();
        self.are_enough(&walk.levels(&wishing))
    }

    fn are_enough(&self, levels: &[Level]) -> bool {
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
        // Those that saw it there will see it again, however near or large it is, if they stand where they are believed
        // to.
        let saw = |stop: usize| {
            let is_seen = |camera| self.world.sight(camera, survey.stops[stop], self.radius);
            let looks = survey.looks.iter().filter(|look| look.stop == stop);
            let looks =
                looks.filter(|look| is_seen(look.camera).is_some_and(|sight| sight.is_whole()));
            let looks: BTreeMap<usize, f64> = looks.map(|look| (look.camera, look.sigma)).collect();
            looks.into_iter().collect()
        };
        let stops = places.into_iter().map(|(place, again)| {
            let looks = again.map_or_else(|| sees(place), saw);
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
