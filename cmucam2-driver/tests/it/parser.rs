//! The parser: golden bytes, round trips, resynchronisation.

use crate::{dialogue::bytes, soak};

use cmucam2_driver::{
    Packet,
    colour::Colour,
    command::StatisticsMask,
    geometry::Size,
    packet::{FirmwareVersion, Histogram, Statistics, Tracking},
    parser::{Expectation, ImageKind, Parser, RowState, Token},
    servo::ServoMask,
};
use proptest::prelude::*;

fn events(parser: &mut Parser, bytes: &[u8]) -> Vec<Token> {
    bytes.iter().filter_map(|&byte| parser.push(byte)).collect()
}

fn parse(bytes: &[u8]) -> Vec<Token> {
    events(&mut Parser::default(), bytes)
}

/// A token as the file tells it: of a row `.` is its end, and `!` is that of a damaged one.
fn told(token: Token) -> String {
    let whole = |intact| if intact { "" } else { "!" };
    let line = |bytes: &[u8]| bytes.trim_ascii_end().escape_ascii().to_string();
    match token {
        Token::Ack => "ACK".to_owned(),
        Token::Nck => "NCK".to_owned(),
        Token::Prompt => ":".to_owned(),
        Token::Banner(version) => line(version.banner().as_bytes()),
        Token::Packet(packet) => line(packet.line().as_bytes()),
        Token::Header(header) => {
            let (width, height) = (header.width, header.height);
            format!("[{:?} {width}x{height} {}]", header.kind, header.row_bytes)
        }
        Token::Pixel(byte, state) => {
            let end = match state {
                RowState::Open => "",
                RowState::Full => ".",
                RowState::Damaged => "!",
            };
            format!("{}{end}", byte.escape_ascii())
        }
        Token::RowCut(bytes) => format!("cut({bytes})"),
        Token::RowAgain => "again".to_owned(),
        Token::ImageEnd { rows, intact } => format!("end({rows}){}", whole(intact)),
        other => panic!("{other:?}"),
    }
}

fn expectation(words: &str) -> Expectation {
    let mut expectation = Expectation::default();
    for word in words.split(' ') {
        match word {
            "text" => {}
            "strict" => expectation.strict = true,
            "raw" => expectation.raw = true,
            "frame1" => expectation.image = Some(ImageKind::Frame(1)),
            "frame3" => expectation.image = Some(ImageKind::Frame(3)),
            "bitmap" => expectation.image = Some(ImageKind::Bitmap),
            "rows" => expectation.image = Some(ImageKind::Rows),
            "means" => expectation.image = Some(ImageKind::Means(3)),
            "deviations" => expectation.image = Some(ImageKind::Means(6)),
            size => {
                let (width, height) = size.split_once('x').unwrap();
                expectation.frame = Size::new(width.parse().unwrap(), height.parse().unwrap());
            }
        }
    }
    expectation
}

/// All that was dropped, as the file tells it.
fn dropped(parser: &Parser) -> String {
    let dropped = parser.dropped();
    let reasons = [
        ("noise", dropped.noise),
        ("malformed", dropped.malformed),
        ("cut", dropped.cut),
        ("fields", dropped.fields),
        ("impossible", dropped.impossible),
        ("images", dropped.images),
    ];
    let reasons = reasons.iter().filter(|(_, count)| *count > 0);
    let reasons: String = reasons
        .map(|(name, count)| format!("{name} {count} "))
        .collect();
    format!("{reasons}bytes {}", dropped.bytes)
}

#[test]
fn bytes_are_these_tokens() {
    let file = include_str!("dialogues/parser.txt").lines();
    for line in file.filter(|line| !line.is_empty() && !line.starts_with('#')) {
        let (expected, rest) = line.split_once(": ").unwrap();
        let (sent, tokens) = rest.rsplit_once(" =>").unwrap();
        let (tokens, count) = match tokens.split_once(" ; ") {
            Some((tokens, count)) => (tokens, Some(count)),
            None => (tokens, None),
        };
        let mut parser = Parser::new(expectation(expected));
        let mut got = Vec::new();
        for part in sent.split_inclusive(['~', '^']) {
            let end = part.trim_end_matches(['~', '^']);
            got.extend(events(&mut parser, &bytes(end)));
            match part.strip_prefix(end) {
                Some("~") => parser.gap(),
                Some("^") => parser.expect(Expectation::default()),
                _ => {}
            }
        }
        let got: Vec<String> = got.into_iter().map(told).collect();
        assert_eq!(got.join(" "), tokens.trim(), "{line}");
        let dropped = dropped(&parser);
        let is_told = |count: &str| {
            dropped
                .strip_prefix(count)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with(" bytes"))
        };
        assert!(count.is_none_or(is_told), "{line}: {dropped}");
    }
}

#[test]
fn golden_packets() {
    let packet = Packet::Tracking(Tracking::new([44, 60, 30, 50, 58, 70, 25, 255]));
    assert_eq!(packet.line().as_bytes(), b"T 44 60 30 50 58 70 25 255\r");
    assert_eq!(
        packet.raw().as_bytes(),
        [0xFF, b'T', 44, 60, 30, 50, 58, 70, 25, 254]
    );
    let Packet::Tracking(tracking) = packet else {
        unreachable!()
    };
    let masked = Packet::Tracking(tracking.masked(3, None, None));
    assert_eq!(masked.line().as_bytes(), b"T 44 60\r");
    let panned = Packet::Tracking(tracking.masked(3, Some(128), None));
    assert_eq!(panned.line().as_bytes(), b"T 44 60 128\r");
    let (mean, deviation) = (Colour::new(200, 100, 30), Colour::new(12, 10, 8));
    let means = Packet::Statistics(Statistics::new(mean, deviation));
    assert_eq!(means.line().as_bytes(), b"S 200 100 30 12 10 8\r");
    let all = Packet::Histogram(Histogram::new(&[255; 28]).unwrap());
    assert_eq!(all.line().as_bytes().len(), 114);
    assert!(Histogram::new(&[0; 29]).is_err());
    assert!(Histogram::new(&[]).is_err());
}

/// Every packet that the camera's formulas can produce is consistent.
#[test]
fn true_packets_are_consistent() {
    for width in 1..=30_u32 {
        for height in 1..=12_u32 {
            let area = width * height;
            for count in 1..=area {
                let pixels = ((count + 4) / 8).min(255) as u8;
                let confidence = (256 * count / area).min(255) as u8;
                let (x2, y2) = (10 + width as u8 - 1, 20 + height as u8 - 1);
                let packet = Tracking::new([10, 20, 10, 20, x2, y2, pixels, confidence]);
                assert!(packet.is_consistent(), "{packet:?} of {count}");
            }
        }
    }
    assert!(Tracking::LOST.is_consistent());
    // A target of one pixel: a pixel count of zero, but not lost.
    let dot = Tracking::new([10, 20, 10, 20, 10, 20, 0, 255]);
    assert!(dot.is_consistent() && !dot.is_lost());
}

#[test]
fn random_streams_leave_no_trace() {
    soak::random_streams(100_000, 1);
}

#[test]
fn damaged_streams_deliver_nothing_that_can_be_told_to_be_wrong() {
    let (delivered, undetectable) = soak::damaged_streams(10_000, 1, false);
    assert!(delivered > 75_000, "{delivered}");
    let (strictly_delivered, strictly_undetectable) = soak::damaged_streams(10_000, 1, true);
    assert!(strictly_undetectable < undetectable);
    assert_eq!(
        strictly_delivered - strictly_undetectable,
        delivered - undetectable
    );
}

fn any_tracking() -> impl Strategy<Value = (Tracking, u8, ServoMask)> {
    (any::<[u8; 8]>(), any::<u8>(), any::<(bool, bool, u8, u8)>()).prop_map(
        |(mut values, mask, (pan, tilt, at_pan, at_tilt))| {
            // In order and inside the largest frame.
            let mut x = [values[0], values[2], values[4]].map(|value| value % 177);
            let mut y = [values[1], values[3], values[5]];
            x.sort_unstable();
            y.sort_unstable();
            [values[2], values[0], values[4]] = x;
            [values[3], values[1], values[5]] = y;
            let servos = ServoMask::from_switches(false, false, pan, tilt);
            (
                Tracking::new(values).masked(mask, pan.then_some(at_pan), tilt.then_some(at_tilt)),
                mask,
                servos,
            )
        },
    )
}

proptest! {
    #[test]
    fn tracking_packets_come_back((tracking, mask, servos) in any_tracking()) {
        let packet = Packet::Tracking(tracking);
        let mut parser = Parser::new(Expectation { tracking: mask, servos, ..Expectation::default() });
        prop_assert_eq!(
            events(&mut parser, packet.line().as_bytes()),
            [Token::Packet(packet)]
        );
    }

    #[test]
    fn raw_packets_come_back(values in prop::array::uniform6(0_u8..=254)) {
        let mask = StatisticsMask::new(values[0] % 64).unwrap();
        let [a, b, c, d, e, f] = values;
        let mean = Colour::new(a, b, c);
        let deviation = Colour::new(d, e, f);
        let packet = Packet::Statistics(Statistics::new(mean, deviation).masked(mask));
        let mut parser = Parser::new(Expectation {
            statistics: mask,
            raw: true,
            ..Expectation::default()
        });
        for line in [packet.raw(), packet.line()] {
            prop_assert_eq!(events(&mut parser, line.as_bytes()), [Token::Packet(packet)]);
        }
    }

    #[test]
    fn histograms_come_back(bins in prop::collection::vec(any::<u8>(), 1..=28)) {
        let packet = Packet::Histogram(Histogram::new(&bins).unwrap());
        let mut parser = Parser::new(Expectation { bins: None, ..Expectation::default() });
        prop_assert_eq!(
            events(&mut parser, packet.line().as_bytes()),
            [Token::Packet(packet)]
        );
    }

    #[test]
    fn banners_come_back(major in 0_u8..=99, minor in 0_u8..=99, module in prop::option::of(0_u8..=9)) {
        let version = FirmwareVersion { major, minor, module };
        let mut bytes = version.banner().as_bytes().to_vec();
        bytes.push(b'\r');
        prop_assert_eq!(parse(&bytes), [Token::Banner(version)]);
    }
}
