//! Memory of the page and its server.

#![cfg(target_os = "linux")]

use std::{
    env, fs,
    process::{Command, Stdio},
};

use results::record::event::{self, What};
use tempfile::TempDir;
use test_support::amount;

use super::browser::{Browser, host_sim};

/// Set in the process that is measured.
const ALONE: &str = "MEMORY_ALONE";

/// Memory of the machine that this process takes, in bytes.
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

/// Memory of the page's scripts, after a collection of garbage.
async fn heap(browser: &Browser) -> u64 {
    let used = "gc(); gc(); return performance.memory.usedJSHeapSize";
    browser.run(used).await.as_u64().unwrap()
}

/// The walk of `thesis-13` again and again, without an end, as fast as the page follows. The number of kept
/// items is bounded, so memory stops growing at the latest after ten hours. At night it goes on for a month.
///
/// It runs in a process of its own, because other tests take memory too.
#[tokio::test]
async fn memory_does_not_grow_without_end() {
    if env::var_os(ALONE).is_none() {
        let alone = Command::new(env::current_exe().unwrap())
            .args([
                "--exact",
                "--nocapture",
                "live::memory::memory_does_not_grow_without_end",
            ])
            .env(ALONE, "")
            .output()
            .unwrap();
        let said = String::from_utf8(alone.stdout).unwrap();
        println!("{said}");
        assert!(alone.status.success() && said.contains("1 passed"));
        return;
    }
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
        speed: 0.0,
    };
    let address = "127.0.0.1:0".parse().unwrap();
    let (server, _commands) = host_sim::live::serve(address, about).unwrap();
    let browser = Browser::start(1280).await;
    browser.client.goto(&server.url()).await.unwrap();
    let mut measured = Vec::new();
    const MONTH: f64 = 30.0 * 86_400.0;
    let wanted = [600.0, 3600.0, 36_000.0, amount(72_000.0, MONTH)];
    let mut wanted = wanted.into_iter().peekable();
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
    let [_, hour, ten, last] = measured[..] else {
        panic!("{measured:?}")
    };
    // A picture more or less, and the reserves of the allocators.
    const SLACK: u64 = 3 << 20;
    assert!(last.1 <= ten.1 + ten.1 / 10 + SLACK, "page: {measured:?}");
    assert!(last.2 <= ten.2 + ten.2 / 10 + SLACK, "server: {measured:?}");
    // An hour can still be played back completely.
    assert!(hour.1 < 64 << 20, "page: {measured:?}");
    browser.end().await;
}
