//! Records of happenings, as commands that run for months write them.

#![cfg(unix)]

use std::{
    io::{BufRead, BufReader, PipeReader, Read, Write},
    net::TcpStream,
    process::{Child, Command, Stdio},
    sync::mpsc::{self, Receiver},
    thread,
};

use tempfile::NamedTempFile;

use crate::common::{HANGS, LineEnd, run};

/// A running `host-sim live`: the records that it writes, one by one, and its other output after its end.
struct Live {
    child: Child,
    url: String,
    records: Receiver<String>,
    stdout: BufReader<std::process::ChildStdout>,
}

impl Live {
    fn start(arguments: &[&str], set: impl FnOnce(&mut Command, &PipeReader)) -> Self {
        let (reader, writer) = std::io::pipe().unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
        command
            .arg("live")
            .args(arguments)
            .env_remove("RUST_LOG")
            .env_remove("JOURNAL_STREAM")
            .stdin(Stdio::null())
            .stdout(Stdio::piped());
        set(&mut command, &reader);
        let mut child = command.stderr(writer).spawn().unwrap();
        // It keeps the other end of the pipe.
        drop(command);
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut url = String::new();
        stdout.read_line(&mut url).unwrap();
        let (sender, records) = mpsc::channel();
        thread::spawn(move || {
            let mut lines = BufReader::new(reader).lines().map_while(Result::ok);
            lines.try_for_each(|line| sender.send(line))
        });
        Self {
            child,
            url: url.trim().to_owned(),
            records,
            stdout,
        }
    }

    fn record(&self) -> String {
        self.records.recv_timeout(HANGS).unwrap()
    }

    /// A request to its server, which it answers with the status.
    fn asks(&self, path: &str) -> String {
        let host = self.url["http://".len()..].split('/').next().unwrap();
        let mut stream = TcpStream::connect(host).unwrap();
        let request = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer.lines().next().unwrap_or_default().to_owned()
    }

    /// Ends it. Returns the records that were not looked at; nothing else was on its standard output.
    fn end(mut self) -> Vec<String> {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        let mut rest = String::new();
        self.stdout.read_to_string(&mut rest).unwrap();
        assert_eq!(rest, "");
        self.records.iter().collect()
    }
}

/// A line that is gone, and the port that it had.
fn lost(set: impl FnOnce(&mut Command, &PipeReader)) -> (Live, String) {
    let (device, keeps_open, port) = LineEnd::pair();
    let live = Live::start(&["--port", &port], set);
    drop((device, keeps_open));
    (live, port)
}

const GONE: &str = "the program at the other end of the line has ended";

#[test]
fn a_filter_that_cannot_be_understood_is_refused() {
    let filter = "info,host_sim::live=loud";
    for command in ["console", "live", "publish", "update"] {
        let done = run(&[command, "--log", filter]);
        assert_eq!((done.code, done.stdout.as_str()), (2, ""));
        let word = "`host_sim::live=loud` is no filter of the log";
        assert!(done.stderr.contains(word), "{}", done.stderr);
    }
    let mut live = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    let done = live.args(["live", "lab"]).env("RUST_LOG", filter).output();
    let done = done.unwrap();
    assert_eq!((done.status.code(), &done.stdout[..]), (Some(2), &b""[..]));
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(said.contains("RUST_LOG"), "{said}");
}

#[test]
fn a_line_that_is_lost_is_a_record_with_time_level_and_port() {
    let (live, port) = lost(|_, _| {});
    let record = live.record();
    let (time, words) = record.split_once(' ').unwrap();
    assert!(time.starts_with("20") && time.ends_with('Z'), "{record}");
    let expected = format!("WARN host_sim::cli::lines: {GONE} port=\"{port}\"");
    assert_eq!(words.trim_start(), expected);
    live.end();
}

#[test]
fn a_filter_chooses_the_records() {
    // The option is stronger than the environment.
    let (device, keeps_open, port) = LineEnd::pair();
    let filter = "host_sim::cli=off,host_sim::live=debug";
    let live = Live::start(&["--port", &port, "--log", filter], |command, _| {
        command.env("RUST_LOG", "trace");
    });
    drop((device, keeps_open));
    assert!(live.asks("/about").contains("403"));
    let record = live.record();
    assert!(
        record.contains(" WARN host_sim::live::server: "),
        "{record}"
    );
    assert_eq!(live.end(), [""; 0]);
}

/// The journal adds the time, and takes the priority from the line.
#[test]
fn records_for_the_journal_have_a_priority_and_no_time() {
    let (live, _) = lost(|command, stderr| {
        let open = rustix::fs::fstat(stderr).unwrap();
        command.env("JOURNAL_STREAM", format!("{}:{}", open.st_dev, open.st_ino));
    });
    let record = live.record();
    let expected = format!("<4> WARN host_sim::cli::lines: {GONE}");
    assert!(record.starts_with(&expected), "{record}");
    live.end();
    // Of a program that inherited the variable, the output leads elsewhere.
    let (live, _) = lost(|command, _| {
        command.env("JOURNAL_STREAM", "1:2");
    });
    assert!(live.record().starts_with("20"));
    live.end();
}

#[test]
fn a_flood_of_requests_makes_few_records() {
    let events = NamedTempFile::new().unwrap();
    let done = run(&["run", "lab", "--events", events.path().to_str().unwrap()]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let live = Live::start(&[events.path().to_str().unwrap()], |_, _| {});
    for _ in 0..300 {
        assert!(live.asks("/about?token=wrong").contains("403"));
    }
    // More than it holds at once, none of which says anything.
    let host = live.url["http://".len()..].split('/').next().unwrap();
    let idle: Vec<_> = (0..300)
        .map(|_| TcpStream::connect(host).unwrap())
        .collect();
    assert!(live.asks("/").contains("200"));
    drop(idle);
    let records = live.end();
    // One of each kind; more if the test takes minutes.
    assert!((2..20).contains(&records.len()), "{records:?}");
    let has = |words: &str| records.iter().any(|record| record.contains(words));
    assert!(has(
        " WARN host_sim::live::server: a request without the token is refused peer=127.0.0.1:"
    ));
    assert!(has(
        " WARN host_sim::live::connections: too many connections"
    ));
}
