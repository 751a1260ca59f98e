//! A failure of one result does not keep the others from being written.

use std::{
    fs,
    io::pipe,
    process::{Command, Stdio},
};

use super::sample::Sample;
use crate::common::{Files, as_shown, run};

/// The record of a run, with one camera that is not calibrated if wanted.
fn recorded(files: &Files, name: &str, blind: &'static [u16]) -> String {
    let record = Sample {
        blind,
        ..Sample::default()
    };
    files.write(name, &record.run().to_json(false).unwrap())
}

/// Without a terminal for a bar, each change of a camera is a line.
#[test]
fn without_a_terminal_progress_is_plain_lines() {
    let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["run", "lab"])
        .output()
        .unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    let cameras: Vec<(f64, u16, &str)> = told
        .lines()
        .map(|line| {
            let (seconds, rest) = line.trim_start().split_once(" s  camera ").unwrap();
            let (id, words) = rest.split_once(": ").unwrap();
            (seconds.parse().unwrap(), id.parse().unwrap(), words)
        })
        .collect();
    assert!(cameras.is_sorted_by(|a, b| a.0 <= b.0), "{told}");
    for id in 1..=7 {
        let of_it = cameras.iter().filter(|(_, camera, _)| *camera == id);
        let words: Vec<_> = of_it.map(|(.., words)| *words).collect();
        assert!((1..=6).contains(&words.len()), "{id}: {words:?}");
        let last = words.last().unwrap();
        assert!(last.starts_with("calibrated, "), "{id}: {words:?}");
    }
}

#[test]
fn the_page_about_results_shows_the_verdict_as_it_is_printed() {
    let page = include_str!("../../../../docs/run-results.md");
    let told = run(&["run", "thesis-13"]).stdout;
    let (_, verdict) = told.split_once('\n').unwrap();
    let (verdict, _) = verdict.split_once("\n\n").unwrap();
    assert!(page.contains(&as_shown(verdict)), "{verdict}");
}

/// A run may have taken ten minutes.
#[test]
#[cfg(target_os = "linux")]
fn a_result_that_cannot_be_written_keeps_nothing_else_from_being_there() {
    let files = Files::new();
    let [csv, plots] = ["poses.csv", "plots"].map(|name| files.path(name));
    let others = ["--csv", &csv, "--plots", &plots];
    for option in ["--json", "--yaml", "--ros"] {
        let arguments = [&["run", "lab", option, "/dev/full"][..], &others].concat();
        let done = run(&arguments);
        assert_eq!(done.code, 2, "{}", done.stderr);
        assert!(done.stdout.contains("lab, path 1"), "{}", done.stdout);
        assert!(
            done.stdout.contains("cameras are calibrated"),
            "{}",
            done.stdout
        );
        assert!(
            done.stderr
                .contains("/dev/full cannot be written: No space"),
            "{}",
            done.stderr
        );
        assert_eq!(done.stderr.lines().count(), 1, "{}", done.stderr);
        fs::remove_file(&csv).unwrap();
        fs::remove_dir_all(&plots).unwrap();
    }
}

#[test]
#[cfg(target_os = "linux")]
fn statistics_of_many_runs_come_before_their_files() {
    let files = Files::new();
    let one = recorded(&files, "one.json", &[]);
    let plot = files.path("sweep.svg");
    let outputs = ["--sweep-csv", "/dev/full", "--sweep-plot", &plot];
    for arguments in [
        &["report", "sweep", &one][..],
        &["sweep", "lab", "--seeds", "1..1"],
    ] {
        let done = run(&[arguments, &outputs].concat());
        assert_eq!(done.code, 2, "{}", done.stderr);
        assert!(done.stdout.contains("All runs together"), "{}", done.stdout);
        assert!(done.stderr.contains("/dev/full cannot be written"));
        fs::remove_file(&plot).unwrap();
    }
}

/// A disk that is full after the first block.
#[test]
#[cfg(unix)]
fn what_was_there_stays_until_the_new_result_is_complete() {
    let files = Files::new();
    let record = recorded(&files, "run.json", &[]);
    fs::create_dir(files.path("results")).unwrap();
    let json = files.write("results/again.json", "as it was");
    let script = format!(
        "trap '' XFSZ; ulimit -f 4; exec {} report run {record} --json {json}",
        env!("CARGO_BIN_EXE_host-sim")
    );
    let output = Command::new("bash").args(["-c", &script]).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("again.json cannot be written"), "{stderr}");
    assert!(fs::metadata(&record).unwrap().len() > 8 << 10);
    assert_eq!(fs::read_to_string(&json).unwrap(), "as it was");
    let left: Vec<_> = fs::read_dir(files.path("results")).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
}

#[test]
#[cfg(unix)]
fn links_and_permissions_stay() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let files = Files::new();
    let record = recorded(&files, "run.json", &[]);
    let real = files.write("real.csv", "as it was");
    fs::set_permissions(&real, fs::Permissions::from_mode(0o640)).unwrap();
    symlink("real.csv", files.path("link.csv")).unwrap();
    let link = files.path("link.csv");
    let done = run(&["report", "run", &record, "--csv", &link]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(fs::read_to_string(&real).unwrap().starts_with("camera,"));
    assert_eq!(
        fs::metadata(&real).unwrap().permissions().mode() & 0o777,
        0o640
    );
    // A new file has the usual permissions of any program.
    let new = files.path("new.csv");
    assert_eq!(run(&["report", "run", &record, "--csv", &new]).code, 0);
    let other = files.write("other", "");
    let mode = |path: &str| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&new), mode(&other));
}

#[test]
#[cfg(target_os = "linux")]
fn the_screen_is_a_place_for_results_too() {
    let files = Files::new();
    let record = recorded(&files, "run.json", &[]);
    let done = run(&["report", "run", &record, "--csv", "/dev/stdout"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(
        done.stdout.contains("camera,network,frame,reference"),
        "{}",
        done.stdout
    );
    assert!(
        done.stdout.contains("cameras are calibrated"),
        "{}",
        done.stdout
    );
}

/// The file that the output was sent to is not replaced, or the report would go with it.
#[test]
#[cfg(target_os = "linux")]
fn an_output_sent_to_a_file_gets_report_and_result() {
    let files = Files::new();
    let record = recorded(&files, "run.json", &[]);
    let all = files.path("all.txt");
    let status = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["report", "run", &record, "--csv", "/dev/stdout"])
        .stdout(fs::File::create(&all).unwrap())
        .status()
        .unwrap();
    assert!(status.success());
    let all = fs::read_to_string(&all).unwrap();
    let report = all.find("cameras are calibrated");
    let result = all.find("camera,network,frame,reference");
    assert!(report.is_some() && report < result, "{all}");
}

/// Exit code after the reader has gone, as with `| head`.
fn code_without_a_reader(arguments: &[&str]) -> i32 {
    let (reader, writer) = pipe().unwrap();
    drop(reader);
    let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(writer)
        .stderr(Stdio::piped())
        .output()
        .unwrap();
    output.status.code().unwrap()
}

#[test]
fn a_reader_that_has_gone_changes_no_exit_code() {
    let files = Files::new();
    let good = recorded(&files, "good.json", &[]);
    let bad = recorded(&files, "bad.json", &[4]);
    let stops = files.write(
        "stops.csv",
        "stop,bearing_0_rad,bearing_1_rad,dx,dy\n0,0.1,0.1,,\n1,0.1,0.2,0,0\n",
    );
    for (arguments, code) in [
        (&["report", "run", &good][..], 0),
        (&["report", "run", &bad], 1),
        (&["report", "run", &bad, "--csv", "/no/folder/a.csv"], 2),
        (&["report", "runs", &bad], 1),
        (&["report", "sweep", &bad], 1),
        (
            &["solve-reference", &stops, "--baseline", "10", "--json"],
            1,
        ),
    ] {
        assert_eq!(run(arguments).code, code, "{arguments:?}");
        assert_eq!(code_without_a_reader(arguments), code, "{arguments:?}");
    }
    let csv = files.path("poses.csv");
    code_without_a_reader(&["report", "run", &bad, "--csv", &csv]);
    assert!(fs::exists(&csv).unwrap());
}

/// Events of the whole site have no node: they stand in the log all the same.
#[test]
fn the_log_tells_what_befalls_the_whole_site() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let events = "
[[event]]
at_s = 1.0
action = { jam = { for_s = 0.5, channel = 15 } }
[[event]]
at_s = 2.0
action = { partition = { nodes = [1], for_s = 0.5 } }
[[event]]
at_s = 3.0
action = { loss = { share = 0.25, for_s = 0.5 } }
[[event]]
at_s = 4.0
action = { daylight = { level = 0.9, kelvin = 6000.0 } }
";
    let file = files.write("events.toml", &format!("{lab}{events}"));
    let log = files.path("log");
    let done = run(&["run", &file, "--log", &log]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let log = std::fs::read_to_string(&log).unwrap();
    for line in [
        "1.000000 site: channel 15 is jammed",
        "1.500000 site: channel 15 is jammed no more",
        "2.000000 site: some nodes and all others do not hear one another",
        "2.500000 site: all nodes can hear one another again",
        "3.000000 site: the radio loses 25 % more of the frames",
        "3.500000 site: the radio loses no more than usual",
        "4.000000 site: the light is 0.9 times as bright, of 6000 kelvin",
    ] {
        assert!(log.lines().any(|told| told == line), "{line}");
    }
}

/// The key, and the owner of every short address. Another test has tshark read it.
#[test]
fn a_capture_comes_with_what_decrypts_it() {
    let files = Files::new();
    let pcap = files.path("air.pcap");
    let done = run(&["run", "lab", "--pcap", &pcap]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let text = fs::read_to_string(format!("{pcap}.sh")).unwrap();
    assert!(text.contains("uat:ieee802154_keys:"), "{text}");
    // Nine nodes: a coordinator, seven cameras, a target.
    assert_eq!(text.matches("uat:802154_addresses:").count(), 9, "{text}");
}

/// A capture that does not go into a file leaves no script.
#[test]
#[cfg(target_os = "linux")]
fn a_capture_that_is_no_file_has_nothing_beside_it() {
    let files = Files::new();
    let link = files.path("air");
    std::os::unix::fs::symlink("/dev/null", &link).unwrap();
    assert_eq!(run(&["run", "lab", "--pcap", &link]).code, 0);
    assert!(!fs::exists(format!("{link}.sh")).unwrap());
}
