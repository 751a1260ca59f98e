//! A node on an nRF52840. One image for all roles: what it is stands in its configuration page.
//!
//! | module | |
//! |---|---|
//! | `board` | pins and peripherals, all in one place |
//! | `identity` | what makes this chip different from others |
//! | `memory` | the pages of the flash that are the node's own |
//! | `panel` | lamps and buttons |
//! | `radio` | the radio on the chip |
//! | `watchdog` | the watchdog, and why the chip last started |
//! | `retained` | what was said before a reset |
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(unsafe_code)]
#![cfg_attr(
    target_os = "none",
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

#[cfg(target_os = "none")]
mod board;
#[cfg(target_os = "none")]
mod identity;
#[cfg(target_os = "none")]
mod memory;
#[cfg(target_os = "none")]
mod node;
#[cfg(target_os = "none")]
mod panel;
#[cfg(target_os = "none")]
mod radio;
#[cfg(target_os = "none")]
mod retained;
#[cfg(target_os = "none")]
mod watchdog;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this runs on an nRF52840: type `cargo xtask firmware`");
    std::process::exit(1);
}
