#![doc = include_str!("../README.md")]
//!
//! | module | job |
//! |---|---|
//! | [`model`] | The cameras: pictures, lenses and rates |
//! | [`packet`] | Requests of a Pixy2 as bytes, and bytes as packets: synchronisation words, lengths, checksums |
//! | [`stream`] | Blocks out of the bytes of the others |
//! | [`block`] | The blobs of a frame |
//! | [`session`] | The dialogue, sans-IO: bytes and times in, bytes and answers out |
//! | [`device`] | [`Pixy`], the session on an `embedded-io` UART, async or blocking |
//! | [`i2c`] | A Pixy2 on an I2C bus, in the place of a UART |
//!
//! # The devices at the other end
//! A Pixy2 whose data port is set to UART (`PixyMon`: Configure, Interface, "Data out port"), in the
//! program `color_connected_components`. Its rate is set there too, 19200 by default: a request of one
//! block and its answer then take 15 ms, of the 16 of a frame. Colours, "signatures" 1 to 7, are taught
//! with its button or in `PixyMon`; that cannot be done over the UART, nor can exposure be fixed.
//!
//! An original Pixy, set likewise; or an OpenMV Cam that runs its maker's script `pixy_uart_emulation.py` or
//! `apriltags_pixy_uart_emulation.py`. A UART that loses bytes while it is not read loses pictures of a stream, no
//! more.
//!
//! Numbers are little-endian. The facts are those of the maker's public host library and firmware
//! (`charmedlabs/pixy2`): types of packets, layouts, errors, and that all it sends over its UART has a
//! checksum.
//!
//! Every request returns a [`device::Call`], which does nothing until it is driven: [`run`](device::Call::run)`().await`
//! over `embedded-io-async`, or [`wait`](device::Call::wait)`()` over `embedded-io`.
//!
//! # Features
//! `defmt` formats the public types.
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

pub mod block;
pub mod device;
pub mod i2c;
pub mod model;
pub mod packet;
pub mod session;
pub mod stream;

pub use block::Block;
pub use device::{Error, Pixy};
pub use heapless;
pub use model::Model;
