//! Processors that keep what they have translated, and do the work of several chips.
//!
//! Translating the program takes most of the time that a run takes, and the processor of `rigless` has a
//! translation of its own, drops it at each reset, and is dropped with each run. So chips with the same program
//! share a few processors, as many as can run at once: a chip that [runs](Seat) takes one, with its registers and
//! its memory in it, and leaves it when it waits. A reset puts registers back and leaves the translation, for it
//! changes no code.
//!
//! A chip that changes its program, or has a debugger, keeps its processor for itself from then on.

#![expect(unsafe_code, reason = "what processors map is told by raw pointers")]

mod memory;
mod pool;

use std::{
    hash::{DefaultHasher, Hash, Hasher},
    ops::Range,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use rigless::{
    emulator::{
        Access, BitAlias, Checked, CoreBus, DataModel, Error, Exit, HaltReason, HostCall,
        InterruptLine, Processor, ProcessorConstructor, Queued,
    },
    soc::{Endian, Width},
    time::VirtualNanos,
};

use self::{memory::Region, pool::Seat};

/// A translated program: two of these are equal where the code in the flash is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Program {
    hash: u64,
    length: usize,
    /// Addresses where nothing writes while it runs.
    addresses: Range<u64>,
}

impl Program {
    /// Contents that were put into these addresses: pieces, in this order.
    pub(crate) fn new<'a>(
        pieces: impl IntoIterator<Item = &'a [u8]>,
        addresses: Range<u64>,
    ) -> Self {
        let (mut hasher, mut length) = (DefaultHasher::new(), 0);
        for piece in pieces {
            piece.hash(&mut hasher);
            length += piece.len();
        }
        Self {
            hash: hasher.finish(),
            length,
            addresses,
        }
    }

    fn key(&self) -> (u64, usize) {
        (self.hash, self.length)
    }

    /// Returns true if a part of it may have changed.
    fn is_touched(&self, queued: &Queued) -> bool {
        let Queued::Invalidate(from, to) = *queued else {
            return false;
        };
        from < self.addresses.end && self.addresses.start < to
    }
}

/// A chip's processor for the thread that runs the chip, to be left while that thread waits.
#[derive(Clone, Default)]
pub(crate) struct Lease(Arc<Mutex<Option<Seat>>>);

impl std::fmt::Debug for Lease {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Lease").finish_non_exhaustive()
    }
}

impl Lease {
    fn lock(&self) -> MutexGuard<'_, Option<Seat>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Leaves the processor to other chips, unless it runs.
    pub(crate) fn leave(&self) {
        if let Ok(mut seat) = self.0.try_lock()
            && let Some(seat) = seat.as_mut()
        {
            seat.stand_up();
        }
    }
}

/// Makes processors that know this program already if one did before. One that locks up asks for a reset,
/// unless it has a debugger, and says so (Product Specification, "Reset").
pub(crate) fn constructor(
    made: ProcessorConstructor,
    program: Program,
    lease: Lease,
    lockup: Arc<AtomicBool>,
) -> ProcessorConstructor {
    Arc::new(move |endian| {
        let seat = Seat::new(&program, &made, endian)?;
        *lease.lock() = Some(seat);
        Ok(Box::new(Shared {
            lease: lease.clone(),
            program: program.clone(),
            lockup: lockup.clone(),
            asks_for_reset: false,
            has_run: false,
            has_debugger: false,
        }))
    })
}

/// The processor of a chip.
#[derive(Debug)]
struct Shared {
    /// Has a seat until this is dropped.
    lease: Lease,
    program: Program,
    /// It has locked up, for the model that resets the chip.
    lockup: Arc<AtomicBool>,
    asks_for_reset: bool,
    /// True once it has run; until then all that is put into memory is what was translated.
    has_run: bool,
    has_debugger: bool,
}

impl Shared {
    fn with<T>(&self, work: impl FnOnce(&mut dyn Processor) -> T) -> T {
        let mut seat = self.lease.lock();
        work(seat.as_mut().expect("a seat").processor())
    }

    fn keep_alone(&self) {
        if let Some(seat) = self.lease.lock().as_mut() {
            seat.keep_alone();
        }
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        self.lease.lock().take();
    }
}

/// Returns true for addresses where nothing answers, so that an access is a bus fault (Product Specification,
/// "Memory map"): neither code, nor data, nor a peripheral, nor the processor's own.
fn is_nowhere(address: u64) -> bool {
    const SOMETHING: [Range<u64>; 6] = [
        0..0x10_0000,
        // Code RAM.
        0x80_0000..0x84_0000,
        0x1000_0000..0x1000_2000,
        0x2000_0000..0x2004_0000,
        0x4000_0000..0x6000_0000,
        0xe000_0000..0x1_0000_0000,
    ];
    !SOMETHING.iter().any(|range| range.contains(&address))
}

/// A bus on which writing to the program is noticed, and which fails where nothing is.
struct Watched<'a> {
    bus: &'a mut dyn CoreBus,
    program: &'a Program,
    is_changed: bool,
}

impl CoreBus for Watched<'_> {
    fn queued(&mut self) -> Vec<Queued> {
        let queued = self.bus.queued();
        self.is_changed |= queued.iter().any(|queued| self.program.is_touched(queued));
        queued
    }

    fn access(&mut self, access: Access, from_code: bool) -> Option<u64> {
        let is_nowhere = is_nowhere(access.address);
        // Told there, which answers something.
        let answer = self.bus.access(access, from_code);
        answer.filter(|_| !is_nowhere)
    }

    fn time(&self, instructions: u64) -> VirtualNanos {
        self.bus.time(instructions)
    }

    fn carry_on(&mut self, instructions: u64, event: Option<VirtualNanos>) -> Option<u32> {
        self.bus.carry_on(instructions, event)
    }

    fn acknowledge(&mut self, line: InterruptLine, instructions: u64) -> Option<u64> {
        self.bus.acknowledge(line, instructions)
    }

    fn read_checked(&mut self, access: Access, report: bool) -> Option<Checked> {
        self.bus.read_checked(access, report)
    }

    fn write_checked(&mut self, access: Access) -> Option<bool> {
        self.bus.write_checked(access)
    }

    fn stops_before(&mut self, access: &Access) -> bool {
        self.bus.stops_before(access)
    }

    fn send_trace(&mut self, bytes: &[u8]) {
        self.bus.send_trace(bytes);
    }
}

impl Processor for Shared {
    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        self.has_run = true;
        let mut seat = self.lease.lock();
        let seat = seat.as_mut().expect("a seat");
        let mut bus = Watched {
            bus,
            program: &self.program,
            is_changed: false,
        };
        let ran = seat.processor().run(budget, &mut bus);
        if bus.is_changed {
            seat.keep_alone();
        }
        if ran.0 == Exit::Lockup && !self.has_debugger {
            self.lockup.store(true, Ordering::Relaxed);
            self.asks_for_reset = true;
        }
        ran
    }

    fn ask(&mut self, queued: Queued) {
        let is_other = match queued {
            Queued::Invalidate(..) => self.program.is_touched(&queued),
            Queued::Route(_) | Queued::Unroute(_) => true,
            _ => false,
        };
        if is_other && matches!(queued, Queued::Invalidate(..)) && !self.has_run {
            return;
        }
        if is_other {
            self.keep_alone();
        }
        self.with(|processor| processor.ask(queued));
    }

    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        let region = Region {
            start,
            length,
            is_writable: writable,
        };
        if let Some(seat) = self.lease.lock().as_mut() {
            // SAFETY: the caller's promise is the one that this asks for. It ends when this is dropped, and the
            // seat with it.
            unsafe { seat.map(region, host) };
        }
    }

    fn reset(&mut self) {
        // A debugger may want to stop there.
        let is_fresh = !self.has_debugger
            && (self.lease.lock().as_mut()).is_some_and(|seat| seat.refresh().is_some());
        if !is_fresh {
            self.with(|processor| processor.reset());
        }
    }

    fn attach_debugger(&mut self, attached: bool) {
        if attached {
            self.has_debugger = true;
            self.keep_alone();
        }
        self.with(|processor| processor.attach_debugger(attached));
    }

    fn retired(&self) -> u64 {
        self.with(|processor| processor.retired())
    }

    fn maps(&self, start: u64, length: u64) -> bool {
        self.with(|processor| processor.maps(start, length))
    }

    fn page_size(&self) -> u64 {
        self.with(|processor| processor.page_size())
    }

    fn boot(&mut self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>) {
        self.with(|processor| processor.boot(table, read));
    }

    fn take_reset_request(&mut self) -> bool {
        let is_asked_for = self.with(|processor| processor.take_reset_request());
        std::mem::take(&mut self.asks_for_reset) || is_asked_for
    }

    fn next_event(&self) -> Option<VirtualNanos> {
        self.with(|processor| processor.next_event())
    }

    fn on_event(&mut self, now: VirtualNanos) {
        self.with(|processor| processor.on_event(now));
    }

    fn waiting(&self) -> bool {
        self.with(|processor| processor.waiting())
    }

    fn pc(&self) -> u64 {
        self.with(|processor| processor.pc())
    }

    fn add_breakpoint(&mut self, address: u64) -> bool {
        self.keep_alone();
        self.with(|processor| processor.add_breakpoint(address))
    }

    fn remove_breakpoint(&mut self, address: u64) {
        self.with(|processor| processor.remove_breakpoint(address));
    }

    fn pass_breakpoint(&mut self, address: u64) {
        self.with(|processor| processor.pass_breakpoint(address));
    }

    fn hold_interrupts(&mut self, held: bool) {
        self.with(|processor| processor.hold_interrupts(held));
    }

    fn gdb_register(&self, number: usize) -> Option<Vec<u8>> {
        self.with(|processor| processor.gdb_register(number))
    }

    fn set_gdb_register(&mut self, number: usize, bytes: &[u8]) -> bool {
        self.with(|processor| processor.set_gdb_register(number, bytes))
    }

    fn debugger_access(
        &mut self,
        write: Option<u64>,
        address: u64,
        width: Width,
        now: VirtualNanos,
    ) -> Option<u64> {
        self.with(|processor| processor.debugger_access(write, address, width, now))
    }

    fn take_debugger_trace(&mut self) -> Vec<u8> {
        self.with(|processor| processor.take_debugger_trace())
    }

    fn target_xml(&self) -> &'static str {
        self.with(|processor| processor.target_xml())
    }

    fn data_model(&self) -> DataModel {
        self.with(|processor| processor.data_model())
    }

    fn byte_order(&self, address: u64) -> Endian {
        self.with(|processor| processor.byte_order(address))
    }

    fn save(&self) -> Vec<u8> {
        self.with(|processor| processor.save())
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.with(|processor| processor.load(bytes))
    }

    fn monitor_command(&mut self, command: &str) -> Option<String> {
        self.with(|processor| processor.monitor_command(command))
    }

    fn debugger_halted(&mut self, why: HaltReason) -> bool {
        self.with(|processor| processor.debugger_halted(why))
    }

    fn bit_alias(&self, address: u64, width: Width) -> Option<BitAlias> {
        self.with(|processor| processor.bit_alias(address, width))
    }

    fn own_ranges(&self) -> Vec<Range<u64>> {
        self.with(|processor| processor.own_ranges())
    }

    fn check_reads(&mut self, every: bool) {
        self.with(|processor| processor.check_reads(every));
    }

    fn check_words(&mut self, words: &[u64]) {
        self.with(|processor| processor.check_words(words));
    }

    fn host_call(&self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall> {
        self.with(|processor| processor.host_call(read))
    }

    fn answer_host_call(&mut self, answer: Option<u64>) {
        self.with(|processor| processor.answer_host_call(answer));
    }
}

#[cfg(test)]
mod tests {
    use std::{alloc::Layout, collections::BTreeMap};

    use rigless::machine::Board as _;

    use super::*;
    use crate::soc::{Board, RAM, Soc};

    #[test]
    fn programs_are_told_apart() {
        let of = |pieces: &[&'static [u8]]| Program::new(pieces.iter().copied(), 0..8);
        assert_eq!(of(&[b"ab", b"c"]), of(&[b"ab", b"c"]));
        assert_ne!(of(&[b"ab", b"c"]), of(&[b"a", b"bc"]));
        assert_ne!(of(&[b"ab"]), of(&[b"ac"]));
    }

    /// Adds the word at the start of RAM to r2 again and again, and keeps the sum behind it:
    /// `ldr r1, [r0]`, `add r2, r1`, `str r2, [r0, #4]`, `b`.
    const PROGRAM: [u16; 4] = [0x6801, 0x440a, 0x6042, 0xe7fb];
    /// `sub r2, r1` (`subs`) in its place.
    const SUBTRACT: u16 = 0x1a52;
    const SIZE: usize = 4096;
    /// Its number for GDB.
    const XPSR: usize = 16;

    /// Nothing is on it.
    struct Bus;

    impl CoreBus for Bus {
        fn access(&mut self, _: Access, _: bool) -> Option<u64> {
            None
        }

        fn time(&self, instructions: u64) -> VirtualNanos {
            VirtualNanos(instructions)
        }

        fn queued(&mut self) -> Vec<Queued> {
            Vec::new()
        }
    }

    /// A processor with memory of its own.
    struct Chip {
        processor: Box<dyn Processor>,
        lease: Lease,
        /// Program and data: whole pages.
        memory: [*mut u8; 2],
    }

    impl Chip {
        fn new(step: u32) -> Self {
            let lease = Lease::default();
            let mut board = Board {
                soc: Soc::new(0, None, None, BTreeMap::new()).unwrap(),
                program: Program::new([b"a test".as_slice()], 0..SIZE as u64),
                processor: lease.clone(),
            };
            let make = board.targets()[0].core.processor.clone();
            let mut processor = make(Endian::Little).unwrap();
            let layout = Layout::from_size_align(SIZE, SIZE).unwrap();
            // SAFETY: the length is not 0.
            let memory = [(); 2].map(|()| unsafe { std::alloc::alloc_zeroed(layout) });
            for (place, start) in memory.into_iter().zip([0, RAM.0]) {
                // SAFETY: whole pages, which live longer than the processor.
                unsafe { processor.map(start, SIZE as u64, place, start > 0) };
            }
            let mut chip = Self {
                processor,
                lease,
                memory,
            };
            for (at, half) in PROGRAM.iter().enumerate() {
                chip.write(0, 2 * at, &half.to_le_bytes());
            }
            chip.write(1, 0, &step.to_le_bytes());
            for (register, value) in [(0, RAM.0 as u32), (15, 0), (XPSR, 1 << 24)] {
                // The bit of XPSR that says that it is Thumb code.
                let bytes = value.to_le_bytes();
                assert!(
                    chip.processor.set_gdb_register(register, &bytes),
                    "{register}"
                );
            }
            chip.lease.leave();
            chip
        }

        fn write(&mut self, place: usize, at: usize, bytes: &[u8]) {
            // SAFETY: its own pages, where nothing runs now.
            unsafe {
                self.memory[place]
                    .add(at)
                    .copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
            }
        }

        /// Goes on by so many rounds of the program: what is kept then.
        fn run(&mut self, rounds: u32) -> u32 {
            let (_, ran) = self.processor.run(4 * rounds, &mut Bus);
            assert_eq!(ran, u64::from(4 * rounds));
            self.lease.leave();
            // SAFETY: its own pages, where nothing runs now.
            unsafe { self.memory[1].cast::<u32>().add(1).read() }
        }
    }

    impl Drop for Chip {
        fn drop(&mut self) {
            self.lease.lock().take();
            let layout = Layout::from_size_align(SIZE, SIZE).unwrap();
            for place in self.memory {
                // SAFETY: allocated so, and the processor has let it go.
                unsafe { std::alloc::dealloc(place, layout) };
            }
        }
    }

    /// They share a processor and see nothing of each other, also where one has rewritten its program.
    #[test]
    fn chips_in_turn_have_their_own_registers_memory_and_changes() {
        let mut chips = [1, 10].map(Chip::new);
        for round in 1..500 {
            assert_eq!(chips[0].run(1), round);
            assert_eq!(chips[1].run(1), 10 * round);
        }
        assert_eq!(chips[0].processor.retired(), 4 * 499);
        chips[0].write(0, 2, &SUBTRACT.to_le_bytes());
        chips[0].processor.ask(Queued::Invalidate(2, 4));
        chips[0].lease.leave();
        for round in 1..400 {
            assert_eq!(chips[0].run(1), 499 - round);
            assert_eq!(chips[1].run(1), 4990 + 10 * round);
        }
        chips[1].processor.reset();
        assert_eq!(chips[1].processor.retired(), 4 * (499 + 399));
        chips[1].lease.leave();
        let third = &mut Chip::new(7);
        assert_eq!(third.run(3), 21);
    }
}
