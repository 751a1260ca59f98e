//! Time and memory of the page of `host-sim live`: `cargo xtask bench live`.
//!
//! An hour of `thesis-13` at 100 times real time, with the memory of the server and of the page meanwhile; and
//! 1,000 cameras, drawn while the view zooms and moves about. Fails if a goal is missed.

use std::{fs, process::ExitCode};

use site::{Overrides, Scenario};

#[path = "../../tests/it/live/browser.rs"]
mod browser;
#[path = "../../tests/it/live/thousand.rs"]
mod thousand;

use browser::{Browser, Running, served};

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    let reached = [hour().await, drawing().await];
    match reached.into_iter().all(|reached| reached) {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}

/// Prints a figure and its goal. Returns true if the goal is reached.
fn figure(name: &str, value: f64, unit: &str, (goal, is_reached): (&str, bool)) -> bool {
    let state = if is_reached { "" } else { "   MISSED" };
    println!("  {name:<52} {value:>9.1} {unit:<10} {goal}{state}");
    is_reached
}

/// The thesis's walk again and again, as a site file.
fn rounds(stops: usize) -> String {
    let mut scenario = Scenario::load("thesis-13", &Overrides::default()).unwrap();
    let site = scenario.put_up().unwrap();
    let way = &site.networks[0].targets[0].stops;
    let way = way.iter().map(|&stop| stop.into()).cycle();
    scenario.networks[0].targets[0].stops = Some(way.take(stops).collect());
    toml::to_string(&scenario).unwrap()
}

/// Memory of the machine that a program takes, in bytes.
fn resident(program: &Running) -> f64 {
    let status = fs::read_to_string(format!("/proc/{}/status", program.0.id())).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:"));
    let kib = line.unwrap().split_whitespace().nth(1).unwrap();
    kib.parse::<f64>().unwrap() * 1024.0
}

const MIB: f64 = 1024.0 * 1024.0;

async fn hour() -> bool {
    println!("\nAn hour of thesis-13 at 100 times real time");
    let browser = Browser::start(1280).await;
    let file = browser.profile.path().join("rounds.toml");
    fs::write(&file, rounds(250)).unwrap();
    let (server, url) = served(&["live", file.to_str().unwrap(), "--speed", "100x"]);
    browser.client.goto(&url).await.unwrap();
    let mut measured = Vec::new();
    for minutes in [10, 20, 30, 40, 50, 60] {
        let seconds = 60 * minutes;
        let is_then = format!("return Number(document.body.dataset.seconds) >= {seconds}");
        browser.until(&is_then).await;
        let heap = "gc(); gc(); return performance.memory.usedJSHeapSize";
        let page = browser.run(heap).await.as_f64().unwrap();
        let told = "return document.body.dataset.seconds + ' s, ' + \
            window.shown().record.targets[0].stops.length + ' stops'";
        let told = browser.run(told).await;
        let (server, page) = (resident(&server) / MIB, page / MIB);
        println!("  minute {minutes}: server {server:.1} MiB, page {page:.1} MiB ({told})");
        measured.push([server, page]);
    }
    browser.end().await;
    let [half, hour] = [measured[2], measured[5]];
    let mut is_reached = true;
    for (n, whose) in ["server", "page"].into_iter().enumerate() {
        let grown = hour[n] - half[n];
        let name = format!("memory of the {whose}, grown in the second half");
        is_reached &= figure(&name, grown, "MiB", ("3 at most", grown <= 3.0));
    }
    is_reached
}

async fn drawing() -> bool {
    println!("\n1,000 cameras while a user zooms and moves about");
    let browser = Browser::start(1280).await;
    let page = browser.profile.path().join("thousand.html");
    fs::write(&page, thousand::report(1000)).unwrap();
    let url = format!("file://{}", page.display());
    browser.client.goto(&url).await.unwrap();
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    browser.run(thousand::MOVES).await;
    browser.until("return window.moves.frames >= 300").await;
    let told = "const {times, script} = window.moves;
        const sorted = values => [...values].sort((a, b) => a - b);
        const gaps = sorted(times.slice(1).map((time, i) => time - times[i]));
        const took = sorted(script);
        const last = list => list[Math.floor(list.length * 0.95)];
        return [1000 * gaps.length / (times.at(-1) - times[0]), last(gaps),
            script.reduce((a, b) => a + b) / script.length, last(took)]";
    let told: [f64; 4] = serde_json::from_value(browser.run(told).await).unwrap();
    browser.end().await;
    let [frames, gap, mean, most] = told;
    let goal = ("30 at least", frames >= 30.0);
    let enough = figure("frames a second", frames, "", goal);
    figure("between two frames, of 95 %", gap, "ms at most", ("", true));
    let goal = ("33.3 at most", mean <= 33.3);
    let quick = figure("scripts for a frame, mean", mean, "ms", goal);
    figure(
        "scripts for a frame, of 95 %",
        most,
        "ms at most",
        ("", true),
    );
    enough && quick
}
