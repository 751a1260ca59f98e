//! A node that gets any frames at any times does what its contract says, and does not panic.
//!
//! The first byte: 1 a device, 2 the bytes are the contents of frames that an insider with the key sealed, 4 the
//! node was a member before. Then come length, pause in units of 10 ms, frame; and so on.

use std::time::Duration;

use zigbee_link::{
    Instant,
    network::{Action, NetworkSettings, Node},
    radio::{Channel, FRAME_MAX},
    security::{Counter, FrameSecurity, Key, Protection},
    store::{Membership, Saved},
    wire::{Address, Eui64, FrameType, Header, PanId, Panned, ShortAddress},
};

/// Tries one input.
pub(crate) fn run(bytes: &[u8]) {
    let [kind, rest @ ..] = bytes else { return };
    let key = Key::new(1, KEY).expect("not constant");
    let saved = Saved {
        counter_limit: 0,
        active_key: key,
        next_key: None,
        network: (kind & 4 != 0).then_some(MEMBERSHIP),
        extended: None,
        former_key: None,
    };
    let mut settings = NetworkSettings::new(Eui64([2, 0, 0, 0, 0, 0, 0, 1]), 1);
    settings.sleeps = kind & 8 != 0;
    let mut now = Instant(0);
    let mut node: Node<4, 2, 4> = if kind % 2 == 0 {
        Node::coordinator(settings, &saved, [None; 4])
    } else {
        Node::device(now, settings, &saved)
    };
    node.open_join_window(now, Duration::from_secs(100));
    let mut insider = (kind & 2 != 0).then(insider);
    let mut buffer = [0; FRAME_MAX];
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
        match &mut insider {
            None => node.handle(now, &mut frame.to_vec()),
            Some(insider) => {
                if let Some(mut sealed) = sealed(insider, frame) {
                    node.handle(now, &mut sealed);
                }
            }
        }
        rest = tail;
    }
}

const KEY: [u8; 16] = *b"0123456789abcdef";

const COORDINATOR: Eui64 = Eui64([2, 0, 0, 0, 0, 0, 0, 9]);

const MEMBERSHIP: Membership = Membership {
    pan: PanId(0xBEEF),
    channel: Channel::FIRST,
    short: ShortAddress(1),
    coordinator: COORDINATOR,
};

/// An insider with the key, and the address of the device's coordinator.
fn insider() -> FrameSecurity<2> {
    let mut counter = Counter::resume(0);
    counter.reserved(1_000_000);
    let key = Key::new(1, KEY).expect("not constant");
    FrameSecurity::new(COORDINATOR, Protection::EncMic64, key, counter)
}

/// Two bytes give its addresses, the rest is its content.
fn sealed(insider: &mut FrameSecurity<2>, bytes: &[u8]) -> Option<Vec<u8>> {
    let [form, sequence, payload @ ..] = bytes else {
        return None;
    };
    let is_command = form & 1 != 0;
    let kind = if is_command {
        FrameType::Command
    } else {
        FrameType::Data
    };
    let mut header = Header::new(kind, *sequence);
    let to = match form >> 1 & 3 {
        0 => Address::Short(ShortAddress::BROADCAST),
        1 => Address::Short(ShortAddress(1)),
        2 => Address::Short(ShortAddress::COORDINATOR),
        _ => Address::Extended(Eui64([2, 0, 0, 0, 0, 0, 0, 1])),
    };
    header.destination = Panned::new(MEMBERSHIP.pan, to);
    header.source = Panned::compressed(match form >> 3 & 3 {
        0 => Address::Short(ShortAddress::COORDINATOR),
        1 => Address::Short(ShortAddress(2)),
        _ => Address::Extended(COORDINATOR),
    });
    let mut buffer = [0; FRAME_MAX];
    let len = insider.seal(&header, payload, &mut buffer).ok()?.len;
    Some(buffer[..len].to_vec())
}
