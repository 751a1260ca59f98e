//! NOR flash that outlasts the node it belongs to.
//!
//! A [`Flash`] is a handle to a chip; the scenario keeps one, and the node that runs gets
//! another. Times are those of the nRF52840 (product specification 1.7, 6.16.9: word write 41 us,
//! page erase 85 ms). The processor of that part stands still meanwhile; here only the caller
//! waits. A handle [without time](Flash::programmer) is done at once.
//!
//! Words are read and written whole, each once between two erasures of its page: the strictest of the boards'
//! flashes asks for that.
//!
//! # What goes wrong
//! An operation whose future is dropped before its end, as when the node is killed, is torn: the words and pages
//! that had their time are done, the one under way has some of its bits. So is the last of the changes that
//! [`Flash::power`] has left; all that follow it fail. A [read](Flash::fail_read) can fail too, the bytes can
//! [rot](Flash::bytes_mut), and the chip can be [worn](Flash::wear_out).

use std::{
    cell::{Ref, RefCell, RefMut},
    error, fmt,
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

/// Bytes that are erased at once by the flash of an nRF52840.
pub const PAGE: usize = 4096;
/// Bytes that are read and written at once.
pub const WORD: usize = 4;
/// Nanoseconds to write a word.
pub const WORD_TIME: Time = 41_000;
/// Nanoseconds to erase a page.
pub const PAGE_TIME: Time = 85_000_000;

/// Reason why a call failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashError {
    /// It is not of whole words, or not of whole pages.
    NotAligned,
    /// The flash ends before.
    OutOfBounds,
    /// The power failed, or the read that was to fail, or the chip is worn.
    Failed,
}

impl fmt::Display for FlashError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kind().fmt(f)
    }
}

impl error::Error for FlashError {}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotAligned => NorFlashErrorKind::NotAligned,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::Failed => NorFlashErrorKind::Other,
        }
    }
}

/// Use of a chip so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wear {
    /// Erasures of each page, torn ones included.
    pub erasures: Vec<u32>,
    /// Words written, torn ones included.
    pub words: u64,
    /// Operations that lost their power.
    pub torn: u64,
    /// Calls that read.
    pub reads: u64,
}

#[derive(Clone)]
struct Chip<const PAGE_LEN: usize> {
    bytes: Vec<u8>,
    /// True for each word that has been written since it was erased.
    is_written: Vec<bool>,
    wear: Wear,
    random: ChaCha8Rng,
    /// Words and pages that may still be changed before the power fails.
    power: Option<u32>,
    is_worn: bool,
    /// Reads up to the one that fails.
    reads_left: Option<u32>,
    /// Operations begun.
    begun: u64,
    /// Time of the operation that began last.
    takes: Time,
    watchers: Vec<Waker>,
}

impl<const PAGE_LEN: usize> Chip<PAGE_LEN> {
    fn write_word(&mut self, at: usize, word: &[u8], whole: bool) {
        self.wear.words += 1;
        let bytes = &mut self.bytes[at..][..WORD];
        for (old, new) in bytes.iter_mut().zip(word) {
            // Only some of the bits that should fall have fallen.
            let kept = if whole { 0 } else { self.random.random::<u8>() };
            *old &= new | kept;
        }
        // A torn word that looks erased counts as erased.
        self.is_written[at / WORD] = whole || bytes != [0xFF; WORD];
    }

    fn erase_page(&mut self, page: usize, whole: bool) {
        self.wear.erasures[page] += 1;
        for byte in &mut self.bytes[page * PAGE_LEN..][..PAGE_LEN] {
            *byte |= if whole {
                0xFF
            } else {
                self.random.next_u32() as u8
            };
        }
        let words = PAGE_LEN / WORD;
        self.is_written[page * words..][..words].fill(false);
    }

    /// Takes changes from those that the power lasts for. Returns their number, and true if the last of them is
    /// torn.
    fn spend(&mut self, changes: usize) -> Result<(usize, bool), FlashError> {
        let Some(left) = self.power else {
            return Ok((changes, false));
        };
        if left == 0 {
            return Err(FlashError::Failed);
        }
        let done = changes.min(left as usize);
        self.power = Some(left - done as u32);
        Ok((done, done == left as usize))
    }
}

/// A handle to a flash chip with pages of so many bytes. See the [module](self).
#[derive(Clone)]
pub struct Flash<const PAGE_LEN: usize = PAGE> {
    chip: Rc<RefCell<Chip<PAGE_LEN>>>,
    /// Absent if operations take no time.
    clock: Option<Clock>,
}

impl Flash {
    /// An erased chip of so many pages. `random` decides what torn operations leave.
    pub fn new(clock: &Clock, pages: usize, random: ChaCha8Rng) -> Self {
        Self {
            clock: Some(clock.clone()),
            ..Self::without_time(pages, random)
        }
    }
}

impl<const PAGE_LEN: usize> Flash<PAGE_LEN> {
    /// The same with pages of any size, whose operations take no time.
    pub fn without_time(pages: usize, random: ChaCha8Rng) -> Self {
        Self::of(Chip {
            bytes: vec![0xFF; pages * PAGE_LEN],
            is_written: vec![false; pages * PAGE_LEN / WORD],
            wear: Wear {
                erasures: vec![0; pages],
                ..Wear::default()
            },
            random,
            power: None,
            is_worn: false,
            reads_left: None,
            begun: 0,
            takes: 0,
            watchers: Vec::new(),
        })
    }

    fn of(chip: Chip<PAGE_LEN>) -> Self {
        Self {
            chip: Rc::new(RefCell::new(chip)),
            clock: None,
        }
    }

    /// A handle to the same chip whose operations take no time, for its contents from before the simulation began.
    #[must_use]
    pub fn programmer(&self) -> Self {
        Self {
            chip: self.chip.clone(),
            clock: None,
        }
    }

    /// Another chip with the same on it, whose operations take no time.
    #[must_use]
    pub fn copy(&self) -> Self {
        let chip = self.chip.borrow();
        Self::of(Chip {
            watchers: Vec::new(),
            ..chip.clone()
        })
    }

    /// All bytes.
    pub fn bytes(&self) -> Ref<'_, [u8]> {
        Ref::map(self.chip.borrow(), |chip| chip.bytes.as_slice())
    }

    /// All bytes, to let them rot, or to put there the contents of another flash. It does not change which words
    /// count as written.
    pub fn bytes_mut(&self) -> RefMut<'_, [u8]> {
        RefMut::map(self.chip.borrow_mut(), |chip| chip.bytes.as_mut_slice())
    }

    /// Returns its use so far.
    pub fn wear(&self) -> Wear {
        self.chip.borrow().wear.clone()
    }

    /// Erasures of the page that was erased most; `None` if there is no page.
    pub fn most_erasures(&self) -> Option<u32> {
        self.chip.borrow().wear.erasures.iter().copied().max()
    }

    /// Power on: for good, or for so many more changes of a word or a page. The last of them is torn, and it and
    /// all that follow fail.
    pub fn power(&self, changes: Option<u32>) {
        self.chip.borrow_mut().power = changes;
    }

    /// Returns true if the power has not failed.
    pub fn has_power(&self) -> bool {
        self.chip.borrow().power != Some(0)
    }

    /// From now on it keeps what it holds: every write and every erasure fails, without an effect.
    pub fn wear_out(&self) {
        self.chip.borrow_mut().is_worn = true;
    }

    /// Has one read fail: the next is number 1.
    pub fn fail_read(&self, number: u32) {
        self.chip.borrow_mut().reads_left = Some(number);
    }

    /// Returns when the next write or erasure begins, with its duration: to plan a power cut within.
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

    fn check(&self, offset: u32, len: usize, unit: usize) -> Result<usize, FlashError> {
        let from = offset as usize;
        if !from.is_multiple_of(unit) || !len.is_multiple_of(unit) {
            return Err(FlashError::NotAligned);
        }
        if from + len > self.chip.borrow().bytes.len() {
            return Err(FlashError::OutOfBounds);
        }
        Ok(from)
    }

    async fn run(&self, job: Job<'_>) -> Result<(), FlashError> {
        if self.chip.borrow().is_worn {
            if let Some(clock) = &self.clock {
                clock.sleep(job.steps() as Time * job.step_time()).await;
            }
            return Err(FlashError::Failed);
        }
        let (steps, is_last_torn) = self.chip.borrow_mut().spend(job.steps())?;
        let operation = Operation {
            flash: self,
            steps,
            whole: steps - usize::from(is_last_torn),
            begun: self.clock.as_ref().map_or(0, Clock::time),
            job,
        };
        if let Some(clock) = &self.clock {
            let takes = operation.steps as Time * operation.job.step_time();
            {
                let mut chip = self.chip.borrow_mut();
                chip.begun += 1;
                chip.takes = takes;
                chip.watchers.drain(..).for_each(Waker::wake);
            }
            clock.sleep(takes).await;
        }
        drop(operation);
        if is_last_torn {
            Err(FlashError::Failed)
        } else {
            Ok(())
        }
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

    fn step_time(&self) -> Time {
        match self {
            Self::Write { .. } => WORD_TIME,
            Self::Erase { .. } => PAGE_TIME,
        }
    }
}

/// Takes effect when it is dropped, as far as its time and its power went.
struct Operation<'a, const PAGE_LEN: usize> {
    flash: &'a Flash<PAGE_LEN>,
    steps: usize,
    /// Steps for which the power lasts.
    whole: usize,
    begun: Time,
    job: Job<'a>,
}

impl<const PAGE_LEN: usize> Drop for Operation<'_, PAGE_LEN> {
    fn drop(&mut self) {
        let done = self.flash.clock.as_ref().map_or(self.whole, |clock| {
            let passed = (clock.time() - self.begun) / self.job.step_time();
            self.whole.min(passed as usize)
        });
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

impl<const PAGE_LEN: usize> ErrorType for Flash<PAGE_LEN> {
    type Error = FlashError;
}

impl<const PAGE_LEN: usize> ReadNorFlash for Flash<PAGE_LEN> {
    const READ_SIZE: usize = WORD;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let from = self.check(offset, bytes.len(), WORD)?;
        let chip = &mut *self.chip.borrow_mut();
        chip.wear.reads += 1;
        chip.reads_left = chip.reads_left.and_then(|left| left.checked_sub(1));
        if chip.reads_left == Some(0) || chip.power == Some(0) {
            return Err(FlashError::Failed);
        }
        bytes.copy_from_slice(&chip.bytes[from..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.chip.borrow().bytes.len()
    }
}

impl<const PAGE_LEN: usize> NorFlash for Flash<PAGE_LEN> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE_LEN;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let len = to.checked_sub(from).ok_or(FlashError::OutOfBounds)? as usize;
        let first = self.check(from, len, PAGE_LEN)? / PAGE_LEN;
        let pages = len / PAGE_LEN;
        self.run(Job::Erase { first, pages }).await
    }

    /// # Panics
    /// A word has been written since it was erased.
    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let from = self.check(offset, bytes.len(), WORD)?;
        {
            let chip = self.chip.borrow();
            let mut words = from / WORD..(from + bytes.len()) / WORD;
            let twice = words.find(|&word| chip.is_written[word]);
            assert_eq!(twice, None, "the word of this number is written twice");
        }
        self.run(Job::Write { from, bytes }).await
    }
}
