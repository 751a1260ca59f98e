//! A node's flash as an nRF52840 has it, with the boot loader and a node on it.

use std::{cell::RefCell, rc::Rc};

use embassy_boot::{AlignedBuffer, BootError, BootLoader, BootLoaderConfig};
use embassy_futures::block_on;
use embedded_storage::nor_flash::{self as blocking, ErrorType, NorFlashError, NorFlashErrorKind};
use radio_update::{
    PAGE,
    embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash},
    package::{Package, public_key},
    packet::PACKET_MAX,
    receiver::{Layout, Own, Reaction, Receiver},
    stamp::{STAMP, Stamp, board_number},
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

pub(crate) const SECRET: [u8; 32] = [42; 32];
pub(crate) const PAGES: usize = 5;
const SIZE: u32 = PAGE as u32;

/// Parts: active, spare, state, header.
fn layout() -> (core::ops::Range<u32>, Layout) {
    let active = PAGES as u32 * SIZE;
    let spare = active + (PAGES as u32 + 1) * SIZE;
    let layout = Layout {
        spare: active..spare,
        state: spare..spare + SIZE,
        header: spare + SIZE..spare + 2 * SIZE,
    };
    (0..active, layout)
}

pub(crate) fn stamp(version: u32) -> Stamp {
    Stamp {
        board: board_number("nrf52840"),
        roles: 7,
        version,
    }
}

/// An image of some length that nothing compresses.
pub(crate) fn image(length: usize, version: u32) -> Vec<u8> {
    let mut state = 0x9e37_79b9_u32 ^ version;
    let mut image = Vec::new();
    for _ in 0..length {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        image.push((state >> 24) as u8);
    }
    image[500..][..STAMP].copy_from_slice(&stamp(version).bytes());
    image
}

pub(crate) fn package(length: usize, version: u32) -> Package {
    Package::sign(&image(length, version), &SECRET).unwrap()
}

struct Memory {
    bytes: Vec<u8>,
    /// Writes of each word since it was erased.
    writes: Vec<u8>,
    power: Option<u32>,
    /// A byte of which no bit rises again.
    stuck: Option<usize>,
    random: ChaCha8Rng,
}

/// A flash whose power may fail.
#[derive(Clone)]
pub(crate) struct Chip(Rc<RefCell<Memory>>);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Failed;

impl NorFlashError for Failed {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl Memory {
    /// Returns true if this change is whole, false if it is torn.
    fn spend(&mut self) -> Result<bool, Failed> {
        match &mut self.power {
            None => Ok(true),
            Some(0) => Err(Failed),
            Some(left) => {
                *left -= 1;
                Ok(*left > 0)
            }
        }
    }

    fn erase(&mut self, page: usize) -> Result<(), Failed> {
        let is_whole = self.spend()?;
        for at in page * PAGE..(page + 1) * PAGE {
            let risen = if is_whole { 0xFF } else { self.random.random() };
            self.bytes[at] |= risen;
        }
        for word in page * PAGE / 4..(page + 1) * PAGE / 4 {
            self.writes[word] = 0;
        }
        if is_whole { Ok(()) } else { Err(Failed) }
    }

    fn write(&mut self, at: usize, word: &[u8]) -> Result<(), Failed> {
        let is_whole = self.spend()?;
        // Product Specification, "NVMC": at most twice between two erasures.
        self.writes[at / 4] += 1;
        assert!(
            self.writes[at / 4] <= 2,
            "the word at {at:#x} is written too often"
        );
        for (old, new) in self.bytes[at..at + 4].iter_mut().zip(word) {
            let kept: u8 = if is_whole { 0 } else { self.random.random() };
            *old &= new | kept;
        }
        if let Some(stuck) = self.stuck {
            self.bytes[stuck] = 0;
        }
        if is_whole { Ok(()) } else { Err(Failed) }
    }
}

impl ErrorType for Chip {
    type Error = Failed;
}

impl blocking::ReadNorFlash for Chip {
    const READ_SIZE: usize = 4;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        blocking::check_read(self, offset, bytes.len()).unwrap();
        let memory = self.0.borrow();
        if memory.power == Some(0) {
            return Err(Failed);
        }
        bytes.copy_from_slice(&memory.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.borrow().bytes.len()
    }
}

impl blocking::NorFlash for Chip {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        blocking::check_erase(self, from, to).unwrap();
        let mut memory = self.0.borrow_mut();
        (from as usize / PAGE..to as usize / PAGE).try_for_each(|page| memory.erase(page))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        blocking::check_write(self, offset, bytes.len()).unwrap();
        let mut memory = self.0.borrow_mut();
        for (number, word) in bytes.chunks(4).enumerate() {
            memory.write(offset as usize + 4 * number, word)?;
        }
        Ok(())
    }
}

impl ReadNorFlash for Chip {
    const READ_SIZE: usize = 4;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        blocking::ReadNorFlash::read(self, offset, bytes)
    }

    fn capacity(&self) -> usize {
        blocking::ReadNorFlash::capacity(self)
    }
}

impl NorFlash for Chip {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        blocking::NorFlash::erase(self, from, to)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        blocking::NorFlash::write(self, offset, bytes)
    }
}

/// A part of the flash for the boot loader.
struct Part(Chip, core::ops::Range<u32>);

impl ErrorType for Part {
    type Error = Failed;
}

impl blocking::ReadNorFlash for Part {
    const READ_SIZE: usize = 4;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Failed> {
        blocking::ReadNorFlash::read(&mut self.0, self.1.start + offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.1.len()
    }
}

impl blocking::NorFlash for Part {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Failed> {
        let start = self.1.start;
        blocking::NorFlash::erase(&mut self.0, start + from, start + to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Failed> {
        blocking::NorFlash::write(&mut self.0, self.1.start + offset, bytes)
    }
}

/// A node: its flash, and its receiver while it runs.
pub(crate) struct Node {
    pub(crate) chip: Chip,
    pub(crate) receiver: Option<Receiver<Chip>>,
    pub(crate) own: Own,
}

impl Node {
    /// A node that runs an image of version 1 and this length.
    pub(crate) fn new(length: usize, random: ChaCha8Rng) -> Self {
        let size = layout().1.header.end as usize;
        let mut bytes = vec![0xFF; size];
        bytes[..length].copy_from_slice(&image(length, 1));
        let memory = Memory {
            bytes,
            writes: vec![0; size / 4],
            power: None,
            stuck: None,
            random,
        };
        Self {
            chip: Chip(Rc::new(RefCell::new(memory))),
            receiver: None,
            own: Own {
                stamp: stamp(1),
                role: 2,
                key: Some(public_key(&SECRET)),
            },
        }
    }

    /// Power for so many changes of the flash, or for good.
    pub(crate) fn power(&self, changes: Option<u32>) {
        self.chip.0.borrow_mut().power = changes;
    }

    /// From now on a byte of the spare part reads 0, whatever is written.
    pub(crate) fn break_byte(&self, at: usize) {
        let stuck = layout().1.spare.start as usize + at;
        self.chip.0.borrow_mut().stuck = Some(stuck);
    }

    pub(crate) fn has_power(&self) -> bool {
        self.chip.0.borrow().power != Some(0)
    }

    /// The first bytes of the active part.
    pub(crate) fn active(&self, length: usize) -> Vec<u8> {
        self.chip.0.borrow().bytes[..length].to_vec()
    }

    /// Starts: the boot loader, and then the image. Returns false if power fails meanwhile.
    pub(crate) fn start(&mut self) -> bool {
        self.receiver = None;
        let (active, layout) = layout();
        let part = |range| Part(self.chip.clone(), range);
        let mut loader = BootLoader::new(BootLoaderConfig {
            active: part(active.clone()),
            dfu: part(layout.spare.clone()),
            state: part(layout.state.clone()),
        });

        let booted = loader.prepare_boot(&mut AlignedBuffer([0; 256]).0);
        if let Err(BootError::BadMagic) = booted {
            panic!("the boot loader does not know its state");
        }
        if booted.is_err() {
            return false;
        }
        let bytes = self.active(active.len());
        let (_, running) = Stamp::find(&bytes).expect("an image runs");
        self.own.stamp = running;
        let opened = Receiver::open(self.chip.clone(), layout, self.own);
        self.receiver = Some(block_on(opened));
        self.has_power()
    }

    /// Takes a packet and works. Returns its answer.
    pub(crate) fn take(&mut self, packet: &[u8]) -> Option<Vec<u8>> {
        let receiver = self.receiver.as_mut()?;
        let reaction = block_on(receiver.on_packet(packet));
        while receiver.has_work() {
            block_on(receiver.work());
        }
        match reaction {
            Reaction::Answer { from, .. } => {
                let mut buffer = [0; PACKET_MAX];
                let length = receiver.status(from, &mut buffer);
                Some(buffer[..length].to_vec())
            }
            Reaction::Restart => {
                self.start();
                None
            }
            Reaction::Nothing => None,
        }
    }

    /// It is in its network again.
    pub(crate) fn confirm(&mut self) {
        if let Some(receiver) = &mut self.receiver {
            block_on(receiver.confirm());
        }
    }
}
