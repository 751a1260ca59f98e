//! RTC: a counter of 24 bits at 32.768 kHz, divided.

use rigless::time::EventId;

use super::{Call, INTEN, INTENCLR, INTENSET, Model};

/// Its address: RTC1 (Product Specification, "Instantiation").
pub(crate) const BASE: u64 = 0x4001_1000;
/// Register where CLOCK tells if LFCLK runs. Programs know nothing of it.
pub(super) const LFCLK: u16 = 0xf00;

const EVTEN: u16 = 0x340;
const EVTENSET: u16 = 0x344;
const EVTENCLR: u16 = 0x348;
const COUNTER: u16 = 0x504;
const PRESCALER: u16 = 0x508;
const CC: u16 = 0x540;
const CC_END: u16 = CC + 4 * 4;
/// Bits of INTEN and EVTEN.
const OVERFLOW: u16 = 1;
const COMPARE: u16 = 16;
const MASK: u64 = 0xff_ffff;
const HZ: u128 = 32_768;
const SECOND: u128 = 1_000_000_000;

/// Least distance of a comparison from the counter N: one with N or N + 1 that is set then may happen or not, one
/// with N + 2 does (Product Specification, "RTC", compare). Those that may happen or not do not happen here.
const SOONEST: u64 = 2;

/// Events happen only where INTEN or EVTEN enables them, and other peripherals hear of them where EVTEN does
/// (Product Specification, "RTC").
#[derive(Debug, Default)]
pub struct Rtc {
    is_started: bool,
    /// Time since which it counts.
    since: Option<u64>,
    /// Ticks before that.
    before: u64,
    divider: u64,
    /// Times when the comparisons were set.
    set: [u64; 4],
    next: Option<EventId>,
}

impl Rtc {
    /// Ticks, not wrapped.
    fn ticks(&self, now: u64) -> u64 {
        let run = self.since.map_or(0, |since| u128::from(now - since));
        self.before + (run * HZ / SECOND) as u64 / (self.divider + 1)
    }

    /// It counts while it is started and its clock runs.
    fn count(&mut self, call: &Call<'_, '_>) {
        let now = call.now();
        if self.is_started && call.get(LFCLK) != 0 {
            self.since.get_or_insert(now);
        } else {
            self.before = self.ticks(now) & MASK;
            self.since = None;
        }
    }

    /// The instant at which so many ticks are reached.
    fn instant(&self, since: u64, ticks: u64) -> u64 {
        let ticks = u128::from((ticks - self.before) * (self.divider + 1));
        since + (ticks * SECOND).div_ceil(HZ) as u64
    }

    /// Calls it when the counter next changes, which is no event, if this register shows the counter: a program
    /// that reads it again and again may sleep until then.
    pub(crate) fn wake(&self, offset: u16, call: &mut Call<'_, '_>) {
        if let Some(since) = self.since.filter(|_| offset == COUNTER) {
            let next = self.ticks(call.now()) + 1;
            call.at(self.instant(since, next));
        }
    }

    /// Returns true if a comparison was set too late for this count.
    fn is_too_soon(&self, event: u16, ticks: u64) -> bool {
        let channel = event.checked_sub(COMPARE).map(usize::from);
        let set = channel.and_then(|channel| self.set.get(channel));
        let is_running = |at: &&u64| self.since.is_some_and(|since| **at >= since);
        set.filter(is_running)
            .is_some_and(|&at| ticks < self.ticks(at) + SOONEST)
    }

    fn targets(call: &Call<'_, '_>) -> Vec<(u16, u64)> {
        let enabled = call.enabled | call.get(EVTEN);
        let compare = (0..4).map(|channel| {
            let value = call.get(CC + 4 * channel);
            (COMPARE + channel, u64::from(value) & MASK)
        });
        let all = compare.chain([(OVERFLOW, 0)]);
        all.filter(|(event, _)| enabled >> event & 1 != 0).collect()
    }

    fn plan(&mut self, call: &mut Call<'_, '_>) {
        self.next = None;
        let Some(since) = self.since else { return };
        let ticks = self.ticks(call.now());
        let ahead = Self::targets(call)
            .into_iter()
            // A target that is equal now comes round again.
            .map(|(event, target)| (event, (target.wrapping_sub(ticks + 1) & MASK) + 1))
            .map(
                |(event, ahead)| match self.is_too_soon(event, ticks + ahead) {
                    true => ahead + MASK + 1,
                    false => ahead,
                },
            )
            .min();
        if let Some(ahead) = ahead {
            let instant = self.instant(since, ticks + ahead);
            self.next = Some(call.at(instant));
        }
    }
}

impl Model for Rtc {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        let now = call.now();
        match number {
            0 if self.is_started => {}
            0 => {
                self.divider = u64::from(call.get(PRESCALER) & 0xfff);
                self.is_started = true;
                if call.get(LFCLK) == 0 {
                    call.forbid("TASKS_START", "LFCLK must run (\"RTC\", clock source)");
                }
                self.count(call);
            }
            1 => {
                self.is_started = false;
                self.count(call);
            }
            2 => {
                self.before = 0;
                self.since = self.since.map(|_| now);
            }
            3 => {
                self.before = 0xff_fff0;
                self.since = self.since.map(|_| now);
            }
            _ => call.no_task(),
        }
        self.plan(call);
    }

    fn read(&mut self, offset: u16, call: &mut Call<'_, '_>) -> Option<u32> {
        let counter = (self.ticks(call.now()) & MASK) as u32;
        match offset {
            COUNTER => Some(counter),
            EVTENSET | EVTENCLR => Some(call.get(EVTEN)),
            _ => None,
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        let events = call.get(EVTEN);
        match offset {
            EVTENSET => call.set(EVTEN, events | value),
            EVTENCLR => call.set(EVTEN, events & !value),
            CC..CC_END => self.set[usize::from((offset - CC) / 4)] = call.now(),
            LFCLK => self.count(call),
            PRESCALER if self.is_started => {
                call.forbid(
                    "PRESCALER",
                    "it is written while the RTC is stopped only (\"RTC\")",
                );
            }
            INTEN | INTENSET | INTENCLR | EVTEN | PRESCALER => {}
            _ => call.no_register(offset),
        }
        if (call.enabled | call.get(EVTEN)) & 1 != 0 {
            call.forbid("EVTEN", "its TICK is not modelled");
        }
        if offset >= INTEN {
            self.plan(call);
        }
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.next != Some(id) {
            return;
        }
        let ticks = self.ticks(call.now());
        for (event, target) in Self::targets(call) {
            if target == ticks & MASK && !self.is_too_soon(event, ticks) {
                if call.get(EVTEN) >> event & 1 != 0 {
                    call.event(event);
                } else {
                    call.event_unheard(event);
                }
            }
        }
        self.plan(call);
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::bench::Bench;

    const S: u64 = 1_000_000_000;

    fn bench() -> Bench<Rtc> {
        let mut bench = Bench::new(Rtc::default());
        bench.set(LFCLK, 1);
        bench
    }

    #[test]
    fn without_its_clock_it_stands_still() {
        let mut bench = Bench::new(Rtc::default());
        bench.task(0);
        assert_eq!(bench.forbidden(), ["TASKS_START"]);
        for (clock, counter) in [(0, 0), (1, 32_768), (0, 32_768), (1, 2 * 32_768)] {
            bench.set(LFCLK, clock);
            bench.pass(S);
            assert_eq!(bench.get(COUNTER), counter);
        }
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    #[test]
    fn it_counts_and_compares() {
        let mut bench = bench();
        bench.set(CC, 32_768);
        bench.set(0x304, 1 << COMPARE);
        bench.task(0);
        bench.pass(S - 1);
        assert_eq!((bench.get(COUNTER), bench.took(16)), (32_767, false));
        bench.pass(1);
        assert_eq!((bench.get(COUNTER), bench.took(16)), (32_768, true));
        // Not before it has come round.
        bench.pass(511 * S);
        assert!(!bench.took(16));
        bench.pass(S);
        assert!(bench.took(16));
        bench.task(1);
        bench.pass(S);
        assert_eq!(bench.get(COUNTER), 32_768);
        bench.task(2);
        assert_eq!(bench.get(COUNTER), 0);
    }

    #[test]
    fn what_is_set_too_late_comes_round_first() {
        let happens = |ahead| {
            let mut bench = bench();
            bench.set(0x304, 1 << COMPARE);
            bench.task(0);
            bench.pass(S);
            let counter = bench.get(COUNTER);
            bench.set(CC, counter + ahead);
            bench.pass(S);
            let at_once = bench.took(16);
            bench.pass(512 * S);
            (at_once, bench.took(16))
        };
        assert_eq!(happens(1), (false, true));
        assert_eq!(happens(2), (true, true));
    }

    #[test]
    fn nothing_happens_that_is_not_enabled() {
        let mut bench = bench();
        bench.set(CC, 5);
        bench.task(0);
        bench.pass(S);
        assert!(!bench.took(16));
        bench.set(EVTENSET, 1 << OVERFLOW);
        bench.task(3);
        bench.pass(16 * S / 32_768 + 1);
        assert!(bench.took(OVERFLOW));
        bench.set(PRESCALER, 3);
        assert_eq!(bench.forbidden(), ["PRESCALER"]);
    }

    #[test]
    fn what_is_not_modelled_is_told() {
        let mut bench = bench();
        bench.task(4);
        bench.set(CC_END, 1);
        assert_eq!(bench.forbidden(), ["TASKS", "registers"]);
    }

    #[test]
    fn the_prescaler_divides() {
        let mut bench = bench();
        bench.set(PRESCALER, 31);
        bench.task(0);
        bench.pass(S);
        assert_eq!(bench.get(COUNTER), 1024);
    }
}
