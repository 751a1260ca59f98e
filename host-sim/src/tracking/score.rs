//! How well objects are tracked, compared with the truth.

use std::{collections::BTreeMap, time::Duration};

use answers::record::Tracking;
use calib_core::tracking::Settings;
use nalgebra::{Matrix2, Matrix4, Point2, RowVector4, Vector2};
use node_firmware::console::TrackedObject;

/// A track within this of an object, metres, may be of it (Bernardin, Stiefelhagen: Evaluating multiple
/// object tracking performance, 2008).
const NEAR_METRES: f64 = 1.0;

/// A track that nobody saw for longer is carried on by its velocity alone. How far it is off is not counted then:
/// those that are far off are of no object any more, which would make the others look better than they are.
const UNSEEN_MS: u16 = 500;

/// What one object really was to one look: where the camera stood, and how sure the look was.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// Which object, of the places that [`Score::sample`] gets.
    pub object: usize,
    /// Where it really was.
    pub place: Point2<f64>,
    /// Where the camera really is.
    pub camera: Point2<f64>,
    /// Standard deviation of the direction, radians.
    pub sigma: f64,
}

/// A track, as it was told last.
#[derive(Clone, Copy, Debug)]
struct Track {
    at: Duration,
    position: Point2<f64>,
    velocity: Vector2<f64>,
    covariance: Matrix2<f64>,
}

/// What is known of one object if everything but it is: the information filter of the very looks that
/// showed it, from exact cameras and with known assignment, linearised at the truth. No unbiased estimate
/// of a walk with this agility is better (Tichavsky, Muravchik, Nehorai: Posterior Cramer-Rao bounds for
/// discrete-time nonlinear filtering, 1998).
#[derive(Clone, Debug)]
struct Bound {
    at: Option<Duration>,
    covariance: Matrix4<f64>,
}

#[derive(Clone, Debug)]
struct Truth {
    bound: Bound,
    track: Option<u16>,
    had: Option<u16>,
    was_seen: bool,
}

/// Counts while it goes on.
#[derive(Clone, Debug)]
pub struct Score {
    settings: Settings<f64>,
    near: f64,
    truths: Vec<Truth>,
    tracks: BTreeMap<u16, Track>,
    /// Of each track there ever was: which object it was last.
    of: BTreeMap<u16, Option<usize>>,
    looks: usize,
    samples: usize,
    matched: usize,
    told: usize,
    squared: f64,
    bound: f64,
    nees: f64,
    breaks: usize,
    swaps: usize,
}

impl Bound {
    fn go_to(&mut self, at: Duration, settings: &Settings<f64>) {
        let dt = (self.at).map_or(0.0, |last| at.saturating_sub(last).as_secs_f64());
        // A look may be told after a younger one.
        self.at = self.at.max(Some(at));
        let mut step = Matrix4::identity();
        (step[(0, 2)], step[(1, 3)]) = (dt, dt);
        let q = settings.agility;
        let mut noise = Matrix4::zeros();
        for axis in 0..2 {
            noise[(axis, axis)] = q * dt.powi(3) / 3.0;
            noise[(axis, axis + 2)] = q * dt * dt / 2.0;
            noise[(axis + 2, axis)] = q * dt * dt / 2.0;
            noise[(axis + 2, axis + 2)] = q * dt;
        }
        self.covariance = step * self.covariance * step.transpose() + noise;
    }

    fn look(&mut self, sight: &Sight) {
        let to = sight.place - sight.camera;
        let squared = to.norm_squared();
        let across = RowVector4::new(-to.y / squared, to.x / squared, 0.0, 0.0);
        let information = across.transpose() * across / (sight.sigma * sight.sigma);
        if let Some(before) = self.covariance.try_inverse()
            && let Some(after) = (before + information).try_inverse()
        {
            self.covariance = after;
        }
    }

    fn place(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(0, 0).into()
    }
}

impl Score {
    /// Of so many objects, in a unit of so many metres.
    pub fn new(objects: usize, settings: Settings<f64>, metres_per_unit: f64) -> Self {
        let speed = settings.speed_sigma * settings.speed_sigma;
        let place = (10.0 / metres_per_unit).powi(2);
        let begin = Matrix4::from_diagonal(&[place, place, speed, speed].into());
        let truth = Truth {
            bound: Bound {
                at: None,
                covariance: begin,
            },
            track: None,
            had: None,
            was_seen: false,
        };
        Self {
            settings,
            near: NEAR_METRES / metres_per_unit,
            truths: vec![truth; objects],
            tracks: BTreeMap::new(),
            of: BTreeMap::new(),
            looks: 0,
            samples: 0,
            matched: 0,
            told: 0,
            squared: 0.0,
            bound: 0.0,
            nees: 0.0,
            breaks: 0,
            swaps: 0,
        }
    }

    /// A look showed an object.
    pub fn look(&mut self, at: Duration, sight: &Sight) {
        self.looks += 1;
        self.look_before(at, sight);
    }

    /// The same before anything is counted: what it tells is known from then on.
    pub fn look_before(&mut self, at: Duration, sight: &Sight) {
        if let Some(truth) = self.truths.get_mut(sight.object) {
            truth.bound.go_to(at, &self.settings);
            truth.bound.look(sight);
        }
    }

    /// The coordinator told where an object is, or that it is gone; that is compared with where the objects really
    /// are, if it is known which one it is.
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
            truth.bound.go_to(at, &self.settings);
            let off = track.position - place;
            if let Some(inverse) = track.covariance.try_inverse() {
                self.told += 1;
                self.squared += off.norm_squared();
                self.bound += truth.bound.place().trace();
                self.nees += off.dot(&(inverse * off));
            }
        }
    }

    /// Finds out which track is of which object, to be called regularly; with each object, whether two cameras
    /// see it.
    pub fn sample(&mut self, at: Duration, places: &[Point2<f64>], are_seen: &[bool]) {
        let now = |track: &Track| {
            track.position + track.velocity * at.saturating_sub(track.at).as_secs_f64()
        };
        let mut free: Vec<_> = { self.tracks.iter() }
            .map(|(id, track)| (*id, now(track)))
            .collect();
        let mut open = Vec::new();
        let mut pairs = Vec::new();
        // What was of an object remains so while it is near.
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
        // The nearest first.
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
            self.samples += usize::from(*is_seen);
        }
        for (number, id) in pairs {
            let truth = &mut self.truths[number];
            let of = self.of.entry(id).or_default();
            let was_another = of.is_some_and(|of| of != number);
            self.swaps += usize::from(was_another);
            self.breaks += usize::from(!was_another && truth.had.is_some_and(|had| had != id));
            *of = Some(number);
            (truth.track, truth.had) = (Some(id), Some(id));
            self.matched += usize::from(are_seen[number]);
        }
    }

    /// Which object a track is of now.
    pub fn object_of(&self, track: u16) -> Option<usize> {
        { self.truths.iter() }.position(|truth| truth.track == Some(track))
    }

    /// What came of so many seconds in a network.
    pub fn end(&self, network: u16, seconds: f64) -> Tracking {
        let mean = |sum: f64| (self.told > 0).then(|| sum / self.told as f64);
        Tracking {
            network,
            seconds,
            objects: self.truths.iter().filter(|truth| truth.was_seen).count(),
            looks: self.looks,
            covered: self.matched as f64 / self.samples.max(1) as f64,
            rms: mean(self.squared).map(f64::sqrt),
            bound: mean(self.bound).map(f64::sqrt),
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
        let mut score = Score::new(2, Settings::walking(), 1.0);
        let places = [Point2::new(0.0, 0.0), Point2::new(5.0, 0.0)];
        tell(&mut score, 1, &places, &[(1, [0.1, 0.0]), (2, [5.1, 0.0])]);
        // A ghost, and nothing of the second.
        score.told(seconds(2), 2, None, &places);
        tell(&mut score, 2, &places, &[(1, [0.1, 0.0]), (3, [9.0, 0.0])]);
        // The second under another number.
        tell(&mut score, 3, &places, &[(1, [0.1, 0.0]), (4, [4.9, 0.0])]);
        let told = score.end(1, 3.0);
        assert_eq!((told.breaks, told.swaps, told.ghosts), (1, 0, 1));
        assert!((told.covered - 5.0 / 6.0).abs() < 1e-12);
        // The first sample found out which is which: of these two was told since.
        assert!((told.rms.unwrap() - 0.1).abs() < 1e-6);
        assert!((told.nees.unwrap() - 1.0).abs() < 1e-5);
        // Both tracks go over to the other object.
        tell(&mut score, 4, &places, &[(4, [0.0, 0.0]), (1, [5.0, 0.0])]);
        assert_eq!(score.end(1, 4.0).swaps, 2);
    }

    /// Two bearings of known sigma at a right angle: the bound is their distance times that.
    #[test]
    fn the_bound_is_that_of_two_bearings() {
        let mut score = Score::new(1, Settings::walking(), 1.0);
        let place = Point2::new(3.0, 4.0);
        for camera in [Point2::new(3.0, 0.0), Point2::new(0.0, 4.0)] {
            let sight = Sight {
                object: 0,
                place,
                camera,
                sigma: 0.01,
            };
            score.look(seconds(1), &sight);
        }
        tell(&mut score, 1, &[place], &[(1, [3.0, 4.0])]);
        assert_eq!(
            score.end(1, 1.0).bound,
            None,
            "nobody knew whose track it is"
        );
        tell(&mut score, 1, &[place], &[(1, [3.0, 4.0])]);
        // 4 m and 3 m away.
        let expected = (0.04_f64.powi(2) + 0.03_f64.powi(2)).sqrt();
        assert!((score.end(1, 1.0).bound.unwrap() - expected).abs() < 1e-5);
    }
}
