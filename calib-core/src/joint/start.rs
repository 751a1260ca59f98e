//! Start of the passes: by closed forms, without a guess.
//!
//! Sightings by both references together give their headings and the place of one stop
//! ([`reference`](crate::reference)). All other stops are placed from there (`placing`). Both solutions
//! of a pair of circles are tried where the reference solve cannot tell them apart.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{
    Prior,
    descent::Descent,
    problem::{Common, Problem, Sight, Standing},
};
use crate::{
    Ray, Real, Refusal, angle,
    fit::{Fit, one_in_a_thousand},
    numerics::plane::quarter_turn,
    numerics::real::lit,
    reference::{self, Known, ReferenceSettings, ReferenceSolution, Stop},
};

/// Least number of stops that both references saw: with two there are two answers.
pub(super) const LEAST: usize = 3;
/// Most of these that a start takes: more add nothing, and one step of the work grows with their third power.
const MOST: usize = 12;
/// The same where the direction of the steps or the baseline is sought too, in 24 directions.
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
    trial: Trial,
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
enum Trial {
    /// A reference solve is next.
    Proposing,
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

    /// One reference solve, or one pass over the references' bearings.
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
        if let Trial::Proposing = starting.trial {
            return self.propose(starting).err().map(Err);
        }
        let tried = self.step_descent(&mut starting.descent)?;
        let Starting { best, other, .. } = starting;
        match (starting.trial, tried, *other) {
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

    fn propose(&mut self, starting: &mut Starting<T>) -> Result<(), Refusal> {
        self.restore_priors(starting);
        let Common {
            baseline,
            is_baseline_known,
            scale_prior,
            compass_prior,
            ..
        } = *self.common;
        let is_known = |prior: Prior<T>| prior.sigma < lit(VAGUE);
        let [mut takes_scale, mut takes_compass] = [false; 2];
        while let Some(taken) = TAKEN.get(starting.taken) {
            [takes_scale, takes_compass] = *taken;
            if (!takes_scale || is_known(scale_prior) && is_baseline_known)
                && (!takes_compass || is_known(compass_prior))
            {
                break;
            }
            starting.taken += 1;
        }
        let common = &mut *self.common;
        common.carrier = Vector2::new(scale_prior.mean, compass_prior.mean);
        let (best, other) = self.proposals(&Known {
            baseline: takes_scale.then_some(baseline),
            frame_heading: takes_compass.then_some(T::zero()),
        })?;
        // A prior that the sightings contradict is dropped: then they tell the value.
        let common = &mut *self.common;
        for (prior, value, is_taken) in [
            (
                &mut common.scale_prior,
                best.carrier.x,
                takes_scale || !is_baseline_known,
            ),
            (&mut common.compass_prior, best.carrier.y, takes_compass),
        ] {
            let off = angle::wrap_signed(value - prior.mean).abs();
            if !is_taken && off > prior.sigma * lit(CLAIMED) {
                prior.sigma = off;
            }
        }
        (starting.best, starting.other) = (best, other);
        starting.trial = Trial::Best;
        self.begin_descent(&best, &mut starting.descent);
        Ok(())
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

    /// Proposals of the reference solve: its best answer, and another one that fits as well.
    #[inline(never)] // for less stack
    fn proposals(&self, known: &Known<T>) -> Result<(Start<T>, Option<Start<T>>), Refusal> {
        let (mut stops, mut count, mut first) = ([Self::nowhere(); MOST], 0, 0);
        let is_known = known.baseline.is_some() && known.frame_heading.is_some();
        let most = if is_known { MOST } else { MOST_OF_UNKNOWN };
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
            let Some(stop) = stops.get_mut(count).filter(|_| count < most) else {
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
            is_baseline_known,
            scale_prior,
            compass_prior,
            ..
        } = *self.common;
        // By reference: large, and moved it would be on the stack twice.
        let solved = reference::solve(stops, known, &ReferenceSettings::default());
        let outcome = solved.as_ref().map_err(|why| *why)?;
        let start = |solution: &ReferenceSolution<T>| {
            // Ratio of the baseline as the carrier would measure it to its length.
            let stretch = if is_baseline_known {
                solution.baseline / baseline
            } else {
                T::one()
            };
            Start {
                headings: solution.headings,
                baseline: solution.baseline,
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
