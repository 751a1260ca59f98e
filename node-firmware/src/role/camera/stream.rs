//! Reports of a camera that tracks to the coordinator: the last frame, now and then.

use core::time::Duration;

use zigbee_link::Instant;

use crate::message::{Seen, Tracked, TrackedBlob};

/// Time between two told frames with an object: as many cameras as see four objects from everywhere leave the
/// air free for other things.
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

    /// Takes a frame. The former one is of no use any more.
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

    /// Time when there is something to tell. That an object is gone is told as soon as that it is there.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn at(milliseconds: u64) -> Instant {
        Instant(milliseconds * 1_000)
    }

    fn object(middle: u16) -> Tracked {
        Tracked {
            blob: TrackedBlob {
                middle: [middle, 70],
                ..TrackedBlob::default()
            },
            seen: Some(Seen::direction(0.1, 0.01)),
            ..Tracked::default()
        }
    }

    /// Of fifty frames a second, five are told, each the last one, with its age.
    #[test]
    fn five_a_second_are_told() {
        let mut stream = Stream::new();
        let mut told = std::vec::Vec::new();
        for now in (0..1_000).step_by(5) {
            if now % 20 == 0 {
                stream.on_frame(at(now), object(now as u16));
            }
            // The radio is busy every second time.
            if now % 10 == 5 {
                told.extend(stream.take_due(at(now)));
            }
        }
        assert_eq!(told.len(), 5);
        for (n, tracked) in (0..).zip(told) {
            assert_eq!(tracked.blob.middle[0], 200 * n);
            assert_eq!(tracked.age_ms, 5);
        }
    }

    #[test]
    fn that_nothing_is_there_is_told_at_once_and_then_seldom() {
        let mut stream = Stream::new();
        stream.on_frame(at(0), object(40));
        assert!(stream.take_due(at(0)).is_some());
        stream.on_frame(at(20), Tracked::default());
        assert_eq!(stream.next_due(), Some(at(200)));
        assert_eq!(stream.take_due(at(199)), None);
        assert!(stream.take_due(at(200)).is_some());
        stream.on_frame(at(220), Tracked::default());
        assert_eq!(stream.next_due(), Some(at(2_200)));
        // Until something is seen.
        stream.on_frame(at(240), object(40));
        assert_eq!(stream.next_due(), Some(at(400)));
    }

    #[test]
    fn no_unusable_direction_is_told() {
        for seen in [
            Seen::direction(f32::NAN, 0.1),
            Seen::direction(0.1, -1.0),
            Seen::direction(0.1, f32::INFINITY),
        ] {
            let mut stream = Stream::new();
            let tracked = Tracked {
                seen: Some(seen),
                ..object(40)
            };
            stream.on_frame(at(0), tracked);
            assert_eq!(stream.take_due(at(0)).unwrap().seen, None);
        }
    }
}
