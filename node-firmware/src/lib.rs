#![doc = include_str!("../README.md")]
//!
//! [`run::run`] is a whole node. A board or a simulation supplies its
//! [`hardware::Peripherals`] and calls it.
//!
//! | module | job |
//! |---|---|
//! | [`limits`] | Numbers that the others share: members, colours, sightings |
//! | [`message`] | Messages between nodes |
//! | [`console`] | Messages between the coordinator and a PC |
//! | [`config`] | Settings of a node before it is switched on: identity, key, radio, role; and its flash page |
//! | [`facts`] | Facts that a role must not forget |
//! | [`hardware`] | Drivers that a node runs on |
//! | [`liveness`] | Check that radio, camera and flash still work, for a watchdog and for people |
//! | [`network`] | Requirements of roles on the network that carries their messages |
//! | [`vision`] | Requirements of a camera role on its camera: target in view, its direction, and its sigma |
//! | [`steps`] | A step sensor of an inertial measurement unit on an I2C bus |
//! | [`role`] | Coordinator, camera, moving target, as state machines without input or output |
//! | [`run`] | A role connected to its hardware |
//!
//! # Size
//! `#[inline(never)]` with the note "for less flash" keeps code in an image once. With "for less stack" it
//! keeps the stack that a function needs away from its caller, which waits for other things meanwhile.
//!
//! # Features
//! `camera`, `coordinator` and `target` are the roles that a node can have, by default all: one that is left out takes no
//! memory, and its configuration is refused. `defmt` and `log` report what is unusual; `defmt` also formats the public types. Without them the
//! crate is silent.
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

#[cfg(test)]
extern crate std;

pub mod config;
pub mod console;
pub mod facts;
pub mod hardware;
pub mod limits;
pub mod liveness;
pub mod message;
pub mod network;
pub mod role;
pub mod run;
pub mod steps;
pub mod vision;

// Crates whose types or traits stand in the public items of this one.
pub use {
    calib_core, cmucam2_driver, embedded_hal_async, embedded_io, embedded_io_async,
    embedded_storage_async, flash_log, heapless, nalgebra, pedestrian, pixy_driver, zigbee_link,
};

mod arithmetic;
mod log;
