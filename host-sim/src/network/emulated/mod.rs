//! Nodes on emulated boards: machine code on nRF52840s in virtual time, [`chips`]; or, as described here,
//! in `qemu-system-arm -M mps2-an386`, one process each.
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

pub(super) mod chips;
mod error;
mod files;
mod heard;
mod machine;
pub(super) mod memory;
mod panel;

use std::{
    cell::Cell,
    fs,
    path::{Path, PathBuf},
    process::ExitStatus,
    rc::Rc,
    sync::Arc,
    time::Duration,
};

use embassy_futures::select::{Either, Either4, select, select4};
use embedded_io_async::{Read, Write};
use node_firmware::{config::CheckedConfig, facts::Fact};

pub use self::error::EmulatorError;
use self::{files::Folder, heard::Heard};
use super::node::Panel;
use virtual_bench::{
    co_processor::CoProcessor,
    executor::{Clock, Time},
    medium::{Medium, NodeId},
    polled::Polled,
};
use zigbee_link::wire::Eui64;

/// Where `cargo xtask firmware` puts the image.
pub const IMAGE: &str = "target/firmware/mps2-an386-node.elf";

/// How long a board may take to show that it runs, unless told otherwise: many start at once, and
/// on a computer that does other things too.
const TIMEOUT: Duration = Duration::from_secs(30);

/// A process that has closed its lines has ended after this.
const LINGERING: Time = 5_000_000_000;

/// What the emulated boards of one run need, checked: the emulator and an image.
#[derive(Debug)]
pub struct Emulation {
    image: PathBuf,
    timeout: Duration,
    /// Holds a directory for each board.
    files: Arc<Folder>,
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
            .ok_or_else(|| EmulatorError::NoImage {
                image: image.to_owned(),
                usual: IMAGE,
            })?;
        board_emulator::check()?;
        let files = Folder::new().map_err(EmulatorError::Files)?;
        Ok(Self {
            image,
            timeout: TIMEOUT,
            files: Arc::new(files),
        })
    }

    /// The same, with another time within which each board has to open its lines after it was
    /// switched on, and then to talk to its radio, and which may pass until it tells its lamps
    /// again. A run with one that does not is over.
    #[must_use]
    pub fn with_timeout(self, timeout: Duration) -> Self {
        Self { timeout, ..self }
    }

    /// A board that is still switched off, with its configuration.
    pub(super) fn board(&self, config: &CheckedConfig) -> Board {
        Board {
            config: config.clone(),
            image: self.image.clone(),
            timeout: self.timeout,
            directory: self.files.path().join(config.id.to_string()),
            files: self.files.clone(),
        }
    }
}

/// An emulated board. Its flash outlasts its being switched off.
pub(super) struct Board {
    config: CheckedConfig,
    image: PathBuf,
    timeout: Duration,
    directory: PathBuf,
    files: Arc<Folder>,
}

/// A board of either kind.
pub(super) enum Emulated {
    Qemu(Box<Board>),
    Chip(Rc<chips::Board>),
}

impl Emulated {
    /// Runs it until it is dropped, which switches it off, or fails.
    pub(super) async fn run<U: Read + Write>(
        &self,
        surroundings: Surroundings<'_, U>,
    ) -> EmulatorError {
        match self {
            Self::Qemu(board) => board.run(surroundings).await,
            Self::Chip(board) => board.run(surroundings).await,
        }
    }

    /// The extended address that the node has drawn.
    pub(super) fn extended(&self, clock: &Clock) -> Option<Eui64> {
        match self {
            Self::Qemu(board) => board.extended(clock),
            Self::Chip(board) => board.extended(clock),
        }
    }

    /// Waits until it works on its flash, where anybody knows when it does: how long that takes. It stands
    /// still then.
    pub(super) async fn next_write(&self) -> Option<Time> {
        match self {
            Self::Qemu(_) => None,
            Self::Chip(board) => Some(board.next_write().await),
        }
    }

    /// Its chip, if that is emulated.
    pub(super) fn chip(&self) -> Option<&chips::Board> {
        match self {
            Self::Qemu(_) => None,
            Self::Chip(board) => Some(board),
        }
    }

    /// What is known of its chip, once the simulation has ended.
    pub(super) fn end(&self) -> Option<chip_pipe::End> {
        match self {
            Self::Qemu(_) => None,
            Self::Chip(board) => Some(board.end()),
        }
    }

    /// What the node's role has written down, in the order of its records.
    pub(super) fn facts(&self, clock: &Clock) -> Vec<Fact> {
        match self {
            Self::Qemu(board) => board.facts(clock),
            Self::Chip(board) => board.facts(clock),
        }
    }
}

/// What surrounds a board.
pub(super) struct Surroundings<'a, U> {
    pub(super) clock: &'a Clock,
    pub(super) medium: &'a Medium,
    pub(super) antenna: NodeId,
    /// The far end of its UART 0.
    pub(super) device: U,
    pub(super) panel: &'a Panel,
    /// Random, another one at each start.
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
        let (mut machine, lines) = match self.start(clock, seed).await {
            Ok(started) => started,
            Err(error) => return error,
        };
        let [line, radio, lamps] = lines.map(|line| Polled::new(line, clock.clone()));
        let (from_radio, from_panel) = (Cell::new(None), Cell::new(None));
        let radio = Heard::new(radio, clock, &from_radio);
        let lamps = Heard::new(lamps, clock, &from_panel);
        let address = Eui64::of_node(self.id(), 0);
        let radio = CoProcessor::new(radio, medium, antenna, clock.clone(), address, seed);
        let connected = select4(
            bridge(line, device),
            radio.run(),
            panel::connect(lamps, panel),
            select(
                machine::ended(&mut machine, clock),
                self.stalls(clock, &from_radio, &from_panel),
            ),
        );
        match connected.await {
            Either4::Fourth(Either::First(status)) => self.ended(status),
            Either4::Fourth(Either::Second(what)) => self.silent(what),
            // A line is closed a moment before its process has ended.
            _ => match select(machine::ended(&mut machine, clock), clock.sleep(LINGERING)).await {
                Either::First(status) => self.ended(status),
                Either::Second(()) => EmulatorError::LineClosed { id: self.id() },
            },
        }
    }

    /// Returns when nothing has come for too long, at any time, with what did not come: a board
    /// tells its lamps every second.
    async fn stalls(
        &self,
        clock: &Clock,
        radio: &Cell<Option<Time>>,
        panel: &Cell<Option<Time>>,
    ) -> &'static str {
        let timeout = Time::try_from(self.timeout.as_nanos()).unwrap_or(Time::MAX);
        clock.sleep(timeout).await;
        if radio.get().is_none() {
            return "talk to its radio";
        }
        while let Some(last) = panel.get() {
            let end = last.saturating_add(timeout);
            match end.checked_sub(clock.time()) {
                None | Some(0) => break,
                Some(left) => clock.sleep(left).await,
            }
        }
        "tell what its lamps show, as a board does every second,"
    }

    fn ended(&self, status: ExitStatus) -> EmulatorError {
        EmulatorError::Ended {
            id: self.id(),
            status,
            log: self.keep_log(),
        }
    }

    fn silent(&self, what: &'static str) -> EmulatorError {
        EmulatorError::Silent {
            id: self.id(),
            what,
            seconds: self.timeout.as_secs_f64(),
            log: self.keep_log(),
        }
    }

    /// What the emulator printed. It is left for people to look at.
    fn keep_log(&self) -> PathBuf {
        self.files.keep();
        self.directory.join(machine::LOG)
    }

    /// The extended address that the node has drawn.
    pub(super) fn extended(&self, clock: &Clock) -> Option<Eui64> {
        let bytes = fs::read(self.directory.join(machine::FLASH)).unwrap_or_default();
        memory::extended(memory::LINK, &bytes, clock)
    }

    /// What the node's role has written down, in the order of its records.
    pub(super) fn facts(&self, clock: &Clock) -> Vec<Fact> {
        // There may be no such file yet.
        let bytes = fs::read(self.directory.join(machine::FLASH)).unwrap_or_default();
        memory::facts(&bytes, self.config.owner(), clock)
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
