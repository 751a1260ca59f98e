//! Networks on emulated boards. `cargo xtask emulate` builds the image and runs those that need it.
#![cfg(unix)]

mod small;

use std::{
    cell::RefCell,
    env, fs,
    io::{self, Write as _},
    os::unix::{fs::PermissionsExt, net::UnixStream},
    path::{Path, PathBuf},
    process::{Child, Command},
    rc::Rc,
    thread,
    time::{Duration, Instant as Moment},
};

use answers::record::{Role as Part, RunRecord};
use board_support::panel::{FRAME_MAX, FromNode, frame};
use host_sim::network::{Emulation, EmulatorError, Options, Simulation};
use node_firmware::facts::Fact;
use site::{Overrides, Scenario};
use small::{SMALL, check_arithmetic};
use tempfile::TempDir;

fn emulation() -> Emulation {
    let image = env::var_os("NODE_IMAGE").expect("NODE_IMAGE is not set: `cargo xtask emulate`");
    Emulation::of(Path::new(&image)).unwrap()
}

/// A file that can be read again.
#[derive(Clone, Default)]
struct Pages(Rc<RefCell<Vec<u8>>>);

impl io::Write for Pages {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Pages {
    /// The sequence numbers of all requests for a beacon in a capture. A node begins with one, and
    /// with a number from its seed.
    fn requests(&self) -> Vec<u8> {
        const FILE_HEADER: usize = 24;
        const RECORD_HEADER: usize = 16;
        const BEACON_REQUEST: [u8; 2] = [0x03, 0x18];
        let bytes = self.0.borrow();
        let number = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
        let mut found = Vec::new();
        let mut record = FILE_HEADER;
        while record < bytes.len() {
            let tap = record + RECORD_HEADER;
            let frame = tap + number(tap + 2);
            if bytes[frame..frame + 2] == BEACON_REQUEST {
                found.push(bytes[frame + 2]);
            }
            record = tap + number(record + 8);
        }
        found
    }
}

fn run(scenario: Scenario) -> (Simulation, RunRecord) {
    run_captured(scenario, Pages::default())
}

fn run_captured(scenario: Scenario, pcap: Pages) -> (Simulation, RunRecord) {
    let options = Options {
        emulation: Some(emulation()),
        pcap: Some(Box::new(pcap)),
        ..Options::default()
    };
    let mut simulation = Simulation::new(scenario, options).unwrap();
    let record = simulation.run(|_| ());
    if let Some(trouble) = simulation.trouble() {
        panic!("{trouble}");
    }
    println!(
        "{}: {:.0} s of the network in {:.0} s",
        record.scenario,
        record.sim_seconds,
        record.wall_seconds.unwrap_or_default()
    );
    (simulation, record)
}

/// Every camera knows where it stands: within an inch and two degrees, several times what is
/// usual, for no two runs in real time are the same.
fn check(record: &RunRecord, cameras: usize) {
    let nodes = record.nodes.iter().filter(|node| node.role == Part::Camera);
    let mut count = 0;
    for node in nodes {
        let id = node.id;
        let error = node.error.as_ref().unwrap_or_else(|| panic!("camera {id}"));
        let off = error.x.hypot(error.y);
        assert!(
            off < 1.0 && error.heading_deg.abs() < 2.0,
            "camera {id}: {error:?}"
        );
        count += 1;
    }
    assert_eq!(count, cameras);
}

#[test]
#[ignore = "needs an image: cargo xtask emulate"]
fn lab_calibrates_itself_on_emulated_boards() {
    let lab = Scenario::load("lab", &Overrides::default()).unwrap();
    let (simulation, record) = run(lab);
    check(&record, 7);
    // The target's board has estimated all of them together.
    for node in &record.nodes {
        let facts = simulation.memory(node.id);
        let mut reports = facts.iter().filter_map(|fact| match fact {
            Fact::Report(report) => *report,
            _ => None,
        });
        let is_camera = node.role == Part::Camera;
        let is_joint = reports.any(|report| report.joint.is_some());
        assert_eq!(is_joint, is_camera, "node {}", node.id);
    }
}

#[test]
#[ignore = "needs an image: cargo xtask emulate"]
fn a_board_goes_on_after_a_power_cut() {
    let files = TempDir::new().unwrap();
    let file = files.path().join("small.toml");
    fs::write(&file, SMALL).unwrap();
    let small = Scenario::load(file.to_str().unwrap(), &Overrides::default()).unwrap();
    let (emulated, here) = (Pages::default(), Pages::default());
    let (simulation, record) = run_captured(small.clone(), emulated.clone());
    check(&record, 3);
    check_arithmetic(&simulation, &record);
    assert!(record.nodes.iter().all(|node| node.payload_bytes.is_none()));
    // Nodes begin as in virtual time: the boards were given their seeds.
    let options = Options {
        pcap: Some(Box::new(here.clone())),
        ..Options::default()
    };
    let record = Simulation::new(small, options).unwrap().run(|_| ());
    assert!(record.nodes.iter().all(|node| node.payload_bytes.is_some()));
    let (emulated, here) = (emulated.requests(), here.requests());
    for first in &here[..4] {
        assert!(emulated.contains(first), "{here:x?} {emulated:x?}");
    }
}

#[test]
#[ignore = "needs the emulator: cargo xtask emulate"]
fn what_is_no_image_ends_the_run() {
    let files = TempDir::new().unwrap();
    let image = files.path().join("image.elf");
    fs::write(&image, "no machine code").unwrap();
    let lab = Scenario::load("lab", &Overrides::default()).unwrap();
    let options = Options {
        emulation: Some(Emulation::of(&image).unwrap()),
        ..Options::default()
    };
    let mut simulation = Simulation::new(lab, options).unwrap();
    simulation.run(|_| ());
    let trouble = simulation.trouble();
    assert!(
        matches!(
            trouble,
            Some(EmulatorError::Ended { .. } | EmulatorError::Silent { .. })
        ),
        "{trouble:?}"
    );
}

/// Where this computer's programs are.
const SYSTEM: &str = "/usr/bin:/bin";

/// A folder with programs, first of all an emulator that does what this script says.
struct Programs {
    files: TempDir,
    image: PathBuf,
}

impl Programs {
    fn with_emulator(script: &str) -> Self {
        let files = TempDir::new().unwrap();
        let emulator = files.path().join("qemu-system-arm");
        let script = format!("#!/bin/sh\n[ \"$1\" = --version ] && exit 0\n{script}");
        fs::write(&emulator, script).unwrap();
        fs::set_permissions(&emulator, fs::Permissions::from_mode(0o755)).unwrap();
        let image = files.path().join("image.elf");
        fs::write(&image, "").unwrap();
        fs::create_dir(files.path().join("tmp")).unwrap();
        Self { files, image }
    }

    /// `host-sim run SCENARIO --backend qemu` where these are the first programs that are found.
    fn host_sim(&self, scenario: &str) -> Command {
        let path = format!("{}:{SYSTEM}", self.files.path().display());
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
        command
            .args(["run", scenario, "--backend", "qemu", "--image"])
            .arg(&self.image)
            .env("PATH", path)
            .env("TMPDIR", self.files.path().join("tmp"));
        command
    }

    /// What is left of runs.
    fn left(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.files.path().join("tmp")).unwrap();
        entries.map(|entry| entry.unwrap().path()).collect()
    }
}

fn refused(command: &mut Command, expected: &str) -> String {
    let output = command.output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(expected), "{stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
    stderr
}

/// The log that a message names.
fn log(message: &str) -> &Path {
    let path = message.split_once(" is in ").unwrap().1;
    Path::new(path.split_once(',').unwrap().0)
}

#[test]
fn what_is_missing_is_told_with_what_to_type() {
    let programs = Programs::with_emulator("exit 0\n");
    let command = || programs.host_sim("lab");
    let nowhere = Programs {
        image: programs.files.path().join("nowhere.elf"),
        files: TempDir::new().unwrap(),
    };
    refused(&mut nowhere.host_sim("lab"), "type `cargo xtask firmware`");
    let emulator = "`sudo apt-get install qemu-system-arm`";
    refused(command().env("PATH", "/nowhere"), emulator);
    if cfg!(target_os = "linux") {
        let leash = "`sudo apt-get install util-linux`";
        refused(command().env("PATH", programs.files.path()), leash);
    }
    refused(command().args(["--speed", "10x"]), "leave out --speed");
    assert_eq!(programs.left(), [] as [&Path; 0]);
}

#[test]
fn an_emulator_that_ends_is_told_with_its_status() {
    let programs = Programs::with_emulator("echo no such machine\nexit 3\n");
    let message = refused(&mut programs.host_sim("lab"), "ended (exit status: 3)");
    assert_eq!(
        fs::read_to_string(log(&message)).unwrap(),
        "no such machine\n"
    );
    // It is there until the next run, which leaves its own.
    // Results are of what was before: nothing.
    let json = programs.files.path().join("run.json");
    let mut command = programs.host_sim("lab");
    let message = refused(command.arg("--json").arg(&json), "ended (exit status: 3)");
    assert!(log(&message).exists());
    assert_eq!(programs.left().len(), 1);
    let json = fs::read_to_string(json).unwrap();
    assert!(
        json.contains("\"cut_short\": \"the emulator of node"),
        "{json}"
    );
    let record = RunRecord::from_json(&json).unwrap();
    assert_eq!((record.scenario.as_str(), record.nodes.len()), ("lab", 9));
    assert!(
        record
            .nodes
            .iter()
            .all(|node| node.calibrated_seconds.is_none())
    );
}

/// No table pretends to be a result.
#[test]
fn a_run_whose_board_failed_says_that_it_is_not_complete() {
    let programs = Programs::with_emulator("exit 3\n");
    let csv = programs.files.path().join("poses.csv");
    let output = programs.host_sim("lab").arg("--csv").arg(&csv).output();
    let output = output.unwrap();
    assert_eq!(output.status.code(), Some(2));
    let stdout = String::from_utf8(output.stdout).unwrap();
    let first = stdout.lines().next().unwrap();
    assert!(
        first.starts_with("NOT COMPLETE: the emulator of node "),
        "{stdout}"
    );
    let csv = fs::read_to_string(csv).unwrap();
    let last = csv.lines().last().unwrap();
    assert!(
        last.starts_with("# not complete: the emulator of node "),
        "{csv}"
    );
}

/// What stands for an emulator in [`a_board_that_stalls_ends_the_run`]: it opens its lines, says
/// something to its radio, and shows its lamps for two seconds. Elsewhere it does nothing.
#[test]
#[cfg(target_os = "linux")]
fn stands_for_a_board_that_stalls() {
    if env::var_os("STALLS").is_none() {
        return;
    }
    let line = |name| UnixStream::connect(name).unwrap();
    let [_device, mut radio, mut panel] = ["device", "radio", "panel"].map(line);
    radio.write_all(&[0x7e]).unwrap();
    let lamps = FromNode::Lamps {
        joined: false,
        target_seen: false,
        calibrated: false,
        may_walk: false,
    };
    for _ in 0..20 {
        let mut buffer = [0; FRAME_MAX];
        panel.write_all(frame(&lamps, &mut buffer)).unwrap();
        thread::sleep(Duration::from_millis(100));
    }
    thread::sleep(Duration::from_secs(1000));
}

/// Long after it was switched on.
#[test]
#[cfg(target_os = "linux")]
fn a_board_that_stalls_ends_the_run() {
    let this = env::current_exe().unwrap();
    let script = format!(
        "exec {} --exact stands_for_a_board_that_stalls\n",
        this.display()
    );
    let programs = Programs::with_emulator(&script);
    let mut command = programs.host_sim("lab");
    command.args(["--board-timeout", "1.5"]).env("STALLS", "");
    let begin = Moment::now();
    refused(&mut command, "did not tell what its lamps show");
    assert!(begin.elapsed() > Duration::from_secs(3));
}

/// An emulator that says which process it is, and does nothing.
#[cfg(target_os = "linux")]
const IDLE: &str = "echo $$ > pid.new\nmv pid.new pid\nexec sleep 1000\n";

#[test]
#[cfg(target_os = "linux")]
fn a_board_that_opens_no_line_ends_the_run() {
    let programs = Programs::with_emulator(IDLE);
    // Until an emulator came so far as to say which process it is.
    let timeouts = ["0.3", "3", "30", "300"];
    let are_told = timeouts.into_iter().any(|timeout| {
        let mut command = programs.host_sim("lab");
        command.args(["--board-timeout", timeout]);
        let expected = format!("did not open its lines within {timeout} s");
        let message = refused(&mut command, &expected);
        assert!(message.contains("--board-timeout"), "{message}");
        // The one that was not waited for any longer has been switched off, as all others.
        let boards = fs::read_dir(log(&message).parent().unwrap().parent().unwrap()).unwrap();
        let pids = boards.map(|board| board.unwrap().path().join("pid"));
        let pids: Vec<_> = pids.filter(|pid| pid.exists()).collect();
        assert!(!pids.iter().any(|pid| is_running(pid)));
        !pids.is_empty()
    });
    assert!(are_told);
}

/// Initial stack, address of the first instruction, and this instruction: a jump to itself.
const LOOP: [u8; 10] = [0, 0x10, 0, 0x20, 9, 0, 0, 0, 0xfe, 0xe7];

#[test]
#[ignore = "needs the emulator: cargo xtask emulate"]
fn an_image_that_hangs_ends_the_run() {
    let files = TempDir::new().unwrap();
    let image = files.path().join("image.bin");
    fs::write(&image, LOOP).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    command
        .args(["run", "lab", "--backend", "qemu", "--board-timeout", "3"])
        .arg("--image")
        .arg(&image)
        .env("TMPDIR", files.path());
    refused(&mut command, "did not talk to its radio within 3 s");
}

/// Ends with its owner.
#[cfg(target_os = "linux")]
struct Running(Child);

#[cfg(target_os = "linux")]
impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Whether there is a process of the number in this file that has not ended.
#[cfg(target_os = "linux")]
fn is_running(pid: &Path) -> bool {
    let pid = fs::read_to_string(pid).unwrap();
    let stat = fs::read_to_string(format!("/proc/{}/stat", pid.trim()));
    // One that nobody has asked for its status yet is a zombie.
    stat.is_ok_and(|stat| !stat.rsplit(')').next().unwrap().starts_with(" Z"))
}

#[cfg(target_os = "linux")]
fn wait_until(mut condition: impl FnMut() -> bool) {
    while !condition() {
        thread::sleep(Duration::from_millis(20));
    }
}

/// Nothing of host-sim runs any more when it is killed, but its emulators end with it. What it
/// leaves on the disk, the next run removes.
#[test]
#[cfg(target_os = "linux")]
fn emulators_do_not_outlive_the_simulation() {
    let programs = Programs::with_emulator(IDLE);
    let mut command = programs.host_sim("lab");
    let simulation = command.args(["--board-timeout", "600"]).spawn();
    let mut simulation = Running(simulation.unwrap());
    let pids = || {
        let boards = programs.left().into_iter().flat_map(fs::read_dir);
        let boards = boards.flatten().map(|board| board.unwrap().path());
        boards
            .map(|board| board.join("pid"))
            .filter(|pid| pid.exists())
    };
    // Coordinator, two references and five cameras; the target is switched on later.
    wait_until(|| {
        assert_eq!(simulation.0.try_wait().unwrap(), None);
        pids().count() == 8
    });
    assert!(pids().all(|pid| is_running(&pid)));
    drop(simulation);
    wait_until(|| !pids().any(|pid| is_running(&pid)));
    let left = programs.left();
    assert_eq!(left.len(), 1);
    let mut next = programs.host_sim("lab");
    refused(
        next.args(["--board-timeout", "0.3"]),
        "did not open its lines",
    );
    assert!(!left[0].exists());
}

/// What the emulator of node 3 gets at its first two starts.
fn starts(seed: &str) -> [String; 2] {
    // The first one tells of itself: there is no other.
    let first = start(seed, "none", "1e6");
    // Now it does not, so it may be switched off at any time, and the second one does.
    let second = start(seed, &first, "0.5");
    [first, second]
}

/// What the emulator of node 3 gets when it is not this, and loses its power then.
fn start(seed: &str, not: &str, cut_s: &str) -> String {
    let idle = "exec sleep 1000";
    let node = format!("case $PWD in */3) ;; *) {idle} ;; esac\n");
    let known = format!("case \"$*\" in *\",arg={not} \"*) {idle} ;; esac\n");
    let tell = "echo \"$@\" > arguments\nexit 3\n";
    let programs = Programs::with_emulator(&format!("{node}{known}{tell}"));
    let file = programs.files.path().join("small.toml");
    let cut = format!("at_s = {cut_s}");
    fs::write(&file, SMALL.replace("at_s = 25.0", &cut)).unwrap();
    let mut command = programs.host_sim(file.to_str().unwrap());
    command.args(["--seed", seed, "--board-timeout", "600"]);
    let message = refused(&mut command, "node 3 ended");
    let arguments = log(&message).with_file_name("arguments");
    seed_of(&fs::read_to_string(arguments).unwrap())
}

/// The node's last argument, a number of its own.
fn seed_of(arguments: &str) -> String {
    let (_, seed) = arguments.split_once(",arg=flash.bin,arg=").unwrap();
    let seed = seed.split(' ').next().unwrap();
    assert!(seed.parse::<u64>().is_ok(), "{arguments}");
    seed.to_owned()
}

#[test]
fn boards_get_another_seed_at_each_start_and_the_same_in_each_run() {
    let [first, second] = starts("1");
    assert_ne!(first, second);
    assert_eq!(starts("1"), [first.clone(), second]);
    assert_ne!(start("2", "none", "1e6"), first);
}

/// The node talks to a camera behind a port of the operating system: as far as it goes without a
/// real one.
#[test]
#[ignore = "takes a minute of real time: cargo xtask emulate"]
fn a_camera_on_a_port_takes_the_place_of_a_simulated_one() {
    let files = TempDir::new().unwrap();
    let [port, log] = ["camera", "log"].map(|name| files.path().join(name));
    let mut camera = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["camera", "--baud", "38400", "--pty"])
        .arg(&port)
        .spawn()
        .unwrap();
    while !port.exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
        assert!(camera.try_wait().unwrap().is_none());
    }
    let file = files.path().join("one.toml");
    fs::write(&file, SMALL).unwrap();
    let ended = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .arg("run")
        .arg(&file)
        .arg("--port")
        .arg(format!("3={}", port.display()))
        .arg("--log")
        .arg(&log)
        .output();
    camera.kill().unwrap();
    camera.wait().unwrap();
    let stderr = String::from_utf8(ended.unwrap().stderr).unwrap();
    let log = fs::read_to_string(log).unwrap();
    // It looks elsewhere, so it finds no pose; but it looks.
    let answers = log
        .lines()
        .filter(|line| line.contains("node 3: ") && line.contains("Look("));
    let mut answers = answers.filter(|line| !line.contains("NotReady") && !line.contains("Failed"));
    assert!(answers.next().is_some(), "{stderr}{log}");
}

#[test]
fn who_has_no_camera_gets_none() {
    for (port, expected) in [
        ("20=/dev/null", "the scenario has no camera 20"),
        ("3=/nowhere", "/nowhere does not exist"),
        ("3", "such as 3=/dev/ttyUSB0"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["run", "lab", "--port", port])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2));
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(stderr.contains(expected), "{stderr}");
    }
}
