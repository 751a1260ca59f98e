//! Boards in QEMU: an [`Emulator`] says what one has, [`start`](Emulator::start) switches it on, and
//! a [`Running`] one ends with its owner.
//!
//! For everyone in this workspace who runs machine code: simulations, tests of images, and counting
//! of instructions.

#![forbid(unsafe_code)]

use std::{
    fmt,
    fs::{self, File},
    io::{self, ErrorKind},
    os::unix::{
        net::{UnixListener, UnixStream},
        process::CommandExt,
    },
    path::{Path, PathBuf},
    process::{Child, ChildStdout, Command, ExitStatus, Output, Stdio},
};

/// The emulator.
pub const PROGRAM: &str = "qemu-system-arm";

/// Replaces itself by a program that ends with the thread that started it, even if that is killed;
/// part of util-linux. Elsewhere than on Linux, nobody does this.
const LEASH: Option<(&str, [&str; 2])> = if cfg!(target_os = "linux") {
    Some(("setpriv", ["--pdeathsig", "KILL"]))
} else {
    None
};

/// Why nothing can be emulated. The texts say what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Unavailable {
    /// The emulator is not installed.
    #[error(
        "{PROGRAM} was not found: install it, on Debian or Ubuntu with \
         `sudo apt-get install qemu-system-arm`"
    )]
    Missing,
    /// It does not even tell its version.
    #[error("{PROGRAM} does not start: {said}")]
    Unusable {
        /// What it said instead.
        said: String,
    },
    /// Nothing would end the emulators if this program were killed.
    #[error(
        "setpriv was not found, or it is too old for --pdeathsig: install util-linux, on Debian or \
         Ubuntu with `sudo apt-get install util-linux`"
    )]
    NoLeash,
}

/// Whether emulators can be started.
///
/// # Errors
/// [`Unavailable`]
pub fn check() -> Result<(), Unavailable> {
    let version = |mut command: Command| -> io::Result<Output> {
        command.arg("--version").stdin(Stdio::null()).output()
    };
    match version(Command::new(PROGRAM)) {
        Ok(output) if output.status.success() => {}
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            return Err(Unavailable::Unusable { said });
        }
        Err(_) => return Err(Unavailable::Missing),
    }
    match version(leashed(PROGRAM)) {
        Ok(output) if output.status.success() => Ok(()),
        _ => Err(Unavailable::NoLeash),
    }
}

/// A program that does not outlive this thread.
fn leashed(program: &str) -> Command {
    match LEASH {
        Some((leash, options)) => {
            let mut command = Command::new(leash);
            command.args(options).arg(program);
            command
        }
        None => Command::new(program),
    }
}

/// What is emulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Machine {
    /// An MPS2 with image AN386: a Cortex-M4F.
    Mps2An386,
    /// A BBC micro:bit: a Cortex-M0.
    Microbit,
}

impl Machine {
    const fn options(self) -> &'static [&'static str] {
        match self {
            Self::Mps2An386 => &["-M", "mps2-an386", "-cpu", "cortex-m4"],
            Self::Microbit => &["-M", "microbit"],
        }
    }
}

/// An emulated board that is not switched on yet. Files are found from its folder.
#[derive(Debug)]
pub struct Emulator {
    command: Command,
    folder: PathBuf,
    lines: Vec<String>,
    /// What the image is told, as programs are.
    arguments: Vec<String>,
}

impl Emulator {
    /// A board with this image, whose files are in this folder. It prints into the void.
    #[must_use]
    pub fn new(machine: Machine, image: &Path, folder: &Path) -> Self {
        let mut command = leashed(PROGRAM);
        command
            .args(machine.options())
            .args(["-display", "none", "-monitor", "none"])
            .arg("-kernel")
            .arg(image)
            .current_dir(folder)
            // Ctrl-C is for the owner, who ends it then.
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        Self {
            command,
            folder: folder.to_owned(),
            lines: Vec::new(),
            arguments: Vec::new(),
        }
    }

    /// Its next UART is a socket of this name.
    #[must_use]
    pub fn line(mut self, name: &str) -> Self {
        self.lines.push(name.to_owned());
        self
    }

    /// The next argument that semihosting tells the image; the first is its own name. Commas would
    /// end it.
    #[must_use]
    pub fn argument(mut self, argument: impl fmt::Display) -> Self {
        self.arguments.push(argument.to_string());
        self
    }

    /// It has the bytes of a file at this address.
    #[must_use]
    pub fn load(mut self, file: &str, address: u32) -> Self {
        let loader = format!("loader,file={file},addr={address:#x}");
        self.command.args(["-device", &loader]);
        self
    }

    /// QEMU itself answers on a socket of this name, in the form of QMP.
    #[must_use]
    pub fn monitor(mut self, name: &str) -> Self {
        let socket = format!("unix:{name},server=on,wait=off");
        self.command.args(["-qmp", &socket]);
        self
    }

    /// An instruction takes a nanosecond, and time depends on nothing else.
    #[must_use]
    pub fn counting(mut self) -> Self {
        self.command.args(["-icount", "shift=0"]);
        self
    }

    /// What it prints, and QEMU's own complaints, go to a file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn print_to(mut self, file: &str) -> io::Result<Self> {
        let log = File::create(self.folder.join(file))?;
        self.command.stdout(log.try_clone()?).stderr(log);
        Ok(self)
    }

    /// What it prints can be [taken](Running::printed).
    #[must_use]
    pub fn print_to_owner(mut self) -> Self {
        self.command.stdout(Stdio::piped());
        self
    }

    /// Switches it on.
    ///
    /// # Errors
    /// A socket cannot be made, or the program cannot be started.
    pub fn start(mut self) -> io::Result<Running> {
        let mut semihosting = "enable=on,target=native".to_owned();
        for argument in &self.arguments {
            semihosting += &format!(",arg={argument}");
        }
        self.command.args(["-semihosting-config", &semihosting]);
        let mut listeners = Vec::new();
        for name in &self.lines {
            let path = self.folder.join(name);
            match fs::remove_file(&path) {
                // Of the last time.
                Ok(()) => {}
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
            let listener = UnixListener::bind(path)?;
            listener.set_nonblocking(true)?;
            listeners.push(listener);
            self.command.args(["-serial", &format!("unix:{name}")]);
        }
        if self.lines.is_empty() {
            self.command.args(["-serial", "none"]);
        }
        Ok(Running {
            child: self.command.spawn()?,
            listeners,
            lines: Vec::new(),
        })
    }
}

/// A running emulator. Ends with its owner, and with the thread that started it.
#[derive(Debug)]
pub struct Running {
    child: Child,
    listeners: Vec<UnixListener>,
    /// Those that are open already.
    lines: Vec<UnixStream>,
}

impl Running {
    /// The far ends of its UARTs, in their order, once all are open; asked again until then. No
    /// line blocks.
    ///
    /// # Errors
    /// A socket failed.
    pub fn lines(&mut self) -> io::Result<Option<Vec<UnixStream>>> {
        while let Some(listener) = self.listeners.get(self.lines.len()) {
            match listener.accept() {
                Ok((line, _)) => {
                    line.set_nonblocking(true)?;
                    self.lines.push(line);
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
                Err(error) => return Err(error),
            }
        }
        self.listeners.clear();
        Ok(Some(std::mem::take(&mut self.lines)))
    }

    /// How it ended by itself, if it has.
    pub fn status(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// What it prints, once, if that is for its owner.
    pub fn printed(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use std::{
        thread,
        time::{Duration, Instant},
    };

    use super::*;

    /// Whoever is killed cannot end what it started.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_program_does_not_outlive_the_thread_that_started_it() {
        let start = || {
            let child = leashed("sleep").arg("600").spawn().unwrap();
            // Whoever is killed before this is another matter.
            let name = format!("/proc/{}/comm", child.id());
            while fs::read_to_string(&name).unwrap() != "sleep\n" {
                thread::sleep(Duration::from_millis(1));
            }
            child
        };
        let mut left = thread::spawn(start).join().unwrap();
        let begun = Instant::now();
        while left.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < Duration::from_secs(30), "it still runs");
            thread::sleep(Duration::from_millis(10));
        }
    }

    #[test]
    fn a_socket_of_the_last_time_is_replaced_and_other_trouble_is_told() {
        let folder = std::env::temp_dir().join(format!("board-emulator-{}", std::process::id()));
        fs::create_dir_all(folder.join("taken/by a folder")).unwrap();
        File::create(folder.join("camera")).unwrap();
        let board = || Emulator::new(Machine::Mps2An386, Path::new("no image"), &folder);
        // Without an image, or without QEMU, nothing comes of it, but its socket is there by then.
        drop(board().line("camera").start());
        // Nobody listens any more. A program that another test starts has all that is open here, until it
        // is that program.
        let begun = Instant::now();
        while UnixStream::connect(folder.join("camera")).is_ok() {
            assert!(begun.elapsed() < Duration::from_secs(30), "still there");
            thread::sleep(Duration::from_millis(10));
        }
        assert!(!folder.join("camera").is_file());
        assert!(board().line("taken").start().is_err());
        fs::remove_dir_all(folder).unwrap();
    }
}
