//! NVMC: writes and erases the flash (Product Specification, "NVMC").

use std::{collections::BTreeMap, ops::Range};

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, READ, US};

const READY: u16 = 0x400;
const READYNEXT: u16 = 0x408;
const CONFIG: u16 = 0x504;
const ERASEPAGE: u16 = 0x508;
const PAGE: u64 = 4096;
const BLANK: u32 = 0xffff_ffff;
/// Values of CONFIG.
const WRITING: u32 = 1;
const ERASING: u32 = 2;
/// "NVMC", `t_WRITE` and `t_ERASEPAGE`, at most.
const WRITE_TIME: u64 = 41 * US;
const ERASE_TIME: u64 = 85_000 * US;
/// "NVMC", `n_WRITE`: how often a word is written between two erasures.
const WRITES: u8 = 2;

/// UICR ("Memory map").
const SETTINGS: Range<u64> = 0x1000_1000..0x1000_2000;

/// What is under way. Half of it is done at once and half at the end, so that a loss of power in between
/// leaves a torn word or page.
#[derive(Clone, Copy, Debug)]
enum Work {
    Word { address: u64, value: u32 },
    Page { address: u64 },
}

/// The processor stands still meanwhile; who runs the chip sees to that, by [`busy_until`](Self::busy_until).
#[derive(Debug, Default)]
pub struct Nvmc {
    ready: u64,
    work: Option<(EventId, Work)>,
    /// Words to be written, by the token of the read of what is there.
    wanted: Option<(u64, u32)>,
    /// How often words were written since they were erased.
    times: BTreeMap<u64, u8>,
    /// Words written.
    pub words: u64,
    /// When pages were erased, and their addresses.
    pub erased: Vec<(u64, u64)>,
    /// From when to when it wrote or erased: what power interrupts then is torn.
    pub operations: Vec<Range<u64>>,
    /// UICR was written, which is valid from the next reset on.
    pub has_settings: bool,
    /// Addresses that keep what they hold, whatever is written or erased: a fault of the chip.
    pub worn: Option<Range<u64>>,
}

impl Nvmc {
    /// Until when it stops the processor.
    pub fn busy_until(&self) -> u64 {
        self.ready
    }

    fn begin(&mut self, work: Work, time: u64, call: &mut Call<'_, '_>) {
        self.ready = call.now() + time;
        self.operations.push(call.now()..self.ready);
        let id = call.at(self.ready);
        self.work = Some((id, work));
    }

    fn program(&self, address: u64, value: u32, call: &mut Call<'_, '_>) {
        if !self
            .worn
            .as_ref()
            .is_some_and(|worn| worn.contains(&address))
        {
            call.context
                .program(address, Width::W32, value.into(), DONE);
        }
    }

    fn fill(&self, call: &mut Call<'_, '_>, words: impl Iterator<Item = u64>) {
        for address in words {
            self.program(address, BLANK, call);
        }
    }

    fn erase(&mut self, address: u64, call: &mut Call<'_, '_>) {
        if call.get(CONFIG) & 3 != ERASING {
            call.forbid("CONFIG", "erasing is not enabled (\"NVMC\", EEN)");
            return;
        }
        self.erased.push((call.now(), address));
        self.times.retain(|word, _| word / PAGE != address / PAGE);
        self.fill(call, (address..address + PAGE / 2).step_by(4));
        self.begin(Work::Page { address }, ERASE_TIME, call);
    }
}

impl Model for Nvmc {
    fn read(&mut self, offset: u16, call: &mut Call<'_, '_>) -> Option<u32> {
        let is_ready = call.now() >= self.ready;
        matches!(offset, READY | READYNEXT).then(|| is_ready.into())
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        if offset == CONFIG && value & 3 == 3 {
            call.forbid(
                "CONFIG",
                "writing and erasing are not enabled at once (\"NVMC\")",
            );
        }
        if offset == ERASEPAGE {
            self.erase(u64::from(value) & !(PAGE - 1), call);
        }
        if matches!(offset, 0x50c | 0x514 | 0x518) {
            call.forbid(
                "ERASEALL",
                "that is not modelled, nor erasing of UICR or of parts of a page",
            );
        }
    }

    fn store(&mut self, address: u64, value: u32, call: &mut Call<'_, '_>) {
        if call.get(CONFIG) & 3 != WRITING {
            call.forbid("CONFIG", "writing is not enabled (\"NVMC\", WEN)");
            return;
        }
        let times = self.times.entry(address).or_default();
        *times = times.saturating_add(1);
        if *times > WRITES {
            call.forbid(
                "flash",
                "a word is written too often between two erasures (\"NVMC\", n_WRITE)",
            );
        }
        self.words += 1;
        self.has_settings |= SETTINGS.contains(&address);
        self.wanted = Some((address, value));
        call.context.read_from(address, Width::W32, READ);
    }

    fn answer(&mut self, _: u64, old: u32, call: &mut Call<'_, '_>) {
        let Some((address, new)) = self.wanted.take() else {
            return;
        };
        // Bits are only cleared.
        let value = old & new;
        let half = old & (value | 0xffff_0000);
        self.program(address, half, call);
        self.begin(Work::Word { address, value }, WRITE_TIME, call);
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        let Some((_, work)) = self.work.take_if(|(mine, _)| *mine == id) else {
            return;
        };
        match work {
            Work::Word { address, value } => self.program(address, value, call),
            Work::Page { address } => {
                self.fill(call, (address + PAGE / 2..address + PAGE).step_by(4));
            }
        }
    }

    fn reset(&mut self) {
        self.ready = 0;
        self.work = None;
        self.wanted = None;
    }
}

#[cfg(test)]
mod tests {
    use rigless::{emulator::Memory, mcu::Operate, time::VirtualNanos};

    use super::*;
    use crate::peripheral::bench::Bench;

    fn store(bench: &mut Bench<Nvmc>, address: u64, value: u32) {
        let at = VirtualNanos(bench.now);
        bench
            .chip
            .write(at, address, Width::W32, value.into())
            .unwrap();
        bench.settle();
    }

    fn word(bench: &mut Bench<Nvmc>, address: u64) -> u32 {
        bench.cells.read(address, Width::W32).unwrap() as u32
    }

    #[test]
    fn bits_are_cleared_until_the_page_is_erased() {
        let mut bench = Bench::new(Nvmc::default());
        bench.set(CONFIG, WRITING);
        store(&mut bench, 8, 0xf0f0_ffff);
        assert_eq!(bench.get(READY), 0);
        bench.pass(WRITE_TIME);
        assert_eq!(bench.get(READY), 1);
        store(&mut bench, 8, 0xffff_0f0f);
        // Half of it, until it is over.
        assert_eq!(word(&mut bench, 8), 0xf0f0_0f0f);
        bench.pass(WRITE_TIME);
        assert_eq!(word(&mut bench, 8), 0xf0f0_0f0f);
        bench.set(CONFIG, ERASING);
        bench.set(ERASEPAGE, 0);
        bench.pass(ERASE_TIME - 1);
        assert_eq!((bench.get(READY), word(&mut bench, 8)), (0, BLANK));
        bench.pass(1);
        assert_eq!(bench.get(READY), 1);
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    #[test]
    fn what_power_interrupts_is_torn() {
        let mut bench = Bench::new(Nvmc::default());
        bench.set(CONFIG, WRITING);
        store(&mut bench, 0x1000, 0);
        assert_eq!(word(&mut bench, 0x1000), 0xffff_0000);
        bench.pass(WRITE_TIME);
        assert_eq!(word(&mut bench, 0x1000), 0);
        store(&mut bench, 0x1ffc, 0);
        bench.pass(WRITE_TIME);
        bench.set(CONFIG, ERASING);
        bench.set(ERASEPAGE, 0x1000);
        assert_eq!(
            (word(&mut bench, 0x1000), word(&mut bench, 0x1ffc)),
            (BLANK, 0)
        );
        bench.pass(ERASE_TIME);
        assert_eq!(word(&mut bench, 0x1ffc), BLANK);
        assert_eq!(bench.chip.model.model.erased.len(), 1);
    }

    #[test]
    fn what_is_worn_keeps_what_it_holds() {
        let mut bench = Bench::new(Nvmc {
            worn: Some(8..0x1000),
            ..Nvmc::default()
        });
        bench.set(CONFIG, WRITING);
        for address in [4, 8] {
            store(&mut bench, address, 1);
            assert_eq!(bench.get(READY), 0);
            bench.pass(WRITE_TIME);
        }
        assert_eq!((word(&mut bench, 4), word(&mut bench, 8)), (1, BLANK));
        assert_eq!(bench.chip.model.model.operations.len(), 2);
    }

    #[test]
    fn what_is_not_enabled_is_told_and_not_done() {
        let mut bench = Bench::new(Nvmc::default());
        store(&mut bench, 0, 0);
        bench.set(ERASEPAGE, 0);
        assert_eq!(bench.forbidden(), ["CONFIG", "CONFIG"]);
        assert_eq!(word(&mut bench, 0), BLANK);
        bench.set(CONFIG, WRITING);
        for _ in 0..3 {
            store(&mut bench, 0, 0);
            bench.pass(WRITE_TIME);
        }
        assert_eq!(bench.forbidden(), ["flash"]);
    }
}
