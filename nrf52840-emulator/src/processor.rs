//! Processors that keep what they have translated.
//!
//! Translating the program takes most of the time that a short run takes, and the processor of `rigless`
//! drops all of it at each reset, and with each run. One of these is kept: over resets, because what a
//! reset changes is not code, and for the next chip with the same program, which maps its own memory.

#![expect(unsafe_code, reason = "what processors map is told by raw pointers")]

use std::{
    collections::BTreeMap,
    hash::{DefaultHasher, Hash, Hasher},
    ops::Range,
    sync::{Arc, Mutex, PoisonError},
};

use rigless::{
    emulator::{
        BitAlias, CoreBus, DataModel, Error, Exit, HaltReason, HostCall, Processor,
        ProcessorConstructor, Queued,
    },
    soc::{Endian, Width},
    time::VirtualNanos,
};

/// What is translated: two of these are equal where the code in the flash is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Program {
    hash: u64,
    length: usize,
    /// Where nobody writes while it runs.
    addresses: Range<u64>,
}

impl Program {
    /// What was put into these addresses: pieces, in this order.
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
}

/// Those that no chip has.
static SPARE: Mutex<BTreeMap<(u64, usize), Vec<Spare>>> = Mutex::new(BTreeMap::new());

/// A processor without a chip.
struct Spare {
    // Dropped before what it maps.
    processor: Box<dyn Processor>,
    /// State after a reset, if it can be put back.
    fresh: Option<Vec<u8>>,
    nowhere: Nowhere,
}

/// What is mapped where there is no chip: never read nor written.
struct Nowhere(#[expect(dead_code, reason = "pointers lead there")] Vec<Vec<u8>>);

impl Nowhere {
    /// Leads all pointers of a processor here.
    fn map(processor: &mut dyn Processor, regions: &[(u64, u64)]) -> Self {
        let page = processor.page_size() as usize;
        let map = |&(start, length): &(u64, u64)| {
            let mut bytes = vec![0; length as usize + page];
            let offset = bytes.as_ptr().align_offset(page);
            let host = bytes[offset..][..length as usize].as_mut_ptr();
            // SAFETY: these are whole pages, as they were when the chip mapped them, and `host` is aligned
            // to one. The bytes stay where they are, unborrowed, while `Nowhere` lives, which the
            // processor's owner drops after the processor or its next call of this.
            unsafe { processor.map(start, length, host, true) };
            bytes
        };
        Self(regions.iter().map(map).collect())
    }
}

/// Makes processors that know this program already if one did before.
pub(crate) fn constructor(made: ProcessorConstructor, program: Program) -> ProcessorConstructor {
    Arc::new(move |endian| {
        let mut spares = SPARE.lock().unwrap_or_else(PoisonError::into_inner);
        let spare = spares.get_mut(&program.key()).and_then(Vec::pop);
        drop(spares);
        let spare = match spare {
            Some(spare) => spare,
            None => {
                let mut processor = made(endian)?;
                let fresh = fresh(processor.as_mut());
                Spare {
                    processor,
                    fresh,
                    nowhere: Nowhere(Vec::new()),
                }
            }
        };
        Ok(Box::new(Kept {
            spare: Some(spare),
            program: program.clone(),
            regions: Vec::new(),
            has_run: false,
            is_changed: false,
            has_debugger: false,
        }))
    })
}

/// The state after a reset, if a number of instructions can be put at its end: with another state than a
/// reset leaves there would be another run.
fn fresh(processor: &mut dyn Processor) -> Option<Vec<u8>> {
    const TRIED: u64 = 123_456_789;
    let fresh = processor.save();
    let can_load = processor.load(&after(&fresh, TRIED)?).is_ok() && processor.retired() == TRIED;
    let is_back = processor.load(&fresh).is_ok() && processor.save() == fresh;
    (can_load && is_back).then_some(fresh)
}

/// A state with so many instructions behind it. They are at its end, lower parts of seven bits first
/// (`Processor::save` of `rigless` 0.4, and the format of `postcard`).
fn after(fresh: &[u8], mut instructions: u64) -> Option<Vec<u8>> {
    let (0, state) = fresh.split_last()? else {
        return None;
    };
    let mut state = state.to_vec();
    while instructions >= 0x80 {
        state.push(instructions as u8 | 0x80);
        instructions >>= 7;
    }
    state.push(instructions as u8);
    Some(state)
}

/// The processor of a chip.
struct Kept {
    /// Always there until it is dropped.
    spare: Option<Spare>,
    program: Program,
    regions: Vec<(u64, u64)>,
    /// Until then what is put into memory is what was translated.
    has_run: bool,
    /// The program is not what it was.
    is_changed: bool,
    has_debugger: bool,
}

impl std::fmt::Debug for Kept {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.get().fmt(formatter)
    }
}

impl Kept {
    fn get(&self) -> &dyn Processor {
        let spare = self.spare.as_ref().expect("there until it is dropped");
        spare.processor.as_ref()
    }

    fn get_mut(&mut self) -> &mut dyn Processor {
        let spare = self.spare.as_mut().expect("there until it is dropped");
        spare.processor.as_mut()
    }

    /// Puts the state of a reset back, if that can be done.
    fn refresh(&mut self) -> Option<()> {
        let spare = self.spare.as_mut()?;
        let retired = spare.processor.retired();
        let state = after(spare.fresh.as_ref()?, retired)?;
        spare.processor.take_reset_request();
        spare.processor.load(&state).ok()
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        let Some(mut spare) = self.spare.take() else {
            return;
        };
        if self.is_changed || self.has_debugger || std::thread::panicking() {
            return;
        }
        let processor = spare.processor.as_mut();
        for other in [
            0..self.program.addresses.start,
            self.program.addresses.end..u64::MAX,
        ] {
            processor.ask(Queued::Invalidate(other.start, other.end));
        }
        let is_fresh = spare
            .fresh
            .as_ref()
            .is_some_and(|fresh| processor.load(fresh).is_ok());
        if is_fresh {
            processor.take_reset_request();
            spare.nowhere = Nowhere::map(processor, &self.regions);
            let mut spares = SPARE.lock().unwrap_or_else(PoisonError::into_inner);
            spares.entry(self.program.key()).or_default().push(spare);
        }
    }
}

impl Processor for Kept {
    fn run(&mut self, budget: u32, bus: &mut dyn CoreBus) -> (Exit, u64) {
        self.has_run = true;
        self.get_mut().run(budget, bus)
    }

    fn ask(&mut self, queued: Queued) {
        if let Queued::Invalidate(from, to) = queued {
            let program = &self.program.addresses;
            if !self.has_run && program.start <= from && to <= program.end {
                return;
            }
            self.is_changed |= from < program.end && program.start < to;
        }
        self.get_mut().ask(queued);
    }

    unsafe fn map(&mut self, start: u64, length: u64, host: *mut u8, writable: bool) {
        self.regions.push((start, length));
        // SAFETY: the caller's promise is the one that this asks for. It ends when this is dropped, which
        // leads all pointers elsewhere.
        unsafe { self.get_mut().map(start, length, host, writable) };
    }

    fn reset(&mut self) {
        // A debugger may want to stop there.
        if self.has_debugger || self.refresh().is_none() {
            self.get_mut().reset();
        }
    }

    fn attach_debugger(&mut self, attached: bool) {
        self.has_debugger |= attached;
        self.get_mut().attach_debugger(attached);
    }

    fn retired(&self) -> u64 {
        self.get().retired()
    }

    fn maps(&self, start: u64, length: u64) -> bool {
        self.get().maps(start, length)
    }

    fn page_size(&self) -> u64 {
        self.get().page_size()
    }

    fn boot(&mut self, table: u64, read: &dyn Fn(u64, Width) -> Option<u64>) {
        self.get_mut().boot(table, read);
    }

    fn take_reset_request(&mut self) -> bool {
        self.get_mut().take_reset_request()
    }

    fn next_event(&self) -> Option<VirtualNanos> {
        self.get().next_event()
    }

    fn on_event(&mut self, now: VirtualNanos) {
        self.get_mut().on_event(now);
    }

    fn waiting(&self) -> bool {
        self.get().waiting()
    }

    fn pc(&self) -> u64 {
        self.get().pc()
    }

    fn add_breakpoint(&mut self, address: u64) -> bool {
        self.is_changed = true;
        self.get_mut().add_breakpoint(address)
    }

    fn remove_breakpoint(&mut self, address: u64) {
        self.get_mut().remove_breakpoint(address);
    }

    fn pass_breakpoint(&mut self, address: u64) {
        self.get_mut().pass_breakpoint(address);
    }

    fn hold_interrupts(&mut self, held: bool) {
        self.get_mut().hold_interrupts(held);
    }

    fn gdb_register(&self, number: usize) -> Option<Vec<u8>> {
        self.get().gdb_register(number)
    }

    fn set_gdb_register(&mut self, number: usize, bytes: &[u8]) -> bool {
        self.get_mut().set_gdb_register(number, bytes)
    }

    fn debugger_access(
        &mut self,
        write: Option<u64>,
        address: u64,
        width: Width,
        now: VirtualNanos,
    ) -> Option<u64> {
        self.get_mut().debugger_access(write, address, width, now)
    }

    fn take_debugger_trace(&mut self) -> Vec<u8> {
        self.get_mut().take_debugger_trace()
    }

    fn target_xml(&self) -> &'static str {
        self.get().target_xml()
    }

    fn data_model(&self) -> DataModel {
        self.get().data_model()
    }

    fn byte_order(&self, address: u64) -> Endian {
        self.get().byte_order(address)
    }

    fn save(&self) -> Vec<u8> {
        self.get().save()
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.get_mut().load(bytes)
    }

    fn monitor_command(&mut self, command: &str) -> Option<String> {
        self.get_mut().monitor_command(command)
    }

    fn debugger_halted(&mut self, why: HaltReason) -> bool {
        self.get_mut().debugger_halted(why)
    }

    fn bit_alias(&self, address: u64, width: Width) -> Option<BitAlias> {
        self.get().bit_alias(address, width)
    }

    fn own_ranges(&self) -> Vec<Range<u64>> {
        self.get().own_ranges()
    }

    fn check_reads(&mut self, every: bool) {
        self.get_mut().check_reads(every);
    }

    fn check_words(&mut self, words: &[u64]) {
        self.get_mut().check_words(words);
    }

    fn host_call(&self, read: &mut dyn FnMut(u64, Width) -> Option<u64>) -> Option<HostCall> {
        self.get().host_call(read)
    }

    fn answer_host_call(&mut self, answer: Option<u64>) {
        self.get_mut().answer_host_call(answer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_are_told_apart() {
        let of = |pieces: &[&'static [u8]]| Program::new(pieces.iter().copied(), 0..8);
        assert_eq!(of(&[b"ab", b"c"]), of(&[b"ab", b"c"]));
        assert_ne!(of(&[b"ab", b"c"]), of(&[b"a", b"bc"]));
        assert_ne!(of(&[b"ab"]), of(&[b"ac"]));
    }

    #[test]
    fn instructions_are_put_at_the_end_of_a_state() {
        assert_eq!(after(&[7, 0], 0), Some(vec![7, 0]));
        assert_eq!(after(&[7, 0], 300), Some(vec![7, 0xac, 2]));
        assert_eq!(after(&[7, 1], 300), None);
        assert_eq!(after(&[], 300), None);
    }
}
