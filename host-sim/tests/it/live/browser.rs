//! A browser that is driven, and commands that serve it pages.

use std::{
    io::{BufRead, BufReader},
    net::TcpListener,
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use fantoccini::{Client, ClientBuilder, wd::Capabilities};
use hyper_util::client::legacy::connect::HttpConnector;
use serde_json::{Value, json};
use tempfile::TempDir;

/// Time that no page should need, however slow the computer is.
pub(super) const HANGS: Duration = Duration::from_secs(600);

/// A program that ends with its test.
pub(super) struct Running(pub(super) Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub(super) fn host_sim(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// A command that serves a page, and the URL that it prints.
pub(super) fn served(arguments: &[&str]) -> (Running, String) {
    let mut child = host_sim(arguments).stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    let out = child.stdout.take().unwrap();
    BufReader::new(out).read_line(&mut line).unwrap();
    let child = Running(child);
    assert!(line.starts_with("http://127.0.0.1:"), "{line}");
    (child, line.trim().to_owned())
}

pub(super) fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
}

pub(super) struct Browser {
    pub(super) client: Client,
    /// Folder of the browser's data and of downloads.
    pub(super) profile: TempDir,
    _driver: Running,
}

impl Browser {
    /// Headless Chromium, as wide as a screen or as a phone.
    pub(super) async fn start(width: u32) -> Self {
        let profile = TempDir::new().unwrap();
        let mut options = json!({ "args": [
            "--headless=new",
            // For root, there is no sandbox.
            "--no-sandbox",
            // Containers have little shared memory.
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            // The memory of scripts can be told, byte by byte.
            "--enable-precise-memory-info",
            "--js-flags=--expose-gc",
            format!("--user-data-dir={}", profile.path().display()),
            "--window-size=1280,1000",
        ] });
        // Folder of saved files.
        options["prefs"] = json!({ "download.default_directory": profile.path() });
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
        Self::driven("chromedriver", profile, capabilities).await
    }

    pub(super) async fn driven(driver: &str, profile: TempDir, capabilities: Value) -> Self {
        let port = free_port();
        let mut command = Command::new(driver);
        if capabilities["browserName"] == "firefox" {
            // It talks to its browser on a port of its own, too.
            command.arg(format!("--websocket-port={}", free_port()));
        }
        let running = command
            .arg(format!("--port={port}"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        let running = running.unwrap_or_else(|_| {
            panic!("{driver} is missing: `cargo xtask test` installs what it needs")
        });
        let running = Running(running);
        let capabilities: Capabilities = serde_json::from_value(capabilities).unwrap();
        let begin = Instant::now();
        let client = loop {
            let mut builder = ClientBuilder::new(HttpConnector::new());
            let builder = builder.capabilities(capabilities.clone());
            match builder.connect(&format!("http://127.0.0.1:{port}")).await {
                Ok(client) => break client,
                Err(error) => assert!(begin.elapsed() < HANGS, "{error}"),
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        };
        Self {
            client,
            profile,
            _driver: running,
        }
    }

    pub(super) async fn run(&self, script: &str) -> Value {
        self.client.execute(script, Vec::new()).await.unwrap()
    }

    /// Waits until a script returns true.
    pub(super) async fn until(&self, script: &str) {
        let begin = Instant::now();
        while self.run(script).await != json!(true) {
            let state = "return document.body.innerText.slice(0, 600)";
            if begin.elapsed() > HANGS {
                panic!("{script}: {}", self.run(state).await);
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    pub(super) async fn end(self) {
        self.client.close().await.unwrap();
    }
}
