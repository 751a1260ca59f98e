//! Gauss-Newton: passes from the raw measurements, each around where the last one led.
//!
//! A step that leads uphill is halved until it does not, so that estimates are never worse than
//! where they began. Nothing is carried from one pass to the next but the estimates.

use super::{
    JointSolution,
    problem::{Problem, REFERENCES, Standing},
    sweep::Without,
};
use crate::{
    Limits, Real, Refusal, fit::Fit, numerics::minimize::STALLED_SIGMAS, numerics::real::lit,
};

/// Passes after which a solve is given up; six are usual after a start, two after a stop.
const PASS_LIMIT: usize = 60;
/// A step worth less than this, in sigmas, is the last.
const CONVERGED_SIGMAS: f64 = 1e-3;
/// Steps are halved so many times in a row.
const HALVINGS: usize = 12;
/// Chi squared that goes up by no more than this does not go up: its rounding.
const ROUNDING: f64 = 1e-4;

/// Bearings from which on a camera's can contradict each other.
const WITNESSED: usize = 4;
/// Bearings that make a pose, and say nothing about anything else.
const ENOUGH: usize = 3;
/// A camera that takes part is put out when its sigmas are so many times those it was let in with.
const HYSTERESIS: f64 = 2.0;
/// Rounds of letting cameras in and settling.
const ROUNDS: usize = 16;

impl<T: Real> Problem<'_, T> {
    /// Lets in what cameras it can, and settles; then those with exactly three bearings.
    pub(super) fn settle(&mut self, limits: &Limits<T>) -> Result<JointSolution<T>, Refusal> {
        for camera in REFERENCES..self.cameras.len() {
            if self.counting(camera) < WITNESSED
                && let Some(unknown) = self.cameras.get_mut(camera)
            {
                unknown.column = None;
                unknown.tried = 0;
            }
        }
        let mut passes = 0;
        self.settle_with(WITNESSED, limits, &mut passes)?;
        let chi_squared = self.settle_with(ENOUGH, limits, &mut passes)?;
        let estimated = |camera: &usize| self.is_estimated(*camera);
        Ok(JointSolution {
            fit: Fit {
                chi_squared,
                degrees_of_freedom: self.redundancy(),
            },
            cameras: (0..self.cameras.len()).filter(estimated).count(),
            passes,
        })
    }

    /// Puts out the camera that fits worst among those that came last.
    fn dismiss_worst(&mut self) {
        let misfit = |camera: usize| {
            let rows = self.sights.iter().filter(|sight| {
                usize::from(sight.camera) == camera && sight.standing == Standing::Counts
            });
            rows.filter_map(|sight| self.sight_row(sight))
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

    /// Rounds until nobody comes or goes. Tells chi squared.
    fn settle_with(
        &mut self,
        least: usize,
        limits: &Limits<T>,
        passes: &mut usize,
    ) -> Result<T, Refusal> {
        let factor = lit(HYSTERESIS);
        let loose = Limits {
            position: limits.position * factor,
            heading: limits.heading * factor,
        };
        let mut result = Err(Refusal::DidNotConverge);
        for round in 0..ROUNDS {
            let admitted = if round + 1 < ROUNDS {
                self.admit(least, limits)
            } else {
                0
            };
            let settled = self.converge();
            let mut changed = 0;
            match settled {
                Ok((cost, taken)) => {
                    *passes += taken;
                    changed += self.evict(&loose);
                    if changed == 0 && round + 1 < ROUNDS {
                        changed += self.readmit();
                    }
                    result = Ok(cost);
                }
                // Of those that came last the one that fits worst is to blame.
                Err(_) if self.cameras.iter().any(|camera| camera.is_new) => {
                    self.dismiss_worst();
                    continue;
                }
                Err(why) => return Err(why),
            }
            for camera in self.cameras.iter_mut() {
                camera.is_new = false;
            }
            if admitted + changed == 0 {
                return result;
            }
        }
        result
    }

    /// Passes until the estimates no longer move. Tells chi squared there, and how many it took.
    ///
    /// # Errors
    /// [`Refusal::DidNotConverge`]; estimates are then the best that were found.
    #[inline(never)] // size
    pub(super) fn converge(&mut self) -> Result<(T, usize), Refusal> {
        let failed = Refusal::DidNotConverge;
        let last = self.stops.len().saturating_sub(1);
        let mut best: Option<T> = None;
        let (mut halvings, mut stalled) = (0, false);
        for passes in 1..=PASS_LIMIT {
            let pass = self.sweep(last, Without::Nothing).ok_or(failed)?;
            let slack = |cost: T| cost * lit(ROUNDING) + lit(ROUNDING);
            let downhill = match best {
                Some(best) => pass.cost <= best + slack(best),
                None => pass.cost.is_finite(),
            };
            if !downhill {
                if best.is_none() {
                    return Err(failed);
                }
                halvings += 1;
                if halvings > HALVINGS {
                    break;
                }
                // Half of the way back; the step that is kept is the other half.
                self.shorten();
                self.go(-T::one());
                continue;
            }
            let fell = best.map(|best| best - pass.cost);
            best = Some(pass.cost);
            halvings = 0;
            let within = |sigmas: f64| pass.worth <= lit::<T>(sigmas) * lit(sigmas);
            // Where rounding lets nothing fall any more, being close is being there.
            let flat = fell.is_some_and(|fell| fell.abs() <= slack(pass.cost));
            let done = within(CONVERGED_SIGMAS) || (flat && stalled && within(STALLED_SIGMAS));
            stalled = flat;
            self.find_step().ok_or(failed)?;
            self.go(T::one());
            if done {
                return Ok((pass.cost - pass.worth, passes));
            }
        }
        // Back to the best, and the triangle with it, so that whoever looks for what contradicts finds
        // the residuals there.
        self.go(-T::one());
        self.sweep(last, Without::Nothing);
        Err(failed)
    }

    /// Moves every estimate along its step.
    fn go(&mut self, length: T) {
        self.common.carrier += self.common.carrier_step * length;
        for unknown in self.cameras.iter_mut().chain(self.marks.iter_mut()) {
            unknown.value += unknown.step * length;
        }
        for stop in self.stops.iter_mut() {
            let [x, y, ..] = stop.chain;
            stop.place.x += x * length;
            stop.place.y += y * length;
        }
    }

    fn shorten(&mut self) {
        let half = lit::<T>(0.5);
        self.common.carrier_step *= half;
        for unknown in self.cameras.iter_mut().chain(self.marks.iter_mut()) {
            unknown.step *= half;
        }
        for stop in self.stops.iter_mut() {
            let [x, y, ..] = &mut stop.chain;
            *x *= half;
            *y *= half;
        }
    }
}
