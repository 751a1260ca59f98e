//! A node that gets any frames at any times does what its contract says, and does not panic.
#![no_main]

use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use zigbee_link::{
    Instant,
    network::{Action, Channels, NetworkSettings, Node},
    radio::FRAME_MAX,
    security::{Key, Protection},
    store::Saved,
    wire::Eui64,
};

fuzz_target!(|bytes: &[u8]| {
    let [kind, rest @ ..] = bytes else { return };
    let key = Key::new(1, core::array::from_fn(|i| 0xA0 ^ i as u8)).expect("not constant");
    let saved = Saved {
        counter_limit: 0,
        active_key: key,
        next_key: None,
        network: None,
        extended: None,
        former_key: None,
    };
    let settings = NetworkSettings {
        extended: Eui64([2, 0, 0, 0, 0, 0, 0, 1]),
        channels: Channels::ALL,
        tx_power: 0,
        protection: Protection::EncMic64,
        seed: 1,
    };
    let mut now = Instant(0);
    let mut node: Node<4, 2, 4> = if kind % 2 == 0 {
        Node::coordinator(settings, &saved, [None; 4])
    } else {
        Node::device(now, settings, &saved)
    };
    node.open_join_window(now, Duration::from_secs(100));
    let mut buffer = [0; FRAME_MAX];
    // Length, pause in units of 10 ms, frame; and so on.
    let mut rest = rest;
    while let [len, pause, tail @ ..] = rest {
        now = now + Duration::from_millis(10 * u64::from(*pause));
        for _ in 0..1000 {
            match node.poll(now, &mut buffer) {
                Some(Action::Save(record)) => node.saved(record),
                Some(Action::Configure(_)) => {}
                Some(Action::Transmit(len)) => assert!(len <= FRAME_MAX),
                None => break,
            }
        }
        let (frame, tail) = tail.split_at(tail.len().min(usize::from(*len)));
        node.handle(now, &mut frame.to_vec());
        rest = tail;
    }
});
