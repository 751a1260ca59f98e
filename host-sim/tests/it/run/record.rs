//! The record itself, its JSON, and its statistics.

use calib_core::{Pose, Ray, Sighting, Status, resection};
use nalgebra::{Matrix3, Point2};
use results::record::{
    Believed, Estimate, FORMAT, Failure, Limits, Node, Place, Radio, RecordError, Role, RunRecord,
    Stop, Target, Unit, View,
    published::{Published, exchange},
    sightings::{Bearing, Carrier, Leg, References, Sightings},
    summary::{Errors, Summary},
};

use super::sample::{FIRST, Sample};

/// A run whose numbers are all exact in binary.
fn tiny() -> RunRecord {
    let mut camera = Node::new(3, Role::Camera);
    camera.expected = true;
    camera.truth = Some(Place::new(1.0, 2.0, 90.0));
    camera.view = Some(View {
        fov_deg: 60.0,
        range: 8.0,
    });
    camera.estimate = Some(Estimate {
        x: 1.5,
        y: 1.75,
        heading_deg: 91.0,
        sigma_x: 0.5,
        sigma_y: 0.25,
        sigma_heading_deg: 2.0,
        covariance: [0.25, 0.0, 0.125, 0.0625, 0.0, 4.0],
        hung: None,
    });
    camera.error = Some(results::record::PoseError::new(0.5, -0.25, 1.0));
    camera.nees = Some(2.25);
    camera.status = Some(Status::Calibrated);
    (camera.used, camera.chi_squared, camera.done) = (1, Some(0.25), true);
    (camera.heard_seconds, camera.address) = (Some(96.5), Some(2));
    camera.sightings = 1;
    camera.residuals = vec![results::record::Residual {
        target: 20,
        stop: 0,
        bearing_deg: -12.5,
        residual_deg: Some(0.25),
        normalised: Some(0.5),
    }];
    camera.calibrated_seconds = Some(64.0);
    (camera.payload_bytes, camera.bytes_sent, camera.frames_sent) = (Some(60), Some(300), Some(9));
    let mut blind = Node::new(4, Role::Camera);
    blind.reason = Some(calib_core::Refusal::TooFew);
    blind.payload_bytes = Some(0);
    blind.failures.push(Failure {
        seconds: 12.5,
        why: "the radio failed".to_owned(),
    });
    let nodes = vec![Node::new(0, Role::Coordinator), camera, blind];
    RunRecord {
        format: FORMAT,
        scenario: "tiny".to_owned(),
        path: None,
        published: None,
        seed: Some(42),
        unit: Unit {
            name: "in".to_owned(),
            metres: 0.0254,
        },
        limits: Limits {
            sigma_position: 0.5,
            sigma_heading_deg: 3.0,
        },
        networks: vec![FIRST],
        summary: Summary::of(&nodes),
        nodes,
        targets: vec![Target {
            id: 20,
            network: 1,
            path: vec![[0.0, 5.0], [2.0, 6.0]],
            stops: vec![Stop {
                stop: 0,
                seconds: Some(32.0),
                x: 2.0,
                y: 6.0,
                believed: Some(Believed {
                    x: 2.125,
                    y: 6.0,
                    sigma_x: 0.125,
                    sigma_y: 0.125,
                }),
            }],
        }],
        sightings: Vec::new(),
        obstacles: vec![vec![[3.0, 3.0], [4.0, 3.0], [4.0, 4.0]]],
        area: Vec::new(),
        radio: Some(Radio {
            frames: 12,
            bytes: 420,
            drops: [("collision".to_owned(), 1)].into(),
            airtime_share: 0.25,
            attack: None,
        }),
        sim_seconds: 100.5,
        tracking: Vec::new(),
        stops_in_vain: false,
        wall_seconds: Some(0.125),
    }
}

/// Programs rely on these names, this order and these numbers: a change of the golden file needs
/// another format number.
#[test]
fn the_json_is_the_golden_one() {
    let golden = include_str!("golden_record.json");
    assert_eq!(tiny().to_json(false).unwrap(), golden);
    let with_time = tiny().to_json(true).unwrap();
    let null = golden.replace("\"wall_seconds\": null", "\"wall_seconds\": 0.125");
    assert_eq!(with_time, null);
}

/// A record without them has none; a reader of one with them gets every bit of them.
#[test]
fn what_was_measured_is_kept_as_the_golden_one() {
    let measured = Sightings {
        network: 1,
        references: Some(References {
            cameras: [1, 2],
            baseline: Some(10.0),
        }),
        frame_heading_deg: Some(0.0),
        carriers: vec![Carrier {
            target: 20,
            systematic_scale: 0.0625,
            systematic_heading_deg: 3.0,
            standing_sigma: 0.0,
        }],
        bearings: vec![Bearing {
            target: 20,
            stop: 1,
            camera: 2,
            bearing_deg: -12.5,
            sigma_deg: 0.25,
            elevation_deg: None,
        }],
        legs: vec![Leg {
            target: 20,
            stop: 2,
            dx: 1.5,
            dy: -0.25,
            covariance: [0.0625, 0.0, 0.125],
        }],
        ..Sightings::default()
    };
    let golden: Sightings = serde_json::from_str(include_str!("golden_sightings.json")).unwrap();
    assert_eq!(measured, golden);
    let text = serde_json::to_string_pretty(&measured).unwrap() + "\n";
    assert_eq!(text, include_str!("golden_sightings.json"));
    let mut record = tiny();
    record.sightings.push(measured);
    let text = record.to_json(false).unwrap();
    let read = RunRecord::from_json(&text).unwrap();
    assert_eq!(read.sightings, record.sightings);
}

#[test]
fn reading_gives_back_every_bit() {
    for seed in 0..20 {
        let record = Sample {
            seed,
            blind: &[5],
            ..Sample::default()
        }
        .run();
        let text = record.to_json(true).unwrap();
        let read = RunRecord::from_json(&text).unwrap();
        assert_eq!(read, record);
        assert_eq!(read.to_json(true).unwrap(), text);
    }
}

#[test]
fn other_formats_and_other_files_are_refused() {
    let text = tiny().to_json(false).unwrap();
    for other in [1, 2, 3, 5] {
        let text = text.replacen("\"format\": 4", &format!("\"format\": {other}"), 1);
        assert!(matches!(
            RunRecord::from_json(&text),
            Err(RecordError::Format(found)) if found == other
        ));
    }
    for text in ["", "[]", "{\"case\":7}", &text[..text.len() / 2]] {
        assert!(matches!(
            RunRecord::from_json(text),
            Err(RecordError::Json(_))
        ));
    }
}

/// The reader of a record is told what its nodes say, whatever its summary says.
#[test]
fn the_summary_is_that_of_the_nodes() {
    let record = Sample {
        blind: &[4],
        ..Sample::default()
    }
    .run();
    let mut told = record.clone();
    told.summary.calibrated = 3;
    told.summary.fit.chi_squared = 1e9;
    told.summary.all = None;
    let read = RunRecord::from_json(&told.to_json(false).unwrap()).unwrap();
    assert_eq!(read.summary, record.summary);
}

#[test]
fn records_that_no_run_makes_are_refused() {
    let refused = |change: fn(&mut RunRecord)| {
        let mut record = Sample::default().run();
        change(&mut record);
        let text = record.to_json(false).unwrap();
        RunRecord::from_json(&text).unwrap_err().to_string()
    };
    for (message, expected) in [
        (refused(|r| r.nodes[4].id = 9), "it has node 9 twice"),
        (
            refused(|r| r.targets.push(r.targets[0].clone())),
            "it has target 20 twice",
        ),
        (
            refused(|r| r.networks.push(r.networks[0])),
            "it has network 1 twice",
        ),
        (
            refused(|r| r.nodes[4].network = 2),
            "node 4 is of network 2, which is not there",
        ),
        (
            refused(|r| r.targets[0].network = 2),
            "target 20 is of network 2, which is not there",
        ),
        (
            refused(|r| r.sightings = vec![Sightings::default(), Sightings::default()]),
            "it has sightings of network 0 twice",
        ),
        (refused(|r| r.nodes.clear()), "it has no cameras"),
    ] {
        assert_eq!(message, expected);
    }
}

/// The printed statistics of Tables 4.3 to 4.5, from Table 4.1.
#[test]
fn the_statistics_are_those_of_the_thesis() {
    for path in 1..=3 {
        let thesis = Published::named("thesis-4.1", Some(path)).unwrap();
        assert_eq!(thesis.table, format!("4.{}", path + 2));
        assert_eq!(thesis.nodes.len(), 13);
        let errors: Vec<_> = thesis
            .nodes
            .iter()
            .map(results::record::published::PublishedNode::error)
            .collect();
        let of = |get: fn(&results::record::PoseError) -> f64| {
            let values: Vec<f64> = errors.iter().map(get).collect();
            Errors::of(&values).unwrap()
        };
        let (mean, sd) = (thesis.mean, thesis.standard_deviation);
        for (ours, mean, sd) in [
            (of(|e| e.x), mean.x, sd.x),
            (of(|e| e.y), mean.y, sd.y),
            (of(|e| e.heading_deg), mean.heading_deg, sd.heading_deg),
        ] {
            // From places and headings that are printed with two decimals only.
            assert!((ours.mean - mean).abs() < 2e-3, "{} {mean}", ours.mean);
            let ours = ours.standard_deviation.unwrap();
            assert!((ours - sd).abs() < 2e-3, "{ours} {sd}");
        }
    }
    assert!(Published::named("thesis-4.1", Some(4)).is_none());
    assert_eq!(
        Published::named("thesis-3.1", Some(2)).unwrap().mean.y,
        0.936
    );
    assert!(Published::named("thesis-13", Some(1)).is_none());
    assert_eq!(exchange::PAYLOAD, 84);
}

#[test]
fn errors_are_measured_across_north_and_in_sigmas() {
    let mut camera = Node::new(1, Role::Camera);
    camera.truth = Some(Place::new(1.0, 1.0, 359.5));
    let sigma = 0.5_f64.to_radians();
    camera.set_pose(&Pose {
        position: Point2::new(1.5, 1.0),
        heading: 0.5_f64.to_radians(),
        covariance: Matrix3::from_diagonal(&[0.25, 1.0, sigma * sigma].into()),
    });
    let error = camera.error.unwrap();
    assert!((error.heading_deg - 1.0).abs() < 1e-9);
    // One sigma in x, none in y, two in heading.
    assert!((camera.nees.unwrap() - 5.0).abs() < 1e-6);
    let estimate = camera.estimate.unwrap();
    assert!((estimate.sigma_heading_deg - 0.5).abs() < 1e-12);
    assert!((estimate.covariance[5] - 0.25).abs() < 1e-12);
    camera.set_pose(&Pose {
        position: Point2::new(f64::NAN, 1.0),
        heading: 0.0,
        covariance: Matrix3::identity(),
    });
    assert!(camera.estimate.is_none() && camera.error.is_none() && camera.nees.is_none());
}

#[test]
fn estimates_keep_the_pose_they_were_made_of() {
    let c = Matrix3::new(0.04, 0.01, 0.002, 0.01, 0.09, -0.003, 0.002, -0.003, 0.0004);
    let pose = Pose {
        position: Point2::new(-3.0, 7.0),
        heading: 6.2,
        covariance: c,
    };
    let back = Estimate::new(&pose).unwrap().pose();
    assert!((back.covariance - c).norm() < 1e-15);
    assert!((back.heading - 6.2).abs() < 1e-14);
}

/// The solver's own chi squared is the oracle.
#[test]
fn normalised_residuals_sum_up_to_the_solvers_chi_squared() {
    let sightings = [
        (4.0, 1.0, 0.26),
        (5.0, -2.0, -0.40),
        (2.0, 0.5, 0.22),
        (6.0, 3.0, 0.48),
        (3.0, -1.0, -0.30),
    ]
    .map(|(x, y, bearing)| {
        let ray = Ray::from_bearing(bearing);
        Sighting::new(Point2::new(x, y), ray, 0.01).with_target_sigma(0.02)
    });
    let solution = resection::solve(&sightings).unwrap();
    let mut camera = Node::new(1, Role::Camera);
    camera.set_pose(&solution.pose);
    camera.set_sightings(sightings.iter().map(|s| (20, 0, s)));
    let fit = camera.fit();
    assert_eq!(fit.degrees_of_freedom, solution.degrees_of_freedom());
    assert!((fit.chi_squared - solution.chi_squared).abs() < 1e-6 * solution.chi_squared);
    assert!(fit.chi_squared > 1.0);
}

#[test]
fn the_summary_counts_expected_cameras_and_leaves_given_places_out_of_the_sigmas() {
    let record = Sample {
        blind: &[4],
        ..Sample::default()
    }
    .run();
    let summary = &record.summary;
    assert_eq!((summary.expected, summary.calibrated), (13, 12));
    let (others, all) = (
        summary.cameras.as_ref().unwrap(),
        summary.all.as_ref().unwrap(),
    );
    assert_eq!((others.count, all.count), (10, 12));
    assert_eq!(others.within_sigmas.x, all.within_sigmas.x);
    assert_ne!(others.within_sigmas.heading, all.within_sigmas.heading);
    assert!(summary.fit.degrees_of_freedom > 10);
}
