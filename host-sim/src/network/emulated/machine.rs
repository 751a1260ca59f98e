//! The emulator's process.

use std::{
    fs::{self, File},
    io,
    os::unix::net::{UnixListener, UnixStream},
    process::{Child, Command, ExitStatus, Stdio},
    time::Instant,
};

use board_support::flash::MPS2_AN386_CONFIG;
use node_firmware::config::page::{self, PAGE_MAX};

use super::{Board, EMULATOR, EmulatorError};
use virtual_bench::executor::{Clock, Time};

/// The board's flash, a file in its directory.
pub(super) const FLASH: &str = "flash.bin";
const PAGE: &str = "page.bin";
/// What the emulator prints.
pub(super) const LOG: &str = "log";

/// The emulator's sockets, in the order of the UARTs.
const LINES: [&str; 3] = ["device", "radio", "panel"];

/// How often a process is looked at.
const PERIOD: Time = 5_000_000;

/// Replaces itself by a program that ends with the thread that started it, even if that is killed;
/// part of util-linux. Elsewhere than on Linux, nobody does this.
const LEASH: Option<(&str, [&str; 2])> = if cfg!(target_os = "linux") {
    Some(("setpriv", ["--pdeathsig", "KILL"]))
} else {
    None
};

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

/// Whether the emulator can be started.
pub(super) fn check() -> Result<(), EmulatorError> {
    let version = |mut command: Command| command.arg("--version").stdin(Stdio::null()).output();
    match version(Command::new(EMULATOR)) {
        Ok(output) if output.status.success() => {}
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            return Err(EmulatorError::Unusable { said });
        }
        Err(_) => return Err(EmulatorError::Missing),
    }
    match version(leashed(EMULATOR)) {
        Ok(output) if output.status.success() => Ok(()),
        _ => Err(EmulatorError::NoLeash),
    }
}

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

    /// With this random number for this start.
    fn command(&self, seed: u64) -> io::Result<Command> {
        let log = File::create(self.directory.join(LOG))?;
        let mut command = leashed(EMULATOR);
        command
            .args(["-M", "mps2-an386", "-cpu", "cortex-m4"])
            .args(["-display", "none", "-monitor", "none"]);
        for line in LINES {
            command.args(["-serial", &format!("unix:{line}")]);
        }
        // Told one by one: the name of the image may have spaces, and the board does not need it.
        let arguments = format!("arg=node,arg={FLASH},arg={seed}");
        command
            .args([
                "-semihosting-config",
                &format!("enable=on,target=native,{arguments}"),
            ])
            .args([
                "-device",
                &format!("loader,file={PAGE},addr={MPS2_AN386_CONFIG:#x}"),
            ])
            .arg("-kernel")
            .arg(&self.image)
            .current_dir(&self.directory)
            .stdin(Stdio::null())
            .stdout(log.try_clone()?)
            .stderr(log);
        Ok(command)
    }
}

/// A running emulator. Ends with its owner, and with the thread that started it.
pub(super) struct Machine(Child);

impl Machine {
    /// Switches a board on, and waits until its lines are open.
    pub(super) async fn start(
        board: &Board,
        clock: &Clock,
        seed: u64,
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
        let child = board.command(seed).map_err(EmulatorError::Files)?.spawn();
        let mut machine = Self(child.map_err(failed)?);
        let started = Instant::now();
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
                if started.elapsed() > board.timeout {
                    return Err(board.silent("open its lines"));
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
