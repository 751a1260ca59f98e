//! What a camera that tracks tells the coordinator: the last frame, now and then.

use core::time::Duration;

use zigbee_link::Instant;

use crate::message::{Seen, Tracked, TrackedBlob};

/// Between two frames with an object that are told: as many cameras as see four objects from everywhere leave
/// the air free for other things.
const SEEN: Duration = Duration::from_millis(200);
/// Between two frames without one.
const NOTHING: Duration = Duration::from_secs(2);

/// The last frame, until it is told.
#[derive(Clone, Debug)]
pub(super) struct Stream {
    latest: Option<(Instant, Tracked)>,
    /// When something was told last, and whether that was an object.
    told: Option<(Instant, bool)>,
}

impl Stream {
    pub(super) const fn new() -> Self {
        Self {
            latest: None,
            told: None,
        }
    }

    /// Takes a frame. What was there is of no use any more.
    pub(super) fn on_frame(&mut self, now: Instant, tracked: Tracked) {
        let seen = tracked.seen.filter(Seen::is_usable);
        self.latest = Some((now, Tracked { seen, ..tracked }));
    }

    /// The last frame with its age, if it is due.
    pub(super) fn take_due(&mut self, now: Instant) -> Option<Tracked> {
        if self.next_due()? > now {
            return None;
        }
        let (at, tracked) = self.latest.take()?;
        self.told = Some((now, is_something(&tracked)));
        let age = now.since(at).as_millis();
        Some(Tracked {
            age_ms: u16::try_from(age).unwrap_or(u16::MAX),
            ..tracked
        })
    }

    /// When there is something to tell. That an object is gone is told as soon as that it is there.
    pub(super) fn next_due(&self) -> Option<Instant> {
        let (at, tracked) = &self.latest?;
        Some(match self.told {
            None => *at,
            Some((told, false)) if !is_something(tracked) => told + NOTHING,
            Some((told, _)) => told + SEEN,
        })
    }
}

fn is_something(tracked: &Tracked) -> bool {
    tracked.blob != TrackedBlob::default()
}
