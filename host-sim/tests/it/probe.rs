//! `host-sim probe` as users run it, against `host-sim camera` and against lines that fail.

#![cfg(unix)]

use std::{
    fs::{self, File, OpenOptions},
    io::{BufRead, BufReader, ErrorKind, Read, Write},
    process::{Child, Command, Stdio},
    sync::{
        atomic::{AtomicUsize, Ordering},
        mpsc::{self, Receiver},
    },
    thread,
};

use crate::common::{Files, LineEnd, data, run, run_with_input};
use serde_json::Value;
use serialport::TTYPort;

/// A run that fails, and its messages.
fn failure(arguments: &[&str]) -> String {
    let mut all = vec!["probe"];
    // Only a CMUcam2 adapts to the light.
    if !arguments.contains(&"--camera") {
        all.extend(["--settle", "0"]);
    }
    all.extend_from_slice(arguments);
    let done = run(&all);
    assert_eq!(
        (done.code, done.stdout.as_str()),
        (2, ""),
        "{}",
        done.stderr
    );
    done.stderr
}

#[test]
fn a_port_that_is_not_there_or_is_none() {
    let files = Files::new();
    let text = failure(&["--port", &files.path("ttyUSB0")]);
    assert!(text.contains("ttyUSB0 does not exist"), "{text}");
    assert!(text.contains("if it is that of a simulation"), "{text}");
    let text = failure(&["--port", "/dev/ttyNONE0"]);
    assert!(text.contains("plugged in"), "{text}");
    let file = files.write("notes.txt", "no port");
    let text = failure(&["--port", &file]);
    assert!(text.contains("cannot be used as a serial port"), "{text}");
    assert_eq!(fs::read_to_string(file).unwrap(), "no port");
}

#[test]
fn a_port_that_another_program_has() {
    let (_camera, _port, name) = LineEnd::pair();
    let _holder = TTYPort::open(&serialport::new(&name, 9600)).unwrap();
    let text = failure(&["--port", &name]);
    assert!(text.contains("is in use"), "{text}");
}

#[test]
fn nobody_answers() {
    let (_camera, _port, name) = LineEnd::pair();
    let text = failure(&["--port", &name, "--baud", "9600"]);
    assert!(text.contains("no answer at 9600 baud"), "{text}");
    for check in ["powered", "TX and RX", "level shifter", "--baud auto"] {
        assert!(text.contains(check), "no {check} in {text}");
    }
    let text = failure(&["--port", &name, "--baud", "auto"]);
    let looking = format!("{name}: looking for a CMUcam2 at 115200, ");
    assert!(text.starts_with(&looking), "{text}");
    assert!(text.contains("no answer at any baud rate"), "{text}");
}

/// A device answers every byte with the same wrong ones, as a camera at another rate does.
#[test]
fn garbage() {
    let (mut camera, _port, name) = LineEnd::pair();
    thread::spawn(move || {
        let mut byte = [0];
        loop {
            match camera.read(&mut byte) {
                Ok(_) => camera.write_all(b"\xF8\x00\x1C:\xE6\x80").unwrap(),
                Err(error) if error.kind() == ErrorKind::TimedOut => {}
                // The test is over.
                Err(_) => break,
            }
        }
    });
    let text = failure(&["--port", &name, "--baud", "38400"]);
    assert!(text.contains("makes no sense"), "{text}");
    assert!(text.contains("jumpers"), "{text}");
}

/// A device that is no camera is named, and its bytes are shown.
#[test]
fn strangers_are_named() {
    let strangers = [
        (&b"$GPGGA,123519,4807.038,N,01131.000,E,1,08\r\n"[..], "GPS"),
        (b"\r\nOK\r\n", "modem"),
        (b"\r\nbox login: ", "console of a computer"),
        (b"NCK\r:", "NCK to everything"),
        (b"CMUcam v1.12\r:", "another camera"),
        (b"\r\n>>> ", "Python"),
        (b"\r", "TX and RX of the adapter"),
    ];
    // In parallel, because each run mostly waits.
    thread::scope(|scope| {
        for (says, words) in strangers {
            scope.spawn(move || {
                let (camera, _port, name) = LineEnd::pair();
                thread::spawn(move || answer(camera, b"\r", says));
                let text = failure(&["--port", &name, "--baud", "38400"]);
                assert!(text.contains(words), "no {words} in {text}");
                assert!(text.contains("received \""), "{text}");
            });
        }
    });
}

/// Both cameras look alike, and so does a Pixy2 that plays the other.
#[test]
fn an_original_pixy_is_named() {
    let frame = b"\x55\xAA\x55\xAA\x43\x01\x01\0\x9E\0\x68\0\x1E\0\x1E\0";
    for (kind, to) in [("cmucam2", b"\r"), ("pixy2", b"\xAF")] {
        let (camera, _port, name) = LineEnd::pair();
        thread::spawn(move || answer(camera, to, frame));
        let text = failure(&["--camera", kind, "--port", &name, "--baud", "19200"]);
        for words in ["an original Pixy", "--camera pixy", "at 19200 baud"] {
            assert!(text.contains(words), "{kind}: no {words} in {text}");
        }
    }
}

/// Answers each of these bytes until the line is closed.
fn answer(mut line: LineEnd, to: &[u8], says: &[u8]) {
    let mut byte = [0];
    loop {
        match line.read(&mut byte) {
            Ok(_) if to.contains(&byte[0]) => line.write_all(says).unwrap(),
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::TimedOut => {}
            // The test is over.
            Err(_) => break,
        }
    }
}

/// A camera that tells who it is, and from then on nothing that makes sense.
fn garbled_after_the_banner(mut line: LineEnd) {
    let (mut byte, mut heard) = ([0], Vec::new());
    loop {
        match line.read(&mut byte) {
            Ok(_) if byte == *b"\r" => {
                let says: &[u8] = match &heard[..] {
                    b"" => b"ACK\r:",
                    b"GV" => b"ACK\rCMUcam2 v1.00 c6\r:",
                    _ => b"\xF8\x00\x1C\xE6\x80",
                };
                line.write_all(says).unwrap();
                heard.clear();
            }
            Ok(_) => heard.extend(byte),
            Err(error) if error.kind() == ErrorKind::TimedOut => {}
            // The test is over.
            Err(_) => break,
        }
    }
}

/// Other programs leave the camera in a mode in which it does not acknowledge, or takes raw
/// commands.
#[test]
fn a_camera_left_in_a_raw_mode_is_recovered() {
    for mode in [2, 3, 5] {
        let camera = Emulated::new(&square(), &[&format!("heard=RM {mode}\\r")]);
        let (_, told) = camera.probe(&["--baud", "115200", "--settle", "0", "--count", "3"]);
        assert!(told.contains("CMUcam2 v1.00 c6"), "RM {mode}: {told}");
    }
}

/// Whatever another program has set, `--as-is` counts the same columns as before.
#[test]
fn modes_that_another_program_has_set_are_put_back() {
    let told = |heard: &str| {
        let camera = Emulated::new(&square(), &[&format!("heard={heard}")]);
        let options = [
            "--baud", "115200", "--as-is", "--count", "2", "--colour", ORANGE,
        ];
        camera.json(&options).pop().unwrap()
    };
    let usual = told("");
    assert_eq!((number(&usual, "x1"), number(&usual, "x2")), (20.0, 67.0));
    let modes = "DS 2 2,OM 0 3,RM 1,RM 7,VW 30 10 50 90,PM 1,LM 0 1,LM 0 2,BM 1,TI 1,PD 1,SM 15,PS 3,PF 1,NF 60,HR 1";
    for mode in modes.split(',') {
        let mut line = told(&format!("{mode}\\r"));
        line["seconds"] = usual["seconds"].clone();
        assert_eq!(line, usual, "{mode}");
    }
}

/// A camera whose banner came at a rate has that rate.
#[test]
fn what_comes_after_the_banner_is_not_blamed_on_the_rate() {
    let (camera, _port, name) = LineEnd::pair();
    thread::spawn(move || garbled_after_the_banner(camera));
    let done = run(&["probe", "--port", &name, "--baud", "38400", "--as-is"]);
    let text = done.stderr;
    assert_eq!(done.code, 2, "{text}");
    assert!(text.contains("CMUcam2 v1.00 c6"), "{text}");
    assert!(
        text.contains("no sense any more after its banner"),
        "{text}"
    );
    assert!(!text.contains("jumpers"), "{text}");
}

#[test]
fn wrong_options_and_files_are_told_before_the_port_is_opened() {
    let files = Files::new();
    let port = files.path("ttyUSB0");
    for (arguments, word) in [
        (&["--baud", "14400"][..], "jumpers"),
        (&["--colour", "1,2,3"], "six levels"),
        (&["--colour", "200,100,16,240,16,240"], "lower"),
        (&["--at", "1,2"], "--record"),
        (&["--fov-deg", "200", "--record", "s.csv"], "field of view"),
        (&["--record", "s.csv", "--at", "1"], "two numbers"),
        (&["--frame", "no/such/folder/a.png"], "no folder"),
        (&["--frame", "a.png", "--record", "s.csv"], "cannot be used"),
        (&["--emulate"], "cannot be used"),
        (&["--at", "1,2", "--count", "1"], "cannot be used"),
        (&["--case", "x", "--seconds", "1"], "cannot be used"),
        (&["--packets", "5", "--frame", "a.png"], "cannot be used"),
        (&["--record", "no/such/folder/s.csv"], "no folder"),
        (&["--tag", "1"], "--camera openmv-tags"),
        (&["--signature", "1"], "--camera pixy2"),
    ] {
        let mut all = vec!["--port", &port];
        all.extend_from_slice(arguments);
        let text = failure(&all);
        assert!(text.contains(word), "no {word} in {text}");
    }
    let other = files.write("other.csv", "case,x,y\n1,2,3\n");
    let text = failure(&["--port", &port, "--record", &other, "--at", "-1,2"]);
    assert!(text.contains("case,x,y"), "{text}");
    assert_eq!(fs::read_to_string(other).unwrap(), "case,x,y\n1,2,3\n");
}

#[test]
fn options_of_other_cameras_are_refused() {
    for (kind, options) in [
        (
            "pixy2",
            &[
                &["--settle", "0"][..],
                &["--tag", "0"],
                &["--as-is"],
                &["--high-res"],
            ][..],
        ),
        (
            "pixy",
            &[
                &["--first-column", "0"],
                &["--frame", "a.png"],
                &["--tag", "3"],
            ],
        ),
        (
            "openmv",
            &[&["--colour", ORANGE], &["--settle", "3"], &["--tag", "0"]],
        ),
        ("openmv-tags", &[&["--signature", "2"], &["--settle", "3"]]),
        ("cmucam2", &[&["--signature", "1"], &["--tag", "0"]]),
    ] {
        for option in options {
            let text = failure(&[&["--camera", kind, "--emulate"], *option].concat());
            let told = format!("host-sim: {} is for ", option[0]);
            assert!(text.starts_with(&told), "{kind}: {text}");
        }
    }
}

/// A camera that is there has as many columns as it has: 88, 176 or 160, 316, 320, 160.
#[test]
fn columns_are_those_of_the_camera() {
    for (options, columns) in [
        (&["--emulate"][..], "88"),
        (&["--emulate", "--high-res"], "176"),
        (&["--emulate=sensor=ov7620"], "160"),
        (&["--emulate", "--camera", "pixy2"], "316"),
        (&["--emulate", "--camera", "pixy"], "320"),
        (&["--emulate", "--camera", "openmv"], "320"),
        (&["--emulate", "--camera", "openmv-tags"], "160"),
    ] {
        let wrong = if columns == "160" { "88" } else { "160" };
        let fov = [options, &["--fov-deg", "45", "--count", "1", "--columns"]].concat();
        let text = failure(&[&fov[..], &[wrong]].concat());
        let told = format!("--columns {wrong}: this camera has {columns} columns");
        assert!(text.contains(&told), "{text}");
        let done = run(&[&["probe"], &fov[..], &[columns]].concat());
        assert_eq!(done.code, 0, "{}", done.stderr);
    }
    // A banner that names no sensor says nothing of columns.
    let unknown = [
        "probe",
        "--emulate=switch=module=2",
        "--settle",
        "0",
        "--count",
        "1",
    ];
    let done = run(&[&unknown[..], &["--fov-deg", "45", "--columns", "160"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
}

/// Runs of `host-sim probe` on a line.
trait Probed {
    fn arguments<'a>(&'a self, arguments: &[&'a str]) -> Vec<&'a str>;

    /// A run that succeeds: its output, and its messages.
    fn probe(&self, arguments: &[&str]) -> (String, String) {
        let done = run(&self.arguments(arguments));
        assert_eq!(done.code, 0, "{}", done.stderr);
        (done.stdout, done.stderr)
    }

    /// The JSON objects that a run prints.
    fn json(&self, arguments: &[&str]) -> Vec<Value> {
        let (stdout, _) = self.probe(&[arguments, &["--json"]].concat());
        stdout
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }
}

/// A camera in virtual time.
struct Emulated(Vec<String>);

impl Emulated {
    fn new(scene: &str, options: &[&str]) -> Self {
        let options = options.iter().map(|&option| option.to_owned());
        let options = options.chain([format!("scene={scene}")]);
        Self(
            options
                .map(|option| format!("--emulate={option}"))
                .collect(),
        )
    }
}

impl Probed for Emulated {
    fn arguments<'a>(&'a self, arguments: &[&'a str]) -> Vec<&'a str> {
        let line = self.0.iter().map(String::as_str);
        let arguments = arguments.iter().copied();
        ["probe"].into_iter().chain(line).chain(arguments).collect()
    }
}

/// `host-sim camera` in real time until it is dropped.
struct Camera {
    child: Child,
    port: String,
    /// Its messages, line by line.
    told: Receiver<String>,
}

impl Camera {
    fn start(files: &Files, scene: &str, arguments: &[&str]) -> Self {
        // The link of a killed camera may by now lead to another one.
        static CAMERAS: AtomicUsize = AtomicUsize::new(0);
        let number = CAMERAS.fetch_add(1, Ordering::Relaxed);
        let port = files.path(&format!("camera{number}"));
        let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["camera", "--verbose", "--pty", &port, "--scene", scene])
            .args(arguments)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (tell, told) = mpsc::channel();
        let said = BufReader::new(child.stderr.take().unwrap()).lines();
        // The test may not listen any more.
        thread::spawn(move || said.for_each(|line| drop(tell.send(line.unwrap()))));
        let mut this = Self { child, port, told };
        assert!(this.says("started"));
        this
    }

    /// Waits until it has said this; false if it ended before.
    fn says(&mut self, words: &str) -> bool {
        self.told.iter().any(|line| line.contains(words))
    }
}

impl Probed for Camera {
    fn arguments<'a>(&'a self, arguments: &[&'a str]) -> Vec<&'a str> {
        [&["probe", "--port", &self.port], arguments].concat()
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Orange over columns 20 to 67 of 88: the middle is 43.5, straight ahead.
fn square() -> String {
    data("camera/square.toml")
}

/// Around the orange of all scenes here, whatever the gain.
const ORANGE: &str = "170,240,60,170,16,90";

/// Angle of one of 88 columns over 45 degrees, at the middle, radians: the uncertainty of whole columns.
const COLUMN: f64 = 0.0096;

fn number(line: &Value, key: &str) -> f64 {
    line[key]
        .as_f64()
        .unwrap_or_else(|| panic!("{key} in {line}"))
}

#[test]
fn every_baud_rate() {
    for rate in [
        "1200", "2400", "4800", "9600", "19200", "38400", "57600", "115200",
    ] {
        let camera = Emulated::new(&square(), &[&format!("baud={rate}")]);
        let options = ["--settle", "0", "--count", "3", "--fov-deg", "45"];
        let lines = camera.json(&[&["--baud", rate], &options[..]].concat());
        assert_eq!(lines.len(), 3, "{rate}");
        for line in lines {
            assert_eq!((number(&line, "x1"), number(&line, "x2")), (20.0, 67.0));
            assert!(
                number(&line, "bearing_rad").abs() < COLUMN,
                "{rate}: {line}"
            );
            assert_eq!(line["confidence"], 255);
        }
    }
}

#[test]
fn the_rate_is_found() {
    let camera = Emulated::new(&square(), &["baud=9600"]);
    let (_, told) = camera.probe(&["--settle", "0", "--count", "1"]);
    assert!(
        told.contains("CMUcam2 v1.00 c6 (OV6620) at 9600 baud"),
        "{told}"
    );
    let text = failure(&camera.arguments(&["--baud", "115200"])[1..]);
    assert!(text.contains("115200 baud"), "{text}");
    assert!(text.contains("jumpers"), "{text}");
}

/// Nothing was garbled but the packet that the stop may have cut.
fn assert_unharmed(told: &str) {
    let unharmed = ["0 bytes garbled", "garbled: 1 cut short"];
    assert!(unharmed.iter().any(|what| told.contains(what)), "{told}");
}

/// The box covers columns 8 to 13 of 88: the middle is 10.5, and
/// `atan((43.5 - 10.5) / 43.5 * tan(22.5 deg))` is 17.44 degrees to the left.
#[test]
fn left_is_positive_and_columns_count_from_0() {
    let files = Files::new();
    let scene = files.write(
        "left.toml",
        "[background]\nplain = [110, 110, 110]\n[[object]]\ncolour = [220, 110, 40]\nshape = 'box'\n\
         stops = [{ picture = [0.125, 0.25], size = [0.068181818, 0.1] }]\n",
    );
    let camera = Emulated::new(&scene, &[]);
    let orange = ["--settle", "0", "--count", "1", "--colour", ORANGE];
    let line = &camera.json(&[&orange[..], &["--fov-deg", "45"]].concat())[0];
    assert_eq!((number(line, "x1"), number(line, "x2")), (8.0, 13.0));
    assert!((number(line, "bearing_rad") - 17.44_f64.to_radians()).abs() < COLUMN);
    assert!((number(line, "row") - 35.5).abs() < 1.5, "{line}");
    // Without a field of view there are columns only.
    let line = &camera.json(&orange)[0];
    assert!(line["bearing_rad"].is_null() && line["column"].is_i64());
    let (text, told) = camera.probe(&orange);
    assert!(
        text.contains("box   8") && !text.contains("bearing"),
        "{text}"
    );
    assert!(told.contains("1 packet; "), "{told}");
    assert_unharmed(&told);
    // Twice the columns, the same direction.
    let line = &camera.json(&[&orange[..], &["--fov-deg", "45", "--high-res"]].concat())[0];
    assert_eq!((number(line, "x1"), number(line, "x2")), (16.0, 27.0));
    assert!((number(line, "bearing_rad") - 17.44_f64.to_radians()).abs() < COLUMN);
}

/// A ball before a background of four by three patches of these colours, in this light.
fn ball_before(files: &Files, name: &str, light: f64, patches: &[[u8; 3]]) -> String {
    let list: Vec<_> = patches.iter().map(|colour| format!("{colour:?}")).collect();
    files.write(
        name,
        &format!(
            "light = [{light}, {light}, {light}]\nnoise = 2.0\n[background.blocks]\ncolumns = 4\nrows = 3\n\
             colours = [{}]\n[[object]]\ncolour = [220, 110, 40]\nshape = 'disc'\n\
             stops = [{{ picture = [0.5, 0.5], size = [0.55, 0.6] }}]\n",
            list.join(", ")
        ),
    )
}

#[test]
fn a_learnt_colour_is_judged_by_its_background() {
    let files = Files::new();
    let run = ["--settle", "0", "--count", "1"];
    let grey = [[120, 118, 112]; 12];

    // A good light: nothing else has the colour.
    let camera = Emulated::new(&ball_before(&files, "good.toml", 1.0, &grey), &[]);
    let (_, told) = camera.probe(&run);
    assert!(
        told.contains("nothing in the background has this colour"),
        "{told}"
    );

    // An orange wall on the right: no window tells the ball from it.
    let mut wall = grey;
    (2..12)
        .step_by(4)
        .for_each(|patch| wall[patch] = [220, 110, 40]);
    (3..12)
        .step_by(4)
        .for_each(|patch| wall[patch] = [220, 110, 40]);
    let camera = Emulated::new(&ball_before(&files, "wall.toml", 1.0, &wall), &[]);
    let text = failure(&camera.arguments(&["--count", "1"])[1..]);
    for words in [
        "of the background has this colour",
        "no narrower one",
        "--colour",
    ] {
        assert!(text.contains(words), "no {words} in {text}");
    }
    // A wall of half the outer view.
    let share: f64 = text
        .split(" %")
        .next()
        .unwrap()
        .rsplit(' ')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!((45.0..60.0).contains(&share), "{text}");
    // An explicit colour is used all the same.
    camera.probe(&[&run[..], &["--colour", ORANGE]].concat());

    // Wood of another hue: a narrower window tells it from the ball.
    let wood = grey.map(|_| [205, 128, 62]);
    let camera = Emulated::new(&ball_before(&files, "wood.toml", 1.0, &wood), &[]);
    let (stdout, told) = camera.probe(&[&run[..], &["--json"]].concat());
    assert!(told.contains("so a narrower one is taken"), "{told}");
    let line: Value = serde_json::from_str(stdout.lines().next().unwrap()).unwrap();
    let width = number(&line, "x2") - number(&line, "x1");
    assert!((44.0..=50.0).contains(&width), "{line}");

    // A poor light: the window around the ball's dark colour has the dark room in it, a narrower one
    // has not. In still less light no window is without the room.
    let room = [[90, 80, 70]; 12];
    let camera = Emulated::new(&ball_before(&files, "dim.toml", 0.08, &room), &[]);
    let (_, told) = camera.probe(&run);
    assert!(told.contains("so a narrower one is taken"), "{told}");
    let camera = Emulated::new(&ball_before(&files, "dark.toml", 0.04, &room), &[]);
    let text = failure(&camera.arguments(&["--count", "1"])[1..]);
    assert!(text.contains("try another light"), "{text}");
}

/// A green ball in a slanting light, before a white cloth: discs within each other, each brighter than the one before.
fn lit_ball(files: &Files, share: f64, middle: f64) -> String {
    let mut scene = "noise = 1.0\n[background]\nplain = [228, 228, 224]\n".to_owned();
    for step in 0..16 {
        let light = f64::from(step) / 16.0;
        let colour = [48.0, 178.0, 84.0].map(|level| (level * (0.35 + 0.75 * light)) as u8);
        let (x, y) = (middle + 0.2 * share * light, 0.5 - 0.3 * share * light);
        let size = share * (1.0 - 0.9 * light);
        scene += &format!(
            "[[object]]\ncolour = {colour:?}\nshape = 'disc'\n\
             stops = [{{ picture = [{x}, {y}], size = [{}, {size}] }}]\n",
            size * 0.75
        );
    }
    files.write("lit.toml", &scene)
}

/// The edges that are tracked are those of the ball, and not of its lit side; or nothing is learnt.
#[test]
fn a_learnt_colour_holds_the_whole_object() {
    let files = Files::new();
    let mut held = 0;
    for (share, middle) in [
        (0.45, 0.5),
        (0.52, 0.45),
        (0.6, 0.5),
        (0.6, 0.52),
        (0.9, 0.5),
    ] {
        let camera = Emulated::new(&lit_ball(&files, share, middle), &[]);
        let done = run(&camera.arguments(&["--settle", "2", "--count", "1", "--json"]));
        let told = format!("{share} {middle}: {}", done.stderr);
        if done.code != 0 {
            assert!(told.contains("does not show the whole object"), "{told}");
            continue;
        }
        let line: Value = serde_json::from_str(&done.stdout).unwrap();
        for (edge, side) in [("x1", -0.5), ("x2", 0.5)] {
            let column = (middle + side * share * 0.75) * 88.0 - 0.5;
            assert!(
                (number(&line, edge) - column).abs() < 1.1,
                "{edge} {line} {told}"
            );
        }
        held += 1;
    }
    assert!((2..=5).contains(&held), "{held}");
}

#[test]
fn other_cameras() {
    let files = Files::new();
    let camera = Emulated::new(&square(), &["sensor=ov7620"]);
    let run = ["--settle", "0", "--count", "1", "--fov-deg", "45"];
    let line = &camera.json(&run)[0];
    assert!((number(line, "column") - 79.5).abs() < 1.0);
    assert!(number(line, "bearing_rad").abs() < COLUMN);
    let text = failure(&camera.arguments(&["--high-res"])[1..]);
    assert!(text.contains("no high resolution"), "{text}");

    // No module in the banner, and columns from 0: an object that fills the view shows it.
    let plain = files.write("plain.toml", "[background]\nplain = [150, 100, 60]\n");
    let other = ["switch=module=2", "switch=origin=0"];
    let camera = Emulated::new(&plain, &other);
    let run = [&run[..], &["--colour", "16,240,16,240,16,240"]].concat();
    let (_, told) = camera.probe(&run);
    assert!(told.contains("88 columns are assumed"), "{told}");
    assert!(!told.contains("give --first-column"), "{told}");
    assert!(told.contains("all over the view"), "{told}");
    let wrong = [&run[..], &["--first-column", "1"]].concat();
    let (text, told) = camera.probe(&wrong);
    assert!(told.contains("give --first-column 0"), "{told}");
    // An object that fills the view has no bearing.
    assert!(text.contains("box") && !text.contains("bearing"), "{text}");
}

#[test]
fn a_picture_of_a_wall() {
    let files = Files::new();
    let plain = files.write("plain.toml", "[background]\nplain = [150, 100, 60]\n");
    let file = files.path("wall.png");
    for switch in ["row_marks=1", "row_marks=0"] {
        let camera = Emulated::new(&plain, &[&format!("switch={switch}")]);
        a_wall(&camera.json(&["--settle", "0", "--frame", &file])[0], &file);
        fs::remove_file(&file).unwrap();
    }
    // What came of most of it is not called a picture.
    let camera = Emulated::new(&plain, &["fault=overrun=0.01"]);
    let text = failure(&camera.arguments(&["--baud", "115200", "--frame", &file])[1..]);
    assert!(text.contains("rows were damaged"), "{text}");
    assert!(!fs::exists(file).unwrap());
}

fn a_wall(line: &Value, file: &str) {
    assert_eq!(line["columns"], 87);
    assert_eq!(line["rows"], 143);
    assert_eq!(line["damaged_rows"], 0);
    let decoder = png::Decoder::new(BufReader::new(File::open(file).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!((info.width, info.height), (174, 143));
    let (first, _) = pixels.split_at(3);
    assert!(pixels.as_chunks::<3>().0.iter().all(|pixel| pixel == first));
    // Gain and white balance are the camera's; this wall is reddish under any of them.
    let ratio = |a: usize, b: usize| f64::from(first[a]) / f64::from(first[b]);
    assert!((ratio(0, 1) - 1.5).abs() < 0.2 && (ratio(1, 2) - 1.67).abs() < 0.2);
}

/// A camera at (1, 2) that looks 30 degrees to the left of the x axis, and a ball at four places
/// around 3 away, as the emulator projects it; the pose comes back.
#[test]
fn record_then_solve() {
    let files = Files::new();
    let file = files.path("s.csv");
    let places = [(4.0, 2.9), (3.2, 4.0), (3.4, 2.6), (2.6, 3.4)];
    for (number, (x, y)) in (1..).zip(places) {
        let scene = files.write(
            "ball.toml",
            &format!(
                "[background]\nplain = [110, 110, 110]\n\
                 [camera]\nfov_deg = 45.0\nx = 1.0\ny = 2.0\nheading_deg = 30.0\n\
                 [[object]]\ncolour = [220, 110, 40]\nstops = [{{ x = {x}, y = {y}, radius = 0.1 }}]\n"
            ),
        );
        let camera = Emulated::new(&scene, &[]);
        let place = format!("{x},{y}");
        let options = format!(
            "--settle 0 --colour {ORANGE} --fov-deg 45 --packets 5 --case north --at {place} --record"
        );
        let options: Vec<_> = options.split(' ').chain([&file[..]]).collect();
        let (text, _) = camera.probe(&options);
        assert!(
            text.starts_with(&format!("north,{place}: column ")),
            "{text}"
        );
        let content = fs::read_to_string(&file).unwrap();
        assert_eq!(content.lines().count(), 1 + number);
    }
    let done = run(&["solve", &file, "--fov-deg", "45", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let pose: Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!(
        (&pose["case"], &pose["status"]),
        (&"north".into(), &"calibrated".into())
    );
    assert!((number(&pose, "x") - 1.0).abs() < 0.15, "{pose}");
    assert!((number(&pose, "y") - 2.0).abs() < 0.15, "{pose}");
    let turned = number(&pose, "heading_rad") - 30_f64.to_radians();
    assert!(turned.abs() < COLUMN + 0.03, "{pose}");
}

#[test]
fn places_are_read_line_by_line() {
    let files = Files::new();
    let file = files.path("s.csv");
    let camera = Emulated::new(&square(), &[]);
    let options = "--settle 0 --packets 3 --fov-deg 45 --json --record".split(' ');
    let options: Vec<_> = options.chain([&file[..]]).collect();
    let arguments = camera.arguments(&options);
    let done = run_with_input(&arguments, "1 2\n\nthere\n-3.5; 4\nq\n9,9\n");
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(
        done.stderr.contains("there: two numbers"),
        "{}",
        done.stderr
    );
    assert!(done.stderr.contains("2 sightings added"), "{}", done.stderr);
    let content = fs::read_to_string(&file).unwrap();
    let rows: Vec<&str> = content.lines().collect();
    assert_eq!(rows.len(), 3, "{content}");
    assert_eq!(rows[0], "case,target_x,target_y,column,sigma_rad");
    assert!(rows[1].starts_with("camera,1,2,43.5,") && rows[2].starts_with("camera,-3.5,4,43.5,"));
    let line: Value = serde_json::from_str(done.stdout.lines().next().unwrap()).unwrap();
    let keys = "case target_x target_y column sigma_rad column_sigma bearing_rad packets pixels confidence";
    let keys: Vec<_> = keys.split(' ').collect();
    assert!(keys.iter().all(|key| line.get(*key).is_some()), "{line}");
    assert_eq!(line.as_object().unwrap().len(), keys.len());
}

#[test]
fn what_is_cut_off_or_not_there_is_not_recorded() {
    let files = Files::new();
    let file = files.path("s.csv");
    let scene = files.write(
        "edge.toml",
        "[background]\nplain = [110, 110, 110]\n[[object]]\ncolour = [220, 110, 40]\n\
         stops = [{ picture = [0.98, 0.5], size = 0.2 }]\n",
    );
    let camera = Emulated::new(&scene, &[]);
    let record = ["--record", &file, "--at", "1,2", "--packets", "3"];
    let text = failure(&camera.arguments(&[&record[..], &["--colour", ORANGE]].concat())[1..]);
    assert!(
        text.contains("cut off by the border of the picture"),
        "{text}"
    );
    let text = failure(
        &camera.arguments(&[&record[..], &["--colour", "16,40,16,40,200,240"]].concat())[1..],
    );
    assert!(text.contains("nothing is tracked"), "{text}");
    // Nor of places that are read, of which none is a place with an object.
    let options = [
        "--settle",
        "0",
        "--packets",
        "3",
        "--colour",
        ORANGE,
        "--record",
        &file,
    ];
    let done = run_with_input(&camera.arguments(&options), "1,2\nthere\n");
    assert_eq!(done.code, 2, "{}", done.stderr);
    assert!(
        done.stderr.contains("no sighting was added"),
        "{}",
        done.stderr
    );
    assert!(!fs::exists(&file).unwrap());
    // Without any place there is nothing to fail.
    let done = run_with_input(&camera.arguments(&options), "\n");
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(done.stderr.contains("0 sightings added"), "{}", done.stderr);
}

#[test]
fn a_camera_that_was_started_up_goes_on_as_it_is() {
    let files = Files::new();
    let camera = Camera::start(&files, &square(), &[]);
    let (_, learnt) = camera.probe(&["--baud", "115200", "--settle", "0", "--count", "1"]);
    let (_, known) = camera.probe(&["--baud", "115200", "--as-is", "--count", "1"]);
    let colour = |told: &str| told.split_once("--colour ").unwrap().1[..20].to_owned();
    assert_eq!(colour(&learnt), colour(&known));
}

/// The commands of a firmware count; another name of it is told.
#[test]
fn kindred_firmware_is_a_warning() {
    for (version, banner) in [
        ("3", "CMUcam2+ v1.00 c6"),
        ("4", "CMUcam2 v2.0+ c6"),
        ("5", "CMUcam3 v1.0 c6"),
    ] {
        let switch = format!("switch=version={version}");
        let camera = Emulated::new(&square(), &[&switch]);
        let (_, told) = camera.probe(&["--baud", "115200", "--settle", "0", "--count", "2"]);
        assert!(told.contains(&format!("calls itself `{banner}`")), "{told}");
    }
}

/// Frames one after the other, at a rate that is not tried first.
#[test]
fn a_camera_that_sends_frames_is_found() {
    let camera = Emulated::new(&square(), &["baud=19200", "heard=\\rFS 1\\rSF\\r"]);
    let (_, told) = camera.probe(&["--settle", "0", "--count", "2"]);
    assert!(told.contains("at 19200 baud"), "{told}");
}

/// A stream of frames is ended even if the wait is interrupted: the camera says so.
#[test]
fn a_camera_that_sends_frames_is_left_silent() {
    let files = Files::new();
    let mut camera = Camera::start(&files, &square(), &["--baud", "19200"]);
    let mut port = serialport::new(&camera.port, 19_200).open().unwrap();
    port.write_all(b"\rFS 1\rSF\r").unwrap();
    assert!(camera.says(" SF"));
    drop(port);
    let probe = spawn(&camera, &["--settle", "0"]);
    assert!(camera.says(" stopped"));
    interrupt(&probe);
    let output = probe.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
}

/// The camera's wiring and rate were right before.
#[test]
fn a_camera_that_hangs_was_started_before() {
    let files = Files::new();
    let camera = Camera::start(&files, &square(), &[]);
    let mut probe = spawn(&camera, &["--baud", "115200", "--settle", "0"]);
    first_line(&mut probe);
    let id = camera.child.id().to_string();
    let done = Command::new("kill").args(["-STOP", &id]).status().unwrap();
    assert!(done.success());
    let output = probe.wait_with_output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("fallen silent after"), "{told}");
    assert!(!told.contains("jumpers"), "{told}");
}

#[test]
fn a_line_with_faults() {
    let faults = [
        "fault=nck=0.1",
        "fault=cut=0.1",
        "fault=stray=0.002",
        "seed=5",
    ];
    let camera = Emulated::new(&square(), &faults);
    let (text, told) = camera.probe(&["--settle", "0", "--count", "60", "--colour", ORANGE]);
    assert_eq!(text.lines().count(), 60);
    assert!(text.lines().all(|line| line.contains("box  20")), "{text}");
    assert!(
        told.contains("60 packets") && !told.contains(" 0 bytes"),
        "{told}"
    );
}

#[test]
fn the_camera_goes_away() {
    let files = Files::new();
    let mut camera = Camera::start(&files, &square(), &[]);
    let mut probe = spawn(&camera, &["--baud", "115200", "--settle", "0"]);
    first_line(&mut probe);
    camera.child.kill().unwrap();
    let output = probe.wait_with_output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(told.contains("the serial port failed"), "{told}");
    assert!(told.contains("packet"), "{told}");
    for kind in ["pixy2", "openmv"] {
        let port = files.path(kind);
        let camera = Pixy::start(kind, &["--pty", &port]);
        let mut probe = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args([
                "probe", "--camera", kind, "--baud", "19200", "--port", &port,
            ])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let stdout = probe.stdout.as_mut().unwrap();
        let mut stdout = BufReader::with_capacity(1, stdout);
        stdout.read_line(&mut line).unwrap();
        drop(camera);
        let output = probe.wait_with_output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{kind}: {told}");
        assert!(told.contains("was the adapter unplugged"), "{kind}: {told}");
    }
}

fn spawn(camera: &Camera, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(camera.arguments(arguments))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn first_line(probe: &mut Child) {
    let mut line = String::new();
    let stdout = probe.stdout.as_mut().unwrap();
    BufReader::with_capacity(1, stdout)
        .read_line(&mut line)
        .unwrap();
    if !line.contains("column") {
        probe.kill().unwrap();
        let mut said = String::new();
        let stderr = probe.stderr.as_mut().unwrap();
        stderr.read_to_string(&mut said).unwrap();
        panic!("{line:?}, and {said:?}");
    }
}

fn interrupt(child: &Child) {
    let id = child.id().to_string();
    let done = Command::new("kill").args(["-INT", &id]).status().unwrap();
    assert!(done.success());
}

#[test]
fn ctrl_c_stops_the_stream() {
    let files = Files::new();
    let camera = Camera::start(&files, &square(), &[]);
    let mut probe = spawn(&camera, &["--baud", "115200", "--settle", "0"]);
    first_line(&mut probe);
    interrupt(&probe);
    let output = probe.wait_with_output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{told}");
    assert_unharmed(&told);
    // It is idle: it answers commands, and sends nothing in between.
    let mut port = OpenOptions::new();
    let mut port = port.read(true).write(true).open(&camera.port).unwrap();
    port.write_all(b"\rGV\r").unwrap();
    let mut said = Vec::new();
    let mut byte = [0];
    while !said.ends_with(b"c6\r:") {
        port.read_exact(&mut byte).unwrap();
        said.push(byte[0]);
    }
    assert_eq!(said, b"ACK\r:ACK\rCMUcam2 v1.00 c6\r:");
    // Before the first output, Ctrl-C is a failure.
    drop(port);
    let mut probe = spawn(&camera, &["--baud", "115200", "--settle", "600"]);
    let mut banner = String::new();
    let mut stderr = BufReader::new(probe.stderr.take().unwrap());
    stderr.read_line(&mut banner).unwrap();
    assert!(banner.starts_with("CMUcam2 v1.00"), "{banner}");
    interrupt(&probe);
    let output = probe.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
}

/// On a terminal it asks before it learns, and shows one line that changes.
#[test]
fn on_a_terminal() {
    let camera = Emulated::new(&square(), &[]);
    let (mut screen, kept, terminal) = LineEnd::pair();
    let open = || {
        OpenOptions::new()
            .read(true)
            .write(true)
            .open(&terminal)
            .unwrap()
    };
    let mut probe = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(camera.arguments(&["--settle", "0", "--seconds", "1", "--fov-deg", "45"]))
        .env("TERM", "xterm")
        .stdin(open())
        .stdout(open())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut told = String::new();
    let mut stderr = BufReader::new(probe.stderr.take().unwrap());
    let mut byte = [0];
    while !told.ends_with("press Enter. ") {
        stderr.read_exact(&mut byte).unwrap();
        told.push(char::from(byte[0]));
    }
    screen.write_all(b"\n").unwrap();
    drop(kept);
    let mut shown = String::new();
    let mut buffer = [0; 4096];
    // An error tells that it has ended.
    loop {
        match screen.read(&mut buffer) {
            Ok(bytes) => shown.push_str(&String::from_utf8_lossy(&buffer[..bytes])),
            Err(error) if error.kind() == ErrorKind::TimedOut => {}
            Err(_) => break,
        }
    }
    assert_eq!(probe.wait().unwrap().code(), Some(0));
    // The square is over the middle half of the view.
    assert!(
        shown.contains("=====O=====") && shown.contains(" column  43"),
        "{shown}"
    );
}

/// A camera of the Pixy family on a pseudo-terminal, which ends with it.
struct Pixy(Child);

impl Pixy {
    fn start(kind: &str, more: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["camera", "--kind", kind])
            .args(more)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut told = BufReader::new(child.stderr.take().unwrap()).lines();
        assert!(told.any(|line| line.unwrap().contains("at 19200 baud is on")));
        Self(child)
    }
}

impl Drop for Pixy {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

#[test]
fn all_of_the_pixy_family_record_then_solve() {
    let ball = ("", 0.1);
    for (kind, fov, columns, (shape, radius)) in [
        ("pixy2", "60", "316", ball),
        ("pixy", "75", "320", ball),
        ("openmv", "70.8", "320", ball),
        ("openmv-tags", "70.8", "160", ("shape = { tag = 4 }\n", 0.3)),
    ] {
        let files = Files::new();
        let file = files.path("s.csv");
        for (x, y) in [(4.0, 2.9), (3.2, 4.0), (3.4, 2.6), (2.6, 3.4)] {
            let scene = files.write(
                "ball.toml",
                &format!(
                    "[background]\nplain = [110, 110, 110]\n\
                     [camera]\nfov_deg = {fov}\nx = 1.0\ny = 2.0\nheading_deg = 30.0\n\
                     [[object]]\ncolour = [220, 110, 40]\n{shape}\
                     stops = [{{ x = {x}, y = {y}, radius = {radius} }}]\n"
                ),
            );
            let scene = format!("scene={scene}");
            let place = format!("{x},{y}");
            let tag: &[&str] = if kind == "openmv-tags" {
                &["--tag", "4"]
            } else {
                &[]
            };
            let done = run(&[
                &["probe", "--camera", kind, "--emulate", &scene],
                tag,
                &["--fov-deg", fov, "--record", &file, "--at", &place],
            ]
            .concat());
            assert_eq!(done.code, 0, "{kind}: {}", done.stderr);
            let begin = format!("camera,{place}: column ");
            assert!(done.stdout.starts_with(&begin), "{kind}: {}", done.stdout);
        }
        let solve = ["solve", &file, "--fov-deg", fov, "--json"];
        let done = run(&[&solve[..], &["--columns", columns]].concat());
        assert_eq!(done.code, 0, "{kind}: {}", done.stderr);
        let pose: Value = serde_json::from_str(&done.stdout).unwrap();
        assert!((number(&pose, "x") - 1.0).abs() < 0.1, "{kind}: {pose}");
        assert!((number(&pose, "y") - 2.0).abs() < 0.1, "{kind}: {pose}");
        let turned = number(&pose, "heading_rad") - 30_f64.to_radians();
        assert!(turned.abs() < 0.02, "{kind}: {pose}");
        // They are not columns of a CMUcam2.
        let wrong = run(&solve);
        if kind != "openmv-tags" {
            assert_ne!(wrong.code, 0, "{kind}: {}", wrong.stdout);
            assert!(
                wrong.stderr.contains("--columns"),
                "{kind}: {}",
                wrong.stderr
            );
        }
    }
}

/// The scene that a camera sees unless told otherwise has an object that stands long enough for all kinds. The Pixy
/// family tells neither pixels nor confidence.
#[test]
fn the_usual_scene_is_good_for_sightings() {
    let files = Files::new();
    for kind in ["cmucam2", "pixy2", "pixy", "openmv", "openmv-tags"] {
        let file = files.path(&format!("{kind}.csv"));
        let record = [
            "probe",
            "--camera",
            kind,
            "--emulate",
            "--fov-deg",
            "45",
            "--record",
            &file,
        ];
        let done = run_with_input(&record, "1,2\n3,4\n5,6\n");
        assert_eq!(done.code, 0, "{kind}: {}", done.stderr);
        assert!(
            done.stderr.contains("3 sightings added"),
            "{kind}: {}",
            done.stderr
        );
        let is_told = kind == "cmucam2";
        assert_eq!(
            done.stdout.contains("pixels"),
            is_told,
            "{kind}: {}",
            done.stdout
        );
        let done = run(&[&record[..], &["--at", "1,2", "--json"]].concat());
        let line: Value = serde_json::from_str(&done.stdout).unwrap();
        for key in ["pixels", "confidence"] {
            let told = line.get(key).unwrap();
            assert_eq!(told.is_null(), !is_told, "{kind}: {line}");
        }
    }
}

/// An object that is no ball, one that is not whole, and none: what is shown and what is recorded agree, and both say
/// why.
#[test]
fn a_view_without_a_bearing_is_not_recorded() {
    let files = Files::new();
    let file = files.path("s.csv");
    let scene = |object: &str| {
        let scene = format!("[background]\nplain = [110, 110, 110]\n{object}");
        format!("--emulate=scene={}", files.write("scene.toml", &scene))
    };
    let object = "[[object]]\ncolour = [225, 110, 35]\n";
    let view = |shape: &str, middle: &str, size: &str| {
        format!("{object}shape = {shape}\nstops = [{{ picture = {middle}, size = {size} }}]\n")
    };
    for (kind, object, words) in [
        (
            "pixy2",
            view("'box'", "[0.5, 0.5]", "[0.3, 0.1]"),
            "wider than tall",
        ),
        (
            "pixy",
            view("'disc'", "[0.5, 0.02]", "0.2"),
            "cut off by the border",
        ),
        (
            "openmv",
            view("'box'", "[0.5, 0.5]", "[0.05, 0.4]"),
            "out of shape",
        ),
        ("openmv-tags", String::new(), "not in view"),
    ] {
        let scene = scene(&object);
        let probe = ["probe", "--camera", kind, &scene, "--fov-deg", "45"];
        let shown = run(&[&probe[..], &["--count", "40", "--json"]].concat());
        let last: Value = serde_json::from_str(shown.stdout.lines().last().unwrap()).unwrap();
        assert!(last["bearing_rad"].is_null(), "{kind}: {last}");
        let reason = last["reason"].as_str().unwrap();
        assert!(reason.contains(words), "{kind}: {reason}");
        let text = failure(&[&probe[1..], &["--record", &file, "--at", "1,2"]].concat());
        let words = if object.is_empty() {
            "nothing is tracked"
        } else {
            words
        };
        assert!(text.contains(words), "{kind}: {text}");
    }
    // A tag may be turned.
    let turned = scene(&view("{ tag = 0 }", "[0.5, 0.5]", "[0.2, 0.4]"));
    let probe = [
        "probe",
        "--camera",
        "openmv-tags",
        &turned,
        "--count",
        "40",
        "--json",
    ];
    let done = run(&[&probe[..], &["--fov-deg", "45"]].concat());
    let last: Value = serde_json::from_str(done.stdout.lines().last().unwrap()).unwrap();
    assert!(
        last["bearing_rad"].is_number() && last["reason"].is_null(),
        "{last}"
    );
    let done = run(&probe);
    let last: Value = serde_json::from_str(done.stdout.lines().last().unwrap()).unwrap();
    assert_eq!(last["reason"], "--fov-deg is not given");
}

/// A camera that starts says nothing for two seconds, which are longer than a look at one rate.
#[test]
fn a_pixy_that_was_just_switched_on_is_found() {
    let files = Files::new();
    let port = files.path("pixy");
    let camera = Pixy::start("pixy", &["--pty", &port]);
    let id = camera.0.id().to_string();
    let done = Command::new("kill").args(["-USR1", &id]).status().unwrap();
    assert!(done.success());
    let done = run(&["probe", "--camera", "pixy", "--port", &port, "--count", "1"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(
        done.stderr.contains("taken for that of the Pixy"),
        "{}",
        done.stderr
    );
}

/// A stream, at another rate than is tried first; another tag than the one that is looked for; and none at all.
#[test]
fn a_stream_is_found_and_told_from_silence() {
    let probe = |kind: &str, more: &[&str]| {
        run(&[&["probe", "--camera", kind, "--count", "6", "--json"], more].concat())
    };
    for (kind, columns) in [("pixy", 320.0), ("openmv", 320.0), ("openmv-tags", 160.0)] {
        let done = probe(kind, &["--emulate", "baud=57600"]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        assert!(done.stderr.contains("at 57600 baud"), "{}", done.stderr);
        let lines = done.stdout.lines();
        let mut places = lines.map(|line| number(&serde_json::from_str(line).unwrap(), "x"));
        // Its usual scene has something near the middle.
        assert!(places.all(|x| (x - columns / 2.0).abs() < 0.1 * columns));
    }
    let other = probe("openmv-tags", &["--emulate", "", "--tag", "7"]);
    assert!(
        other.stdout.contains("\"blocks\":0,\"x\":null"),
        "{}",
        other.stdout
    );
    let (_device, _port, silent) = LineEnd::pair();
    for (kind, name) in [
        ("pixy", "no Pixy is heard"),
        ("openmv", "no OpenMV Cam is heard"),
    ] {
        let done = probe(kind, &["--port", &silent, "--baud", "19200"]);
        assert_ne!(done.code, 0);
        assert!(done.stderr.contains(name), "{}", done.stderr);
    }
}

/// At another rate the camera understands nothing.
#[test]
fn a_pixy2_has_one_rate() {
    let probe = ["probe", "--camera", "pixy2", "--emulate", "--fov-deg", "60"];
    let done = run(&[&probe[..], &["--count", "1"]].concat());
    let found = "a Pixy2 at 19200 baud";
    assert!(done.stderr.contains(found), "{}", done.stderr);
    let text = failure(&[&probe[1..], &["--baud", "115200"]].concat());
    assert!(text.contains("no Pixy2 answers"), "{text}");
    // PixyMon offers it, though no jumper of a CMUcam2 does.
    let fast = ["--emulate", "baud=230400", "--count", "1"];
    for baud in ["230400", "auto"] {
        let done = run(&[&probe[..], &fast, &["--baud", baud]].concat());
        let found = "a Pixy2 at 230400 baud";
        assert!(done.stderr.contains(found), "{}", done.stderr);
    }
}

/// On a pseudo-terminal: its ball is straight ahead, up to the way that it is moved.
#[test]
fn a_pixy2() {
    let files = Files::new();
    let port = files.path("pixy");
    let camera = Pixy::start("pixy2", &["--pty", &port]);
    let probe = |more: &[&str]| {
        let all = [
            "probe", "--camera", "pixy2", "--port", &port, "--baud", "19200",
        ];
        run(&[&all, more].concat())
    };
    let seen = probe(&["--count", "20", "--fov-deg", "45", "--json"]);
    let nothing = probe(&["--count", "3", "--signature", "2"]);
    let refused = probe(&["--high-res"]);
    drop(camera);
    assert_eq!(seen.code, 0, "{}", seen.stderr);
    assert!(
        seen.stderr.contains("blobs in 316 x 208"),
        "{}",
        seen.stderr
    );
    let lines: Vec<Value> = seen
        .stdout
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(lines.len(), 20);
    let bearings: Vec<f64> = lines
        .iter()
        .filter_map(|line| line["bearing_rad"].as_f64())
        .collect();
    assert!(!bearings.is_empty(), "{}", seen.stdout);
    assert!(
        bearings.iter().all(|bearing| bearing.abs() < 0.08),
        "{bearings:?}"
    );
    assert_eq!(nothing.stdout.lines().count(), 3);
    assert!(nothing.stdout.contains("not in view"), "{}", nothing.stdout);
    assert!(
        refused.stderr.contains("--high-res is for a CMUcam2"),
        "{}",
        refused.stderr
    );
    let (_camera, _port, silent) = LineEnd::pair();
    let done = run(&[
        "probe", "--camera", "pixy2", "--port", &silent, "--baud", "19200",
    ]);
    // The wait begins with words.
    let looking = format!("{silent}: looking for a Pixy2 at 19200 baud\n");
    assert!(done.stderr.starts_with(&looking), "{}", done.stderr);
    assert!(
        done.stderr.contains("no Pixy2 answers at 19200 baud"),
        "{}",
        done.stderr
    );
}
