//! Exports, read back by other code than wrote them.

use std::collections::BTreeMap;

use results::export::{self, Frame};
use results::record::RunRecord;
use serde::Deserialize;

use super::sample::Sample;

fn sample() -> RunRecord {
    let mut record = Sample {
        blind: &[4],
        ..Sample::default()
    }
    .run();
    record.unit = results::record::Unit {
        name: "in".to_owned(),
        metres: 0.0254,
    };
    record.scenario = "line\nfeed: [\"quoted\"".to_owned();
    record
}

#[test]
fn csv_has_a_row_for_every_camera() {
    let record = sample();
    let text = export::csv(&record, Frame::Network).unwrap();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let rows: Vec<BTreeMap<String, String>> =
        reader.deserialize().collect::<Result<_, _>>().unwrap();
    assert_eq!(rows.len(), 13);
    for (row, camera) in rows.iter().zip(record.cameras()) {
        assert_eq!(row["camera"], camera.id.to_string());
        let Some(estimate) = camera.estimate else {
            let told = ["status", "reason", "x"].map(|name| row[name].as_str());
            assert_eq!(told, ["waiting", "too_few", ""]);
            continue;
        };
        let number = |name: &str| row[name].parse::<f64>().unwrap();
        assert_eq!(number("x"), estimate.x);
        assert_eq!(number("sigma_heading_deg"), estimate.sigma_heading_deg);
        let names = ["cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt"];
        assert_eq!(names.map(number), estimate.covariance);
        assert_eq!(number("error_y"), estimate.y - camera.truth.unwrap().y);
    }
}

#[derive(Deserialize)]
struct Network {
    format: u32,
    scenario: String,
    unit: BTreeMap<String, serde_json::Value>,
    cameras: Vec<Camera>,
}

#[derive(Deserialize)]
struct Camera {
    id: u16,
    status: String,
    reason: Option<String>,
    pose: Option<Pose>,
}

#[derive(Deserialize)]
struct Pose {
    x: f64,
    y: f64,
    heading_rad: f64,
    covariance: Vec<f64>,
}

#[test]
fn yaml_has_poses_with_covariance() {
    let record = sample();
    let text = export::yaml(&record, Frame::Network).unwrap();
    let network: Network = serde_saphyr::from_str(&text).unwrap();
    assert_eq!(network.format, 3);
    assert_eq!(network.scenario, record.scenario);
    assert_eq!(network.unit["name"], "in");
    assert_eq!(network.cameras.len(), 13);
    for (read, camera) in network.cameras.iter().zip(record.cameras()) {
        assert_eq!(read.id, camera.id);
        let (Some(pose), Some(estimate)) = (&read.pose, camera.estimate) else {
            assert!(read.pose.is_none() && camera.estimate.is_none());
            assert_eq!(read.status, "waiting");
            assert_eq!(read.reason.as_deref(), Some("too_few"));
            continue;
        };
        assert_eq!((pose.x, pose.y), (estimate.x, estimate.y));
        assert!((pose.heading_rad.to_degrees() - estimate.heading_deg).abs() < 1e-9);
        assert_eq!(pose.covariance.len(), 9);
        let sigma = pose.covariance[8].sqrt().to_degrees();
        assert!((sigma - estimate.sigma_heading_deg).abs() < 1e-9);
        assert_eq!(pose.covariance[1], pose.covariance[3]);
    }
}

#[derive(Deserialize)]
struct Launch {
    launch: Vec<BTreeMap<String, BTreeMap<String, String>>>,
}

#[test]
fn ros_gets_static_transforms_in_metres_and_their_covariance() {
    let record = sample();
    let text = export::ros_launch(&record, Frame::Network).unwrap();
    let launch: Launch = serde_saphyr::from_str(&text).unwrap();
    let calibrated: Vec<_> = record.cameras().filter(|c| c.is_calibrated()).collect();
    assert_eq!(launch.launch.len(), 2 * calibrated.len());
    for (actions, camera) in launch.launch.chunks(2).zip(calibrated) {
        let estimate = camera.estimate.unwrap();
        let node = &actions[0]["node"];
        assert_eq!(node["pkg"], "tf2_ros");
        assert_eq!(node["exec"], "static_transform_publisher");
        let words: Vec<&str> = node["args"].split(' ').collect();
        let args: BTreeMap<_, _> = words.chunks(2).map(|pair| (pair[0], pair[1])).collect();
        let number = |name: &str| args[name].parse::<f64>().unwrap();
        assert_eq!(args["--frame-id"], "world");
        assert_eq!(args["--child-frame-id"], format!("camera_{}", camera.id));
        assert!((number("--x") - 0.0254 * estimate.x).abs() < 1e-12);
        assert!((number("--y") - 0.0254 * estimate.y).abs() < 1e-12);
        assert!((number("--yaw").to_degrees() - estimate.heading_deg).abs() < 1e-9);

        let covariance = &actions[1]["let"];
        assert_eq!(
            covariance["name"],
            format!("camera_{}_covariance", camera.id)
        );
        let values = covariance["value"].split(' ').map(|v| v.parse().unwrap());
        let values: Vec<f64> = values.collect();
        assert_eq!(values.len(), 36);
        let [_, xy, _, _, yt, _] = estimate.covariance;
        for (place, expected) in [
            (0, (0.0254 * estimate.sigma_x).powi(2)),
            (7, (0.0254 * estimate.sigma_y).powi(2)),
            (35, estimate.sigma_heading_deg.to_radians().powi(2)),
            (1, xy * 0.0254 * 0.0254),
            (6, xy * 0.0254 * 0.0254),
            (11, yt.to_radians() * 0.0254),
            (31, yt.to_radians() * 0.0254),
            (14, 0.0),
        ] {
            assert!((values[place] - expected).abs() < 1e-12, "{place}");
        }
    }
}

/// A quarter turn about the building's place of the first reference.
#[test]
fn poses_in_the_coordinates_of_the_building() {
    let mut record = sample();
    let text = export::csv(&record, Frame::Building).unwrap();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let rows: Vec<BTreeMap<String, String>> =
        reader.deserialize().collect::<Result<_, _>>().unwrap();
    for (row, camera) in rows.iter().zip(record.cameras()) {
        assert_eq!(row["frame"], "building");
        let Some(estimate) = camera.estimate else {
            continue;
        };
        let near = |name: &str, expected: f64| {
            let value: f64 = row[name].parse().unwrap();
            assert!(
                (value - expected).abs() < 1e-9,
                "{name}: {value} {expected}"
            );
        };
        near("x", 10.0 - estimate.y);
        near("y", -4.0 + estimate.x);
        near(
            "heading_deg",
            (estimate.heading_deg + 90.0).rem_euclid(360.0),
        );
        near("sigma_x", estimate.sigma_y);
        near("cov_xy", -estimate.covariance[1]);
        near("error_x", -camera.error.unwrap().y);
    }
    let ros = export::ros_launch(&record, Frame::Building).unwrap();
    assert!(ros.contains("--frame-id building "), "{ros}");
    record.networks[0].building = None;
    let refused = export::yaml(&record, Frame::Building).unwrap_err();
    assert!(refused.to_string().contains("--site"), "{refused}");
}
