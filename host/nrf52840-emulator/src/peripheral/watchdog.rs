//! WDT: restarts the chip unless it is told in time that all is well.

use rigless::time::EventId;

use super::{Call, Model};

/// After a reset.
pub(crate) const RESET: [(u16, u32); 4] = [(REQSTATUS, 1), (CRV, u32::MAX), (RREN, 1), (CONFIG, 1)];

const RUNSTATUS: u16 = 0x400;
const REQSTATUS: u16 = 0x404;
const CRV: u16 = 0x504;
const RREN: u16 = 0x508;
const CONFIG: u16 = 0x50c;
const RELOAD: core::ops::Range<u16> = 0x600..0x620;
/// Registers that do not change while it runs.
const SET_UP: [u16; 3] = [CRV, RREN, CONFIG];
/// Product Specification, "WDT", RR.
const KEY: u32 = 0x6e52_4635;

/// Two cycles of 32.768 kHz: with its interrupt on, so long before the reset is the event ("WDT").
const POSTPONED: u64 = 2 * 1_000_000_000 / 32_768;

/// Once started it runs on through a reset by the program, with its set-up (Product Specification,
/// "Reset behavior"); what keeps it is the chip.
#[derive(Debug, Default)]
pub struct Watchdog {
    next: Option<EventId>,
    /// Time when it bites.
    pub(crate) deadline: u64,
    requested: u32,
    /// CRV, RREN and CONFIG as they were when it was started: they are what they were until it stops.
    set_up: [u32; 3],
    /// It has told that it is about to bite.
    has_told: bool,
    /// Reloads.
    pub fed: u64,
}

impl Watchdog {
    /// Registers that stay through a reset by the program.
    pub(crate) const KEPT: [u16; 4] = [RUNSTATUS, CRV, RREN, CONFIG];

    /// Returns true if it runs, by its registers.
    pub(crate) fn is_running(call: &Call<'_, '_>) -> bool {
        call.get(RUNSTATUS) != 0
    }

    /// It goes on after a reset.
    pub(crate) fn go_on(&mut self, deadline: u64, call: &mut Call<'_, '_>) {
        self.deadline = deadline;
        self.next = Some(call.at(deadline.max(call.now() + 1)));
        self.set_up = SET_UP.map(|offset| call.get(offset));
        self.request(call);
    }

    fn request(&mut self, call: &mut Call<'_, '_>) {
        self.requested = call.get(RREN);
        call.set(REQSTATUS, self.requested);
    }

    fn reload(&mut self, call: &mut Call<'_, '_>) {
        let ticks = u64::from(call.get(CRV)) + 1;
        let time = (u128::from(ticks) * 1_000_000_000 / 32_768) as u64;
        self.deadline = call.now() + time;
        self.next = Some(call.at(self.deadline));
        self.request(call);
    }
}

impl Model for Watchdog {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        if number == 0 && !Self::is_running(call) {
            if call.get(CONFIG) & 1 == 0 {
                call.forbid(
                    "CONFIG",
                    "that it stops while the processor sleeps is not modelled",
                );
            }
            call.set(RUNSTATUS, 1);
            self.set_up = SET_UP.map(|offset| call.get(offset));
            self.reload(call);
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        if Self::is_running(call) && SET_UP.contains(&offset) {
            call.forbid("CRV", "it is set up before it is started (\"WDT\")");
            for (offset, value) in SET_UP.into_iter().zip(self.set_up) {
                call.set(offset, value);
            }
        }
        // Before it is started there is nothing to reload, and once it has told it cannot be stopped.
        let can_reload = Self::is_running(call) && !self.has_told;
        if RELOAD.contains(&offset) && value == KEY && can_reload {
            self.requested &= !(1 << ((offset - RELOAD.start) / 4));
            call.set(REQSTATUS, self.requested);
            if self.requested == 0 {
                self.fed += 1;
                self.reload(call);
            }
        }
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.next != Some(id) {
            return;
        }
        if !core::mem::replace(&mut self.has_told, true) {
            call.event(0);
            if call.enabled & 1 != 0 {
                self.next = Some(call.after(POSTPONED));
                return;
            }
        }
        call.context.request_reset();
    }

    fn reset(&mut self) {
        self.next = None;
        self.has_told = false;
    }
}

#[cfg(test)]
mod tests {
    use rigless::mcu::Operate;

    use super::*;
    use crate::peripheral::{INTENSET, bench::Bench};

    const S: u64 = 1_000_000_000;

    fn bench() -> Bench<Watchdog> {
        let mut bench = Bench::new(Watchdog::default());
        for (offset, value) in RESET {
            bench.set(offset, value);
        }
        bench
    }

    #[test]
    fn it_bites_unless_all_that_are_asked_report() {
        let mut bench = bench();
        bench.set(CRV, 32_767);
        bench.set(RREN, 0b11);
        bench.task(0);
        for _ in 0..3 {
            bench.pass(S - 1);
            bench.set(RELOAD.start, KEY);
            bench.set(RELOAD.start + 4, KEY);
        }
        assert!(bench.chip.take_reset_request().is_none());
        assert_eq!(bench.chip.model.model.fed, 3);
        bench.set(RELOAD.start, KEY);
        bench.set(RELOAD.start + 4, KEY + 1);
        bench.pass(S - 1);
        assert!(bench.chip.take_reset_request().is_none());
        bench.pass(1);
        assert!(bench.chip.take_reset_request().is_some());
    }

    #[test]
    fn it_does_not_bite_before_it_is_started() {
        let mut bench = bench();
        bench.set(CRV, 32_767);
        bench.set(RREN, 1);
        bench.set(RELOAD.start, KEY);
        bench.pass(5 * S);
        assert!(bench.chip.take_reset_request().is_none());
        assert_eq!(bench.chip.model.model.fed, 0);
    }

    #[test]
    fn that_it_sleeps_is_not_modelled() {
        for (config, told) in [(0, ["CONFIG"].as_slice()), (1, &[]), (9, &[])] {
            let mut bench = Bench::new(Watchdog::default());
            bench.set(CONFIG, config);
            bench.task(0);
            assert_eq!(bench.forbidden(), told);
        }
    }

    #[test]
    fn it_is_not_changed_any_more() {
        let mut bench = bench();
        bench.set(CRV, 32_767);
        bench.task(0);
        bench.set(CRV, 99);
        assert_eq!(bench.forbidden(), ["CRV"]);
        assert_eq!(bench.get(CRV), 32_767);
        bench.pass(S - 1);
        assert!(bench.chip.take_reset_request().is_none());
        bench.pass(1);
        assert!(bench.chip.take_reset_request().is_some());
    }

    #[test]
    fn a_program_that_is_told_has_two_cycles_left() {
        let mut bench = bench();
        bench.set(CRV, 32_767);
        bench.set(RREN, 1);
        bench.set(INTENSET, 1);
        bench.task(0);
        bench.pass(S);
        assert!(bench.took(0) && bench.chip.take_reset_request().is_none());
        bench.set(RELOAD.start, KEY);
        bench.pass(POSTPONED - 1);
        assert!(bench.chip.take_reset_request().is_none());
        bench.pass(1);
        assert!(bench.chip.take_reset_request().is_some());
    }
}
