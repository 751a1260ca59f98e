//! Objects of the learnt colour, as cameras that track and know their poses see them (thesis 1.2).

use core::time::Duration;

use calib_core::{
    Ray, Real, Status,
    intersection::StationBearing,
    tracking::{Look, OBJECTS, Settings, Tracker},
};
use zigbee_link::Instant;

use crate::{
    arithmetic::root,
    config::CoordinatorConfig,
    console::{ToPc, TrackedObject},
    message::{MemberAddress, Mount, PoseParts, Report, Seen, Tracked},
};

/// The PC is told of one object so often: ten times a second in all.
const PERIOD: Duration = Duration::from_millis(100);

/// Standard deviation of the height at which a ball is carried, metres.
const HEIGHT_SIGMA: f32 = 0.1;
/// Standard deviation of a camera's pitch, radians.
const MOUNT_SIGMA: f32 = 0.01;
/// A range by a row whose standard deviation is a larger share of it is none.
const ROW_LIMIT: f32 = 0.2;
/// Standard deviations within which size and row tell of one ball.
const AGREE: f32 = 3.0;

/// In microseconds.
const MILLISECOND: u64 = 1_000;

/// Tracked objects, and the PC's knowledge of them.
#[derive(Clone, Debug)]
pub(super) struct Tracking {
    tracker: Tracker<f32>,
    /// Radius of the objects, if it is known.
    radius: Option<f32>,
    /// Standard deviation of the height at which they are carried, in the unit of the site.
    height_sigma: f32,
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
            radius: None,
            height_sigma: 0.0,
            told: heapless::Vec::new(),
            next: None,
            turn: 0,
        }
    }

    /// From now on objects of this kind, in this unit.
    pub(super) fn configure(&mut self, config: &CoordinatorConfig) {
        let radius = Some(config.ball_radius).filter(|radius| *radius > 0.0);
        let mut settings = Settings::WALKING.in_units(config.metres_per_unit);
        settings.radius = radius;
        self.tracker.follow(settings);
        self.radius = radius;
        self.height_sigma = HEIGHT_SIGMA / config.metres_per_unit;
    }

    /// Distance along the floor to a ball of known radius, and its standard deviation: by its size, and, of a camera that is
    /// not level, by the row in which it is seen. So one camera tells where a ball is that is carried at the height at which
    /// the cameras were calibrated.
    // for less stack
    #[inline(never)]
    fn range(&self, seen: &Seen, mount: Option<Mount>) -> Option<(f32, f32)> {
        let radius = self.radius?;
        // The camera turned it upright.
        let (up, along) = Real::sine_cosine(seen.elevation.radians().unwrap_or(0.0_f32));
        let by_size = seen
            .range(radius)
            .map(|(range, sigma)| (range * along, sigma * along));
        let by_row = mount.and_then(|mount| {
            let range = -mount.height * along / up;
            let by_angle = (range * range + mount.height * mount.height) / mount.height;
            let by_height = self.height_sigma * range / mount.height;
            let angle = seen.sigma * seen.sigma + MOUNT_SIGMA * MOUNT_SIGMA;
            let sigma = root(by_angle * by_angle * angle + by_height * by_height);
            (range > 0.0 && sigma < ROW_LIMIT * range).then_some((range, sigma))
        });
        let (Some(size), Some(row)) = (by_size, by_row) else {
            return by_size.or(by_row);
        };
        let variances = [size, row].map(|(_, sigma)| sigma * sigma);
        let [of_size, of_row] = variances;
        let both = of_size + of_row;
        let apart = size.0 - row.0;
        if apart * apart > AGREE * AGREE * both {
            // It is carried higher or lower.
            return by_size;
        }
        let range = (size.0 * of_row + row.0 * of_size) / both;
        Some((range, root(of_size * of_row / both)))
    }

    /// Takes a camera's look. Only a camera that is sure of its pose tells the place of an object.
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
        let mount = report.and_then(|report| report.mount);
        let age = u64::from(tracked.age_ms) * MILLISECOND;
        let look = Look {
            camera,
            at: now.0.saturating_sub(age),
            bearing: StationBearing {
                pose,
                ray: Ray::from_bearing(seen.bearing),
                bearing_sigma: seen.sigma,
                range: self.range(&seen, mount),
            },
            half_width: seen.half_angle(),
            is_wide: tracked.is_wide,
        };
        self.tracker.take(now.0, &look);
        if self.next.is_none() && self.tracker.objects().next().is_some() {
            self.next = Some(now);
        }
    }

    /// Message to the PC now, if it is due.
    pub(super) fn take_due(&mut self, now: Instant) -> Option<ToPc> {
        if self.next? > now {
            return None;
        }
        self.tracker.go_to(now.0);
        let is_gone = |id: &u16| self.tracker.objects().all(|object| object.id != *id);
        if let Some(place) = self.told.iter().position(is_gone) {
            let id = *self.told.get(place)?;
            self.told.retain(|told| *told != id);
            return Some(ToPc::Object { id, object: None });
        }
        let count = self.tracker.objects().count();
        if count == 0 {
            self.next = None;
            return None;
        }
        self.next = Some(now + PERIOD);
        self.turn = (self.turn + 1) % count;
        let object = self.tracker.objects().nth(self.turn)?;
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
                unseen_ms: u16::try_from(now.0.saturating_sub(object.seen) / MILLISECOND)
                    .unwrap_or(u16::MAX),
            }),
        })
    }

    pub(super) fn next_due(&self) -> Option<Instant> {
        self.next
    }
}

#[cfg(test)]
mod tests {
    use calib_core::level::{Elevation, Mounting};

    use std::vec::Vec;

    use super::*;
    use crate::message::CameraState;

    /// Cameras with their positions and headings.
    const CAMERAS: [(u16, [f32; 2], f32); 3] = [
        (1, [0.0, 0.0], 0.8),
        (2, [10.0, 0.0], 2.3),
        (3, [5.0, 10.0], -1.6),
    ];

    fn at(milliseconds: u64) -> Instant {
        Instant(milliseconds * 1_000)
    }

    fn report(position: [f32; 2], heading: f32, sigma: f32) -> Report {
        let variance = sigma * sigma;
        Report {
            id: 1,
            duty: None,
            sightings: 5,
            used: 5,
            chi_squared: 1.0,
            done: true,
            joint: None,
            state: CameraState::Calibrated(PoseParts {
                position,
                heading,
                covariance: [variance, 0.0, variance, 0.0, 0.0, variance],
            }),
            mount: None,
        }
    }

    fn towards([cx, cy]: [f32; 2], heading: f32, [x, y]: [f32; 2]) -> Tracked {
        let direction = f64::from(y - cy).atan2(f64::from(x - cx)) as f32;
        Tracked {
            seen: Some(Seen::direction(direction - heading, 0.005)),
            ..Tracked::default()
        }
    }

    /// Messages to the PC while something walks from (4, 4) to the right, and their times.
    fn walk(tracking: &mut Tracking, milliseconds: u64) -> Vec<(u64, ToPc)> {
        let mut told = Vec::new();
        for now in (0..milliseconds).step_by(50) {
            let place = [4.0 + now as f32 * 5e-4, 4.0];
            let (camera, position, heading) = CAMERAS[(now / 50 % 3) as usize];
            let report = report(position, heading, 0.01);
            let tracked = towards(position, heading, place);
            tracking.on_tracked(at(now), camera, &tracked, Some(&report));
            told.extend(tracking.take_due(at(now)).map(|told| (now, told)));
        }
        told
    }

    #[test]
    fn an_object_is_told_until_it_is_gone() {
        let mut tracking = Tracking::new();
        let told = walk(&mut tracking, 4_000);
        // Two a second less than ten: it takes half a second to believe in it.
        assert!((25..=36).contains(&told.len()), "{}", told.len());
        assert!(told.windows(2).all(|pair| pair[1].0 - pair[0].0 >= 100));
        let &(
            now,
            ToPc::Object {
                id,
                object: Some(object),
            },
        ) = told.last().unwrap()
        else {
            panic!("{told:?}");
        };
        let ([x, y], [xx, _, yy]) = object.place;
        let sigma = (f64::from(xx + yy)).sqrt() as f32;
        assert!(sigma < 0.2, "{sigma}");
        assert!((x - 4.0 - now as f32 * 5e-4).abs() < 3.0 * sigma, "{x}");
        assert!((y - 4.0).abs() < 3.0 * sigma, "{y}");
        assert!((object.velocity[0] - 0.5).abs() < 0.3 && object.unseen_ms < 200);
        // No camera sees it any more.
        let mut last = Vec::new();
        for now in (4_000..12_000).step_by(50) {
            last.extend(tracking.take_due(at(now)));
        }
        assert_eq!(last.last(), Some(&ToPc::Object { id, object: None }));
        let gone = |told: &&ToPc| matches!(told, ToPc::Object { object: None, .. });
        assert_eq!(last.iter().filter(gone).count(), 1);
        assert_eq!(tracking.next_due(), None);
    }

    /// A camera that does not know its pose, or says so of itself, is not relied on.
    #[test]
    fn who_has_no_sure_pose_tells_nothing() {
        for state in [
            CameraState::Waiting,
            CameraState::Doubtful(PoseParts {
                position: [0.0; 2],
                heading: 0.8,
                covariance: [1e-4, 0.0, 1e-4, 0.0, 0.0, 1e-4],
            }),
        ] {
            let mut tracking = Tracking::new();
            for now in (0..4_000).step_by(50) {
                for (camera, position, heading) in CAMERAS {
                    let report = Report {
                        state,
                        ..report(position, heading, 0.01)
                    };
                    let tracked = towards(position, heading, [4.0, 4.0]);
                    tracking.on_tracked(at(now), camera, &tracked, Some(&report));
                    tracking.on_tracked(at(now), camera, &tracked, None);
                }
                assert_eq!(tracking.take_due(at(now)), None);
            }
        }
    }

    /// A look counts for its time, and one that is older than any use for nothing.
    #[test]
    fn old_looks_are_none() {
        let mut tracking = Tracking::new();
        for now in (2_000..6_000).step_by(50) {
            for (camera, position, heading) in CAMERAS {
                let tracked = Tracked {
                    age_ms: 900,
                    ..towards(position, heading, [4.0, 4.0])
                };
                let report = report(position, heading, 0.01);
                tracking.on_tracked(at(now), camera, &tracked, Some(&report));
            }
            assert_eq!(tracking.take_due(at(now)), None);
        }
    }

    /// Direction of a ball `ahead` and `aside` of a camera that hangs `height` above it, as the camera turned it upright.
    fn seen(ahead: f32, aside: f32, height: f32, half_width: f32) -> Seen {
        let along = ahead.hypot(aside);
        Seen::direction(aside.atan2(ahead), 0.001)
            .above(Elevation::from_radians((-height).atan2(along)))
            .wide(half_width)
    }

    fn mount(height: f32) -> Option<Mount> {
        let mounting = Mounting {
            pitch: 0.5,
            roll: 0.02,
        };
        Mount::of(mounting, height)
    }

    fn tracking(ball_radius: f32) -> Tracking {
        let mut tracking = Tracking::new();
        tracking.configure(&CoordinatorConfig {
            ball_radius,
            ..CoordinatorConfig::default()
        });
        tracking
    }

    /// By its row alone where it is too far away to be measured; by its size, along the floor, where it is carried at another
    /// height; by both, and surer, where they agree.
    #[test]
    fn one_camera_tells_how_far_away_a_ball_is() {
        const BALL: f32 = 0.25;
        let tracking = tracking(BALL);
        for (ahead, aside, height) in [(3.0, 0.5, 1.5), (4.0, -1.0, 2.5), (5.0, 2.0, -2.0)] {
            let along = f32::hypot(ahead, aside);
            let far = seen(ahead, aside, height, 0.0);
            let (range, of_row) = tracking.range(&far, mount(height)).unwrap();
            assert!((range - along).abs() < 0.01, "{range} {along}");
            assert!((0.02..0.2).contains(&(of_row / range)), "{of_row}");
            // The height is wrong by one sigma, and so is the range.
            let higher = seen(ahead, aside, height - 0.1, 0.0);
            let (higher, _) = tracking.range(&higher, mount(height)).unwrap();
            assert!(
                (0.5..1.1).contains(&((higher - range).abs() / of_row)),
                "{higher}"
            );
            // All that is known of a level camera is the size.
            assert_eq!(tracking.range(&far, None), None);
            let half_width = (BALL / along.hypot(height)).asin();
            let near = seen(ahead, aside, height, half_width);
            let (by_size, of_size) = tracking.range(&near, None).unwrap();
            assert!((by_size - along).abs() < 0.02, "{by_size} {along}");
            let (both, of_both) = tracking.range(&near, mount(height)).unwrap();
            assert!((both - along).abs() < 0.02 && of_both < of_row.min(of_size));
            // On the floor, a metre below.
            let low = Seen {
                elevation: seen(ahead, aside, height + 1.0, 0.0).elevation,
                ..near
            };
            let (on_floor, _) = tracking.range(&low, mount(height)).unwrap();
            assert_eq!(
                Some(on_floor),
                tracking.range(&low, None).map(|(range, _)| range)
            );
        }
    }

    /// A row near the horizon tells nothing, nor does a ball of which nothing is known.
    #[test]
    fn a_row_that_tells_nothing_tells_none() {
        let far = seen(30.0, 0.0, 1.5, 0.0);
        assert_eq!(tracking(0.1).range(&far, mount(1.5)), None);
        // Above the horizon of a camera that hangs above it.
        assert_eq!(
            tracking(0.1).range(&seen(3.0, 0.0, -1.0, 0.0), mount(1.5)),
            None
        );
        assert_eq!(
            tracking(0.0).range(&seen(3.0, 0.0, 1.5, 0.0), mount(1.5)),
            None
        );
    }
}
