//! Faults in a network of roles, and their effect on each of them: contradictions, memories with gaps, more
//! news than room, parts that are replaced.

use crate::support;

use std::{cell::RefCell, rc::Rc, time::Duration};

use calib_core::{Refusal, Status, dead_reckoning::Track};
use node_firmware::{
    config::{Sigmas, Subjects},
    console::{FromPc, ToPc},
    facts::Fact,
    hardware::Button,
    limits::SIGHTINGS,
    message::{
        CameraCommand, CameraState, CommandOutcome, CommandResult, Confirmation, CoordinateFrame,
        Duty, Hello, MemberKind, Message, PoseParts, ProtectionLevel, Reference, References,
        Report, Seen, Sight, Stopped,
    },
    role::{
        Role, camera,
        coordinator::{self, CoordinatorRole},
        moving_target::TargetRole,
    },
    vision::ColourWindow,
};
use support::{
    bus::{Air, AnyStation, Faults, PERFECT, Station},
    net::{Net, SECOND, TARGET, error, from_to, refining, same, with_references},
    site::{CAMERAS, STOPS, camera_config, noise, target_config},
    target::target_role,
};
use zigbee_link::wire::ShortAddress;

/// The carrier is pushed aside between two stops, and his sensor misses it; or one reference camera takes
/// something else for the target at one stop. A contradiction is no answer, and says why. Stops after that
/// one decide.
#[test]
fn references_that_contradict_each_other_want_more_stops() {
    for seed in 0..20 {
        for (stop, what) in [(1, "pushed"), (2, "pushed"), (1, "blob"), (2, "blob")] {
            let mut net = Net::new(PERFECT, 100 + seed, with_references);
            net.wait();
            while net.stops < 3 {
                match what {
                    "pushed" if net.stops == stop => net.push([0.8, -0.5]),
                    "blob" => net.show_to(1, (net.stops == stop).then_some([8.2, 4.1])),
                    _ => {}
                }
                net.walk();
            }
            let at = format!("{what} at {stop}, seed {seed}");
            assert!(!net.target.role.indication().calibrated, "{at}");
            let refused = CameraState::Refused(Refusal::Inconsistent);
            assert_eq!(net.reports()[0].state, refused, "{at}");
            net.show_to(1, None);
            while !net.are_all_done() {
                assert!(net.stops < 14, "{at}: {:?}", net.reports());
                net.walk();
            }
            net.check_poses(same, 5.0);
        }
    }
}

/// A lens that is not as configured contradicts itself at every stop. There is an answer in the end, which
/// says how bad it is: neither camera is calibrated.
#[test]
fn references_with_a_wrong_lens_come_to_an_answer() {
    let mut net = Net::new(PERFECT, 14, with_references);
    net.warp(0, 0.12);
    net.walk_to(9);
    assert_eq!(
        net.reports()[0].state,
        CameraState::Refused(Refusal::Inconsistent)
    );
    net.walk_to(10);
    let report = net.reports()[0];
    let pose = report.pose().unwrap();
    let degrees = 20.0 - 5.0;
    assert!(report.chi_squared > 3.0 * degrees, "{report:?}");
    let error = error(pose, &CAMERAS[0]).z.abs();
    let sigma = f64::from(pose.covariance[5]).sqrt();
    assert!(error < 5.0 * sigma, "{error} of {sigma}");
    for camera in &net.cameras[..2] {
        assert_eq!(camera.role.report().status(), Status::Doubtful);
        assert!(!camera.role.indication().calibrated);
        assert_eq!(camera.role.report().chi_squared, report.chi_squared);
    }
}

/// A camera whose sightings are far worse than it takes them for has a pose that they contradict, and
/// says so, whatever its sigmas, to the end.
#[test]
fn a_doubtful_camera_is_none_that_is_calibrated() {
    let config = |n| {
        let mut camera = with_references(n);
        camera.stops = SIGHTINGS as u8;
        camera
    };
    let mut net = Net::new(PERFECT, 16, config);
    while net.reports()[2].sightings < SIGHTINGS as u8 {
        let [x, y] = STOPS[net.stops % STOPS.len()];
        let off = [1, 2].map(|axis| 0.5 * noise(&[net.stops as u64, axis]));
        net.show_to(2, Some([x + off[0], y + off[1]]));
        net.walk();
        let [doubtful, right] = [2, 3].map(|n| net.reports()[n]);
        // Of fewer sightings, most may agree by chance.
        if doubtful.sightings >= 8 {
            assert_eq!(doubtful.status(), Status::Doubtful, "{doubtful:?}");
            assert!(!net.cameras[2].role.indication().calibrated);
        }
        if right.sightings >= 3 {
            assert_eq!(right.status(), Status::Calibrated);
            assert!(net.cameras[3].role.indication().calibrated);
        }
    }
    let report = net.reports()[2];
    assert!(report.done, "it can take no more");
    // The PC is told, and the next start knows it.
    let told = net.told.borrow().iter().rev().find_map(|told| match told {
        ToPc::Report { address: 3, report } => Some(report.status()),
        _ => None,
    });
    assert_eq!(told, Some(Status::Doubtful));
    net.cameras[2].restart(net.now);
    assert_eq!(*net.cameras[2].role.report(), report);
}

/// With four sightings, it cannot be told which one is wrong. The fifth one decides.
#[test]
fn a_wrong_sighting_is_outvoted_in_the_end() {
    let config = |n| {
        let mut camera = with_references(n);
        camera.stops = 4;
        camera
    };
    let mut net = Net::new(PERFECT, 17, config);
    let mut statuses = Vec::new();
    net.wait();
    while !net.are_all_done() {
        let before = net.reports()[2].sightings;
        net.show_to(2, (before == 3).then_some([7.5, 5.0]));
        net.walk();
        let report = net.reports()[2];
        if report.sightings > before {
            statuses.push((report.status(), report.done, report.used));
        }
    }
    let [.., third, fourth, fifth] = statuses[..] else {
        panic!("{statuses:?}")
    };
    assert_eq!(third, (Status::Calibrated, false, 3));
    assert_eq!(fourth, (Status::Doubtful, false, 4));
    assert_eq!(fifth, (Status::Calibrated, true, 4));
    net.check_poses(same, 5.0);
}

/// A camera that was calibrated is told to be more certain than it is.
#[test]
fn what_is_remembered_is_judged_by_the_limits_of_today() {
    let pose = PoseParts {
        position: [1.0, 2.0],
        heading: 1.0,
        covariance: [9e-4, 0.0, 16e-4, 0.0, 0.0, 1e-4],
    };
    let recalled = |state, weak, duty| {
        let mut config = camera_config(None);
        config.weak = weak;
        let mut camera = camera::CameraRole::new(101, config);
        camera.restore(&Fact::Report(Some(Report {
            id: 101,
            duty,
            sightings: 4,
            used: 4,
            chi_squared: 1.0,
            done: true,
            joint: duty.map(|_| ProtectionLevel::NONE),
            state,
            mount: None,
        })));
        (camera.report().status(), camera.report().done)
    };
    // Its sigmas are 0.05 and 0.57 degrees.
    for (position, heading_deg, expected) in [
        (0.051, 0.6, (Status::Calibrated, true)),
        (0.049, 0.6, (Status::Weak, false)),
        (0.051, 0.5, (Status::Weak, false)),
    ] {
        let weak = Sigmas {
            position,
            heading_deg,
        };
        assert_eq!(
            recalled(CameraState::Calibrated(pose), weak, None),
            expected
        );
        let (status, done) = recalled(CameraState::Weak(pose), weak, Some(Duty::First));
        assert_eq!((status, done), (expected.0, true));
        let doubtful = recalled(CameraState::Doubtful(pose), weak, None);
        assert_eq!(doubtful, (Status::Doubtful, false));
    }
}

/// A record in the middle of a camera's facts rots away. The recalled ones take other places, and new ones
/// are written over none of them.
#[test]
fn facts_with_a_gap_survive_restarts() {
    let mut net = Net::new(PERFECT, 15, refining);
    net.walk_to(9);
    let camera = &mut net.cameras[2];
    let before = camera.role.report().sightings;
    assert!(before >= 5);
    camera.lose(&Fact::Sighting(1, None));
    for _ in 0..3 {
        let camera = &mut net.cameras[2];
        camera.restart(net.now);
        camera.event(net.now, camera::CameraEvent::Ready);
        net.walk();
    }
    let now = net.now;
    let camera = &mut net.cameras[2];
    let sightings = camera.role.report().sightings;
    // One is lost, three are new.
    assert_eq!(sightings, before + 2);
    camera.restart(now);
    assert_eq!(camera.recalled_sightings(), usize::from(sightings));
}

/// A camera looks for the colours that it learnt, until its configuration has others.
#[test]
fn learnt_colours_survive_a_restart() {
    let tasks = Rc::new(RefCell::new(Vec::new()));
    let configured = Rc::new(RefCell::new(camera_config(None)));
    let (noted, config) = (tasks.clone(), configured.clone());
    let mut station = Station::<camera::CameraRole>::new(
        1,
        move || camera::CameraRole::new(101, config.borrow().clone()),
        Box::new(move |_, task| {
            noted.borrow_mut().push(task);
            None
        }),
    );
    let mut air = Air::new(PERFECT, 1);
    let learnt = ColourWindow {
        red: [1, 2],
        green: [3, 4],
        blue: [5, 6],
    };
    for _ in 0..5 {
        station.event(0, camera::CameraEvent::Learnt(1, learnt));
        station.act(0, &mut air);
    }
    assert_eq!(station.facts.len(), 1, "written once");
    station.restart(1);
    station.act(1, &mut air);
    station.act(2, &mut air);
    let recall = camera::CameraTask::Recall([None, Some(learnt), None, None]);
    assert_eq!(tasks.take(), [recall]);

    configured.borrow_mut().subjects = Subjects::Colours([learnt].into_iter().collect());
    station.restart(3);
    station.act(3, &mut air);
    assert_eq!(tasks.take(), []);
}

/// The coordinator gets news of all members at once, and has more to write down than it had room for once.
/// After a restart it knows all of it.
#[test]
fn no_news_is_too_much_to_be_written_down() {
    let mut station =
        Station::<CoordinatorRole>::new(0, CoordinatorRole::new, Box::new(|_, _| None));
    let mut target = Station::<TargetRole<'_>>::new(
        TARGET,
        || target_role(TARGET, target_config(0), 7),
        Box::new(|_, _| None),
    );
    let mut air = Air::new(PERFECT, 1);
    target.attach(0);
    for sightings in 1..=2 {
        for camera in 1..=32 {
            let report = Report {
                id: 100 + camera,
                duty: None,
                sightings,
                used: 3,
                chi_squared: 1.0,
                done: false,
                joint: None,
                state: CameraState::Refused(Refusal::DangerCircle),
                mount: None,
            };
            station.hear(0, ShortAddress(camera), &Message::Report(report));
            target.hear(0, ShortAddress(camera), &Message::Report(report));
        }
    }
    station.act(0, &mut air);
    target.act(0, &mut air);
    station.restart(1);
    target.restart(1);
    let reports = station.role.reports().map(|(_, report)| report.sightings);
    assert_eq!(reports.collect::<Vec<_>>(), [2; 32]);
    let table = target.role.cameras();
    let reports = table.filter_map(|camera| Some(camera.report?.sightings));
    assert_eq!(reports.collect::<Vec<_>>(), [2; 32]);
}

/// The line to the PC is slow. The PC's requests are carried out all the same, or it hears that they are not.
#[test]
fn a_pc_is_told_of_every_command() {
    let told = Rc::new(RefCell::new(Vec::new()));
    let tasks = told.clone();
    let mut station = Station::<CoordinatorRole>::new(
        0,
        CoordinatorRole::new,
        Box::new(move |_, task| {
            tasks.borrow_mut().push(task);
            None
        }),
    );
    let mut air = Air::new(
        Faults {
            loss: 1.0,
            ..PERFECT
        },
        1,
    );
    let command = CameraCommand::Forget;
    for address in 0..20 {
        let wish = FromPc::Command { address, command };
        station.event(0, coordinator::CoordinatorEvent::Pc(wish));
    }
    station.event(0, coordinator::CoordinatorEvent::Pc(FromPc::JoinWindow(9)));
    station.act(0, &mut air);
    station.attach(1);
    for now in 1..40 {
        station.act(now * SECOND, &mut air);
    }
    let told = told.borrow();
    let window = coordinator::CoordinatorTask::OpenJoinWindow(Duration::from_secs(9));
    assert!(told.contains(&window));
    for address in 0..20 {
        let done = CommandResult {
            command,
            outcome: CommandOutcome::Failed,
        };
        let done = coordinator::CoordinatorTask::Tell(ToPc::Done { address, done });
        assert!(told.contains(&done), "{address}");
    }
}

/// A reference camera breaks, and another one comes in its place. One with an impossible position is
/// none.
#[test]
fn a_reference_in_place_of_another_is_appointed() {
    let mut station =
        Station::<CoordinatorRole>::new(0, CoordinatorRole::new, Box::new(|_, _| None));
    let mut air = Air::new(PERFECT, 1);
    station.attach(0);
    let hello = |duty, position| {
        let reference = Some(Reference { duty, position });
        Message::Hello(Hello {
            id: 1,
            kind: MemberKind::Camera { reference },
        })
    };
    let at = |x| Some([x, 0.0]);
    for (from, hello) in [
        (1, hello(Duty::First, at(0.0))),
        (2, hello(Duty::Second, at(10.0))),
        (3, hello(Duty::Second, at(9.0))),
        (4, hello(Duty::Second, at(f32::NAN))),
    ] {
        station.hear(0, ShortAddress(from), &hello);
    }
    station.act(0, &mut air);
    let references = References {
        first: 1,
        second: 3,
        positions: Some([[0.0, 0.0], [9.0, 0.0]]),
    };
    assert_eq!(station.facts, [Fact::References(Some(references))]);
}

/// Its solutions are not told any more.
#[test]
fn a_reference_forgets() {
    let mut net = Net::new(PERFECT, 16, with_references);
    net.walk_to(2);
    net.step_until_confirmed(0);
    net.cameras[0].is_mute = true;
    while net.poses()[0].is_none() {
        net.run_for(1_000);
    }
    let forget = Message::Command(CameraCommand::Forget);
    net.cameras[0].hear(net.now, ShortAddress(0), &forget);
    net.cameras[0].is_mute = false;
    let before = net.air.sent.len();
    net.run_for(40 * SECOND);
    let told = |message: &Message| matches!(message, Message::Located(_) | Message::Posed(_));
    assert!(
        !net.air.sent[before..]
            .iter()
            .any(|sent| told(&sent.message))
    );
}

/// If two commands wait for a busy camera, the later one counts, that of a button too; the sender of the
/// other is told.
#[test]
fn a_command_that_is_given_up_is_answered() {
    let mut station = Station::<camera::CameraRole>::new(
        1,
        || camera::CameraRole::new(101, camera_config(None)),
        Box::new(|_, _| None),
    );
    let mut air = Air::new(PERFECT, 1);
    station.attach(0);
    station.event(0, camera::CameraEvent::Ready);
    station.act(0, &mut air);
    let lost = CameraCommand::Track { colour: 0 };
    for command in [CameraCommand::Initialise, lost] {
        station.hear(0, ShortAddress(0), &Message::Command(command));
        station.act(0, &mut air);
    }
    station.event(1, camera::CameraEvent::Button(Button::LearnColour));
    station.act(1, &mut air);
    let done = Message::Done(CommandResult {
        command: lost,
        outcome: CommandOutcome::Failed,
    });
    assert!(air.sent.iter().any(|sent| sent.message == done));
}

/// The start time of a camera that does not start, and its view then, are not known.
#[test]
fn what_a_camera_that_does_not_start_is_told_is_not_done_later() {
    let tasks = Rc::new(RefCell::new(Vec::new()));
    let noted = tasks.clone();
    let mut station = Station::<camera::CameraRole>::new(
        1,
        || camera::CameraRole::new(101, camera_config(None)),
        Box::new(move |_, task| {
            noted.borrow_mut().push(task);
            None
        }),
    );
    let mut air = Air::new(PERFECT, 1);
    station.attach(0);
    let learn = CameraCommand::LearnColour { colour: 1 };
    for (now, command) in [(1, learn), (2, CameraCommand::Forget)] {
        station.hear(now, ShortAddress(0), &Message::Command(command));
        station.act(now, &mut air);
        let done = Message::Done(CommandResult {
            command,
            outcome: CommandOutcome::of(command == CameraCommand::Forget),
        });
        assert!(air.sent.iter().any(|sent| sent.message == done));
    }
    station.event(3, camera::CameraEvent::Button(Button::LearnColour));
    station.act(3, &mut air);
    station.event(4, camera::CameraEvent::Ready);
    station.act(4, &mut air);
    assert_eq!(tasks.take(), []);
    station.event(5, camera::CameraEvent::Button(Button::LearnColour));
    station.act(5, &mut air);
    let learn = CameraCommand::LearnColour { colour: 0 };
    assert_eq!(tasks.take(), [camera::CameraTask::Command(learn)]);
}

/// Two cameras were elected, and two that are configured come later. There is one frame.
#[test]
fn former_references_have_no_duty() {
    for is_restarted in [false, true] {
        let baseline = (CAMERAS[3].position - CAMERAS[2].position).norm() as f32;
        let config = |n: usize| {
            let mut camera = camera_config(
                [None, None, Some(Duty::First), Some(Duty::Second)]
                    .get(n)
                    .copied()
                    .flatten(),
            );
            camera.may_be_elected = n < 2;
            camera.baseline = if n < 2 { Some(10.0) } else { Some(baseline) };
            camera
        };
        let mut net = Net::new(PERFECT, 17, config);
        for camera in &mut net.cameras[2..4] {
            camera.is_off = true;
        }
        net.walk_to(2);
        let duties = |net: &Net| {
            let facts = net.cameras.iter().map(|camera| camera.facts.iter());
            let told = facts.map(|mut facts| {
                facts
                    .rfind(|fact| matches!(fact, Fact::References(_)))
                    .copied()
            });
            told.collect::<Vec<_>>()
        };
        let elected = duties(&net)[0];
        assert!(elected.is_some());
        // The news find one of the former ones and the coordinator switched off.
        net.cameras[0].is_off = is_restarted;
        for camera in &mut net.cameras[2..4] {
            camera.is_off = false;
        }
        net.run_for(40 * SECOND);
        if is_restarted {
            net.coordinator.restart(net.now);
            net.run_for(5 * SECOND);
            net.cameras[0].is_off = false;
            net.cameras[0].restart(net.now);
            net.cameras[0].event(net.now, camera::CameraEvent::Ready);
            net.run_for(5 * SECOND);
        }
        let references = References {
            first: 3,
            second: 4,
            positions: None,
        };
        assert_eq!(duties(&net)[0], Some(Fact::References(Some(references))));
        net.walk_to(9);
        net.check_poses(from_to(2, 3), 5.0);
        let own: Vec<_> = net.reports().iter().map(|report| report.duty).collect();
        assert_eq!(
            own[..4],
            [None, None, Some(Duty::First), Some(Duty::Second)]
        );
    }
}

/// It saw the target at stops of known places before the answer of the first one came. It tells its stops as
/// a reference, or these, not both.
#[test]
fn a_reference_drops_its_sightings() {
    let seen = Seen::direction(0.1, 0.01);
    for cut in [None, Some(1), Some(2), Some(3)] {
        let mut station = Station::<camera::CameraRole>::new(
            2,
            || camera::CameraRole::new(102, camera_config(None)),
            Box::new(move |now, _| {
                Some((now, camera::CameraEvent::Looked(Sight::InView, Some(seen))))
            }),
        );
        let mut air = Air::new(PERFECT, 1);
        station.attach(0);
        station.event(0, camera::CameraEvent::Ready);
        let references = References {
            first: 1,
            second: 2,
            positions: None,
        };
        let references = Message::References(references);
        station.hear(0, ShortAddress(0), &references);
        station.act(0, &mut air);
        let place = Track::<f32>::default().place(0.01).unwrap();
        for stop in 1..=2 {
            let stopped = Message::Stopped(Stopped {
                stop,
                colour: 0,
                frame: CoordinateFrame::Site,
                place,
            });
            let now = u64::from(stop) * SECOND;
            station.hear(now, ShortAddress(TARGET), &stopped);
            station.act(now, &mut air);
            station.act(now + 1, &mut air);
            let confirmation = Message::Confirmed(Confirmation {
                stop,
                seen_by: [2].into_iter().collect(),
            });
            station.hear(now + 2, ShortAddress(TARGET), &confirmation);
            station.act(now + 2, &mut air);
        }
        assert_eq!(station.recalled_sightings(), 2);
        let pose = PoseParts {
            position: [10.0, 0.0],
            heading: 1.0,
            covariance: [1e-4, 0.0, 1e-4, 0.0, 0.0, 1e-4],
        };
        let posed = Message::Posed(Report {
            id: 101,
            duty: None,
            sightings: 3,
            used: 3,
            chi_squared: 1.0,
            done: false,
            joint: None,
            state: CameraState::Calibrated(pose),
            mount: None,
        });
        station.facts_left = cut;
        station.hear(3 * SECOND, ShortAddress(1), &posed);
        station.act(3 * SECOND, &mut air);
        station.facts_left = None;
        station.restart(4 * SECOND);
        station.act(4 * SECOND, &mut air);
        assert_eq!(station.role.report().duty, Some(Duty::Second));
        assert_eq!(station.recalled_sightings(), 0, "{cut:?}");
        let before = air.sent.len();
        station.hear(5 * SECOND, ShortAddress(0), &Message::Sightings);
        station.act(5 * SECOND, &mut air);
        let told = air.sent[before..].iter();
        assert_eq!(
            told.filter(|sent| matches!(sent.message, Message::Sighting(_)))
                .count(),
            0
        );
    }
}
