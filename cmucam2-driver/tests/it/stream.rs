//! Streams of well-formed lines, damaged streams, and an independent reading of both.

use super::random::Random;
use cmucam2_driver::{
    Packet,
    packet::Tracking,
    parser::{Parser, Token},
};

/// A packet that a camera of 88 x 143 pixels may send, computed from a blob as the camera does.
pub(crate) fn tracking(random: &mut Random) -> Tracking {
    if random.chance(10) {
        return Tracking::LOST;
    }
    let x1 = 1 + random.below(87);
    let x2 = x1 + random.below(89 - x1);
    let y1 = 1 + random.below(142);
    let y2 = y1 + random.below(144 - y1);
    let area = (x2 - x1 + 1) * (y2 - y1 + 1);
    let count = 1 + random.below(area);
    Tracking::new(
        [
            x1 + random.below(x2 - x1 + 1),
            y1 + random.below(y2 - y1 + 1),
            x1,
            y1,
            x2,
            y2,
            ((count + 4) / 8).min(255),
            (256 * count / area).min(255),
        ]
        .map(|value| value as u8),
    )
}

/// Damages a line as real lines are damaged: changed, lost, doubled, inserted and cut bytes.
pub(crate) fn damage(random: &mut Random, line: &mut Vec<u8>) {
    for _ in 0..=random.below(2) {
        if line.is_empty() {
            return;
        }
        let at = random.below(line.len() as u64) as usize;
        match random.below(6) {
            0 => line[at] ^= 1 << random.below(8),
            1 => line[at] = random.next() as u8,
            2 => {
                line.remove(at);
            }
            3 => line.insert(at, line[at]),
            4 => line.insert(at, random.next() as u8),
            _ => line.truncate(at),
        }
    }
}

/// Packets of a text-mode stream, read with the whole text at hand: the last `T` of a line, and its rest up
/// to the carriage return. Knows nothing of how the parser works.
pub(crate) fn read(bytes: &[u8]) -> Vec<Tracking> {
    bytes
        .split_inclusive(|&byte| byte == b'\r' || byte == b':')
        .filter_map(|line| line.strip_suffix(b"\r"))
        .filter_map(|line| {
            let at = line.iter().rposition(|&byte| byte == b'T')?;
            let text = std::str::from_utf8(&line[at + 1..]).ok()?;
            let text = text.strip_suffix(' ').unwrap_or(text);
            let numbers: Vec<u8> = text
                .split(' ')
                .skip(1)
                .map(|word| {
                    let value: u8 = word.parse().ok()?;
                    (value.to_string() == word).then_some(value)
                })
                .collect::<Option<_>>()?;
            let values: [u8; 8] = numbers.try_into().ok()?;
            (text.starts_with(' ') && possible(values)).then(|| Tracking::new(values))
        })
        .collect()
}

/// Checks of a colour-tracking packet of 88 x 143 pixels that the protocol allows.
pub(crate) fn possible([mx, my, x1, y1, x2, y2, ..]: [u8; 8]) -> bool {
    x1 <= mx && mx <= x2 && x2 <= 88 && y1 <= my && my <= y2 && y2 <= 143
}

pub(crate) fn packets(parser: &mut Parser, bytes: &[u8]) -> Vec<Tracking> {
    bytes
        .iter()
        .filter_map(|&byte| match parser.push(byte)? {
            Token::Packet(Packet::Tracking(tracking)) => Some(tracking),
            _ => None,
        })
        .collect()
}
