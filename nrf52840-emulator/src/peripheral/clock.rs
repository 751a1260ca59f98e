//! CLOCK and POWER, which share their registers.

use rigless::time::EventId;

use super::{Call, Model, US};

/// Product Specification, "HFXO": the crystal of 32 MHz starts within this time.
const HFXO_START: u64 = 360 * US;
/// Product Specification, "LFXO": the crystal of 32.768 kHz, typically.
const LFXO_START: u64 = 250_000 * US;
/// Product Specification, "LFRC": the oscillator without a crystal.
const LFRC_START: u64 = 600 * US;

const RESETREAS: u16 = 0x400;
const HFCLKRUN: u16 = 0x408;
const HFCLKSTAT: u16 = 0x40c;
const LFCLKRUN: u16 = 0x414;
const LFCLKSTAT: u16 = 0x418;
const LFCLKSRC: u16 = 0x518;
/// In both STAT registers.
const RUNNING: u32 = 1 << 16;

/// The chip was restarted by its pin, a bit of RESETREAS (Product Specification, "POWER").
pub(crate) const PIN: u32 = 1;
/// By the watchdog.
pub(crate) const WATCHDOG: u32 = 2;
/// By the program.
pub(crate) const PROGRAM: u32 = 4;

/// Clocks start after a time; the cause of a reset is kept until the program clears it.
#[derive(Debug, Default)]
pub struct Clock {
    high: Option<EventId>,
    low: Option<EventId>,
    /// RESETREAS.
    pub cause: u32,
    /// From when on the high-frequency crystal starts: a fault of the board. What was begun earlier never
    /// ends.
    pub hfxo_from: u64,
}

impl Model for Clock {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        match number {
            0 => {
                call.set(HFCLKRUN, 1);
                if call.now() >= self.hfxo_from {
                    self.high = Some(call.after(HFXO_START));
                }
            }
            1 => {
                self.high = None;
                call.set(HFCLKRUN, 0);
                // The internal oscillator goes on.
                call.set(HFCLKSTAT, RUNNING);
            }
            2 => {
                let crystal = call.get(LFCLKSRC) & 3 == 1;
                call.set(LFCLKRUN, 1);
                self.low = Some(call.after(if crystal { LFXO_START } else { LFRC_START }));
            }
            3 => {
                self.low = None;
                call.set(LFCLKRUN, 0);
                call.set(LFCLKSTAT, 0);
            }
            _ => {}
        }
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.high == Some(id) {
            self.high = None;
            call.set(HFCLKSTAT, RUNNING | 1);
            call.event(0);
        }
        if self.low == Some(id) {
            self.low = None;
            let source = call.get(LFCLKSRC) & 3;
            call.set(LFCLKSTAT, RUNNING | source);
            call.event(1);
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        if offset == RESETREAS {
            // Cleared by ones.
            self.cause &= !value;
        }
        if offset == LFCLKSRC && call.get(LFCLKRUN) != 0 {
            call.forbid(
                "LFCLKSRC",
                "the source is changed while the clock is stopped only (\"LFCLK\")",
            );
        }
    }

    fn read(&mut self, offset: u16, _: &mut Call<'_, '_>) -> Option<u32> {
        (offset == RESETREAS).then_some(self.cause)
    }

    fn reset(&mut self) {
        self.high = None;
        self.low = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::bench::Bench;

    #[test]
    fn crystals_take_their_time() {
        let mut bench = Bench::new(Clock::default());
        bench.task(0);
        bench.pass(HFXO_START - 1);
        assert_eq!((bench.took(0), bench.get(HFCLKSTAT)), (false, 0));
        bench.pass(1);
        assert_eq!((bench.took(0), bench.get(HFCLKSTAT)), (true, RUNNING | 1));
        bench.set(LFCLKSRC, 1);
        bench.task(2);
        bench.pass(LFXO_START - 1);
        assert!(!bench.took(1));
        bench.pass(1);
        assert!(bench.took(1));
        assert_eq!(bench.forbidden(), [""; 0]);
        bench.set(LFCLKSRC, 0);
        assert_eq!(bench.forbidden(), ["LFCLKSRC"]);
    }

    #[test]
    fn a_dead_crystal_never_starts() {
        let mut bench = Bench::new(Clock {
            hfxo_from: 2_000_000 * US,
            ..Clock::default()
        });
        bench.task(0);
        bench.pass(3_000_000 * US);
        assert!(!bench.took(0));
        bench.task(0);
        bench.pass(1_000 * US);
        assert!(bench.took(0));
    }

    #[test]
    fn ones_clear_the_cause() {
        let mut bench = Bench::new(Clock {
            cause: WATCHDOG | PROGRAM,
            ..Clock::default()
        });
        bench.set(RESETREAS, WATCHDOG);
        assert_eq!(bench.get(RESETREAS), PROGRAM);
    }
}
