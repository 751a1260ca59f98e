//! Objects of the learnt colour, as cameras that track and know their poses see them (thesis 1.2).

use core::time::Duration;

use calib_core::{
    Ray, Status,
    intersection::StationBearing,
    tracking::{Look, OBJECTS, Settings, Tracker},
};
use zigbee_link::Instant;

use crate::{
    console::{ToPc, TrackedObject},
    message::{MemberAddress, PoseParts, Report, Tracked},
};

/// The PC is told of one object so often: ten times a second in all.
const PERIOD: Duration = Duration::from_millis(100);

/// What is tracked, and what the PC knows of it.
#[derive(Clone, Debug)]
pub(super) struct Tracking {
    tracker: Tracker<f32>,
    /// Numbers of objects that the PC was told of and that are not gone.
    told: heapless::Vec<u16, OBJECTS>,
    /// When the PC is told again, and of which object.
    next: Option<Instant>,
    turn: usize,
}

impl Tracking {
    #[inline(always)]
    pub(super) const fn new() -> Self {
        Self {
            tracker: Tracker::new(Settings::WALKING),
            told: heapless::Vec::new(),
            next: None,
            turn: 0,
        }
    }

    /// Takes what a camera saw. Only one that is sure of its pose tells where an object is.
    pub(super) fn on_tracked(
        &mut self,
        now: Instant,
        camera: MemberAddress,
        tracked: &Tracked,
        report: Option<&Report>,
    ) {
        let is_sure =
            |report: &&Report| matches!(report.status(), Status::Calibrated | Status::Weak);
        let pose = report.filter(is_sure).and_then(|report| report.pose());
        let (Some(seen), Some(pose)) = (tracked.seen, pose.and_then(PoseParts::pose)) else {
            return;
        };
        let at = time(now);
        let look = Look {
            camera,
            at: at.saturating_sub(Duration::from_millis(tracked.age_ms.into())),
            bearing: StationBearing {
                pose,
                ray: Ray::from_bearing(seen.bearing),
                bearing_sigma: seen.sigma,
                range: None,
            },
            half_width: seen.half_angle(),
            is_wide: tracked.is_wide,
        };
        self.tracker.take(at, &look);
        if self.next.is_none() && self.tracker.objects().next().is_some() {
            self.next = Some(now);
        }
    }

    /// What the PC is told now, if that is due.
    pub(super) fn take_due(&mut self, now: Instant) -> Option<ToPc> {
        if self.next? > now {
            return None;
        }
        let at = time(now);
        self.tracker.go_to(at);
        let objects: heapless::Vec<_, OBJECTS> = self.tracker.objects().collect();
        let is_gone = |id: &u16| objects.iter().all(|object| object.id != *id);
        if let Some(place) = self.told.iter().position(is_gone) {
            let id = self.told.swap_remove(place);
            return Some(ToPc::Object { id, object: None });
        }
        if objects.is_empty() {
            self.next = None;
            return None;
        }
        self.next = Some(now + PERIOD);
        self.turn = (self.turn + 1) % objects.len();
        let object = objects.get(self.turn)?;
        if !self.told.contains(&object.id) {
            let has_room = self.told.push(object.id).is_ok();
            debug_assert!(has_room, "those that are gone were told");
        }
        let covariance = object.covariance;
        Some(ToPc::Object {
            id: object.id,
            object: Some(TrackedObject {
                place: (
                    object.position.coords.into(),
                    [covariance.m11, covariance.m21, covariance.m22],
                ),
                velocity: object.velocity.into(),
                unseen_ms: u16::try_from(at.saturating_sub(object.seen).as_millis())
                    .unwrap_or(u16::MAX),
            }),
        })
    }

    pub(super) fn next_due(&self) -> Option<Instant> {
        self.next
    }
}

fn time(now: Instant) -> Duration {
    Duration::from_micros(now.0)
}
