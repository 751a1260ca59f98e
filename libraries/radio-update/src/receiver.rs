//! A node: takes blocks, checks them, has its boot loader change images.
//!
//! A [`Receiver`] has no task and no time of its own. Its user hands it packets ([`Receiver::on_packet`]), lets it
//! work as long as it [has work](Receiver::has_work), and sends its answers. The flash may lose its power at any
//! moment: what was taken is found again by the checksums of pages.
//!
//! The boot loader is that of `embassy-boot`: its state, its active part and its spare part. A new image runs on trial
//! until [`Receiver::confirm`]; without that, the next start goes back to the former image.

use core::ops::Range;

use embassy_boot::{FirmwareState, State};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use salty::Sha512;

use crate::{
    BLOCK, CRC, PAGE,
    blocks::Blocks,
    package::{HEADER_BLOCKS, Header, Key},
    packet::{NO_ANSWER, PACKET_MAX, Packet, Phase, RangeWriter},
    stamp::Stamp,
};

/// Parts of the flash, bytes from its start. Each is whole erase units.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// State of the boot loader.
    pub state: Range<u32>,
    /// Header of the package that is taken: one erase unit.
    pub header: Range<u32>,
    /// The spare part, one page longer than the part from which images run.
    pub spare: Range<u32>,
}

/// Facts of the node that decide which images it takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Own {
    /// Kind and version of the image that runs.
    pub stamp: Stamp,
    /// The role of the node, as a bit of [`Stamp::roles`].
    pub role: u8,
    /// Key with which images are checked, if the node was given one.
    pub key: Option<Key>,
}

/// Returns true if the first word of the boot loader's state says that the image runs on trial.
pub fn is_on_trial(word: &[u8]) -> bool {
    State::from(word) == State::Swap
}

/// Request of a packet to the receiver's user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reaction {
    /// None.
    Nothing,
    /// Send the [status](Receiver::status).
    Answer {
        /// The first block to be listed.
        from: u16,
        /// Wait a random time up to this before, milliseconds.
        spread_ms: u16,
    },
    /// Restart the node: the boot loader changes images.
    Restart,
}

/// Whole pages that may be wrong between two starts before the flash counts as broken.
const WRONG_MAX: u8 = 16;

/// The flash failed.
struct Failed;

/// Contents of the spare part before.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Before {
    /// Another image.
    Other,
    /// A part of this image: a block that is not erased is one of its own. One that was torn by a loss of power is
    /// found by the checksum of its page.
    Begun,
}

/// Work that takes some time.
#[derive(Clone, Copy)]
enum Work {
    None,
    /// Finds what is there of the next page, and erases it if it is of another image.
    Prepare(usize, Before),
    /// Adds the next page to the hash.
    Check(usize),
}

/// The receiver of a node.
pub struct Receiver<F> {
    flash: F,
    layout: Layout,
    own: Own,
    /// Name of the package; 0: none.
    package: u32,
    header: [u8; HEADER_BLOCKS * BLOCK],
    header_length: usize,
    blocks: Blocks,
    phase: Phase,
    work: Work,
    /// Of the pages that are checked.
    hash: Sha512,
    /// Whole pages that were not as the header says.
    wrong: u8,
}

/// A part of a flash.
struct Part<'a, F> {
    flash: &'a mut F,
    range: Range<u32>,
}

impl<F: ErrorType> ErrorType for Part<'_, F> {
    type Error = F::Error;
}

impl<F: ReadNorFlash> ReadNorFlash for Part<'_, F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.flash.read(self.range.start + offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.range.len()
    }
}

impl<F: NorFlash> NorFlash for Part<'_, F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        let start = self.range.start;
        self.flash.erase(start + from, start + to).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        self.flash.write(self.range.start + offset, bytes).await
    }
}

/// The header at the start of these bytes.
fn header_of(bytes: &[u8]) -> Option<Header<'_>> {
    (0..=bytes.len())
        .rev()
        .find_map(|end| Header::parse(bytes.get(..end)?))
}

impl<F: NorFlash> Receiver<F> {
    const UNITS_FIT: () = assert!(
        BLOCK.is_multiple_of(F::WRITE_SIZE)
            && BLOCK.is_multiple_of(F::READ_SIZE)
            && PAGE.is_multiple_of(F::ERASE_SIZE)
            && F::WRITE_SIZE <= WORD
            && F::READ_SIZE <= WORD,
        "blocks and pages are whole units of the flash"
    );

    /// Finds out how far the update came before the start.
    pub async fn open(flash: F, layout: Layout, own: Own) -> Self {
        let () = Self::UNITS_FIT;
        let mut receiver = Self {
            flash,
            layout,
            own,
            package: 0,
            header: [0; HEADER_BLOCKS * BLOCK],
            header_length: 0,
            blocks: Blocks::new(),
            phase: Phase::Idle,
            work: Work::None,
            hash: Sha512::new(),
            wrong: 0,
        };
        if receiver.load().await.is_err() {
            receiver.phase = Phase::Flash;
        }
        receiver
    }

    async fn load(&mut self) -> Result<(), Failed> {
        let state = self.state(None).await?;
        let read = self.flash.read(self.layout.header.start, &mut self.header);
        read.await.map_err(|_| Failed)?;
        let own = self.own;
        let header = header_of(&self.header)
            .filter(|header| own.key.is_some_and(|key| header.is_signed(&key)));
        let is_installed = header.is_some_and(|header| header.stamp.version == own.stamp.version);
        // The node may have another role, or another key, than when it took the header.
        let is_newer = header.is_some_and(|header| self.refusal(&header).is_none());
        if let Some(header) = header {
            self.package = header.package();
            self.header_length = header.length_of_header();
        }
        self.phase = match state {
            State::Swap => Phase::Trial,
            State::Revert if is_newer => Phase::Reverted,
            _ if is_installed => Phase::Installed,
            _ if is_newer => {
                self.work = Work::Prepare(0, Before::Begun);
                Phase::Preparing
            }
            _ => {
                self.package = 0;
                Phase::Idle
            }
        };
        let is_known = matches!(self.phase, Phase::Preparing | Phase::Reverted);
        for block in 0..self.header_blocks() {
            self.blocks.set(block, is_known);
        }
        Ok(())
    }

    /// The state of the boot loader, or `None` where it is to be another one.
    async fn state(&mut self, change: Option<State>) -> Result<State, Failed> {
        let part = Part {
            flash: &mut self.flash,
            range: self.layout.state.clone(),
        };
        let mut word = [0; WORD];
        let size = F::WRITE_SIZE.max(F::READ_SIZE);
        let word = word.get_mut(..size).ok_or(Failed)?;
        let mut state = FirmwareState::new(part, word);
        let done = match change {
            None => return state.get_state().await.map_err(|_| Failed),
            Some(State::Swap) => state.mark_updated().await,
            Some(_) => state.mark_booted().await,
        };
        done.map(|()| State::Boot).map_err(|_| Failed)
    }

    /// State of the update.
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Returns true where the node is to [`work`](Self::work).
    pub const fn has_work(&self) -> bool {
        !matches!(self.work, Work::None)
    }

    const fn header_blocks(&self) -> usize {
        self.header_length.div_ceil(BLOCK)
    }

    fn parsed(&self) -> Option<Header<'_>> {
        Header::parse(self.header.get(..self.header_length)?)
    }

    /// Blocks of the package, as far as they are known: those of the header, and of all.
    fn count(&self) -> usize {
        let image = match self.phase {
            Phase::Header => None,
            _ => self.parsed(),
        };
        self.header_blocks() + image.map_or(0, |header| header.blocks())
    }

    /// Takes a packet.
    pub async fn on_packet(&mut self, bytes: &[u8]) -> Reaction {
        let reaction = match Packet::parse(bytes) {
            Some(Packet::Offer {
                package,
                header,
                from,
                spread_ms,
            }) => {
                self.on_offer(package, header.into(), from == NO_ANSWER);
                Ok(match from {
                    NO_ANSWER => Reaction::Nothing,
                    _ => Reaction::Answer { from, spread_ms },
                })
            }
            Some(Packet::Block {
                package,
                number,
                bytes,
            }) if package == self.package => self.take(number.into(), bytes).await,
            Some(Packet::Mix {
                package,
                numbers,
                bytes,
            }) if package == self.package => self.unmix(numbers, bytes).await,
            Some(Packet::Install { package }) if package == self.package => self.install().await,
            _ => Ok(Reaction::Nothing),
        };
        reaction.unwrap_or_else(|Failed| {
            self.phase = Phase::Flash;
            self.work = Work::None;
            Reaction::Nothing
        })
    }

    /// With the first offer of a run, to which no answer is wanted, a flash that failed is tried again.
    fn on_offer(&mut self, package: u32, header: usize, is_first: bool) {
        let is_busy = matches!(self.phase, Phase::Trial | Phase::Installing);
        let fits = header > 0 && header <= self.header.len();
        let is_known = package == self.package && !(is_first && self.phase == Phase::Flash);
        if is_known || is_busy || !fits {
            return;
        }
        self.package = package;
        self.header_length = header;
        self.blocks = Blocks::new();
        self.wrong = 0;
        self.work = Work::None;
        self.phase = if self.own.key.is_none() {
            Phase::NoKey
        } else {
            Phase::Header
        };
    }

    /// Takes a block.
    async fn take(&mut self, number: usize, bytes: &[u8; BLOCK]) -> Result<Reaction, Failed> {
        if self.blocks.has(number) || number >= self.count() {
            return Ok(Reaction::Nothing);
        }
        match (self.phase, number.checked_sub(self.header_blocks())) {
            (Phase::Header, None) => {
                let place = self.header.get_mut(number * BLOCK..(number + 1) * BLOCK);
                place.ok_or(Failed)?.copy_from_slice(bytes);
                self.blocks.set(number, true);
                if self.blocks.missing(self.header_blocks()) == 0 {
                    self.accept().await?;
                }
            }
            (Phase::Receiving, Some(block)) => {
                let at = self.layout.spare.start + (block * BLOCK) as u32;
                self.flash.write(at, bytes).await.map_err(|_| Failed)?;
                self.blocks.set(number, true);
                self.close(block / (PAGE / BLOCK)).await?;
            }
            _ => {}
        }
        Ok(Reaction::Nothing)
    }

    /// Takes the one block of a mix that is missing.
    async fn unmix(&mut self, numbers: &[u8], bytes: &[u8; BLOCK]) -> Result<Reaction, Failed> {
        let numbers = numbers.as_chunks::<2>().0.iter();
        let mut numbers = numbers.map(|number| usize::from(u16::from_le_bytes(*number)));
        let mut wanted = numbers.clone().filter(|&number| !self.blocks.has(number));
        let (Some(number), None) = (wanted.next(), wanted.next()) else {
            return Ok(Reaction::Nothing);
        };
        if self.phase != Phase::Receiving {
            return Ok(Reaction::Nothing);
        }
        let mut mixed = *bytes;
        for known in numbers.by_ref().filter(|&known| known != number) {
            let Some(block) = known.checked_sub(self.header_blocks()) else {
                return Ok(Reaction::Nothing);
            };
            let mut bytes = [0; BLOCK];
            let at = self.layout.spare.start + (block * BLOCK) as u32;
            self.flash.read(at, &mut bytes).await.map_err(|_| Failed)?;
            for (to, from) in mixed.iter_mut().zip(bytes) {
                *to ^= from;
            }
        }
        self.take(number, &mixed).await
    }

    /// Judges a header that is whole.
    /// Reason why this node does not take the image of a header.
    fn refusal(&self, header: &Header<'_>) -> Option<Phase> {
        let (own, stamp) = (&self.own, header.stamp);
        let room = self.layout.spare.len().saturating_sub(PAGE);
        if !own.key.is_some_and(|key| header.is_signed(&key)) {
            Some(Phase::Forged)
        } else if stamp.board != own.stamp.board || stamp.roles & own.role != own.role {
            Some(Phase::Foreign)
        } else if stamp.version <= own.stamp.version {
            Some(Phase::Older)
        } else if header.pages() * PAGE > room {
            Some(Phase::TooLong)
        } else {
            None
        }
    }

    async fn accept(&mut self) -> Result<(), Failed> {
        let Some(header) = self
            .parsed()
            .filter(|header| header.package() == self.package)
        else {
            // Blocks of another package under the same name: it is taken again.
            self.blocks = Blocks::new();
            return Ok(());
        };
        if let Some(refusal) = self.refusal(&header) {
            self.phase = refusal;
            return Ok(());
        }
        let Range { start, end } = self.layout.header;
        // The former one goes first: its pages are no more.
        self.flash.erase(start, end).await.map_err(|_| Failed)?;
        self.flash
            .write(start, &self.header)
            .await
            .map_err(|_| Failed)?;
        self.phase = Phase::Preparing;
        self.work = Work::Prepare(0, Before::Other);
        Ok(())
    }

    /// The numbers of the blocks of a page of the image.
    fn of_page(&self, page: usize) -> Range<usize> {
        let first = self.header_blocks() + page * (PAGE / BLOCK);
        first..self.count().min(first + PAGE / BLOCK)
    }

    /// Returns true if a page is as the header says.
    async fn is_right(&mut self, page: usize) -> Result<bool, Failed> {
        let Some(wanted) = self.parsed().and_then(|header| header.checksum(page)) else {
            return Ok(false);
        };
        let mut digest = CRC.digest();
        let start = self.layout.spare.start + (page * PAGE) as u32;
        let mut bytes = [0; BLOCK];
        for at in (start..start + PAGE as u32).step_by(BLOCK) {
            self.flash.read(at, &mut bytes).await.map_err(|_| Failed)?;
            digest.update(&bytes);
        }
        Ok(digest.finalize() == wanted)
    }

    /// Finds the blocks of a page that are there: all of a right one, and those that are not erased of another one.
    async fn find(&mut self, page: usize, is_right: bool) -> Result<(), Failed> {
        for block in self.of_page(page) {
            let mut bytes = [0; BLOCK];
            let at = (block - self.header_blocks()) * BLOCK;
            let read = (self.flash).read(self.layout.spare.start + at as u32, &mut bytes);
            read.await.map_err(|_| Failed)?;
            let is_there = is_right || bytes.iter().any(|byte| *byte != 0xFF);
            self.blocks.set(block, is_there);
        }
        Ok(())
    }

    async fn erase(&mut self, page: usize) -> Result<(), Failed> {
        let start = self.layout.spare.start + (page * PAGE) as u32;
        let erased = self.flash.erase(start, start + PAGE as u32);
        erased.await.map_err(|_| Failed)?;
        for block in self.of_page(page) {
            self.blocks.set(block, false);
        }
        Ok(())
    }

    /// Checks a page that has all its blocks, and begins the last check if nothing is missing.
    async fn close(&mut self, page: usize) -> Result<(), Failed> {
        let is_full = self.of_page(page).all(|block| self.blocks.has(block));
        if is_full && !self.is_right(page).await? {
            // A loss of power spoils a page; a flash that keeps wrong bytes does so again and again.
            self.wrong += 1;
            if self.wrong >= WRONG_MAX {
                return Err(Failed);
            }
            self.erase(page).await?;
        }
        self.finish();
        Ok(())
    }

    /// Begins the last check if nothing is missing.
    fn finish(&mut self) {
        if self.phase == Phase::Receiving && self.blocks.missing(self.count()) == 0 {
            self.phase = Phase::Checking;
            self.work = Work::Check(0);
            self.hash = Sha512::new();
        }
    }

    /// Does a part of the work, one page of the flash: up to 85 ms on an nRF52, where a page is erased.
    pub async fn work(&mut self) {
        if self.step().await.is_err() {
            self.phase = Phase::Flash;
            self.work = Work::None;
        }
    }

    async fn step(&mut self) -> Result<(), Failed> {
        let Some((pages, length)) = self.parsed().map(|header| (header.pages(), header.length))
        else {
            self.work = Work::None;
            return Ok(());
        };
        let work = self.work;
        self.work = Work::None;
        match work {
            Work::None => {}
            Work::Prepare(page, before) if page < pages => {
                let is_right = self.is_right(page).await?;
                if is_right || before == Before::Begun {
                    self.find(page, is_right).await?;
                }
                let is_full = self.of_page(page).all(|block| self.blocks.has(block));
                if !is_right && (is_full || before == Before::Other) {
                    self.erase(page).await?;
                }
                self.work = Work::Prepare(page + 1, before);
            }
            Work::Prepare(..) => {
                self.phase = Phase::Receiving;
                self.finish();
            }
            Work::Check(page) if page < pages => {
                let start = page * PAGE;
                let end = (start + PAGE).min(length as usize);
                let mut bytes = [0; BLOCK];
                for at in (start..end).step_by(BLOCK) {
                    let from = self.layout.spare.start + at as u32;
                    self.flash
                        .read(from, &mut bytes)
                        .await
                        .map_err(|_| Failed)?;
                    self.hash.update(bytes.get(..end - at).unwrap_or(&bytes));
                }
                self.work = Work::Check(page + 1);
            }
            Work::Check(_) => {
                let hash = core::mem::take(&mut self.hash);
                let is_right = self.parsed().is_some_and(|header| header.is_hash(hash));
                self.phase = if is_right {
                    Phase::Complete
                } else {
                    Phase::Damaged
                };
            }
        }
        Ok(())
    }

    async fn install(&mut self) -> Result<Reaction, Failed> {
        if self.phase == Phase::Reverted {
            // The boot loader has put the new image back into the spare part: it is checked, and then tried again.
            self.phase = Phase::Preparing;
            self.work = Work::Prepare(0, Before::Begun);
        }
        if self.phase != Phase::Complete {
            return Ok(Reaction::Nothing);
        }
        self.state(Some(State::Swap)).await?;
        self.phase = Phase::Installing;
        Ok(Reaction::Restart)
    }

    /// The node is in its network: a new image that runs on trial stays.
    pub async fn confirm(&mut self) {
        if self.phase == Phase::Trial {
            let booted = self.state(Some(State::Boot)).await;
            self.phase = if booted.is_ok() {
                Phase::Installed
            } else {
                Phase::Flash
            };
        }
    }

    /// Writes the answer to an offer, and returns its length.
    pub fn status(&self, from: u16, buffer: &mut [u8; PACKET_MAX]) -> usize {
        let count = self.count();
        let is_asked = matches!(self.phase, Phase::Header | Phase::Receiving);
        let missing = if is_asked {
            self.blocks.missing(count)
        } else {
            0
        };
        let mut ranges = RangeWriter::new();
        let mut at = usize::from(from);
        while let Some((start, count)) = self.blocks.gap(at, count).filter(|_| is_asked)
            && ranges.push(start, count)
        {
            at = start + count;
        }
        let status = Packet::Status {
            package: self.package,
            version: self.own.stamp.version,
            phase: self.phase,
            missing: missing as u16,
            ranges: ranges.bytes(),
        };
        status.write(buffer)
    }
}

/// Bytes of the largest unit that is read or written: that of an STM32L4.
const WORD: usize = 8;
