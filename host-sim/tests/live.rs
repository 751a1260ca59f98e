//! The page of `host-sim live` and of `run --report` in a real browser: headless Chromium. Where Chromium
//! or its driver is missing, this fails: `cargo xtask test` installs them.

#![cfg(unix)]

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::{SocketAddr, TcpListener, TcpStream},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use answers::record::{
    RunRecord,
    event::{self, Event, What},
    verdict::Verdict,
};
use fantoccini::{
    Client, ClientBuilder,
    wd::{Capabilities, WebDriverCompatibleCommand},
};
use hyper_util::client::legacy::connect::HttpConnector;
use serde_json::{Value, json};
use tempfile::TempDir;

/// A program that ends with its test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn host_sim(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// The page's server, and the URL that it prints.
fn live(arguments: &[&str]) -> (Running, String) {
    let mut child = host_sim(&[&["live"], arguments].concat())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let out = child.stdout.take().unwrap();
    BufReader::new(out).read_line(&mut line).unwrap();
    let child = Running(child);
    assert!(line.starts_with("http://127.0.0.1:"), "{line}");
    (child, line.trim().to_owned())
}

/// Nobody looks at a page for a network whose line is misspelled.
#[test]
fn a_port_that_is_not_there_is_told_at_once() {
    let mut command = host_sim(&["live", "--port", "/nowhere/line"]);
    let ended = command.stderr(Stdio::piped()).output().unwrap();
    assert_eq!(ended.status.code(), Some(2));
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(said.contains("/nowhere/line does not exist"), "{said}");
    assert!(ended.stdout.is_empty());
}

fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
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

struct Browser {
    client: Client,
    _driver: Running,
    _profile: TempDir,
}

impl Browser {
    async fn start(width: u32) -> Self {
        let port = free_port();
        let driver = Command::new("chromedriver")
            .arg(format!("--port={port}"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("chromedriver is missing: `cargo xtask test` installs chromium-driver");
        let driver = Running(driver);
        let profile = TempDir::new().unwrap();
        let mut options = json!({ "args": [
            "--headless=new",
            // Who runs tests as root has no sandbox.
            "--no-sandbox",
            // Containers have little of it.
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            format!("--user-data-dir={}", profile.path().display()),
            "--window-size=1280,1000",
        ] });
        if width < 500 {
            // No window is as narrow as a phone.
            options["mobileEmulation"] =
                json!({ "deviceMetrics": { "width": width, "height": 844, "pixelRatio": 2.0 } });
        }
        let capabilities = json!({
            "browserName": "chrome",
            "goog:chromeOptions": options,
            "goog:loggingPrefs": { "browser": "ALL" },
        });
        let capabilities: Capabilities = serde_json::from_value(capabilities).unwrap();
        let begin = Instant::now();
        let client = loop {
            let mut builder = ClientBuilder::new(HttpConnector::new());
            let builder = builder.capabilities(capabilities.clone());
            match builder.connect(&format!("http://127.0.0.1:{port}")).await {
                Ok(client) => break client,
                Err(error) => assert!(begin.elapsed() < Duration::from_secs(60), "{error}"),
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        };
        Self {
            client,
            _driver: driver,
            _profile: profile,
        }
    }

    async fn run(&self, script: &str) -> Value {
        self.client.execute(script, Vec::new()).await.unwrap()
    }

    /// Waits until a script returns true.
    async fn until(&self, script: &str) {
        let begin = Instant::now();
        while self.run(script).await != json!(true) {
            let state = "return document.body.innerText.slice(0, 600)";
            if begin.elapsed() > Duration::from_secs(120) {
                panic!("{script}: {}", self.run(state).await);
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// What the page shows, folded by its own script.
    async fn shown(&self) -> Value {
        self.run("return JSON.parse(JSON.stringify(window.shown()))")
            .await
    }

    /// The page asked nobody but its own server, and nothing went wrong.
    async fn is_clean(&self, server: &str) {
        let asked = "return performance.getEntriesByType('resource').map(entry => entry.name)";
        for asked in self.run(asked).await.as_array().unwrap() {
            let asked = asked.as_str().unwrap();
            let is_own =
                asked.starts_with("data:") || !server.is_empty() && asked.starts_with(server);
            assert!(is_own, "{asked}");
        }
        let log = self.client.issue_cmd(ConsoleLog).await.unwrap();
        assert_eq!(log, json!([]));
    }

    async fn end(self) {
        self.client.close().await.unwrap();
    }
}

/// Map, table and banner are of what the record says.
async fn shows(browser: &Browser, record: &RunRecord) {
    let shown = browser.shown().await;
    let nodes: Vec<answers::record::Node> =
        serde_json::from_value(shown["record"]["nodes"].clone()).unwrap();
    assert_eq!(nodes, record.nodes);
    let table = "return [...document.querySelectorAll('#checklist tr[data-camera]')]
        .map(row => [...row.cells].map(cell => cell.textContent))";
    let table: Vec<Vec<String>> = serde_json::from_value(browser.run(table).await).unwrap();
    let cameras: Vec<_> = record.cameras().collect();
    assert_eq!(table.len(), cameras.len());
    for (row, camera) in table.iter().zip(cameras) {
        assert_eq!(row[0], camera.id.to_string());
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

async fn banner(browser: &Browser) -> String {
    let text = "return document.getElementById('verdict').textContent";
    browser.run(text).await.as_str().unwrap().to_owned()
}

fn read(path: &Path) -> RunRecord {
    RunRecord::from_json(&fs::read_to_string(path).unwrap()).unwrap()
}

/// A run of `lab` with its record, events and report.
fn lab(folder: &Path) -> (RunRecord, Vec<Event>, PathBuf) {
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

#[tokio::test]
async fn a_report_opens_from_a_file_and_shows_what_the_record_says() {
    let folder = TempDir::new().unwrap();
    let (record, events, report) = lab(folder.path());
    let browser = Browser::start(1280).await;
    browser
        .client
        .goto(&format!("file://{}", report.display()))
        .await
        .unwrap();
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    shows(&browser, &record).await;
    let verdict = Verdict::of(&record).to_string();
    assert_eq!(banner(&browser).await, verdict.lines().next().unwrap());
    // Something is drawn.
    let inks = "const map = document.getElementById('map');
        const {data} = map.getContext('2d').getImageData(0, 0, map.width, map.height);
        const seen = new Set();
        for (let i = 0; i < data.length; i += 4) seen.add(data[i] << 16 | data[i + 1] << 8 | data[i + 2]);
        return seen.size > 10";
    browser.until(inks).await;
    // At a moment in the middle.
    let moment = (record.sim_seconds * 4.0).round() / 8.0;
    let scrub = format!(
        "const scrub = document.getElementById('scrub'); scrub.value = '{moment}';
         scrub.dispatchEvent(new Event('input')); return scrub.valueAsNumber"
    );
    let moment = browser.run(&scrub).await.as_f64().unwrap();
    let at = format!("return document.body.dataset.seconds === '{moment:.3}'");
    browser.until(&at).await;
    let then = || events.iter().take_while(|event| event.seconds <= moment);
    shows(&browser, &event::fold(then()).unwrap()).await;
    let verdict = then().filter_map(|event| match &event.what {
        What::Verdict { words, .. } => words.lines().next(),
        _ => None,
    });
    assert_eq!(banner(&browser).await, verdict.last().unwrap());
    // It plays on from there to the end.
    browser.run("document.getElementById('rate').value = '100'; document.getElementById('play').click()").await;
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    browser.is_clean("").await;
    browser.end().await;
}

/// Asks the server as a program would, and returns the first line of its answer.
fn ask(url: &str, request: &str) -> String {
    let address: SocketAddr = url["http://".len()..]
        .split('/')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
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

#[tokio::test]
async fn a_simulation_shows_itself_in_every_tab_and_after_the_server_came_back() {
    let folder = TempDir::new().unwrap();
    let (record, ..) = lab(folder.path());
    let port = free_port().to_string();
    let arguments = ["lab", "--speed", "max", "--http-port", &port];
    let (server, url) = live(&arguments);
    let origin = url.split("/#").next().unwrap().to_owned();
    let browser = Browser::start(1280).await;
    browser.client.goto(&url).await.unwrap();
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    shows(&browser, &record).await;
    browser.client.refresh().await.unwrap();
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    shows(&browser, &record).await;
    browser.is_clean(&origin).await;

    let first = browser.client.window().await.unwrap();
    let second = browser.client.new_window(true).await.unwrap();
    browser
        .client
        .switch_to_window(second.handle)
        .await
        .unwrap();
    browser.client.goto(&url).await.unwrap();
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    shows(&browser, &record).await;
    browser.client.close_window().await.unwrap();
    browser.client.switch_to_window(first).await.unwrap();

    // It is told that the server is gone; what was there stays.
    drop(server);
    browser
        .until("return document.getElementById('link').classList.contains('lost')")
        .await;
    shows(&browser, &record).await;
    let (_server, again) = live(&arguments);
    assert_ne!(again, url, "another token");
    browser.client.goto("about:blank").await.unwrap();
    browser.client.goto(&again).await.unwrap();
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    shows(&browser, &record).await;
    browser.end().await;
}

#[test]
fn whoever_lacks_the_token_or_comes_from_elsewhere_is_refused() {
    let (_server, url) = live(&["lab", "--speed", "1x"]);
    let (origin, token) = url.split_once("/#").unwrap();
    let host = &origin["http://".len()..];
    let body = "{\"do\":\"pause\"}";
    let command = |origin: &str, token: &str, body: &str| {
        let request = format!(
            "POST /command HTTP/1.1\r\nhost: {host}\r\n{origin}content-type: application/json\r\n\
             x-token: {token}\r\ncontent-length: {}\r\n\r\n{body}",
            body.len()
        );
        ask(&url, &request)
    };
    let own = format!("origin: {origin}\r\n");
    assert!(command(&own, token, body).contains("202"));
    assert!(command(&own, &token.replace(|_: char| true, "0"), body).contains("403"));
    assert!(command(&own, "", body).contains("403"));
    assert!(command("origin: http://elsewhere.example\r\n", token, body).contains("403"));
    assert!(command("origin: null\r\n", token, body).contains("403"));
    assert!(command("", token, body).contains("403"));
    assert!(command(&own, token, "{\"do\":\"anything\"}").contains("422"));
    let get = |path: &str, host: &str| {
        ask(
            &url,
            &format!("GET {path} HTTP/1.1\r\nhost: {host}\r\n\r\n"),
        )
    };
    assert!(get("/", host).contains("200"));
    assert!(
        get("/", "elsewhere.example").contains("421"),
        "a name that was led here"
    );
    assert!(get("/events", host).contains("403"));
    assert!(get("/events?token=0", host).contains("403"));
    assert!(get(&format!("/events?token={token}"), host).contains("200"));
    assert!(get("/about", host).contains("403"));
}

#[tokio::test]
async fn what_nodes_say_is_text_and_the_page_fits_a_phone() {
    let folder = TempDir::new().unwrap();
    let (_, mut events, _) = lab(folder.path());
    let hostile =
        "</script><img src=x onerror=\"window.hacked=1\"><script>window.hacked=1</script>";
    for event in &mut events {
        match &mut event.what {
            What::Verdict {
                words, findings, ..
            } => {
                words.insert_str(0, hostile);
                findings.push(event::Advice {
                    node: 3,
                    words: hostile.to_owned(),
                });
            }
            What::Begin { record, .. } => record.scenario.insert_str(0, hostile),
            _ => {}
        }
    }
    let end = events.pop().unwrap();
    let words = hostile.to_owned();
    let said = What::Said {
        node: Some(3),
        words,
    };
    events.extend([Event::new(end.seconds, said), end]);
    let lines: String = events
        .iter()
        .map(|event| event.to_line().unwrap())
        .collect();
    let stream = folder.path().join("hostile.ndjson");
    fs::write(&stream, lines).unwrap();
    let page = folder.path().join("hostile.html");
    fs::write(&page, host_sim::live::report(&events).unwrap()).unwrap();
    let (_server, url) = live(&[stream.to_str().unwrap()]);
    let browser = Browser::start(390).await;
    for url in [url.clone(), format!("file://{}", page.display())] {
        browser.client.goto(&url).await.unwrap();
        browser
            .until("return document.body.dataset.ended === 'true'")
            .await;
        browser
            .run("document.querySelector('[data-camera=\"3\"]').click()")
            .await;
        browser
            .until("return document.getElementById('node-log').textContent.includes('onerror')")
            .await;
        assert!(banner(&browser).await.starts_with(hostile));
        assert_eq!(
            browser.run("return window.hacked ?? null").await,
            Value::Null
        );
        assert_eq!(browser.run("return document.images.length").await, json!(0));
        let wide = browser
            .run("return [innerWidth, document.documentElement.scrollWidth]")
            .await;
        assert_eq!(wide, json!([390, 390]));
        let large =
            "return parseFloat(getComputedStyle(document.getElementById('walk')).fontSize) >= 20";
        assert_eq!(browser.run(large).await, json!(true));
    }
    browser.end().await;
}

/// Types into the page what a person would, against a coordinator behind a pseudo-terminal.
#[tokio::test]
async fn commands_reach_a_coordinator_on_a_line_and_come_back_confirmed() {
    let folder = TempDir::new().unwrap();
    let line = folder.path().join("line");
    let line = line.to_str().unwrap();
    let rehearsal = host_sim(&["run", "lab", "--console", line, "--speed", "10x"])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let _rehearsal = Running(rehearsal);
    let begin = Instant::now();
    while !Path::new(line).exists() {
        assert!(begin.elapsed() < Duration::from_secs(30), "no line");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let (_server, url) = live(&["--port", line]);
    let browser = Browser::start(1280).await;
    browser.client.goto(&url).await.unwrap();
    browser
        .until("return document.querySelectorAll('#checklist tr[data-camera]').length >= 6")
        .await;
    browser
        .run("document.querySelector('[data-camera=\"3\"]').click()")
        .await;
    let press = |name: &str| {
        format!(
            "[...document.querySelectorAll('#node-controls button')]
             .find(button => button.textContent === '{name}').click()"
        )
    };
    browser.run(&press("track")).await;
    browser
        .until("return document.getElementById('node-log').textContent.includes('track: done')")
        .await;
    browser.run(&press("stop-tracking")).await;
    let done =
        "return document.getElementById('node-log').textContent.includes('stop-tracking: done')";
    browser.until(done).await;
    // What only a simulation can do is refused in words.
    browser.run("[...document.querySelectorAll('#controls button')].find(b => b.textContent === 'open').click()").await;
    browser
        .until(
            "return document.getElementById('log').textContent.includes('join window 60 s: done')",
        )
        .await;
    let keys = "return document.querySelectorAll('input[type=password], input[type=file]').length";
    assert_eq!(
        browser.run(keys).await,
        json!(0),
        "no key is ever asked for"
    );
    browser.end().await;
}

/// From the command line: what cameras see that track, in files, and what happened, as events.
#[test]
fn the_console_writes_what_cameras_track_and_what_happens() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (line, events, tracked, json) = (path("line"), path("e"), path("tracked"), path("j"));
    let rehearsal = host_sim(&["run", "lab", "--console", &line, "--speed", "10x"])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let _rehearsal = Running(rehearsal);
    let begin = Instant::now();
    while !Path::new(&line).exists() {
        assert!(begin.elapsed() < Duration::from_secs(30), "no line");
        std::thread::sleep(Duration::from_millis(20));
    }
    let console = host_sim(&[
        "console",
        "--port",
        &line,
        "--site",
        "lab",
        "--seconds",
        "15",
    ])
    .args(["--command", "1:track", "--command", "2:track"])
    .args(["--events", &events, "--tracked", &tracked, "--json", &json])
    .output()
    .unwrap();
    let told = String::from_utf8_lossy(&console.stdout);
    let stream = event::read(&fs::read(&events).unwrap()[..]).unwrap();
    assert_eq!(event::fold(&stream).unwrap(), read(Path::new(&json)));
    let seen = |stream: &[Event]| {
        let of_1 = stream
            .iter()
            .filter(|e| matches!(e.what, What::Tracked { node: 1, .. }));
        of_1.count()
    };
    assert!(seen(&stream) > 3, "{told}");
    let rows = fs::read_to_string(Path::new(&tracked).join("camera-1.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + seen(&stream));
    assert!(rows.starts_with("seconds,mx,my,left,upper,right,lower,pixels,confidence\n"));
}
