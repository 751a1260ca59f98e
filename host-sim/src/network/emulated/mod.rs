//! Nodes on emulated boards: machine code in `qemu-system-arm -M mps2-an386`, one process each.
//!
//! A board has three lines, sockets on this side:
//!
//! | UART | what is connected |
//! |---|---|
//! | 0 | the camera's line, or the console's |
//! | 1 | a [`CoProcessor`] on the medium |
//! | 2 | steps and lamps, as [`board_support::panel`] writes them |
//!
//! The emulator has its own time, that of the computer. So the simulation has to run in real time,
//! and no two runs are the same.
//!
//! Nobody watches such a node from within. What it has written down is read from the file that
//! holds its flash.

mod error;
mod machine;
mod memory;
mod panel;

use std::{
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::Arc,
};

use embassy_futures::select::{Either, Either4, select, select4};
use embedded_io_async::{Read, Write};
use node_firmware::{config::Config, memory::Fact};
use tempfile::TempDir;

pub use self::error::EmulatorError;
use self::machine::Machine;
use super::node::Panel;
use crate::sim::{
    co_processor::CoProcessor, executor::Clock, medium::Medium, medium::NodeId, polled::Polled,
};

/// The program.
const EMULATOR: &str = "qemu-system-arm";

/// Where `cargo xtask firmware` puts the image.
pub const IMAGE: &str = "target/firmware/mps2-an386-node.elf";

/// What emulated boards need, checked: the emulator and an image.
#[derive(Clone, Debug)]
pub struct Emulation {
    image: PathBuf,
    /// Holds a directory for each board.
    files: Arc<TempDir>,
}

impl Emulation {
    /// Boards that run this image.
    ///
    /// # Errors
    /// The emulator or the image is missing, or there is no room for files.
    pub fn of(image: &Path) -> Result<Self, EmulatorError> {
        let image = image
            .canonicalize()
            .ok()
            .filter(|image| image.is_file())
            .ok_or_else(|| EmulatorError::NoImage(image.to_owned()))?;
        let version = Command::new(EMULATOR)
            .arg("--version")
            .stdin(Stdio::null())
            .output();
        match version {
            Ok(output) if output.status.success() => {}
            Ok(output) => {
                let said = String::from_utf8_lossy(&output.stderr).into_owned();
                return Err(EmulatorError::Unusable { said });
            }
            Err(_) => return Err(EmulatorError::Missing),
        }
        let files = TempDir::with_prefix("nodes-").map_err(EmulatorError::Files)?;
        Ok(Self {
            image,
            files: Arc::new(files),
        })
    }

    /// A board that is still switched off, with its configuration.
    pub(super) fn board(&self, config: &Config) -> Board {
        Board {
            config: config.clone(),
            directory: self.files.path().join(config.id.to_string()),
            emulation: self.clone(),
        }
    }
}

/// An emulated board. Its flash outlasts its being switched off.
pub(super) struct Board {
    config: Config,
    emulation: Emulation,
    directory: PathBuf,
}

/// What surrounds a board.
pub(super) struct Surroundings<'a, U> {
    pub(super) clock: &'a Clock,
    pub(super) medium: &'a Medium,
    pub(super) antenna: NodeId,
    /// The far end of its UART 0.
    pub(super) device: U,
    pub(super) panel: &'a Panel,
    pub(super) seed: u64,
}

impl Board {
    fn id(&self) -> u16 {
        self.config.id
    }

    /// Runs it until it is dropped, which switches it off, or fails.
    pub(super) async fn run<U: Read + Write>(
        &self,
        surroundings: Surroundings<'_, U>,
    ) -> EmulatorError {
        let Surroundings {
            clock,
            medium,
            antenna,
            device,
            panel,
            seed,
        } = surroundings;
        let (mut machine, lines) = match Machine::start(self, clock).await {
            Ok(started) => started,
            Err(error) => return error,
        };
        let [line, radio, lamps] = lines.map(|line| Polled::new(line, clock.clone()));
        let address = super::provision::extended(self.id());
        let address = zigbee_link::wire::Eui64(address);
        let radio = CoProcessor::new(radio, medium, antenna, clock.clone(), address, seed);
        let connected = select4(
            bridge(line, device),
            radio.run(),
            panel::connect(lamps, panel),
            machine.ended(clock),
        );
        match connected.await {
            Either4::Fourth(status) => self.ended(status),
            // A line is closed a moment before its process has ended.
            _ => self.ended(machine.ended(clock).await),
        }
    }

    fn ended(&self, status: std::process::ExitStatus) -> EmulatorError {
        EmulatorError::Ended {
            id: self.id(),
            status,
            files: self.keep_files(),
        }
    }

    /// Leaves the files for people to look at.
    fn keep_files(&self) -> PathBuf {
        let kept = std::env::temp_dir().join(format!(
            "host-sim-{}-node-{}",
            std::process::id(),
            self.id()
        ));
        match std::fs::rename(&self.directory, &kept) {
            Ok(()) => kept,
            Err(_) => self.directory.clone(),
        }
    }

    /// What the node's role has written down, in the order of its records.
    pub(super) fn facts(&self, clock: &Clock) -> Vec<Fact> {
        memory::facts(&self.directory.join(machine::FLASH), clock)
    }
}

/// Carries bytes both ways until an end is closed or fails.
async fn bridge<A: Read + Write, B: Read + Write>(mut a: A, mut b: B) {
    let (mut from_a, mut from_b) = ([0; 256], [0; 256]);
    loop {
        let carried = match select(a.read(&mut from_a), b.read(&mut from_b)).await {
            Either::First(Ok(count @ 1..)) => b.write_all(&from_a[..count]).await.is_ok(),
            Either::Second(Ok(count @ 1..)) => a.write_all(&from_b[..count]).await.is_ok(),
            _ => false,
        };
        if !carried {
            return;
        }
    }
}
