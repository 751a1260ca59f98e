//! NOR flash that outlasts the node it belongs to.
//!
//! A [`Flash`] is a handle to a chip; the scenario keeps one, and the node that runs gets
//! another. Times are those of the nRF52840 (product specification 1.7, 6.16.9: word write 41 us,
//! page erase 85 ms). The processor of that part stands still meanwhile; here only the caller
//! waits.
//!
//! An operation whose future is dropped before its end, as when the node is killed, is torn: what
//! had its time is done, the word or page under way has some of its bits.

use std::{
    cell::{Ref, RefCell},
    fmt,
    future::poll_fn,
    rc::Rc,
    task::{Poll, Waker},
};

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;

use super::executor::{Clock, Time};

/// Bytes that are erased at once.
pub const PAGE: usize = 4096;
/// Bytes that are written at once.
pub const WORD: usize = 4;
/// Nanoseconds to write a word.
pub const WORD_TIME: Time = 41_000;
/// Nanoseconds to erase a page.
pub const PAGE_TIME: Time = 85_000_000;

/// The call does not fit the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashError(NorFlashErrorKind);

impl fmt::Display for FlashError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl std::error::Error for FlashError {}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        self.0
    }
}

impl From<NorFlashErrorKind> for FlashError {
    fn from(kind: NorFlashErrorKind) -> Self {
        Self(kind)
    }
}

/// How much a chip has been used.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wear {
    /// Erasures of each page, torn ones included.
    pub erasures: Vec<u32>,
    /// Words written, torn ones included.
    pub words: u64,
    /// Operations that lost their power.
    pub torn: u64,
}

struct Chip {
    bytes: Vec<u8>,
    wear: Wear,
    random: ChaCha8Rng,
    /// Operations begun, and who waits for the next.
    begun: u64,
    /// Time of the operation that began last.
    takes: Time,
    watchers: Vec<Waker>,
}

impl Chip {
    fn write_word(&mut self, at: usize, word: &[u8], whole: bool) {
        self.wear.words += 1;
        for (old, new) in self.bytes[at..].iter_mut().zip(word) {
            // Only some of the bits that should fall have fallen.
            let kept = if whole { 0 } else { self.random.random::<u8>() };
            *old &= new | kept;
        }
    }

    fn erase_page(&mut self, page: usize, whole: bool) {
        self.wear.erasures[page] += 1;
        for byte in &mut self.bytes[page * PAGE..][..PAGE] {
            *byte |= if whole {
                0xFF
            } else {
                self.random.next_u32() as u8
            };
        }
    }
}

/// A handle to a flash chip. See the [module](self).
#[derive(Clone)]
pub struct Flash {
    chip: Rc<RefCell<Chip>>,
    clock: Clock,
    takes_time: bool,
}

impl Flash {
    /// An erased chip of so many pages. `random` decides what torn operations leave.
    pub fn new(clock: &Clock, pages: usize, random: ChaCha8Rng) -> Self {
        let chip = Chip {
            bytes: vec![0xFF; pages * PAGE],
            wear: Wear {
                erasures: vec![0; pages],
                ..Wear::default()
            },
            random,
            begun: 0,
            takes: 0,
            watchers: Vec::new(),
        };
        Self {
            chip: Rc::new(RefCell::new(chip)),
            clock: clock.clone(),
            takes_time: true,
        }
    }

    /// A handle to the same chip whose operations take no time: what was on it before the
    /// simulation began.
    #[must_use]
    pub fn programmer(&self) -> Self {
        Self {
            takes_time: false,
            ..self.clone()
        }
    }

    /// All bytes.
    pub fn bytes(&self) -> Ref<'_, [u8]> {
        Ref::map(self.chip.borrow(), |chip| chip.bytes.as_slice())
    }

    /// How much it has been used.
    pub fn wear(&self) -> Wear {
        self.chip.borrow().wear.clone()
    }

    /// Returns when the next write or erasure begins, with how long it takes: to plan a power cut
    /// within.
    pub async fn next_operation(&self) -> Time {
        let begun = self.chip.borrow().begun;
        poll_fn(|context| {
            let mut chip = self.chip.borrow_mut();
            if chip.begun > begun {
                return Poll::Ready(chip.takes);
            }
            chip.watchers.push(context.waker().clone());
            Poll::Pending
        })
        .await
    }

    fn check(&self, offset: u32, len: usize, unit: usize) -> Result<usize, NorFlashErrorKind> {
        let from = offset as usize;
        if !from.is_multiple_of(unit) || !len.is_multiple_of(unit) {
            return Err(NorFlashErrorKind::NotAligned);
        }
        if from + len > self.chip.borrow().bytes.len() {
            return Err(NorFlashErrorKind::OutOfBounds);
        }
        Ok(from)
    }

    async fn run(&self, job: Job<'_>) {
        let step = match job {
            _ if !self.takes_time => 0,
            Job::Write { .. } => WORD_TIME,
            Job::Erase { .. } => PAGE_TIME,
        };
        let operation = Operation {
            flash: self,
            steps: job.steps(),
            step,
            begun: self.clock.time(),
            job,
        };
        let takes = operation.steps as Time * step;
        {
            let mut chip = self.chip.borrow_mut();
            chip.begun += 1;
            chip.takes = takes;
            chip.watchers.drain(..).for_each(Waker::wake);
        }
        self.clock.sleep(takes).await;
    }
}

enum Job<'a> {
    Write { from: usize, bytes: &'a [u8] },
    Erase { first: usize, pages: usize },
}

impl Job<'_> {
    fn steps(&self) -> usize {
        match self {
            Self::Write { bytes, .. } => bytes.len() / WORD,
            Self::Erase { pages, .. } => *pages,
        }
    }
}

/// Takes effect when it is dropped, as far as its time went.
struct Operation<'a> {
    flash: &'a Flash,
    steps: usize,
    step: Time,
    begun: Time,
    job: Job<'a>,
}

impl Drop for Operation<'_> {
    fn drop(&mut self) {
        let passed = self.flash.clock.time() - self.begun;
        let done = passed
            .checked_div(self.step)
            .map_or(self.steps, |done| (done as usize).min(self.steps));
        let mut chip = self.flash.chip.borrow_mut();
        let is_torn = done < self.steps;
        chip.wear.torn += u64::from(is_torn);
        for step in 0..done + usize::from(is_torn) {
            let whole = step < done;
            match self.job {
                Job::Write { from, bytes } => {
                    let at = step * WORD;
                    chip.write_word(from + at, &bytes[at..][..WORD], whole);
                }
                Job::Erase { first, .. } => chip.erase_page(first + step, whole),
            }
        }
    }
}

impl ErrorType for Flash {
    type Error = FlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let from = self.check(offset, bytes.len(), 1)?;
        bytes.copy_from_slice(&self.chip.borrow().bytes[from..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.chip.borrow().bytes.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let len = to.checked_sub(from).ok_or(NorFlashErrorKind::OutOfBounds)? as usize;
        let first = self.check(from, len, PAGE)? / PAGE;
        let pages = len / PAGE;
        self.run(Job::Erase { first, pages }).await;
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let from = self.check(offset, bytes.len(), WORD)?;
        self.run(Job::Write { from, bytes }).await;
        Ok(())
    }
}
