#![doc = include_str!("../README.md")]
//!
//! | module | |
//! |---|---|
//! | [`radio`] | the seam to the hardware, and wrappers that stack: CSMA-CA, FCS, faults, pcap |
//! | [`wire`] | bytes of MAC frames and their meaning |
//! | [`security`] | CCM*, frame counters, keys, replay protection |
//! | [`store`] | what a node must not forget, in a NOR flash that may lose its power |
//! | [`link`] | messages: acknowledged, repeated, never doubled |
//! | [`network`] | forming, joining, losing and leaving a network |
//! | [`runner`] | all of it connected to a radio, a flash and a clock |
//!
//! Everything but `radio`, `store` and `runner` is sans-IO: bytes and the time go in, bytes and
//! deadlines come out. No state machine reads a clock, sleeps or waits.
//!
//! # What it is not
//! - Not Zigbee, Thread or 6LoWPAN: one hop, one coordinator, no routing, frames of these networks
//!   are ignored. Captures open in Wireshark, with the key, as plain IEEE 802.15.4.
//! - No superframes, time slots, indirect transmission or sleeping receivers.
//! - One key for all members: see [`security`] for what that does not protect against.
//! - Immediate acknowledgements are not requested: software radios send them too late, and they
//!   prove nothing. Delivery is acknowledged end to end instead.
//!
//! # Size
//! On a Cortex-M4F, `opt-level = "s"` and link-time optimisation, 16 peers and 4 messages each way;
//! `cargo xtask size` of this repository measures it. RAM is the future of the whole node.
//!
//! | | flash | RAM |
//! |---|---:|---:|
//! | messages and security | 16.0 KB | 2.8 KB |
//! | with key and frame counter in flash | 23.5 KB | 3.1 KB |
//! | a device that joins networks | 34.3 KB | 4.2 KB |
//! | a node that is a device or a coordinator of 16 members | 38.5 KB | 4.5 KB |
//!
//! AES is 2.6 KB of it: the `aes` crate's constant-time one, with `--cfg aes_backend_soft="compact"`,
//! else 1 KB more. The panics left in an image are those that the compiler puts into every future, for a
//! caller that polls it after its end, and that of [`runner::Shared::with`], when it is called from within
//! itself.
//!
//! Functions that are not inlined, though the compiler would, have many callers or move large values, and make the
//! image smaller; they are marked `size`. Constructors that are always inlined make a value in its place that each
//! return would else copy on the stack; they are marked `stack`. The work of a node on a frame takes some 800
//! bytes of the stack, all of it in the future of [`runner::run`]: polled in a function that is not inlined, they
//! are free while others run.
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

pub mod link;
pub mod network;
pub mod radio;
pub mod runner;
pub mod security;
pub mod store;
pub mod wire;

mod jitter;
mod log;
mod slots;
mod time;

pub use flash_log;
pub use heapless;
pub use time::Instant;
