//! NOR flash that is worn out: its operations fail, or do nothing and do not say so.

use std::{cell::RefCell, ops::Range, rc::Rc};

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::flash::{Flash, FlashError};

/// Reaction of a worn flash to a write or an erasure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It does nothing, and says that it failed.
    Fails,
    /// It does nothing, and says that it is done.
    Lost,
    /// Some bits of the written bytes stick; an erasure is as lost.
    Sticks,
}

/// Wear of a flash. By default none.
#[derive(Clone, Default)]
pub struct Faults(Rc<RefCell<Option<Wear>>>);

struct Wear {
    fault: Fault,
    /// Share of the operations.
    share: f64,
    range: Range<u32>,
    random: ChaCha8Rng,
}

impl Faults {
    /// From now on this share of the operations in this range fails so.
    pub fn set(&self, fault: Fault, share: f64, range: Range<u32>, seed: u64) {
        self.0.replace(Some(Wear {
            fault,
            share,
            range,
            random: ChaCha8Rng::seed_from_u64(seed),
        }));
    }

    /// It is as good as new.
    pub fn clear(&self) {
        self.0.take();
    }

    /// Returns true if operations fail there.
    pub fn are_at(&self, at: u32) -> bool {
        let wear = self.0.borrow();
        wear.as_ref().is_some_and(|wear| wear.range.contains(&at))
    }

    fn draw(&self, at: u32) -> Option<(Fault, u32)> {
        let mut wear = self.0.borrow_mut();
        let wear = wear.as_mut()?;
        let is_worn = wear.range.contains(&at) && wear.random.random_bool(wear.share);
        is_worn.then(|| (wear.fault, wear.random.next_u32()))
    }
}

/// A flash that wears out.
#[derive(Clone)]
pub struct Worn<const PAGE_LEN: usize> {
    flash: Flash<PAGE_LEN>,
    faults: Faults,
}

impl<const PAGE_LEN: usize> Worn<PAGE_LEN> {
    /// This flash with this wear, which may change.
    pub fn new(flash: Flash<PAGE_LEN>, faults: Faults) -> Self {
        Self { flash, faults }
    }
}

impl<const PAGE_LEN: usize> ErrorType for Worn<PAGE_LEN> {
    type Error = FlashError;
}

impl<const PAGE_LEN: usize> ReadNorFlash for Worn<PAGE_LEN> {
    const READ_SIZE: usize = Flash::<PAGE_LEN>::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.flash.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<const PAGE_LEN: usize> NorFlash for Worn<PAGE_LEN> {
    const WRITE_SIZE: usize = Flash::<PAGE_LEN>::WRITE_SIZE;
    const ERASE_SIZE: usize = Flash::<PAGE_LEN>::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        match self.faults.draw(from) {
            None => self.flash.erase(from, to).await,
            Some((Fault::Fails, _)) => Err(FlashError::Failed),
            Some(_) => Ok(()),
        }
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let at = offset as usize;
        let end = at + bytes.len();
        if !self.flash.bytes()[at..end].iter().all(|&byte| byte == 0xFF) {
            // Over bytes that could not be erased: of a real flash the bits that fall.
            let mut all = self.flash.bytes_mut();
            for (old, new) in all[at..end].iter_mut().zip(bytes) {
                *old &= new;
            }
            return Ok(());
        }
        match self.faults.draw(offset) {
            None => self.flash.write(offset, bytes).await,
            Some((Fault::Fails, _)) => Err(FlashError::Failed),
            Some((Fault::Lost, _)) => Ok(()),
            Some((Fault::Sticks, random)) => {
                let mut stuck = bytes.to_vec();
                let at = random as usize % stuck.len();
                stuck[at] ^= 1 << (random >> 24 & 7);
                self.flash.write(offset, &stuck).await
            }
        }
    }
}
