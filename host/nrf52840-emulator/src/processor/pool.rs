//! Processors that several chips with the same program use in turn.

use std::{
    collections::BTreeMap,
    mem,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    thread,
};

use rigless::{
    emulator::{Error, Processor, ProcessorConstructor, Queued},
    soc::Endian,
};

use crate::one_cpu::OneCpu;

use super::{
    Program,
    memory::{Memory, Region, Window},
};

/// A processor that no chip uses, or the one that uses it.
struct Core {
    // Dropped before what it looks into.
    processor: Box<dyn Processor>,
    window: Option<Window>,
    /// Its state after a reset, if that can be put back.
    fresh: Option<Vec<u8>>,
    /// The chip whose state it has, and the one whose memory it sees.
    is_in: Option<u64>,
    sees: Option<u64>,
}

/// The processors that know a program.
struct Pool {
    make: ProcessorConstructor,
    endian: Endian,
    state: Mutex<State>,
    /// Rings when one has become free, or may be made.
    bell: Condvar,
}

#[derive(Default)]
struct State {
    /// The one that has been free longest first.
    free: Vec<Core>,
    /// Those and the ones in use.
    count: usize,
}

static POOLS: Mutex<BTreeMap<(u64, usize), Arc<Pool>>> = Mutex::new(BTreeMap::new());
static CHIPS: AtomicU64 = AtomicU64::new(0);

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pool {
    fn of(program: &Program, make: &ProcessorConstructor, endian: Endian) -> Arc<Self> {
        let pool = || {
            Arc::new(Self {
                make: make.clone(),
                endian,
                state: Mutex::default(),
                bell: Condvar::new(),
            })
        };
        lock(&POOLS)
            .entry(program.key())
            .or_insert_with(pool)
            .clone()
    }

    /// Waits for one, best the one that this chip had last. There are no more than networks, in which one chip
    /// runs at a time.
    fn take(&self, chip: u64) -> Result<Core, Error> {
        let mut state = lock(&self.state);
        loop {
            let own = state.free.iter().position(|core| core.is_in == Some(chip));
            if !state.free.is_empty() {
                return Ok(state.free.remove(own.unwrap_or(0)));
            }
            if state.count < OneCpu::held().max(1) {
                state.count += 1;
                break;
            }
            state = self
                .bell
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
        drop(state);
        let made = (self.make)(self.endian);
        let mut processor = made.inspect_err(|_| self.lose())?;
        let fresh = fresh(processor.as_mut());
        Ok(Core {
            processor,
            window: None,
            fresh,
            is_in: None,
            sees: None,
        })
    }

    fn put(&self, core: Core) {
        lock(&self.state).free.push(core);
        self.bell.notify_one();
    }

    /// One of them does not come back.
    fn lose(&self) {
        lock(&self.state).count -= 1;
        self.bell.notify_one();
    }
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

/// A chip's place at a processor of the pool, which it has while it runs.
pub(super) struct Seat {
    chip: u64,
    program: Program,
    pool: Arc<Pool>,
    core: Option<Core>,
    /// Its state while it has no processor; none before it had one.
    state: Option<Vec<u8>>,
    /// None where the system cannot share it.
    memory: Option<Memory>,
    /// Its processor is no other chip's any more.
    is_alone: bool,
}

impl Seat {
    pub(super) fn new(
        program: &Program,
        make: &ProcessorConstructor,
        endian: Endian,
    ) -> Result<Self, Error> {
        let memory = Memory::new().ok();
        let mut seat = Self {
            chip: CHIPS.fetch_add(1, Ordering::Relaxed),
            program: program.clone(),
            pool: Pool::of(program, make, endian),
            core: None,
            state: None,
            memory,
            is_alone: false,
        };
        if seat.memory.is_none() {
            seat.keep_alone();
        }
        if seat.is_alone {
            seat.core = Some(Core {
                processor: make(endian)?,
                window: None,
                fresh: None,
                is_in: Some(seat.chip),
                sees: Some(seat.chip),
            });
        } else {
            // Checks that there is one at all.
            seat.sit()?;
        }
        Ok(seat)
    }

    /// Its processor, with its state and memory.
    ///
    /// # Panics
    /// None can be made, or the system maps no more memory.
    pub(super) fn processor(&mut self) -> &mut dyn Processor {
        self.sit().expect("a processor");
        let core = self.core.as_mut().expect("it sits");
        core.processor.as_mut()
    }

    /// Sits down, without a change of the processor's state. It has had one since it was made.
    ///
    /// # Errors
    /// None can be made, or it does not take the chip's state or memory: it is dropped, and another one may be
    /// made.
    pub(super) fn sit(&mut self) -> Result<(), Error> {
        let mut core = match self.core.take() {
            Some(core) => core,
            None => self.pool.take(self.chip)?,
        };
        // No other chip could begin with it.
        if core.fresh.is_none() {
            self.keep_alone();
        }
        let ready = self.prepare(&mut core);
        if ready.is_ok() {
            self.core = Some(core);
        } else if !self.is_alone {
            self.pool.lose();
        }
        ready
    }

    /// The chip's state and memory are in this processor.
    fn prepare(&self, core: &mut Core) -> Result<(), Error> {
        if core.is_in != Some(self.chip) {
            if let Some(state) = self.state.as_ref().or(core.fresh.as_ref()) {
                core.processor.load(state)?;
            }
            core.processor.take_reset_request();
            core.is_in = Some(self.chip);
        }
        if core.sees != Some(self.chip)
            && let Some(memory) = self.memory.as_ref()
            && !memory.regions().is_empty()
        {
            core.see(memory, &self.program)
                .map_err(|error| Error::Machine(error.to_string()))?;
            core.sees = Some(self.chip);
        }
        Ok(())
    }

    /// Leaves its processor to other chips.
    pub(super) fn stand_up(&mut self) {
        if self.is_alone {
            return;
        }
        if let Some(core) = self.core.take() {
            self.state = Some(core.processor.save());
            self.pool.put(core);
        }
    }

    /// Keeps its processor: other chips' would do something else from now on.
    pub(super) fn keep_alone(&mut self) {
        if !mem::replace(&mut self.is_alone, true) {
            self.pool.lose();
        }
    }

    /// Memory of the chip.
    ///
    /// # Panics
    /// The system gives no more memory.
    ///
    /// # Safety
    /// That of [`Processor::map`].
    pub(super) unsafe fn map(&mut self, region: Region, place: *mut u8) {
        let Region {
            start,
            length,
            is_writable,
        } = region;
        if let Some(core) = &mut self.core {
            core.sees = None;
        }
        // SAFETY: the caller's promise.
        match &mut self.memory {
            Some(memory) => unsafe { memory.push(region, place) }.expect("memory to share"),
            None => unsafe { self.processor().map(start, length, place, is_writable) },
        }
    }

    /// Puts the state of a reset back, if that can be done.
    pub(super) fn refresh(&mut self) -> Option<()> {
        let core = self.core.as_mut()?;
        let state = after(core.fresh.as_ref()?, core.processor.retired())?;
        core.processor.take_reset_request();
        core.processor.load(&state).ok()
    }
}

impl Core {
    fn see(&mut self, memory: &Memory, program: &Program) -> std::io::Result<()> {
        let is_new = self.window.is_none();
        let window = match &mut self.window {
            Some(window) => window,
            none => none.insert(Window::new(memory)?),
        };
        window.show(memory)?;
        for (region, place) in window.places(memory) {
            let Region {
                start,
                length,
                is_writable,
            } = region;
            if is_new {
                // SAFETY: the window's, whole pages, which live longer than the processor.
                unsafe { self.processor.map(start, length, place, is_writable) };
            }
            // Bytes outside of the program may differ from chip to chip.
            let begin = start.max(program.addresses.end);
            if begin < start + length {
                self.processor
                    .ask(Queued::Invalidate(begin, start + length));
            }
        }
        Ok(())
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        if let Some(mut core) = self.core.take()
            && !self.is_alone
        {
            if thread::panicking() {
                self.pool.lose();
            } else {
                core.is_in = None;
                self.pool.put(core);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use rigless::{
        emulator::{CoreBus, DataModel, Exit},
        soc::Width,
    };

    use super::*;

    /// A processor that is its state, which grows with what is asked of it.
    #[derive(Debug)]
    struct Stub {
        state: Vec<u8>,
        fails: Arc<AtomicBool>,
    }

    impl Processor for Stub {
        fn run(&mut self, _: u32, _: &mut dyn CoreBus) -> (Exit, u64) {
            (Exit::Waiting, 0)
        }

        fn retired(&self) -> u64 {
            let digits = self.state.iter().skip(1).rev();
            digits.fold(0, |sum, digit| sum << 7 | u64::from(digit & 0x7f))
        }

        fn ask(&mut self, _: Queued) {
            self.state.push(1);
        }

        fn boot(&mut self, _: u64, _: &dyn Fn(u64, Width) -> Option<u64>) {}

        fn reset(&mut self) {}

        fn waiting(&self) -> bool {
            true
        }

        fn pc(&self) -> u64 {
            0
        }

        fn data_model(&self) -> DataModel {
            unreachable!()
        }

        fn byte_order(&self, _: u64) -> Endian {
            Endian::Little
        }

        fn save(&self) -> Vec<u8> {
            self.state.clone()
        }

        fn load(&mut self, bytes: &[u8]) -> Result<(), Error> {
            if self.fails.load(Ordering::Relaxed) {
                return Err(Error::State);
            }
            self.state = bytes.to_vec();
            Ok(())
        }
    }

    /// Chips of a program of their own, whose processors begin with this state, and the switch that makes their
    /// loading fail.
    fn stubs(fresh: &'static [u8]) -> (impl Fn() -> Result<Seat, Error>, Arc<AtomicBool>) {
        let fails = Arc::new(AtomicBool::new(false));
        let makes = fails.clone();
        let make: ProcessorConstructor = Arc::new(move |_| {
            Ok(Box::new(Stub {
                state: fresh.to_vec(),
                fails: makes.clone(),
            }))
        });
        let program = Program::new([fresh], 0..1);
        let seat = move || Seat::new(&program, &make, Endian::Little);
        (seat, fails)
    }

    /// With and without a processor that can be put back to its beginning.
    #[test]
    fn a_chip_does_not_begin_with_the_state_of_another() {
        for fresh in [[7, 0].as_slice(), &[7, 1]] {
            let (seat, _) = stubs(fresh);
            let mut first = seat().unwrap();
            first.processor().ask(Queued::Return);
            first.stand_up();
            let mut second = seat().unwrap();
            assert_eq!(second.processor().save(), fresh);
            second.stand_up();
            assert_eq!(first.processor().save().len(), 3);
        }
    }

    #[test]
    fn a_processor_that_fails_is_made_again() {
        let (seat, fails) = stubs(&[8, 0]);
        let mut first = seat().unwrap();
        first.stand_up();
        fails.store(true, Ordering::Relaxed);
        assert!(seat().is_err());
        fails.store(false, Ordering::Relaxed);
        // No chip waits for it.
        assert_eq!(lock(&first.pool.state).count, 0);
        assert_eq!(first.processor().save(), [8, 0]);
    }

    #[test]
    fn instructions_are_put_at_the_end_of_a_state() {
        assert_eq!(after(&[7, 0], 0), Some(vec![7, 0]));
        assert_eq!(after(&[7, 0], 300), Some(vec![7, 0xac, 2]));
        assert_eq!(after(&[7, 1], 300), None);
        assert_eq!(after(&[], 300), None);
    }
}
