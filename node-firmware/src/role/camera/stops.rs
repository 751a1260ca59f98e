//! What a camera does at a stop of a target: look, answer, count.

use core::time::Duration;

use zigbee_link::{Instant, wire::ShortAddress};

use super::{
    Asked, COORDINATOR, CameraRole, KnownTarget, LastLook, Owed,
    calibration::is_done,
    facts::{reference_stop, sighting},
};
use crate::{
    memory::KeptSighting,
    message::{
        Address, CameraState, CoordinateFrame, Duty, Message, Report, Seen, Sight, StopAnswer,
        StopBearing, StopNumber, Stopped,
    },
};

/// A stop told late comes after the next few were. Farther back are the numbers of a target that
/// began anew.
const OVERTAKEN: StopNumber = 8;

/// A target that says that it stands stays for so long at least: a look that ends later may have
/// seen it leave.
pub(super) const LOOK_WITHIN: Duration = Duration::from_millis(3_500);

impl CameraRole {
    /// Whether a look at this stop would be of use.
    fn wants(&self, stopped: &Stopped) -> bool {
        match stopped.frame {
            CoordinateFrame::Site => !self.report.done && self.report.duty.is_none(),
            CoordinateFrame::Own if self.pose().is_some() => true,
            CoordinateFrame::Own => match self.references {
                Some(_) => self.duty().is_some(),
                None => self.config.reference.is_some() || self.config.may_be_elected,
            },
        }
    }

    pub(super) fn stopped(&mut self, now: Instant, target: Address, stopped: &Stopped) {
        self.meet(now, target);
        let asked = Asked {
            target,
            stopped: *stopped,
            heard: now,
        };
        let is_past = |stop: StopNumber| (1..=OVERTAKEN).contains(&stop.wrapping_sub(stopped.stop));
        let known = self.last.iter().map(|last| (last.target, last.stop));
        let asked_for = [self.looking, self.next].into_iter().flatten();
        let mut known = known.chain(asked_for.map(|asked| (asked.target, asked.stopped.stop)));
        if known.any(|(of, stop)| of == target && is_past(stop)) {
            // The target stands there no more.
            return;
        }
        // What it did not look at then may be of use now.
        let is_last = |last: &&LastLook| {
            last.target == target && last.stop == stopped.stop && last.sight != Sight::NotLooking
        };
        if let Some(&last) = self.last.iter().find(is_last) {
            // It was looked at. It may be told again because the answer was lost, or because the
            // target now knows where it is.
            if last.frame == stopped.frame {
                self.answer(now, asked.target, stopped.stop, last.sight);
            } else {
                self.looked(now, asked, last.sight, last.seen);
            }
            return;
        }
        if !self.wants(stopped) {
            self.looked(now, asked, Sight::NotLooking, None);
        } else if !self.ready {
            self.answer(now, target, stopped.stop, Sight::NotReady);
        } else if self
            .looking
            .is_none_or(|looking| (looking.target, looking.stopped.stop) != (target, stopped.stop))
        {
            // Of two that wait the later one counts; the other target asks again.
            self.next = Some(asked);
        } else {
            self.looking = Some(asked);
        }
    }

    /// Remembers a target, so that it is told when the pose is known.
    fn meet(&mut self, now: Instant, target: Address) {
        let is_known = |known: &KnownTarget| known.address == target;
        let mut known = match self.to_targets.iter().position(is_known) {
            Some(place) => self.to_targets.remove(place),
            None => {
                if self.to_targets.is_full() {
                    self.to_targets.remove(0);
                }
                KnownTarget {
                    address: target,
                    report: Owed::Nothing,
                    missed_report: self.report.state != CameraState::Waiting,
                }
            }
        };
        if known.missed_report {
            known.missed_report = false;
            known.report.tell(now);
        }
        // The one heard last is the last one to make room.
        let _ = self.to_targets.push(known);
    }

    /// Answers in this node's own slot after a question that went to everybody: otherwise all
    /// answers would begin in the same moment.
    pub(super) fn answer(&mut self, now: Instant, target: Address, stop: StopNumber, sight: Sight) {
        let due = now + self.slot();
        let look = StopAnswer {
            stop,
            sight,
            counted: self.report.sightings,
            done: self.report.done,
        };
        self.outbox
            .push(due, ShortAddress(target), Message::Look(look), None);
    }

    /// A look is over.
    pub(super) fn looked(&mut self, now: Instant, asked: Asked, sight: Sight, seen: Option<Seen>) {
        let Asked {
            target, stopped, ..
        } = asked;
        let seen = seen.filter(|seen| sight == Sight::InView && seen.is_usable());
        if sight != Sight::NotLooking {
            self.target_seen = seen.is_some();
        }
        if let Some(seen) = seen {
            match stopped.frame {
                CoordinateFrame::Site => self.sighted(now, target, &stopped, seen),
                CoordinateFrame::Own => self.sighted_lost(now, target, &stopped, seen),
            }
        }
        let last = LastLook {
            target,
            stop: stopped.stop,
            frame: stopped.frame,
            sight,
            seen,
        };
        self.last.retain(|known| known.target != target);
        if self.last.is_full() {
            self.last.remove(0);
        }
        let _ = self.last.push(last);
        self.answer(now, target, stopped.stop, sight);
    }

    /// Three of these make a pose.
    // Not inlined, for the sake of the stack.
    #[inline(never)]
    fn sighted(&mut self, now: Instant, target: Address, stopped: &Stopped, seen: Seen) {
        if self.report.done || self.report.duty.is_some() {
            return;
        }
        let kept = KeptSighting {
            target,
            stop: stopped.stop,
            place: stopped.place,
            seen,
        };
        let Some(index) = self.calibration.add(kept) else {
            return;
        };
        self.unsaved.add(sighting(index));
        let answer = self.calibration.solve(&self.config.weak.limits());
        let count = self.calibration.count();
        self.know(
            now,
            Report {
                sightings: count as u8,
                used: answer.used as u8,
                chi_squared: answer.chi_squared,
                done: is_done(&self.config, count, &answer.state),
                state: answer.state,
                ..self.report
            },
        );
    }

    /// The target does not know where it is.
    // Not inlined, for the sake of the stack.
    #[inline(never)]
    fn sighted_lost(&mut self, now: Instant, target: Address, stopped: &Stopped, seen: Seen) {
        let stop = stopped.stop;
        if let Some(pose) = self.pose() {
            let bearing = StopBearing {
                target,
                stop,
                seen,
                pose: Some(pose),
            };
            self.outbox
                .push(now, ShortAddress(target), Message::Bearing(bearing), None);
            return;
        }
        if let Some(index) = self.stops.own(target, stop, stopped.place, seen) {
            self.unsaved.add(reference_stop(index));
        }
        match self.duty() {
            Some(Duty::First) => self.to_solve = true,
            Some(Duty::Second) => self.owe_bearing(now, target, stop),
            None => {
                let trigger = Message::Trigger { target, stop };
                self.outbox.push(now, COORDINATOR, trigger, None);
            }
        }
    }
}
