#![doc = include_str!("../README.md")]
//!
//! | part | stands for |
//! |---|---|
//! | [`Bench`] | the surroundings: virtual time, radio medium, all nodes |
//! | [`Board`] | a node's hardware; its firmware starts and stops on it |
//! | [`CameraDevice`], [`PixyDevice`] | an emulated camera on a UART, before a scene that changes |
//! | [`Script`] | any other device on a UART, as a test says |
//! | [`Pc`] | the PC of a coordinator |
//!
//! Everything else is the machinery below: [`virtual_hardware`] has lines that are unplugged, air that loses frames,
//! flash that is torn and worn, clocks that drift.
#![allow(
    clippy::needless_doctest_main,
    reason = "the example of the readme is a whole program"
)]

mod bench;
mod board;
mod camera;
mod pc;
mod script;

pub use {
    calib_core, cmucam2_emulator, node_firmware, pixy_emulator, virtual_hardware, zigbee_link,
};

pub use bench::{Bench, SECOND};
pub use board::{Board, FACTS, FlashOfBoard, LINK, Lamps, NodeUart, PAGE, Sent, Steps};
pub use camera::{CameraDevice, PixyDevice};
pub use pc::Pc;
pub use script::Script;
