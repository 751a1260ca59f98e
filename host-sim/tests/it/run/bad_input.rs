//! Errors on the command line or in a file are told at once, with advice, and change nothing.

use std::fs;

use results::record::RunRecord;

use super::sample::Sample;
use crate::common::{Files, run};

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
            "`stops` is 0: it must be 3 to 16",
        ),
        (
            &["run", "lab", "--stops", "-1"],
            "invalid value '-1' for '--stops <N>': a whole number",
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
        (&["run", "lab", "--speed", "-1x"], "such as 10x"),
        (
            &["run", "lab", "--console", "a", "--console", "1:b"],
            "the console of network 1 is on two links",
        ),
        (
            &["run", "lab", "--until-calibrated", "--further-stops", "-1"],
            "a whole number",
        ),
        (&["console", "--port", "x", "--seconds", "-1"], "above 0"),
        (&["live", "lab", "--seed", "-1"], "a whole number from 0"),
        (&["keygen", "/nowhere/key"], "there is no folder /nowhere"),
        (
            &["run", "lab", "--seed", "-1"],
            "invalid value '-1' for '--seed <S>': a whole number from 0",
        ),
        (&["run", "lab", "--seed", "1.5"], "a whole number from 0"),
        (
            &["run", "lab", "--check", "x", "--tolerance", "-1"],
            "invalid value '-1' for '--tolerance <X>': 0 or a number above",
        ),
        (
            &["run", "lab", "--speed", "-5"],
            "invalid value '-5' for '--speed <SPEED>': give max",
        ),
        (&["run", "grid", "--nodes", "-4"], "a whole number"),
        (&["sweep", "lab", "--seeds", "-1..4"], "such as 1..50"),
        (
            &["sweep", "lab", "--seeds", "1..2", "--paths", "-1"],
            "1 to 1000000000",
        ),
        (
            &["sweep", "lab", "--seeds", "1..2", "--jobs", "0"],
            "a whole number from 1",
        ),
        (
            &["sweep", "lab", "--seeds", "1..2", "--jobs", "-2"],
            "a whole number from 1",
        ),
        (
            &["camera", "--pty", "x", "--seed", "-1"],
            "a whole number from 0",
        ),
        (&["run", "lab", "--track", "0"], "above 0"),
        (&["run", "lab", "--track", "1e30"], "fewer seconds"),
        (
            &["run", "lab", "--port", "3=/x", "--speed", "10x"],
            "leave out --speed",
        ),
        (
            &["run", "lab", "--port", "20=/dev/null"],
            "the scenario has no camera 20",
        ),
        (
            &["run", "lab", "--port", "3=/nowhere"],
            "/nowhere does not exist",
        ),
        (&["run", "lab", "--port", "3"], "such as 3=/dev/ttyUSB0"),
        (
            &["run", "lab", "--port", "3=/x", "--port", "3=/y"],
            "two ports",
        ),
        (
            &["run", "thesis"],
            "did you mean `thesis-13`? There are thesis-13, lab, grid",
        ),
        (
            &["console", "--port", "x", "--command", "2:lern-colour"],
            "did you mean `learn-colour`?",
        ),
        (
            &["live", "lab", "--listen", "203.0.113.7"],
            "this computer does not have the address 203.0.113.7: give",
        ),
        (
            &["console", "--port", "/dev/null"],
            "/dev/null cannot be used as a serial port: it is none",
        ),
        (&["live", "walk.ndjson"], "there is no file walk.ndjson: "),
        (&["sweep", "lab", "--seeds", "5..1"], "such as 1..50"),
        (&["rnu", "lab"], "a similar subcommand exists: 'run'"),
        (
            &["report", "rnu", "x"],
            "a similar subcommand exists: 'run'",
        ),
        (&["edit", "ofice"], "did you mean `office`?"),
        (
            &["run", "/"],
            "/ is a folder: give the file of a site in it",
        ),
        (
            &["live", "/"],
            "/ is a folder: give the file of a site in it",
        ),
        (&["edit", "/"], "it is a folder: name a file"),
        (&["solve", "/"], "it is a folder: name a file"),
        (&["provision", "--show", "/"], "it is a folder: name a file"),
        (
            &["run", "/dev/null"],
            "is no file of a site: the name of one ends in `.toml`",
        ),
        (
            &["live", "lab", "--listen", "foo"],
            "an address of this computer is needed, such as 127.0.0.1",
        ),
        (
            &["live", "lab", "--http-port", "99999"],
            "a whole number from 0 to 65535 is needed",
        ),
        (
            &["provision", "--id", "70000"],
            "a whole number from 1 to 65535 is needed",
        ),
        (
            &[
                "console",
                "--port",
                "x",
                "--until-calibrated",
                "--cameras",
                "-1",
            ],
            "a whole number is needed",
        ),
        (&["live", "lab", "--port", "x"], "say `--site lab`"),
        (
            &["run", "lab", "--console", "9:line"],
            "the scenario has no network 9: look at --console",
        ),
        (
            &["run", "lab", "--console", "/nowhere/line"],
            "there is no folder /nowhere: make it first",
        ),
        (
            &["console", "--port", "nowhere/line"],
            "start that first: `host-sim run SITE --console nowhere/line`",
        ),
        (
            &["live", "--port", "nowhere/line"],
            "start that first: `host-sim run SITE --console nowhere/line`",
        ),
        (
            &["console", "--port", "/dev/ttyNONE0"],
            "is the adapter plugged in?",
        ),
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
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    for (content, expected) in [
        (
            &b""[..],
            "line 1: the key `name` is missing at the top of the file: add `name = ",
        ),
        (&lab.as_bytes()[..lab.len() / 2], "bad.toml: "),
        (b"\xff\xfe", "it is no text in UTF-8"),
        (
            b"name = \"x\"\nnmae = 3",
            "line 2: there is no key `nmae` at the top of the file: did you mean `name`?",
        ),
        (
            b"name = \"x\"\nseed = -1",
            "line 2: `seed` is -1: it must be a whole number",
        ),
        (
            b"name = \"x\"\nstops = 3.5",
            "line 2: `stops` is 3.5: it must be a whole number, 3 to 16",
        ),
        (b"name = room", "put text into quotes"),
        (b"name = true-room", "put text into quotes"),
        (b"name = \"x\"\nmeasures = yes", "put text into quotes"),
    ] {
        let file = files.path("bad.toml");
        fs::write(&file, content).unwrap();
        let message = refused(&["run", &file], expected);
        assert!(message.contains("bad.toml"), "{message}");
        fs::remove_file(&file).unwrap();
        let message = refused(&["run", &file], "there is no such file in the folder");
        assert_eq!(message.matches("no such file").count(), 1, "{message}");
    }
}

/// Each with a file of that folder whose name is like it.
#[test]
fn files_that_are_not_there() {
    let files = Files::new();
    let there = files.write("site-1.toml", "");
    let (near, far) = (files.path("site-2.toml"), files.path("other.toml"));
    let nowhere = files.path("nowhere/x.toml");
    let line = files.path("line");
    for command in [
        &["run"][..],
        &["sweep", "--seeds", "1..2"],
        &["edit"],
        &["report", "run"],
        &["report", "runs"],
        &["solve"],
        &["solve-network"],
        &["solve-reference", "--baseline", "4"],
        &["run", "lab", "--check"],
        &["console", "--port", "x", "--site"],
        &["live", "--port", "x", "--site"],
        &["provision", "--out", "x", "--site"],
        &["provision", "--show"],
        &["flash", "nrf52840", "--dry-run", "--config"],
        &["camera", "--pty", &line, "--video"],
        &["camera", "--pty", &line, "--scene"],
    ] {
        let meant = format!("did you mean `{there}`?");
        let said = refused(&[command, &[near.as_str()]].concat(), &meant);
        assert!(!said.contains("os error"), "{said}");
        if command != ["edit"] {
            let words = "there is no such file in the folder";
            refused(&[command, &[far.as_str()]].concat(), words);
            let words = format!("there is no folder {}: look", files.path("nowhere"));
            refused(&[command, &[nowhere.as_str()]].concat(), &words);
        }
    }
    let name = there.strip_suffix(".toml").unwrap();
    refused(&["run", name], &format!("did you mean `{there}`?"));
}

/// The line to write is told.
#[test]
fn keys_that_are_missing_and_tables_that_are_no_lists() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let references = lab.lines().find(|line| line.starts_with("references"));
    let references = references.unwrap();
    for (old, new, expected) in [
        (
            references,
            "",
            "the key `references` is missing in `network 1`: add `references = { cameras = [1, 2] }`.",
        ),
        (
            references,
            "references = { elected = true }",
            "the key `cameras` is missing in `network 1.references`: add `cameras = [1, 2]`.",
        ),
        (
            "[[network]]",
            "[network]",
            "it must be a list of tables: write `[[network]]`",
        ),
        (
            "[camera]\n",
            "[camera]\nfield_of_view_deg = 0.785\n",
            "is it in radians? Then write 45.0",
        ),
    ] {
        assert!(lab.contains(old), "{old}");
        let text = match new.contains("field_of_view") {
            true => without(lab, "field_of_view_deg").replacen(old, new, 1),
            false => lab.replacen(old, new, 1),
        };
        refused(&["run", &files.write("site.toml", &text)], expected);
    }
}

/// The text without the lines of a key.
fn without(text: &str, key: &str) -> String {
    let lines = text.lines().filter(|line| !line.starts_with(key));
    lines.map(|line| format!("{line}\n")).collect()
}

/// A person does not run at 80 m a second: that is told, and done.
#[test]
fn values_that_are_hardly_meant() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let lab = without(&without(lab, "unit"), "speed");
    let fast = lab.replacen("[walk]\n", "[walk]\nspeed = 80.0\n", 1);
    let said = run(&["run", &files.write("fast.toml", &fast)]).stderr;
    assert!(!said.contains("is it in another unit?"), "{said}");
    let known = files.write("known.toml", &format!("unit = \"m\"\n{fast}"));
    let said = run(&["run", &known]).stderr;
    let doubt = "`walk.speed` is 80 m a second, and a person walks about 1 m a second";
    assert!(said.contains(doubt), "{said}");
}

/// Words of parsers are not for people.
#[test]
fn files_that_are_something_else() {
    let files = Files::new();
    let sample = Sample::default().run();
    let record = files.write("run.json", &sample.to_json(false).unwrap());
    let events = files.path("run.ndjson");
    let told = run(&["report", "run", &record, "--events", &events]);
    assert!(told.stderr.is_empty(), "{}", told.stderr);
    let [binary, bytes, words, cut] = [
        ("binary.csv", &b"\x7fELF\x02\0\0\n\0"[..]),
        ("bytes.csv", b"\xff\xfe\0a"),
        ("words.json", b"nope"),
        ("cut.json", b"{\"format\": "),
    ]
    .map(|(name, content)| {
        let path = files.path(name);
        fs::write(&path, content).unwrap();
        path
    });
    let no_text = "it is no text in UTF-8";
    for (arguments, expected) in [
        (&["solve-network", &bytes][..], no_text),
        (&["report", "run", &bytes], no_text),
        (&["edit", &bytes], no_text),
        (&["camera", "--pty", "x", "--scene", &bytes], no_text),
        (
            &["solve", &binary],
            "is no text: its first line has control",
        ),
        (
            &["report", "run", &events],
            "is a file of events: `host-sim live ",
        ),
        (
            &["live", &record],
            "is the record of a run: `host-sim report run ",
        ),
        (&["report", "run", &words], "line 1 is no JSON"),
        (&["report", "run", &cut], "its JSON is cut off in line 1"),
        (&["solve-network", &cut], "its JSON is cut off in line 1"),
        (&["live", &cut], "line 1 is no event: it is cut off"),
        (
            &["live", &words],
            "is neither the file of a site, whose name ends in `.toml`, nor",
        ),
    ] {
        let said = refused(arguments, expected);
        for raw in ["os error", "valid UTF-8", "expected", "at line 1 column"] {
            assert!(!said.contains(raw), "{said}");
        }
    }
}

/// Each has a sentence of its own.
#[test]
fn headings_in_radians_and_places_in_centimetres() {
    let files = Files::new();
    let thesis = include_str!("../../../../host/site/scenarios/thesis-13.toml");
    let changed = |text: &str, key: &str, factor: f64| -> String {
        let change = |text: String, part: &str| {
            let (number, rest) = part.split_at(part.find([',', ' ']).unwrap());
            format!(
                "{text}{key}{:.4}{rest}",
                factor * number.parse::<f64>().unwrap()
            )
        };
        let mut parts = text.split(key);
        let first = parts.next().unwrap().to_owned();
        parts.fold(first, change)
    };
    let radians = changed(thesis, ", heading_deg = ", 1_f64.to_radians());
    let centimetres = changed(&changed(thesis, ", x = ", 100.0), ", y = ", 100.0);
    let centimetres = { centimetres.lines() }
        .map(|line| match line.split_once(" = [") {
            Some(("low", _)) => "low = [-200, -200]",
            Some(("high", _)) => "high = [2800, 2800]",
            _ => line,
        })
        .collect::<Vec<_>>()
        .join("\n");
    for (name, text, expected) in [
        (
            "radians.toml",
            radians,
            "are they radians? They must be degrees",
        ),
        (
            "centimetres.toml",
            centimetres,
            "are places in centimetres?",
        ),
    ] {
        let said = refused(&["run", &files.write(name, &text)], expected);
        assert!(said.split_whitespace().count() < 45, "{said}");
    }
}

#[test]
fn options_that_would_do_nothing() {
    let files = Files::new();
    let record = Sample::default().run().to_json(false).unwrap();
    let file = files.write("run.json", &record);
    fs::create_dir(files.path("sub")).unwrap();
    let again = files.path("sub/../run.json");
    for (arguments, expected) in [
        (&["run", "lab", "--tolerance", "0.1"][..], "--check"),
        (&["report", "run", &file, "--tolerance", "0.1"], "--check"),
        (
            &["run", "lab", "--image", "x.elf"],
            "say `--backend nrf52840`",
        ),
        (&["run", "lab", "--gdb", "1"], "say `--backend nrf52840`"),
        (
            &["run", "lab", "--backend", "nrf52840", "--port", "3=/x"],
            "say `--backend host`",
        ),
        (
            &["sweep", "lab", "--seeds", "1..1", "--paths", "1,2,2"],
            "path 2 is named twice",
        ),
        (&["report", "sweep", &file, &again], "is named twice"),
        (&["report", "runs", &file, &file], "is named twice"),
    ] {
        refused(arguments, expected);
    }
}

/// Otherwise it would become a file of that name.
#[test]
fn a_dash_is_no_name_for_a_result() {
    let files = Files::new();
    let record = files.write("run.json", &Sample::default().run().to_json(false).unwrap());
    let sightings = files.write("s.csv", "case,target_x,target_y,bearing_rad\n1,1,1,1\n");
    let advice = "name a file; /dev/stdout is the screen";
    for option in ["--json", "--csv", "--yaml", "--ros", "--plots"] {
        refused(&["run", "lab", option, "-"], advice);
        refused(&["report", "run", &record, option, "-"], advice);
    }
    for option in ["--log", "--pcap"] {
        refused(&["run", "lab", option, "-"], advice);
    }
    for option in ["--sweep-csv", "--sweep-plot"] {
        refused(&["report", "sweep", &record, option, "-"], advice);
    }
    refused(&["solve", &sightings, "--plot", "-"], advice);
    for option in ["--frame", "--record"] {
        refused(&["probe", "--port", "/nowhere", option, "-"], advice);
    }
}

/// The file tells which of several scenarios it was.
#[test]
fn a_scenario_that_cannot_be_put_up_is_named() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let pillar = "[[world.obstacle]]\npillar = { x = 0.0, y = 0.0, radius = 1.0 }\n";
    let impossible = files.write("impossible.toml", &format!("{lab}{pillar}"));
    let start = format!("host-sim: {impossible}: ");
    for arguments in [
        &["run", &impossible][..],
        &["sweep", &impossible, "--seeds", "1..2"],
    ] {
        let message = refused(arguments, "outside of obstacle 1");
        assert!(message.starts_with(&start), "{message}");
        assert_eq!(message.matches(&impossible).count(), 1, "{message}");
    }
}

/// The references of `lab` face each other: turning them would change nothing.
#[test]
fn stops_that_the_references_cannot_share_have_all_causes_named() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let wall = "[[world.obstacle]]\nwall = [[-3.0, 1.0], [17.0, 1.0]]\n";
    let file = files.write("walled.toml", &format!("{lab}{wall}"));
    let message = refused(&["run", &file], "no stops can be planned for network 1");
    for cause in [
        "turn them",
        "`range`",
        "`area`",
        "`world.low`",
        "obstacles",
        "`stops`",
        "`radius`",
    ] {
        assert!(message.contains(cause), "{cause}: {message}");
    }
}

/// A terminal would obey them, and no drawing may contain them.
#[test]
fn names_with_control_characters() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    for (field, value) in [("name", "a\\u001b[31mb"), ("unit", "m\\u0000")] {
        let mut text = String::new();
        for line in lab.lines() {
            if line.starts_with(&format!("{field} =")) {
                text += &format!("{field} = \"{value}\"\n");
            } else {
                text += &format!("{line}\n");
            }
        }
        let file = files.write("control.toml", &text);
        let message = refused(&["run", &file], &format!("`{field}` is "));
        assert!(message.contains("control characters"), "{message}");
        assert!(
            !message.trim_end().contains(char::is_control),
            "{message:?}"
        );
    }
}

/// Devices have no end, or cannot be read again.
#[test]
#[cfg(target_os = "linux")]
fn devices_are_no_records() {
    refused(&["run", "lab", "--check", "/dev/zero"], "no regular file");
    refused(&["report", "run", "/dev/zero"], "no regular file");
    let files = Files::new();
    let long = files.write("long.json", "");
    let file = fs::OpenOptions::new().write(true).open(&long).unwrap();
    file.set_len(1 << 33).unwrap();
    refused(&["run", "lab", "--check", &long], "more than");
    refused(
        &["probe", "--port", "/nowhere", "--record", "/dev/full"],
        "no regular file",
    );
}

/// Otherwise a run would have made the log.
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
        ("--plots", &below, "is a file, not a folder"),
        ("--report", &below, "is a file, not a folder"),
        ("--json", &log, "is named for two results"),
        ("--check", &nowhere, "cannot be read"),
        ("--check", &file, "not the record of a run"),
    ] {
        refused(&["run", "lab", "--log", &log, option, path], expected);
        assert!(!fs::exists(&log).unwrap(), "{option} {path}");
    }
    // A camera within an obstacle: only the world shows this.
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
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

/// Otherwise a run would have made the log.
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

/// By whatever names they are called.
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

/// By whatever name it is called, and whatever is to be written.
#[test]
#[cfg(unix)]
fn a_site_that_is_edited_stays_as_it_was() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let site = files.write("site.toml", lab);
    std::os::unix::fs::symlink("site.toml", files.path("link")).unwrap();
    let replaced = "is read, and would be replaced by a result";
    for name in ["site.toml", "./site.toml", "link"] {
        refused(&["edit", &site, "--json", &files.path(name)], replaced);
    }
    assert_eq!(fs::read_to_string(&site).unwrap(), lab);
    let nowhere = files.path("no/such.toml");
    for (saved, expected) in [
        (files.path(""), "is a folder"),
        (nowhere.clone(), "there is no folder"),
        ("-".to_owned(), "name a file"),
    ] {
        refused(&["edit", &site, "--save", &saved], expected);
    }
    // Another file is replaced only if that is asked for.
    let other = files.write("other.toml", "as it was");
    for edited in ["office", &site] {
        let words = "is there already: go on with it (`host-sim edit ";
        refused(&["edit", edited, "--save", &other], words);
    }
    assert_eq!(fs::read_to_string(&other).unwrap(), "as it was");
    refused(&["edit", &site, "--replace"], "--save");
    let begin = "begin with a site that is built in, as `host-sim edit office --save";
    refused(&["edit", &files.path("my-site.toml")], begin);
    let told = run(&["edit", &site, "--json", "-"]);
    assert_eq!(told.code, 0, "{}", told.stderr);
}

/// Otherwise it would not be noticed that cameras stayed at their places.
#[test]
fn cameras_that_scatter_out_of_the_world() {
    for (scatter, expected) in [
        (
            "1000,3",
            "`scatter.position` is 1000: it must be less: camera 1 then stands outside",
        ),
        (
            "1e308,3",
            "`scatter.position` is 1e308: it must be 0 to 100000",
        ),
    ] {
        refused(
            &["sweep", "lab", "--seeds", "1..2", "--scatter", scatter],
            expected,
        );
    }
}

#[test]
fn a_network_that_has_its_frame_from_none_and_a_number_in_quotes() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let camera = [101, 102, 103].map(|id| format!("{{ id = {id}, x = 0.0, y = 0.0 }}"));
    let camera = format!("camera = [{}]", camera.join(", "));
    let network = format!(
        "{lab}\n[[network]]\nreferences = {{ cameras = [101, 102], frame_of = 7 }}\n{camera}\n"
    );
    let quoted = lab.replacen("stops = 3", "stops = \"3\"", 1);
    for (text, expected) in [
        (
            network,
            "`network 2.references.frame_of` is 7: it must be the number",
        ),
        (
            quoted,
            "`stops` is a text, \"3\": it must be a whole number",
        ),
    ] {
        let file = files.write("site.toml", &text);
        refused(&["run", &file], expected);
        fs::remove_file(file).unwrap();
    }
}

#[test]
fn a_file_without_an_end_is_not_read() {
    let files = Files::new();
    let long = files.write("long.toml", &format!("x = {}", "a".repeat(5_000_000)));
    refused(&["run", &long], "has more than 4194304 bytes");
    let line = files.write("line.toml", &format!("x = {}", "a".repeat(100_000)));
    assert!(refused(&["run", &line], "TOML parse error").len() < 10_000);
}

/// Events after the end do not happen.
#[test]
fn events_that_come_too_late_are_told() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let event = "[[event]]\nat_s = 90000.0\naction.restart = { node = 3 }\n";
    let site = files.write("late.toml", &format!("{lab}\n{event}"));
    let done = run(&["run", &site]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let told = "1 of 1 events did not happen: the run ended before";
    assert!(done.stderr.contains(told), "{}", done.stderr);
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
