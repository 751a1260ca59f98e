//! TIMER, as a counter and as a timer.

use rigless::time::EventId;

use super::{Call, INTEN, INTENCLR, INTENSET, Model, SHORTS, stopwatch::Stopwatch};

const MODE: u16 = 0x504;
const BITMODE: u16 = 0x508;
const PRESCALER: u16 = 0x510;
const CC: u16 = 0x540;
const COMPARE: u16 = 16;
/// After a reset.
pub(crate) const RESET: [(u16, u32); 1] = [(PRESCALER, 4)];
/// Channels of TIMER0 to TIMER2; the others have two more.
const CHANNELS: u16 = 4;
const CC_END: u16 = CC + 4 * CHANNELS;

/// Counts its own clock, 16 MHz divided by a power of two, or its task COUNT (Product Specification,
/// "TIMER").
#[derive(Debug, Default)]
pub struct Timer {
    count: u64,
    /// Time since which it runs as a timer.
    since: Option<u64>,
    is_running: bool,
    /// Time for which it needs its clock: a counter does, too. STOP alone does not end that (Errata, 78).
    pub(crate) clocked: Stopwatch,
    next: Option<EventId>,
}

impl Timer {
    fn mask(call: &Call<'_, '_>) -> u64 {
        match call.get(BITMODE) & 3 {
            0 => 0xffff,
            1 => 0xff,
            2 => 0xff_ffff,
            _ => 0xffff_ffff,
        }
    }

    /// Sixteenths of a microsecond of a tick.
    fn tick(call: &Call<'_, '_>) -> u64 {
        1 << (call.get(PRESCALER) & 0xf).min(9)
    }

    fn now(&self, call: &Call<'_, '_>) -> u64 {
        let run = self.since.map_or(0, |since| {
            (call.now() - since) * 16 / 1_000 / Self::tick(call)
        });
        self.count.wrapping_add(run)
    }

    fn targets(call: &Call<'_, '_>) -> impl Iterator<Item = (u16, u64)> + use<> {
        let mask = Self::mask(call);
        let values: Vec<_> = (0..CHANNELS)
            .map(|channel| u64::from(call.get(CC + 4 * channel)) & mask)
            .collect();
        (COMPARE..).zip(values)
    }

    fn plan(&mut self, call: &mut Call<'_, '_>) {
        self.next = None;
        let Some(since) = self.since else { return };
        let (now, mask) = (self.now(call), Self::mask(call));
        let ahead = Self::targets(call)
            .map(|(_, target)| (target.wrapping_sub(now + 1) & mask) + 1)
            .min();
        if let Some(ahead) = ahead {
            let ticks = now + ahead - self.count;
            let instant = since + (ticks * Self::tick(call) * 1_000).div_ceil(16);
            self.next = Some(call.at(instant));
        }
    }

    fn compare(&mut self, call: &mut Call<'_, '_>) {
        let count = self.now(call) & Self::mask(call);
        for (event, target) in Self::targets(call) {
            if target == count {
                call.event(event);
            }
        }
    }

    fn stop(&mut self, call: &Call<'_, '_>) {
        self.count = self.now(call);
        self.since = None;
        self.is_running = false;
    }
}

impl Model for Timer {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        let is_timer = call.get(MODE) & 3 == 0;
        match number {
            0 if self.is_running => {}
            0 => {
                self.is_running = true;
                self.clocked.start(call.now());
                self.since = is_timer.then(|| call.now());
            }
            1 => self.stop(call),
            4 => {
                self.stop(call);
                self.clocked.stop(call.now());
            }
            2 if is_timer => {
                call.forbid(
                    "TASKS_COUNT",
                    "it counts in the modes of a counter only (\"TIMER\")",
                );
            }
            2 if self.is_running => {
                self.count = self.count.wrapping_add(1);
                self.compare(call);
            }
            2 => {}
            3 => {
                self.count = 0;
                self.since = self.since.map(|_| call.now());
            }
            16..=19 => {
                let count = self.now(call) & Self::mask(call);
                call.set(CC + 4 * (number - 16), count as u32);
            }
            _ => call.no_task(),
        }
        self.plan(call);
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        call.only_shortcuts(offset, value, 0xf0f);
        if !matches!(
            offset,
            SHORTS | INTEN | INTENSET | INTENCLR | MODE | BITMODE | PRESCALER | CC..CC_END
        ) {
            call.no_register(offset);
        }
        if self.is_running && matches!(offset, MODE | BITMODE | PRESCALER) {
            call.forbid("MODE", "it is set up while it is stopped only (\"TIMER\")");
        }
        self.plan(call);
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.next == Some(id) {
            self.compare(call);
            self.plan(call);
        }
    }

    fn shortcut(&mut self, event: u16, call: &mut Call<'_, '_>) {
        let shorts = call.get(SHORTS);
        let Some(channel) = event.checked_sub(COMPARE) else {
            return;
        };
        if shorts >> channel & 1 != 0 {
            self.task(3, call);
        }
        if shorts >> (channel + 8) & 1 != 0 {
            self.task(1, call);
        }
    }

    fn reset(&mut self) {
        *self = Self {
            clocked: self.clocked,
            ..Self::default()
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::bench::Bench;

    #[test]
    fn a_counter_counts_its_task() {
        let mut bench = Bench::new(Timer::default());
        bench.set(MODE, 2);
        bench.set(BITMODE, 3);
        bench.set(CC, 3);
        bench.set(SHORTS, 1);
        bench.task(2);
        bench.task(0);
        for expected in [false, false, true, false, false, true] {
            bench.task(2);
            assert_eq!(bench.took(16), expected);
        }
        bench.task(2);
        bench.task(17);
        assert_eq!(bench.get(CC + 4), 1);
    }

    /// `TASKS_SHUTDOWN` is at 0x010.
    #[test]
    fn a_stopped_counter_needs_its_clock_until_it_is_shut_down() {
        let mut bench = Bench::new(Timer::default());
        bench.set(MODE, 2);
        for expected in [1_007, 2_014] {
            bench.pass(50);
            bench.task(0);
            bench.pass(1_000);
            bench.task(1);
            bench.pass(7);
            bench.set(0x010, 1);
            bench.pass(50);
            let timer = &bench.chip.model.model;
            assert_eq!(timer.clocked.until(bench.now), expected);
        }
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    #[test]
    fn what_is_not_modelled_is_told() {
        let mut bench = Bench::new(Timer::default());
        bench.task(20);
        bench.set(CC_END, 1);
        bench.set(SHORTS, 1 << 4);
        assert_eq!(bench.forbidden(), ["TASKS", "registers", "SHORTS"]);
    }

    #[test]
    fn a_timer_counts_microseconds() {
        let mut bench = Bench::new(Timer::default());
        bench.set(PRESCALER, 4);
        bench.set(BITMODE, 3);
        bench.set(CC, 1_000);
        bench.set(SHORTS, 1 << 8);
        bench.task(0);
        bench.pass(999_999);
        assert!(!bench.took(16));
        bench.pass(1);
        assert!(bench.took(16));
        // The shortcut stopped it.
        bench.pass(5_000);
        bench.task(17);
        assert_eq!(bench.get(CC + 4), 1_000);
        assert_eq!(bench.forbidden(), [""; 0]);
        bench.task(2);
        assert_eq!(bench.forbidden(), ["TASKS_COUNT"]);
    }
}
