//! Contradictions are found, left out and named; the possible effect of one undetected fault is told.
//!
//! **Test.** The largest normalised statistic over single bearings, legs, and all that a camera has seen
//! since some stop (it was bumped, or is stuck). Only the strongest one is left out, and everything is solved
//! again before the next one is looked for: one wrong measurement makes many residuals large. Baarda's data
//! snooping; as receivers of satellite navigation check themselves (RAIM). A measurement that was left out
//! and agrees later comes back.
//!
//! All of it comes from the covariances of a solve, without another pass. Without a camera's last sights chi
//! squared falls by `r^T (1 - H)^-1 r` of these, `H` being their predicted covariance.
//!
//! **Protection level.** A fault of a measurement that its test just misses moves an unknown by at most
//! `|C g| (4.42 + 3.09) / sqrt(1 - h)`: limit of the test plus the margin with which it misses one
//! in a thousand, in sigmas of the measurement. The largest over all measurements, and 3.09 sigmas
//! of noise, bound the error that one undetected fault leaves. Measurements that nothing checks
//! leave no bound worth the name.

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
/// A camera is looked at as a whole once chance exceeds one of its bearings only once in a hundred, or in a
/// twentieth of all bearings if that is rarer.
const SUSPICION: f64 = 4.6;
/// Sigmas of a test that one good measurement in 100,000 fails, plus those by which a fault has to
/// exceed them to be missed once in a thousand.
const DETECTED: f64 = 4.42 + RARE;
/// Redundancies below this count as this much.
const LEAST_REDUNDANCY: f64 = 1e-4;
/// Bearings of a camera, one after the other, that are off: it is no longer what it was.
pub(super) const IN_A_ROW: usize = 2;
/// Odds of a bearing that repeats the camera's last one to the bit, although the target has moved.
const OF_REPEATED: f64 = 2.0;
/// Odds of a leg: where it and a bearing explain the same, the loss is less without the bearing.
const OF_LEG: f64 = 0.95;
/// Odds of a tail: one wrong bearing explains itself.
const OF_TAIL: f64 = 0.9;
/// The legs' claim is believed while the sum of their squares is within so many of its sigmas.
const BELIEVED: f64 = 2.0;
/// A claim is far too small where more than half of the legs err by more than twice of what half of them may: chi
/// squared of one and of two degrees of freedom.
const LOOSE: [f64; 2] = [4.0 * 0.455, 4.0 * 1.386];
/// So many legs at least tell that.
const LOOSE_LEGS: usize = 6;
/// The legs' claimed variance counts as much as so many residuals.
const PSEUDO_SAMPLES: f64 = 6.0;

/// Rarity of a chi squared by chance: minus the logarithm of its probability, so that statistics
/// of different degrees of freedom can be compared. By the first term of the asymptotic series of the
/// incomplete gamma function (Abramowitz and Stegun, 6.5.32): exact for two degrees, and to a
/// hundredth for others from the limit on. Zero where chance exceeds it often.
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

/// Result of a look at every measurement.
#[derive(Clone, Copy, Debug)]
pub(super) struct Survey<T> {
    /// Next.
    camera: usize,
    protects: bool,
    strongest: Option<(Finding<T>, T)>,
    /// The strongest that is not a whole camera.
    single: Option<(Finding<T>, T)>,
    /// The leg that may be to blame for a suspect, and its chi squared.
    leg: Option<(usize, T)>,
    /// The sum of the legs' squared residuals, in claimed sigmas, and its expectation.
    squares: T,
    redundancy: T,
    /// Legs that are checked, and those that err by [much more](LOOSE) than they claim.
    legs: usize,
    loose: usize,
    /// The next step once all measurements were looked at: the last sights of this camera.
    tail: Option<usize>,
    /// Of the solve that [`verify`](Problem::verify) is at: chi squared where it begins.
    cost: Option<T>,
    /// Least chi squared with all sightings.
    all: Option<T>,
}

impl<T: Real> Survey<T> {
    /// The contradiction that is too strong for chance.
    pub(super) fn found(&self) -> Option<Finding<T>> {
        let beyond = self
            .strongest
            .filter(|(_, strength)| *strength > lit(LIMIT));
        beyond.map(|(found, _)| found)
    }

    /// Rarity by chance of the strongest contradiction.
    pub(super) fn strength(&self) -> T {
        let strongest = self.strongest.filter(|_| self.found().is_some());
        strongest.map_or_else(T::zero, |(_, strength)| strength)
    }

    /// `odds` decide between findings of equal strength.
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
    /// Begins a look at what every measurement says against the rest and, if asked, at its possible unseen
    /// effect on the pose of every camera.
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

    /// One camera: its sights, and their effect and that of everything else on it; with the first camera all
    /// legs. Or, in the search for contradictions, the last sights of a camera under suspicion.
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
            // An unknown that is not determined contradicts nothing, and moves nothing.
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

    /// Possible effect of a fault of any measurement on a camera, and of noise without a fault.
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

    /// Returns true if a bearing is to the bit the camera's last one before it.
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

    /// Contradiction of all that a camera saw since a stop: the fall of chi squared without it. Of
    /// [`IN_A_ROW`] bearings or more, which leave it enough for a pose.
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

    /// A slice of a solve without the sightings that a camera is blamed for: where nothing fits, and estimates came to
    /// no end, closed forms in single precision say too much of a camera right before the target. A finding that
    /// does not stand this test is dropped.
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

    /// A slice of the way to the least chi squared, as far as the model is linear. `cost` is that of the present
    /// estimates once it is known.
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

    /// Leaves out a finding. A camera whose last bearings are all off is no longer as it was, or the
    /// way to where it saw them was not as measured: then nothing is left out for good yet, and the next
    /// surveys tell.
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

    /// Decides between the camera and the leg, once everything is solved with the suspect's bearings, and
    /// then again without the leg that explains them best.
    pub(super) fn decide(&mut self, survey: &Survey<T>) -> Option<Finding<T>> {
        let suspect = self.common.suspect.take()?;
        let (camera, from) = (usize::from(suspect.camera), usize::from(suspect.from));
        let found = survey.found();
        match suspect.leg {
            None => {
                // Any of several legs between the same sightings will do.
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
        // A camera that seemed to be moved near it may see rightly where the target really is.
        self.undo_moves(Some(stop));
        self.count_leg(stop, Standing::Excluded);
    }

    /// Returns true if the leg to a stop may be to blame for the suspect's sightings: since it saw rightly.
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

    /// The stop since which all bearings of a camera are left out, if they are [`IN_A_ROW`] or more.
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

    /// The finding, with the stop from which on it still holds now that everything is solved without.
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

    /// Doubles the noise of all legs if most of them err by far more than they claim. Before anything is left out: else
    /// good bearings go one after the other until the rest fits the claim. A single wrong leg, or a camera that was
    /// moved, is off for few legs. Returns true if that changes anything.
    pub(super) fn loosen_legs(&mut self, survey: &Survey<T>) -> bool {
        let is_loose = survey.legs >= LOOSE_LEGS && 2 * survey.loose > survey.legs;
        if is_loose {
            self.common.leg_factor *= lit(2.0);
        }
        is_loose
    }

    /// Estimates from the legs' own residuals by how much they err more, or less, than they claim; the claim
    /// counts as much as six. It is believed until their residuals contradict it: a factor from few of them
    /// errs more than most claims. Returns true if that changes anything.
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

    /// Widens a prior of the carrier to its error if all measurements together contradict it more strongly
    /// than anything else. Returns true if there was one.
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
            // The variance of its residual.
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

    /// At equal chi squared the one with fewer degrees is the rarer.
    #[test]
    fn fewer_degrees_are_stronger() {
        for degrees in 1..30 {
            for chi_squared in [80.0, 500.0_f64, 1e4] {
                assert!(strength(chi_squared, degrees) > strength(chi_squared, degrees + 1));
            }
        }
    }
}
