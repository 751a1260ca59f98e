//! The targets that a camera knows: who is told how far it is, and what was seen at the last stop of
//! each.

use nalgebra::Point2;

use crate::{
    limits::TARGETS,
    message::{CoordinateFrame, MemberAddress, Seen, Sight, StopNumber, Stopped},
};

/// A stop told late comes after the next few were. Farther back are the numbers of a target that
/// began anew.
const OVERTAKEN: StopNumber = 8;

/// Places nearer to each other than so many sigmas of how a target stands are one.
const STANDING_SIGMAS: f32 = 4.0;

/// A target that is told how far this camera is.
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

/// What follows when a target is heard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Heard {
    /// It has not been told yet how far this camera is.
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

    /// A target was told how far this camera is, or not: then when it is heard again.
    pub(super) fn on_report_sent(&mut self, target: MemberAddress, delivered: bool) {
        let mut targets = self.targets.iter_mut();
        if let Some(known) = targets.find(|known| known.address == target) {
            known.missed_report = !delivered;
        }
    }

    /// Whether this is one of them.
    pub(super) fn knows(&self, address: MemberAddress) -> bool {
        self.addresses().any(|known| known == address)
    }

    pub(super) fn addresses(&self) -> impl Iterator<Item = MemberAddress> {
        self.targets.iter().map(|known| known.address)
    }

    pub(super) fn clear(&mut self) {
        self.targets.clear();
    }
}

/// What was seen at the last stop of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LastLook {
    pub(super) target: MemberAddress,
    pub(super) stop: StopNumber,
    /// The answer was about this frame; the same stop may be told again in the other one.
    pub(super) frame: CoordinateFrame,
    pub(super) sight: Sight,
    /// Also where it was not believed.
    pub(super) seen: Option<Seen>,
    /// Where the target said that it stood.
    pub(super) place: Point2<f32>,
    /// How many looks in a row were the same to the bit, at places that are apart, before this one.
    pub(super) repeats: u8,
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
        let is_it = |look: &&LastLook| (look.target, look.stop) == (target, stop);
        self.looks.iter().find(is_it).copied()
    }

    /// How many looks at this target in a row were this to the bit, although it says that it stood
    /// elsewhere each time. Of good looks one in a hundred or so repeats the last one by chance.
    pub(super) fn repeats(&self, target: MemberAddress, stopped: &Stopped, seen: &Seen) -> u8 {
        let mut looks = self.looks.iter();
        let last = looks.find(|look| look.target == target);
        last.map_or(0, |last| {
            let place = &stopped.place;
            let within = place.parts().standing_sigma * STANDING_SIGMAS;
            let is_apart = (place.position() - last.place).norm_squared() > within * within;
            match last.seen == Some(*seen) {
                // The same stop, told again in another frame.
                true if last.stop == stopped.stop => last.repeats,
                true if is_apart => last.repeats.saturating_add(1),
                _ => 0,
            }
        })
    }

    /// The last stop of each target.
    pub(super) fn stops(&self) -> impl Iterator<Item = (MemberAddress, StopNumber)> {
        self.looks.iter().map(|look| (look.target, look.stop))
    }

    pub(super) fn clear(&mut self) {
        self.looks.clear();
    }
}

/// Whether a target that stood at `known` stands at `stop` no more.
pub(super) fn is_past(known: StopNumber, stop: StopNumber) -> bool {
    (1..=OVERTAKEN).contains(&known.wrapping_sub(stop))
}
