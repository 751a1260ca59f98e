//! Facts that a node must not forget, in a small NOR flash.
//!
//! [`Store`] keeps a few records in a checksummed log over two banks of a flash. A write that loses
//! its power half-way leaves the record before it; pages are worn evenly; a record that rots is not
//! taken for one that was never written: bad in the middle of the log, it is refused, and bad at
//! its end, where a torn write looks the same, the frame counter skips what that write may have
//! promised.
//!
//! Everything else of this crate is sans-IO and asks for records to be written
//! ([`Record`]); only this module touches flash, and only it and the runner are async. A blocking
//! flash serves through `embassy_embedded_hal::adapter::BlockingAsync` or the like.
//!
//! The log is [`flash_log`], which also serves other data that a node should keep.
//!
//! A page of 4 KiB holds 127 records and a counter reservation comes once per
//! [`BLOCK`] frames: with 10,000 erasures, some 2.5 billion frames.
//!
//! # Format, version 1
//! A log ([`flash_log`]) with slots of 32 bytes. Numbers in values are little-endian.
//!
//! | key | value |
//! |---|---|
//! | 0 | frame counter limit: u32 |
//! | 1 | key in use: 1, index, 16 bytes |
//! | 2 | next key: the same; 0 for none |
//! | 3 | network: 1, PAN u16, channel u8, own short address u16, coordinator's EUI-64; 0 for none |
//! | 4 | key the node was provisioned with, written as that in use; missing in older stores |
//! | 5 | own EUI-64: 1, 8 bytes; missing in older stores |
//! | 6 | a coordinator's former key, for members that missed its end: the same; 0 for none |
//! | 16 + n | member n of a coordinator: 1, EUI-64, short address u16; 0 for none |

use core::{fmt, ops::Range};

use embedded_storage_async::nor_flash::NorFlash;

use crate::{
    radio::Channel,
    security::{BLOCK, Key},
    wire::{Eui64, PanId, Reader, ShortAddress, Writer},
};
use flash_log::{Log, LogError};

/// Most members a coordinator can remember, for they have one byte of the format.
pub const MEMBERS_MAX: usize = 239;

/// Bytes of a slot.
const SLOT: usize = 32;

type Entry = flash_log::Entry<SLOT>;

const COUNTER: u8 = 0;
const ACTIVE_KEY: u8 = 1;
const NEXT_KEY: u8 = 2;
const NETWORK: u8 = 3;
const FIRST_KEY: u8 = 4;
const OWN: u8 = 5;
const FORMER_KEY: u8 = 6;
const MEMBERS: u8 = 16;

/// The network a node belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Membership {
    /// The identifier of its PAN.
    pub pan: PanId,
    /// The channel it is on.
    pub channel: Channel,
    /// The own short address.
    pub short: ShortAddress,
    /// The coordinator's extended address; the own one for the coordinator.
    pub coordinator: Eui64,
}

/// A device that a coordinator admitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Member {
    /// Its extended address.
    pub extended: Eui64,
    /// The address it was given.
    pub short: ShortAddress,
}

/// Something to write down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Record {
    /// Frame counters below this may be used.
    CounterLimit(u32),
    /// The key in use.
    ActiveKey(Key),
    /// The next key.
    NextKey(Option<Key>),
    /// The network the node belongs to, if any.
    Network(Option<Membership>),
    /// A place in the coordinator's table, below [`MEMBERS_MAX`].
    Member(u8, Option<Member>),
    /// The own extended address.
    Extended(Eui64),
    /// The key that was in use before, which members may still have.
    FormerKey(Option<Key>),
}

/// Everything written down, except the members.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Saved {
    /// Frame counters below this may have been used.
    pub counter_limit: u32,
    /// The key in use.
    pub active_key: Key,
    /// The next key.
    pub next_key: Option<Key>,
    /// The network the node belongs to, if any.
    pub network: Option<Membership>,
    /// The own extended address; `None` if the store is of a firmware that kept none.
    pub extended: Option<Eui64>,
    /// The key that was in use before, if members may still have it.
    pub former_key: Option<Key>,
}

impl Saved {
    /// Facts of a node that begins with these, and remembers nothing else.
    pub const fn of_new(key: Key, extended: Eui64) -> Self {
        Self {
            counter_limit: 0,
            active_key: key,
            next_key: None,
            network: None,
            extended: Some(extended),
            former_key: None,
        }
    }

    /// From the records with keys 0 to 6. `None` if one is not understood, or one of those that
    /// every node has is missing.
    fn decode(
        [counter, active, next, network, _, own, former]: &[Option<Entry>; 7],
    ) -> Option<Self> {
        fn value(entry: &Option<Entry>) -> Option<Reader<'_>> {
            entry.as_ref().map(|entry| Reader::new(entry.value()))
        }
        Some(Self {
            counter_limit: value(counter)?.u32().ok()?,
            active_key: decode_key(value(active)?)??,
            next_key: value(next).map_or(Some(None), decode_key)?,
            network: value(network).map_or(Some(None), decode_network)?,
            extended: value(own).map_or(Some(None), decode_extended)?,
            former_key: value(former).map_or(Some(None), decode_key)?,
        })
    }
}

/// Reason why the store does not serve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum StoreError<E> {
    /// The range is not an even number of erase units of the flash, aligned; or the flash's units
    /// do not fit slots of 32 bytes.
    Layout,
    /// There is no key: the node was never provisioned, and must not join or transmit.
    NotProvisioned,
    /// A record is missing or not understood. A node that transmitted now might use a nonce twice:
    /// provision it again, with a new key.
    Corrupt,
    /// The records do not fit the range.
    Full,
    /// The flash failed.
    Flash(E),
    /// The flash does not hold what was just written to it: it is worn out.
    Worn,
}

impl<E> fmt::Display for StoreError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Layout => "the store needs an aligned range of an even number of erase units",
            Self::NotProvisioned => "no site key: provision the node",
            Self::Corrupt => "the store is damaged: provision the node again, with a new key",
            Self::Full => "the store is full: give it a larger range",
            Self::Flash(_) => "the flash failed",
            Self::Worn => "the flash is worn out: it does not keep what is written",
        })
    }
}

impl<E: fmt::Debug> core::error::Error for StoreError<E> {}

impl<E> From<LogError<E>> for StoreError<E> {
    fn from(error: LogError<E>) -> Self {
        match error {
            LogError::Layout => Self::Layout,
            LogError::NotOpen => Self::NotProvisioned,
            LogError::Full => Self::Full,
            LogError::Flash(error) => Self::Flash(error),
            LogError::Worn => Self::Worn,
            // With a log that fails in any other way no node goes on, either.
            _ => Self::Corrupt,
        }
    }
}

/// The records of one node in a range of a flash.
#[derive(Debug)]
pub struct Store<F> {
    log: Log<F, SLOT>,
    is_abandoned: bool,
}

impl<F: NorFlash> Store<F> {
    /// A store in `range` of the flash, bytes from its start.
    ///
    /// # Errors
    /// [`StoreError::Layout`].
    pub fn new(flash: F, range: Range<u32>) -> Result<Self, StoreError<F::Error>> {
        let log = Log::new(flash, range)?;
        Ok(Self {
            log,
            is_abandoned: false,
        })
    }

    /// Gives the node a site key and an extended address. Everything else in the store is erased.
    ///
    /// `first_counter` is 0 for an address that no node has had. With one that was in use, it must be above every
    /// frame counter that was used with it under this key.
    ///
    /// To be done after [`load`](Self::load), whatever its result. Cut off half-way, the node is as before: not
    /// provisioned, or so with the key and the frame counter it had.
    ///
    /// # Errors
    /// The flash failed, and the store has to be loaded again.
    pub async fn provision(
        &mut self,
        key: Key,
        extended: Eui64,
        first_counter: u32,
    ) -> Result<(), StoreError<F::Error>> {
        let records = [
            Record::CounterLimit(first_counter),
            Record::ActiveKey(key),
            Record::Extended(extended),
        ];
        let [Some(counter), Some(active), Some(own)] = records.map(encode) else {
            return Err(StoreError::Full);
        };
        let first = Entry::new(FIRST_KEY, active.value()).ok_or(StoreError::Full)?;
        Ok(self.log.begin(&[counter, active, first, own]).await?)
    }

    /// The key the node was provisioned with, not one that came into use later. To be asked after
    /// [`load`](Self::load).
    ///
    /// # Errors
    /// [`StoreError::Corrupt`], or the flash failed.
    pub async fn first_key(&mut self) -> Result<Key, StoreError<F::Error>> {
        let first = match self.log.find(FIRST_KEY).await? {
            Some(first) => Some(first),
            None => self.log.find(ACTIVE_KEY).await?,
        };
        let key = first.and_then(|entry| decode_key(Reader::new(entry.value())));
        key.flatten().ok_or(StoreError::Corrupt)
    }

    /// Writes nothing any more, even if something is saved: for a flash that does not serve. Only for a node with
    /// an extended address that no node has had, and that is drawn anew at each start: the frame counters that it
    /// used will not be known.
    pub const fn abandon(&mut self) {
        self.is_abandoned = true;
    }

    /// Writes a record down. When this returns `Ok`, a loss of power does not undo it; when it does not return,
    /// the record is as before or as told. A write that fails once is tried again, in the other half of the flash.
    ///
    /// # Errors
    /// The flash failed or is full.
    pub async fn save(&mut self, record: Record) -> Result<(), StoreError<F::Error>> {
        if self.is_abandoned {
            return Ok(());
        }
        let entry = encode(record).ok_or(StoreError::Full)?;
        match self.log.append(&entry).await {
            Err(LogError::Flash(_) | LogError::Worn) => {}
            other => return Ok(other?),
        }
        if !self.log.recover(skip_block).await? {
            return Err(StoreError::Corrupt);
        }
        Ok(self.log.append(&entry).await?)
    }

    /// Reads everything but the members.
    ///
    /// # Errors
    /// [`StoreError::NotProvisioned`] or [`StoreError::Corrupt`]: do not transmit. Or the flash
    /// failed.
    pub async fn load(&mut self) -> Result<Saved, StoreError<F::Error>> {
        if !self.log.recover(skip_block).await? {
            return Err(StoreError::NotProvisioned);
        }
        let mut entries = [None; 7];
        for (key, entry) in (COUNTER..).zip(&mut entries) {
            *entry = self.log.find(key).await?;
        }
        Saved::decode(&entries).ok_or(StoreError::Corrupt)
    }

    /// Reads a place in the coordinator's table.
    ///
    /// # Errors
    /// The flash failed, or the record is not understood.
    pub async fn member(&mut self, place: u8) -> Result<Option<Member>, StoreError<F::Error>> {
        let Some(key) = MEMBERS.checked_add(place) else {
            return Ok(None);
        };
        match self.log.find(key).await? {
            None => Ok(None),
            Some(entry) => decode_member(Reader::new(entry.value())).ok_or(StoreError::Corrupt),
        }
    }

    /// Reads the first places of the coordinator's table, all in two passes over the store.
    ///
    /// # Errors
    /// As of [`member`](Self::member).
    pub async fn members<const PLACES: usize>(
        &mut self,
        members: &mut [Option<Member>; PLACES],
    ) -> Result<(), StoreError<F::Error>> {
        let mut slots = [0; PLACES];
        self.log.newest(MEMBERS, &mut slots).await?;
        for (member, slot) in members.iter_mut().zip(slots) {
            *member = match self.log.read(slot).await? {
                None => None,
                Some(entry) => {
                    decode_member(Reader::new(entry.value())).ok_or(StoreError::Corrupt)?
                }
            };
        }
        Ok(())
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.log.into_flash()
    }
}

/// The last write was torn. It may have been of the next reservation, which is one block.
fn skip_block(key: u8, value: &mut [u8]) {
    if let (COUNTER, Some(limit)) = (key, value.first_chunk_mut()) {
        *limit = u32::from_le_bytes(*limit)
            .saturating_add(BLOCK)
            .to_le_bytes();
    }
}

/// `None` for a member's place beyond [`MEMBERS_MAX`].
fn encode(record: Record) -> Option<Entry> {
    let mut value = [0; Entry::VALUE_MAX];
    let mut writer = Writer::new(&mut value);
    let key = match record {
        Record::CounterLimit(limit) => {
            writer.u32(limit).ok()?;
            COUNTER
        }
        Record::ActiveKey(key) => {
            encode_key(key, &mut writer)?;
            ACTIVE_KEY
        }
        Record::NextKey(key) => {
            if let Some(key) = key {
                encode_key(key, &mut writer)?;
            }
            NEXT_KEY
        }
        Record::FormerKey(key) => {
            if let Some(key) = key {
                encode_key(key, &mut writer)?;
            }
            FORMER_KEY
        }
        Record::Network(network) => {
            if let Some(network) = network {
                writer.u8(1).ok()?;
                writer.u16(network.pan.0).ok()?;
                writer.u8(network.channel.number()).ok()?;
                writer.u16(network.short.0).ok()?;
                writer.bytes(&network.coordinator.0).ok()?;
            }
            NETWORK
        }
        Record::Member(place, member) => {
            if let Some(member) = member {
                writer.u8(1).ok()?;
                writer.bytes(&member.extended.0).ok()?;
                writer.u16(member.short.0).ok()?;
            }
            if usize::from(place) >= MEMBERS_MAX {
                return None;
            }
            MEMBERS + place
        }
        Record::Extended(extended) => {
            writer.u8(1).ok()?;
            writer.bytes(&extended.0).ok()?;
            OWN
        }
    };
    Entry::new(key, &value)
}

fn encode_key(key: Key, writer: &mut Writer<'_>) -> Option<()> {
    writer.u8(1).ok()?;
    writer.u8(key.index()).ok()?;
    writer.bytes(key.secret()).ok()
}

// The outer option of the following is "understood", the inner one "there is one".

fn decode_key(mut value: Reader<'_>) -> Option<Option<Key>> {
    if value.u8().ok()? == 0 {
        return Some(None);
    }
    Key::new(value.u8().ok()?, value.array().ok()?).map(Some)
}

fn decode_network(mut value: Reader<'_>) -> Option<Option<Membership>> {
    if value.u8().ok()? == 0 {
        return Some(None);
    }
    Some(Some(Membership {
        pan: PanId(value.u16().ok()?),
        channel: Channel::new(value.u8().ok()?)?,
        short: ShortAddress(value.u16().ok()?),
        coordinator: Eui64(value.array().ok()?),
    }))
}

fn decode_extended(mut value: Reader<'_>) -> Option<Option<Eui64>> {
    if value.u8().ok()? == 0 {
        return Some(None);
    }
    Some(Some(Eui64(value.array().ok()?)))
}

fn decode_member(mut value: Reader<'_>) -> Option<Option<Member>> {
    if value.u8().ok()? == 0 {
        return Some(None);
    }
    Some(Some(Member {
        extended: Eui64(value.array().ok()?),
        short: ShortAddress(value.u16().ok()?),
    }))
}
