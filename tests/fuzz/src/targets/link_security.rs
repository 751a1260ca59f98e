//! Nothing that was not sealed with the key is opened, and nothing disturbs a peer.

use zigbee_link::{
    Instant,
    link::Link,
    radio::FRAME_MAX,
    security::{Counter, FrameSecurity, Key, Protection},
    wire::{Eui64, PanId, ShortAddress},
};

fn link(n: u8) -> Link<4, 2> {
    let key = Key::new(1, core::array::from_fn(|i| 0xA0 ^ i as u8)).expect("not constant");
    let mut counter = Counter::resume(0);
    counter.reserved(1000);
    let session = FrameSecurity::new(
        Eui64([2, 0, 0, 0, 0, 0, 0, n]),
        Protection::EncMic64,
        key,
        counter,
    );
    let mut link = Link::new(session, n.into());
    link.attach(PanId(0xBEEF), ShortAddress(n.into()));
    link
}

/// Tries one input.
pub(crate) fn run(bytes: &[u8]) {
    let now = Instant(0);
    let (mut alice, mut bob) = (link(0), link(1));
    alice
        .send(now, ShortAddress(1), &[0x5A_u8; 8])
        .expect("the queue is empty");
    let mut frame = [0; FRAME_MAX];
    let mut heard = Vec::new();
    for _ in 0..8 {
        if let Some(len) = alice.poll_transmit(now, &mut frame) {
            heard.push(frame[..len].to_vec());
            bob.handle(now, &mut frame[..len]);
        }
        if let Some(len) = bob.poll_transmit(now, &mut frame) {
            alice.handle(now, &mut frame[..len]);
        }
    }
    assert!(bob.recv_bytes().is_some());
    let peers = bob.session.peers.clone();

    // The frame as it is, and laid over each that was heard.
    let mut forged = vec![bytes.to_vec()];
    for mut frame in heard {
        for (place, byte) in frame.iter_mut().zip(bytes) {
            *place ^= byte;
        }
        forged.push(frame);
    }
    for mut frame in forged {
        bob.handle(now, &mut frame);
        assert!(bob.recv_bytes().is_none());
        assert_eq!(bob.session.peers, peers);
    }
}
