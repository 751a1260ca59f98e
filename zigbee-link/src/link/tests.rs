//! Two and more links over a lossy medium in virtual time.

use core::time::Duration;
use std::{
    collections::{BTreeMap, BTreeSet},
    vec::Vec,
};

use proptest::prelude::*;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::{
    security::{Counter, Protection, storm},
    wire::fcs,
};

const PAN: PanId = PanId(0xBEEF);
const NODES: usize = 4;

type Node = Link<8, 4>;

fn key(index: u8) -> Key {
    Key::new(index, core::array::from_fn(|i| 0xC0 + i as u8 + index)).unwrap()
}

fn node(n: usize, counter: u32) -> Node {
    let mut reserved = Counter::resume(counter);
    reserved.reserved(counter + 1_000_000);
    let extended = Eui64([2, 0, 0, 0, 0, 0, 0, n as u8]);
    let session = FrameSecurity::new(extended, Protection::EncMic64, key(1), reserved);
    let mut link = Link::new(session, n as u64);
    link.attach(PAN, short(n));
    link
}

fn short(n: usize) -> ShortAddress {
    ShortAddress(n as u16)
}

/// Some nodes that hear each other, each frame lost with a probability.
struct Aether {
    nodes: Vec<Node>,
    now: Instant,
    loss: f64,
    rng: ChaCha8Rng,
    heard: Vec<Vec<u8>>,
}

impl Aether {
    fn new(nodes: usize, loss: f64, seed: u64) -> Self {
        Self {
            nodes: (0..nodes).map(|n| node(n, 0)).collect(),
            now: Instant(0),
            loss,
            rng: ChaCha8Rng::seed_from_u64(seed),
            heard: Vec::new(),
        }
    }

    /// Lets one node send what is due. Returns true if it did.
    fn transmit(&mut self, from: usize) -> bool {
        let mut buffer = [0; FRAME_MAX];
        let Some(len) = self.nodes[from].poll_transmit(self.now, &mut buffer) else {
            return false;
        };
        self.heard.push(buffer[..len].to_vec());
        self.now = self.now + Duration::from_micros(32 * (len as u64 + 8) + 192);
        for to in (0..self.nodes.len()).filter(|&to| to != from) {
            if !self.rng.random_bool(self.loss) {
                let mut copy = buffer;
                self.nodes[to].handle(self.now, &mut copy[..len]);
            }
        }
        true
    }

    /// Runs until nothing is due any more, or for a minute.
    fn run(&mut self) {
        let end = self.now + Duration::from_secs(60);
        while self.now < end {
            let mut sent = false;
            for from in 0..self.nodes.len() {
                sent |= self.transmit(from);
            }
            if !sent {
                let deadlines = self.nodes.iter().filter_map(Link::deadline);
                match deadlines.min() {
                    Some(deadline) => self.now = self.now.max(deadline),
                    None => return,
                }
            }
        }
        panic!("nodes never come to rest");
    }
}

#[test]
fn bytes_on_air_of_a_message_of_20() {
    let mut aether = Aether::new(2, 0.0, 0);
    aether.nodes[0].send(aether.now, short(1), &0_u8).unwrap();
    aether.run();
    aether.heard.clear();
    aether.nodes[0]
        .send(aether.now, short(1), &[0_u8; 20])
        .unwrap();
    aether.run();
    const PHY_HEADER: usize = 6;
    const FCS: usize = 2;
    let on_air: Vec<usize> = aether
        .heard
        .iter()
        .map(|frame| PHY_HEADER + frame.len() + FCS)
        .collect();
    assert_eq!(on_air, [53, 36]);
}

/// One frame without acknowledgement, which comes at most once; to a stranger after a challenge, as others.
#[test]
fn what_is_sent_once_is_not_acknowledged() {
    let mut aether = Aether::new(2, 0.0, 0);
    for is_known in [false, true] {
        aether.heard.clear();
        let sent = aether.nodes[0].send_with(aether.now, short(1), &7_u8, Effort::Once);
        aether.run();
        let received: Option<(ShortAddress, u8)> = aether.nodes[1].recv();
        assert_eq!(received, Some((short(0), 7)));
        assert_eq!(aether.nodes[1].recv::<u8>(), None);
        assert_eq!(
            aether.nodes[0].result_of(sent.unwrap()),
            Some(Delivery::Broadcast)
        );
        if is_known {
            assert_eq!(aether.heard.len(), 1);
        }
    }
}

/// A broadcast is sent twice, until enough messages in a row came at the first attempt; and again after one
/// that did not.
#[test]
fn a_broadcast_is_repeated_where_frames_get_lost() {
    let mut aether = Aether::new(2, 0.0, 0);
    let send = |aether: &mut Aether, loss, to, value: u8| {
        aether.loss = loss;
        aether.heard.clear();
        let ticket = aether.nodes[0].send(aether.now, to, &value).unwrap();
        aether.run();
        let _ = aether.nodes[0].result_of(ticket);
        while aether.nodes[1].recv::<u8>().is_some() {}
        aether.heard.len()
    };
    let everybody = ShortAddress::BROADCAST;
    // The first one is to a stranger, who is challenged.
    send(&mut aether, 0.0, short(1), 0);
    for value in 0..AT_ONCE {
        assert_eq!(send(&mut aether, 0.0, everybody, value), 2, "{value}");
        assert_eq!(send(&mut aether, 0.0, short(1), value), 2, "{value}");
    }
    assert_eq!(send(&mut aether, 0.0, everybody, 1), 1);
    assert!(send(&mut aether, 1.0, short(1), 2) > 2);
    assert_eq!(send(&mut aether, 0.0, everybody, 3), 2);
}

/// The first frames between two nodes are pinned, byte for byte, with their FCS: challenge,
/// response that challenges, response, message, acknowledgement. Any change here is a change of the
/// wire format and needs another version. tests/it/capture.rs has tshark read the same kind of frames.
#[test]
fn golden_exchange() {
    let mut aether = Aether::new(2, 0.0, 0);
    aether.nodes[0]
        .send(aether.now, short(1), b"hello")
        .unwrap();
    aether.run();
    let text: Vec<std::string::String> = aether
        .heard
        .iter()
        .map(|frame| {
            let sum = fcs(frame).to_le_bytes();
            frame
                .iter()
                .chain(&sum)
                .map(|byte| std::format!("{byte:02x}"))
                .collect()
        })
        .collect();
    let golden = [
        "49d801efbe010000000000000000020e0000000001bbd33d152a9687411b9002",
        "49dc02efbe000000000000000201000000000000020e00000000012979415866e3ed036b4911a5cd579e60946d",
        "49dc02efbe010000000000000200000000000000020e01000000017af5bdc8e2a60c3f4378ccd4fa76ac9ee23e",
        "499803efbe010000000e02000000011047edc65a0a977bb3e7277ac3579b0643",
        "499803efbe000001000e0100000001218f63850e5699440ac0396fc21825",
    ];
    assert_eq!(text, golden);
    assert_eq!(aether.nodes[1].recv(), Some((short(0), *b"hello")));
}

#[test]
fn a_message_arrives_once_and_its_sender_knows() {
    let mut aether = Aether::new(2, 0.0, 0);
    let ticket = aether.nodes[0].send(aether.now, short(1), &7_u32).unwrap();
    assert_eq!(aether.nodes[0].result_of(ticket), None);
    aether.run();
    assert_eq!(aether.nodes[1].recv(), Some((short(0), 7_u32)));
    assert_eq!(aether.nodes[1].recv::<u32>(), None);
    assert_eq!(aether.nodes[0].result_of(ticket), Some(Delivery::Delivered));
    assert_eq!(aether.nodes[0].result_of(ticket), None);
}

/// An acknowledgement is for the frame whose counter it repeats, not for any message that waits for one. The order
/// is kept whichever place in the queue becomes free, and when the numbers of tickets wrap around.
#[test]
fn messages_to_one_receiver_keep_their_order() {
    let mut aether = Aether::new(2, 0.3, 11);
    aether.nodes[0].next_ticket = u16::MAX - 20;
    let (mut sent, mut received) = (0, Vec::new());
    while received.len() < 60 {
        let now = aether.now;
        while sent < 60 && aether.nodes[0].send(now, short(1), &sent).is_ok() {
            sent += 1;
        }
        let mut acted = false;
        for from in 0..2 {
            acted |= aether.transmit(from);
        }
        while let Some((_, number)) = aether.nodes[1].recv::<u32>() {
            received.push(number);
        }
        // Results are fetched late and out of order.
        while let (true, Some((_, delivery))) = (aether.rng.random(), aether.nodes[0].result()) {
            assert_eq!(delivery, Delivery::Delivered);
        }
        if !acted {
            aether.now = aether.now + Duration::from_millis(1);
        }
    }
    assert!(received.is_sorted());
}

#[test]
fn an_acknowledgement_of_another_frame_is_none() {
    let mut aether = Aether::new(2, 0.0, 0);
    let first = aether.nodes[0].send(aether.now, short(1), &1_u8).unwrap();
    aether.run();
    assert_eq!(aether.nodes[0].result_of(first), Some(Delivery::Delivered));
    let of_first = aether.nodes[0].session.counter.upcoming() - 1;
    let second = aether.nodes[0].send(aether.now, short(1), &2_u8).unwrap();
    let mut buffer = [0; FRAME_MAX];
    // The frame is lost.
    aether.nodes[0]
        .poll_transmit(aether.now, &mut buffer)
        .unwrap();
    let mut acknowledge = |counter| {
        let mut payload = [0; 8];
        let packet = Packet::Acknowledgement { counter };
        let len = packet.emit(&mut payload).unwrap();
        let [sender, receiver] = [short(1), short(0)].map(Address::Short);
        let payload = &payload[..len];
        let sealed = aether.nodes[1].seal(false, sender, receiver, payload, &mut buffer);
        let len = sealed.unwrap().0;
        aether.nodes[0].handle(aether.now, &mut buffer[..len]);
        aether.nodes[0].result_of(second)
    };
    assert_eq!(acknowledge(of_first), None);
    assert_eq!(acknowledge(of_first + 2), None);
    assert_eq!(acknowledge(of_first + 1), Some(Delivery::Delivered));
}

#[test]
fn every_send_has_a_clear_result() {
    let mut aether = Aether::new(1, 0.0, 0);
    let now = aether.now;
    let node = &mut aether.nodes[0];
    assert_eq!(node.send(now, short(0), &1), Err(SendError::Destination));
    assert_eq!(
        node.send(now, ShortAddress::UNASSIGNED, &1),
        Err(SendError::Destination)
    );
    assert_eq!(
        node.send(now, short(1), &[0_u8; MESSAGE_MAX + 1][..]),
        Err(SendError::TooLong)
    );
    let tickets = [(); 4].map(|()| node.send(now, short(1), &1).unwrap());
    assert_eq!(node.send(now, short(1), &1), Err(SendError::QueueFull));
    aether.run();
    let node = &mut aether.nodes[0];
    for ticket in tickets {
        assert_eq!(node.result(), Some((ticket, Delivery::NoAnswer)));
    }
    let broadcast = node.send(now, ShortAddress::BROADCAST, &1).unwrap();
    aether.run();
    let node = &mut aether.nodes[0];
    assert_eq!(node.result(), Some((broadcast, Delivery::Broadcast)));
    let ticket = node.send(now, short(1), &1).unwrap();
    node.detach();
    assert_eq!(node.result_of(ticket), Some(Delivery::NoAnswer));
    assert_eq!(node.send(now, short(1), &1), Err(SendError::NotJoined));
}

#[test]
fn the_longest_message_fits_its_frame() {
    let mut aether = Aether::new(2, 0.0, 0);
    let longest: [u8; 25] = [0xEE; 25];
    let message = [longest; 4];
    aether.nodes[0]
        .send(aether.now, short(1), &message)
        .unwrap();
    aether.run();
    assert_eq!(aether.nodes[1].recv(), Some((short(0), message)));
    assert_eq!(aether.heard.iter().map(Vec::len).max(), Some(FRAME_MAX));
    let longer = aether.nodes[0].send(aether.now, short(1), &(message, 0_u8));
    assert_eq!(longer, Err(SendError::TooLong));
}

#[test]
fn broadcasts_reach_all_who_know_the_sender_once() {
    let mut aether = Aether::new(4, 0.0, 0);
    for _ in 0..2 {
        aether.nodes[0]
            .send(aether.now, ShortAddress::BROADCAST, &3_u8)
            .unwrap();
        aether.run();
        let _ = aether.nodes[0].result();
    }
    for n in 1..4 {
        let received: Vec<_> = core::iter::from_fn(|| aether.nodes[n].recv::<u8>()).collect();
        // The copy of the first broadcast comes after the proof of freshness.
        assert_eq!(received, [(short(0), 3), (short(0), 3)], "{n}");
    }
}

#[test]
fn a_full_inbox_pushes_back() {
    let mut aether = Aether::new(2, 0.0, 0);
    for n in 0..4_u8 {
        aether.nodes[0].send(aether.now, short(1), &n).unwrap();
    }
    aether.run();
    while aether.nodes[0].result().is_some() {}
    let ticket = aether.nodes[0].send(aether.now, short(1), &4_u8).unwrap();
    let end = aether.now + Duration::from_millis(200);
    while aether.now < end {
        aether.transmit(0);
        aether.transmit(1);
        aether.now = aether.now + Duration::from_millis(1);
    }
    assert_eq!(aether.nodes[0].result_of(ticket), None);
    for n in 0..4_u8 {
        assert_eq!(aether.nodes[1].recv(), Some((short(0), n)));
    }
    aether.run();
    assert_eq!(aether.nodes[0].result_of(ticket), Some(Delivery::Delivered));
    assert_eq!(aether.nodes[1].recv(), Some((short(0), 4_u8)));
}

#[test]
fn unknown_messages_are_counted_and_ignored() {
    let mut aether = Aether::new(2, 0.0, 0);
    let ticket = aether.nodes[0]
        .send(aether.now, short(1), &[0xFF_u8; 3])
        .unwrap();
    aether.run();
    assert_eq!(aether.nodes[0].result_of(ticket), Some(Delivery::Delivered));
    assert_eq!(aether.nodes[1].recv::<bool>(), None);
    assert_eq!(aether.nodes[1].counts().unknown, 1);
    // A frame of a later version, authentic.
    let header = Header {
        destination: Panned::new(PAN, Address::Short(short(1))),
        source: Panned::compressed(Address::Short(short(0))),
        ..Header::new(FrameType::Data, 0)
    };
    let mut buffer = [0; FRAME_MAX];
    let sealed = aether.nodes[0]
        .session
        .seal(&header, &[0x21, 0, 0], &mut buffer)
        .unwrap();
    aether.nodes[1].handle(aether.now, &mut buffer[..sealed.len]);
    assert_eq!(aether.nodes[1].counts().unknown, 2);
    assert_eq!(aether.nodes[1].deadline(), None);
}

/// Both restart, one after the other: each proves itself again, and nothing old is accepted.
#[test]
fn restarts_of_either_side() {
    let mut aether = Aether::new(2, 0.0, 0);
    for round in 0..4_u32 {
        let ticket = aether.nodes[0].send(aether.now, short(1), &round).unwrap();
        aether.run();
        assert_eq!(aether.nodes[0].result_of(ticket), Some(Delivery::Delivered));
        assert_eq!(aether.nodes[1].recv(), Some((short(0), round)));
        let reborn = round as usize % 2;
        aether.nodes[reborn] = node(reborn, 1000 * (round + 1));
        for old in aether.heard.clone() {
            for n in [0, 1] {
                aether.nodes[n].handle(aether.now, &mut old.clone());
            }
        }
        assert_eq!(aether.nodes[0].recv_bytes(), None);
        assert_eq!(aether.nodes[1].recv_bytes(), None);
        assert!(aether.nodes[reborn].session.peers.iter().next().is_none());
        aether.run();
    }
}

/// A restarted node knows no other. When the attacker replays everything and forges more, it asks, and believes
/// only true answers. It gets as many frames as `ZIGBEE_LINK_FORGERIES` says, or 20,000.
#[test]
fn replays_to_a_restarted_node() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut aether = Aether::new(4, 0.2, 2);
    for n in 1..4 {
        aether.nodes[0]
            .send(aether.now, short(n), &[n as u8; 30])
            .unwrap();
        aether.nodes[n]
            .send(aether.now, short(0), &[n as u8; 5])
            .unwrap();
    }
    aether.run();
    let heard = aether.heard.clone();
    let mut reborn = node(0, 5000);
    let mut now = aether.now;
    let mut buffer = [0; FRAME_MAX];
    for _ in 0..storm() {
        let mut frame = heard[rng.random_range(0..heard.len())].clone();
        match rng.random_range(0..4) {
            0 => frame.truncate(rng.random_range(0..frame.len())),
            1 => {
                let bit = rng.random_range(0..frame.len() * 8);
                frame[bit / 8] ^= 1 << (bit % 8);
            }
            2 => rng.fill_bytes(&mut frame[7..]),
            _ => {}
        }
        let event = reborn.handle(now, &mut frame);
        assert_eq!(event, LinkEvent::Nothing);
        while reborn.poll_transmit(now, &mut buffer).is_some() {}
        now = now + Duration::from_millis(1);
    }
    assert_eq!(reborn.recv_bytes(), None);
    assert_eq!(reborn.session.peers.iter().count(), 0);
    // It is not blocked either.
    aether.nodes[0] = reborn;
    aether.now = now + Duration::from_secs(2);
    aether.loss = 0.0;
    aether.nodes[1].send(aether.now, short(0), &9_u8).unwrap();
    aether.run();
    assert_eq!(aether.nodes[0].recv(), Some((short(1), 9_u8)));
}

/// One frame that is replayed without end makes a node that restarted send no more than a few a
/// second.
#[test]
fn replayed_challenges_cost_little() {
    let mut aether = Aether::new(2, 0.0, 0);
    aether.nodes[0].send(aether.now, short(1), &1_u8).unwrap();
    aether.run();
    let challenge = aether.heard[0].clone();
    let mut reborn = node(1, 5000);
    let mut buffer = [0; FRAME_MAX];
    let mut sent = 0;
    for milli in 0..10_000 {
        let now = aether.now + Duration::from_millis(milli);
        reborn.handle(now, &mut challenge.clone());
        while reborn.poll_transmit(now, &mut buffer).is_some() {
            sent += 1;
        }
    }
    assert!((1..=50).contains(&sent), "{sent} frames in 10 s");
}

/// Frames that one forged or repeated broadcast, and many of them, make every node send.
#[test]
fn broadcasts_that_nobody_vouches_for_make_few_ask() {
    const MEMBERS: usize = 31;
    let mut aether = Aether::new(2, 0.0, 0);
    let now = aether.now;
    let broadcast = aether.nodes[1].send(now, ShortAddress::BROADCAST, &[1_u8; 20]);
    aether.run();
    assert!(broadcast.is_ok());
    let genuine = aether.heard[0].clone();
    let mut forged = genuine.clone();
    *forged.last_mut().unwrap() ^= 1;
    // Of a member that all know, and of an address that no node has.
    let mut unknown = forged.clone();
    unknown[7] = 77;
    for (frame, knows, most) in [
        (&forged, true, 0.0),
        (&genuine, true, 0.0),
        (&unknown, true, 0.3),
        (&genuine, false, 0.3),
    ] {
        let mut members: Vec<Node> = (0..MEMBERS).map(|n| node(100 + n, 5000)).collect();
        for member in members.iter_mut().filter(|_| knows) {
            let peers = &mut member.session.peers;
            let counter = aether.nodes[1].session.counter.upcoming();
            let one = aether.nodes[1].session.extended();
            peers.enter(one, short(1), counter, now).unwrap();
        }
        let (mut sent, mut received) = (0, 0);
        let mut buffer = [0; FRAME_MAX];
        // A frame each 50 ms for a minute.
        for n in 0..1200 {
            let now = now + Duration::from_millis(50 * n);
            received += frame.len();
            for member in &mut members {
                member.handle(now, &mut frame.clone());
                let later = now + Duration::from_millis(25);
                while let Some(len) = member.poll_transmit(later, &mut buffer) {
                    sent += len;
                }
            }
        }
        let factor = sent as f64 / received as f64;
        assert!(factor <= most, "{factor}");
        assert_eq!(sent == 0, most == 0.0);
    }
}

/// A node with the key speaks in a member's name, with a counter far ahead. The member proves that it is the one,
/// and is heard again.
#[test]
fn a_counter_far_ahead_mutes_nobody_for_long() {
    for ahead in [2_000, u32::MAX - 2_000_000] {
        let mut aether = acquainted();
        let now = aether.now;
        let mut insider = node(1, 5000 + ahead);
        insider.attach(PAN, short(1));
        insider.session.peers = aether.nodes[1].session.peers.clone();
        insider.send(now, short(2), &66_u8).unwrap();
        let mut buffer = [0; FRAME_MAX];
        let len = insider.poll_transmit(now, &mut buffer).unwrap();
        aether.nodes[2].handle(now, &mut buffer[..len]);
        assert_eq!(aether.nodes[2].recv(), Some((short(1), 66_u8)));
        while aether.nodes[2].poll_transmit(now, &mut buffer).is_some() {}
        let ticket = aether.nodes[1].send(now, short(2), &1_u8).unwrap();
        aether.run();
        assert_eq!(aether.nodes[2].recv(), Some((short(1), 1_u8)), "{ahead}");
        assert_eq!(aether.nodes[1].result_of(ticket), Some(Delivery::Delivered));
    }
}

/// A member with the key says that it has the coordinator's address. It hands on no key to those who have
/// joined another coordinator.
#[test]
fn only_the_coordinator_one_joined_hands_on_a_key() {
    for (authority, is_taken) in [(0, true), (3, false)] {
        let mut aether = acquainted();
        aether.nodes[2].obey(Eui64([2, 0, 0, 0, 0, 0, 0, authority]));
        let now = aether.now;
        let ticket = aether.nodes[0].send_next_key(now, short(2), &key(2));
        aether.run();
        let delivery = aether.nodes[0].result_of(ticket.unwrap());
        assert_eq!(delivery == Some(Delivery::Delivered), is_taken);
        let next = is_taken.then(|| key(2));
        assert_eq!(aether.nodes[2].session.keys.next(), next);
    }
}

/// Two nodes change addresses, and the others know them by their former ones.
#[test]
fn whoever_has_an_address_now_is_asked_who_it_is() {
    let mut aether = Aether::new(3, 0.0, 0);
    for n in [1, 2] {
        aether.nodes[n].send(aether.now, short(0), &0_u8).unwrap();
    }
    aether.run();
    while aether.nodes[0].recv_bytes().is_some() {}
    for (n, other) in [(1, 2), (2, 1)] {
        aether.nodes[n].attach(PAN, short(other));
    }
    // One whose frame counters are ahead of the other's, and one whose are behind.
    for (n, other) in [(1, 2), (2, 1)] {
        let ticket = aether.nodes[n].send(aether.now, short(0), &n).unwrap();
        aether.run();
        assert_eq!(aether.nodes[0].recv(), Some((short(other), n)));
        assert_eq!(aether.nodes[n].result_of(ticket), Some(Delivery::Delivered));
    }
}

/// A node that asks under the next key has not heard that it is in use; no node takes it for that.
#[test]
fn nobody_follows_a_challenge() {
    let mut aether = Aether::new(3, 0.0, 0);
    for n in [0, 1, 2] {
        aether.nodes[n].session.keys.install(key(2)).unwrap();
    }
    aether.nodes[1].send(aether.now, short(2), &0_u8).unwrap();
    aether.run();
    for to in [0, 2] {
        let now = aether.now;
        aether.nodes[1].ask(now, Address::Short(short(to)), true);
        aether.run();
    }
    for node in &aether.nodes {
        assert_eq!(node.session.keys.active(), key(1));
    }
    // The coordinator follows no other node.
    let now = aether.now;
    aether.nodes[1].activate_key(2, now).unwrap();
    aether.nodes[1].send(now, short(0), &1_u8).unwrap();
    aether.nodes[1].send(now, short(2), &2_u8).unwrap();
    aether.run();
    let keys = aether.nodes.iter().map(|node| node.session.keys.active());
    assert_eq!(keys.collect::<Vec<_>>(), [key(1), key(2), key(2)]);
    assert_eq!(aether.nodes[0].recv(), Some((short(1), 1_u8)));
}

#[test]
fn keys_are_handed_on_and_followed() {
    let mut aether = Aether::new(3, 0.0, 0);
    aether.nodes[0].session.keys.install(key(2)).unwrap();
    for n in [1, 2] {
        aether.nodes[0]
            .send_next_key(aether.now, short(n), &key(2))
            .unwrap();
    }
    aether.run();
    for n in [1, 2] {
        assert_eq!(aether.nodes[n].session.keys.next(), Some(key(2)));
        assert_eq!(aether.nodes[n].session.keys.active(), key(1));
    }
    aether.nodes[0].activate_key(2, aether.now).unwrap();
    aether.nodes[0].send(aether.now, short(1), &1_u8).unwrap();
    aether.run();
    assert_eq!(aether.nodes[1].session.keys.active(), key(2));
    // The other one has heard nothing for it yet, and is heard all the same.
    aether.nodes[2].send(aether.now, short(1), &2_u8).unwrap();
    aether.run();
    assert_eq!(aether.nodes[1].recv(), Some((short(0), 1_u8)));
    assert_eq!(aether.nodes[1].recv(), Some((short(2), 2_u8)));
    assert_eq!(aether.nodes[2].session.keys.active(), key(2));
}

/// Two nodes that know each other.
fn acquainted() -> Aether {
    let mut aether = Aether::new(3, 0.0, 0);
    aether.nodes[1].send(aether.now, short(2), &0_u8).unwrap();
    aether.nodes[1].send(aether.now, short(0), &0_u8).unwrap();
    aether.run();
    assert_eq!(aether.nodes[2].recv(), Some((short(1), 0_u8)));
    aether.heard.clear();
    aether
}

/// A packet from node 1 to node 2, which gets it.
fn slip(aether: &mut Aether, packet: &Packet<'_>) {
    let mut payload = [0; MESSAGE_HEADER + MESSAGE_MAX];
    let len = packet.emit(&mut payload).unwrap();
    let to = Address::Short(short(2));
    let from = Address::Short(short(1));
    let mut buffer = [0; FRAME_MAX];
    let sealed = aether.nodes[1].seal(false, from, to, &payload[..len], &mut buffer);
    let (len, _) = sealed.unwrap();
    aether.nodes[2].handle(aether.now, &mut buffer[..len]);
}

#[test]
fn challenges_are_few_and_not_repeated_at_once() {
    let target = |n: u64| Address::Short(ShortAddress(n as u16));
    let at = |ms: u64| Instant(ms * 1000);
    let mut challenges = Challenges::default();
    challenges.asked(at(0), target(1), 11);
    assert!(!challenges.may_ask(Instant(99_999), target(1)));
    assert!(challenges.may_ask(at(100), target(1)));
    assert!(challenges.may_ask(at(0), target(2)));
    for n in 2..=8 {
        challenges.asked(at(n), target(n), 10 + n as u32);
    }
    // Full, until the first one expires.
    assert!(!challenges.may_ask(Instant(1_999_999), target(9)));
    assert!(challenges.may_ask(at(2000), target(9)));
    challenges.asked(at(2000), target(9), 19);
    // A target that has to be asked takes the place of the oldest.
    challenges.asked(at(2000), target(10), 20);
    let mut is_answered = |n: u16, counter| {
        let extended = Eui64([2, 0, 0, 0, 0, 0, 0, 9]);
        challenges.is_answered(at(2000), extended, ShortAddress(n), counter)
    };
    assert!(!is_answered(2, 12));
    assert!(!is_answered(3, 14), "another's counter");
    assert!(is_answered(3, 13));
    assert!(!is_answered(3, 13), "once");
    assert!(is_answered(4, 14) && is_answered(10, 20));
}

/// A broadcast is sent twice and not acknowledged: all receivers would answer at once.
#[test]
fn a_broadcast_is_sent_twice_and_not_acknowledged() {
    let mut aether = acquainted();
    let everybody = ShortAddress::BROADCAST;
    aether.nodes[1].send(aether.now, everybody, &1_u8).unwrap();
    aether.run();
    assert_eq!(aether.heard.len(), 2);
    assert_eq!(aether.nodes[2].recv(), Some((short(1), 1_u8)));
    assert_eq!(aether.nodes[2].recv_bytes(), None);
}

#[test]
fn a_broadcast_that_its_user_repeats_is_sent_once() {
    let mut aether = Aether::new(2, 0.0, 1);
    let (all, now) = (ShortAddress::BROADCAST, aether.now);
    let sent = |aether: &mut Aether, effort| {
        let before = aether.heard.len();
        let ticket = aether.nodes[0].send_with(now, all, &7_u8, effort).unwrap();
        aether.run();
        let result = aether.nodes[0].result_of(ticket);
        assert_eq!(result, Some(Delivery::Broadcast));
        aether.heard.len() - before
    };
    // What a stranger needs to believe it comes besides, the first time.
    let _ = sent(&mut aether, Effort::Acknowledged);
    assert_eq!(sent(&mut aether, Effort::Acknowledged), 2);
    assert_eq!(sent(&mut aether, Effort::Once), 1);
}

#[test]
fn a_broadcast_to_one_is_refused() {
    let mut aether = acquainted();
    let unknown = aether.nodes[2].counts().unknown;
    let packet = Packet::Message {
        kind: Kind::Broadcast,
        age: 0,
        bytes: &[7],
    };
    slip(&mut aether, &packet);
    assert_eq!(aether.nodes[2].counts().unknown, unknown + 1);
    assert_eq!(aether.nodes[2].recv_bytes(), None);
}

#[test]
fn only_the_receiver_acknowledges() {
    let mut aether = acquainted();
    let ticket = aether.nodes[1].send(aether.now, short(2), &1_u8).unwrap();
    let mut buffer = [0; FRAME_MAX];
    aether.nodes[1]
        .poll_transmit(aether.now, &mut buffer)
        .unwrap();
    let counter = aether.nodes[1].session.counter.upcoming() - 1;
    for (n, result) in [(0, None), (2, Some(Delivery::Delivered))] {
        let mut payload = [0; 8];
        let packet = Packet::Acknowledgement { counter };
        let len = packet.emit(&mut payload).unwrap();
        let (from, to) = (Address::Short(short(n)), Address::Short(short(1)));
        let sealed = aether.nodes[n].seal(false, from, to, &payload[..len], &mut buffer);
        let (len, _) = sealed.unwrap();
        aether.nodes[1].handle(aether.now, &mut buffer[..len]);
        assert_eq!(aether.nodes[1].result_of(ticket), result, "of node {n}");
    }
}

#[test]
fn whoever_finds_no_place_in_the_table_is_not_heard() {
    let mut aether = Aether::new(10, 0.0, 0);
    for n in 1..=9 {
        let ticket = aether.nodes[n].send(aether.now, short(0), &n).unwrap();
        aether.run();
        let delivery = match n {
            9 => Delivery::NoAnswer,
            _ => Delivery::Delivered,
        };
        assert_eq!(aether.nodes[n].result_of(ticket), Some(delivery), "{n}");
        assert_eq!(aether.nodes[0].recv_bytes().is_some(), n < 9);
    }
    assert_eq!(aether.nodes[0].session.peers.iter().count(), 8);
    assert!(aether.nodes[0].counts().table_full > 0);
}

/// The age of a repetition has one byte: an old message is not taken for a new one.
#[test]
fn a_message_is_given_up_before_its_age_overflows() {
    for (frames, is_repeated) in [(254, true), (255, false)] {
        let mut aether = acquainted();
        let ticket = aether.nodes[1].send(aether.now, short(2), &1_u8).unwrap();
        let mut buffer = [0; FRAME_MAX];
        aether.nodes[1]
            .poll_transmit(aether.now, &mut buffer)
            .unwrap();
        for _ in 0..frames {
            aether.nodes[1].session.counter.take().unwrap();
        }
        let later = aether.now + Duration::from_secs(1);
        let repeated = aether.nodes[1].poll_transmit(later, &mut buffer).is_some();
        assert_eq!(repeated, is_repeated, "{frames} frames in between");
        let result = aether.nodes[1].result_of(ticket);
        assert_eq!(result, (!is_repeated).then_some(Delivery::NoAnswer));
    }
}

/// Any member could lock the others out otherwise.
#[test]
fn only_the_coordinator_hands_on_keys() {
    let mut aether = acquainted();
    let unknown = aether.nodes[2].counts().unknown;
    let ticket = aether.nodes[1].send_next_key(aether.now, short(2), &key(2));
    aether.run();
    assert_eq!(aether.nodes[2].session.keys.next(), None);
    assert!(!aether.nodes[2].take_keys_changed());
    // It is not acknowledged either, and its sender knows.
    let result = aether.nodes[1].result_of(ticket.unwrap());
    assert_eq!(result, Some(Delivery::NoAnswer));
    assert_eq!(
        aether.nodes[2].counts().unknown,
        unknown + u32::from(ATTEMPTS)
    );
}

/// A node that answers late may have kept the challenge back, or been kept from answering.
#[test]
fn an_answer_after_two_seconds_is_none() {
    for (late, is_fresh) in [(1_999_999, true), (2_000_000, false)] {
        let mut nodes = [node(1, 0), node(2, 0)];
        let mut buffer = [0; FRAME_MAX];
        let asked = Instant(1000);
        nodes[0].challenge(asked, nodes[1].own_extended());
        let len = nodes[0].poll_transmit(asked, &mut buffer).unwrap();
        nodes[1].handle(asked, &mut buffer[..len]);
        let len = nodes[1].poll_transmit(asked, &mut buffer).unwrap();
        let answered = asked + Duration::from_micros(late);
        let event = nodes[0].handle(answered, &mut buffer[..len]);
        let fresh = LinkEvent::Fresh {
            peer: nodes[1].session.extended(),
            short: short(2),
        };
        assert_eq!(event == fresh, is_fresh, "{late} us");
        assert_eq!(nodes[0].session.peers.iter().count(), usize::from(is_fresh));
    }
}

/// A message that its sender gave up, and that comes all the same, is neither delivered nor
/// acknowledged: its sender has told the application otherwise.
#[test]
fn what_its_sender_gave_up_is_not_acknowledged() {
    let mut aether = acquainted();
    let message = |age| Packet::Message {
        kind: Kind::Unicast,
        age,
        bytes: &[7],
    };
    slip(&mut aether, &message(0));
    assert!(aether.nodes[2].deadline().is_some(), "the answer is due");
    assert_eq!(aether.nodes[2].recv(), Some((short(1), 7_u8)));
    aether.run();
    let duplicates = aether.nodes[2].counts().duplicates;
    // The same once more, acknowledged again; then one from before it.
    for (age, is_acknowledged) in [(1, true), (3, false)] {
        slip(&mut aether, &message(age));
        assert_eq!(aether.nodes[2].deadline().is_some(), is_acknowledged);
        assert_eq!(aether.nodes[2].recv_bytes(), None);
        aether.run();
    }
    assert_eq!(aether.nodes[2].counts().duplicates, duplicates + 2);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Half of all frames are lost, each way, independently: every unicast is delivered or
    /// reported as unanswered, those reported as delivered were, and none is delivered twice.
    #[test]
    fn delivered_or_reported_and_never_doubled(
        seed in any::<u64>(),
        loss in prop_oneof![Just(0.5), 0.0..0.9],
        sends in proptest::collection::vec((0..NODES, 0..NODES), 1..24),
    ) {
        let mut aether = Aether::new(NODES, loss, seed);
        let mut tickets = BTreeMap::new();
        let mut results = BTreeMap::new();
        let mut received = Vec::new();
        for (number, &(from, to)) in sends.iter().enumerate() {
            let number = number as u32;
            match aether.nodes[from].send(aether.now, short(to), &number) {
                Ok(ticket) => { tickets.insert((from, ticket), number); }
                Err(SendError::QueueFull) => aether.run(),
                Err(error) => prop_assert!(error == SendError::Destination && from == to),
            }
            if number % 3 == 2 {
                aether.run();
            }
            collect(&mut aether, &mut results, &mut received);
        }
        aether.run();
        collect(&mut aether, &mut results, &mut received);
        prop_assert_eq!(tickets.len(), results.len());
        let distinct: BTreeSet<u32> = received.iter().copied().collect();
        prop_assert_eq!(distinct.len(), received.len(), "doubled: {:?}", received);
        for (ticket, delivery) in results {
            let number = tickets[&ticket];
            prop_assert!(delivery != Delivery::Broadcast);
            prop_assert!(delivery == Delivery::NoAnswer || distinct.contains(&number));
        }
    }
}

fn collect(
    aether: &mut Aether,
    results: &mut BTreeMap<(usize, Ticket), Delivery>,
    received: &mut Vec<u32>,
) {
    for (n, node) in aether.nodes.iter_mut().enumerate() {
        while let Some((ticket, delivery)) = node.result() {
            assert_eq!(results.insert((n, ticket), delivery), None);
        }
        received.extend(core::iter::from_fn(|| node.recv()).map(|(_, number): (_, u32)| number));
    }
}
