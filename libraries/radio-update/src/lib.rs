#![doc = include_str!("../README.md")]
//!
//! | module | job |
//! |---|---|
//! | [`stamp`] | The mark in an image: its board, its roles, its version |
//! | [`package`] | The signed header that goes before an image |
//! | [`packet`] | Messages between the side that sends and a node |
//! | [`receiver`] | A node: takes blocks, checks them, has its boot loader change images |
//! | `sender` | The side that sends, with the feature `alloc`: what to send next so that all nodes have all blocks |
//!
//! # Trust
//! A node takes an image only if the header before it is signed with the key that the node was given (Ed25519, RFC
//! 8032), is for its board and its role, and has a higher version than the image that runs. The header holds a
//! checksum of each page and a hash of all (SHA-512, the first 32 bytes): pages that do not fit are taken again, and
//! an image whose hash is another one is never started. The header is checked before anything is erased.
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

#[cfg(any(test, feature = "alloc"))]
extern crate alloc;
#[cfg(test)]
extern crate std;

mod blocks;
pub mod package;
pub mod packet;
pub mod receiver;
#[cfg(any(test, feature = "alloc"))]
pub mod sender;
pub mod stamp;

// Crates whose types or traits stand in the public items of this one.
pub use embedded_storage_async;

/// Bytes of a block.
pub const BLOCK: usize = 64;

/// Bytes of a page of the flash: so much is erased at once, and has one checksum.
pub const PAGE: usize = 4096;

/// Most pages of an image: 384 KiB.
pub const PAGES_MAX: usize = 96;

/// CRC-32 (ISO-HDLC, that of Ethernet and zip), without a table.
pub(crate) const CRC: crc::Crc<u32, crc::NoTable> =
    crc::Crc::<u32, crc::NoTable>::new(&crc::CRC_32_ISO_HDLC);
