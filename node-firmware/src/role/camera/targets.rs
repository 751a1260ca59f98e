//! The targets that a camera knows: those that hear of its status, and the look at the last stop of each.

use core::time::Duration;

use zigbee_link::Instant;

use super::stops::STUCK;
use crate::{
    limits::TARGETS,
    message::{CoordinateFrame, MemberAddress, Seen, Sight, StopNumber, Stopped},
};

/// A stop told late comes after the next few were. Numbers farther back are those of a target that began
/// anew.
const OVERTAKEN: StopNumber = 8;

/// Places nearer to each other than so many sigmas of a standing target are one.
const STANDING_SIGMAS: f32 = 4.0;

/// After an answer that was not confirmed, before it is repeated: a target confirms the first ones
/// within two seconds of having stopped. Doubled each time.
const REPEAT: Duration = Duration::from_millis(1_500);

/// Then it is given up: the target walks, or does not hear.
const REPEATS: u8 = 4;

/// A target that hears of this camera's status.
#[derive(Clone, Copy, Debug, PartialEq)]
struct KnownTarget {
    address: MemberAddress,
    /// It was told last when it was away, or never.
    missed_report: bool,
}

/// Targets, the one heard last at the end. The one heard least recently makes room.
#[derive(Clone, Debug)]
pub(super) struct KnownTargets {
    targets: heapless::Vec<KnownTarget, TARGETS>,
}

/// Consequences when a target is heard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Heard {
    /// It has not been told this camera's status yet.
    pub(super) missed_report: bool,
    /// This one made room.
    pub(super) replaced: Option<MemberAddress>,
}

impl KnownTargets {
    pub(super) const fn new() -> Self {
        Self {
            targets: heapless::Vec::new(),
        }
    }

    /// A target is there. A new one has missed the report if there is anything to report.
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
        // It is told now.
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

    /// A target was told this camera's status, or not: then it is told when it is heard again.
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
    /// Place where the target said that it stood. The same stop may be told again in the other frame.
    pub(super) stopped: Stopped,
    pub(super) sight: Sight,
    /// Also where it was not believed.
    pub(super) seen: Option<Seen>,
    /// Number of looks in a row before this one that were the same to the bit, at places that are apart.
    pub(super) repeats: u8,
    /// The target was seen, and has not said yet that it stood there then.
    pub(super) unconfirmed: Option<Unconfirmed>,
}

/// An answer that the target has not confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unconfirmed {
    /// Time to repeat it, if not for the last time.
    again: Option<Instant>,
    /// Number of repetitions.
    repeats: u8,
}

impl Unconfirmed {
    /// An answer that is sent at this time for the first time.
    pub(super) fn new(due: Instant) -> Self {
        Self {
            again: Some(due + REPEAT),
            repeats: 0,
        }
    }

    /// The same answer once more at this time.
    fn repeat(&mut self, due: Instant) {
        self.repeats += 1;
        let pause = REPEAT.saturating_mul(1 << self.repeats);
        self.again = (self.repeats < REPEATS).then_some(due + pause);
    }
}

/// The last look at each target. The oldest makes room.
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

    /// The target confirms this look: returns it, if that was not known.
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

    /// The target confirmed others: the answer was lost. The target stands there and hears, so this
    /// repetition does not count.
    pub(super) fn repeat(&mut self, now: Instant, target: MemberAddress, stop: StopNumber) {
        let mut looks = self.looks.iter_mut();
        let look = looks.find(|look| (look.target, look.stopped.stop) == (target, stop));
        if let Some(unconfirmed) = look.and_then(|look| look.unconfirmed.as_mut()) {
            unconfirmed.again = Some(now);
            unconfirmed.repeats = unconfirmed.repeats.saturating_sub(1);
        }
    }

    /// Number of looks at this target in a row that were equal to this one to the bit, although it says that
    /// it stood elsewhere each time. Of good looks one in a hundred or so repeats the last one by chance.
    pub(super) fn repeats(&self, target: MemberAddress, stopped: &Stopped, seen: &Seen) -> u8 {
        self.last(target).map_or(0, |last| {
            let place = &stopped.place;
            let within = place.parts().standing_sigma * STANDING_SIGMAS;
            let between = place.position() - last.stopped.place.position();
            let is_apart = between.norm_squared() > within * within;
            // A target that does not know its place counts from where it began: each time anew.
            let fixes = [&last.stopped, stopped].map(|stopped| {
                let fix = stopped.place.parts().fix;
                (stopped.frame == CoordinateFrame::Own).then_some(fix)
            });
            match last.seen == Some(*seen) {
                // The same stop, told again in another frame, or it is not known whether it walked.
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

/// Returns true if a target that stood at `known` stands at `stop` no more.
pub(super) fn is_past(known: StopNumber, stop: StopNumber) -> bool {
    (1..=OVERTAKEN).contains(&known.wrapping_sub(stop))
}
