//! A camera behind a port of the operating system.

use std::{fs, process::Command};

use tempfile::TempDir;

use crate::{common::wait_until, small::SMALL};

/// The node talks to the camera as far as that works without a real one.
#[test]
#[ignore = "takes a minute of real time: cargo xtask peers"]
fn a_camera_on_a_port_takes_the_place_of_a_simulated_one() {
    let files = TempDir::new().unwrap();
    let [port, log] = ["camera", "log"].map(|name| files.path().join(name));
    let mut camera = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["camera", "--baud", "38400", "--pty"])
        .arg(&port)
        .spawn()
        .unwrap();
    wait_until(|| {
        assert!(camera.try_wait().unwrap().is_none());
        port.exists()
    });
    let file = files.path().join("one.toml");
    fs::write(&file, SMALL).unwrap();
    let ended = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .arg("run")
        .arg(&file)
        .arg("--port")
        .arg(format!("3={}", port.display()))
        .arg("--log")
        .arg(&log)
        .output();
    camera.kill().unwrap();
    camera.wait().unwrap();
    let stderr = String::from_utf8(ended.unwrap().stderr).unwrap();
    let log = fs::read_to_string(log).unwrap();
    // The camera looks elsewhere, so it finds no pose; but it looks.
    let answers = log
        .lines()
        .filter(|line| line.contains("node 3: ") && line.contains("Look("));
    let mut answers = answers.filter(|line| !line.contains("NotReady") && !line.contains("Failed"));
    assert!(answers.next().is_some(), "{stderr}{log}");
}
