//! A site over an MQTT broker: mosquitto, with its own programs as witnesses.

use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader, Read},
    net::TcpStream,
    path::Path,
    process::{Command, Stdio},
    sync::{Arc, Mutex},
    thread,
};

use results::record::{
    RunRecord,
    event::{self, CommandState, Event, What},
};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

use super::{
    browser::{Running, free_port, host_sim},
    looks::{ask, events_until, live, rehearsal},
};
use crate::common::wait_until;

/// A broker that keeps nothing on a disk.
struct Broker {
    folder: TempDir,
    port: u16,
    running: Option<Running>,
}

/// A program of mosquitto. Debian keeps the broker where only root looks for programs.
fn mosquitto(name: &str) -> Command {
    let elsewhere = Path::new("/usr/sbin").join(name);
    match elsewhere.is_file() {
        true => Command::new(elsewhere),
        false => Command::new(name),
    }
}

impl Broker {
    fn start() -> Self {
        Self::with("allow_anonymous true\n", |_| {})
    }

    /// A broker with more settings, of files that are made in its folder.
    fn with(settings: &str, make: impl FnOnce(&Path)) -> Self {
        let folder = TempDir::new().unwrap();
        make(folder.path());
        let port = free_port();
        let settings = settings.replace("FOLDER", folder.path().to_str().unwrap());
        let own = env_user();
        // As root, it would become another user, who may not read the folder.
        let settings = format!("listener {port} 127.0.0.1\nuser {own}\n{settings}");
        fs::write(folder.path().join("conf"), settings).unwrap();
        let mut broker = Self {
            folder,
            port,
            running: None,
        };
        broker.run();
        broker
    }

    fn run(&mut self) {
        let child = mosquitto("mosquitto")
            .arg("-c")
            .arg(self.folder.path().join("conf"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("mosquitto is missing: `cargo xtask test --stage peers` installs it");
        self.running = Some(Running(child));
        wait_until(|| TcpStream::connect(("127.0.0.1", self.port)).is_ok());
    }

    fn kill(&mut self) {
        self.running = None;
    }

    fn url(&self) -> String {
        format!("mqtt://127.0.0.1:{}/building", self.port)
    }

    fn witness(&self) -> Witness {
        Witness::of(self.port)
    }
}

fn env_user() -> String {
    let id = Command::new("id").arg("-un").output().unwrap();
    String::from_utf8(id.stdout).unwrap().trim().to_owned()
}

/// Independent reader of all topics: `mosquitto_sub`.
struct Witness {
    _running: Running,
    seen: Arc<Mutex<Seen>>,
}

#[derive(Default)]
struct Seen {
    /// The last text of each topic that is not empty.
    now: BTreeMap<String, String>,
    /// Topics that were told since it looks, not from what was retained before.
    fresh: Vec<String>,
}

impl Witness {
    fn of(port: u16) -> Self {
        let mut child = mosquitto("mosquitto_sub")
            .args(["-h", "127.0.0.1", "-p", &port.to_string()])
            .args(["-t", "building/#", "-F", "%t %r %p"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("mosquitto_sub is missing: `cargo xtask test --stage peers` installs it");
        let out = child.stdout.take().unwrap();
        let seen = Arc::new(Mutex::new(Seen::default()));
        let own = seen.clone();
        thread::spawn(move || {
            for line in BufReader::new(out).lines().map_while(Result::ok) {
                let mut words = line.splitn(3, ' ');
                let [topic, retained, text] = [(); 3].map(|()| words.next().unwrap_or_default());
                let mut seen = own.lock().unwrap();
                match text {
                    "" => seen.now.remove(topic),
                    text => seen.now.insert(topic.to_owned(), text.to_owned()),
                };
                if retained == "0" {
                    seen.fresh.push(topic.to_owned());
                }
            }
        });
        Self {
            _running: Running(child),
            seen,
        }
    }

    fn text(&self, topic: &str) -> Option<String> {
        self.seen.lock().unwrap().now.get(topic).cloned()
    }

    fn json(&self, topic: &str) -> Value {
        serde_json::from_str(&self.text(topic).expect(topic)).unwrap()
    }

    /// The last messages of all topics that have a lasting state: the others come once, to those who are there.
    fn lasting(&self) -> BTreeMap<String, String> {
        let seen = self.seen.lock().unwrap();
        let all = seen.now.iter().filter(|(topic, _)| {
            let event = topic.split_once("/events/").map(|(_, kind)| kind);
            event.is_none_or(|kind| {
                kind.contains('/') || ["obstacles", "traffic", "verdict", "end"].contains(&kind)
            })
        });
        all.map(|(topic, text)| (topic.clone(), text.clone()))
            .collect()
    }

    fn until(&self, topic: &str, holds: impl Fn(&str) -> bool) {
        wait_until(|| self.text(topic).is_some_and(|text| holds(&text)));
    }

    /// The record that the messages of a publisher come to.
    fn record(&self, publisher: &str) -> RunRecord {
        let lasting = self.lasting();
        let begin = &lasting[&format!("building/{publisher}/begin")];
        let events = format!("building/{publisher}/events/");
        let others = lasting.iter().filter(|(topic, _)| {
            topic
                .strip_prefix(&events)
                .is_some_and(|kind| kind != "verdict")
        });
        let all = [begin].into_iter().chain(others.map(|(_, text)| text));
        let all: Vec<_> = all.map(|text| Event::from_line(text).unwrap()).collect();
        let mut record = event::fold(&all).unwrap();
        record.networks.sort_by_key(|own| own.network);
        record.sightings.sort_by_key(|own| own.network);
        record
    }
}

/// A publisher of the site.
fn publish(broker: &Broker, name: &str, arguments: &[&str]) -> Running {
    let mut command = host_sim(&["publish", "--mqtt", &broker.url(), "--name", name]);
    let mut child = command
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let out = child.stdout.take().unwrap();
    BufReader::new(out).read_line(&mut line).unwrap();
    assert_eq!(line.trim(), format!("building/{name}"));
    Running(child)
}

fn ends(mut child: Running, signal: Signal) {
    let id = Pid::from_child(&child.0);
    kill_process(id, signal).unwrap();
    child.0.wait().unwrap();
}

/// The record that the page gets at first.
fn begun(url: &str) -> RunRecord {
    let events = events_until(url, |event| matches!(event.what, What::Begin { .. }));
    event::fold(&events).unwrap()
}

/// The record that the page's events come to, once it is as wanted.
fn shown(url: &str, holds: impl Fn(&RunRecord) -> bool) -> RunRecord {
    let mut record: Option<RunRecord> = None;
    events_until(url, |event| {
        match (&event.what, &mut record) {
            (What::Begin { record: begun, .. }, _) => record = Some(RunRecord::clone(begun)),
            (_, Some(record)) => record.apply(event),
            _ => {}
        }
        record.as_ref().is_some_and(&holds)
    });
    record.unwrap()
}

fn says(url: &str, part: &str) {
    events_until(
        url,
        |event| matches!(&event.what, What::Said { words, .. } if words.contains(part)),
    );
}

const TWO: &str = "name = \"two\"\n[camera]\nfield_of_view_deg = 60.0\nrange = 8.0\n\
                   [grid]\nnodes = 8\ncell_nodes = 4\n";

/// A site of two networks, and the events and the record of a simulation.
fn two(folder: &Path) -> (String, String, RunRecord) {
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let [site, events] = ["two.toml", "two.ndjson"].map(path);
    fs::write(&site, TWO).unwrap();
    let ran = host_sim(&["run", &site, "--events", &events])
        .stdout(Stdio::null())
        .status()
        .unwrap();
    assert!(ran.code().is_some_and(|code| code < 2));
    let stream = event::read(&fs::read(&events).unwrap()[..]).unwrap();
    let record = event::fold(&stream).unwrap();
    (site, events, record)
}

/// The events of one network of a record, in a file.
fn network(folder: &Path, record: &RunRecord, number: u16) -> String {
    let mut part = record.clone();
    part.networks.retain(|own| own.network == number);
    part.nodes.retain(|node| node.network == number);
    part.targets.retain(|own| own.network == number);
    part.sightings.retain(|own| own.network == number);
    part.tracking.retain(|own| own.network == number);
    let lines = event::of_record(&part, None).into_iter();
    let lines: String = lines.map(|event| event.to_line().unwrap()).collect();
    let path = folder.join(format!("{number}.ndjson"));
    fs::write(&path, lines).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Takes times out: clocks of two publishers are compared by their computers.
fn timeless(mut record: RunRecord) -> RunRecord {
    record.sim_seconds = 0.0;
    // Each coordinator's own.
    record.radio = None;
    for node in &mut record.nodes {
        (node.calibrated_seconds, node.heard_seconds) = (None, None);
    }
    let stops = record.targets.iter_mut().flat_map(|own| &mut own.stops);
    stops.for_each(|stop| stop.seconds = None);
    record
}

#[test]
#[ignore = "needs mosquitto: cargo xtask peers"]
fn what_a_broker_keeps_is_the_record_of_the_one_stream() {
    let folder = TempDir::new().unwrap();
    let (_, events, record) = two(folder.path());
    let broker = Broker::start();
    let witness = broker.witness();
    let _publisher = publish(&broker, "all", &[&events]);
    witness.until("building/all/events/end", |_| true);
    assert_eq!(witness.record("all"), record);
    // A reader that comes later sees the same, and a page too.
    // All that it needs is retained: once the publisher has nothing more to tell, a reader hears nothing else.
    let mut readers = std::iter::repeat_with(|| {
        let late = broker.witness();
        late.until("building/all/events/end", |_| true);
        wait_until(|| late.lasting() == witness.lasting());
        late
    });
    let late = readers
        .by_ref()
        .take(20)
        .find(|late| late.seen.lock().unwrap().fresh.is_empty());
    let late = late.expect("a reader that only hears what is retained");
    let (_server, url) = live(&["--mqtt", &broker.url()]);
    assert_eq!(begun(&url), record);

    let camera = late.json("building/all/camera/3");
    let node = record.nodes.iter().find(|node| node.id == 3).unwrap();
    let estimate = node.estimate.unwrap();
    assert_eq!(camera["camera"], 3);
    assert_eq!(camera["status"], "calibrated");
    assert_eq!(camera["checked"], node.is_checked(&record.limits));
    assert!(camera["moved"].is_null());
    // The whole building's frame, if the site's file tells it, and otherwise that of the network.
    match record.node_in_building(node) {
        Some(placed) => {
            assert_eq!(camera["frame"], "building");
            assert_eq!(camera["x"], placed.estimate.unwrap().x);
        }
        None => {
            assert_eq!(camera["frame"], "network");
            assert_eq!(camera["x"], estimate.x);
        }
    }
    assert_eq!(late.json("building/all/events/verdict")["expected"], 8);
    assert_eq!(late.text("building/all/status").unwrap(), "online");
}

#[test]
#[ignore = "needs mosquitto: cargo xtask peers"]
fn two_publishers_are_one_site() {
    let folder = TempDir::new().unwrap();
    let (_, _, record) = two(folder.path());
    let [first, second] = [1, 2].map(|number| network(folder.path(), &record, number));
    let broker = Broker::start();
    let (_server, url) = live(&["--mqtt", &broker.url()]);
    let west = publish(&broker, "west", &[&second]);
    let _east = publish(&broker, "east", &[&first]);
    let witness = broker.witness();
    for name in ["east", "west"] {
        witness.until(&format!("building/{name}/events/end"), |_| true);
    }
    // One that comes later has everything at once.
    let (_late, late) = live(&["--mqtt", &broker.url()]);
    assert_eq!(timeless(begun(&late)), timeless(record.clone()));
    let all = record.summary.calibrated;
    let expected = record.summary.expected;
    shown(&url, |now| {
        now.networks.len() == 2 && now.summary.calibrated == all
    });
    for url in [&url, &late] {
        events_until(url, |event| match &event.what {
            What::Verdict {
                calibrated,
                expected: of,
                ..
            }
            | What::VerdictChange {
                calibrated,
                expected: of,
                ..
            } => (*calibrated, *of) == (all, expected),
            _ => false,
        });
    }
    // One is lost; then it ends as it should.
    ends(west, Signal::KILL);
    witness.until("building/west/status", |text| text == "offline");
    says(&url, "publisher west: has ended or is lost");
    let west = publish(&broker, "west", &[&second]);
    witness.until("building/west/status", |text| text == "online");
    says(&url, "publisher west: is there again");
    ends(west, Signal::TERM);
    witness.until("building/west/status", |text| text == "offline");
    let again = begun(&late);
    assert_eq!(again.summary.calibrated, all, "what it told is still there");
}

#[test]
#[ignore = "needs mosquitto: cargo xtask peers"]
fn a_broker_that_lost_everything_gets_it_again() {
    let folder = TempDir::new().unwrap();
    let (_, events, record) = two(folder.path());
    let mut broker = Broker::start();
    let _publisher = publish(&broker, "all", &[&events]);
    let (_server, url) = live(&["--mqtt", &broker.url()]);
    shown(&url, |now| {
        now.summary.calibrated == record.summary.calibrated
    });
    broker.kill();
    says(&url, "it is waited for");
    broker.run();
    let witness = broker.witness();
    witness.until("building/all/events/end", |_| true);
    assert_eq!(witness.record("all"), record);
    says(&url, "the broker is there again");
    // The page still has all of it.
    let now = shown(&url, |now| {
        now.summary.calibrated == record.summary.calibrated
    });
    assert_eq!(now.nodes.len(), record.nodes.len());
}

/// Messages that a former run has left behind, and of which nothing is true any more.
#[test]
#[ignore = "needs mosquitto: cargo xtask peers"]
fn what_is_gone_is_taken_back() {
    let folder = TempDir::new().unwrap();
    let (_, events, record) = two(folder.path());
    let first = network(folder.path(), &record, 1);
    let broker = Broker::start();
    let witness = broker.witness();
    let both = publish(&broker, "all", &[&events]);
    witness.until("building/all/events/end", |_| true);
    assert!(witness.text("building/all/camera/8").is_some());
    ends(both, Signal::KILL);
    let _one = publish(&broker, "all", &[&first]);
    for gone in ["camera/8", "events/node/8", "events/network/2"] {
        wait_until(|| witness.text(&format!("building/all/{gone}")).is_none());
    }
    let late = broker.witness();
    late.until("building/all/events/end", |_| true);
    wait_until(|| late.lasting() == witness.lasting());
    assert!(late.text("building/all/camera/4").is_some());
    assert!(late.text("building/all/camera/8").is_none());
}

/// Coordinators on lines, a command from the page, and a line that goes away.
#[test]
#[ignore = "needs mosquitto: cargo xtask peers"]
fn commands_reach_the_coordinator_of_the_publisher_that_obeys() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [site, first, second] = ["two.toml", "1.pty", "2.pty"].map(path);
    fs::write(&site, TWO).unwrap();
    let broker = Broker::start();
    let _rehearsal = rehearsal(&site, "4x", &[&first, &second]);
    let _east = publish(&broker, "east", &["--port", &first, "--site", &site]);
    let west = ["--port", &second, "--site", &site, "--obey"];
    let _west = publish(&broker, "west", &west);
    let (_server, url) = live(&["--mqtt", &broker.url()]);
    shown(&url, |now| {
        let members = now.cameras().filter(|camera| camera.address.is_some());
        let has_pose = |id: u16| {
            now.nodes
                .iter()
                .any(|n| n.id == id && n.estimate.is_some() && n.address.is_some())
        };
        now.networks.len() == 2 && members.count() == 8 && has_pose(7)
    });
    let command = |node: u16| {
        let (origin, token) = url.split_once("/#").unwrap();
        let host = &origin["http://".len()..];
        let body = format!("{{\"do\":\"camera\",\"node\":{node},\"command\":\"track\"}}");
        let length = body.len();
        let request = format!(
            "POST /command HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nX-Token: {token}\r\n\
             Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n{body}"
        );
        assert!(ask(&url, &request).contains("202"));
    };
    command(7);
    let became = |of: u16, state: CommandState| {
        let told = events_until(&url, |event| {
            matches!(&event.what, What::Command { node: Some(node), state: now, .. }
                if (*node, *now) == (of, state))
        });
        let Some(What::Command { words, .. }) = told.into_iter().last().map(|event| event.what)
        else {
            panic!("it is the last one")
        };
        words
    };
    became(7, CommandState::Done);
    events_until(&url, |event| {
        matches!(event.what, What::Tracked { node: 7, .. })
    });
    command(2);
    let why = became(2, CommandState::Failed);
    assert!(why.contains("--obey"), "{why}");
}

/// A publisher that cannot begin, and what it says.
fn refused(arguments: &[&str], environment: &[(&str, &str)]) -> String {
    let mut command = host_sim(&["publish", "lab", "--name", "a"]);
    command.args(arguments).envs(environment.iter().copied());
    let ended = command.stderr(Stdio::piped()).output().unwrap();
    assert_eq!(ended.status.code(), Some(2));
    String::from_utf8(ended.stderr).unwrap()
}

#[test]
#[ignore = "needs mosquitto: cargo xtask peers"]
fn a_broker_that_cannot_be_had_is_told_at_once() {
    let broker = Broker::with(
        "password_file FOLDER/passwords\nallow_anonymous false\n",
        |folder| {
            let made = Command::new("mosquitto_passwd")
                .args(["-b", "-c"])
                .arg(folder.join("passwords"))
                .args(["me", "s3cret"])
                .status();
            assert!(made.unwrap().success());
        },
    );
    let folder = TempDir::new().unwrap();
    let password = folder.path().join("password");
    fs::write(&password, "s3cret\n").unwrap();
    let password = password.to_str().unwrap();
    let url = broker.url().replace("://", "://me@");
    for (arguments, environment, why) in [
        (vec!["--mqtt", &url], vec![], "refuses the user"),
        (
            vec!["--mqtt", &url],
            vec![("MQTT_PASSWORD", "wrong")],
            "refuses the user",
        ),
        (
            vec!["--mqtt", "mqtt://nowhere.invalid/a"],
            vec![],
            "nowhere.invalid is not known",
        ),
        (
            vec!["--mqtt", "mqtt://127.0.0.1:1/a"],
            vec![],
            "no broker listens at 127.0.0.1:1",
        ),
        (
            vec!["--mqtt", "tcp://127.0.0.1/a"],
            vec![],
            "neither mqtt:// nor mqtts://",
        ),
        (
            vec!["--mqtt", "mqtt://me:s3cret@127.0.0.1/a"],
            vec![],
            "--password-file",
        ),
        (
            vec!["--mqtt", "mqtt://127.0.0.1"],
            vec![],
            "topic of the site is missing",
        ),
    ] {
        let said = refused(&arguments, &environment);
        assert!(said.contains(why), "{arguments:?}: {said}");
        assert!(!said.contains("s3cret"), "{said}");
    }
    // Two ways to tell the password.
    for (arguments, environment) in [
        (vec!["--password-file", password], vec![]),
        (vec![], vec![("MQTT_PASSWORD", "s3cret")]),
    ] {
        let mut command = host_sim(&["publish", "lab", "--name", "a", "--mqtt", &url]);
        command.args(arguments).envs(environment);
        let mut child = Running(command.stdout(Stdio::piped()).spawn().unwrap());
        let mut told = [0; 10];
        let out = child.0.stdout.as_mut().unwrap();
        out.read_exact(&mut told).unwrap();
        assert_eq!(&told, b"building/a");
    }
}

/// A command of OpenSSL in a folder.
fn openssl(folder: &Path, arguments: &str) {
    let made = Command::new("openssl")
        .args(arguments.split(' '))
        .current_dir(folder)
        .stderr(Stdio::null())
        .status();
    assert!(
        made.expect("openssl is missing").success(),
        "openssl {arguments}"
    );
}

#[test]
#[ignore = "needs mosquitto: cargo xtask peers"]
fn a_broker_with_tls_is_trusted_by_its_authority() {
    let settings = "allow_anonymous true\ncertfile FOLDER/server.pem\nkeyfile FOLDER/server.key\n";
    let broker = Broker::with(settings, |folder| {
        let key = "-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2";
        openssl(
            folder,
            &format!("req -x509 {key} -keyout ca.key -out ca.pem -subj /CN=own"),
        );
        openssl(
            folder,
            "req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout server.key -out server.csr \
             -subj /CN=localhost",
        );
        fs::write(folder.join("names"), "subjectAltName=DNS:localhost\n").unwrap();
        openssl(
            folder,
            "x509 -req -in server.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -out server.pem \
             -extfile names",
        );
    });
    let url = format!("mqtts://localhost:{}/building", broker.port);
    let said = refused(&["--mqtt", &url], &[]);
    assert!(
        said.contains("no secure connection") && said.contains("--ca"),
        "{said}"
    );
    let ca = broker.folder.path().join("ca.pem");
    let ca = ca.to_str().unwrap();
    let publisher = host_sim(&["publish", "lab", "--name", "a", "--mqtt", &url, "--ca", ca])
        .stdout(Stdio::null())
        .spawn();
    let _publisher = Running(publisher.unwrap());
    let (_server, page) = live(&["--mqtt", &url, "--ca", ca]);
    shown(&page, |now| now.cameras().count() == 7);
}
