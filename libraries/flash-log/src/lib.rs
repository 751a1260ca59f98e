#![doc = include_str!("../README.md")]
//!
//! Every record takes a slot of `SLOT` bytes: 6 of the log and a value of up to `SLOT - 6`. `SLOT`
//! is a multiple of the flash's read and write size, at most [`SLOT_MAX`]; 128 gives 122 bytes, and
//! 31 records to a page of 4 KiB. Logs of several sizes on one type of flash share their code.
//!
//! # Format, version 1
//! A slot is: version 1, key, value padded with zeros, CRC-32 (ISO-HDLC) of all that, as little-endian u32. A bank
//! is half the range. At rest one bank is valid and the other erased. Slot 0 of a bank is its header: key 255,
//! generation as little-endian u32. It is written last, so a bank with a header is whole. Records follow, then
//! erased slots. When a bank is full, the newest record of each key goes into the other one, with the next
//! generation, and then this one is erased. [Beginning](Log::begin) a log anew is the same with other records.
//! Where there was none, an empty bank of generation 0 comes first: it says that the log is being begun, and that
//! the contents of the other bank without a header were never in force.
//!
//! # Rot
//! Flash may lose a bit. A user that [recovers](Log::recover) a log is told: no written record is then taken for
//! one that was not. A user that [opens](Log::open) it gets what is left: one flipped bit of a slot is put right,
//! and so is a wrong key if all else is right, for the checksum tells which it was (no two of these have the same
//! effect on a CRC-32). A record with more damage is lost, and with it the records written under its key before:
//! they may be true no more. Its key is then the one that is read. So where the damage is to the key and to other
//! bytes, the record written before under the right key comes back, and those written before under the key that is
//! read are lost. At the end of the log more damage is taken for a torn write, and the record written before
//! stands.
//!
//! # What only looks erased
//! A flash with a checksum for each unit, as the STM32L4's, may refuse to be written where a write lost its
//! power, though it reads as erased there. The slot is then made a torn one: the failure is told, and when
//! the log is opened next, what is live goes into the other bank.
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
//! use flash_log::{Entry, Log};
//!
//! # let nvmc = Nvmc([0xFF; 4 * 4096]);
//! # embassy_futures::block_on(async {
//! let flash = Mutex::<NoopRawMutex, _>::new(nvmc);
//! let half = 2 * 4096;
//! let [poses, counters] = [0, half].map(|start| Partition::new(&flash, start, half));
//!
//! let mut counters = Log::<_, 32>::new(counters, 0..half)?;
//! counters.open().await?;
//! let mut log = Log::<_, 128>::new(poses, 0..half)?;
//! log.open().await?;
//! let pose = Entry::new(1, b"x 2.5 m, y 7.0 m").ok_or("too long")?;
//! log.append(&pose).await?;
//! assert_eq!(log.find(1).await?, Some(pose));
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! # }).unwrap();
//! ```
//!
//! # Size
//! Functions that are not inlined, though the compiler would, have several callers and make the image
//! smaller; they are marked `size`.
//!
//! # Why not a ready-made map
//! With `sequential-storage` 8.0.2, erasures cut off half-way, which may
//! leave anything in a page, lost records in the power-cut test of this crate; and it skips records
//! with a wrong checksum silently, which for a frame counter is a nonce used twice.

#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod banks;
mod crc;
mod dirty;
mod slot;

use core::{fmt, ops::Range};

use embedded_storage_async::nor_flash::NorFlash;

use self::{
    banks::Banks,
    slot::{HEAD, HEADER, SUM},
};
pub use self::{crc::Crc32, dirty::DirtySet};

/// Bytes of the longest slot.
pub const SLOT_MAX: usize = 128;

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
        fits.then(|| {
            let mut filled = [0; SLOT];
            slot::fill(&mut filled, key, value);
            Self(filled)
        })
    }

    /// The key, 0 to 254.
    pub const fn key(&self) -> u8 {
        slot::key(self.0.as_slice())
    }

    /// The value, with zeros behind it: [`VALUE_MAX`](Self::VALUE_MAX) bytes.
    pub fn value(&self) -> &[u8] {
        self.0.get(HEAD..HEAD + Self::VALUE_MAX).unwrap_or_default()
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

/// Reason why the log does not serve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
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
    /// The flash does not hold what was just written to it, or was not erased: it is worn out.
    Worn,
}

impl<E> fmt::Display for LogError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Layout => "the log needs an aligned range of an even number of erase units",
            Self::NotOpen => "the log is not open",
            Self::Corrupt => "the log is damaged: begin it anew",
            Self::Full => "the log is full: give it a larger range",
            Self::Flash(_) => "the flash failed",
            Self::Worn => "the flash is worn out: it does not keep what is written",
        })
    }
}

impl<E: fmt::Debug> core::error::Error for LogError<E> {}

/// A log in a range of a flash, in slots of `SLOT` bytes.
#[derive(Debug)]
pub struct Log<F, const SLOT: usize>(Banks<F>);

impl<F: NorFlash, const SLOT: usize> Log<F, SLOT> {
    /// A log in `range` of the flash, bytes from its start. It is not yet open.
    ///
    /// # Errors
    /// [`LogError::Layout`].
    pub fn new(flash: F, range: Range<u32>) -> Result<Self, LogError<F::Error>> {
        Ok(Self(Banks::new(flash, range, SLOT)?))
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.0.into_flash()
    }

    /// Opens the log, for a user that can do without a record: it is begun if it never was, and records that
    /// [rotted](self#rot) are left out.
    ///
    /// Neither bank having a header and no slot a record counts as never begun: so an erased range,
    /// any bytes that are not this log's, and a first opening that lost its power.
    ///
    /// # Errors
    /// The flash failed.
    pub fn open(&mut self) -> impl Future<Output = Result<(), LogError<F::Error>>> {
        self.0.open()
    }

    /// Opens the log, for a user that must take neither an empty one for a new one nor an old record for the
    /// newest. `Ok(false)` if it was never begun, or that was cut off: it is not open then. A torn header counts
    /// as this only where nothing else is written.
    ///
    /// Finds the valid bank and finishes work that a loss of power interrupted. `after_tear` gets the key and the
    /// value of every live record when the last write was torn, which may have been of that record.
    ///
    /// # Errors
    /// [`LogError::Corrupt`], or the flash failed.
    pub fn recover(
        &mut self,
        after_tear: fn(u8, &mut [u8]),
    ) -> impl Future<Output = Result<bool, LogError<F::Error>>> {
        self.0.recover(after_tear)
    }

    /// Begins the log anew with these records, in place of what was in it. When this returns `Ok`,
    /// a loss of power does not undo it. When it does not return, the log is as before: not begun if
    /// it never was. One that was neither [opened](Self::open) nor [recovered](Self::recover) may
    /// then be damaged.
    ///
    /// # Errors
    /// The flash failed, or is too small, and the log has to be opened again.
    pub async fn begin(&mut self, entries: &[Entry<SLOT>]) -> Result<(), LogError<F::Error>> {
        let entry = |number: usize| Some(entries.get(number)?.0.as_slice());
        self.0.begin(&entry).await
    }

    /// Writes a record, in place of the one with the same key. When this returns `Ok`, a loss of
    /// power does not undo it; when it does not return, the record is as before or as told.
    ///
    /// # Errors
    /// The log is full, nothing has changed then; or not open; or the flash failed, and the log has
    /// to be opened again.
    pub fn append(
        &mut self,
        entry: &Entry<SLOT>,
    ) -> impl Future<Output = Result<(), LogError<F::Error>>> {
        self.0.append(&entry.0)
    }

    /// The record with this key.
    ///
    /// # Errors
    /// The log is not open, has rotted since, or the flash failed.
    pub async fn find(&mut self, key: u8) -> Result<Option<Entry<SLOT>>, LogError<F::Error>> {
        let is_found = self.0.find(key).await?;
        Ok(is_found.then(|| self.entry()))
    }

    /// Slot of the newest record of each key from `first` on, 0 for none, all in one pass. To be
    /// [read](Self::read) before anything else is written.
    ///
    /// # Errors
    /// As of [`find`](Self::find).
    pub fn newest(
        &mut self,
        first: u8,
        slots: &mut [u16],
    ) -> impl Future<Output = Result<(), LogError<F::Error>>> {
        self.0.newest(first, slots)
    }

    /// The record in a slot, as [`newest`](Self::newest) told it; `None` for 0.
    ///
    /// # Errors
    /// As of [`find`](Self::find).
    pub async fn read(&mut self, slot: u16) -> Result<Option<Entry<SLOT>>, LogError<F::Error>> {
        let is_found = self.0.read(slot.into()).await?;
        Ok(is_found.then(|| self.entry()))
    }

    /// The slot last read.
    fn entry(&mut self) -> Entry<SLOT> {
        let mut entry = Entry([0; SLOT]);
        copy(&mut entry.0, self.0.slot());
        entry
    }
}

/// Copies as much as both have. Unlike `copy_from_slice` it leaves no branch to a panic where it is
/// not inlined.
fn copy(to: &mut [u8], from: &[u8]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
