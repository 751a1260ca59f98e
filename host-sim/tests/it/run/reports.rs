//! Printed reports, and advice.

use calib_core::{Ray, Sighting, Status, camera::Projection, resection};
use host_sim::network::{Options, Simulation};
use nalgebra::Point2;
use results::export::{self, Frame};
use results::record::{
    Failure, Node, Protection, RunRecord, Tracking,
    summary::Summary,
    verdict::{Common, Finding, InView, Trouble, Verdict},
};
use results::report::run::{answer, run_report, runs_report};
use site::{Overrides, Scenario};

use super::sample::{self, Sample};
use crate::common::{Files, run};

/// Tracks that are not what they claim to be must not be relied on.
#[test]
fn tracking_that_deceives_or_is_of_little_use_is_told() {
    let tracking = |covered, nees| {
        let mut record = Sample::default().run();
        record.tracking = vec![Tracking {
            network: 1,
            seconds: 60.0,
            objects: 2,
            looks: 500,
            covered,
            rms: Some(0.4),
            bound: Some(0.2),
            nees: Some(nees),
            breaks: 0,
            swaps: 0,
            ghosts: 0,
        }];
        run_report(&record)
    };
    let deceives =
        "Tracks are 4.9 times farther off than their covariances say: do not rely on these.";
    let useless = "Tracking is of little use here";
    let [good, bad] = [(0.95, 2.2), (0.07, 48.0)].map(|(covered, nees)| tracking(covered, nees));
    assert!(
        !good.contains("Tracks are") && !good.contains(useless),
        "{good}"
    );
    assert!(bad.contains(deceives) && bad.contains(useless), "{bad}");
}

/// The answer fits a screen, whatever there is to tell, and tells the counts first and the next stop at last.
#[test]
fn the_answer_fits_a_screen() {
    let mut troubled = Sample {
        blind: &[4, 5, 6],
        short: Some((9, 2)),
        ..Sample::default()
    }
    .run();
    for node in troubled.nodes.iter_mut().filter(|node| node.id > 9) {
        node.protection = None;
    }
    for long_unit in [false, true] {
        let mut record = troubled.clone();
        if long_unit {
            record.unit.name = "Rhenish feet".to_owned();
        }
        let verdict = Verdict::of(&record);
        let text = answer(&record, &verdict);
        let widest = text.lines().map(|line| line.chars().count()).max();
        assert!(widest <= Some(100), "{text}");
        let brief = verdict.brief();
        assert!((2..=5).contains(&brief.lines().count()), "{brief}");
        assert!(text.contains(&brief), "{text}");
        // No sentence breaks off, and no row of one is shorter than need be.
        assert!(!brief.lines().any(|line| line.ends_with("...")), "{brief}");
        let told: String = verdict.to_string().split_whitespace().collect();
        for line in brief.lines().filter(|line| !line.starts_with("and ")) {
            let line: String = line.split_whitespace().collect();
            assert!(
                told.contains(&line) || line.contains("notchecked"),
                "{line}"
            );
        }
        assert!(
            brief
                .lines()
                .last()
                .unwrap()
                .ends_with("more: --details tells all"),
            "{brief}"
        );
        assert!(
            brief.starts_with("9 of 13 cameras are calibrated"),
            "{brief}"
        );
        assert!(brief.contains("\nNext: stop the target about"), "{brief}");
        let rows = text.lines().filter(|line| line.starts_with("| "));
        assert_eq!(rows.count(), 13 + 2, "{text}");
    }
    let good = Sample::default().run();
    let verdict = Verdict::of(&good);
    assert_eq!(verdict.brief().lines().count(), 3, "{}", verdict.brief());
    let folded: String = verdict.brief().split_whitespace().collect();
    let whole: String = verdict.to_string().split_whitespace().collect();
    assert_eq!(folded, whole);

    // Poses that are not checked are told in the row that the next stop leaves.
    let mut unchecked = Sample::default().run();
    for node in unchecked.nodes.iter_mut().filter(|node| node.id > 3) {
        node.protection = None;
    }
    let brief = Verdict::of(&unchecked).brief();
    assert!(brief.lines().count() <= 5, "{brief}");
    assert!(brief.contains("not checked"), "{brief}");
    assert!(brief.contains("\nNext: "), "{brief}");
}

/// Returns true if a camera of the sample sees a place, from geometry.
fn sees(camera: u16, x: f64, y: f64) -> bool {
    let (cx, cy, heading) = sample::camera(camera);
    let (dx, dy) = (x - cx, y - cy);
    let bearing = (dy.atan2(dx).to_degrees() - heading + 540.0).rem_euclid(360.0) - 180.0;
    dx.hypot(dy) < 8.0 && bearing.abs() < 30.0
}

#[test]
fn a_complete_run_leaves_nothing_to_do() {
    let verdict = Verdict::of(&Sample::default().run());
    assert!(verdict.is_complete());
    assert_eq!(verdict.exit_code(), 0);
    assert!(verdict.findings.is_empty() && verdict.next_stops.is_empty());
    assert_eq!(
        verdict.to_string(),
        "13 of 13 cameras are calibrated, 11 of 11 poses are checked; nothing is left to do.\n  \
         Checked: one wrong measurement that was not noticed moves such a pose by 0.42 units and turns \
         it by 2.5 deg at most.\n"
    );
}

#[test]
fn cameras_without_a_pose_are_named_with_stops_in_their_view() {
    let record = Sample {
        blind: &[4],
        short: Some((9, 2)),
        ..Sample::default()
    }
    .run();
    let verdict = Verdict::of(&record);
    assert_eq!((verdict.calibrated, verdict.exit_code()), (11, 1));
    let found: Vec<_> = verdict
        .findings
        .iter()
        .map(|f| (f.camera, f.trouble.clone()))
        .collect();
    // Its own stops, and some of those of others.
    assert!(
        matches!(
            found[..],
            [
                (4, Trouble::NeverSaw(InView::Stops(3..))),
                (9, Trouble::TooFew(2))
            ]
        ),
        "{found:?}"
    );
    // Three for camera 4, one for camera 9, none of them in view of both.
    let of = |camera| {
        let stops = verdict.next_stops.iter();
        stops.filter(|s| s.seen_by.contains(&camera)).count()
    };
    assert_eq!((of(4), of(9), verdict.next_stops.len()), (3, 1, 4));
    for stop in &verdict.next_stops {
        assert!(stop.seen_by.iter().all(|&id| sees(id, stop.x, stop.y)));
    }
    let text = verdict.to_string();
    assert!(text.contains("camera 4: not calibrated: it never saw the target standing still"));
    assert!(text.contains("camera 9: not calibrated: 2 of the 3 sightings it needs"));
    assert!(text.contains("in view of camera 9\n"));
}

/// A stop counts for the references only if both see the target there, and two of them that are
/// nearly the same are hardly more than one.
#[test]
fn references_without_an_answer_are_asked_for_stops_that_both_see() {
    let record = Sample {
        blind: &[1, 2],
        ..Sample::default()
    }
    .run();
    let verdict = Verdict::of(&record);
    let stops = &verdict.next_stops;
    assert_eq!(stops.len(), 3, "{verdict}");
    for (place, stop) in stops.iter().enumerate() {
        assert_eq!(stop.seen_by, [1, 2]);
        assert!(
            sees(1, stop.x, stop.y) && sees(2, stop.x, stop.y),
            "{verdict}"
        );
        for other in &stops[..place] {
            let apart = (stop.x - other.x).hypot(stop.y - other.y);
            assert!(apart >= 0.8, "{verdict}");
        }
    }
}

/// No stop helps a node that never joined.
#[test]
fn nodes_that_never_joined_are_told_so_and_not_walked_to() {
    let silence = |record: &mut RunRecord, id: u16| {
        let node = record.nodes.iter_mut().find(|node| node.id == id).unwrap();
        node.payload_bytes = Some(0);
        if node.is_camera() {
            (node.estimate, node.error, node.nees, node.reason) = (None, None, None, None);
            (node.residuals, node.sightings) = (Vec::new(), 0);
            node.status = Some(Status::Waiting);
        }
        record.summary = Summary::of(&record.nodes);
    };
    let mut record = Sample::default().run();
    silence(&mut record, 5);
    let verdict = Verdict::of(&record);
    assert_eq!((verdict.calibrated, verdict.exit_code()), (12, 1));
    assert_eq!(verdict.findings.len(), 1);
    assert_eq!(verdict.findings[0].trouble, Trouble::NeverJoined);
    assert_eq!(verdict.next_stops, []);
    assert!(verdict.to_string().contains(
        "camera 5: not calibrated: it never joined: look at `radio`, at distances and at events"
    ));
    // A reference whose partner is silent has no common stop.
    let mut record = Sample {
        blind: &[2],
        ..Sample::default()
    }
    .run();
    silence(&mut record, 1);
    let verdict = Verdict::of(&record);
    assert_eq!(verdict.next_stops, [], "{verdict}");
    // A target that no camera hears is not seen either.
    let mut record = Sample {
        blind: &[4],
        ..Sample::default()
    }
    .run();
    silence(&mut record, 20);
    let verdict = Verdict::of(&record);
    assert_eq!(
        (verdict.absent.as_slice(), verdict.next_stops.len()),
        (&[20][..], 0)
    );
    assert!(
        verdict.to_string().contains("target 20: it never joined"),
        "{verdict}"
    );
}

/// A camera that takes something else for the target: its sightings contradict each other, however
/// sure it is.
#[test]
fn a_doubtful_pose_is_none() {
    let mut record = Sample::default().run();
    let camera = record.nodes.iter_mut().find(|n| n.id == 7).unwrap();
    assert!(camera.residuals.len() > 3);
    for (residual, sigmas) in camera
        .residuals
        .iter_mut()
        .zip([40.0, -35.0, 20.0, -30.0].iter().cycle())
    {
        residual.normalised = Some(*sigmas);
    }
    let (truth, error) = (camera.truth.unwrap(), camera.error.as_mut().unwrap());
    let estimate = camera.estimate.as_mut().unwrap();
    (estimate.x, error.x) = (truth.x - 300.0, -300.0);
    sample::judge(camera);
    assert_eq!(camera.status, Some(Status::Doubtful));
    record.summary = Summary::of(&record.nodes);
    let verdict = Verdict::of(&record);
    assert_eq!(
        (verdict.calibrated, verdict.exit_code()),
        (12, 1),
        "{verdict}"
    );
    assert_eq!(verdict.common, []);
    assert!(
        matches!(verdict.findings[0].trouble, Trouble::Doubtful { ratio: Some(ratio), .. } if ratio > 20.0)
    );
    assert!(
        verdict
            .to_string()
            .contains("camera 7: not calibrated: doubtful, its sightings contradict")
    );
    // The place where it was put, not where it believes to be.
    let [stop] = verdict.next_stops.as_slice() else {
        panic!("{verdict}");
    };
    assert!(sees(7, stop.x, stop.y), "{verdict}");
    let csv = export::csv(&record, Frame::Network).unwrap();
    assert!(csv.contains("\n7,1,network,false,doubtful,,"), "{csv}");
    let ros = export::ros_launch(&record, Frame::Network).unwrap();
    assert!(!ros.contains("camera_7"));
    assert!(run_report(&record).contains("| 7    | doubtful "));
}

/// A camera that hangs upside down is named by what it saw alone, at any seed, and no stop is asked for in its view.
#[test]
fn a_camera_upside_down_is_named() {
    const SITE: &str = r#"
        name = "upside down"
        unit = "m"
        stops = 8
        camera = { projection = "pin-hole", field_of_view_deg = 60 }
        world = { low = [0.0, 0.0], high = [9.0, 9.0] }
        [[network]]
        references = { cameras = [1, 2] }
        camera = [
            { id = 1, x = 0.0, y = 0.0, heading_deg = 45.0 },
            { id = 2, x = 9.0, y = 0.0, heading_deg = 135.0 },
            { id = 3, x = 0.0, y = 9.0, heading_deg = -45.0, roll_deg = 180 },
            { id = 4, x = 9.0, y = 9.0, heading_deg = 225.0 },
            { id = 5, x = 4.5, y = 9.0, heading_deg = 270.0 },
        ]
        target = [{ id = 20 }]
    "#;
    for seed in 1..=4 {
        let scenario =
            Scenario::from_toml(&format!("seed = {seed}\n{SITE}"), &Overrides::default());
        let mut simulation = Simulation::new(scenario.unwrap(), Options::default()).unwrap();
        let record = simulation.run(|_| ());
        let verdict = Verdict::of(&record);
        let mirrored = Finding {
            camera: 3,
            trouble: Trouble::Mirrored,
        };
        assert!(verdict.findings.contains(&mirrored), "{verdict}");
        let of_it = verdict.findings.iter().filter(|found| found.camera == 3);
        assert_eq!(of_it.count(), 1, "{verdict}");
        assert!(
            verdict
                .brief()
                .contains("camera 3: not calibrated: it hangs upside down")
        );
        // Others may want a stop there.
        assert!(
            verdict
                .next_stops
                .iter()
                .all(|stop| !stop.seen_by.contains(&3))
        );
        // A doubtful pose deceives no reader.
        assert!(!verdict.deceives, "{verdict}");
    }
}

/// The camera is sure of its pose, but the pose is wrong: the rehearsal has failed.
#[test]
fn a_pose_that_would_deceive_fails_the_run() {
    let mut record = Sample::default().run();
    assert_eq!(Verdict::of(&record).exit_code(), 0);
    let camera = record.nodes.iter_mut().find(|n| n.id == 7).unwrap();
    let mut pose = camera.estimate.unwrap().pose();
    let sigma = pose.sigma_x();
    pose.position.x = camera.truth.unwrap().x + 8.0 * sigma;
    camera.set_pose(&pose);
    let verdict = Verdict::of(&record);
    assert!(verdict.is_complete() && verdict.deceives, "{verdict}");
    assert_eq!((verdict.calibrated, verdict.exit_code()), (13, 1));
    assert!(
        verdict
            .to_string()
            .contains("predicted sigmas off the truth"),
        "{verdict}"
    );
    // The truth of a real network is not known.
    for node in &mut record.nodes {
        (node.truth, node.error, node.nees) = (None, None, None);
    }
    assert_eq!(Verdict::of(&record).exit_code(), 0);
}

/// Only the heading of a reference can be wrong.
#[test]
fn a_references_heading_can_deceive() {
    let mut record = Sample::default().run();
    let reference = record.nodes.iter_mut().find(|n| n.id == 2).unwrap();
    assert!(reference.reference && reference.nees.is_none());
    for (sigmas, code) in [(4.9, 0), (5.1, 1)] {
        let reference = record.nodes.iter_mut().find(|n| n.id == 2).unwrap();
        let sigma = reference.estimate.unwrap().sigma_heading_deg;
        reference.error.as_mut().unwrap().heading_deg = sigmas * sigma;
        assert_eq!(Verdict::of(&record).exit_code(), code, "{sigmas}");
    }
}

/// All poses are a little wrong, each within its sigmas five times: together that is no chance.
#[test]
fn errors_that_are_too_large_together_fail_the_run() {
    let mut record = Sample::default().run();
    for (sigma, ratio) in [(3.7, None), (3.95, Some(()))] {
        for node in record.nodes.iter_mut().filter(|node| node.is_camera()) {
            if let (None, Some(error)) = (node.nees, &mut node.error) {
                error.heading_deg = sigma * node.estimate.unwrap().sigma_heading_deg;
            } else {
                node.nees = Some(sigma * sigma);
            }
        }
        let verdict = Verdict::of(&record);
        let found = verdict.common.iter().find_map(|common| match common {
            Common::Overconfident(ratio) => Some(*ratio),
            _ => None,
        });
        // In each camera one of three numbers errs by so much.
        assert_eq!(found.is_some(), ratio.is_some(), "{sigma}: {verdict}");
        assert_eq!(verdict.exit_code(), u8::from(ratio.is_some()));
    }
}

/// Errors far below the foretold ones deceive no user.
#[test]
fn errors_that_are_too_small_are_said_and_fail_nothing() {
    let mut record = Sample::default().run();
    for node in record.nodes.iter_mut().filter(|node| node.is_camera()) {
        if let (None, Some(error)) = (node.nees, &mut node.error) {
            error.heading_deg = 0.0;
        } else {
            node.nees = Some(0.3);
        }
    }
    let verdict = Verdict::of(&record);
    assert!(matches!(verdict.common[..], [Common::Underconfident(ratio)] if ratio > 3.0));
    assert_eq!(verdict.exit_code(), 0);
}

/// The target's believed places err by more than their sigmas: the cause is the carrier, not the lens.
#[test]
fn a_carrier_is_named_and_a_lens_is_not_blamed() {
    let mut record = Sample::default().run();
    for stop in &mut record.targets[0].stops {
        let believed = stop.believed.as_mut().unwrap();
        (believed.x, believed.y) = (1.03 * stop.x, 1.03 * stop.y);
    }
    let verdict = Verdict::of(&record);
    assert!(matches!(verdict.common[..], [Common::Carrier(20, ratio)] if ratio > 5.0));
    assert!(
        verdict.to_string().contains("carrier's steps or compass"),
        "{verdict}"
    );
}

/// Four walls around a camera.
#[test]
fn a_sealed_room_is_named() {
    let blind = Sample {
        blind: &[4],
        ..Sample::default()
    };
    let mut record = blind.run();
    let (x, y, _) = sample::camera(4);
    let room = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    record.obstacles = vec![room.map(|[dx, dy]| [x + dx, y + dy]).to_vec()];
    let verdict = Verdict::of(&record);
    assert_eq!(
        verdict.findings[0].trouble,
        Trouble::NeverSaw(InView::Sealed)
    );
    assert_eq!(verdict.next_stops, [], "{verdict}");
    assert!(verdict.to_string().contains("sealed room"), "{verdict}");
    // A gap at its back, out of sight, is no way into its view; one in front of it is.
    let mut open = room.map(|[dx, dy]| [x + 6.0 * dx, y + 6.0 * dy]).to_vec();
    open.push(open[0]);
    let walls: Vec<Vec<[f64; 2]>> = open.windows(2).map(<[_]>::to_vec).collect();
    record.obstacles = walls.clone();
    let trouble = Verdict::of(&record).findings[0].trouble.clone();
    assert!(
        matches!(trouble, Trouble::NeverSaw(InView::Stops(3..))),
        "stops are in the room"
    );
    // No path leads into the room, whose wall on the right has a door.
    record.targets[0].stops.clear();
    record.targets[0].path = vec![[x + 20.0, y]];
    assert_eq!(
        Verdict::of(&record).findings[0].trouble,
        Trouble::NeverSaw(InView::Sealed)
    );
    let [[dx, low], [_, high]] = [walls[1][0], walls[1][1]];
    record.obstacles[1] = vec![[dx, low], [dx, y - 1.0]];
    record.obstacles.push(vec![[dx, y + 1.0], [dx, high]]);
    assert_eq!(
        Verdict::of(&record).findings[0].trouble,
        Trouble::NeverSaw(InView::Elsewhere)
    );
}

/// The silent node, and the time since when it is silent.
#[test]
fn a_silent_node_is_named_with_the_time() {
    let mut record = Sample {
        blind: &[4],
        ..Sample::default()
    }
    .run();
    for node in record.nodes.iter_mut().filter(|n| [4, 20].contains(&n.id)) {
        (node.silent, node.heard_seconds) = (true, Some(123.4));
    }
    let verdict = Verdict::of(&record);
    assert_eq!(verdict.findings[0].trouble, Trouble::Silent(Some(123.4)));
    assert_eq!(verdict.next_stops, []);
    let text = verdict.to_string();
    for part in [
        "camera 4: it does not",
        "target 20: it does not",
        "at 123 s",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

/// There is no place in view of a pose that is far off.
#[test]
fn no_stop_is_asked_for_out_of_reach() {
    let mut record = Sample::default().run();
    let camera = record.nodes.iter_mut().find(|n| n.id == 7).unwrap();
    let estimate = camera.estimate.as_mut().unwrap();
    (estimate.sigma_x, estimate.covariance[0]) = (5.0, 25.0);
    sample::judge(camera);
    assert_eq!(Verdict::of(&record).next_stops.len(), 1);
    let camera = record.nodes.iter_mut().find(|n| n.id == 7).unwrap();
    camera.estimate.as_mut().unwrap().x += 60.0;
    assert_eq!(Verdict::of(&record).next_stops, []);
}

/// A failure leaves poses as they are, but must not be overlooked.
#[test]
fn nodes_that_could_not_go_on_are_named() {
    let mut record = Sample::default().run();
    let failure = |seconds, why: &str| Failure {
        seconds,
        why: why.to_owned(),
    };
    let node = |id| move |node: &&mut Node| node.id == id;
    let target = record.nodes.iter_mut().find(node(20)).unwrap();
    target.failures = vec![failure(3.0, "the radio failed"), failure(9.0, "no flash")];
    let coordinator = record.nodes.iter_mut().find(node(0)).unwrap();
    coordinator.failures = vec![failure(1.5, "the radio failed")];
    let verdict = Verdict::of(&record);
    assert_eq!(verdict.exit_code(), 0);
    assert_eq!(
        verdict.to_string(),
        "13 of 13 cameras are calibrated, 11 of 11 poses are checked.\n  \
         Checked: one wrong measurement that was not noticed moves such a pose by 0.42 units and turns \
         it by 2.5 deg at most.\n  \
         coordinator 0: its firmware could not go on once, and was started again: the radio failed\n  \
         target 20: its firmware could not go on 2 times, and was started again; the last time: no flash\n"
    );
    assert!(run_report(&record).contains("target 20: its firmware could not go on"));
}

/// A number that was not counted is not zero.
#[test]
fn payload_that_was_not_counted_is_said_to_be_so() {
    let mut record = Sample::default().run();
    let row = |record: &RunRecord| {
        let report = run_report(record);
        let mut lines = report.lines().map(str::to_owned);
        lines.find(|line| line.starts_with("| payload")).unwrap()
    };
    assert!(!row(&record).contains("not counted"), "{}", row(&record));
    record.nodes[3].payload_bytes = None;
    assert!(row(&record).contains("not counted"), "{}", row(&record));
}

/// The advice is followed: every weak camera solves again with the sightings of the stops that
/// were named for it, and knows its place better by far.
#[test]
fn the_stops_that_are_asked_for_help() {
    let mut record = Sample::default().run();
    record.limits.sigma_position = 0.06;
    for node in record.nodes.iter_mut().filter(|node| node.is_camera()) {
        if node.estimate.unwrap().sigma_position() > 0.06 {
            node.status = Some(Status::Weak);
        }
    }
    record.summary = Summary::of(&record.nodes);
    let verdict = Verdict::of(&record);
    let is_weak = |f: &&Finding| matches!(f.trouble, Trouble::Weak { .. });
    let weak = verdict.findings.iter().filter(is_weak);
    let weak: Vec<u16> = weak.map(|f| f.camera).collect();
    assert!(weak.contains(&11) && !verdict.next_stops.is_empty());
    assert_eq!(verdict.exit_code(), 1);
    for camera in weak {
        let node = record.nodes.iter().find(|n| n.id == camera).unwrap();
        let (x, y, heading) = sample::camera(camera);
        let exact = |tx: f64, ty: f64| {
            let ray = Ray::from_bearing((ty - y).atan2(tx - x) - heading.to_radians());
            Sighting::new(Point2::new(tx, ty), ray, 0.0038)
        };
        let stops = &record.targets[0].stops;
        let mut sightings: Vec<_> = node
            .residuals
            .iter()
            .map(|r| stops[r.stop as usize])
            .map(|stop| exact(stop.x, stop.y))
            .collect();
        let before = resection::solve(&sightings).unwrap().pose.sigma_position();
        let named = verdict.next_stops.iter();
        sightings.extend(
            named
                .filter(|s| s.seen_by.contains(&camera))
                .map(|s| exact(s.x, s.y)),
        );
        let after = resection::solve(&sightings).unwrap().pose.sigma_position();
        assert!(after < 0.75 * before, "{camera}: {before} {after}");
    }
}

#[test]
fn no_stop_is_asked_for_behind_an_obstacle() {
    let mut record = Sample {
        blind: &[4],
        ..Sample::default()
    }
    .run();
    // A wall across the left half of the view of camera 4, at (17, 3) looking along 120 degrees.
    record.obstacles = vec![vec![[14.0, 3.5], [16.0, 5.0], [15.9, 5.1], [13.9, 3.6]]];
    let behind = |x: f64, y: f64| {
        let angle = (y - 3.0).atan2(x - 17.0).to_degrees();
        let wall = (117.0..170.0).contains(&angle);
        wall && (x - 17.0).hypot(y - 3.0) > 3.1
    };
    let verdict = Verdict::of(&record);
    assert_eq!(verdict.next_stops.len(), 3);
    assert!(verdict.next_stops.iter().all(|s| !behind(s.x, s.y)));
}

fn blames_the_lens(record: &RunRecord) -> bool {
    let verdict = Verdict::of(record);
    let mut common = verdict.common.iter();
    common.any(|c| matches!(c, Common::Lens(_)))
}

/// A record without the truth, from which a lens cannot be told from a carrier.
fn without_truth(mut record: RunRecord) -> RunRecord {
    record.seed = None;
    for node in &mut record.nodes {
        (node.truth, node.error, node.nees) = (None, None, None);
    }
    record
}

#[test]
fn a_wrong_camera_model_is_noticed_and_a_right_one_is_not_blamed() {
    let wrong = Sample {
        projection: Projection::EqualAngle,
        ..Sample::default()
    };
    for seed in 0..20 {
        assert!(blames_the_lens(
            &Sample {
                seed,
                stops: 10,
                ..wrong
            }
            .run()
        ));
        assert!(
            blames_the_lens(&Sample { seed, ..wrong }.run()),
            "seed {seed}"
        );
        for stops in [3, 10] {
            let right = Sample {
                seed,
                stops,
                ..Sample::default()
            }
            .run();
            assert!(!blames_the_lens(&right), "seed {seed}");
            let common = Verdict::of(&without_truth(right)).common;
            assert_eq!(common, [], "seed {seed}");
        }
    }
    let wrong = Sample { stops: 10, ..wrong }.run();
    let text = Verdict::of(&wrong).to_string();
    assert!(
        text.contains("Check the projection and the field of view"),
        "{text}"
    );
    let text = Verdict::of(&without_truth(wrong)).to_string();
    assert!(
        text.contains("the carrier's step length and compass"),
        "{text}"
    );
}

#[test]
fn one_wild_sighting_is_one_cameras_trouble() {
    // A run in which chance gives no camera residuals of the rarest in a thousand.
    let mut record = Sample {
        seed: 3,
        stops: 10,
        ..Sample::default()
    }
    .run();
    assert_eq!(Verdict::of(&record).findings, []);
    let camera = record.nodes.iter_mut().find(|n| n.id == 7).unwrap();
    camera.residuals[4].normalised = Some(-12.0);
    let stop = camera.residuals[4].stop;
    record.summary = Summary::of(&record.nodes);
    let verdict = Verdict::of(&record);
    assert_eq!(verdict.common, []);
    let found: Vec<_> = verdict.findings.iter().map(|f| f.camera).collect();
    assert_eq!(found, [7], "{:?}", verdict.findings);
    let wild = Trouble::Wild { stop, sigmas: 12.0 };
    assert_eq!(verdict.findings[0].trouble, wild);
    // The camera left it out, and has its pose.
    assert_eq!(verdict.exit_code(), 0);
}

#[test]
fn the_thesis_stands_beside_our_numbers() {
    let text = run_report(&Sample::default().run());
    for part in [
        // Table 4.2, node 3, path 1, and Table 4.3.
        "(-1.190, +0.090, -8.42)",
        "Beside the thesis's Table 4.3",
        "-0.1131",
        "3.1069",
        // Appendix B.
        "| payload ",
        "|     84 |",
        "2710 times real time",
        "2 collision, 5 loss",
    ] {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
    let mut other = Sample::default().run();
    other.scenario = "grid".to_owned();
    other.path = None;
    assert!(!run_report(&other).contains("thesis's Table"));
}

#[test]
fn several_runs_make_one_table() {
    let runs: Vec<RunRecord> = (1..=5)
        .map(|path| {
            let mut record = Sample {
                seed: u64::from(path),
                ..Sample::default()
            }
            .run();
            record.scenario = "lab".to_owned();
            record.published = Some("thesis-3.1".to_owned());
            record.path = Some(path);
            record.nodes.retain(|node| node.id <= 3);
            record
        })
        .collect();
    let text = runs_report(&runs.iter().collect::<Vec<_>>());
    assert!(text.contains("| 5, 5, 3 "));
    assert!(text.starts_with("lab: 5 runs\n"), "{text}");
    assert!(text.contains("mean, these runs") && !text.contains("this run"));
    assert!(text.contains("Errors of 5 cameras, without references"));
    assert!(text.contains("Beside the thesis's Table 3.1") && text.contains("7.1618"));
    // By whatever name the scenario is called.
    let mut other = runs[0].clone();
    other.published = None;
    assert!(!run_report(&other).contains("thesis's Table"));
}

#[test]
fn the_command_makes_everything_from_a_record() {
    let files = Files::new();
    let record = Sample {
        blind: &[4],
        ..Sample::default()
    }
    .run();
    let text = record.to_json(true).unwrap();
    let file = files.write("run.json", &text);
    let made = ["again.json", "poses.csv", "poses.yaml", "poses.launch.yaml"];
    let [json, csv, yaml, ros] = made.map(|name| files.path(name));
    let plots = files.path("plots/of/this");
    let done = run(&[
        "report", "run", &file, "--json", &json, "--wall", "--plots", &plots, "--csv", &csv,
        "--yaml", &yaml, "--ros", &ros, "--check", &file,
    ]);
    assert_eq!((done.code, done.stderr.as_str()), (1, ""));
    assert!(
        done.stdout
            .contains("12 of 13 cameras are calibrated, 10 of 10 poses are checked.")
    );
    assert!(done.stdout.contains("The runs agree in all"));
    assert_eq!(std::fs::read_to_string(&json).unwrap(), text);
    for path in [csv, yaml, ros] {
        assert!(std::fs::metadata(path).unwrap().len() > 0);
    }
    for name in ["map.svg", "errors.svg", "residuals.svg"] {
        assert!(std::fs::exists(format!("{plots}/{name}")).unwrap());
    }
}

#[test]
fn exit_codes_of_the_command() {
    let files = Files::new();
    let write = |name: &str, record: &RunRecord| files.write(name, &record.to_json(false).unwrap());
    let good = Sample::default();
    let a = write("a.json", &good.run());
    let b = write("b.json", &Sample { seed: 8, ..good }.run());
    let other = files.write("other.json", "{\"format\": 9}");
    assert_eq!(run(&["report", "run", &a]).code, 0);
    let differ = run(&["report", "run", &a, "--check", &b]);
    assert_eq!(differ.code, 1);
    assert!(differ.stdout.contains("The runs differ in"));
    assert_eq!(run(&["report", "sweep", &a, &b]).code, 0);
    assert_eq!(run(&["report", "runs", &a, &b]).code, 0);
    let blind = Sample {
        seed: 9,
        blind: &[4],
        ..good
    };
    let c = write("c.json", &blind.run());
    let incomplete = run(&["report", "sweep", &a, &c]);
    assert_eq!(incomplete.code, 1);
    let named = "path 1, seed 9: 12 of 13 cameras calibrated";
    assert!(incomplete.stdout.contains(named), "{}", incomplete.stdout);
    assert_eq!(run(&["report", "runs", &a, &c]).code, 1);
    for what in ["run", "runs", "sweep"] {
        let help = run(&["report", what, "--help"]).stdout;
        assert!(help.contains("Exit codes:\n  0  every camera"), "{help}");
    }
    let unreadable = run(&["report", "run", &other]);
    assert_eq!(unreadable.code, 2);
    assert!(unreadable.stderr.contains("format 9"));
}

#[test]
fn runs_of_two_seeds_are_told_apart() {
    let runs = [1, 2].map(|seed| {
        Sample {
            seed,
            ..Sample::default()
        }
        .run()
    });
    let text = runs_report(&runs.iter().collect::<Vec<_>>());
    assert!(text.starts_with("thesis-13, path 1: 2 runs\n"), "{text}");
    assert!(text.contains("| path, seed, node |"), "{text}");
    for row in ["| 1, 1, 3 ", "| 1, 2, 3 "] {
        assert_eq!(text.matches(row).count(), 1, "{row}: {text}");
    }
    let one = runs_report(&[&runs[0]]);
    assert!(one.starts_with("thesis-13, path 1, seed 1\n"), "{one}");
    assert!(one.contains("this run"), "{one}");
}

#[test]
fn parts_of_a_report_have_one_blank_line_between_them() {
    let thesis = Sample::default().run();
    let mut other = thesis.clone();
    other.scenario = "mine".to_owned();
    for record in [thesis, other] {
        for text in [run_report(&record), runs_report(&[&record])] {
            assert!(!text.contains("\n\n\n"), "{text}");
            assert!(text.ends_with('\n') && !text.ends_with("\n\n"), "{text:?}");
        }
    }
}

/// A camera of small sigmas that is only weak: stops are to check its pose, not to make it surer.
#[test]
fn a_pose_that_too_little_tests_is_no_calibrated_one() {
    let mut record = Sample::default().run();
    for node in record.nodes.iter_mut().filter(|node| node.id == 11) {
        node.status = Some(Status::Weak);
        node.protection = Some(Protection {
            position: 9.0,
            heading_deg: 60.0,
        });
    }
    record.summary = Summary::of(&record.nodes);
    let verdict = Verdict::of(&record);
    let of_it = verdict.findings.iter().filter(|found| found.camera == 11);
    let troubles: Vec<_> = of_it.map(|found| &found.trouble).collect();
    assert!(
        troubles.contains(&&Trouble::Untested {
            is_reference: false
        }),
        "{troubles:?}"
    );
    let is_weak = |trouble: &&&Trouble| matches!(trouble, Trouble::Weak { .. });
    assert_eq!(troubles.iter().filter(is_weak).count(), 0, "{troubles:?}");
    let told = verdict.to_string();
    let words = "camera 11: not calibrated: weak: it hangs on a single measurement, and several others were wrong";
    assert!(told.contains(words), "{told}");
    assert!(told.contains("could move it by 9.00 units"), "{told}");
    assert_eq!(verdict.exit_code(), 1);
}
