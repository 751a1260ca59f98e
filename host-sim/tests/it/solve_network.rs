//! `host-sim solve-network` as users run it.

use std::fmt::Write as _;

use crate::common::{Files, run, run_with_input};
use serde_json::Value;

/// Five cameras around a yard, and the stops of a target; all cameras see all of the yard.
const CAMERAS: [(f64, f64, f64); 5] = [
    (0.0, 0.0, 45.0),
    (10.0, 0.0, 135.0),
    (5.0, 11.0, 270.0),
    (-1.0, 6.0, 0.0),
    (11.0, 7.0, 190.0),
];
const STOPS: [(f64, f64); 7] = [
    (4.0, 4.0),
    (6.0, 4.5),
    (5.0, 6.5),
    (3.5, 5.5),
    (6.5, 6.0),
    (4.5, 5.0),
    (5.5, 3.5),
];

/// A bearing without any error.
fn bearing(camera: usize, stop: usize) -> f64 {
    let ((x, y, heading), (to_x, to_y)) = (CAMERAS[camera], STOPS[stop]);
    let world = f64::atan2(to_y - y, to_x - x).to_degrees();
    (world - heading + 540.0).rem_euclid(360.0) - 180.0
}

fn bearings() -> String {
    let mut text = "stop,camera,bearing_deg,sigma_deg\n".to_owned();
    for stop in 0..STOPS.len() {
        for camera in 0..CAMERAS.len() {
            let bearing = bearing(camera, stop);
            writeln!(text, "{},{},{bearing},0.1", stop + 1, camera + 1).unwrap();
        }
    }
    text
}

/// A carrier who reads 3 % too much.
fn legs() -> String {
    let mut text = "stop,dx,dy\n".to_owned();
    for (n, ends) in STOPS.windows(2).enumerate() {
        let [(x, y), (to_x, to_y)] = [ends[0], ends[1]];
        writeln!(
            text,
            "{},{},{}",
            n + 2,
            1.03 * (to_x - x),
            1.03 * (to_y - y)
        )
        .unwrap();
    }
    text
}

fn lines(text: &str) -> Vec<Value> {
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn bearings_and_displacements_give_every_pose_and_the_carrier() {
    let files = Files::new();
    let (bearings, legs) = (
        files.write("bearings.csv", &bearings()),
        files.write("legs.csv", &legs()),
    );
    let all = [
        "solve-network",
        &bearings,
        "--legs",
        &legs,
        "--references",
        "1,2",
        "--displacement-sigma",
        "0.02",
    ];
    // Prior knowledge about the carrier would pull a little.
    let free = ["--baseline", "10", "--systematic-scale", "1", "--json"];
    let done = run(&[&all[..], &free].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let solution = &lines(&done.stdout)[0];
    assert_eq!(solution["status"], "calibrated");
    assert_eq!(solution["scale_from"], "baseline");
    for (camera, (x, y, heading)) in solution["cameras"].as_array().unwrap().iter().zip(CAMERAS) {
        let pose = &camera["estimate"];
        assert!((number(&pose["x"]) - x).abs() < 1e-4, "{camera}");
        assert!((number(&pose["y"]) - y).abs() < 1e-4, "{camera}");
        let turned = (number(&pose["heading_deg"]) - heading + 540.0).rem_euclid(360.0) - 180.0;
        assert!(turned.abs() < 1e-3, "{camera}");
    }
    assert!((number(&solution["carrier"]["scale"]) - 1.03).abs() < 1e-4);
    assert_eq!(solution["bearings"].as_array().unwrap().len(), 35);
    // The same without the baseline: all is 3 % longer, and its told uncertainty is about as large.
    let unknown = [
        "--baseline",
        "unknown",
        "--systematic-scale",
        "0.04",
        "--json",
    ];
    let done = run(&[&all[..], &unknown].concat());
    let solution = &lines(&done.stdout)[0];
    assert_eq!(solution["scale_from"], "carrier");
    assert!((number(&solution["baseline"]) - 10.3).abs() < 1e-3);
    assert!((number(&solution["sigma_baseline"]) / 10.3 - 0.04).abs() < 2e-3);
    let done = run(&[&all[..], &["--baseline", "unknown"]].concat());
    assert!(
        done.stdout
            .contains("the carrier's distances set the scale"),
        "{}",
        done.stdout
    );
}

#[test]
fn bearings_alone_give_a_network_up_to_scale() {
    let done = run_with_input(&["solve-network", "-", "--json"], &bearings());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let solution = &lines(&done.stdout)[0];
    assert_eq!(solution["scale_from"], "nothing");
    let known = ["--references", "1,2", "--baseline", "10", "--json"];
    let done = run_with_input(&[&["solve-network", "-"], &known[..]].concat(), &bearings());
    let solution = &lines(&done.stdout)[0];
    for (camera, (x, y, _)) in solution["cameras"].as_array().unwrap().iter().zip(CAMERAS) {
        let pose = &camera["estimate"];
        assert!((number(&pose["x"]) - x).abs() < 1e-3, "{camera}");
        assert!((number(&pose["y"]) - y).abs() < 1e-3, "{camera}");
    }
    let done = run_with_input(&["solve-network", "-"], &bearings());
    assert!(
        done.stdout.contains("Nothing sets the scale"),
        "{}",
        done.stdout
    );
    // Four places are one too few.
    let few: String = bearings()
        .lines()
        .take(21)
        .fold(String::new(), |all, line| all + line + "\n");
    let done = run_with_input(&["solve-network", "-"], &few);
    assert_eq!(done.code, 1);
    assert!(done.stdout.contains("at 5 places"), "{}", done.stdout);
}

/// Distances, marks and lenses beside bearings and displacements: exact measurements of cameras whose
/// bearings were decoded with a lens of 45 degrees where it has 47.
#[test]
fn ranges_marks_and_lenses_are_taken_too() {
    let files = Files::new();
    let factor = f64::tan(23.5_f64.to_radians()) / f64::tan(22.5_f64.to_radians());
    let mut seen = "stop,camera,bearing_deg,sigma_deg\n".to_owned();
    let mut ranges = "stop,camera,range,sigma\n".to_owned();
    for (stop, (to_x, to_y)) in STOPS.into_iter().enumerate() {
        for (camera, (x, y, _)) in CAMERAS.into_iter().enumerate() {
            let mut bearing = bearing(camera, stop);
            if camera == 3 {
                bearing = (bearing.to_radians().tan() / factor).atan().to_degrees();
            }
            let range = f64::hypot(to_x - x, to_y - y);
            writeln!(seen, "{},{},{bearing},0.05", stop + 1, camera + 1).unwrap();
            writeln!(ranges, "{},{},{range},0.05", stop + 1, camera + 1).unwrap();
        }
    }
    let visits = "stop,mark,sigma\n1,7,0.01\n6,9,0.01\n";
    let (seen, ranges) = (
        files.write("seen.csv", &seen),
        files.write("ranges.csv", &ranges),
    );
    let (legs, visits) = (
        files.write("legs.csv", &legs()),
        files.write("visits.csv", visits),
    );
    let all = [
        "solve-network",
        &seen,
        "--legs",
        &legs,
        "--displacement-sigma",
        "0.02",
        "--references",
        "1,2",
        "--baseline",
        "10",
        "--ranges",
        &ranges,
        "--visits",
        &visits,
        "--lens-sigma",
        "0.05",
    ];
    let done = run(&[&all[..], &["--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let solution = &lines(&done.stdout)[0];
    assert_eq!(solution["ranges"].as_array().unwrap().len(), 35);
    let camera = &solution["cameras"][3];
    assert_eq!(camera["checked"], true);
    assert!(number(&camera["redundancy"]) > 0.02);
    let lens = &camera["lens"];
    assert!((number(&lens["factor"]) - factor).abs() < 0.01, "{lens}");
    let other = number(&solution["cameras"][4]["lens"]["factor"]);
    assert!((other - 1.0).abs() < 0.01, "{other}");
    let pose = &camera["estimate"];
    assert!((number(&pose["x"]) + 1.0).abs() < 0.05, "{camera}");

    // Other contents of a file of JSON.
    let json = files.write(
        "all.json",
        &serde_json::json!({
            "references": {"cameras": [1, 2], "baseline": 10.0},
            "frame_heading_deg": 0.0,
            "bearings": [{"target": 1, "stop": 1, "camera": 1, "bearing_deg": 0.0, "sigma_deg": 0.1}],
            "legs": [{"target": 1, "stop": 2, "dx": 1.0, "dy": 0.0, "covariance": [1e-4, 0.0, 1e-4]}],
            "ranges": [{"target": 1, "stop": 1, "camera": 1, "range": 5.0, "sigma": 0.1}],
            "visits": [{"target": 1, "stop": 1, "mark": 1, "sigma": 0.1}],
            "lens": {"sigma": 0.02, "fov_deg": 45.0},
        })
        .to_string(),
    );
    assert_eq!(run(&["solve-network", &json]).code, 1);
}

/// The record of a run has all that is needed, with the truth to compare with.
#[test]
fn the_record_of_a_run_is_solved_again() {
    let files = Files::new();
    let (record, map) = (files.path("run.json"), files.path("map.svg"));
    let done = run(&["run", "lab", "--drift", "--json", &record]);
    assert_ne!(done.code, 2, "{}", done.stderr);
    let done = run(&["solve-network", &record, "--plot", &map]);
    assert_eq!(done.code, 0, "{}{}", done.stdout, done.stderr);
    assert!(done.stdout.contains("Errors of"), "{}", done.stdout);
    assert!(std::fs::read_to_string(&map).unwrap().contains("<svg"));
    // Its contents may stand in a file of their own, and options count more.
    let text = std::fs::read_to_string(&record).unwrap();
    let own: Value = serde_json::from_str(&text).unwrap();
    let own = files.write("own.json", &own["sightings"].to_string());
    let again = run(&["solve-network", &own, "--json"]);
    let first = run(&["solve-network", &record, "--json"]);
    assert_eq!(again.stdout, first.stdout);
    let doubled = run(&["solve-network", &own, "--json", "--baseline", "100"]);
    assert_ne!(doubled.stdout, first.stdout);
}

#[test]
fn what_is_wrong_with_a_file_is_said_with_its_line() {
    let files = Files::new();
    let good = files.write("bearings.csv", &bearings());
    let mut wrong = legs();
    wrong.push_str("7,1.0,2.0\n");
    let twice = files.write("twice.csv", &wrong);
    let words = files.write("words.csv", "stop,dx,dy,sigma\n2,1.0,north,0.1\n");
    let typing = files.write("typing.json", "{\n \"bearings\": [],\n \"leg\": []\n}\n");
    let none = files.write("none.csv", "stop,camera,bearing_deg\n1,door,3.0\n");
    let far = files.write("far.csv", "stop,camera,range,sigma\n1,1,0,0.1\n");
    let mark = files.write("mark.csv", "stop,mark,sigma\n1,1,0.1\n2,door,0.1\n");
    let bare = files.write("bare.csv", "stop,mark\n1,1\n");
    let wrong_range = "{\"bearings\": [],\n \"ranges\": [{\"target\": 1, \"stop\": 1}]}\n";
    let wrong_range = files.write("range.json", wrong_range);
    let minus = files.write(
        "minus.csv",
        "stop,camera,bearing_deg,sigma_deg\n1,1,3.0,-1\n",
    );
    let whose = files.write("whose.csv", "stop,camera,range,sigma\n99,1,3.0,0.1\n");
    let nobody = files.write("nobody.csv", "stop,camera,range,sigma\n2,7,3.0,0.1\n");
    let many = files.write("many.csv", "stop,camera,bearing_deg\n1,70000,3.0\n");
    let legs = files.write("legs.csv", &legs());
    let sigma = ["--displacement-sigma", "0.1"];
    for (arguments, expected) in [
        (
            vec![
                &good[..],
                "--legs",
                &twice,
                "--references",
                "1,2",
                sigma[0],
                sigma[1],
            ],
            "twice.csv:8: stop 7 of target 1 has a displacement already",
        ),
        (
            vec![&good[..], "--legs", &words, "--references", "1,2"],
            "words.csv:2: `dy` is \"north\"",
        ),
        (
            vec![&good[..], "--legs", &legs, "--references", "1,2"],
            "--displacement-sigma",
        ),
        (
            vec![&good[..], "--legs", &legs, sigma[0], sigma[1]],
            "--references",
        ),
        (
            vec![&good[..], "--references", "1,9"],
            "no bearing of camera 9",
        ),
        (
            vec![
                &good[..],
                "--legs",
                &legs,
                sigma[0],
                sigma[1],
                "--references",
                "1,9",
            ],
            "no bearing of camera 9",
        ),
        (
            vec![&good[..], "--ranges", &nobody],
            "has no bearing of camera 7, but a range of it at stop 2",
        ),
        (
            vec![&good[..], "--ranges", &whose],
            "a range or a visit is of stop 99 of target 1, which nothing else is of",
        ),
        (vec![&many[..]], "a whole number from 0 to 65535"),
        (vec![&typing[..]], "typing.json:3: "),
        (vec![&none[..]], "none.csv:2: `camera` is \"door\""),
        (vec![&minus[..]], "minus.csv:2: the sigma must be"),
        (
            vec![&good[..], "--ranges", &far],
            "far.csv:2: `range` must be finite and above 0",
        ),
        (
            vec![&good[..], "--visits", &mark],
            "mark.csv:3: `mark` is \"door\"",
        ),
        (vec![&good[..], "--visits", &bare], "no column `sigma`"),
        (vec![&wrong_range[..]], "range.json:2: "),
        (
            vec![&good[..], "--lens-sigma", "0.02"],
            "has a lens to estimate and no displacements",
        ),
        (vec![&good[..], "--lens-sigma", "0"], "--lens-sigma"),
        (vec!["nowhere.csv"], "nowhere.csv cannot be read"),
    ] {
        let done = run(&[&["solve-network"], &arguments[..]].concat());
        assert_eq!(done.code, 2, "{arguments:?}: {}", done.stdout);
        assert!(
            done.stderr.contains(expected),
            "{arguments:?}: {}",
            done.stderr
        );
    }
}
