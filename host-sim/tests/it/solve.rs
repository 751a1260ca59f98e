//! `host-sim solve` as users run it.

use std::{
    io::Read,
    process::{Command, Stdio},
};

use crate::common::{Files, data, run, run_with_input};
use serde_json::{Value, json};

/// A camera at (1, 2) with heading 30 degrees; bearings in radians, from geometry by hand: the
/// world bearings of these targets are 0, 45 and 90 degrees.
const EXACT: [(f64, f64, f64); 3] = [(4.0, 2.0, -30.0), (3.0, 4.0, 15.0), (1.0, 5.0, 60.0)];

fn rows(case: &str) -> String {
    EXACT
        .map(|(x, y, degrees)| format!("{case},{x},{y},{}\n", degrees.to_radians()))
        .concat()
}

const HEADER: &str = "case,target_x,target_y,bearing_rad\n";

fn lines(json: &str) -> Vec<Value> {
    json.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// Case and status of every answer.
fn statuses(json: &str) -> Vec<(String, String)> {
    lines(json)
        .iter()
        .map(|line| {
            let text = |name: &str| line[name].as_str().unwrap().to_owned();
            (text("case"), text("status"))
        })
        .collect()
}

fn assert_near(value: &Value, expected: f64, tolerance: f64) {
    let value = value.as_f64().unwrap();
    assert!(
        (value - expected).abs() < tolerance,
        "{value} is not {expected}"
    );
}

#[test]
fn json_has_these_keys_in_this_order() {
    let files = Files::new();
    let file = files.write("s.csv", &format!("{HEADER}{}8,1,1,0\n", rows("7")));
    let done = run(&["solve", &file, "--bearing-sigma", "0.01", "--json"]);
    assert_eq!(done.code, 0);
    let (first, second) = done.stdout.split_once('\n').unwrap();
    let keys = [
        "case",
        "status",
        "reason",
        "x",
        "y",
        "heading_rad",
        "sigma_x",
        "sigma_y",
        "sigma_heading_rad",
        "sightings",
        "dropped",
        "chi_squared",
    ];
    let places: Vec<_> = keys.map(|key| first.find(&format!("\"{key}\":"))).to_vec();
    assert!(places.iter().all(Option::is_some) && places.is_sorted());
    let answer = &lines(first)[0];
    assert_eq!(answer.as_object().unwrap().len(), keys.len());
    assert_eq!(answer["case"], json!("7"));
    assert_near(&answer["x"], 1.0, 1e-9);
    assert_near(&answer["y"], 2.0, 1e-9);
    assert_near(&answer["heading_rad"], 30_f64.to_radians(), 1e-9);
    assert_eq!(
        second.trim_end(),
        "{\"case\":\"8\",\"status\":\"waiting\",\"reason\":\"too_few\",\"x\":null,\"y\":null,\"heading_rad\":null,\
         \"sigma_x\":null,\"sigma_y\":null,\"sigma_heading_rad\":null,\"sightings\":1,\"dropped\":0,\
         \"chi_squared\":null}"
    );
}

/// A target that stands still is seen in the same column again and again: that is no further measurement.
#[test]
fn rows_that_repeat_others_count_once() {
    let once = format!("{HEADER}{}", rows("7"));
    let often = format!("{HEADER}{}", rows("7").repeat(40));
    let [once, often] = [once, often].map(|input| {
        let done = run_with_input(&["solve", "-", "--json", "--bearing-sigma", "0.01"], &input);
        assert_eq!(done.code, 0);
        done
    });
    assert_eq!(once.stdout, often.stdout);
    assert!(!once.stderr.contains("repeat"), "{}", once.stderr);
    assert!(often.stderr.contains("117 rows repeat"), "{}", often.stderr);
    let rows = rows("7");
    let row = rows.lines().next().unwrap();
    let done = run_with_input(&["solve", "-"], &format!("{HEADER}{row}\n{row}\n{row}\n"));
    assert_eq!(done.code, 1);
    assert!(done.stderr.contains("waiting"), "{}", done.stderr);
}

#[test]
fn names_of_cases_are_text_whatever_the_others_are() {
    let input = format!("{HEADER}{}{}{}", rows("7"), rows("08"), rows("hall"));
    let done = run_with_input(&["solve", "-", "--json"], &input);
    let answers = lines(&done.stdout);
    assert_eq!(
        [0, 1, 2].map(|place| &answers[place]["case"]),
        [&json!("7"), &json!("08"), &json!("hall")]
    );
}

/// Three sightings always fit, so only the size of the numbers tells degrees from radians.
#[test]
fn degrees_are_not_taken_for_radians() {
    let in_degrees = |name: &str| {
        let header = HEADER.replace("bearing_rad", name);
        let rows = rows("7");
        let rows = rows.lines().map(|row| {
            let (before, bearing) = row.rsplit_once(',').unwrap();
            format!(
                "{before},{}\n",
                bearing.parse::<f64>().unwrap().to_degrees()
            )
        });
        format!("{header}{}", rows.collect::<String>())
    };
    let wrong = run_with_input(&["solve", "-"], &in_degrees("bearing_rad"));
    assert_eq!((wrong.code, &*wrong.stdout), (2, ""));
    assert!(
        wrong.stderr.contains("call the column `bearing_deg`"),
        "{}",
        wrong.stderr
    );
    let right = run_with_input(&["solve", "-", "--json"], &in_degrees("bearing_deg"));
    assert_eq!(right.code, 0, "{}", right.stderr);
    let answer = &lines(&right.stdout)[0];
    assert_near(&answer["x"], 1.0, 1e-9);
    assert_near(&answer["heading_rad"], 30_f64.to_radians(), 1e-9);
    // One bad bearing among many spoils its own case only.
    let many: String = (0..10).map(|case| rows(&case.to_string())).collect();
    let one = run_with_input(
        &["solve", "-", "--json"],
        &format!("{HEADER}{many}3,1,1,45\n"),
    );
    assert_eq!(one.code, 0);
    let unreadable = statuses(&one.stdout)
        .into_iter()
        .filter(|(_, status)| status == "refused");
    let unreadable: Vec<_> = unreadable.map(|(case, _)| case).collect();
    assert_eq!(unreadable, ["3"]);
    assert!(
        one.stderr.contains("more than a whole turn"),
        "{}",
        one.stderr
    );
}

#[test]
fn every_case_gets_its_answer_whatever_is_wrong_with_it() {
    let input = [
        HEADER,                                       // line 1
        &rows("good"),                                // 2 to 4
        "text,1,here,0.1\n",                          // 5
        &rows("text"),                                // 6 to 8
        "nan,1,NaN,0.1\n",                            // 9
        &rows("nan"),                                 // 10 to 12
        "inf,inf,1,0.1\n",                            // 13
        &rows("inf"),                                 // 14 to 16
        "two,1,2,0.1\ntwo,3,2,0\n",                   // 17, 18
        "same,1,2,0.1\nsame,1,2,0.2\nsame,5,5,0.3\n", // 19 to 21
        "short,1,2\n",                                // 22
        ",1,2,0.1\n",                                 // 23
        &rows("last"),                                // 24 to 26
    ]
    .concat();
    let files = Files::new();
    let file = files.write("s.csv", &input);
    let done = run(&["solve", &file, "--json"]);
    assert_eq!(done.code, 0);
    let expected = [
        ("good", "calibrated"),
        ("text", "refused"),
        ("nan", "refused"),
        ("inf", "refused"),
        ("two", "waiting"),
        ("same", "refused"),
        ("short", "refused"),
        ("last", "calibrated"),
    ];
    let expected = expected.map(|(case, status)| (case.to_owned(), status.to_owned()));
    assert_eq!(statuses(&done.stdout), expected);
    let answers = lines(&done.stdout);
    let reasons = answers.iter().map(|line| line["reason"].as_str());
    assert_eq!(
        reasons.collect::<Vec<_>>(),
        [
            None,
            Some("unreadable"),
            Some("not_finite"),
            Some("not_finite"),
            Some("too_few"),
            Some("coincident_targets"),
            Some("unreadable"),
            None
        ]
    );
    for (line, part) in [
        (5, "\"here\""),
        (9, "\"nan\" is refused"),
        (13, "\"inf\" is refused"),
        (22, "ends before `bearing_rad`"),
        (23, "`case`"),
    ] {
        let start = format!("{file}:{line}: ");
        let message = done.stderr.lines().find(|l| l.starts_with(&start));
        assert!(message.is_some_and(|m| m.contains(part)), "{}", done.stderr);
    }
    assert!(
        done.stderr.contains("8 cases: 2 calibrated, 2 refused"),
        "{}",
        done.stderr
    );

    // The table has the same cases in the same order.
    let table = run(&["solve", &file]).stdout;
    let cases: Vec<_> = table
        .lines()
        .skip(1)
        .filter_map(|l| l.split(' ').next())
        .collect();
    assert_eq!(cases, expected.map(|(case, _)| case));
}

#[test]
fn a_file_that_cannot_be_used_says_what_is_needed() {
    let files = Files::new();
    let unreadable = format!("{HEADER}1,a,b,c\n");
    for (content, part) in [
        ("", "first line must name the columns"),
        ("\n\n", "first line must name the columns"),
        (HEADER, "no rows"),
        ("1,2,3,0.1\n", "no column `case`"),
        ("case;target_x;target_y\n1;2;3\n", "separated by commas"),
        (
            "case,target_x,target_y\n1,2,3\n",
            "no column `bearing_rad`, `bearing_deg` or `column`",
        ),
        ("case,target_x,target_y,column\n1,2,3,4\n", "--fov-deg"),
        (
            "case,case,target_x,target_y,bearing_rad\n1,1,2,3,4\n",
            "`case` twice",
        ),
        (
            "case,target_x,target_y,bearing_rad\n,2,3,4\n",
            "no row with a case",
        ),
        (&unreadable, "`target_x` is \"a\""),
    ] {
        let file = files.write("s.csv", content);
        let done = run(&["solve", &file, "--json"]);
        assert_eq!(done.code, 2, "{content}");
        assert!(done.stderr.contains(part), "{content}: {}", done.stderr);
        assert!(done.stderr.contains(&file), "{}", done.stderr);
    }
    let nowhere = files.path("nowhere.csv");
    let done = run(&["solve", &nowhere]);
    assert_eq!((done.code, done.stdout.as_str()), (2, ""));
    assert!(done.stderr.contains(&nowhere));
}

#[test]
fn a_wrong_option_is_refused() {
    let files = Files::new();
    let file = files.write("s.csv", &format!("{HEADER}{}", rows("1")));
    for (options, part) in [
        (&["--bearing-sigma", "0"][..], "above 0"),
        (&["--bearing-sigma", "half"], "number"),
        (&["--target-sigma=-1"], "0 or a number above it"),
        (&["--max-sigma", "nan"], "above 0"),
        (&["--reject", "-3"], "--reject"),
        (&["--columns", "80"], "--fov-deg"),
        (&["--fov-deg", "60"], "no column `column`"),
        (&["--fov-deg", "180"], "below 180"),
        (&["--fov-deg", "60", "--columns", "1"], "two columns"),
        (&["--truth", "nowhere.csv"], "nowhere.csv"),
        (&["--nonsense"], "--nonsense"),
    ] {
        let done = run(&[&["solve", &file], options].concat());
        assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{options:?}");
        assert!(done.stderr.contains(part), "{options:?}: {}", done.stderr);
    }
}

#[test]
fn the_same_sightings_in_any_dress_give_the_same_answers() {
    let plain = run_with_input(
        &["solve", "-", "--json"],
        &format!("{HEADER}{}{}", rows("a"), rows("b")),
    );
    // Byte order mark, Windows line ends, other columns in another order, blanks, blank lines,
    // quotes, rows of two cases mixed.
    let mut dressed = "\u{feff}note, bearing_rad ,target_y, case,target_x\r\n\r\n".to_owned();
    for (x, y, degrees) in EXACT {
        for case in ["a", "\"b\""] {
            let bearing = degrees.to_radians();
            dressed += &format!("\"x, y\",{bearing},{y} ,{case}, {x}\r\n");
        }
    }
    dressed += "\r\n,,,,\r\n";
    let done = run_with_input(&["solve", "-", "--json"], &dressed);
    assert_eq!(done.stdout, plain.stdout);
    assert_eq!(lines(&plain.stdout).len(), 2);
}

#[test]
fn repeated_messages_are_counted() {
    let input = format!("{HEADER}{}{}", "1,a,b,c\n".repeat(50), rows("2"));
    let done = run_with_input(&["solve", "-", "--bearing-sigma", "0.01"], &input);
    assert_eq!(done.code, 0);
    assert_eq!(done.stderr.matches("a number belongs there").count(), 20);
    assert!(done.stderr.contains("30 more"), "{}", done.stderr);
}

#[test]
fn an_assumed_sigma_is_told_once_and_a_given_one_is_not() {
    let input = format!("{HEADER}{}{}", rows("1"), rows("2"));
    let told = run_with_input(&["solve", "-"], &input).stderr;
    assert_eq!(told.matches("0.0087").count(), 1);
    let untold = run_with_input(&["solve", "-", "--bearing-sigma", "0.0087"], &input).stderr;
    assert!(!untold.contains("0.0087"));
}

/// Appendix B of the thesis: a camera of 88 columns over 60 degrees sees column 67 at -17.3228
/// degrees and column 38 at 4.17509 degrees.
#[test]
fn pixel_columns_are_those_of_the_thesis() {
    let at = |degrees: f64, range: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        (range * cos, range * sin)
    };
    // A camera at the origin that looks along x.
    let sightings = [
        (at(-17.3228, 5.0), 67),
        (at(4.17509, 3.0), 38),
        (at(30.0, 4.0), 0),
    ];
    let mut input = "case,column,target_x,target_y\n".to_owned();
    for ((x, y), column) in sightings {
        input += &format!("3,{column},{x},{y}\n");
    }
    let done = run_with_input(&["solve", "-", "--fov-deg", "60", "--json"], &input);
    let answer = &lines(&done.stdout)[0];
    assert_near(&answer["x"], 0.0, 1e-4);
    assert_near(&answer["y"], 0.0, 1e-4);
    let heading = answer["heading_rad"].as_f64().unwrap();
    assert!(heading.sin().abs() < 1e-5 && heading.cos() > 0.0);
    assert!(!done.stderr.contains("assumed"), "{}", done.stderr);

    // The principal point moves every bearing.
    let moved = [
        "solve",
        "-",
        "--fov-deg",
        "60",
        "--principal",
        "42",
        "--json",
    ];
    let moved = &lines(&run_with_input(&moved, &input).stdout)[0];
    assert_ne!(moved["x"], answer["x"]);

    let outside = input.clone() + "3,88,1,1\n";
    let done = run_with_input(&["solve", "-", "--fov-deg", "60", "--json"], &outside);
    assert_eq!(done.code, 2);
    assert_eq!(lines(&done.stdout)[0]["reason"], "unreadable");
    assert!(done.stderr.contains("input:5: "), "{}", done.stderr);
    assert!(done.stderr.contains("from 0 to 87"), "{}", done.stderr);
}

#[test]
fn sigmas_in_the_file_scale_the_prediction() {
    let sigma = |options: &[&str], input: &str| {
        let done = run_with_input(&[&["solve", "-", "--json"], options].concat(), input);
        lines(&done.stdout)[0]["sigma_x"].as_f64().unwrap()
    };
    let plain = format!("{HEADER}{}", rows("1"));
    let with_column = plain
        .replace("bearing_rad\n", "bearing_rad,sigma_rad\n")
        .lines()
        .enumerate()
        .map(|(n, line)| format!("{line}{}\n", if n > 0 { ",0.02" } else { "" }))
        .collect::<String>();
    let once = sigma(&["--bearing-sigma", "0.01"], &plain);
    let twice = sigma(&["--bearing-sigma", "0.01"], &with_column);
    assert!((twice / once - 2.0).abs() < 1e-9);
    let blurred = sigma(
        &["--bearing-sigma", "0.01", "--target-sigma", "0.1"],
        &plain,
    );
    assert!(blurred > 2.0 * once);
}

#[test]
fn a_reader_that_has_seen_enough_ends_the_run_quietly() {
    let files = Files::new();
    let cases: String = (0..20_000).map(|case| rows(&case.to_string())).collect();
    let sightings = files.write("s.csv", &format!("{HEADER}{cases}"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["solve", &sightings, "--bearing-sigma", "0.01"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut start = [0; 100];
    child.stdout.take().unwrap().read_exact(&mut start).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "");
}

/// Truths put beside exact answers, so that the errors are known by hand.
#[test]
fn errors_and_coverage_are_those_computed_by_hand() {
    let files = Files::new();
    let cases: String = (1..=5).map(|case| rows(&case.to_string())).collect();
    let sightings = files.write("s.csv", &format!("{HEADER}{cases}9,1,1,1\n"));
    // Distances 0.1, 0.2, 0.3, 1.0; heading errors 1, 2, 3, 358 - 360 = -2 degrees; case 5 has no
    // truth; case 77 has no camera.
    let mut truth = "x,y,theta_rad,case\n".to_owned();
    for (case, dx, dy, degrees) in [
        (1, 0.1, 0.0, 31.0),
        (2, 0.0, -0.2, 28.0),
        (3, -0.3, 0.0, 33.0),
        (4, 0.6, 0.8, 388.0),
        (77, 9.0, 9.0, 0.0),
    ] {
        truth += &format!(
            "{},{},{},{case}\n",
            1.0 + dx,
            2.0 + dy,
            f64::to_radians(degrees)
        );
    }
    let truth = files.write("t.csv", &truth);
    let arguments = [
        "solve",
        &sightings,
        "--truth",
        &truth,
        "--bearing-sigma",
        "0.01",
    ];
    let done = run(&arguments);
    assert_eq!(done.code, 0);
    let row = |name: &str| -> Vec<f64> {
        let line = done.stdout.lines().find(|l| l.starts_with(name)).unwrap();
        let numbers = line[name.len()..].split_whitespace();
        numbers.filter_map(|word| word.parse().ok()).collect()
    };
    // Places 1.5, 2.7 and 2.97 among 0.1, 0.2, 0.3, 1.0; the mean square is 0.285.
    assert_eq!(row("position [m]"), [0.25, 0.79, 0.979, 0.534]);
    // Among 1, 2, 2, 3 degrees; the mean square is 4.5.
    assert_eq!(row("heading [deg]"), [2.0, 2.7, 2.97, 2.12]);

    let sigma = |key: &str| {
        let json = run(&[&arguments[..], &["--json"]].concat());
        lines(&json.stdout)[0][key].as_f64().unwrap()
    };
    let share = |errors: [f64; 4], sigma: f64| -> Vec<f64> {
        [1.0, 2.0, 3.0]
            .map(|n| 25.0 * errors.iter().filter(|&&e| e <= n * sigma).count() as f64)
            .to_vec()
    };
    assert_eq!(row("x "), share([0.1, 0.0, 0.3, 0.6], sigma("sigma_x")));
    assert_eq!(row("y "), share([0.0, 0.2, 0.0, 0.8], sigma("sigma_y")));
    assert!(
        done.stdout
            .contains("Errors of 4 answers (1 more have no truth to compare)")
    );
    assert!(
        done.stdout.contains("Kept 83.3 %: 5 of 6 cases"),
        "{}",
        done.stdout
    );

    let json = run(&[&arguments[..], &["--json"]].concat());
    assert_eq!(lines(&json.stdout).len(), 6);
    assert!(json.stderr.contains("Kept 83.3 %"));
}

#[test]
fn weak_answers_keep_their_values() {
    let input = format!("{HEADER}{}", rows("1"));
    let status = |limit: &str| {
        let options = [
            "solve",
            "-",
            "--json",
            "--bearing-sigma",
            "0.01",
            "--max-sigma",
            limit,
        ];
        lines(&run_with_input(&options, &input).stdout).remove(0)
    };
    let certain = status("10");
    assert_eq!(certain["status"], "calibrated");
    let sigma = |key: &str| certain[key].as_f64().unwrap();
    let predicted = sigma("sigma_x").hypot(sigma("sigma_y"));
    assert_eq!(
        status(&(predicted * 1.001).to_string())["status"],
        "calibrated"
    );
    let uncertain = status(&(predicted * 0.999).to_string());
    assert_eq!(uncertain["status"], "weak");
    assert_eq!(uncertain["x"], certain["x"]);
}

#[test]
fn the_planted_outlier_is_dropped() {
    let input = format!(
        "{HEADER}{}1,5,6,{}\n1,-1,4,{}\n1,7,1,2.5\n",
        rows("1"),
        15_f64.to_radians(),
        105_f64.to_radians()
    );
    let answer = |options: &[&str]| {
        let done = run_with_input(&[&["solve", "-", "--json"], options].concat(), &input);
        lines(&done.stdout).remove(0)
    };
    let robust = answer(&["--reject", "4"]);
    assert_eq!(
        (&robust["sightings"], &robust["dropped"]),
        (&json!(6), &json!(1))
    );
    assert_near(&robust["x"], 1.0, 1e-6);
    assert_near(&robust["heading_rad"], 30_f64.to_radians(), 1e-6);
    let trusting = answer(&[]);
    assert_eq!(trusting["dropped"], json!(0));
    assert_ne!(trusting["x"], robust["x"]);
}

#[test]
fn the_map_is_well_formed_and_shows_every_camera() {
    let files = Files::new();
    let sightings = data("mrclam/mrclam9_every5th_sightings.csv");
    let map = files.path("map.svg");
    let done = run(&["solve", &sightings, "--plot", &map, "--max-sigma", "0.5"]);
    assert_eq!(done.code, 0);
    let svg = std::fs::read_to_string(&map).unwrap();
    let svg = roxmltree::Document::parse(&svg).unwrap();
    let texts: Vec<_> = svg.descendants().filter_map(|node| node.text()).collect();
    for part in [
        "mrclam9_every5th_sightings.csv",
        "x [m]",
        "y [m]",
        "targets",
        "weak",
    ] {
        assert!(texts.iter().any(|text| text.contains(part)), "{part}");
    }
    let finite = svg.descendants().flat_map(|node| node.attributes());
    assert!(!finite.into_iter().any(|a| a.value().contains("NaN")));
    // One for each of the 363 poses, but those far outside.
    let ellipses = svg.descendants().filter(|n| n.has_tag_name("ellipse"));
    assert!(ellipses.count() > 300);
}

/// Most of a map's cameras are left out, and it says so.
#[test]
fn of_many_cameras_some_are_drawn() {
    let files = Files::new();
    let cases: String = (0..700).map(|case| rows(&case.to_string())).collect();
    let sightings = files.write("s.csv", &format!("{HEADER}{cases}"));
    let map = files.path("map.svg");
    assert_eq!(run(&["solve", &sightings, "--plot", &map]).code, 0);
    let svg = std::fs::read_to_string(&map).unwrap();
    assert!(svg.contains("500 of 700, evenly chosen"));
}

/// Real cameras: the solver has to be as good as the published least-squares rows.
#[test]
fn real_cameras_are_as_accurate_as_published_methods() {
    for (name, median, heading) in [
        ("mrclam/mrclam1_every30th", 0.050, 0.42),
        ("mrclam/mrclam9_every5th", 0.080, 1.30),
        ("roh/roh_x1.5_y1.5", 0.083, 0.70),
    ] {
        let [sightings, truth] =
            ["sightings", "truth"].map(|kind| data(&format!("{name}_{kind}.csv")));
        let done = run(&[
            "solve",
            &sightings,
            "--truth",
            &truth,
            "--bearing-sigma",
            "0.0086",
        ]);
        assert_eq!(done.code, 0);
        let first = |row: &str| -> f64 {
            let line = done.stdout.lines().find(|l| l.starts_with(row)).unwrap();
            let mut words = line[row.len()..].split_whitespace();
            words.next().unwrap().parse().unwrap()
        };
        assert!(first("position [m]") <= median, "{name}");
        assert!(first("heading [deg]") <= heading, "{name}");
    }
}

/// One of four sightings is half a radian off: no pose fits them, and predicted sigmas do not know.
#[test]
fn sightings_that_contradict_each_other_are_called_so() {
    let fourth = |off: f64| format!("1,5,6,{}\n", 15_f64.to_radians() + off);
    let solve = |off: f64, options: &[&str]| {
        let input = format!("{HEADER}{}{}", rows("1"), fourth(off));
        let usual = ["solve", "-", "--bearing-sigma", "0.01"];
        run_with_input(&[&usual, options].concat(), &input)
    };
    let wrong = solve(0.5, &["--json"]);
    assert_eq!(wrong.code, 1, "nothing to rely on");
    let answer = &lines(&wrong.stdout)[0];
    assert_eq!(answer["status"], "doubtful");
    assert_eq!(answer["reason"], "contradictory");
    assert!(answer["chi_squared"].as_f64().unwrap() > 10.8);
    assert!(answer["x"].is_number(), "the pose is given all the same");
    for part in ["1 case: 1 doubtful", "contradict each other", "--reject"] {
        assert!(wrong.stderr.contains(part), "{part}: {}", wrong.stderr);
    }
    let table = solve(0.5, &[]).stdout;
    assert!(
        table.lines().next().unwrap().contains("chi squared"),
        "{table}"
    );
    assert!(table.contains("doubtful"), "{table}");
    let chi_squared = format!("{:.1}", answer["chi_squared"].as_f64().unwrap());
    assert!(table.contains(&chi_squared), "{chi_squared}: {table}");

    let right = solve(0.005, &["--json"]);
    assert_eq!(lines(&right.stdout)[0]["status"], "calibrated");
    assert!(!right.stderr.contains("contradict"), "{}", right.stderr);
}

/// A camera at the origin near the circle through its three targets. Noise puts its pose 4.4 units
/// off, right beside one of them, with a sigma of 0.17.
#[test]
fn a_pose_that_another_place_would_do_for_is_ambiguous() {
    let files = Files::new();
    let rows = "1,3.277,-0.846,-0.2451\n1,3.961,1.817,0.4217\n1,4.017,1.684,0.4001\n";
    let sightings = files.write("s.csv", &format!("{HEADER}{rows}"));
    let truth = files.write("t.csv", "case,x,y,theta_rad\n1,0,0,0\n");
    let arguments = ["solve", &sightings, "--bearing-sigma", "0.0069", "--json"];
    let done = run(&arguments);
    assert_eq!(done.code, 1, "{}", done.stderr);
    let answer = &lines(&done.stdout)[0];
    assert_eq!(answer["status"], "doubtful");
    assert_eq!(answer["reason"], "ambiguous");
    assert!(answer["sigma_x"].as_f64().unwrap() < 0.2);
    for part in ["doubtful: ambiguous", "stop the target once more", "1: ("] {
        assert!(done.stderr.contains(part), "{part}: {}", done.stderr);
    }
    // The sightings refute its sigmas: it is not kept.
    let compared = [&arguments[..4], &["--truth", &truth]].concat();
    let done = run(&compared);
    assert!(done.stdout.contains("Kept 0.0 %"), "{}", done.stdout);
}

/// An answer is kept if it is certain enough: whether sigmas were right is another question.
#[test]
fn doubtful_answers_are_compared_with_the_truth_too() {
    let files = Files::new();
    let fourth = format!("1,5,6,{}\n", 15_f64.to_radians() + 0.5);
    let sightings = files.write("s.csv", &format!("{HEADER}{}{fourth}", rows("1")));
    let truth = files.write("t.csv", "case,x,y,theta_rad\n1,1,2,0.5\n");
    let done = run(&["solve", &sightings, "--truth", &truth]);
    assert!(done.stdout.contains("doubtful"), "{}", done.stdout);
    assert!(
        done.stdout.contains("Kept 100.0 %: 1 of 1 cases"),
        "{}",
        done.stdout
    );
}

#[test]
fn a_map_that_cannot_be_written_is_found_before_solving() {
    let files = Files::new();
    let sightings = files.write("s.csv", &format!("{HEADER}{}", rows("1")));
    let nowhere = files.path("no/folder/map.svg");
    let done = run(&["solve", &sightings, "--plot", &nowhere]);
    assert_eq!(
        (done.code, done.stdout.as_str()),
        (2, ""),
        "{}",
        done.stderr
    );
    assert!(
        done.stderr.contains("there is no folder"),
        "{}",
        done.stderr
    );
}

#[test]
#[cfg(target_os = "linux")]
fn a_map_that_fails_hides_nothing() {
    let files = Files::new();
    let sightings = files.write("s.csv", &format!("{HEADER}{}", rows("1")));
    let done = run(&["solve", &sightings, "--plot", "/dev/full"]);
    assert_eq!(done.code, 2);
    assert!(
        done.stderr.contains("1 case: 1 calibrated"),
        "{}",
        done.stderr
    );
    assert!(
        done.stderr.contains("/dev/full cannot be written"),
        "{}",
        done.stderr
    );
}

#[test]
fn a_column_that_is_passed_over_is_told() {
    let with_column = |line: &str| match line {
        "" => String::new(),
        line if line.starts_with("case") => format!("{line},column\n"),
        line => format!("{line},40\n"),
    };
    let text = format!("{HEADER}{}", rows("1"));
    let both: String = text.lines().map(with_column).collect();
    let bearings = run_with_input(&["solve", "-"], &both).stderr;
    assert!(bearings.contains("`column` is not used"), "{bearings}");
    let columns = run_with_input(&["solve", "-", "--fov-deg", "60"], &both).stderr;
    assert!(columns.contains("`bearing_rad` is not used"), "{columns}");
    let one = run_with_input(&["solve", "-"], &text).stderr;
    assert!(!one.contains("not used"), "{one}");
}

#[test]
fn the_help_names_no_unit() {
    let help = run(&["solve", "--help"]).stdout;
    assert!(help.contains("--max-sigma <LENGTH>"), "{help}");
}

/// Columns of three cameras whose lens has 47 degrees over 160 columns, rounded to whole ones.
fn columns_of_47_degrees() -> String {
    let mut text = "case,target_x,target_y,column\n".to_owned();
    let focal_length = 79.5 / 23.5_f64.to_radians().tan();
    for (case, heading, first) in [
        ("a", 0.3_f64, -0.38),
        ("b", 1.2, -0.395),
        ("c", -2.0, -0.367),
    ] {
        for n in 0..9 {
            let range = 2.0 + f64::from(n * 5 % 7);
            let bearing: f64 = first + 0.0949 * f64::from(n);
            let (x, y) = (
                range * (heading + bearing).cos(),
                range * (heading + bearing).sin(),
            );
            let column = (79.5 - focal_length * bearing.tan()).round();
            text += &format!("{case},{x},{y},{column}\n");
        }
    }
    text
}

/// Taken for 45 degrees, the lens is found and named; taken for 47, nothing is said.
#[test]
fn a_lens_of_another_field_of_view_is_named() {
    let solve = |degrees: &str| {
        let lens = ["--columns", "160", "--fov-deg", degrees];
        run_with_input(
            &[&["solve", "-"], &lens[..]].concat(),
            &columns_of_47_degrees(),
        )
    };
    let wrong = solve("45");
    assert_eq!(wrong.code, 1, "{}", wrong.stderr);
    let (_, fits) = wrong.stderr.split_once("the field of view fits ").unwrap();
    let view: f64 = fits.split(' ').next().unwrap().parse().unwrap();
    assert!((view - 47.0).abs() < 0.25, "{}", wrong.stderr);
    assert!(wrong.stderr.contains("configured 45 "), "{}", wrong.stderr);
    assert!(
        !wrong.stderr.contains("with --projection"),
        "{}",
        wrong.stderr
    );
    let right = solve("47");
    assert_eq!(right.code, 0, "{}", right.stderr);
    assert!(!right.stderr.contains("lens:"), "{}", right.stderr);
}

/// Whatever lens is told, it is the one of 60 degrees that is found, also from one case.
#[test]
fn a_lens_is_found_from_afar() {
    // A camera at (1, 2) with a heading of 30 degrees and 88 columns.
    let csv = "case,target_x,target_y,column\na,4,2.5,71.7\na,5,5,34.4\na,3,4.5,14.1\na,6,3.2,65.8\na,4.5,3.8,47.2\n\
               a,5.5,6,28.0\n";
    for told in ["30", "40", "50", "70", "90", "120"] {
        let done = run_with_input(&["solve", "-", "--fov-deg", told], csv);
        assert_eq!(done.code, 1, "{told}: {}", done.stderr);
        let words = "lens: the field of view fits 60.0 +/- ";
        assert!(done.stderr.contains(words), "{told}: {}", done.stderr);
        assert!(!done.stderr.contains("equal-angle"), "{}", done.stderr);
    }
    let right = run_with_input(&["solve", "-", "--fov-deg", "60"], csv);
    assert!(right.code == 0 && !right.stderr.contains("lens:"));
}

/// Places from a plan whose y axis runs downwards. A lens that does not fit either is not named.
#[test]
fn a_mirrored_plan_is_named() {
    let places = [
        (4.0, 3.0),
        (5.0, 6.0),
        (3.0, 5.5),
        (6.0, 4.5),
        (4.5, 7.0),
        (2.5, 2.6),
    ];
    // A pin-hole of 60 degrees and 88 columns.
    let focal_length = 43.5 / 30_f64.to_radians().tan();
    let table = |mirror: f64| {
        let mut csv = "case,target_x,target_y,column\n".to_owned();
        for (case, x, y, heading) in [(1, 0.0, 0.0, 0.7), (2, 8.0, 1.0, 2.4)] {
            for (px, py) in places {
                let bearing: f64 = f64::atan2(py - y, px - x) - heading;
                let column = (43.5 - focal_length * bearing.tan()).round();
                csv += &format!("{case},{px},{},{column}\n", mirror * py);
            }
        }
        csv
    };
    let solve = |mirror| run_with_input(&["solve", "-", "--fov-deg", "60"], &table(mirror));
    let right = solve(1.0);
    assert_eq!(right.code, 0, "{}", right.stderr);
    let mirrored = solve(-1.0);
    assert_eq!(mirrored.code, 1, "{}", mirrored.stderr);
    let told = &mirrored.stderr;
    assert!(told.contains("  mirrored: "), "{told}");
    assert!(!told.contains("lens:"), "{told}");
}

/// Stage's blob finder sees equal angles.
#[test]
fn a_lens_of_another_projection_is_named() {
    let blobs = data("stage13/seed1_sightings.csv");
    let solve = |options: &[&str]| run(&[&["solve", &blobs], options].concat());
    let wrong = solve(&["--fov-deg", "60"]);
    assert_eq!(wrong.code, 1, "{}", wrong.stderr);
    for part in [
        "--projection equal-angle, configured pinhole",
        "the field of view fits",
    ] {
        assert!(wrong.stderr.contains(part), "{part}: {}", wrong.stderr);
    }
    let right = solve(&["--fov-deg", "60", "--projection", "equal-angle"]);
    assert_eq!(right.code, 0, "{}", right.stderr);
    assert!(!right.stderr.contains("lens:"), "{}", right.stderr);
}

/// A file is read case by case if the rows of each case follow one another. It is read as a whole if they do
/// not, or if a question concerns all cases together. The user sees no difference. Nor does it matter where
/// the rows come from.
#[test]
fn answers_do_not_depend_on_the_order_of_rows_or_on_where_they_come_from() {
    let files = Files::new();
    let names = ["b", "the longest name", "a", "c"];
    let spoilt = |case: &str| rows(case).replacen("3,4", "3,four", 1);
    let told: Vec<String> = { names.iter() }
        .map(|case| match *case {
            "a" => spoilt(case),
            _ => rows(case),
        })
        .collect();
    let together = format!("{HEADER}{}", told.concat());
    let mixed: String = (0..3)
        .flat_map(|row| told.iter().map(move |rows| rows.lines().nth(row).unwrap()))
        .map(|row| format!("{row}\n"))
        .collect();
    let mixed = format!("{HEADER}{mixed}");
    for options in [&[][..], &["--json"]] {
        let mut answers = Vec::new();
        for (name, text) in [("together.csv", &together), ("mixed.csv", &mixed)] {
            let file = files.write(name, text);
            let map = file.replace(".csv", ".svg");
            let usual = |file: &str, more: &[&str]| {
                let arguments = ["solve", file, "--bearing-sigma", "0.01"];
                let arguments = [&arguments[..], options, more].concat();
                match file {
                    "-" => run_with_input(&arguments, text),
                    _ => run(&arguments),
                }
            };
            // A drawing needs all cases at once.
            for done in [
                usual(&file, &[]),
                usual("-", &[]),
                usual(&file, &["--plot", &map]),
            ] {
                assert_eq!(done.code, 0, "{}", done.stderr);
                // The line is that of the file.
                let line = text.lines().position(|line| line.contains("four")).unwrap() + 1;
                assert!(
                    done.stderr.contains(&format!(":{line}: `target_y`")),
                    "{}",
                    done.stderr
                );
                assert!(
                    done.stderr.contains("4 cases: 3 calibrated, 1 refused"),
                    "{}",
                    done.stderr
                );
                answers.push(done.stdout);
            }
        }
        assert!(
            answers.iter().all(|other| *other == answers[0]),
            "{answers:#?}"
        );
        if !options.is_empty() {
            let order: Vec<_> = { statuses(&answers[0]).into_iter() }
                .map(|(case, _)| case)
                .collect();
            assert_eq!(order, names);
        }
    }
}
