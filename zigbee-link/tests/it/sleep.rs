//! Devices that sleep while their network is quiet.

use crate::support;

use std::time::Duration;

use support::aether::{Aether, eui, key};
use zigbee_link::{
    link::{Delivery, WAKE_FOR, WAKING},
    wire::ShortAddress,
};

const SECOND: Duration = Duration::from_secs(1);
const HOUR: Duration = Duration::from_secs(3600);

/// A network of a coordinator in place 0 and three devices, all of which have joined.
fn network(loss: f64, seed: u64) -> Aether {
    let mut aether = Aether::new(loss, seed);
    aether.sleeps = true;
    aether.add(0, key(1));
    for number in 1..=3 {
        aether.add(number, key(1));
        aether.stations[0].node.allow(eui(number).number()).unwrap();
    }
    aether.run(60 * SECOND);
    assert!((0..4).all(|place| aether.short(place).is_some()));
    aether
}

/// Time for which each device listens while this time passes.
fn listened(aether: &mut Aether, time: Duration) -> [Duration; 3] {
    let all = |aether: &Aether| [1, 2, 3].map(|place| aether.stations[place].listened(aether.now));
    let before = all(aether);
    aether.run(time);
    let after = all(aether);
    std::array::from_fn(|place| after[place] - before[place])
}

fn receives(aether: &mut Aether, place: usize) -> bool {
    aether.stations[place].node.link.recv::<u8>().is_some()
}

/// They listen for half a percent of the time, and a little for each answer of the coordinator.
#[test]
fn devices_of_a_quiet_network_hardly_listen_and_stay_members() {
    let mut aether = network(0.0, 1);
    let shorts = [1, 2, 3].map(|place| aether.short(place));
    aether.run(2 * WAKE_FOR);
    for share in listened(&mut aether, 24 * HOUR) {
        let share = share.as_secs_f64() / (24.0 * 3600.0);
        assert!((0.005..0.006).contains(&share), "{share}");
    }
    assert_eq!([1, 2, 3].map(|place| aether.short(place)), shorts);
}

/// Within the time that is promised, for any sender and any receiver.
#[test]
fn a_message_to_one_wakes_it() {
    let mut aether = network(0.0, 2);
    for (from, to) in [(0, 1), (1, 2), (2, 1), (3, 0), (0, 3)] {
        aether.run(HOUR);
        let destination = aether.short(to).unwrap();
        let now = aether.now;
        let link = &mut aether.stations[from].node.link;
        let ticket = link.send(now, destination, &7_u8).unwrap();
        let others: Vec<_> = (1..4).filter(|place| ![from, to].contains(place)).collect();
        let listened = listened(&mut aether, WAKING + SECOND / 2);
        let result = aether.stations[from].node.link.result_of(ticket);
        assert_eq!(result, Some(Delivery::Delivered), "{from} to {to}");
        assert!(receives(&mut aether, to));
        for place in others {
            assert!(listened[place - 1] < SECOND / 5, "{place}");
        }
    }
}

/// The second one is heard: after so long, receivers ask first whether the sender is fresh.
#[test]
fn a_message_to_all_wakes_all() {
    for (seed, from) in [(1, 0), (2, 1), (3, 2), (4, 3)] {
        let mut aether = network(0.0, seed);
        aether.run(HOUR);
        for pause in [WAKING + SECOND / 2, SECOND / 2] {
            let now = aether.now;
            let link = &mut aether.stations[from].node.link;
            let _ = link.send(now, ShortAddress::BROADCAST, &7_u8).unwrap();
            let others = (1..4).filter(|place| *place != from);
            let others: Vec<_> = others.collect();
            for place in &others {
                let _ = receives(&mut aether, *place);
            }
            aether.run(pause);
            if pause < SECOND {
                for place in others {
                    assert!(receives(&mut aether, place), "{from} to {place}");
                }
            }
        }
    }
}

/// Nodes that talk are awake: nothing is delayed but the first message of each minute and a half.
#[test]
fn nothing_waits_in_a_network_that_is_not_quiet() {
    let mut aether = network(0.0, 3);
    aether.run(HOUR);
    for minute in 0..10 {
        let now = aether.now;
        let link = &mut aether.stations[1].node.link;
        let ticket = link.send(now, ShortAddress::BROADCAST, &7_u8).unwrap();
        aether.run(WAKING + SECOND);
        let _ = aether.stations[1].node.link.result_of(ticket);
        for (from, to) in [(1, 2), (2, 1), (1, 3), (3, 2), (0, 3), (1, 0)] {
            let destination = aether.short(to).unwrap();
            let now = aether.now;
            let link = &mut aether.stations[from].node.link;
            let ticket = link.send(now, destination, &7_u8).unwrap();
            aether.run(SECOND / 10);
            let result = aether.stations[from].node.link.result_of(ticket);
            assert_eq!(
                result,
                Some(Delivery::Delivered),
                "{minute}: {from} to {to}"
            );
            while receives(&mut aether, to) {}
            aether.run(3 * SECOND);
        }
        aether.run(40 * SECOND);
    }
}

/// One that is gone is woken alone, again and again; it is no reason for the others to listen.
#[test]
fn a_member_that_is_gone_keeps_the_others_from_no_sleep() {
    let mut aether = network(0.0, 4);
    aether.run(HOUR);
    let gone = aether.short(2).unwrap();
    aether.stations[2].is_out_of_range = true;
    let before = aether.heard.len();
    let mut listened_for = [Duration::ZERO; 3];
    for _ in 0..20 {
        let now = aether.now;
        let link = &mut aether.stations[0].node.link;
        let ticket = link.send(now, gone, &7_u8).unwrap();
        for (sum, time) in listened_for
            .iter_mut()
            .zip(listened(&mut aether, 60 * SECOND))
        {
            *sum += time;
        }
        let result = aether.stations[0].node.link.result_of(ticket);
        assert_eq!(result, Some(Delivery::NoAnswer));
    }
    for place in [0, 2] {
        assert!(listened_for[place] < 10 * SECOND, "{listened_for:?}");
    }
    assert!(aether.heard.len() > before + 20);
}

/// Frames are lost, and messages arrive all the same. One may be given up, with sleep or without: roles send it again.
#[test]
fn devices_are_woken_through_loss() {
    for seed in 0..8 {
        let mut aether = network(0.3, seed);
        aether.run(HOUR);
        for (from, to) in [(0, 1), (1, 2), (3, 1)] {
            let destination = aether.short(to).unwrap();
            let is_delivered = (0..3).any(|_| {
                let now = aether.now;
                let link = &mut aether.stations[from].node.link;
                let ticket = link.send(now, destination, &7_u8).unwrap();
                aether.run(20 * SECOND);
                let result = aether.stations[from].node.link.result_of(ticket);
                result == Some(Delivery::Delivered)
            });
            assert!(is_delivered, "seed {seed}: {from} to {to}");
            aether.run(10 * WAKE_FOR);
        }
    }
}

/// A new identifier is told to all: none has to look for its network.
#[test]
fn devices_that_sleep_follow_their_network() {
    let mut aether = network(0.0, 5);
    aether.run(HOUR);
    let now = aether.now;
    assert!(aether.stations[0].node.change_pan(now));
    aether.run(WAKING + SECOND);
    let pans = [0, 1, 2, 3].map(|place| aether.stations[place].config.unwrap().pan);
    assert_eq!(pans, [pans[0]; 4]);
    let short = [1, 2, 3].map(|place| aether.short(place).is_some());
    assert_eq!(short, [true; 3]);
}
