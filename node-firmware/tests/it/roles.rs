//! Whole networks of roles, connected by an ideal radio and ideal devices, or by bad ones.

use crate::support;

use std::collections::BTreeSet;

use calib_core::{Refusal, Status, dead_reckoning::Step};
use node_firmware::{
    config::{CameraConfig, Sigmas},
    console::{FromPc, ToPc},
    facts::Fact,
    message::{CameraCommand, CameraState, CoordinateFrame, Duty, Message, Report, Stopped},
    role::{
        Role, camera,
        coordinator::{self, CoordinatorRole},
        moving_target::{self, TargetRole},
    },
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::{
    bus::{Air, AnyStation, Faults, PERFECT, Sent, Station},
    net::{Net, SECOND, TARGET, error, from_to, nees, refining, same, with_references},
    site::{CAMERAS, camera_config, noise, target_config},
    target::{BROKEN, WORKS, target_role},
};
use zigbee_link::{Instant, wire::ShortAddress};

/// Three stops of the references, and with the third one three of all other cameras.
#[test]
fn references_then_everybody() {
    let mut net = Net::new(PERFECT, 1, with_references);
    net.walk_to(2);
    assert!(!net.target.role.indication().calibrated);
    net.walk_to(3);
    assert!(net.target.role.indication().calibrated);
    let duties: Vec<_> = net.reports().iter().map(|r| r.duty).collect();
    assert_eq!(
        duties,
        [Some(Duty::First), Some(Duty::Second), None, None, None]
    );
    net.walk_to(4);
    assert_eq!(net.poses()[2..], [None; 3]);
    net.walk_to(5);
    net.check_poses(same, 4.5);
    assert!(net.are_all_done());
    assert_eq!(sightings(&net), [3; 5]);
}

fn sightings(net: &Net) -> Vec<u8> {
    let reports = net.reports();
    reports.iter().map(|report| report.sightings).collect()
}

/// The table of Appendix B, and the knowledge of the coordinator and the PC.
#[test]
fn everybody_knows_the_poses() {
    let mut net = Net::new(PERFECT, 2, with_references);
    net.walk_to(5);
    net.run_for(5 * SECOND);
    let reports = net.reports();
    for (n, report) in reports.iter().enumerate() {
        let address = n as u16 + 1;
        let mut of_target = net.target.role.cameras();
        let entry = of_target.find(|entry| entry.address == address).unwrap();
        assert_eq!(entry.report, Some(*report));
        assert_eq!((entry.counted, entry.done), (report.sightings, report.done));
        let mut of_coordinator = net.coordinator.role.reports();
        let known = of_coordinator.find(|(of, _)| *of == address).unwrap();
        assert_eq!(known.1, report);
        let told = ToPc::Report {
            address,
            report: *report,
        };
        assert!(net.told.borrow().contains(&told));
    }
    assert_eq!(net.target.role.cameras().count(), CAMERAS.len());
    let (position, is_in_site) = net.target.role.position();
    assert!(is_in_site);
    assert!((position.x - 5.5).abs() < 0.15 && (position.y - 8.8).abs() < 0.15);
}

/// Over many worlds the squared errors are as large as the covariances say: 3 on average for 3 numbers. The
/// cameras of one world have the errors of its references in common, so that the mean of 320 worlds is good
/// to a tenth. It is below 3, because targets here do not move at all while they stand, and say that they
/// might.
#[test]
fn errors_are_as_large_as_predicted() {
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..320 {
        let mut net = Net::new(PERFECT, 1000 + seed, with_references);
        net.walk_to(5);
        for (pose, truth) in net.poses().iter().zip(&CAMERAS).skip(2) {
            sum += nees(&pose.unwrap(), truth);
            count += 1.0;
        }
    }
    let mean = sum / count;
    println!("mean squared error in units of the covariance: {mean:.2}");
    assert!((2.0..2.6).contains(&mean), "{mean}");
}

/// The first two that see the target become the references; the first one is the origin.
#[test]
fn references_are_elected() {
    let config = |n: usize| {
        let mut camera = camera_config(None);
        camera.may_be_elected = n < 2;
        camera
    };
    for seed in 0..4 {
        let faults = Faults {
            delay: 40_000,
            ..PERFECT
        };
        let mut net = Net::new(faults, seed, config);
        net.walk_to(8);
        let first = net.reports()[0].duty == Some(Duty::First);
        if first {
            net.check_poses(from_to(0, 1), 4.5);
        } else {
            net.check_poses(from_to(1, 0), 4.5);
        }
    }
}

/// Messages that come twice, late and in another order change nothing.
#[test]
fn doubled_and_reordered_is_the_same() {
    let mut ideal = Net::new(PERFECT, 3, with_references);
    ideal.walk_to(8);
    for delay in [20_000, 400_000, 900_000] {
        let faults = Faults {
            loss: 0.0,
            double: 0.5,
            delay,
        };
        let mut net = Net::new(faults, 3, with_references);
        net.walk_to(8);
        net.run_for(10 * SECOND);
        assert!(net.are_all_done());
        net.check_poses(same, 4.5);
        if delay < 100_000 {
            assert_eq!(net.reports(), ideal.reports());
        }
        check_counts(&net);
    }
}

/// A camera's count, its records, and the target's knowledge of it are one number.
fn check_counts(net: &Net) {
    for (n, camera) in net.cameras.iter().enumerate().skip(2) {
        let stops: BTreeSet<_> = camera
            .facts
            .iter()
            .filter_map(|fact| match fact {
                Fact::Sighting(_, Some(kept)) => Some((kept.target, kept.stop)),
                _ => None,
            })
            .collect();
        let counted = camera.role.report().sightings;
        assert_eq!(usize::from(counted), stops.len(), "camera {n}");
        let mut table = net.target.role.cameras();
        let entry = table.find(|entry| usize::from(entry.address) == n + 1);
        assert!(entry.is_none_or(|entry| entry.counted <= counted));
    }
}

#[test]
fn lost_messages_cost_time_only() {
    for seed in 0..6 {
        let faults = Faults {
            loss: 0.3,
            double: 0.1,
            delay: 100_000,
        };
        let mut net = Net::new(faults, seed, with_references);
        net.wait();
        while !net.are_all_done() {
            assert!(net.stops < 40, "seed {seed}: {:?}", net.reports());
            net.walk();
        }
        println!("seed {seed}: {} stops", net.stops);
        net.check_poses(same, 5.0);
        check_counts(&net);
        net.run_for(120 * SECOND);
        let mut known = net.coordinator.role.reports().collect::<Vec<_>>();
        known.sort_by_key(|(address, _)| *address);
        assert!(known.iter().map(|(_, report)| **report).eq(net.reports()));
    }
}

#[test]
fn a_camera_that_is_done_is_left_alone() {
    let mut net = Net::new(PERFECT, 4, with_references);
    net.walk_to(5);
    let reports = net.reports();
    net.walk_to(8);
    // It looks, for the target's sake, and learns nothing.
    assert_eq!(*net.looks.borrow(), [8; 5]);
    assert_eq!(net.reports(), reports);
    // No camera is asked: one broadcast for each stop, and an answer from each.
    let asked = net
        .air
        .sent
        .iter()
        .filter(|sent| matches!(sent.message, Message::Stopped(_)) && sent.to.0 <= TARGET);
    assert_eq!(asked.count(), 0);
}

#[test]
fn refining_goes_on_until_it_is_good_enough() {
    let mut net = Net::new(PERFECT, 5, refining);
    net.walk_to(5);
    assert!(net.poses().iter().all(Option::is_some));
    assert!(!net.are_all_done());
    let before = net.reports();
    net.walk_to(18);
    assert!(net.are_all_done());
    for (before, after) in before.iter().zip(net.reports()).skip(2) {
        assert!(after.sightings > before.sightings);
        let variance = |r: &Report| r.pose().unwrap().covariance[5];
        assert!(variance(&after) < variance(before));
    }
    net.check_poses(same, 4.5);
}

#[test]
fn a_weak_pose_asks_for_more() {
    let config = |n| {
        let mut camera = with_references(n);
        camera.weak = Sigmas {
            position: 0.035,
            heading_deg: 5.0,
        };
        camera.good_enough = Sigmas {
            position: 0.03,
            heading_deg: 5.0,
        };
        camera
    };
    let mut net = Net::new(PERFECT, 6, config);
    net.walk_to(5);
    let reports = net.reports();
    let (done, weak): (Vec<&Report>, Vec<&Report>) = reports.iter().partition(|report| report.done);
    assert!(!weak.is_empty());
    assert!(weak.iter().all(|r| r.status() == Status::Weak), "{weak:?}");
    // References are weak here, where no target estimates, and need no more stops.
    assert!(done.iter().all(|r| r.duty.is_some()));
    // Sightings are kept.
    assert!(sightings(&net).iter().all(|&n| n >= 3));
    net.walk_to(18);
    assert!(net.are_all_done());
}

/// The step sensor fails for a while. Two cameras that know their poses find the target.
#[test]
fn a_lost_target_is_found() {
    let mut net = Net::new(PERFECT, 7, with_references);
    net.walk_to(5);
    let before = net.stops;
    for _ in 0..5 {
        net.target.event(net.now, BROKEN);
        net.run_for(SECOND);
    }
    net.target.event(net.now, WORKS);
    net.walk();
    assert_eq!(net.stops, before + 1);
    assert!(net.target.role.indication().calibrated);
    let (position, is_in_site) = net.target.role.position();
    assert!(is_in_site);
    assert!((position.x - 6.6).abs() < 0.2 && (position.y - 5.6).abs() < 0.2);
}

/// A sensor that fails for good makes one more stop, not one with each failure.
#[test]
fn a_broken_sensor_does_not_wear_the_flash() {
    let mut net = Net::new(PERFECT, 8, with_references);
    net.walk_to(5);
    for camera in &mut net.cameras {
        camera.is_off = true;
    }
    net.target.event(net.now, BROKEN);
    net.run_for(70 * SECOND);
    let written = net.target.facts.len();
    for _ in 0..100 {
        net.target.event(net.now, BROKEN);
        net.run_for(SECOND);
    }
    assert_eq!(net.target.facts.len(), written);
}

/// Nor with cameras that would find the target again after each failure, and again after a step.
#[test]
fn a_broken_sensor_is_no_new_stop_each_time_the_target_is_found() {
    let mut net = Net::new(PERFECT, 8, with_references);
    net.walk_to(5);
    for _ in 0..2 {
        let before = (net.target.facts.len(), net.air.sent.len());
        for _ in 0..100 {
            net.target.event(net.now, BROKEN);
            net.run_for(SECOND);
        }
        assert!(!net.target.role.position().1);
        let told = net.air.sent[before.1..]
            .iter()
            .filter(|sent| matches!(sent.message, Message::Stopped(_)) && sent.to.0 > TARGET);
        assert_eq!(told.count(), 1);
        let written = net.target.facts.len() - before.0;
        assert!(written < 10, "{written}");
        net.target.event(net.now, WORKS);
        net.walk();
        assert!(net.target.role.position().1);
        net.check_target(0.2);
    }
}

/// Sightings from before the target was lost say nothing about its place.
#[test]
fn bearings_of_a_stop_are_void_when_the_target_is_lost() {
    let mut net = Net::new(PERFECT, 8, with_references);
    net.walk_to(5);
    net.target.event(net.now, BROKEN);
    net.target.event(net.now, WORKS);
    let step = Step {
        distance: 1.0,
        heading: 0.0,
        distance_sigma: 0.01,
        heading_sigma: 0.01,
    };
    net.target
        .event(net.now, moving_target::TargetEvent::Step(step));
    net.site
        .borrow_mut()
        .targets
        .insert(0, nalgebra::Point2::new(5.0, 6.0));
    let bearings = |net: &Net| {
        let sent = net.air.sent.iter();
        sent.filter(|sent| sent.to.0 == TARGET && matches!(sent.message, Message::Bearing(_)))
            .count()
    };
    while bearings(&net) < 2 {
        net.run_for(1_000);
    }
    net.run_for(10_000);
    for event in [
        moving_target::TargetEvent::Step(step),
        BROKEN,
        WORKS,
        moving_target::TargetEvent::Step(step),
    ] {
        net.target.event(net.now, event);
    }
    net.run_for(SECOND);
    assert!(!net.target.role.position().1);
}

/// With a place that cannot be sent there is nothing to tell, and nothing to wait for.
#[test]
fn a_target_without_a_place_does_not_spin() {
    let mut config = target_config(0);
    config.standing_sigma = 1e20;
    let mut target = Station::<TargetRole<'_>>::new(
        TARGET,
        move || target_role(TARGET, config, 7),
        Box::new(|_, _| None),
    );
    let mut air = Air::new(PERFECT, 1);
    target.attach(0);
    for now in 0..20 {
        target.act(now * SECOND, &mut air);
    }
}

/// Nodes lose their power at any time.
#[test]
fn restarts_are_survived() {
    for seed in 0..12 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let faults = Faults {
            delay: 30_000,
            ..PERFECT
        };
        let mut net = Net::new(faults, seed, with_references);
        net.wait();
        while !net.are_all_done() {
            assert!(net.stops < 40, "seed {seed}: {:?}", net.reports());
            // In the middle of looking, answering, solving.
            if net.stops < 12 {
                net.run_for(rng.random_range(0..4 * SECOND));
                restart_one(&mut net, &mut rng);
            }
            net.walk();
        }
        net.check_poses(same, 5.0);
        check_counts(&net);
    }
}

fn restart_one(net: &mut Net, rng: &mut ChaCha8Rng) {
    let now = net.now;
    match rng.random_range(0..7_usize) {
        5 => net.coordinator.restart(now),
        6 => net.target.restart(now),
        n => {
            let reported = *net.cameras[n].role.report();
            net.cameras[n].restart(now);
            assert_eq!(*net.cameras[n].role.report(), reported);
            net.cameras[n].event(now + SECOND, camera::CameraEvent::Ready);
        }
    }
    net.run_for(5 * SECOND);
    net.wait();
}

/// The first reference solves, and loses its power before others hear of it.
#[test]
fn the_second_reference_gets_its_pose_after_a_restart_of_the_first() {
    let mut net = Net::new(PERFECT, 9, with_references);
    net.walk_to(2);
    net.step_until_confirmed(0);
    net.cameras[0].is_mute = true;
    while net.poses()[0].is_none() {
        net.run_for(1_000);
    }
    net.cameras[0].restart(net.now);
    net.cameras[0].event(net.now, camera::CameraEvent::Ready);
    net.cameras[0].is_mute = false;
    assert!(net.poses()[0].is_some());
    assert_eq!(net.poses()[1], None);
    net.wait();
    while !net.are_all_done() {
        assert!(net.stops < 20, "{:?}", net.reports());
        net.walk();
    }
    assert_eq!(net.reports()[1].duty, Some(Duty::Second));
    net.check_poses(same, 4.5);
}

/// The first of three cameras never reports; the coordinator restarts twice, and one of the others has news
/// in between. The last record of each is known.
#[test]
fn a_table_with_gaps_survives_restarts() {
    let mut station =
        Station::<CoordinatorRole>::new(0, CoordinatorRole::new, Box::new(|_, _| None));
    let mut air = Air::new(PERFECT, 1);
    let report = |id, sightings| {
        Message::Report(Report {
            id,
            duty: None,
            sightings,
            used: 3,
            chi_squared: 1.0,
            done: false,
            joint: None,
            state: CameraState::Refused(Refusal::DangerCircle),
            mount: None,
        })
    };
    let hears = [
        (1, Message::WhoIsThere(heapless::Vec::new())),
        (2, report(102, 3)),
        (3, report(103, 3)),
    ];
    for (from, message) in &hears {
        station.hear(0, ShortAddress(*from), message);
    }
    station.act(0, &mut air);
    station.restart(1);
    station.hear(1, ShortAddress(3), &report(103, 4));
    station.act(1, &mut air);
    station.restart(2);
    let known = station.role.reports();
    let mut known: Vec<_> = known.map(|(of, report)| (of, report.sightings)).collect();
    known.sort_unstable();
    assert_eq!(known, [(2, 3), (3, 4)]);
}

/// The knowledge of one camera is forgotten there, over restarts too, and learnt again.
#[test]
fn a_camera_forgets() {
    let mut net = Net::new(PERFECT, 10, refining);
    net.walk_to(12);
    assert!(net.reports()[3].sightings > 8);
    let wish = FromPc::Command {
        address: 4,
        command: CameraCommand::Forget,
    };
    net.coordinator
        .event(net.now, coordinator::CoordinatorEvent::Pc(wish));
    net.run_for(SECOND);
    assert_eq!(net.reports()[3].state, CameraState::Waiting);
    net.cameras[3].restart(net.now);
    net.cameras[3].event(net.now, camera::CameraEvent::Ready);
    assert_eq!(net.reports()[3].sightings, 0);
    net.run_for(SECOND);
    for _ in 0..3 {
        net.walk();
    }
    let report = net.reports()[3];
    assert_eq!(report.sightings, 3);
    net.check_poses(same, 4.5);
}

/// A carrier about whom nothing is known: the cameras tell his errors, and he tells their poses.
#[test]
fn an_unknown_carrier_is_estimated_with_the_cameras() {
    let (mut errors, mut checked) = (Vec::new(), 0);
    for seed in 0..8 {
        let mut nets = [Net::new, Net::estimating].map(|new| new(PERFECT, seed, refining));
        for net in &mut nets {
            let [scale, turn] = [1, 2].map(|n| noise(&[seed, n]));
            net.missteps(0.05 * scale, 0.035 * turn);
            net.walk_to(12);
            net.run_for(20 * SECOND);
        }
        nets[1].check_poses(same, 4.5);
        let off = |net: &Net| {
            let off = net.poses().into_iter().flatten().zip(&CAMERAS).skip(2);
            off.map(|(pose, truth)| error(&pose, truth).xy().norm_squared())
                .sum::<f64>()
        };
        errors.push([off(&nets[0]), off(&nets[1])]);
        for report in &nets[1].reports()[2..] {
            let level = report.joint.expect("solved by the target");
            checked += usize::from(level.position < 1.0);
        }
    }
    let sum = |n: usize| errors.iter().map(|errors| errors[n]).sum::<f64>().sqrt();
    let (alone, together) = (sum(0), sum(1));
    assert!(together < 0.3 * alone, "{together}, alone {alone}");
    // Twelve stops that all cameras see leave little unchecked.
    assert!(checked >= 20, "{checked}");
}

/// The distance of the references was not measured, or they are elected: the steps of the carrier tell
/// lengths, and all errors have the error of his steps in common.
#[test]
fn references_of_an_unknown_distance_are_estimated_with_the_cameras() {
    let unknown = |n: usize| {
        let mut camera = refining(n);
        camera.baseline = None;
        camera.reference_stops = 4;
        camera
    };
    let elected = |n: usize| {
        let mut camera = unknown(n);
        camera.may_be_elected = n < 2;
        camera.reference = None;
        camera
    };
    for seed in 0..4 {
        for config in [&unknown as &dyn Fn(usize) -> CameraConfig, &elected] {
            let mut net = Net::estimating(PERFECT, seed, config);
            let [scale, turn] = [1, 2].map(|n| noise(&[seed, n]));
            net.missteps(0.05 * scale, 0.035 * turn);
            net.walk_to(12);
            net.run_for(20 * SECOND);
            let reports = net.reports();
            let first = reports.iter().position(|of| of.duty == Some(Duty::First));
            let [first, second] = [first.unwrap(), 1 - first.unwrap()];
            let [pose, other] = [first, second].map(|n| *reports[n].pose().unwrap());
            assert_eq!((pose.position, pose.covariance[0]), ([0.0; 2], 0.0));
            // Along the line between both.
            let [along, _, across, ..] = other.covariance;
            let sigma = f64::from(along.sqrt());
            assert_eq!((other.position[1], across), (0.0, 0.0));
            let baseline = f64::from(other.position[0]);
            assert!((0.7..1.0).contains(&sigma), "8 % of 10: {sigma}");
            assert!((baseline - 10.0).abs() < 3.0 * sigma, "{baseline}");
            // In the frame between them, and in units of what they are apart.
            let truth = [first, second].map(|n| CAMERAS[n].position);
            let along = truth[1] - truth[0];
            let turned = along.y.atan2(along.x);
            for (n, report) in reports.iter().enumerate().skip(2) {
                let at = format!("camera {n}, seed {seed}");
                assert!(report.joint.is_some(), "{at} is estimated by the target");
                let pose = report.pose().unwrap();
                let to = (CAMERAS[n].position - truth[0]).map(|x| x * baseline / 10.0);
                let (sine, cosine) = turned.sin_cos();
                let off = [
                    f64::from(pose.position[0]) - (cosine * to.x + sine * to.y),
                    f64::from(pose.position[1]) - (cosine * to.y - sine * to.x),
                ];
                assert!(off[0].hypot(off[1]) < 0.3, "{at}: {off:?}");
                let sigma = f64::from((pose.covariance[0] + pose.covariance[2]).sqrt());
                let expected = 0.08 * to.norm();
                let share = sigma / expected;
                assert!((0.97..1.2).contains(&share), "{at}: {share}");
            }
        }
    }
}

/// A calibrated camera is bumped. It says so, and calibrates itself again.
#[test]
fn a_camera_that_was_moved_is_estimated_anew() {
    let mut net = Net::estimating(PERFECT, 3, refining);
    net.walk_to(12);
    net.check_poses(same, 4.5);
    net.turn_camera(3, 0.1);
    let mut statuses = Vec::new();
    for _ in 0..9 {
        net.walk();
        net.run_for(20 * SECOND);
        statuses.push(net.reports()[3].status());
    }
    let noticed = statuses
        .iter()
        .position(|status| *status == Status::Doubtful);
    assert!(noticed.is_some_and(|after| after <= 2), "{statuses:?}");
    assert_eq!(statuses.last(), Some(&Status::Calibrated), "{statuses:?}");
    let pose = net.poses()[3].unwrap();
    let turned = error(&pose, &CAMERAS[3]);
    assert!((turned.z - 0.1).abs() < 0.02, "{turned}");
    assert!(turned.xy().norm() < 0.3, "{turned}");
    // No other camera was led astray.
    for n in [2, 4] {
        let off = error(&net.poses()[n].unwrap(), &CAMERAS[n]);
        assert!(off.xy().norm() < 0.2, "{n}: {off}");
    }
}

/// A target that comes later is told of cameras that are done, though it asks them nothing.
#[test]
fn a_target_that_lost_its_memory_fills_its_table() {
    let mut net = Net::new(PERFECT, 11, with_references);
    net.walk_to(5);
    let now = net.now;
    for camera in &mut net.cameras {
        camera.restart(now);
        camera.event(now, camera::CameraEvent::Ready);
    }
    net.target.role = target_role(TARGET, target_config(0), 500);
    net.target.attach(now);
    net.run_for(3 * SECOND);
    net.wait();
    let table: Vec<_> = net
        .target
        .role
        .cameras()
        .map(|c| (c.address, c.report))
        .collect();
    for (n, report) in net.reports().into_iter().enumerate() {
        assert!(table.contains(&(n as u16 + 1, Some(report))));
    }
}

/// A member that is away is not called every two seconds for ever.
#[test]
fn the_dead_are_not_called_often() {
    let mut net = Net::new(PERFECT, 12, with_references);
    net.walk_to(2);
    net.cameras[1].is_off = true;
    net.cameras[1].restart(net.now);
    let before = net.air.sent.len();
    let mut coordinator = Net::new(PERFECT, 12, with_references);
    coordinator.run_for(SECOND / 2);
    coordinator.cameras[0].is_off = true;
    coordinator.run_for(600 * SECOND);
    let to_dead = coordinator
        .air
        .sent
        .iter()
        .filter(|sent| sent.to.0 == 1)
        .count();
    assert!(to_dead < 120, "{to_dead}");
    net.run_for(600 * SECOND);
    let sent = net.air.sent.len() - before;
    assert!(sent < 60, "{sent}");
}

/// Told late, a stop at which the target stands no more is not looked at.
#[test]
fn a_stop_told_late_is_ignored() {
    let mut net = Net::new(PERFECT, 13, with_references);
    net.walk_to(4);
    let late = net.air.sent.iter().find_map(|sent| match &sent.message {
        Message::Stopped(stopped) if stopped.frame == CoordinateFrame::Site => Some(*stopped),
        _ => None,
    });
    let late = Message::Stopped(Stopped {
        stop: late.unwrap().stop.wrapping_sub(1),
        ..late.unwrap()
    });
    let looks = net.looks.borrow().clone();
    let now = Instant(net.now);
    for camera in &mut net.cameras {
        camera.role.on_message(now, ShortAddress(TARGET), &late);
    }
    net.run_for(5 * SECOND);
    assert_eq!(*net.looks.borrow(), looks);
}

/// A camera was deaf while the target stood there, and hears of the stop when it stands elsewhere: an
/// attacker recorded the frame and jammed the camera. It looks, sees the target, and says so; no node uses
/// that.
#[test]
fn a_stop_heard_when_the_target_stands_elsewhere_gives_no_sighting_and_no_bearing() {
    for (camera, stops) in [(0, 1), (1, 1), (2, 4)] {
        let mut net = Net::new(PERFECT, 13, with_references);
        net.walk_to(stops);
        net.cameras[camera].is_off = true;
        net.walk();
        let mut told = net.air.sent.iter().rev();
        let late = told.find_map(|sent| match &sent.message {
            Message::Stopped(stopped) => Some(*stopped),
            _ => None,
        });
        let late = late.unwrap();
        // It walks on, and tells of its next stop.
        net.step_to_next();
        let next = late.stop.wrapping_add(1);
        let is_next = |sent: &Sent| matches!(sent.message, Message::Stopped(of) if of.stop == next);
        while !net.air.sent.iter().any(is_next) {
            net.run_for(1_000);
        }
        net.run_for(100_000);
        net.cameras[camera].is_off = false;
        let before = net.air.sent.len();
        net.cameras[camera].hear(net.now, ShortAddress(TARGET), &Message::Stopped(late));
        net.run_for(2 * SECOND);
        let address = camera as u16 + 1;
        let answers = net.air.sent[before..].iter().any(|sent| {
            sent.from.0 == address
                && matches!(&sent.message, Message::Look(look) if look.stop == late.stop && look.seen.is_some())
        });
        assert!(answers, "{camera}");
        net.wait();
        let is_of_it = |fact: &Fact| match fact {
            Fact::Sighting(_, Some(kept)) => kept.stop == late.stop,
            Fact::ReferenceStop(_, Some(kept)) => kept.stop == late.stop && kept.own.is_some(),
            _ => false,
        };
        assert!(!net.cameras[camera].facts.iter().any(is_of_it), "{camera}");
        let told = net.air.sent.iter().any(|sent| {
            sent.from.0 == address
                && matches!(&sent.message, Message::Bearing(bearing) if bearing.stop == late.stop)
        });
        assert!(!told, "{camera}");
        // At the stops that follow it is as good as any.
        net.walk_to(12);
        net.check_poses(same, 5.0);
    }
}
