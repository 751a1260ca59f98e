//! The firmware of a camera network's nodes, over a few hardware traits.
//!
//! A network of small cameras finds out by itself where each camera stands and looks. A friendly
//! target walks through the scene. Two reference cameras fix the frame and tell the target where
//! it is; then the target tells every camera that sees it where it stands, and each camera computes
//! its own pose from three or more such sightings.
//!
//! [`run::run`] is a whole node. A board or a simulation supplies its
//! [`hardware::Peripherals`] and calls it.
//!
//! | module | job |
//! |---|---|
//! | [`limits`] | Numbers that the others share: members, colours, sightings |
//! | [`message`] | What nodes tell each other |
//! | [`console`] | What the coordinator and a PC tell each other |
//! | [`config`] | What a node is told before it is switched on: identity, key, radio, role; and its flash page |
//! | [`facts`] | What a role must not forget |
//! | [`hardware`] | Which drivers a node runs on |
//! | [`liveness`] | Whether radio, camera and flash still work, for a watchdog and for people |
//! | [`network`] | What roles need of the network that carries their messages |
//! | [`vision`] | What a camera role needs of its camera: is the target in view, in which direction, how sure |
//! | [`steps`] | A step sensor of an inertial measurement unit on an I2C bus |
//! | [`role`] | Coordinator, camera, moving target, as state machines without input or output |
//! | [`run`] | A role connected to its hardware |
//!
//! # Size
//! `#[inline(never)]` that is there "for less flash" keeps code in an image once; "for less stack", it keeps
//! what a function needs of the stack from the one that calls it, which waits for other things meanwhile.
//!
//! # Features
//! `defmt` and `log` report what is unusual; `defmt` also formats the public types. Without them the
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

mod arithmetic;
mod log;
