//! A log of small records in two banks of a NOR flash, safe against the loss of power.
//!
//! [`Store`](super::Store) is built on it, and an application can keep its own facts in another
//! range of the same flash. A record has a key; appending one replaces the record of this key. It
//! is there whole or not at all, whenever the power fails, and pages are worn evenly.
//!
//! Every record takes a slot of `SLOT` bytes: 6 of the log and a value of up to `SLOT - 6`. `SLOT`
//! is a multiple of the flash's read and write size; 128 gives 122 bytes, and 31 records to a page
//! of 4 KiB.
//!
//! # Format, version 1
//! A slot is: version 1, key, value padded with zeros, CRC-32 (ISO-HDLC) of all that, as
//! little-endian u32. A bank is half the range. At rest one bank is valid and the other erased.
//! Slot 0 of a bank is its header: key 255, generation as little-endian u32. It is written last, so
//! a bank with a header is whole. Records follow, then erased slots. When a bank is full, the
//! newest record of each key goes into the other one, with the next generation, and then this one
//! is erased. [Beginning](Log::begin) a log anew is the same with other records. Where there was
//! none, an empty bank of generation 0 comes first: it says that the log is being begun, and that
//! whatever the other bank holds without a header was never in force.
//!
//! # Rot
//! Flash may lose a bit. Who [recovers](Log::recover) a log is told: nothing that was written is
//! then taken for something that was not. Who [opens](Log::open) it gets what is left: one flipped
//! bit of a slot is put right, and so is a wrong key if all else is right, for the checksum tells
//! which it was (no two of these have the same effect on a CRC-32). A record with more damage is
//! lost, and with it what was written under its key before: that may be true no more. Its key is
//! then the one that is read. So where the damage is to the key and to other bytes, what was
//! written before under the right key comes back, and what was written before under the key that is
//! read is lost. At the end of the log more damage is taken for a torn write, and what was written
//! before stands.
//!
//! # Several users of one flash
//! One log borrows the flash as `&mut F`. Users that live side by side each take a
//! `Partition` of `embassy_embedded_hal::flash::partition`, over one
//! `embassy_sync::mutex::Mutex<NoopRawMutex, F>`:
//! ```
//! # use core::convert::Infallible;
//! # use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
//! # struct Nvmc([u8; 4 * 4096]);
//! # impl ErrorType for Nvmc { type Error = Infallible; }
//! # impl ReadNorFlash for Nvmc {
//! #     const READ_SIZE: usize = 4;
//! #     async fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
//! #         bytes.copy_from_slice(&self.0[at as usize..][..bytes.len()]);
//! #         Ok(())
//! #     }
//! #     fn capacity(&self) -> usize { self.0.len() }
//! # }
//! # impl NorFlash for Nvmc {
//! #     const WRITE_SIZE: usize = 4;
//! #     const ERASE_SIZE: usize = 4096;
//! #     async fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
//! #         self.0[from as usize..to as usize].fill(0xFF);
//! #         Ok(())
//! #     }
//! #     async fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), Infallible> {
//! #         self.0[at as usize..][..bytes.len()].copy_from_slice(bytes);
//! #         Ok(())
//! #     }
//! # }
//! use embassy_embedded_hal::flash::partition::Partition;
//! use embassy_sync::{blocking_mutex::raw::NoopRawMutex, mutex::Mutex};
//! use zigbee_link::store::{Store, log::{Entry, Log}};
//!
//! # let nvmc = Nvmc([0xFF; 4 * 4096]);
//! # embassy_futures::block_on(async {
//! let flash = Mutex::<NoopRawMutex, _>::new(nvmc);
//! let half = 2 * 4096;
//! let link = Partition::new(&flash, 0, half);
//! let facts = Partition::new(&flash, half, half);
//!
//! let mut store = Store::new(link, 0..half)?;
//! let mut log = Log::<_, 128>::new(facts, 0..half)?;
//! log.open().await?;
//! let pose = Entry::new(1, b"x 2.5 m, y 7.0 m").ok_or("too long")?;
//! log.append(&pose).await?;
//! assert_eq!(log.find(1).await?, Some(pose));
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! # }).unwrap();
//! ```

use core::{fmt, ops::Range};

use embedded_storage_async::nor_flash::NorFlash;

/// Bytes of a slot before the value, and behind it.
const HEAD: usize = 2;
const SUM: usize = 4;
/// Version of the format, first byte of each slot.
const VERSION: u8 = 1;
/// Key of a bank's header; its value starts with the generation.
const HEADER: u8 = 0xFF;

/// A record: its key, and its value padded with zeros.
///
/// It is kept as the bytes of its slot, aligned as flash drivers may ask for.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(align(4))]
pub struct Entry<const SLOT: usize>([u8; SLOT]);

impl<const SLOT: usize> Entry<SLOT> {
    /// Bytes of the longest value.
    pub const VALUE_MAX: usize = {
        assert!(
            SLOT >= HEAD + 4 + SUM,
            "a slot must have room for the header of a bank"
        );
        SLOT - HEAD - SUM
    };

    /// A record. `None` for key 255, which is the log's own, and for more than
    /// [`VALUE_MAX`](Self::VALUE_MAX) bytes.
    pub fn new(key: u8, value: &[u8]) -> Option<Self> {
        let fits = key != HEADER && value.len() <= Self::VALUE_MAX;
        fits.then(|| Self::filled(key, value))
    }

    /// A slot whose checksum is right.
    fn filled(key: u8, value: &[u8]) -> Self {
        let mut slot = [0; SLOT];
        let content = [VERSION, key].into_iter().chain(value.iter().copied());
        if let Some((body, sum)) = slot.split_last_chunk_mut() {
            for (place, byte) in body.iter_mut().zip(content) {
                *place = byte;
            }
            *sum = crc32(body).to_le_bytes();
        }
        Self(slot)
    }

    fn header(generation: u32) -> Self {
        Self::filled(HEADER, &generation.to_le_bytes())
    }

    /// The key.
    pub const fn key(&self) -> u8 {
        match self.0.as_slice() {
            [_, key, ..] => *key,
            _ => HEADER,
        }
    }

    /// The value, with zeros behind it: [`VALUE_MAX`](Self::VALUE_MAX) bytes.
    pub fn value(&self) -> &[u8] {
        self.0.get(HEAD..HEAD + Self::VALUE_MAX).unwrap_or_default()
    }

    /// With `mends`, one wrong bit or a wrong key is put right.
    fn content(mut self, mends: bool) -> Content<SLOT> {
        if self.0.iter().all(|&byte| byte == 0xFF) {
            return Content::Erased;
        }
        let difference = difference(&self.0);
        let is_whole = difference == 0 || mends && mend(&mut self.0, difference);
        match self.0.first() {
            Some(&VERSION) if is_whole => Content::Entry(self, difference != 0),
            _ => Content::Bad,
        }
    }

    /// Of the header of a bank.
    fn generation(&self) -> Option<u32> {
        let generation = self
            .value()
            .first_chunk()
            .filter(|_| self.key() == HEADER)?;
        Some(u32::from_le_bytes(*generation))
    }
}

impl<const SLOT: usize> fmt::Debug for Entry<SLOT> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Values may be secrets.
        write!(f, "Entry {}", self.key())
    }
}

#[cfg(feature = "defmt")]
impl<const SLOT: usize> defmt::Format for Entry<SLOT> {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "Entry {}", self.key());
    }
}

/// What a slot holds.
enum Content<const SLOT: usize> {
    Erased,
    /// A record, and whether something of it was put right.
    Entry(Entry<SLOT>, bool),
    /// A write that lost its power, or a record that rotted.
    Bad,
}

/// CRC-32 (ISO-HDLC), bit by bit: slots are read rarely.
fn crc32(bytes: &[u8]) -> u32 {
    let crc = bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| shifted(crc))
    });
    !crc
}

/// Between the checksum that a slot should have and its own; 0 if it is whole.
// Not generic, so that logs of several sizes of slots share it.
#[inline(never)]
fn difference(slot: &[u8]) -> u32 {
    match slot.split_last_chunk() {
        Some((body, sum)) => crc32(body) ^ u32::from_le_bytes(*sum),
        None => u32::MAX,
    }
}

/// Flips the bit of a slot, or the bits of its key, that alone make this difference, if there are
/// such.
#[inline(never)]
fn mend(slot: &mut [u8], difference: u32) -> bool {
    let body = 8 * slot.len().saturating_sub(SUM);
    let in_sum = body + difference.trailing_zeros() as usize;
    let mut wrong = difference.is_power_of_two().then_some((in_sum, 1));
    // What a flip makes of the checksum is shifted once for each bit that follows.
    let mut effect = 1;
    let mut of_key = [0; 8];
    for bit in (0..body).rev() {
        effect = shifted(effect);
        if effect == difference {
            wrong = Some((bit, 1));
        }
        if let Some(place) = bit.checked_sub(8).and_then(|bit| of_key.get_mut(bit)) {
            *place = effect;
        }
    }
    let key = || {
        (1..=u8::MAX).find(|flips| {
            let bits = of_key.iter().enumerate();
            let bits = bits.filter(|(bit, _)| flips >> bit & 1 != 0);
            bits.fold(0, |sum, (_, effect)| sum ^ effect) == difference
        })
    };
    // A single bit is the likelier one.
    let wrong = wrong.or_else(|| Some((8, key()?)));
    match wrong.and_then(|(bit, flips)| Some((slot.get_mut(bit / 8)?, flips << (bit % 8)))) {
        Some((byte, flips)) => *byte ^= flips,
        None => return false,
    }
    true
}

/// A CRC-32 one bit later.
const fn shifted(crc: u32) -> u32 {
    (crc >> 1) ^ (0xEDB8_8320 * (crc & 1))
}

/// Why the log does not serve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LogError<E> {
    /// The range is not an even number of erase units of the flash, aligned; or slots are no
    /// multiple of its read and write units.
    Layout,
    /// Neither [`open`](Log::open), [`recover`](Log::recover) nor [`begin`](Log::begin) succeeded,
    /// or the flash failed since.
    NotOpen,
    /// A record was once there and cannot be read. [`Log::begin`] starts anew. Not from a log that
    /// was [opened](Log::open).
    Corrupt,
    /// The records of all keys do not fit a bank together with one more.
    Full,
    /// The flash failed.
    Flash(E),
}

impl<E> fmt::Display for LogError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Layout => "the log needs an aligned range of an even number of erase units",
            Self::NotOpen => "the log is not open",
            Self::Corrupt => "the log is damaged: begin it anew",
            Self::Full => "the log is full: give it a larger range",
            Self::Flash(_) => "the flash failed",
        })
    }
}

impl<E: fmt::Debug> core::error::Error for LogError<E> {}

/// What to do with a slot, or with the bank it is the first of.
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

/// What is found in a bank, slot by slot.
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

    fn add<const SLOT: usize>(&mut self, slot: u32, content: &Content<SLOT>) {
        if let Content::Erased = content {
            return;
        }
        self.begun |= slot == 0;
        self.rotten |= self.torn || self.used < slot;
        self.used = slot + 1;
        match content {
            Content::Entry(entry, mended) => {
                self.mended |= *mended;
                if slot == 0 {
                    self.generation = entry.generation();
                } else {
                    self.has_records = true;
                }
            }
            _ => self.torn = true,
        }
    }
}

/// A log in a range of a flash, in slots of `SLOT` bytes.
#[derive(Debug)]
pub struct Log<F, const SLOT: usize> {
    flash: F,
    start: u32,
    /// Bytes of a bank.
    bank_len: u32,
    active: Option<Active>,
    /// It was opened, not recovered: what rotted is done without.
    lenient: bool,
    /// Of the slot being read or written.
    buffer: Entry<SLOT>,
}

impl<F: NorFlash, const SLOT: usize> Log<F, SLOT> {
    /// A log in `range` of the flash, bytes from its start. It is not yet open.
    ///
    /// # Errors
    /// [`LogError::Layout`].
    pub fn new(flash: F, range: Range<u32>) -> Result<Self, LogError<F::Error>> {
        let unit = u32::try_from(F::ERASE_SIZE).map_err(|_| LogError::Layout)?;
        let len = range.end.checked_sub(range.start);
        let len = len.ok_or(LogError::Layout)?;
        let aligned = range.start.is_multiple_of(unit) && len.is_multiple_of(2 * unit);
        let sizes_fit = SLOT.is_multiple_of(F::WRITE_SIZE)
            && SLOT.is_multiple_of(F::READ_SIZE)
            && F::ERASE_SIZE >= SLOT;
        if len == 0 || !aligned || !sizes_fit {
            return Err(LogError::Layout);
        }
        Ok(Self {
            flash,
            start: range.start,
            bank_len: len / 2,
            active: None,
            lenient: false,
            buffer: Entry([0; SLOT]),
        })
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.flash
    }

    /// Slots of a bank. What is left at its end is not used.
    const fn slots(&self) -> u32 {
        self.bank_len / SLOT as u32
    }

    const fn place(&self, bank: u32, slot: u32) -> u32 {
        self.start + bank * self.bank_len + slot * SLOT as u32
    }

    /// All there is to do with the flash, in one place: every `await` of a future of its own would
    /// be code of its own.
    async fn access(
        &mut self,
        access: Access,
        bank: u32,
        slot: u32,
    ) -> Result<(), LogError<F::Error>> {
        let at = self.place(bank, slot);
        let done = match access {
            Access::Read => self.flash.read(at, &mut self.buffer.0).await,
            Access::Write if slot >= self.slots() => return Err(LogError::Full),
            Access::Write => self.flash.write(at, &self.buffer.0).await,
            Access::Erase => self.flash.erase(at, at + self.bank_len).await,
        };
        done.map_err(LogError::Flash)
    }

    /// Content of the slot last read.
    fn content(&self) -> Content<SLOT> {
        self.buffer.content(self.lenient)
    }

    /// Opens the log, for whoever can do without a record: it is begun if it never was, and what
    /// [rotted](self#rot) is left out.
    ///
    /// Neither bank having a header and no slot a record counts as never begun: so an erased range,
    /// any bytes that are not this log's, and a first opening that lost its power.
    ///
    /// # Errors
    /// The flash failed.
    pub async fn open(&mut self) -> Result<(), LogError<F::Error>> {
        self.lenient = true;
        let surveys = self.survey().await?;
        let is_void = |survey: &Survey| survey.generation.is_none() && !survey.has_records;
        if !surveys.iter().all(is_void) {
            self.resume(&surveys, |entry| entry).await?;
        }
        if self.in_force().is_err() {
            self.begin(&[]).await?;
        }
        Ok(())
    }

    /// Opens the log, for whoever must take neither an empty one for a new one nor an old record
    /// for the newest. `Ok(false)` if it was never begun, or that was cut off: it is not open then.
    /// A torn header counts as this only where nothing else is written.
    ///
    /// Finds the valid bank and finishes what a loss of power interrupted. `after_tear` is applied
    /// to every live record when the last write was torn, which may have been of that record; it
    /// must not change the key.
    ///
    /// # Errors
    /// [`LogError::Corrupt`], or the flash failed.
    pub async fn recover(
        &mut self,
        after_tear: fn(Entry<SLOT>) -> Entry<SLOT>,
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
            for slot in 0..self.slots() {
                self.access(Access::Read, bank, slot).await?;
                survey.add(slot, &self.content());
            }
        }
        Ok(surveys)
    }

    async fn resume(
        &mut self,
        [first, second]: &[Survey; 2],
        after_tear: fn(Entry<SLOT>) -> Entry<SLOT>,
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

    /// Begins the log anew with these records, in place of what was in it. When this returns `Ok`,
    /// a loss of power does not undo it. When it does not return, the log is as before: not begun if
    /// it never was. One that was neither [opened](Self::open) nor [recovered](Self::recover) may
    /// then be damaged.
    ///
    /// # Errors
    /// The flash failed, or is too small, and the log has to be opened again.
    pub async fn begin(&mut self, entries: &[Entry<SLOT>]) -> Result<(), LogError<F::Error>> {
        let from = match self.active.take() {
            Some(active) => active,
            None => {
                self.access(Access::Erase, 1, 0).await?;
                self.buffer = Entry::header(0);
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
        for (slot, entry) in (1..).zip(entries) {
            self.buffer.0.copy_from_slice(&entry.0);
            self.access(Access::Write, to, slot).await?;
        }
        self.replace(from, 1 + entries.len() as u32).await
    }

    /// Writes a record, in place of the one with the same key. When this returns `Ok`, a loss of
    /// power does not undo it; when it does not return, the record is as before or as told.
    ///
    /// # Errors
    /// The log is full, nothing has changed then; or not open; or the flash failed, and the log has
    /// to be opened again.
    pub async fn append(&mut self, entry: &Entry<SLOT>) -> Result<(), LogError<F::Error>> {
        if self
            .active
            .is_some_and(|active| active.free >= self.slots())
        {
            self.compact(|entry| entry).await?;
        }
        let active = self.in_force()?;
        if active.free >= self.slots() {
            return Err(LogError::Full);
        }
        // A failure in the middle leaves the log as a loss of power would.
        self.active = None;
        self.buffer.0.copy_from_slice(&entry.0);
        self.access(Access::Write, active.bank, active.free).await?;
        self.active = Some(Active {
            free: active.free + 1,
            ..active
        });
        Ok(())
    }

    /// The record with this key.
    ///
    /// # Errors
    /// The log is not open, has rotted since, or the flash failed.
    pub async fn find(&mut self, key: u8) -> Result<Option<Entry<SLOT>>, LogError<F::Error>> {
        let active = self.in_force()?;
        for slot in (1..active.free).rev() {
            self.access(Access::Read, active.bank, slot).await?;
            match self.content() {
                Content::Entry(entry, _) if entry.key() == key => return Ok(Some(entry)),
                Content::Entry(..) => {}
                _ if !self.lenient => return Err(LogError::Corrupt),
                // What was written before it may be true no more.
                _ if self.buffer.key() == key => return Ok(None),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Moves what is live to the other bank.
    async fn compact(
        &mut self,
        change: fn(Entry<SLOT>) -> Entry<SLOT>,
    ) -> Result<(), LogError<F::Error>> {
        let from = self.active.take().ok_or(LogError::NotOpen)?;
        let to = 1 - from.bank;
        self.access(Access::Erase, to, 0).await?;
        let mut done = [0_u32; 8];
        let mut free = 1;
        // From the newest back.
        for slot in (1..from.free).rev() {
            self.access(Access::Read, from.bank, slot).await?;
            let found = match self.content() {
                Content::Entry(entry, _) => Some(entry),
                // Torn: the record before it stands.
                Content::Bad if from.torn && slot + 1 == from.free => continue,
                _ if self.lenient => None,
                _ => return Err(LogError::Corrupt),
            };
            let key = self.buffer.key();
            let key = found.as_ref().map_or(key, Entry::key);
            let word = done.get_mut(usize::from(key / 32));
            let word = word.ok_or(LogError::Corrupt)?;
            let bit = 1 << (key % 32);
            if *word & bit != 0 {
                continue;
            }
            *word |= bit;
            if let Some(entry) = found {
                self.buffer = change(entry);
                self.access(Access::Write, to, free).await?;
                free += 1;
            }
        }
        self.replace(from, free).await
    }

    /// Puts the other bank in force, which has so many used slots.
    async fn replace(&mut self, from: Active, free: u32) -> Result<(), LogError<F::Error>> {
        let to = 1 - from.bank;
        // No bank outlives so many erasures as to come back to 0.
        let generation = from.generation.wrapping_add(1);
        self.buffer = Entry::header(generation);
        self.access(Access::Write, to, 0).await?;
        self.active = Some(Active {
            bank: to,
            generation,
            free,
            torn: false,
        });
        self.access(Access::Erase, from.bank, 0).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value_of_crc_32() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }

    /// Any wrong bit, or any wrong key, in slots of the sizes in use: nothing looks like another.
    fn is_put_right<const SLOT: usize>() {
        let whole = Entry::<SLOT>::filled(0x5A, &[1, 2, 3]);
        let bits = (0..SLOT * 8).map(|bit| (bit / 8, 1 << (bit % 8)));
        for (byte, flips) in bits.chain((1..=255).map(|flips| (1, flips))) {
            let mut slot = whole.0;
            slot[byte] ^= flips;
            let difference = difference(&slot);
            assert!(mend(&mut slot, difference));
            assert_eq!(slot, whole.0, "{flips:#x} of byte {byte}");
        }
    }

    #[test]
    fn a_wrong_bit_or_key_is_put_right() {
        is_put_right::<32>();
        is_put_right::<96>();
        is_put_right::<128>();
    }

    #[test]
    fn a_record_is_bounded() {
        assert_eq!(Entry::<32>::VALUE_MAX, 26);
        assert!(Entry::<32>::new(254, &[1; 26]).is_some());
        assert!(Entry::<32>::new(254, &[1; 27]).is_none());
        assert!(Entry::<32>::new(255, &[]).is_none());
        let entry = Entry::<96>::new(7, &[1, 2, 3]).unwrap();
        assert_eq!(entry.key(), 7);
        assert_eq!(entry.value()[..4], [1, 2, 3, 0]);
        assert_eq!(entry.value().len(), 90);
    }
}
