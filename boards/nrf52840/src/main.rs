//! A node on an nRF52840. One image for all roles: its role stands in its configuration page.
//!
//! | module | |
//! |---|---|
//! | `board` | pins and peripherals, all in one place |
//! | `identity` | a true random number |
//! | `line` | the UART to the camera or the PC |
//! | `memory` | the flash |
//! | `node` | the tasks; their start is `board_support::start` |
//! | `radio` | the radio on the chip |
//! | `sensor_bus` | the I2C bus of a target's step sensor |
//! | `watchdog` | the watchdog, and the reason why the chip last started |
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

cfg_if::cfg_if! {
    if #[cfg(target_os = "none")] {
        mod board;
        mod identity;
        mod line;
        mod memory;
        mod node;
        mod radio;
        mod sensor_bus;
        mod watchdog;
    } else {
        board_support::not_on_a_computer!("an nRF52840");
    }
}
