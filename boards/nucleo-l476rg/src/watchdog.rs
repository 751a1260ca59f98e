//! The watchdog, and the reason why the chip last started.

use board_support::{
    heartbeats::Heartbeats, last_words::LastWords, retained::say_and_restart, start::Cause,
};
use embassy_stm32::{
    Peri,
    pac::{DBGMCU, RCC},
    peripherals,
    wdg::IndependentWatchdog,
};

/// The one task that must run. It talks to the radio, too.
pub(crate) const NODE: u32 = 0;
/// Its reports.
pub(crate) static HEARTBEATS: Heartbeats = Heartbeats::new(1);

/// Watched tasks report every second; none of their work takes as long as this. Its clock errs by some percent.
const TIMEOUT_US: u32 = 8_000_000;

/// Feeds the watchdog as long as all tasks run, and radio and camera work.
#[embassy_executor::task]
pub(crate) async fn feed(
    watchdog: Peri<'static, peripherals::IWDG>,
    node: &'static node_firmware::liveness::Liveness,
) {
    // A debugger has stopped the node.
    DBGMCU.apb1fzr1().modify(|freeze| freeze.set_iwdg(true));
    let mut watchdog = IndependentWatchdog::new(watchdog, TIMEOUT_US);
    watchdog.unleash();
    let why = HEARTBEATS.feed(node, || watchdog.pet()).await;
    say_and_restart(LastWords::restart(why));
}

/// Reason why the chip started, as far as it tells; then forgotten, or it would add up.
pub(crate) fn reset_cause() -> Cause {
    let cause = RCC.csr().read();
    RCC.csr().modify(|state| state.set_rmvf(true));
    // The first that explains the others: each reset pulls at the pin (reference manual RM0351,
    // "System reset").
    if cause.iwdgrstf() {
        Cause::WATCHDOG
    } else if cause.sftrstf() {
        Cause::other("restart by the program")
    } else if cause.borrstf() {
        Cause::other("power-on")
    } else if cause.lpwrrstf() || cause.wwdgrstf() || cause.fwrstf() || cause.oblrstf() {
        Cause::other("option bytes, firewall, other watchdog or low power")
    } else if cause.pinrstf() {
        Cause::other("reset pin")
    } else {
        Cause::other("woken up")
    }
}
