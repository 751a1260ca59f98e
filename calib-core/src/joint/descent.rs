//! Gauss-Newton: each pass goes over the raw measurements, around the estimates of the pass before.
//!
//! A step that makes chi squared larger is halved until it does not. So estimates never get worse. Nothing but the
//! estimates is kept from one pass to the next.

use core::task::Poll;

use super::{
    JointSolution,
    problem::{Problem, REFERENCES, Standing, Told},
};
use crate::{
    Limits, Real, Refusal, fit::Fit, numerics::minimize::STALLED_SIGMAS, numerics::real::lit,
};

/// Passes after which a solve is given up. Six are usual after a start, two after a new stop.
const PASS_LIMIT: u8 = 60;
/// Size of a step in sigmas below which it is the last.
const CONVERGED_SIGMAS: f64 = 1e-3;
/// Most halvings of a step.
const HALVINGS: u8 = 12;
/// Rounding error of chi squared: if it grows by no more than this, it does not grow.
const ROUNDING: f64 = 1e-4;

/// Least number of bearings of a camera that can contradict each other.
pub(super) const WITNESSED: usize = 4;
/// Least number of bearings that give a pose. They tell nothing about anything else.
pub(super) const ENOUGH: usize = 3;
/// Factor of the sigmas with which a camera was let in. Beyond it the camera is put out.
const HYSTERESIS: f64 = 2.0;
/// Rounds of letting cameras in and settling.
const ROUNDS: u8 = 16;

/// Passes under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Descent<T> {
    best: Option<T>,
    /// Chi squared of the pass whose step is being found, and its fall since the pass before.
    begun: Option<(T, Option<T>)>,
    passes: u8,
    halvings: u8,
    stalled: bool,
}

impl<T> Descent<T> {
    pub(super) fn new() -> Self {
        Self {
            best: None,
            begun: None,
            passes: 0,
            halvings: 0,
            stalled: false,
        }
    }
}

/// A solve under way: cameras are let in and put out until none comes or goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settling<T> {
    /// Least number of bearings of a camera that is let in.
    least: usize,
    round: u8,
    /// A camera came or went in this round.
    changed: bool,
    passes: usize,
    /// Chi squared after the last descent that came to its end.
    chi_squared: Option<T>,
    doing: Doing<T>,
}

#[derive(Clone, Copy, Debug)]
enum Doing<T> {
    /// Lets in cameras from this one on.
    Admitting(usize),
    Descending(Descent<T>),
    /// Puts out cameras that have become too uncertain.
    Evicting,
    /// Puts back measurements from this one on.
    Readmitting(usize),
}

impl<T: Real> Problem<'_, T> {
    /// Lets in all cameras with four bearings or more, and settles; then those with three.
    pub(super) fn begin_settling(&mut self) -> Settling<T> {
        self.place_parts();
        for camera in self.cameras.iter_mut() {
            camera.is_new = false;
        }
        for camera in REFERENCES..self.cameras.len() {
            if self.counting(camera) < WITNESSED
                && let Some(unknown) = self.cameras.get_mut(camera)
            {
                unknown.takes_part = false;
                unknown.tried = 0;
            }
        }
        Settling {
            least: WITNESSED,
            round: 0,
            changed: false,
            passes: 0,
            chi_squared: None,
            doing: Doing::Admitting(REFERENCES),
        }
    }

    /// One camera, one pass or one measurement; the result once all is done.
    pub(super) fn step_settling(
        &mut self,
        settling: &mut Settling<T>,
        limits: &Limits<T>,
    ) -> Option<Result<JointSolution<T>, Refusal>> {
        let is_last = settling.round + 1 >= ROUNDS;
        match settling.doing {
            Doing::Admitting(from) => {
                let waiting = self.next_waiting(from, settling.least);
                if let Some(camera) = waiting.filter(|_| !is_last) {
                    settling.changed |= self.admit(camera, limits);
                    settling.doing = Doing::Admitting(camera + 1);
                    return None;
                }
                // Without cameras of three bearings nothing changes.
                if settling.least == ENOUGH && !settling.changed && settling.round == 0 {
                    return self.end_round(settling);
                }
                settling.doing = Doing::Descending(Descent::new());
                self.step_settling_down(settling, limits)
            }
            Doing::Descending(_) => self.step_settling_down(settling, limits),
            Doing::Evicting => self.step_evicting(settling, limits),
            Doing::Readmitting(from) => {
                let Some(measurement) = self.next_excluded(from) else {
                    return self.end_round(settling);
                };
                settling.changed |= self.readmit(measurement);
                settling.doing = Doing::Readmitting(measurement + 1);
                None
            }
        }
    }

    fn step_settling_down(
        &mut self,
        settling: &mut Settling<T>,
        limits: &Limits<T>,
    ) -> Option<Result<JointSolution<T>, Refusal>> {
        let Doing::Descending(descent) = &mut settling.doing else {
            return None;
        };
        let descended = self.descend(descent)?;
        settling.passes += usize::from(descent.passes);
        match descended {
            Ok(cost) => {
                settling.chi_squared = Some(cost);
                settling.doing = Doing::Evicting;
                if self.is_small() {
                    return self.step_evicting(settling, limits);
                }
                None
            }
            // Of the cameras that came last the one that fits worst is to blame.
            Err(_) if self.cameras.iter().any(|camera| camera.is_new) => {
                self.dismiss_worst();
                self.next_round(settling)
            }
            Err(why) => Some(Err(why)),
        }
    }

    fn step_evicting(
        &mut self,
        settling: &mut Settling<T>,
        limits: &Limits<T>,
    ) -> Option<Result<JointSolution<T>, Refusal>> {
        // If there are none, no camera has a pose.
        if !self.has_told() {
            return None;
        }
        let factor = lit(HYSTERESIS);
        let evicted = self.evict(&Limits {
            position: limits.position * factor,
            heading: limits.heading * factor,
        });
        settling.changed |= evicted > 0;
        if evicted > 0 || settling.round + 1 >= ROUNDS {
            return self.end_round(settling);
        }
        settling.doing = Doing::Readmitting(0);
        None
    }

    fn end_round(
        &mut self,
        settling: &mut Settling<T>,
    ) -> Option<Result<JointSolution<T>, Refusal>> {
        for camera in self.cameras.iter_mut() {
            camera.is_new = false;
        }
        settling.changed |= self.place_parts();
        if settling.changed {
            return self.next_round(settling);
        }
        self.end_rounds(settling)
    }

    fn next_round(
        &mut self,
        settling: &mut Settling<T>,
    ) -> Option<Result<JointSolution<T>, Refusal>> {
        settling.round += 1;
        if settling.round >= ROUNDS {
            return self.end_rounds(settling);
        }
        settling.changed = false;
        settling.doing = Doing::Admitting(REFERENCES);
        None
    }

    fn end_rounds(
        &mut self,
        settling: &mut Settling<T>,
    ) -> Option<Result<JointSolution<T>, Refusal>> {
        let Some(chi_squared) = settling.chi_squared else {
            return Some(Err(Refusal::DidNotConverge));
        };
        if settling.least == WITNESSED {
            settling.least = ENOUGH;
            settling.round = 0;
            settling.changed = false;
            settling.doing = Doing::Admitting(REFERENCES);
            return None;
        }
        let estimated = |camera: &usize| self.is_estimated(*camera);
        Some(Ok(JointSolution {
            fit: Fit {
                chi_squared,
                degrees_of_freedom: self.redundancy(),
            },
            cameras: (0..self.cameras.len()).filter(estimated).count(),
            passes: settling.passes,
        }))
    }

    /// Puts out the camera that fits worst among those that came last.
    fn dismiss_worst(&mut self) {
        let misfit = |camera: usize| {
            let own = self.own(camera).map(|(_, sight)| sight);
            own.filter(|sight| sight.standing == Standing::Counts)
                .filter_map(|sight| self.sight_row(sight))
                .fold(T::zero(), |sum, row| sum + row.residual * row.residual)
        };
        let mut worst: Option<(usize, T)> = None;
        for (n, camera) in self.cameras.iter().enumerate() {
            if camera.is_new {
                let misfit = misfit(n);
                if worst.is_none_or(|(_, most)| !(misfit <= most)) {
                    worst = Some((n, misfit));
                }
            }
        }
        if let Some((camera, _)) = worst {
            self.dismiss(camera);
            if let Some(camera) = self.cameras.get_mut(camera) {
                camera.is_new = false;
            }
        }
    }

    /// Does a slice of a pass, until the estimates no longer move. Returns chi squared there.
    ///
    /// # Errors
    /// [`Refusal::DidNotConverge`]; estimates are then the best that were found.
    #[inline(never)] // for less flash
    pub(super) fn descend(&mut self, descent: &mut Descent<T>) -> Option<Result<T, Refusal>> {
        let failed = Some(Err(Refusal::DidNotConverge));
        let slack = |cost: T| cost * lit(ROUNDING) + lit(ROUNDING);
        loop {
            if let Some((cost, fell)) = descent.begun {
                let Poll::Ready(worth) = self.find_step() else {
                    return None;
                };
                descent.begun = None;
                let Some(worth) = worth else {
                    return failed;
                };
                let within = |sigmas: f64| worth <= lit::<T>(sigmas) * lit(sigmas);
                // Once rounding keeps chi squared from falling, the estimates are close enough.
                let flat = fell.is_some_and(|fell| fell.abs() <= slack(cost));
                let stalled = flat && descent.stalled && within(STALLED_SIGMAS);
                let done = within(CONVERGED_SIGMAS) || stalled;
                descent.stalled = flat;
                self.go(T::one());
                if done {
                    return Some(Ok(cost - worth));
                }
                break;
            }
            let Poll::Ready(cost) = self.assemble() else {
                return None;
            };
            let Some(cost) = cost else {
                return failed;
            };
            descent.passes += 1;
            let downhill = match descent.best {
                Some(best) => cost <= best + slack(best),
                None => cost.is_finite(),
            };
            if !downhill {
                if descent.best.is_none() {
                    return failed;
                }
                descent.halvings += 1;
                if descent.halvings <= HALVINGS {
                    // Goes half of the way back. The step that is kept is the other half.
                    self.shorten();
                    self.go(-T::one());
                }
                self.common.told = Told::Equations;
                break;
            }
            descent.begun = Some((cost, descent.best.map(|best| best - cost)));
            descent.best = Some(cost);
            descent.halvings = 0;
            if !self.is_small() {
                return None;
            }
        }
        if descent.passes < PASS_LIMIT && descent.halvings <= HALVINGS {
            return None;
        }
        // Goes back to the best estimates: the search for contradictions begins there.
        self.go(-T::one());
        self.common.told = Told::Equations;
        failed
    }

    /// Moves every estimate along its step.
    fn go(&mut self, length: T) {
        self.common.carrier += self.common.carrier_step * length;
        for unknown in self.cameras.iter_mut().chain(self.marks.iter_mut()) {
            for (value, step) in unknown.value.iter_mut().zip(unknown.step) {
                *value += step * length;
            }
        }
        for stop in self.stops.iter_mut() {
            stop.place += stop.step * length;
        }
    }

    fn shorten(&mut self) {
        let half = lit::<T>(0.5);
        self.common.carrier_step *= half;
        for unknown in self.cameras.iter_mut().chain(self.marks.iter_mut()) {
            for step in &mut unknown.step {
                *step *= half;
            }
        }
        for stop in self.stops.iter_mut() {
            stop.step *= half;
        }
    }
}
