//! Updates by radio: the boot loader, the image of `NODE_UPDATED`, a coordinator whose PC spreads a package.

use std::{
    collections::{BTreeSet, VecDeque},
    sync::{Arc, Mutex},
    time::Duration,
};

use board_facts::NRF52840_DK;
use node_firmware::{
    console::{FRAME_MAX, FromPc, encode},
    message::UpdatePacket,
};
use radio_update::{
    package::{Package, key_record, public_key},
    sender::Sender,
    stamp::Stamp,
};

use rand::RngExt;

use super::*;

const SECRET: [u8; 32] = [17; 32];
/// `Updated` of `board-facts`: the loader and the image, and all else.
const PROGRAM: Range<u64> = 0..0x6_8000;
const IMAGE: u64 = 0x8000;
const FLASH_END: u64 = 0x10_0000;
/// Behind the longest configuration.
const KEY: u64 = PAGE + 512;
/// Nanoseconds of a byte at 115,200 baud.
const BYTE: u64 = 86_806;

fn file(variable: &str) -> PathBuf {
    env::var_os(variable)
        .unwrap_or_else(|| panic!("{variable} is not set"))
        .into()
}

/// The image of this version, as nodes take it.
fn binary(version: u32) -> Vec<u8> {
    let mut image = fs::read(file("NODE_UPDATED").with_extension("bin")).unwrap();
    let length = image.len();
    assert!(Stamp::set_version(&mut image, version, length));
    image
}

/// A node with boot loader, image of this version, configuration and key; its program in one piece, and the rest.
fn updated(node: Node, version: u32) -> Node {
    let mut flash = vec![0xFF; FLASH_END as usize];
    let mut put = |at: u64, bytes: &[u8]| {
        flash[at as usize..][..bytes.len()].copy_from_slice(bytes);
    };
    put(0, &fs::read(file("NODE_LOADER")).unwrap());
    put(IMAGE, &binary(version));
    for (at, bytes) in &node.flash {
        put(*at, bytes);
    }
    put(KEY, &key_record(&public_key(&SECRET)));
    let rest = flash.split_off(PROGRAM.end as usize);
    Node {
        image: file("NODE_UPDATED"),
        flash: vec![(0, flash), (PROGRAM.end, rest)],
        parts: Some([PROGRAM, PROGRAM.end..FLASH_END]),
        ..node
    }
}

/// The PC on the coordinator's line.
#[derive(Debug)]
struct Desk {
    frames: Frames,
    members: BTreeSet<u16>,
    /// Instant when the update begins.
    begins: u64,
    package: Package,
    sender: Option<Sender>,
    /// Bytes, and when each is sent.
    line: VecDeque<(u64, u8)>,
    free: u64,
    /// When the coordinator was switched on: it counts time from there.
    on: u64,
}

impl Desk {
    fn pump(&mut self, now: u64) {
        if now < self.begins || self.members.is_empty() {
            return;
        }
        let nodes = self.members.iter().copied().chain([0]);
        let sender = self
            .sender
            .get_or_insert_with(|| Sender::new(self.package.clone(), nodes, 0));
        while let Some(next) = sender.poll(Duration::from_nanos(now)) {
            let message = FromPc::Update {
                to: next.to.unwrap_or(0xFFFF),
                packet: UpdatePacket::new(&next.packet).unwrap(),
            };
            let mut buffer = [0; FRAME_MAX];
            let mut at = self.free.max(now);
            for &byte in encode(&message, &mut buffer).unwrap() {
                at += BYTE;
                self.line.push_back((at, byte));
            }
            self.free = at;
        }
    }
}

#[derive(Clone, Debug)]
struct Pc(Arc<Mutex<Desk>>);

impl Pc {
    fn new(package: Package, begins: u64) -> Self {
        Self(Arc::new(Mutex::new(Desk {
            frames: Frames::default(),
            members: BTreeSet::new(),
            begins,
            package,
            sender: None,
            line: VecDeque::new(),
            free: 0,
            on: 0,
        })))
    }

    /// The coordinator is switched on again: bytes on their way are lost.
    fn switched_on(&self, at: u64) {
        let mut desk = self.0.lock().unwrap();
        desk.on = at;
        desk.line.clear();
        desk.frames = Frames::default();
    }

    fn is_done(&self) -> bool {
        let desk = self.0.lock().unwrap();
        desk.sender.as_ref().is_some_and(Sender::is_done)
    }
}

impl Peer for Pc {
    fn receive(&mut self, byte: u8, at: u64) {
        let mut desk = self.0.lock().unwrap();
        let at = desk.on + at;
        let now = Duration::from_nanos(at);
        match desk.frames.push(byte) {
            Some(ToPc::Member { address, .. }) => {
                desk.members.insert(address);
            }
            Some(ToPc::Update { address, packet }) => {
                if let Some(sender) = &mut desk.sender {
                    sender.on_packet(now, address, packet.bytes());
                }
            }
            Some(ToPc::UpdateSent) => {
                if let Some(sender) = &mut desk.sender {
                    sender.on_sent(now);
                }
            }
            _ => {}
        }
        desk.pump(at);
    }

    fn transmit(&mut self, now: u64) -> Option<u8> {
        let mut desk = self.0.lock().unwrap();
        let now = desk.on + now;
        desk.pump(now);
        let (at, byte) = *desk.line.front()?;
        (at <= now).then(|| {
            desk.line.pop_front();
            byte
        })
    }

    fn next(&self) -> Option<u64> {
        let desk = self.0.lock().unwrap();
        let byte = desk.line.front().map(|(at, _)| *at);
        let thinks = match &desk.sender {
            None => (!desk.members.is_empty()).then_some(desk.begins),
            Some(sender) => sender.deadline().map(|time| time.as_nanos() as u64),
        };
        let next = byte.into_iter().chain(thinks).min()?;
        Some(next.saturating_sub(desk.on))
    }
}

/// The image that a node runs at the end.
fn runs(outcome: &Outcome, version: u32) -> bool {
    let (_, program) = &outcome.flash[0];
    let image = binary(version);
    program[IMAGE as usize..][..image.len()] == image
}

/// The unmodified images: coordinator and camera take an image, change to it, find each other again, and keep it.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_network_is_updated_by_radio() {
    let lab = lab();
    let package = Package::sign(&binary(2), &SECRET).unwrap();
    let blocks = package.blocks();
    let pc = Pc::new(package, 15 * S);
    let coordinator = Node {
        peer: Some(Box::new(pc.clone())),
        ..updated(lab.coordinator(), 1)
    };
    let nodes = [coordinator, updated(lab.camera(0), 1)];
    let count = nodes.len();
    let mut network = Network::default();
    for (number, node) in nodes.into_iter().enumerate() {
        network.switch_on(number, node, 0);
    }
    let mut airtime = 0;
    while network.reached() < 400 * S && !pc.is_done() {
        let until = network.reached() + S;
        for (_, number, deed) in network.run(until) {
            match deed {
                Deed::Fails(why) => panic!("{number}: {why}"),
                Deed::Sends(frame) => {
                    airtime += frame.end() - frame.start;
                    for to in (0..count).filter(|to| *to != number) {
                        network.input(to, Input::Frame(frame.clone(), LEVEL.into()));
                    }
                }
                _ => {}
            }
        }
    }
    let ended = network.reached();
    let desk = pc.0.lock().unwrap();
    let sender = desk.sender.as_ref().unwrap();
    println!(
        "{blocks} blocks, {:?}, {} s, {} s of airtime",
        sender.sent(),
        ended / S,
        airtime / S
    );
    assert!(sender.has_succeeded(), "{:?}", sender.nodes());
    assert_eq!(sender.nodes().len(), count);
    drop(desk);
    for number in 0..count {
        let outcome = network.switch_off(number).unwrap().unwrap();
        println!("{number}: {:?}", outcome.resets);
        assert!(runs(&outcome, 2), "{number}");
        assert_eq!(outcome.forbidden, []);
        assert_eq!(outcome.unmapped, [""; 0]);
    }
}

/// An image on trial that cannot use the configuration is not fed for ever: the one before it comes back.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn an_image_that_cannot_read_its_configuration_goes_back() {
    let parts = NRF52840_DK.updated.as_ref().unwrap();
    // UICR is written once, and takes a restart.
    let mut network = Network::default();
    network.switch_on(0, updated(lab().camera(0), 1), 0);
    let _ = network.run(5 * S);
    let before = network.switch_off(0).unwrap().unwrap();
    let mut node = Node {
        flash: before.flash,
        ..updated(lab().camera(0), 1)
    };
    let mut put = |at: u64, bytes: &[u8]| {
        let (start, part) = node
            .flash
            .iter_mut()
            .rfind(|(start, _)| *start <= at)
            .unwrap();
        part[(at - *start) as usize..][..bytes.len()].copy_from_slice(bytes);
    };
    // The package was taken, and the boot loader is to change images.
    put(parts.spare.start.into(), &binary(2));
    put(parts.state.start.into(), &[0xF0; 4]);
    put(PAGE, &[0; 16]);
    let mut network = Network::default();
    network.switch_on(0, node, 0);
    while network.reached() < 90 * S {
        let until = network.reached() + S;
        for (_, _, deed) in network.run(until) {
            if let Deed::Fails(why) = deed {
                panic!("{why}");
            }
        }
    }
    let outcome = network.switch_off(0).unwrap().unwrap();
    let [reset] = &outcome.resets[..] else {
        panic!("{:?}", outcome.resets);
    };
    assert!(reset.by.contains("WDT"), "{reset:?}");
    assert!(runs(&outcome, 1));
}

/// Power of a node goes at any time, often in the middle of a write, and a third of all frames is lost: every node runs
/// every image at last. `NODE_CUTS` is a number of cuts: none in the run of every day, as fifty take a quarter of an hour.
#[test]
#[ignore = "`cargo xtask bench chip`"]
fn updates_survive_losses_of_power() {
    let cuts = env::var("NODE_CUTS")
        .ok()
        .and_then(|cuts| cuts.parse().ok());
    let cuts: usize = cuts.unwrap_or(0);
    let skip = env::var("NODE_SKIP")
        .ok()
        .and_then(|skip| skip.parse().ok());
    let skip: u32 = skip.unwrap_or(0);
    let mut random = test_support::generator(21);
    let (mut done, mut version) = (0, 1);
    while done < cuts {
        let seed = random.random_range(0..1000);
        if version < skip {
            version += 1;
            continue;
        }
        done += update_with_cuts(version, &mut test_support::generator(seed));
        version += 1;
        println!("{done} losses of power in {} updates", version - 1);
    }
}

/// An update to the next version. Returns the number of cuts.
fn update_with_cuts(version: u32, random: &mut impl RngExt) -> usize {
    let lab = lab();
    let package = Package::sign(&binary(version + 1), &SECRET).unwrap();
    let pc = Pc::new(package, 20 * S);
    let node = |number: usize| match number {
        0 => Node {
            peer: Some(Box::new(pc.clone())),
            ..updated(lab.coordinator(), version)
        },
        _ => updated(lab.camera(0), version),
    };
    let mut network = Network::default();
    for number in 0..2 {
        network.switch_on(number, node(number), 0);
    }
    let (mut cuts, mut next) = (0, 25 * S);
    // The node whose power goes, and when.
    let mut falls: Option<(usize, u64)> = None;
    // The node that has no power, and when it comes again.
    let mut rises: Option<(usize, u64, Node)> = None;
    while network.reached() < 7200 * S && !pc.is_done() {
        let mut until = network.reached() + S;
        if let Some((number, at, again)) = rises.take() {
            until = until.min(at);
            if network.reached() >= at {
                if number == 0 {
                    pc.switched_on(network.reached());
                }
                network.switch_on(number, again, 0);
            } else {
                rises = Some((number, at, again));
            }
        } else if let Some((number, at)) = falls {
            until = until.min(at);
            if network.reached() >= at {
                let outcome = network.switch_off(number).unwrap().unwrap();
                assert_eq!(outcome.forbidden, []);
                assert_eq!(outcome.unmapped, [""; 0]);
                let again = Node {
                    flash: outcome.flash,
                    ..node(number)
                };
                rises = Some((number, at + 50 * MS, again));
                until = at + 50 * MS;
                cuts += 1;
                falls = None;
                next = at + random.random_range(0..60 * S);
            }
        } else if network.reached() >= next {
            let number = usize::from(random.random_bool(0.7));
            next = u64::MAX;
            if random.random_bool(0.5) {
                network.input(number, Input::StandInWrite);
                // In case that it writes nothing.
                next = network.reached() + 30 * S;
            } else {
                falls = Some((number, network.reached()));
            }
        }
        for (at, number, deed) in network.run(until) {
            match deed {
                Deed::Fails(why) => panic!("{number}: {why}"),
                Deed::Writes(takes) => {
                    falls = Some((number, at + random.random_range(0..takes)));
                }
                Deed::Sends(frame) if !random.random_bool(0.3) => {
                    network.input(1 - number, Input::Frame(frame, LEVEL.into()));
                }
                _ => {}
            }
        }
    }
    let desk = pc.0.lock().unwrap();
    let sender = desk.sender.as_ref().unwrap();
    println!(
        "{cuts} cuts, {} s, {:?}",
        network.reached() / S,
        sender.sent()
    );
    assert!(sender.has_succeeded(), "{:?}", sender.nodes());
    assert_eq!(sender.nodes().len(), 2);
    drop(desk);
    for number in 0..2 {
        let outcome = network.switch_off(number).unwrap().unwrap();
        assert!(runs(&outcome, version + 1), "{number}");
    }
    cuts
}
