//! Any bytes in any mode: no panic, every packet is in order and inside the frame and comes back
//! when it is sent again, and after a silence the next packet is understood.

use arbitrary::{Arbitrary, Unstructured};
use cmucam2_driver::{
    Packet,
    command::StatisticsMask,
    geometry::Size,
    packet::Tracking,
    parser::{Expectation, ImageKind, Parser, Token},
    servo::ServoMask,
};

/// Tries one input.
pub(crate) fn run(input: &[u8]) {
    let Ok(input) = <(u8, u8, u8, u8, &[u8])>::arbitrary_take_rest(Unstructured::new(input)) else {
        return;
    };
    let (mask, servos, image, values, bytes) = input;
    let expectation = Expectation {
        tracking: mask,
        servos: ServoMask::new(servos & 15).unwrap(),
        statistics: StatisticsMask::new(mask & 63).unwrap(),
        bins: (servos & 16 == 0).then_some(28),
        frame: Size::new(88, 143),
        image: match image % 7 {
            0 => None,
            1 => Some(ImageKind::Frame(1)),
            2 => Some(ImageKind::Frame(3)),
            3 => Some(ImageKind::Bitmap),
            4 => Some(ImageKind::Rows),
            5 => Some(ImageKind::Means(3)),
            _ => Some(ImageKind::Means(6)),
        },
        raw: servos & 32 != 0,
        values: values % 7,
        strict: servos & 64 != 0,
    };
    let mut parser = Parser::new(expectation);
    for &byte in bytes {
        if let Some(Token::Packet(packet)) = parser.push(byte) {
            if let (Packet::Tracking(tracking), 0xFF) = (packet, mask)
                && let Some(target) = tracking.bounding_box()
            {
                assert!(target.x1 <= target.x2 && target.x2 <= 88);
                assert!(target.y1 <= target.y2 && target.y2 <= 143);
            }
            let mut again = Parser::new(expectation);
            let events = packet.line();
            let mut events = events
                .as_bytes()
                .iter()
                .filter_map(|&byte| again.push(byte));
            assert_eq!(events.next(), Some(Token::Packet(packet)));
        }
    }
    parser.gap();
    parser.expect(Expectation::default());
    let lost = Packet::Tracking(Tracking::LOST);
    let line = lost.line();
    let mut events = line.as_bytes().iter().filter_map(|&byte| parser.push(byte));
    assert_eq!(events.next(), Some(Token::Packet(lost)));
}
