//! The process with the emulated chips, as the simulation sees it. In its place is mostly a test of this
//! program, [`stands_for_chips`], whose chips do nothing.
#![cfg(target_os = "linux")]

use std::{
    env,
    fs::{self, File},
    io::{self, BufReader, Write as _},
    net::{Ipv4Addr, TcpListener},
    os::unix::{fs::PermissionsExt, process::CommandExt},
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    thread,
    time::Duration,
};

use crate::small::SMALL;
use answers::record::RunRecord;
use chip_pipe::{Deed, Order, Orders, Reports, Wires, read, write};
use host_sim::network::CHIP_IMAGE;
use tempfile::TempDir;

/// What makes a test stand for the process, and is what it is to do.
const DOES: &str = "CHIPS_DO";
/// It notes there what it is told: the seed of each start of node 3, and the end.
const NOTES: &str = "notes";
/// It ends at the first or second start of node 3.
const ENDS: [&str; 2] = ["ends at start 1", "ends at start 2"];
/// It goes on to the end.
const STAYS: &str = "stays";
/// It does not answer any more once node 3 has started, as if GDB had it stand still.
const WAITS: &str = "waits";
/// The chip of node 3 does something at each of its starts; the process ends at the second one.
const DOES_WELL: &str = "does well";
const RESTARTS: &str = "restarts";
const FAILS: &str = "fails";
const OTHER_PAGE: &str = "does not know its page";
const OTHER_PINS: &str = "sends elsewhere";
const OTHER_RATE: &str = "sends too fast";
const OTHER_BUS: &str = "has its bus elsewhere";
const OTHER_MEMORY: &str = "has its memory elsewhere";

/// What it does there.
fn deeds(does: &str) -> Vec<Deed> {
    let restarts = |by: &str, has_settings| Deed::Restarts {
        by: by.into(),
        has_settings,
    };
    let logs = |line: &str| Deed::Logs(line.into());
    let uart = |pins, rate| Deed::Uart(Wires { pins, rate });
    let bus = |pins| {
        let rate = 250_000;
        Deed::I2c(Wires { pins, rate })
    };
    match does {
        DOES_WELL => vec![
            restarts("Core", true),
            logs("error memory: Ram"),
            uart([34, 33], 38_330),
            bus([26, 27]),
        ],
        RESTARTS => vec![
            restarts("Core", true),
            restarts("Core", false),
            logs("error before that: src/radio.rs:7 no frame"),
            logs("error stopped: the radio failed"),
            restarts("Model(\"WDT\")", false),
        ],
        FAILS => vec![Deed::Fails("a model panicked".into())],
        OTHER_PAGE => vec![logs("error no configuration: Version { found: 9 }")],
        OTHER_PINS => vec![uart([6, 8], 38_330)],
        OTHER_RATE => vec![uart([34, 33], 250_000)],
        OTHER_BUS => vec![bus([27, 26])],
        OTHER_MEMORY => vec![Deed::Memory(vec![(0, vec![0xff; 4096])])],
        _ => Vec::new(),
    }
}

/// Where this computer's programs are.
const SYSTEM: &str = "/usr/bin:/bin";

/// What the process does in some tests; in others nothing. Its reports do not go to the standard output,
/// where tests tell how they went.
#[test]
fn stands_for_chips() {
    let Ok(does) = env::var(DOES) else {
        return;
    };
    let done = deeds(&does);
    let ends = ENDS.iter().position(|end| *end == does);
    let end = ends.or((!done.is_empty()).then_some(1));
    let mut orders = BufReader::new(io::stdin().lock());
    let mut reports = File::options().write(true).open("/dev/fd/3").unwrap();
    let mut notes = File::create(NOTES).unwrap();
    let (mut starts, mut reached) = (0, 0);
    while let Some(told) = read(&mut orders).unwrap() {
        let mut deeds = Vec::new();
        match told {
            Orders::Run { orders, until } => {
                for (number, order) in orders {
                    if let (3, Order::On { seed, .. }) = (number, order) {
                        writeln!(notes, "{seed}").unwrap();
                        if end == Some(starts) {
                            std::process::exit(3);
                        }
                        if does == WAITS {
                            loop {
                                thread::park();
                            }
                        }
                        starts += 1;
                        deeds = done.iter().map(|deed| (until, 3, deed.clone())).collect();
                    }
                }
                reached = until;
            }
            Orders::Look => {}
            Orders::End => writeln!(notes, "end").unwrap(),
            Orders::Load(_) | Orders::Debug(..) => continue,
        }
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

/// ELF's number of a processor.
const ARM: u16 = 40;

/// An ELF file of two vectors at an address, and one section.
fn elf(machine: u16, address: u32, section: &[u8; 6]) -> Vec<u8> {
    let vectors = [0x2004_0000, address + 0x101];
    let names = [b"\0".as_slice(), section, b"\0.shstrtab\0\0\0"].concat();
    let mut file = b"\x7fELF\x01\x01\x01".to_vec();
    file.resize(16, 0);
    let halves = [
        [2, machine, 1, 0, 0x101, 0],
        // Where programs and sections begin, and how long their entries are and how many.
        [52, 0, 112, 0, 0, 0],
        [52, 32, 1, 40, 3, 2],
    ];
    file.extend(halves.concat().into_iter().flat_map(u16::to_le_bytes));
    // The program, at the end of this table.
    let program = [1, 84, address, address, 8, 8, 5, 4];
    let sections = [
        [0; 10],
        [1, 1, 0, 0, 84, 0, 0, 0, 1, 0],
        [8, 3, 0, 0, 92, 18, 0, 0, 1, 0],
    ];
    let words = program.into_iter().chain(vectors);
    file.extend(words.flat_map(u32::to_le_bytes));
    file.extend(names);
    file.extend(
        sections
            .concat()
            .iter()
            .flat_map(|word: &u32| word.to_le_bytes()),
    );
    file
}

/// A folder as that of the sources, in which everything is built.
struct Sources(TempDir);

impl Sources {
    fn new() -> Self {
        let sources = Self(TempDir::new().unwrap());
        sources.write("nrf52840-emulator/Cargo.toml", "");
        sources.write(CHIP_IMAGE, "");
        fs::write(sources.path(CHIP_IMAGE), elf(ARM, 0, b".defmt")).unwrap();
        sources.program("bin/cargo", "exit 0");
        let this = env::current_exe().unwrap();
        let script = format!(
            "exec {} --exact chip_process::stands_for_chips 3>&1 >/dev/null",
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
    refused(
        command().env("PATH", "/nowhere"),
        "`cargo` cannot be started",
    );
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
    let shell = fs::read("/bin/sh").unwrap();
    for other in [
        b"no machine code".to_vec(),
        shell,
        elf(62, 0, b".defmt"),
        elf(ARM, 0x0800_0000, b".defmt"),
        elf(ARM, 0, b".other"),
    ] {
        fs::write(sources.path(CHIP_IMAGE), other).unwrap();
        refused(&mut command(), "is no program for an nRF52840");
    }
    fs::remove_file(sources.path(CHIP_IMAGE)).unwrap();
    refused(&mut command(), "type `cargo xtask firmware`");
}

/// Whoever waits minutes knows for what; and what a configuration of cargo has put elsewhere is not run.
#[test]
fn what_was_not_built_yet_is_told() {
    let sources = Sources::new();
    fs::remove_file(sources.path("target/chip/release/chips")).unwrap();
    let output = sources.host_sim("lab", STAYS).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    let mut lines = stderr.lines();
    assert!(lines.next().unwrap().starts_with("building"), "{stderr}");
    assert!(
        lines.next().unwrap().contains("was built, but is not in"),
        "{stderr}"
    );
    assert_eq!(output.status.code(), Some(2), "{stderr}");
}

/// Before anything is built, and before anybody waits.
#[test]
fn a_node_or_port_that_gdb_cannot_have_is_told() {
    let sources = Sources::new();
    let taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = taken.local_addr().unwrap().port();
    let small = sources.small(0.5);
    let gdb = |what: &str| {
        let mut command = sources.host_sim(&small, STAYS);
        command.args(["--gdb", what]);
        command
    };
    refused(
        &mut gdb(&format!("3:{port}")),
        &format!("port {port} of this computer is taken"),
    );
    sources.program("bin/cargo", "exit 101");
    refused(
        &mut gdb("99"),
        "there is no node 99; there are 1, 2, 3, 20, ",
    );
    for wrong in ["x", "3:", "3:0", "3:65536"] {
        let output = gdb(wrong).output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(stderr.contains("such as 3:3334"), "{stderr}");
    }
}

/// The first network whose node 3 cannot go on, and why. Who restarts by itself goes on.
#[test]
fn what_chips_cannot_do_ends_the_run_with_words() {
    let sources = Sources::new();
    let small = sources.small(0.5);
    for (does, expected) in [
        (
            FAILS,
            "the chip of node 3 cannot be emulated: a model panicked",
        ),
        (
            OTHER_PAGE,
            "the configuration page of node 3 (Version { found: 9 })",
        ),
        (
            OTHER_PINS,
            "its UART has P0.06 and P0.08, where the board has P1.02 and P1.01",
        ),
        (
            OTHER_RATE,
            "its UART has 250000 baud, where its line has 38400",
        ),
        (
            OTHER_BUS,
            "its I2C bus has P0.27 and P0.26, where the board has P0.26 and P0.27",
        ),
        (OTHER_MEMORY, "do not tell what is in the flash of node 3"),
        (DOES_WELL, "the process with the emulated chips has failed"),
    ] {
        refused(&mut sources.host_sim(&small, does), expected);
    }
}

/// A panic, or a watchdog that bites, is in the record with what the image says of it; what a first start is for is no
/// failure.
#[test]
fn a_chip_that_restarts_has_failed() {
    let sources = Sources::new();
    let small = sources.small(0.5);
    let json = sources.path("run.json");
    let failures = |does| {
        let mut command = sources.host_sim(&small, does);
        command.arg("--json").arg(&json);
        refused(
            &mut command,
            "the process with the emulated chips has failed",
        );
        let record = RunRecord::from_json(&fs::read_to_string(&json).unwrap()).unwrap();
        let node = record.nodes.into_iter().find(|node| node.id == 3).unwrap();
        node.failures
            .into_iter()
            .map(|failure| failure.why)
            .collect::<Vec<_>>()
    };
    let told = [
        "its program restarts it: src/radio.rs:7 no frame",
        "its watchdog restarts it: the radio failed",
    ];
    assert_eq!(failures(RESTARTS), told);
    assert_eq!(failures(DOES_WELL), [""; 0]);
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

/// Nobody has connected GDB, and nothing moves.
#[test]
fn who_interrupts_a_run_that_waits_for_gdb_need_do_so_once() {
    let sources = Sources::new();
    let mut command = sources.host_sim(&sources.small(1e6), WAITS);
    let gdb = format!("3:{}", free_port());
    command
        .args(["--gdb", &gdb])
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut simulation = Running(command.spawn().unwrap());
    wait_until(|| {
        assert_eq!(simulation.0.try_wait().unwrap(), None);
        sources.notes().len() == 1
    });
    let chips = children(simulation.0.id());
    assert_eq!(chips.len(), 1, "{chips:?}");
    let pid = simulation.0.id().to_string();
    let kill = Command::new("kill").args(["-INT", &pid]).status();
    assert!(kill.unwrap().success());
    assert_eq!(simulation.0.wait().unwrap().code(), Some(130));
    assert!(!is_running(&chips[0]));
}

/// One that nobody has now.
fn free_port() -> u16 {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    listener.local_addr().unwrap().port()
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

/// `host-sim run lab` on the image that is flashed.
fn lab() -> Command {
    let image = env::var_os("NODE_IMAGE").expect("NODE_IMAGE is not set");
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    command
        .args(["run", "lab", "--backend", "nrf52840", "--image"])
        .arg(image)
        // What emulates chips is found from there.
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// Whoever debugs a node and is killed leaves nobody who has the port.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn chips_that_wait_for_gdb_do_not_outlive_the_simulation() {
    let port = free_port();
    // Not tried: chips could not have it meanwhile.
    let is_taken = || {
        let all = fs::read_to_string("/proc/net/tcp").unwrap();
        all.contains(&format!(":{port:04X} 00000000:0000 0A"))
    };
    let mut command = lab();
    command.args(["--gdb", &format!("3:{port}")]);
    let mut simulation = Running(command.spawn().unwrap());
    wait_until(|| {
        assert_eq!(simulation.0.try_wait().unwrap(), None);
        is_taken()
    });
    let chips = children(simulation.0.id());
    assert_eq!(chips.len(), 1, "{chips:?}");
    drop(simulation);
    // The port is free with its last thread.
    wait_until(|| !is_running(&chips[0]) && !is_taken());
}

/// Nothing of host-sim runs any more when it is killed, but the chips end with it.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn chips_do_not_outlive_the_simulation() {
    let log = TempDir::new().unwrap();
    let log = log.path().join("log");
    let mut simulation = Running(lab().arg("--log").arg(&log).spawn().unwrap());
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
