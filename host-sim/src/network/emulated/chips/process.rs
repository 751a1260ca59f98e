//! The process in which chips are emulated.

use std::{
    io::{self, BufReader, Read},
    os::{fd::AsFd, unix::process::CommandExt},
    path::Path,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
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

/// Somebody who wants to end the run while GDB is waited for does not wait longer.
const GLANCE: Duration = Duration::from_millis(100);

/// For how long something is waited for.
#[derive(Debug)]
enum Patience {
    Time(Duration),
    /// Until this is set.
    Until(Arc<AtomicBool>),
}

/// A pipe from somebody who may say nothing any more.
#[derive(Debug)]
struct Patient<R> {
    pipe: R,
    patience: Patience,
}

impl<R: Read + AsFd> Read for Patient<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let time = match self.patience {
            Patience::Time(time) => time,
            Patience::Until(_) => GLANCE,
        };
        let time = Timespec::try_from(time).ok();
        let told = loop {
            let mut pipe = [PollFd::new(&self.pipe, PollFlags::IN)];
            let told = poll(&mut pipe, time.as_ref());
            match &self.patience {
                Patience::Until(end) if told == Ok(0) && !end.load(Ordering::Relaxed) => {}
                // A signal is for others.
                _ if told == Err(Errno::INTR) => {}
                _ => break told?,
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
    pub(super) fn start(building: impl FnOnce()) -> Result<Self, EmulatorError> {
        let program = Path::new(BUILT).join("release/chips");
        let folder = Path::new(CRATE);
        if !folder.join("Cargo.toml").is_file() {
            return Err(EmulatorError::NoSource);
        }
        if !program.is_file() {
            building();
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
            // It would be elsewhere then.
            .env_remove("CARGO_BUILD_TARGET")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .status();
        if !built.map_err(EmulatorError::NoCargo)?.success() {
            return Err(EmulatorError::NotBuilt);
        }
        if !program.is_file() {
            return Err(EmulatorError::NotThere { program });
        }
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
                patience: Patience::Time(PATIENCE),
            }),
        })
    }

    /// From now on its answers may take until this is set: somebody may look at a chip that stands still.
    pub(super) fn wait_until(&mut self, end: Arc<AtomicBool>) {
        self.reports.get_mut().patience = Patience::Until(end);
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
        let patience = Patience::Time(Duration::from_millis(10));
        let mut patient = Patient { pipe, patience };
        let mut bytes = [0; 4];
        let error = patient.read(&mut bytes).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        other.write_all(&[1, 2]).unwrap();
        assert_eq!(patient.read(&mut bytes).unwrap(), 2);
        drop(other);
        assert_eq!(patient.read(&mut bytes).unwrap(), 0);
    }

    /// Who waits for ever can still be told to end, before and while he waits.
    #[test]
    fn waiting_ends_when_somebody_ends_it() {
        let (pipe, _other) = io::pipe().unwrap();
        let end = Arc::new(AtomicBool::new(false));
        let patience = Patience::Until(end.clone());
        let mut patient = Patient { pipe, patience };
        let reader = std::thread::spawn(move || {
            let mut again = || patient.read(&mut [0; 4]).unwrap_err().kind();
            [again(), again()]
        });
        std::thread::sleep(2 * GLANCE);
        assert!(!reader.is_finished());
        end.store(true, Ordering::Relaxed);
        assert_eq!(reader.join().unwrap(), [io::ErrorKind::TimedOut; 2]);
    }
}
