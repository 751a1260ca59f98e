//! Nodes on emulated boards: machine code on [`chips`].

pub(super) mod chips;
mod error;
pub(super) mod memory;

pub use self::error::EmulatorError;
use super::node::Panel;
use virtual_hardware::{
    executor::Clock,
    medium::{Medium, NodeId},
};

/// Surroundings of a board.
pub(super) struct Surroundings<'a, U> {
    pub(super) clock: &'a Clock,
    pub(super) medium: &'a Medium,
    pub(super) antenna: NodeId,
    /// The far end of its UART.
    pub(super) device: U,
    pub(super) panel: &'a Panel,
    /// Random number, another one at each start.
    pub(super) seed: u64,
}
