//! Where the passes begin: closed forms, no guess.
//!
//! What the two references saw together gives their headings and the place of one stop
//! ([`reference`](crate::reference)); dead reckoning gives all other stops. Both solutions of a
//! pair of circles are tried where the reference solve cannot tell them apart.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{
    JointError, Prior,
    problem::{Common, Problem, Sight, Standing},
};
use crate::{
    Ray, Real, Refusal, angle,
    fit::{Fit, one_in_a_thousand},
    numerics::plane::quarter_turn,
    numerics::real::lit,
    reference::{self, Known, ReferenceSettings, ReferenceSolution, Stop},
};

/// Stops seen by both references that a start takes, at least: with two there are two answers.
pub(super) const LEAST: usize = 3;
/// And at most: more add nothing to a start.
const MOST: usize = 16;
/// Stops of a start when all together contradict each other: with fewer it would not show.
const WINDOW: usize = 5;
/// All stops.
const ALL: [u16; 2] = [0, u16::MAX];
/// A prior sigma of scale, or of the compass in radians, from which on a start does without: the
/// references' own sightings have to tell it.
const VAGUE: f64 = 0.3;

/// One answer of the reference solve.
#[derive(Clone, Copy)]
struct Start<T: Real> {
    headings: [T; 2],
    carrier: Vector2<T>,
    /// Where the target was at this stop.
    stop: usize,
    place: Point2<T>,
    /// Chi squared.
    cost: T,
}

impl<T: Real> Problem<'_, T> {
    /// Headings of the references, and places of all stops: from all that both references saw or, if
    /// that contradicts itself, from any few stops in a row that agree. What is wrong elsewhere is
    /// then found by those who look for it.
    ///
    /// # Errors
    /// [`JointError::Start`]: why the references' own sightings do not carry a start.
    #[inline(never)] // size
    pub(super) fn start(&mut self) -> Result<(), JointError> {
        for camera in self.cameras.iter_mut() {
            camera.column = None;
        }
        let mut started = self.start_within(ALL);
        if let Err(Refusal::Inconsistent | Refusal::DidNotConverge) = started {
            for first in 0..self.stops.len() {
                let Some(window) = self.window(first) else {
                    continue;
                };
                if self.start_within(window).is_ok() {
                    started = Ok(());
                    break;
                }
            }
        }
        self.common.window = ALL;
        for mark in 0..self.marks.len() {
            self.find_mark(mark);
        }
        started.map_err(JointError::Start)
    }

    /// A few common stops in a row from one on; `None` if it is none, or there are too few.
    fn window(&self, first: usize) -> Option<[u16; 2]> {
        let is_common =
            |&stop: &usize| self.seen_by(stop, 0).is_some() && self.seen_by(stop, 1).is_some();
        let mut common = (first..self.stops.len()).filter(is_common);
        let begins = common.next() == Some(first);
        let last = common.nth(WINDOW - 2).filter(|_| begins)?;
        Some([u16::try_from(first).ok()?, u16::try_from(last).ok()?])
    }

    fn start_within(&mut self, window: [u16; 2]) -> Result<(), Refusal> {
        self.common.window = window;
        let Common {
            baseline,
            scale_prior,
            compass_prior,
            ..
        } = *self.common;
        let is_known = |prior: Prior<T>| prior.sigma < lit(VAGUE);
        // A carrier far off its priors has its own sightings against it: they tell scale and
        // compass too.
        let mut failure = None;
        for [takes_scale, takes_compass] in [[true, true], [false, true], [true, false], [false; 2]]
        {
            if (takes_scale && !is_known(scale_prior))
                || (takes_compass && !is_known(compass_prior))
            {
                continue;
            }
            match self.start_from(&Known {
                baseline: takes_scale.then_some(baseline),
                frame_heading: takes_compass.then_some(T::zero()),
            }) {
                Ok(()) => return Ok(()),
                // The reason that holds for what is known.
                Err(why) => failure = failure.or(Some(why)),
            }
        }
        Err(failure.unwrap_or(Refusal::TooFew))
    }

    fn start_from(&mut self, known: &Known<T>) -> Result<(), Refusal> {
        self.forget_carrier();
        let (mut best, alternative) = self.proposals(known)?;
        best.cost = self.try_out(&best)?;
        if let Some(other) = alternative
            && let Ok(cost) = self.try_out(&other)
        {
            // The better one may not be the one that the reference solve took for it, which does
            // not know how legs add up.
            if (cost - best.cost).abs() < one_in_a_thousand(1) {
                return Err(Refusal::Undetermined);
            }
            if cost < best.cost {
                best = Start { cost, ..other };
            }
            self.try_out(&best)?;
        }
        let fit = Fit {
            chi_squared: best.cost,
            degrees_of_freedom: self.redundancy(),
        };
        if fit.is_bad() {
            return Err(Refusal::Inconsistent);
        }
        Ok(())
    }

    fn forget_carrier(&mut self) {
        let common = &mut *self.common;
        common.carrier = Vector2::new(common.scale_prior.mean, common.compass_prior.mean);
    }

    /// Passes over the references' bearings alone. Tells chi squared.
    fn try_out(&mut self, start: &Start<T>) -> Result<T, Refusal> {
        self.common.carrier = start.carrier;
        for (camera, heading) in self.cameras.iter_mut().zip(start.headings) {
            camera.value.z = heading;
        }
        self.reckon(start.stop, start.place);
        let (cost, _) = self.converge()?;
        // In front of both, or it is the wrong one of two solutions.
        let quarter = T::frac_pi_2();
        let behind = |sight: &Sight<T>| {
            let row = self.sight_row(sight);
            row.is_some_and(|row| !((row.residual * sight.sigma).abs() < quarter))
        };
        if self
            .sights
            .iter()
            .filter(|s| s.standing == Standing::Counts)
            .any(behind)
        {
            return Err(Refusal::TargetBehind);
        }
        Ok(cost)
    }

    /// All stops by dead reckoning from one.
    fn reckon(&mut self, from: usize, place: Point2<T>) {
        let mut at = place;
        for stop in from..self.stops.len() {
            if stop > from {
                at += self.way_to(stop);
            }
            self.put(stop, at);
        }
        at = place;
        for stop in (0..from).rev() {
            at -= self.way_to(stop + 1);
            self.put(stop, at);
        }
    }

    /// The place of a new stop, by dead reckoning from the one before.
    pub(super) fn reckon_on(&mut self, stop: usize) {
        let before = stop
            .checked_sub(1)
            .and_then(|before| self.stops.get(before));
        if let Some(place) = before.map(|before| before.place) {
            let at = place + self.way_to(stop);
            self.put(stop, at);
        }
    }

    /// Puts a mark where it was visited first.
    pub(super) fn find_mark(&mut self, mark: usize) {
        let visit = { self.visits.iter() }.find(|visit| usize::from(visit.mark) == mark);
        let stop = visit.and_then(|visit| self.stops.get(usize::from(visit.stop)));
        if let (Some(stop), Some(mark)) = (stop, self.marks.get_mut(mark)) {
            (mark.value.x, mark.value.y) = (stop.place.x, stop.place.y);
        }
    }

    fn way_to(&self, stop: usize) -> Vector2<T> {
        let stop = self.stops.get(stop);
        stop.map_or_else(Vector2::zeros, |stop| self.true_way(stop.displacement))
    }

    fn put(&mut self, stop: usize, place: Point2<T>) {
        if let Some(stop) = self.stops.get_mut(stop) {
            stop.place = place;
        }
    }

    /// What the reference solve says: its best answer, and the one it cannot tell from it.
    #[inline(never)] // stack
    fn proposals(&self, known: &Known<T>) -> Result<(Start<T>, Option<Start<T>>), Refusal> {
        let (mut stops, mut count, mut first) = ([Self::nowhere(); MOST], 0, 0);
        let mut since = Self::nowhere();
        for number in 0..self.stops.len() {
            let connected = self.add_leg(number, &mut since);
            if !connected && count > 0 {
                if count >= LEAST {
                    break;
                }
                count = 0;
            }
            let (Some(own), Some(other)) = (self.seen_by(number, 0), self.seen_by(number, 1))
            else {
                continue;
            };
            let Some(stop) = stops.get_mut(count) else {
                break;
            };
            *stop = Stop {
                rays: [own, other].map(|(bearing, _)| Ray::from_bearing(bearing)),
                bearing_sigmas: [own, other].map(|(_, sigma)| sigma),
                ..since
            };
            if count == 0 {
                first = number;
            }
            since = Self::nowhere();
            count += 1;
        }
        let stops = { stops.get(..count) }
            .filter(|stops| stops.len() >= LEAST)
            .ok_or(Refusal::TooFew)?;
        let Common {
            baseline,
            scale_prior,
            compass_prior,
            ..
        } = *self.common;
        let outcome = reference::solve(stops, known, &ReferenceSettings::default())?;
        let start = |solution: &ReferenceSolution<T>| {
            // The baseline as the carrier would measure it, over its length.
            let stretch = solution.baseline / baseline;
            Start {
                headings: solution.headings,
                carrier: Vector2::new(
                    scale_prior.mean * stretch,
                    angle::wrap_signed(compass_prior.mean - solution.frame_heading),
                ),
                stop: first,
                place: solution.first_stop / stretch,
                cost: solution.chi_squared,
            }
        };
        let alternative = outcome.alternative.as_ref().map(start);
        Ok((start(&outcome.best), alternative))
    }

    fn nowhere() -> Stop<T> {
        Stop {
            rays: [Ray::from_bearing(T::zero()); 2],
            bearing_sigmas: [T::one(); 2],
            displacement: Vector2::zeros(),
            displacement_covariance: Matrix2::zeros(),
        }
    }

    /// Adds the leg to a stop, with what is not known of the carrier; whether there is one.
    fn add_leg(&self, number: usize, since: &mut Stop<T>) -> bool {
        let Some(stop) = self.stops.get(number).filter(|_| number > 0) else {
            return false;
        };
        let [w11, w21, w22] = stop.root;
        if !(w11 > T::zero()) {
            *since = Self::nowhere();
            return false;
        }
        let scale = self.common.scale_prior;
        let columns = [
            Vector2::new(w11.recip(), -w21 / (w11 * w22)),
            Vector2::new(T::zero(), w22.recip()),
            stop.displacement * (scale.sigma.min(lit(VAGUE)) / scale.mean),
            quarter_turn(stop.displacement) * self.common.compass_prior.sigma.min(lit(VAGUE)),
        ];
        for column in columns {
            let turned = self.true_way(column);
            since.displacement_covariance += turned * turned.transpose();
        }
        since.displacement += self.true_way(stop.displacement);
        true
    }

    fn seen_by(&self, stop: usize, camera: usize) -> Option<(T, T)> {
        let [first, last] = self.common.window;
        let sight = self.sights.iter().find(|sight| {
            usize::from(sight.stop) == stop
                && usize::from(sight.camera) == camera
                && (first..=last).contains(&sight.stop)
                && sight.standing == Standing::Counts
        })?;
        Some((sight.bearing, sight.sigma))
    }
}
