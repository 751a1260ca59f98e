//! The page of a simulation, of a record, and as one file.

use std::fs;

use results::record::{
    event::{self, Event, What},
    verdict::Verdict,
};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{
    browser::{Browser, free_port},
    looks::{ask, banner, lab, live, shows},
    thousand,
};

#[tokio::test]
async fn a_report_opens_from_a_file_and_shows_what_the_record_says() {
    a_report_opens(Browser::start(1280).await).await;
}

pub(super) async fn a_report_opens(browser: Browser) {
    let folder = TempDir::new().unwrap();
    let (record, events, report) = lab(folder.path());
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
    // The map is not empty.
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

#[tokio::test]
async fn a_simulation_shows_itself_in_every_tab_and_after_the_server_came_back() {
    a_simulation_shows_itself(Browser::start(1280).await).await;
}

pub(super) async fn a_simulation_shows_itself(browser: Browser) {
    let folder = TempDir::new().unwrap();
    let (record, events, _) = lab(folder.path());
    let port = free_port().to_string();
    let arguments = ["lab", "--speed", "max", "--http-port", &port];
    let (server, url) = live(&arguments);
    let origin = url.split("/#").next().unwrap().to_owned();
    browser.client.goto(&url).await.unwrap();
    browser
        .until("return document.body.dataset.ended === 'true'")
        .await;
    shows(&browser, &record).await;
    // After the end nothing is said to go on.
    let over = "return [document.getElementById('link').textContent, document.getElementById('walk').textContent]";
    assert_eq!(browser.run(over).await, json!(["the walk has ended", ""]));
    // The verdict was told piece by piece, and is that of the end, word for word.
    let verdict = events.iter().rev().find_map(|event| match &event.what {
        What::Verdict {
            words, findings, ..
        } => Some(json!({ "words": words, "findings": findings })),
        _ => None,
    });
    let shown =
        "const {event, words, findings} = window.shown().verdict; return {event, words, findings}";
    let mut shown = browser.run(shown).await;
    let event = shown.as_object_mut().unwrap().remove("event");
    assert_eq!(event, Some(json!("verdict_change")));
    assert_eq!(Some(shown), verdict);
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

    // The page tells that the server is gone; its contents stay.
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

/// The controls of time are those of the simulation while it is followed, and of a replay otherwise.
#[tokio::test]
async fn there_is_one_set_of_controls_of_time() {
    let (_server, url) = live(&["lab", "--speed", "3x"]);
    let browser = Browser::start(390).await;
    browser.client.goto(&url).await.unwrap();
    let words = |id: &str| format!("return document.getElementById('{id}').textContent");
    let is = |id: &str, text: &str| {
        format!("return document.getElementById('{id}').textContent === '{text}'")
    };
    browser.until(&is("play", "pause")).await;
    assert_eq!(browser.run(&words("rate-of")).await, json!("speed"));
    let rate = "return document.getElementById('rate').value";
    assert_eq!(browser.run(rate).await, json!("3"));
    let others = "return [...document.querySelectorAll('#controls legend')].map(legend => legend.textContent)";
    let others = browser.run(others).await;
    assert!(!others.to_string().contains("Time"), "{others}");
    browser.run("document.getElementById('play').click()").await;
    browser.until(&is("sent", "pause: sent")).await;
    browser.until(&is("play", "go on")).await;
    let faster = "const rate = document.getElementById('rate'); rate.value = '30';
        rate.dispatchEvent(new Event('change'))";
    browser.run(faster).await;
    browser.until(&is("sent", "speed: sent")).await;
    // Another moment is replayed.
    let back = "const scrub = document.getElementById('scrub'); scrub.value = '0';
        scrub.dispatchEvent(new Event('input'))";
    browser.run(back).await;
    browser.until(&is("rate-of", "replay")).await;
    browser.end().await;
}

/// Numbers of cameras and stops, as they are drawn: none lies over another, and most cameras have theirs.
#[tokio::test]
async fn no_number_lies_over_another() {
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("many.html");
    fs::write(&page, thousand::with_stops(60, 40)).unwrap();
    for (width, least) in [(390, 25), (1280, 50)] {
        let browser = Browser::start(width).await;
        let url = format!("file://{}", page.display());
        browser.client.goto(&url).await.unwrap();
        let spy = "window.words = [];
            const kind = CanvasRenderingContext2D.prototype;
            const own = kind.fillText;
            kind.fillText = function (words, x, y) {
                const {width} = this.measureText(words);
                const at = this.getTransform().transformPoint(new DOMPoint(x, y));
                const {a} = this.getTransform();
                if (this.textBaseline === 'middle') {
                    window.words.push([words, at.x / a, at.y / a, width, parseFloat(this.font.match(/(\\d+)px/)[1])]);
                }
                own.call(this, words, x, y);
            };";
        browser.run(spy).await;
        // Drawn anew as a whole.
        browser
            .run("window.words = []; document.getElementById('zoom-in').click()")
            .await;
        let drawn =
            format!("return window.words.filter(([words]) => words < 62200).length >= {least}");
        browser.until(&drawn).await;
        let over = "
            const drawn = new Map(window.words.map(word => [word[0], word]));
            const all = [...drawn.values()];
            return all.flatMap(([a, ax, ay, aw, ah], i) => all.slice(i + 1)
                .filter(([, bx, by, bw, bh]) => Math.abs(ax - bx) * 2 < aw + bw && Math.abs(ay - by) * 2 < ah + bh)
                .map(([b]) => `${a} and ${b}`))";
        assert_eq!(browser.run(over).await, json!([]));
        browser.end().await;
    }
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
