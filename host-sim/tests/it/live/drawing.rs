//! Work of drawing.

use std::{fs, process::Stdio};

use serde_json::json;
use tempfile::TempDir;

use super::{
    browser::{Browser, host_sim},
    looks::read,
    thousand::{self, MOVES},
};

/// However many cameras there are, a frame draws a bounded part of them while the user zooms and moves about;
/// afterwards the picture is whole again.
#[tokio::test]
async fn a_frame_draws_a_bounded_part_of_a_thousand_cameras() {
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("thousand.html");
    fs::write(&page, thousand::report(1000)).unwrap();
    let browser = Browser::start(1280).await;
    let url = format!("file://{}", page.display());
    browser.client.goto(&url).await.unwrap();
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    // Each camera, and its field of view, is a path.
    let count = "window.paths = 0;
        const kind = CanvasRenderingContext2D.prototype;
        const own = kind.beginPath;
        kind.beginPath = function () { window.paths += 1; own.call(this); };";
    browser.run(count).await;
    browser.run(MOVES).await;
    browser.until("return window.moves.frames >= 60").await;
    let most = browser.run("return Math.max(...window.moves.paths)").await;
    let most = most.as_u64().unwrap();
    assert!((1..=600).contains(&most), "{most} paths in a frame");
    // A whole picture takes more than one frame may draw.
    browser.run("window.moves.stop(); window.paths = 0;").await;
    browser
        .run("document.getElementById('zoom-in').click()")
        .await;
    browser.until("return window.paths >= 2000").await;
    let still = "const before = window.paths;
        return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() =>
            done(window.paths === before))))";
    browser.until(still).await;
    assert_eq!(browser.run("return window.moves.errors").await, json!(0));
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
    let is_found = |camera: &&results::record::Node| {
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
