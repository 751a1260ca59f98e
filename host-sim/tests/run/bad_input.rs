//! What is wrong on the command line or in a file is told at once, with what to do, and changes
//! nothing.

use std::fs;

use host_sim::record::RunRecord;

use crate::{
    common::{Files, run},
    sample::Sample,
};

/// The message, which is short and tells everything once.
fn refused(arguments: &[&str], expected: &str) -> String {
    let done = run(arguments);
    let what = format!("{arguments:?}: {}", done.stderr);
    assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{what}");
    assert!(done.stderr.contains(expected), "{what}");
    assert!(!done.stderr.contains("panicked"), "{what}");
    done.stderr
}

#[test]
fn options_out_of_their_range() {
    for (arguments, expected) in [
        (&["run", "lab", "--path", "0"][..], "1 to 1000000000"),
        (&["run", "lab", "--path", "-3"], "1 to 1000000000"),
        (
            &["run", "lab", "--stops", "0"],
            "`stops` is 0: it must be 3 to 100",
        ),
        (
            &["run", "lab", "--stops", "-1"],
            "invalid value '-1' for '--stops",
        ),
        (
            &["run", "grid", "--nodes", "0"],
            "`grid.nodes` is 0: it must be 2 to 20000",
        ),
        (
            &["run", "grid", "--nodes", "1"],
            "`grid.nodes` is 1: it must be 2 to 20000",
        ),
        (
            &["run", "grid", "--nodes", "20001"],
            "it must be 2 to 20000",
        ),
        (
            &["run", "lab", "--nodes", "5"],
            "only scenarios with a `grid`",
        ),
        (&["run", "lab", "--loss", "nan"], "from 0 to 1"),
        (&["run", "lab", "--loss", "-0.1"], "from 0 to 1"),
        (&["run", "lab", "--speed", "infx"], "such as 10x"),
        (
            &["run", "lab", "--seed", "-1"],
            "invalid value '-1' for '--seed",
        ),
        (&["run", "lab", "--board-timeout", "0"], "above 0"),
        (&["run", "lab", "--board-timeout", "1e30"], "fewer seconds"),
        (
            &["run", "lab", "--board-timeout", "5"],
            "say `--backend qemu`",
        ),
        (
            &["run", "lab", "--port", "3=/x", "--port", "3=/y"],
            "two ports",
        ),
        (&["run", "thesis"], "there are thesis-13, lab, grid"),
        (&["sweep", "lab", "--seeds", "5..1"], "such as 1..50"),
        (
            &["sweep", "lab", "--seeds", "0..18446744073709551615"],
            "at most 100000",
        ),
        (
            &["sweep", "lab", "--seeds", "1..2", "--paths", "0"],
            "1 to 1000000000",
        ),
    ] {
        refused(arguments, expected);
    }
}

#[test]
fn files_that_are_no_scenarios() {
    let files = Files::new();
    let lab = include_str!("../../scenarios/lab.toml");
    for (content, expected) in [
        (&b""[..], "missing field `name`"),
        (&lab.as_bytes()[..lab.len() / 2], "bad.toml: "),
        (b"\xff\xfe", "valid UTF-8"),
        (b"name = \"x\"\nnmae = 3", "unknown field `nmae`"),
        (b"name = \"x\"\nseed = -1", "invalid value: integer `-1`"),
        (b"name = \"x\"\nstops = 3.5", "expected usize"),
    ] {
        let file = files.path("bad.toml");
        fs::write(&file, content).unwrap();
        let message = refused(&["run", &file], expected);
        assert!(message.contains("bad.toml"), "{message}");
        fs::remove_file(&file).unwrap();
        let message = refused(&["run", &file], "No such file");
        assert_eq!(message.matches("No such file").count(), 1, "{message}");
    }
}

/// A run would have made the log.
#[test]
fn results_that_cannot_be_written_are_found_before_the_run() {
    let files = Files::new();
    let log = files.path("log");
    let nowhere = files.path("no/such/folder");
    let file = files.write("file", "as it was");
    let below = files.path("file/plots");
    let folder = files.path("");
    for (option, path, expected) in [
        ("--json", &nowhere, "there is no folder"),
        ("--csv", &nowhere, "there is no folder"),
        ("--yaml", &folder, "is a folder"),
        ("--ros", &nowhere, "there is no folder"),
        ("--pcap", &nowhere, "there is no folder"),
        ("--plots", &below, "is no folder"),
        ("--json", &log, "is named for two results"),
        ("--check", &nowhere, "cannot be read"),
        ("--check", &file, "not the record of a run"),
    ] {
        refused(&["run", "lab", "--log", &log, option, path], expected);
        assert!(!fs::exists(&log).unwrap(), "{option} {path}");
    }
    // A camera within an obstacle, which only the world shows.
    let lab = include_str!("../../scenarios/lab.toml");
    let pillar = "[[world.obstacle]]\npillar = { x = 0.0, y = 0.0, radius = 1.0 }\n";
    let impossible = files.write("impossible.toml", &format!("{lab}{pillar}"));
    refused(
        &["run", &impossible, "--log", &file, "--pcap", &log],
        "outside of obstacle 1",
    );
    assert!(!fs::exists(&log).unwrap());
    for (port, expected) in [
        ("77=/dev/null", "the scenario has no camera 77"),
        ("3=/nowhere", "/nowhere does not exist"),
    ] {
        refused(
            &["run", "lab", "--port", port, "--pcap", &file, "--log", &log],
            expected,
        );
        assert!(!fs::exists(&log).unwrap());
        assert_eq!(fs::read_to_string(&file).unwrap(), "as it was");
    }
    for option in ["--sweep-csv", "--sweep-plot"] {
        let arguments = ["sweep", "lab", "--seeds", "1..1", option, &nowhere];
        refused(&arguments, "there is no folder");
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "as it was");
    assert!(!fs::exists(files.path("no")).unwrap());
}

/// A run would have made the log.
#[test]
fn a_record_of_another_run_is_found_before_the_run() {
    let files = Files::new();
    let log = files.path("log");
    let other = Sample::default().run();
    let other = files.write("other.json", &other.to_json(false).unwrap());
    for (scenario, path) in [("lab", "1"), ("thesis-13", "2")] {
        let arguments = ["run", scenario, "--path", path, "--log", &log];
        let message = refused(
            &[&arguments[..], &["--check", &other]].concat(),
            "only runs of one scenario can be compared",
        );
        let runs = format!("one run is of {scenario}, path {path}, the other of thesis-13, path 1");
        assert!(message.contains(&runs), "{message}");
        assert!(!fs::exists(&log).unwrap());
    }
}

/// Whatever they are called by.
#[test]
#[cfg(unix)]
fn results_that_would_replace_or_block_one_another() {
    let files = Files::new();
    fs::create_dir(files.path("sub")).unwrap();
    let there = files.write("there", "as it was");
    std::os::unix::fs::symlink("there", files.path("link")).unwrap();
    std::os::unix::fs::symlink("not-there", files.path("early")).unwrap();
    let twice = "is named for two results";
    let beside = "have to be a file and a folder";
    for (one, other, expected) in [
        (["--json", "a"], ["--csv", "sub/../a"], twice),
        (["--json", "there"], ["--csv", "link"], twice),
        (["--json", "not-there"], ["--yaml", "early"], twice),
        (["--log", "sub/map.svg"], ["--plots", "sub"], twice),
        (["--json", "out"], ["--plots", "out"], beside),
        (["--json", "out"], ["--plots", "out/in/it"], beside),
        (["--json", "out"], ["--plots", "sub/../out"], beside),
    ] {
        let [one_file, other_file] = [one, other].map(|[_, name]| files.path(name));
        let pair = [one[0], &one_file, other[0], &other_file];
        refused(&[&["run", "lab"][..], &pair].concat(), expected);
    }
    assert_eq!(fs::read_to_string(&there).unwrap(), "as it was");
    assert!(!fs::exists(files.path("out")).unwrap());
}

/// The other results are written all the same.
#[test]
#[cfg(target_os = "linux")]
fn a_log_or_capture_that_is_cut_short_is_told() {
    let files = Files::new();
    for option in ["--log", "--pcap"] {
        let json = files.path(&format!("{option}.json"));
        let done = run(&["run", "lab", option, "/dev/full", "--json", &json]);
        assert_eq!(done.code, 2, "{}", done.stderr);
        assert!(
            done.stderr
                .contains("/dev/full cannot be written: No space"),
            "{}",
            done.stderr
        );
        assert_eq!(done.stderr.lines().count(), 1, "{}", done.stderr);
        assert!(done.stdout.contains("lab, path 1"), "{}", done.stdout);
        let record = RunRecord::from_json(&fs::read_to_string(&json).unwrap()).unwrap();
        assert_eq!(record.summary.calibrated, record.summary.expected);
    }
}
