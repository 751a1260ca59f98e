//! A node on the emulated board mps2-an386, a Cortex-M4F: `qemu-system-arm -M mps2-an386`.
//!
//! | UART | |
//! |---|---|
//! | 0 | the camera; the PC of a coordinator |
//! | 1 | a radio co-processor that speaks Spinel, such as `ot-rcp` |
//! | 2 | steps, lamps and buttons: `board_support::panel` |
//!
//! The configuration page is loaded to 0x003ff000 (`-device loader,file=page.bin,addr=0x003ff000`).
//! Two arguments may follow (`-append 'FILE SEED'`). The flash of the node is in memory, and in that
//! file if one is named. The seed, a decimal number of 64 bits, is what the node draws its random
//! numbers from; it should be another one at each start. Logs are defmt over semihosting, on the
//! emulator's standard output. The emulator ends with the node, with 1 for a node that stopped and
//! 2 for a panic or a fault.
//!
//! | module | |
//! |---|---|
//! | `uart` | the UARTs |
//! | `executor` | tasks, and sleep |
//! | `timer` | the time |
//! | `interrupts` | which interrupt is whose |
//! | `flash` | the flash |
//! | `panel` | steps, lamps and buttons |
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
        mod executor;
        mod flash;
        mod interrupts;
        mod node;
        mod panel;
        mod register;
        mod timer;
        mod uart;
    } else {
        board_support::not_on_a_computer!("an emulated board");
    }
}
