use std::vec::Vec;

use calib_core::dead_reckoning::{Place, Systematic, Track};
use nalgebra::{Matrix2, Point2};
use zigbee_link::{
    radio::Channel,
    wire::{Eui64, PanId},
};

use super::{progress::is_news, reference::ReferenceStops, *};
use crate::{
    config::{Sigmas, Subjects},
    limits::SIGHTINGS,
    message::{CameraState, CoordinateFrame, References, Stopped},
    vision::Lens,
};

const TARGET: ShortAddress = ShortAddress(9);
const REFERENCES: References = References {
    first: 1,
    second: 2,
    positions: None,
};
const SEEN: Seen = Seen {
    bearing: 0.1,
    sigma: 0.01,
};

const fn at(seconds: u64) -> Instant {
    Instant(seconds * 1_000_000)
}

fn membership(pan: u16, short: u16) -> Membership {
    Membership {
        pan: PanId(pan),
        channel: Channel::FIRST,
        short: ShortAddress(short),
        coordinator: Eui64([2; 8]),
    }
}

/// A camera that has started, and said so in its network.
fn camera(address: u16) -> CameraRole {
    let config = CameraConfig {
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
    };
    let mut camera = CameraRole::new(100 + address, config);
    camera.on_event(at(0), CameraEvent::Ready);
    camera.on_attached(at(0), Some(membership(7, address)));
    let hello = outputs(&mut camera, 0);
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
    camera.on_sent(at(0), CameraNotification::Hello, true);
    camera
}

/// All that it wants now.
fn outputs(camera: &mut CameraRole, now: u64) -> Vec<Output<CameraNotification, CameraTask>> {
    camera.compute(at(now));
    core::iter::from_fn(|| camera.poll(at(now))).collect()
}

/// What it sends, and to whom.
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
    let systematic = Systematic {
        heading_sigma: 0.0,
        scale_sigma: 0.0,
    };
    let covariance = Matrix2::identity() * 1e-4;
    let track = Track::start(Point2::new(x, 4.0), covariance, systematic);
    track.unwrap().place(0.0).unwrap()
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
    camera.on_event(at(now), CameraEvent::Looked(Sight::InView, Some(SEEN)));
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
    // Nobody knows what a former run delivered: all of them again.
    camera.on_attached(at(40), None);
    assert_eq!(camera.next_deadline(), None);
    camera.on_attached(at(41), Some(membership(7, 2)));
    assert_eq!(bearings(&sent(&mut camera, 41)), [(1, 5), (1, 6), (1, 7)]);
    // Other references: this camera tells none what it saw.
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
    assert_eq!(told.first(), Some(&(COORDINATOR, trigger)));
    assert!(matches!(told[1..], [(TARGET, Message::Look(_))]));
    // With references, it has no use for such stops.
    camera.on_message(at(20), COORDINATOR, &Message::References(REFERENCES));
    let stopped = Stopped {
        stop: 6,
        colour: 0,
        frame: CoordinateFrame::Own,
        place: place(1.0),
    };
    camera.on_message(at(21), TARGET, &Message::Stopped(stopped));
    let told = sent(&mut camera, 22);
    assert!(
        matches!(&told[..], [(TARGET, Message::Look(look))] if look.sight == Sight::NotLooking),
        "{told:?}"
    );
}

/// Some may be in the flash alone: what was written before the present run was restored from it.
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
        success: true,
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
    let tracked = TrackedBlob {
        middle: [40, 70],
        edges: [30, 60, 50, 80],
        pixels: 90,
        confidence: 120,
    };
    camera.on_event(at(1), CameraEvent::Tracked(tracked));
    let done = CommandResult {
        command: CameraCommand::Initialise,
        success: true,
    };
    camera.on_event(at(1), CameraEvent::Done(done));
    assert_eq!(
        sent(&mut camera, 1),
        [
            (COORDINATOR, Message::Tracked(tracked)),
            (COORDINATOR, Message::Done(done))
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
    // Of a target that began anew, and a new one.
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
        state: CameraState::Calibrated(pose),
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
    let no_news = [
        old,
        Report {
            sightings: 4,
            used: 4,
            ..old
        },
        with(|pose| pose.covariance[0] = 0.0065),
        with(|pose| pose.covariance[0] = 0.1),
        with(|pose| pose.covariance[5] = 0.00082),
        with(|pose| pose.position[0] += 0.044),
    ];
    for (n, new) in no_news.iter().enumerate() {
        assert!(!is_news(&old, new), "{n}");
    }
}
