//! A log of fixed-size slots in two banks of a NOR flash.
//!
//! At rest one bank is valid and the other erased. Slot 0 of a bank is its header; it is written
//! last, so a bank with a header is whole. When a bank is full, what is live goes into the other
//! one, with the next generation, and then this one is erased.

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;

use super::StoreError;

/// Bytes of a slot. Every write size that divides it is supported.
const SLOT: usize = 32;
/// Bytes of a slot before its checksum.
const BODY: usize = SLOT - 4;
/// Bytes of a record's value.
pub(super) const VALUE_LEN: usize = BODY - 2;
/// Version of the format, first byte of each slot.
const VERSION: u8 = 1;
/// Record key of a bank's header; its value starts with the generation.
const HEADER: u8 = 0xFF;

/// A record: its key, and its value padded with zeros.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub key: u8,
    pub value: [u8; VALUE_LEN],
}

/// What a slot holds.
#[derive(Clone, Copy)]
enum Content {
    Erased,
    Entry(Entry),
    /// A write that lost its power, or a record that rotted.
    Bad,
}

/// Flash drivers may ask for word-aligned buffers.
#[repr(align(4))]
struct Slot([u8; SLOT]);

impl Slot {
    fn new(entry: Entry) -> Self {
        let mut slot = [0; SLOT];
        let body = [VERSION, entry.key].into_iter().chain(entry.value);
        for (place, byte) in slot.iter_mut().zip(body) {
            *place = byte;
        }
        let sum = crc32(&slot).to_le_bytes();
        for (place, byte) in slot.iter_mut().skip(BODY).zip(sum) {
            *place = byte;
        }
        Self(slot)
    }

    fn content(&self) -> Content {
        if self.0.iter().all(|&byte| byte == 0xFF) {
            return Content::Erased;
        }
        let [version, key, value @ .., a, b, c, d] = self.0;
        if version == VERSION && crc32(&self.0) == u32::from_le_bytes([a, b, c, d]) {
            Content::Entry(Entry { key, value })
        } else {
            Content::Bad
        }
    }
}

/// CRC-32 (ISO-HDLC) of a slot's body, bit by bit: slots are read rarely.
fn crc32(slot: &[u8; SLOT]) -> u32 {
    let crc = slot.iter().take(BODY).fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ (0xEDB8_8320 * (crc & 1))
        })
    });
    !crc
}

/// The valid bank.
#[derive(Clone, Copy, Debug)]
struct Active {
    bank: usize,
    generation: u32,
    /// The first slot that is not used.
    free: u32,
    /// The last slot used is bad. Nothing is written behind it, so that a bad slot before others
    /// is always rot.
    torn: bool,
}

/// The log.
#[derive(Debug)]
pub(super) struct Log<F> {
    flash: F,
    banks: [Range<u32>; 2],
    active: Option<Active>,
}

impl<F: NorFlash> Log<F> {
    pub(super) fn new(flash: F, range: Range<u32>) -> Result<Self, StoreError<F::Error>> {
        let unit = u32::try_from(F::ERASE_SIZE).map_err(|_| StoreError::Layout)?;
        let len = range
            .end
            .checked_sub(range.start)
            .ok_or(StoreError::Layout)?;
        let aligned = range.start.is_multiple_of(unit) && len.is_multiple_of(2 * unit);
        let sizes_fit = SLOT.is_multiple_of(F::WRITE_SIZE)
            && SLOT.is_multiple_of(F::READ_SIZE)
            && F::ERASE_SIZE.is_multiple_of(SLOT);
        if len == 0 || !aligned || !sizes_fit {
            return Err(StoreError::Layout);
        }
        let middle = range.start + len / 2;
        Ok(Self {
            flash,
            banks: [range.start..middle, middle..range.end],
            active: None,
        })
    }

    pub(super) fn into_flash(self) -> F {
        self.flash
    }

    fn bank(&self, bank: usize) -> Result<Range<u32>, StoreError<F::Error>> {
        self.banks.get(bank).cloned().ok_or(StoreError::Layout)
    }

    async fn read(&mut self, bank: usize, slot: u32) -> Result<Content, StoreError<F::Error>> {
        let range = self.bank(bank)?;
        let at = range.start + slot * SLOT as u32;
        if at >= range.end {
            return Ok(Content::Erased);
        }
        let mut bytes = Slot([0; SLOT]);
        let read = self.flash.read(at, &mut bytes.0).await;
        read.map_err(StoreError::Flash)?;
        Ok(bytes.content())
    }

    async fn write(
        &mut self,
        bank: usize,
        slot: u32,
        entry: Entry,
    ) -> Result<(), StoreError<F::Error>> {
        let range = self.bank(bank)?;
        let at = range.start + slot * SLOT as u32;
        if at >= range.end {
            return Err(StoreError::Full);
        }
        let written = self.flash.write(at, &Slot::new(entry).0).await;
        written.map_err(StoreError::Flash)
    }

    async fn erase(&mut self, bank: usize) -> Result<(), StoreError<F::Error>> {
        let range = self.bank(bank)?;
        let erased = self.flash.erase(range.start, range.end).await;
        erased.map_err(StoreError::Flash)
    }

    async fn generation(&mut self, bank: usize) -> Result<Option<u32>, StoreError<F::Error>> {
        Ok(match self.read(bank, 0).await? {
            Content::Entry(Entry {
                key: HEADER,
                value: [a, b, c, d, ..],
            }) => Some(u32::from_le_bytes([a, b, c, d])),
            _ => None,
        })
    }

    /// Finds the valid bank and finishes what a loss of power interrupted. `Ok(false)` if the log
    /// was never begun.
    ///
    /// `after_tear` is applied to every live record when the last write was torn, which may have
    /// been of that record.
    pub(super) async fn recover(
        &mut self,
        after_tear: impl Fn(Entry) -> Entry,
    ) -> Result<bool, StoreError<F::Error>> {
        self.active = None;
        let generations = [self.generation(0).await?, self.generation(1).await?];
        let (bank, generation) = match generations {
            [Some(first), Some(second)] if second > first => (1, second),
            [Some(first), _] => (0, first),
            [None, Some(second)] => (1, second),
            [None, None] => {
                let untouched = matches!(self.read(0, 0).await?, Content::Erased)
                    && matches!(self.read(1, 0).await?, Content::Erased);
                return if untouched {
                    Ok(false)
                } else {
                    Err(StoreError::Corrupt)
                };
            }
        };
        let mut free = 1;
        let mut torn = false;
        loop {
            match self.read(bank, free).await? {
                Content::Erased => break,
                // Something follows a bad slot.
                _ if torn => return Err(StoreError::Corrupt),
                Content::Entry(_) => {}
                Content::Bad => torn = true,
            }
            free += 1;
        }
        self.expect_erased(bank, free).await?;
        self.active = Some(Active {
            bank,
            generation,
            free,
            torn,
        });
        if torn {
            self.compact(after_tear).await?;
        } else if !matches!(self.read(1 - bank, 0).await?, Content::Erased) {
            self.erase(1 - bank).await?;
        }
        Ok(true)
    }

    /// That nothing is written behind the end: else what looks erased has rotted or was read wrong.
    async fn expect_erased(&mut self, bank: usize, free: u32) -> Result<(), StoreError<F::Error>> {
        let range = self.bank(bank)?;
        for slot in free..(range.end - range.start) / SLOT as u32 {
            if !matches!(self.read(bank, slot).await?, Content::Erased) {
                return Err(StoreError::Corrupt);
            }
        }
        Ok(())
    }

    /// Begins the log anew with these records.
    pub(super) async fn begin(&mut self, entries: &[Entry]) -> Result<(), StoreError<F::Error>> {
        self.active = None;
        self.erase(0).await?;
        self.erase(1).await?;
        let mut free = 1;
        for &entry in entries {
            self.write(0, free, entry).await?;
            free += 1;
        }
        self.finish(0, 1, free).await
    }

    /// Appends a record. Call [`recover`](Self::recover) or [`begin`](Self::begin) before.
    pub(super) async fn append(&mut self, entry: Entry) -> Result<(), StoreError<F::Error>> {
        for attempt in [1, 2] {
            let mut active = self.active.ok_or(StoreError::NotProvisioned)?;
            // A failure in the middle leaves the log as a loss of power would.
            self.active = None;
            match self.write(active.bank, active.free, entry).await {
                Ok(()) => {
                    active.free += 1;
                    self.active = Some(active);
                    return Ok(());
                }
                Err(StoreError::Full) if attempt == 1 => {
                    self.active = Some(active);
                    self.compact(|entry| entry).await?;
                }
                Err(error) => return Err(error),
            }
        }
        Err(StoreError::Full)
    }

    /// The newest record with this key.
    pub(super) async fn find(&mut self, key: u8) -> Result<Option<Entry>, StoreError<F::Error>> {
        let active = self.active.ok_or(StoreError::NotProvisioned)?;
        for slot in (1..active.free).rev() {
            match self.read(active.bank, slot).await? {
                Content::Entry(entry) if entry.key == key => return Ok(Some(entry)),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Moves what is live to the other bank.
    async fn compact(
        &mut self,
        change: impl Fn(Entry) -> Entry,
    ) -> Result<(), StoreError<F::Error>> {
        let from = self.active.take().ok_or(StoreError::NotProvisioned)?;
        let to = 1 - from.bank;
        self.erase(to).await?;
        let mut copied = [0_u32; 8];
        let mut free = 1;
        for slot in (1..from.free).rev() {
            let entry = match self.read(from.bank, slot).await? {
                Content::Entry(entry) => entry,
                Content::Bad if from.torn && slot + 1 == from.free => continue,
                _ => return Err(StoreError::Corrupt),
            };
            let Some(word) = copied.get_mut(usize::from(entry.key / 32)) else {
                continue;
            };
            let bit = 1 << (entry.key % 32);
            if *word & bit == 0 {
                *word |= bit;
                self.write(to, free, change(entry)).await?;
                free += 1;
            }
        }
        self.finish(to, from.generation.wrapping_add(1), free)
            .await?;
        self.erase(from.bank).await
    }

    async fn finish(
        &mut self,
        bank: usize,
        generation: u32,
        free: u32,
    ) -> Result<(), StoreError<F::Error>> {
        let mut value = [0; VALUE_LEN];
        for (place, byte) in value.iter_mut().zip(generation.to_le_bytes()) {
            *place = byte;
        }
        self.write(bank, 0, Entry { key: HEADER, value }).await?;
        self.active = Some(Active {
            bank,
            generation,
            free,
            torn: false,
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value_of_crc_32() {
        // The body "123456789" and zeros; the value from an independent implementation (zlib).
        let mut slot = [0; SLOT];
        slot[..9].copy_from_slice(b"123456789");
        assert_eq!(crc32(&slot), 0x6fde5a4a);
    }
}
