//! What can be wrong with emulated boards.

use std::{io, path::PathBuf, time::Duration};

use node_firmware::config::page::PageError;

/// Why boards cannot be emulated, or why a run with them ended. The texts say what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EmulatorError {
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
    /// The image is something else.
    #[error(
        "{} is no program for a chip, an ELF file: type `cargo xtask firmware`, which makes {usual}", .image.display()
    )]
    NoProgram {
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
    /// The process that emulates chips does not answer.
    #[error(
        "the emulated chips have said nothing for {} s, which is a fault of what emulates them: run it again \
         with --log to see what came before", .0.as_secs()
    )]
    Hangs(Duration),
    /// A chip cannot be emulated.
    #[error("the chip of node {id} cannot be emulated: {why}")]
    Chip {
        /// The node.
        id: u16,
        /// Why not.
        why: String,
    },
    /// A node's configuration does not fit into a page.
    #[error("node {id} cannot be configured: {reason}")]
    Config {
        /// The node.
        id: u16,
        /// Why not.
        reason: PageError,
    },
    /// A line is closed, but the chip runs.
    #[error(
        "a line of node {id} was closed while its chip runs: if it has a real camera, is that \
         still plugged in?"
    )]
    LineClosed {
        /// The node.
        id: u16,
    },
}
