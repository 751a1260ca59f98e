//! Quality of tracking, compared with the truth.

use std::{collections::BTreeMap, time::Duration};

use nalgebra::{Matrix2, Point2, Vector2};
use node_firmware::console::TrackedObject;
use results::record::Tracking;

use super::bound::{Bound, Leg, Sight};

/// A track within this of an object, metres, may be of it (Bernardin, Stiefelhagen: Evaluating multiple
/// object tracking performance, 2008).
const NEAR_METRES: f64 = 1.0;

/// Factor of this distance beyond which a track that is of no object has lost it.
const FAR: f64 = 3.0;

/// Longest time without a look for which a track's error is counted. Then its velocity alone carries it on.
/// Of such tracks only the near ones are still of an object: to count these would give too small errors.
const UNSEEN_MS: u16 = 500;

/// Cameras that told of an object within this time see it.
const RECENT: Duration = Duration::from_secs(1);

/// A track as it was last told.
#[derive(Clone, Copy, Debug)]
struct Track {
    at: Duration,
    position: Point2<f64>,
    velocity: Vector2<f64>,
    covariance: Matrix2<f64>,
}

/// Reason why an object that two cameras have in view has no track.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lack {
    /// No camera told its direction in the last second.
    Untold,
    /// Only one camera told it.
    OneTold,
    /// There is a track of no object within three metres.
    FarOff,
    /// Two cameras told it, and need longer to tell it from a crossing of two rays.
    TwoTold,
    /// More cameras told it.
    MoreTold,
}

/// An object got another track than it had.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Time since it was last near the former one.
    pub after: Duration,
    /// The former one was still told.
    pub beside: bool,
}

/// Reasons why tracking was not perfect.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Causes {
    /// Moments without a track in view of two cameras, of [`Causes::moments`].
    pub lacks: BTreeMap<Lack, usize>,
    /// Moments of objects in view of two cameras.
    pub moments: usize,
    /// Changes of number.
    pub changes: Vec<Change>,
    /// Squared error over variance of the looks' directions: 1 if cameras know how sure they are.
    pub noise: f64,
}

#[derive(Clone, Debug, Default)]
struct Truth {
    bound: Bound,
    /// Times at which a track of it was told.
    told: Vec<Duration>,
    track: Option<u16>,
    /// Its last track, and the time of that.
    had: Option<(u16, Duration)>,
    was_seen: bool,
}

/// Counts while it goes on.
#[derive(Clone, Debug)]
pub struct Score {
    near: f64,
    truths: Vec<Truth>,
    tracks: BTreeMap<u16, Track>,
    /// The last object of each track that ever was.
    of: BTreeMap<u16, Option<usize>>,
    looks: usize,
    matched: usize,
    squared: f64,
    nees: f64,
    breaks: usize,
    swaps: usize,
    causes: Causes,
}

impl Score {
    /// A score for so many objects, in a unit of so many metres.
    pub fn new(objects: usize, metres_per_unit: f64) -> Self {
        Self {
            near: NEAR_METRES / metres_per_unit,
            truths: vec![Truth::default(); objects],
            tracks: BTreeMap::new(),
            of: BTreeMap::new(),
            looks: 0,
            matched: 0,
            squared: 0.0,
            nees: 0.0,
            breaks: 0,
            swaps: 0,
            causes: Causes::default(),
        }
    }

    /// Begins a leg of an object.
    pub fn leg(&mut self, object: usize, leg: Leg) {
        if let Some(truth) = self.truths.get_mut(object) {
            truth.bound.leg(leg);
        }
    }

    /// Takes in a look that showed an object.
    pub fn look(&mut self, at: Duration, object: usize, sight: Sight) {
        self.looks += usize::from(sight.direction.is_some());
        self.look_before(at, object, sight);
    }

    /// The same before anything is counted: the bound knows this look from then on.
    pub fn look_before(&mut self, at: Duration, object: usize, sight: Sight) {
        if let Some(truth) = self.truths.get_mut(object) {
            truth.bound.look(at, sight);
        }
    }

    /// The coordinator told where an object is, or that it is gone. That is compared with the true places,
    /// if it is known which object it is.
    pub fn told(
        &mut self,
        at: Duration,
        id: u16,
        object: Option<&TrackedObject>,
        places: &[Point2<f64>],
    ) {
        let Some(object) = object else {
            self.tracks.remove(&id);
            return;
        };
        let (place, [xx, xy, yy]) = object.place;
        let track = Track {
            at,
            position: place.map(f64::from).into(),
            velocity: object.velocity.map(f64::from).into(),
            covariance: Matrix2::new(xx, xy, xy, yy).map(f64::from),
        };
        self.tracks.insert(id, track);
        self.of.entry(id).or_default();
        if object.unseen_ms > UNSEEN_MS {
            return;
        }
        let held = self.truths.iter_mut().zip(places);
        for (truth, place) in held.filter(|(truth, _)| truth.track == Some(id)) {
            let off = track.position - place;
            if let Some(inverse) = track.covariance.try_inverse() {
                truth.told.push(at);
                self.squared += off.norm_squared();
                self.nees += off.dot(&(inverse * off));
            }
        }
    }

    /// Finds out which track is of which object, to be called regularly; `are_seen` tells of each object
    /// whether two cameras see it.
    pub fn sample(&mut self, at: Duration, places: &[Point2<f64>], are_seen: &[bool]) {
        let now = |track: &Track| {
            track.position + track.velocity * at.saturating_sub(track.at).as_secs_f64()
        };
        let mut free: Vec<_> = { self.tracks.iter() }
            .map(|(id, track)| (*id, now(track)))
            .collect();
        let mut open = Vec::new();
        let mut pairs = Vec::new();
        // A track stays with its object while it is near.
        for (number, place) in places.iter().enumerate() {
            let held = self.truths[number].track;
            let is_same = |(id, track): &(u16, Point2<f64>)| {
                Some(*id) == held && (track - place).norm() < self.near
            };
            match free.iter().position(is_same) {
                Some(at) => pairs.push((number, free.remove(at).0)),
                None => open.push(number),
            }
        }
        // The nearest pair first.
        while let Some((_, number, track)) = open
            .iter()
            .flat_map(|&number| (0..free.len()).map(move |track| (number, track)))
            .map(|(number, track)| ((free[track].1 - places[number]).norm(), number, track))
            .filter(|(off, ..)| *off < self.near)
            .min_by(|a, b| a.0.total_cmp(&b.0))
        {
            pairs.push((number, free.remove(track).0));
            open.retain(|&other| other != number);
        }
        for (truth, is_seen) in self.truths.iter_mut().zip(are_seen) {
            truth.track = None;
            truth.was_seen |= is_seen;
            self.causes.moments += usize::from(*is_seen);
        }
        for (number, id) in pairs {
            self.pair(at, number, id);
            self.matched += usize::from(are_seen[number]);
        }
        for number in open.into_iter().filter(|&number| are_seen[number]) {
            let is_far =
                { free.iter() }.any(|(_, track)| (track - places[number]).norm() < FAR * self.near);
            let recent = at.saturating_sub(RECENT)..=at;
            let lack = match self.truths[number].bound.cameras(recent) {
                _ if is_far => Lack::FarOff,
                0 => Lack::Untold,
                1 => Lack::OneTold,
                2 => Lack::TwoTold,
                _ => Lack::MoreTold,
            };
            *self.causes.lacks.entry(lack).or_default() += 1;
        }
    }

    /// Notes that a track is of an object.
    fn pair(&mut self, at: Duration, number: usize, id: u16) {
        let truth = &mut self.truths[number];
        let of = self.of.entry(id).or_default();
        let was_another = of.is_some_and(|of| of != number);
        self.swaps += usize::from(was_another);
        if !was_another
            && let Some((had, last)) = truth.had
            && had != id
        {
            self.breaks += 1;
            self.causes.changes.push(Change {
                after: at.saturating_sub(last),
                beside: self.tracks.contains_key(&had),
            });
        }
        *of = Some(number);
        (truth.track, truth.had) = (Some(id), Some((id, at)));
    }

    /// The object that a track is of now.
    pub fn object_of(&self, track: u16) -> Option<usize> {
        { self.truths.iter() }.position(|truth| truth.track == Some(track))
    }

    /// Squared error over variance of the looks' directions.
    fn noise(&self) -> f64 {
        let all = self.truths.iter().map(|truth| truth.bound.noise());
        let (sum, count) = all.fold((0.0, 0), |(sum, count), own| (sum + own.0, count + own.1));
        sum / count as f64
    }

    /// The reasons why tracking was not perfect.
    pub fn causes(&self) -> Causes {
        Causes {
            noise: self.noise(),
            ..self.causes.clone()
        }
    }

    /// Result of so many seconds in a network.
    pub fn end(&self, network: u16, seconds: f64) -> Tracking {
        // Cameras whose sigmas are too large cannot make the bound larger.
        let noise = self.noise().min(1.0);
        let squares = self
            .truths
            .iter()
            .flat_map(|t| t.bound.squares(&t.told, noise));
        let squares: Vec<f64> = squares.collect();
        let told = squares.len();
        let mean = |sum: f64| (told > 0).then(|| sum / told as f64);
        Tracking {
            network,
            seconds,
            objects: self.truths.iter().filter(|truth| truth.was_seen).count(),
            looks: self.looks,
            covered: self.matched as f64 / self.causes.moments.max(1) as f64,
            rms: mean(self.squared).map(f64::sqrt),
            bound: mean(squares.iter().sum()).map(f64::sqrt),
            nees: mean(self.nees),
            breaks: self.breaks,
            swaps: self.swaps,
            ghosts: self.of.values().filter(|of| of.is_none()).count(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(at: u64) -> Duration {
        Duration::from_secs(at)
    }

    fn standing(place: Point2<f64>) -> Leg {
        Leg {
            begin: Duration::ZERO,
            place,
            velocity: Vector2::zeros(),
        }
    }

    fn tell(score: &mut Score, at: u64, places: &[Point2<f64>], tracks: &[(u16, [f32; 2])]) {
        for &(id, place) in tracks {
            let object = TrackedObject {
                place: (place, [0.01, 0.0, 0.01]),
                velocity: [0.0; 2],
                unseen_ms: 0,
            };
            score.told(seconds(at), id, Some(&object), places);
        }
        score.sample(seconds(at), places, &vec![true; places.len()]);
    }

    #[test]
    fn breaks_swaps_and_ghosts_are_told_apart() {
        let mut score = Score::new(2, 1.0);
        let places = [Point2::new(0.0, 0.0), Point2::new(5.0, 0.0)];
        for (object, place) in places.into_iter().enumerate() {
            score.leg(object, standing(place));
        }
        tell(&mut score, 1, &places, &[(1, [0.1, 0.0]), (2, [5.1, 0.0])]);
        // A ghost, and nothing of the second.
        score.told(seconds(2), 2, None, &places);
        tell(&mut score, 2, &places, &[(1, [0.1, 0.0]), (3, [9.0, 0.0])]);
        // The second under another number.
        tell(&mut score, 3, &places, &[(1, [0.1, 0.0]), (4, [4.9, 0.0])]);
        let told = score.end(1, 3.0);
        assert_eq!((told.breaks, told.swaps, told.ghosts), (1, 0, 1));
        assert!((told.covered - 5.0 / 6.0).abs() < 1e-12);
        // The first sample found out which track is which: only messages since then count.
        assert!((told.rms.unwrap() - 0.1).abs() < 1e-6);
        assert!((told.nees.unwrap() - 1.0).abs() < 1e-5);
        // Both tracks go over to the other object.
        tell(&mut score, 4, &places, &[(4, [0.0, 0.0]), (1, [5.0, 0.0])]);
        assert_eq!(score.end(1, 4.0).swaps, 2);
    }
}
