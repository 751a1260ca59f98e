//! Facts that a camera must not forget: how it is written down, and how it is taken up again.

use zigbee_link::Instant;

use super::{CameraNotification, CameraRole, duty::reference_stop, stream::Stream};
use crate::{
    facts::{Fact, FactKey},
    limits::SIGHTINGS,
    role::COORDINATOR,
};

/// The key of a sighting.
pub(super) const fn sighting(index: usize) -> FactKey {
    FactKey::Sighting(index as u8)
}

impl CameraRole {
    /// The next fact to write down.
    pub(super) fn unsaved_fact(&mut self) -> Option<Fact> {
        match self.unsaved.take()? {
            FactKey::Colours => Some(self.colours.fact()),
            FactKey::Sighting(index) => {
                let kept = self.calibration.get(index.into()).copied();
                Some(Fact::Sighting(index, kept))
            }
            FactKey::ReferenceStop(index) => Some(self.duty.stop_fact(index)),
            FactKey::Posed => Some(Fact::Posed(self.duty.second())),
            FactKey::References => Some(Fact::References(self.duty.references().copied())),
            FactKey::Report => {
                let report = *self.progress.report();
                if report.duty.is_some() {
                    // The stops of which it was solved are erased after it is written: a cut in between
                    // leaves them. So are sightings, of which it was not solved.
                    self.duty.drop_stops(&mut self.unsaved);
                    self.drop_sightings();
                }
                Some(Fact::Report(Some(report)))
            }
            FactKey::Network => self.last_network.fact(),
            other => {
                debug_assert!(false, "no fact of a camera: {other:?}");
                None
            }
        }
    }

    fn drop_sightings(&mut self) {
        for index in 0..self.calibration.count() {
            self.unsaved.insert(sighting(index));
        }
        self.calibration.clear();
    }

    /// Takes a fact of a former run. They come in the order of the memory's keys, the report first.
    pub(super) fn restore_fact(&mut self, fact: &Fact) {
        match fact {
            Fact::Report(Some(report)) => self.progress.restore(report, &self.config),
            Fact::References(references) => self.duty.restore_references(*references),
            Fact::Posed(second) => self.duty.restore_second(*second),
            Fact::Colours(colours) => self.colours.restore(colours),
            Fact::Network(network) => self.last_network.restore(*network),
            // A cut left it, after the report, in which it has no part.
            Fact::Sighting(_, Some(_)) if self.progress.report().duty.is_some() => {
                self.unsaved.insert(fact.key());
            }
            Fact::Sighting(_, Some(kept)) => {
                let place = self.calibration.restore(*kept);
                self.on_restored(place.map(sighting), fact.key());
            }
            // A cut left it, after the report that it led to.
            Fact::ReferenceStop(_, Some(_)) if self.progress.pose().is_some() => {
                self.unsaved.insert(fact.key());
            }
            Fact::ReferenceStop(_, Some(stop)) => {
                let place = self.duty.restore_stop(*stop);
                self.on_restored(place.map(reference_stop), fact.key());
            }
            _ => {}
        }
    }

    /// A fact that took another place than it was written in, because one before it is lost, is written again
    /// in this one. The present entry of the other place is written there, even if it is nothing.
    fn on_restored(&mut self, place: Option<FactKey>, written: FactKey) {
        if let Some(place) = place.filter(|place| *place != written) {
            self.unsaved.insert(place);
            self.unsaved.insert(written);
        }
    }

    /// Addresses are those of others now. A camera that is done stands where it stood; for sightings of other
    /// cameras, the target is not known any more.
    // for less stack
    #[inline(never)]
    pub(super) fn forget_network(&mut self) {
        // A first reference that stays alone with its pose is of no use to others.
        let is_told = !self.notifications.is_pending(CameraNotification::Posed);
        let is_finished = self.progress.report().done && is_told;
        self.duty.dismiss(&mut self.unsaved);
        self.looks.clear();
        self.targets.clear();
        self.notifications.retain(|notification| {
            use CameraNotification::{Hello, Report};
            matches!(notification, Hello | Report(COORDINATOR_ADDRESS))
        });
        self.outbox.clear();
        self.stream = Stream::new();
        // A look that goes on has no receiver.
        self.device.forget_requests();
        self.listing = None;
        if is_finished {
            self.progress.on_told();
        } else {
            self.drop_sightings();
            self.progress.clear(&mut self.unsaved);
        }
    }

    /// Forgets pose and sightings. From now on it does not take estimates of targets that rest on none of its
    /// later sightings; that is not written down.
    pub(super) fn forget(&mut self, now: Instant) {
        self.has_forgotten = true;
        self.calibration.clear();
        self.misses = 0;
        self.missed = 0.0;
        self.is_watched_doubtful = false;
        self.is_told_doubtful = false;
        self.was_moved = false;
        for index in 0..SIGHTINGS {
            self.unsaved.insert(sighting(index));
        }
        self.duty.forget(&mut self.unsaved);
        self.looks.clear();
        self.notifications.retain(|notification| {
            use CameraNotification::{Bearing, Located, Posed};
            !matches!(notification, Bearing(..) | Located | Posed)
        });
        self.update(now, self.progress.nothing_known());
    }
}

/// As a constant of its own, which patterns need.
const COORDINATOR_ADDRESS: u16 = COORDINATOR.0;
