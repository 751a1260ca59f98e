//! Errors of emulated boards.

use std::{io, path::PathBuf};

use node_firmware::config::page::PageError;

/// Reason why boards cannot be emulated, or why a run with them ended. The texts say what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EmulatorError {
    /// There is no image.
    #[error(
        "there is no image {}: type `cargo xtask firmware`, which makes {usual}, or name another \
         one with --image", .image.display()
    )]
    NoImage {
        /// Path of the missing image.
        image: PathBuf,
        /// Path of the usual image.
        usual: &'static str,
    },
    /// The image is something else.
    #[error(
        "{} is no program for an nRF52840, an ELF file with vectors at the beginning of the flash and a log of \
         defmt: type `cargo xtask firmware`, which makes {usual}", .image.display()
    )]
    NoProgram {
        /// Path of the file.
        image: PathBuf,
        /// Path of the usual image.
        usual: &'static str,
    },
    /// This program was built without the emulator.
    #[error(
        "this host-sim was built without emulated chips, which take minutes to build: type `cargo run --release -p \
         host-sim --features chip -- run ...`, in the topmost folder of the sources"
    )]
    NotIncluded,
    /// GDB cannot connect.
    #[error(
        "port {port} of this computer is taken ({source}), perhaps by another run that waits for GDB: end that, or \
         name another port, `--gdb {node}:{}`", if *.port == u16::MAX { port - 1 } else { port + 1 }
    )]
    PortTaken {
        /// Node whose chip GDB is to look into.
        node: u16,
        /// The port.
        port: u16,
        /// Error of the attempt to open it.
        source: io::Error,
    },
    /// The emulator has panicked.
    #[error("what emulates the chips has panicked, which is a fault of it: {0}")]
    Panicked(String),
    /// A chip cannot be emulated.
    #[error("the chip of node {id} cannot be emulated: {why}")]
    Chip {
        /// The node.
        id: u16,
        /// Reason.
        why: String,
    },
    /// A node's configuration does not fit into a page.
    #[error("node {id} cannot be configured: {reason}")]
    Config {
        /// The node.
        id: u16,
        /// Reason.
        reason: PageError,
    },
    /// The image does not understand the configuration of the node.
    #[error(
        "the image does not understand the configuration page of node {id} ({why}), which is of another version: \
         type `cargo xtask firmware`"
    )]
    NoConfiguration {
        /// The node.
        id: u16,
        /// The image's own message.
        why: String,
    },
    /// Wires are not connected as they should be.
    #[error("the image of node {id} is not for this board (boards/nrf52840/src/main.rs): {why}")]
    Wires {
        /// The node.
        id: u16,
        /// The wrong connection.
        why: String,
    },
    /// The contents of its flash are at other addresses.
    #[error(
        "the chips do not tell what is in the flash of node {id} where the image has its memory, which is a fault of \
         what emulates them"
    )]
    NoMemory {
        /// The node.
        id: u16,
    },
    /// A line is closed, but the chip runs.
    #[error("a line of node {id} was closed while its chip runs, which is a fault of this program")]
    LineClosed {
        /// The node.
        id: u16,
    },
}
