//! A package for many nodes over a medium that loses packets.

use core::time::Duration;

use radio_update::{
    package::{Package, public_key},
    packet::Phase,
    sender::Sender,
    stamp::{STAMP, Stamp, board_number},
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::chip::{Node, PAGES, SECRET, image, package, stamp};

const LENGTH: usize = 4096 * PAGES - 1000;

/// Sends a package until the sender is done; each packet to all is lost at each node with this probability. Returns
/// the nodes and the sender.
fn run(nodes: usize, loss: f64, package: Package, seed: u64) -> (Vec<Node>, Sender) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut all: Vec<_> = (0..nodes)
        .map(|number| Node::new(LENGTH, ChaCha8Rng::seed_from_u64(number as u64)))
        .collect();
    for node in &mut all {
        assert!(node.start());
    }
    let sender = Sender::new(package, 0..nodes as u16, 0);
    let sender = drive(&mut all, sender, |_| random.random_bool(loss));
    (all, sender)
}

/// Drives a sender until it is done.
pub(crate) fn drive(
    nodes: &mut [Node],
    mut sender: Sender,
    mut is_lost: impl FnMut(u16) -> bool,
) -> Sender {
    let mut now = Duration::ZERO;
    while !sender.is_done() {
        assert!(now < Duration::from_secs(3600), "{sender:?}");
        if let Some(next) = sender.poll(now) {
            now += Duration::from_millis(5);
            for (address, node) in (0..).zip(nodes.iter_mut()) {
                if next.to.is_some_and(|to| to != address) || next.to.is_none() && is_lost(address)
                {
                    continue;
                }
                let answer = node.take(&next.packet);
                node.confirm();
                // Answers to one are repeated until they arrive.
                if let Some(answer) = answer
                    && !(next.to.is_none() && is_lost(address))
                {
                    sender.on_packet(now, address, &answer);
                }
            }
            sender.on_sent(now);
        } else if let Some(deadline) = sender.deadline() {
            now = now.max(deadline);
        }
    }
    sender
}

#[test]
fn all_nodes_run_the_new_image() {
    for (nodes, loss) in [(1, 0.0), (7, 0.05), (20, 0.3)] {
        let (mut all, sender) = run(nodes, loss, package(LENGTH, 2), 3);
        assert!(sender.has_succeeded(), "{:?}", sender.nodes());
        for node in &mut all {
            assert_eq!(node.active(LENGTH), image(LENGTH, 2));
            // Confirmed: it stays.
            assert!(node.start());
            assert_eq!(node.active(LENGTH), image(LENGTH, 2));
        }
    }
}

/// A hundred nodes that each lose one packet in fifty, none the same: what all of them miss is two thirds of the image.
#[test]
fn a_hundred_nodes_cost_little_more_than_one() {
    let (_, sender) = run(100, 0.02, package(LENGTH, 2), 5);
    assert!(sender.has_succeeded());
    let blocks = sender.package().blocks();
    let sent = sender.sent().blocks;
    assert!(sent as f64 <= 1.3 * blocks as f64, "{sent} for {blocks}");
}

/// Runs a package at one node, and returns the state in which it ends there.
fn ends(package: Package, change: impl FnOnce(&mut Node)) -> (Option<Phase>, Node) {
    let mut node = Node::new(LENGTH, ChaCha8Rng::seed_from_u64(1));
    change(&mut node);
    assert!(node.start());
    let mut nodes = [node];
    let sender = drive(&mut nodes, Sender::new(package, [0], 0), |_| false);
    let phase = sender.nodes()[&0].phase;
    assert!(!sender.has_succeeded() || phase == Some(Phase::Installed));
    let [node] = nodes;
    (phase, node)
}

#[test]
fn what_is_forged_older_foreign_or_too_long_is_refused_and_changes_nothing() {
    let of = |stamp: Stamp, length, secret| {
        let mut image = image(length, 1);
        image[500..][..STAMP].copy_from_slice(&stamp.bytes());
        Package::sign(&image, &secret).unwrap()
    };
    let other = Stamp {
        board: board_number("nrf52833"),
        ..stamp(9)
    };
    let without_role = Stamp {
        roles: 1,
        ..stamp(9)
    };
    for (package, phase) in [
        (of(stamp(9), LENGTH, [43; 32]), Phase::Forged),
        (of(stamp(1), LENGTH, SECRET), Phase::Older),
        (of(stamp(0), LENGTH, SECRET), Phase::Older),
        (of(other, LENGTH, SECRET), Phase::Foreign),
        (of(without_role, LENGTH, SECRET), Phase::Foreign),
        (of(stamp(9), 4096 * PAGES + 1, SECRET), Phase::TooLong),
    ] {
        let (ended, mut node) = ends(package, |_| {});
        assert_eq!(ended, Some(phase));
        assert!(node.start());
        assert_eq!(node.active(LENGTH), image(LENGTH, 1));
    }
    let (ended, _) = ends(package(LENGTH, 2), |node| node.own.key = None);
    assert_eq!(ended, Some(Phase::NoKey));
    let (ended, _) = ends(package(LENGTH, 2), |node| {
        node.own.key = Some(public_key(&[1; 32]));
    });
    assert_eq!(ended, Some(Phase::Forged));
}

/// Hands node 0 the next packet, or waits for a second where there is none.
fn talk(sender: &mut Sender, node: &mut Node, now: &mut Duration) {
    let Some(next) = sender.poll(*now) else {
        *now += Duration::from_secs(1);
        return;
    };
    if let Some(answer) = node.take(&next.packet) {
        sender.on_packet(*now, 0, &answer);
    }
    sender.on_sent(*now);
}

/// A camera takes a part of an image for cameras, becomes a target, and starts again.
#[test]
fn an_image_that_was_begun_in_another_role_is_foreign() {
    let mut bytes = image(LENGTH, 1);
    let for_cameras = Stamp {
        roles: 2,
        ..stamp(2)
    };
    bytes[500..][..STAMP].copy_from_slice(&for_cameras.bytes());
    let package = Package::sign(&bytes, &SECRET).unwrap();
    let mut node = Node::new(LENGTH, ChaCha8Rng::seed_from_u64(1));
    assert!(node.start());
    let mut sender = Sender::new(package.clone(), [0], 0);
    let mut now = Duration::ZERO;
    let phase = |node: &Node| node.receiver.as_ref().unwrap().phase();
    while phase(&node) != Phase::Receiving {
        talk(&mut sender, &mut node, &mut now);
    }
    assert!(node.start());
    assert_eq!(phase(&node), Phase::Preparing);
    node.own.role = 4;
    assert!(node.start());
    assert_eq!(phase(&node), Phase::Idle);
    let mut nodes = [node];
    let sender = drive(&mut nodes, Sender::new(package, [0], 0), |_| false);
    assert_eq!(sender.nodes()[&0].phase, Some(Phase::Foreign));
    assert_eq!(nodes[0].active(LENGTH), image(LENGTH, 1));
}

/// A byte that keeps its value spoils one page again and again: the node says that its flash fails, the other one
/// runs the new image, and the sender comes to an end.
#[test]
fn a_broken_flash_is_named_and_costs_the_others_nothing() {
    let mut nodes = [1, 2].map(|seed| Node::new(LENGTH, ChaCha8Rng::seed_from_u64(seed)));
    nodes[1].break_byte(5000);
    for node in &mut nodes {
        assert!(node.start());
    }
    assert_ne!(image(LENGTH, 2)[5000], 0);
    let sender = Sender::new(package(LENGTH, 2), [0, 1], 0);
    let sender = drive(&mut nodes, sender, |_| false);
    assert_eq!(sender.nodes()[&0].phase, Some(Phase::Installed));
    assert_eq!(sender.nodes()[&1].phase, Some(Phase::Flash));
    assert_eq!(nodes[1].active(LENGTH), image(LENGTH, 1));
}

/// An image that never finds its network, and that its watchdog restarts: the node goes back each time, and says so.
#[test]
fn a_new_image_that_finds_no_network_goes_back() {
    let mut node = Node::new(LENGTH, ChaCha8Rng::seed_from_u64(1));
    assert!(node.start());
    let mut sender = Sender::new(package(LENGTH, 2), [0], 0);
    let (mut now, mut trials) = (Duration::ZERO, 0);
    while !sender.is_done() {
        talk(&mut sender, &mut node, &mut now);
        if node.receiver.as_ref().unwrap().phase() == Phase::Trial {
            trials += 1;
            assert_eq!(node.active(LENGTH), image(LENGTH, 2));
            assert!(node.start());
            assert_eq!(node.active(LENGTH), image(LENGTH, 1));
        }
    }
    assert_eq!(sender.nodes()[&0].phase, Some(Phase::Reverted));
    assert!(!sender.has_succeeded());
    assert_eq!(trials, 4);
    // A later version is taken.
    let mut nodes = [node];
    let sender = Sender::new(package(LENGTH, 3), [0], 0);
    let sender = drive(&mut nodes, sender, |_| false);
    assert!(sender.has_succeeded(), "{sender:?}");
    assert_eq!(nodes[0].active(LENGTH), image(LENGTH, 3));
}
