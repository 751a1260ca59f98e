//! `host-sim console` as users run it, against the coordinator's own state machine behind a
//! pseudo-terminal, and against lines that fail.

#![cfg(unix)]

use std::{
    fs,
    io::{BufRead, BufReader, ErrorKind, Read, Write},
    os::unix::fs::PermissionsExt,
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::common::{Done, Files, LineEnd, run, wait_until};
use calib_core::Refusal;
use node_firmware::{
    console::{FRAME_MAX, Frames, FromPc, KeyChangeReport, NetworkInfo, ToPc, encode},
    message::{self, CameraState, Hello, MemberKind, Message, PoseParts, Report},
    network::{Attachment, NetworkIdentity},
    role::{
        Output, Role,
        coordinator::{CoordinatorEvent, CoordinatorRole, CoordinatorTask},
    },
};
use serde_json::Value;
use zigbee_link::wire::ShortAddress;

/// The network of a coordinator: cameras 2 and 3 at addresses 1 and 2, target 4 at address 3. Goes
/// on until its line is closed.
struct Site {
    line: LineEnd,
    role: CoordinatorRole,
    begin: Instant,
    key: Option<KeyChangeReport>,
    /// The second camera gets a pose when this command reaches it.
    answers: message::CameraCommand,
    /// It ends as soon as it is asked for more than what it knows.
    ends: bool,
}

impl Site {
    /// Starts it, with these states of its cameras. Keeps the line open as long as the returned end is kept.
    fn start(states: [CameraState; 2]) -> (LineEnd, String) {
        Self::start_until(states, false)
    }

    fn start_until(states: [CameraState; 2], ends: bool) -> (LineEnd, String) {
        let (line, port, name) = LineEnd::pair();
        let mut site = Self {
            line,
            role: CoordinatorRole::new(),
            begin: Instant::now(),
            key: None,
            answers: message::CameraCommand::Initialise,
            ends,
        };
        site.role.on_attached(
            site.now(),
            Some(Attachment {
                network: NetworkIdentity {
                    number: 0x1234,
                    founder: [2; 8],
                },
                own: 0,
            }),
        );
        let camera = MemberKind::Camera { reference: None };
        for (address, id, kind) in [(1, 2, camera), (2, 3, camera), (3, 4, MemberKind::Target)] {
            site.hears(address, &Message::Hello(Hello { id, kind }));
        }
        for (address, state) in (1..).zip(states) {
            site.hears(address, &Message::Report(report(address + 1, state)));
        }
        thread::spawn(move || site.run());
        (port, name)
    }

    fn now(&self) -> zigbee_link::Instant {
        zigbee_link::Instant(self.begin.elapsed().as_micros().try_into().unwrap())
    }

    fn hears(&mut self, from: u16, message: &Message) {
        self.role
            .on_message(self.now(), ShortAddress(from), message);
        self.work();
    }

    fn run(mut self) {
        let mut frames = Frames::default();
        let mut byte = [0];
        loop {
            match self.line.read(&mut byte) {
                Ok(_) => {
                    if let Some(wish) = frames.push::<FromPc>(byte[0]) {
                        if self.ends && wish != FromPc::Refresh {
                            return;
                        }
                        self.role.on_event(self.now(), CoordinatorEvent::Pc(wish));
                    }
                }
                Err(error) if error.kind() == ErrorKind::TimedOut => {}
                // The test is over.
                Err(_) => break,
            }
            self.work();
        }
    }

    /// Does what the role wants, as its surroundings on a node would.
    fn work(&mut self) {
        while let Some(output) = self.role.poll(self.now()) {
            match output {
                Output::Task(task) => self.task(task),
                Output::Send { to, message, .. } => {
                    if let Message::Command(command) = message {
                        let outcome = message::CommandOutcome::of(command == self.answers);
                        self.hears(
                            to.0,
                            &Message::Done(message::CommandResult { command, outcome }),
                        );
                    }
                }
                Output::Save(_) => {}
            }
        }
    }

    fn task(&mut self, task: CoordinatorTask) {
        match task {
            CoordinatorTask::Tell(message) => self.tell(message),
            CoordinatorTask::TellNetwork => self.tell(ToPc::Network(Some(NetworkInfo {
                pan: 0x1234,
                channel: 15,
            }))),
            CoordinatorTask::Remove(address) => self.tell(ToPc::Removed {
                address,
                success: true,
            }),
            CoordinatorTask::ChangeKey(key) => {
                self.key = (key.index() != 1).then_some(KeyChangeReport {
                    index: key.index(),
                    check: key.key().unwrap().check_value(),
                    done: false,
                    unreached: 0,
                });
                self.tell(ToPc::KeyChange(self.key));
                if let Some(key) = &mut self.key {
                    key.done = true;
                }
            }
            CoordinatorTask::ChangePan => self.tell(ToPc::Pan {
                conflict_s: Some(7),
                changes: true,
            }),
            CoordinatorTask::TellConflict => {}
            CoordinatorTask::TellKeyChange => self.tell(ToPc::KeyChange(self.key)),
            CoordinatorTask::OpenJoinWindow(window) => {
                // A camera joins at once.
                assert_eq!(window, Duration::from_secs(60));
                let kind = MemberKind::Camera { reference: None };
                self.hears(9, &Message::Hello(Hello { id: 12, kind }));
            }
        }
    }

    fn tell(&mut self, message: ToPc) {
        // The port may not be open yet, or any more.
        let _ = self
            .line
            .write_all(encode(&message, &mut [0; FRAME_MAX]).unwrap());
    }
}

fn report(id: u16, state: CameraState) -> Report {
    Report {
        id,
        duty: None,
        sightings: 5,
        used: 4,
        chi_squared: 2.5,
        done: true,
        joint: None,
        state,
        mount: None,
    }
}

fn pose() -> CameraState {
    CameraState::Calibrated(PoseParts {
        position: [1.5, -2.0],
        heading: core::f32::consts::FRAC_PI_2,
        covariance: [0.25, 0.125, 1.0, 0.0, 0.0, 0.0001],
    })
}

fn console(port: &str, arguments: &[&str]) -> Done {
    run(&[&["console", "--port", port], arguments].concat())
}

/// A run that fails, and what it says.
fn failure(port: &str, arguments: &[&str]) -> String {
    let done = console(port, arguments);
    assert_eq!(done.code, 2, "{}{}", done.stdout, done.stderr);
    done.stderr
}

/// A run that succeeds, and what it prints.
fn success(port: &str, arguments: &[&str]) -> String {
    let done = console(port, arguments);
    assert_eq!(done.code, 0, "{}{}", done.stdout, done.stderr);
    done.stdout
}

/// The row of the final list with this address.
fn row<'a>(text: &'a str, address: &str) -> Option<&'a str> {
    let mut rows = text.lines().filter(|line| line.starts_with('|'));
    rows.find(|row| row.contains(&format!(" {address} ")))
}

#[test]
fn poses_of_a_calibrated_network() {
    let files = Files::new();
    let (_port, name) = Site::start([pose(), pose()]);
    let (csv, json) = (files.path("poses.csv"), files.path("poses.json"));
    let text = success(
        &name,
        &["--until-calibrated", "--csv", &csv, "--json", &json],
    );
    for part in [
        "network 1234 on channel 15",
        "target 4: member with address 0003",
        "camera 3: calibrated: sigma of its place 1.118 units, of its heading 0.57 deg",
    ] {
        assert!(text.contains(part), "no {part} in {text}");
    }
    assert!(text.contains("2 of 2 cameras are calibrated"), "{text}");
    let row = row(&text, "0002").unwrap();
    assert!(row.contains("calibrated") && row.contains("1.118"), "{row}");
    assert!(
        text.contains("| calibrated |    1.50 |   -2.00 |"),
        "{text}"
    );

    let mut reader = csv::Reader::from_path(&csv).unwrap();
    let head = reader.headers().unwrap().clone();
    let rows: Vec<_> = reader.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 2, "cameras only");
    let value = |name: &str| {
        let column = head.iter().position(|title| title == name);
        rows[1].get(column.unwrap()).unwrap().to_owned()
    };
    assert_eq!(value("camera"), "3");
    assert_eq!(value("status"), "calibrated");
    assert_eq!(value("x"), "1.5");
    assert_eq!(value("cov_xy"), "0.125");
    assert_eq!(value("sightings"), "5");
    // A variance of headings, in squared degrees.
    let variance: f64 = value("cov_tt").parse().unwrap();
    assert!((variance - 0.3283).abs() < 1e-3, "{variance}");

    let json: Value = serde_json::from_str(&fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(json["networks"][0]["channel"], 15);
    assert_eq!(json["nodes"][0]["estimate"]["y"], -2.0);
    assert_eq!(json["nodes"][0]["status"], "calibrated");
    assert_eq!(json["seed"], Value::Null);
    assert_eq!(json["nodes"][2]["role"], "target");
    assert_eq!(json["nodes"][2]["estimate"], Value::Null);
}

/// With a refused camera, or a missing one, the network is not calibrated: exit code 1, and the poses
/// that there are.
#[test]
fn time_is_over_before_all_have_poses() {
    let files = Files::new();
    let (_port, name) = Site::start([pose(), CameraState::Refused(Refusal::DangerCircle)]);
    let csv = files.path("poses.csv");
    let done = console(
        &name,
        &["--until-calibrated", "--seconds", "10", "--csv", &csv],
    );
    assert_eq!(done.code, 1, "{}{}", done.stdout, done.stderr);
    assert!(
        done.stderr.contains("not every camera is calibrated"),
        "{}",
        done.stderr
    );
    assert!(
        done.stdout
            .contains("camera 3: not calibrated: the camera is on the circle"),
        "{}",
        done.stdout
    );
    let csv = fs::read_to_string(csv).unwrap();
    assert!(
        csv.contains("\n3,1,network,false,refused,danger_circle,,,"),
        "{csv}"
    );

    let (_port, name) = Site::start([pose(), pose()]);
    let arguments = ["--until-calibrated", "--cameras", "3", "--seconds", "10"];
    assert_eq!(console(&name, &arguments).code, 1);
}

/// A console may listen for months: the end would be too late to tell of a file that is not written.
#[test]
fn events_that_cannot_be_written_are_told_at_once() {
    let (_port, name) = Site::start([pose(), pose()]);
    let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["console", "--port", &name, "--events", "/dev/full"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let record = lines.next().unwrap().unwrap();
    let expected = "ERROR host_sim::cli::late: cannot be written, and gets nothing more: No space";
    assert!(record.contains(expected), "{record}");
    assert!(record.ends_with("file=\"/dev/full\""), "{record}");
    assert!(child.try_wait().unwrap().is_none(), "it goes on");
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Ctrl-C ends listening, which is what was asked for, and results are written all the same. The exit
/// code is that of the verdict: camera 3 is not calibrated.
#[test]
fn ctrl_c_ends_listening() {
    let files = Files::new();
    let (_port, name) = Site::start([pose(), CameraState::Waiting]);
    for (arguments, code) in [(&[][..], 1), (&["--until-calibrated"], 130)] {
        let csv = files.path(&format!("{code}.csv"));
        let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["console", "--port", &name, "--csv", &csv])
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert!(lines.any(|line| line.unwrap().contains("camera 2: calibrated: sigma")));
        let mut kill = Command::new("kill");
        let kill = kill.args(["-INT", &child.id().to_string()]).status();
        assert!(kill.unwrap().success());
        lines.for_each(drop);
        assert_eq!(child.wait().unwrap().code(), Some(code));
        let csv = fs::read_to_string(csv).unwrap();
        assert!(
            csv.contains("\n2,1,network,false,calibrated,,1.5,"),
            "{csv}"
        );
    }
}

#[test]
fn wishes_are_done_and_confirmed() {
    let files = Files::new();
    let (_port, name) = Site::start([pose(), CameraState::Waiting]);
    let text = success(&name, &["--command", "3:initialise"]);
    assert!(text.contains("camera 3: initialise: done"), "{text}");
    let text = failure(&name, &["--command", "3:learn-colour=1"]);
    assert!(text.contains("camera 3 did not do it"), "{text}");
    let text = failure(&name, &["--command", "4:forget"]);
    assert!(text.contains("node 4 is no camera"), "{text}");

    let text = success(&name, &["--join-window", "60"]);
    assert!(text.contains("asked to open it for 60 s"), "{text}");
    assert!(text.contains("camera 12: member"), "{text}");

    // Both in one go.
    let key = key_file(&files, "new.sitekey", SECOND);
    let text = success(&name, &["--remove", "3", "--change-key", &key]);
    assert!(text.contains("camera 3: removed"), "{text}");
    assert!(text.contains("site key 7: in use"), "{text}");
    assert!(!text.contains("001122"), "{text}");
    assert!(
        row(&text, "0001").is_some() && row(&text, "0002").is_none(),
        "{text}"
    );
    let text = success(&name, &["--change-pan"]);
    assert!(text.contains("takes another PAN identifier"), "{text}");
    let text = failure(&name, &["--remove", "3"]);
    assert!(
        text.contains("node 3 is no member; there are 2, 4, 12"),
        "{text}"
    );
}

/// Keys of which the checksums are right.
const SECOND: &str = "site-key 1 7 00112233445566778899aabbccddeeff 17238689\n";

fn key_file(files: &Files, name: &str, text: &str) -> String {
    let path = files.write(name, text);
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
    path
}

#[test]
fn nobody_answers() {
    let (_coordinator, _port, name) = LineEnd::pair();
    let files = Files::new();
    let csv = files.path("poses.csv");
    let text = failure(&name, &["--csv", &csv]);
    assert!(text.contains("no coordinator answers"), "{text}");
    for check in ["port", "baud", "role"] {
        assert!(text.contains(check), "no {check} in {text}");
    }
    assert!(!fs::exists(csv).unwrap(), "there are no poses");
}

/// Another device talks: at another rate, or a node that has a camera on this line.
#[test]
fn no_coordinator_talks() {
    for (bytes, words) in [
        (&b"\xF8\x00\x1C:\xE6\x80"[..], "check the baud rate"),
        (b"\rGV\r", "its role is camera"),
    ] {
        let (mut other, _port, name) = LineEnd::pair();
        thread::spawn(move || {
            let mut byte = [0];
            loop {
                match other.read(&mut byte) {
                    Ok(_) => other.write_all(bytes).unwrap(),
                    Err(error) if error.kind() == ErrorKind::TimedOut => {}
                    // The test is over.
                    Err(_) => break,
                }
            }
        });
        let text = failure(&name, &[]);
        assert!(text.contains(words), "no {words} in {text}");
    }
}

/// Things that were to be done when the line ended are an error; a camera that is not calibrated is told.
#[test]
fn a_line_that_ends_too_early() {
    let until = "the other end has ended, and not every camera is calibrated";
    for (arguments, code, words) in [
        (
            &["--command", "3:track"][..],
            2,
            "it ended before everything was done",
        ),
        (&["--until-calibrated"], 1, until),
        (
            &[],
            1,
            "no next stop can be named: `--site FILE.toml` tells both",
        ),
    ] {
        let (port, name) = Site::start_until([CameraState::Waiting, pose()], true);
        let done = console(&name, arguments);
        drop(port);
        assert_eq!(done.code, code, "{}{}", done.stdout, done.stderr);
        assert!(
            done.stderr.contains(words),
            "{words} is not in {}",
            done.stderr
        );
    }
}

#[test]
fn wrong_options_and_files_are_told_before_the_port_is_opened() {
    let files = Files::new();
    let port = files.path("ttyACM0");
    let text = failure(&port, &[]);
    assert!(text.contains("ttyACM0 does not exist"), "{text}");
    let public = files.write("public.sitekey", SECOND);
    fs::set_permissions(&public, fs::Permissions::from_mode(0o644)).unwrap();
    let changed = key_file(&files, "changed.sitekey", &SECOND.replace("0011", "1011"));
    let missing = files.path("missing.sitekey");
    for (arguments, word) in [
        (&["--command", "2"][..], "2:learn-colour"),
        (&["--command", "2:dance"], "2:learn-colour"),
        (&["--command", "2:learn-colour="], "2:learn-colour"),
        (&["--join-window", "70000"], "65535"),
        (
            &["--site", "lab", "--stands", "20:1.5"],
            "such as 30:2.5,4.0",
        ),
        (
            &["--site", "lab", "--stands", "20:nan,1"],
            "such as 30:2.5,4.0",
        ),
        (&["--stands", "20:1,2"], "--site"),
        (&["--site", "lab", "--stands", "99:1,2"], "no target 99"),
        (&["--remove", "camera"], "invalid"),
        (&["--seconds", "0"], "above 0"),
        (&["--baud", "0"], "from 1 to"),
        (&["--cameras", "3"], "--until-calibrated"),
        (&["--csv", "-"], "name a file"),
        (&["--csv", "no/such/folder/a.csv"], "no folder"),
        (&["--csv", "a.csv", "--json", "a.csv"], "two results"),
        (&["--change-key", &public], "others may read it"),
        (&["--change-key", &changed], "holds no site key"),
        (&["--change-key", &missing], "cannot be read"),
    ] {
        let text = failure(&port, arguments);
        assert!(text.contains(word), "no {word} in {text}");
        assert!(!text.contains("00112233"), "{text}");
    }
}

/// Two programs: a rehearsal whose coordinator is on a pseudo-terminal, and the console there. In the
/// end they know the same poses, and the console also says what a real network tells.
#[test]
fn a_rehearsals_console_knows_the_poses_of_its_record() {
    let files = Files::new();
    let [pty, run_csv, csv, json] =
        ["site.pty", "run.csv", "console.csv", "console.json"].map(|name| files.path(name));
    let mut rehearsal = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args([
            "run",
            "lab",
            "--speed",
            "8x",
            "--console",
            &pty,
            "--csv",
            &run_csv,
        ])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_until(|| fs::symlink_metadata(&pty).is_ok());
    let arguments = ["--site", "lab", "--csv", &csv, "--json", &json];
    let done = console(&pty, &arguments);
    assert_eq!(rehearsal.wait().unwrap().code(), Some(0));
    // The rehearsal took the line with it: that is an end, and all that was told until then is kept.
    assert_eq!(done.code, 0, "{}{}", done.stdout, done.stderr);
    assert_eq!(done.stderr, "");
    let ended = "the program at the other end of the line has ended";
    assert!(done.stdout.contains(ended), "{}", done.stdout);
    assert!(
        done.stdout.contains("7 of 7 cameras are calibrated"),
        "{}",
        done.stdout
    );
    let rows = |path: &str| {
        let text = fs::read_to_string(path).unwrap();
        let lines = text.lines().map(|line| {
            let cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            // Up to the covariance: then follow the truth, and data that only a camera knows.
            cells[..18].to_vec()
        });
        lines.collect::<Vec<_>>()
    };
    let (told, kept) = (rows(&csv), rows(&run_csv));
    assert_eq!(told.len(), 8);
    assert_eq!(told[0].last().map(String::as_str), Some("cov_tt"));
    assert_eq!(told, kept);
    let json: Value = serde_json::from_str(&fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(json["networks"][0]["building"]["heading_deg"], 0.0);
    assert_eq!(json["nodes"][2]["truth"], Value::Null);
    assert_eq!(json["nodes"][2]["planned"]["x"], 7.0);
    let told = json["nodes"].as_array().unwrap().iter();
    let residuals: usize = told.map(|n| n["residuals"].as_array().unwrap().len()).sum();
    assert!(residuals > 0, "cameras were asked for their sightings");
}

/// A rehearsal of two networks on two lines, and one console for both: one site, in which each wish goes to
/// the coordinator that it concerns.
#[test]
fn the_coordinators_of_a_site_are_one_site() {
    let files = Files::new();
    let [first, second, kept, told] =
        ["1.pty", "2.pty", "run.json", "console.json"].map(|name| files.path(name));
    let site = files.write(
        "two.toml",
        "name = \"two\"\n[camera]\nfield_of_view_deg = 60.0\nfield_of_view_sigma = 0\nprincipal_sigma = 0\nrange = 8.0\n[grid]\nnodes = 8\ncell_nodes = 4\n",
    );
    let lines = [format!("1:{first}"), format!("2:{second}")];
    let mut rehearsal = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["run", &site, "--speed", "8x", "--json", &kept])
        .args(["--console", &lines[0], "--console", &lines[1]])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_until(|| fs::symlink_metadata(&second).is_ok());
    // In the other order than in the file.
    let both = ["--port", &first, "--site", &site, "--json", &told];
    let wishes = ["--join-window", "30", "--command", "7:stop-tracking"];
    let done = console(
        &second,
        &[&both[..], &wishes, &["--until-calibrated"]].concat(),
    );
    assert!(rehearsal.wait().unwrap().success());
    assert_eq!(done.code, 0, "{}{}", done.stdout, done.stderr);
    assert!(
        done.stdout.contains("8 of 8 cameras are calibrated"),
        "{}",
        done.stdout
    );
    for line in [&first, &second] {
        let asked = format!("{line}: join window: asked to open it for 30 s");
        assert!(done.stdout.contains(&asked), "{}", done.stdout);
    }
    let is_done = |line: &str| {
        done.stdout
            .contains(&format!("{line}: camera 7: stop-tracking: done"))
    };
    assert_eq!(
        [is_done(&first), is_done(&second)],
        [false, true],
        "{}",
        done.stdout
    );
    let [kept, told] = [kept, told]
        .map(|path| -> Value { serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap() });
    assert_eq!(told["networks"].as_array().unwrap().len(), 2);
    let cameras = |record: &Value| -> Vec<(u64, u64)> {
        let nodes = record["nodes"].as_array().unwrap().iter();
        let cameras = nodes.filter(|node| node["role"] == "camera");
        let number = |node: &Value, key: &str| node[key].as_u64().unwrap();
        cameras
            .map(|node| (number(node, "id"), number(node, "network")))
            .collect()
    };
    assert_eq!(cameras(&told), cameras(&kept));
    // The file tells how the networks stand to each other.
    for axis in ["x", "y", "heading_deg"] {
        let [kept, told] =
            [&kept, &told].map(|record| record["networks"][1]["frame"][axis].as_f64());
        assert!(
            (kept.unwrap() - told.unwrap()).abs() < 1e-6,
            "{axis}: {kept:?}, {told:?}"
        );
    }
    for (arguments, words) in [
        (&["--port", &second][..], "given twice"),
        (&["--port", &first, "--change-pan"], "alone"),
    ] {
        let text = failure(&second, arguments);
        assert!(text.contains(words), "no {words} in {text}");
    }
}
