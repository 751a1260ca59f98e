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
        "{} is no program for an nRF52840, an ELF file with vectors at the beginning of the flash and a log of \
         defmt: type `cargo xtask firmware`, which makes {usual}", .image.display()
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
    /// There is nothing that builds it.
    #[error(
        "the emulated nRF52840 cannot be built, for `cargo` cannot be started ({0}): install Rust, from rustup.rs, \
         or put the folder of `cargo` into PATH"
    )]
    NoCargo(#[source] io::Error),
    /// What emulates chips cannot be built.
    #[error(
        "the emulated nRF52840 cannot be built: what is wrong stands above, and comes again with \
         `cargo build --release --bin chips` in nrf52840-emulator; its compiler comes with \
         `rustup toolchain install 1.98.0`, where there is a network"
    )]
    NotBuilt,
    /// What emulates chips was built, but is elsewhere.
    #[error(
        "the emulated nRF52840 was built, but is not in {}: does a configuration of cargo set \
         `build.target`? Leave that out", .program.display()
    )]
    NotThere {
        /// Where it should be.
        program: PathBuf,
    },
    /// GDB cannot connect.
    #[error(
        "port {port} of this computer is taken ({source}), perhaps by another run that waits for GDB: end that, or \
         name another port, `--gdb {node}:{}`", if *.port == u16::MAX { port - 1 } else { port + 1 }
    )]
    PortTaken {
        /// Whose chip it is to look into.
        node: u16,
        /// Where.
        port: u16,
        /// Why not.
        source: io::Error,
    },
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
    /// The image does not know what the node is.
    #[error(
        "the image does not understand the configuration page of node {id} ({why}), which is of another version: \
         type `cargo xtask firmware`"
    )]
    NoConfiguration {
        /// The node.
        id: u16,
        /// What the image says.
        why: String,
    },
    /// Something is not connected to what it should be.
    #[error("the image of node {id} is not for this board (boards/nrf52840/src/board.rs): {why}")]
    Wires {
        /// The node.
        id: u16,
        /// What is connected to what.
        why: String,
    },
    /// What its flash holds is elsewhere.
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
