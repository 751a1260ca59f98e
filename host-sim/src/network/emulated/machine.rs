//! A board that is switched on.

use std::{fs, os::unix::net::UnixStream, process::ExitStatus, time::Instant};

use board_emulator::{Emulator, Machine, Running};
use board_support::flash::MPS2_AN386_CONFIG;
use node_firmware::config::page::{self, PAGE_MAX};

use super::{Board, EmulatorError};
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

    /// Switches it on, with this random number for this start, and waits until its lines are open.
    pub(super) async fn start(
        &self,
        clock: &Clock,
        seed: u64,
    ) -> Result<(Running, [UnixStream; 3]), EmulatorError> {
        self.prepare()?;
        let id = self.id();
        let failed = |reason| EmulatorError::Start { id, reason };
        let emulator = Emulator::new(Machine::Mps2An386, &self.image, &self.directory)
            .print_to(LOG)
            .map_err(EmulatorError::Files)?
            .load(PAGE, MPS2_AN386_CONFIG)
            .argument("node")
            .argument(FLASH)
            .argument(seed);
        let emulator = LINES.iter().fold(emulator, |all, line| all.line(line));
        let mut machine = emulator.start().map_err(failed)?;
        let started = Instant::now();
        loop {
            if let Some(lines) = machine.lines().map_err(failed)? {
                let lines = <[UnixStream; 3]>::try_from(lines);
                let lines = lines.map_err(|_| failed(std::io::ErrorKind::NotConnected.into()))?;
                return Ok((machine, lines));
            }
            if let Some(status) = machine.status() {
                return Err(self.ended(status));
            }
            if started.elapsed() > self.timeout {
                return Err(self.silent("open its lines"));
            }
            clock.sleep(PERIOD).await;
        }
    }
}

/// When it ends by itself.
pub(super) async fn ended(machine: &mut Running, clock: &Clock) -> ExitStatus {
    loop {
        if let Some(status) = machine.status() {
            return status;
        }
        clock.sleep(PERIOD).await;
    }
}
