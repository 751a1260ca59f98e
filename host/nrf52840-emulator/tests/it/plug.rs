//! The images of `NODE_PLUG`, a dongle's, and `NODE_PLUG_KIT`, a kit's, whose coordinator speaks with a PC at the USB plug
//! of its chip.

use std::{
    collections::VecDeque,
    env, fs,
    ops::Range,
    path::PathBuf,
    sync::{Arc, Mutex},
};

use board_facts::{Board, NRF52840_DK, PCA10059};
use node_firmware::{
    config::{CheckedConfig, page},
    console::{FRAME_MAX, Frames, FromPc, ToPc, encode},
};
use nrf52840_emulator::{
    Deed, Input, Network, Node, Outcome,
    peripheral::{Pc, Peer},
};

use object::{
    Endianness,
    elf::PT_LOAD,
    read::elf::{ElfFile32, ProgramHeader},
};

use crate::image::{LEVEL, S, lab};

const BOARD: &Board = &PCA10059;
const FLASH_END: usize = 0x10_0000;

/// The master boot record, as far as an image needs it: it takes stack and program from the image's own table of
/// vectors. `LDR R0, [PC, #8]; LDR R1, [R0]; MOV SP, R1; LDR R0, [R0, #4]; BX R0`, and the table's address.
fn boot_record() -> Vec<u8> {
    let code: [u16; 6] = [0x4802, 0x6801, 0x468d, 0x6840, 0x4700, 0xbf00];
    let vectors = [0x2000_0400, 9];
    let words = vectors.into_iter().flat_map(u32::to_le_bytes);
    let code = code.into_iter().flat_map(u16::to_le_bytes);
    let image = BOARD.regions.image.start.to_le_bytes();
    words.chain(code).chain(image).collect()
}

fn image(variable: &str) -> PathBuf {
    let image = env::var_os(variable);
    image
        .unwrap_or_else(|| panic!("{variable} is not set"))
        .into()
}

fn page(config: &CheckedConfig) -> Vec<u8> {
    let mut page = vec![0xff; page::PAGE_MAX];
    page::encode(config, &mut page).unwrap();
    page
}

/// A kit as its debug probe leaves it, with blank memory.
fn kit(config: &CheckedConfig) -> Node {
    Node {
        image: image("NODE_PLUG_KIT"),
        flash: vec![(NRF52840_DK.config().into(), page(config))],
        ..Node::default()
    }
}

/// A dongle as it comes from its boot loader, with blank memory.
fn dongle(config: &CheckedConfig) -> Node {
    let image = image("NODE_PLUG");
    let elf = fs::read(&image).unwrap();
    let program = ElfFile32::<Endianness>::parse(elf.as_slice()).unwrap();
    let page = page(config);
    let mut flash = vec![0xff; FLASH_END];
    let mut put = |at: u32, bytes: &[u8]| {
        flash[at as usize..][..bytes.len()].copy_from_slice(bytes);
    };
    put(0, &boot_record());
    for part in program.elf_program_headers() {
        let bytes = part.data(Endianness::Little, elf.as_slice()).unwrap();
        if part.p_type(Endianness::Little) == PT_LOAD && !bytes.is_empty() {
            put(part.p_paddr(Endianness::Little), bytes);
        }
    }
    put(BOARD.regions.config.start, &page);
    let end = BOARD.regions.image.end as usize;
    let rest = flash.split_off(end);
    let end = end as u64;
    Node {
        image,
        flash: vec![(0, flash), (end, rest)],
        parts: Some([0..end, end..FLASH_END as u64]),
        ..Node::default()
    }
}

/// A program that has the port open: it asks for everything again and again.
#[derive(Clone, Debug, Default)]
struct Program(Arc<Mutex<Desk>>);

#[derive(Debug, Default)]
struct Desk {
    frames: Frames,
    heard: Vec<(u64, ToPc)>,
    /// Bytes to send, and time of the next question.
    line: VecDeque<u8>,
    asks: u64,
}

impl Peer for Program {
    fn receive(&mut self, byte: u8, at: u64) {
        let mut desk = self.0.lock().unwrap();
        if let Some(message) = desk.frames.push(byte) {
            desk.heard.push((at, message));
        }
    }

    fn transmit(&mut self, now: u64) -> Option<u8> {
        let mut desk = self.0.lock().unwrap();
        if desk.line.is_empty() && desk.asks <= now {
            desk.asks = now + 5 * S;
            let mut buffer = [0; FRAME_MAX];
            desk.line = encode(&FromPc::Refresh, &mut buffer)
                .unwrap()
                .iter()
                .copied()
                .collect();
        }
        desk.line.pop_front()
    }

    fn next(&self) -> Option<u64> {
        let desk = self.0.lock().unwrap();
        Some(if desk.line.is_empty() { desk.asks } else { 0 })
    }
}

/// A coordinator with this PC and a camera run for a time, on boards of a kind.
fn run(board: fn(&CheckedConfig) -> Node, pc: Option<Pc>, time: u64) -> [Outcome; 2] {
    let lab = lab();
    let coordinator = Node {
        pc,
        ..board(&lab.configs.coordinator)
    };
    let mut network = Network::default();
    network.switch_on(0, coordinator, 0);
    let camera = Node {
        peer: Some(Box::new(lab.eye(0))),
        ..board(&lab.configs.cameras[0])
    };
    network.switch_on(1, camera, 0);
    while network.reached() < time {
        for (_, number, deed) in network.run(time) {
            match deed {
                Deed::Fails(why) => panic!("{number}: {why}"),
                Deed::Sends(frame) => {
                    network.input(1 - number, Input::Frame(frame, LEVEL.into()));
                }
                _ => {}
            }
        }
    }
    [0, 1].map(|number| {
        let outcome = network.switch_off(number).unwrap().unwrap();
        assert_eq!(outcome.forbidden, [], "{number}");
        assert_eq!(outcome.unmapped, [""; 0], "{number}");
        // The one by which the chip takes its settings.
        assert_eq!(outcome.resets.len(), 1, "{:?}", outcome.resets);
        outcome
    })
}

/// Times at which the PC heard of the camera.
fn members(program: &Program, during: Range<u64>) -> usize {
    let desk = program.0.lock().unwrap();
    let heard = desk.heard.iter().filter(|(at, _)| during.contains(at));
    heard
        .filter(|(_, message)| matches!(message, ToPc::Member { .. }))
        .count()
}

#[test]
#[ignore = "`cargo xtask test --stage boards`"]
fn a_coordinator_speaks_over_its_plug() {
    speaks_over_its_plug(dongle, BOARD);
}

/// Its debug probe's serial port is silent then.
#[test]
#[ignore = "`cargo xtask test --stage boards`"]
fn a_kit_speaks_over_the_plug_of_its_chip() {
    speaks_over_its_plug(kit, &NRF52840_DK);
}

fn speaks_over_its_plug(node: fn(&CheckedConfig) -> Node, board: &Board) {
    let program = Program::default();
    let [coordinator, camera] = run(node, Some(Pc::new(Box::new(program.clone()))), 20 * S);
    let names = coordinator.names.expect("the PC knows its device");
    assert_eq!(names.numbers, [0x16c0, 0x05e1]);
    let [maker, product, serial] = names.texts.each_ref().map(String::as_str);
    assert_eq!([maker, product], ["Self-calibrating cameras", board.title]);
    assert_eq!(serial.len(), 16);
    assert!(serial.bytes().all(|digit| digit.is_ascii_hexdigit()));
    // Asked every five seconds, once it has joined.
    assert!(members(&program, 0..20 * S) >= 2);
    // The plug is the coordinator's: nothing goes over its wires, and a camera's device stays silent.
    assert!(coordinator.line.is_empty());
    assert!(camera.names.is_none() && camera.plug.is_empty() && !camera.line.is_empty());
}

/// Nothing waits for a PC that is not there, does not open the port, or does not read.
#[test]
#[ignore = "`cargo xtask test --stage boards`"]
fn a_network_goes_on_without_its_pc() {
    let joins = |outcome: &Outcome| outcome.received[0] > 5;
    let [alone, _] = run(dongle, None, 12 * S);
    assert!(joins(&alone) && alone.plug.is_empty());
    let program = Program::default();
    let late = Pc::new(Box::new(program.clone())).with_times(15 * S, 0..0);
    let [late, _] = run(dongle, Some(late), 30 * S);
    assert!(joins(&late) && late.names.is_some());
    assert!(late.plug.iter().all(|(at, _)| *at > 15 * S));
    assert!(members(&program, 15 * S..30 * S) >= 2);
    let program = Program::default();
    let busy = Pc::new(Box::new(program.clone())).with_times(0, 8 * S..21 * S);
    let [busy, _] = run(dongle, Some(busy), 40 * S);
    assert!(joins(&busy));
    assert_eq!(members(&program, 8 * S..21 * S), 0);
    assert!(members(&program, 21 * S..40 * S) >= 2);
}
