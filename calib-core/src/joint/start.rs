//! Start of the passes: by closed forms, without a guess.
//!
//! Sightings by both references together give their headings and the place of one stop
//! ([`reference`](crate::reference)). All other stops are placed from there (`placing`). Both solutions
//! of a pair of circles are tried where the reference solve cannot tell them apart.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{
    Prior,
    descent::Descent,
    problem::{Problem, Sight, Standing},
};
use crate::{
    Ray, Real, Refusal, angle,
    fit::{Fit, one_in_a_thousand},
    numerics::plane::quarter_turn,
    numerics::real::lit,
    reference::{Found, Known, ReferenceSettings, Search, Stop},
};

/// Least number of stops that both references saw: with two there are two answers.
pub(super) const LEAST: usize = 3;
/// Most of these that a start takes: more add nothing, and the work grows with their third power.
const MOST: usize = 12;
/// The same where the direction of the steps or the baseline is sought too, in many directions.
const MOST_OF_UNKNOWN: usize = 8;
/// Stops of a start if all together contradict each other: fewer would not show it.
const WINDOW: usize = 5;
/// All stops.
const ALL: [u16; 2] = [0, u16::MAX];
/// Prior sigma of the scale, or of the compass in radians, from which on a start does not use the prior: the sightings
/// of the references have to tell the value.
const VAGUE: f64 = 0.3;
/// Error of a prior in its sigmas beyond which it is contradicted.
const CLAIMED: f64 = 4.42;

/// One answer of the reference solve.
#[derive(Clone, Copy, Debug)]
struct Start<T: Real> {
    headings: [T; 2],
    baseline: T,
    carrier: Vector2<T>,
    /// Place of the target at this stop.
    stop: usize,
    place: Point2<T>,
    /// Chi squared.
    cost: T,
}

/// A start under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Starting<T: Real> {
    /// First of the stops that are tried alone. `None` while all are tried together.
    window: Option<usize>,
    /// A few stops at a time are tried, too.
    in_parts: bool,
    /// The one of [`TAKEN`] that is tried.
    taken: usize,
    trial: Trial<T>,
    best: Start<T>,
    other: Option<Start<T>>,
    descent: Descent<T>,
    /// Sigmas of scale and compass as they were told.
    told: [T; 2],
    /// Reason why these stops give no start, for the first of [`TAKEN`].
    failure: Option<Refusal>,
    /// Reason why all stops together give none.
    why: Refusal,
}

#[derive(Clone, Copy, Debug)]
enum Trial<T: Real> {
    /// A reference solve is next.
    Proposing,
    /// A reference solve is under way, with these known.
    Searching(Known<T>, Search<T>),
    Best,
    Other,
    /// The better of both once more.
    Better,
}

/// Use of the priors for scale and compass, in the order of the trials. If the carrier errs far more than told, the
/// sightings have to tell scale and compass.
const TAKEN: [[bool; 2]; 4] = [[true, true], [false, true], [true, false], [false; 2]];

impl<T: Real> Problem<'_, T> {
    /// Headings of the references, and places of all stops: from all common sightings of both references or,
    /// if these contradict each other, from any few stops in a row that agree. Faults elsewhere are then
    /// found by the search for contradictions.
    pub(super) fn begin_starting(&mut self, in_parts: bool) -> Starting<T> {
        for camera in self.cameras.iter_mut() {
            camera.takes_part = false;
        }
        self.common.window = ALL;
        Starting {
            window: None,
            in_parts,
            taken: 0,
            trial: Trial::Proposing,
            best: Start {
                headings: [T::zero(); 2],
                baseline: self.common.baseline,
                carrier: Vector2::zeros(),
                stop: 0,
                place: Point2::origin(),
                cost: T::zero(),
            },
            other: None,
            descent: Descent::new(),
            told: [
                self.common.scale_prior.sigma,
                self.common.compass_prior.sigma,
            ],
            failure: None,
            why: Refusal::TooFew,
        }
    }

    /// A slice of a reference solve, or one pass over the references' bearings.
    ///
    /// # Errors
    /// The reason why the references' own sightings do not carry a start.
    pub(super) fn step_start(&mut self, starting: &mut Starting<T>) -> Option<Result<(), Refusal>> {
        match self.step_trial(starting)? {
            Ok(()) => {
                self.end_start();
                Some(Ok(()))
            }
            Err(why) => {
                // The reason of the first trial, with both priors.
                starting.failure = starting.failure.or(Some(why));
                starting.trial = Trial::Proposing;
                starting.taken += 1;
                if starting.taken < TAKEN.len() {
                    return None;
                }
                self.next_window(starting)
            }
        }
    }

    fn next_window(&mut self, starting: &mut Starting<T>) -> Option<Result<(), Refusal>> {
        let failure = starting.failure.take().unwrap_or(Refusal::TooFew);
        let from = match starting.window {
            Some(before) => before + 1,
            None => {
                starting.why = failure;
                let contradicts = [Refusal::Inconsistent, Refusal::DidNotConverge];
                if starting.in_parts && contradicts.contains(&failure) {
                    0
                } else {
                    self.stops.len()
                }
            }
        };
        starting.taken = 0;
        for first in from..self.stops.len() {
            if let Some(window) = self.window(first) {
                self.common.window = window;
                starting.window = Some(first);
                return None;
            }
        }
        self.restore_priors(starting);
        self.end_start();
        Some(Err(starting.why))
    }

    fn end_start(&mut self) {
        self.common.window = ALL;
        for mark in 0..self.marks.len() {
            self.find_mark(mark);
        }
    }

    fn step_trial(&mut self, starting: &mut Starting<T>) -> Option<Result<(), Refusal>> {
        match &mut starting.trial {
            Trial::Proposing => {
                let known = self.begin_search(starting);
                starting.trial = Trial::Searching(known, Search::new());
            }
            Trial::Searching(..) => return self.step_search(starting).map(Err),
            Trial::Best | Trial::Other | Trial::Better => {
                return self.step_descents(starting);
            }
        }
        self.step_search(starting).map(Err)
    }

    /// Does one pass over the references' bearings.
    fn step_descents(&mut self, starting: &mut Starting<T>) -> Option<Result<(), Refusal>> {
        let tried = self.step_descent(&mut starting.descent)?;
        let Starting { best, other, .. } = starting;
        match (&starting.trial, tried, *other) {
            (Trial::Best, Ok(cost), Some(other)) => {
                best.cost = cost;
                starting.trial = Trial::Other;
                self.begin_descent(&other, &mut starting.descent);
                return None;
            }
            (Trial::Other, tried, Some(other)) => {
                // The reference solve may take the wrong one for the better: it does not know how the errors of legs
                // add up.
                if let Ok(cost) = tried {
                    if (cost - best.cost).abs() < one_in_a_thousand(1) {
                        return Some(Err(Refusal::Undetermined));
                    }
                    if cost < best.cost {
                        *best = other;
                    }
                }
                starting.trial = Trial::Better;
                self.begin_descent(best, &mut starting.descent);
                return None;
            }
            (_, Ok(cost), _) => best.cost = cost,
            (_, Err(why), _) => return Some(Err(why)),
        }
        let fit = Fit {
            chi_squared: best.cost,
            degrees_of_freedom: self.redundancy(),
        };
        Some(if fit.is_bad() {
            Err(Refusal::Inconsistent)
        } else {
            Ok(())
        })
    }

    fn restore_priors(&mut self, starting: &Starting<T>) {
        let [scale, compass] = starting.told;
        self.common.scale_prior.sigma = scale;
        self.common.compass_prior.sigma = compass;
    }

    /// Begins a reference solve with the next priors that are known well enough. Returns the known ones.
    fn begin_search(&mut self, starting: &mut Starting<T>) -> Known<T> {
        self.restore_priors(starting);
        let common = &mut *self.common;
        let (scale, compass) = (common.scale_prior, common.compass_prior);
        let is_known = |prior: Prior<T>| prior.sigma < lit(VAGUE);
        let [mut takes_scale, mut takes_compass] = [false; 2];
        while let Some(taken) = TAKEN.get(starting.taken) {
            [takes_scale, takes_compass] = *taken;
            if (!takes_scale || is_known(scale) && common.is_baseline_known)
                && (!takes_compass || is_known(compass))
            {
                break;
            }
            starting.taken += 1;
        }
        common.carrier = Vector2::new(scale.mean, compass.mean);
        Known {
            baseline: takes_scale.then_some(common.baseline),
            frame_heading: takes_compass.then_some(T::zero()),
        }
    }

    /// Does a slice of a reference solve. At its end the passes from its answers begin.
    ///
    /// Returns the reason why there is no answer.
    fn step_search(&mut self, starting: &mut Starting<T>) -> Option<Refusal> {
        let Trial::Searching(known, search) = &mut starting.trial else {
            return None;
        };
        let first = match self.search(known, search)? {
            Ok(first) => first,
            Err(why) => return Some(why),
        };
        let (best, other) = search.best()?;
        let best = self.start_of(first, best);
        let other = other.map(|other| self.start_of(first, other));
        // A prior that the sightings contradict is dropped: then they tell the value.
        let common = &mut *self.common;
        for (prior, value, is_taken) in [
            (
                &mut common.scale_prior,
                best.carrier.x,
                known.baseline.is_some() || !common.is_baseline_known,
            ),
            (
                &mut common.compass_prior,
                best.carrier.y,
                known.frame_heading.is_some(),
            ),
        ] {
            let off = angle::wrap_signed(value - prior.mean).abs();
            if !is_taken && off > prior.sigma * lit(CLAIMED) {
                prior.sigma = off;
            }
        }
        (starting.best, starting.other) = (best, other);
        starting.trial = Trial::Best;
        self.begin_descent(&best, &mut starting.descent);
        None
    }

    fn begin_descent(&mut self, start: &Start<T>, descent: &mut Descent<T>) {
        self.common.carrier = start.carrier;
        for (camera, heading) in self.cameras.iter_mut().zip(start.headings) {
            camera.turn(heading);
            camera.trust_lens();
        }
        if let Some(second) = self.cameras.get_mut(1) {
            second.put(Vector2::new(start.baseline, T::zero()));
        }
        self.place_from(start.stop, start.place);
        *descent = Descent::new();
    }

    /// Does a pass over the bearings of the references alone. Returns chi squared at the end.
    fn step_descent(&mut self, descent: &mut Descent<T>) -> Option<Result<T, Refusal>> {
        let descended = self.descend(descent)?;
        // The target has to be in front of both. Otherwise it is the wrong one of two solutions.
        let quarter = T::frac_pi_2();
        let behind = |sight: &Sight<T>| {
            let row = self.sight_row(sight);
            sight.is_bearing()
                && row.is_some_and(|row| !((row.residual * sight.sigma).abs() < quarter))
        };
        let mut counting = { self.sights.iter() }.filter(|s| s.standing == Standing::Counts);
        if descended.is_ok() && counting.any(behind) {
            return Some(Err(Refusal::TargetBehind));
        }
        Some(descended)
    }

    /// Returns a few common stops in a row from this one on. `None` if it is no common stop, or there are too few.
    fn window(&self, first: usize) -> Option<[u16; 2]> {
        let is_common =
            |&stop: &usize| self.seen_by(stop, 0).is_some() && self.seen_by(stop, 1).is_some();
        let mut common = (first..self.stops.len()).filter(is_common);
        let begins = common.next() == Some(first);
        let last = common.nth(WINDOW - 2).filter(|_| begins)?;
        Some([u16::try_from(first).ok()?, u16::try_from(last).ok()?])
    }

    /// Does a slice of a reference solve. Returns the number of its first stop at its end.
    #[inline(never)] // for less stack
    fn search(&self, known: &Known<T>, search: &mut Search<T>) -> Option<Result<usize, Refusal>> {
        let mut stops = [Self::nowhere(); MOST];
        let is_known = known.baseline.is_some() && known.frame_heading.is_some();
        let most = if is_known { MOST } else { MOST_OF_UNKNOWN };
        let (first, count) = self.common_stops(stops.get_mut(..most)?);
        let stops = stops.get(..count).filter(|stops| stops.len() >= LEAST);
        let Some(stops) = stops else {
            return Some(Err(Refusal::TooFew));
        };
        let searched = search.step(stops, known, ReferenceSettings::default())?;
        Some(searched.map(|()| first))
    }

    /// Start of the passes from an answer of the reference solve, whose first stop is this one.
    #[inline(never)] // for less flash
    fn start_of(&self, first: usize, answer: &Found<T>) -> Start<T> {
        let common = &*self.common;
        // Ratio of the baseline as the carrier would measure it to its length.
        let stretch = if common.is_baseline_known {
            answer.baseline() / common.baseline
        } else {
            T::one()
        };
        Start {
            headings: answer.headings(),
            baseline: answer.baseline(),
            carrier: Vector2::new(
                common.scale_prior.mean * stretch,
                angle::wrap_signed(common.compass_prior.mean - answer.frame_heading()),
            ),
            stop: first,
            place: answer.first_stop() / stretch,
            cost: answer.chi_squared,
        }
    }

    /// Collects the stops at which both references saw the target, at most as many as there is room for and up to a leg
    /// that was not measured. Returns the number of the first one, and how many there are.
    fn common_stops(&self, stops: &mut [Stop<T>]) -> (usize, usize) {
        let (mut count, mut first) = (0, 0);
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
        (first, count)
    }

    fn nowhere() -> Stop<T> {
        Stop {
            rays: [Ray::from_bearing(T::zero()); 2],
            bearing_sigmas: [T::one(); 2],
            displacement: Vector2::zeros(),
            displacement_covariance: Matrix2::zeros(),
        }
    }

    /// Adds the leg to a stop, with the unknown part of the carrier; returns true if there is one.
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
        let factor = self.common.leg_factor;
        let columns = [
            Vector2::new(w11.recip(), -w21 / (w11 * w22)) * factor,
            Vector2::new(T::zero(), factor / w22),
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
        let mut own = self.own(camera).map(|(_, sight)| sight);
        let sight = own.find(|sight| {
            usize::from(sight.stop) == stop
                && sight.is_bearing()
                && (first..=last).contains(&sight.stop)
                && sight.standing == Standing::Counts
        })?;
        Some(self.bearing_at(sight))
    }
}
