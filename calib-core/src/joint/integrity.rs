//! What contradicts the rest is found, left out and named; what one undetected fault could do is
//! told.
//!
//! **Test.** The largest normalised statistic over single bearings, legs, and all that a camera has
//! seen since some stop (it was bumped, or is stuck). Alone what stands out most is left out, and
//! everything is solved again before the next one is looked for: one wrong measurement makes many
//! residuals large. Baarda's data snooping; as receivers of satellite navigation check themselves
//! (RAIM). What was left out and agrees later comes back.
//!
//! **Protection level.** A fault of a measurement that its test just misses moves an unknown by at most
//! `|C g| (4.42 + 3.09) / sqrt(1 - h)`: limit of the test plus the margin with which it misses one
//! in a thousand, in sigmas of the measurement. The largest over all measurements, and 3.09 sigmas
//! of noise, bound the error that one undetected fault leaves. Measurements that nothing checks
//! leave no bound worth the name.

use super::{
    Finding, ProtectionLevels,
    answers::dot,
    problem::{Problem, REFERENCES, Sight, Standing},
    sweep::{Pass, Without},
    triangle::packed,
};
use crate::{Limits, Real, Refusal, numerics::real::lit};

/// Strength of a statistic that chance exceeds once in 100,000: 4.42 sigmas of a single one.
const LIMIT: f64 = 11.51;
/// A camera is looked at as a whole once chance exceeds one of its bearings only once in a hundred.
const SUSPICION: f64 = 4.6;
/// Sigmas of a test that one good measurement in 100,000 fails, plus those by which a fault has to
/// exceed them to be missed once in a thousand.
const DETECTED: f64 = 4.42 + 3.09;
/// Noise exceeds so many sigmas once in a thousand, on both sides of a position's.
const NOISE: f64 = 3.09;
/// What is less checked than this counts as this much.
const LEAST_REDUNDANCY: f64 = 1e-4;
/// Bearings of a camera, one after the other, that are off: it is no longer what it was.
const IN_A_ROW: usize = 2;
/// The legs' claimed variance counts as much as so many residuals.
const PSEUDO_SAMPLES: f64 = 6.0;
/// Rounds of the legs' noise.
const ROUNDS: usize = 4;

/// How rarely chance exceeds a chi squared: minus the logarithm of its probability, so that statistics
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

impl<T: Real> Problem<'_, T> {
    /// Leaves out what contradicts most, if anything does, and solves again.
    #[inline(never)] // size
    pub(super) fn check(&mut self, limits: &Limits<T>) -> Result<Option<Finding<T>>, Refusal> {
        let Some((found, strongest)) = self.strongest()? else {
            return Ok(None);
        };
        if !(strongest > lit(LIMIT)) {
            return Ok(None);
        }
        let found = self.leave_out(found);
        match self.settle(limits) {
            // What contradicts may keep it from coming to an end: there is more to leave out.
            Ok(_) | Err(Refusal::DidNotConverge) => Ok(Some(found)),
            Err(why) => Err(why),
        }
    }

    /// What contradicts most, with its strength.
    fn strongest(&mut self) -> Result<Option<(Finding<T>, T)>, Refusal> {
        let mut strongest: Option<(Finding<T>, T)> = None;
        let mut offer = |found: Finding<T>, strength: T| {
            if strongest.as_ref().is_none_or(|(_, most)| strength > *most) {
                strongest = Some((found, strength));
            }
        };
        for camera in self.cameras.iter_mut() {
            camera.is_new = false;
        }
        for stop in 0..self.stops.len() {
            for n in 0..self.sights.len() {
                let Some(sight) = self.sights.get(n) else {
                    break;
                };
                let camera = usize::from(sight.camera);
                let counts = sight.standing == Standing::Counts && self.is_estimated(camera);
                if usize::from(sight.stop) != stop || !counts {
                    continue;
                }
                // What is not determined contradicts nothing.
                let residual = self.bearing_residual(n).ok();
                let Some(off) = residual.and_then(|residual| residual.normalised) else {
                    continue;
                };
                let strength = strength(off * off, 1);
                offer(Finding::Bearing { stop, camera, off }, strength);
                if let Some(camera) = self.cameras.get_mut(camera) {
                    camera.is_new |= strength > lit(SUSPICION);
                }
            }
            if self.leg_rows(stop + 1).is_some()
                && let Ok(leg) = self.leg_residual(stop + 1)
                && leg.standing == Standing::Counts
            {
                let found = Finding::Leg {
                    stop: leg.stop,
                    chi_squared: leg.chi_squared,
                };
                offer(found, strength(leg.chi_squared, leg.degrees_of_freedom));
            }
        }
        for camera in REFERENCES..self.cameras.len() {
            let suspect = self.cameras.get(camera).is_some_and(|camera| camera.is_new);
            if suspect {
                self.tails(camera, &mut offer)
                    .ok_or(Refusal::Undetermined)?;
            }
        }
        for camera in self.cameras.iter_mut() {
            camera.is_new = false;
        }
        Ok(strongest)
    }

    /// What everything that a camera saw since a stop contradicts: chi squared with it less chi
    /// squared without.
    fn tails(&mut self, camera: usize, offer: &mut impl FnMut(Finding<T>, T)) -> Option<()> {
        let last = self.stops.len().checked_sub(1)?;
        let chi_squared = |pass: Pass<T>| pass.cost - pass.worth;
        let all = chi_squared(self.sweep(last, Without::Nothing)?);
        let count = self.counting(camera);
        let number = u16::try_from(camera).ok()?;
        for stop in 1..self.stops.len() {
            let from = u16::try_from(stop).ok()?;
            let tail = { self.sights.iter() }.filter(|sight| {
                sight.camera == number && sight.stop >= from && sight.standing == Standing::Counts
            });
            let begins = tail.clone().any(|sight| sight.stop == from);
            let removed = tail.count();
            if !begins || removed < IN_A_ROW {
                continue;
            }
            // Bearings that the camera's own unknowns can then no longer follow.
            let lost = 3_usize.saturating_sub(count.saturating_sub(removed)).min(3);
            let without = Without::Tail {
                camera: number,
                from,
            };
            let rest = chi_squared(self.sweep(last, without)?);
            let found = Finding::Camera {
                camera,
                from: stop,
                chi_squared: all - rest,
            };
            offer(found, strength(all - rest, removed.saturating_sub(lost)));
        }
        self.sweep(last, Without::Nothing)?;
        Some(())
    }

    /// A camera whose last bearings are all off is no longer what it was.
    fn leave_out(&mut self, found: Finding<T>) -> Finding<T> {
        match found {
            Finding::Bearing { stop, camera, off } => {
                for sight in self.sights.iter_mut() {
                    if usize::from(sight.stop) == stop && usize::from(sight.camera) == camera {
                        sight.standing = Standing::Excluded;
                    }
                }
                let counts = |sight: &&Sight<T>| {
                    usize::from(sight.camera) == camera && sight.standing == Standing::Counts
                };
                let good = self
                    .sights
                    .iter()
                    .filter(counts)
                    .map(|sight| sight.stop)
                    .max();
                let is_off = |sight: &&Sight<T>| {
                    usize::from(sight.camera) == camera
                        && sight.standing == Standing::Excluded
                        && good.is_none_or(|good| sight.stop > good)
                };
                let since = self.sights.iter().filter(is_off);
                let from = since.clone().map(|sight| usize::from(sight.stop)).min();
                match from {
                    Some(from) if since.count() >= IN_A_ROW => {
                        self.distrust(camera, from);
                        Finding::Camera {
                            camera,
                            from,
                            chi_squared: off * off,
                        }
                    }
                    _ => found,
                }
            }
            Finding::Leg { stop, .. } => {
                if let Some(stop) = self.stops.get_mut(stop) {
                    stop.standing = Standing::Excluded;
                }
                found
            }
            Finding::Camera { camera, from, .. } => {
                self.distrust(camera, from);
                found
            }
        }
    }

    fn distrust(&mut self, camera: usize, from: usize) {
        for sight in self.sights.iter_mut() {
            if usize::from(sight.camera) == camera && usize::from(sight.stop) >= from {
                sight.standing = Standing::Distrusted;
            }
        }
    }

    /// By how much the legs err more, or less, than they claim, from their own residuals, with a claim
    /// that counts as much as six. Solves again with it.
    #[inline(never)] // size
    pub(super) fn fit_leg_noise(&mut self, limits: &Limits<T>) -> Result<T, Refusal> {
        for _ in 0..ROUNDS {
            let (mut squares, mut redundancy) =
                (lit::<T>(PSEUDO_SAMPLES), lit::<T>(PSEUDO_SAMPLES));
            for stop in 1..self.stops.len() {
                match self.leg_residual(stop) {
                    Ok(leg) if leg.standing == Standing::Counts => {
                        squares += leg.squared;
                        redundancy += leg.redundancy;
                    }
                    Ok(_) | Err(Refusal::TooFew) => {}
                    Err(why) => return Err(why),
                }
            }
            let factor = (squares / redundancy).sqrt();
            self.common.leg_factor *= factor;
            self.settle(limits)?;
            if (factor - T::one()).abs() < lit(0.01) {
                break;
            }
        }
        Ok(self.common.leg_factor)
    }

    /// Protection levels of every camera.
    #[inline(never)] // size
    pub(super) fn protect(&mut self) -> Result<(), Refusal> {
        let undetermined = Refusal::Undetermined;
        for camera in self.cameras.iter_mut() {
            camera.protection = ProtectionLevels::default();
        }
        for stop in 0..self.stops.len() {
            self.hold(stop).ok_or(undetermined)?;
            for n in 0..self.sights.len() {
                let Some(&sight) = self.sights.get(n) else {
                    break;
                };
                let counts = sight.standing == Standing::Counts
                    && self.is_estimated(usize::from(sight.camera));
                if counts && usize::from(sight.stop) == stop {
                    self.enter_sight(&sight).ok_or(undetermined)?;
                    self.add_influence(false).ok_or(undetermined)?;
                }
            }
            for row in self.leg_rows(stop + 1).iter().flatten() {
                self.enter_leg(0, row).ok_or(undetermined)?;
                self.add_influence(true).ok_or(undetermined)?;
            }
        }
        for n in REFERENCES..self.cameras.len() {
            let Ok(pose) = self.pose(n) else { continue };
            let Some(camera) = self.cameras.get_mut(n) else {
                break;
            };
            let noise = lit::<T>(NOISE);
            let levels = &mut camera.protection;
            for level in [&mut levels.position_bearing, &mut levels.position_leg] {
                *level += pose.sigma_position() * noise;
            }
            for level in [&mut levels.heading_bearing, &mut levels.heading_leg] {
                *level += pose.sigma_heading() * noise;
            }
        }
        Ok(())
    }

    /// What a fault of the measurement whose row is in the first vector does to every camera.
    fn add_influence(&mut self, is_leg: bool) -> Option<()> {
        let width = self.width();
        let (triangle, [g, ..]) = self.triangle()?;
        triangle.forward_substitute(g)?;
        let redundancy = (T::one() - dot(g, g)).max(lit(LEAST_REDUNDANCY));
        triangle.back_substitute(g);
        let size = lit::<T>(DETECTED) / redundancy.sqrt();
        let offset = packed(width);
        let numbers = &*self.workspace;
        let at = |column: usize| {
            let number = numbers.get(offset + column).copied();
            number.unwrap_or_else(T::zero) * size
        };
        for camera in self.cameras.iter_mut().skip(REFERENCES) {
            let Some(column) = camera.column.map(usize::from) else {
                continue;
            };
            let (x, y) = (at(column), at(column + 1));
            let (position, heading) = ((x * x + y * y).sqrt(), at(column + 2).abs());
            let levels = &mut camera.protection;
            let (of_position, of_heading) = if is_leg {
                (&mut levels.position_leg, &mut levels.heading_leg)
            } else {
                (&mut levels.position_bearing, &mut levels.heading_bearing)
            };
            *of_position = of_position.max(position);
            *of_heading = of_heading.max(heading);
        }
        Some(())
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

    /// Of equal chi squared that of fewer degrees is the rarer.
    #[test]
    fn fewer_degrees_are_stronger() {
        for degrees in 1..30 {
            for chi_squared in [80.0, 500.0_f64, 1e4] {
                assert!(strength(chi_squared, degrees) > strength(chi_squared, degrees + 1));
            }
        }
    }
}
