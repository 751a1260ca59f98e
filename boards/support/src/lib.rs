//! Parts that the boards of a node share.
//!
//! | module | |
//! |---|---|
//! | [`clock`] | time and delays from `embassy-time` |
//! | [`memory`] | the flash without long stops, and the configuration in it |
//! | [`heartbeats`] | check that every task still runs, for a watchdog |
//! | [`failure`] | reasons why a node cannot go on, in words |
//! | [`last_words`] | reason why a node stopped, kept over its reset |
//! | [`lost`] | bytes of a UART that found no room |
//! | [`pins`] | lamps and buttons |
//! | [`i2c`] | a bus that a sensor holds |
//! | `retained` | place where last words are kept, and their writers; on a board only |
//! | `start` | the start of a real board, and the reason why its node stopped; on a board only |
//! | `tasks` | spawning of tasks; on a board only |
#![no_std]
#![deny(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

#[cfg(not(target_os = "none"))]
extern crate std;

// Functions with which every image copies.
#[cfg(target_os = "none")]
use memory_functions as _;

pub mod clock;
pub mod failure;
pub mod heartbeats;
pub mod i2c;
pub mod last_words;
pub mod lost;
pub mod memory;
pub mod pins;
#[cfg(all(target_os = "none", feature = "retained"))]
pub mod retained;
#[cfg(all(target_os = "none", feature = "retained"))]
pub mod start;
#[cfg(target_os = "none")]
pub mod tasks;

/// The `main` of a board's image where it is built for a computer: it says what to type instead.
#[cfg(not(target_os = "none"))]
pub fn not_on_a_computer(board: &board_facts::Board) -> ! {
    std::eprintln!(
        "this runs on a {}: type `cargo xtask firmware {}`",
        board.title,
        board.name
    );
    std::process::exit(1);
}
