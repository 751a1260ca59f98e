//! What `cargo xtask flash` has probe-rs do; a script is in its place.

use std::{fs, os::unix::fs::PermissionsExt};

use crate::place::Place;

/// Notes how it is called. It fails when it is to fail at that.
const PROBE_RS: &str = r#"#!/bin/sh
printf '%s\n' "$*" >> "${0%/*}/calls"
case "$*" in "${FAIL:-never}"*) exit 3 ;; esac
"#;

fn place() -> Place {
    let place = Place::with_key();
    place.write("image.elf", "stands for an image");
    place
        .run(&[
            "provision",
            "--site-key=site.sitekey",
            "--role=target",
            "--id=4",
            "--first-counter=77",
            "--out=page.bin",
        ])
        .ok();
    place
}

fn install(place: &Place) {
    let path = place.path("bin/probe-rs");
    fs::create_dir(place.path("bin")).unwrap();
    fs::write(&path, PROBE_RS).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
}

/// What probe-rs was called with, without the folder of the test.
fn calls(place: &Place) -> Vec<String> {
    let calls = fs::read_to_string(place.path("bin/calls")).unwrap_or_default();
    let folder = format!("{}/", place.path("").canonicalize().unwrap().display());
    let calls = calls.replace(&folder, "");
    calls.lines().map(str::to_owned).collect()
}

const IMAGE: &str = "download --chip nRF52840_xxAA --verify --binary-format elf image.elf";
const PAGE: &str = "download --chip nRF52840_xxAA --verify --binary-format bin \
                    --base-address 0x000ff000 page.bin";
const RESET: &str = "reset --chip nRF52840_xxAA";
const FLASH: [&str; 4] = [
    "flash",
    "nrf52840",
    "--image=image.elf",
    "--config=page.bin",
];

#[test]
fn image_page_and_reset() {
    let place = place();
    install(&place);
    place.run(&FLASH).ok();
    assert_eq!(calls(&place), [IMAGE, PAGE, RESET]);
}

#[test]
fn an_image_alone_for_one_of_several_probes() {
    let place = place();
    install(&place);
    place
        .run(&[&FLASH[..3], &["--probe=1366:1015:00012"]].concat())
        .ok();
    let probe = "--chip nRF52840_xxAA --probe 1366:1015:00012";
    let expected = [IMAGE, RESET].map(|call| call.replace("--chip nRF52840_xxAA", probe));
    assert_eq!(calls(&place), expected);
}

/// 0x000f7000 to 0x000fefff.
#[test]
fn the_memory_is_erased_last_and_with_a_warning() {
    let place = place();
    install(&place);
    let run = place.run(&[FLASH.as_slice(), &["--erase-memory"]].concat());
    let warning =
        "warning: the node forgets which frame counters it used, and begins again with 77";
    assert!(run.stderr.contains(warning), "{}", run.stderr);
    run.ok();
    let calls = calls(&place);
    let [image, page, erase, reset] = calls.as_slice() else {
        panic!("{calls:?}");
    };
    assert_eq!([image, page, reset], [IMAGE, PAGE, RESET]);
    let (start, file) = erase.rsplit_once(' ').unwrap();
    assert_eq!(
        start,
        "download --chip nRF52840_xxAA --verify --binary-format bin --base-address 0x000f7000"
    );
    assert!(fs::read(file).unwrap() == vec![0xFF; 0x8000]);
}

#[test]
fn a_dry_run_tells_the_commands() {
    let place = place();
    let run = place.run(&[FLASH.as_slice(), &["--dry-run"]].concat());
    assert!(run.stderr.contains("probe-rs is not installed"));
    let told = run.ok();
    install(&place);
    assert_eq!(
        place.run(&[FLASH.as_slice(), &["--dry-run"]].concat()).ok(),
        told
    );
    assert!(calls(&place).is_empty());
    place.run(&FLASH).ok();
    let folder = format!("{}/", place.path("").canonicalize().unwrap().display());
    let told: Vec<_> = told.lines().map(|line| line.replace(&folder, "")).collect();
    let done: Vec<_> = calls(&place)
        .iter()
        .map(|call| format!("probe-rs {call}"))
        .collect();
    assert_eq!(told, done);
}

#[test]
fn nothing_is_skipped() {
    let place = place();
    place.run(&FLASH).fails(1, "cargo install probe-rs-tools");
    install(&place);
    place.write("damaged.bin", "not a page");
    for (status, error, words) in [
        (
            1,
            "cargo xtask firmware",
            "flash nrf52840 --image=none.elf --config=page.bin",
        ),
        (
            1,
            "is no page",
            "flash nrf52840 --image=image.elf --config=damaged.bin",
        ),
        (
            1,
            "cannot be read",
            "flash nrf52840 --image=image.elf --config=none.bin",
        ),
        (
            2,
            "--config",
            "flash nrf52840 --image=image.elf --erase-memory",
        ),
        (2, "possible values", "flash nrf9160 --config=page.bin"),
    ] {
        let words: Vec<_> = words.split(' ').collect();
        place.run(&words).fails(status, error);
    }
    assert!(calls(&place).is_empty());
}

#[test]
fn a_failure_ends_it() {
    let place = place();
    install(&place);
    let page = PAGE.strip_suffix("page.bin").unwrap().trim_end();
    place
        .run_with(&FLASH, &[("FAIL", page)])
        .fails(1, "the board is not complete");
    assert_eq!(calls(&place), [IMAGE, PAGE]);
}
