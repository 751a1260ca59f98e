//! Runs the command and keeps its files.

use std::{
    io::Write,
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

/// Result of a run.
pub(crate) struct Done {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

pub(crate) fn run(arguments: &[&str]) -> Done {
    run_with_input(arguments, "")
}

pub(crate) fn run_with_input(arguments: &[&str], input: &str) -> Done {
    let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A run may end before it reads its input: that is not checked here.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    let output = child.wait_with_output().unwrap();
    Done {
        code: output.status.code().unwrap(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: without_progress(&String::from_utf8(output.stderr).unwrap()),
    }
}

/// Messages other than the progress of cameras, `12.3 s  camera 4: calibrated, 3 sightings`.
fn without_progress(stderr: &str) -> String {
    let is_progress = |line: &&str| {
        let parts = line.trim_start().split_once(" s  camera ");
        parts.is_some_and(|(seconds, _)| seconds.parse::<f64>().is_ok())
    };
    let said = stderr.split_inclusive('\n');
    said.filter(|line| !is_progress(line)).collect()
}

/// A folder that goes away with the test.
pub(crate) struct Files(tempfile::TempDir);

impl Files {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    pub(crate) fn write(&self, name: &str, content: &str) -> String {
        let path = self.path(name);
        std::fs::write(&path, content).unwrap();
        path
    }
}

/// A file of the repository's recorded data.
pub(crate) fn data(name: &str) -> String {
    format!("{}/../tests/data/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// One end of a pseudo-terminal, which no other program inherits: otherwise the line would stay open after
/// its end.
#[cfg(unix)]
pub(crate) struct LineEnd(pub(crate) std::fs::File);

#[cfg(unix)]
impl LineEnd {
    /// Both ends of a line, raw: the device's end, and one that keeps it open; and the name of the port.
    pub(crate) fn pair() -> (Self, Self, String) {
        use rustix::{
            fs::{Mode, OFlags},
            pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt},
            termios::{OptionalActions, tcgetattr, tcsetattr},
        };
        let device =
            openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&device).unwrap();
        unlockpt(&device).unwrap();
        let name = ptsname(&device, Vec::new()).unwrap().into_string().unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let port = rustix::fs::open(&name, flags, Mode::empty()).unwrap();
        let mut modes = tcgetattr(&port).unwrap();
        modes.make_raw();
        tcsetattr(&port, OptionalActions::Now, &modes).unwrap();
        (Self(device.into()), Self(port.into()), name)
    }
}

/// A silent line times out now and then, so that the reader may look at something else.
#[cfg(unix)]
impl std::io::Read for LineEnd {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let wait = Timespec {
            tv_sec: 0,
            tv_nsec: 100_000_000,
        };
        let ready = poll(&mut [PollFd::new(&self.0, PollFlags::IN)], Some(&wait))?;
        match ready {
            0 => Err(std::io::ErrorKind::TimedOut.into()),
            _ => self.0.read(buffer),
        }
    }
}

#[cfg(unix)]
impl Write for LineEnd {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Time that no test should need, however slow the computer is: then something hangs.
pub(crate) const HANGS: Duration = Duration::from_secs(600);

/// Waits for something that another program does.
pub(crate) fn wait_until(mut holds: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !holds() {
        assert!(begin.elapsed() < HANGS, "it never came");
        thread::sleep(Duration::from_millis(5));
    }
}

/// Output as the documentation shows it.
pub(crate) fn as_shown(output: &str) -> String {
    let lines = output.lines().map(|line| match line {
        "" => "\n".to_owned(),
        _ => format!("    {line}\n"),
    });
    lines.collect()
}
