//! An nRF52840 in virtual time: the image that is flashed runs unchanged, on models of the peripherals.
//!
//! The processor is that of the crate `rigless`. The [peripherals](peripheral) are written from the Product
//! Specification (Nordic Semiconductor, nRF52840 PS v1.7), whose chapters are named in quotation marks; a
//! program's breaches of it are [told](Outcome::forbidden). They check glue, addresses, pins, order and time; of
//! silicon and its errata they know nothing.
//!
//! [`run`] lets several chips hear each other; in a [`Network`] they can be switched on and off, and the caller
//! provides their surroundings. [`print`](print()) runs a program alone. It is deterministic: the same nodes do
//! the same.

#![deny(unsafe_code)]

mod bare;
pub mod device;
pub mod energy;
mod network;
mod node;
mod one_cpu;
pub mod peripheral;
mod processor;
mod soc;

pub use self::{
    bare::print,
    network::{Deed, Input, Network, run},
    node::{MEMORY, Node, Outcome, Reset, SETTINGS, Time},
    peripheral::Wires,
    soc::{Board, Soc},
};
