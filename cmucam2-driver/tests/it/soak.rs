//! The two loads that the parser must stand, for any number of streams.

use cmucam2_driver::{
    Packet,
    geometry::Size,
    parser::{Expectation, ImageKind, Parser},
};

use super::{
    random::{Random, garbage},
    stream::{damage, packets, read, tracking},
};

const FRAME: Size = Size::new(88, 143);

fn text() -> Expectation {
    Expectation {
        frame: FRAME,
        ..Expectation::default()
    }
}

/// Random bytes in every mode of the parser: no panic, and the packets that follow are delivered
/// from the first one on. Binary images end with the silence that follows them.
pub(crate) fn random_streams(count: u64, seed: u64) -> u64 {
    let mut random = Random::new(seed);
    let mut bytes = Vec::new();
    let mut total = 0;
    let images = [
        ImageKind::Frame(1),
        ImageKind::Frame(3),
        ImageKind::Bitmap,
        ImageKind::Rows,
        ImageKind::Means(3),
        ImageKind::Means(6),
    ];
    for round in 0..count {
        let mut expectation = text();
        match round % 4 {
            0 | 1 => {}
            2 => expectation.raw = true,
            _ => {
                expectation.image = Some(images[random.below(6) as usize]);
                expectation.raw = random.chance(30);
                expectation.values = random.below(7) as u8;
            }
        }
        let mut parser = Parser::new(expectation);
        bytes.clear();
        let length = random.below(120) as usize;
        garbage(&mut random, length, &mut bytes);
        for &byte in &bytes {
            let _ = parser.push(byte);
        }
        if round % 4 == 3 {
            parser.gap();
            parser.expect(text());
        }
        for _ in 0..2 {
            let packet = tracking(&mut random);
            let line = if round % 4 == 2 {
                // Raw output has no 255.
                if packet.confidence() == Some(255) || packet.pixels() == Some(255) {
                    continue;
                }
                Packet::Tracking(packet).raw()
            } else {
                Packet::Tracking(packet).line()
            };
            let got = packets(&mut parser, line.as_bytes());
            assert_eq!(
                got,
                [packet],
                "round {round} of seed {seed} after {bytes:?}"
            );
        }
        total += bytes.len() as u64;
    }
    total
}

/// Every fifth line of a stream of tracking packets is damaged. The parser delivers exactly what an
/// independent reader of the whole text finds, and the undamaged lines after an undamaged one are among it.
/// Returns the number of delivered packets, and the number of those that differ from the camera's own,
/// because their damage cannot be detected.
pub(crate) fn damaged_streams(count: u64, seed: u64, strict: bool) -> (u64, u64) {
    let mut random = Random::new(seed);
    let mut delivered = 0;
    let mut undetectable = 0;
    for round in 0..count {
        let mut parser = Parser::new(Expectation { strict, ..text() });
        let mut all = Vec::new();
        let mut sent = Vec::new();
        let mut certain = Vec::new();
        let mut clean = true;
        for _ in 0..10 {
            let packet = tracking(&mut random);
            let mut line = Packet::Tracking(packet).line().as_bytes().to_vec();
            sent.push(packet);
            let damaged = random.chance(20);
            if damaged {
                damage(&mut random, &mut line);
            } else if clean {
                certain.push(packet);
            }
            clean = !damaged;
            all.extend(line);
        }
        let got = packets(&mut parser, &all);
        let mut expected = read(&all);
        expected.retain(|packet| !strict || packet.is_consistent());
        assert_eq!(got, expected, "round {round} of seed {seed}: {all:?}");
        let mut rest = got.iter();
        for packet in certain {
            assert!(
                rest.any(|other| *other == packet),
                "round {round} of seed {seed}: {packet:?} is missing of {all:?}"
            );
        }
        delivered += got.len() as u64;
        undetectable += got.iter().filter(|packet| !sent.contains(packet)).count() as u64;
    }
    (delivered, undetectable)
}
