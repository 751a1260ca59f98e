//! Best possible knowledge of the place of an object that walks straight and turns at once.
//!
//! The bound of Cramer and Rao for a state that changes with time (Van Trees: Detection, Estimation, and
//! Modulation Theory I, 1968, 2.4; Tichavsky, Muravchik, Nehorai: Posterior Cramer-Rao bounds for
//! discrete-time nonlinear filtering, 1998), for the true process of the walk and not for a tracker's model
//! of it. The bound's estimator knows what no tracker knows: which look shows which object, all cameras'
//! poses and the radius exactly, the object's speed, the times of its turns, and roughly the new directions.
//! Only the exact direction has to be seen then. More knowledge can only make errors smaller, so a tracker
//! can be better than the bound only by chance.

use std::{ops::RangeInclusive, time::Duration};

use calib_core::angle::wrap_signed;
use nalgebra::{Matrix3, Point2, RowVector3, Vector2};

/// Limit of a look's error, in sigmas: beyond it a part was hidden, or another object was seen.
const OUTLIER: f64 = 4.0;

/// Standard deviation with which the direction after a turn is told, radians: rather too small than too large,
/// because the bound needs a variance to begin with, and a uniform direction has none.
const TOLD: f64 = 0.5;

/// One look that showed an object.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// True place of the camera.
    pub camera: Point2<f64>,
    /// Direction in which it saw the object, by its true heading, radians. `None`: it saw an edge of a box
    /// around several. The object's place in the box is then told beforehand, so that no tracker knows more.
    pub direction: Option<f64>,
    /// Standard deviation of the direction, radians.
    pub sigma: f64,
    /// The radius of the object, if the tracker was told it: then the width of the look tells the range.
    pub radius: Option<f64>,
}

/// A straight way of an object.
#[derive(Clone, Copy, Debug)]
pub struct Leg {
    /// Time at which it begins.
    pub begin: Duration,
    /// Place where it begins.
    pub place: Point2<f64>,
    /// Velocity, units a second.
    pub velocity: Vector2<f64>,
}

impl Leg {
    fn place(&self, at: Duration) -> Point2<f64> {
        self.place + self.velocity * (at.as_secs_f64() - self.begin.as_secs_f64())
    }
}

/// The walk of one object and all looks at it.
#[derive(Clone, Debug, Default)]
pub(super) struct Bound {
    legs: Vec<Leg>,
    sights: Vec<(Duration, Sight)>,
}

impl Bound {
    pub(super) fn leg(&mut self, leg: Leg) {
        let stands = |leg: &Leg| leg.velocity == Vector2::zeros();
        if !(stands(&leg) && self.legs.last().is_some_and(stands)) {
            self.legs.push(leg);
        }
    }

    pub(super) fn look(&mut self, at: Duration, sight: Sight) {
        self.sights.push((at, sight));
    }

    /// Cameras that saw it in this time.
    pub(super) fn cameras(&self, time: RangeInclusive<Duration>) -> usize {
        let mut cameras: Vec<Point2<f64>> = Vec::new();
        // Looks come in the order in which they were told, a little out of the order of their times.
        let late = time.start().saturating_sub(Duration::from_secs(1));
        let recent = self.sights.iter().rev().take_while(|(at, _)| *at >= late);
        for (_, sight) in recent.filter(|(at, _)| time.contains(at)) {
            if !cameras.contains(&sight.camera) {
                cameras.push(sight.camera);
            }
        }
        cameras.len()
    }

    /// True place of the object.
    fn place(&self, at: Duration) -> Option<Point2<f64>> {
        let legs = &self.legs;
        let next = legs.partition_point(|leg| leg.begin <= at);
        let leg = legs.get(next.saturating_sub(1))?;
        Some(leg.place(at))
    }

    /// Squared error over variance of the looks' directions, summed, and the number of these looks.
    pub(super) fn noise(&self) -> (f64, usize) {
        let off = |(at, sight): &(Duration, Sight)| {
            let to = self.place(*at)? - sight.camera;
            let off = wrap_signed(to.y.atan2(to.x) - sight.direction?) / sight.sigma;
            (off.abs() < OUTLIER).then_some(off * off)
        };
        let squares: Vec<f64> = self.sights.iter().filter_map(off).collect();
        (squares.iter().sum(), squares.len())
    }

    /// The least expected squared distance from the truth at each of these times, if directions err by this share
    /// of their variances. It includes every look made by then, even if the coordinator had not heard of it.
    pub(super) fn squares(&self, times: &[Duration], noise: f64) -> Vec<f64> {
        let mut sights: Vec<_> = self.sights.iter().collect();
        sights.sort_by_key(|(at, _)| *at);
        let (mut sights, mut legs) = (sights.into_iter().peekable(), self.legs.iter().peekable());
        let Some(first) = legs.next() else {
            return Vec::new();
        };
        let mut known = Known::new(*first);
        let mut squares = Vec::new();
        for &time in times {
            loop {
                let sight = sights.peek().map(|(at, _)| *at).filter(|at| *at <= time);
                if let Some(leg) = legs.next_if(|leg| leg.begin <= sight.unwrap_or(time)) {
                    known.turn(*leg);
                } else if let Some((at, sight)) = sights.next_if(|(at, _)| *at <= time) {
                    known.look(*at, sight, noise);
                } else {
                    break;
                }
            }
            known.go_to(time);
            squares.push(known.covariance.fixed_view::<2, 2>(0, 0).trace());
        }
        squares
    }
}

/// Knowledge about place and direction of one leg.
struct Known {
    leg: Leg,
    at: Duration,
    covariance: Matrix3<f64>,
}

impl Known {
    /// Its beginning is known to a unit: looks soon tell more.
    fn new(leg: Leg) -> Self {
        Self {
            leg,
            at: leg.begin,
            covariance: Matrix3::from_diagonal(&[1.0, 1.0, TOLD * TOLD].into()),
        }
    }

    fn go_to(&mut self, at: Duration) {
        let seconds = at.saturating_sub(self.at).as_secs_f64();
        self.at = self.at.max(at);
        let mut step = Matrix3::identity();
        step[(0, 2)] = -self.leg.velocity.y * seconds;
        step[(1, 2)] = self.leg.velocity.x * seconds;
        self.covariance = step * self.covariance * step.transpose();
    }

    /// The direction of the next leg is independent of the former one.
    fn turn(&mut self, leg: Leg) {
        self.go_to(leg.begin);
        self.leg = leg;
        self.covariance.fill_row(2, 0.0);
        self.covariance.fill_column(2, 0.0);
        self.covariance[(2, 2)] = TOLD * TOLD;
    }

    fn look(&mut self, at: Duration, sight: &Sight, noise: f64) {
        self.go_to(at);
        let to = self.leg.place(self.at) - sight.camera;
        let distance = to.norm();
        let across = RowVector3::new(-to.y, to.x, 0.0) / (distance * distance);
        let variance = sight.sigma * sight.sigma * noise;
        self.measured(&across, variance);
        if let Some(radius) = sight.radius {
            // Both edges tell the direction and, as surely, half the width: r = d sin(half).
            let cotangent = ((distance / radius).powi(2) - 1.0).max(0.0).sqrt();
            let along = RowVector3::new(to.x, to.y, 0.0) / distance;
            self.measured(&along, variance * (distance * cotangent).powi(2));
        }
    }

    fn measured(&mut self, by_state: &RowVector3<f64>, variance: f64) {
        let with = self.covariance * by_state.transpose();
        let all = (by_state * with)[(0, 0)] + variance;
        self.covariance -= with * with.transpose() / all;
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::{Matrix2, Vector2};
    use rand::RngExt;
    use test_support::{Random, generator, normal};

    use super::*;

    const SIGMA: f64 = 0.005;
    const CAMERAS: [[f64; 2]; 3] = [[0.0, 0.0], [10.0, 0.0], [5.0, 10.0]];
    /// Directions from which an estimator that knows everything else has to choose.
    const DIRECTIONS: usize = 1_500;

    fn at(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    fn sight(camera: Point2<f64>, place: Point2<f64>, off: f64) -> Sight {
        let to = place - camera;
        Sight {
            camera,
            direction: Some(to.y.atan2(to.x) + off),
            sigma: SIGMA,
            radius: None,
        }
    }

    /// Two bearings of known sigma at a right angle: errors are the distances times that. With the width of a
    /// ball of 0.1 seen from 3 away, its range to 9 / 0.1 of that.
    #[test]
    fn what_stands_is_known_by_two_bearings_or_a_width() {
        let place = Point2::new(3.0, 4.0);
        let leg = Leg {
            begin: Duration::ZERO,
            place,
            velocity: Vector2::zeros(),
        };
        let mut bound = Bound::default();
        bound.leg(leg);
        for camera in [Point2::new(3.0, 0.0), Point2::new(0.0, 4.0)] {
            bound.look(at(1.0), sight(camera, place, SIGMA));
        }
        let expected = (SIGMA * 4.0).powi(2) + (SIGMA * 3.0).powi(2);
        let told = bound.squares(&[at(2.0)], 1.0)[0];
        assert!((told / expected - 1.0).abs() < 1e-3, "{told} {expected}");
        // The real error of the looks counts, and it is known from them.
        assert!((bound.squares(&[at(2.0)], 0.25)[0] / expected * 4.0 - 1.0).abs() < 1e-3);
        let (sum, count) = bound.noise();
        assert!((sum - 2.0).abs() < 1e-9 && count == 2, "{sum}");
        assert_eq!(bound.cameras(at(0.5)..=at(1.5)), 2);
        assert_eq!(bound.cameras(at(1.5)..=at(2.5)), 0);

        let mut bound = Bound::default();
        bound.leg(leg);
        let camera = Point2::new(0.0, 4.0);
        let radius = Some(0.1);
        let look = sight(camera, place, 0.0);
        bound.look(at(1.0), Sight { radius, ..look });
        let told = bound.squares(&[at(2.0)], 1.0)[0];
        let range = (SIGMA * 9.0 / 0.1_f64).powi(2);
        // The knowledge from before helps a little.
        let expected = (SIGMA * 3.0).powi(2) + range / (1.0 + range);
        assert!((told / expected - 1.0).abs() < 0.01, "{told} {expected}");
    }

    /// An estimator that knows all that the bound knows, and makes the best of it: the mean over all directions,
    /// each with the probability that the looks leave it.
    struct Best {
        places: Vec<Point2<f64>>,
        scores: Vec<f64>,
        covariance: Matrix2<f64>,
    }

    fn velocity(direction: usize, speed: f64) -> Vector2<f64> {
        let angle = direction as f64 / DIRECTIONS as f64 * 2.0 * PI;
        Vector2::new(angle.cos(), angle.sin()) * speed
    }

    impl Best {
        fn new(place: Point2<f64>, covariance: Matrix2<f64>) -> Self {
            Self {
                places: vec![place; DIRECTIONS],
                scores: vec![0.0; DIRECTIONS],
                covariance,
            }
        }

        fn go(&mut self, speed: f64, seconds: f64) {
            for (direction, place) in self.places.iter_mut().enumerate() {
                *place += velocity(direction, speed) * seconds;
            }
        }

        /// Directions change with the place as they do at the truth: so the problem is linear, and this the best.
        fn look(&mut self, sight: &Sight, truth: Point2<f64>) {
            let to = truth - sight.camera;
            let noise = wrap_signed(sight.direction.unwrap() - to.y.atan2(to.x));
            let across = Vector2::new(-to.y, to.x) / to.norm_squared();
            let with = self.covariance * across;
            let variance = across.dot(&with) + SIGMA * SIGMA;
            for (place, score) in self.places.iter_mut().zip(&mut self.scores) {
                let off = noise + across.dot(&(truth - *place));
                *place += with * (off / variance);
                *score += off * off / variance;
            }
            self.covariance -= with * with.transpose() / variance;
        }

        fn mean(&self) -> (Point2<f64>, Matrix2<f64>) {
            let least = self.scores.iter().copied().fold(f64::MAX, f64::min);
            let weights = self
                .scores
                .iter()
                .map(|score| (0.5 * (least - score)).exp());
            let weights: Vec<f64> = weights.collect();
            let all: f64 = weights.iter().sum();
            let parts = || self.places.iter().zip(&weights);
            let mean: Vector2<f64> = parts().map(|(p, w)| p.coords * (w / all)).sum();
            let spread: Matrix2<f64> = parts()
                .map(|(p, w)| (p.coords - mean) * (p.coords - mean).transpose() * (w / all))
                .sum();
            (mean.into(), self.covariance + spread)
        }
    }

    /// Squared errors of the best that can be done, and the bound, now and then on a walk that turns.
    fn walk(rng: &mut Random) -> Vec<(f64, f64)> {
        const SPEED: f64 = 0.8;
        let begin = Point2::new(5.0 + 0.5 * normal(rng), 4.0 + 0.5 * normal(rng));
        let believed = begin + Vector2::new(normal(rng), normal(rng));
        let mut best = Best::new(believed, Matrix2::identity());
        let mut bound = Bound::default();
        let mut leg = Leg {
            begin: Duration::ZERO,
            place: begin,
            velocity: Vector2::zeros(),
        };
        let (mut times, mut errors) = (Vec::new(), Vec::new());
        for n in 0..30_u32 {
            let now = at(f64::from(n) / 5.0);
            if n > 0 {
                best.go(SPEED, 0.2);
            }
            if n % 15 == 0 {
                let place = leg.place(now);
                leg = Leg {
                    begin: now,
                    place,
                    velocity: velocity(rng.random_range(0..DIRECTIONS), SPEED),
                };
                bound.leg(leg);
                let (place, covariance) = best.mean();
                best = Best::new(place, covariance);
            }
            let place = leg.place(now);
            let camera = CAMERAS[n as usize % 3].into();
            let seen = sight(camera, place, SIGMA * normal(rng));
            best.look(&seen, place);
            bound.look(now, seen);
            if n % 3 == 2 {
                times.push(now);
                errors.push((best.mean().0 - place).norm_squared());
            }
        }
        errors.into_iter().zip(bound.squares(&times, 1.0)).collect()
    }

    /// From both sides: an estimator that knows all that the bound knows, but not roughly the direction, is never
    /// below it, and two seconds after a turn as near to it as chance allows.
    #[test]
    fn the_best_that_can_be_done_meets_it() {
        let walks: Vec<_> = (0..600).map(|seed| walk(&mut generator(seed))).collect();
        for moment in 0..walks[0].len() {
            let sum = |of: fn(&(f64, f64)) -> f64| -> f64 {
                walks.iter().map(|walk| of(&walk[moment])).sum()
            };
            let ratio = sum(|m| m.0) / sum(|m| m.1);
            println!("{moment}: {ratio:.4}");
            let is_long_after = moment % 5 >= 3;
            let most = if is_long_after { 1.15 } else { f64::MAX };
            assert!((0.88..most).contains(&ratio), "{moment}: {ratio}");
        }
    }
}
