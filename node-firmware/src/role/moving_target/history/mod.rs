//! Measurements of a target on its walk: written down as they grow, taken up after a restart, and dropped to
//! make room.
//!
//! Estimates are made of measurements alone, so only these are kept: every stop with the leg that led there,
//! and every bearing. A stop has a place in the flash that it keeps until it goes ([`StopTag::slot`]); a
//! bearing has the place that it has in the estimator's list. Nothing of it is kept twice in memory.
//!
//! A record of bearings is written when it is full, and the last one when the stop is over. Bearings lost
//! with the power are asked of the cameras again, as the target resumes the stop at which it stood. If it
//! walked, the way from the last stop is lost, and with it that one leg.
//!
//! Whatever is written when the power fails, no measurement is taken for one of another stop: a leg says
//! where it began, and a bearing names its stop. Measurements that have no stop any more are dropped.
//!
//! # Room
//! Of 100 stops or 384 bearings, the stop that is [missed
//! least](calib_core::joint::JointEstimator::least_missed) makes room, with its bearings: the one whose
//! cameras all have been seen most often. Of equals it is the oldest. The legs before and after it become
//! one, so their information on all other stops is not lost. That of its bearings is: with them in a prior of
//! all cameras sigmas would be smaller, but that is a second triangle of 13 KB.

use calib_core::joint::{Leg, Quantity, RestoredLeg, StopTag};
use nalgebra::{Matrix2, Vector2};

use super::{
    TargetRole,
    estimate::{Estimate, LEAST_SIGMA},
};
use crate::{
    facts::{BEARINGS_PER_RECORD, Fact, FactKey, STOPS_PER_RECORD, WalkBearing, WalkLeg, WalkStop},
    limits::{ESTIMATED_STOPS, WALK_BEARINGS, WALK_STOPS},
    log::debug,
    message::{MemberAddress, StopNumber, matrix, triangle},
    role::Unsaved,
};

/// The record of the stop in this slot.
const fn stop_record(slot: usize) -> FactKey {
    FactKey::WalkStops((slot / STOPS_PER_RECORD) as u8)
}

/// The record of the bearing in this place.
const fn bearing_record(place: usize) -> FactKey {
    FactKey::WalkBearings((place / BEARINGS_PER_RECORD) as u8)
}

/// Looks that differ by no more sigmas may be of one place.
const REPEATED: f32 = 3.0;

impl Estimate<'_> {
    /// The target stands.
    pub(super) fn on_stop(&mut self, stop: StopNumber, unsaved: &mut Unsaved) {
        self.failed.clear();
        let leg = self.way.map(|(displacement, covariance)| Leg {
            displacement,
            covariance: covariance + Matrix2::from_diagonal_element(LEAST_SIGMA * LEAST_SIGMA),
        });
        if self.add_stop(stop, leg, unsaved) {
            self.way = Some((Vector2::zeros(), Matrix2::zeros()));
        }
    }

    fn add_stop(&mut self, stop: StopNumber, leg: Option<Leg<f32>>, unsaved: &mut Unsaved) -> bool {
        if self.index(stop).is_some() {
            return false;
        }
        if self.estimator.stops() >= ESTIMATED_STOPS {
            self.make_room(unsaved);
        }
        let is_used = |slot: &u8| self.estimator.tags().any(|tag| tag.slot == *slot);
        let Some(slot) = (0..WALK_STOPS as u8).find(|slot| !is_used(slot)) else {
            return false;
        };
        let tag = StopTag { number: stop, slot };
        // A way that is no number is none.
        let added = self.estimator.add_stop(leg);
        let added = added.or_else(|_| self.estimator.add_stop(None));
        let is_added = added.and_then(|index| self.estimator.tag_stop(index, tag));
        debug_assert_eq!(is_added, Ok(()), "there is room");
        unsaved.insert(stop_record(slot.into()));
        is_added.is_ok()
    }

    /// Index of a stop among those of the estimator.
    pub(super) fn index(&self, stop: StopNumber) -> Option<usize> {
        self.estimator.tags().rposition(|tag| tag.number == stop)
    }

    /// The number of a stop of the estimator.
    pub(super) fn stop_number(&self, index: usize) -> Option<StopNumber> {
        self.estimator.tags().nth(index).map(|tag| tag.number)
    }

    /// Makes room for another bearing, and for the other measurement of the same look.
    pub(super) fn make_room_for_bearing(&mut self, unsaved: &mut Unsaved) {
        while self.estimator.bearings() >= WALK_BEARINGS && self.make_room(unsaved) {}
    }

    /// The stop that is missed least goes. Returns true if there is one.
    fn make_room(&mut self, unsaved: &mut Unsaved) -> bool {
        let Some(stop) = self.estimator.least_missed() else {
            return false;
        };
        debug!("a stop of the walk makes room");
        self.remove_stop(stop, unsaved)
    }

    /// After a restart the target may stand where it stood before, and only the cameras' looks tell. Then
    /// their looks are those of the last stop once more, and are dropped: the way on is from there.
    fn drop_repetition(&mut self, unsaved: &mut Unsaved) {
        let Some(last) = self.estimator.stops().checked_sub(1) else {
            return;
        };
        if self.estimator.leg(last).is_some() {
            return;
        }
        if self.estimator.repeats(last, REPEATED) {
            debug!("a stop of the walk is the one before");
            self.remove_stop(last, unsaved);
        }
    }

    pub(super) fn remove_stop(&mut self, stop: usize, unsaved: &mut Unsaved) -> bool {
        // Its own record, and that of the next one, whose leg begins elsewhere then.
        for tag in self.estimator.tags().skip(stop).take(2) {
            unsaved.insert(stop_record(tag.slot.into()));
        }
        let removed = self
            .estimator
            .remove_stop(stop, |place| unsaved.insert(bearing_record(place)));
        self.saved = self.saved.min(self.estimator.bearings());
        self.is_new = true;
        removed.is_ok()
    }

    /// Records of bearings that are full are to be written; when the stop is `over`, the last one too.
    pub(super) fn save_bearings(&mut self, over: bool, unsaved: &mut Unsaved) {
        let all = self.estimator.bearings();
        let until = if over {
            all
        } else {
            all - all % BEARINGS_PER_RECORD
        };
        for place in self.saved..until {
            unsaved.insert(bearing_record(place));
        }
        self.saved = self.saved.max(until);
    }

    /// All that is written down is to be written anew, for nothing of it is known any more.
    pub(super) fn forget_records(&mut self, unsaved: &mut Unsaved) {
        for tag in self.estimator.tags() {
            unsaved.insert(stop_record(tag.slot.into()));
        }
        self.rewrite_bearings(unsaved);
        self.saved = 0;
    }

    /// All records of bearings are to be written anew.
    pub(super) fn rewrite_bearings(&self, unsaved: &mut Unsaved) {
        for place in 0..self.estimator.bearings() {
            unsaved.insert(bearing_record(place));
        }
    }

    /// Stops to write down.
    pub(super) fn stops_fact(&self, record: u8) -> Fact {
        let mut stops = [None; STOPS_PER_RECORD];
        let first = usize::from(record) * STOPS_PER_RECORD;
        for (index, tag) in self.estimator.tags().enumerate() {
            let place = usize::from(tag.slot).checked_sub(first);
            let Some(stop) = place.and_then(|place| stops.get_mut(place)) else {
                continue;
            };
            let before = index.checked_sub(1).and_then(|n| self.stop_number(n));
            let leg = before.zip(self.estimator.leg(index));
            *stop = Some(WalkStop {
                stop: tag.number,
                leg: leg.map(|(from, leg)| WalkLeg {
                    from,
                    displacement: leg.displacement.into(),
                    covariance: triangle(&leg.covariance),
                }),
            });
        }
        Fact::WalkStops(record, stops)
    }

    /// Bearings to write down.
    pub(super) fn bearings_fact(&self, record: u8) -> Fact {
        let mut bearings = [None; BEARINGS_PER_RECORD];
        let first = usize::from(record) * BEARINGS_PER_RECORD;
        for (bearing, place) in bearings.iter_mut().zip(first..) {
            *bearing = self.bearing(place);
        }
        Fact::WalkBearings(record, bearings)
    }

    fn bearing(&self, place: usize) -> Option<WalkBearing> {
        let measured = self.estimator.measured(place)?;
        Some(WalkBearing {
            stop: self.stop_number(measured.stop)?,
            camera: self.address(measured.camera)?,
            quantity: measured.quantity,
            value: measured.value,
            sigma: measured.sigma,
            elevation: measured.elevation,
        })
    }

    /// After a restart: begins the way from the stop where the target stood, if it still stands there.
    pub(super) fn resume(&mut self, stands: bool) {
        self.way = stands.then(|| (Vector2::zeros(), Matrix2::zeros()));
        self.is_restoring = true;
    }

    /// Takes up stops of a former run. They come before bearings.
    pub(super) fn restore_stops(
        &mut self,
        record: u8,
        stops: &[Option<WalkStop>; STOPS_PER_RECORD],
        unsaved: &mut Unsaved,
    ) {
        self.is_restoring = true;
        let first = usize::from(record) * STOPS_PER_RECORD;
        for (slot, stop) in (first..).zip(stops) {
            let Some(stop) = stop else { continue };
            let tag = StopTag {
                number: stop.stop,
                slot: slot as u8,
            };
            let leg = stop.leg.map(|leg| RestoredLeg {
                from: leg.from,
                leg: Leg {
                    displacement: leg.displacement.into(),
                    covariance: matrix(leg.covariance),
                },
            });
            if self.estimator.restore_stop(tag, leg).is_err() {
                unsaved.insert(stop_record(slot));
            }
        }
    }

    /// Takes up bearings of a former run. They come in the order of their places.
    pub(super) fn restore_bearings(
        &mut self,
        record: u8,
        bearings: &[Option<WalkBearing>; BEARINGS_PER_RECORD],
        unsaved: &mut Unsaved,
    ) {
        let first = usize::from(record) * BEARINGS_PER_RECORD;
        for (written, bearing) in (first..).zip(bearings) {
            let Some(bearing) = bearing else { continue };
            let place = self.estimator.bearings();
            let is_taken = self.restore_bearing(bearing).is_some();
            // A bearing that is in another place than it was, because one before it is lost, is written
            // again.
            if !is_taken || place != written {
                unsaved.insert(bearing_record(written));
            }
            if is_taken && place != written {
                unsaved.insert(bearing_record(place));
            }
        }
        self.saved = self.estimator.bearings();
    }

    fn restore_bearing(&mut self, bearing: &WalkBearing) -> Option<()> {
        let stop = self.index(bearing.stop)?;
        let is_known = self.has(stop, bearing.camera, bearing.quantity);
        let camera = self.number(bearing.camera).filter(|_| !is_known)?;
        let (value, sigma) = (bearing.value, bearing.sigma);
        let added = match bearing.quantity {
            Quantity::Bearing => {
                let added = self.estimator.add_bearing(stop, camera, value, sigma);
                added.and_then(|()| self.estimator.add_elevation(bearing.elevation))
            }
            Quantity::Range => self.estimator.add_range(stop, camera, value, sigma),
        };
        self.is_new |= added.is_ok();
        added.ok()
    }

    /// Returns true if a camera told this of a stop already, under either of its numbers.
    pub(super) fn has(&self, stop: usize, camera: MemberAddress, quantity: Quantity) -> bool {
        let mut all = (0..self.estimator.bearings()).filter_map(|n| self.estimator.measured(n));
        all.any(|measured| {
            measured.stop == stop
                && measured.quantity == quantity
                && self.address(measured.camera) == Some(camera)
        })
    }

    /// All stops of a former run are there, of which this is the last.
    pub(super) fn sort_restored(&mut self, last: StopNumber, unsaved: &mut Unsaved) {
        if !core::mem::take(&mut self.is_restoring) {
            return;
        }
        // One that was being written, and of which no camera was told.
        for tag in self.estimator.tags() {
            if tag.number.wrapping_sub(last).cast_signed() > 0 {
                unsaved.insert(stop_record(tag.slot.into()));
            }
        }
        self.estimator.sort_restored(last);
        if self.way.is_some() {
            // Bearings of the stop where it stands count, whether the way there is known or not.
            self.add_stop(last, None, unsaved);
        }
    }
}

impl TargetRole<'_> {
    /// Stops of a former run.
    pub(super) fn restore_history(&mut self, fact: &Fact) {
        let Some(estimate) = &mut self.estimate else {
            return;
        };
        let unsaved = &mut self.unsaved;
        match fact {
            Fact::WalkStops(record, stops) => estimate.restore_stops(*record, stops, unsaved),
            Fact::WalkBearings(record, bearings) => {
                estimate.sort_restored(self.stop, unsaved);
                estimate.restore_bearings(*record, bearings, unsaved);
            }
            _ => {}
        }
    }

    /// Part of the walk, to be written down.
    pub(super) fn history_fact(&self, key: FactKey) -> Option<Fact> {
        let estimate = self.estimate.as_ref()?;
        match key {
            FactKey::WalkStops(record) => Some(estimate.stops_fact(record)),
            FactKey::WalkBearings(record) => Some(estimate.bearings_fact(record)),
            _ => None,
        }
    }

    /// The cameras' bearings of this stop are to be written down.
    pub(super) fn save_history(&mut self) {
        if let Some(estimate) = &mut self.estimate {
            estimate.drop_repetition(&mut self.unsaved);
            estimate.save_bearings(true, &mut self.unsaved);
        }
    }
}

#[cfg(test)]
pub(in crate::role::moving_target) mod tests;
