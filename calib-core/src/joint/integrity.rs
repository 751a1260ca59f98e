//! Search for contradictions, and protection levels: the possible effect of one fault that no test noticed.
//!
//! **Test.** The largest normalised statistic over single bearings, legs, and tails: all that a camera has seen since
//! some stop (it was bumped, or is stuck). One wrong measurement makes many residuals large. So only the strongest is
//! left out, and everything is solved again before the next search. This is Baarda's data snooping, as receivers of
//! satellite navigation use it (RAIM). A measurement that was left out and agrees later comes back.
//!
//! The covariances of a solve give all of it, without another pass. Without the tail of a camera chi squared falls by
//! `r^T (1 - H)^-1 r`, where `r` are the residuals of the tail and `H` is their predicted covariance.
//!
//! **Protection level.** A fault that the test of its measurement just misses moves an unknown by at most
//! `|C g| (4.42 + 3.09) / sqrt(1 - h)`, in sigmas of the measurement: 4.42 is the limit of the test, and 3.09 the
//! margin with which it misses one fault in a thousand. The largest of these over all measurements, and 3.09 sigmas of
//! noise, bound the error that one unnoticed fault leaves. If nothing checks a measurement, there is no useful bound.

use core::task::Poll;

use super::{
    Finding, ProtectionLevels,
    descent::ENOUGH,
    problem::{NONE, Problem, Quantity, REFERENCES, Sight, Standing, Suspect, Told},
    residuals::UNCHECKED,
};
use crate::{Real, Refusal, fit::RARE, numerics::real::lit};

/// Strength of a statistic that chance exceeds once in 100,000: 4.42 sigmas of a single one.
const LIMIT: f64 = 11.51;
/// Strength of a single bearing from which on the tails of its camera are tested: chance exceeds it once in a hundred,
/// or once in twenty times all bearings if that is rarer.
const SUSPICION: f64 = 4.6;
/// Size of a fault that is missed once in a thousand, in sigmas: the limit that one good measurement in 100,000
/// exceeds, and the margin above it.
const DETECTED: f64 = 4.42 + RARE;
/// Least redundancy: smaller ones count as this.
const LEAST_REDUNDANCY: f64 = 1e-4;
/// Bearings of a camera in a row that have to be wrong before it counts as moved.
pub(super) const IN_A_ROW: usize = 2;
/// Odds that a bearing is wrong that is bit by bit the camera's last one although the target has moved.
const OF_REPEATED: f64 = 2.0;
/// Odds that a leg is wrong. Below one: where a leg and a bearing explain the same, less is lost without the bearing.
const OF_LEG: f64 = 0.95;
/// Odds that a tail is wrong. Below one: a single wrong bearing needs no tail.
const OF_TAIL: f64 = 0.9;
/// The told noise of the legs is believed while the sum of their squared residuals is within so many sigmas of its
/// mean.
const BELIEVED: f64 = 2.0;
/// Chi squared of a leg, of one and of two degrees of freedom, beyond which it errs by more than twice the median
/// error. The told noise is far too small if more than half of the legs do.
const LOOSE: [f64; 2] = [4.0 * 0.455, 4.0 * 1.386];
/// Least number of legs for that test.
const LOOSE_LEGS: usize = 6;
/// Weight of the told variance of the legs, in residuals.
const PSEUDO_SAMPLES: f64 = 6.0;

/// Strength of a chi squared: minus the logarithm of the probability that chance exceeds it. So statistics of different
/// degrees of freedom can be compared. The first term of the asymptotic series of the incomplete gamma function
/// (Abramowitz and Stegun, 6.5.32) is exact for two degrees, and right to a hundredth for others from [`LIMIT`] on.
/// Zero where chance exceeds it often.
fn strength<T: Real>(chi_squared: T, degrees_of_freedom: usize) -> T {
    let Some(degrees) = u32::try_from(degrees_of_freedom).ok().filter(|n| *n > 0) else {
        return T::zero();
    };
    let beyond_two = T::whole(degrees) - lit(2.0);
    if !(chi_squared > T::whole(degrees)) {
        return T::zero();
    }
    let half = chi_squared * lit(0.5);
    // The logarithm of gamma at half the degrees, by its recursion from one half or from one.
    let mut log_gamma = if degrees % 2 == 1 {
        T::pi().ln() * lit(0.5)
    } else {
        T::zero()
    };
    let mut at = T::whole(degrees % 2) * lit(0.5);
    for _ in 0..(degrees / 2) {
        if at > T::zero() {
            log_gamma += at.ln();
        }
        at += T::one();
    }
    half - beyond_two * lit(0.5) * half.ln()
        + log_gamma
        + (T::one() - beyond_two / chi_squared).ln()
}

/// Survey of all measurements.
#[derive(Clone, Copy, Debug)]
pub(super) struct Survey<T> {
    /// The next camera.
    camera: usize,
    protects: bool,
    strongest: Option<(Finding<T>, T)>,
    /// The strongest contradiction of a single measurement.
    single: Option<(Finding<T>, T)>,
    /// The leg that may explain the suspect, and its chi squared.
    leg: Option<(usize, T)>,
    /// The sum of the legs' squared residuals, in claimed sigmas, and its expectation.
    squares: T,
    redundancy: T,
    /// Legs that are checked, and those that err by [much more](LOOSE) than they claim.
    legs: usize,
    loose: usize,
    /// The camera whose tails are tested next, once all single measurements are tested.
    tail: Option<usize>,
    /// Chi squared at the begin of the solve of [`verify`](Problem::verify).
    cost: Option<T>,
    /// Least chi squared with all sightings.
    all: Option<T>,
}

impl<T: Real> Survey<T> {
    /// The strongest contradiction, if it is too strong for chance.
    pub(super) fn found(&self) -> Option<Finding<T>> {
        let beyond = self
            .strongest
            .filter(|(_, strength)| *strength > lit(LIMIT));
        beyond.map(|(found, _)| found)
    }

    /// Strength of that contradiction.
    pub(super) fn strength(&self) -> T {
        let strongest = self.strongest.filter(|_| self.found().is_some());
        strongest.map_or_else(T::zero, |(_, strength)| strength)
    }

    /// Keeps a finding if it is the strongest. `odds` decide between findings of equal strength.
    fn offer(&mut self, found: Finding<T>, strength: T, odds: T) {
        if strength > lit(LIMIT) {
            let weighed = strength * odds;
            let is_more =
                |than: &Option<(Finding<T>, T)>| than.is_none_or(|(_, most)| weighed > most);
            if is_more(&self.strongest) {
                self.strongest = Some((found, weighed));
            }
            if !matches!(found, Finding::Camera { .. }) && is_more(&self.single) {
                self.single = Some((found, weighed));
            }
        }
    }
}

impl<T: Real> Problem<'_, T> {
    /// Begins a survey: each measurement is tested against the rest. If `protects`, protection levels of all cameras
    /// are computed.
    pub(super) fn begin_survey(&mut self, protects: bool) -> Survey<T> {
        for camera in self.cameras.iter_mut() {
            camera.is_new = false;
            if protects {
                camera.protection = ProtectionLevels::default();
            }
        }
        Survey {
            camera: 0,
            protects,
            strongest: None,
            single: None,
            leg: None,
            squares: T::zero(),
            redundancy: T::zero(),
            legs: 0,
            loose: 0,
            tail: None,
            cost: None,
            all: None,
        }
    }

    /// Does one step of a survey: the sightings and the protection level of one camera, with the first one all legs
    /// too; or, in the search for contradictions, the tails of a suspected camera.
    #[inline(never)] // for less flash
    pub(super) fn step_survey(
        &mut self,
        survey: &mut Survey<T>,
        looks: bool,
    ) -> Option<Result<(), Refusal>> {
        let Some(tail) = survey.tail else {
            if !self.has_told() {
                return None;
            }
            if self.survey_camera(survey).is_none() {
                return Some(Err(Refusal::Undetermined));
            }
            survey.camera += 1;
            if survey.camera < self.cameras.len() {
                return None;
            }
            survey.tail = Some(0);
            return (!looks).then_some(Ok(()));
        };
        let is_suspect = |camera: &usize| self.cameras.get(*camera).is_some_and(|c| c.is_new);
        let Some(camera) = (tail..self.cameras.len()).find(is_suspect) else {
            loop {
                if self.verify(survey).is_ready() {
                    return Some(Ok(()));
                }
                if !self.is_small() {
                    return None;
                }
            }
        };
        survey.tail = Some(camera + 1);
        let surveyed = self.survey_tails(survey, camera);
        surveyed.is_none().then_some(Err(Refusal::Undetermined))
    }

    fn survey_camera(&mut self, survey: &mut Survey<T>) -> Option<()> {
        self.tell().ok()?;
        let camera = survey.camera;
        if camera == 0 {
            self.survey_legs(survey);
        }
        let suspicion = self.suspicion(SUSPICION);
        let mut next = self.cameras.get(camera).map_or(NONE, |camera| camera.last);
        while let Some((n, sight)) = self.next_own(&mut next) {
            if sight.standing != Standing::Counts {
                continue;
            }
            // A bearing without redundancy has no normalised residual.
            let residual = self.bearing_residual(n).ok();
            let off = residual.and_then(|residual| Some((residual, residual.normalised?)));
            let Some((residual, off)) = off else {
                continue;
            };
            let strength = strength(off * off, 1);
            let is_strong = strength > lit(LIMIT);
            let odds = if is_strong && self.repeats(n) {
                lit(OF_REPEATED)
            } else {
                T::one()
            };
            let stop = residual.stop;
            let found = match residual.quantity {
                Quantity::Bearing => Finding::Bearing { stop, camera, off },
                Quantity::Range => Finding::Range { stop, camera, off },
            };
            survey.offer(found, strength, odds);
            if let Some(camera) = self.cameras.get_mut(camera) {
                camera.is_new |= strength > suspicion;
            }
        }
        if survey.protects && camera >= REFERENCES && self.is_estimated(camera) {
            self.protect(camera);
        }
        Some(())
    }

    fn survey_legs(&mut self, survey: &mut Survey<T>) {
        for later in 1..self.stops.len() {
            let Ok(leg) = self.leg_residual(later) else {
                continue;
            };
            if leg.standing != Standing::Counts {
                continue;
            }
            survey.squares += leg.squared;
            survey.redundancy += leg.redundancy;
            let loose = leg.degrees_of_freedom.checked_sub(1);
            if let Some(loose) = loose.and_then(|degrees| LOOSE.get(degrees)) {
                survey.legs += 1;
                survey.loose += usize::from(leg.chi_squared > lit(*loose));
            }
            let found = Finding::Leg {
                stop: leg.stop,
                chi_squared: leg.chi_squared,
            };
            let strength = strength(leg.chi_squared, leg.degrees_of_freedom);
            survey.offer(found, strength, lit(OF_LEG));
            if strength > lit(LIMIT)
                && self.may_be_blamed(leg.stop)
                && survey.leg.is_none_or(|(_, most)| leg.chi_squared > most)
            {
                survey.leg = Some((leg.stop, leg.chi_squared));
            }
        }
    }

    /// Computes the protection levels of a camera.
    fn protect(&mut self, camera: usize) {
        let mut levels = ProtectionLevels::<T>::default();
        let told = self.influences(camera, |moved, redundancy, is_leg| {
            let size = lit::<T>(DETECTED) / redundancy.max(lit(LEAST_REDUNDANCY)).sqrt();
            let &[x, y, heading, ..] = moved else { return };
            let position = (x * x + y * y).sqrt() * size;
            let (of_position, of_heading) = if is_leg {
                (&mut levels.position_leg, &mut levels.heading_leg)
            } else {
                (&mut levels.position_bearing, &mut levels.heading_bearing)
            };
            *of_position = of_position.max(position);
            *of_heading = of_heading.max(heading.abs() * size);
        });
        let (Some(()), Ok(pose)) = (told, self.told_pose(camera)) else {
            return;
        };
        let noise = lit::<T>(RARE);
        for level in [&mut levels.position_bearing, &mut levels.position_leg] {
            *level += pose.sigma_position() * noise;
        }
        for level in [&mut levels.heading_bearing, &mut levels.heading_leg] {
            *level += pose.sigma_heading() * noise;
        }
        if let Some(camera) = self.cameras.get_mut(camera) {
            camera.protection = levels;
        }
    }

    /// Returns true if a bearing equals the camera's bearing before it bit by bit.
    fn repeats(&self, n: usize) -> bool {
        let Some(sight) = self.sights.get(n) else {
            return false;
        };
        let is_before = |m: usize, other: &Sight<T>| {
            let is_same_stop = other.stop == sight.stop && m < n;
            other.quantity == sight.quantity && (other.stop < sight.stop || is_same_stop)
        };
        let mut own = self.own(usize::from(sight.camera));
        let last = own.find(|(m, other)| *m != n && is_before(*m, other));
        last.is_some_and(|(_, last)| last.stop != sight.stop && last.value == sight.value)
    }

    fn tail(&self, camera: usize, from: usize) -> impl Iterator<Item = &Sight<T>> + Clone {
        let own = self.own(camera).map(|(_, sight)| sight);
        own.filter(move |sight| {
            sight.is_bearing()
                && usize::from(sight.stop) >= from
                && sight.standing == Standing::Counts
        })
    }

    /// Tests the tails of a camera: for each stop, the fall of chi squared without all that it saw since then. A tail
    /// has [`IN_A_ROW`] bearings at least, and leaves enough for a pose.
    fn survey_tails(&mut self, survey: &mut Survey<T>, camera: usize) -> Option<()> {
        let all = self.counting(camera);
        let mut offered = *survey;
        self.tails(camera, |problem, count, fallen| {
            let mut counting = { problem.own(camera).map(|(_, sight)| sight) }
                .filter(|sight| sight.standing == Standing::Counts)
                .skip(count.saturating_sub(1));
            let Some(last) = counting.next() else { return };
            let from = usize::from(last.stop);
            let goes_on = counting.next().is_some_and(|sight| sight.stop == last.stop);
            let bearings = problem.tail(camera, from).count();
            if goes_on || bearings < IN_A_ROW || all < bearings + ENOUGH {
                return;
            }
            let strength = strength(fallen, bearings);
            let found = Finding::Camera {
                camera,
                from,
                chi_squared: fallen,
            };
            if strength > lit(LIMIT) {
                let mut later = { problem.own(camera) }
                    .filter(|(_, sight)| sight.is_bearing() && usize::from(sight.stop) > from);
                let odds = if later.all(|(n, _)| problem.repeats(n)) {
                    lit(OF_TAIL * OF_REPEATED)
                } else {
                    lit(OF_TAIL)
                };
                offered.offer(found, strength, odds);
            }
        })?;
        *survey = offered;
        Some(())
    }

    /// Does a slice of a solve without the tail that was found, and drops the finding if chi squared does not fall as
    /// predicted. The prediction is linear: it promises too much for a camera very near to the target, and where the
    /// solve did not converge.
    fn verify(&mut self, survey: &mut Survey<T>) -> Poll<()> {
        let Some((found, weighed)) = survey.strongest else {
            return Poll::Ready(());
        };
        let Finding::Camera {
            camera,
            from,
            chi_squared,
        } = found
        else {
            return Poll::Ready(());
        };
        let Poll::Ready(least) = self.find_least(&mut survey.cost) else {
            return Poll::Pending;
        };
        let (Some(all), Some(rest)) = (survey.all, least) else {
            survey.all = least;
            survey.cost = None;
            self.common.left_out = least.map(|_| (camera, from));
            return if least.is_some() {
                Poll::Pending
            } else {
                Poll::Ready(())
            };
        };
        self.common.left_out = None;
        self.common.told = Told::Equations;
        let bearings = self.tail(camera, from).count();
        let odds = weighed / strength(chi_squared, bearings);
        let fallen = all - rest;
        let found = Finding::Camera {
            camera,
            from,
            chi_squared: fallen,
        };
        survey.strongest = survey.single;
        let strength = strength(fallen, bearings);
        if strength > lit(LIMIT) && { survey.single }.is_none_or(|(_, most)| strength * odds > most)
        {
            survey.strongest = Some((found, strength * odds));
        }
        Poll::Ready(())
    }

    /// Does a slice of the search for the least chi squared of the linear model. `cost` is chi squared of the present
    /// estimates, once known.
    fn find_least(&mut self, cost: &mut Option<T>) -> Poll<Option<T>> {
        if let Some(cost) = *cost {
            return self.find_step().map(|worth| Some(cost - worth?));
        }
        if let Poll::Ready(found) = self.assemble() {
            *cost = found;
            if found.is_none() {
                return Poll::Ready(None);
            }
        }
        Poll::Pending
    }

    /// Leaves out a finding. If the last bearings of a camera are all wrong, it was moved, or a leg was not as
    /// measured. Then nothing is left out for good yet: the next surveys decide.
    pub(super) fn leave_out(&mut self, found: Finding<T>) -> Option<Finding<T>> {
        let (camera, from) = match found {
            Finding::Bearing { stop, camera, .. } => {
                self.exclude(stop, camera, Quantity::Bearing);
                let Some(from) = self.off_since(camera) else {
                    return Some(found);
                };
                for sight in self.sights.iter_mut() {
                    let is_its = usize::from(sight.camera) == camera && sight.is_bearing();
                    if is_its && usize::from(sight.stop) >= from {
                        sight.standing = Standing::Counts;
                    }
                }
                (camera, from)
            }
            Finding::Range { stop, camera, .. } => {
                self.exclude(stop, camera, Quantity::Range);
                return Some(found);
            }
            Finding::Leg { stop, .. } => {
                self.leave_out_leg(stop);
                return Some(found);
            }
            Finding::Camera { camera, from, .. } => (camera, from),
        };
        let key = u16::try_from(camera).ok().zip(u16::try_from(from).ok());
        let (camera, from) = key?;
        self.common.suspect = Some(Suspect {
            camera,
            from,
            leg: None,
        });
        None
    }

    /// Decides between the camera and a leg. Everything was solved with the bearings of the suspect; then once more
    /// without the leg that explains them best.
    pub(super) fn decide(&mut self, survey: &Survey<T>) -> Option<Finding<T>> {
        let suspect = self.common.suspect.take()?;
        let (camera, from) = (usize::from(suspect.camera), usize::from(suspect.from));
        let found = survey.found();
        match suspect.leg {
            None => {
                // Of several legs between the same sightings any serves.
                let (leg, chi_squared) = survey.leg.unwrap_or((from, T::zero()));
                let counts = self
                    .stops
                    .get(leg)
                    .is_some_and(|stop| stop.standing == Standing::Counts);
                if counts && self.leg_rows_of(leg).is_some() {
                    self.count_leg(leg, Standing::Excluded);
                    let leg = u16::try_from(leg).ok()?;
                    let leg = Some((leg, chi_squared));
                    self.common.suspect = Some(Suspect { leg, ..suspect });
                    return None;
                }
            }
            Some((leg, chi_squared)) => {
                let is_still = match found {
                    Some(
                        Finding::Bearing { camera: of, .. } | Finding::Camera { camera: of, .. },
                    ) => of == camera,
                    _ => false,
                };
                let stop = usize::from(leg);
                if !is_still {
                    self.leave_out_leg(stop);
                    return Some(Finding::Leg { stop, chi_squared });
                }
                self.count_leg(stop, Standing::Counts);
            }
        }
        let chi_squared = match found {
            Some(Finding::Bearing { off, .. }) => off * off,
            Some(Finding::Camera { chi_squared, .. }) => chi_squared,
            _ => T::zero(),
        };
        self.distrust(camera, from);
        Some(Finding::Camera {
            camera,
            from,
            chi_squared,
        })
    }

    fn count_leg(&mut self, stop: usize, standing: Standing) {
        if let Some(stop) = self.stops.get_mut(stop) {
            stop.standing = standing;
        }
    }

    fn leave_out_leg(&mut self, stop: usize) {
        // A camera that seemed to be moved near this leg may be right.
        self.undo_moves(Some(stop));
        self.count_leg(stop, Standing::Excluded);
    }

    /// Returns true if the leg to a stop may explain the sightings of the suspect: it comes after its last good
    /// sighting.
    fn may_be_blamed(&self, leg: usize) -> bool {
        self.common.suspect.is_some_and(|suspect| {
            let camera = usize::from(suspect.camera);
            let before = self.sights.iter().filter(|sight| {
                usize::from(sight.camera) == camera
                    && sight.is_bearing()
                    && sight.standing == Standing::Counts
                    && sight.stop < suspect.from
            });
            let good = before.map(|sight| usize::from(sight.stop)).max();
            suspect.leg.is_none()
                && good.is_some_and(|good| leg > good)
                && leg <= suspect.from.into()
        })
    }

    /// Returns the stop since which all bearings of a camera are left out, if these are [`IN_A_ROW`] or more.
    fn off_since(&self, camera: usize) -> Option<usize> {
        let good = self.tail(camera, 0).map(|sight| sight.stop).max();
        let since = self.sights.iter().filter(|sight| {
            usize::from(sight.camera) == camera
                && sight.is_bearing()
                && sight.standing == Standing::Excluded
                && good.is_none_or(|good| sight.stop > good)
        });
        let from = since.clone().map(|sight| usize::from(sight.stop)).min();
        from.filter(|_| since.count() >= IN_A_ROW)
    }

    fn exclude(&mut self, stop: usize, camera: usize, quantity: Quantity) {
        for sight in self.sights.iter_mut() {
            let is_it = usize::from(sight.stop) == stop && usize::from(sight.camera) == camera;
            if is_it && sight.quantity == quantity {
                sight.standing = Standing::Excluded;
            }
        }
    }

    /// Returns the finding with the stop since which it holds, now that everything is solved without it.
    pub(super) fn refined(&self, found: Finding<T>) -> Finding<T> {
        let Finding::Camera {
            camera,
            from,
            chi_squared,
        } = found
        else {
            return found;
        };
        let distrusted = self.sights.iter().filter(|sight| {
            usize::from(sight.camera) == camera && sight.standing == Standing::Distrusted
        });
        let first = distrusted.map(|sight| usize::from(sight.stop)).min();
        Finding::Camera {
            camera,
            from: first.unwrap_or(from),
            chi_squared,
        }
    }

    fn distrust(&mut self, camera: usize, from: usize) {
        let from = u16::try_from(from).unwrap_or(u16::MAX);
        if let Some(camera) = self.cameras.get_mut(camera) {
            camera.moved = Some(camera.moved.map_or(from, |before| before.min(from)));
        }
        for sight in self.sights.iter_mut() {
            if usize::from(sight.camera) == camera && sight.stop >= from {
                sight.standing = Standing::Distrusted;
            }
        }
    }

    /// Doubles the noise of all legs if most of them err by far more than told. This comes before anything is left out:
    /// otherwise good bearings are left out one by one until the rest fits the told noise. A single wrong leg, or a
    /// moved camera, makes few legs large. Returns true if that changes anything.
    pub(super) fn loosen_legs(&mut self, survey: &Survey<T>) -> bool {
        let is_loose = survey.legs >= LOOSE_LEGS && 2 * survey.loose > survey.legs;
        if is_loose {
            self.common.leg_factor *= lit(2.0);
        }
        is_loose
    }

    /// Estimates the noise of the legs from their residuals, relative to the told noise, which counts as six residuals.
    /// The told noise is kept until the residuals contradict it: from few residuals the estimate is worse than most
    /// told values. Returns true if that changes anything.
    pub(super) fn fit_leg_noise(&mut self, survey: &Survey<T>) -> bool {
        let claim = lit::<T>(PSEUDO_SAMPLES);
        let before = self.common.leg_factor;
        let squares = survey.squares * before * before;
        let redundancy = survey.redundancy;
        let by_chance = (redundancy + redundancy).sqrt() * lit(BELIEVED);
        let factor = if (squares - redundancy).abs() <= by_chance {
            T::one()
        } else {
            ((squares + claim) / (redundancy + claim)).sqrt()
        };
        if !factor.is_finite() || (factor / before - T::one()).abs() < lit(0.01) {
            return false;
        }
        self.common.leg_factor = factor;
        true
    }

    /// Widens a prior of the carrier to its error if nothing is contradicted more strongly. Returns true if there was
    /// one.
    pub(super) fn widen_priors(&mut self, survey: &Survey<T>) -> bool {
        let Ok(carrier) = self.carrier() else {
            return false;
        };
        let least = lit::<T>(LIMIT).max(survey.strength());
        let common = &mut *self.common;
        let mut has_widened = false;
        for (prior, value, variance) in [
            (
                &mut common.scale_prior,
                carrier.scale,
                carrier.covariance.m11,
            ),
            (
                &mut common.compass_prior,
                carrier.compass,
                carrier.covariance.m22,
            ),
        ] {
            let off = value - prior.mean;
            let claimed = prior.sigma * prior.sigma;
            // Variance of the residual of the prior.
            let told = claimed - variance;
            if told > claimed * lit(UNCHECKED) && strength(off * off / told, 1) > least {
                prior.sigma = prior.sigma.max(off.abs());
                has_widened = true;
            }
        }
        has_widened
    }
}

#[cfg(test)]
mod tests {
    use super::strength;

    /// Chi squared that chance exceeds once in 100,000, from the regularised incomplete gamma
    /// function.
    #[test]
    fn once_in_a_hundred_thousand() {
        for (degrees, chi_squared) in [
            (1, 19.511_421),
            (2, 23.025_851),
            (3, 25.901_749),
            (4, 28.473_255),
            (6, 33.107_057),
            (10, 41.296_158),
        ] {
            let double = strength::<f64>(chi_squared, degrees);
            assert!((double - 11.513).abs() < 0.08, "{degrees}: {double}");
            let single = f64::from(strength::<f32>(chi_squared as f32, degrees));
            assert!((single - double).abs() < 1e-4, "{degrees}: {single}");
        }
        assert_eq!(strength(3.0_f64, 4), 0.0);
        assert_eq!(strength(100.0_f64, 0), 0.0);
    }

    /// At equal chi squared fewer degrees of freedom are stronger.
    #[test]
    fn fewer_degrees_are_stronger() {
        for degrees in 1..30 {
            for chi_squared in [80.0, 500.0_f64, 1e4] {
                assert!(strength(chi_squared, degrees) > strength(chi_squared, degrees + 1));
            }
        }
    }
}
