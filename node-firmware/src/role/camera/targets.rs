//! Targets that a camera knows: they get its status. The look at the last stop of each.

use core::time::Duration;

use zigbee_link::Instant;

use super::stops::STUCK;
use crate::{
    limits::TARGETS,
    message::{CoordinateFrame, MemberAddress, Seen, Sight, StopNumber, Stopped},
};

/// Greatest distance in numbers of a stop that is told late. Numbers farther back are those of a target that began
/// anew.
const OVERTAKEN: StopNumber = 8;

/// Distance of two places in standing sigmas below which they count as one.
const STANDING_SIGMAS: f32 = 4.0;

/// Time until an answer without a confirmation is repeated, doubled each time. A target confirms the first answers
/// within two seconds of its stop.
const REPEAT: Duration = Duration::from_millis(1_500);

/// Repetitions after which an answer is given up: the target walks, or does not hear.
const REPEATS: u8 = 4;

/// Target that gets the status of this camera.
#[derive(Clone, Copy, Debug, PartialEq)]
struct KnownTarget {
    address: MemberAddress,
    /// True if it did not hear the last status.
    missed_report: bool,
}

/// Targets, the one heard last at the end. A full list drops the first.
#[derive(Clone, Debug)]
pub(super) struct KnownTargets {
    targets: heapless::Vec<KnownTarget, TARGETS>,
}

/// Consequences when a target is heard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Heard {
    /// It did not get the status yet.
    pub(super) missed_report: bool,
    /// Target that was dropped for it.
    pub(super) replaced: Option<MemberAddress>,
}

impl KnownTargets {
    pub(super) const fn new() -> Self {
        Self {
            targets: heapless::Vec::new(),
        }
    }

    /// Notes that a target was heard. A new one has missed the report, if there is one.
    pub(super) fn on_heard(&mut self, address: MemberAddress, has_report: bool) -> Heard {
        let is_known = |known: &KnownTarget| known.address == address;
        let mut replaced = None;
        let missed_report = match self.targets.iter().position(is_known) {
            Some(place) => self.targets.remove(place).missed_report,
            None => {
                if self.targets.is_full() {
                    replaced = Some(self.targets.remove(0).address);
                }
                has_report
            }
        };
        // It gets the status now.
        let known = KnownTarget {
            address,
            missed_report: false,
        };
        let has_room = self.targets.push(known).is_ok();
        debug_assert!(has_room);
        Heard {
            missed_report,
            replaced,
        }
    }

    /// Notes that a target got the status, or did not. Then it gets it when it is heard again.
    pub(super) fn on_report_sent(&mut self, target: MemberAddress, delivered: bool) {
        let mut targets = self.targets.iter_mut();
        if let Some(known) = targets.find(|known| known.address == target) {
            known.missed_report = !delivered;
        }
    }

    pub(super) fn addresses(&self) -> impl Iterator<Item = MemberAddress> {
        self.targets.iter().map(|known| known.address)
    }

    pub(super) fn clear(&mut self) {
        self.targets.clear();
    }
}

/// The look at the last stop of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LastLook {
    pub(super) target: MemberAddress,
    /// Place that the target told. The same stop may be told again in the other frame.
    pub(super) stopped: Stopped,
    pub(super) sight: Sight,
    /// Result, even if it was not believed.
    pub(super) seen: Option<Seen>,
    /// Number of looks in a row before this one that were equal bit by bit, at different places.
    pub(super) repeats: u8,
    /// Answer that the target has not confirmed yet.
    pub(super) unconfirmed: Option<Unconfirmed>,
}

/// Answer without a confirmation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unconfirmed {
    /// Time of the next repetition, unless it is given up.
    again: Option<Instant>,
    /// Number of repetitions.
    repeats: u8,
}

impl Unconfirmed {
    /// An answer that is sent at `due` for the first time.
    pub(super) fn new(due: Instant) -> Self {
        Self {
            again: Some(due + REPEAT),
            repeats: 0,
        }
    }

    /// Notes that the answer is repeated at `due`.
    fn repeat(&mut self, due: Instant) {
        self.repeats += 1;
        let pause = REPEAT.saturating_mul(1 << self.repeats);
        self.again = (self.repeats < REPEATS).then_some(due + pause);
    }
}

/// Last look at each target. A full list drops the oldest.
#[derive(Clone, Debug)]
pub(super) struct LastLooks {
    looks: heapless::Vec<LastLook, TARGETS>,
}

impl LastLooks {
    pub(super) const fn new() -> Self {
        Self {
            looks: heapless::Vec::new(),
        }
    }

    pub(super) fn insert(&mut self, look: LastLook) {
        self.looks.retain(|known| known.target != look.target);
        if self.looks.is_full() {
            self.looks.remove(0);
        }
        let has_room = self.looks.push(look).is_ok();
        debug_assert!(has_room);
    }

    /// The look at this stop, if there was one.
    pub(super) fn find(&self, target: MemberAddress, stop: StopNumber) -> Option<LastLook> {
        let is_it = |look: &&LastLook| (look.target, look.stopped.stop) == (target, stop);
        self.looks.iter().find(is_it).copied()
    }

    /// The last look at this target.
    pub(super) fn last(&self, target: MemberAddress) -> Option<&LastLook> {
        self.looks.iter().find(|look| look.target == target)
    }

    /// Notes that the target confirms a look. Returns the look, the first time.
    pub(super) fn confirm(&mut self, target: MemberAddress, stop: StopNumber) -> Option<LastLook> {
        let mut looks = self.looks.iter_mut();
        let look = looks.find(|look| (look.target, look.stopped.stop) == (target, stop))?;
        look.unconfirmed.take()?;
        Some(*look)
    }

    /// When an answer is to be repeated next.
    pub(super) fn next_due(&self) -> Option<Instant> {
        let unconfirmed = self.looks.iter().filter_map(|look| look.unconfirmed);
        unconfirmed
            .filter_map(|unconfirmed| unconfirmed.again)
            .min()
    }

    /// A look whose answer is to be repeated now.
    pub(super) fn take_due(&mut self, now: Instant) -> Option<LastLook> {
        self.looks.iter_mut().find_map(|look| {
            let unconfirmed = look.unconfirmed.as_mut()?;
            unconfirmed.again.filter(|again| *again <= now)?;
            unconfirmed.repeat(now);
            Some(*look)
        })
    }

    /// Notes that the target confirmed other cameras: the answer was lost. The target is there, so this repetition does
    /// not count.
    pub(super) fn repeat(&mut self, now: Instant, target: MemberAddress, stop: StopNumber) {
        let mut looks = self.looks.iter_mut();
        let look = looks.find(|look| (look.target, look.stopped.stop) == (target, stop));
        if let Some(unconfirmed) = look.and_then(|look| look.unconfirmed.as_mut()) {
            unconfirmed.again = Some(now);
            unconfirmed.repeats = unconfirmed.repeats.saturating_sub(1);
        }
    }

    /// Returns the number of looks in a row that were equal to this one bit by bit although the target stood elsewhere
    /// each time. Of good looks about one in a hundred repeats the last one by chance.
    pub(super) fn repeats(&self, target: MemberAddress, stopped: &Stopped, seen: &Seen) -> u8 {
        self.last(target).map_or(0, |last| {
            let place = &stopped.place;
            let within = place.parts().standing_sigma * STANDING_SIGMAS;
            let between = place.position() - last.stopped.place.position();
            let is_apart = between.norm_squared() > within * within;
            // A target that does not know its place counts its way from its first stop, each time anew.
            let fixes = [&last.stopped, stopped].map(|stopped| {
                let fix = stopped.place.parts().fix;
                (stopped.frame == CoordinateFrame::Own).then_some(fix)
            });
            match last.seen == Some(*seen) {
                // The same stop in another frame, or a target that may not have walked.
                true if last.stopped.stop == stopped.stop || fixes[0] != fixes[1] => last.repeats,
                true if is_apart => last.repeats.saturating_add(1),
                _ => 0,
            }
        })
    }

    /// Returns true if the picture did not change though a target moved.
    pub(super) fn is_stuck(&self) -> bool {
        self.looks.iter().any(|look| look.repeats >= STUCK)
    }

    /// The last stop of each target.
    pub(super) fn stops(&self) -> impl Iterator<Item = (MemberAddress, StopNumber)> {
        let looks = self.looks.iter();
        looks.map(|look| (look.target, look.stopped.stop))
    }

    pub(super) fn clear(&mut self) {
        self.looks.clear();
    }
}

/// Returns true if a target that stood at `known` has gone on to `stop`.
pub(super) fn is_past(known: StopNumber, stop: StopNumber) -> bool {
    (1..=OVERTAKEN).contains(&known.wrapping_sub(stop))
}
