//! Looks of tests at a page, and the records to compare it with.

use std::{
    env, fs,
    io::{BufRead, BufReader, Read, Write},
    net::{SocketAddr, TcpStream},
    path::{Path, PathBuf},
    process::Stdio,
};

use fantoccini::wd::WebDriverCompatibleCommand;
use results::record::{
    RunRecord,
    event::{self, Event},
};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::browser::{Browser, HANGS, Running, host_sim, served};
use crate::common::wait_until;

/// The page's server, and the URL that it prints.
pub(super) fn live(arguments: &[&str]) -> (Running, String) {
    served(&[&["live"], arguments].concat())
}

/// The log of the page that Chromium keeps; the standard has no command for it.
#[derive(Debug)]
struct ConsoleLog;

impl WebDriverCompatibleCommand for ConsoleLog {
    fn endpoint(
        &self,
        base: &url::Url,
        session: Option<&str>,
    ) -> Result<url::Url, url::ParseError> {
        base.join(&format!("session/{}/se/log", session.unwrap_or_default()))
    }

    fn method_and_body(&self, _: &url::Url) -> (http::Method, Option<String>) {
        (
            http::Method::POST,
            Some(json!({ "type": "browser" }).to_string()),
        )
    }
}

impl Browser {
    /// Headless Firefox, by the driver that `GECKODRIVER` names.
    pub(super) async fn firefox() -> Self {
        let driver = env::var("GECKODRIVER").expect("`cargo xtask peers` builds it and names it");
        let profile = TempDir::new().unwrap();
        let options = json!({ "args": ["-headless", "-width", "1280", "-height", "1000"] });
        let capabilities = json!({ "browserName": "firefox", "moz:firefoxOptions": options });
        Self::driven(&driver, profile, capabilities).await
    }

    /// The page's state, folded by its own script. As text: drivers are not exact with numbers.
    pub(super) async fn shown(&self) -> Value {
        let shown = self.run("return JSON.stringify(window.shown())").await;
        serde_json::from_str(shown.as_str().unwrap()).unwrap()
    }

    /// Checks that the page asked only its own server, and that nothing went wrong.
    pub(super) async fn is_clean(&self, server: &str) {
        let asked = "return performance.getEntriesByType('resource').map(entry => entry.name)";
        for asked in self.run(asked).await.as_array().unwrap() {
            let asked = asked.as_str().unwrap();
            let is_own =
                asked.starts_with("data:") || !server.is_empty() && asked.starts_with(server);
            assert!(is_own, "{asked}");
        }
        // Drivers of other browsers do not tell the log.
        let has_log = "return navigator.userAgent.includes('Chrome')";
        if self.run(has_log).await == json!(true) {
            let log = self.client.issue_cmd(ConsoleLog).await.unwrap();
            assert_eq!(log, json!([]));
        }
    }
}

/// Checks that map, table and banner agree with the record.
pub(super) async fn shows(browser: &Browser, record: &RunRecord) {
    let shown = browser.shown().await;
    let nodes: Vec<results::record::Node> =
        serde_json::from_value(shown["record"]["nodes"].clone()).unwrap();
    assert_eq!(nodes, record.nodes);
    let table = "return [...document.querySelectorAll('#checklist tr[data-camera]')]
        .map(row => [...row.cells].map(cell => cell.textContent))";
    let table: Vec<Vec<String>> = serde_json::from_value(browser.run(table).await).unwrap();
    let cameras: Vec<_> = record.cameras().collect();
    assert_eq!(table.len(), cameras.len());
    // What needs attention comes first.
    let worth = |row: &Vec<String>| match row.last().unwrap().as_str() {
        "no" => 0,
        "not checked" => 1,
        _ => 2,
    };
    assert!(table.is_sorted_by_key(worth), "{table:?}");
    for camera in cameras {
        let row = table.iter().find(|row| row[0] == camera.id.to_string());
        let row = row.unwrap();
        let joined = if camera.address.is_some() {
            "yes"
        } else {
            "no"
        };
        assert_eq!(row[1], joined, "camera {}", camera.id);
        let status = serde_json::to_value(camera.status).unwrap();
        assert_eq!(row[3], status.as_str().unwrap(), "camera {}", camera.id);
        let place = camera.estimate.map_or_else(
            || "-".to_owned(),
            |estimate| format!("{:.2}, {:.2}", estimate.x, estimate.y),
        );
        // JavaScript rounds halves up.
        let numbers = |text: &str| -> Vec<f64> {
            { text.split(", ") }
                .filter_map(|part| part.parse().ok())
                .collect()
        };
        for (a, b) in numbers(&row[4]).iter().zip(numbers(&place)) {
            assert!(
                (a - b).abs() < 0.0101,
                "camera {}: {} {place}",
                camera.id,
                row[4]
            );
        }
        assert_eq!(row[4] == "-", place == "-", "camera {}", camera.id);
    }
}

pub(super) async fn banner(browser: &Browser) -> String {
    let text = "return document.getElementById('verdict').textContent";
    browser.run(text).await.as_str().unwrap().to_owned()
}

pub(super) fn read(path: &Path) -> RunRecord {
    RunRecord::from_json(&fs::read_to_string(path).unwrap()).unwrap()
}

/// A run of `lab` with its record, events and report.
pub(super) fn lab(folder: &Path) -> (RunRecord, Vec<Event>, PathBuf) {
    let [json, events, report] = ["r.json", "e.ndjson", "r.html"].map(|name| folder.join(name));
    let path = |path: &Path| path.to_str().unwrap().to_owned();
    let (json_path, events_path, report_path) = (path(&json), path(&events), path(&report));
    host_sim(&["run", "lab", "--json", &json_path, "--events", &events_path])
        .args(["--report", &report_path])
        .stdout(Stdio::null())
        .status()
        .unwrap();
    let stream = fs::read(&events).unwrap();
    (read(&json), event::read(&stream[..]).unwrap(), report)
}

/// Asks the server as a program would, and returns the first line of its answer.
pub(super) fn ask(url: &str, request: &str) -> String {
    let address: SocketAddr = url["http://".len()..]
        .split('/')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(HANGS)).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = Vec::new();
    let mut bytes = [0; 512];
    while !answer.contains(&b'\n') {
        let count = stream.read(&mut bytes).unwrap();
        assert!(count > 0, "the server hung up");
        answer.extend(&bytes[..count]);
    }
    let answer = String::from_utf8_lossy(&answer).into_owned();
    answer.lines().next().unwrap().to_owned()
}

/// Waits for a file, such as the line of a coordinator.
fn await_file(path: &str) {
    wait_until(|| Path::new(path).exists());
}

/// A rehearsal whose coordinators are on lines of these names.
pub(super) fn rehearsal(site: &str, speed: &str, lines: &[&str]) -> Running {
    let mut command = host_sim(&["run", site, "--speed", speed]);
    for (number, line) in (1..).zip(lines) {
        command.args(["--console", &format!("{number}:{line}")]);
    }
    let running = Running(command.stdout(Stdio::null()).spawn().unwrap());
    lines.iter().copied().for_each(await_file);
    running
}

/// The events of a page's server up to the one that is looked for.
pub(super) fn events_until(url: &str, mut is_last: impl FnMut(&Event) -> bool) -> Vec<Event> {
    let (origin, token) = url.split_once("/#").unwrap();
    let host = &origin["http://".len()..];
    let mut stream = TcpStream::connect(host).unwrap();
    let timeout = Some(HANGS);
    stream.set_read_timeout(timeout).unwrap();
    let request = format!("GET /events?token={token} HTTP/1.1\r\nhost: {host}\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut events = Vec::new();
    for line in BufReader::new(stream).lines() {
        let line = line.unwrap();
        let Some(line) = line.strip_prefix("data: ") else {
            continue;
        };
        let event = Event::from_line(line).unwrap();
        let is_found = is_last(&event);
        events.push(event);
        if is_found {
            return events;
        }
    }
    panic!("it is not among them: {events:?}")
}
