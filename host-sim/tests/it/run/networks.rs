//! A record of two networks: each has a frame of its own, and troubles of its own.

use std::collections::BTreeMap;

use calib_core::{Status, angle};
use nalgebra::{Point2, Vector2};
use results::export::{self, Frame};
use results::plot;
use results::record::{
    Network, Place, RunRecord, Stop,
    summary::Summary,
    verdict::{InView, Trouble, Verdict},
};
use results::report::run::run_report;
use roxmltree::Document;

use super::sample::{self, FIRST, Sample};

/// Difference between the numbers of the second network and those of the first one.
const SECOND: u16 = 100;
/// Pose of the second network's frame in that of the first one: looking north.
const NORTH: Place = Place::new(60.0, -5.0, 90.0);

/// The same site twice, the second one at another place.
fn two(first: Sample, second: Sample) -> RunRecord {
    let [mut record, other] = [first, second].map(Sample::run);
    record.networks.push(Network {
        network: 2,
        frame: NORTH,
        building: None,
        ..FIRST
    });
    for mut node in other.nodes {
        (node.id, node.network) = (node.id + SECOND, 2);
        for residual in &mut node.residuals {
            residual.target += SECOND;
        }
        record.nodes.push(node);
    }
    for mut target in other.targets {
        (target.id, target.network) = (target.id + SECOND, 2);
        record.targets.push(target);
    }
    record.summary = Summary::of(&record.nodes);
    RunRecord::from_json(&record.to_json(true).unwrap()).unwrap()
}

fn of(record: &RunRecord) -> BTreeMap<u16, Vec<Trouble>> {
    let mut of = BTreeMap::<u16, Vec<Trouble>>::new();
    for finding in Verdict::of(record).findings {
        of.entry(finding.camera).or_default().push(finding.trouble);
    }
    of
}

#[test]
fn references_of_one_network_do_not_excuse_another() {
    let lost = Sample {
        blind: &[1, 2],
        ..Sample::default()
    };
    let short = Sample {
        blind: &[4],
        ..Sample::default()
    };
    let mut record = two(lost, short);
    // No camera of the first network has a pose while its references have none, nor a reason of its own.
    for node in record.nodes.iter_mut().filter(|n| n.network == 1) {
        (node.estimate, node.error, node.nees, node.reason) = (None, None, None, None);
        node.status = node.status.map(|_| Status::Waiting);
    }
    for node in record.nodes.iter_mut().filter(|n| n.id == 4 + SECOND) {
        node.reason = None;
    }
    let found = of(&record);
    assert_eq!(found.len(), 14, "{found:?}");
    for id in 1..=13 {
        assert_eq!(found[&id], [Trouble::NoReferences]);
    }
    assert!(matches!(
        found[&(4 + SECOND)][..],
        [Trouble::NeverSaw(InView::Stops(3..))]
    ));
    // Each network has its own stops, in its frame: both are the same site.
    let verdict = Verdict::of(&record);
    for stop in &verdict.next_stops {
        let cameras: &[u16] = match stop.network {
            1 => &[1, 2],
            _ => &[4],
        };
        let own = (stop.network - 1) * SECOND;
        let seen_by: Vec<u16> = cameras.iter().map(|id| id + own).collect();
        assert_eq!(stop.seen_by, seen_by);
        for &id in cameras {
            let (x, y, _) = sample::camera(id);
            assert!((stop.x - x).hypot(stop.y - y) < 8.0, "{verdict}");
        }
    }
    let text = verdict.to_string();
    let lines = |start: &str| text.lines().filter(|l| l.starts_with(start)).count();
    assert_eq!(
        (
            lines("Next in network 1: stop"),
            lines("Next in network 2: stop")
        ),
        (1, 1)
    );
    assert_eq!(
        (
            lines("Then in network 1: stop"),
            lines("Then in network 2: stop")
        ),
        (2, 2)
    );
    let table = run_report(&record);
    assert!(
        table.contains("| network, node |") && table.contains("| 2, 101* "),
        "{table}"
    );
}

/// A wall across the view of camera 4 of the second network, told in the frame of the first one.
#[test]
fn obstacles_are_in_the_way_of_every_network() {
    let blind = Sample {
        blind: &[4],
        ..Sample::default()
    };
    let mut record = two(Sample::default(), blind);
    let free = Verdict::of(&record).next_stops;
    assert_eq!(free.len(), 3);
    // Camera 4 is at (17, 3): at (57, 12) in the other frame, looking along 210 degrees.
    let around = [[56.6, 11.5], [57.5, 11.5], [57.5, 12.8], [56.6, 12.8]];
    record.obstacles = vec![around.to_vec()];
    assert_eq!(Verdict::of(&record).next_stops, []);
    // The same numbers in its own frame are far away.
    record.networks[1].frame = Place::new(0.0, 0.0, 0.0);
    assert_eq!(Verdict::of(&record).next_stops, free);
}

#[test]
fn one_frame_for_all_moves_and_turns_everything() {
    let record = two(
        Sample::default(),
        Sample {
            seed: 8,
            ..Sample::default()
        },
    );
    let together = record.in_one_frame();
    let moved = |p: Point2<f64>| Point2::new(NORTH.x - p.y, NORTH.y + p.x);
    let is_at = |place: [f64; 2], expected: Point2<f64>| {
        assert!(
            (Point2::from(place) - expected).norm() < 1e-9,
            "{place:?} {expected}"
        );
    };
    for (own, other) in record.nodes.iter().zip(&together.nodes) {
        let (Some(own_truth), Some(truth)) = (own.truth, other.truth) else {
            continue;
        };
        let (old, new) = (own.estimate.unwrap(), other.estimate.unwrap());
        let turn = if own.network == 1 { 0.0 } else { 90.0 };
        let at = |p: Point2<f64>| if own.network == 1 { p } else { moved(p) };
        is_at([truth.x, truth.y], at(own_truth.position()));
        is_at([new.x, new.y], at(Point2::new(old.x, old.y)));
        let turned = (new.heading_deg - old.heading_deg - turn).to_radians();
        assert!(angle::wrap_signed(turned).abs() < 1e-9);
        // The error keeps its length, and the covariance its meaning.
        let (a, b) = (own.error.unwrap(), other.error.unwrap());
        assert!((a.x.hypot(a.y) - b.x.hypot(b.y)).abs() < 1e-9);
        assert!((own.nees.unwrap_or(0.0) - other.nees.unwrap_or(0.0)).abs() < 1e-6);
        let [across, along] = if own.network == 1 {
            [new.sigma_x, new.sigma_y]
        } else {
            [new.sigma_y, new.sigma_x]
        };
        is_at([across, along], Point2::new(old.sigma_x, old.sigma_y));
    }
    let place = |stop: &Stop| Point2::new(stop.x, stop.y);
    let off = |stop: &Stop| {
        let believed = stop.believed.unwrap();
        Point2::new(believed.x, believed.y) - place(stop)
    };
    let stops = record.targets[1]
        .stops
        .iter()
        .zip(&together.targets[1].stops);
    for (own, other) in stops {
        is_at([other.x, other.y], moved(place(own)));
        let turned = Vector2::new(-off(own).y, off(own).x);
        assert!((off(other) - turned).norm() < 1e-9);
    }
    assert_eq!(record.targets[0], together.targets[0]);
}

#[test]
fn the_map_shows_networks_where_they_are() {
    let record = two(Sample::default(), Sample::default());
    let texts = |record: &RunRecord| -> Vec<String> {
        let svg = plot::map(record).unwrap();
        let document = Document::parse(&svg).unwrap();
        let texts = document.descendants().filter(|n| n.has_tag_name("text"));
        let texts = texts.filter_map(|n| n.text());
        texts.map(|text| text.trim().to_owned()).collect()
    };
    let (both, one) = (texts(&record), texts(&Sample::default().run()));
    let remark = "2 networks where they really are, frame of the first".to_owned();
    assert!(both.contains(&remark) && !one.contains(&remark));
    // If they lay over one another, the map would be as wide as that of one.
    let has = |texts: &[String], name: &str| texts.iter().any(|text| text == name);
    assert!(has(&both, "1*") && has(&both, "101*"));
    assert!(has(&both, "60") && !has(&one, "60"), "{both:?}");
}

#[test]
fn exports_tell_networks_apart() {
    let record = two(Sample::default(), Sample::default());
    let csv = export::csv(&record, Frame::Network).unwrap();
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let rows: Vec<BTreeMap<String, String>> =
        reader.deserialize().collect::<Result<_, _>>().unwrap();
    let yaml: serde_json::Value =
        serde_saphyr::from_str(&export::yaml(&record, Frame::Network).unwrap()).unwrap();
    let ros = export::ros_launch(&record, Frame::Network).unwrap();
    assert_eq!(rows.len(), 26);
    for (place, (row, camera)) in rows.iter().zip(record.cameras()).enumerate() {
        let (id, network) = (camera.id, camera.network);
        assert_eq!(row["network"], network.to_string());
        assert_eq!(yaml["cameras"][place]["id"], id);
        assert_eq!(yaml["cameras"][place]["network"], network);
        let frames = format!("--frame-id world_{network} --child-frame-id camera_{id}\"");
        let frames = frames.trim_end_matches('"');
        assert!(
            ros.lines()
                .any(|l| l.trim_end_matches(['"', '\'']).ends_with(frames)),
            "{frames}"
        );
    }
}
