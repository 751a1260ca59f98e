//! TWIM: the master of an I2C bus, and chips on it.

use std::collections::BTreeMap;

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, READ, SHORTS, US, Wires};
use crate::device::{Chip, NOT_ACKNOWLEDGED};

const ERRORSRC: u16 = 0x4c4;
const ENABLE: u16 = 0x500;
const PSEL_SCL: u16 = 0x508;
const PSEL_SDA: u16 = 0x50c;
const FREQUENCY: u16 = 0x524;
const RX_PTR: u16 = 0x534;
const RX_MAX: u16 = 0x538;
const RX_AMOUNT: u16 = 0x53c;
const TX_PTR: u16 = 0x544;
const TX_MAX: u16 = 0x548;
const TX_AMOUNT: u16 = 0x54c;
const ADDRESS: u16 = 0x588;

/// Its address (Product Specification, "Instantiation").
pub(crate) const BASE: u64 = 0x4000_3000;
/// Register where the pins tell if the bus is held low. Programs know nothing of it.
pub(super) const HELD: u16 = 0xf00;

/// After a reset: no pins, 250 kbit/s.
pub(crate) const RESET: [(u16, u32); 3] = [
    (FREQUENCY, 0x0400_0000),
    (PSEL_SCL, u32::MAX),
    (PSEL_SDA, u32::MAX),
];

const STOPPED: u16 = 1;
const ERROR: u16 = 9;
const SUSPENDED: u16 = 18;
const RXSTARTED: u16 = 19;
const TXSTARTED: u16 = 20;
const LASTRX: u16 = 23;
const LASTTX: u16 = 24;
/// Bits of SHORTS, causes and tasks (Product Specification, "TWIM").
const SHORTCUTS: [(u16, u16, u16); 6] = [
    (7, LASTTX, 0),
    (8, LASTTX, 7),
    (9, LASTTX, 5),
    (10, LASTRX, 2),
    (11, LASTRX, 7),
    (12, LASTRX, 5),
];
/// ERRORSRC: no chip answered to the address.
const NO_ANSWER: u32 = 2;
/// ERRORSRC: a byte was not acknowledged.
const REFUSED: u32 = 4;
/// Two bits of the slowest bus.
const STOP_TIME: u64 = 20 * US;

#[derive(Clone, Copy, Debug)]
enum Step {
    Write,
    Read,
    Unanswered,
    Stop,
}

/// Transfers take the time of their bits, and are done at its end.
#[derive(Debug, Default)]
pub struct Twim {
    /// Chips by their addresses.
    pub chips: BTreeMap<u32, Box<dyn Chip>>,
    /// Transfers that ended.
    pub transfers: u64,
    /// Times from which on it transfers over which wires, data and clock, to be taken.
    pub wired: Vec<(u64, Wires)>,
    /// The last of them.
    wires: Option<Wires>,
    step: Option<(EventId, Step)>,
    bytes: Vec<u8>,
    error: u32,
}

impl Twim {
    /// A bus with these chips.
    pub fn new(chips: BTreeMap<u32, Box<dyn Chip>>) -> Self {
        Self {
            chips,
            ..Self::default()
        }
    }

    /// A byte and its acknowledgement are nine bits; the address is the first.
    fn begin(&mut self, step: Step, bytes: u32, call: &mut Call<'_, '_>) {
        let share = u128::from(call.get(FREQUENCY).max(1));
        let bits = 9 * (u128::from(bytes) + 1);
        let time = bits * 1_000_000_000 * (1 << 32) / (share * 16_000_000);
        let id = call.after(time as u64);
        self.step = Some((id, step));
    }

    fn start(&mut self, step: Step, bytes: u32, call: &mut Call<'_, '_>) {
        let pins = [PSEL_SDA, PSEL_SCL].map(|pin| call.get(pin));
        if pins.iter().any(|pin| *pin >= Wires::NOT_CONNECTED) {
            call.forbid(
                "PSEL",
                "a transfer over a pin that is not connected (\"TWIM\")",
            );
        }
        let rate = (u64::from(call.get(FREQUENCY)) * 16_000_000) >> 32;
        let wires = Wires {
            pins,
            rate: rate as u32,
        };
        if self.wires.replace(wires) != Some(wires) {
            self.wired.push((call.now(), wires));
        }
        if self.chips.contains_key(&call.get(ADDRESS)) {
            self.begin(step, bytes, call);
        } else {
            self.begin(Step::Unanswered, 0, call);
        }
    }
}

impl Model for Twim {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        if call.get(ENABLE) != 6 {
            call.forbid("ENABLE", "a task while it is not enabled (\"TWIM\")");
            return;
        }
        // Nothing begins on a bus that is held low.
        if call.get(HELD) != 0 {
            return;
        }
        let is_busy = matches!(
            self.step,
            Some((_, Step::Read | Step::Write | Step::Unanswered))
        );
        if is_busy && matches!(number, 0 | 2) {
            call.forbid(
                "TASKS_START",
                "it is started before the transfer before is over (\"TWIM\")",
            );
            return;
        }
        match number {
            0 => {
                let (pointer, max) = (call.get(RX_PTR), call.get(RX_MAX));
                if call.reaches(pointer, max) {
                    call.event(RXSTARTED);
                    self.start(Step::Read, max, call);
                }
            }
            2 => {
                let (pointer, max) = (call.get(TX_PTR), call.get(TX_MAX));
                if call.reaches(pointer, max) {
                    call.event(TXSTARTED);
                    self.bytes.clear();
                    for byte in 0..max {
                        let at = u64::from(pointer) + u64::from(byte);
                        call.context.read_from(at, Width::W8, READ);
                    }
                    self.start(Step::Write, max, call);
                }
            }
            5 => {
                let id = call.after(STOP_TIME);
                self.step = Some((id, Step::Stop));
            }
            7 => call.event(SUSPENDED),
            _ => call.no_task(),
        }
    }

    fn answer(&mut self, _: u64, value: u32, _: &mut Call<'_, '_>) {
        self.bytes.push(value as u8);
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        let Some((_, step)) = self.step.take_if(|(mine, _)| *mine == id) else {
            return;
        };
        let now = call.now();
        let chip = self.chips.get_mut(&call.get(ADDRESS));
        match (step, chip) {
            (Step::Stop, _) => call.event(STOPPED),
            (Step::Write, Some(chip)) => {
                self.transfers += 1;
                match chip.write(&self.bytes, now) {
                    Ok(()) => {}
                    Err(NOT_ACKNOWLEDGED) => {
                        self.error |= REFUSED;
                        call.event(ERROR);
                        return;
                    }
                    Err(what) => call.forbid("ADDRESS", what),
                }
                call.set(TX_AMOUNT, self.bytes.len() as u32);
                call.event(LASTTX);
            }
            (Step::Read, Some(chip)) => {
                self.transfers += 1;
                let (pointer, max) = (call.get(RX_PTR), call.get(RX_MAX));
                let mut bytes = vec![0; max as usize];
                chip.read(&mut bytes, now);
                for (at, byte) in (u64::from(pointer)..).zip(bytes) {
                    call.context.write_to(at, Width::W8, byte.into(), DONE);
                }
                call.set(RX_AMOUNT, max);
                call.event(LASTRX);
            }
            _ => {
                self.error |= NO_ANSWER;
                call.event(ERROR);
            }
        }
    }

    fn shortcut(&mut self, event: u16, call: &mut Call<'_, '_>) {
        let shorts = call.get(SHORTS);
        for (bit, cause, task) in SHORTCUTS {
            if cause == event && shorts >> bit & 1 != 0 {
                self.task(task, call);
            }
        }
    }

    fn read(&mut self, offset: u16, _: &mut Call<'_, '_>) -> Option<u32> {
        (offset == ERRORSRC).then_some(self.error)
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        let known = SHORTCUTS
            .iter()
            .fold(0, |known, (bit, ..)| known | 1 << bit);
        call.only_shortcuts(offset, value, known);
        if offset == ERRORSRC {
            self.error &= !value;
        }
        // A transfer under way does not end either.
        if offset == HELD && value != 0 {
            self.step = None;
        }
    }

    fn reset(&mut self) {
        self.step = None;
        self.bytes.clear();
        self.error = 0;
        self.wires = None;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{
        device::{Lsm6dsox, Motion},
        peripheral::bench::Bench,
    };

    fn bench() -> Bench<Twim> {
        let chip = Lsm6dsox::new(Arc::new(Motion::default()), 0);
        let chips: [(u32, Box<dyn Chip>); 1] = [(Lsm6dsox::ADDRESS, Box::new(chip))];
        let mut bench = Bench::new(Twim::new(chips.into()));
        bench.set(ENABLE, 6);
        bench.set(FREQUENCY, 0x0640_0000);
        bench.set(TX_PTR, 0x2000_0100);
        bench.set(TX_MAX, 1);
        bench.set(RX_PTR, 0x2000_0200);
        bench.set(RX_MAX, 2);
        bench.cells.0.insert(0x2000_0100, 0x0f);
        bench
    }

    #[test]
    fn a_register_is_read() {
        let mut bench = bench();
        bench.set(ADDRESS, 0x6a);
        bench.set(SHORTS, 1 << 7 | 1 << 12);
        bench.task(2);
        // Two bytes out and three, of nine bits at 390 kHz, and the stop.
        bench.pass(110 * US);
        assert!(!bench.took(STOPPED));
        bench.pass(40 * US);
        assert!(bench.took(STOPPED) && bench.took(LASTTX) && bench.took(LASTRX));
        assert_eq!(bench.cells.0[&0x2000_0200], 0x6c);
        assert_eq!(bench.cells.0[&0x2000_0201], 0);
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    #[test]
    fn what_a_chip_forbids_is_told() {
        let mut bench = bench();
        bench.set(TX_MAX, 2);
        bench.set(ADDRESS, Lsm6dsox::ADDRESS);
        bench.task(2);
        bench.pass(150 * US);
        assert_eq!(bench.forbidden(), ["ADDRESS"]);
    }

    #[test]
    fn what_is_under_way_goes_on() {
        let mut bench = bench();
        bench.set(ADDRESS, Lsm6dsox::ADDRESS);
        for task in [2, 0] {
            bench.task(task);
            assert_eq!(bench.forbidden(), [""; 0]);
            bench.task(task);
            assert_eq!(bench.forbidden(), ["TASKS_START"]);
            bench.pass(150 * US);
        }
        assert_eq!(bench.chip.model.model.transfers, 2);
        bench.task(8);
        bench.set(SHORTS, 1);
        assert_eq!(bench.forbidden(), ["TASKS", "SHORTS"]);
    }

    #[test]
    fn wires_are_told() {
        let mut bench = bench();
        bench.set(PSEL_SDA, 26);
        bench.set(PSEL_SCL, 27);
        bench.set(ADDRESS, 0x6a);
        bench.task(2);
        bench.pass(150 * US);
        bench.task(2);
        let wires = Wires {
            pins: [26, 27],
            rate: 390_625,
        };
        assert_eq!(bench.chip.model.model.wired, [(0, wires)]);
        assert_eq!(bench.forbidden(), [""; 0]);
        bench.pass(150 * US);
        bench.set(PSEL_SCL, u32::MAX);
        bench.task(2);
        assert_eq!(bench.forbidden(), ["PSEL"]);
    }

    #[test]
    fn nobody_answers() {
        let mut bench = bench();
        bench.set(ADDRESS, 0x1c);
        bench.task(2);
        bench.pass(1_000 * US);
        assert!(bench.took(ERROR) && !bench.took(LASTTX));
        assert_eq!(bench.get(ERRORSRC), NO_ANSWER);
        bench.set(ERRORSRC, NO_ANSWER);
        assert_eq!(bench.get(ERRORSRC), 0);
    }

    #[test]
    fn a_byte_may_be_refused() {
        #[derive(Debug)]
        struct Refuses;

        impl Chip for Refuses {
            fn write(&mut self, _: &[u8], _: u64) -> Result<(), &'static str> {
                Err(NOT_ACKNOWLEDGED)
            }

            fn read(&mut self, _: &mut [u8], _: u64) {}
        }

        let mut bench = bench();
        let chips = &mut bench.chip.model.model.chips;
        chips.insert(Lsm6dsox::ADDRESS, Box::new(Refuses));
        bench.set(ADDRESS, Lsm6dsox::ADDRESS);
        bench.task(2);
        bench.pass(150 * US);
        assert!(bench.took(ERROR) && !bench.took(LASTTX));
        assert_eq!(bench.get(ERRORSRC), REFUSED);
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    #[test]
    fn a_held_bus_ends_nothing() {
        let mut bench = bench();
        bench.set(ADDRESS, 0x6a);
        bench.task(2);
        bench.pass(10 * US);
        bench.set(HELD, 1);
        bench.pass(900 * US);
        bench.task(2);
        bench.pass(900 * US);
        assert!(!bench.took(LASTTX));
        bench.set(HELD, 0);
        bench.task(2);
        bench.pass(900 * US);
        assert!(bench.took(LASTTX));
    }
}
