//! The mistakes that others shipped, and a storm of forgeries.

use core::time::Duration;
use std::{env, vec::Vec};

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::{
    Instant,
    radio::FRAME_MAX,
    wire::{Address, Eui64, FrameType, Header, Malformed, PanId, Panned, ShortAddress},
};

const ALICE: Eui64 = Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0, 1]);
const BOB: Eui64 = Eui64([0xAC, 0xDE, 0x48, 0, 0, 0, 0, 2]);
const ALICE_SHORT: ShortAddress = ShortAddress(0x0A);
const NOW: Instant = Instant(0);

fn key(index: u8) -> Key {
    Key::new(index, core::array::from_fn(|i| 0xC0 + i as u8 + index)).unwrap()
}

fn session(extended: Eui64) -> FrameSecurity<4> {
    let mut counter = Counter::resume(100);
    counter.reserved(100_000);
    FrameSecurity::new(extended, Protection::EncMic64, key(1), counter)
}

/// Alice, and Bob who knows her up to counter 99.
fn pair() -> (FrameSecurity<4>, FrameSecurity<4>) {
    let mut bob = session(BOB);
    bob.peers.enter(ALICE, ALICE_SHORT, 99, NOW).unwrap();
    (session(ALICE), bob)
}

fn header(frame_type: FrameType) -> Header {
    Header {
        destination: Panned::new(PanId(0xBEEF), Address::Short(ShortAddress(0x0B))),
        source: Panned::compressed(Address::Short(ALICE_SHORT)),
        ..Header::new(frame_type, 7)
    }
}

fn sealed(from: &mut FrameSecurity<4>, payload: &[u8]) -> Vec<u8> {
    let mut buffer = [0; FRAME_MAX];
    let sealed = from
        .seal(&header(FrameType::Data), payload, &mut buffer)
        .unwrap();
    buffer[..sealed.len].to_vec()
}

fn opened<'f>(by: &mut FrameSecurity<4>, frame: &'f mut [u8]) -> Result<Opened<'f>, Refused> {
    by.open(NOW, frame)
}

#[test]
fn sealed_then_opened() {
    let (mut alice, mut bob) = pair();
    for frame_type in [FrameType::Data, FrameType::Command] {
        let mut buffer = [0; FRAME_MAX];
        let len = alice
            .seal(&header(frame_type), b"payload", &mut buffer)
            .unwrap()
            .len;
        let opened = bob.open(NOW, &mut buffer[..len]).unwrap();
        assert_eq!(opened.payload, b"payload");
        assert_eq!(opened.sender, Sender::Peer(ALICE));
        assert_eq!(opened.frame_type, frame_type);
    }
}

/// zigbee-rs #61, #62: the counter was never updated, or compared with `<`.
#[test]
fn the_same_frame_passes_once() {
    let (mut alice, mut bob) = pair();
    let first = sealed(&mut alice, b"1");
    let second = sealed(&mut alice, b"2");
    assert!(opened(&mut bob, &mut second.clone()).is_ok());
    assert_eq!(
        opened(&mut bob, &mut second.clone()),
        Err(Refused::Replayed)
    );
    assert_eq!(opened(&mut bob, &mut first.clone()), Err(Refused::Replayed));
}

/// A forged frame with a high counter must not lock the true sender out.
#[test]
fn the_counter_moves_only_after_the_code_was_verified() {
    let (mut alice, mut bob) = pair();
    let mut forged = sealed(&mut alice, b"1");
    let counter = forged.len() - 8 - 1 - 5;
    forged[counter..][..4].copy_from_slice(&[0xFF, 0xFF, 0xFF, 0x7F]);
    let before = bob.peers.clone();
    assert_eq!(opened(&mut bob, &mut forged), Err(Refused::Mic));
    assert_eq!(bob.peers, before);
    assert!(opened(&mut bob, &mut sealed(&mut alice, b"2")).is_ok());
}

/// After a restart a receiver has no peers: an old frame is authentic, and no more than that.
#[test]
fn a_stranger_is_not_believed_to_be_fresh() {
    let (mut alice, _) = pair();
    let mut reborn = session(BOB);
    let frame = sealed(&mut alice, b"old");
    let unknown = Refused::UnknownShort(ALICE_SHORT);
    assert_eq!(opened(&mut reborn, &mut frame.clone()), Err(unknown));
    let long = Header {
        source: Panned::compressed(Address::Extended(ALICE)),
        ..header(FrameType::Data)
    };
    let mut buffer = [0; FRAME_MAX];
    let len = alice.seal(&long, b"old", &mut buffer).unwrap().len;
    for _ in 0..2 {
        let mut copy = buffer;
        let opened = reborn.open(NOW, &mut copy[..len]).unwrap();
        assert_eq!(opened.sender, Sender::Stranger(ALICE));
        assert_eq!(reborn.peers.iter().count(), 0);
    }
}

/// RIOT #16844, Contiki #1703: the transmit counter restarted at boot.
#[test]
fn nothing_is_sent_before_its_counter_is_reserved() {
    let mut session =
        FrameSecurity::<4>::new(ALICE, Protection::EncMic64, key(1), Counter::resume(5));
    let mut buffer = [0; FRAME_MAX];
    let refused = session.seal(&header(FrameType::Data), b"1", &mut buffer);
    assert_eq!(refused, Err(SealError::Counter(CounterError::NotReserved)));
    let mut last = FrameSecurity::<4>::new(
        ALICE,
        Protection::EncMic64,
        key(1),
        Counter::resume(u32::MAX),
    );
    let refused = last.seal(&header(FrameType::Data), b"1", &mut buffer);
    assert_eq!(refused, Err(SealError::Counter(CounterError::Exhausted)));
}

#[test]
fn weaker_frames_are_refused() {
    let (mut alice, mut bob) = pair();
    let good = sealed(&mut alice, b"a longer payload");
    // The security control field is behind control, sequence, PAN and two short addresses.
    let security_control = 9;
    assert_eq!(good[security_control], 0b0_1110);
    for (control, refused) in [
        (0b0_1000, Refused::Level), // none
        (0b0_1010, Refused::Level), // integrity only
        (0b0_1100, Refused::Level), // encryption without integrity
        (0b0_1101, Refused::Level), // the other level
        (0b0_1111, Refused::Level),
        (0b0_0110, Refused::Malformed(Malformed::Unsupported)), // implicit key
    ] {
        let mut weak = good.clone();
        weak[security_control] = control;
        assert_eq!(opened(&mut bob, &mut weak), Err(refused), "{control:#07b}");
    }
    // Not secured at all.
    let mut plain = [0; FRAME_MAX];
    let len = header(FrameType::Data).emit(&mut plain).unwrap();
    assert_eq!(
        opened(&mut bob, &mut plain[..len + 16]),
        Err(Refused::Unsecured)
    );
    assert!(opened(&mut bob, &mut good.clone()).is_ok());
}

/// It is never handed out; a node that used it could never be heard again.
#[test]
fn the_last_counter_is_refused() {
    let (mut alice, mut bob) = pair();
    let mut frame = sealed(&mut alice, b"x");
    // Behind control, sequence, PAN, two short addresses and the security control.
    frame[10..14].fill(0xFF);
    assert_eq!(opened(&mut bob, &mut frame), Err(Refused::Replayed));
}

/// Contiki-NG #3171: the length ran below zero before the check of the integrity code.
#[test]
fn frames_shorter_than_their_code_are_refused() {
    let (mut alice, mut bob) = pair();
    let before = bob.peers.clone();
    for (frame_type, payload) in [
        (FrameType::Data, &b""[..]),
        (FrameType::Command, &b"\x06"[..]),
    ] {
        let mut buffer = [0; FRAME_MAX];
        let len = alice
            .seal(&header(frame_type), payload, &mut buffer)
            .unwrap()
            .len;
        for cut in 0..len {
            let mut copy = buffer;
            assert!(bob.open(NOW, &mut copy[..cut]).is_err(), "{cut} of {len}");
        }
    }
    assert_eq!(bob.peers, before);
    // A command needs its identifier even when nothing else is left.
    let mut buffer = [0; FRAME_MAX];
    let refused = alice.seal(&header(FrameType::Command), b"", &mut buffer);
    assert!(refused.is_err());
}

#[test]
fn a_node_does_not_hear_itself() {
    let (mut alice, _) = pair();
    alice.peers.enter(ALICE, ALICE_SHORT, 0, NOW).unwrap();
    let mut frame = sealed(&mut alice, b"echo");
    assert_eq!(opened(&mut alice, &mut frame), Err(Refused::OwnAddress));
}

#[test]
fn keys_change_within_a_window() {
    let window = Duration::from_secs(10);
    let (mut alice, mut bob) = pair();
    let old = [(); 3].map(|()| sealed(&mut alice, b"old"));
    alice.keys.install(key(2)).unwrap();
    alice.keys.activate(2, NOW, window).unwrap();
    let new = [(); 2].map(|()| sealed(&mut alice, b"new"));
    assert_eq!(opened(&mut bob, &mut new[0].clone()), Err(Refused::Key));
    bob.keys.install(key(2)).unwrap();
    assert!(opened(&mut bob, &mut old[0].clone()).is_ok());
    bob.keys.activate(2, NOW, window).unwrap();
    let before = NOW + (window - Duration::from_micros(1));
    assert!(bob.open(before, &mut old[1].clone()).is_ok());
    assert_eq!(
        bob.open(NOW + window, &mut old[2].clone()),
        Err(Refused::Key)
    );
    assert!(bob.open(NOW + window, &mut new[0].clone()).is_ok());
    // The counter went on, so the nonces of both keys are different ones anyway.
    assert_eq!(bob.peers.by_extended(ALICE).unwrap().counter, 103);
    let reused = Key::new(2, [9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 1, 2, 3, 4, 5, 6]).unwrap();
    assert_eq!(bob.keys.install(reused), Err(RotationError::SameIndex));
    assert_eq!(
        bob.keys.activate(3, NOW, window),
        Err(RotationError::NotInstalled)
    );
}

#[test]
fn a_full_table_says_so_and_gives_way_to_nobody_active() {
    let mut peers = Peers::<2>::default();
    let eui = |n| Eui64([n; 8]);
    let minute = NOW + EVICT_AFTER;
    peers.enter(eui(1), ShortAddress(1), 10, NOW).unwrap();
    peers
        .enter(eui(2), ShortAddress(2), 20, NOW + Duration::from_secs(1))
        .unwrap();
    assert_eq!(
        peers.enter(eui(3), ShortAddress(3), 30, Instant(minute.0 - 1)),
        Err(TableFull)
    );
    peers.enter(eui(3), ShortAddress(2), 30, minute).unwrap();
    assert_eq!(peers.by_extended(eui(1)), None);
    // The address moved with its new owner.
    assert_eq!(peers.by_short(ShortAddress(2)).unwrap().extended, eui(3));
    assert_eq!(
        peers.by_extended(eui(2)).unwrap().short,
        ShortAddress::UNASSIGNED
    );
    // A counter never goes back.
    peers.enter(eui(3), ShortAddress(2), 5, minute).unwrap();
    assert_eq!(peers.by_extended(eui(3)).unwrap().counter, 30);
}

/// Number of forged frames that a test tries.
pub(crate) fn storm() -> u64 {
    env::var("ZIGBEE_LINK_FORGERIES").map_or(20_000, |count| count.parse().unwrap())
}

/// 20,000 frames, or as many as `ZIGBEE_LINK_FORGERIES` says, of all kinds an outsider can make
/// from what it heard: none is accepted, none changes anything.
#[test]
fn forgeries_change_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(0xF0E);
    let (mut alice, mut bob) = pair();
    // Half of what the attacker heard has been delivered, half has not.
    let heard: Vec<Vec<u8>> = (0..64)
        .map(|len| {
            let frame = sealed(&mut alice, &[0xA5; 64][..len]);
            if len < 32 {
                assert!(opened(&mut bob, &mut frame.clone()).is_ok());
            }
            frame
        })
        .collect();
    let peers = bob.peers.clone();
    for _ in 0..storm() {
        let mut frame = heard[rng.random_range(0..64)].clone();
        match rng.random_range(0..7) {
            0 => frame = heard[rng.random_range(0..32)].clone(),
            1 => frame.truncate(rng.random_range(0..frame.len())),
            2 => {
                for _ in 0..rng.random_range(1..4) {
                    let bit = rng.random_range(0..frame.len() * 8);
                    frame[bit / 8] ^= 1 << (bit % 8);
                }
                if heard.contains(&frame) {
                    continue;
                }
            }
            3 => {
                frame.resize(rng.random_range(0..=FRAME_MAX), 0);
                rng.fill_bytes(&mut frame);
            }
            // A true header before noise.
            4 => rng.fill_bytes(&mut frame[15..]),
            // The head of one and the tail of another.
            5 => {
                let other = &heard[rng.random_range(0..64)];
                let tail = rng.random_range(1..other.len().min(frame.len()));
                let spliced = [&frame[..frame.len() - tail], &other[other.len() - tail..]].concat();
                if heard.contains(&spliced) {
                    continue;
                }
                frame = spliced;
            }
            // A later counter.
            _ => {
                let later = rng.random_range(200..u32::MAX).to_le_bytes();
                frame[10..14].copy_from_slice(&later);
            }
        }
        let result = opened(&mut bob, &mut frame);
        assert!(result.is_err(), "{result:?}");
        assert_eq!(bob.peers, peers);
    }
    assert!(opened(&mut bob, &mut heard[63].clone()).is_ok());
}
