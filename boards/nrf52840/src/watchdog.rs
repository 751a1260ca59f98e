//! The watchdog, and why the chip last started.

use board_support::{
    heartbeats::Heartbeats, last_words::LastWords, retained::say_and_restart, start,
};
use embassy_nrf::{
    Peri,
    pac::{POWER, power::regs::Resetreas},
    peripherals,
    wdt::{Config, HaltConfig, Watchdog},
};

/// Tasks that must run.
pub(crate) const NODE: u32 = 0;
pub(crate) const RADIO: u32 = 1;
/// Their reports.
pub(crate) static HEARTBEATS: Heartbeats = Heartbeats::new(2);

/// Watched tasks report every second; nothing they do takes as long as this.
const TIMEOUT_S: u32 = 8;
const LFCLK_HZ: u32 = 32_768;

/// Feeds the watchdog as long as all tasks run, and radio and camera work.
#[embassy_executor::task]
pub(crate) async fn feed(
    watchdog: Peri<'static, peripherals::WDT>,
    node: &'static node_firmware::liveness::Liveness,
) {
    let mut config = Config::default();
    config.timeout_ticks = TIMEOUT_S * LFCLK_HZ;
    // Somebody looks at the node.
    config.action_during_debug_halt = HaltConfig::Pause;
    let Ok((_, [mut handle])) = Watchdog::try_new(watchdog, config) else {
        // It runs already, otherwise: only another program before this one can have started it.
        return defmt::error!("the watchdog is somebody else's");
    };
    let why = HEARTBEATS.feed(node, || handle.pet()).await;
    say_and_restart(LastWords::restart(why));
}

/// Why the chip started, as far as it tells; then forgotten, or it would add up.
pub(crate) fn reset_cause() -> &'static str {
    let cause = POWER.resetreas().read();
    POWER.resetreas().write_value(Resetreas(u32::MAX));
    // The first that explains the others (Product Specification, "POWER", RESETREAS).
    if cause.dog() {
        start::WATCHDOG
    } else if cause.lockup() {
        "processor lock-up"
    } else if cause.sreq() {
        "restart by the program"
    } else if cause.resetpin() {
        "reset pin"
    } else if cause.dif() || cause.off() || cause.nfc() || cause.vbus() || cause.lpcomp() {
        "woken up"
    } else {
        "power-on"
    }
}
