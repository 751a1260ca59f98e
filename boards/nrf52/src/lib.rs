//! Parts of a node on an nRF52, with its radio on the chip. A board is its pins: [`board!`].
//!
//! | module | |
//! |---|---|
//! | `board` | pins of a board, and the peripherals that they belong to |
//! | `guarded` | the USB device of the chip, without its panics |
//! | `identity` | a true random number |
//! | `line` | the UART to the camera or the PC |
//! | `memory` | the flash |
//! | `node` | the tasks; their start is `board_support::start` |
//! | `plug` | the USB plug of a coordinator |
//! | `radio` | the radio on the chip |
//! | `sensor_bus` | the I2C bus of a target's step sensor |
//! | `watchdog` | the watchdog, and the reason why the chip last started |
#![no_std]
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

#[doc(hidden)]
pub use board_facts;
#[doc(hidden)]
pub use board_support;

cfg_if::cfg_if! {
    if #[cfg(target_os = "none")] {
        mod board;
        #[cfg(feature = "usb")]
        mod guarded;
        mod identity;
        mod line;
        mod memory;
        mod node;
        #[cfg(feature = "usb")]
        mod plug;
        mod radio;
        mod sensor_bus;
        mod watchdog;

        #[doc(hidden)]
        pub use board::{Board, Parts, Pins, Usb, Wires, start};
        #[doc(hidden)]
        pub use board_support::{start::tell_failure, tasks::spawn};
        #[doc(hidden)]
        pub use embassy_executor::{self, Spawner};
        #[doc(hidden)]
        pub use node::{Stamp, begin, execute};
        #[doc(hidden)]
        pub use node_firmware::{
            config::CheckedConfig, hardware::Peripherals, liveness::Liveness, run::run,
        };
        #[doc(hidden)]
        pub use watchdog::{HEARTBEATS, NODE};
        #[cfg(feature = "update")]
        #[doc(hidden)]
        pub use radio_update;
        #[cfg(feature = "update")]
        #[doc(hidden)]
        pub const ROLES: u8 = node_firmware::config::RoleConfig::BUILT;
        #[doc(hidden)]
        pub use cortex_m_rt::entry;
        #[doc(hidden)]
        pub use embassy_nrf::{gpio::Level, nvmc::FLASH_SIZE};
    }
}

/// The stamp of an image that is updated by radio: `cargo xtask firmware --update` writes the version into it.
#[cfg(feature = "update")]
#[doc(hidden)]
#[macro_export]
macro_rules! stamp {
    ($board:ident) => {{
        static STAMP: [u8; $crate::radio_update::stamp::STAMP] =
            $crate::radio_update::stamp::Stamp {
                board: $crate::radio_update::stamp::board_number($crate::board_facts::$board.name),
                roles: $crate::ROLES,
                version: 0,
            }
            .bytes();
        &STAMP
    }};
}

/// No stamp.
#[cfg(not(feature = "update"))]
#[doc(hidden)]
#[macro_export]
macro_rules! stamp {
    ($board:ident) => {
        ()
    };
}

/// The USB device of the chip.
#[cfg(feature = "usb")]
#[doc(hidden)]
#[macro_export]
macro_rules! usb {
    ($peripherals:ident) => {
        $peripherals.USBD
    };
}

/// No USB device.
#[cfg(not(feature = "usb"))]
#[doc(hidden)]
#[macro_export]
macro_rules! usb {
    ($peripherals:ident) => {
        ()
    };
}

/// The `main` of a board's image: a node on the pins that it names. A build for a computer says what to type
/// instead.
///
/// `board` is a constant of `board-facts`; `lit by` the level of a pin at which its lamp shines; buttons are between
/// their pins and ground. A coordinator's PC is at the USB plug of the chip with the feature `usb`, else at the pins of
/// `console`, and without them at those of the camera.
#[macro_export]
macro_rules! board {
    (
        board: $board:ident,
        camera: receive $camera_receive:ident, send $camera_send:ident,
        $(console: receive $console_receive:ident, send $console_send:ident,)?
        lamps: lit by $lit:ident, joined $joined:ident, target_seen $seen:ident, calibrated $calibrated:ident,
            may_walk $walk:ident,
        buttons: join_window $join:ident, learn_colour $learn:ident,
        sensor: data $data:ident, clock $clock:ident,
    ) => {
        #[cfg(target_os = "none")]
        const _: () = assert!($crate::board_facts::$board.chip.flash_bytes as usize == $crate::FLASH_SIZE);

        #[cfg(target_os = "none")]
        #[$crate::embassy_executor::task(embassy_executor = $crate::embassy_executor)]
        async fn run_node(
            config: &'static $crate::CheckedConfig,
            peripherals: &'static mut Option<$crate::Peripherals<$crate::Board>>,
            liveness: &'static $crate::Liveness,
        ) {
            // Not passed by value: the whole future of the node would be copied on the stack with them.
            let Some(peripherals) = peripherals.take() else {
                return;
            };
            let node = core::pin::pin!($crate::run(config, peripherals, liveness));
            $crate::tell_failure(&$crate::HEARTBEATS.watch($crate::NODE, node).await);
        }

        #[cfg(target_os = "none")]
        #[$crate::embassy_executor::task(embassy_executor = $crate::embassy_executor)]
        async fn begin(spawner: $crate::Spawner, pins: $crate::Pins, parts: $crate::Parts) {
            let board = &$crate::board_facts::$board;
            let (config, peripherals, liveness) =
                $crate::begin(spawner, (board, $crate::stamp!($board)), pins, parts).await;
            $crate::spawn(spawner, run_node(config, peripherals, liveness));
        }

        #[cfg(target_os = "none")]
        #[$crate::entry]
        fn main() -> ! {
            let p = $crate::start();
            let pins = $crate::Pins {
                camera: $crate::Wires {
                    receive: p.$camera_receive.into(),
                    send: p.$camera_send.into(),
                },
                console: None$(.or(Some($crate::Wires {
                    receive: p.$console_receive.into(),
                    send: p.$console_send.into(),
                })))?,
                lit: $crate::Level::$lit,
                lamps: [p.$joined.into(), p.$seen.into(), p.$calibrated.into(), p.$walk.into()],
                buttons: [p.$join.into(), p.$learn.into()],
                sensor: [p.$data.into(), p.$clock.into()],
            };
            let parts = $crate::Parts {
                uart: p.UARTE0,
                usb: $crate::usb!(p),
                timer: p.TIMER1,
                channels: (p.PPI_CH0, p.PPI_CH1),
                group: p.PPI_GROUP0,
                sensor: p.TWISPI0,
                radio: p.RADIO,
                flash: p.NVMC,
                random: p.RNG,
                watchdog: p.WDT,
            };
            $crate::execute(|spawner| $crate::spawn(spawner, begin(spawner, pins, parts)))
        }

        #[cfg(not(target_os = "none"))]
        fn main() {
            $crate::board_support::not_on_a_computer(&$crate::board_facts::$board);
        }
    };
}
