//! Checks of poses, and advice where poses are not checked.

use calib_core::Status;
use results::record::{
    Protection, RunRecord,
    verdict::{Common, NextStop, Trouble, Verdict, Weakness, check_words},
};
use results::{
    export::{self, Frame},
    report::run::run_report,
};

use super::sample::{self, Sample};

/// One wrong measurement could do anything to this camera's pose.
fn unchecked(record: &mut RunRecord, id: u16) {
    let camera = record.nodes.iter_mut().find(|node| node.id == id).unwrap();
    camera.protection = Some(Protection {
        position: 12.4,
        heading_deg: 132.0,
    });
}

fn troubles(verdict: &Verdict) -> Vec<(u16, &Trouble)> {
    let findings = verdict.findings.iter();
    findings
        .map(|found| (found.camera, &found.trouble))
        .collect()
}

/// A camera that saw the target three times: each of its bearings could be wrong without being
/// noticed.
#[test]
fn a_pose_of_three_sightings_is_not_checked_until_the_target_stops_again_before_it() {
    let mut record = Sample {
        short: Some((11, 3)),
        ..Sample::default()
    }
    .run();
    unchecked(&mut record, 11);
    let verdict = Verdict::of(&record);
    assert_eq!((verdict.checked, verdict.checkable), (10, 11));
    // It is calibrated all the same.
    assert_eq!((verdict.calibrated, verdict.exit_code()), (13, 0));
    assert!(!verdict.is_checked());
    assert!(
        matches!(
            troubles(&verdict)[..],
            [(
                11,
                Trouble::Unchecked {
                    weakness: Some(Weakness::TooFew),
                    ..
                }
            )]
        ),
        "{verdict}"
    );
    let text = verdict.to_string();
    assert!(text.starts_with("13 of 13 cameras are calibrated, 10 of 11 poses are checked.\n"));
    assert!(
        text.contains(
            "camera 11: not checked: one wrong measurement that was not noticed could put it anywhere: it has \
             too few sightings\n"
        ),
        "{text}"
    );
    let mut stops = verdict.next_stops.iter();
    let stop = stops.find(|stop| stop.seen_by == [11]).unwrap();
    let (x, y, heading) = sample::camera(11);
    let bearing = (stop.y - y).atan2(stop.x - x).to_degrees() - heading;
    assert!(
        (stop.x - x).hypot(stop.y - y) < 8.0 && bearing.abs() < 30.0,
        "{stop:?}"
    );
    assert!(run_report(&record).contains("| not checked |"));
}

/// Levels that are tolerated grow with the limits of the site.
#[test]
fn checked_is_what_the_limits_tolerate() {
    let mut record = Sample::default().run();
    // 3.09 sigmas of the largest that is calibrated.
    for (limit, checked) in [(0.137, 11), (0.135, 0)] {
        record.limits.sigma_position = limit;
        let verdict = Verdict::of(&record);
        assert_eq!(verdict.checked, checked, "{verdict}");
        assert_eq!(verdict.protection.is_some(), checked > 0);
    }
    // The same, turned by 2.5 degrees.
    record.limits.sigma_position = 1.0;
    for (limit, checked) in [(0.82, 11), (0.80, 0)] {
        record.limits.sigma_heading_deg = limit;
        assert_eq!(Verdict::of(&record).checked, checked);
    }
}

/// A stop is asked for twice, with another one between: the text must say that one walks back.
#[test]
fn a_place_that_is_asked_for_again_is_walked_back_to() {
    let mut verdict = Verdict::of(&Sample::default().run());
    let stop = |x| NextStop {
        network: 1,
        x,
        y: 2.0,
        again: None,
        seen_by: vec![3],
        helps: None,
    };
    verdict.common = vec![Common::Misfit(3.0)];
    verdict.next_stops = vec![stop(1.0), stop(4.0), stop(1.0)];
    let text = verdict.to_string();
    // In the frame of the site's file: the network's origin is at (10, -4) there, its x axis along y.
    let asked: Vec<_> = text.lines().rev().take(3).collect();
    assert_eq!(
        asked,
        [
            "Then walk back to about (8.0, -3.0), in view of camera 3",
            "Then stop the target about (8.0, 0.0), in view of camera 3",
            "Next: stop the target about (8.0, -3.0), in view of camera 3",
        ]
    );
}

/// A PC that listens late knows some of the sightings: where to stop next, but not how much it helps.
#[test]
fn half_of_the_sightings_foretell_no_gain() {
    let mut record = Sample::default().run();
    unchecked(&mut record, 11);
    let words = |record: &RunRecord| Verdict::of(record).to_string();
    assert!(
        words(&record).contains("one wrong measurement then moves"),
        "{}",
        words(&record)
    );
    let camera = record.nodes.iter_mut().find(|node| node.id == 5).unwrap();
    camera.residuals.pop();
    let words = words(&record);
    assert!(words.contains("\nNext: "), "{words}");
    assert!(!words.contains("then moves"), "{words}");
}

#[test]
fn a_bound_that_turns_a_camera_round_is_none() {
    let words = |heading_deg| {
        let level = Protection {
            position: 30.0,
            heading_deg,
        };
        check_words(Some(&level), false, "m")
    };
    let [bound, none] = [89.0, 269.6].map(words);
    assert!(
        bound.ends_with("by 30.00 m and turn it by 89.0 deg"),
        "{bound}"
    );
    assert!(none.ends_with("could put it anywhere"), "{none}");
}

/// A network whose target makes no joint estimate is told so once.
#[test]
fn where_no_target_estimates_no_pose_is_checked() {
    let mut record = Sample::default().run();
    record
        .nodes
        .iter_mut()
        .for_each(|node| node.protection = None);
    let verdict = Verdict::of(&record);
    assert_eq!((verdict.checked, verdict.checkable), (0, 11));
    assert!(verdict.findings.is_empty() && verdict.next_stops.is_empty());
    assert!(
        verdict
            .to_string()
            .contains("No pose is checked: no target has estimated"),
        "{verdict}"
    );
}

/// A camera was bumped: its sightings since then contradict those of all others.
#[test]
fn a_camera_that_was_moved_is_told_so() {
    let mut record = Sample::default().run();
    let camera = record.nodes.iter_mut().find(|node| node.id == 7).unwrap();
    camera.status = Some(Status::Doubtful);
    (camera.used, camera.sightings) = (4, 9);
    let verdict = Verdict::of(&record);
    assert_eq!((verdict.checked, verdict.checkable), (10, 10));
    assert!(
        verdict.to_string().contains(
            "camera 7: not calibrated: doubtful, it may have been moved, or is stuck: only 4 of its 9 \
             sightings agree with what everybody else saw."
        ),
        "{verdict}"
    );
}

#[test]
fn the_csv_tells_levels_and_what_they_are_worth() {
    let mut record = Sample::default().run();
    unchecked(&mut record, 11);
    let csv = export::csv(&record, Frame::Network).unwrap();
    let mut lines = csv.lines();
    let heading = lines.next().unwrap();
    // Height, pitch and roll follow, with sigmas and truth, which this sample has not.
    let in_space = ",z,pitch_deg,roll_deg,sigma_z,sigma_pitch_deg,sigma_roll_deg,true_z,true_pitch_deg,true_roll_deg";
    let heading = heading.strip_suffix(in_space).unwrap();
    assert!(heading.ends_with(",address,checked,protection,protection_heading_deg"));
    let lines = lines.map(|line| line.strip_suffix(",,,,,,,,,").unwrap());
    let lines: Vec<_> = lines.collect();
    // A reference's place is given.
    assert!(lines[0].ends_with(",false,,"), "{}", lines[0]);
    assert!(lines[2].ends_with(",true,0.42,2.5"), "{}", lines[2]);
    assert!(lines[10].ends_with(",false,12.4,132.0"), "{}", lines[10]);
}

/// Levels are part of the record, and records without them can be read.
#[test]
fn the_record_keeps_levels() {
    let record = Sample::default().run();
    let text = record.to_json(false).unwrap();
    assert_eq!(text.matches("\"protection\"").count(), 11);
    let read = RunRecord::from_json(&text).unwrap();
    assert_eq!(read.nodes, record.nodes);
}
