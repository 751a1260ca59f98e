use std::vec::Vec;

use calib_core::dead_reckoning::{Place, Systematic, Track};
use nalgebra::{Matrix2, Point2};

use super::{reference::ReferenceStops, *};
use crate::role::is_news;
use crate::{
    config::{LensSigma, Sigmas, Subjects},
    limits::SIGHTINGS,
    message::{
        CONFIRMED, CameraState, Confirmation, CoordinateFrame, ProtectionLevel, References,
        StopAnswer, Stopped, TrackedBlob,
    },
    network::NetworkIdentity,
    vision::Lens,
};

const TARGET: ShortAddress = ShortAddress(9);
const REFERENCES: References = References {
    first: 1,
    second: 2,
    positions: None,
};
const SEEN: Seen = Seen::direction(0.1, 0.01);

const fn at(seconds: u64) -> Instant {
    Instant(seconds * 1_000_000)
}

fn membership(pan: u16, short: u16) -> Attachment {
    Attachment {
        network: NetworkIdentity {
            number: pan,
            founder: [2; 8],
        },
        own: short,
    }
}

fn config() -> CameraConfig {
    CameraConfig {
        lens_sigma: LensSigma::EXACT,
        kind: crate::vision::CameraKind::Cmucam2,
        lens: Lens::pin_hole(88, 60.0),
        baud: 38_400,
        first_column: 1,
        subjects: Subjects::Motion { threshold: 10 },
        round: true,
        reference: None,
        may_be_elected: true,
        baseline: Some(10.0),
        frame_heading_deg: None,
        reference_stops: 3,
        stops: 3,
        refine: false,
        good_enough: Sigmas {
            position: 0.05,
            heading_deg: 0.3,
        },
        weak: Sigmas {
            position: 0.5,
            heading_deg: 10.0,
        },
        sigma_floor_px: 0.0625,
    }
}

/// A camera that has started, and said so in its network.
fn camera(address: u16) -> CameraRole {
    camera_with(address, config())
}

fn camera_with(address: u16, config: CameraConfig) -> CameraRole {
    let mut camera = CameraRole::new(100 + address, config);
    let hello = start(&mut camera, address);
    assert!(matches!(
        hello[..],
        [
            Output::Save(Fact::Network(_)),
            Output::Send {
                to: COORDINATOR,
                message: Message::Hello(_),
                notification: Some(CameraNotification::Hello)
            }
        ]
    ));
    camera
}

/// Its outputs when it has started and joined. All that it sends then is delivered.
fn start(camera: &mut CameraRole, address: u16) -> Vec<Output<CameraNotification, CameraTask>> {
    camera.on_event(at(0), CameraEvent::Ready);
    camera.on_attached(at(0), Some(membership(7, address)));
    let outputs = outputs(camera, 0);
    deliver(camera, 0, &outputs, true);
    outputs
}

/// Reports the delivery of all that it sent.
fn deliver(
    camera: &mut CameraRole,
    now: u64,
    outputs: &[Output<CameraNotification, CameraTask>],
    delivered: bool,
) {
    for output in outputs {
        if let Output::Send {
            notification: Some(notification),
            ..
        } = output
        {
            camera.on_sent(at(now), *notification, delivered);
        }
    }
}

/// All that it wants now.
fn outputs(camera: &mut CameraRole, now: u64) -> Vec<Output<CameraNotification, CameraTask>> {
    camera.compute(at(now));
    core::iter::from_fn(|| camera.poll(at(now))).collect()
}

/// Messages that it sends, and their receivers.
fn sent(camera: &mut CameraRole, now: u64) -> Vec<(ShortAddress, Message)> {
    let outputs = outputs(camera, now).into_iter();
    outputs
        .filter_map(|output| match output {
            Output::Send { to, message, .. } => Some((to, message)),
            _ => None,
        })
        .collect()
}

fn place(x: f32) -> Place<f32> {
    place_at([x, 4.0])
}

fn place_at([x, y]: [f32; 2]) -> Place<f32> {
    let systematic = Systematic {
        heading_sigma: 0.0,
        scale_sigma: 0.0,
    };
    let covariance = Matrix2::identity() * 1e-4;
    let track = Track::start(Point2::new(x, y), covariance, systematic);
    track.unwrap().place(0.0).unwrap()
}

/// The target heard that this camera, and others, saw it there.
fn confirm(camera: &mut CameraRole, now: u64, stop: StopNumber) {
    let seen_by = (1..=CONFIRMED as u16).collect();
    let confirmation = Message::Confirmed(Confirmation { stop, seen_by });
    camera.on_message(at(now), TARGET, &confirmation);
}

/// A target stands where it does not know, and the camera sees it.
fn show(camera: &mut CameraRole, now: u64, stop: StopNumber) -> Vec<(ShortAddress, Message)> {
    let stopped = Stopped {
        stop,
        colour: 0,
        frame: CoordinateFrame::Own,
        place: place(f32::from(stop)),
    };
    camera.on_message(at(now), TARGET, &Message::Stopped(stopped));
    let look = outputs(camera, now);
    assert!(
        matches!(
            look.last(),
            Some(Output::Task(CameraTask::Look { colour: 0 }))
        ),
        "{look:?}"
    );
    let seen = Seen {
        bearing: SEEN.bearing + f32::from(stop) * 0.01,
        ..SEEN
    };
    camera.on_event(at(now), CameraEvent::Looked(Sight::InView, Some(seen)));
    confirm(camera, now, stop);
    sent(camera, now + 1)
}

fn bearings(sent: &[(ShortAddress, Message)]) -> Vec<(u16, StopNumber)> {
    let of = |(to, message): &(ShortAddress, Message)| match message {
        Message::Bearing(bearing) => Some((to.0, bearing.stop)),
        _ => None,
    };
    sent.iter().filter_map(of).collect()
}

#[test]
fn the_second_reference_tells_the_first_what_it_saw_until_it_is_delivered() {
    let mut camera = camera(2);
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    let saved = Output::Save(Fact::References(Some(REFERENCES)));
    assert_eq!(outputs(&mut camera, 1), [saved]);
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    assert_eq!(outputs(&mut camera, 1), []);
    let bearing = |stop| CameraNotification::Bearing(TARGET.0, stop);
    assert_eq!(bearings(&show(&mut camera, 10, 5)), [(1, 5)]);
    camera.on_sent(at(11), bearing(5), false);
    assert_eq!(camera.next_deadline(), Some(at(13)));
    assert_eq!(bearings(&sent(&mut camera, 13)), [(1, 5)]);
    assert_eq!(bearings(&show(&mut camera, 20, 6)), [(1, 6)]);
    camera.on_sent(at(21), bearing(5), true);
    camera.on_sent(at(21), bearing(6), true);
    assert_eq!(camera.next_deadline(), None);
    assert_eq!(bearings(&show(&mut camera, 30, 7)), [(1, 7)]);
    camera.on_sent(at(31), bearing(7), true);
    // The deliveries of a former run are not known: all of them again.
    camera.on_attached(at(40), None);
    assert_eq!(camera.next_deadline(), None);
    camera.on_attached(at(41), Some(membership(7, 2)));
    assert_eq!(bearings(&sent(&mut camera, 41)), [(1, 5), (1, 6), (1, 7)]);
    // Other references: this camera tells its sightings to none.
    let others = References {
        second: 3,
        ..REFERENCES
    };
    camera.on_message(at(42), COORDINATOR, &Message::References(others));
    for stop in 5..8 {
        camera.on_sent(at(43), bearing(stop), false);
    }
    assert_eq!(bearings(&sent(&mut camera, 60)), []);
}

#[test]
fn whoever_is_no_reference_tells_the_coordinator_what_it_saw() {
    let mut camera = camera(4);
    let trigger = Message::Trigger { target: 9, stop: 5 };
    let told = show(&mut camera, 10, 5);
    assert!(matches!(told[..1], [(TARGET, Message::Look(_))]));
    assert_eq!(told[1..], [(COORDINATOR, trigger)]);
    // With references only the target is told.
    camera.on_message(at(20), COORDINATOR, &Message::References(REFERENCES));
    let stopped = Stopped {
        stop: 6,
        colour: 0,
        frame: CoordinateFrame::Own,
        place: place(1.0),
    };
    camera.on_message(at(21), TARGET, &Message::Stopped(stopped));
    let _ = outputs(&mut camera, 21);
    camera.on_event(at(21), CameraEvent::Looked(Sight::InView, Some(SEEN)));
    confirm(&mut camera, 21, 6);
    let told = sent(&mut camera, 22);
    assert!(
        matches!(&told[..], [(TARGET, Message::Look(look))] if look.seen == Some(SEEN)),
        "{told:?}"
    );
    // It becomes one while the target stands there: its sightings count from this stop on.
    let others = References {
        second: 4,
        ..REFERENCES
    };
    camera.on_message(at(23), COORDINATOR, &Message::References(others));
    assert_eq!(bearings(&sent(&mut camera, 23)), [(1, 5), (1, 6)]);
}

/// Some may be in the flash alone: facts written before the present run were restored from it.
#[test]
fn what_is_forgotten_is_erased_wherever_it_may_be() {
    let mut camera = camera(2);
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    show(&mut camera, 10, 5);
    camera.on_message(
        at(20),
        COORDINATOR,
        &Message::Command(CameraCommand::Forget),
    );
    let outputs = outputs(&mut camera, 20);
    let saved = outputs.iter().filter_map(|output| match output {
        Output::Save(fact) => Some(*fact),
        _ => None,
    });
    let sightings = (0..SIGHTINGS as u8).map(|index| Fact::Sighting(index, None));
    let stops = (0..REFERENCE_STOPS as u8).map(|index| Fact::ReferenceStop(index, None));
    let expected = sightings.chain(stops).chain([Fact::Posed(None)]);
    assert!(saved.eq(expected), "{outputs:?}");
    // The bearing is not told any more, and the coordinator knows that it is done.
    let done = Message::Done(CommandResult {
        command: CameraCommand::Forget,
        outcome: CommandOutcome::Done,
    });
    assert!(matches!(
        outputs.last(),
        Some(Output::Send { to: COORDINATOR, message, notification: None }) if *message == done
    ));
    assert_eq!(camera.next_deadline(), None);
}

#[test]
fn what_the_hardware_tells_goes_to_the_coordinator() {
    let mut camera = camera(2);
    let tracked = Tracked {
        blob: TrackedBlob {
            middle: [40, 70],
            edges: [30, 60, 50, 80],
            pixels: 90,
            confidence: 120,
        },
        ..Tracked::default()
    };
    camera.on_event(at(1), CameraEvent::Tracked(tracked));
    let done = CommandResult {
        command: CameraCommand::Initialise,
        outcome: CommandOutcome::Done,
    };
    camera.on_event(at(1), CameraEvent::Done(done));
    assert_eq!(
        sent(&mut camera, 1),
        [
            (COORDINATOR, Message::Done(done)),
            (COORDINATOR, Message::Tracked(tracked))
        ]
    );
}

#[test]
fn a_stop_told_late_is_none_when_others_need_the_room() {
    let mut stops = ReferenceStops::new();
    let mut own = |stop| stops.own(9, stop, place(1.0), SEEN);
    for stop in 0..REFERENCE_STOPS - 1 {
        assert_eq!(own(100 + stop as u16), Some(stop));
    }
    // There is room.
    assert_eq!(own(90), Some(REFERENCE_STOPS - 1));
    assert_eq!(own(89), None);
    // From a target that began anew, and a new one.
    assert_eq!(own(25), Some(0));
    assert_eq!(own(200), Some(1));
    assert_eq!(stops.len(), REFERENCE_STOPS);
}

#[test]
fn others_hear_of_what_changes_their_picture_of_a_camera() {
    let pose = PoseParts {
        position: [1.0, 2.0],
        heading: 0.5,
        covariance: [0.01, 0.0, 0.01, 0.0, 0.0, 0.001],
    };
    let old = Report {
        id: 7,
        duty: None,
        sightings: 3,
        used: 3,
        chi_squared: 1.0,
        done: false,
        joint: None,
        state: CameraState::Calibrated(pose),
        mount: None,
    };
    let with = |change: fn(&mut PoseParts)| {
        let mut pose = pose;
        change(&mut pose);
        Report {
            state: CameraState::Calibrated(pose),
            ..old
        }
    };
    let news = [
        Report { done: true, ..old },
        Report {
            duty: Some(Duty::Second),
            ..old
        },
        Report {
            state: CameraState::Weak(pose),
            ..old
        },
        Report {
            state: CameraState::Waiting,
            ..old
        },
        with(|pose| pose.covariance[0] = 0.006),
        with(|pose| pose.covariance[2] = 0.006),
        with(|pose| pose.covariance[5] = 0.0008),
        with(|pose| pose.position[0] += 0.046),
        with(|pose| pose.position[1] -= 0.046),
        // A reference keeps its place: its heading alone may change.
        with(|pose| pose.heading -= 0.011),
        with(|pose| pose.covariance[0] = 0.1),
        with(|pose| pose.covariance[5] = 0.0013),
    ];
    for (n, new) in news.iter().enumerate() {
        assert!(is_news(&old, new), "{n}");
    }
    let waiting = Report {
        state: CameraState::Waiting,
        ..old
    };
    assert!(is_news(&waiting, &old) && !is_news(&waiting, &waiting));
    assert!(is_news(
        &waiting,
        &Report {
            done: true,
            ..waiting
        }
    ));
    let checked_to = |position, heading| Report {
        joint: Some(ProtectionLevel { position, heading }),
        ..old
    };
    for (level, news) in [(0.91, false), (1.09, false), (0.89, true), (1.12, true)] {
        for other in [checked_to(level, 0.1), checked_to(1.0, 0.1 * level)] {
            let one = checked_to(1.0, 0.1);
            assert_eq!(is_news(&one, &other), news, "{level}");
            assert_eq!(is_news(&other, &one), news, "{level}");
        }
    }
    let checked = checked_to(1.0, 0.1);
    assert!(is_news(&old, &checked) && is_news(&checked, &old));
    let no_news = [
        old,
        Report {
            sightings: 4,
            used: 4,
            ..old
        },
        with(|pose| pose.covariance[0] = 0.0065),
        with(|pose| pose.covariance[0] = 0.0115),
        with(|pose| pose.covariance[5] = 0.00082),
        with(|pose| pose.position[0] += 0.044),
        with(|pose| pose.heading += 0.009),
    ];
    for (n, new) in no_news.iter().enumerate() {
        assert!(!is_news(&old, new), "{n}");
    }
}

/// Places where a target stands, in view of cameras at (0, 0) and (10, 0) that look at (5, 5).
const STOPS: [[f32; 2]; 4] = [[5.0, 5.0], [3.6, 7.5], [6.4, 7.0], [4.5, 4.6]];

fn seen_from(x: f32, heading_deg: f32, [to_x, to_y]: [f32; 2]) -> Seen {
    Seen::direction(to_y.atan2(to_x - x) - heading_deg.to_radians(), 0.001)
}

fn stopped(stop: StopNumber, frame: CoordinateFrame) -> Stopped {
    Stopped {
        stop,
        colour: 0,
        frame,
        place: place_at(STOPS[usize::from(stop) % STOPS.len()]),
    }
}

/// A target stands, and the camera, at (0, 0), sees it.
fn see(camera: &mut CameraRole, now: u64, stopped: &Stopped) {
    camera.on_message(at(now), TARGET, &Message::Stopped(*stopped));
    let look = Output::Task(CameraTask::Look { colour: 0 });
    assert_eq!(outputs(camera, now).last(), Some(&look));
    let seen = seen_from(0.0, 45.0, stopped.place.position().into());
    camera.on_event(at(now), CameraEvent::Looked(Sight::InView, Some(seen)));
    confirm(camera, now, stopped.stop);
}

/// The first reference, which has just solved, and its outputs then.
fn solved() -> (CameraRole, Vec<Output<CameraNotification, CameraTask>>) {
    let mut camera = camera(1);
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    let mut last = Vec::new();
    for stop in 1..=3 {
        let stopped = stopped(stop, CoordinateFrame::Own);
        see(&mut camera, 10, &stopped);
        let bearing = StopBearing {
            target: TARGET.0,
            stop,
            seen: seen_from(10.0, 135.0, stopped.place.position().into()),
            pose: None,
        };
        camera.on_message(at(10), ShortAddress(2), &Message::Bearing(bearing));
        last = outputs(&mut camera, 11);
    }
    assert!(camera.report().pose().is_some(), "{:?}", camera.report());
    (camera, last)
}

/// A camera that has calibrated itself, and told so.
fn calibrated(address: u16) -> CameraRole {
    let mut camera = camera(address);
    for stop in 1..=3 {
        see(&mut camera, 10, &stopped(stop, CoordinateFrame::Site));
        let outputs = outputs(&mut camera, 11);
        deliver(&mut camera, 11, &outputs, true);
    }
    assert!(camera.report().done, "{:?}", camera.report());
    camera
}

fn is_sent(outputs: &[Output<CameraNotification, CameraTask>], wanted: CameraNotification) -> bool {
    outputs.iter().any(|output| {
        matches!(output, Output::Send { notification: Some(notification), .. } if *notification == wanted)
    })
}

#[test]
fn the_first_reference_tells_what_it_solved_as_long_as_it_is_the_first() {
    use CameraNotification::{Located, Posed};
    for (others, is_located) in [((1, 3), true), ((3, 1), false), ((3, 2), false)] {
        let (mut camera, told) = solved();
        assert!(is_sent(&told, Located) && is_sent(&told, Posed));
        for told in [Located, Posed] {
            camera.on_sent(at(12), told, false);
        }
        for report in [COORDINATOR, TARGET] {
            camera.on_sent(at(12), CameraNotification::Report(report.0), true);
        }
        let references = References {
            first: others.0,
            second: others.1,
            positions: None,
        };
        camera.on_message(at(13), COORDINATOR, &Message::References(references));
        // The pose was that of the former second one.
        let changed = outputs(&mut camera, 13);
        assert!(
            changed.contains(&Output::Save(Fact::Posed(None))),
            "{changed:?}"
        );
        let due = is_located.then_some(at(14));
        assert_eq!(camera.next_deadline(), due, "{others:?}");
        let told = sent(&mut camera, 60);
        assert_eq!(told.len(), usize::from(is_located), "{told:?}");
        assert!(
            told.iter()
                .all(|(to, message)| *to == TARGET && matches!(message, Message::Located(_)))
        );
    }
}

#[test]
fn what_was_solved_is_not_told_after_it_is_forgotten() {
    use CameraNotification::{Located, Posed};
    let (mut camera, told) = solved();
    assert!(is_sent(&told, Located) && is_sent(&told, Posed));
    let forget = Message::Command(CameraCommand::Forget);
    camera.on_message(at(12), COORDINATOR, &forget);
    let reports = outputs(&mut camera, 12);
    assert!(!is_sent(&reports, Located) && !is_sent(&reports, Posed));
    // Not even if the messages in flight were lost.
    for told in [Located, Posed] {
        camera.on_sent(at(13), told, false);
    }
    for report in [COORDINATOR, TARGET] {
        // Superseded: told once more.
        camera.on_sent(at(13), CameraNotification::Report(report.0), true);
    }
    let reports = outputs(&mut camera, 14);
    deliver(&mut camera, 14, &reports, true);
    assert!(!is_sent(&reports, Located) && !is_sent(&reports, Posed));
    assert_eq!(camera.next_deadline(), None);
    assert_eq!(sent(&mut camera, 60), []);
}

#[test]
fn a_bearing_in_flight_is_not_repeated_after_it_is_forgotten() {
    let mut camera = camera(2);
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    assert_eq!(bearings(&show(&mut camera, 10, 5)), [(1, 5)]);
    let forget = Message::Command(CameraCommand::Forget);
    camera.on_message(at(12), COORDINATOR, &forget);
    let _ = outputs(&mut camera, 12);
    camera.on_sent(at(13), CameraNotification::Bearing(TARGET.0, 5), false);
    assert_eq!(camera.next_deadline(), None);
}

/// Its sighting there is forgotten, too, and with it the answer.
#[test]
fn a_camera_that_forgot_looks_again_at_a_stop_that_it_had_seen() {
    let mut camera = camera(2);
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    show(&mut camera, 10, 5);
    let forget = Message::Command(CameraCommand::Forget);
    camera.on_message(at(12), COORDINATOR, &forget);
    let _ = outputs(&mut camera, 12);
    // Asserts that it looks.
    assert_eq!(bearings(&show(&mut camera, 13, 5)), [(1, 5)]);
}

#[test]
fn what_waited_for_members_of_one_network_is_not_told_in_another() {
    let mut camera = calibrated(4);
    let tracked = Tracked {
        blob: TrackedBlob {
            middle: [40, 70],
            edges: [30, 60, 50, 80],
            pixels: 90,
            confidence: 120,
        },
        ..Tracked::default()
    };
    camera.on_message(at(20), COORDINATOR, &Message::Sightings);
    camera.on_event(at(20), CameraEvent::Tracked(tracked));
    camera.on_attached(at(21), None);
    assert_eq!(sent(&mut camera, 21), []);
    camera.on_attached(at(22), Some(membership(8, 5)));
    let told = sent(&mut camera, 23);
    assert!(
        matches!(
            told[..],
            [
                (COORDINATOR, Message::Hello(_)),
                (COORDINATOR, Message::Report(_))
            ]
        ),
        "{told:?}"
    );
    assert!(camera.report().done);
}

#[test]
fn what_was_solved_for_a_member_of_a_former_network_is_erased() {
    let (mut camera, told) = solved();
    deliver(&mut camera, 12, &told, true);
    camera.on_attached(at(21), None);
    camera.on_attached(at(22), Some(membership(8, 5)));
    let outputs = outputs(&mut camera, 23);
    for erased in [Fact::Posed(None), Fact::References(None)] {
        assert!(outputs.contains(&Output::Save(erased)), "{outputs:?}");
    }
    assert!(camera.report().done);
}

#[test]
fn what_a_reference_saw_is_written_down_before_it_is_told() {
    let mut camera = camera(2);
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    let stopped = stopped(1, CoordinateFrame::Own);
    let _ = outputs(&mut camera, 1);
    see(&mut camera, 10, &stopped);
    let outputs = outputs(&mut camera, 11);
    assert!(
        matches!(
            outputs[0],
            Output::Save(Fact::ReferenceStop(0, Some(kept)))
                if (kept.target, kept.stop) == (TARGET.0, 1)
                    && kept.own == Some(seen_from(0.0, 45.0, STOPS[1]))
                    && kept.other.is_none()
        ),
        "{outputs:?}"
    );
}

/// The other references are not known yet; and to the target every bearing is of use.
#[test]
fn everybody_looks_at_targets_that_do_not_know_their_place() {
    let config = |duty: Option<Duty>| CameraConfig {
        may_be_elected: false,
        reference: duty.map(|duty| crate::message::Reference {
            duty,
            position: None,
        }),
        ..config()
    };
    for duty in [Some(Duty::First), Some(Duty::Second), None] {
        let mut camera = camera_with(4, config(duty));
        let stopped = stopped(1, CoordinateFrame::Own);
        camera.on_message(at(1), TARGET, &Message::Stopped(stopped));
        let look = Output::Task(CameraTask::Look { colour: 0 });
        assert!(outputs(&mut camera, 1).contains(&look), "{duty:?}");
    }
}

#[test]
fn there_is_room_for_a_target_of_which_no_stop_is_known() {
    let mut camera = camera(2);
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    for stop in 100..100 + REFERENCE_STOPS as u16 {
        show(&mut camera, 10, stop);
        camera.on_sent(at(11), CameraNotification::Bearing(TARGET.0, stop), true);
    }
    let stopped = stopped(50, CoordinateFrame::Own);
    camera.on_message(at(20), ShortAddress(8), &Message::Stopped(stopped));
    let _ = outputs(&mut camera, 20);
    camera.on_event(at(20), CameraEvent::Looked(Sight::InView, Some(SEEN)));
    let confirmation = Confirmation {
        stop: 50,
        seen_by: [2].into_iter().collect(),
    };
    camera.on_message(at(20), ShortAddress(8), &Message::Confirmed(confirmation));
    assert_eq!(bearings(&sent(&mut camera, 21)), [(1, 50)]);
}

#[test]
fn a_stop_told_again_during_the_look_is_looked_at_once() {
    let mut camera = camera(4);
    let look = Output::Task(CameraTask::Look { colour: 0 });
    let tell = |camera: &mut CameraRole, target: u16, stop| {
        let stopped = stopped(stop, CoordinateFrame::Site);
        camera.on_message(at(1), ShortAddress(target), &Message::Stopped(stopped));
    };
    tell(&mut camera, 9, 5);
    assert_eq!(outputs(&mut camera, 1), core::slice::from_ref(&look));
    // Again, and of another target with the same number.
    tell(&mut camera, 9, 5);
    tell(&mut camera, 8, 5);
    assert_eq!(outputs(&mut camera, 1), []);
    let answered = |camera: &mut CameraRole| {
        camera.on_event(at(1), CameraEvent::Looked(Sight::NotInView, None));
        let (looks, sent): (Vec<_>, Vec<_>) = outputs(camera, 2)
            .into_iter()
            .partition(|output| *output == look);
        let to = sent.iter().map(|output| match output {
            Output::Send {
                to,
                message: Message::Look(_),
                ..
            } => to.0,
            other => panic!("{other:?}"),
        });
        (looks.len(), to.collect::<Vec<_>>())
    };
    assert_eq!(answered(&mut camera), (1, [9].to_vec()));
    assert_eq!(answered(&mut camera), (0, [8].to_vec()));
}

/// A look after it heard of a stop, however late: only the target knows whether it stood there then.
#[test]
fn a_look_counts_when_the_target_confirms_it() {
    for frame in [CoordinateFrame::Site, CoordinateFrame::Own] {
        let mut camera = camera(1);
        camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
        let _ = outputs(&mut camera, 1);
        let stopped = stopped(2, frame);
        camera.on_message(at(10), TARGET, &Message::Stopped(stopped));
        let _ = outputs(&mut camera, 10);
        camera.on_event(at(40), CameraEvent::Looked(Sight::InView, Some(SEEN)));
        let before = *camera.report();
        let is_kept = |outputs: &[Output<CameraNotification, CameraTask>]| {
            let is_fact = |output: &Output<_, _>| matches!(output, Output::Save(_));
            outputs.iter().any(is_fact)
        };
        let answers = |outputs: &[Output<CameraNotification, CameraTask>]| {
            let looks = outputs.iter().filter(|output| {
                matches!(output, Output::Send { to: TARGET, message: Message::Look(look), .. }
                    if look.sight == Sight::InView && look.stop == 2)
            });
            looks.count()
        };
        let told = outputs(&mut camera, 41);
        assert_eq!((answers(&told), is_kept(&told)), (1, false));
        // Confirmations of another stop, of another target, of others.
        confirm(&mut camera, 41, 3);
        let other = Confirmation {
            stop: 2,
            seen_by: [1].into_iter().collect(),
        };
        camera.on_message(at(41), ShortAddress(8), &Message::Confirmed(other.clone()));
        assert!(!is_kept(&outputs(&mut camera, 41)));
        let nobody = Confirmation {
            seen_by: heapless::Vec::new(),
            ..other
        };
        camera.on_message(at(42), TARGET, &Message::Confirmed(nobody));
        let mut told = outputs(&mut camera, 42);
        told.extend(outputs(&mut camera, 43));
        assert_eq!(
            (answers(&told), is_kept(&told)),
            (1, false),
            "at once, again"
        );
        // A few times more, and then no more.
        let more: usize = (44..200)
            .map(|now| answers(&outputs(&mut camera, now)))
            .sum();
        assert_eq!(more, 3);
        assert_eq!(*camera.report(), before);
        confirm(&mut camera, 200, 2);
        assert!(is_kept(&outputs(&mut camera, 200)));
        // Once.
        confirm(&mut camera, 201, 2);
        assert!(!is_kept(&outputs(&mut camera, 201)));
    }
}

/// It did not hear of the stop, or looks still.
#[test]
fn a_camera_that_missed_a_stop_asks_for_it() {
    let mut camera = camera(4);
    let told_not_ready = |camera: &mut CameraRole, now| {
        let told = sent(camera, now);
        let [(TARGET, Message::Look(look))] = told[..] else {
            panic!("{told:?}");
        };
        assert_eq!((look.sight, look.stop), (Sight::NotReady, 5));
    };
    let confirm_others = |camera: &mut CameraRole, now, stop| {
        let seen_by = [1].into_iter().collect();
        let confirmation = Message::Confirmed(Confirmation { stop, seen_by });
        camera.on_message(at(now), TARGET, &confirmation);
    };
    confirm_others(&mut camera, 1, 5);
    told_not_ready(&mut camera, 2);
    let stopped = stopped(5, CoordinateFrame::Site);
    camera.on_message(at(3), TARGET, &Message::Stopped(stopped));
    let _ = outputs(&mut camera, 3);
    confirm_others(&mut camera, 4, 5);
    told_not_ready(&mut camera, 5);
    // It does not ask for past stops.
    confirm_others(&mut camera, 6, 4);
    assert_eq!(sent(&mut camera, 7), []);
}

/// Its camera restarts within a look, or seems to. That takes a while, and the target waits. If the camera
/// does not start, no target waits for it.
#[test]
fn a_camera_that_starts_anew_says_so_at_once() {
    let mut camera = camera(4);
    let look = Output::Task(CameraTask::Look { colour: 0 });
    let stopped = Message::Stopped(stopped(5, CoordinateFrame::Site));
    camera.on_message(at(1), TARGET, &stopped);
    assert_eq!(outputs(&mut camera, 1), core::slice::from_ref(&look));
    let learn = Message::Command(CameraCommand::LearnBackground);
    camera.on_message(at(1), COORDINATOR, &learn);
    camera.on_event(at(1), CameraEvent::Starting);
    let told = sent(&mut camera, 2);
    assert!(
        matches!(
            told[..],
            [
                (
                    COORDINATOR,
                    Message::Done(CommandResult {
                        outcome: CommandOutcome::Failed,
                        ..
                    })
                ),
                (
                    TARGET,
                    Message::Look(StopAnswer {
                        sight: Sight::NotReady,
                        ..
                    })
                )
            ] | [
                (
                    TARGET,
                    Message::Look(StopAnswer {
                        sight: Sight::NotReady,
                        ..
                    })
                ),
                (
                    COORDINATOR,
                    Message::Done(CommandResult {
                        outcome: CommandOutcome::Failed,
                        ..
                    })
                )
            ]
        ),
        "{told:?}"
    );
    let mut asked = |event: Option<CameraEvent>, now| {
        if let Some(event) = event {
            camera.on_event(at(now), event);
            // The coordinator hears the state of its camera.
            let eye = match event {
                CameraEvent::Failed => Eye::Failed,
                _ => Eye::Sees,
            };
            assert_eq!(sent(&mut camera, now), [health(eye)]);
            camera.on_sent(at(now), CameraNotification::Health, true);
        }
        camera.on_message(at(now), TARGET, &stopped);
        let mut told = outputs(&mut camera, now);
        told.extend(outputs(&mut camera, now + 1));
        let [output] = &told[..] else {
            panic!("{told:?}");
        };
        match output {
            Output::Send {
                message: Message::Look(look),
                ..
            } => Some(look.sight),
            output => (*output != look).then_some(Sight::NotLooking),
        }
    };
    assert_eq!(asked(None, 3), Some(Sight::NotReady));
    assert_eq!(asked(Some(CameraEvent::Failed), 10), Some(Sight::Failed));
    assert_eq!(asked(Some(CameraEvent::Ready), 20), None);
}

fn health(camera: Eye) -> (ShortAddress, Message) {
    let health = Health {
        camera,
        ..Health::default()
    };
    (COORDINATOR, Message::Health(health))
}

/// The health of a node is told after each hello, and nothing of a healthy one.
#[test]
fn what_is_the_matter_with_it_is_told_again_when_it_is_asked() {
    let told = |camera: &mut CameraRole, now: u64| {
        camera.on_message(
            at(now),
            COORDINATOR,
            &Message::WhoIsThere(heapless::Vec::new()),
        );
        let sent = sent(camera, now + 1).into_iter();
        let told: Vec<Message> = sent.map(|(_, message)| message).collect();
        for notification in [CameraNotification::Hello, CameraNotification::Health] {
            camera.on_sent(at(now + 1), notification, true);
        }
        told
    };
    let mut camera = camera(4);
    assert!(matches!(told(&mut camera, 1)[..], [Message::Hello(_)]));
    camera.on_node(at(3), Memory::Ram, Restart::RadioDeaf);
    let expected = Health {
        memory: Memory::Ram,
        camera: Eye::Sees,
        restart: Restart::RadioDeaf,
        steps: None,
    };
    for now in [4, 6] {
        let told = told(&mut camera, now);
        assert!(
            matches!(told[..], [Message::Hello(_), Message::Health(health)] if health == expected),
            "{told:?}"
        );
    }
}

/// A target does not need to hear at each stop that there is nothing to see.
#[test]
fn a_camera_without_the_target_in_view_says_so_once_or_when_it_is_asked() {
    let mut camera = camera(4);
    let mut answers = |stop: StopNumber, sight, seen| {
        let now = 10 * u64::from(stop);
        let stopped = Message::Stopped(Stopped {
            stop,
            ..stopped(1, CoordinateFrame::Site)
        });
        camera.on_message(at(now), TARGET, &stopped);
        let _ = outputs(&mut camera, now);
        camera.on_event(at(now), CameraEvent::Looked(sight, seen));
        let unasked = sent(&mut camera, now + 1).len();
        confirm(&mut camera, now + 1, stop);
        let _ = outputs(&mut camera, now + 1);
        camera.on_message(at(now + 2), TARGET, &stopped);
        (unasked, sent(&mut camera, now + 3).len())
    };
    assert_eq!(answers(1, Sight::NotInView, None), (1, 1));
    assert_eq!(answers(2, Sight::NotInView, None), (0, 1));
    assert_eq!(answers(3, Sight::Unsteady, None), (1, 1));
    assert_eq!(answers(4, Sight::NotInView, None), (1, 1));
    assert_eq!(answers(5, Sight::NotInView, None), (0, 1));
    assert_eq!(answers(6, Sight::InView, Some(SEEN)).0, 1);
    assert_eq!(answers(7, Sight::NotInView, None), (1, 1));
}

#[test]
fn a_target_that_was_away_hears_the_report_when_it_is_heard_again() {
    let reports = |outputs: &[Output<CameraNotification, CameraTask>]| {
        [8, 9].map(|target| is_sent(outputs, CameraNotification::Report(target)))
    };
    let mut camera = camera(4);
    let hear = |camera: &mut CameraRole, now: u64, target: u16, stop| {
        let stopped = stopped(stop, CoordinateFrame::Site);
        let to_be_told = Message::Stopped(stopped);
        camera.on_message(at(now), ShortAddress(target), &to_be_told);
        outputs(camera, now + 1)
    };
    // Two targets are there when it becomes calibrated.
    hear(&mut camera, 1, 8, 1);
    camera.on_event(at(1), CameraEvent::Looked(Sight::NotInView, None));
    let _ = outputs(&mut camera, 2);
    for stop in 1..=3 {
        see(&mut camera, 10, &stopped(stop, CoordinateFrame::Site));
        if stop < 3 {
            let _ = outputs(&mut camera, 11);
        }
    }
    let told = outputs(&mut camera, 12);
    assert_eq!(reports(&told), [true, true]);
    camera.on_sent(at(13), CameraNotification::Report(COORDINATOR.0), true);
    camera.on_sent(at(13), CameraNotification::Report(8), true);
    camera.on_sent(at(13), CameraNotification::Report(9), false);
    // No absent target is called.
    assert_eq!(camera.next_deadline(), None);
    assert_eq!(reports(&hear(&mut camera, 100, 8, 2)), [false, false]);
    assert_eq!(reports(&hear(&mut camera, 110, 9, 4)), [false, true]);
    camera.on_sent(at(112), CameraNotification::Report(9), true);
    assert_eq!(reports(&hear(&mut camera, 120, 9, 5)), [false, false]);
}

/// It wanted more stops; a restart gives it none.
#[test]
fn a_restart_alone_does_not_end_a_calibration() {
    let done = *calibrated(4).report();
    for is_done in [true, false] {
        let mut camera = CameraRole::new(104, config());
        let report = Report {
            done: is_done,
            ..done
        };
        camera.restore(&Fact::Report(Some(report)));
        assert_eq!(*camera.report(), report);
        let told = start(&mut camera, 4);
        assert!(told.iter().any(|output| matches!(
            output,
            Output::Send { message: Message::Report(told), .. } if *told == report
        )));
    }
}

#[test]
fn the_coordinator_hears_a_report_before_targets_do() {
    let mut camera = CameraRole::new(104, config());
    camera.restore(&Fact::Report(Some(*calibrated(4).report())));
    start(&mut camera, 4);
    let stopped = stopped(4, CoordinateFrame::Site);
    camera.on_message(at(10), TARGET, &Message::Stopped(stopped));
    camera.on_message(
        at(10),
        COORDINATOR,
        &Message::WhoIsThere(heapless::Vec::new()),
    );
    let told = sent(&mut camera, 11);
    let reports = told
        .iter()
        .filter_map(|(to, message)| matches!(message, Message::Report(_)).then_some(*to));
    assert!(reports.eq([COORDINATOR, TARGET]), "{told:?}");
}

/// Members of this network have not heard what those of a former network were told.
#[test]
fn what_is_news_in_a_network_is_what_differs_from_what_was_told_there() {
    let mut camera = camera(2);
    let told = *calibrated(4).report();
    let posed = |camera: &mut CameraRole, now: u64, x: f32| {
        let pose = PoseParts {
            position: [x, 0.0],
            heading: 0.5,
            covariance: [0.01, 0.0, 0.01, 0.0, 0.0, 0.001],
        };
        let solved = Report {
            state: CameraState::Calibrated(pose),
            ..told
        };
        camera.on_message(at(now), ShortAddress(1), &Message::Posed(solved));
        let told = outputs(camera, now);
        deliver(camera, now, &told, true);
        is_sent(&told, CameraNotification::Report(COORDINATOR.0))
    };
    camera.on_message(at(1), COORDINATOR, &Message::References(REFERENCES));
    assert!(posed(&mut camera, 2, 10.0));
    // Too little to be told.
    assert!(!posed(&mut camera, 3, 10.03));
    camera.on_attached(at(4), None);
    camera.on_attached(at(5), Some(membership(8, 5)));
    let hello = outputs(&mut camera, 5);
    deliver(&mut camera, 5, &hello, true);
    assert!(is_sent(&hello, CameraNotification::Report(COORDINATOR.0)));
    let references = References {
        second: 5,
        ..REFERENCES
    };
    camera.on_message(at(6), COORDINATOR, &Message::References(references));
    // Near to the one told first, but that was elsewhere.
    assert!(posed(&mut camera, 7, 9.98));
}

#[test]
fn a_camera_that_begins_anew_in_another_network_tells_what_it_learns_there() {
    let config = CameraConfig {
        refine: true,
        good_enough: Sigmas {
            position: 1e-6,
            heading_deg: 1e-6,
        },
        ..config()
    };
    let mut camera = camera_with(4, config);
    let calibrate = |camera: &mut CameraRole| {
        let told = [1, 2, 3].map(|stop| {
            see(camera, 10, &stopped(stop, CoordinateFrame::Site));
            let told = outputs(camera, 11);
            deliver(camera, 11, &told, true);
            is_sent(&told, CameraNotification::Report(COORDINATOR.0))
        });
        assert!(camera.report().pose().is_some() && !camera.report().done);
        told
    };
    assert_eq!(calibrate(&mut camera), [false, false, true]);
    camera.on_attached(at(12), None);
    camera.on_attached(at(13), Some(membership(8, 5)));
    let hello = outputs(&mut camera, 13);
    deliver(&mut camera, 13, &hello, true);
    assert_eq!(camera.report().state, CameraState::Waiting);
    // The same as before, but no member there has heard it.
    assert_eq!(calibrate(&mut camera), [false, false, true]);
}

/// A target at `(x, y)` says that it stands there; the camera sees it at `bearing`. Returns its answer.
fn seen_at(
    camera: &mut CameraRole,
    stop: StopNumber,
    at_place: [f32; 2],
    bearing: f32,
) -> StopAnswer {
    let stopped = Stopped {
        stop,
        colour: 0,
        frame: CoordinateFrame::Site,
        place: place_at(at_place),
    };
    seen_when(camera, stopped, bearing)
}

fn seen_when(camera: &mut CameraRole, stopped: Stopped, bearing: f32) -> StopAnswer {
    let stop = stopped.stop;
    let now = 100 + 10 * u64::from(stop);
    camera.on_message(at(now), TARGET, &Message::Stopped(stopped));
    let _ = outputs(camera, now);
    let seen = Seen { bearing, ..SEEN };
    camera.on_event(at(now), CameraEvent::Looked(Sight::InView, Some(seen)));
    let told = sent(camera, now + 1);
    confirm(camera, now + 1, stop);
    let _ = outputs(camera, now + 1);
    let look = told.iter().find_map(|(_, message)| match message {
        Message::Look(look) => Some(*look),
        _ => None,
    });
    look.unwrap()
}

/// A picture that does not change though the target moves twice is not believed; one that changes again
/// is. Once may be chance.
#[test]
fn a_camera_that_is_stuck_says_that_it_failed() {
    let mut camera = camera(4);
    for (stop, x, bearing, sight) in [
        (1, 1.0, 0.1, Sight::InView),
        (2, 2.0, 0.1, Sight::InView),
        (3, 3.0, 0.1, Sight::Failed),
        (4, 4.0, 0.2, Sight::InView),
        // The same place.
        (5, 4.0, 0.2, Sight::InView),
    ] {
        let look = seen_at(&mut camera, stop, [x, 1.0], bearing);
        assert_eq!(look.sight, sight, "{stop}");
        assert_eq!(look.seen.is_some(), sight == Sight::InView, "{stop}");
    }
}

/// A target that starts again counts from where it is, and may be where it was.
#[test]
fn who_does_not_know_where_it_is_may_stand_where_it_stood() {
    let mut camera = camera(4);
    let mut look = |stop, frame, fix: u8, x| {
        let systematic = Systematic {
            heading_sigma: 0.0,
            scale_sigma: 0.0,
        };
        let track = Track::start(Point2::new(x, 0.0), Matrix2::identity() * 1e-4, systematic);
        let stopped = Stopped {
            stop,
            colour: 0,
            frame,
            place: track.unwrap().numbered(fix.into()).place(0.0).unwrap(),
        };
        seen_when(&mut camera, stopped, 0.1).sight
    };
    let mut stop = 0;
    for fix in 0..6 {
        // Before and after it was told where that is.
        for (frame, x) in [(CoordinateFrame::Own, 0.0), (CoordinateFrame::Site, 5.0)] {
            stop += 1;
            assert_eq!(look(stop, frame, fix, x), Sight::InView, "{stop}");
        }
    }
    // It walks, and knows that it does.
    let sights = [1.0, 2.0].map(|x| {
        stop += 1;
        look(stop, CoordinateFrame::Site, 6, x)
    });
    assert_eq!(sights, [Sight::InView, Sight::Failed]);
}

/// A camera at the origin that looks along x, as a target solved it.
fn told() -> CameraRole {
    let mut camera = camera(4);
    let _ = seen_at(&mut camera, 1, [4.0, 0.4], 0.1);
    camera.on_message(at(200), TARGET, &Message::Posed(report_of([0.0, 0.0], 0.0)));
    assert_eq!(camera.report().status(), Status::Calibrated);
    camera
}

fn report_of(position: [f32; 2], heading: f32) -> Report {
    let state = CameraState::Weak(PoseParts {
        position,
        heading,
        covariance: [1e-4, 0.0, 1e-4, 0.0, 0.0, 1e-5],
    });
    Report {
        id: 0,
        duty: None,
        sightings: 9,
        used: 9,
        chi_squared: 3.0,
        done: false,
        joint: Some(ProtectionLevel {
            position: 0.1,
            heading: 0.01,
        }),
        state,
        mount: None,
    }
}

/// A target tells a pose until it is acknowledged, and then no more: also a camera that has restarted, and
/// that it has not stood before since, takes it.
#[test]
fn a_pose_is_taken_from_a_target_that_was_not_heard_before() {
    let mut camera = camera(4);
    camera.on_message(at(1), TARGET, &Message::Posed(report_of([1.0, 2.0], 0.5)));
    assert_eq!(camera.report().status(), Status::Calibrated);
    // A reference that solved something for others does not make it known to this one.
    let other = Report {
        joint: None,
        ..report_of([9.0, 2.0], 0.5)
    };
    camera.on_message(at(2), ShortAddress(3), &Message::Posed(other));
    assert_eq!(camera.report().pose().unwrap().position, [1.0, 2.0]);
}

/// A camera that was moved is told to forget its pose. Its target has not seen it elsewhere yet, and tells it
/// the old one again.
#[test]
fn a_camera_that_forgot_takes_no_pose_before_it_has_seen_a_target() {
    let mut camera = told();
    let forget = Message::Command(CameraCommand::Forget);
    let posed = Message::Posed(report_of([0.0, 0.0], 0.0));
    camera.on_message(at(300), COORDINATOR, &forget);
    camera.on_message(at(301), TARGET, &posed);
    assert_eq!(camera.report().state, CameraState::Waiting);
    let _ = seen_at(&mut camera, 31, [4.0, 0.5], 0.125);
    camera.on_message(at(400), TARGET, &posed);
    assert_eq!(camera.report().status(), Status::Calibrated);
}

/// Two bearings that do not fit make it doubtful, one does not, and as many that fit end the doubt.
#[test]
fn a_camera_that_no_longer_fits_is_doubtful_after_two_sightings() {
    let mut camera = told();
    let far = 0.3;
    for (stop, y, bearing, status) in [
        (20, 0.5, 0.125 + far, Status::Calibrated),
        (21, 0.6, 0.15, Status::Calibrated),
        (22, 0.7, 0.175 + far, Status::Calibrated),
        (23, 0.8, 0.2 + far, Status::Doubtful),
        (24, 0.9, 0.225, Status::Doubtful),
        (25, 1.0, 0.25, Status::Calibrated),
    ] {
        let bearing: f32 = bearing;
        let _ = seen_at(&mut camera, stop, [4.0, y], bearing);
        assert_eq!(camera.report().status(), status, "{stop}");
        assert_eq!(camera.report().pose().unwrap().position, [0.0, 0.0]);
    }
}

/// A target that doubts a pose, or is hardly sure of its place, ends no doubt by being seen.
#[test]
fn a_doubt_ends_with_what_tells_something() {
    let far = 0.3;
    let unsure = |stop| {
        let systematic = Systematic {
            heading_sigma: 0.0,
            scale_sigma: 0.0,
        };
        let track = Track::start(Point2::new(4.0, 0.5), Matrix2::identity(), systematic);
        Stopped {
            stop,
            colour: 0,
            frame: CoordinateFrame::Site,
            place: track.unwrap().place(0.0).unwrap(),
        }
    };
    let doubted = |by_target| {
        let mut camera = told();
        for (stop, y, bearing) in [(20, 0.5, 0.125 + far), (21, 0.6, 0.15 + far)] {
            let _ = seen_at(&mut camera, stop, [4.0, y], bearing);
        }
        assert_eq!(camera.report().status(), Status::Doubtful);
        if by_target {
            let mut report = report_of([0.0, 0.0], 0.0);
            report.state = CameraState::Doubtful(*report.pose().unwrap());
            camera.on_message(at(320), TARGET, &Message::Posed(report));
        }
        camera
    };
    for (by_target, is_sure, status) in [
        (false, true, Status::Calibrated),
        (false, false, Status::Doubtful),
        (true, true, Status::Doubtful),
    ] {
        let mut camera = doubted(by_target);
        for (stop, bearing) in [(23, 0.124), (24, 0.125), (25, 0.126), (26, 0.127)] {
            let _ = match is_sure {
                true => seen_at(&mut camera, stop, [4.0, 4.0 * bearing], bearing),
                false => seen_when(&mut camera, unsure(stop), bearing),
            };
        }
        assert_eq!(camera.report().status(), status, "{by_target} {is_sure}");
    }
}

/// The solver may leave out the bearings that do not fit. The camera does not.
#[test]
fn a_pose_that_no_longer_fits_is_not_good_for_being_told_again() {
    let mut camera = told();
    let far = 0.3;
    for (stop, y, bearing) in [(20, 0.5, 0.125 + far), (21, 0.6, 0.15 + far)] {
        let _ = seen_at(&mut camera, stop, [4.0, y], bearing);
    }
    assert_eq!(camera.report().status(), Status::Doubtful);
    camera.on_message(
        at(400),
        TARGET,
        &Message::Posed(report_of([0.001, 0.0], 0.001)),
    );
    assert_eq!(camera.report().status(), Status::Doubtful);
    // One that explains them ends the doubt.
    let moved = report_of([0.0, 0.0], -far);
    camera.on_message(at(410), TARGET, &Message::Posed(moved));
    assert_eq!(camera.report().status(), Status::Calibrated);
}

/// A reference stands where it was told. Turned, it was moved: a pose with another heading at that place
/// explains its sightings, and is not where it stands.
#[test]
fn a_camera_of_a_given_place_that_was_turned_is_doubtful() {
    let given = |heading| {
        let report = report_of([0.0, 0.0], heading);
        let mut pose = *report.pose().unwrap();
        pose.covariance = [0.0, 0.0, 0.0, 0.0, 0.0, 1e-5];
        Report {
            state: CameraState::Weak(pose),
            ..report
        }
    };
    let mut camera = told();
    camera.on_message(at(201), TARGET, &Message::Posed(given(0.0)));
    assert_eq!(camera.report().status(), Status::Calibrated);
    let far = 0.3;
    for (stop, y, bearing) in [(20, 0.5, 0.125 + far), (21, 0.6, 0.15 + far)] {
        let _ = seen_at(&mut camera, stop, [4.0, y], bearing);
    }
    assert_eq!(camera.report().status(), Status::Doubtful);
    camera.on_message(at(400), TARGET, &Message::Posed(given(-far)));
    assert_eq!(camera.report().status(), Status::Doubtful);
    for (stop, y, bearing) in [
        (40, 0.5, 0.12 + far),
        (41, 0.6, 0.15 + far),
        (42, 0.7, 0.17 + far),
    ] {
        let _ = seen_at(&mut camera, stop, [4.0, y], bearing);
        assert_eq!(camera.report().status(), Status::Doubtful);
    }
}

/// The target that solved a pose learns from further stops that its steps err by more than it believed: its newer pose
/// is less certain, and counts. One of another target, or of fewer sightings, does not.
#[test]
fn a_less_certain_pose_counts_where_more_is_known() {
    let wide = |used| {
        let report = report_of([0.03, 0.0], 0.0);
        let mut pose = *report.pose().unwrap();
        pose.covariance = [4e-4, 0.0, 4e-4, 0.0, 0.0, 4e-5];
        Report {
            used,
            state: CameraState::Weak(pose),
            ..report
        }
    };
    for (from, used, x) in [
        (TARGET, 9, 0.03),
        (TARGET, 12, 0.03),
        (TARGET, 8, 0.0),
        (ShortAddress(TARGET.0 + 1), 12, 0.0),
    ] {
        let mut camera = told();
        camera.on_message(at(300), from, &Message::Posed(wide(used)));
        let report = camera.report();
        assert_eq!(report.pose().unwrap().position, [x, 0.0], "{from:?} {used}");
        assert_eq!(report.status(), Status::Calibrated);
    }
}

/// The last sightings before it is noticed that a picture does not change may be wrong. Where such do harm, the pose is
/// weak until the picture changes again.
#[test]
fn a_pose_that_is_not_checked_is_weak_while_the_camera_is_stuck() {
    for (level, stuck) in [(0.1, Status::Calibrated), (9.0, Status::Weak)] {
        let told = |camera: &mut CameraRole, now| {
            let mut report = report_of([0.0, 0.0], 0.0);
            report.joint = Some(ProtectionLevel {
                position: level,
                heading: 0.01,
            });
            camera.on_message(at(now), TARGET, &Message::Posed(report));
        };
        let mut camera = camera(4);
        for (stop, x, bearing, status) in [
            (1, 4.0, 0.1, Status::Calibrated),
            (2, 5.0, 0.1, Status::Calibrated),
            (3, 6.0, 0.1, stuck),
            (4, 7.0, 0.057, Status::Calibrated),
        ] {
            let _ = seen_at(&mut camera, stop, [x, 0.4], bearing);
            if stop == 1 {
                told(&mut camera, 115);
            }
            assert_eq!(camera.report().status(), status, "{stop}");
            if stop == 3 {
                told(&mut camera, 135);
                assert_eq!(camera.report().status(), stuck);
            }
        }
    }
}

/// A pose that contradicts a good one makes it doubtful; only one that is told once more replaces it.
#[test]
fn a_contradiction_replaces_no_good_pose() {
    let mut camera = told();
    let moved = report_of([1.0, 0.0], 0.2);
    camera.on_message(at(300), TARGET, &Message::Posed(moved));
    assert_eq!(camera.report().status(), Status::Doubtful);
    assert_eq!(camera.report().pose().unwrap().position, [0.0, 0.0]);
    let told = sent(&mut camera, 300);
    let doubts = |(to, message): &(ShortAddress, Message)| {
        *to == TARGET
            && matches!(message, Message::Report(report) if report.status() == Status::Doubtful)
    };
    assert!(told.iter().any(doubts), "{told:?}");
    camera.on_message(at(310), TARGET, &Message::Posed(moved));
    assert_eq!(camera.report().status(), Status::Calibrated);
    assert_eq!(camera.report().pose().unwrap().position, [1.0, 0.0]);
}

/// A camera that looks for a colour.
fn colour_camera(address: u16) -> CameraRole {
    let window = ColourWindow {
        red: [170, 240],
        green: [60, 140],
        blue: [16, 80],
    };
    let config = CameraConfig {
        subjects: Subjects::Colours([window].into_iter().collect()),
        ..config()
    };
    camera_with(address, config)
}

/// A target stands, and the camera sees nothing: returns true if it adapts to the light then.
fn miss(camera: &mut CameraRole, now: u64, stopped: &Stopped) -> bool {
    camera.on_message(at(now), TARGET, &Message::Stopped(*stopped));
    let look = Output::Task(CameraTask::Look { colour: 0 });
    assert!(outputs(camera, now).contains(&look));
    camera.on_event(at(now), CameraEvent::Looked(Sight::NotInView, None));
    let adapts = outputs(camera, now).contains(&Output::Task(CameraTask::Adapt));
    if adapts {
        // A target that asks meanwhile hears so, and waits.
        let next = Stopped {
            stop: stopped.stop + 1,
            ..*stopped
        };
        camera.on_message(at(now), TARGET, &Message::Stopped(next));
        let told = sent(camera, now + 1);
        let is_not_ready = |(_, message): &(_, Message)| matches!(message, Message::Look(look) if look.sight == Sight::NotReady);
        assert!(told.iter().any(is_not_ready), "{told:?}");
        camera.on_event(at(now + 1), CameraEvent::Ready);
    }
    adapts
}

const NEVER: [StopNumber; 0] = [];

/// The stops, out of so many, after which a camera that sees nothing adapts.
fn adaptations(
    camera: &mut CameraRole,
    stops: u16,
    stopped: impl Fn(StopNumber) -> Stopped,
) -> Vec<StopNumber> {
    let is_adapting =
        |stop: &StopNumber| miss(camera, 1_000 + 10 * u64::from(*stop), &stopped(*stop));
    (100..100 + stops).filter(is_adapting).collect()
}

#[test]
fn a_camera_that_never_sees_anything_adapts_to_the_light_ever_less_often() {
    let own = |stop| stopped(stop, CoordinateFrame::Own);
    let mut blind = colour_camera(4);
    assert_eq!(adaptations(&mut blind, 100, own), [111, 135, 183]);
    // The background of moving objects would have the target in it.
    let mut camera = camera(4);
    assert_eq!(adaptations(&mut camera, 100, own), NEVER);
}

fn calibrated_colour_camera() -> CameraRole {
    let mut camera = colour_camera(4);
    for stop in 1..=4 {
        see(
            &mut camera,
            10 * u64::from(stop),
            &stopped(stop, CoordinateFrame::Site),
        );
        let _ = outputs(&mut camera, 10 * u64::from(stop) + 1);
    }
    let _ = outputs(&mut camera, 60);
    assert_eq!(camera.report().status(), Status::Calibrated);
    camera
}

#[test]
fn a_camera_that_does_not_see_a_target_in_its_view_adapts_when_it_has_left() {
    let calibrated = calibrated_colour_camera;
    let in_view = |stop| Stopped {
        place: place_at([4.5, 4.6]),
        ..stopped(stop, CoordinateFrame::Site)
    };
    let behind = |stop| Stopped {
        place: place_at([-5.0, -5.0]),
        ..in_view(stop)
    };
    // Nothing is wrong with a camera that does not see a target behind it.
    assert_eq!(adaptations(&mut calibrated(), 60, behind), NEVER);
    let leaves = |stop| {
        if stop < 104 {
            in_view(stop)
        } else {
            behind(stop)
        }
    };
    assert_eq!(adaptations(&mut calibrated(), 60, leaves), [104]);
    // It does not leave.
    assert_eq!(adaptations(&mut calibrated(), 10, in_view), [107]);
    // A new sighting begins the count anew.
    let mut camera = calibrated();
    assert_eq!(adaptations(&mut camera, 3, in_view), NEVER);
    let _ = outputs(&mut camera, 2_040);
    see(&mut camera, 2_050, &in_view(103));
    assert!((104..107).all(|stop| !miss(
        &mut camera,
        3_000 + 10 * u64::from(stop),
        &in_view(stop)
    )));
    assert!(!miss(&mut camera, 5_000, &behind(107)));
}

/// After it adapted, and not before.
#[test]
fn a_camera_that_sees_nothing_where_it_should_says_that_it_is_blind() {
    let in_view = |stop| Stopped {
        place: place_at([4.5, 4.6]),
        ..stopped(stop, CoordinateFrame::Site)
    };
    let mut camera = calibrated_colour_camera();
    let mut blind_since = None;
    for stop in 100..=112 {
        miss(&mut camera, 1_000 + 10 * u64::from(stop), &in_view(stop));
        if camera.health.camera == Eye::Blind {
            blind_since.get_or_insert(stop);
        }
    }
    // It adapts at 107.
    assert_eq!(blind_since, Some(110));
    assert!(camera.notifications.is_pending(CameraNotification::Health));
    see(&mut camera, 4_000, &in_view(113));
    assert_eq!(camera.health.camera, Eye::Sees);
}

/// A refusal is named once it is no accident, until the target is seen whole.
#[test]
fn a_camera_tells_why_it_does_not_believe_its_blobs() {
    for (sight, eye) in [
        (Sight::Hidden, Eye::Hidden),
        (Sight::Several, Eye::Several),
        (Sight::Clipped, Eye::Sees),
        (Sight::Unsteady, Eye::Sees),
    ] {
        let mut camera = calibrated_colour_camera();
        for (stop, sight, seen, told) in [
            (100, sight, None, Eye::Sees),
            (101, sight, None, eye),
            (102, Sight::InView, Some(SEEN), Eye::Sees),
            (103, sight, None, Eye::Sees),
        ] {
            let now = 10 * u64::from(stop);
            let stopped = Message::Stopped(stopped(stop, CoordinateFrame::Site));
            camera.on_message(at(now), TARGET, &stopped);
            let _ = outputs(&mut camera, now);
            camera.on_event(at(now), CameraEvent::Looked(sight, seen));
            let _ = outputs(&mut camera, now + 1);
            assert_eq!(camera.health.camera, told, "{sight:?} at {stop}");
        }
    }
}
