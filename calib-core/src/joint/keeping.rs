//! Measurements over a restart, and when there are more than there is room for.
//!
//! Estimates are made anew from measurements, so these are all that must be kept. Each stop has a
//! [`StopTag`] of its caller's, by which its record is found again; a bearing is found by its place in
//! the list. A restart may come while records are written: so a leg says at which stop it began
//! ([`RestoredLeg`]), and one that began elsewhere than at the stop before is none.
//!
//! # Room
//! [`remove_stop`](JointEstimator::remove_stop) drops a stop's bearings and makes one leg of the two
//! that meet there. Displacements and their covariances add up, in the frame of the carrier whose scale and
//! compass both share. So nothing but the bearings is lost: the sum says of all other stops what the two legs
//! said. Sigmas grow by the worth of the bearings.

use nalgebra::{Matrix2, Vector2};

use super::{
    JointError, JointEstimator, Leg, Quantity,
    estimator::index,
    problem::{REFERENCES, Sight, Standing, Stop, Told, root_information},
    round::Work,
};
use crate::{Real, angle::wrap_signed, level::Elevation, numerics::real::lit};

/// Bearings that a pose takes.
const FEWEST: usize = 3;

/// Label of a stop by the caller; the estimator keeps it and makes nothing of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StopTag {
    /// Its number in the walk; of a later stop it is higher, modulo 2^16.
    pub number: u16,
    /// Where it is written down.
    pub slot: u8,
}

/// A leg of a former run, and the number of the stop at which it began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestoredLeg<T: Real> {
    /// [`StopTag::number`] of the stop before.
    pub from: u16,
    /// The way from there.
    pub leg: Leg<T>,
}

/// A measurement as it was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured<T> {
    /// The stop.
    pub stop: usize,
    /// The camera.
    pub camera: usize,
    /// Bearing or range.
    pub quantity: Quantity,
    /// Radians to the left of the axis, or a distance.
    pub value: T,
    /// Its standard deviation.
    pub sigma: T,
    /// Of a bearing: how far above the camera's horizontal plane, if that is known.
    pub elevation: Elevation,
}

impl<T: Real> JointEstimator<'_, T> {
    /// Names a stop.
    ///
    /// # Errors
    /// [`JointError::Unknown`].
    pub fn tag_stop(&mut self, stop: usize, tag: StopTag) -> Result<(), JointError> {
        let stop = self.stops.all_mut().get_mut(stop);
        stop.ok_or(JointError::Unknown)?.tag = tag;
        Ok(())
    }

    /// The tags of all stops, in their order.
    pub fn tags(&self) -> impl DoubleEndedIterator<Item = StopTag> + ExactSizeIterator {
        self.stops.all().iter().map(|stop| stop.tag)
    }

    /// The way by which the target came to a stop, as it was measured; `None` where it was not.
    pub fn leg(&self, stop: usize) -> Option<Leg<T>> {
        measured_leg(self.stops.all().get(stop)?)
    }

    /// Measurement `n`, in the order in which they are kept: that in which they came, until a stop is
    /// [removed](Self::remove_stop). Then the last ones take the places of its own.
    pub fn measured(&self, n: usize) -> Option<Measured<T>> {
        let sight = self.sights.all().get(n)?;
        Some(Measured {
            stop: sight.stop.into(),
            camera: sight.camera.into(),
            quantity: sight.quantity,
            value: sight.value,
            sigma: sight.sigma,
            elevation: sight.elevation,
        })
    }

    /// Takes up a stop of a former run, in any order, before bearings and before the first round.
    /// [`sort_restored`](Self::sort_restored) is to be called when all are there.
    ///
    /// # Errors
    /// [`JointError::Full`]; [`JointError::NotFinite`]; [`JointError::Taken`] for a number that is
    /// there, and after the first bearing.
    pub fn restore_stop(
        &mut self,
        tag: StopTag,
        leg: Option<RestoredLeg<T>>,
    ) -> Result<(), JointError> {
        let is_known = self.tags().any(|known| known.number == tag.number);
        if is_known || self.sights.len > 0 {
            return Err(JointError::Taken);
        }
        let stop = self.push_stop(leg.map(|leg| leg.leg))?;
        let stop = self.stops.all_mut().get_mut(stop);
        let stop = stop.ok_or(JointError::Unknown)?;
        stop.tag = tag;
        // The number of the stop where it began, until all are there.
        if let Some(leg) = leg {
            stop.step.x = lit(f64::from(leg.from));
        }
        Ok(())
    }

    /// Puts the stops that were [restored](Self::restore_stop) in their order. Those after stop `last`
    /// are none, nor are legs that did not begin at the stop before.
    pub fn sort_restored(&mut self, last: u16) {
        // Before the last one it is below zero.
        let order = |stop: &Stop<T>| stop.tag.number.wrapping_sub(last).cast_signed();
        let stops = self.stops.all_mut();
        for sorted in 1..stops.len() {
            for later in (1..=sorted).rev() {
                let pair = stops.get_mut(later - 1..=later);
                match pair {
                    Some([a, b]) if order(a) > order(b) => core::mem::swap(a, b),
                    _ => break,
                }
            }
        }
        let count = stops.iter().take_while(|stop| order(stop) <= 0).count();
        self.stops.len = count;
        let mut before = None;
        for stop in self.stops.all_mut() {
            let from = core::mem::replace(&mut stop.step.x, T::zero());
            if before.is_none_or(|before: u16| lit::<T>(f64::from(before)) != from) {
                forget_leg(stop);
            }
            before = Some(stop.tag.number);
        }
    }

    /// The stop that is missed least, so that another one has room: the one whose least seen camera has been
    /// seen most often, or one that no camera saw. Among equals it is the oldest; never the last one. `None`
    /// where there are fewer than two.
    ///
    /// So no camera is forgotten because the target has long been elsewhere, and the references keep the
    /// sightings that the frame needs.
    pub fn least_missed(&self) -> Option<usize> {
        let fewest = |stop: usize| {
            let sights = self.sights.all().iter();
            let cameras = sights.filter(|sight| usize::from(sight.stop) == stop);
            let counts = cameras.map(|sight| {
                let all = self.sights.all().iter();
                all.filter(|other| other.camera == sight.camera).count()
            });
            counts.min().unwrap_or(usize::MAX)
        };
        let candidates = 0..self.stops.len.checked_sub(1)?;
        // Among equals `max_by_key` takes the last.
        candidates.rev().max_by_key(|stop| fewest(*stop))
    }

    /// Returns true if a stop cannot be told from the one before: two cameras or more saw the target at both,
    /// no camera saw it here alone, and for each it looked the same within `sigmas` of both looks' errors.
    ///
    /// Where a target stands for long, and no leg tells one stop from the other, each look has the errors of the
    /// one before: of a whole number of pixels, of the light. Taken for independent they would make sigmas
    /// smaller than the errors are.
    pub fn repeats(&self, stop: usize, sigmas: T) -> bool {
        let at = |stop: usize| {
            let sights = self.sights.all().iter();
            sights.filter(move |sight| usize::from(sight.stop) == stop && sight.is_bearing())
        };
        let Some(former) = stop.checked_sub(1) else {
            return false;
        };
        let is_same = |sight: &Sight<T>| {
            let mut before = at(former).filter(|before| before.camera == sight.camera);
            before.any(|before| {
                let noise = before.sigma * before.sigma + sight.sigma * sight.sigma;
                let off = wrap_signed(sight.value - before.value);
                off * off <= sigmas * sigmas * noise
            })
        };
        at(stop).nth(1).is_some() && at(stop).all(is_same)
    }

    /// Takes a stop out, with its bearings and visits. The known ways to it and on from it become one leg,
    /// unless one of them was not measured. The numbers of later stops fall by one. Tells `moved` which
    /// measurements are other ones than before, first those that took the place of a removed one, then those
    /// that are no more.
    ///
    /// A round under way is given up, and answers are told again after the next one.
    ///
    /// # Errors
    /// [`JointError::Unknown`].
    pub fn remove_stop(
        &mut self,
        stop: usize,
        mut moved: impl FnMut(usize),
    ) -> Result<(), JointError> {
        let removed = *self.stops.all().get(stop).ok_or(JointError::Unknown)?;
        if let Some(next) = self.stops.all_mut().get_mut(stop + 1) {
            join_legs(&removed, next);
        }
        self.stops.remove(stop);
        let mut n = 0;
        while let Some(sight) = self.sights.all().get(n) {
            if usize::from(sight.stop) == stop {
                self.sights.swap_remove(n);
                moved(n);
                moved(self.sights.len);
            } else {
                n += 1;
            }
        }
        let mut n = 0;
        while let Some(visit) = self.visits.all().get(n) {
            if usize::from(visit.stop) == stop {
                self.visits.swap_remove(n);
            } else {
                n += 1;
            }
        }
        let sights = self
            .sights
            .all_mut()
            .iter_mut()
            .map(|sight| &mut sight.stop);
        let visits = self
            .visits
            .all_mut()
            .iter_mut()
            .map(|visit| &mut visit.stop);
        let moves = self.cameras.iter_mut().filter_map(|c| c.moved.as_mut());
        for of in sights.chain(visits).chain(moves) {
            if usize::from(*of) > stop {
                *of -= 1;
            }
        }
        self.dismiss_blind();
        let [stops, ..] = self.counted;
        self.give_up(stops - usize::from(stop < stops));
        Ok(())
    }

    /// Forgets where a camera was before it was [moved](JointEstimator::split): its sightings from then go, and the camera
    /// that it has become is this one, so that the other number is free. Measurements are in other places than before,
    /// and answers are told again after the next round.
    ///
    /// # Errors
    /// [`JointError::Unknown`] for a camera that was not moved, and for a reference, whose former place says what the frame
    /// is.
    pub fn forget_past(&mut self, camera: usize) -> Result<(), JointError> {
        let past = self.cameras.get(camera).filter(|_| camera >= REFERENCES);
        let past = past.and_then(|past| past.moved.zip(past.successor));
        let (from, into) = past.ok_or(JointError::Unknown)?;
        let number = index(camera)?;
        let now = self.cameras.get_mut(usize::from(into)).map(core::mem::take);
        if let (Some(now), Some(place)) = (now, self.cameras.get_mut(camera)) {
            *place = now;
        }
        let mut n = 0;
        while let Some(sight) = self.sights.all_mut().get_mut(n) {
            if sight.camera == number {
                if sight.stop < from {
                    self.sights.swap_remove(n);
                    continue;
                }
                // It came after the last round.
                sight.standing = Standing::Counts;
            } else if sight.camera == into {
                sight.camera = number;
            }
            n += 1;
        }
        let [stops, ..] = self.counted;
        self.give_up(stops);
        Ok(())
    }

    /// Gives up the round under way, with so many stops for the next one.
    fn give_up(&mut self, stops: usize) {
        self.work = Work::new();
        self.common.told = Told::Nothing;
        self.counted = [stops, self.sights.len, self.visits.len];
    }

    /// No longer estimates cameras that have too few bearings left.
    fn dismiss_blind(&mut self) {
        for camera in REFERENCES..self.cameras.len() {
            let [_, counting] = self.bearings_of(camera);
            if counting < FEWEST
                && let Some(unknown) = self.cameras.get_mut(camera)
            {
                unknown.takes_part = false;
            }
        }
    }
}

fn forget_leg<T: Real>(stop: &mut Stop<T>) {
    stop.displacement = Vector2::zeros();
    stop.root = [T::zero(); 3];
    stop.standing = Standing::Counts;
}

/// Makes the leg on from a stop begin at the stop before it.
fn join_legs<T: Real>(removed: &Stop<T>, next: &mut Stop<T>) {
    let legs = (measured_leg(removed), measured_leg(next));
    let (Some(to), Some(on)) = legs else {
        return forget_leg(next);
    };
    let Some(root) = root_information(&(to.covariance + on.covariance)) else {
        return forget_leg(next);
    };
    next.root = root;
    next.displacement += to.displacement;
    if removed.standing != Standing::Counts {
        next.standing = removed.standing;
    }
}

fn measured_leg<T: Real>(stop: &Stop<T>) -> Option<Leg<T>> {
    let [w11, w21, w22] = stop.root;
    if !(w11 > T::zero() && w22 > T::zero()) {
        return None;
    }
    // C = L L^T with L the inverse of the root.
    let (l11, l22) = (w11.recip(), w22.recip());
    let l21 = -w21 * l11 * l22;
    Some(Leg {
        displacement: stop.displacement,
        covariance: Matrix2::new(l11 * l11, l11 * l21, l11 * l21, l21 * l21 + l22 * l22),
    })
}
