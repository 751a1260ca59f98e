//! The two banks of a log. Not generic over the size of slots, so that all logs in one type of flash
//! are one code.

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;

use crate::{
    LogError, SLOT_MAX, copy,
    slot::{self, Content},
};

/// Work on a slot, or on the bank it is the first of.
#[derive(Clone, Copy)]
enum Access {
    Read,
    Write,
    Erase,
}

/// The valid bank.
#[derive(Clone, Copy, Debug)]
struct Active {
    bank: u32,
    generation: u32,
    /// The first slot that is not used.
    free: u32,
    /// The last slot used was torn when the log was opened, see [`Survey::torn`].
    torn: bool,
}

/// State of a bank, slot by slot.
#[derive(Clone, Copy, Default)]
struct Survey {
    generation: Option<u32>,
    /// Something is where the header goes.
    begun: bool,
    /// Slots that are not erased, and come before the first that is.
    used: u32,
    has_records: bool,
    /// The last of the used ones is bad. Nothing is written behind it, so that a bad slot before
    /// others is always rot.
    torn: bool,
    /// A bad or an erased slot has others behind it: rot, or reading went wrong.
    rotten: bool,
    /// Something was put right.
    mended: bool,
}

impl Survey {
    /// Nothing, or records without a header, or the header of a log that was being begun.
    const fn never_begun(&self) -> bool {
        !self.begun || self.used == 1 && self.generation.is_none()
    }

    fn add(&mut self, slot: u32, content: Content, generation: Option<u32>) {
        if let Content::Erased = content {
            return;
        }
        self.begun |= slot == 0;
        self.rotten |= self.torn || self.used < slot;
        self.used = slot + 1;
        match content {
            Content::Entry { is_mended } => {
                self.mended |= is_mended;
                if slot == 0 {
                    self.generation = generation;
                } else {
                    self.has_records = true;
                }
            }
            _ => self.torn = true,
        }
    }
}

/// Bytes of a slot at their start, aligned as flash drivers may ask for.
#[derive(Debug)]
#[repr(align(4))]
struct Buffer([u8; SLOT_MAX]);

#[derive(Debug)]
pub(super) struct Banks<F> {
    flash: F,
    start: u32,
    /// Bytes of a bank.
    bank_len: u32,
    /// Bytes of a slot, at most [`SLOT_MAX`].
    slot_len: usize,
    /// Slots of a bank. The rest at its end is not used.
    slots: u32,
    active: Option<Active>,
    /// It was opened, not recovered: records that rotted are left out.
    lenient: bool,
    /// Bytes of the slot being read or written.
    buffer: Buffer,
}

impl<F: NorFlash> Banks<F> {
    pub(super) fn new(
        flash: F,
        range: Range<u32>,
        slot_len: usize,
    ) -> Result<Self, LogError<F::Error>> {
        let unit = u32::try_from(F::ERASE_SIZE).map_err(|_| LogError::Layout)?;
        let len = range.end.checked_sub(range.start);
        let len = len.ok_or(LogError::Layout)?;
        let aligned = range.start.is_multiple_of(unit) && len.is_multiple_of(2 * unit);
        let sizes_fit = slot_len.is_multiple_of(F::WRITE_SIZE)
            && slot_len.is_multiple_of(F::READ_SIZE)
            && F::ERASE_SIZE >= slot_len
            && SLOT_MAX >= slot_len;
        if len == 0 || !aligned || !sizes_fit {
            return Err(LogError::Layout);
        }
        let bank_len = len / 2;
        let slots = bank_len.checked_div(slot_len as u32);
        Ok(Self {
            flash,
            start: range.start,
            bank_len,
            slot_len,
            slots: slots.ok_or(LogError::Layout)?,
            active: None,
            lenient: false,
            buffer: Buffer([0; SLOT_MAX]),
        })
    }

    pub(super) fn into_flash(self) -> F {
        self.flash
    }

    const fn place(&self, bank: u32, slot: u32) -> u32 {
        self.start + bank * self.bank_len + slot * self.slot_len as u32
    }

    /// The slot last read or to be written.
    pub(super) fn slot(&mut self) -> &mut [u8] {
        debug_assert!(self.slot_len <= SLOT_MAX);
        let slot = self.buffer.0.get_mut(..self.slot_len);
        slot.unwrap_or_default()
    }

    /// All work on the flash, in one place: every `await` of a future of its own would be code of its own. Written
    /// or erased bytes are read again: worn flash may not say that it failed, and bytes that were not erased would
    /// be taken for the newest.
    async fn access(
        &mut self,
        access: Access,
        bank: u32,
        slot: u32,
    ) -> Result<(), LogError<F::Error>> {
        let at = self.place(bank, slot);
        let bytes = self.buffer.0.get_mut(..self.slot_len).unwrap_or_default();
        let done = match access {
            Access::Read => self.flash.read(at, bytes).await,
            Access::Write if slot >= self.slots => return Err(LogError::Full),
            Access::Write => self.flash.write(at, bytes).await,
            Access::Erase => self.flash.erase(at, at + self.bank_len).await,
        };
        if let (Access::Write, Err(_)) = (access, &done)
            && self.flash.read(at, bytes).await.is_ok()
            && let Content::Erased = slot::inspect(bytes, false)
        {
            // A unit whose write lost its power may read as erased and refuse all writes until its page is
            // erased. Zeros in the units beside it make the slot a torn one, which no bank keeps.
            bytes.fill(0);
            let size = F::WRITE_SIZE.max(1);
            for (at, unit) in (at..).step_by(size).zip(bytes.chunks_exact(size)) {
                // Some may refuse this, too; that the write failed is told in any case.
                let _ = self.flash.write(at, unit).await;
            }
        }
        done.map_err(LogError::Flash)?;
        if let Access::Read = access {
            return Ok(());
        }
        let written = slot::sum(bytes);
        let (slots, len) = match access {
            Access::Erase => (self.slots, self.slot_len as u32),
            _ => (1, 0),
        };
        for slot in 0..slots {
            let read = self.flash.read(at + slot * len, bytes).await;
            read.map_err(LogError::Flash)?;
            let is_done = match (access, slot::inspect(bytes, false)) {
                (Access::Erase, Content::Erased) => true,
                (Access::Write, Content::Entry { .. }) => slot::sum(bytes) == written,
                _ => false,
            };
            if !is_done {
                return Err(LogError::Worn);
            }
        }
        Ok(())
    }

    /// Content of the slot last read, which is put right.
    fn content(&mut self) -> Content {
        let lenient = self.lenient;
        slot::inspect(self.slot(), lenient)
    }

    pub(super) async fn open(&mut self) -> Result<(), LogError<F::Error>> {
        self.lenient = true;
        let surveys = self.survey().await?;
        let is_void = |survey: &Survey| survey.generation.is_none() && !survey.has_records;
        if !surveys.iter().all(is_void) {
            self.resume(&surveys, |_, _| {}).await?;
        }
        if self.in_force().is_err() {
            self.begin(&|_| None).await?;
        }
        Ok(())
    }

    pub(super) async fn recover(
        &mut self,
        after_tear: fn(u8, &mut [u8]),
    ) -> Result<bool, LogError<F::Error>> {
        self.lenient = false;
        let surveys = self.survey().await?;
        if surveys.iter().all(Survey::never_begun) {
            return Ok(false);
        }
        self.resume(&surveys, after_tear).await?;
        Ok(self.in_force().is_ok())
    }

    /// The valid bank, unless it only says that the log is being begun.
    fn in_force(&self) -> Result<Active, LogError<F::Error>> {
        let active = self.active.filter(|active| active.generation != 0);
        active.ok_or(LogError::NotOpen)
    }

    async fn survey(&mut self) -> Result<[Survey; 2], LogError<F::Error>> {
        self.active = None;
        let mut surveys = [Survey::default(); 2];
        for (bank, survey) in (0..).zip(&mut surveys) {
            for slot in 0..self.slots {
                self.access(Access::Read, bank, slot).await?;
                let content = self.content();
                survey.add(slot, content, slot::generation(self.slot()));
            }
        }
        Ok(surveys)
    }

    async fn resume(
        &mut self,
        [first, second]: &[Survey; 2],
        after_tear: fn(u8, &mut [u8]),
    ) -> Result<(), LogError<F::Error>> {
        // Without a header there may be records all the same; they are whole where one was begun.
        let rank = |survey: &Survey| (survey.generation, survey.has_records, survey.begun);
        let (bank, valid, other) = if rank(second) > rank(first) {
            (1, second, first)
        } else {
            (0, first, second)
        };
        let generation = valid.generation.filter(|_| !valid.rotten);
        let generation = match generation {
            Some(generation) => generation,
            None if self.lenient => valid.generation.unwrap_or_default(),
            None => return Err(LogError::Corrupt),
        };
        self.active = Some(Active {
            bank,
            generation,
            free: valid.used,
            torn: valid.torn,
        });
        if valid.torn || valid.rotten || valid.mended || valid.generation.is_none() {
            self.compact(after_tear).await
        } else if other.used != 0 {
            self.access(Access::Erase, 1 - bank, 0).await
        } else {
            Ok(())
        }
    }

    /// `entry` tells the slots to begin with, from 0 on.
    pub(super) async fn begin<'e>(
        &mut self,
        entry: &(dyn Fn(usize) -> Option<&'e [u8]> + Sync),
    ) -> Result<(), LogError<F::Error>> {
        let from = match self.active.take() {
            Some(active) => active,
            None => {
                self.access(Access::Erase, 1, 0).await?;
                self.make_header(0);
                self.access(Access::Write, 1, 0).await?;
                Active {
                    bank: 1,
                    generation: 0,
                    free: 1,
                    torn: false,
                }
            }
        };
        let to = 1 - from.bank;
        self.access(Access::Erase, to, 0).await?;
        let mut free = 1;
        while let Some(entry) = entry(free as usize - 1) {
            copy(self.slot(), entry);
            self.access(Access::Write, to, free).await?;
            free += 1;
        }
        self.replace(from, free).await
    }

    pub(super) async fn append(&mut self, entry: &[u8]) -> Result<(), LogError<F::Error>> {
        if self.active.is_some_and(|active| active.free >= self.slots) {
            self.compact(|_, _| {}).await?;
        }
        let active = self.in_force()?;
        if active.free >= self.slots {
            return Err(LogError::Full);
        }
        // A failure in the middle leaves the log as a loss of power would.
        self.active = None;
        copy(self.slot(), entry);
        self.access(Access::Write, active.bank, active.free).await?;
        self.active = Some(Active {
            free: active.free + 1,
            ..active
        });
        Ok(())
    }

    /// Returns true if there is a record with this key, which is then the [`slot`](Self::slot).
    pub(super) async fn find(&mut self, key: u8) -> Result<bool, LogError<F::Error>> {
        let active = self.in_force()?;
        for slot in (1..active.free).rev() {
            self.access(Access::Read, active.bank, slot).await?;
            let content = self.content();
            let is_wanted = slot::key(self.slot()) == key;
            match content {
                Content::Entry { .. } if is_wanted => return Ok(true),
                Content::Entry { .. } => {}
                _ if !self.lenient => return Err(LogError::Corrupt),
                // Records written before it may be true no more.
                _ if is_wanted => return Ok(false),
                _ => {}
            }
        }
        Ok(false)
    }

    /// Slot of the newest record of each key from `first` on, 0 for none.
    pub(super) async fn newest(
        &mut self,
        first: u8,
        slots: &mut [u16],
    ) -> Result<(), LogError<F::Error>> {
        let active = self.in_force()?;
        slots.fill(0);
        for slot in 1..active.free {
            self.access(Access::Read, active.bank, slot).await?;
            let newest = match self.content() {
                Content::Entry { .. } => slot,
                _ if !self.lenient => return Err(LogError::Corrupt),
                // Records written before it may be true no more.
                _ => 0,
            };
            let place = slot::key(self.slot()).checked_sub(first).map(usize::from);
            if let Some(place) = place.and_then(|place| slots.get_mut(place)) {
                *place = u16::try_from(newest).map_err(|_| LogError::Layout)?;
            }
        }
        Ok(())
    }

    /// Returns true if there is a record in this slot, which is then the [`slot`](Self::slot).
    pub(super) async fn read(&mut self, slot: u32) -> Result<bool, LogError<F::Error>> {
        let active = self.in_force()?;
        if !(1..active.free).contains(&slot) {
            return Ok(false);
        }
        self.access(Access::Read, active.bank, slot).await?;
        match self.content() {
            Content::Entry { .. } => Ok(true),
            _ if self.lenient => Ok(false),
            _ => Err(LogError::Corrupt),
        }
    }

    /// Moves the live records to the other bank.
    async fn compact(&mut self, change: fn(u8, &mut [u8])) -> Result<(), LogError<F::Error>> {
        let from = self.active.take().ok_or(LogError::NotOpen)?;
        let to = 1 - from.bank;
        self.access(Access::Erase, to, 0).await?;
        let mut done = [0_u32; 8];
        let mut free = 1;
        // From the newest back.
        for slot in (1..from.free).rev() {
            self.access(Access::Read, from.bank, slot).await?;
            let is_found = match self.content() {
                Content::Entry { .. } => true,
                // Torn: the record before it stands.
                Content::Bad if from.torn && slot + 1 == from.free => continue,
                _ if self.lenient => false,
                _ => return Err(LogError::Corrupt),
            };
            let key = slot::key(self.slot());
            let word = done.get_mut(usize::from(key / 32));
            let word = word.ok_or(LogError::Corrupt)?;
            let bit = 1 << (key % 32);
            if *word & bit != 0 {
                continue;
            }
            *word |= bit;
            if is_found {
                change(key, slot::value_mut(self.slot()));
                slot::seal(self.slot());
                self.access(Access::Write, to, free).await?;
                free += 1;
            }
        }
        self.replace(from, free).await
    }

    /// Puts the other bank in force, which has so many used slots.
    async fn replace(&mut self, from: Active, free: u32) -> Result<(), LogError<F::Error>> {
        let to = 1 - from.bank;
        // No bank outlives so many erasures as to come back to 0, which says that the log is being
        // begun; but a page may hold anything.
        let generation = from.generation.wrapping_add(1).max(1);
        self.make_header(generation);
        self.access(Access::Write, to, 0).await?;
        self.active = Some(Active {
            bank: to,
            generation,
            free,
            torn: false,
        });
        self.access(Access::Erase, from.bank, 0).await
    }

    /// Makes the slot the header of a bank.
    fn make_header(&mut self, generation: u32) {
        slot::fill(self.slot(), slot::HEADER, &generation.to_le_bytes());
    }
}
