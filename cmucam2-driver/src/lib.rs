#![doc = include_str!("../README.md")]
//!
//! Three layers, each useful alone:
//!
//! | layer | modules | job |
//! |---|---|---|
//! | words | [`command`], [`packet`], [`colour`], [`geometry`], [`register`], [`servo`] | commands and packets as types, encoded and decoded in both directions; they refuse values that the wire would take and no camera has a meaning for |
//! | bytes | [`parser`] | one byte at a time to events; resynchronises after garbage and counts what it dropped |
//! | dialogue | [`session`], [`device`] | time-outs, retries, stopping a stream, modes that survive a restart of the camera |
//!
//! [`session::Session`] holds the whole dialogue as a state machine without input or output: bytes
//! and the time go in, bytes to send, a deadline and answers come out. [`Cmucam2`] connects it to
//! a UART and a delay. Every method of [`Cmucam2`] returns a [`device::Call`], which does nothing
//! until it is driven: [`run`](device::Call::run)`().await` over `embedded-io-async`, or
//! [`wait`](device::Call::wait)`()` over `embedded-io`. Both drive the same state machine.
//!
//! One place lists and decides the points that the public sources of the protocol leave open: [`uncertain`].
//!
//! With an async HAL the same calls end in `.run().await?`. Other requests are one [`Command`]:
//! [`set`](Cmucam2::set) for a mode, [`command`](Cmucam2::command) for one with an answer,
//! [`stream`](Cmucam2::stream) for one that goes on.
//!
//! Whole programs, which only the boards' targets can build: with Embassy's buffered UART on an nRF52840
//! (`boards/nrf52/examples/cmucam2.rs`, 20 kB), and with a blocking UART of which one byte is peeked,
//! on an STM32L476 (`boards/nucleo-l476rg/examples/cmucam2_blocking.rs`).
//!
//! # What cannot be detected
//! The protocol has no checksum. A packet is refused if its letter, its separators, the number of
//! its fields, the form of a number (1 to 3 digits, no leading zero, at most 255), the order of
//! its coordinates or the geometry of the frame is wrong. A corruption that turns digits into
//! other digits and keeps all of that passes. So does a whole packet that was lost, a packet of
//! all zeros made of single digits, and, in raw mode, nearly every changed byte. When one line in
//! five is damaged, about 1.0 % of the packets delivered are changed beyond detection, 0.24 % with
//! [`strict`](session::Policy::strict) (`cargo run --release -p cmucam2-driver --example soak`).
//! Track over several packets before you trust one.
//!
//! # Features
//! `defmt` and `log` report restarts, retries and restored modes; `defmt` also formats the public types.
//! Without them the crate is silent. `full` is on by default: frames, line modes, raw output, histograms,
//! masked packets, servo positions, uploads, learning from a mean. Without it the driver understands only the
//! answers that tracking needs, and the commands for the rest must not be sent. `embedded-hal-nb` adds
//! `serial::Peek`, for blocking UARTs that give one byte or none.
//!
//! # Size
//! Only the commands that an image sends are in it: an [`Order`](command::Order) is made of a [`Command`]
//! where that is known, inlined there, and the dialogue sees only the order.
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

mod features;
mod log;

pub mod argument;
pub mod colour;
pub mod command;
pub mod device;
pub mod geometry;
pub mod packet;
pub mod parser;
pub mod register;
#[cfg(feature = "embedded-hal-nb")]
pub mod serial;
pub mod servo;
pub mod session;
pub mod uncertain;

mod text;

pub use command::Command;
pub use device::{Cmucam2, Error};
pub use packet::Packet;
pub use text::Line;
