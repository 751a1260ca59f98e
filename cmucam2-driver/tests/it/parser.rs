//! The parser: golden bytes, round trips, resynchronisation.

use crate::soak;

use cmucam2_driver::{
    Packet,
    colour::Colour,
    command::{StatisticsLines, StatisticsMask, TrackingLines},
    geometry::Size,
    packet::{FirmwareVersion, Histogram, Statistics, Tracking, TrackingFields},
    parser::{Expectation, ImageExpectation, ImageHeader, ImageKind, Parser, RowState, Token},
    servo::ServoMask,
};
use proptest::prelude::*;

const T: &[u8] = b"T 44 60 30 50 58 70 25 90\r";

fn here() -> Token {
    Token::Packet(Packet::Tracking(Tracking::new([
        44, 60, 30, 50, 58, 70, 25, 90,
    ])))
}

fn events(parser: &mut Parser, bytes: &[u8]) -> Vec<Token> {
    bytes.iter().filter_map(|&byte| parser.push(byte)).collect()
}

fn parse(bytes: &[u8]) -> Vec<Token> {
    events(&mut Parser::default(), bytes)
}

#[test]
fn golden_lines() {
    assert_eq!(parse(b"ACK\r:"), [Token::Ack, Token::Prompt]);
    assert_eq!(parse(b"NCK\r:"), [Token::Nck, Token::Prompt]);
    assert_eq!(parse(T), [here()]);
    assert_eq!(
        parse(b"S 200 100 30 12 10 8\r"),
        [Token::Packet(Packet::Statistics(Statistics::new(
            Colour::new(200, 100, 30),
            Colour::new(12, 10, 8),
        )))]
    );
    let lost = parse(b"T 0 0 0 0 0 0 0 0\r");
    assert_eq!(lost, [Token::Packet(Packet::Tracking(Tracking::LOST))]);
    let version = FirmwareVersion {
        major: 1,
        minor: 0,
        module: Some(6),
    };
    assert_eq!(
        parse(b"\r\rCMUcam2 v1.00 c6\r:"),
        [Token::Banner(version), Token::Prompt]
    );
    assert_eq!(version.banner().as_bytes(), b"CMUcam2 v1.00 c6");
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
    let all = Packet::Histogram(Histogram::new(&[255; 28]).unwrap());
    assert_eq!(all.line().as_bytes().len(), 114);
    assert!(Histogram::new(&[0; 29]).is_err());
    assert!(Histogram::new(&[]).is_err());
}

/// Each is wrong in one way that the protocol lets one detect.
#[test]
fn wrong_packets_are_dropped_and_counted() {
    let cases: [(&[u8], [u32; 5]); 16] = [
        // noise, malformed, cut, fields, impossible
        (b"T 44 60 30 50 58 70 25\r", [0, 0, 0, 1, 0]),
        (b"T 44 60 30 50 58 70 25 90 1\r", [0, 0, 0, 1, 0]),
        (b"T\r", [0, 0, 0, 1, 0]),
        (b"T44 60 30 50 58 70 25 90\r", [0, 1, 0, 0, 0]),
        (b"T 44  60 30 50 58 70 25 90\r", [0, 1, 0, 0, 0]),
        (b"T 44 60 30 50 58 70 25 90  \r", [0, 1, 0, 0, 0]),
        (b"T 44 60 30 50 58 70 25 9O\r", [0, 1, 0, 0, 0]),
        (b"T 044 60 30 50 58 70 25 90\r", [0, 1, 0, 0, 0]),
        (b"T 44 60 30 50 58 70 25 256\r", [0, 1, 0, 0, 0]),
        (b"T 4\xB4 60 30 50 58 70 25 90\r", [0, 1, 0, 0, 0]),
        (b"T 44 60 30 :", [0, 0, 1, 0, 0]),
        (b"T 44 60 58 50 30 70 25 90\r", [0, 0, 0, 0, 1]),
        (b"T 44 90 30 50 58 70 25 90\r", [0, 0, 0, 0, 1]),
        (b"T 20 60 30 50 58 70 25 90\r", [0, 0, 0, 0, 1]),
        (b"T 44 60 30 50 177 70 25 90\r", [0, 0, 0, 0, 1]),
        (b"xyz\r", [1, 0, 0, 0, 0]),
    ];
    for (bytes, [noise, malformed, cut, fields, impossible]) in cases {
        let mut parser = Parser::default();
        let got = events(&mut parser, bytes);
        let shown = String::from_utf8_lossy(bytes);
        assert!(
            got.iter().all(|event| *event == Token::Prompt),
            "{shown}: {got:?}"
        );
        let dropped = parser.dropped();
        assert_eq!(
            [
                dropped.noise,
                dropped.malformed,
                dropped.cut,
                dropped.fields,
                dropped.impossible
            ],
            [noise, malformed, cut, fields, impossible],
            "{shown}"
        );
        let prompts = bytes.iter().filter(|byte| **byte == b':').count();
        assert_eq!(dropped.bytes as usize, bytes.len() - prompts, "{shown}");
        assert_eq!(events(&mut parser, T), [here()], "{shown}");
    }
}

#[test]
fn a_line_begins_wherever_its_letter_stands() {
    for before in [
        &b"T 44 6"[..],
        b"AC",
        b"CMUcam2 v1.",
        b"\xFF\x00\x80",
        b"12 13 ",
        b"S 1 2",
    ] {
        let bytes = [before, T].concat();
        assert_eq!(parse(&bytes), [here()], "{before:?}");
    }
}

#[test]
fn the_frame_limits_coordinates() {
    let at = |x: u8| format!("T {x} 60 {x} 50 {x} 70 25 90\r").into_bytes();
    for (frame, most) in [(88, 88), (160, 160), (8, 8)] {
        let expectation = Expectation {
            frame: Size::new(frame, 143),
            ..Expectation::default()
        };
        let mut parser = Parser::new(expectation);
        assert_eq!(events(&mut parser, &at(most)).len(), 1);
        assert_eq!(events(&mut parser, &at(most + 1)).len(), 0);
    }
}

#[test]
fn contradictions_are_dropped_only_when_asked_for() {
    // 600 pixels (25 * 8 = 200 at most 204) cannot have confidence 250 in a box of 29 x 21.
    let contradiction = b"T 44 60 30 50 58 70 25 250\r";
    assert_eq!(parse(contradiction).len(), 1);
    let mut strict = Parser::new(Expectation {
        strict: true,
        ..Expectation::default()
    });
    assert_eq!(events(&mut strict, contradiction), []);
    assert_eq!(strict.dropped().impossible, 1);
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
fn frames_with_every_separator_variant() {
    let header = ImageHeader {
        kind: ImageKind::Frame(1),
        width: 3,
        height: 2,
        row_bytes: 3,
    };
    let pixel = |byte, state| Token::Pixel(byte, state);
    let expected = [
        Token::Header(header),
        pixel(16, RowState::Open),
        pixel(17, RowState::Open),
        pixel(18, RowState::Full),
        pixel(19, RowState::Open),
        pixel(20, RowState::Open),
        pixel(240, RowState::Full),
        Token::ImageEnd {
            rows: 2,
            intact: true,
        },
        Token::Prompt,
    ];
    let mark = [2];
    let (no, yes) = (&mark[..0], &mark[..]);
    for marks in [
        [no, yes, no],
        [no, yes, yes],
        [yes, yes, no],
        [yes, yes, yes],
        [no, no, no],
    ] {
        let [first, between, last] = marks;
        let bytes = [
            &[1, 3, 2],
            first,
            &[16, 17, 18],
            between,
            &[19, 20, 240],
            last,
            b"\x03:",
        ]
        .concat();
        let mut parser = Parser::new(Expectation {
            image: ImageExpectation::Frame(1),
            ..Expectation::default()
        });
        assert_eq!(events(&mut parser, &bytes), expected, "{marks:?}");
        assert_eq!(parser.dropped().bytes, 0);
    }
}

#[test]
fn damaged_frames_are_told_row_by_row() {
    let frame = |rows: &[u8]| {
        let mut parser = Parser::new(Expectation {
            image: ImageExpectation::Frame(1),
            ..Expectation::default()
        });
        let all = events(&mut parser, &[&[1, 3, 2], rows].concat());
        all[1..].to_vec()
    };
    // A lost pixel: that row is cut, the next one is in its place.
    let got = frame(&[2, 16, 18, 2, 19, 20, 21, 3]);
    assert!(got.contains(&Token::RowCut(2)));
    assert!(got.contains(&Token::Pixel(21, RowState::Full)));
    let damaged = Token::ImageEnd {
        rows: 2,
        intact: false,
    };
    assert_eq!(got.last(), Some(&damaged));
    // A doubled pixel.
    let got = frame(&[2, 16, 17, 18, 18, 2, 19, 20, 21, 3]);
    assert_eq!(got.last(), Some(&damaged));
    assert_eq!(got.len(), 7);
    // In the first row, where a frame without marks looks alike: the next row is in its place all the same.
    let got = frame(&[16, 17, 18, 18, 2, 19, 20, 21, 2, 3]);
    assert_eq!(got[4], Token::RowAgain);
    assert_eq!(got[7], Token::Pixel(21, RowState::Full));
    assert_eq!(got.last(), Some(&damaged));
    // Without marks a pixel that cannot be is damaged, even if it looks like one.
    let got = frame(&[16, 17, 18, 19, 20, 2, 3]);
    assert_eq!(got[5], Token::Pixel(2, RowState::Damaged));
    assert_eq!(got.last(), Some(&damaged));
    // A level that no pixel has.
    let got = frame(&[2, 16, 255, 18, 2, 19, 20, 21, 3]);
    assert_eq!(got[2], Token::Pixel(18, RowState::Damaged));
    assert_eq!(got.last(), Some(&damaged));
    // The end is missing: whatever comes next ends the frame.
    let got = frame(b"\x02\x10\x11\x12\x02\x10\x11\x12T 44 60 30 50 58 70 25 90\r");
    assert_eq!(got[6..], [damaged, here()]);
    // A restart within the frame.
    let got = frame(b"\x02\x10CMUcam2 v1.01 c6\r");
    assert!(matches!(got.last(), Some(Token::Banner(_))));
}

#[test]
fn line_modes() {
    let lines = |image, bytes: &[u8]| {
        let mut parser = Parser::new(Expectation {
            image,
            ..Expectation::default()
        });
        events(&mut parser, &[bytes, T].concat())
    };
    let bitmap = ImageExpectation::Tracking(TrackingLines::Bitmap);
    let got = lines(
        bitmap,
        &[
            0xAA,
            10,
            2,
            0b1111_0000,
            0b1100_0000,
            0xAA,
            0xAA,
            0xAA,
            0xAA,
        ],
    );
    assert_eq!(
        got,
        [
            Token::Header(ImageHeader {
                kind: ImageKind::Bitmap,
                width: 10,
                height: 2,
                row_bytes: 2
            }),
            Token::Pixel(0b1111_0000, RowState::Open),
            Token::Pixel(0b1100_0000, RowState::Full),
            Token::Pixel(0xAA, RowState::Open),
            Token::Pixel(0xAA, RowState::Full),
            Token::ImageEnd {
                rows: 2,
                intact: true
            },
            here()
        ]
    );
    // Data may look like marks: rows are counted.
    let rows = ImageExpectation::Tracking(TrackingLines::Rows);
    let got = lines(rows, &[0xFE, 1, 0xFD, 0xFE, 0xFD, 0xFD, 0xFD, 0xFD]);
    assert_eq!(got.len(), 1 + 5 + 1 + 1);
    assert_eq!(
        got[6],
        Token::ImageEnd {
            rows: 1,
            intact: true
        }
    );
    assert_eq!(got[7], here());
    for (mode, width) in [
        (StatisticsLines::Means, 3),
        (StatisticsLines::MeansAndDeviations, 6),
    ] {
        let bytes = [&[0xFE][..], &[100; 12], &[0xFD]].concat();
        let got = lines(ImageExpectation::Statistics(mode), &bytes);
        let end = Token::ImageEnd {
            rows: 12 / width,
            intact: true,
        };
        assert_eq!(got[13], end);
        assert_eq!(got[14], here());
    }
    // A header beyond the frame is no header.
    assert_eq!(lines(bitmap, &[0xAA, 200, 2]), [here()]);
    // Nothing of this is taken for data when it is not expected.
    assert_eq!(lines(ImageExpectation::None, &[0xAA, 10, 2]), [here()]);
}

#[test]
fn silence_ends_an_image() {
    let mut parser = Parser::new(Expectation {
        image: ImageExpectation::Frame(3),
        ..Expectation::default()
    });
    events(&mut parser, &[1, 88, 143, 2, 100, 100]);
    parser.gap();
    assert_eq!(events(&mut parser, T), [here()]);
}

#[test]
fn raw_packets() {
    let raw = |bytes: &[u8]| {
        let mut parser = Parser::new(Expectation {
            raw: true,
            ..Expectation::default()
        });
        events(&mut parser, bytes)
    };
    let packet = [0xFF, b'T', 44, 60, 30, 50, b':', 70, b'\r', 90];
    let got = raw(&[&b"ACK\r"[..], &packet, &packet, b":"].concat());
    let expected = Token::Packet(Packet::Tracking(Tracking::new([
        44, 60, 30, 50, b':', 70, b'\r', 90,
    ])));
    assert_eq!(got, [Token::Ack, expected, expected, Token::Prompt]);
    // 255 within the numbers: the packet before it was cut.
    assert_eq!(raw(&[&packet[..5], &packet].concat()), [expected]);
    // Not before raw mode is on.
    assert_eq!(parse(&packet).first(), Some(&Token::Prompt));
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

fn any_tracking() -> impl Strategy<Value = (Tracking, TrackingFields)> {
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
                TrackingFields::new(mask, servos),
            )
        },
    )
}

proptest! {
    #[test]
    fn tracking_packets_come_back((tracking, fields) in any_tracking()) {
        let packet = Packet::Tracking(tracking);
        let mut parser = Parser::new(Expectation { tracking: fields, ..Expectation::default() });
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

/// Counts of an image of three columns and two rows: images, lines that were cut, bytes; and its tokens.
fn counted(image: ImageExpectation, bytes: &[u8]) -> ((u32, u32, u32), Vec<Token>) {
    let mut parser = Parser::new(Expectation {
        image,
        frame: Size::new(3, 2),
        ..Expectation::default()
    });
    let tokens = events(&mut parser, bytes);
    let dropped = parser.dropped();
    ((dropped.images, dropped.cut, dropped.bytes), tokens)
}

#[test]
fn what_is_wrong_with_an_image_is_counted() {
    let frame = |bytes: &[u8]| counted(ImageExpectation::Frame(1), bytes).0;
    let header = [1, 3, 2];
    let counts = |rows: &[u8]| frame(&[&header, rows, &[3]].concat());
    assert_eq!(counts(&[2, 20, 30, 40, 2, 20, 30, 40]), (0, 0, 0));
    // The row, and the image that it is in: no column too few, and no level that is none.
    assert_eq!(counts(&[2, 20, 30, 2, 20, 30, 40]), (2, 0, 0));
    assert_eq!(counts(&[2, 20, 250, 40, 2, 20, 30, 40]), (2, 0, 0));
    assert_eq!(counts(&[2, 20, 30, 40]), (1, 0, 0));
    // A header that cannot be.
    assert_eq!(frame(&[1, 0, b'\r']).0, 1);
    assert_eq!(frame(&[1, 3, 3, b'\r']).0, 1);
    // The camera restarts within.
    let (dropped, tokens) = counted(
        ImageExpectation::Frame(1),
        &[&header[..], &[2, 20], b"CMUcam2 v1.00 c6\r"].concat(),
    );
    assert_eq!(dropped.0, 1);
    assert!(matches!(tokens.last(), Some(Token::Banner(_))));
}

/// A row after a damaged one is judged by itself.
#[test]
fn a_row_is_intact_by_itself() {
    for damaged in [&[2, 20, 250, 40][..], &[2, 250, 20]] {
        let bytes = [&[1, 3, 2], damaged, &[2, 20, 30, 40, 3]].concat();
        let (_, tokens) = counted(ImageExpectation::Frame(1), &bytes);
        assert!(tokens.contains(&Token::Pixel(40, RowState::Full)));
        let end = Token::ImageEnd {
            rows: 2,
            intact: false,
        };
        assert_eq!(tokens.last(), Some(&end));
    }
}

/// An image whose end is missing ends before the next token, of which nothing is lost.
#[test]
fn an_image_without_its_end_loses_nothing_else() {
    let rows = ImageExpectation::Tracking(TrackingLines::Rows);
    let lost = b"T 0 0 0 0 0 0 0 0\r";
    let image = [0xFE, 1, 20, 30, 40, 50, 60];
    for (between, bytes) in [(&b""[..], 0), (b"x", 1)] {
        let (dropped, tokens) = counted(rows, &[&image[..], between, lost].concat());
        assert_eq!((dropped.0, dropped.2), (1, bytes));
        let packet = Token::Packet(Packet::Tracking(Tracking::LOST));
        assert_eq!(tokens.last(), Some(&packet));
    }
}

#[test]
fn an_image_that_is_no_longer_expected_is_over() {
    let mut parser = Parser::new(Expectation {
        image: ImageExpectation::Frame(1),
        ..Expectation::default()
    });
    events(&mut parser, &[1, 3, 2, 2, 20]);
    parser.expect(Expectation::default());
    assert_eq!(events(&mut parser, T), [here()]);
    assert_eq!(parser.dropped().cut, 1);
}

/// A raw packet that is cut by another counts with all its bytes.
#[test]
fn a_raw_packet_that_is_cut_is_counted() {
    let mut parser = Parser::new(Expectation {
        raw: true,
        ..Expectation::default()
    });
    let packet = [0xFF, b'T', 44, 60, 30, 50, 58, 70, 25, 90];
    let bytes = [&packet[..4], &packet].concat();
    assert_eq!(events(&mut parser, &bytes), [here()]);
    let dropped = parser.dropped();
    assert_eq!((dropped.cut, dropped.bytes), (1, 4));
}
