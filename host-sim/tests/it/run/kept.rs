//! Nothing is lost: no result replaces a file that is read, and a command that is ended leaves its results.
#![cfg(unix)]

use std::{
    fs,
    io::{ErrorKind, Read as _},
    os::unix::fs::symlink,
    path::Path,
    process::{Child, Command, Stdio},
    sync::mpsc,
    thread,
};

use results::record::RunRecord;
use rustix::process::{Pid, Signal, kill_process};

use super::sample::Sample;
use crate::common::{Files, LineEnd, run, wait_until};

const IS_READ: &str = "is read, and would be replaced by a result";

/// Checks that the command is refused, and that all of these files are unchanged.
#[track_caller]
fn keeps(arguments: &[&str], files: &[&str]) {
    let before: Vec<_> = files.iter().map(|file| fs::read(file).unwrap()).collect();
    let done = run(arguments);
    assert_eq!(done.code, 2, "{arguments:?}: {}", done.stderr);
    assert!(done.stderr.contains(IS_READ), "{}", done.stderr);
    assert_eq!(done.stderr.lines().count(), 1, "{}", done.stderr);
    for (file, before) in files.iter().zip(before) {
        assert!(fs::read(file).unwrap() == before, "{arguments:?}: {file}");
    }
}

#[test]
fn no_result_replaces_what_is_read() {
    let files = Files::new();
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let scenario = files.write("s.toml", lab);
    let record = Sample::default().run().to_json(false).unwrap();
    let record = files.write("run.json", &record);
    let csv = "case,target_x,target_y,bearing_rad\na,1,0,0\na,0,1,1\na,1,1,0.5\n";
    let sightings = files.write("in.csv", csv);
    let truth = files.write("truth.csv", "case,x,y,heading_rad\na,0,0,0\n");
    let link = files.path("link");
    symlink("s.toml", &link).unwrap();
    let other_name = files.path("other-name");
    fs::hard_link(&sightings, &other_name).unwrap();
    let dots = files.path("nowhere/../in.csv");
    fs::create_dir(files.path("nowhere")).unwrap();
    fs::create_dir(files.path("plots")).unwrap();
    symlink("../run.json", files.path("plots/map.svg")).unwrap();
    let plots = files.path("plots");

    for result in [&sightings, &other_name, &dots] {
        keeps(&["solve", &sightings, "--plot", result], &[&sightings]);
    }
    let with_truth = ["solve", &sightings, "--truth", &truth, "--plot", &truth];
    keeps(&with_truth, &[&truth]);
    for option in ["--json", "--csv", "--yaml", "--ros", "--log", "--pcap"] {
        for result in [&scenario, &link] {
            keeps(&["run", &scenario, option, result], &[&scenario]);
        }
        let port = format!("3={sightings}");
        keeps(
            &["run", "lab", "--port", &port, option, &sightings],
            &[&sightings],
        );
    }
    keeps(
        &["run", "lab", "--check", &record, "--json", &record],
        &[&record],
    );
    keeps(
        &["run", "lab", "--check", &record, "--plots", &plots],
        &[&record],
    );
    for option in ["--json", "--csv", "--yaml", "--ros"] {
        keeps(&["report", "run", &record, option, &record], &[&record]);
    }
    keeps(&["report", "run", &record, "--plots", &plots], &[&record]);
    for option in ["--sweep-csv", "--sweep-plot"] {
        keeps(&["report", "sweep", &record, option, &record], &[&record]);
        let sweep = ["sweep", &scenario, "--seeds", "1..2", option, &link];
        keeps(&sweep, &[&scenario]);
    }
    let console = ["console", "--port", "/nowhere", "--change-key", &record];
    keeps(&[&console[..], &["--csv", &record]].concat(), &[&record]);
    keeps(
        &["console", "--port", &record, "--json", &record],
        &[&record],
    );
    keeps(
        &["probe", "--port", &record, "--frame", &record],
        &[&record],
    );
}

/// `solve - --plot in.csv < in.csv`
#[test]
#[cfg(target_os = "linux")]
fn what_comes_on_the_standard_input_stays_too() {
    let files = Files::new();
    let csv = "case,target_x,target_y,bearing_rad\na,1,0,0\na,0,1,1\na,1,1,0.5\n";
    let sightings = files.write("in.csv", csv);
    let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["solve", "-", "--plot", &sightings])
        .stdin(fs::File::open(&sightings).unwrap())
        .output()
        .unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.contains(IS_READ), "{stderr}");
    assert_eq!(fs::read_to_string(&sightings).unwrap(), csv);
}

/// A command at work. Ends with its owner.
struct Work(Child);

impl Work {
    fn new(arguments: &[&str]) -> Self {
        Self::on(arguments, Stdio::piped())
    }

    /// Starts it, with its errors to `stderr`.
    fn on(arguments: &[&str], stderr: Stdio) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
        command
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(stderr);
        Self(command.spawn().unwrap())
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.0), signal).unwrap();
    }

    /// Its exit code, and its output.
    fn end(mut self) -> (Option<i32>, String, String) {
        let (mut stdout, mut stderr) = (String::new(), String::new());
        let out = self.0.stdout.as_mut().unwrap();
        out.read_to_string(&mut stdout).unwrap();
        if let Some(err) = self.0.stderr.as_mut() {
            err.read_to_string(&mut stderr).unwrap();
        }
        (self.0.wait().unwrap().code(), stdout, stderr)
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The signals of a line of Linux's status of a process.
#[cfg(target_os = "linux")]
fn signals(of: &Work, line: &str) -> u64 {
    let status = fs::read_to_string(format!("/proc/{}/status", of.0.id())).unwrap();
    let mask = status.lines().find_map(|told| told.strip_prefix(line));
    u64::from_str_radix(mask.unwrap().trim(), 16).unwrap()
}

/// Returns true while a command waits.
#[cfg(target_os = "linux")]
fn is_asleep(work: &Work) -> bool {
    let status = fs::read_to_string(format!("/proc/{}/status", work.0.id())).unwrap();
    status.lines().any(|line| line == "State:\tS (sleeping)")
}

/// Bit of the signal in such a line.
#[cfg(target_os = "linux")]
const INTERRUPT: u64 = 1 << (Signal::INT.as_raw() - 1);
/// The last signal that the program begins to watch.
#[cfg(target_os = "linux")]
const HANG_UP: u64 = 1 << (Signal::HUP.as_raw() - 1);

fn length(file: &str) -> u64 {
    fs::metadata(Path::new(file)).map_or(0, |found| found.len())
}

#[test]
fn who_is_interrupted_leaves_report_and_files() {
    for signal in [Signal::INT, Signal::TERM] {
        let files = Files::new();
        let [log, json, csv, yaml] = ["log", "run.json", "a.csv", "a.yaml"].map(|f| files.path(f));
        let outputs = [
            "--log", &log, "--json", &json, "--csv", &csv, "--yaml", &yaml,
        ];
        let grid = ["run", "grid", "--nodes", "300", "--speed", "20x"];
        let work = Work::new(&[&grid[..], &outputs].concat());
        wait_until(|| length(&log) > 10_000);
        work.signal(signal);
        let (code, stdout, stderr) = work.end();
        assert_eq!(code, Some(130), "{stderr}");
        assert!(
            stdout.starts_with("NOT COMPLETE: interrupted after "),
            "{stdout}"
        );
        assert!(stderr.ends_with("interrupted\n"), "{stderr}");
        let text = fs::read_to_string(&json).unwrap();
        RunRecord::from_json(&text).unwrap();
        assert!(
            text.contains("\"cut_short\": \"interrupted after "),
            "{text}"
        );
        for file in [&csv, &yaml] {
            let text = fs::read_to_string(file).unwrap();
            let last = text.lines().last().unwrap();
            assert!(
                last.starts_with("# not complete: interrupted after "),
                "{last}"
            );
        }
        assert!(fs::read_to_string(&log).unwrap().ends_with('\n'));
        // It is not taken for a whole run later.
        let again = run(&["report", "run", &json]);
        assert_eq!(again.code, 1);
        assert!(
            again.stdout.starts_with("NOT COMPLETE: "),
            "{}",
            again.stdout
        );
        let counted = run(&["report", "sweep", &json]);
        assert_eq!(counted.code, 2);
        assert!(
            counted.stderr.contains("was cut short"),
            "{}",
            counted.stderr
        );
    }
}

#[test]
fn a_sweep_that_is_interrupted_tells_of_the_runs_before() {
    let files = Files::new();
    let csv = files.path("sweep.csv");
    let sweep = ["sweep", "lab", "--seeds", "1..2000", "--jobs", "2"];
    let (mut screen, LineEnd(stderr), _) = LineEnd::pair();
    let work = Work::on(
        &[&sweep[..], &["--sweep-csv", &csv]].concat(),
        stderr.into(),
    );
    // The bar tells of the first run that is done, and goes on.
    let (tell, told) = mpsc::channel();
    thread::spawn(move || {
        let (mut shown, mut bytes) = (String::new(), [0; 4096]);
        loop {
            match screen.read(&mut bytes) {
                Ok(count) => shown += &String::from_utf8_lossy(&bytes[..count]),
                Err(error) if error.kind() == ErrorKind::TimedOut => {}
                Err(_) => break,
            }
            let mut counts = shown.split("run ").skip(1);
            if counts.any(|text| text.starts_with(|first| ('1'..='9').contains(&first))) {
                // The test may be over.
                let _ = tell.send(());
            }
        }
    });
    told.recv().unwrap();
    work.signal(Signal::TERM);
    let (code, stdout, _) = work.end();
    assert_eq!(code, Some(130), "{stdout}");
    assert!(
        stdout.starts_with("NOT COMPLETE: interrupted after "),
        "{stdout}"
    );
    assert!(stdout.contains(" of 2000 runs"), "{stdout}");
    let csv = fs::read_to_string(&csv).unwrap();
    assert!(
        csv.lines().last().unwrap().starts_with("# not complete: "),
        "{csv}"
    );
}

/// Time hardly passes in this run, so that it never sees the first one.
#[test]
#[cfg(target_os = "linux")]
fn a_second_signal_ends_at_once() {
    let work = Work::new(&["run", "lab", "--speed", "0.000001x"]);
    // It watches, and sleeps until something happens in the network.
    wait_until(|| signals(&work, "SigCgt:") & HANG_UP != 0 && is_asleep(&work));
    work.signal(Signal::INT);
    wait_until(|| (signals(&work, "ShdPnd:") | signals(&work, "SigPnd:")) & INTERRUPT == 0);
    work.signal(Signal::INT);
    let (code, stdout, _) = work.end();
    assert_eq!((code, stdout.as_str()), (Some(130), ""));
}

#[test]
fn who_is_killed_leaves_whole_lines_and_packets() {
    let files = Files::new();
    let [log, pcap] = ["log", "air.pcap"].map(|name| files.path(name));
    let grid = [
        "run", "grid", "--nodes", "300", "--log", &log, "--pcap", &pcap,
    ];
    let work = Work::new(&grid);
    wait_until(|| length(&log) > 100_000 && length(&pcap) > 10_000);
    work.signal(Signal::KILL);
    assert_eq!(work.end().0, None);
    assert!(fs::read_to_string(&log).unwrap().ends_with('\n'));
    let bytes = fs::read(&pcap).unwrap();
    // The header of the file, and of each packet, whose third word is its length.
    let mut place = 24;
    while place < bytes.len() {
        let length = u32::from_le_bytes(bytes[place + 8..place + 12].try_into().unwrap());
        place += 16 + length as usize;
    }
    assert_eq!(place, bytes.len());
}
