use std::f32::consts::FRAC_PI_2;

use nalgebra::{Matrix2, Point2};

use super::{confirmations::SETTLE, estimate::Estimated, *};
use crate::network::NetworkIdentity;
use crate::{
    config::{LensSigma, SensorConfig, SurveySigma},
    message::{CameraState, PoseParts, Report, Seen, StopAnswer, TargetLocation},
    steps::{Chip, SensorFault},
};

const OWN: f32 = 2.0 / 180.0 * core::f32::consts::PI;
const SCALE: f32 = 0.03;
const STANDING: f32 = 0.02;

const fn at(seconds: u64) -> Instant {
    Instant(seconds * 1_000_000)
}

fn target() -> TargetRole<'static> {
    let config = TargetConfig {
        lens_sigma: LensSigma::EXACT,
        survey_sigma: SurveySigma::EXACT,
        colour: 0,
        still_after_ms: 1_000,
        systematic_heading_deg: OWN.to_degrees(),
        systematic_scale: SCALE,
        standing_sigma: STANDING,
        ball_radius: 0.0,
        dwell_least_ms: 2_000,
        dwell_most_ms: 20_000,
        roams: false,
        sensor: SensorConfig::UNCALIBRATED,
    };
    TargetRole::new(9, config, 7)
}

/// Ten steps of one unit along the sensor's x axis, which have no error of their own.
fn walk(target: &mut TargetRole<'_>) {
    let step = Step {
        distance: 1.0,
        heading: 0.0,
        distance_sigma: 0.0,
        heading_sigma: 0.0,
    };
    for _ in 0..10 {
        target.on_event(at(5), TargetEvent::Step(step));
    }
}

#[track_caller]
fn check(target: &TargetRole<'_>, position: [f32; 2], variances: [f32; 2]) {
    let place = target.place().unwrap();
    let off = place.position() - Point2::from(position);
    assert!(off.norm() < 1e-4, "{:?}", place.position());
    let expected = Matrix2::from_diagonal(&variances.into());
    let covariance = place.covariance();
    let off = covariance - expected;
    assert!(off.norm() < 1e-3 * expected.norm(), "{covariance}");
}

/// In ten units, three percent along the way and two degrees across it.
#[test]
fn a_walk_is_as_uncertain_as_what_its_sensor_always_does_wrong() {
    let mut target = target();
    check(&target, [0.0, 0.0], [STANDING * STANDING; 2]);
    walk(&mut target);
    let along = 100.0 * SCALE * SCALE + STANDING * STANDING;
    let across = 100.0 * OWN * OWN + STANDING * STANDING;
    check(&target, [10.0, 0.0], [along, across]);
}

/// The sensor's x axis is the site's y axis, with an error that adds to the sensor's own.
#[test]
fn a_target_that_was_located_walks_on_in_the_frame_of_the_site() {
    const FRAME: f32 = 0.04;
    let mut target = target();
    let membership = Attachment {
        network: NetworkIdentity {
            number: 1,
            founder: [2; 8],
        },
        own: 3,
    };
    target.on_attached(at(0), Some(membership));
    let _ = target.poll(at(2));
    let located = TargetLocation {
        stop: target.stop,
        position: [3.0, 4.0],
        covariance: [0.25, 0.0, 0.16],
        frame_heading: FRAC_PI_2,
        frame_heading_sigma: FRAME,
    };
    target.on_located(at(3), &located);
    check(
        &target,
        [3.0, 4.0],
        [0.25, 0.16].map(|variance| variance + STANDING * STANDING),
    );
    walk(&mut target);
    let across = 0.25 + 100.0 * (OWN * OWN + FRAME * FRAME) + STANDING * STANDING;
    let along = 0.16 + 100.0 * SCALE * SCALE + STANDING * STANDING;
    check(&target, [3.0, 14.0], [across, along]);
    // A place from a second reference camera comes too late.
    let again = TargetLocation {
        position: [0.0, 0.0],
        ..located
    };
    target.on_located(at(6), &again);
    check(&target, [3.0, 14.0], [across, along]);
}

const fn answer(sight: Sight) -> StopAnswer {
    StopAnswer {
        stop: 0,
        sight,
        seen: None,
        counted: 1,
        done: false,
    }
}

fn table(cameras: &[u16]) -> Table {
    let mut table = Table::new();
    for camera in cameras {
        table.meet(*camera);
    }
    table.new_stop(false);
    table
}

#[test]
fn a_camera_that_is_starting_is_asked_again_after_a_while() {
    let mut table = table(&[1, 2, 3]);
    assert_eq!(
        [2, 2, 2].map(|most| table.ask(most)),
        [Some(1), Some(2), None]
    );
    table.on_asked(at(0), 1, true);
    assert_eq!(table.deadline(), Some(at(0) + ANSWER_WITHIN));
    assert!(table.can_ask(2));
    table.on_answer(at(1), 1, &answer(Sight::NotReady));
    assert_eq!(table.deadline(), Some(at(1) + READY_AFTER));
    table.on_answer(at(1), 2, &answer(Sight::InView));
    table.on_answer(at(1), 3, &answer(Sight::NotInView));
    table.give_up(at(2));
    assert!(!table.is_settled() && !table.can_ask(2));
    assert_eq!(table.ask(2), None);
    table.give_up(at(3));
    assert_eq!(table.ask(2), Some(1));
    table.on_answer(at(3), 1, &answer(Sight::Unsteady));
    assert!(table.is_settled());
}

#[test]
fn a_camera_that_is_silent_is_asked_three_times_at_each_stop() {
    let mut table = table(&[1]);
    for stop in 0..3 {
        let began = 100 * stop;
        for asked in 0..3 {
            let now = began + 10 * asked;
            assert_eq!(table.ask(2), Some(1), "{now}");
            table.on_asked(at(now), 1, true);
            table.give_up(at(now + 3));
            assert_eq!(table.ask(2), None);
            table.give_up(at(now + 4));
        }
        assert!(table.is_settled());
        table.new_stop(false);
    }
}

#[test]
fn a_camera_that_is_away_is_asked_once_at_every_fourth_stop() {
    let mut table = table(&[1]);
    for asked in 0..3 {
        assert_eq!(table.ask(2), Some(1));
        table.on_asked(at(10 * asked), 1, false);
        table.give_up(at(10 * asked + 4));
    }
    assert!(table.is_settled());
    for stop in 2..10 {
        table.new_stop(false);
        assert_eq!(table.is_settled(), stop % 4 != 0, "{stop}");
        if stop % 4 == 0 {
            assert_eq!(table.ask(2), Some(1));
            table.on_asked(at(100), 1, false);
            table.give_up(at(104));
            assert!(table.is_settled());
        }
    }
    // It is back.
    table.on_answer(at(105), 1, &answer(Sight::InView));
    table.new_stop(false);
    assert_eq!(table.ask(2), Some(1));
}

#[test]
fn a_camera_that_is_done_is_asked_where_the_target_is_lost() {
    let mut table = table(&[1]);
    let report = Report {
        id: 7,
        duty: None,
        sightings: 5,
        used: 5,
        chi_squared: 1.0,
        done: true,
        joint: None,
        state: CameraState::Waiting,
        mount: None,
    };
    let mut unsaved = Unsaved::new();
    table.report(1, report, &mut unsaved);
    assert_eq!(unsaved.take(), Some(FactKey::Camera(0)));
    table.restore(4, 2, report);
    assert!(
        table
            .iter()
            .all(|camera| camera.done && camera.counted == 5)
    );
    table.new_stop(false);
    assert!(table.is_settled());
    table.new_stop(true);
    assert_eq!([2, 2].map(|most| table.ask(most)), [Some(1), Some(2)]);
    // No camera is asked any more.
    table.new_stop(true);
    table.close();
    assert!(table.is_settled());
}

/// A target that stood when its power failed stands there; one that walked may be anywhere.
#[test]
fn a_target_goes_on_from_where_it_stood() {
    let mut before = target();
    before.frame_heading = Some((0.5, 0.1));
    before.located = true;
    before.scale = 1.05;
    walk(&mut before);
    for standing in [true, false] {
        let walk = Walk {
            standing,
            ..before.walk().unwrap()
        };
        let mut after = target();
        after.restore(&Fact::Walk(walk));
        assert_eq!(after.located, standing);
        assert_eq!(after.frame_heading, before.frame_heading);
        // Its sigmas are those of corrected steps.
        assert_eq!(after.scale, before.scale);
        assert_eq!(after.stop, before.stop);
        let is_there = (after.track.position() - before.track.position()).norm() < 1e-3;
        assert_eq!(is_there, standing);
        assert_eq!(matches!(after.state, State::Standing(_)), standing);
        let fix = |target: &TargetRole<'_>| target.place().unwrap().parts().fix;
        assert_eq!(fix(&after) == fix(&before), standing);
    }
}

#[test]
fn bearings_of_the_present_stop_and_of_cameras_with_poses_count() {
    let mut target = target();
    target.address = Some(ShortAddress(3));
    let pose = PoseParts {
        position: [1.0, 2.0],
        heading: 0.5,
        covariance: [0.01, 0.0, 0.01, 0.0, 0.0, 0.001],
    };
    let seen = Seen::direction(0.1, 0.01);
    let bearing = StopBearing {
        target: 3,
        stop: target.stop,
        seen,
        pose: Some(pose),
    };
    let useless = [
        StopBearing {
            target: 4,
            ..bearing
        },
        StopBearing {
            stop: target.stop - 1,
            ..bearing
        },
        StopBearing {
            pose: None,
            ..bearing
        },
        StopBearing {
            seen: Seen { sigma: 0.0, ..seen },
            ..bearing
        },
    ];
    for useless in &useless {
        target.on_bearing(at(1), ShortAddress(7), useless);
        assert_eq!(target.next_deadline(), None);
    }
    for camera in [7, 8, 7, 9, 10, 11] {
        target.on_bearing(at(1), ShortAddress(camera), &bearing);
        assert!(target.locate_at.is_some());
    }
    let senders = target.bearings.iter().map(|(sender, _)| sender.0);
    assert!(senders.eq([8, 7, 9, 10]));
    target.located = true;
    target.bearings.clear();
    target.on_bearing(at(1), ShortAddress(7), &bearing);
    assert!(target.bearings.is_empty());
}

const CAMERA: u16 = 1;

fn membership() -> Attachment {
    Attachment {
        network: NetworkIdentity {
            number: 1,
            founder: [2; 8],
        },
        own: 3,
    }
}

/// All its outputs now. All that it sends is delivered.
fn outputs(
    target: &mut TargetRole<'_>,
    now: Instant,
) -> std::vec::Vec<Output<TargetNotification, TargetTask>> {
    let mut outputs = std::vec::Vec::new();
    while let Some(output) = target.poll(now) {
        if let Output::Send {
            notification: Some(notification),
            ..
        } = output
        {
            target.on_sent(now, notification, true);
        }
        outputs.push(output);
    }
    outputs
}

/// A target that stands since the second second, and knows of one camera.
fn standing() -> TargetRole<'static> {
    let mut target = target();
    target.on_attached(at(1), Some(membership()));
    let roster = Message::Roster([CAMERA].into_iter().collect());
    target.on_message(at(1), COORDINATOR, &roster);
    let told = outputs(&mut target, at(2));
    assert!(
        matches!(
            told[..],
            [
                Output::Save(Fact::Walk(Walk { standing: true, .. })),
                Output::Save(Fact::Network(_)),
                Output::Send {
                    to: COORDINATOR,
                    message: Message::Hello(_),
                    ..
                },
                Output::Send {
                    to: ShortAddress::BROADCAST,
                    message: Message::Stopped(_),
                    notification: None
                }
            ]
        ),
        "{told:?}"
    );
    target
}

/// The camera answers the present stop.
fn reply(target: &mut TargetRole<'_>, now: Instant, sight: Sight) {
    let look = Message::Look(StopAnswer {
        stop: target.stop,
        ..answer(sight)
    });
    target.on_message(now, ShortAddress(CAMERA), &look);
}

/// Time when it lets its carrier walk on.
fn may_walk_at(target: &mut TargetRole<'_>, from: Instant) -> Instant {
    let mut now = from;
    loop {
        let told = outputs(target, now);
        if target.indication().may_walk {
            // It is not known after a restart whether it left.
            assert!(
                matches!(
                    told.last(),
                    Some(Output::Save(Fact::Walk(Walk {
                        standing: false,
                        ..
                    })))
                ),
                "{told:?}"
            );
            return now;
        }
        now = target.next_deadline().unwrap();
    }
}

fn step(target: &mut TargetRole<'_>, now: Instant) {
    let step = Step {
        distance: 1.0,
        heading: 0.0,
        distance_sigma: 0.0,
        heading_sigma: 0.0,
    };
    target.on_event(now, TargetEvent::Step(step));
}

/// Its step sensor fails: it is at the places that a person tells, each of them a stop. Nothing else says where it is.
#[test]
fn a_target_without_steps_is_where_people_say() {
    let mut target = standing();
    let place = |x, y| {
        let place = ([x, y], [0.01, 0.0, 0.04]);
        Message::Located(TargetLocation::of_place(place))
    };
    let variances = [0.01, 0.04].map(|variance| variance + STANDING * STANDING);
    let stops = |told: &[Output<TargetNotification, TargetTask>]| {
        let told = told.iter().filter_map(|output| match output {
            Output::Send {
                to: ShortAddress::BROADCAST,
                message: Message::Stopped(stopped),
                ..
            } => Some((stopped.stop, stopped.told().is_some())),
            _ => None,
        });
        told.collect::<std::vec::Vec<_>>()
    };
    let health = |told: &[Output<TargetNotification, TargetTask>]| {
        told.iter().find_map(|output| match output {
            Output::Send {
                to: COORDINATOR,
                message: Message::Health(health),
                ..
            } => Some(*health),
            _ => None,
        })
    };
    // As long as its steps are known they are believed.
    let stop = target.stop;
    target.on_message(at(3), COORDINATOR, &place(4.0, 3.0));
    assert_eq!((target.stop, target.position().1), (stop, false));

    let steps = Some(Chip::Motion.is(SensorFault::Silent));
    target.on_event(at(4), TargetEvent::Sensor(steps));
    let told = outputs(&mut target, at(4));
    assert_eq!(health(&told).map(|health| health.steps), Some(steps));
    assert_eq!(stops(&told), [(stop + 1, false)]);

    target.on_message(at(5), ShortAddress(CAMERA), &place(4.0, 3.0));
    assert!(!target.position().1, "only a person knows");
    for now in [6, 7] {
        target.on_message(at(now), COORDINATOR, &place(4.0, 3.0));
        check(&target, [4.0, 3.0], variances);
        let told = outputs(&mut target, at(now));
        let told = stops(&told);
        // Told again, it is the same.
        assert_eq!(told, [(stop + 2, true)][..told.len()], "{now}");
        assert_eq!(told.is_empty(), now == 7);
        step(&mut target, at(now));
    }
    reply(&mut target, at(8), Sight::InView);
    let now = may_walk_at(&mut target, at(8));
    target.on_message(now, COORDINATOR, &place(6.0, 3.0));
    assert!(!target.indication().may_walk, "the cameras have to look");
    assert_eq!(stops(&outputs(&mut target, now)), [(stop + 3, true)]);
    check(&target, [6.0, 3.0], variances);

    // Steps may have been missed.
    target.on_event(now, TargetEvent::Sensor(None));
    let told = outputs(&mut target, now);
    assert_eq!(health(&told), Some(Health::default()));
    assert_eq!(stops(&told), [(stop + 4, false)]);
}

/// A place that is none, and an uncertainty that is none, change nothing.
#[test]
fn a_place_that_is_none_is_not_believed() {
    let mut target = standing();
    let steps = Some(Chip::Compass.is(SensorFault::Bus));
    target.on_event(at(4), TargetEvent::Sensor(steps));
    let stop = target.stop;
    for place in [
        ([f32::MAX, f32::MAX], [0.0; 3]),
        ([1.0, 1.0], [-1.0, 0.0, 1.0]),
        ([1.0, 1.0], [1.0, 2.0, 1.0]),
    ] {
        let told = Message::Located(TargetLocation::of_place(place));
        target.on_message(at(5), COORDINATOR, &told);
        assert_eq!(
            (target.stop, target.position().1),
            (stop, false),
            "{place:?}"
        );
    }
}

/// Only a camera that sees it may tell its place.
#[test]
fn a_target_that_is_lost_waits_to_be_told_where_it_is_if_it_is_seen() {
    for sight in [
        Sight::InView,
        Sight::NotInView,
        Sight::Clipped,
        Sight::Unsteady,
        Sight::NotLooking,
        Sight::Failed,
    ] {
        let mut target = standing();
        let now = at(3);
        reply(&mut target, now, sight);
        let is_seen = sight == Sight::InView;
        assert_eq!(target.indication().target_seen, is_seen);
        let confirmed = at(2) + ASK_AFTER;
        let expected = confirmed + if is_seen { LOCATED_WITHIN } else { SETTLE };
        assert_eq!(may_walk_at(&mut target, now), expected, "{sight:?}");
    }
}

/// To all.
fn confirmed(
    outputs: &[Output<TargetNotification, TargetTask>],
) -> std::vec::Vec<(u16, std::vec::Vec<u16>)> {
    confirmed_to(ShortAddress::BROADCAST, outputs)
}

fn confirmed_to(
    receiver: ShortAddress,
    outputs: &[Output<TargetNotification, TargetTask>],
) -> std::vec::Vec<(u16, std::vec::Vec<u16>)> {
    let confirmed = outputs.iter().filter_map(|output| match output {
        Output::Send {
            to,
            message: Message::Confirmed(confirmation),
            ..
        } => (*to == receiver).then(|| (confirmation.stop, confirmation.seen_by.to_vec())),
        _ => None,
    });
    confirmed.collect()
}

/// An answer to another stop, or one that comes when the carrier may have left, says nothing about the place
/// where the target stood.
#[test]
fn only_what_was_seen_while_it_stood_there_is_confirmed() {
    let mut target = standing();
    let stop = target.stop;
    let look = |target: &mut TargetRole<'_>, now, camera, stop| {
        let look = Message::Look(StopAnswer {
            stop,
            ..answer(Sight::InView)
        });
        target.on_message(now, ShortAddress(camera), &look);
    };
    look(&mut target, at(3), CAMERA, stop);
    look(&mut target, at(3), 2, stop - 1);
    let told = outputs(&mut target, at(2) + ASK_AFTER);
    assert_eq!(confirmed(&told), [(stop, [CAMERA].to_vec())]);
    // One that was lost before.
    look(&mut target, at(4), 3, stop);
    let now = target.next_deadline().unwrap();
    assert_eq!(
        confirmed(&outputs(&mut target, now)),
        [(stop, [CAMERA, 3].to_vec())]
    );
    let now = may_walk_at(&mut target, now);
    look(&mut target, now, 4, stop);
    assert_eq!(
        confirmed(&outputs(&mut target, now + Duration::from_secs(1))),
        []
    );
    // A camera that did not hear it is told again, alone and at once, also while it walks.
    for is_walking in [false, true] {
        if is_walking {
            step(&mut target, now);
        }
        look(&mut target, now, 3, stop);
        let told = outputs(&mut target, now);
        assert_eq!(confirmed_to(ShortAddress(3), &told), [(stop, [3].to_vec())]);
        assert_eq!(confirmed(&told), []);
        assert_eq!(target.indication().may_walk, !is_walking);
    }
}

/// An answer that comes again shows that messages get lost: all are told once more. A camera that is named in
/// a message due soon is not told alone.
#[test]
fn where_messages_get_lost_a_stop_is_confirmed_again() {
    let mut target = standing();
    let look = Message::Look(StopAnswer {
        stop: target.stop,
        ..answer(Sight::InView)
    });
    for _ in 0..2 {
        target.on_message(at(3), ShortAddress(CAMERA), &look);
    }
    let mut times = std::vec::Vec::new();
    let mut now = at(2) + ASK_AFTER;
    while !target.indication().may_walk {
        let told = outputs(&mut target, now);
        times.extend(confirmed(&told).iter().map(|_| now));
        assert_eq!(confirmed_to(ShortAddress(CAMERA), &told), []);
        now = target.next_deadline().unwrap_or(now);
    }
    let first = at(2) + ASK_AFTER;
    assert_eq!(times, [first, first + Duration::from_millis(300)]);
}

/// Where that happens at stop after stop it is no accident.
#[test]
fn where_messages_get_lost_again_and_again_a_stop_is_confirmed_four_times() {
    let mut confirmations = Confirmations::new();
    let first = at(1);
    for (loses, expected) in [(true, 2), (true, 4), (false, 4), (false, 4), (false, 2)] {
        confirmations.clear();
        confirmations.add(at(0), CAMERA, first);
        if loses {
            confirmations.add(at(0), CAMERA, first);
        }
        let times = (0..10).map(|n| first + Duration::from_millis(300 * n));
        let told = times.filter_map(|now| confirmations.take_due(now));
        assert_eq!(told.count(), expected);
    }
}

/// Four are told alone; if there are five, the last one hears it with all others.
#[test]
fn more_cameras_than_can_be_told_alone_are_told_together() {
    let mut confirmations = Confirmations::new();
    let first = at(1);
    for camera in 1..=5 {
        confirmations.add(at(0), camera, first);
    }
    let told = |confirmations: &mut Confirmations, now| {
        core::iter::from_fn(|| confirmations.take_due(now))
            .map(|(to, cameras)| (to.0, cameras.len()))
            .collect::<std::vec::Vec<_>>()
    };
    let all = ShortAddress::BROADCAST.0;
    assert_eq!(told(&mut confirmations, first), [(all, 5)]);
    for camera in 1..=5 {
        confirmations.repeat(at(2), camera);
        // It insists.
        confirmations.repeat(at(2), camera);
    }
    assert_eq!(confirmations.next_due(), Some(Instant(0)));
    let alone = [(4, 1), (3, 1), (2, 1), (1, 1)];
    assert_eq!(told(&mut confirmations, at(2)), alone);
    let due = confirmations.next_due().unwrap();
    assert!(at(2) < due && due < at(3));
    assert_eq!(told(&mut confirmations, due), [(all, 5)]);
    assert_eq!(confirmations.next_due(), None);
}

/// Where it walks, its steps are not counted while its power is off.
#[test]
fn a_target_that_leaves_its_stop_writes_so_once() {
    let mut early = standing();
    step(&mut early, at(3));
    let walks = |outputs: &[Output<TargetNotification, TargetTask>]| {
        let walks = outputs.iter().filter_map(|output| match output {
            Output::Save(Fact::Walk(walk)) => Some(walk.standing),
            _ => None,
        });
        walks.collect::<std::vec::Vec<_>>()
    };
    assert_eq!(walks(&outputs(&mut early, at(3))), [false]);
    step(&mut early, at(3));
    assert!(walks(&outputs(&mut early, at(3))).is_empty());
    // It wrote so when it let its carrier go.
    let mut late = standing();
    reply(&mut late, at(3), Sight::NotInView);
    let now = may_walk_at(&mut late, at(3));
    step(&mut late, now);
    assert!(walks(&outputs(&mut late, now)).is_empty());
}

#[test]
fn a_target_that_is_found_while_it_walks_writes_where_it_is() {
    let mut target = standing();
    step(&mut target, at(3));
    let _ = outputs(&mut target, at(3));
    let located = TargetLocation {
        stop: target.stop,
        position: [3.0, 4.0],
        covariance: [0.01, 0.0, 0.01],
        frame_heading: FRAC_PI_2,
        frame_heading_sigma: 0.01,
    };
    target.on_message(at(3), ShortAddress(CAMERA), &Message::Located(located));
    let told = outputs(&mut target, at(3));
    let [Output::Save(Fact::Walk(walk))] = told[..] else {
        panic!("{told:?}");
    };
    assert!(walk.located && !walk.standing);
    assert_eq!(walk.frame_heading, Some(FRAC_PI_2));
    assert!((walk.place.position() - Point2::new(3.0, 5.0)).norm() < 1e-5);
}

/// Its stop is estimated twice while it walks on: each time it is where it walked to since it left.
#[test]
fn a_stop_that_is_estimated_again_takes_nothing_from_the_way_since() {
    let mut target = standing();
    target.estimate = Some(history::tests::estimate());
    let stop = target.stop;
    if let Some(estimate) = &mut target.estimate {
        estimate.on_stop(stop, &mut target.unsaved);
    }
    let estimated = |x: f32| Estimated {
        stop,
        position: Point2::new(x, 4.0),
        covariance: Matrix2::from_diagonal_element(0.01),
        frame_heading: (FRAC_PI_2, 0.01),
        scale: (1.0, 0.01),
    };
    for (x, walked) in [(3.0, 1.0), (3.5, 2.0), (3.25, 3.0)] {
        step(&mut target, at(3));
        target.on_estimated(at(3), &estimated(x));
        let off = target.track.position() - Point2::new(x, 4.0 + walked);
        assert!(off.norm() < 1e-5, "{:?}", target.track.position());
    }
    // The steps have no error of their own.
    let place = target.place().unwrap();
    let across = 0.01 + 9.0 * (OWN * OWN + 0.01 * 0.01) + STANDING * STANDING;
    let found = place.covariance().m11;
    assert!((0.01..across).contains(&found), "{found}, {across}");
}

/// Cameras may be others, or have begun anew.
#[test]
fn a_target_that_is_back_presents_itself_and_tells_its_stop_again() {
    let mut target = standing();
    target.on_attached(at(4), None);
    assert_eq!(outputs(&mut target, at(4)), []);
    // Longer than it ever stands.
    target.on_attached(at(50), Some(membership()));
    let told = outputs(&mut target, at(50));
    let sent = told.iter().filter_map(|output| match output {
        Output::Send { to, message, .. } => Some((*to, message)),
        _ => None,
    });
    let sent: std::vec::Vec<_> = sent.collect();
    assert!(
        matches!(
            sent[..],
            [
                (COORDINATOR, Message::Hello(_)),
                (ShortAddress::BROADCAST, Message::Stopped(_))
            ]
        ),
        "{told:?}"
    );
    // They have as much time to look as at any other stop.
    let asked = outputs(&mut target, at(50) + ASK_AFTER);
    assert!(
        matches!(
            asked[..],
            [
                Output::Send {
                    to: ShortAddress::BROADCAST,
                    message: Message::Confirmed(_),
                    ..
                },
                Output::Send {
                    to: ShortAddress(CAMERA),
                    message: Message::Stopped(_),
                    ..
                }
            ]
        ),
        "{asked:?}"
    );
    assert!(!target.indication().may_walk);
    reply(&mut target, at(53), Sight::NotInView);
    assert_eq!(may_walk_at(&mut target, at(53)), at(53));
}

#[test]
fn a_camera_that_answers_before_it_is_known_that_it_was_asked_has_answered() {
    for delivered in [true, false] {
        let mut table = table(&[1]);
        assert_eq!(table.ask(2), Some(1));
        table.on_answer(at(1), 1, &answer(Sight::InView));
        table.on_asked(at(1), 1, delivered);
        assert!(table.is_settled());
        assert_eq!(table.ask(2), None);
    }
}

/// Silent, but not away.
#[test]
fn a_camera_that_hears_the_question_again_is_asked_at_each_stop_again() {
    let mut table = table(&[1]);
    for asked in 0..3 {
        assert_eq!(table.ask(2), Some(1));
        table.on_asked(at(10 * asked), 1, false);
        table.give_up(at(10 * asked + 4));
    }
    for stop in 2..=4 {
        table.new_stop(false);
        assert_eq!(table.is_settled(), stop < 4);
    }
    assert_eq!(table.ask(2), Some(1));
    table.on_asked(at(100), 1, true);
    table.new_stop(false);
    assert_eq!(table.ask(2), Some(1));
}

/// Where no camera sees it, it looks once for another network before it lets its carrier walk on.
#[test]
fn a_target_that_roams_looks_for_another_network_where_nobody_sees_it() {
    let roams = |output: &Output<_, _>| *output == Output::Task(TargetTask::Roam);
    for (sight, expected) in [(Sight::NotInView, true), (Sight::InView, false)] {
        let mut target = standing();
        target.config.roams = true;
        reply(&mut target, at(3), sight);
        let mut now = at(3);
        let looks = loop {
            let told = outputs(&mut target, now);
            let may_walk = target.indication().may_walk;
            if may_walk || told.iter().any(roams) {
                break !may_walk;
            }
            now = target.next_deadline().unwrap();
        };
        assert_eq!(looks, expected);
        if looks {
            // It stays, for there is no other one.
            let walks = may_walk_at(&mut target, now);
            assert!(walks >= now + ROAM_WITHIN && walks < now + ROAM_WITHIN * 2);
        }
    }
}

/// In the other network it stands where it stood, and says so to the cameras there.
#[test]
fn a_target_that_went_over_tells_the_same_stop_again() {
    let mut target = standing();
    let told = |target: &mut TargetRole<'_>, now| {
        let mut told = outputs(target, now)
            .into_iter()
            .filter_map(|output| match output {
                Output::Send {
                    to,
                    message: Message::Stopped(stopped),
                    ..
                } => {
                    assert_eq!(to, ShortAddress::BROADCAST);
                    Some(stopped)
                }
                _ => None,
            });
        told.next()
    };
    reply(&mut target, at(3), Sight::InView);
    let before = target.stopped();
    target.on_attached(at(4), None);
    assert_eq!(told(&mut target, at(4)), None, "nobody is there");
    let other = NetworkIdentity {
        number: 77,
        founder: [9; 8],
    };
    let attached = Attachment {
        network: other,
        own: 5,
    };
    target.on_attached(at(5), Some(attached));
    assert_eq!(target.cameras().count(), 0, "those of the other network");
    let again = told(&mut target, at(5)).map(Message::Stopped);
    assert_eq!(again, before);
}
