//! Faults of a chip or its power: each ends in a restart that says why, or in work that goes on, and nothing that
//! was learnt is lost.
//!
//! `NODE_CUTS=all` tries every cut where some are tried otherwise.

use std::{
    collections::BTreeMap,
    env,
    sync::atomic::{AtomicU64, Ordering},
};

use node_firmware::{
    facts::Fact,
    message::{Health, Memory, Restart},
    network::Attachment,
};
use rand::RngExt;

use super::*;

/// Coordinator and camera join in less than this from blank flash.
const JOINED: u64 = 15 * S;

fn all() -> bool {
    env::var("NODE_CUTS").is_ok_and(|cuts| cuts == "all")
}

/// Nodes that all hear each other, whose power can be cut.
pub(super) struct Site {
    pub(super) network: Network,
    nodes: Vec<Box<dyn Fn() -> Node>>,
    /// Contents of each one's flash when its power went.
    flash: BTreeMap<usize, Vec<(u64, Vec<u8>)>>,
    /// Messages of the coordinator to its PC, and their times.
    pub(super) told: Vec<(u64, ToPc)>,
    frames: Frames,
    /// Times and senders of frames.
    sent: Vec<(u64, usize)>,
}

impl Site {
    /// All have power from now on.
    pub(super) fn new(nodes: Vec<Box<dyn Fn() -> Node>>) -> Self {
        let mut site = Self {
            network: Network::default(),
            nodes,
            flash: BTreeMap::new(),
            told: Vec::new(),
            frames: Frames::default(),
            sent: Vec::new(),
        };
        (0..site.nodes.len()).for_each(|number| site.switch_on(number));
        site
    }

    /// With its former contents of the flash.
    fn switch_on(&mut self, number: usize) {
        let mut node = self.nodes[number]();
        if let Some(flash) = self.flash.get(&number) {
            node.flash.clone_from(flash);
        }
        self.network.switch_on(number, node, 0);
    }

    pub(super) fn switch_off(&mut self, number: usize) -> Outcome {
        let outcome = self.network.switch_off(number).unwrap().unwrap();
        self.flash.insert(number, outcome.flash.clone());
        if number == 0 {
            self.frames = Frames::default();
        }
        outcome
    }

    pub(super) fn run(&mut self, until: u64) {
        while self.network.reached() < until {
            for (at, number, deed) in self.network.run(until) {
                match deed {
                    Deed::Fails(why) => panic!("{number}: {why}"),
                    Deed::Sends(frame) => {
                        self.sent.push((at, number));
                        for to in (0..self.nodes.len()).filter(|to| *to != number) {
                            self.network
                                .input(to, Input::Frame(frame.clone(), LEVEL.into()));
                        }
                    }
                    Deed::Bytes(bytes) if number == 0 => {
                        let messages = bytes.into_iter().filter_map(|byte| self.frames.push(byte));
                        self.told.extend(messages.map(|message| (at, message)));
                    }
                    _ => {}
                }
            }
        }
    }

    /// Number of members that were told of since an instant.
    fn members(&self, since: u64) -> usize {
        let told = self.told.iter().filter(|(at, _)| *at >= since);
        let members = told.filter_map(|(_, message)| match message {
            ToPc::Member { address, .. } => Some(*address),
            _ => None,
        });
        members.collect::<std::collections::BTreeSet<_>>().len()
    }
}

/// The network that a node remembers, and its address there.
fn attachment(outcome: &Outcome, owner: u32) -> Option<Attachment> {
    let facts = facts(outcome, owner);
    facts.into_iter().find_map(|fact| match fact {
        Fact::Network(attachment) => Some(attachment),
        _ => None,
    })
}

/// A coordinator and a camera.
fn two() -> (Site, [u32; 2]) {
    let lab = lab();
    let owners =
        [&lab.configs.coordinator, &lab.configs.cameras[0]].map(|config| config.settings().owner());
    let nodes: Vec<Box<dyn Fn() -> Node>> = vec![
        Box::new(|| super::lab().coordinator()),
        Box::new(|| super::lab().camera(0)),
    ];
    (Site::new(nodes), owners)
}

/// Power goes in the middle of an operation of the flash, of all that there are while two nodes join: after
/// a restart they are members of the same network with the same addresses.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn power_may_go_in_any_work_of_the_flash() {
    let (mut whole, owners) = two();
    whole.run(JOINED);
    let outcomes = [0, 1].map(|number| whole.switch_off(number));
    let expected = [0, 1].map(|number| attachment(&outcomes[number], owners[number]));
    assert!(expected[1].is_some());
    let mut tried = 0;
    for who in [0, 1] {
        let operations = &outcomes[who].operations;
        let step = if all() { 1 } else { 1 + operations.len() / 8 };
        println!("{who}: {} operations", operations.len());
        for (number, operation) in operations.iter().enumerate().step_by(step) {
            let cut = operation.start.midpoint(operation.end);
            let (mut site, _) = two();
            site.run(cut);
            let before = site.switch_off(who);
            let known = attachment(&before, owners[who]);
            site.run(cut + 100 * MS);
            site.switch_on(who);
            site.run(cut + 100 * MS + JOINED);
            let what = format!("{who}: operation {number} at {cut}");
            assert_eq!(site.members(cut + 100 * MS), 1, "{what}");
            for (number, owner) in owners.into_iter().enumerate() {
                let after = site.switch_off(number);
                in_order(&after);
                let now = attachment(&after, owner);
                assert!(number == 0 || now.is_some(), "{what}");
                if number == who && known.is_some() {
                    assert_eq!(now, known, "{what}");
                }
            }
            tried += 1;
        }
    }
    println!("{tried} cuts");
}

/// Power goes again and again, now here, now there.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn power_may_go_at_any_time() {
    let lab = lab();
    let configs = &lab.configs;
    let owners = [
        configs.coordinator.settings().owner(),
        configs.cameras[0].settings().owner(),
        configs.cameras[1].settings().owner(),
        configs.targets[0].settings().owner(),
    ];
    let nodes: Vec<Box<dyn Fn() -> Node>> = vec![
        Box::new(|| super::lab().coordinator()),
        Box::new(|| super::lab().camera(0)),
        Box::new(|| super::lab().camera(1)),
        Box::new(|| super::lab().target()),
    ];
    let mut site = Site::new(nodes);
    let mut random = test_support::generator(8);
    let mut now = JOINED;
    let mut known: [Option<Attachment>; 4] = [None; 4];
    let cuts = if all() { 1_000 } else { 25 };
    for cut in 0..cuts {
        now += random.random_range(0..3 * S);
        site.run(now);
        let who = random.random_range(0..owners.len());
        let outcome = site.switch_off(who);
        in_order(&outcome);
        let attachment = attachment(&outcome, owners[who]);
        assert!(
            known[who].is_none() || attachment == known[who],
            "cut {cut} of {who}: {attachment:?} after {:?}",
            known[who]
        );
        known[who] = attachment;
        now += random.random_range(MS..S);
        site.run(now);
        site.switch_on(who);
    }
    site.run(now + 4 * JOINED);
    assert_eq!(site.members(JOINED), owners.len() - 1);
    for (number, owner) in owners.into_iter().enumerate() {
        let sent = site
            .sent
            .iter()
            .filter(|(at, who)| *at > now && *who == number);
        assert!(sent.count() > 1, "{number} is silent");
        let outcome = site.switch_off(number);
        in_order(&outcome);
        if known[number].is_some() {
            assert_eq!(attachment(&outcome, owner), known[number]);
        }
    }
}

/// The crystals of 32 MHz and of 32.768 kHz are waited for without end: the watchdog restarts the board.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn without_its_crystals_a_board_restarts() {
    let faults: [fn(&mut Soc); 2] = [
        |soc| soc.clock.model.hfxo_from = u64::MAX,
        |soc| soc.clock.model.lfxo_from = u64::MAX,
    ];
    for faults in faults {
        let node = Node {
            faults: Some(faults),
            ..lab().coordinator()
        };
        let outcome = alone(node, 60 * S);
        in_order(&outcome);
        // One for the pins' voltage, then one every eight seconds.
        assert_eq!(
            (outcome.fed, outcome.resets.len()),
            (0, 8),
            "{:?}",
            outcome.resets
        );
    }
}

/// It works once the crystal does, and says why it restarted.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_bite_of_the_watchdog_is_told() {
    let faults: fn(&mut Soc) = |soc| soc.clock.model.hfxo_from = 12 * S;
    let lab = lab();
    let camera = Node {
        faults: Some(faults),
        ..lab.camera(0)
    };
    let (outcomes, _) = run(vec![lab.coordinator(), camera], 30 * S, everybody).unwrap();
    let bites = outcomes[1]
        .resets
        .iter()
        .filter(|reset| reset.by.contains("WDT"));
    assert_eq!(bites.count(), 2, "{:?}", outcomes[1].resets);
    assert_eq!(health(&outcomes[0]).restart, Restart::Program);
}

/// The last that was told about the only member's health.
fn health(coordinator: &Outcome) -> Health {
    let told = told(coordinator);
    let healths = told.iter().rev().filter_map(|message| match message {
        ToPc::Health { address, health } if *address != 0 => Some(*health),
        _ => None,
    });
    healths.into_iter().next().unwrap_or_default()
}

/// Writes and erasures do not take: the node remembers in its RAM, and says so.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn worn_flash_is_told() {
    let faults: fn(&mut Soc) = |soc| soc.nvmc.model.worn = Some(MEMORY.start..PAGE);
    let lab = lab();
    let camera = Node {
        faults: Some(faults),
        ..lab.camera(0)
    };
    let nodes = vec![lab.coordinator(), camera, lab.target()];
    let (outcomes, _) = run(nodes, 30 * S, everybody).unwrap();
    let told = told(&outcomes[0]);
    assert!(told.iter().any(|message| matches!(
        message,
        ToPc::Health {
            health: Health {
                memory: Memory::Ram,
                ..
            },
            ..
        }
    )));
    assert!(asked(&outcomes[1], 0) > 2);
}

/// Number of times that a camera node asked its camera for the ball, since an instant.
fn asked(node: &Outcome, since: u64) -> usize {
    let line = node.line.iter().filter(|(at, _)| *at >= since);
    let line: Vec<u8> = line.map(|&(_, byte)| byte).collect();
    String::from_utf8_lossy(&line).matches("\rTC").count()
}

/// A camera that talks without end for some time, whether it is asked or not.
#[derive(Debug)]
struct Flood {
    camera: Camera,
    next: u64,
}

const FLOOD: std::ops::Range<u64> = 6 * S..9 * S;

impl Peer for Flood {
    fn receive(&mut self, byte: u8, at: u64) {
        self.camera.receive(byte, at);
    }

    fn transmit(&mut self, now: u64) -> Option<u8> {
        if self.next <= now && self.next < FLOOD.end {
            // As fast as 115,200 baud.
            self.next += 10 * S / 115_200;
            return Some((self.next >> 7) as u8);
        }
        self.camera.transmit(now)
    }

    fn next(&self) -> Option<u64> {
        let flood = (self.next < FLOOD.end).then_some(self.next);
        flood.into_iter().chain(self.camera.next()).min()
    }
}

/// Outcome of a camera node with such a camera.
fn flooded(faults: Option<fn(&mut Soc)>) -> Outcome {
    let lab = lab();
    let flood = Flood {
        camera: lab.eye(0),
        next: FLOOD.start,
    };
    let camera = Node {
        peer: Some(Box::new(flood)),
        faults,
        ..lab.camera(0)
    };
    let nodes = vec![lab.coordinator(), camera, lab.target()];
    let (mut outcomes, _) = run(nodes, 40 * S, everybody).unwrap();
    outcomes.swap_remove(1)
}

/// While all of it finds room the node reads it, and goes on.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_flooded_line_with_room_restarts_nobody() {
    let camera = flooded(None);
    assert_eq!(camera.overruns, 0);
    // The one restart is for the pins' voltage.
    assert_eq!(camera.resets.len(), 1, "{:?}", camera.resets);
    assert!(asked(&camera, FLOOD.end) > 2);
}

#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_flooded_line_is_got_over() {
    // Some of it finds no room, either.
    let camera = flooded(Some(|soc| {
        soc.uarte.model.full = Some(7 * S..7 * S + S / 10);
    }));
    assert!(camera.overruns > 0);
    // Pictures are lost, and nothing else.
    assert_eq!(camera.resets.len(), 1, "{:?}", camera.resets);
    assert!(asked(&camera, FLOOD.end) > 2);
}

/// Bytes are lost while the camera tells what it sees at a stop: the node asks for another picture, and does not
/// restart.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn lost_bytes_are_a_lost_picture() {
    /// Beginning of the loss.
    static LOST: AtomicU64 = AtomicU64::new(u64::MAX / 2);
    let looks = || {
        let lab = lab();
        let camera = Node {
            faults: Some(|soc| {
                let from = LOST.load(Ordering::Relaxed);
                soc.uarte.model.full = Some(from..from + 10 * MS);
            }),
            ..lab.camera(0)
        };
        let nodes = vec![lab.coordinator(), camera, lab.target()];
        let (mut outcomes, _) = run(nodes, 25 * S, everybody).unwrap();
        outcomes.swap_remove(1)
    };
    let calm = looks();
    let asks = |camera: &Outcome| {
        let all: Vec<_> = camera.line.windows(3).collect();
        let asks = all
            .iter()
            .filter(|bytes| [bytes[0].1, bytes[1].1, bytes[2].1] == *b"\rTC");
        asks.map(|bytes| bytes[2].0).collect::<Vec<_>>()
    };
    let before = asks(&calm);
    let hit = before[before.len() / 2];
    // The answer to a question in the middle of the look.
    LOST.store(hit + 5 * MS, Ordering::Relaxed);
    let lossy = looks();
    assert_eq!((calm.overruns, lossy.overruns > 0), (0, true));
    assert_eq!(lossy.resets.len(), calm.resets.len(), "{:?}", lossy.resets);
    let after = asks(&lossy);
    assert!(after.len() > before.len(), "{before:?} {after:?}");
    assert!(after[after.len() - 1] < hit + 2 * S, "{before:?} {after:?}");
}

/// A vector that leads nowhere is a fault of the processor: the node restarts by itself, and says so. The others do not
/// notice.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_fault_of_the_processor_restarts_its_node() {
    /// Of RTC1, the clock (Product Specification, "Peripherals"), after those of the processor itself. The image begins
    /// at 0.
    const CLOCK: u64 = 4 * (16 + 17);
    const AT: u64 = 35 * S;
    let (mut site, _) = two();
    site.run(AT);
    for until in [AT + S / 2, AT + 20 * S] {
        site.network.input(1, Input::Rot(vec![(CLOCK, 0)]));
        site.run(until);
    }
    let [coordinator, camera] = [0, 1].map(|number| site.switch_off(number));
    assert_eq!(coordinator.resets.len(), 1, "{:?}", coordinator.resets);
    let faults = camera.resets.iter().filter(|reset| reset.at > AT);
    assert!(faults.count() > 0, "{:?}", camera.resets);
    assert!(says(&camera, "fault at"), "{:?}", log(&camera));
    assert_eq!(health(&coordinator).restart, Restart::Program);
}

/// A person may press the reset button of a board whose watchdog has just bitten: that is no fault.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_reset_by_the_pin_is_an_ordinary_one() {
    // RESETREAS: the pin is bit 0, the watchdog bit 1.
    let causes: [(fn(&mut Soc), _); 3] = [
        (|soc| soc.clock.model.cause = 1, Restart::Ordinary),
        (|soc| soc.clock.model.cause = 2, Restart::Program),
        (|soc| soc.clock.model.cause = 3, Restart::Ordinary),
    ];
    for (cause, restart) in causes {
        let lab = lab();
        let camera = Node {
            faults: Some(cause),
            ..lab.camera(0)
        };
        let (outcomes, _) = run(vec![lab.coordinator(), camera], 12 * S, everybody).unwrap();
        assert_eq!(health(&outcomes[0]).restart, restart);
    }
}

/// Neither at power-on nor after a restart is anything sure about the RAM: here it is random each time.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn ram_that_is_not_retained_does_no_harm() {
    let lab = lab();
    let mut random = test_support::generator(3);
    let mut junk = vec![0; 256 << 10];
    random.fill(junk.as_mut_slice());
    // The radio sticks: the node restarts, and cannot know why.
    let faults: fn(&mut Soc) = |soc| soc.radio.model.sticks_at = Some(S);
    let mut camera = Node {
        faults: Some(faults),
        ..lab.camera(0)
    };
    camera.flash.push((0x2000_0000, junk));
    let (outcomes, frames) = run(vec![lab.coordinator(), camera], 30 * S, everybody).unwrap();
    let last = outcomes[1].resets.last().unwrap();
    assert!(outcomes[1].resets.len() == 2, "{:?}", outcomes[1].resets);
    assert!(
        frames
            .iter()
            .any(|frame| frame.node == 1 && frame.start > last.at)
    );
    assert_eq!(health(&outcomes[0]).restart, Restart::Ordinary);
}

/// A transmission does not end: the node restarts at once, says why, and goes on.
#[test]
#[ignore = "`cargo xtask test --stage chip`"]
fn a_restart_tells_its_cause_where_ram_is_retained() {
    let lab = lab();
    let faults: fn(&mut Soc) = |soc| soc.radio.model.sticks_at = Some(S);
    let camera = Node {
        faults: Some(faults),
        ..lab.camera(0)
    };
    let (outcomes, _) = run(vec![lab.coordinator(), camera], 30 * S, everybody).unwrap();
    assert_eq!(health(&outcomes[0]).restart, Restart::RadioStuck);
}
