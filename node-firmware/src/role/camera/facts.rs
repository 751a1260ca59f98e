//! What a camera must not forget, and what of it is not written down yet.

use zigbee_link::Instant;

use super::{CameraRole, calibration::is_done, nothing_known};
use crate::{
    limits::{REFERENCE_STOPS, SIGHTINGS},
    memory::Fact,
    message::Report,
    role::{Outbox, Owed},
};

// Facts are numbered in the order in which they are written: a report counts sightings, so these
// are there before it; and a camera that forgets reports that only when nothing is left. Other
// references are there when nothing of the former ones is.
pub(super) const COLOURS: u32 = 0;
const SIGHTING: u32 = 1;
const REFERENCE_STOP: u32 = SIGHTING + SIGHTINGS as u32;
pub(super) const POSED: u32 = REFERENCE_STOP + REFERENCE_STOPS as u32;
pub(super) const REFERENCES: u32 = POSED + 1;
pub(super) const REPORT: u32 = REFERENCES + 1;

pub(super) const fn sighting(index: usize) -> u32 {
    SIGHTING + index as u32
}

pub(super) const fn reference_stop(index: usize) -> u32 {
    REFERENCE_STOP + index as u32
}

/// Numbers of facts that changed since they were written down. None is ever lost: what is written
/// is what is known when its turn comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unsaved(u32);

impl Unsaved {
    pub(super) const fn new() -> Self {
        const { assert!(REPORT < u32::BITS) };
        Self(0)
    }

    pub(super) const fn add(&mut self, fact: u32) {
        self.0 |= 1 << fact;
    }

    /// The one whose turn it is.
    const fn take(&mut self) -> Option<u32> {
        if self.0 == 0 {
            return None;
        }
        let fact = self.0.trailing_zeros();
        self.0 &= self.0 - 1;
        Some(fact)
    }
}

impl CameraRole {
    /// The next fact to write down.
    pub(super) fn unsaved(&mut self) -> Option<Fact> {
        let Some(number) = self.unsaved.take() else {
            return self.home.unsaved();
        };
        Some(match number {
            REFERENCES => Fact::References(self.references),
            COLOURS => Fact::Colours(self.colours),
            number @ SIGHTING..REFERENCE_STOP => {
                let index = number - SIGHTING;
                Fact::Sighting(index as u8, self.calibration.get(index as usize).copied())
            }
            number @ REFERENCE_STOP..POSED => {
                let index = number - REFERENCE_STOP;
                let stop = self.stops.iter().nth(index as usize).copied();
                Fact::ReferenceStop(index as u8, stop)
            }
            POSED => Fact::Posed(self.posed.1),
            _ => {
                if self.report.duty.is_some() {
                    // The stops it came of go after it: they are what a cut in between leaves. So do
                    // sightings, which it did not come of.
                    self.drop_stops();
                    self.drop_sightings();
                }
                Fact::Report(Some(self.report))
            }
        })
    }

    /// The first so many stops of the references are to be written anew.
    pub(super) fn rewrite(&mut self, stops: usize) {
        for index in 0..stops {
            self.unsaved.add(reference_stop(index));
        }
    }

    fn drop_stops(&mut self) {
        let kept = self.stops.len();
        self.stops.clear();
        self.rewrite(kept);
    }

    fn drop_sightings(&mut self) {
        for index in 0..self.calibration.count() {
            self.unsaved.add(sighting(index));
        }
        self.calibration.clear();
    }

    /// Takes a fact of a former run. They come in the order of the memory's keys, the report first.
    pub(super) fn recall(&mut self, fact: &Fact) {
        match fact {
            Fact::Report(Some(report)) => {
                // The limits may be others since.
                let state = report.state.judged_again(&self.config.weak.limits());
                let is_done =
                    report.duty.is_some() || is_done(&self.config, report.sightings.into(), &state);
                self.report = Report {
                    id: self.id,
                    done: report.done && is_done,
                    state,
                    ..*report
                };
                self.told = self.report;
            }
            Fact::References(references) => self.references = *references,
            Fact::Posed(second) => self.posed.1 = *second,
            Fact::Colours(colours) if colours.configured == self.colours.configured => {
                self.colours = *colours;
                self.recalled = true;
            }
            Fact::Network(network) => self.home.remember(*network),
            // A cut left it, after the report that it has no part in.
            Fact::Sighting(index, Some(_)) if self.report.duty.is_some() => {
                self.unsaved.add(sighting((*index).into()));
            }
            Fact::Sighting(index, Some(kept)) => {
                let place = self.calibration.restore(*kept);
                self.recalled_at(place.map(sighting), sighting((*index).into()));
            }
            // A cut left it, after the report that it led to.
            Fact::ReferenceStop(index, Some(_)) if self.pose().is_some() => {
                self.unsaved.add(reference_stop((*index).into()));
            }
            Fact::ReferenceStop(index, Some(stop)) => {
                let place = self.stops.restore(*stop);
                self.recalled_at(place.map(reference_stop), reference_stop((*index).into()));
            }
            _ => {}
        }
    }

    /// A fact that took another place than it was written in, because one before it is lost, is
    /// written again in this one, and in the other what is there then, if only nothing.
    fn recalled_at(&mut self, place: Option<u32>, written: u32) {
        if let Some(place) = place.filter(|place| *place != written) {
            self.unsaved.add(place);
            self.unsaved.add(written);
        }
    }

    /// Addresses are those of others now. A camera that is done stands where it stood; of sightings
    /// of others, nobody knows the target any more.
    // Not inlined, for the sake of the stack.
    #[inline(never)]
    pub(super) fn forget_network(&mut self) {
        if self.references.take().is_some() {
            self.unsaved.add(REFERENCES);
        }
        // A first reference that stays alone with its pose is of no use to anybody.
        let is_finished = self.report.done && self.posed.0 == Owed::Nothing;
        if self.posed.1.is_some() {
            self.unsaved.add(POSED);
        }
        self.posed = (Owed::Nothing, None);
        self.located = (Owed::Nothing, None);
        self.drop_stops();
        self.to_solve = false;
        self.bearings.clear();
        self.last.clear();
        self.to_targets.clear();
        self.outbox = Outbox::new();
        // A look that goes on has nobody to be told.
        self.looking = None;
        self.next = None;
        self.listing = None;
        if !is_finished {
            self.drop_sightings();
            self.report = nothing_known(self.id);
            self.unsaved.add(REPORT);
        }
        self.told = self.report;
    }

    /// Forgets pose and sightings.
    pub(super) fn forget(&mut self, now: Instant) {
        self.calibration.clear();
        self.stops.clear();
        self.last.clear();
        self.bearings.clear();
        self.posed = (Owed::Nothing, None);
        self.located = (Owed::Nothing, None);
        self.know(now, nothing_known(self.id));
        // All of these are without content now.
        for fact in SIGHTING..=POSED {
            self.unsaved.add(fact);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_fact_has_its_turn_once() {
        let mut unsaved = Unsaved::new();
        for fact in [REPORT, sighting(3), REPORT, COLOURS, POSED, sighting(3)] {
            unsaved.add(fact);
        }
        let turns = [COLOURS, sighting(3), POSED, REPORT];
        assert_eq!(turns.map(|_| unsaved.take()), turns.map(Some));
        assert_eq!(unsaved.take(), None);
        assert_eq!(sighting(SIGHTINGS), reference_stop(0));
        assert_eq!(reference_stop(REFERENCE_STOPS), POSED);
    }
}
