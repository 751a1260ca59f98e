//! The watchdog, and the reason why the chip last started.

use board_facts::WATCHDOG_S as TIMEOUT_S;
use board_support::{
    heartbeats::Heartbeats, last_words::LastWords, retained::say_and_restart, start::Cause,
};
use embassy_nrf::{
    Peri,
    pac::{POWER, WDT, power::regs::Resetreas, wdt::regs::Rren},
    peripherals,
    wdt::{Config, HaltConfig, SleepConfig, Watchdog, WatchdogHandle},
};
use embassy_time::Timer;

/// Tasks that must run.
pub const NODE: u32 = 0;
pub(crate) const RADIO: u32 = 1;
/// Their reports.
pub static HEARTBEATS: Heartbeats = Heartbeats::new(2);

const LFCLK_HZ: u32 = 32_768;

/// A debugger has stopped the node.
const HALTED: HaltConfig = HaltConfig::Pause;

/// Starts the watchdog before anything is waited for: a crystal that does not start would be waited for without
/// end. Its own clock runs from then on, from either oscillator (Product Specification, "WDT").
pub(crate) fn start() {
    if WDT.runstatus().read().runstatus() {
        return;
    }
    WDT.config().write(|config| {
        config.set_sleep(SleepConfig::Run);
        config.set_halt(HALTED);
    });
    WDT.crv().write_value(TIMEOUT_S * LFCLK_HZ);
    WDT.rren().write_value(Rren(1));
    WDT.tasks_start().write_value(1);
}

/// Handle that feeds it, once.
fn handle(watchdog: Peri<'static, peripherals::WDT>) -> Option<WatchdogHandle> {
    let mut config = Config::default();
    config.timeout_ticks = TIMEOUT_S * LFCLK_HZ;
    config.action_during_debug_halt = HALTED;
    let Ok((_, [handle])) = Watchdog::try_new(watchdog, config) else {
        // It runs with other settings, otherwise: another program before this one has started it.
        defmt::error!("the watchdog was started by another program");
        return None;
    };
    Some(handle)
}

/// Feeds the watchdog as long as all tasks run, and radio and camera work.
#[embassy_executor::task]
pub(crate) async fn feed(
    watchdog: Peri<'static, peripherals::WDT>,
    node: &'static node_firmware::liveness::Liveness,
) {
    let Some(mut handle) = handle(watchdog) else {
        return;
    };
    let why = HEARTBEATS.feed(node, || handle.pet()).await;
    say_and_restart(LastWords::restart(why));
}

/// Feeds it where a restart would not help.
#[embassy_executor::task]
pub(crate) async fn feed_always(watchdog: Peri<'static, peripherals::WDT>) {
    let mut handle = handle(watchdog);
    loop {
        if let Some(handle) = &mut handle {
            handle.pet();
        }
        Timer::after_secs((TIMEOUT_S / 4).into()).await;
    }
}

/// Reason why the chip started, as far as it tells; then forgotten, or it would add up.
pub(crate) fn reset_cause() -> Cause {
    let cause = POWER.resetreas().read();
    POWER.resetreas().write_value(Resetreas(u32::MAX));
    // The first that explains the others (Product Specification, "POWER", RESETREAS). A person may reset a chip whose
    // watchdog has just bitten.
    if cause.resetpin() {
        Cause::other("reset pin")
    } else if cause.dog() {
        Cause::WATCHDOG
    } else if cause.lockup() {
        Cause::other("processor lock-up")
    } else if cause.sreq() {
        Cause::other("restart by the program")
    } else if cause.dif() || cause.off() || cause.nfc() || cause.vbus() || cause.lpcomp() {
        Cause::other("woken up")
    } else {
        Cause::other("power-on")
    }
}
