//! The side that sends: what to send next so that all nodes have all blocks.
//!
//! A [`Sender`] has no line and no clock. Its user asks it for packets ([`Sender::poll`]), tells it when one was sent
//! ([`Sender::on_sent`]) and what nodes answered ([`Sender::on_packet`]).
//!
//! Every block is sent once to all. Then nodes list the blocks that they miss, and these go out again, several in one
//! packet: their exclusive or. Blocks are put together so that no node misses two of one packet. So a packet mends
//! another block at each node, and what a hundred nodes miss takes little more than what one of them misses.
//!
//! When every node that answers has the image, they are told one after the other to change images; the node through
//! which all goes is the last.

use alloc::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    vec,
    vec::Vec,
};

use core::time::Duration;

use crate::{
    BLOCK, PAGE,
    package::Package,
    packet::{MIX_MAX, NO_ANSWER, PACKET_MAX, Packet, Phase, Ranges},
};

/// Packets that wait to be sent at a time.
const WINDOW: usize = 2;
/// Time that each node gets for its answer to a question to all.
const SLOT: Duration = Duration::from_millis(12);
/// Time after which a packet to all that was not told to be sent counts as lost.
const LINE: Duration = Duration::from_secs(5);
/// The same of a packet to one node: if that is not there it takes a network about a minute.
const LINE_TO_ONE: Duration = Duration::from_secs(90);
/// Time for an answer.
const ANSWER: Duration = Duration::from_millis(1500);
/// Attempts to ask a node that does not answer.
const ATTEMPTS: u8 = 3;
/// Time for a page to be erased, and for all pages to be hashed.
const ERASE: Duration = Duration::from_millis(90);
const HASH: Duration = Duration::from_millis(1500);
/// Packets that take less time than that.
const FEW: usize = 100;
/// Time after which nodes that erase, check or restart are asked again.
const PATIENCE: Duration = Duration::from_secs(2);
const RESTART: Duration = Duration::from_secs(10);
/// Time after which a node that changes images is given up: it goes back to its former image before that.
pub const LOST: Duration = Duration::from_secs(1800);
/// Attempts to have a node change images: it also goes back where it lost its power before it was in its network.
const TRIES: u8 = 3;
/// Mixes to which a block may still be added.
const OPEN: usize = 256;

/// States in which a node takes blocks, or is to take some.
const UNDER_WAY: [Phase; 4] = [
    Phase::Header,
    Phase::Preparing,
    Phase::Receiving,
    Phase::Checking,
];

/// A packet to be sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Transmit {
    /// Address of the node, or `None`: all.
    pub to: Option<u16>,
    /// Bytes of the packet.
    pub packet: Vec<u8>,
}

/// State of a node.
#[derive(Clone, PartialEq, Eq)]
pub struct Node {
    /// State of its update as it told it last; `None`: it did not answer.
    pub phase: Option<Phase>,
    /// Version of the image that runs.
    pub version: Option<u32>,
    /// Blocks that it misses, as far as it listed them.
    pub missing: BTreeSet<u16>,
    /// True if all that it misses now is listed.
    is_fresh: bool,
    /// The first block that it did not list yet.
    listed: u16,
    attempts: u8,
    /// Time of the first request to change images.
    asked: Option<Duration>,
    /// Number of these requests after which it went back.
    tries: u8,
}

impl core::fmt::Debug for Node {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Node")
            .field("phase", &self.phase)
            .field("version", &self.version)
            .field("missing", &self.missing.len())
            .finish_non_exhaustive()
    }
}

impl Node {
    const NEW: Self = Self {
        phase: None,
        version: None,
        missing: BTreeSet::new(),
        is_fresh: false,
        listed: 0,
        attempts: 0,
        asked: None,
        tries: 0,
    };

    fn forget(&mut self) {
        self.missing.clear();
        self.is_fresh = false;
        self.listed = 0;
        self.attempts = 0;
    }

    /// Returns true if it may still get the image.
    fn is_open(&self) -> bool {
        let is_lost = self.phase.is_none() && self.attempts > ATTEMPTS;
        let is_over = self.phase.is_some_and(|phase| match phase {
            Phase::Installed => true,
            Phase::Reverted => self.tries >= TRIES,
            _ => phase.is_refusal(),
        });
        !is_lost && !is_over
    }
}

/// Packets that were sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sent {
    /// Blocks, alone or mixed.
    pub blocks: usize,
    /// All other packets.
    pub others: usize,
    /// Bytes of all.
    pub bytes: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Begin,
    Spread,
    Install,
    Last,
    Done,
}

/// The side that sends.
#[derive(Debug)]
pub struct Sender {
    package: Package,
    name: u32,
    nodes: BTreeMap<u16, Node>,
    /// The node through which all goes.
    gate: u16,
    stage: Stage,
    queue: VecDeque<Transmit>,
    outstanding: usize,
    /// Time after which those on their way count as lost.
    lost: Duration,
    /// Time to be waited for when all is sent.
    pause: Duration,
    wait: Duration,
    /// All are to be asked.
    is_survey_due: bool,
    /// The node whose answer is waited for.
    awaited: Option<u16>,
    sent: Sent,
}

impl Sender {
    /// Spreads a package to nodes, of which one hands on what goes to the others.
    pub fn new(package: Package, nodes: impl IntoIterator<Item = u16>, gate: u16) -> Self {
        let name = package.name();
        Self {
            package,
            name,
            nodes: nodes.into_iter().map(|node| (node, Node::NEW)).collect(),
            gate,
            stage: Stage::Begin,
            queue: VecDeque::new(),
            outstanding: 0,
            lost: Duration::ZERO,
            pause: Duration::ZERO,
            wait: Duration::ZERO,
            is_survey_due: true,
            awaited: None,
            sent: Sent::default(),
        }
    }

    /// All nodes.
    pub const fn nodes(&self) -> &BTreeMap<u16, Node> {
        &self.nodes
    }

    /// The package.
    pub const fn package(&self) -> &Package {
        &self.package
    }

    /// Packets that were sent so far.
    pub const fn sent(&self) -> Sent {
        self.sent
    }

    /// Blocks that wait to be sent in this round.
    pub fn waiting(&self) -> usize {
        self.queue.len()
    }

    /// Returns true when nothing is left to be done.
    pub fn is_done(&self) -> bool {
        self.stage == Stage::Done
    }

    /// Returns true if every node runs the new image.
    pub fn has_succeeded(&self) -> bool {
        self.is_done()
            && self
                .nodes
                .values()
                .all(|node| node.phase == Some(Phase::Installed))
    }

    /// Time at which to [`poll`](Self::poll) again, if nothing happens before.
    pub fn deadline(&self) -> Option<Duration> {
        let deadline = match self.outstanding {
            0 => self.wait,
            _ => self.lost,
        };
        (!self.is_done()).then_some(deadline)
    }

    /// The next packet to be sent now.
    pub fn poll(&mut self, now: Duration) -> Option<Transmit> {
        if self.outstanding > 0 && now >= self.lost {
            // What was on its way is missing at nodes, which list it.
            self.outstanding = 0;
        }
        loop {
            if self.is_done() || self.outstanding >= WINDOW {
                return None;
            }
            if let Some(next) = self.queue.pop_front() {
                self.outstanding += 1;
                let patience = match next.to {
                    Some(_) => LINE_TO_ONE,
                    None => LINE,
                };
                self.lost = self.lost.max(now + patience);
                self.sent.bytes += next.packet.len();
                if matches!(next.packet.first(), Some(2 | 3)) {
                    self.sent.blocks += 1;
                } else {
                    self.sent.others += 1;
                }
                return Some(next);
            }
            if self.outstanding > 0 {
                return None;
            }
            if !self.pause.is_zero() {
                self.wait = now + core::mem::take(&mut self.pause);
            }
            if now < self.wait {
                return None;
            }
            self.think(now);
        }
    }

    /// A packet was sent, or could not be.
    pub fn on_sent(&mut self, now: Duration) {
        self.outstanding = self.outstanding.saturating_sub(1);
        if self.outstanding == 0 {
            self.lost = now;
        }
    }

    /// A node sent a packet.
    pub fn on_packet(&mut self, now: Duration, from: u16, bytes: &[u8]) {
        let Some(Packet::Status {
            package,
            version,
            phase,
            missing,
            ranges,
        }) = Packet::parse(bytes)
        else {
            return;
        };
        let Some(node) = self.nodes.get_mut(&from) else {
            return;
        };
        node.version = Some(version);
        node.phase = Some(phase);
        node.attempts = 0;
        let is_of_this = package == self.name;
        if is_of_this && matches!(phase, Phase::Header | Phase::Receiving) {
            for (start, end) in Ranges::new(ranges) {
                node.missing.extend(start..end);
                node.listed = node.listed.max(end);
            }
            node.is_fresh = node.missing.len() >= missing.into() || ranges.is_empty();
        } else {
            node.missing.clear();
            // Another package is on trial there: it takes this one when that is settled.
            node.is_fresh = is_of_this
                || self
                    .package
                    .stamp()
                    .is_some_and(|stamp| stamp.version == version);
            if !is_of_this && node.is_fresh {
                node.phase = Some(Phase::Installed);
            }
        }
        if self.awaited == Some(from) {
            self.awaited = None;
            self.wait = now;
        }
    }

    fn push(&mut self, to: Option<u16>, packet: Packet<'_>) {
        let mut buffer = [0; PACKET_MAX];
        let length = packet.write(&mut buffer);
        let packet = buffer.iter().take(length).copied().collect();
        self.queue.push_back(Transmit { to, packet });
    }

    fn offer(&mut self, to: Option<u16>, from: u16, spread: Duration) {
        let offer = Packet::Offer {
            package: self.name,
            header: self.package.header().len() as u16,
            from,
            spread_ms: spread.as_millis().min(60_000) as u16,
        };
        self.push(to, offer);
    }

    /// Sends the header twice, before any node is asked, and lets nodes erase their pages.
    fn begin(&mut self) {
        self.stage = Stage::Spread;
        let header = self.package.header_blocks();
        for _ in 0..2 {
            self.offer(None, NO_ANSWER, Duration::ZERO);
            (0..header as u16).for_each(|block| self.push_blocks(&[block]));
        }
        let pages = self.package.image().len().div_ceil(PAGE) as u32;
        self.pause = ERASE * pages + ANSWER;
    }

    /// Asks all.
    fn survey(&mut self) {
        self.is_survey_due = false;
        for node in self.nodes.values_mut().filter(|node| node.is_open()) {
            node.forget();
        }
        let spread = SLOT * self.nodes.len() as u32;
        self.offer(None, 0, spread);
        self.pause = spread + ANSWER / 2;
    }

    /// Asks the next node of these that did not answer yet. Returns true if it asks one.
    fn ask(&mut self) -> bool {
        if let Some(silent) = self.awaited.take()
            && let Some(node) = self.nodes.get_mut(&silent)
            && node.attempts > ATTEMPTS
        {
            node.phase = None;
        }
        let mut nodes = self.nodes.iter_mut();
        let next =
            nodes.find(|(_, node)| node.is_open() && !node.is_fresh && node.attempts <= ATTEMPTS);
        let Some((&address, node)) = next else {
            return false;
        };
        node.attempts += 1;
        let listed = node.listed;
        self.awaited = Some(address);
        self.offer(Some(address), listed, Duration::ZERO);
        self.pause = ANSWER;
        true
    }

    fn think(&mut self, now: Duration) {
        match self.stage {
            Stage::Begin => self.begin(),
            Stage::Spread => self.spread(),
            Stage::Install => self.install(now),
            Stage::Last => self.install_last(now),
            Stage::Done => {}
        }
    }

    fn is_any(&self, phases: &[Phase]) -> bool {
        let phases_of = self.nodes.values().filter_map(|node| node.phase);
        phases_of.into_iter().any(|phase| phases.contains(&phase))
    }

    fn spread(&mut self) {
        if self.is_survey_due {
            return self.survey();
        }
        if self.ask() {
            return;
        }
        let missing = self.plan();
        if !missing.is_empty() {
            self.is_survey_due = true;
            // The last blocks are followed by the check of the hash.
            self.pause = match missing.len() {
                ..FEW => HASH,
                _ => ANSWER / 4,
            };
            for blocks in missing {
                self.push_blocks(&blocks);
            }
        } else if self.is_any(&UNDER_WAY) || self.is_any(&[Phase::Trial]) {
            self.is_survey_due = true;
            self.pause = PATIENCE;
        } else {
            self.stage = Stage::Install;
        }
    }

    /// The blocks that are to be sent, those together that no node misses two of.
    fn plan(&self) -> Vec<Vec<u16>> {
        let wants: Vec<_> = self.nodes.values().filter(|node| node.is_open()).collect();
        let (header, all) = (self.package.header_blocks(), self.package.blocks());
        let words = wants.len().div_ceil(64);
        let mut done = Vec::new();
        let mut open: VecDeque<(Vec<u16>, Vec<u64>)> = VecDeque::new();
        for block in 0..all as u16 {
            let mut of = vec![0_u64; words];
            for (number, _) in
                { wants.iter().enumerate() }.filter(|(_, node)| node.missing.contains(&block))
            {
                if let Some(word) = of.get_mut(number / 64) {
                    *word |= 1 << (number % 64);
                }
            }
            if of.iter().all(|word| *word == 0) {
                continue;
            }
            // Nodes that take a header can take nothing apart yet.
            let is_header = usize::from(block) < header;
            let fits = open.iter_mut().find(|(blocks, nodes)| {
                !is_header
                    && blocks.len() < MIX_MAX
                    && nodes.iter().zip(&of).all(|(one, other)| one & other == 0)
            });
            if let Some((blocks, nodes)) = fits {
                blocks.push(block);
                for (to, from) in nodes.iter_mut().zip(of) {
                    *to |= from;
                }
            } else if is_header {
                done.push(vec![block]);
            } else {
                open.push_back((vec![block], of));
            }
            if open.len() > OPEN {
                done.extend(open.pop_front().map(|(blocks, _)| blocks));
            }
        }
        done.extend(open.into_iter().map(|(blocks, _)| blocks));
        done
    }

    fn push_blocks(&mut self, blocks: &[u16]) {
        let mut bytes = [0; BLOCK];
        let mut numbers = Vec::new();
        for &block in blocks {
            for (to, from) in bytes.iter_mut().zip(self.package.block(block.into())) {
                *to ^= from;
            }
            numbers.extend(block.to_le_bytes());
        }
        let package = self.name;
        match *blocks {
            [number] => self.push(
                None,
                Packet::Block {
                    package,
                    number,
                    bytes: &bytes,
                },
            ),
            _ => self.push(
                None,
                Packet::Mix {
                    package,
                    numbers: &numbers,
                    bytes: &bytes,
                },
            ),
        }
    }

    /// Has all nodes but the last change images, and waits until they are back.
    fn install(&mut self, now: Duration) {
        let gate = self.gate;
        if self.is_any(&UNDER_WAY) {
            // A node that goes back and tries again may have lost a page.
            self.stage = Stage::Spread;
            self.is_survey_due = true;
            return;
        }
        let mut is_waiting = false;
        let mut ready = Vec::new();
        for (&address, node) in self
            .nodes
            .iter_mut()
            .filter(|(address, _)| **address != gate)
        {
            match node.phase {
                Some(Phase::Complete) => {
                    // Until it tells its state again.
                    node.phase = Some(Phase::Installing);
                    ready.push(address);
                }
                Some(Phase::Reverted) if node.tries < TRIES => {
                    node.tries += 1;
                    node.phase = Some(Phase::Installing);
                    ready.push(address);
                }
                Some(Phase::Installing | Phase::Trial) => {}
                _ => continue,
            }
            is_waiting |= now < *node.asked.get_or_insert(now) + LOST;
        }
        for address in ready {
            let install = Packet::Install { package: self.name };
            self.push(Some(address), install);
        }
        if is_waiting {
            self.look_again();
        } else {
            self.stage = Stage::Last;
        }
    }

    /// Asks all in a while.
    fn look_again(&mut self) {
        if self.queue.is_empty() {
            self.offer(None, 0, SLOT * self.nodes.len() as u32);
        }
        self.pause = RESTART;
    }

    fn install_last(&mut self, now: Duration) {
        let (gate, name) = (self.gate, self.name);
        let Some(node) = self.nodes.get_mut(&gate) else {
            self.stage = Stage::Done;
            return;
        };
        let is_lost = now > *node.asked.get_or_insert(now) + LOST;
        self.pause = RESTART;
        match node.phase {
            Some(Phase::Complete) if !is_lost => {
                node.phase = Some(Phase::Installing);
                self.push(Some(gate), Packet::Install { package: name });
            }
            Some(Phase::Reverted) if !is_lost && node.tries < TRIES => {
                node.tries += 1;
                node.phase = Some(Phase::Installing);
                self.push(Some(gate), Packet::Install { package: name });
            }
            Some(phase) if UNDER_WAY.contains(&phase) => {
                self.stage = Stage::Spread;
                self.is_survey_due = true;
            }
            Some(Phase::Installing | Phase::Trial) if !is_lost => {
                self.offer(Some(gate), 0, Duration::ZERO);
            }
            _ => self.stage = Stage::Done,
        }
    }
}
