//! What a reference camera does besides: the first one solves, the second one tells it what it saw
//! (thesis 2.6.1).

use zigbee_link::Instant;

use super::{
    CameraRole,
    facts::{POSED, REFERENCES, reference_stop},
    reference::{Answer, NotYet, ReferenceFrame},
};
use crate::{
    log::debug,
    memory::ReferenceStop,
    message::{Address, CameraState, Duty, References, Report, StopBearing, StopNumber},
    role::Owed,
};

impl CameraRole {
    pub(super) fn owe_bearing(&mut self, now: Instant, target: Address, stop: StopNumber) {
        if self.bearings.is_full() {
            self.bearings.remove(0);
        }
        let _ = self.bearings.push((target, stop, Owed::Due(now, 0)));
    }

    // Not inlined, for the sake of the stack.
    #[inline(never)]
    pub(super) fn solve_reference(&mut self, now: Instant) {
        if self.pose().is_some() {
            return;
        }
        let Some(references) = &self.references else {
            return;
        };
        let frame = ReferenceFrame::new(references, &self.config);
        let wanted = usize::from(self.config.reference_stops);
        let solved = self.stops.solve(&frame, wanted);
        self.solved(now, &solved);
    }

    // Not inlined: what it takes of the stack is not there while solving.
    #[inline(never)]
    fn solved(&mut self, now: Instant, solved: &Result<Answer, NotYet>) {
        match solved {
            Ok(answer) => {
                let limits = self.config.weak.limits();
                let [first, second] = answer.poses.map(|pose| Report {
                    sightings: answer.stops as u8,
                    used: answer.stops as u8,
                    chi_squared: answer.fit.chi_squared,
                    state: CameraState::judged(pose, &answer.fit, &limits),
                    ..self.report
                });
                self.posed = (Owed::Due(now, 0), Some(second));
                self.unsaved.add(POSED);
                self.located = (Owed::Due(now, 0), Some((answer.target, answer.located)));
                self.posed_as(now, Duty::First, &first);
            }
            Err(why) => {
                debug!("no reference solve yet");
                if let NotYet::Refused(refusal) = why {
                    let state = CameraState::Refused(*refusal);
                    self.know(
                        now,
                        Report {
                            state,
                            ..self.report
                        },
                    );
                }
            }
        }
    }

    /// This reference camera now knows its pose.
    pub(super) fn posed_as(&mut self, now: Instant, duty: Duty, solved: &Report) {
        let report = Report {
            id: self.id,
            duty: Some(duty),
            done: true,
            state: solved.state.judged_again(&self.config.weak.limits()),
            ..*solved
        };
        // The stops are erased when this is written down.
        self.know(now, report);
    }

    pub(super) fn references(&mut self, now: Instant, references: References) {
        if self.references == Some(references) {
            return;
        }
        let pair = |of: &References| (of.first, of.second);
        if self.references.as_ref().map(pair) != Some(pair(&references)) {
            // What another camera saw, or its pose, is nothing to this one.
            if self.posed.1.is_some() {
                self.unsaved.add(POSED);
            }
            self.posed = (Owed::Nothing, None);
            let kept = self.stops.forget_other();
            self.rewrite(kept);
        }
        self.references = Some(references);
        self.bearings.clear();
        self.unsaved.add(REFERENCES);
        self.to_solve = self.duty() == Some(Duty::First);
        if !self.to_solve {
            // Where the target stood, another one tells it.
            self.located = (Owed::Nothing, None);
        }
        if self.duty() == Some(Duty::Second) {
            self.owe_bearings(now);
        }
    }

    pub(super) fn owe_bearings(&mut self, now: Instant) {
        let owed = |stop: &ReferenceStop| (stop.target, stop.stop, Owed::Due(now, 0));
        let mine = self.stops.iter().filter(|stop| stop.own.is_some());
        self.bearings.clear();
        for bearing in mine.map(owed) {
            // As many as there are stops.
            let _ = self.bearings.push(bearing);
        }
    }

    pub(super) fn bearing(&mut self, now: Instant, bearing: &StopBearing) {
        if self.duty() != Some(Duty::First) || !bearing.seen.is_usable() {
            return;
        }
        if self.pose().is_some() {
            // The second one has not heard its pose, or lost it.
            if self.posed.1.is_some() {
                self.posed.0.tell(now);
            }
            return;
        }
        if let Some(index) = self.stops.other(bearing.target, bearing.stop, bearing.seen) {
            self.unsaved.add(reference_stop(index));
        }
        self.to_solve = true;
    }
}
