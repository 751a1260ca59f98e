//! What the boards of a node share.
//!
//! | module | |
//! |---|---|
//! | [`clock`] | time and delays from `embassy-time` |
//! | [`liveness`] | whether every task still runs, for a watchdog |
//! | [`failure`] | why a node cannot go on, in words |
//! | [`last_words`] | why a node stopped, kept over its reset |
//! | [`panel`] | steps, lamps and buttons as messages on a line, for boards that have none |
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

pub mod clock;
pub mod failure;
pub mod last_words;
pub mod liveness;
pub mod panel;
