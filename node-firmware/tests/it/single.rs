//! One role, alone with the test: references that are replaced or contradict each other, power that is cut
//! between two facts, messages of the wrong member.

use crate::support;

use std::{cell::Cell, rc::Rc};

use calib_core::{
    Refusal,
    dead_reckoning::{Place, Step, Systematic, Track},
};
use nalgebra::{Matrix2, Point2, Vector2};
use node_firmware::{
    config::{CameraConfig, TargetConfig},
    facts::{Fact, Walk},
    limits::REFERENCE_STOPS,
    message::{
        CameraState, Confirmation, CoordinateFrame, Duty, Message, PoseParts, References, Report,
        Seen, Sight, StopAnswer, StopBearing, StopNumber, Stopped, TargetLocation,
    },
    role::{
        Role,
        camera::{self, CameraRole},
        moving_target::{self, TargetRole},
    },
};
use support::{
    bus::{Air, AnyStation, PERFECT, Station},
    net::{SECOND, TARGET, with_references},
    site::{BEARING_SIGMA, CAMERAS, STOPS, Truth, camera_config, target_config},
    target::target_role,
};
use zigbee_link::wire::ShortAddress;

/// A camera's sighting of a place, without an error.
fn sees(camera: &Truth, place: [f64; 2]) -> Seen {
    use std::f64::consts::PI;
    let to = Point2::from(place) - camera.position;
    let bearing = to.y.atan2(to.x) - camera.heading;
    Seen::direction(
        ((bearing + PI).rem_euclid(2.0 * PI) - PI) as f32,
        BEARING_SIGMA as f32,
    )
}

/// The first camera, alone with this test.
struct Alone {
    camera: Station<CameraRole>,
    air: Air,
    now: u64,
    place: Rc<Cell<[f64; 2]>>,
    track: Track<f32>,
}

impl Alone {
    fn new(config: CameraConfig) -> Self {
        let place = Rc::new(Cell::new(STOPS[0]));
        let seen = place.clone();
        let mut camera = Station::<CameraRole>::new(
            1,
            move || CameraRole::new(101, config.clone()),
            Box::new(move |now, _| {
                let seen = sees(&CAMERAS[0], seen.get());
                Some((now, camera::CameraEvent::Looked(Sight::InView, Some(seen))))
            }),
        );
        camera.attach(0);
        camera.event(0, camera::CameraEvent::Ready);
        let mut alone = Self {
            camera,
            air: Air::new(PERFECT, 1),
            now: 0,
            place,
            track: Track::default(),
        };
        alone.act();
        alone
    }

    fn act(&mut self) {
        // Devices are done at once; another moment for their events, and for its answers.
        for _ in 0..3 {
            self.now += SECOND / 10;
            self.camera.act(self.now, &mut self.air);
        }
    }

    fn references(&mut self, first: u16, second: u16) {
        let references = References {
            first,
            second,
            positions: None,
        };
        let message = Message::References(references);
        self.camera.hear(self.now, ShortAddress(0), &message);
        self.act();
    }

    /// The target, which does not know its place, tells of its stop.
    fn stopped(&mut self, stop: StopNumber, place: Place<f32>) {
        let message = Message::Stopped(Stopped {
            stop,
            colour: 0,
            frame: CoordinateFrame::Own,
            place,
        });
        self.camera.hear(self.now, ShortAddress(TARGET), &message);
        self.act();
        let confirmation = Message::Confirmed(Confirmation {
            stop,
            seen_by: [1].into_iter().collect(),
        });
        self.camera
            .hear(self.now, ShortAddress(TARGET), &confirmation);
        self.act();
    }

    /// It walks to places, and on the way to some of them its sensor misses a push.
    fn walk(&mut self, stops: &[[f64; 2]], pushed: impl Fn(usize) -> [f64; 2]) {
        let mut before = stops[0];
        for (n, stop) in stops.iter().enumerate() {
            let by = pushed(n);
            let way = Vector2::new(stop[0] - by[0] - before[0], stop[1] - by[1] - before[1]);
            before = *stop;
            if n > 0 {
                let step = Step {
                    distance: way.norm() as f32,
                    heading: way.y.atan2(way.x) as f32,
                    distance_sigma: 0.005,
                    heading_sigma: 0.001,
                };
                self.track.advance(&step).unwrap();
            }
            self.place.set(*stop);
            self.stopped(n as StopNumber, self.track.place(0.005).unwrap());
        }
    }

    /// Another reference camera saw the target there.
    fn bearing(&mut self, from: u16, stop: usize) {
        let bearing = StopBearing {
            target: TARGET,
            stop: stop as StopNumber,
            seen: sees(&CAMERAS[1], STOPS[stop]),
            pose: None,
        };
        let message = Message::Bearing(bearing);
        self.camera.hear(self.now, ShortAddress(from), &message);
    }

    fn has_pose(&self) -> bool {
        self.camera.role.report().pose().is_some()
    }
}

const NO_PUSH: fn(usize) -> [f64; 2] = |_| [0.0; 2];

/// The second reference camera is replaced, or both change places for a while. The sightings of the former
/// one count no more, over a restart too, wherever the power is cut.
#[test]
fn another_second_camera_begins_anew() {
    for interlude in [&[(1, 3)][..], &[(2, 1), (1, 3)], &[(3, 2), (1, 3)]] {
        let mut alone = Alone::new(with_references(0));
        alone.references(1, 2);
        alone.walk(&STOPS[..3], NO_PUSH);
        // One more that this camera did not see.
        for stop in [3, 0, 1] {
            alone.bearing(2, stop);
            alone.act();
        }
        let before = alone.camera.facts.len();
        for (first, second) in interlude {
            alone.references(*first, *second);
        }
        // Until no stop has a bearing of the former one, it is the second.
        let written = &alone.camera.facts[before..];
        let told = |fact: &Fact| matches!(fact, Fact::References(_));
        let stops = |fact: &Fact| matches!(fact, Fact::ReferenceStop(..));
        let first = written.iter().position(told).unwrap();
        assert_eq!(
            written[..first].iter().filter(|fact| stops(fact)).count(),
            4
        );
        assert!(!written[first..].iter().any(stops), "{written:?}");
        alone.camera.restart(alone.now);
        alone.bearing(3, 2);
        alone.act();
        assert!(!alone.has_pose());
        alone.bearing(3, 0);
        alone.act();
        assert!(!alone.has_pose());
        alone.bearing(3, 1);
        alone.act();
        assert!(alone.has_pose());
    }
}

#[test]
fn a_second_camera_that_was_the_first_begins_anew() {
    let mut alone = Alone::new(with_references(0));
    alone.references(1, 2);
    alone.walk(&STOPS[..3], NO_PUSH);
    for stop in [0, 1] {
        alone.bearing(2, stop);
        alone.act();
    }
    alone.references(2, 1);
    alone.references(1, 2);
    alone.bearing(2, 2);
    alone.act();
    assert!(!alone.has_pose());
    for stop in [0, 1] {
        alone.bearing(2, stop);
        alone.act();
    }
    assert!(alone.has_pose());
}

/// A pose of the former second camera is not that of the next.
#[test]
fn a_pose_is_told_to_its_camera_only() {
    let mut alone = Alone::new(with_references(0));
    alone.references(1, 2);
    alone.walk(&STOPS[..3], NO_PUSH);
    for stop in 0..3 {
        alone.bearing(2, stop);
    }
    alone.act();
    assert!(alone.has_pose());
    alone.references(1, 3);
    alone.bearing(3, 0);
    alone.now += 60 * SECOND;
    alone.act();
    let posed = alone.air.sent.iter().filter_map(|sent| {
        let is_posed = matches!(sent.message, Message::Posed(_));
        is_posed.then_some(sent.to.0)
    });
    assert!(posed.clone().count() > 0);
    assert_eq!(posed.filter(|to| *to != 2).count(), 0);
}

/// Two references know neither their distance nor how the sensor is turned, and three stops fit
/// whatever happened. Where four contradict each other, three of them do not decide.
#[test]
fn what_cannot_be_checked_is_no_way_out() {
    let mut config = with_references(0);
    config.baseline = None;
    let mut contradictions = 0;
    for start in 0..STOPS.len() - 3 {
        for pushed in 1..4 {
            let mut alone = Alone::new(config.clone());
            alone.references(1, 2);
            let by = |n| {
                if n == start + pushed {
                    [0.8, -0.5]
                } else {
                    [0.0; 2]
                }
            };
            alone.walk(&STOPS, by);
            for stop in start..start + 4 {
                alone.bearing(2, stop);
            }
            alone.act();
            let state = alone.camera.role.report().state;
            if state == CameraState::Refused(Refusal::Inconsistent) {
                contradictions += 1;
            }
            assert!(!alone.has_pose(), "{pushed} after {start}");
        }
    }
    assert!(contradictions > 5, "{contradictions}");
}

/// The first reference solves, and loses its power between two facts that it writes down. From the deciding
/// one on nothing is lost; and when all are written, no stop is left.
#[test]
fn a_cut_while_a_solve_is_written_down_loses_nothing() {
    let mut alone = Alone::new(with_references(0));
    alone.references(1, 2);
    alone.walk(&STOPS[..3], NO_PUSH);
    for stop in 0..2 {
        alone.bearing(2, stop);
        alone.act();
    }
    let before = alone.camera.facts.len();
    alone.bearing(2, 2);
    alone.act();
    assert!(alone.has_pose());
    let facts = &alone.camera.facts;
    for cut in before + 1..=facts.len() {
        // As a memory recalls them: the last of each kind, the report first.
        let mut report = None;
        let mut others = Vec::new();
        let mut stops = [None; REFERENCE_STOPS];
        for fact in &facts[..cut] {
            match fact {
                Fact::Report(_) => report = Some(*fact),
                Fact::ReferenceStop(index, _) => stops[usize::from(*index)] = Some(*fact),
                other => others.push(*other),
            }
        }
        let mut role = CameraRole::new(101, with_references(0));
        let recalled = report.into_iter().chain(others);
        for fact in recalled.chain(stops.into_iter().flatten()) {
            role.restore(&fact);
        }
        let mut station =
            Station::<CameraRole>::new(1, move || role.clone(), Box::new(|_, _| None));
        station.attach(alone.now);
        station.act(alone.now, &mut Air::new(PERFECT, 2));
        assert!(station.role.report().pose().is_some(), "{cut}: {facts:?}");
        let left = |fact: &&Option<Fact>| matches!(fact, Some(Fact::ReferenceStop(_, Some(_))));
        if cut == facts.len() {
            assert_eq!(stops.iter().filter(left).count(), 0);
        }
        // Those that a cut left go after the restart.
        let erased = |fact: &&Fact| matches!(fact, Fact::ReferenceStop(_, None));
        let erased = station.facts.iter().filter(erased).count();
        assert_eq!(erased, stops.iter().filter(left).count(), "{cut}");
    }
}

/// A camera that was none becomes a reference while the target still stands. Its sighting there counts from
/// the next stop on: this one it has answered.
#[test]
fn a_camera_that_was_none_becomes_a_reference() {
    let mut alone = Alone::new(camera_config(None));
    alone.references(2, 3);
    let sights = |alone: &Alone| -> Vec<_> {
        let sent = alone.air.sent.iter();
        let looks = sent.filter_map(|sent| match &sent.message {
            Message::Look(StopAnswer { sight, .. }) => Some(*sight),
            _ => None,
        });
        looks.collect()
    };
    let place = alone.track.place(0.005).unwrap();
    alone.stopped(5, place);
    alone.stopped(5, place);
    assert_eq!(sights(&alone), [Sight::InView; 2]);
    alone.references(2, 1);
    alone.stopped(6, place);
    assert_eq!(sights(&alone)[2..], [Sight::InView]);
    let told =
        |sent: &support::bus::Sent| sent.to.0 == 2 && matches!(sent.message, Message::Bearing(_));
    assert!(alone.air.sent.iter().any(told));
}

fn standing_target(now: &mut u64, air: &mut Air) -> (Station<TargetRole<'static>>, StopNumber) {
    standing(target_config(0), now, air)
}

fn standing(
    config: TargetConfig,
    now: &mut u64,
    air: &mut Air,
) -> (Station<TargetRole<'static>>, StopNumber) {
    let mut target = Station::<TargetRole<'_>>::new(
        TARGET,
        move || target_role(TARGET, config, 7),
        Box::new(|_, _| None),
    );
    target.attach(*now);
    let stop = stand(&mut target, now, air);
    (target, stop)
}

fn stand(target: &mut Station<TargetRole<'static>>, now: &mut u64, air: &mut Air) -> StopNumber {
    for _ in 0..3 {
        *now += SECOND;
        target.act(*now, air);
    }
    let mut sent = air.sent.iter().rev();
    let stop = sent.find_map(|sent| match &sent.message {
        Message::Stopped(stopped) => Some(stopped.stop),
        _ => None,
    });
    stop.unwrap()
}

/// The direction of the site's x axis in the frame of the sensor is -0.3.
fn way(from: [f64; 2], to: [f64; 2]) -> Step<f32> {
    let [x, y] = [to[0] - from[0], to[1] - from[1]];
    Step {
        distance: x.hypot(y) as f32,
        heading: y.atan2(x) as f32 - 0.3,
        distance_sigma: 0.005,
        heading_sigma: 0.001,
    }
}

fn pose_of(camera: &Truth) -> PoseParts {
    PoseParts {
        position: [camera.position.x as f32, camera.position.y as f32],
        heading: camera.heading as f32,
        covariance: [1e-6, 0.0, 1e-6, 0.0, 0.0, 1e-6],
    }
}

/// Only the first reference camera solves the place of a target.
#[test]
fn a_place_is_taken_from_the_first_reference_only() {
    let (mut now, mut air) = (0, Air::new(PERFECT, 1));
    let (mut target, stop) = standing_target(&mut now, &mut air);
    let report = |id, duty, state| {
        Message::Report(Report {
            id,
            duty,
            sightings: 3,
            used: 3,
            chi_squared: 1.0,
            done: true,
            joint: None,
            state,
            mount: None,
        })
    };
    let pose = CameraState::Calibrated(pose_of(&CAMERAS[0]));
    target.hear(now, ShortAddress(2), &report(102, Some(Duty::Second), pose));
    target.hear(now, ShortAddress(3), &report(103, None, pose));
    let located = Message::Located(TargetLocation {
        stop,
        position: [1.0, 2.0],
        covariance: [1e-4, 0.0, 1e-4],
        frame_heading: 0.0,
        frame_heading_sigma: 0.01,
    });
    // A node that is not known as a camera, the coordinator, and two with other duties.
    for from in [20, 0, 2, 3] {
        target.hear(now, ShortAddress(from), &located);
        assert!(!target.role.position().1, "{from}");
    }
    let refused = CameraState::Refused(Refusal::Inconsistent);
    for known in [
        Message::Roster([4].into_iter().collect()),
        report(104, None, refused),
        report(104, Some(Duty::First), pose),
    ] {
        let mut target = standing_target(&mut now, &mut air).0;
        let from = if matches!(known, Message::Roster(_)) {
            0
        } else {
            4
        };
        target.hear(now, ShortAddress(from), &known);
        target.hear(now, ShortAddress(4), &located);
        assert!(target.role.position().1, "{known:?}");
    }
}

/// One camera is enough for a target whose size is known, and which knows the direction of its sensor from
/// before its restart: its place follows from bearing and range.
#[test]
fn one_camera_finds_a_target_whose_size_is_known() {
    const RADIUS: f32 = 0.1;
    let camera = &CAMERAS[0];
    for (radius, is_found) in [(0.0, false), (RADIUS, true)] {
        let (mut now, mut air) = (0, Air::new(PERFECT, 1));
        let mut config = target_config(0);
        config.ball_radius = radius;
        let (mut target, stop) = standing(config, &mut now, &mut air);
        let track = Track::start(Point2::origin(), Matrix2::zeros(), Systematic::default());
        target.role.restore(&Fact::Walk(Walk {
            stop,
            standing: false,
            place: track.unwrap().place(0.02).unwrap(),
            located: true,
            frame_heading: Some(0.3),
            frame_heading_sigma: 0.01,
            scale: 1.0,
        }));
        let mut stop = stand(&mut target, &mut now, &mut air);
        // The second stop confirms the answer that nothing checks at the first.
        for (n, place) in STOPS[..2].iter().enumerate() {
            assert!(!target.role.position().1);
            if n > 0 {
                let step = way(STOPS[0], STOPS[1]);
                target.event(now, moving_target::TargetEvent::Step(step));
                stop = stand(&mut target, &mut now, &mut air);
            }
            let range = (Point2::from(*place) - camera.position).norm();
            let bearing = StopBearing {
                target: TARGET,
                stop,
                seen: sees(camera, *place).wide((f64::from(RADIUS) / range).asin() as f32),
                pose: Some(pose_of(camera)),
            };
            target.hear(now, ShortAddress(1), &Message::Bearing(bearing));
            now += SECOND;
            target.act(now, &mut air);
        }
        let (position, is_located) = target.role.position();
        assert_eq!(is_located, is_found, "{radius}");
        let off = (position.cast() - Point2::from(STOPS[1])).norm();
        assert!(!is_located || off < 0.05, "{off}");
    }
}

/// The direction of a sensor follows from two places, and is as uncertain as both. Nothing checks two
/// bearings at a stop, so it counts when the third place agrees.
#[test]
fn a_direction_from_a_poor_place_is_none() {
    let poor = 0.05;
    let good = BEARING_SIGMA as f32;
    for (sigmas, is_found) in [
        ([good, good, good], true),
        ([poor, good, good], false),
        ([good, poor, good], false),
    ] {
        let (mut now, mut air) = (0, Air::new(PERFECT, 1));
        let (mut target, mut stop) = standing_target(&mut now, &mut air);
        for (n, sigma) in sigmas.into_iter().enumerate() {
            assert!(!target.role.position().1, "{sigmas:?} at stop {n}");
            if n > 0 {
                let step = way(STOPS[n - 1], STOPS[n]);
                target.event(now, moving_target::TargetEvent::Step(step));
                stop = stand(&mut target, &mut now, &mut air);
            }
            for (from, camera) in (1..).zip(&CAMERAS[..2]) {
                let bearing = StopBearing {
                    target: TARGET,
                    stop,
                    seen: Seen {
                        sigma,
                        ..sees(camera, STOPS[n])
                    },
                    pose: Some(pose_of(camera)),
                };
                target.hear(now, ShortAddress(from), &Message::Bearing(bearing));
            }
            now += SECOND;
            target.act(now, &mut air);
        }
        assert_eq!(target.role.position().1, is_found, "{sigmas:?}");
    }
}
