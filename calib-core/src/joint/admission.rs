//! Admission: the cameras that take part.
//!
//! A camera seen once or twice is a ring, not a Gaussian: its bearings wait, raw, until there are
//! enough for a closed form. From four on they must agree with each other (consensus of three:
//! [`solve_rejecting`]). One with exactly three agrees with anything and tells the others nothing,
//! so it is solved last, when they are settled.

use nalgebra::{Matrix2, Point2};

use super::descent::WITNESSED;
use super::problem::{NONE, Problem, REFERENCES, Sight, Standing};
use crate::{
    Limits, Pose, Ray, Real, Refusal, Sighting,
    numerics::real::lit,
    resection::{solve, solve_rejecting},
};

/// Bearings of a camera that an admission looks at: triples are drawn from no more.
const MOST: usize = 16;
/// Chi squared by which one pose fits better than another one: one in 400 of the right ones by chance.
const AS_GOOD: f64 = 9.0;
/// Chi squared over degrees of freedom is not less than this but by chance.
const LEAST_NOISE: f64 = 0.3;
/// Bearings off the consensus by more sigmas do not belong to it.
const GATE: f64 = 4.0;
/// A pose that rests on the camera's bearings alone may be so many times less certain than the limits allow:
/// for these a place is as uncertain as the leg that led there, and sightings of it by other cameras are left
/// out unless they tell far more. The pose from all bearings together has to be within the limits.
const ADMITTED: f64 = 4.0;
/// Ratio of the determinants of two informations of a place from which on one tells far more: ten times in each
/// direction.
const FAR_MORE: f64 = 1e4;
/// Least number of different bearings of a camera that stands for one that was moved.
const DIFFERENT: usize = 3;

impl<T: Real> Problem<'_, T> {
    /// The next waiting camera, from one on, with `least` bearings or more, and with others than when it was
    /// last looked at.
    pub(super) fn next_waiting(&self, from: usize, least: usize) -> Option<usize> {
        (from..self.cameras.len()).find(|&camera| {
            let bearings = self.counting(camera);
            let count = u16::try_from(bearings).unwrap_or(u16::MAX);
            let least = if self.is_successor(camera) {
                least.max(WITNESSED)
            } else {
                least
            };
            let waits = { self.cameras.get(camera) }
                .is_some_and(|unknown| !unknown.takes_part && unknown.tried != count);
            waits && bearings >= least
        })
    }

    /// Returns true if a camera repeats itself, as a stuck one does. A camera that stands for a moved one may
    /// begin with one or two bearings that were still good.
    fn repeats_itself(&self, camera: usize) -> bool {
        let least = if self.is_successor(camera) {
            DIFFERENT
        } else {
            2
        };
        let (mut values, mut count) = ([T::zero(); DIFFERENT], 0);
        for sight in self.of(camera) {
            let known = values.get(..count).unwrap_or_default();
            if !known.contains(&sight.value)
                && let Some(value) = values.get_mut(count)
            {
                *value = sight.value;
                count += 1;
            }
        }
        count < least
    }

    /// Takes in a camera if its bearings give a pose within the limits. Returns true if it was taken in.
    #[inline(never)] // for less flash
    pub(super) fn admit(&mut self, camera: usize, limits: &Limits<T>) -> bool {
        let count = u16::try_from(self.counting(camera)).unwrap_or(u16::MAX);
        if let Some(unknown) = self.cameras.get_mut(camera) {
            unknown.trust_lens();
        }
        let mut pose = None;
        if !self.repeats_itself(camera) {
            let factor = if usize::from(count) < WITNESSED {
                T::one()
            } else {
                lit(ADMITTED)
            };
            let limits = Limits {
                position: limits.position * factor,
                heading: limits.heading * factor,
            };
            pose = self.resect(camera).ok().filter(|pose| limits.allow(pose));
        }
        let Some(unknown) = self.cameras.get_mut(camera) else {
            return false;
        };
        let Some(pose) = pose else {
            unknown.tried = count;
            return false;
        };
        unknown.put(pose.position.coords);
        unknown.turn(pose.heading);
        unknown.takes_part = true;
        unknown.is_new = true;
        true
    }

    /// Puts a camera back among those that wait when it no longer is what it was let in for: its target is
    /// behind it, or it is less certain than the limits allow. Returns the number of these cameras.
    pub(super) fn evict(&mut self, limits: &Limits<T>) -> usize {
        // Covariances are of all of them: first all are judged, then the bad ones leave.
        for camera in REFERENCES..self.cameras.len() {
            let stays = !self.is_estimated(camera)
                || (self.is_in_front(camera)
                    && self.pose(camera).is_ok_and(|pose| limits.allow(&pose)));
            if let Some(unknown) = self.cameras.get_mut(camera) {
                unknown.is_new = !stays;
            }
        }
        let mut evicted = 0;
        for camera in REFERENCES..self.cameras.len() {
            if self.cameras.get(camera).is_some_and(|camera| camera.is_new) {
                self.dismiss(camera);
                evicted += 1;
            }
        }
        evicted
    }

    /// No longer estimates a camera, until it has other bearings.
    pub(super) fn dismiss(&mut self, camera: usize) {
        let count = self.counting(camera);
        if let Some(unknown) = self.cameras.get_mut(camera) {
            unknown.takes_part = false;
            unknown.tried = u16::try_from(count).unwrap_or(u16::MAX);
        }
    }

    /// Bearings of a camera that count.
    pub(super) fn counting(&self, camera: usize) -> usize {
        self.of(camera).count()
    }

    fn of(&self, camera: usize) -> impl Iterator<Item = &Sight<T>> {
        self.own(camera)
            .map(|(_, sight)| sight)
            .filter(|sight| sight.is_bearing() && sight.standing == Standing::Counts)
            .filter(|sight| self.placed(sight.stop).is_some())
    }

    pub(super) fn is_in_front(&self, camera: usize) -> bool {
        let quarter = T::frac_pi_2();
        self.of(camera).all(|sight| {
            let row = self.sight_row(sight);
            row.is_some_and(|row| (row.residual * sight.sigma).abs() < quarter)
        })
    }

    /// The pose that a camera's bearings give from the estimated places. Those that do not agree are
    /// excluded.
    #[inline(never)] // for less stack
    fn resect(&mut self, camera: usize) -> Result<Pose<T>, Refusal> {
        let (sightings, used) = self.seen(camera, |sight| self.sighting(sight))?;
        let sightings = sightings.get(..used).unwrap_or_default();
        if used <= 3 {
            return Ok(solve(sightings)?.pose);
        }
        let mut dropped = [false; MOST];
        let dropped = dropped.get_mut(..used).unwrap_or_default();
        let pose = solve_rejecting(sightings, lit(GATE), dropped)?.pose;
        self.exclude_off(camera, &pose);
        Ok(pose)
    }

    /// Sightings of a camera, and their number: of many as many as there is room for, spread over all.
    #[inline(never)] // for less flash
    fn seen(
        &self,
        camera: usize,
        sighting: impl Fn(&Sight<T>) -> Option<Sighting<T>>,
    ) -> Result<([Sighting<T>; MOST], usize), Refusal> {
        let nothing = Sighting::new(Point2::origin(), Ray::from_bearing(T::zero()), T::one());
        let mut sightings = [nothing; MOST];
        let all = self.counting(camera);
        let mut used = 0;
        let sights = self.of(camera).enumerate();
        let spread = sights.filter(|(n, _)| all <= MOST || n * MOST / all != (n + 1) * MOST / all);
        for (to, (_, sight)) in sightings.iter_mut().zip(spread) {
            *to = sighting(sight).ok_or(Refusal::TooFew)?;
            used += 1;
        }
        Ok((sightings, used))
    }

    /// Position that the bearings of a level camera fit, left and right exchanged, as well as they fit any as they are. Stops
    /// nearly on a line leave that open: a camera on their other side that hangs upside down would see them so. Three
    /// bearings fit such a pose in any case, and tell nothing.
    #[inline(never)] // for less stack
    pub(super) fn mirrored(&self, camera: usize) -> Option<Point2<T>> {
        let of = self.cameras.get(camera)?;
        let (mut sightings, used) = { of.mounting.is_level() }
            .then(|| self.seen(camera, |sight| self.own_sighting(sight)).ok())??;
        let sightings = sightings.get_mut(..used)?;
        let beyond = used.checked_sub(3).filter(|beyond| *beyond > 0)?;
        let upright = solve(sightings);
        for Sighting { ray, .. } in sightings.iter_mut() {
            ray.left = -ray.left;
        }
        let mirrored = solve(sightings).ok()?;
        let is_as_good = match upright {
            Ok(upright) => {
                // Sigmas may be too large. Then a worse pose is told by less.
                let noise = upright.chi_squared / T::whole(beyond as u32);
                let noise = noise.max(lit(LEAST_NOISE)).min(T::one());
                mirrored.chi_squared < upright.chi_squared + noise * lit(AS_GOOD)
            }
            Err(_) => true,
        };
        is_as_good.then_some(mirrored.pose.position)
    }

    /// A bearing at the estimated place of its stop.
    fn own_sighting(&self, sight: &Sight<T>) -> Option<Sighting<T>> {
        let place = self.placed(sight.stop)?;
        let (bearing, sigma) = self.bearing_at(sight);
        let mut sighting = Sighting::new(place, Ray::from_bearing(bearing), sigma);
        let standing = self.common.standing;
        sighting.target_covariance = Matrix2::from_diagonal_element(standing * standing);
        Some(sighting)
    }

    /// A bearing as the camera would solve it on its own: places are as uncertain, against each
    /// other, as the leg that led there, or as other cameras see them if these tell far more: the leg may not have
    /// been measured.
    fn sighting(&self, sight: &Sight<T>) -> Option<Sighting<T>> {
        let stop = self.stops.get(usize::from(sight.stop))?;
        let [w11, w21, w22] = stop.root;
        let (bearing, sigma) = self.bearing_at(sight);
        let mut sighting =
            Sighting::new(self.placed(sight.stop)?, Ray::from_bearing(bearing), sigma);
        let of_leg = Matrix2::new(w11 * w11 + w21 * w21, w21 * w22, w21 * w22, w22 * w22);
        let of_others = self.told_by_others(sight);
        let [by_leg, by_others] = [of_leg, of_others].map(|of| of.determinant());
        let information = if by_others > by_leg * lit(FAR_MORE) {
            of_others
        } else {
            of_leg
        };
        if let Some(covariance) = information.try_inverse() {
            sighting.target_covariance = covariance;
        }
        let standing = self.common.standing;
        for axis in 0..2 {
            if let Some(variance) = sighting.target_covariance.get_mut((axis, axis)) {
                *variance += standing * standing;
            }
        }
        Some(sighting)
    }

    /// Information that other cameras' bearings give of the place of a sight.
    fn told_by_others(&self, sight: &Sight<T>) -> Matrix2<T> {
        let mut information = Matrix2::zeros();
        for other in self.sights.iter() {
            if other.stop == sight.stop
                && other.camera != sight.camera
                && other.standing == Standing::Counts
                && let Some(row) = self.sight_row(other)
            {
                information += row.by_place * row.by_place.transpose();
            }
        }
        information
    }

    /// Excludes the bearings that are off the consensus.
    fn exclude_off(&mut self, camera: usize, pose: &Pose<T>) {
        let gate = lit::<T>(GATE * GATE);
        let mut next = self.cameras.get(camera).map_or(NONE, |camera| camera.last);
        while let Some((n, sight)) = self.next_own(&mut next) {
            if !sight.is_bearing() || sight.standing != Standing::Counts {
                continue;
            }
            let Some(sighting) = self.sighting(&sight) else {
                continue;
            };
            let to_target = sighting.target - pose.position;
            let residual = sighting.ray.residual(pose.heading, to_target);
            let range2 = to_target.norm_squared();
            let variance = sighting.bearing_variance_range4(to_target) / (range2 * range2);
            if !(residual * residual <= variance * gate)
                && let Some(sight) = self.sights.get_mut(n)
            {
                sight.standing = Standing::Excluded;
            }
        }
    }
}
