//! A driver for the Pixy2 (`CMUcam5`), a camera that finds blobs of colours which it was taught, over its
//! UART.
//!
//! | module | job |
//! |---|---|
//! | [`packet`] | Requests as bytes, and bytes as packets: synchronisation words, lengths, checksums |
//! | [`block`] | The blobs of a frame |
//! | [`session`] | The dialogue, sans-IO: bytes and times in, bytes and answers out |
//! | [`device`] | [`Pixy2`], the session on an `embedded-io` UART, async or blocking |
//!
//! # The device at the other end
//! A Pixy2 whose data port is set to UART (`PixyMon`: Configure, Interface, "Data out port"), in the
//! program `color_connected_components`. Its rate is set there too, 19200 by default: a request of one
//! block and its answer then take 15 ms, of the 16 of a frame. Colours, "signatures" 1 to 7, are taught
//! with its button or in `PixyMon`; that cannot be done over the UART, nor can exposure be fixed.
//!
//! Numbers are little-endian. The facts are those of the maker's public host library and firmware
//! (`charmedlabs/pixy2`): types of packets, layouts, errors, and that all it sends over its UART has a
//! checksum.
//!
//! # Example
//! On a board, `uart` and `delay` come from its HAL.
//! ```
//! use pixy2_driver::{Error, Pixy2, packet::Signatures};
//!
//! # async fn board<U, D>(uart: U, delay: D, turn_towards: fn(u16)) -> Result<(), Error<U::Error>>
//! # where U: embedded_io_async::Read + embedded_io_async::Write,
//! #     D: embedded_hal_async::delay::DelayNs {
//! let mut camera = Pixy2::new(uart, delay);
//! camera.version().await?;
//! loop {
//!     // The largest first.
//!     if let Some(block) = camera.blocks(Signatures::one(1), 1).await?.next() {
//!         turn_towards(block.x);
//!     }
//! }
//! # }
//! ```
//! With a blocking HAL the same calls have `_wait` at the end of their names.
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
pub mod packet;
pub mod session;

pub use block::Block;
pub use device::{Error, Pixy2};
