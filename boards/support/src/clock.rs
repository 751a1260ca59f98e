//! The time of a board.

use core::future::Future;

use zigbee_link::runner::Clock;

/// Microseconds of a tick of the driver, rounded up.
const TICK: u64 = 1_000_000_u64.div_ceil(embassy_time::TICK_HZ);

/// The time since the start, from `embassy-time`, with the resolution of its driver.
#[derive(Clone, Copy, Debug, Default)]
pub struct EmbassyClock;

impl Clock for EmbassyClock {
    #[inline(never)] // for less flash
    fn now(&self) -> zigbee_link::Instant {
        zigbee_link::Instant(embassy_time::Instant::now().as_micros())
    }

    fn sleep_until(&self, time: zigbee_link::Instant) -> impl Future<Output = ()> {
        // Ticks are rounded down here and in `now`: without one more it would be too early.
        // Saturates where microseconds do not fit the driver's ticks: that is never reached.
        let at = embassy_time::Instant::try_from_micros(time.0.saturating_add(TICK));
        embassy_time::Timer::at(at.unwrap_or(embassy_time::Instant::MAX))
    }
}
