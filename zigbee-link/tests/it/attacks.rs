//! Attacks by a radio without the key: they cause nothing but noise.

use crate::support;

use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::aether::{Aether, MEMBERS, eui, key};
use zigbee_link::{
    network::NetworkStatus,
    store::Member,
    wire::{Frame, ShortAddress},
};

const SECOND: Duration = Duration::from_secs(1);

/// A coordinator in place 0 and two members, who know each other.
fn network(seed: u64) -> Aether {
    let mut aether = Aether::new(0.0, seed);
    aether.add(0, key(1));
    for number in 1..=2 {
        aether.add(number, key(1));
        aether.stations[0].node.allow(eui(number).number()).unwrap();
    }
    aether.run(5 * SECOND);
    for from in 0..3 {
        broadcast(&mut aether, from, 0);
        aether.run(6 * SECOND);
        broadcast(&mut aether, from, 0);
        aether.run(SECOND);
    }
    for station in &mut aether.stations {
        while station.node.link.recv::<u32>().is_some() {}
        while station.node.link.result().is_some() {}
    }
    aether
}

fn broadcast(aether: &mut Aether, from: usize, what: u32) {
    let now = aether.now;
    let link = &mut aether.stations[from].node.link;
    while link.result().is_some() {}
    link.send(now, ShortAddress::BROADCAST, &what).unwrap();
}

fn received(aether: &mut Aether, place: usize) -> Vec<u32> {
    let link = &mut aether.stations[place].node.link;
    std::iter::from_fn(|| link.recv().map(|(_, what)| what)).collect()
}

/// A member is deaf for a while. An attacker recorded the broadcasts of that time and sends them again: none is
/// taken, whether the sender is still there to be asked or not. Presence, and answers to challenges, are replayed
/// too.
#[test]
fn what_a_deaf_node_missed_is_not_taken_later() {
    for (deaf, sender_is_there) in [(66, true), (66, false), (3600, true), (3600, false)] {
        let mut aether = network(deaf);
        aether.stations[2].is_out_of_range = true;
        aether.heard.clear();
        for stop in 0..deaf / 11 {
            broadcast(&mut aether, 1, 1 + stop as u32);
            aether.run(11 * SECOND);
        }
        aether.stations[2].is_out_of_range = false;
        aether.stations[1].is_out_of_range = !sender_is_there;
        if deaf > 60 {
            // It has lost its network, and finds it again.
            aether.run(60 * SECOND);
        }
        assert!(aether.short(2).is_some());
        let recorded: Vec<_> = aether
            .heard
            .iter()
            .map(|on_air| on_air.frame.clone())
            .collect();
        assert!(recorded.len() > 8);
        for mut frame in recorded {
            let now = aether.now;
            aether.stations[2].node.handle(now, &mut frame);
            aether.run(Duration::from_millis(5));
        }
        assert_eq!(received(&mut aether, 2), [0; 0], "{deaf} s");
        // Not for ever.
        aether.stations[1].is_out_of_range = false;
        aether.run(60 * SECOND);
        broadcast(&mut aether, 1, 77);
        aether.run(6 * SECOND);
        broadcast(&mut aether, 1, 78);
        aether.run(SECOND);
        assert_eq!(received(&mut aether, 2).last(), Some(&78), "{deaf} s");
    }
}

/// A node that is silent for minutes is heard all the same, with its first frame, for it said meanwhile that it is
/// there.
#[test]
fn a_pause_costs_no_broadcast() {
    let mut aether = network(3);
    for pause in [20, 60, 500] {
        aether.run(pause * SECOND);
        broadcast(&mut aether, 1, pause);
        aether.run(SECOND);
        assert_eq!(received(&mut aether, 2), [pause]);
        assert_eq!(received(&mut aether, 0), [pause]);
    }
}

/// A network at rest: the coordinator says that it is there, and no device asks.
#[test]
fn a_network_at_rest_says_little() {
    let mut aether = Aether::new(0.0, 4);
    aether.add(0, key(1));
    for number in 1..=MEMBERS {
        aether.add(number, key(1));
        aether.stations[0].node.allow(eui(number).number()).unwrap();
    }
    aether.run(60 * SECOND);
    aether.heard.clear();
    aether.run(600 * SECOND);
    let frames = aether.heard.len();
    assert!((35..60).contains(&frames), "{frames} frames");
}

/// Replays, frames with flipped bits, and frames made up around true headers, counters ahead of all that was
/// sent included. `ATTACKS=100000000` tries so many.
#[test]
fn no_forgery_and_no_replay_is_taken() {
    let count = std::env::var("ATTACKS").map_or(1_000_000, |count| count.parse().unwrap());
    let mut rng = ChaCha8Rng::seed_from_u64(15);
    let mut aether = network(15);
    // Of all kinds, from all, to all.
    for round in 0..8 {
        for from in 0..3 {
            broadcast(&mut aether, from, round);
            let to = aether.short((from + 1) % 3).unwrap();
            let now = aether.now;
            aether.stations[from]
                .node
                .link
                .send(now, to, &round)
                .unwrap();
            aether.run(3 * SECOND);
            for place in 0..3 {
                assert!(
                    received(&mut aether, place)
                        .iter()
                        .all(|&what| what == round)
                );
            }
        }
    }
    let is_secured =
        |frame: &[u8]| Frame::parse(frame).is_ok_and(|f| f.header().security.is_some());
    let recorded: Vec<_> = aether
        .heard
        .iter()
        .map(|on_air| on_air.frame.clone())
        .collect();
    let recorded: Vec<_> = recorded
        .into_iter()
        .filter(|frame| is_secured(frame))
        .collect();
    let state = |aether: &Aether| {
        let nodes = aether.stations.iter().map(|station| {
            let NetworkStatus::Joined(membership) = station.node.status() else {
                panic!("{:?}", station.node.status());
            };
            let keys = &station.node.link.session.keys;
            (membership, keys.active(), keys.next())
        });
        let members: Vec<Member> = aether.stations[0].node.members().collect();
        (nodes.collect::<Vec<_>>(), members)
    };
    let before = state(&aether);
    let mut refused = 0;
    for n in 0..count {
        let mut frame = recorded[rng.random_range(0..recorded.len())].clone();
        match n % 4 {
            // As it was.
            0 => {}
            // Some bits of it.
            1 => {
                for _ in 0..rng.random_range(1..4) {
                    let at = rng.random_range(0..frame.len());
                    frame[at] ^= 1 << rng.random_range(0..8);
                }
            }
            // Another counter, mostly one that was never used.
            2 => {
                let (header, short) = (frame.len(), frame[1] >> 6 == 2);
                let at = if short { 9 } else { 15 };
                if at + 5 < header {
                    frame[at + 1..at + 5].copy_from_slice(&rng.random::<u32>().to_le_bytes());
                }
            }
            // Another content under a true header.
            _ => {
                let from = rng.random_range(15..frame.len().max(16)).min(frame.len());
                rng.fill(&mut frame[from..]);
            }
        }
        let at = rng.random_range(0..3);
        let now = aether.now;
        aether.stations[at].node.handle(now, &mut frame);
        if n % 64 == 0 {
            aether.run(Duration::from_millis(20));
            refused = (0..3)
                .map(|place| u64::from(aether.stations[place].node.link.counts().refused))
                .sum();
            for place in 0..3 {
                assert_eq!(received(&mut aether, place), [0; 0], "attack {n}");
            }
        }
    }
    assert_eq!(state(&aether), before);
    assert!(refused > count / 3, "{refused}");
    // And the network works as before.
    aether.run(20 * SECOND);
    broadcast(&mut aether, 1, 4_711);
    aether.run(6 * SECOND);
    assert_eq!(received(&mut aether, 2), [4_711]);
}
