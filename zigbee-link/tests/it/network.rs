//! Forming, joining, losing and leaving a network.

use crate::support;

use std::time::Duration;

use support::aether::{Aether, eui, key};
use zigbee_link::{
    Instant,
    link::Delivery,
    network::{Action, KeyChange, NetworkStatus, Node},
    radio::{Channel, FRAME_MAX},
    security::{CounterError, Key},
    store::{Member, Membership, Record, Saved},
    wire::{
        Address, AssociationStatus, Beacon, Frame, FrameType, Header, PanId, Panned, ShortAddress,
        Superframe,
    },
};

const SECOND: Duration = Duration::from_secs(1);

/// A running coordinator in place 0 that expects these devices in the places after it.
fn network(devices: usize, loss: f64, seed: u64) -> Aether {
    let mut aether = Aether::new(loss, seed);
    aether.add(0, key(1));
    for number in 1..=devices {
        aether.add(number, key(1));
        aether.stations[0].node.allow(eui(number).number()).unwrap();
    }
    aether
}

fn pan(aether: &Aether, place: usize) -> Option<PanId> {
    match aether.stations[place].node.status() {
        NetworkStatus::Joined(membership) => Some(membership.pan),
        _ => None,
    }
}

fn refusal(aether: &Aether, place: usize) -> Option<AssociationStatus> {
    match aether.stations[place].node.status() {
        NetworkStatus::Searching(refusal) => refusal,
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn assert_delivers(aether: &mut Aether, from: usize, to: usize) {
    let destination = aether.short(to).unwrap();
    let now = aether.now;
    let link = &mut aether.stations[from].node.link;
    let ticket = link.send(now, destination, &0xA5_u8).unwrap();
    aether.run(10 * SECOND);
    let result = aether.stations[from].node.link.result_of(ticket);
    assert_eq!(result, Some(Delivery::Delivered));
    let received = aether.stations[to].node.link.recv::<u8>();
    assert_eq!(received, Some((aether.short(from).unwrap(), 0xA5)));
}

#[test]
fn devices_on_the_allow_list_join_and_talk() {
    let mut aether = network(3, 0.0, 1);
    aether.run(5 * SECOND);
    let shorts: Vec<_> = (0..4).map(|place| aether.short(place).unwrap().0).collect();
    assert_eq!(shorts[0], 0);
    let mut given = shorts[1..].to_vec();
    given.sort_unstable();
    assert_eq!(given, [1, 2, 3]);
    for (from, to) in [(0, 1), (1, 0), (2, 3), (3, 1)] {
        assert_delivers(&mut aether, from, to);
    }
}

/// A member that was erased has another extended address. It takes its former place at once, and is
/// heard by all, whose table still has the former one: broadcasts included.
#[test]
fn an_erased_member_is_back_at_once() {
    for seed in 0..8 {
        let mut aether = network(3, 0.0, seed);
        aether.run(5 * SECOND);
        let hello = |aether: &mut Aether| {
            let now = aether.now;
            let link = &mut aether.stations[1].node.link;
            link.send(now, ShortAddress::BROADCAST, &7_u8).unwrap();
            aether.run(SECOND);
            [0, 2, 3].map(|to| aether.stations[to].node.link.recv::<u8>().is_some())
        };
        hello(&mut aether);
        assert_eq!(hello(&mut aether), [true; 3]);
        assert_delivers(&mut aether, 1, 2);
        let short = aether.short(1).unwrap();
        for _ in 0..3 {
            let former = aether.stations[1].extended;
            aether.erase(1, key(1));
            aether.run(3 * SECOND);
            assert_ne!(aether.stations[1].extended, former);
            assert_eq!(aether.short(1), Some(short), "seed {seed}");
            let members: Vec<_> = aether.stations[0].node.members().collect();
            assert_eq!(members.len(), 3);
            assert!(members.iter().all(|member| member.extended != former));
            // The first one makes the others ask for its identity.
            hello(&mut aether);
            aether.run(5 * SECOND);
            assert_eq!(hello(&mut aether), [true; 3], "seed {seed}");
            assert_delivers(&mut aether, 1, 0);
            assert_delivers(&mut aether, 2, 1);
        }
    }
}

#[test]
fn joins_through_heavy_loss() {
    for seed in 0..8 {
        let mut aether = network(3, 0.5, seed);
        let all_in = |aether: &Aether| (1..4).all(|place| aether.short(place).is_some());
        let minutes = (0..30).find(|_| {
            aether.run(60 * SECOND);
            all_in(&aether)
        });
        assert!(minutes.is_some(), "seed {seed}");
    }
}

#[test]
fn nobody_joins_uninvited() {
    let mut aether = Aether::new(0.0, 1);
    aether.add(0, key(1));
    aether.add(7, key(1));
    aether.run(20 * SECOND);
    assert_eq!(refusal(&aether, 1), Some(AssociationStatus::Denied));
    let now = aether.now;
    aether.stations[0].node.open_join_window(now, 100 * SECOND);
    aether.run(100 * SECOND);
    assert_eq!(aether.short(1), Some(ShortAddress(1)));
    // The window is over.
    aether.add(8, key(1));
    aether.run(100 * SECOND);
    assert_eq!(refusal(&aether, 2), Some(AssociationStatus::Denied));
    // And so is one that is closed.
    let now = aether.now;
    aether.stations[0].node.open_join_window(now, 100 * SECOND);
    aether.stations[0].node.close_join_window();
    aether.run(90 * SECOND);
    assert_eq!(refusal(&aether, 2), Some(AssociationStatus::Denied));
}

#[test]
fn a_join_window_closes_after_ten_minutes_at_the_latest() {
    let mut aether = Aether::new(0.0, 1);
    aether.add(0, key(1));
    aether.run(5 * SECOND);
    let now = aether.now;
    aether.stations[0]
        .node
        .open_join_window(now, 10_000 * SECOND);
    aether.run(601 * SECOND);
    aether.add(7, key(1));
    aether.run(20 * SECOND);
    assert_eq!(refusal(&aether, 1), Some(AssociationStatus::Denied));
}

#[test]
fn nobody_joins_without_the_site_key() {
    let mut aether = Aether::new(0.0, 1);
    aether.add(0, key(1));
    let same_index = Key::new(1, core::array::from_fn(|i| 0x11 + i as u8)).unwrap();
    aether.add(7, same_index);
    aether.add(8, key(2));
    let now = aether.now;
    aether.stations[0].node.open_join_window(now, 500 * SECOND);
    aether.run(200 * SECOND);
    for place in [1, 2] {
        assert_eq!(refusal(&aether, place), None);
    }
    assert_eq!(aether.stations[0].node.members().count(), 0);
    assert_eq!(aether.stations[0].node.link.session.peers.iter().count(), 0);
}

#[test]
fn a_full_table_says_so() {
    let mut aether = network(4, 0.0, 1);
    aether.run(10 * SECOND);
    let now = aether.now;
    aether.stations[0].node.open_join_window(now, 100 * SECOND);
    let late = aether.add(5, key(1));
    aether.run(10 * SECOND);
    // Its beacons already tell, so nothing is asked.
    assert_eq!(refusal(&aether, late), None);
    assert_eq!(aether.stations[0].node.members().count(), 4);
    // One leaves, and there is room.
    let freed = aether.short(2);
    let now = aether.now;
    aether.stations[2].node.leave(now);
    aether.run(100 * SECOND);
    assert_eq!(aether.stations[2].node.status(), NetworkStatus::Out);
    let short = aether.short(late).unwrap();
    assert_ne!(Some(short), freed);
    aether.stations[2].node.join();
    let now = aether.now;
    aether.stations[0].node.open_join_window(now, 100 * SECOND);
    aether.run(10 * SECOND);
    assert_eq!(aether.stations[0].node.members().count(), 4);
    assert_eq!(aether.short(2), None);
}

#[test]
fn restarts_keep_network_and_addresses() {
    let mut aether = network(2, 0.0, 3);
    aether.run(5 * SECOND);
    let before: Vec<_> = (0..3)
        .map(|place| (pan(&aether, place), aether.short(place)))
        .collect();
    for place in [0, 1, 2] {
        aether.restart(place);
        aether.run(3 * SECOND);
        let after: Vec<_> = (0..3)
            .map(|place| (pan(&aether, place), aether.short(place)))
            .collect();
        assert_eq!(after, before);
        assert_delivers(&mut aether, 1, 2);
        assert_delivers(&mut aether, 0, 1);
    }
    assert_eq!(aether.stations[0].node.members().count(), 2);
}

#[test]
fn an_orphan_comes_back_to_the_same_address() {
    let mut aether = network(2, 0.0, 3);
    aether.run(5 * SECOND);
    let address = aether.short(1);
    aether.stations[1].is_out_of_range = true;
    aether.run(120 * SECOND);
    assert_eq!(refusal(&aether, 1), None);
    aether.stations[1].is_out_of_range = false;
    aether.run(120 * SECOND);
    assert_eq!(aether.short(1), address);
    assert_delivers(&mut aether, 1, 2);
}

#[test]
fn a_member_sent_away_is_out() {
    let mut aether = Aether::new(0.0, 3);
    aether.add(0, key(1));
    aether.add(1, key(1));
    let now = aether.now;
    aether.stations[0].node.open_join_window(now, 5 * SECOND);
    aether.run(6 * SECOND);
    assert_eq!(aether.short(1), Some(ShortAddress(1)));
    let now = aether.now;
    aether.stations[0].node.remove(now, eui(1));
    aether.run(20 * SECOND);
    assert_eq!(refusal(&aether, 1), Some(AssociationStatus::Denied));
    assert_eq!(aether.stations[1].saved.network, None);
    assert_eq!(aether.stations[0].members, [None; 4]);
}

/// They work beside each other, and know of it; a person moves one.
#[test]
fn two_networks_of_one_identifier_part_when_told() {
    let mut aether = network(1, 0.0, 3);
    aether.run(5 * SECOND);
    let shared = pan(&aether, 0).unwrap();
    // Another coordinator, of another site, that has the same identifier on the same channel.
    let other = aether.add(100, key(9));
    let mut network = aether.stations[0].saved.network.unwrap();
    network.coordinator = eui(100);
    aether.stations[other].saved.network = Some(network);
    aether.restart(other);
    // A device asks for beacons, so that they hear of each other.
    aether.add(50, key(7));
    assert_eq!(aether.stations[0].node.last_conflict(), None);
    aether.run(30 * SECOND);
    assert_eq!(pan(&aether, 0), pan(&aether, other));
    assert!(aether.stations[0].node.last_conflict().is_some());
    assert!(aether.stations[other].node.last_conflict().is_some());
    assert_delivers(&mut aether, 0, 1);
    let now = aether.now;
    assert!(aether.stations[0].node.change_pan(now));
    assert!(!aether.stations[0].node.change_pan(now), "under way");
    assert!(!aether.stations[1].node.change_pan(now), "no coordinator");
    aether.run(30 * SECOND);
    assert_ne!(pan(&aether, 0), Some(shared));
    assert_eq!(pan(&aether, other), Some(shared));
    assert_eq!(pan(&aether, 1), pan(&aether, 0));
    assert_delivers(&mut aether, 0, 1);
}

#[test]
fn a_beacon_answers_a_request_to_everybody() {
    let mut aether = Aether::new(0.0, 1);
    aether.add(0, key(1));
    aether.run(5 * SECOND);
    let everybody = Address::Short(ShortAddress::BROADCAST);
    let own = pan(&aether, 0).unwrap();
    for (to, beacons) in [
        (Panned::new(PanId::BROADCAST, everybody), 1),
        (Panned::new(own, everybody), 0),
        (Panned::new(own, Address::Short(ShortAddress(0))), 0),
    ] {
        let header = Header {
            destination: to,
            ..Header::new(FrameType::Command, 1)
        };
        let mut frame = [0; FRAME_MAX];
        let len = header.emit(&mut frame).unwrap();
        frame[len] = 7;
        aether.heard.clear();
        let now = aether.now;
        aether.stations[0].node.handle(now, &mut frame[..=len]);
        aether.run(SECOND);
        assert_eq!(aether.heard.len(), beacons, "{to:?}");
    }
}

/// Forged beacons move no network, and make no node send.
#[test]
fn forged_beacons_move_no_network() {
    let mut aether = network(3, 0.0, 1);
    aether.run(30 * SECOND);
    let own = pan(&aether, 0).unwrap();
    let header = Header {
        source: Panned::new(own, Address::Extended(eui(77))),
        ..Header::new(FrameType::Beacon, 1)
    };
    let mut frame = [0; FRAME_MAX];
    let len = header.emit(&mut frame).unwrap();
    let beacon = Beacon::new(Superframe::beaconless(false), &[]);
    let end = len + beacon.emit(&mut frame[len..]).unwrap();
    let now = aether.now;
    aether.heard.clear();
    for _ in 0..1000 {
        for station in &mut aether.stations {
            station.node.handle(now, &mut frame[..end].to_vec());
        }
    }
    aether.run(SECOND);
    assert_eq!(aether.heard.len(), 0);
    assert!((0..4).all(|place| pan(&aether, place) == Some(own)));
    assert_delivers(&mut aether, 1, 2);
}

/// Forged beacons of networks to join, as many as a scan can hold and more, delay a new node but do not
/// keep it out.
#[test]
fn a_device_joins_in_spite_of_forged_beacons() {
    let mut aether = Aether::new(0.0, 4);
    aether.add(0, key(1));
    aether.run(5 * SECOND);
    let now = aether.now;
    aether.stations[0].node.open_join_window(now, 600 * SECOND);
    aether.add(1, key(1));
    let mut seconds = 0;
    while aether.short(1).is_none() {
        seconds += 1;
        assert!(seconds < 300, "not in five minutes");
        // Ten in each slot of a scan.
        for part in 0..10_u16 {
            for n in 0..10_u16 {
                let place = 100 + 100 * part + n;
                let header = Header {
                    source: Panned::new(PanId(place), Address::Extended(eui(place.into()))),
                    ..Header::new(FrameType::Beacon, 1)
                };
                let mut frame = [0; FRAME_MAX];
                let len = header.emit(&mut frame).unwrap();
                let beacon = Beacon::new(Superframe::beaconless(true), b"zl\x01\0");
                let end = len + beacon.emit(&mut frame[len..]).unwrap();
                let now = aether.now;
                aether.stations[1].node.handle(now, &mut frame[..end]);
            }
            aether.run(SECOND / 10);
        }
    }
    println!("{seconds} s");
}

#[test]
fn the_key_changes_while_the_network_runs() {
    let mut aether = network(3, 0.3, 5);
    aether.run(60 * SECOND);
    assert_eq!(aether.stations[0].node.key_change(), None);
    aether.stations[0].node.change_key(key(2)).unwrap();
    aether.run(100 * SECOND);
    let done = KeyChange {
        index: 2,
        check: key(2).check_value(),
        is_done: true,
        unreached: 0,
    };
    assert_eq!(aether.stations[0].node.key_change(), Some(done));
    for station in &aether.stations {
        assert_eq!(station.node.link.session.keys.active(), key(2));
        assert_eq!(station.saved.active_key, key(2));
        assert_eq!(station.saved.next_key, None);
    }
    aether.loss = 0.0;
    for place in 0..4 {
        aether.restart(place);
    }
    aether.run(5 * SECOND);
    assert_delivers(&mut aether, 1, 2);
}

/// Members that a new key does not reach are counted.
#[test]
fn a_key_change_tells_whom_it_missed() {
    let mut aether = network(3, 0.0, 8);
    aether.run(30 * SECOND);
    aether.stations[2].is_out_of_range = true;
    aether.stations[0].node.change_key(key(2)).unwrap();
    aether.run(60 * SECOND);
    let change = aether.stations[0].node.key_change().unwrap();
    assert!(change.is_done);
    assert_eq!(change.unreached, 1);
    let keys = [0, 1, 2, 3].map(|place| aether.stations[place].saved.active_key);
    assert_eq!(keys, [key(2), key(2), key(1), key(2)]);
}

/// A member is away while the key changes, for any time, and nodes restart meanwhile: it gets the key in use when
/// it is heard again.
#[test]
fn a_member_that_missed_a_key_change_catches_up() {
    for (away, restarts) in [(10, false), (3600, false), (3600, true)] {
        for seed in 0..4 {
            let mut aether = network(3, 0.0, seed);
            aether.run(30 * SECOND);
            aether.stations[2].is_out_of_range = true;
            aether.stations[0].node.change_key(key(2)).unwrap();
            aether.run(away * SECOND);
            if restarts {
                aether.restart(0);
                aether.restart(2);
            } else if away > 60 {
                let change = aether.stations[0].node.key_change().unwrap();
                assert_eq!((change.is_done, change.unreached), (true, 1));
            }
            aether.stations[2].is_out_of_range = false;
            aether.run(200 * SECOND);
            let keys = [0, 1, 2, 3].map(|place| aether.stations[place].saved.active_key);
            assert_eq!(keys, [key(2); 4], "{away} s");
            assert_delivers(&mut aether, 2, 1);
            assert_delivers(&mut aether, 0, 2);
            if restarts {
                // After its start the coordinator knows of no member which key it has.
                assert_delivers(&mut aether, 1, 0);
                assert_delivers(&mut aether, 3, 0);
            }
            aether.run(100 * SECOND);
            assert_eq!(aether.stations[0].saved.former_key, None);
            if !restarts {
                let change = aether.stations[0].node.key_change().unwrap();
                assert_eq!(change.unreached, 0);
            }
        }
    }
}

/// Power may go after each record: without the former key on record, the members that missed the change would
/// be shut out.
#[test]
fn the_former_key_is_written_down_before_another_one_is_in_use() {
    let mut aether = network(3, 0.0, 1);
    aether.run(30 * SECOND);
    aether.stations[2].is_out_of_range = true;
    aether.stations[0].written.clear();
    aether.stations[0].node.change_key(key(2)).unwrap();
    aether.run(300 * SECOND);
    let written = &aether.stations[0].written;
    let place = |record| written.iter().position(|written| *written == record);
    let kept = place(Record::FormerKey(Some(key(1)))).unwrap();
    let active = place(Record::ActiveKey(key(2))).unwrap();
    assert!(kept < active, "{written:?}");
}

/// The former key is of no use to a member that was sent away, nor, after that, to any other node that has only
/// that key. A member that missed two changes has missed them.
#[test]
fn who_was_sent_away_gets_no_new_key() {
    for twice in [false, true] {
        let mut aether = network(3, 0.0, 8);
        aether.run(30 * SECOND);
        aether.stations[2].is_out_of_range = true;
        aether.stations[3].is_out_of_range = true;
        if !twice {
            let now = aether.now;
            assert!(aether.stations[0].node.remove(now, eui(2)));
        }
        for index in [2, 3].into_iter().take(1 + usize::from(twice)) {
            aether.stations[0].node.change_key(key(index)).unwrap();
            aether.run(100 * SECOND);
            assert!(aether.stations[0].node.key_change().unwrap().is_done);
        }
        aether.stations[2].is_out_of_range = false;
        aether.stations[3].is_out_of_range = false;
        aether.run(600 * SECOND);
        for place in [2, 3] {
            let saved = &aether.stations[place].saved;
            assert_eq!((saved.active_key, saved.next_key), (key(1), None));
        }
    }
}

/// The coordinator lost its store while the devices run on: they come back in another order, so that addresses
/// change hands. No node takes one of them for the former owner of its address.
#[test]
fn addresses_change_hands_with_the_network() {
    let pairs = || (0..4).flat_map(|from| (0..4).map(move |to| (from, to)));
    let mut aether = network(3, 0.0, 4);
    let mut former = Vec::new();
    for order in [[1, 2, 3], [3, 1, 2]] {
        for place in 1..4 {
            aether.stations[place].is_out_of_range = true;
        }
        aether.run(120 * SECOND);
        for place in order {
            aether.stations[place].is_out_of_range = false;
            aether.run(60 * SECOND);
        }
        let shorts = [1, 2, 3].map(|place| aether.short(place).unwrap());
        assert_ne!(former, shorts);
        former = shorts.to_vec();
        for (from, to) in pairs().filter(|(from, to)| from != to) {
            assert_delivers(&mut aether, from, to);
        }
        let coordinator = &mut aether.stations[0];
        coordinator.saved.network = None;
        coordinator.members = [None; 4];
        aether.restart(0);
        for number in 1..4 {
            aether.stations[0].node.allow(eui(number).number()).unwrap();
        }
    }
}

/// An application that fetches all results leaves those of the key change to the coordinator.
#[test]
fn a_key_change_ends_while_the_application_fetches_results() {
    let mut aether = network(3, 0.0, 8);
    aether.run(30 * SECOND);
    aether.fetches_results = true;
    aether.stations[2].is_out_of_range = true;
    aether.stations[0].node.change_key(key(3)).unwrap();
    aether.run(Duration::from_millis(10));
    // Another key takes the place of one that is still being handed on.
    aether.stations[0].node.change_key(key(2)).unwrap();
    aether.run(60 * SECOND);
    let change = aether.stations[0].node.key_change().unwrap();
    assert!(change.is_done && change.index == 2);
    assert_eq!(change.unreached, 1);
    let keys = [0, 1, 2, 3].map(|place| aether.stations[place].saved.active_key);
    assert_eq!(keys, [key(2), key(2), key(1), key(2)]);
    // Nothing is left in the queue.
    let (now, link) = (aether.now, &mut aether.stations[0].node.link);
    for _ in 0..4 {
        link.send(now, ShortAddress(1), &1_u8).unwrap();
    }
}

/// A member that has the next key and misses how it comes into use, until the former one is no
/// longer accepted, is let in under the next.
#[test]
fn a_member_that_slept_through_a_key_change_comes_back() {
    for restarts in [true, false] {
        let mut aether = network(3, 0.0, 8);
        aether.run(30 * SECOND);
        aether.stations[0].node.change_key(key(2)).unwrap();
        while aether.stations[1].saved.next_key != Some(key(2)) {
            aether.run(Duration::from_millis(1));
        }
        aether.run(Duration::from_millis(4));
        aether.stations[1].is_out_of_range = true;
        aether.run(100 * SECOND);
        let change = aether.stations[0].node.key_change().unwrap();
        assert!(change.is_done);
        assert_eq!(change.unreached, 0);
        assert_eq!(aether.stations[1].saved.active_key, key(1));
        if restarts {
            aether.restart(1);
        }
        aether.stations[1].is_out_of_range = false;
        aether.run(100 * SECOND);
        assert_eq!(aether.stations[1].saved.active_key, key(2));
        assert_delivers(&mut aether, 1, 2);
        assert_delivers(&mut aether, 0, 1);
    }
}

/// A device that missed that it is no longer a member is told when it is next heard, even if nodes restarted
/// meanwhile, and no other device is given its address.
#[test]
fn a_member_that_missed_being_sent_away_is_told_again() {
    for restarts in [false, true] {
        let mut aether = network(1, 0.0, 3);
        aether.run(5 * SECOND);
        let now = aether.now;
        aether.stations[0].node.open_join_window(now, 2 * SECOND);
        let gone = aether.add(2, key(1));
        aether.run(3 * SECOND);
        let address = aether.short(gone).unwrap();
        aether.stations[gone].is_out_of_range = true;
        let now = aether.now;
        assert!(aether.stations[0].node.remove(now, eui(2)));
        assert!(!aether.stations[0].node.remove(now, eui(2)));
        let now = aether.now;
        aether.stations[0].node.open_join_window(now, 2 * SECOND);
        let late = aether.add(3, key(1));
        aether.run(3 * SECOND);
        assert_ne!(aether.short(late).unwrap(), address);
        if restarts {
            aether.restart(0);
        }
        // The first time, it is told in vain again.
        aether.loss = 0.9;
        aether.stations[gone].is_out_of_range = false;
        aether.run(30 * SECOND);
        aether.loss = 0.0;
        aether.run(60 * SECOND);
        assert_eq!(aether.short(gone), None);
        assert_eq!(aether.stations[gone].saved.network, None);
        assert_eq!(refusal(&aether, gone), Some(AssociationStatus::Denied));
        assert_delivers(&mut aether, 0, late);
        assert_delivers(&mut aether, late, 1);
    }
}

/// Many members go at once: each is written down.
#[test]
fn all_that_changes_at_once_is_written_down() {
    let member = |n: usize| Member {
        extended: eui(n),
        short: ShortAddress(n as u16),
    };
    let saved = Saved {
        counter_limit: 0,
        active_key: key(1),
        next_key: None,
        network: Some(Membership {
            pan: PanId(0xBEEF),
            channel: Channel::FIRST,
            short: ShortAddress::COORDINATOR,
            coordinator: eui(0),
        }),
        extended: None,
        former_key: None,
    };
    let members = core::array::from_fn(|place| Some(member(place + 1)));
    let settings = support::node::settings(0);
    let mut node = Node::<4, 4, 12>::coordinator(settings, &saved, members);
    for n in 1..=12 {
        assert!(node.remove(Instant(0), eui(n)));
    }
    for index in 2..20 {
        node.change_key(key(index)).unwrap();
    }
    let mut left: Vec<u8> = (0..12).collect();
    let mut active = None;
    let mut buffer = [0; FRAME_MAX];
    while let Some(action) = node.poll(Instant(0), &mut buffer) {
        if let Action::Save(record) = action {
            match record {
                Record::Member(place, None) => left.retain(|&other| other != place),
                Record::ActiveKey(key) => active = Some(key),
                _ => {}
            }
            node.saved(record);
        }
    }
    assert!(left.is_empty(), "still there after a restart: {left:?}");
    // Without members to hand it on to, the last key is in use at once.
    assert_eq!(active, Some(key(19)));
}

/// A secured orphan notification of a member is answered with its own address; one of any other device, or an
/// unsecured one, with nothing.
#[test]
fn orphan_notifications_of_members_are_answered() {
    let mut aether = network(2, 0.0, 9);
    aether.run(30 * SECOND);
    let answers = |aether: &mut Aether, place: usize, secured: bool| {
        let node = &mut aether.stations[place].node;
        let header = Header {
            destination: Panned::new(PanId::BROADCAST, Address::Short(ShortAddress::BROADCAST)),
            source: Panned::compressed(Address::Extended(eui(place))),
            ..Header::new(FrameType::Command, 1)
        };
        let mut frame = [0; FRAME_MAX];
        let len = if secured {
            let sealed = node.link.session.seal(&header, &[0x06], &mut frame);
            sealed.unwrap().len
        } else {
            let len = header.emit(&mut frame).unwrap();
            frame[len] = 0x06;
            len + 1
        };
        aether.heard.clear();
        let now = aether.now;
        aether.stations[0].node.handle(now, &mut frame[..len]);
        aether.run(SECOND);
        let is_realignment = |frame: &Frame<'_>| {
            frame.header().frame_type == FrameType::Command && frame.payload()[0] == 0x08
        };
        let frames = aether.heard.iter();
        let frames = frames.filter_map(|on_air| Frame::parse(&on_air.frame).ok());
        frames.filter(is_realignment).count()
    };
    assert_eq!(answers(&mut aether, 1, true), 1);
    assert_eq!(answers(&mut aether, 1, false), 0);
    assert!(aether.short(1).is_some());
    let now = aether.now;
    aether.stations[0].node.remove(now, eui(2));
    assert_eq!(answers(&mut aether, 2, true), 0);
}

/// The coordinator takes the quieter channel and a free identifier.
#[test]
fn networks_keep_apart() {
    let mut aether = network(1, 0.0, 7);
    aether.run(5 * SECOND);
    let second = aether.add(100, key(9));
    aether.run(5 * SECOND);
    let config = |place: usize| aether.stations[place].config.unwrap();
    assert_ne!(config(0).channel, config(second).channel);
    assert_ne!(config(0).pan, config(second).pan);
}

/// Nodes whose counters run out fall silent, and neither wrap around nor spin.
#[test]
fn without_frame_counters_there_is_silence() {
    let mut aether = network(2, 0.0, 7);
    for place in [0, 2] {
        aether.stations[place].saved.counter_limit = u32::MAX - 12;
        aether.restart(place);
    }
    aether.run(100 * SECOND);
    let now = aether.now;
    let link = &mut aether.stations[0].node.link;
    assert_eq!(link.session.counter.take(), Err(CounterError::Exhausted));
    let ticket = link.send(now, ShortAddress(1), &1_u8).unwrap();
    aether.run(100 * SECOND);
    let result = aether.stations[0].node.link.result_of(ticket);
    assert_eq!(result, Some(Delivery::NoAnswer));
    let mut last = Vec::new();
    for on_air in &aether.heard {
        let header = *Frame::parse(&on_air.frame).unwrap().header();
        let counter = header.security.map(|security| security.counter);
        if let Some(counter) = counter.filter(|&counter| counter >= u32::MAX - 12) {
            assert!(counter < u32::MAX);
            assert!(!last.contains(&(header.source.address, counter)));
            last.push((header.source.address, counter));
        }
    }
    assert!((2..=24).contains(&last.len()));
}

/// A device that is carried from one network to the next and back, with loss and a restart in the other
/// one: it belongs to the one that it hears best when it is told to look, is talked to there, uses no
/// nonce twice, and comes home to the address it had.
#[test]
fn a_device_goes_over_to_the_network_that_it_hears_best() {
    for (seed, loss) in [(1, 0.0), (2, 0.0), (3, 0.2), (4, 0.2), (5, 0.2)] {
        let mut aether = network(1, loss, seed);
        let other = aether.add(100, key(1));
        aether.stations[other].node.allow(eui(1).number()).unwrap();
        aether.stations[other].strength = 60;
        aether.run(10 * SECOND);
        // It took the stronger one, or the one that was there first.
        for (own, strengths) in [(0, [100, 60]), (other, [60, 100]), (0, [100, 60])] {
            for (place, strength) in [0, other].into_iter().zip(strengths) {
                aether.stations[place].strength = strength;
            }
            // A beacon may get lost.
            for _ in 0..if loss > 0.0 { 6 } else { 1 } {
                assert!(aether.stations[1].node.roam(), "seed {seed}");
                aether.run(20 * SECOND);
                if pan(&aether, 1) == pan(&aether, own) {
                    break;
                }
            }
            assert_eq!(pan(&aether, 1), pan(&aether, own), "seed {seed}");
            assert_delivers(&mut aether, 1, own);
            assert_delivers(&mut aether, own, 1);
            assert_eq!(aether.short(1), Some(ShortAddress(1)), "seed {seed}");
            aether.restart(1);
            aether.run(5 * SECOND);
            assert_eq!(pan(&aether, 1), pan(&aether, own), "seed {seed}");
        }
        let sent = aether.heard.iter().filter(|on_air| on_air.from == 1);
        let mut counters: Vec<_> = sent
            .filter_map(|on_air| Frame::parse(&on_air.frame).ok()?.header().security)
            .map(|security| security.counter)
            .collect();
        let secured = counters.len();
        counters.sort_unstable();
        counters.dedup();
        assert_eq!(counters.len(), secured, "seed {seed}: a nonce twice");
    }
}

/// A network with another key is no network to go over to, however well it is heard; nor is one that
/// has not expected this device.
#[test]
fn a_device_stays_where_it_is_let_in() {
    for (seed, is_expected) in [(1, true), (2, false)] {
        let mut aether = network(1, 0.0, seed);
        let other = aether.add(100, key(if is_expected { 2 } else { 1 }));
        if is_expected {
            aether.stations[other].node.allow(eui(1).number()).unwrap();
        }
        aether.stations[other].strength = 200;
        aether.run(10 * SECOND);
        assert!(aether.stations[1].node.roam());
        assert!(!aether.stations[0].node.roam(), "a coordinator stays");
        aether.run(20 * SECOND);
        assert_eq!(pan(&aether, 1), pan(&aether, 0));
        assert_delivers(&mut aether, 1, 0);
    }
}
