//! Parts that a machine lacks: installed, or told with the command to type.

use std::fs;

use crate::place::Place;

/// A machine with a compiler that has all its parts, and nothing else.
fn machine() -> Place {
    let place = Place::new();
    place.install(
        "rustc",
        &format!("echo {}", place.path("sysroot").display()),
    );
    for part in [
        "lib/rustlib/thumbv7em-none-eabihf",
        "lib/rustlib/thumbv6m-none-eabi",
        "bin",
    ] {
        fs::create_dir_all(place.path("sysroot").join(part)).unwrap();
    }
    for program in ["cargo-fmt", "cargo-clippy"] {
        place.write(&format!("sysroot/bin/{program}"), "");
    }
    place
}

/// A program that notes how it was called, and does nothing else.
fn note(place: &Place, program: &str) {
    place.install(program, r#"echo "${0##*/} $*" >> "${0%/*}/calls""#);
}

fn calls(place: &Place) -> Vec<String> {
    let calls = fs::read_to_string(place.path("bin/calls")).unwrap_or_default();
    calls.lines().map(str::to_owned).collect()
}

const PACKAGES: &str = "gdb-multiarch qemu-system-arm tshark ffmpeg cmake ninja-build g++ chromium chromium-driver valgrind \
     mosquitto mosquitto-clients openssl";

#[test]
fn without_a_compiler() {
    let place = Place::new();
    place.run(&["cortex-m"]).fails(1, "rustc");
    place.run(&["firmware"]).fails(1, "rustup");
}

#[test]
fn without_the_targets_and_without_rustup() {
    let place = machine();
    fs::remove_dir(place.path("sysroot/lib/rustlib/thumbv6m-none-eabi")).unwrap();
    place.run(&["cortex-m"]).fails(
        1,
        "has no thumbv6m-none-eabi: type `rustup toolchain install`",
    );
    fs::remove_dir(place.path("sysroot/lib/rustlib/thumbv7em-none-eabihf")).unwrap();
    place.install("rustup", "exit 1");
    place
        .run(&["firmware"])
        .fails(1, "--profile minimal --target thumbv7em-none-eabihf` where");
}

#[test]
fn without_the_linker_and_without_a_network() {
    let place = machine();
    place.install("cargo", "exit 101");
    place
        .run(&["firmware"])
        .fails(1, "type `cargo install --locked flip-link@");
    // Installed to a folder that is not in the path.
    note(&place, "cargo");
    place.run(&["firmware"]).fails(1, "put the folder");
    assert!(calls(&place)[0].starts_with("cargo install --locked flip-link@"));
}

#[test]
fn without_packages_and_without_apt() {
    let place = machine();
    place.run(&["cortex-m"]).fails(
        1,
        &format!("on Debian, type `sudo apt-get install {PACKAGES}`"),
    );
}

#[test]
fn without_packages_and_without_root() {
    let place = machine();
    note(&place, "apt-get");
    place.install("id", "echo 1000");
    let told = format!("type `sudo apt-get install {PACKAGES}`");
    place.run(&["cortex-m"]).fails(1, &told);
    // A password is asked for where it cannot be typed.
    place.install("sudo", "exit 1");
    place.run(&["cortex-m"]).fails(1, &told);
    assert!(calls(&place).is_empty());
}

#[test]
fn packages_are_installed_where_that_is_allowed() {
    let place = machine();
    note(&place, "apt-get");
    place.install("env", r#"shift; exec "$@""#);
    place.install("cmake", "");
    let install = "apt-get -o DPkg::Lock::Timeout=120 install -y --no-install-recommends";
    let missing = PACKAGES.replace("cmake ", "");
    let expected = ["apt-get update".to_owned(), format!("{install} {missing}")];
    // The program that then runs is not there.
    place.install("id", "echo 0");
    place.run(&["cortex-m"]).fails(1, "cargo");
    assert_eq!(calls(&place), expected);
    place.install("id", "echo 1000");
    place.install(
        "sudo",
        r#"shift; case "$1" in true) ;; *) exec "$@" ;; esac"#,
    );
    place.run(&["cortex-m"]).fails(1, "cargo");
    assert_eq!(calls(&place)[2..], expected);
    // No network.
    place.install("apt-get", "exit 100");
    place
        .run(&["cortex-m"])
        .fails(1, &format!("failed; type `sudo apt-get install {missing}`"));
}
