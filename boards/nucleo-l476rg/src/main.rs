//! A node on a NUCLEO-L476RG. One image for all roles: its role stands in its configuration page.
//!
//! The chip has no radio: any `ot-rcp` on a UART is it.
//!
//! | module | |
//! |---|---|
//! | `board` | pins, peripherals and rates, all in one place |
//! | `identity` | a true random number |
//! | `line` | the UARTs |
//! | `memory` | the flash |
//! | `node` | the tasks; their start is `board_support::start` |
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
        mod sensor_bus;
        mod watchdog;
    } else {
        fn main() {
            board_support::not_on_a_computer(&board_facts::NUCLEO_L476RG);
        }
    }
}
