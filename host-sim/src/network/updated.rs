//! Updates by radio in a rehearsal: room for images in a node's flash, and the boot loader that changes them.
//!
//! A node takes images for the nRF52840-DK, packet by packet, with the code that runs on the board. After a change it
//! goes on with this program, and tells the version of the image that it would run.

use std::{cell::Cell, ops::Range};

use board_facts::{NRF52840_DK, regions::Updated};
use embassy_boot::{AlignedBuffer, BootLoader, BootLoaderConfig, State};
use embassy_futures::block_on;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash as BlockingFlash, ReadNorFlash as ReadBlockingFlash,
};
use embedded_storage_async::nor_flash::{NorFlash as _, ReadNorFlash as _};
use node_firmware::{config::RoleConfig, hardware::Updates};
use radio_update::{
    package::Key,
    stamp::{Stamp, board_number},
};
use virtual_hardware::{
    executor::Time,
    flash::{Flash, FlashError, PAGE, PAGE_TIME, WORD, WORD_TIME},
};

/// Parts of the flash of a node that takes updates, behind those of the link and of the role.
#[derive(Clone, Debug)]
pub(super) struct Parts {
    image: Range<u32>,
    spare: Range<u32>,
    state: Range<u32>,
    header: Range<u32>,
    key: Key,
}

/// Work of a boot loader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Boot {
    /// Time that it took.
    pub(super) takes: Time,
    /// It has changed images.
    pub(super) changed: bool,
    /// The image that runs; `None` before the first update.
    pub(super) image: Option<Stamp>,
}

impl Parts {
    /// Parts from a place in the flash on, as long as those of the nRF52840-DK. The nodes check images with this key.
    pub(super) fn new(from: u32, key: Key) -> Option<Self> {
        let Updated {
            image,
            spare,
            state,
            header,
            ..
        } = NRF52840_DK.updated.as_ref()?;
        let mut at = from;
        let mut behind = |part: &Range<u32>| {
            let start = at;
            at += part.end - part.start;
            start..at
        };
        Some(Self {
            image: behind(image),
            spare: behind(spare),
            state: behind(state),
            header: behind(header),
            key,
        })
    }

    /// The end of the last one.
    pub(super) const fn end(&self) -> u32 {
        self.header.end
    }

    /// Starts the node: its boot loader changes images if it was asked to, or goes back to the former one.
    ///
    /// # Errors
    /// The flash failed.
    pub(super) fn boot(&self, flash: &Flash) -> Result<Boot, FlashError> {
        let takes = Cell::new(0);
        let part = |range: &Range<u32>| Part {
            flash: flash.programmer(),
            range: range.clone(),
            takes: &takes,
        };
        let mut loader = BootLoader::new(BootLoaderConfig {
            active: part(&self.image),
            dfu: part(&self.spare),
            state: part(&self.state),
        });
        let mut page = AlignedBuffer([0; PAGE]);
        let state = loader.prepare_boot(&mut page.0);
        let state = state.map_err(|_| FlashError::Failed)?;
        let bytes = flash.bytes();
        let image = &bytes[self.image.start as usize..self.image.end as usize];
        Ok(Boot {
            takes: takes.get(),
            changed: takes.get() > 0 && state != State::Boot,
            image: Stamp::find(image).map(|(_, stamp)| stamp),
        })
    }

    /// The firmware's end, with this image.
    pub(super) fn firmware(&self, image: Option<Stamp>) -> Updates {
        Updates {
            state: self.state.clone(),
            header: self.header.clone(),
            spare: self.spare.clone(),
            board: board_number(NRF52840_DK.name),
            version: image.map_or(0, |stamp| stamp.version),
            roles: image.map_or(RoleConfig::BUILT, |stamp| stamp.roles),
            key: Some(self.key),
        }
    }
}

/// A part of the flash for the boot loader, which counts the time of its writes.
struct Part<'a> {
    flash: Flash,
    range: Range<u32>,
    takes: &'a Cell<Time>,
}

impl Part<'_> {
    fn spend(&self, steps: usize, each: Time) {
        self.takes.set(self.takes.get() + steps as Time * each);
    }
}

impl ErrorType for Part<'_> {
    type Error = FlashError;
}

impl ReadBlockingFlash for Part<'_> {
    const READ_SIZE: usize = WORD;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        block_on(self.flash.read(self.range.start + offset, bytes))
    }

    fn capacity(&self) -> usize {
        self.range.len()
    }
}

impl BlockingFlash for Part<'_> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        self.spend((to - from) as usize / PAGE, PAGE_TIME);
        let start = self.range.start;
        block_on(self.flash.erase(start + from, start + to))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        self.spend(bytes.len() / WORD, WORD_TIME);
        block_on(self.flash.write(self.range.start + offset, bytes))
    }
}

#[cfg(test)]
mod tests {
    use std::{
        cell::RefCell,
        collections::{BTreeMap, VecDeque},
        io,
        rc::Rc,
        time::Duration,
    };

    use node_firmware::console::{FRAME_MAX, Frames, FromPc, ToPc, encode};
    use radio_update::{
        package::{Package, public_key},
        packet::Phase,
        sender::Sender,
        stamp::STAMP,
    };
    use site::{Overrides, Scenario};

    use super::{
        super::{Options, SECOND, Simulation},
        *,
    };
    use crate::console::update as exchange;

    const SECRET: [u8; 32] = [9; 32];
    const LENGTH: usize = 30_000;

    /// A package of an image that nothing compresses.
    fn package(version: u32, board: &str, secret: &[u8; 32]) -> Package {
        let mut image: Vec<u8> = { 0..LENGTH as u32 }
            .map(|at| (at.wrapping_mul(2_654_435_761) >> 23) as u8)
            .collect();
        let stamp = Stamp {
            board: board_number(board),
            roles: RoleConfig::BUILT,
            version,
        };
        image[..STAMP].copy_from_slice(&stamp.bytes());
        Package::sign(&image, secret).unwrap()
    }

    /// A terminal of this program: bytes for it, and from it.
    #[derive(Clone, Default)]
    struct Terminal(Rc<RefCell<[VecDeque<u8>; 2]>>);

    impl io::Read for Terminal {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            match io::Read::read(&mut self.0.borrow_mut()[1], buffer) {
                Ok(0) => Err(io::ErrorKind::WouldBlock.into()),
                done => done,
            }
        }
    }

    impl io::Write for Terminal {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.borrow_mut()[0].extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// The network of `lab` and the PC on its line.
    struct Rehearsal {
        simulation: Simulation,
        terminal: Terminal,
        frames: Frames,
    }

    impl Rehearsal {
        fn new(key: Option<Key>) -> Self {
            let options = Options {
                update_key: key,
                ..Options::default()
            };
            let lab = Scenario::load("lab", &Overrides::default()).unwrap();
            let simulation = Simulation::new(lab, options).unwrap();
            let terminal = Terminal::default();
            simulation.consoles[0].connect(Box::new(terminal.clone()));
            Self {
                simulation,
                terminal,
                frames: Frames::default(),
            }
        }

        fn now(&self) -> Duration {
            Duration::from_nanos(self.simulation.executor.clock().time())
        }

        /// Messages of the next five milliseconds.
        fn listen(&mut self) -> Vec<ToPc> {
            let end = self.simulation.executor.clock().time() + SECOND / 200;
            self.simulation.run_until(end, &|| false);
            let bytes: Vec<u8> = self.terminal.0.borrow_mut()[0].drain(..).collect();
            bytes
                .into_iter()
                .filter_map(|byte| self.frames.push(byte))
                .collect()
        }

        fn say(&self, message: &FromPc) {
            let mut buffer = [0; FRAME_MAX];
            let frame = encode(message, &mut buffer).unwrap();
            self.terminal.0.borrow_mut()[1].extend(frame);
        }

        /// Gives all members and the coordinator a package. Returns the last state of each.
        fn update(&mut self, package: Package) -> BTreeMap<u16, Option<Phase>> {
            let members = self.simulation.nodes.len() - 1;
            let (mut nodes, begun) = (vec![0], self.now());
            while nodes.len() <= members {
                assert!(self.now() - begun < Duration::from_secs(120), "{nodes:?}");
                if self.now().subsec_millis() < 5 {
                    self.say(&FromPc::Refresh);
                }
                for message in self.listen() {
                    if let ToPc::Member { address, .. } = message
                        && !nodes.contains(&address)
                    {
                        nodes.push(address);
                    }
                }
            }
            let mut sender = Sender::new(package, nodes, 0);
            let begun = self.now();
            while !sender.is_done() {
                let now = self.now() - begun;
                assert!(now < Duration::from_secs(900), "{:?}", sender.nodes());
                for message in self.listen() {
                    exchange::hear(&mut sender, now, &message);
                }
                while let Some(message) = exchange::say(&mut sender, now) {
                    self.say(&message);
                }
            }
            println!("{:?}", self.now() - begun);
            let nodes = sender.nodes().iter();
            nodes
                .map(|(address, node)| (*address, node.phase))
                .collect()
        }
    }

    #[test]
    fn a_rehearsed_network_takes_an_image_and_calibrates_itself() {
        let mut rehearsal = Rehearsal::new(Some(public_key(&SECRET)));
        let told = rehearsal.update(package(7, NRF52840_DK.name, &SECRET));
        let is_new = |phase: &Option<Phase>| *phase == Some(Phase::Installed);
        assert!(told.values().all(is_new), "{told:?}");
        assert_eq!(told.len(), 9);
        let record = rehearsal.simulation.run(|_| ());
        let poses = record.cameras().filter(|camera| camera.is_calibrated());
        assert_eq!(poses.count(), 7);
        // A change of images is no failure.
        assert!(record.cameras().all(|camera| camera.failures.is_empty()));
        let again = rehearsal.update(package(6, NRF52840_DK.name, &SECRET));
        assert!(
            again.values().all(|phase| *phase == Some(Phase::Older)),
            "{again:?}"
        );
    }

    #[test]
    fn a_rehearsed_network_refuses_what_a_deployed_one_refuses() {
        for (board, secret, phase) in [
            ("nrf52833", &SECRET, Phase::Foreign),
            (NRF52840_DK.name, &[8; 32], Phase::Forged),
        ] {
            let mut rehearsal = Rehearsal::new(Some(public_key(&SECRET)));
            let told = rehearsal.update(package(7, board, secret));
            assert!(told.values().all(|told| *told == Some(phase)), "{told:?}");
        }
    }
}
