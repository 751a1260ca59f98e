//! A flash with a checksum of its own for each unit of 8 bytes, as the STM32L4's: a unit whose write lost its
//! power may read as erased, and refuses to be written until its page is erased.

use std::{cell::RefCell, ops::Range, rc::Rc};

use crate::support::{Flash, PAGE, chip, length};

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use flash_log::{Entry, Log, LogError};
use virtual_hardware::flash::FlashError;

const SLOT: usize = 96;
const UNIT: usize = 8;
const RANGE: Range<u32> = 0..length(4);

#[derive(Clone)]
struct Checked {
    inner: Flash,
    state: Rc<RefCell<State>>,
    /// Pages that read as erased are not erased.
    spares_blank_pages: bool,
}

#[derive(Default)]
struct State {
    /// Units that look erased and are not.
    spoilt: Vec<u32>,
    writes: u32,
    /// The write that loses its power: in this unit of its slot, before any bit of it is changed.
    cut: Option<(u32, usize)>,
}

impl Checked {
    fn new(spares_blank_pages: bool) -> Self {
        Self {
            inner: chip(4, 1),
            state: Rc::default(),
            spares_blank_pages,
        }
    }

    fn log(&self) -> Log<Self, SLOT> {
        Log::new(self.clone(), RANGE).unwrap()
    }
}

impl ErrorType for Checked {
    type Error = FlashError;
}

impl ReadNorFlash for Checked {
    const READ_SIZE: usize = Flash::READ_SIZE;

    async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.inner.read(at, bytes).await
    }

    fn capacity(&self) -> usize {
        self.inner.capacity()
    }
}

impl NorFlash for Checked {
    const WRITE_SIZE: usize = UNIT;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        for page in (from..to).step_by(PAGE) {
            let mut bytes = [0; PAGE];
            self.inner.read(page, &mut bytes).await?;
            if self.spares_blank_pages && bytes == [0xFF; PAGE] {
                continue;
            }
            let end = page + PAGE as u32;
            self.inner.erase(page, end).await?;
            let mut state = self.state.borrow_mut();
            state.spoilt.retain(|at| !(page..end).contains(at));
        }
        Ok(())
    }

    async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), FlashError> {
        self.state.borrow_mut().writes += 1;
        for (number, unit) in bytes.as_chunks::<UNIT>().0.iter().enumerate() {
            let at = at + (number * UNIT) as u32;
            {
                let mut state = self.state.borrow_mut();
                if state.cut == Some((state.writes, number)) {
                    state.cut = None;
                    state.spoilt.push(at);
                    // No power: what would have been written next never is.
                    self.inner.power(Some(0));
                    return Err(FlashError::Failed);
                }
                if state.spoilt.contains(&at) {
                    return Err(FlashError::Failed);
                }
            }
            self.inner.write(at, unit).await?;
        }
        Ok(())
    }
}

/// One start of a node: it opens its log, or recovers it as the store of a link does, and writes.
async fn start(flash: &Checked, recovers: bool, first: u8) -> Result<(), LogError<FlashError>> {
    let mut log = flash.log();
    if !recovers {
        log.open().await?;
    } else if !log.recover(|_, _| {}).await? {
        log.begin(&[]).await?;
    }
    for number in 0..9 {
        let entry = Entry::new(number % 3, &[first; 90]).unwrap();
        log.append(&entry).await?;
        assert_eq!(log.find(number % 3).await?, Some(entry));
    }
    Ok(())
}

/// Each write of a node's first minutes, in its first, a middle or its last unit. Two starts that fail are
/// enough: one finds the unit, and one may be in the middle of another bank.
#[test]
fn any_write_that_was_cut_is_got_over() {
    let mut cuts = 0;
    for spares_blank_pages in [false, true] {
        for recovers in [false, true] {
            for write in 1..40 {
                for unit in [0, 5, SLOT / UNIT - 1] {
                    let flash = Checked::new(spares_blank_pages);
                    flash.state.borrow_mut().cut = Some((write, unit));
                    let first = block_on(start(&flash, recovers, 0));
                    if first.is_ok() {
                        continue;
                    }
                    cuts += 1;
                    assert_eq!(first, Err(LogError::Flash(FlashError::Failed)));
                    flash.inner.clone().power(None);
                    let starts: Vec<_> = (1..5)
                        .map(|number| block_on(start(&flash, recovers, number)))
                        .collect();
                    let last = starts.iter().rposition(Result::is_err);
                    assert!(
                        last.is_none_or(|last| last < 2),
                        "write {write}, unit {unit}: {starts:?}"
                    );
                }
            }
        }
    }
    assert!(cuts > 100, "{cuts}");
}
