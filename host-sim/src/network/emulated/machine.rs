//! The emulator's process.

use std::{
    fs::{self, File},
    io,
    os::unix::net::{UnixListener, UnixStream},
    process::{Child, Command, ExitStatus, Stdio},
    time::{Duration, Instant},
};

use node_firmware::config::page::{self, PAGE_MAX};

use super::{Board, EMULATOR, EmulatorError};
use crate::sim::executor::{Clock, Time};

/// The board's flash, a file in its directory.
pub(super) const FLASH: &str = "flash.bin";
const PAGE: &str = "page.bin";
const LOG: &str = "log";

/// Where the board looks for its configuration.
const PAGE_ADDRESS: &str = "0x003ff000";

/// The emulator's sockets, in the order of the UARTs.
const LINES: [&str; 3] = ["device", "radio", "panel"];

/// How long an emulator may take to open them, on a computer that starts many at once.
const PATIENCE: Duration = Duration::from_secs(30);

/// How often a process is looked at.
const PERIOD: Time = 5_000_000;

impl Board {
    /// Makes its directory, and writes its configuration page.
    fn prepare(&self) -> Result<(), EmulatorError> {
        let id = self.id();
        let mut bytes = [0; PAGE_MAX];
        let length = page::encode(&self.config, &mut bytes)
            .map_err(|reason| EmulatorError::Config { id, reason })?;
        fs::create_dir_all(&self.directory).map_err(EmulatorError::Files)?;
        fs::write(self.directory.join(PAGE), &bytes[..length]).map_err(EmulatorError::Files)
    }

    fn command(&self) -> io::Result<Command> {
        let log = File::create(self.directory.join(LOG))?;
        let mut command = Command::new(EMULATOR);
        command
            .args(["-M", "mps2-an386", "-cpu", "cortex-m4"])
            .args(["-display", "none", "-monitor", "none"]);
        for line in LINES {
            command.args(["-serial", &format!("unix:{line}")]);
        }
        command
            .args(["-semihosting-config", "enable=on,target=native"])
            .args([
                "-device",
                &format!("loader,file={PAGE},addr={PAGE_ADDRESS}"),
            ])
            .args(["-append", FLASH])
            .arg("-kernel")
            .arg(&self.emulation.image)
            .current_dir(&self.directory)
            .stdin(Stdio::null())
            .stdout(log.try_clone()?)
            .stderr(log);
        Ok(command)
    }
}

/// A running emulator. Ends with its owner.
pub(super) struct Machine(Child);

impl Machine {
    /// Switches a board on, and waits until its lines are open.
    pub(super) async fn start(
        board: &Board,
        clock: &Clock,
    ) -> Result<(Self, [UnixStream; 3]), EmulatorError> {
        board.prepare()?;
        let listeners = LINES.map(|name| {
            let path = board.directory.join(name);
            // Of the last time.
            let _ = fs::remove_file(&path);
            let listener = UnixListener::bind(path)?;
            listener.set_nonblocking(true)?;
            io::Result::Ok(listener)
        });
        let failed = |reason| EmulatorError::Start {
            id: board.id(),
            reason,
        };
        let child = board.command().map_err(EmulatorError::Files)?.spawn();
        let mut machine = Self(child.map_err(failed)?);
        let end = Instant::now() + PATIENCE;
        let mut lines = Vec::new();
        for listener in listeners {
            let listener = listener.map_err(EmulatorError::Files)?;
            lines.push(loop {
                match listener.accept() {
                    Ok((line, _)) => break line,
                    Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                    Err(error) => return Err(failed(error)),
                }
                if let Some(status) = machine.status() {
                    return Err(board.ended(status));
                }
                if Instant::now() > end {
                    return Err(EmulatorError::Silent {
                        id: board.id(),
                        seconds: PATIENCE.as_secs(),
                        files: board.keep_files(),
                    });
                }
                clock.sleep(PERIOD).await;
            });
        }
        for line in &lines {
            line.set_nonblocking(true).map_err(failed)?;
        }
        let lines = <[UnixStream; 3]>::try_from(lines);
        let lines = lines.map_err(|_| failed(io::ErrorKind::NotConnected.into()))?;
        Ok((machine, lines))
    }

    fn status(&mut self) -> Option<ExitStatus> {
        self.0.try_wait().ok().flatten()
    }

    /// When it ends by itself.
    pub(super) async fn ended(&mut self, clock: &Clock) -> ExitStatus {
        loop {
            if let Some(status) = self.status() {
                return status;
            }
            clock.sleep(PERIOD).await;
        }
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
