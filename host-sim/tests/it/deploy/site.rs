//! All nodes of a site, from the file that is rehearsed.

use std::fs;

use node_firmware::config::{Config, RoleConfig, page};

use super::place::Place;
use crate::common::as_shown;

const KEY: &str = "--site-key=site.sitekey";
const PROVISION: [&str; 3] = ["provision", "--site=room.toml", "--out=pages"];

const PAGE: &str = include_str!("../../../../docs/deploy.md");

/// The first file of a page of the documentation.
fn documented() -> String {
    let (_, file) = PAGE.split_once("```toml\n").unwrap();
    file.split_once("```").unwrap().0.to_owned()
}

fn decode(place: &Place, id: u16) -> Config {
    let page = place.path(&format!("pages/node-{id}.page.bin"));
    page::decode(&fs::read(page).unwrap())
        .unwrap()
        .settings()
        .clone()
}

#[test]
fn the_file_that_is_rehearsed_makes_the_pages() {
    let place = Place::with_key();
    let file = documented();
    place.write("room.toml", &file);
    let told = place.run(&["run", "room.toml"]).ok();
    assert!(told.contains("3 of 3 cameras are calibrated"), "{told}");
    assert!(PAGE.contains(&as_shown(&told)), "{told}");
    let told = place.run(&PROVISION).ok();
    let lines: Vec<_> = told.lines().collect();
    assert_eq!(lines.len(), 5, "{told}");
    assert!(lines[0].starts_with("pages/node-"), "{told}");
    for node in ["coordinator 60000,", "camera 3,", "target 20,"] {
        assert_eq!(told.matches(node).count(), 1, "{told}");
    }
    let [coordinator, first, second, third, target] =
        [60_000, 1, 2, 3, 20].map(|id| decode(&place, id));
    let RoleConfig::Coordinator(own) = &coordinator.role else {
        panic!("{coordinator:?}");
    };
    let members = [&first, &second, &third, &target];
    assert_eq!(own.allow, members.map(|config| config.id));
    for config in members.into_iter().chain([&coordinator]) {
        assert_eq!(config.site_key, place.key());
        assert_eq!(config.channels, 1 << 20);
    }
    let RoleConfig::Camera(camera) = &first.role else {
        panic!("{first:?}");
    };
    assert!(camera.reference.is_some());
    assert_eq!(camera.lens.field_of_view_deg, 45.0);
    assert_eq!(camera.baseline, Some(5.0));
    // Another key than the file names.
    place.run(&["keygen", "other.sitekey", "--index=2"]).ok();
    let other = ["--site-key=other.sitekey", "--overwrite"];
    place.run(&[&PROVISION[..], &other].concat()).ok();
    assert_eq!(decode(&place, 3).site_key.index(), 2);
}

#[test]
fn what_nobody_can_guess_is_asked() {
    let place = Place::with_key();
    let file = documented();
    let without = |start: &str| {
        let lines = file.lines().filter(|line| !line.starts_with(start));
        lines.collect::<Vec<_>>().join("\n")
    };
    for (start, asked) in [
        ("field_of_view_deg", "the field of view of 3 cameras"),
        ("projection", "the lens of 3 cameras"),
        ("systematic_heading_deg", "the compass of target 20"),
        ("systematic_scale", "the step length of target 20"),
        ("key_file", "which key has the site?"),
    ] {
        place.write("room.toml", &without(start));
        let run = place.run(&PROVISION);
        run.fails(asked);
        assert!(!place.path("pages").exists(), "{start}");
    }
    place.write("room.toml", &format!("{file}\nspeed = 1\n"));
    place.run(&PROVISION).fails("speed");
    place.write("room.toml", &file);
    place
        .run(&[&PROVISION[..], &["--id=3"]].concat())
        .fails("not in options");
    place
        .run(&["provision", KEY, "--site=room.toml"])
        .fails("--out");
    place
        .run(&["provision", "--site=none.toml", KEY, "--out=pages"])
        .fails("none.toml");
    fs::remove_file(place.path("site.sitekey")).unwrap();
    place
        .run(&PROVISION)
        .fails("site.sitekey: it cannot be read; `host-sim keygen FILE`");
}

#[test]
fn all_pages_are_written_or_none() {
    let place = Place::with_key();
    place.write("room.toml", &documented());
    fs::create_dir(place.path("pages")).unwrap();
    place.write("pages/node-3.page.bin", "");
    place.run(&PROVISION).fails("node-3.page.bin exists");
    assert_eq!(fs::read_dir(place.path("pages")).unwrap().count(), 1);
    place.run(&[&PROVISION[..], &["--overwrite"]].concat()).ok();
    assert_eq!(fs::read_dir(place.path("pages")).unwrap().count(), 5);
    // A page of the folder is the file of the site itself.
    fs::rename(place.path("room.toml"), place.path("pages/room.toml")).unwrap();
    std::os::unix::fs::symlink("room.toml", place.path("pages/link")).unwrap();
    fs::remove_file(place.path("pages/node-3.page.bin")).unwrap();
    fs::rename(
        place.path("pages/link"),
        place.path("pages/node-3.page.bin"),
    )
    .unwrap();
    let words = [
        "provision",
        KEY,
        "--site=pages/room.toml",
        "--out=pages",
        "--overwrite",
    ];
    place.run(&words).fails("would be replaced by a result");
}
