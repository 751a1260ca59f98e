//! What can be wrong with emulated boards.

use std::{io, path::PathBuf, process::ExitStatus};

use board_emulator::Unavailable;
use node_firmware::config::page::PageError;

/// Why boards cannot be emulated, or why a run with them ended. The texts say what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EmulatorError {
    /// The emulator, or what it needs, is not installed.
    #[error(transparent)]
    Unavailable(#[from] Unavailable),
    /// There is no image.
    #[error(
        "there is no image {}: type `cargo xtask firmware`, which makes {usual}, or name another \
         one with --image", .image.display()
    )]
    NoImage {
        /// Where.
        image: PathBuf,
        /// Where the usual one would be.
        usual: &'static str,
    },
    /// There is nothing that emulates chips.
    #[error(
        "there is no folder nrf52840-emulator here: emulated chips need the sources, so run this in \
         their topmost folder"
    )]
    NoSource,
    /// What emulates chips cannot be built.
    #[error(
        "the emulated nRF52840 cannot be built: what is wrong stands above, and comes again with \
         `cargo build --release --bin chips` in nrf52840-emulator; its compiler comes with \
         `rustup toolchain install 1.98.0`, where there is a network"
    )]
    NotBuilt,
    /// The process that emulates chips does not start, or has ended.
    #[error("the process with the emulated chips has failed, which is a fault of it: {0}")]
    Pipe(#[source] io::Error),
    /// A chip cannot be emulated.
    #[error("the chip of node {id} cannot be emulated: {why}")]
    Chip {
        /// The node.
        id: u16,
        /// Why not.
        why: String,
    },
    /// A directory, file or socket for a board cannot be made.
    #[error("the files of emulated boards cannot be made: {0}")]
    Files(#[source] io::Error),
    /// A node's configuration does not fit into a page.
    #[error("node {id} cannot be configured: {reason}")]
    Config {
        /// The node.
        id: u16,
        /// Why not.
        reason: PageError,
    },
    /// The process could not be started.
    #[error("the emulator of node {id} does not start: {reason}")]
    Start {
        /// The node.
        id: u16,
        /// Why not.
        reason: io::Error,
    },
    /// It runs but does not do what every board does when it is switched on.
    #[error(
        "the emulator of node {id} did not {what} within {seconds} s: if the computer is \
         overloaded, give it longer with --board-timeout; otherwise the image hangs. Its output is \
         in {}, until the next run with emulated boards", .log.display()
    )]
    Silent {
        /// The node.
        id: u16,
        /// What it did not do.
        what: &'static str,
        /// How long it was waited for.
        seconds: f64,
        /// What it printed.
        log: PathBuf,
    },
    /// A line is closed, but it runs.
    #[error(
        "a line of node {id} was closed while its emulator runs: if it has a real camera, is that \
         still plugged in?"
    )]
    LineClosed {
        /// The node.
        id: u16,
    },
    /// It ended by itself.
    #[error(
        "the emulator of node {id} ended ({status}): 1 is a node that cannot go on or a wrong \
         option, 2 a panic or a fault. What it printed is in {}, until the next run with emulated \
         boards, as defmt frames: `defmt-print -e IMAGE < log`", .log.display()
    )]
    Ended {
        /// The node.
        id: u16,
        /// How.
        status: ExitStatus,
        /// What it printed.
        log: PathBuf,
    },
}
