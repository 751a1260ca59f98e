//! Cameras whose looks at the present stop came while the target stood there.

use core::time::Duration;

use zigbee_link::{Instant, wire::ShortAddress};

use crate::message::{CONFIRMED, MemberAddress};

/// After an answer, before it is confirmed: others answer too.
const COLLECT: Duration = Duration::from_millis(300);

/// After a confirmation, until no camera is expected to repeat an answer that it does not name: the slots of
/// all members, and a look that was about to end.
pub(super) const SETTLE: Duration = Duration::from_millis(600);

#[derive(Clone, Debug)]
pub(super) struct Confirmations {
    seen_by: heapless::Vec<MemberAddress, CONFIRMED>,
    /// Time to tell, if there is something to tell.
    due: Option<Instant>,
    told: Option<Instant>,
    /// Those that did not hear that they were named.
    missed: heapless::Vec<MemberAddress, MISSED>,
    /// For so many stops yet, this one included, messages are taken to get lost: a camera answered twice, or
    /// had not heard of a stop.
    lossy: u8,
    /// That happened at this stop.
    has_lost: bool,
    /// Number of further confirmations of the present stop because of that.
    repeats: u8,
}

/// Stops, after one at which a message was lost.
const LOSSY: u8 = 4;

/// Cameras that are told alone, one after the other. If there are more, the first ones: each answers again.
const MISSED: usize = 4;

/// Where messages get lost. A camera that did not see the target before is not asked, and hears of a stop by
/// broadcasts alone: of ten frames with 30 % loss all are lost in 6 of a million cases, of six in 7 of
/// 10,000.
const REPEATS: u8 = 3;

/// Where that was once, and may have been a collision.
const FEW_REPEATS: u8 = 1;

impl Confirmations {
    pub(super) const fn new() -> Self {
        Self {
            seen_by: heapless::Vec::new(),
            due: None,
            told: None,
            missed: heapless::Vec::new(),
            lossy: 0,
            has_lost: false,
            repeats: 0,
        }
    }

    /// Another stop, or the same one told anew.
    pub(super) fn clear(&mut self) {
        *self = Self {
            lossy: self.lossy.saturating_sub(1),
            ..Self::new()
        };
    }

    /// The cameras are to be told at this time.
    pub(super) const fn due(&mut self, at: Instant) {
        self.due = Some(at);
    }

    /// A camera saw the target at this stop. Not before `first`, when most have answered. Returns the time of
    /// the confirmation.
    pub(super) fn add(&mut self, now: Instant, camera: MemberAddress, first: Instant) -> Instant {
        if self.seen_by.contains(&camera) {
            self.lost();
            if self.tell_alone(camera) {
                return now;
            }
        }
        self.seen_by.retain(|known| *known != camera);
        if self.seen_by.is_full() {
            // Most likely it was named already. If not, it answers again.
            self.seen_by.remove(0);
        }
        let has_room = self.seen_by.push(camera).is_ok();
        debug_assert!(has_room);
        self.tell_again(now, first)
    }

    /// A camera answers when the target may stand there no more. If it has answered before, it did
    /// not hear that it was confirmed.
    pub(super) fn repeat(&mut self, now: Instant, camera: MemberAddress) {
        if self.seen_by.contains(&camera) && !self.tell_alone(camera) {
            self.tell_again(now, now);
        }
    }

    /// A named camera answers again, so it has missed that. It is told alone until it acknowledges, unless
    /// all are told soon.
    fn tell_alone(&mut self, camera: MemberAddress) -> bool {
        self.due.is_none() && (self.missed.contains(&camera) || self.missed.push(camera).is_ok())
    }

    /// A camera did not know of the stop, or is not ready. It is told once more, for others that did not
    /// hear of it either.
    pub(super) fn on_missed(&mut self, now: Instant, first: Instant) {
        if self.lost() {
            self.tell_again(now, first);
        }
    }

    /// A message was lost. Returns true if it is the first at this stop.
    fn lost(&mut self) -> bool {
        let is_first = !core::mem::replace(&mut self.has_lost, true);
        if is_first {
            self.lossy = (self.lossy + LOSSY).min(2 * LOSSY);
        }
        is_first
    }

    fn tell_again(&mut self, now: Instant, first: Instant) -> Instant {
        let at = (now + COLLECT).max(first);
        let at = self.due.map_or(at, |due| due.min(at));
        self.due = Some(at);
        at
    }

    /// The receiver now, and the cameras to name.
    pub(super) fn take_due(
        &mut self,
        now: Instant,
    ) -> Option<(ShortAddress, heapless::Vec<MemberAddress, CONFIRMED>)> {
        if let Some(camera) = self.missed.pop() {
            self.told = Some(now);
            let mut named = heapless::Vec::new();
            let has_room = named.push(camera).is_ok();
            debug_assert!(has_room);
            return Some((ShortAddress(camera), named));
        }
        self.due.take_if(|due| *due <= now)?;
        self.told = Some(now);
        // A camera that missed the stop and this message has missed all that tells it to look.
        let repeats = match self.lossy {
            0 => 0,
            1..=LOSSY => FEW_REPEATS,
            _ => REPEATS,
        };
        if self.repeats < repeats {
            self.repeats += 1;
            self.due = Some(now + COLLECT);
        }
        Some((ShortAddress::BROADCAST, self.seen_by.clone()))
    }

    pub(super) fn next_due(&self) -> Option<Instant> {
        if self.missed.is_empty() {
            self.due
        } else {
            Some(Instant(0))
        }
    }

    /// Time when all cameras that saw the target know that it counts, as known now; not before `first`.
    pub(super) fn settled_at(&self, first: Instant) -> Instant {
        let last = self.due.or(self.told).unwrap_or(first);
        last.max(first) + SETTLE
    }
}
