//! A NOR flash that enforces the rules of the hardware and loses its power half-way.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const PAGE: usize = 256;
pub const WORD: usize = 4;

/// Erased bytes are 0xFF; a word is written once between erasures; whole words, whole pages.
#[derive(Clone)]
pub struct MockFlash<const PAGES: usize> {
    pub bytes: Vec<u8>,
    written: Vec<bool>,
    /// Words and pages that may still be changed before the power fails.
    budget: Option<u32>,
    rng: ChaCha8Rng,
    pub erasures: [u32; PAGES],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PowerLoss;

impl NorFlashError for PowerLoss {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<const PAGES: usize> MockFlash<PAGES> {
    pub fn new(seed: u64) -> Self {
        Self {
            bytes: vec![0xFF; PAGES * PAGE],
            written: vec![false; PAGES * PAGE / WORD],
            budget: None,
            rng: ChaCha8Rng::seed_from_u64(seed),
            erasures: [0; PAGES],
        }
    }

    pub const LEN: u32 = (PAGES * PAGE) as u32;

    /// Power on, for so many more changes; the last of them is torn.
    pub fn power(&mut self, budget: Option<u32>) {
        self.budget = budget;
    }

    pub fn has_power(&self) -> bool {
        self.budget != Some(0)
    }

    /// Takes one change from the budget. `Some(true)`: whole; `Some(false)`: torn; `None`: no power.
    fn spend(&mut self) -> Option<bool> {
        match &mut self.budget {
            None => Some(true),
            Some(0) => None,
            Some(budget) => {
                *budget -= 1;
                Some(*budget > 0)
            }
        }
    }
}

impl<const PAGES: usize> ErrorType for MockFlash<PAGES> {
    type Error = PowerLoss;
}

impl<const PAGES: usize> ReadNorFlash for MockFlash<PAGES> {
    const READ_SIZE: usize = WORD;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerLoss> {
        let offset = offset as usize;
        assert!(
            offset.is_multiple_of(WORD) && bytes.len().is_multiple_of(WORD),
            "unaligned read"
        );
        if !self.has_power() {
            return Err(PowerLoss);
        }
        bytes.copy_from_slice(&self.bytes[offset..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const PAGES: usize> NorFlash for MockFlash<PAGES> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerLoss> {
        let (from, to) = (from as usize, to as usize);
        assert!(
            from.is_multiple_of(PAGE) && to.is_multiple_of(PAGE) && from <= to,
            "unaligned erase"
        );
        for page in from / PAGE..to / PAGE {
            let whole = self.spend().ok_or(PowerLoss)?;
            self.erasures[page] += 1;
            for byte in &mut self.bytes[page * PAGE..][..PAGE] {
                // An erasure that is cut off leaves anything.
                *byte = if whole {
                    0xFF
                } else {
                    *byte | self.rng.next_u32() as u8
                };
            }
            for word in 0..PAGE / WORD {
                self.written[page * PAGE / WORD + word] = false;
            }
            if !whole {
                return Err(PowerLoss);
            }
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerLoss> {
        let offset = offset as usize;
        assert!(
            offset.is_multiple_of(WORD) && bytes.len().is_multiple_of(WORD),
            "unaligned write"
        );
        for (at, word) in bytes.chunks(WORD).enumerate() {
            let at = offset + at * WORD;
            let whole = self.spend().ok_or(PowerLoss)?;
            assert!(!self.written[at / WORD], "word at {at} written twice");
            for (old, new) in self.bytes[at..].iter_mut().zip(word) {
                // Only some of the bits that should fall have fallen.
                let kept = if whole { 0 } else { self.rng.random::<u8>() };
                *old &= new | kept;
            }
            // A torn word that looks erased is one to everybody.
            let erased = self.bytes[at..][..WORD].iter().all(|&byte| byte == 0xFF);
            self.written[at / WORD] = whole || !erased;
            if !whole {
                return Err(PowerLoss);
            }
        }
        Ok(())
    }
}
