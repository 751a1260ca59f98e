//! The process in which chips are emulated.

use std::{
    io::{self, BufReader, Read},
    os::{fd::AsFd, unix::process::CommandExt},
    path::Path,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    time::Duration,
};

use chip_pipe::{Orders, Reports, one_cpu::OneCpu, read, write};
use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    io::Errno,
};

use super::super::EmulatorError;

/// The folder of its crate, and where it is built, as `cargo xtask test --stage chip` builds it too.
const CRATE: &str = "nrf52840-emulator";
const BUILT: &str = "target/chip";

/// It answers sooner, also on a slow and busy computer: usually within a millisecond, and within seconds where it
/// translates a program first.
const PATIENCE: Duration = Duration::from_secs(120);

/// A pipe from somebody who may say nothing any more.
#[derive(Debug)]
struct Patient<R> {
    pipe: R,
    /// For how long that is waited for; `None`: for ever.
    patience: Option<Duration>,
}

impl<R: Read + AsFd> Read for Patient<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let patience = self.patience.and_then(|time| Timespec::try_from(time).ok());
        let told = loop {
            let mut pipe = [PollFd::new(&self.pipe, PollFlags::IN)];
            match poll(&mut pipe, patience.as_ref()) {
                // A signal is for others.
                Err(Errno::INTR) => {}
                told => break told?,
            }
        };
        if told == 0 {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.pipe.read(bytes)
    }
}

/// A running one, which ends with its owner, and is on the same CPU as he until then.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    #[expect(dead_code, reason = "until it is dropped")]
    one_cpu: OneCpu,
    orders: ChildStdin,
    reports: BufReader<Patient<ChildStdout>>,
}

impl Process {
    /// Builds it, unless it is up to date, and starts it.
    pub(super) fn start() -> Result<Self, EmulatorError> {
        let folder = Path::new(CRATE);
        if !folder.join("Cargo.toml").is_file() {
            return Err(EmulatorError::NoSource);
        }
        // Its own compiler, by its `rust-toolchain.toml`; this program may have been started by another.
        let built = Command::new("cargo")
            .args([
                "build",
                "--quiet",
                "--release",
                "--locked",
                "--bin",
                "chips",
            ])
            .arg("--target-dir")
            .arg(Path::new("..").join(BUILT))
            .current_dir(folder)
            .env_remove("RUSTUP_TOOLCHAIN")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .status();
        if !built.is_ok_and(|status| status.success()) {
            return Err(EmulatorError::NotBuilt);
        }
        let program = Path::new(BUILT).join("release/chips");
        let one_cpu = OneCpu::take();
        let mut child = Command::new(program)
            // Ctrl-C is for the owner, who still asks it then what chips know.
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(EmulatorError::Pipe)?;
        let (orders, reports) = (child.stdin.take(), child.stdout.take());
        let (Some(orders), Some(reports)) = (orders, reports) else {
            return Err(EmulatorError::Pipe(io::ErrorKind::BrokenPipe.into()));
        };
        Ok(Self {
            child,
            one_cpu,
            orders,
            reports: BufReader::new(Patient {
                pipe: reports,
                patience: Some(PATIENCE),
            }),
        })
    }

    /// From now on its answers may take as long as they do: somebody may look at a chip that stands still.
    pub(super) fn wait_for_ever(&mut self) {
        self.reports.get_mut().patience = None;
    }

    pub(super) fn order(&mut self, orders: &Orders) -> Result<(), EmulatorError> {
        write(&mut self.orders, orders).map_err(EmulatorError::Pipe)
    }

    /// Orders, and waits for what comes of it.
    pub(super) fn exchange(&mut self, orders: &Orders) -> Result<Reports, EmulatorError> {
        self.order(orders)?;
        let reports = read(&mut self.reports).map_err(|error| match error.kind() {
            io::ErrorKind::TimedOut => EmulatorError::Hangs(PATIENCE),
            _ => EmulatorError::Pipe(error),
        })?;
        reports.ok_or_else(|| EmulatorError::Pipe(io::ErrorKind::UnexpectedEof.into()))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It has nothing to lose.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    /// What is there is read, also the end; where nothing comes, not for ever.
    #[test]
    fn nobody_is_waited_for_too_long() {
        let (pipe, mut other) = io::pipe().unwrap();
        let patience = Some(Duration::from_millis(10));
        let mut patient = Patient { pipe, patience };
        let mut bytes = [0; 4];
        let error = patient.read(&mut bytes).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        other.write_all(&[1, 2]).unwrap();
        assert_eq!(patient.read(&mut bytes).unwrap(), 2);
        drop(other);
        assert_eq!(patient.read(&mut bytes).unwrap(), 0);
    }
}
