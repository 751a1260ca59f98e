use std::vec::Vec;

use super::{appointment::FIRST_KNOWS, *};
use crate::message::{Duty, Reference, References, StopNumber};
use crate::{limits::MEMBERS, network::NetworkIdentity};

const CAMERA: MemberKind = MemberKind::Camera { reference: None };

const fn at(seconds: u64) -> Instant {
    Instant(seconds * 1_000_000)
}

/// All that it wants now.
fn outputs(
    role: &mut CoordinatorRole,
    now: u64,
) -> Vec<Output<CoordinatorNotification, CoordinatorTask>> {
    core::iter::from_fn(|| role.poll(at(now))).collect()
}

/// Messages that it sends, and their receivers.
fn sent(role: &mut CoordinatorRole, now: u64) -> Vec<(u16, Message)> {
    let outputs = outputs(role, now).into_iter();
    outputs
        .filter_map(|output| match output {
            Output::Send { to, message, .. } => Some((to.0, message)),
            _ => None,
        })
        .collect()
}

/// Messages to the PC.
fn told(role: &mut CoordinatorRole, now: u64) -> Vec<ToPc> {
    let outputs = outputs(role, now).into_iter();
    outputs
        .filter_map(|output| match output {
            Output::Task(CoordinatorTask::Tell(message)) => Some(message),
            _ => None,
        })
        .collect()
}

/// A coordinator that has asked all members who they are.
fn coordinator() -> CoordinatorRole {
    coordinator_with(&[])
}

/// The same after a restart.
fn coordinator_with(written: &[Fact]) -> CoordinatorRole {
    let mut role = CoordinatorRole::new();
    for fact in written {
        role.restore(fact);
    }
    let membership = Attachment {
        network: NetworkIdentity {
            number: 7,
            founder: [2; 8],
        },
        own: 0,
    };
    role.on_attached(at(0), Some(membership));
    for call in [0, 5, 30] {
        let expected = (
            ShortAddress::BROADCAST.0,
            Message::WhoIsThere(heapless::Vec::new()),
        );
        assert_eq!(role.next_deadline(), Some(at(call)));
        assert_eq!(sent(&mut role, call), [expected]);
        // Once for each start, not for each time that it forms its network.
        role.on_attached(at(call), Some(membership));
    }
    // References without a pose have to be there.
    let probe = role.appointment.references().map(|_| at(60));
    assert_eq!(role.next_deadline(), probe);
    role
}

fn hello(role: &mut CoordinatorRole, now: u64, address: u16, kind: MemberKind) {
    let hello = Hello { id: address, kind };
    role.on_message(at(now), ShortAddress(address), &Message::Hello(hello));
}

fn trigger(role: &mut CoordinatorRole, now: u64, camera: u16, stop: StopNumber) {
    let message = Message::Trigger { target: 9, stop };
    role.on_message(at(now), ShortAddress(camera), &message);
}

#[test]
fn targets_alone_hear_of_cameras() {
    let mut role = coordinator();
    hello(&mut role, 40, 9, MemberKind::Target);
    let roster = |cameras: &[u16]| Message::Roster(cameras.iter().copied().collect());
    assert_eq!(sent(&mut role, 40), [(9, roster(&[]))]);
    let notification = CoordinatorNotification::Member(9, MemberNotification::Roster);
    role.on_sent(at(40), notification, true);
    hello(&mut role, 50, 4, CAMERA);
    hello(&mut role, 50, 5, CAMERA);
    assert_eq!(role.next_deadline(), Some(at(50) + ROSTER_AFTER));
    assert_eq!(sent(&mut role, 50), []);
    assert_eq!(sent(&mut role, 51), [(9, roster(&[4, 5]))]);
    role.on_sent(at(51), notification, true);
    // No news.
    hello(&mut role, 60, 4, CAMERA);
    assert_eq!(sent(&mut role, 70), []);
}

/// Parts that a target is told until it knows all cameras. One message in three is lost.
fn all_parts(role: &mut CoordinatorRole, mut now: u64) -> Vec<Vec<u16>> {
    let notification = CoordinatorNotification::Member(9, MemberNotification::Roster);
    let mut parts = Vec::new();
    let mut sends = 0;
    loop {
        match &sent(role, now)[..] {
            [] => return parts,
            [(9, Message::Roster(roster))] => {
                sends += 1;
                let delivered = sends % 3 != 0;
                if delivered {
                    parts.push(roster.to_vec());
                }
                role.on_sent(at(now), notification, delivered);
                now += 60;
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn many_cameras_are_told_in_several_parts() {
    const LAST: u16 = 1000 + MEMBERS as u16 - 2;
    let mut role = coordinator();
    hello(&mut role, 40, 9, MemberKind::Target);
    assert_eq!(all_parts(&mut role, 41), [[0; 0]]);
    for camera in 1000..LAST {
        hello(&mut role, 50, camera, CAMERA);
    }
    let parts = all_parts(&mut role, 60);
    assert!(parts.iter().all(|part| part.len() <= ROSTER));
    assert!(parts.concat().into_iter().eq(1000..LAST));

    // One more while they are told: all again, for it is not known which came before.
    hello(&mut role, 5000, 9, MemberKind::Target);
    assert_eq!(sent(&mut role, 5000).len(), 1);
    hello(&mut role, 5000, LAST, CAMERA);
    let notification = CoordinatorNotification::Member(9, MemberNotification::Roster);
    role.on_sent(at(5000), notification, true);
    assert!(
        all_parts(&mut role, 5001)
            .concat()
            .into_iter()
            .eq(1000..=LAST)
    );
}

#[test]
fn who_never_said_who_it_is_is_asked_once() {
    let mut role = coordinator();
    trigger(&mut role, 40, 4, 1);
    assert_eq!(role.next_deadline(), Some(at(42)));
    assert_eq!(sent(&mut role, 41), []);
    assert_eq!(
        sent(&mut role, 42),
        [(4, Message::WhoIsThere(heapless::Vec::new()))]
    );
    let who = CoordinatorNotification::Member(4, MemberNotification::WhoIsThere);
    role.on_sent(at(42), who, false);
    assert_eq!(role.next_deadline(), None);
    // Heard again, it is asked again; and not if it says so itself.
    trigger(&mut role, 50, 4, 2);
    hello(&mut role, 51, 4, CAMERA);
    assert_eq!(role.next_deadline(), None);
}

#[test]
fn the_first_two_cameras_that_see_a_target_are_the_references() {
    let mut role = coordinator();
    for camera in [4, 5, 6] {
        hello(&mut role, 40, camera, CAMERA);
    }
    trigger(&mut role, 41, 4, 1);
    trigger(&mut role, 41, 4, 1);
    trigger(&mut role, 42, 5, 2);
    assert_eq!(sent(&mut role, 42), []);
    trigger(&mut role, 43, 6, 2);
    trigger(&mut role, 43, 4, 2);
    let references = References {
        first: 5,
        second: 6,
        positions: None,
    };
    let told = |to| Output::Send {
        to: ShortAddress(to),
        message: Message::References(references),
        notification: Some(CoordinatorNotification::Member(
            to,
            MemberNotification::References,
        )),
    };
    let saved = Output::Save(Fact::References(Some(references)));
    let line = ToPc::References(Some(references));
    let line = Output::Task(CoordinatorTask::Tell(line));
    assert_eq!(outputs(&mut role, 43), [saved, line, told(5)]);
    // The second one tells the first its sightings at once.
    assert_eq!(role.next_deadline(), Some(at(43) + FIRST_KNOWS));
    assert_eq!(outputs(&mut role, 44), [told(6)]);
}

#[test]
fn a_camera_that_was_sent_away_is_no_reference() {
    let mut role = coordinator();
    for camera in [4, 5] {
        hello(&mut role, 40, camera, CAMERA);
    }
    trigger(&mut role, 41, 4, 1);
    role.on_event(at(42), CoordinatorEvent::Pc(FromPc::Remove(4)));
    let _ = outputs(&mut role, 42);
    trigger(&mut role, 43, 5, 1);
    assert_eq!(sent(&mut role, 43), []);
    // Once it is one, no other camera is.
    trigger(&mut role, 44, 6, 1);
    assert_eq!([44, 45].map(|now| sent(&mut role, now).len()), [1, 1]);
    role.on_event(at(45), CoordinatorEvent::Pc(FromPc::Remove(5)));
    let outputs = outputs(&mut role, 45);
    assert!(outputs.contains(&Output::Save(Fact::References(None))));
    // The other one is told, or it would wait for ever.
    let late = CoordinatorNotification::Member(6, MemberNotification::References);
    role.on_sent(at(45), late, false);
    let none = (6, Message::References(References::NONE));
    assert_eq!(
        sent(&mut role, 100),
        [(6, Message::WhoIsThere(heapless::Vec::new())), none]
    );
}

/// Two references of three cameras, and a target.
fn with_references(kind: impl Fn(Duty) -> MemberKind) -> CoordinatorRole {
    let mut role = coordinator();
    hello(&mut role, 40, 4, kind(Duty::First));
    hello(&mut role, 40, 5, kind(Duty::Second));
    hello(&mut role, 40, 6, CAMERA);
    hello(&mut role, 40, 9, MemberKind::Target);
    trigger(&mut role, 41, 4, 1);
    trigger(&mut role, 41, 5, 1);
    let appointed = [41, 42].map(|now| sent(&mut role, now)).concat();
    let told = |to| {
        move |(who, what): &(u16, Message)| {
            *who == to && matches!(what, Message::References(references) if references.are_two())
        }
    };
    assert!(appointed.iter().any(told(4)) && appointed.iter().any(told(5)));
    for camera in [4, 5] {
        let notification = CoordinatorNotification::Member(camera, MemberNotification::References);
        role.on_sent(at(41), notification, true);
    }
    let roster = CoordinatorNotification::Member(9, MemberNotification::Roster);
    role.on_sent(at(41), roster, true);
    let _ = outputs(&mut role, 41);
    role
}

/// Messages to the PC about the references while this one does not answer.
fn without(role: &mut CoordinatorRole, absent: u16, mut now: u64) -> Vec<ToPc> {
    let mut lines = Vec::new();
    for _ in 0..4 {
        now = now.max(role.next_deadline().unwrap().0.div_ceil(1_000_000));
        for output in outputs(role, now) {
            match output {
                Output::Send {
                    notification: Some(notification @ CoordinatorNotification::Member(to, _)),
                    ..
                } => role.on_sent(at(now), notification, to != absent),
                Output::Task(CoordinatorTask::Tell(line @ ToPc::Reference { .. })) => {
                    lines.push(line);
                }
                _ => {}
            }
        }
    }
    lines.extend(told(role, now));
    lines
}

/// Until a camera has a pose: the other one and a third camera take over.
#[test]
fn an_elected_reference_that_is_gone_is_replaced() {
    for absent in [4, 5] {
        let other = 9 - absent;
        let mut role = with_references(|_| CAMERA);
        let gone = ToPc::Reference {
            address: absent,
            present: false,
        };
        assert_eq!(without(&mut role, absent, 42), [gone], "{absent}");
        assert_eq!(role.appointment.references(), None);
        trigger(&mut role, 200, 6, 7);
        trigger(&mut role, 200, other, 7);
        let references = role.appointment.references().unwrap();
        assert_eq!((references.first, references.second), (6, other));
        // The one that is back hears that it is none any more.
        let retried = sent(&mut role, 300);
        let told = |to| (to, Message::References(references));
        for camera in [absent, 6, other] {
            assert!(retried.contains(&told(camera)), "{retried:?}");
        }
    }
}

#[test]
fn an_elected_reference_whose_camera_fails_is_replaced() {
    for camera in [Eye::Failed, Eye::Blind] {
        let mut role = with_references(|_| CAMERA);
        let health = Health {
            camera,
            ..Health::default()
        };
        role.on_message(at(50), ShortAddress(6), &Message::Health(health));
        assert!(role.appointment.references().is_some());
        role.on_message(at(50), ShortAddress(5), &Message::Health(health));
        assert_eq!(role.appointment.references(), None);
        let told = sent(&mut role, 50);
        assert!(told.contains(&(4, Message::References(References::NONE))));
    }
}

/// They answer, and share too few of the places where the target stands.
#[test]
fn elected_references_that_find_no_pose_give_way() {
    let configured = |duty| MemberKind::Camera {
        reference: Some(Reference {
            duty,
            position: None,
        }),
    };
    for (mut role, give_way) in [
        (with_references(|_| CAMERA), true),
        (with_references(configured), false),
    ] {
        let _ = without(&mut role, 0, 42);
        assert!(role.appointment.references().is_some());
        // Four questions each, of which the last one is not asked.
        let _ = without(&mut role, 0, 162);
        assert_eq!(role.appointment.references().is_none(), give_way);
        if give_way {
            trigger(&mut role, 400, 6, 7);
            trigger(&mut role, 400, 4, 7);
            let references = role.appointment.references().unwrap();
            assert_eq!((references.first, references.second), (6, 4));
        }
    }
}

/// No camera takes its place: people are told, and told when it is back.
#[test]
fn a_configured_reference_that_is_gone_is_told_to_people() {
    let mut role = with_references(|duty| MemberKind::Camera {
        reference: Some(Reference {
            duty,
            position: None,
        }),
    });
    let reference = |present| ToPc::Reference {
        address: 5,
        present,
    };
    assert_eq!(without(&mut role, 5, 42), [reference(false)]);
    assert!(role.appointment.references().is_some());
    hello(&mut role, 300, 5, CAMERA);
    assert!(told(&mut role, 300).contains(&reference(true)));
}

/// A camera that has a pose does not need them any more.
#[test]
fn with_a_pose_no_one_asks_whether_the_references_are_there() {
    let mut role = with_references(|_| CAMERA);
    role.on_message(at(45), ShortAddress(4), &Message::Report(weak(4)));
    let _ = outputs(&mut role, 45);
    let probe = role.next_deadline().unwrap();
    assert_eq!(probe, at(41) + Duration::from_secs(30));
    assert_eq!(sent(&mut role, 100), []);
    assert_eq!(role.next_deadline(), None);
}

fn weak(id: u16) -> Report {
    let pose = crate::message::PoseParts {
        position: [1.0, 2.0],
        heading: 0.5,
        covariance: [0.01, 0.0, 0.01, 0.0, 0.0, 0.001],
    };
    Report {
        id,
        duty: None,
        sightings: 3,
        used: 3,
        chi_squared: 1.0,
        done: false,
        joint: None,
        state: crate::message::CameraState::Weak(pose),
        mount: None,
    }
}

#[test]
fn a_pc_that_asks_is_told_everything() {
    let mut role = coordinator();
    hello(&mut role, 40, 4, CAMERA);
    hello(&mut role, 40, 9, MemberKind::Target);
    let _ = outputs(&mut role, 40);
    role.on_event(at(41), CoordinatorEvent::Pc(FromPc::Refresh));
    let told = outputs(&mut role, 41);
    assert!(
        matches!(
            told[..],
            [
                Output::Task(CoordinatorTask::TellNetwork),
                Output::Task(CoordinatorTask::TellKeyChange),
                Output::Task(CoordinatorTask::TellConflict),
                Output::Task(CoordinatorTask::Tell(ToPc::Health { address: 0, .. })),
                Output::Task(CoordinatorTask::Tell(ToPc::Member { address: 4, .. })),
                Output::Task(CoordinatorTask::Tell(ToPc::Health { address: 4, .. })),
                Output::Task(CoordinatorTask::Tell(ToPc::Member { address: 9, .. })),
                Output::Task(CoordinatorTask::Tell(ToPc::Health { address: 9, .. })),
            ]
        ),
        "{told:?}"
    );
    let failed = CameraCommand::Forget;
    for (command, delivered) in [(CameraCommand::Initialise, true), (failed, false)] {
        let wish = FromPc::Command {
            address: 4,
            command,
        };
        role.on_event(at(42), CoordinatorEvent::Pc(wish));
        assert_eq!(sent(&mut role, 42), [(4, Message::Command(command))]);
        let notification = CoordinatorNotification::Command(4, command);
        role.on_sent(at(43), notification, delivered);
    }
    let done = CommandResult {
        command: failed,
        outcome: CommandOutcome::Failed,
    };
    assert_eq!(self::told(&mut role, 43), [ToPc::Done { address: 4, done }]);
}

/// A coordinator does not know which cameras it had told before it lost its power.
#[test]
fn references_of_a_former_run_are_told_to_cameras_that_say_hello() {
    let references = References {
        first: 4,
        second: 5,
        positions: None,
    };
    for written in [Some(references), None] {
        let mut role = coordinator_with(&[Fact::References(written)]);
        for camera in [4, 6] {
            hello(&mut role, 40, camera, CAMERA);
        }
        hello(&mut role, 40, 9, MemberKind::Target);
        let told = sent(&mut role, 40).into_iter();
        let told = told.filter(|(_, message)| matches!(message, Message::References(_)));
        let expected = written.map(Message::References).into_iter();
        let expected = expected.flat_map(|message| [4, 6].map(|to| (to, message.clone())));
        assert!(told.eq(expected));
        // And no other camera becomes one.
        trigger(&mut role, 41, 6, 1);
        trigger(&mut role, 41, 7, 1);
        let told = sent(&mut role, 41);
        assert_eq!(told.is_empty(), written.is_some(), "{told:?}");
    }
}

#[test]
fn the_lamp_says_whether_a_camera_is_calibrated() {
    let pose = crate::message::PoseParts {
        position: [1.0, 2.0],
        heading: 0.5,
        covariance: [0.01, 0.0, 0.01, 0.0, 0.0, 0.001],
    };
    use crate::message::CameraState::{Calibrated, Doubtful, Waiting, Weak};
    let mut role = coordinator();
    assert!(!role.indication().calibrated);
    for (address, state) in [
        (4, Waiting),
        (5, Weak(pose)),
        (6, Doubtful(pose)),
        (4, Calibrated(pose)),
    ] {
        let report = Report {
            id: address,
            duty: None,
            sightings: 3,
            used: 3,
            chi_squared: 1.0,
            done: false,
            joint: None,
            state,
            mount: None,
        };
        role.on_message(at(40), ShortAddress(address), &Message::Report(report));
        let expected = matches!(state, Calibrated(_));
        assert_eq!(role.indication().calibrated, expected, "{state:?}");
    }
}

/// A target repeats where it stands; the PC is told news, and everything when it asks.
#[test]
fn the_pc_is_told_a_stop_once() {
    let stopped = |frame, x| {
        let track = calib_core::dead_reckoning::Track::start(
            nalgebra::Point2::new(x, 2.0),
            nalgebra::Matrix2::identity(),
            calib_core::dead_reckoning::Systematic::none(),
        );
        Message::Stopped(Stopped {
            stop: 5,
            colour: 0,
            frame,
            place: track.unwrap().place(0.0).unwrap(),
        })
    };
    let line = |place| ToPc::Stopped {
        address: 9,
        stop: 5,
        place,
    };
    let place = |x| Some(([x, 2.0], [1.0, 0.0, 1.0]));
    let mut role = coordinator();
    hello(&mut role, 40, 9, MemberKind::Target);
    let _ = outputs(&mut role, 40);
    let mut hears = |message: &Message| {
        role.on_message(at(41), ShortAddress(9), message);
        told(&mut role, 41)
    };
    use crate::message::CoordinateFrame::{Own, Site};
    assert_eq!(hears(&stopped(Own, 1.0)), [line(None)]);
    assert_eq!(hears(&stopped(Own, 3.0)), []);
    assert_eq!(hears(&stopped(Site, 1.0)), [line(place(1.0))]);
    assert_eq!(hears(&stopped(Site, 1.0)), []);
    assert_eq!(hears(&stopped(Site, 1.5)), [line(place(1.5))]);
    role.on_pc(at(42), FromPc::Refresh);
    let _ = outputs(&mut role, 42);
    role.on_message(at(43), ShortAddress(9), &stopped(Site, 1.5));
    assert_eq!(told(&mut role, 43), [line(place(1.5))]);
}
