//! NVMC: writes and erases the flash (Product Specification, "NVMC").

use std::{
    collections::{BTreeMap, VecDeque},
    ops::Range,
};

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, READ, US, rng::draw};

const READY: u16 = 0x400;
const READYNEXT: u16 = 0x408;
const CONFIG: u16 = 0x504;
const ERASEPAGE: u16 = 0x508;
const ICACHECNF: u16 = 0x540;
const PAGE: u64 = 4096;
const BLANK: u32 = 0xffff_ffff;
/// Values of CONFIG.
const WRITING: u32 = 1;
const ERASING: u32 = 2;
/// "NVMC", `t_WRITE` and `t_ERASEPAGE`, at most.
const WRITE_TIME: u64 = 41 * US;
const ERASE_TIME: u64 = 85_000 * US;
/// "NVMC", `n_WRITE`: number of times that a word is written between two erasures.
const WRITES: u8 = 2;

/// Token of the first word of a page that is read; those of the others follow.
const PAGE_READ: u64 = READ + 1;

/// Work under way. Some of its bits are done at once and the others at the end, so that a loss of power in between
/// leaves a torn word or page.
#[derive(Clone, Copy, Debug)]
enum Work {
    Word { address: u64, old: u32, value: u32 },
    Page { address: u64 },
}

/// The processor stands still meanwhile; the thread that runs the chip sees to that, by
/// [`busy_until`](Self::busy_until).
#[derive(Debug, Default)]
pub struct Nvmc {
    ready: u64,
    /// The first is under way, and the others wait for it: one instruction can store several words.
    works: VecDeque<(EventId, Work)>,
    /// Words to be written once the old contents are read, in order.
    wanted: VecDeque<(u64, u32)>,
    /// Number of times that words were written since they were erased; one that is not blank when power comes
    /// counts as written once.
    times: BTreeMap<u64, u8>,
    /// Seed of the bits that a loss of power leaves.
    seed: u64,
    random: u64,
    /// Words written.
    pub words: u64,
    /// Times when pages were erased, and their addresses.
    pub erased: Vec<(u64, u64)>,
    /// Times from begin to end of its writes and erasures: those that a loss of power interrupts are torn.
    pub operations: Vec<Range<u64>>,
    /// UICR was written, which is valid from the next reset on.
    pub has_settings: bool,
    /// Addresses that keep what they hold, though they are written or erased: a fault of the chip.
    pub worn: Option<Range<u64>>,
}

impl Nvmc {
    /// Time until which it stops the processor.
    pub fn busy_until(&self) -> u64 {
        self.ready
    }

    /// The bits that a loss of power leaves come from this seed.
    pub(crate) fn draw_from(&mut self, seed: u64) {
        self.seed = seed;
    }

    fn begin(&mut self, work: Work, time: u64, call: &mut Call<'_, '_>) {
        let start = self.ready.max(call.now());
        self.ready = start + time;
        self.operations.push(start..self.ready);
        let id = call.at(self.ready);
        self.works.push_back((id, work));
        if self.works.len() == 1 {
            self.tear(work, call);
        }
    }

    /// Bits that have changed when power goes in the middle, and others that have not.
    fn bits(&mut self) -> u32 {
        (draw(&mut self.random) >> 32) as u32
    }

    /// Does some of it.
    fn tear(&mut self, work: Work, call: &mut Call<'_, '_>) {
        let (Work::Word { address, .. } | Work::Page { address }) = work;
        self.random = self.seed ^ call.now().rotate_left(24) ^ address;
        match work {
            Work::Word {
                address,
                old,
                value,
            } => {
                let kept = self.bits();
                self.program(address, old & (value | kept), call);
            }
            Work::Page { address } => {
                for word in 0..PAGE / 4 {
                    let token = PAGE_READ + word;
                    call.context
                        .read_from(address + 4 * word, Width::W32, token);
                }
            }
        }
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

    fn erase(&mut self, address: u64, call: &mut Call<'_, '_>) {
        if call.get(CONFIG) & 3 != ERASING {
            call.forbid("CONFIG", "erasing is not enabled (\"NVMC\", EEN)");
            return;
        }
        self.erased.push((call.now(), address));
        self.times.retain(|word, _| word / PAGE != address / PAGE);
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
        match offset {
            // Only the speed of the cache can be seen.
            CONFIG | ERASEPAGE | ICACHECNF => {}
            0x50c..=0x51c => call.forbid(
                "ERASEALL",
                "that is not modelled, nor erasing of UICR or of parts of a page",
            ),
            _ => call.no_register(offset),
        }
    }

    fn store(&mut self, address: u64, value: u32, call: &mut Call<'_, '_>) {
        if call.get(CONFIG) & 3 != WRITING {
            call.forbid("CONFIG", "writing is not enabled (\"NVMC\", WEN)");
            return;
        }
        self.words += 1;
        self.has_settings |= crate::SETTINGS.contains(&address);
        self.wanted.push_back((address, value));
        call.context.read_from(address, Width::W32, READ);
    }

    fn answer(&mut self, token: u64, old: u32, call: &mut Call<'_, '_>) {
        if let Some(word) = token.checked_sub(PAGE_READ) {
            if let Some(&(_, Work::Page { address })) = self.works.front() {
                let erased = self.bits();
                self.program(address + 4 * word, old | erased, call);
            }
            return;
        }
        let Some((address, new)) = self.wanted.pop_front() else {
            return;
        };
        let times = { self.times.entry(address) }.or_insert(u8::from(old != BLANK));
        *times = times.saturating_add(1);
        if *times > WRITES {
            call.forbid(
                "flash",
                "a word is written too often between two erasures (\"NVMC\", n_WRITE)",
            );
        }
        // Bits are only cleared.
        let value = old & new;
        let word = Work::Word {
            address,
            old,
            value,
        };
        self.begin(word, WRITE_TIME, call);
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        let Some((_, work)) = self.works.pop_front_if(|(mine, _)| *mine == id) else {
            return;
        };
        match work {
            Work::Word { address, value, .. } => self.program(address, value, call),
            Work::Page { address } => {
                for word in (address..address + PAGE).step_by(4) {
                    self.program(word, BLANK, call);
                }
            }
        }
        if let Some(&(_, next)) = self.works.front() {
            self.tear(next, call);
        }
    }

    fn reset(&mut self) {
        self.ready = 0;
        self.works.clear();
        self.wanted.clear();
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
        bench.pass(WRITE_TIME);
        assert_eq!(word(&mut bench, 8), 0xf0f0_0f0f);
        bench.set(CONFIG, ERASING);
        bench.set(ERASEPAGE, 0);
        bench.pass(ERASE_TIME - 1);
        assert_eq!(bench.get(READY), 0);
        assert_ne!(word(&mut bench, 8), BLANK);
        bench.pass(1);
        assert_eq!((bench.get(READY), word(&mut bench, 8)), (1, BLANK));
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    /// Some bits are done, not always the same ones, and none that are not to change.
    #[test]
    fn what_power_interrupts_is_torn() {
        let torn = |seed| {
            let mut bench = Bench::new(Nvmc::default());
            bench.chip.model.model.draw_from(seed);
            bench.set(CONFIG, WRITING);
            store(&mut bench, 0x1000, 0xffff);
            let half = word(&mut bench, 0x1000);
            bench.pass(WRITE_TIME);
            assert_eq!(word(&mut bench, 0x1000), 0xffff);
            store(&mut bench, 0x1ffc, 0);
            bench.pass(WRITE_TIME);
            bench.set(CONFIG, ERASING);
            bench.set(ERASEPAGE, 0x1000);
            let halves = [0x1000, 0x1004, 0x1ffc].map(|at| word(&mut bench, at));
            bench.pass(ERASE_TIME);
            assert_eq!(word(&mut bench, 0x1ffc), BLANK);
            assert_eq!(bench.chip.model.model.erased.len(), 1);
            (half, halves)
        };
        let (half, [first, blank, last]) = torn(1);
        assert_eq!(torn(1), (half, [first, blank, last]));
        assert_ne!(torn(2).0, half);
        assert_ne!(torn(2).1, [first, blank, last]);
        for of in [half, first] {
            assert!(of & 0xffff == 0xffff && of != 0xffff && of != BLANK);
        }
        assert!(blank == BLANK && last != BLANK && last != 0);
    }

    /// Writes from before power came count.
    #[test]
    fn what_is_not_blank_has_been_written() {
        let mut bench = Bench::new(Nvmc::default());
        bench.cells.write(4, Width::W32, 0xffff).unwrap();
        bench.set(CONFIG, WRITING);
        for (value, is_told) in [(0xff, false), (0xf, true)] {
            store(&mut bench, 4, value);
            bench.pass(WRITE_TIME);
            assert_eq!(!bench.forbidden().is_empty(), is_told);
        }
        bench.set(CONFIG, ERASING);
        bench.set(ERASEPAGE, 0);
        bench.pass(ERASE_TIME);
        bench.set(CONFIG, WRITING);
        for _ in 0..2 {
            store(&mut bench, 4, 0);
            bench.pass(WRITE_TIME);
        }
        assert_eq!(bench.forbidden(), [""; 0]);
    }

    /// As an instruction does that stores two words.
    #[test]
    fn one_operation_waits_for_the_other() {
        let mut bench = Bench::new(Nvmc::default());
        bench.set(CONFIG, WRITING);
        store(&mut bench, 0, 1);
        store(&mut bench, 4, 2);
        assert_eq!(bench.chip.model.model.busy_until(), 2 * WRITE_TIME);
        assert_eq!(word(&mut bench, 4), BLANK);
        bench.pass(WRITE_TIME);
        assert_eq!((word(&mut bench, 0), bench.get(READY)), (1, 0));
        bench.pass(WRITE_TIME);
        assert_eq!((word(&mut bench, 4), bench.get(READY)), (2, 1));
        let operations = &bench.chip.model.model.operations;
        assert_eq!(operations[0].end, operations[1].start);
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
        for offset in [ICACHECNF, 0x51c, 0x520] {
            bench.set(offset, 1);
        }
        assert_eq!(bench.forbidden(), ["ERASEALL", "registers"]);
        assert_eq!(word(&mut bench, 0), BLANK);
        bench.set(CONFIG, WRITING);
        for _ in 0..3 {
            store(&mut bench, 0, 0);
            bench.pass(WRITE_TIME);
        }
        assert_eq!(bench.forbidden(), ["flash"]);
    }
}
