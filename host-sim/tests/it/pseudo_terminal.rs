//! The command `host-sim camera`, through real file descriptors.

use std::{
    cell::RefCell,
    fs::File,
    io::{BufRead, BufReader, Read, Write},
    os::unix::fs::symlink,
    path::Path,
    process::{Child, Command, Stdio},
    sync::mpsc::{self, Receiver},
    thread::{self, sleep},
    time::Duration,
};

use crate::common::wait_until;
use rustix::{
    io::ioctl_fionread,
    termios::{OptionalActions, tcgetattr, tcsetattr},
};

/// A camera that is ended with the test.
struct Camera {
    child: Child,
    /// Messages that were looked at so far.
    said: RefCell<String>,
    says: Receiver<String>,
}

impl Camera {
    fn start(link: &Path, options: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .args(["camera", "--verbose", "--pty"])
            .arg(link)
            .args(options)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let (tell, says) = mpsc::channel();
        // The test may not listen any more.
        thread::spawn(move || lines.for_each(|line| drop(tell.send(line.unwrap() + "\n"))));
        wait_until(|| link.exists());
        Self {
            child,
            said: RefCell::default(),
            says,
        }
    }

    /// Waits until it has said this.
    fn says(&self, words: &str) {
        let mut said = self.said.borrow_mut();
        while !said.contains(words) {
            *said += &self.says.recv().expect("it ended");
        }
    }

    /// Sends a signal by its name.
    fn signal(&self, name: &str) {
        let process = self.child.id().to_string();
        let done = Command::new("kill").args(["-s", name, &process]).status();
        assert!(done.unwrap().success());
    }

    /// Ends it as a terminal or a service manager does; returns its messages.
    fn end(mut self, name: &str) -> String {
        self.signal(name);
        let said = self.said.take() + &self.says.iter().collect::<String>();
        assert!(self.child.wait().unwrap().success());
        said
    }
}

impl Drop for Camera {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn open(link: &Path) -> File {
    File::options().read(true).write(true).open(link).unwrap()
}

/// Reads until this was read; returns all of it.
fn read_until(port: &mut File, end: &str) -> String {
    let mut all = Vec::new();
    while !all.ends_with(end.as_bytes()) {
        let mut byte = [0];
        port.read_exact(&mut byte).unwrap();
        all.push(byte[0]);
        assert!(all.len() < 10_000, "{}", String::from_utf8_lossy(&all));
    }
    String::from_utf8_lossy(&all).into_owned()
}

/// Sends carriage returns until a camera answers that may still be starting.
fn synchronise(port: &mut File) {
    port.write_all(b"\r").unwrap();
    // A banner if it was starting, an acknowledgement otherwise.
    read_until(port, ":");
}

#[test]
fn any_program_can_talk_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("camera");
    let camera = Camera::start(&link, &[]);
    {
        let mut port = open(&link);
        synchronise(&mut port);
        port.write_all(b"GV\r").unwrap();
        let banner = read_until(&mut port, "c6\r:");
        assert!(banner.ends_with("ACK\rCMUcam2 v1.00 c6\r:"), "{banner:?}");
        port.write_all(b"PM 1\r").unwrap();
        assert_eq!(read_until(&mut port, ":"), "ACK\r:");
        port.write_all(b"TC 100 240 30 200 16 120\r").unwrap();
        let packet = read_until(&mut port, ":");
        assert!(packet.starts_with("ACK\rT "), "{packet:?}");
        // Bytes that a terminal would translate or obey: the line does neither. 0x03, 0x0D and 0x0A are in
        // every frame.
        port.write_all(b"VW 1 1 10 13\r").unwrap();
        assert_eq!(read_until(&mut port, ":"), "ACK\r:");
        port.write_all(b"SF 0\r").unwrap();
        let mut frame = vec![0; 4 + 3 + 13 * 11 + 1 + 1];
        port.read_exact(&mut frame).unwrap();
        assert_eq!(frame[..7], [b'A', b'C', b'K', b'\r', 1, 10, 13]);
        assert!(frame[7..7 + 13 * 11].chunks(11).all(|row| row[10] == 2));
        assert_eq!(frame[7 + 13 * 11..], [3, b':']);
    }
    // The next program finds the same camera, and no bytes that were meant for the first.
    wait_until(|| {
        let mut port = open(&link);
        port.write_all(b"\r").unwrap();
        read_until(&mut port, ":") == "ACK\r:"
    });
    let said = camera.end("TERM");
    assert!(link.symlink_metadata().is_err(), "the link is still there");
    for part in [
        "115200 baud",
        "started",
        " GV\n",
        " TC 100 240 30 200 16 120\n",
        " SF 0\n",
    ] {
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn every_ordinary_end_removes_the_link() {
    let folder = tempfile::tempdir().unwrap();
    for signal in ["INT", "HUP", "TERM"] {
        let link = folder.path().join(signal);
        let camera = Camera::start(&link, &["--baud", "9600"]);
        camera.end(signal);
        assert!(link.symlink_metadata().is_err(), "after {signal}");
    }
}

/// Sets the rate of the port, as programs do that use a serial line.
fn set_baud(port: &File, baud: u32) {
    let mut modes = tcgetattr(port).unwrap();
    modes.set_speed(baud).unwrap();
    tcsetattr(port, OptionalActions::Now, &modes).unwrap();
}

/// Bytes that come within half a second of this command.
fn answer(port: &mut File, command: &[u8]) -> Vec<u8> {
    port.write_all(command).unwrap();
    sleep(Duration::from_millis(500));
    let mut all = Vec::new();
    let mut buffer = [0; 256];
    while ioctl_fionread(&*port).unwrap() > 0 {
        let bytes = port.read(&mut buffer).unwrap();
        all.extend(&buffer[..bytes]);
    }
    all
}

#[test]
fn a_program_with_another_rate_gets_garbage() {
    let folder = tempfile::tempdir().unwrap();
    for (options, understood) in [(&[][..], false), (&["--any-baud"][..], true)] {
        let link = folder.path().join(format!("{understood}"));
        let camera = Camera::start(&link, &[&["--baud", "38400"], options].concat());
        let mut port = open(&link);
        synchronise(&mut port);
        // The line end is answered after the banner.
        while !answer(&mut port, b"").is_empty() {}
        set_baud(&port, 9600);
        if understood {
            port.write_all(b"GV\r").unwrap();
            let banner = read_until(&mut port, "c6\r:");
            assert!(banner.ends_with("ACK\rCMUcam2 v1.00 c6\r:"), "{banner:?}");
        } else {
            port.write_all(b"GV\r").unwrap();
            camera.says("9600 baud");
            let heard = answer(&mut port, b"");
            assert!(!heard.starts_with(b"ACK"), "{heard:?}");
        }
        set_baud(&port, 38_400);
        wait_until(|| answer(&mut port, b"GB\r").ends_with(b"ACK\r0\r:"));
        let said = camera.end("TERM");
        assert_eq!(said.contains("9600 baud"), !understood, "{said}");
    }
}

#[test]
fn a_signal_cycles_the_power() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("camera");
    let camera = Camera::start(&link, &["--switch", "module=2"]);
    let mut port = open(&link);
    synchronise(&mut port);
    camera.signal("USR1");
    let banner = read_until(&mut port, "v1.00\r:");
    assert!(banner.ends_with("CMUcam2 v1.00\r:"), "{banner:?}");
}

/// A killed camera leaves a link that leads nowhere.
#[test]
fn a_stale_link_is_replaced_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let stale = folder.path().join("stale");
    symlink(folder.path().join("gone"), &stale).unwrap();
    let camera = Camera::start(&stale, &[]);
    let second = run(&["--pty", stale.to_str().unwrap()]);
    assert!(second.contains("in use"), "{second}");
    drop(camera);
    let file = folder.path().join("file");
    std::fs::write(&file, "mine").unwrap();
    let refused = run(&["--pty", file.to_str().unwrap()]);
    assert!(refused.contains("exists and is no link"), "{refused}");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "mine");
}

/// Messages of a camera that cannot start.
fn run(options: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .arg("camera")
        .args(options)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn what_is_wrong_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("camera");
    let scene = folder.path().join("scene.toml");
    std::fs::write(&scene, "noise = 1\n").unwrap();
    let link = link.to_str().unwrap();
    for (options, part) in [
        (&["--baud", "14400"][..], "1200, 2400"),
        (&["--switch", "orgin=1"], "there is no `orgin`"),
        (&["--fault", "nck=2"], "`nck` must be 0 to 1"),
        (&["--fault", "nck"], "NAME=VALUE"),
        (
            &["--scene", "/nowhere.toml"],
            "/nowhere.toml cannot be read",
        ),
        (&["--scene", scene.to_str().unwrap()], "background"),
        // Those that mean nothing for this kind of camera.
        (
            &["--taught", "1,2,3"],
            "--taught is for cameras that are taught",
        ),
        (
            &["--kind", "openmv-tags", "--taught", "1,2,3"],
            "--taught is for cameras that are taught",
        ),
        (
            &["--kind", "pixy2", "--sensor", "ov6620"],
            "--sensor is for a CMUcam2",
        ),
        (
            &["--kind", "pixy", "--switch", "origin=0"],
            "--switch is for a CMUcam2",
        ),
        (
            &["--kind", "openmv", "--fault", "nck=0.1"],
            "--fault is for a CMUcam2",
        ),
    ] {
        let said = run(&[&["--pty", link], options].concat());
        assert!(said.contains(part), "{options:?}: {said}");
        // It was never there.
        assert!(!said.contains("baud is on"), "{options:?}: {said}");
    }
    let said = run(&["--pty", "/nowhere/camera"]);
    assert!(said.contains("/nowhere/camera cannot be made"), "{said}");
}
