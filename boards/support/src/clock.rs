//! The time of a board.

use zigbee_link::runner::Clock;

/// The time since the start, from `embassy-time`, with the resolution of its driver.
#[derive(Clone, Copy, Debug, Default)]
pub struct EmbassyClock;

impl Clock for EmbassyClock {
    // Not inlined: for the sake of flash.
    #[inline(never)]
    fn now(&self) -> zigbee_link::Instant {
        zigbee_link::Instant(embassy_time::Instant::now().as_micros())
    }

    async fn sleep_until(&self, time: zigbee_link::Instant) {
        // Saturates where microseconds do not fit the driver's ticks: that is never reached.
        let at = embassy_time::Instant::try_from_micros(time.0);
        embassy_time::Timer::at(at.unwrap_or(embassy_time::Instant::MAX)).await;
    }
}
