//! `host-sim camera --video`, in real time.

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    path::Path,
    process::{Child, Command, Stdio},
    thread,
};

use cmucam2_emulator::{Lens, Pose, Scene};
use serde_json::Value;

use super::film::{Shot, ffmpeg, lit_ball, room};
use crate::common::{Files, LineEnd, run};

const FIELD_OF_VIEW_DEG: f64 = 45.0;
const POSE: Pose = Pose {
    x: 1.0,
    y: 2.0,
    height: 1.0,
    heading: 0.3,
};

/// A process that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn camera(arguments: &[&str], input: Stdio) -> (Running, Vec<String>) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["camera", "--verbose"])
        .args(arguments)
        .stdin(input)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let mut told = Vec::new();
    while !told
        .last()
        .is_some_and(|line: &String| line.contains("started"))
    {
        told.push(lines.next().expect("it ended").unwrap());
    }
    thread::spawn(move || lines.for_each(drop));
    (Running(child), told)
}

/// A ball at this place, filmed by a camera at [`POSE`].
fn ball_at([x, y]: [f64; 2]) -> Scene {
    let lens = Lens::new(FIELD_OF_VIEW_DEG.to_radians(), 88, 143).unwrap();
    let ball = lens
        .extent_of_ball(&POSE, [x, y, POSE.height], 0.2)
        .unwrap();
    Scene {
        background: room(2),
        objects: lit_ball(ball),
        ..Scene::default()
    }
}

/// As in the README: ffmpeg makes a CMUcam2 out of a camera, here out of a recording. `probe` records
/// sightings, and `solve` finds the pose of the camera.
#[test]
fn a_pose_from_recorded_video() {
    let files = Files::new();
    // Distances ahead of the camera and to the left of it.
    let places = [[2.8, -0.7], [2.4, 0.4], [3.5, 1.1], [4.0, -1.2], [3.0, 0.1]].map(
        |[ahead, left]: [f64; 2]| {
            let (sin, cos) = POSE.heading.sin_cos();
            [
                POSE.x + ahead * cos - left * sin,
                POSE.y + ahead * sin + left * cos,
            ]
        },
    );
    let recorded = thread::scope(|scope| {
        let recorders = [0, 1, 2, 3, 4].map(|number| {
            let (files, place) = (&files, places[number]);
            scope.spawn(move || record(files, number, place))
        });
        recorders.map(|recorder| recorder.join().unwrap())
    });
    let mut all = recorded[0].lines().next().unwrap().to_owned();
    for lines in &recorded {
        all = all + "\n" + lines.lines().nth(1).unwrap();
    }
    let sightings = files.write("sightings.csv", &all);
    let done = run(&["solve", &sightings, "--fov-deg", "45", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let pose: Value = serde_json::from_str(done.stdout.lines().next().unwrap()).unwrap();
    let number = |key: &str| {
        pose[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key} in {pose}"))
    };
    println!("{pose}");
    let (x, y) = (number("x") - POSE.x, number("y") - POSE.y);
    let turned = number("heading_rad") - POSE.heading;
    assert!(x.hypot(y) < 0.08 && turned.abs() < 0.01, "{pose}");
}

/// One sighting of the ball in a recording that ffmpeg plays.
fn record(files: &Files, number: usize, place: [f64; 2]) -> String {
    let path = files.path(&format!("room-{number}.mp4"));
    let shot = Shot {
        width: 640,
        height: 360,
        rate: 5,
        noise: 8,
    };
    shot.compressed(Path::new(&path), 23, 15, |_| ball_at(place));
    let mut film = Running(
        ffmpeg()
            .args([
                "-re",
                "-i",
                &path,
                "-pix_fmt",
                "yuv420p",
                "-f",
                "yuv4mpegpipe",
                "-",
            ])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap(),
    );
    let pictures = film.0.stdout.take().unwrap();
    let pty = files.path(&format!("camera-{number}"));
    let (_camera, told) = camera(&["--pty", &pty, "--video", "-"], pictures.into());
    assert!(
        told[0].contains("640 x 360 pixels, 5.000 pictures"),
        "{told:?}"
    );
    let (csv, at) = (
        files.path(&format!("{number}.csv")),
        format!("{},{}", place[0], place[1]),
    );
    let done = run(&[
        "probe",
        "--port",
        &pty,
        "--baud",
        "115200",
        "--settle",
        "0",
        "--fov-deg",
        "45",
        "--colour",
        "130,240,50,150,16,75",
        "--record",
        &csv,
        "--case",
        "room",
        "--at",
        &at,
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    fs::read_to_string(csv).unwrap()
}

/// A board's camera, on a real line.
#[test]
fn on_a_serial_port() {
    let files = Files::new();
    let file = files.path("room.y4m");
    let shot = Shot {
        width: 88,
        height: 143,
        rate: 50,
        noise: 0,
    };
    shot.file(Path::new(&file), 2, |_| ball_at([4.0, 2.9]));
    let (LineEnd(mut board), _port, name) = LineEnd::pair();
    let arguments = ["--port", &name, "--baud", "38400", "--video", &file];
    let (_camera, told) = camera(&arguments, Stdio::null());
    assert!(
        told.iter().any(|line| line.contains("38400 baud")),
        "{told:?}"
    );
    let mut said = Vec::new();
    let mut byte = [0];
    board.write_all(b"PM 1\r").unwrap();
    board.write_all(b"TC 130 240 50 150 16 75\r").unwrap();
    let prompts = |said: &[u8]| said.iter().filter(|&&byte| byte == b':').count();
    while prompts(&said) < 3 {
        board.read_exact(&mut byte).unwrap();
        said.push(byte[0]);
    }
    let said = String::from_utf8(said).unwrap();
    assert!(
        said.starts_with("CMUcam2 v1.00 c6\r:ACK\r:ACK\rT "),
        "{said:?}"
    );
    assert!(!said.contains("T 0 0 0 0"), "{said:?}");
}

#[test]
fn what_is_wrong_is_said() {
    let files = Files::new();
    let pty = files.path("camera");
    let other = files.write("film.avi", "RIFF....AVI LIST");
    for (arguments, word) in [
        (&["--pty", &pty, "--video", &other][..], "yuv4mpegpipe"),
        (&["--pty", &pty, "--video", "/nowhere.y4m"], "/nowhere.y4m"),
        (
            &["--pty", &pty, "--video", &other, "--scene", &other],
            "cannot be used with",
        ),
        (
            &["--pty", &pty, "--port", "/dev/ttyS9"],
            "cannot be used with",
        ),
        (&["--video", &other], "--pty"),
        (&["--port", "/nowhere"], "/nowhere cannot be opened"),
    ] {
        let done = run(&[&["camera"], arguments].concat());
        assert_eq!(done.code, 2, "{arguments:?}");
        assert!(done.stderr.contains(word), "{arguments:?}: {}", done.stderr);
    }
}
