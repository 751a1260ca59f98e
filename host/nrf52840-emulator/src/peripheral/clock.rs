//! CLOCK and POWER, which share their registers.

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, US, radio, rtc, stopwatch::Stopwatch};

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
/// VBUS is there, and its regulator is ready.
const USBREGSTATUS: u16 = 0x438;
const SYSTEMOFF: u16 = 0x500;
const POFCON: u16 = 0x510;
const LFCLKSRC: u16 = 0x518;
/// GPREGRET and GPREGRET2.
const RETAINED: [u16; 2] = [0x51c, 0x520];
/// In both STAT registers.
const RUNNING: u32 = 1 << 16;
/// LFCLKSRC: a crystal.
const CRYSTAL: u32 = 1;

/// The chip was restarted by its pin, a bit of RESETREAS (Product Specification, "POWER").
pub(crate) const PIN: u32 = 1;
/// By the watchdog.
pub(crate) const WATCHDOG: u32 = 2;
/// By the program.
pub(crate) const PROGRAM: u32 = 4;
/// By a lockup of the processor.
pub(crate) const LOCKUP: u32 = 8;

/// Clocks start after a time. While the crystal of 32.768 kHz starts, the oscillator without one is the
/// clock ("LFCLK"). The radio and the RTC hear what runs. The cause of a reset is kept until the program clears it.
#[derive(Debug, Default)]
pub struct Clock {
    high: Option<EventId>,
    /// The clock that was asked for, and the one until then.
    low: Option<EventId>,
    any_low: Option<EventId>,
    /// RESETREAS.
    pub cause: u32,
    /// Time from which on the high-frequency crystal starts: a fault of the board. A start that was begun earlier
    /// never ends.
    pub hfxo_from: u64,
    /// The same for the crystal of 32.768 kHz.
    pub lfxo_from: u64,
    /// The USB plug gives power, from power-on.
    is_plugged: bool,
    /// Time for which the high-frequency crystal is asked for.
    pub(crate) asked: Stopwatch,
}

impl Clock {
    /// With power from a USB plug, or without.
    pub(crate) fn new(is_plugged: bool) -> Self {
        Self {
            is_plugged,
            ..Self::default()
        }
    }

    /// Registers that stay through a reset by the program (Product Specification, "Reset behavior").
    pub(crate) const KEPT: [u16; 2] = RETAINED;
}

/// Tells the radio, or the RTC, if its clock runs.
fn tell([base, offset]: [u64; 2], runs: bool, call: &mut Call<'_, '_>) {
    let address = base + offset;
    call.context
        .write_to(address, Width::W32, runs.into(), DONE);
}

const TO_RADIO: [u64; 2] = [radio::BASE, radio::HFXO as u64];
const TO_RTC: [u64; 2] = [rtc::BASE, rtc::LFCLK as u64];

impl Model for Clock {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        match number {
            0 => {
                call.set(HFCLKRUN, 1);
                self.asked.start(call.now());
                if call.now() >= self.hfxo_from {
                    self.high = Some(call.after(HFXO_START));
                }
            }
            1 => {
                self.high = None;
                self.asked.stop(call.now());
                call.set(HFCLKRUN, 0);
                // The internal oscillator goes on.
                call.set(HFCLKSTAT, RUNNING);
                tell(TO_RADIO, false, call);
            }
            2 => {
                call.set(LFCLKRUN, 1);
                self.any_low = Some(call.after(LFRC_START));
                self.low = match call.get(LFCLKSRC) & 3 {
                    CRYSTAL if call.now() < self.lfxo_from => None,
                    CRYSTAL => Some(call.after(LFXO_START)),
                    _ => Some(call.after(LFRC_START)),
                };
            }
            3 => {
                self.low = None;
                self.any_low = None;
                call.set(LFCLKRUN, 0);
                call.set(LFCLKSTAT, 0);
                tell(TO_RTC, false, call);
            }
            // CONSTLAT and LOWPWR: nothing else can be seen of them.
            30 | 31 => {}
            _ => call.no_task(),
        }
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        if self.high == Some(id) {
            self.high = None;
            call.set(HFCLKSTAT, RUNNING | 1);
            tell(TO_RADIO, true, call);
            call.event(0);
        }
        if self.any_low == Some(id) {
            self.any_low = None;
            call.set(LFCLKSTAT, RUNNING);
            tell(TO_RTC, true, call);
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
        if offset == SYSTEMOFF && value & 1 != 0 {
            call.forbid("SYSTEMOFF", "that it switches itself off is not modelled");
        }
        if offset == POFCON && value & 1 != 0 {
            call.forbid("POFCON", "a warning of low voltage is not modelled");
        }
        if offset == LFCLKSRC && call.get(LFCLKRUN) != 0 {
            call.forbid(
                "LFCLKSRC",
                "the source is changed while the clock is stopped only (\"LFCLK\")",
            );
        }
    }

    fn read(&mut self, offset: u16, _: &mut Call<'_, '_>) -> Option<u32> {
        match offset {
            RESETREAS => Some(self.cause),
            USBREGSTATUS if self.is_plugged => Some(3),
            _ => None,
        }
    }

    fn reset(&mut self) {
        self.high = None;
        self.low = None;
        self.any_low = None;
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
        assert_eq!(bench.chip.model.model.asked.until(bench.now), HFXO_START);
        bench.set(LFCLKSRC, 1);
        bench.task(2);
        bench.pass(LFRC_START - 1);
        assert_eq!(bench.get(LFCLKSTAT), 0);
        // Without a crystal until then.
        bench.pass(1);
        assert_eq!(bench.get(LFCLKSTAT), RUNNING);
        bench.pass(LFXO_START - LFRC_START - 1);
        assert_eq!((bench.took(1), bench.get(LFCLKSTAT)), (false, RUNNING));
        bench.pass(1);
        assert_eq!((bench.took(1), bench.get(LFCLKSTAT)), (true, RUNNING | 1));
        // No other peripheral is there to hear it.
        assert!(bench.forbidden().iter().all(|told| *told == "PTR"));
        bench.set(LFCLKSRC, 0);
        assert_eq!(bench.forbidden(), ["LFCLKSRC"]);
        let asked = bench.now;
        bench.task(1);
        bench.pass(5);
        assert_eq!(bench.chip.model.model.asked.until(bench.now), asked);
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
    fn a_dead_slow_crystal_never_starts_either() {
        let mut bench = Bench::new(Clock {
            lfxo_from: 2_000_000 * US,
            ..Clock::default()
        });
        bench.set(LFCLKSRC, CRYSTAL);
        bench.task(2);
        bench.pass(3_000_000 * US);
        assert_eq!((bench.took(1), bench.get(LFCLKSTAT)), (false, RUNNING));
        bench.task(2);
        bench.pass(LFXO_START);
        assert!(bench.took(1));
    }

    #[test]
    fn what_is_not_modelled_is_told() {
        let mut bench = Bench::new(Clock::default());
        for task in [4, 5, 6, 30, 31] {
            bench.task(task);
        }
        for (offset, value) in [(POFCON, 0), (POFCON, 1), (SYSTEMOFF, 1)] {
            bench.set(offset, value);
        }
        let expected = ["TASKS", "TASKS", "TASKS", "POFCON", "SYSTEMOFF"];
        assert_eq!(bench.forbidden(), expected);
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
