//! The process with the emulated chips, as the simulation sees it. In its place is mostly a test of this
//! program, [`stands_for_chips`], whose chips do nothing.
#![cfg(target_os = "linux")]

#[expect(dead_code, reason = "these chips have no arithmetic")]
mod small;

use std::{
    env,
    fs::{self, File},
    io::{self, BufReader, Write as _},
    os::unix::{fs::PermissionsExt, process::CommandExt},
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    thread,
    time::Duration,
};

use answers::record::RunRecord;
use chip_pipe::{Order, Orders, Reports, read, write};
use host_sim::network::CHIP_IMAGE;
use small::SMALL;
use tempfile::TempDir;

/// What makes a test stand for the process, and is what it is to do.
const DOES: &str = "CHIPS_DO";
/// It notes there what it is told: the seed of each start of node 3, and the end.
const NOTES: &str = "notes";
/// It ends at the first or second start of node 3.
const ENDS: [&str; 2] = ["ends at start 1", "ends at start 2"];
/// It goes on to the end.
const STAYS: &str = "stays";

/// Where this computer's programs are.
const SYSTEM: &str = "/usr/bin:/bin";

/// What the process does in some tests; in others nothing. Its reports do not go to the standard output,
/// where tests tell how they went.
#[test]
fn stands_for_chips() {
    let Ok(does) = env::var(DOES) else {
        return;
    };
    let end = ENDS.iter().position(|end| *end == does);
    let mut orders = BufReader::new(io::stdin().lock());
    let mut reports = File::options().write(true).open("/dev/fd/3").unwrap();
    let mut notes = File::create(NOTES).unwrap();
    let (mut starts, mut reached) = (0, 0);
    while let Some(told) = read(&mut orders).unwrap() {
        match told {
            Orders::Run { orders, until } => {
                for (number, order) in orders {
                    if let (3, Order::On { seed, .. }) = (number, order) {
                        writeln!(notes, "{seed}").unwrap();
                        if end == Some(starts) {
                            std::process::exit(3);
                        }
                        starts += 1;
                    }
                }
                reached = until;
            }
            Orders::Look => {}
            Orders::End => writeln!(notes, "end").unwrap(),
            Orders::Load(_) | Orders::Debug(..) => continue,
        }
        let deeds = Vec::new();
        write(
            &mut reports,
            &Reports {
                reached,
                next: reached,
                deeds,
            },
        )
        .unwrap();
    }
}

/// A folder as that of the sources, in which everything is built.
struct Sources(TempDir);

impl Sources {
    fn new() -> Self {
        let sources = Self(TempDir::new().unwrap());
        sources.write("nrf52840-emulator/Cargo.toml", "");
        // Any program.
        sources.write(CHIP_IMAGE, "");
        fs::copy("/bin/sh", sources.path(CHIP_IMAGE)).unwrap();
        sources.program("bin/cargo", "exit 0");
        let this = env::current_exe().unwrap();
        let script = format!(
            "exec {} --exact stands_for_chips 3>&1 >/dev/null",
            this.display()
        );
        sources.program("target/chip/release/chips", &script);
        sources
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        path
    }

    fn program(&self, name: &str, script: &str) {
        let path = self.write(name, &format!("#!/bin/sh\n{script}\n"));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// `host-sim run SCENARIO --backend nrf52840`, there.
    fn host_sim(&self, scenario: &str, does: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
        command
            .args(["run", scenario, "--backend", "nrf52840"])
            .current_dir(self.0.path())
            .env("PATH", format!("{}:{SYSTEM}", self.path("bin").display()))
            .env(DOES, does);
        command
    }

    /// The small network, of which node 3 loses its power then.
    fn small(&self, cut_s: f64) -> String {
        let cut = format!("at_s = {cut_s}");
        let path = self.write("small.toml", &SMALL.replace("at_s = 25.0", &cut));
        path.to_str().unwrap().to_owned()
    }

    fn notes(&self) -> Vec<String> {
        let notes = fs::read_to_string(self.path(NOTES)).unwrap_or_default();
        notes.lines().map(str::to_owned).collect()
    }
}

fn refused(command: &mut Command, expected: &str) -> Output {
    let output = command.output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(expected), "{stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
    output
}

#[test]
fn what_is_missing_is_told_with_what_to_type() {
    let sources = Sources::new();
    let command = || sources.host_sim("lab", STAYS);
    let toolchain = "`rustup toolchain install 1.98.0`";
    refused(command().env("PATH", "/nowhere"), toolchain);
    sources.program("bin/cargo", "exit 101");
    refused(&mut command(), toolchain);
    let elsewhere = TempDir::new().unwrap();
    let image = sources.path(CHIP_IMAGE);
    refused(
        command()
            .arg("--image")
            .arg(image)
            .current_dir(elsewhere.path()),
        "no folder nrf52840-emulator here",
    );
    fs::write(sources.path(CHIP_IMAGE), "no machine code").unwrap();
    refused(&mut command(), "is no program for a chip");
    fs::remove_file(sources.path(CHIP_IMAGE)).unwrap();
    refused(&mut command(), "type `cargo xtask firmware`");
}

/// Whatever has happened until then, results are of what was before, and no table pretends to be more.
#[test]
fn a_run_whose_chips_fail_says_that_it_is_not_complete() {
    let sources = Sources::new();
    let small = sources.small(0.5);
    let [json, csv] = ["run.json", "poses.csv"].map(|name| sources.path(name));
    for does in ENDS {
        let mut command = sources.host_sim(&small, does);
        command.arg("--json").arg(&json).arg("--csv").arg(&csv);
        let output = refused(
            &mut command,
            "the process with the emulated chips has failed",
        );
        let stdout = String::from_utf8(output.stdout).unwrap();
        let begins = "NOT COMPLETE: the process with the emulated chips has failed";
        assert!(stdout.starts_with(begins), "{does}: {stdout}");
        let csv = fs::read_to_string(&csv).unwrap();
        let last = csv.lines().last().unwrap();
        assert!(
            last.starts_with("# not complete: the process with"),
            "{csv}"
        );
        let json = fs::read_to_string(&json).unwrap();
        assert!(json.contains("\"cut_short\": \"the process with"), "{json}");
        let record = RunRecord::from_json(&json).unwrap();
        assert_eq!((record.scenario.as_str(), record.nodes.len()), ("small", 5));
        let mut nodes = record.nodes.iter();
        assert!(nodes.all(|node| node.calibrated_seconds.is_none()));
    }
}

#[test]
fn chips_get_another_seed_at_each_start_and_the_same_in_each_run() {
    let starts = |seed: &str| {
        let sources = Sources::new();
        let mut command = sources.host_sim(&sources.small(0.5), ENDS[1]);
        let output = command.args(["--seed", seed]).output().unwrap();
        let notes = sources.notes();
        assert_eq!(notes.len(), 2, "{output:?}");
        notes
    };
    let first = starts("1");
    assert_ne!(first[0], first[1]);
    assert_eq!(starts("1"), first);
    assert_ne!(starts("2")[0], first[0]);
}

/// Ends with its owner.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn wait_until(mut condition: impl FnMut() -> bool) {
    while !condition() {
        thread::sleep(Duration::from_millis(20));
    }
}

/// A terminal interrupts all that it has started at once. Chips are told by the simulation.
#[test]
fn who_interrupts_a_run_still_hears_what_chips_knew() {
    let sources = Sources::new();
    let mut command = sources.host_sim(&sources.small(1e6), STAYS);
    command
        .args(["--speed", "real-time"])
        .process_group(0)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut simulation = Running(command.spawn().unwrap());
    wait_until(|| {
        assert_eq!(simulation.0.try_wait().unwrap(), None);
        sources.notes().len() == 1
    });
    let group = format!("-{}", simulation.0.id());
    let kill = Command::new("kill").args(["-INT", "--", &group]).status();
    assert!(kill.unwrap().success());
    assert_eq!(simulation.0.wait().unwrap().code(), Some(130));
    assert_eq!(sources.notes()[1..], ["end"]);
}

/// The processes that this one has started and that have not ended.
fn children(of: u32) -> Vec<PathBuf> {
    let is_child = |process: &PathBuf| {
        let stat = fs::read_to_string(process.join("stat")).unwrap_or_default();
        // Behind its name: its state, and who started it.
        let mut words = stat.rsplit(") ").next().unwrap_or_default().split(' ');
        let is_alive = words.next().is_some_and(|state| state != "Z");
        is_alive && words.next() == Some(&of.to_string())
    };
    let all = fs::read_dir("/proc").unwrap();
    let all = all.map(|entry| entry.unwrap().path());
    all.filter(is_child).collect()
}

fn is_running(process: &Path) -> bool {
    let stat = fs::read_to_string(process.join("stat"));
    stat.is_ok_and(|stat| !stat.rsplit(") ").next().unwrap().starts_with('Z'))
}

/// Nothing of host-sim runs any more when it is killed, but the chips end with it.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn chips_do_not_outlive_the_simulation() {
    let image = env::var_os("NODE_IMAGE").expect("NODE_IMAGE is not set");
    let log = TempDir::new().unwrap();
    let log = log.path().join("log");
    let command = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["run", "lab", "--backend", "nrf52840", "--image"])
        .arg(image)
        .arg("--log")
        .arg(&log)
        // What emulates chips is found from there.
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let mut simulation = Running(command.unwrap());
    // They are in the middle of it.
    wait_until(|| {
        assert_eq!(simulation.0.try_wait().unwrap(), None);
        log.metadata().is_ok_and(|log| log.len() > 0)
    });
    let chips = children(simulation.0.id());
    assert_eq!(chips.len(), 1, "{chips:?}");
    drop(simulation);
    wait_until(|| !is_running(&chips[0]));
}
