//! WDT: restarts the chip unless it is told in time that all is well.

use rigless::time::EventId;

use super::{Call, Model};

const RUNSTATUS: u16 = 0x400;
const REQSTATUS: u16 = 0x404;
const CRV: u16 = 0x504;
const RREN: u16 = 0x508;
const CONFIG: u16 = 0x50c;
const RELOAD: core::ops::Range<u16> = 0x600..0x620;
/// Product Specification, "WDT", RR.
const KEY: u32 = 0x6e52_4635;

/// Once started it runs on through a reset by the program, with its set-up (Product Specification,
/// "Reset behavior"); what keeps it is the chip.
#[derive(Debug, Default)]
pub struct Watchdog {
    next: Option<EventId>,
    /// When it bites.
    pub(crate) deadline: u64,
    requested: u32,
    /// Reloads.
    pub fed: u64,
}

impl Watchdog {
    /// Registers that stay through a reset by the program.
    pub(crate) const KEPT: [u16; 4] = [RUNSTATUS, CRV, RREN, CONFIG];

    /// Whether it runs, by its registers.
    pub(crate) fn is_running(call: &Call<'_, '_>) -> bool {
        call.get(RUNSTATUS) != 0
    }

    /// It goes on after a reset.
    pub(crate) fn go_on(&mut self, deadline: u64, call: &mut Call<'_, '_>) {
        self.deadline = deadline;
        self.next = Some(call.at(deadline));
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
            call.set(RUNSTATUS, 1);
            self.reload(call);
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        if Self::is_running(call) && matches!(offset, CRV | RREN | CONFIG) {
            call.forbid("CRV", "it is set up before it is started (\"WDT\")");
        }
        if RELOAD.contains(&offset) && value == KEY {
            self.requested &= !(1 << ((offset - RELOAD.start) / 4));
            call.set(REQSTATUS, self.requested);
            if self.requested == 0 {
                self.fed += 1;
                self.reload(call);
            }
        }
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.next == Some(id) {
            call.event(0);
            call.context.request_reset();
        }
    }

    fn reset(&mut self) {
        self.next = None;
    }
}

#[cfg(test)]
mod tests {
    use rigless::mcu::Operate;

    use super::*;
    use crate::peripheral::bench::Bench;

    const S: u64 = 1_000_000_000;

    #[test]
    fn it_bites_unless_all_that_are_asked_report() {
        let mut bench = Bench::new(Watchdog::default());
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
    fn it_is_not_changed_any_more() {
        let mut bench = Bench::new(Watchdog::default());
        bench.set(CRV, 32_767);
        bench.task(0);
        bench.set(CRV, 99);
        assert_eq!(bench.forbidden(), ["CRV"]);
    }
}
