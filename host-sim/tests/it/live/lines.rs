//! Real networks on the page: coordinators behind pseudo-terminals.

use std::{fs, path::Path, process::Stdio};

use results::record::event::{self, Event, What};
use serde_json::json;
use tempfile::TempDir;

use super::{
    browser::{Browser, host_sim},
    looks::{events_until, live, read, rehearsal},
};

/// A page is not served for a network whose line is misspelled.
#[test]
fn a_port_that_is_not_there_is_told_at_once() {
    let mut command = host_sim(&["live", "--port", "/nowhere/line"]);
    let ended = command.stderr(Stdio::piped()).output().unwrap();
    assert_eq!(ended.status.code(), Some(2));
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(said.contains("/nowhere/line does not exist"), "{said}");
    assert!(ended.stdout.is_empty());
}

/// Types into the page as a user would, against a coordinator behind a pseudo-terminal.
#[tokio::test]
async fn commands_reach_a_coordinator_on_a_line_and_come_back_confirmed() {
    let folder = TempDir::new().unwrap();
    let line = folder.path().join("line");
    let line = line.to_str().unwrap();
    let browser = Browser::start(1280).await;
    let _rehearsal = rehearsal("lab", "2x", &[line]);
    let (_server, url) = live(&["--port", line]);
    browser.client.goto(&url).await.unwrap();
    browser
        .until("return document.querySelectorAll('#checklist tr[data-camera]').length >= 6")
        .await;
    // The coordinator refuses commands before it has started.
    browser.until(&is_calibrated(1)).await;
    browser
        .run("document.querySelector('[data-camera=\"1\"]').click()")
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
    // Commands that only a simulation has are refused in words.
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

/// On the command line: packets of cameras that track, in files, and the events.
#[test]
fn the_console_writes_what_cameras_track_and_what_happens() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (line, events, tracked, json) = (path("line"), path("e"), path("tracked"), path("j"));
    let _rehearsal = rehearsal("lab", "5x", &[&line]);
    // Until the rehearsal is over.
    let console = host_sim(&[
        "console",
        "--port",
        &line,
        "--site",
        "lab",
        "--seconds",
        "600",
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

/// Script that returns true if this camera has a pose on the page.
fn is_calibrated(camera: u16) -> String {
    format!(
        "const nodes = window.shown().record?.nodes ?? [];
         return (nodes.find(node => node.id === {camera})?.estimate ?? null) !== null"
    )
}

/// Presses a button of the page as users do.
fn press(among: &str, name: &str) -> String {
    format!(
        "[...document.querySelectorAll('{among} button')]
         .find(button => button.textContent === '{name}').click()"
    )
}

/// Two coordinators are one page, in whatever order their lines are named; each command goes to the coordinator
/// that it concerns.
#[tokio::test]
async fn the_coordinators_of_a_site_are_one_page() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [site, first, second] = ["two.toml", "1.pty", "2.pty"].map(path);
    let two = "name = \"two\"\n[camera]\nfield_of_view_deg = 60.0\nrange = 8.0\n[grid]\nnodes = 8\ncell_nodes = 4\n";
    fs::write(&site, two).unwrap();
    let browser = Browser::start(1280).await;
    let _rehearsal = rehearsal(&site, "4x", &[&first, &second]);
    let (_server, url) = live(&["--port", &second, "--port", &first, "--site", &site]);
    browser.client.goto(&url).await.unwrap();
    let all = "const record = window.shown().record;
        return record !== null && record.networks.length === 2
            && record.nodes.filter(node => node.role === 'camera' && node.address !== null).length === 8";
    browser.until(all).await;
    browser.until(&is_calibrated(7)).await;
    // In the order of the file.
    let networks = "return window.shown().record.nodes.filter(node => node.role === 'camera')
        .map(node => [node.id, node.network])";
    let expected = json!([
        [1, 1],
        [2, 1],
        [3, 1],
        [4, 1],
        [5, 2],
        [6, 2],
        [7, 2],
        [8, 2]
    ]);
    assert_eq!(browser.run(networks).await, expected);
    let frame = "return window.shown().record.networks.find(own => own.network === 2).frame.x > 20";
    assert_eq!(browser.run(frame).await, json!(true));

    // A camera of the second network, and then every camera.
    let log = |node: u16, words: &str| {
        format!(
            "if (!document.querySelector('[data-camera=\"{node}\"].chosen'))
                 document.querySelector('[data-camera=\"{node}\"]').click();
             return document.getElementById('node-log').textContent.includes('{words}')"
        )
    };
    browser.until(&log(7, "")).await;
    browser.run(&press("#node-controls", "track")).await;
    browser
        .until(&log(7, &format!("track: done: {second}")))
        .await;
    browser.run(&press("#controls", "initialise")).await;
    for (node, line) in [(1, &first), (8, &second)] {
        browser
            .until(&log(node, &format!("initialise: done: {line}")))
            .await;
    }
    browser.run(&press("#controls", "open")).await;
    for line in [&first, &second] {
        let done = format!(
            "return document.getElementById('log').textContent.includes('join window 60 s: done: {line}')"
        );
        browser.until(&done).await;
    }
    browser.is_clean(url.split("/#").next().unwrap()).await;
    browser.end().await;
}

/// A coordinator may restart, or its plug be pulled and put back: the page need not be started again.
#[tokio::test]
async fn a_line_that_failed_is_opened_again() {
    let folder = TempDir::new().unwrap();
    let line = folder.path().join("line");
    let line = line.to_str().unwrap();
    let browser = Browser::start(1280).await;
    let first = rehearsal("lab", "2x", &[line]);
    let (_server, url) = live(&["--port", line]);
    browser.client.goto(&url).await.unwrap();
    browser
        .until("return document.querySelectorAll('#checklist tr[data-camera]').length >= 6")
        .await;
    drop(first);
    let log = |words: &str| {
        format!("return document.getElementById('log').textContent.includes('{words}')")
    };
    browser
        .until(&log("the program at the other end of the line has ended"))
        .await;
    // The link leads to a device whose number another test's device may have by now: then it would be in use.
    fs::remove_file(line).unwrap();
    let _second = rehearsal("lab", "2x", &[line]);
    browser.until(&log("the line is there again")).await;
    browser.run(&press("#controls", "open")).await;
    browser.until(&log("join window 60 s: done")).await;
    browser.end().await;
}

/// A coordinator's message about a target that stands goes over the line, as an event, to the map.
#[tokio::test]
async fn a_target_that_stands_is_drawn_where_it_believes_to_be() {
    let folder = TempDir::new().unwrap();
    let line = folder.path().join("line");
    let line = line.to_str().unwrap();
    // At its first stop the target rests until the page is there, and at a later one until it was looked at.
    let lab = include_str!("../../../../host/site/scenarios/lab.toml");
    let rest = |at_s: f64, for_s: f64| {
        format!(
            "\n[[event]]\nat_s = {at_s}\naction = {{ rest = {{ node = 20, for_s = {for_s} }} }}\n"
        )
    };
    let site = folder.path().join("lab.toml");
    fs::write(
        &site,
        format!("{lab}{}{}", rest(0.0, 60.0), rest(90.0, 1e6)),
    )
    .unwrap();
    let _rehearsal = rehearsal(site.to_str().unwrap(), "10x", &[line]);
    let (_server, url) = live(&["--port", line, "--site", "lab"]);
    let browser = Browser::start(1280).await;
    // Each picture is looked at when the next one is begun, and the last one in the end: a stop's mark, and the target
    // on the same place, while it stands there.
    let spy = "window.circles = [];
        window.isDrawn = false;
        const kind = CanvasRenderingContext2D.prototype;
        const {setTransform, arc} = kind;
        const of = radius => window.circles.filter(([, , r]) => r === radius);
        window.isThere = () =>
            of(2.5).some(([x, y]) => of(6).some(([tx, ty]) => Math.hypot(x - tx, y - ty) < 1));
        kind.setTransform = function (...all) {
            if (this.canvas.id === 'map') {
                window.isDrawn ||= window.isThere();
                window.circles = [];
            }
            return setTransform.apply(this, all);
        };
        kind.arc = function (...all) {
            if (this.canvas.id === 'map') window.circles.push(all);
            return arc.apply(this, all);
        };";
    browser.client.goto(&url).await.unwrap();
    browser.run(spy).await;
    let stops = "return (window.shown().record?.targets[0]?.stops.length ?? 0) >= 3";
    browser.until(stops).await;
    browser
        .until("return window.isDrawn || window.isThere()")
        .await;

    // The first stop may be known with its target. Of a later one the begin is told, and then who saw it there.
    let mut begun = Vec::new();
    let events = events_until(&url, |event| match event.what {
        What::Stop {
            begins: true, is, ..
        } => {
            begun.push(is);
            false
        }
        What::Seen { stop, .. } => begun.iter().any(|begun| Some(begun.stop) == stop),
        _ => false,
    });
    let record = event::fold(&events).unwrap();
    for stop in &begun {
        assert!(
            stop.seconds.is_some() && stop.believed.is_some(),
            "{stop:?}"
        );
        let known = { record.targets[0].stops.iter() }.find(|known| known.stop == stop.stop);
        assert!(known.is_some(), "{stop:?}");
    }
    browser.end().await;
}
