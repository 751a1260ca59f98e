//! The process in which chips are emulated.

use std::{
    io::{self, BufReader},
    os::unix::process::CommandExt,
    path::Path,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
};

use chip_pipe::{Orders, Reports, one_cpu::OneCpu, read, write};

use super::super::EmulatorError;

/// The folder of its crate, and where it is built, as `cargo xtask test --stage chip` builds it too.
const CRATE: &str = "nrf52840-emulator";
const BUILT: &str = "target/chip";

/// A running one, which ends with its owner, and is on the same CPU as he until then.
#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    #[expect(dead_code, reason = "until it is dropped")]
    one_cpu: OneCpu,
    orders: ChildStdin,
    reports: BufReader<ChildStdout>,
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
            reports: BufReader::new(reports),
        })
    }

    pub(super) fn order(&mut self, orders: &Orders) -> Result<(), EmulatorError> {
        write(&mut self.orders, orders).map_err(EmulatorError::Pipe)
    }

    /// Orders, and waits for what comes of it.
    pub(super) fn exchange(&mut self, orders: &Orders) -> Result<Reports, EmulatorError> {
        self.order(orders)?;
        let reports = read(&mut self.reports).map_err(EmulatorError::Pipe)?;
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
