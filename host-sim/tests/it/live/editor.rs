//! The page on which a site is edited.

use std::{fs, path::Path, process::Stdio};

use serde_json::json;
use tempfile::TempDir;

use super::{
    browser::{Browser, host_sim, served},
    looks::{ask, read},
};
use crate::common::wait_until;

/// A camera's row on the editor's page: its cells.
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
         // Only existing pointers can be captured.
         svg.setPointerCapture = () => {{}};
         const from = document.elementFromPoint(at({a}, {b}).x, at({a}, {b}).y);
         from.dispatchEvent(event('pointerdown', {a}, {b}));
         svg.dispatchEvent(event('pointermove', {c}, {d}));
         svg.dispatchEvent(event('pointerup', {c}, {d}));"
    )
}

/// Waits until the server has judged the last change.
async fn judged(browser: &Browser) {
    let done = "return document.getElementById('link').textContent === 'computed' && isJudged()";
    let is = "window.isJudged = () => document.body.dataset.judged !== window.judgedBefore";
    browser.run(is).await;
    browser.until(done).await;
    browser
        .run("window.judgedBefore = document.body.dataset.judged")
        .await;
}

/// A room as in docs/start.md.
const ROOM: &str = r#"
name = "room"
unit = "m"
world = { low = [0.0, 0.0], high = [6.0, 5.0] }
[camera]
field_of_view_deg = 60.0
projection = "pin-hole"
range = 8.0
[[network]]
references = { cameras = [1, 2] }
camera = [
  { id = 1, x = 0.2, y = 0.2, heading_deg = 45.0 },
  { id = 2, x = 5.0, y = 0.2, heading_deg = 110.0 },
  { id = 3, x = 0.2, y = 4.8, heading_deg = 325.0 },
]
target = [{ id = 20 }]
"#;

/// Height and pitch of the form are in the saved file; with empty fields the camera is level again.
#[tokio::test]
async fn a_camera_is_hung_by_the_form() {
    let folder = TempDir::new().unwrap();
    let site = folder.path().join("room.toml");
    fs::write(&site, ROOM).unwrap();
    let path = site.to_str().unwrap();
    let (_server, url) = served(&["edit", path, "--save", path]);
    let browser = Browser::start(1280).await;
    browser.client.goto(&url).await.unwrap();
    judged(&browser).await;
    let before = row(&browser, 3).await;
    let fill = |id: &str, value: &str| {
        format!(
            "const field = document.getElementById('{id}');
             field.value = '{value}'; field.dispatchEvent(new Event('change'));"
        )
    };
    let choose = "document.querySelector('#cameras tr[data-camera=\"3\"]').click()";
    browser.run(choose).await;
    for (id, value) in [("height", "2.5"), ("pitch", "30")] {
        browser.run(&fill(id, value)).await;
        judged(&browser).await;
    }
    browser.run("document.getElementById('save').click()").await;
    let saved = "return document.getElementById('link').textContent.startsWith('saved')";
    browser.until(saved).await;
    let text = fs::read_to_string(&site).unwrap();
    assert!(
        text.contains("heading_deg = 325.0, height = 2.5, pitch_deg = 30.0 }"),
        "{text}"
    );
    browser.run(choose).await;
    for id in ["height", "pitch"] {
        browser.run(&fill(id, "")).await;
        judged(&browser).await;
    }
    assert_eq!(row(&browser, 3).await, before);
}

#[tokio::test]
async fn a_site_is_edited_and_calibrates() {
    let folder = TempDir::new().unwrap();
    // A name that would be more than text, if it were not escaped.
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

    // The input is unchanged; the new file differs only in the changes, and it calibrates.
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

    // Another page is refused, and so is one without the token.
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

/// Without `--save` the browser keeps the file; existing walls move, by pointer and by key.
#[tokio::test]
async fn a_wall_is_moved_and_the_file_downloaded() {
    let folder = TempDir::new().unwrap();
    let site = folder.path().join("walled.toml");
    let (_, thesis) = site::BUILT_IN[0];
    let wall = "obstacle = [{ wall = [[1.0, 25.0], [3.0, 25.0]] }] # the shelf\n[camera]\n";
    let text = thesis.replacen("[camera]\n", wall, 1);
    assert_ne!(text, thesis);
    fs::write(&site, &text).unwrap();
    let (_server, url) = served(&["edit", site.to_str().unwrap()]);
    let browser = Browser::start(1280).await;
    browser.client.goto(&url).await.unwrap();
    judged(&browser).await;
    // All of it, then one end of it, then all of it by key.
    browser.run(&drag([2.0, 25.0], [2.5, 25.5])).await;
    judged(&browser).await;
    browser.run(&drag([3.5, 25.5], [4.0, 26.0])).await;
    judged(&browser).await;
    let key =
        "document.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowLeft', shiftKey: true}))";
    browser.run(key).await;
    judged(&browser).await;
    browser.run("document.getElementById('save').click()").await;
    let kept = browser.profile.path().join("site.toml");
    // The browser holds the name with an empty file before it moves the whole one there.
    wait_until(|| fs::metadata(&kept).is_ok_and(|kept| kept.len() > 0));
    let expected = text.replace("[[1.0, 25.0], [3.0, 25.0]]", "[[0.5, 25.5], [3.0, 26.0]]");
    assert_eq!(fs::read_to_string(&kept).unwrap(), expected);
    browser.end().await;
}

/// Cameras of a grid become cameras that can be moved; advice names the network of a further camera.
#[tokio::test]
async fn a_grid_is_edited_and_fits_a_phone() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [site, saved] = ["two.toml", "saved.toml"].map(path);
    let two = "name = \"two\"\n[camera]\nfield_of_view_deg = 60.0\nrange = 8.0\n[grid]\nnodes = 8\ncell_nodes = 4\n";
    fs::write(&site, two).unwrap();
    let (_server, url) = served(&["edit", &site, "--save", &saved]);
    let browser = Browser::start(390).await;
    browser.client.goto(&url).await.unwrap();
    judged(&browser).await;
    let said = "return !document.getElementById('grid').hidden";
    assert_eq!(browser.run(said).await, json!(true));
    let wide = "return [innerWidth, document.documentElement.scrollWidth]";
    assert_eq!(browser.run(wide).await, json!([390, 390]));
    let table =
        "const list = document.getElementById('list'); return list.scrollWidth <= list.clientWidth";
    assert_eq!(browser.run(table).await, json!(true), "the table fits");
    browser
        .run("document.getElementById('advise').click()")
        .await;
    judged(&browser).await;
    let advised = "return document.querySelector('#advice li').textContent";
    let advised = browser.run(advised).await;
    let advised = advised.as_str().unwrap();
    let network = ["1", "2"]
        .into_iter()
        .find(|n| advised.contains(&format!("of network {n} at")));
    let network: usize = network.expect(advised).parse().unwrap();
    browser
        .run("document.querySelector('#advice button').click()")
        .await;
    judged(&browser).await;
    browser.run("document.getElementById('save').click()").await;
    browser
        .until("return document.getElementById('link').textContent.startsWith('saved as')")
        .await;
    let saved = site::Scenario::load(&saved, &site::Overrides::default()).unwrap();
    let ids = |n: usize| -> Vec<u16> {
        let cameras = saved.networks[n].cameras.iter();
        cameras.map(|camera| camera.id).collect()
    };
    let mut expected = [vec![1, 2, 3, 4], vec![5, 6, 7, 8]];
    expected[network - 1].push(9);
    assert_eq!([ids(0), ids(1)], expected);
    browser.end().await;
}

/// Another program writes the file, and another page, while a page is open: nothing of it is lost, and where both
/// changed the same camera the user chooses.
#[tokio::test]
async fn what_others_write_meanwhile_is_not_lost() {
    let folder = TempDir::new().unwrap();
    let site = folder.path().join("mine.toml");
    let (_, thesis) = site::BUILT_IN[0];
    fs::write(&site, "as it was before").unwrap();
    let path = site.to_str().unwrap();
    let (_server, url) = served(&["edit", "thesis-13", "--save", path, "--replace"]);
    let browser = Browser::start(1280).await;
    browser.client.goto(&url).await.unwrap();
    judged(&browser).await;
    let save = "document.getElementById('save').click()";
    let says = |words: &str| {
        format!("return document.getElementById('link').textContent.startsWith('{words}')")
    };
    let by_hand = |from: &str, to: &str| {
        let text = fs::read_to_string(&site).unwrap();
        assert!(text.contains(from), "{text}");
        fs::write(&site, text.replace(from, to)).unwrap();
    };
    browser.run(&drag([15.0, 2.0], [15.5, 2.5])).await;
    judged(&browser).await;
    browser.run(save).await;
    browser.until(&says("saved as")).await;
    by_hand("id = 5, x = 21.0", "id = 5, x = 20.0");
    // After a reload, with what was saved and what was written by hand.
    browser.client.refresh().await.unwrap();
    browser.run("window.judgedBefore = undefined").await;
    judged(&browser).await;
    assert_eq!(row(&browser, 3).await[1], "15.50, 2.50");
    assert_eq!(row(&browser, 5).await[1], "20.00, 3.00");
    // Without one.
    by_hand("id = 5, x = 20.0", "id = 5, x = 19.0");
    browser.run(&drag([15.5, 2.5], [15.0, 2.0])).await;
    judged(&browser).await;
    browser.run(save).await;
    let joined = format!("saved as {path}, joined with what changed there meanwhile");
    browser.until(&says(&joined)).await;
    assert_eq!(row(&browser, 5).await[1], "19.00, 3.00");
    // The same camera, here and there.
    by_hand("id = 5, x = 19.0", "id = 5, x = 18.0");
    browser.run(&drag([19.0, 3.0], [20.5, 3.5])).await;
    judged(&browser).await;
    browser.run(save).await;
    browser.until(&says("not saved")).await;
    let told = "const told = document.getElementById('conflict'); return told.hidden ? '' : told.textContent";
    let told = browser.run(told).await;
    let told = told.as_str().unwrap();
    assert!(told.contains("camera 5: at (18.00, 3.00)"), "{told}");
    browser
        .run("document.getElementById('take-page').click()")
        .await;
    browser.until(&says("saved as")).await;
    let hidden = "return document.getElementById('conflict').hidden";
    assert_eq!(browser.run(hidden).await, json!(true));
    let expected = thesis.replace("id = 5, x = 21.0, y = 3.0", "id = 5, x = 20.5, y = 3.5");
    assert_eq!(fs::read_to_string(&site).unwrap(), expected);
    browser.end().await;
}
