//! A camera node on a board of one's own.
#![cfg_attr(target_os = "none", no_std, no_main)]

use embassy_futures::block_on;
use node_firmware::{
    config::{CameraConfig, Config, RoleConfig, SiteKey, Subjects},
    liveness::Liveness,
    message::Restart,
    vision::{ColourWindow, Lens},
};
use outside::board::Board;

/// The settings of the node. A board reads them from a page of its flash.
fn config() -> Config {
    let orange = ColourWindow {
        red: [170, 240],
        green: [60, 140],
        blue: [16, 80],
    };
    let subjects = Subjects::Colours([orange].into_iter().collect());
    let role = RoleConfig::Camera(CameraConfig::new(Lens::pin_hole(88, 45.0), subjects));
    Config::new(7, SiteKey::new(1, *b"0123456789abcdef"), role)
}

fn main() {
    let liveness = Liveness::new(Restart::Ordinary);
    if let Ok(config) = config().check() {
        block_on(outside::node(&config, Board::peripherals(1), &liveness));
    }
}

/// Where a start-up routine would come to.
#[cfg(target_os = "none")]
#[unsafe(no_mangle)]
extern "C" fn _start() -> ! {
    main();
    loop {
        core::hint::spin_loop();
    }
}

#[cfg(target_os = "none")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
