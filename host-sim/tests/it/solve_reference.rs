//! `host-sim solve-reference` as users run it.

use std::collections::BTreeMap;

use crate::common::{Files, data, run, run_with_input};
use serde_json::Value;

/// Cameras at (0, 0) and (10, 0), headings 45 and 135 degrees; the target stops at (5, 5), (5, 3)
/// and (7, 4). Bearings are the world's minus the heading.
fn exact() -> String {
    let mut text = "stop,bearing_0_rad,bearing_1_rad,dx,dy\n".to_owned();
    let mut last: Option<(f64, f64)> = None;
    for (name, (x, y)) in [
        ("door", (5.0, 5.0)),
        ("sofa", (5.0, 3.0)),
        ("lamp", (7.0, 4.0)),
    ] {
        let bearing = |from: f64, heading: f64| f64::atan2(y, x - from) - heading.to_radians();
        let moved = last.map_or(String::from(","), |(a, b)| format!("{},{}", x - a, y - b));
        text += &format!(
            "{name},{},{},{moved}\n",
            bearing(0.0, 45.0),
            bearing(10.0, 135.0)
        );
        last = Some((x, y));
    }
    text
}

fn solve(options: &[&str], input: &str) -> Value {
    let done = run_with_input(
        &[&["solve-reference", "-", "--json"], options].concat(),
        input,
    );
    assert_eq!(done.code, 0, "{}", done.stderr);
    serde_json::from_str(&done.stdout).unwrap()
}

fn degrees(value: &Value) -> f64 {
    value.as_f64().unwrap().to_degrees()
}

#[test]
fn exact_bearings_give_the_exact_answer_whatever_is_unknown_and_by_every_method() {
    let unknowns: [&[&str]; 4] = [
        &["--baseline", "10"],
        &["--baseline", "unknown"],
        &["--baseline", "10", "--frame-heading-deg", "unknown"],
        &["--baseline", "unknown", "--frame-heading-deg", "unknown"],
    ];
    for known in unknowns {
        for method in ["levenberg", "gauss-newton", "steepest-descent"] {
            let line = solve(&[known, &["--method", method]].concat(), &exact());
            let best = &line["best"];
            assert!((degrees(&best["heading_0_rad"]) - 45.0).abs() < 1e-6);
            assert!((degrees(&best["heading_1_rad"]) - 135.0).abs() < 1e-6);
            assert!((best["baseline"].as_f64().unwrap() - 10.0).abs() < 1e-6);
            let lamp = &best["stops"][2];
            assert_eq!(lamp["stop"], "lamp");
            assert!((lamp["x"].as_f64().unwrap() - 7.0).abs() < 1e-6);
            assert!((lamp["y"].as_f64().unwrap() - 4.0).abs() < 1e-6);
        }
    }
}

#[test]
fn displacements_may_be_measured_in_a_turned_frame() {
    // A quarter turn: a displacement x against the baseline was measured as -y.
    let turned: String = exact()
        .lines()
        .map(|line| {
            let mut cells: Vec<_> = line.split(',').map(str::to_owned).collect();
            if let (Ok(dx), Ok(dy)) = (cells[3].parse::<f64>(), cells[4].parse::<f64>()) {
                (cells[3], cells[4]) = (dy.to_string(), (-dx).to_string());
            }
            cells.join(",") + "\n"
        })
        .collect();
    for heading in ["90", "-270", "unknown"] {
        let line = solve(
            &["--baseline", "10", "--frame-heading-deg", heading],
            &turned,
        );
        assert!((degrees(&line["best"]["heading_0_rad"]) - 45.0).abs() < 1e-6);
        assert!((degrees(&line["best"]["frame_heading_rad"]) - 90.0).abs() < 1e-6);
    }
}

#[test]
fn json_has_these_keys() {
    let line = solve(&["--baseline", "10"], &exact());
    let keys =
        |value: &Value| -> Vec<String> { value.as_object().unwrap().keys().cloned().collect() };
    // In alphabetical order, as the reader keeps them.
    assert_eq!(
        keys(&line),
        ["alternative", "best", "candidates", "reason", "status"]
    );
    assert_eq!(
        keys(&line["best"]),
        [
            "baseline",
            "chi_squared",
            "condition",
            "degrees_of_freedom",
            "frame_heading_rad",
            "heading_0_rad",
            "heading_1_rad",
            "iterations",
            "sigma_baseline",
            "sigma_frame_heading_rad",
            "sigma_heading_0_rad",
            "sigma_heading_1_rad",
            "stops"
        ]
    );
    assert_eq!(
        keys(&line["best"]["stops"][0]),
        ["sigma_x", "sigma_y", "stop", "x", "y"]
    );
    assert_eq!(line["status"], "calibrated");
}

#[test]
fn the_text_says_how_sure_everything_is() {
    let done = run_with_input(&["solve-reference", "-", "--baseline", "10"], &exact());
    assert_eq!(done.code, 0);
    for part in [
        "camera 0 heading",
        "45.00 +/- ",
        "135.00 +/- ",
        "stop sofa",
        "candidates: ",
    ] {
        assert!(done.stdout.contains(part), "{part}: {}", done.stdout);
    }
    let baseline = done.stdout.lines().find(|l| l.starts_with("baseline"));
    assert!(baseline.is_some_and(|l| l.contains("10.000 given")));
}

/// Blobs of the real Stage; its reference cameras look along 45 and 145 degrees.
#[test]
fn stage_blobs_give_the_headings_within_a_degree() {
    let blobs = std::fs::read_to_string(data("stage13/blobs_seed1.csv")).unwrap();
    let mut stops: BTreeMap<u32, (f64, f64, [f64; 2])> = BTreeMap::new();
    for line in blobs.lines().skip(1) {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        let [stop, x, y, node, left, right, ..] = cells[..] else {
            panic!("{line}");
        };
        if stop < 3.0 && node < 3.0 {
            let entry = stops.entry(stop as u32).or_insert((x, y, [f64::NAN; 2]));
            entry.2[node as usize - 1] = (left + right) / 2.0;
        }
    }
    let mut input = "stop,column_0,column_1,dx,dy\n".to_owned();
    let mut last = stops[&0];
    for (stop, &(x, y, [column_0, column_1])) in &stops {
        input += &format!(
            "{stop},{column_0},{column_1},{},{}\n",
            x - last.0,
            y - last.1
        );
        last = (x, y, [0.0; 2]);
    }
    let camera = ["--fov-deg", "60", "--projection", "equal-angle"];
    let line = solve(&[&["--baseline", "10"], &camera[..]].concat(), &input);
    let best = &line["best"];
    assert!((degrees(&best["heading_0_rad"]) - 45.0).abs() < 1.0);
    assert!((degrees(&best["heading_1_rad"]) - 145.0).abs() < 1.0);
}

#[test]
fn two_stops_may_leave_two_answers_and_then_both_are_shown() {
    // Two stops of the Stage blobs that leave both circles' intersections possible.
    let input = "stop,column_0,column_1,dx,dy\n0,45.5,35.5,,\n1,61.5,49.5,1.878,0.0507\n";
    let arguments = [
        "solve-reference",
        "-",
        "--baseline",
        "10",
        "--fov-deg",
        "60",
        "--projection",
        "equal-angle",
        "--json",
    ];
    let done = run_with_input(&arguments, input);
    assert_eq!(done.code, 1, "neither can be relied on");
    assert!(done.stderr.contains("one more place"), "{}", done.stderr);
    let line: Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!(
        (&line["status"], &line["reason"]),
        (&"doubtful".into(), &"ambiguous".into())
    );
    assert_eq!(line["candidates"], 2);
    assert!(line["alternative"]["heading_0_rad"].is_number());
}

#[test]
fn what_was_read_but_has_no_answer_exits_with_one() {
    let two = exact().lines().take(3).collect::<Vec<_>>().join("\n");
    let arguments = ["solve-reference", "-", "--baseline", "unknown", "--json"];
    let done = run_with_input(&arguments, &two);
    assert_eq!(done.code, 1);
    let line: Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!(
        (&line["status"], &line["reason"]),
        (&"waiting".into(), &"too_few".into())
    );
    assert!(line["best"].is_null());
    assert!(done.stderr.contains("more places"), "{}", done.stderr);
}

#[test]
fn bad_input_names_its_line_and_exits_with_two() {
    let files = Files::new();
    let header = "stop,bearing_0_rad,bearing_1_rad,dx,dy\n";
    for (content, part) in [
        (String::new(), "first line must name the columns"),
        (header.to_owned(), "no rows"),
        (
            "stop,dx,dy\n1,2,3\n".to_owned(),
            "`bearing_0_rad`, `bearing_0_deg` or `column_0`",
        ),
        (
            "stop,column_0,column_1,dx,dy\n1,2,3,4,5\n".to_owned(),
            "--fov-deg",
        ),
        (
            format!("{header}0,0.1,0.2,,\n1,0.1,0.2,,1\n"),
            "s.csv:3: `dx` is empty",
        ),
        (
            format!("{header}0,0.1,0.2,,\n\n1,x,0.2,1,1\n"),
            "s.csv:4: `bearing_0_rad` is \"x\"",
        ),
        (format!("{header}0,0.1\n"), "s.csv:2: the row ends before"),
    ] {
        let file = files.write("s.csv", &content);
        let done = run(&["solve-reference", &file, "--baseline", "10"]);
        assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{content}");
        assert!(done.stderr.contains(part), "{content}: {}", done.stderr);
    }
    let file = files.write("s.csv", &exact());
    for options in [&[][..], &["--baseline", "0"], &["--baseline", "long"]] {
        assert_eq!(
            run(&[&["solve-reference", &file], options].concat()).code,
            2
        );
    }
}

fn contradictory(options: &[&str], input: &str) -> Value {
    let done = run_with_input(
        &[&["solve-reference", "-", "--json"], options].concat(),
        input,
    );
    assert_eq!(done.code, 1, "{}", done.stderr);
    assert!(
        done.stderr.contains("contradict each other"),
        "{}",
        done.stderr
    );
    let line: Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!(
        (&line["status"], &line["reason"]),
        (&"doubtful".into(), &"contradictory".into())
    );
    assert!(line["best"]["heading_0_rad"].is_number());
    line
}

/// Two stops and everything known leave no freedom, but may still not fit.
#[test]
fn stops_that_contradict_what_is_known_are_called_so() {
    let sure = ["--bearing-sigma", "0.0087", "--displacement-sigma", "0.01"];
    let line = contradictory(&[&["--baseline", "14"], &sure[..]].concat(), &exact());
    assert!(line["best"]["chi_squared"].as_f64().unwrap() > 13.8);
    assert_eq!(line["best"]["degrees_of_freedom"], 2);

    let text = [&["solve-reference", "-", "--baseline", "14"], &sure[..]].concat();
    let text = run_with_input(&text, &exact());
    assert!(text.stdout.contains("chi squared"), "{}", text.stdout);
    assert!(text.stdout.contains("contradictory"), "{}", text.stdout);

    let two: String = exact().lines().take(3).map(|l| format!("{l}\n")).collect();
    // Away from the cameras instead of towards them.
    let wrong = two.replace("0,-2\n", "0,2\n");
    assert_ne!(two, wrong);
    let line = contradictory(&[&["--baseline", "10"], &sure[..]].concat(), &wrong);
    assert!(line["best"]["chi_squared"].as_f64().unwrap() > 10.8);
    assert_eq!(line["best"]["degrees_of_freedom"], 0);

    let fits = solve(&[&["--baseline", "10"], &sure[..]].concat(), &exact());
    assert_eq!(fits["status"], "calibrated");
}

#[test]
fn a_column_that_is_passed_over_is_told() {
    let both: String = exact()
        .lines()
        .map(|line| {
            let more = if line.starts_with("stop") {
                "column_0,column_1"
            } else {
                "40,41"
            };
            format!("{line},{more}\n")
        })
        .collect();
    let done = run_with_input(&["solve-reference", "-", "--baseline", "10"], &both);
    assert!(
        done.stderr.contains("`column_0` is not used"),
        "{}",
        done.stderr
    );
}
