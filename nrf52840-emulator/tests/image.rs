//! The image that is flashed, from `NODE_IMAGE`, with pages of `host-sim provision` from `NODE_PAGES`.

use std::{collections::BTreeMap, env, fs, path::PathBuf};

use cmucam2_emulator::{Configuration, Emulator, Extent, Scene, Shape};
use defmt_decoder::{DecodeError, Table};
use nrf52840_emulator::{
    MEMORY, Node, Outcome, SETTINGS, Soc,
    peripheral::{Chip, Frame, Peer},
    run,
};

const S: u64 = 1_000_000_000;
const MS: u64 = 1_000_000;
/// Where the configuration page is.
const PAGE: u64 = 0xf_f000;
/// 40 dB above the least that is heard.
const LEVEL: u8 = 40;

fn path(variable: &str) -> PathBuf {
    env::var_os(variable)
        .map(PathBuf::from)
        .unwrap_or_else(|| panic!("{variable} is not set"))
}

/// A node as it comes from `provision`, with blank flash.
fn node(page: &str) -> Node {
    let page = fs::read(path("NODE_PAGES").join(page)).unwrap();
    Node {
        image: path("NODE_IMAGE"),
        flash: vec![(PAGE, page)],
        ..Node::default()
    }
}

/// The same node after its power has gone.
fn again(page: &str, before: &Outcome) -> Node {
    Node {
        flash: before.flash.clone(),
        ..node(page)
    }
}

/// A CMUcam2 that was switched on with its node.
#[derive(Debug)]
struct Camera(Emulator);

impl Peer for Camera {
    fn receive(&mut self, byte: u8, at: u64) {
        self.0.receive(byte, at);
    }

    fn transmit(&mut self, now: u64) -> Option<u8> {
        self.0.transmit(now).map(|(_, byte)| byte)
    }

    fn next(&self) -> Option<u64> {
        self.0.next_deadline()
    }
}

/// A camera node that sees an orange ball.
fn camera() -> Node {
    let ball = Extent::centred(0.4, 0.5, 0.1, 0.14);
    let scene = Scene::with_object([230, 105, 35], Shape::Disc, ball);
    let configuration = Configuration {
        baud: 38_400,
        host_baud: 38_400,
        ..Configuration::default()
    };
    Node {
        peer: Some(Box::new(Camera(Emulator::new(configuration, scene)))),
        ..node("camera.bin")
    }
}

/// A target's sensors: who they say they are (data sheets of LSM6DSOX and LIS3MDL, WHO_AM_I).
fn target() -> Node {
    Node {
        chips: BTreeMap::from([
            (0x6a, Chip::new(&[(0x0f, 0x6c)])),
            (0x1c, Chip::new(&[(0x0f, 0x3d)])),
        ]),
        ..node("target.bin")
    }
}

fn alone(node: Node, time: u64) -> Outcome {
    let (mut outcomes, _) = run(vec![node], time, |_, _| None).unwrap();
    outcomes.pop().unwrap()
}

fn everybody(_: &Frame, _: usize) -> Option<u8> {
    Some(LEVEL)
}

/// What must hold of every run.
fn in_order(outcome: &Outcome) {
    assert_eq!(log(outcome), [""; 0]);
    assert_eq!(outcome.forbidden, []);
    assert_eq!(outcome.unmapped, [""; 0]);
}

/// What the image logged, a line each.
fn log(outcome: &Outcome) -> Vec<String> {
    let image = fs::read(path("NODE_IMAGE")).unwrap();
    let table = Table::parse(&image).unwrap().unwrap();
    let mut decoder = table.new_stream_decoder();
    decoder.received(&outcome.log);
    let mut lines = Vec::new();
    loop {
        match decoder.decode() {
            Ok(frame) => lines.push(frame.display(false).to_string()),
            // A restart tears what was being said.
            Err(DecodeError::Malformed) => {}
            Err(DecodeError::UnexpectedEof) => return lines,
        }
    }
}

fn says(outcome: &Outcome, words: &str) -> bool {
    log(outcome).iter().any(|line| line.contains(words))
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_blank_board_starts() {
    let first = alone(node("coordinator.bin"), 20 * S);
    in_order(&first);
    // UICR is written once, and takes a restart (Product Specification, "UICR").
    assert!(first.resets.len() <= 1, "{:?}", first.resets);
    // Of the pages in use, only those that something was written to.
    println!(
        "{} pages erased, {} words written",
        first.erased.len(),
        first.written
    );
    assert!(first.erased.len() <= 4, "{:x?}", first.erased);
    assert!(first.written > 0 && first.fed > 5);
    // With its memory it starts at once, and erases nothing.
    let second = alone(again("coordinator.bin", &first), 20 * S);
    in_order(&second);
    assert_eq!(
        (second.resets.as_slice(), second.erased.as_slice()),
        ([].as_slice(), [].as_slice())
    );
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn nodes_join_from_blank_flash() {
    let nodes = || vec![node("coordinator.bin"), camera(), target()];
    let (outcomes, frames) = run(nodes(), 20 * S, everybody).unwrap();
    for outcome in &outcomes {
        in_order(outcome);
        assert!(outcome.received[0] > 3, "{:?}", outcome.received);
        println!(
            "{} instructions, radio {:?} ms, {} bytes of the RAM untouched, {} transfers, {:?}",
            outcome.instructions,
            outcome.radio_on.map(|on| on / MS),
            outcome.untouched,
            outcome.transfers,
            outcome.resets,
        );
    }
    // The camera answers: after its set-up it is asked for the ball again and again.
    let line: Vec<u8> = outcomes[1].line.iter().map(|&(_, byte)| byte).collect();
    let line = String::from_utf8(line).unwrap();
    println!("{line:?}");
    assert!(line.matches("\rTC").count() > 2, "{line:?}");
    assert_eq!(outcomes[1].overruns, 0);
    for node in 0..3 {
        let sent = frames.iter().filter(|frame| frame.node == node);
        // Joined nodes send secured data; a beacon request alone has ten bytes.
        let data = sent.filter(|frame| frame.psdu.len() > 20).count();
        println!("node {node}: {data} frames of data");
        assert!(data > 1, "node {node} sent {data}");
    }
    // The same again.
    let (repeated, same) = run(nodes(), 20 * S, everybody).unwrap();
    assert_eq!(frames, same);
    for (one, other) in outcomes.iter().zip(&repeated) {
        assert_eq!(
            (one.instructions, &one.log),
            (other.instructions, &other.log)
        );
    }
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_stuck_radio_restarts_the_node_at_once() {
    const AT: u64 = S;
    let faults: fn(&mut Soc) = |soc| soc.radio.model.sticks_at = Some(AT);
    let camera = Node {
        faults: Some(faults),
        ..camera()
    };
    let nodes = vec![node("coordinator.bin"), camera];
    let (outcomes, frames) = run(nodes, 10 * S, everybody).unwrap();
    println!("{:?}", outcomes[1].resets);
    let stuck = frames
        .iter()
        .filter(|frame| frame.node == 1)
        .find(|frame| frame.end() >= AT);
    let stuck = stuck.unwrap().end();
    let restart = outcomes[1]
        .resets
        .iter()
        .find(|reset| reset.at > AT)
        .unwrap();
    assert_eq!(restart.by, "Core");
    let dead = restart.at - stuck;
    println!("restarted after {} ms", dead / MS);
    assert!(dead < 600 * MS, "{dead}");
    assert!(says(&outcomes[1], "the radio is stuck"));
    // And goes on.
    assert!(
        frames
            .iter()
            .any(|frame| frame.node == 1 && frame.start > restart.at)
    );
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn power_may_go_while_the_flash_is_written() {
    let whole = alone(node("coordinator.bin"), 4 * S);
    // Also in the middle of the work on the flash.
    let busy = whole.erased.iter().map(|(at, _)| at + 40 * MS);
    for cut in busy.chain((1..4).map(|part| part * S / 3)) {
        let before = alone(node("coordinator.bin"), cut);
        let after = alone(again("coordinator.bin", &before), 10 * S);
        in_order(&after);
        assert!(after.fed > 3, "cut at {cut}: {:?}", after.resets);
        assert!(after.flash.iter().any(|(at, _)| *at == MEMORY.start));
        assert!(after.flash.iter().any(|(at, _)| *at == SETTINGS.start));
    }
}
