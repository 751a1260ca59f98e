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
    served(&[&["live"], arguments].concat())
}

/// A command that serves a page, and the URL that it prints.
fn served(arguments: &[&str]) -> (Running, String) {
    let mut child = host_sim(arguments).stdout(Stdio::piped()).spawn().unwrap();
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
            // What scripts hold can be told, byte by byte.
            "--enable-precise-memory-info",
            "--js-flags=--expose-gc",
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

/// What the editor's page tells of a camera: the cells of its row.
async fn row(browser: &Browser, camera: u16) -> Vec<String> {
    let cells = format!(
        "return [...document.querySelector('#cameras tr[data-camera=\"{camera}\"]').cells]
            .map(cell => cell.textContent)"
    );
    serde_json::from_value(browser.run(&cells).await).unwrap()
}

/// Drags from one place of the plan to another.
fn drag(from: [f64; 2], to: [f64; 2]) -> String {
    let [[a, b], [c, d]] = [from, to];
    format!(
        "const svg = document.getElementById('site');
         const at = (x, y) => new DOMPoint(x, -y).matrixTransform(svg.getScreenCTM());
         const event = (name, x, y) => new PointerEvent(name,
             {{clientX: at(x, y).x, clientY: at(x, y).y, pointerId: 1, bubbles: true}});
         // Only pointers that there are can be captured.
         svg.setPointerCapture = () => {{}};
         const from = document.elementFromPoint(at({a}, {b}).x, at({a}, {b}).y);
         from.dispatchEvent(event('pointerdown', {a}, {b}));
         svg.dispatchEvent(event('pointermove', {c}, {d}));
         svg.dispatchEvent(event('pointerup', {c}, {d}));"
    )
}

/// Waits until the server has judged what was done last.
async fn judged(browser: &Browser) {
    let done = "return document.getElementById('link').textContent === 'computed' && isJudged()";
    let is = "window.isJudged = () => document.body.dataset.judged !== window.judgedBefore";
    browser.run(is).await;
    browser.until(done).await;
    browser
        .run("window.judgedBefore = document.body.dataset.judged")
        .await;
}

#[tokio::test]
async fn a_site_is_edited_and_calibrates() {
    let folder = TempDir::new().unwrap();
    // A name that would be more than text, were it not escaped.
    let [site, saved, record] = ["<img src=x onerror=alert(1)>.toml", "saved.toml", "r.json"]
        .map(|name| folder.path().join(name));
    let (_, thesis) = site::BUILT_IN[0];
    let hostile = "name = \"<script>document.body.dataset.hostile = 'true'</script>\"";
    let text = thesis.replace("name = \"thesis-13\"", hostile);
    assert_ne!(text, thesis);
    fs::write(&site, &text).unwrap();
    let path = |path: &Path| path.to_str().unwrap().to_owned();
    let (_server, url) = served(&["edit", &path(&site), "--save", &path(&saved)]);
    let browser = Browser::start(1280).await;
    browser.client.goto(&url).await.unwrap();
    judged(&browser).await;
    let before = row(&browser, 3).await;
    assert_eq!(before[1], "15.00, 2.00");
    let sigma = |row: &[String]| row[4].parse::<f64>().unwrap();
    assert!(sigma(&before) > 0.0 && sigma(&before) < 0.1, "{before:?}");
    let cells = "return document.querySelectorAll('#site .cell').length > 100";
    assert_eq!(browser.run(cells).await, json!(true));

    // Moved and turned with a pointer, and back.
    browser.run(&drag([15.0, 2.0], [15.5, 2.5])).await;
    judged(&browser).await;
    let moved = row(&browser, 3).await;
    assert_eq!(moved[1], "15.50, 2.50");
    assert_ne!(sigma(&moved), sigma(&before));
    browser.run("document.getElementById('undo').click()").await;
    judged(&browser).await;
    assert_eq!(row(&browser, 3).await, before);
    browser.run("document.getElementById('redo').click()").await;
    judged(&browser).await;
    assert_eq!(row(&browser, 3).await, moved);
    // Turned with a key.
    let key = "document.querySelector('#site [data-key=\"camera-0-3\"]').focus();
        document.dispatchEvent(new KeyboardEvent('keydown', {key: 'q'}))";
    browser.run(key).await;
    judged(&browser).await;
    assert_eq!(row(&browser, 3).await[2], "131.0°");
    // A further camera where it is advised.
    browser
        .run("document.getElementById('advise').click()")
        .await;
    judged(&browser).await;
    browser
        .run("document.querySelector('#advice button').click()")
        .await;
    judged(&browser).await;
    let further = row(&browser, 14).await;
    assert!(sigma(&further) > 0.0, "{further:?}");
    // A wall at the border.
    let wall = "document.getElementById('tool-wall').click();
        const svg = document.getElementById('site');
        const at = (x, y) => new DOMPoint(x, -y).matrixTransform(svg.getScreenCTM());
        for (const [x, y] of [[26, 26], [27.5, 26]]) {
            svg.dispatchEvent(new PointerEvent('pointerdown', {clientX: at(x, y).x, clientY: at(x, y).y}));
        }
        document.dispatchEvent(new KeyboardEvent('keydown', {key: 'Enter'}))";
    browser.run(wall).await;
    judged(&browser).await;
    browser.run("document.getElementById('save').click()").await;
    browser
        .until("return document.getElementById('link').textContent.startsWith('saved as')")
        .await;

    // The input is as it was; of the new file only what was changed differs, and it calibrates.
    assert_eq!(fs::read_to_string(&site).unwrap(), text);
    let new = fs::read_to_string(&saved).unwrap();
    let lost: Vec<_> = { text.lines() }
        .filter(|line| !new.lines().any(|other| other == *line))
        .collect();
    assert_eq!(lost.len(), 1, "{lost:?}");
    assert!(lost[0].contains("id = 3"), "{lost:?}");
    assert!(new.contains("wall = "), "{new}");
    let ended = host_sim(&["run", &path(&saved), "--json", &path(&record)])
        .stdout(Stdio::null())
        .status()
        .unwrap();
    assert!(ended.success());
    let record = read(&record);
    assert_eq!(record.cameras().count(), 14);
    assert!(record.cameras().all(|camera| camera.estimate.is_some()));

    let hostile = "return [document.body.dataset.hostile ?? null, document.getElementById('name').textContent]";
    let name = "<script>document.body.dataset.hostile = 'true'</script>";
    assert_eq!(browser.run(hostile).await, json!([null, name]));
    let own = &url[..url.find('#').unwrap()];
    browser.is_clean(own).await;
    browser.end().await;

    // Neither another page nor one without the token.
    let host = own["http://".len()..].trim_end_matches('/');
    let token = &url[url.find('#').unwrap() + 1..];
    for (path, origin, token) in [
        ("design", "http://elsewhere.example".to_owned(), token),
        ("save", "http://elsewhere.example".to_owned(), token),
        ("design", format!("http://{host}"), "0123"),
        ("save", format!("http://{host}"), "0123"),
    ] {
        let request = format!(
            "POST /{path} HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nX-Token: {token}\r\n\
             Content-Type: application/json\r\nContent-Length: 2\r\nConnection: close\r\n\r\n{{}}"
        );
        assert_eq!(ask(&url, &request), "HTTP/1.1 403 Forbidden", "{path}");
    }
    let request =
        format!("GET /site?token=0123 HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    assert_eq!(ask(&url, &request), "HTTP/1.1 403 Forbidden");
}

/// What this process takes of the machine's memory, in bytes.
#[cfg(target_os = "linux")]
fn resident() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:"));
    let kib: u64 = line
        .unwrap()
        .split_whitespace()
        .nth(1)
        .unwrap()
        .parse()
        .unwrap();
    kib << 10
}

/// What the page's scripts hold, after a collection of what they do not.
#[cfg(target_os = "linux")]
async fn heap(browser: &Browser) -> u64 {
    let used = "gc(); gc(); return performance.memory.usedJSHeapSize";
    browser.run(used).await.as_u64().unwrap()
}

/// The walk of `thesis-13` again and again, without an end, as fast as the page follows. What is kept is
/// bounded in number, so nothing grows once there is as much: at the latest after ten hours.
#[cfg(target_os = "linux")]
#[tokio::test]
async fn memory_does_not_grow_without_end() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("e.ndjson");
    let ran = host_sim(&["run", "thesis-13", "--events", file.to_str().unwrap()])
        .stdout(Stdio::null())
        .status()
        .unwrap();
    assert!(ran.success());
    let events = event::read(&fs::read(&file).unwrap()[..]).unwrap();
    let walk = events.last().unwrap().seconds;
    let about = host_sim::live::About {
        name: "thesis-13".to_owned(),
        kind: "recorded",
    };
    let address = "127.0.0.1:0".parse().unwrap();
    let (server, _commands) = host_sim::live::serve(address, about).unwrap();
    let browser = Browser::start(1280).await;
    browser.client.goto(&server.url()).await.unwrap();
    let mut measured = Vec::new();
    let mut wanted = [600.0, 3600.0, 36_000.0, 72_000.0].into_iter().peekable();
    for round in 0.. {
        let Some(&minute) = wanted.peek() else { break };
        let begin = walk * f64::from(round);
        let again = events.iter().filter(|event| match event.what {
            What::Begin { .. } => round == 0,
            What::End { .. } => false,
            _ => true,
        });
        let shifted = again.cloned().map(|mut event| {
            event.seconds += begin;
            event
        });
        let shifted: Vec<_> = shifted.collect();
        let last = shifted.last().unwrap().seconds;
        server.tell(shifted);
        let shown = format!("return Number(document.body.dataset.seconds) >= {last:.3} - 0.001");
        browser.until(&shown).await;
        if last >= minute {
            measured.push((last / 60.0, heap(&browser).await, resident()));
            wanted.next();
        }
    }
    for (minutes, heap, resident) in &measured {
        println!("minute {minutes:.0}: page {heap} bytes, server {resident} bytes");
    }
    let [_, hour, ten, twenty] = measured[..] else {
        panic!("{measured:?}")
    };
    // A picture more or less, and what the allocators keep.
    const SLACK: u64 = 3 << 20;
    assert!(twenty.1 <= ten.1 + ten.1 / 10 + SLACK, "page: {measured:?}");
    assert!(
        twenty.2 <= ten.2 + ten.2 / 10 + SLACK,
        "server: {measured:?}"
    );
    // Of an hour, everything can still be played back.
    assert!(hour.1 < 64 << 20, "page: {measured:?}");
    browser.end().await;
}

/// The picture tells no more and no less than the record.
#[test]
fn a_run_becomes_a_small_picture_that_moves() {
    let folder = TempDir::new().unwrap();
    let [svg, json] = ["a.svg", "r.json"].map(|name| folder.path().join(name));
    let ran = host_sim(&["run", "lab", "--animation", svg.to_str().unwrap()])
        .args(["--json", json.to_str().unwrap()])
        .stdout(Stdio::null())
        .status();
    assert!(ran.unwrap().code().is_some());
    let text = fs::read_to_string(&svg).unwrap();
    assert!(text.len() < 100_000, "{} bytes", text.len());
    let drawn = roxmltree::Document::parse(&text).unwrap();
    let named = |name: &'static str| {
        drawn
            .descendants()
            .filter(move |node| node.has_tag_name(name))
    };
    assert_eq!(named("script").count(), 0);
    let record = read(&json);
    let network = record.nodes[0].network;
    let cameras = || record.cameras().filter(|camera| camera.network == network);
    // And the target.
    assert_eq!(named("circle").count(), cameras().count() + 1);
    let is_found = |camera: &&answers::record::Node| {
        camera.status == Some(calib_core::Status::Calibrated) && camera.calibrated_seconds.is_some()
    };
    assert_eq!(named("ellipse").count(), cameras().filter(is_found).count());
    assert!(named("ellipse").count() > 0);
    // All moments are in their order, within the whole.
    for moving in named("animate") {
        let times = moving.attribute("keyTimes").unwrap().split(';');
        let times: Vec<f64> = times.map(|time| time.parse().unwrap()).collect();
        assert_eq!(
            times.len(),
            moving.attribute("values").unwrap().split(';').count()
        );
        assert!(times.is_sorted() && times[0] == 0.0, "{times:?}");
        assert!(
            times.iter().all(|time| (0.0..=1.0).contains(time)),
            "{times:?}"
        );
    }
}
