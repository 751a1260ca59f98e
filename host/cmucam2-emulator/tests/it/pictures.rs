//! Results of the camera, against counting the pixels of its picture.

use cmucam2_driver::{
    colour::{self, ColourBounds, ColourChannel},
    command::{Command, LineMode, StatisticsLines, TrackingLines},
    geometry::Window,
    packet::{BoundingBox, Packet, Tracking},
    register::{Register, Registers},
    session::{Answer, Learn, Request, StartUp},
};
use cmucam2_emulator::{
    Background, Colour, Configuration, Emulator, Extent, Note, Object, Place, Scene, Sensor, Shape,
    Size, Switches, daylight,
};
use cmucam2_pair::Link;

use std::sync::Arc;

use crate::support::{ORANGE, SECOND, command, driver, orange, orange_box, tracking, with};

fn contains(bounds: ColourBounds, colour: Colour) -> bool {
    let [red, green, blue] = colour.levels();
    bounds.contains(colour::Colour { red, green, blue })
}

/// A room with everything: blocks behind, a ball, a box over a part of it, noise.
fn room() -> Scene {
    let object = |colour, shape, extent| Object {
        colour,
        shape,
        place: Place::At(extent),
    };
    Scene {
        background: Background::Blocks {
            columns: 5,
            rows: 4,
            colours: vec![[90, 95, 100], [130, 120, 110], [200, 110, 70], [60, 60, 60]],
        },
        objects: vec![
            object(ORANGE, Shape::Disc, Extent::centred(0.4, 0.5, 0.3, 0.3)),
            object([70; 3], Shape::Box, Extent::centred(0.5, 0.5, 0.08, 0.9)),
            object(ORANGE, Shape::Disc, Extent::centred(0.02, 0.9, 0.1, 0.3)),
        ],
        light: [1.0, 0.95, 0.9],
        noise: 6.0,
        ..Scene::default()
    }
}

/// A camera that adapts to nothing, so that all frames at one time are the same.
fn frozen(configuration: Configuration, scene: Scene) -> Link {
    let mut link = driver(configuration, scene);
    let off = Registers::one(Register::auto_gain(false));
    command(&mut link, Command::Registers(off)).unwrap();
    link
}

/// The one T packet of a command, and the picture it was computed from.
fn tracked(link: &mut Link, start: Command) -> (Tracking, Vec<Vec<Colour>>) {
    command(link, Command::BufferMode(true)).unwrap();
    let picture = link.camera.picture(link.now());
    let answer = command(link, start);
    command(link, Command::BufferMode(false)).unwrap();
    (tracking(answer), picture)
}

/// The fields of a T packet by counting, columns and rows from 1; runs shorter than `run` do not
/// count.
fn counted(picture: &[Vec<Colour>], counts: impl Fn(Colour) -> bool, run: usize) -> [u8; 8] {
    let mut pixels: Vec<(usize, usize)> = Vec::new();
    for (y, row) in picture.iter().enumerate() {
        for x in 0..row.len() {
            if !counts(row[x]) {
                continue;
            }
            let before = (0..x).rev().take_while(|&x| counts(row[x])).count();
            let after = (x + 1..row.len()).take_while(|&x| counts(row[x])).count();
            if before + 1 + after >= run {
                pixels.push((x + 1, y + 1));
            }
        }
    }
    if pixels.is_empty() {
        return [0; 8];
    }
    let n = pixels.len();
    let xs = || pixels.iter().map(|pixel| pixel.0);
    let ys = || pixels.iter().map(|pixel| pixel.1);
    let (x1, x2) = (xs().min().unwrap(), xs().max().unwrap());
    let (y1, y2) = (ys().min().unwrap(), ys().max().unwrap());
    let area = (x2 - x1 + 1) * (y2 - y1 + 1);
    [
        xs().sum::<usize>() / n,
        ys().sum::<usize>() / n,
        x1,
        y1,
        x2,
        y2,
        ((n + 4) / 8).min(255),
        (256 * n / area).min(255),
    ]
    .map(|number| u8::try_from(number).unwrap())
}

#[test]
fn a_drawn_rectangle_is_the_blob() {
    for (columns, rows, expected) in [
        ([30, 49], [40, 79], [40, 60, 31, 41, 50, 80, 100, 255]),
        // Three pixels, two of them side by side, are fewer than half of eight.
        ([0, 2], [0, 0], [2, 1, 1, 1, 3, 1, 0, 255]),
        ([86, 86], [0, 142], [87, 72, 87, 1, 87, 143, 18, 255]),
        ([0, 86], [0, 142], [44, 72, 1, 1, 87, 143, 255, 255]),
    ] {
        let mut link = frozen(Configuration::default(), orange_box(columns, rows));
        command(&mut link, Command::NoiseFilter(1)).unwrap();
        let (tracking, _) = tracked(&mut link, Command::TrackColour(Some(orange())));
        assert_eq!(tracking, Tracking::new(expected));
    }
}

/// The lower right corner of the picture is inside a box that reaches it.
#[test]
fn every_sensor_and_resolution_shows_the_same_scene() {
    let scene = || Scene::with_object(ORANGE, Shape::Box, Extent::centred(0.5, 0.25, 0.5, 0.25));
    for (sensor, high_resolution) in [
        (Sensor::Ov6620, false),
        (Sensor::Ov6620, true),
        (Sensor::Ov7620, false),
    ] {
        let configuration = with(|it| {
            it.sensor = sensor;
            it.switches.narrow = 0;
        });
        let mut link = frozen(configuration, scene());
        if high_resolution {
            command(&mut link, Command::HighResolution(true)).unwrap();
        }
        let (tracking, picture) = tracked(&mut link, Command::TrackColour(Some(orange())));
        let size = Size::of(sensor, high_resolution);
        assert_eq!(picture.len(), usize::from(size.height));
        assert!(
            picture
                .iter()
                .all(|row| row.len() == usize::from(size.width))
        );
        let BoundingBox { x1, y1, x2, y2 } = tracking.bounding_box().unwrap();
        let width = f64::from(size.width);
        // In high resolution 255 of 286 rows are read.
        let height = if high_resolution {
            286.0
        } else {
            f64::from(size.height)
        };
        let near = |number: u8, place: f64| (f64::from(number) - 0.5 - place).abs() <= 1.0;
        assert!(
            near(x1, 0.25 * width) && near(x2, 0.75 * width),
            "{x1} {x2}"
        );
        assert!(
            near(y1, 0.125 * height) && near(y2, 0.375 * height),
            "{y1} {y2}"
        );
    }
}

/// Only parts of the picture are computed for a packet; they must be those that count. All bounds,
/// inverted, windowed and filtered, against counting the whole picture.
#[test]
fn the_blob_is_that_of_the_whole_picture() {
    let bounds = [
        orange(),
        ColourBounds::new([190, 216, 90, 110, 20, 60]).unwrap(),
        ColourBounds::new([40, 80, 40, 80, 40, 80]).unwrap(),
        ColourBounds::new([80, 140, 80, 140, 80, 140]).unwrap(),
        ColourBounds::ALL,
        ColourBounds::new([16, 17, 16, 17, 16, 17]).unwrap(),
    ];
    let plain = Scene {
        background: Background::Gradient {
            top: [140, 130, 120],
            bottom: [70, 80, 90],
        },
        ..room()
    };
    for scene in [room(), plain] {
        let mut link = frozen(Configuration::default(), scene);
        for (bounds, run, invert) in bounds
            .iter()
            .flat_map(|bounds| [1, 2, 5].map(|run| (*bounds, run)))
            .flat_map(|(bounds, run)| [false, true].map(|invert| (bounds, run, invert)))
        {
            command(&mut link, Command::NoiseFilter(run)).unwrap();
            command(&mut link, Command::TrackInvert(invert)).unwrap();
            let (tracking, picture) = tracked(&mut link, Command::TrackColour(Some(bounds)));
            let counts = |colour| contains(bounds, colour) != invert;
            let expected = counted(&picture, counts, usize::from(run));
            assert_eq!(
                tracking,
                Tracking::new(expected),
                "{bounds:?} {run} {invert}"
            );
        }
    }
}

#[test]
fn the_noise_is_that_of_the_scene() {
    let scene = Scene {
        noise: 5.0,
        ..Scene::default()
    };
    let mut link = frozen(Configuration::default(), scene);
    let picture = link.camera.picture(link.now());
    let levels: Vec<f64> = picture
        .iter()
        .flatten()
        .map(|colour| f64::from(colour.red))
        .collect();
    let n = levels.len() as f64;
    let mean = levels.iter().sum::<f64>() / n;
    let variance = levels
        .iter()
        .map(|level| (level - mean).powi(2))
        .sum::<f64>()
        / n;
    // 12584 pixels: the standard error of sigma is 0.03.
    assert!((variance.sqrt() - 5.0).abs() < 0.15, "{}", variance.sqrt());
    let later = link.camera.picture(link.now() + SECOND);
    assert_ne!(picture, later);
    command(&mut link, Command::BufferMode(true)).unwrap();
    let held = link.camera.picture(link.now());
    assert_eq!(held, link.camera.picture(link.now() + SECOND));
}

fn level(colour: Colour, channel: usize) -> u32 {
    u32::from([colour.red, colour.green, colour.blue][channel])
}

/// Mean and mean absolute deviation of each channel, rounded down.
fn mean_and_deviation(pixels: &[Colour]) -> [[u8; 3]; 2] {
    let n = pixels.len() as u32;
    let levels = |channel| pixels.iter().map(move |colour| level(*colour, channel));
    let means = [0, 1, 2].map(|channel| levels(channel).sum::<u32>() / n);
    let deviations = [0, 1, 2].map(|channel| {
        let off = levels(channel).map(|level| level.abs_diff(means[channel]));
        off.sum::<u32>() / n
    });
    [means, deviations].map(|three| three.map(|number| u8::try_from(number).unwrap()))
}

#[test]
fn statistics_and_histograms_are_those_of_the_pixels() {
    let mut link = frozen(Configuration::default(), room());
    command(&mut link, Command::BufferMode(true)).unwrap();
    for window in [None, Some(Window::new(3, 7, 61, 99).unwrap())] {
        command(&mut link, Command::VirtualWindow(window)).unwrap();
        let pixels = link.camera.picture(link.now()).concat();
        let [mean, deviation] = mean_and_deviation(&pixels);
        let Ok(Answer::Packet(Packet::Statistics(statistics))) =
            command(&mut link, Command::GetMean)
        else {
            panic!("no S packet");
        };
        let three = |colour: colour::Colour| [colour.red, colour.green, colour.blue];
        assert_eq!(three(statistics.mean().unwrap()), mean);
        assert_eq!(three(statistics.deviation().unwrap()), deviation);
        for channel in [
            ColourChannel::Red,
            ColourChannel::Green,
            ColourChannel::Blue,
        ] {
            let Ok(Answer::Packet(Packet::Histogram(histogram))) =
                command(&mut link, Command::GetHistogram(channel))
            else {
                panic!("no H packet");
            };
            let mut shares = [0; 28];
            for pixel in &pixels {
                let level = level(*pixel, usize::from(channel.number()));
                shares[((level - 16) / 8).min(27) as usize] += 256;
            }
            let shares = shares.map(|share| (share / pixels.len()).min(255) as u8);
            assert_eq!(histogram.bins(), shares);
        }
    }
}

/// All that a stream sends, as the driver reads it: rows and packets.
fn rows_of(link: &mut Link, start: Command, length: usize) -> Vec<Vec<u8>> {
    let mut row = vec![0; length];
    let mut rows = Vec::new();
    link.ask(Request::Start(start.into())).unwrap();
    loop {
        let request = Request::NextPart { row: length };
        match link.ask_with(request, &mut row, &[]).unwrap() {
            Answer::Header(_) => rows.clear(),
            Answer::Row { bytes, intact } => {
                assert!(intact);
                rows.push(row[..usize::from(bytes)].to_vec());
            }
            Answer::End { intact, .. } => {
                assert!(intact);
                link.ask(Request::Stop).unwrap();
                return rows;
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_frame_that_is_sent_is_the_picture() {
    let marks: [fn(&mut Switches); 3] = [
        |_| {},
        |it| (it.narrow, it.first_row_mark, it.last_row_mark) = (0, 1, 0),
        |it| it.row_marks = 0,
    ];
    for change in marks {
        let configuration = with(|it| change(&mut it.switches));
        let mut link = frozen(configuration, room());
        command(&mut link, Command::BufferMode(true)).unwrap();
        let picture = link.camera.picture(link.now());
        let rows = rows_of(&mut link, Command::SendFrame(None), 264);
        let expected: Vec<Vec<u8>> = picture
            .iter()
            .map(|row| row.iter().flat_map(|c| [c.red, c.green, c.blue]).collect())
            .collect();
        assert!(rows == expected);
        let rows = rows_of(
            &mut link,
            Command::SendFrame(Some(ColourChannel::Blue)),
            264,
        );
        let expected: Vec<Vec<u8>> = picture
            .iter()
            .map(|row| row.iter().map(|c| c.blue).collect())
            .collect();
        assert!(rows == expected);
    }
}

#[test]
fn line_modes_are_rows_of_the_picture() {
    let mut link = frozen(Configuration::default(), room());
    command(&mut link, Command::BufferMode(true)).unwrap();
    command(&mut link, Command::NoiseFilter(1)).unwrap();
    let picture = link.camera.picture(link.now());
    let track = Command::TrackColour(Some(orange()));
    let mut rows = |mode: LineMode, start: Command| {
        command(&mut link, Command::LineMode(mode)).unwrap();
        rows_of(&mut link, start, 16)
    };
    let bits = rows(LineMode::Tracking(TrackingLines::Bitmap), track);
    for (row, bits) in picture.iter().zip(&bits) {
        for (x, colour) in row.iter().enumerate() {
            let bit = bits[x / 8] >> (7 - x % 8) & 1 == 1;
            assert_eq!(bit, contains(orange(), *colour));
        }
    }
    let lines = rows(LineMode::Tracking(TrackingLines::Rows), track);
    for (row, line) in picture.iter().zip(&lines) {
        let columns: Vec<usize> = (1..)
            .zip(row)
            .filter(|(_, colour)| contains(orange(), **colour))
            .map(|(x, _)| x)
            .collect();
        let expected = match (columns.first(), columns.last()) {
            (Some(&first), Some(&last)) => [
                // The mean of columns from 0 is rounded down.
                columns.iter().map(|x| x - 1).sum::<usize>() / columns.len() + 1,
                first,
                last,
                columns.len(),
                (256 * columns.len() / (last - first + 1)).min(255),
            ],
            _ => [0; 5],
        };
        assert_eq!(
            line.iter().map(|n| usize::from(*n)).collect::<Vec<_>>(),
            expected
        );
    }
    let means = rows(
        LineMode::Statistics(StatisticsLines::MeansAndDeviations),
        Command::GetMean,
    );
    for (row, line) in picture.iter().zip(&means) {
        assert_eq!(line, &mean_and_deviation(row).concat());
    }
}

/// The blocks of the grid that the entering target covers, counted from 1.
#[test]
fn frame_differencing_sees_what_enters() {
    for (fine, expected) in [
        // Blocks of 11 columns: 33 to 43 is the fourth. Rows 54 to 71 are the fourth of 8.
        (false, [4, 4, 4, 4, 4, 4, 1, 255]),
        (true, [7, 7, 7, 7, 8, 8, 4, 255]),
    ] {
        let mut link = frozen(Configuration::default(), Scene::default());
        command(&mut link, Command::HighResolutionDifference(fine)).unwrap();
        command(&mut link, Command::LoadFrame).unwrap();
        let compared = |link: &mut Link| tracking(command(link, Command::FrameDifference(10)));
        assert_eq!(compared(&mut link), Tracking::LOST);
        *link.camera.scene_mut() = Scene {
            background: Background::Plain([110; 3]),
            ..Scene::with_object(
                [110, 200, 110],
                Shape::Box,
                Extent::of_pixels([33.0, 43.0], [54.0, 71.0], 88.0, 143.0),
            )
        };
        assert_eq!(compared(&mut link), Tracking::new(expected));
        command(&mut link, Command::MaskDifference(10)).unwrap();
        assert_eq!(compared(&mut link), Tracking::LOST);
        // Only green has changed.
        command(&mut link, Command::DifferenceChannel(ColourChannel::Blue)).unwrap();
        command(&mut link, Command::MaskDifference(255)).unwrap();
        assert_eq!(compared(&mut link), Tracking::LOST);
    }
}

/// A colour that is learned while the camera still adapts is soon another one.
#[test]
fn freezing_gain_and_white_balance_matters() {
    let dim = || Scene {
        light: [0.45, 0.4, 0.35],
        ..orange_box([30, 49], [40, 79])
    };
    let target = |link: &Link| i16::from(link.camera.picture(link.now())[60][40].green);
    let mut link = driver(Configuration::default(), dim());
    let on = Registers::two(Register::auto_gain(true), Register::COLOUR_MODE.with(44));
    command(&mut link, Command::Registers(on)).unwrap();
    let first = target(&link);
    link.pass(10 * SECOND);
    let adapted = target(&link);
    assert!(adapted > first + 10, "{first} {adapted}");
    let off = Registers::two(Register::auto_gain(false), Register::COLOUR_MODE.with(40));
    command(&mut link, Command::Registers(off)).unwrap();
    let frozen = target(&link);
    // The blinds open: an adapting camera would follow.
    link.camera.scene_mut().background = Background::Plain([230; 3]);
    link.pass(10 * SECOND);
    assert_eq!(target(&link), frozen);
    command(&mut link, Command::Registers(on)).unwrap();
    link.pass(10 * SECOND);
    assert!(target(&link) + 20 < frozen);
}

/// With the pan servo under its control the camera turns until the target is in the middle.
#[test]
fn the_camera_follows_with_its_servos() {
    let mut scene = orange_box([70, 79], [60, 79]);
    scene.servo_step = 0.004;
    let configuration = with(|it| it.watched = true);
    let mut link = frozen(configuration, scene);
    let mask = cmucam2_driver::servo::ServoMask::new(0b0101).unwrap();
    command(&mut link, Command::ServoMask(mask)).unwrap();
    link.ask(Request::Start(Command::TrackColour(Some(orange())).into()))
        .unwrap();
    let seen = std::array::from_fn::<_, 60, _>(|_| tracking(link.ask(Request::Next)));
    let tracking = seen[59];
    assert!(tracking.pan().unwrap() > 180, "{tracking:?}");
    assert!(
        tracking.centroid().unwrap().0.abs_diff(44) <= 9,
        "{tracking:?}"
    );
    let packets = std::iter::from_fn(|| link.camera.take_note())
        .filter(|note| matches!(note, Note::Packet { .. }))
        .count();
    assert!(packets >= 60);
}

/// The scene that is built in, and the thesis's start-up: whenever that happens, the camera learns
/// the ball, and from then on tracks all of it and nothing else.
#[test]
fn the_usual_scene_can_be_learned_and_tracked() {
    let text = include_str!("../../scenes/orange-ball.toml");
    for wait in 0..8 {
        let scene = Scene::from_toml(text, Sensor::Ov6620).unwrap();
        let mut link = driver(Configuration::default(), scene);
        link.pass(wait * SECOND);
        link.ask(Request::StartUp(StartUp::default())).unwrap();
        let how = Learn::TrackWindow;
        link.ask(Request::Learn { how, track: true }).unwrap();
        for _ in 0..300 {
            let tracking = tracking(link.ask(Request::Next));
            // A diameter of 0.5 at a focal length of 43.5 / tan 22.5 columns, and twice as many
            // rows, noise at the edge apart; pi / 4 of its box.
            let BoundingBox { x1, y1, x2, y2 } = tracking.bounding_box().unwrap();
            assert!((x2 - x1 + 1).abs_diff(52) <= 2, "{tracking:?}");
            assert!((y2 - y1 + 1).abs_diff(105) <= 2, "{tracking:?}");
            assert!(
                tracking.confidence().unwrap().abs_diff(201) < 12,
                "{tracking:?}"
            );
        }
    }
}

/// A camera that receives nothing has nothing to do.
#[test]
fn an_idle_camera_has_no_deadline() {
    let mut camera = Emulator::new(Configuration::default(), room());
    camera.advance(2 * SECOND);
    while camera.transmit(2 * SECOND).is_some() {}
    assert_eq!(camera.next_deadline(), None);
    assert_eq!(camera.next_frame(), None);
}

/// Returns true if the orange box is tracked in such light by a camera that adapted and froze before.
fn is_tracked_after(change: [f64; 3], adapts_again: bool) -> bool {
    let mut link = driver(Configuration::default(), orange_box([30, 50], [40, 90]));
    link.ask(Request::StartUp(StartUp::default())).unwrap();
    let before = link.camera.light().factors();
    link.camera.scene_mut().light = change;
    if adapts_again {
        link.ask(Request::StartUp(StartUp::default())).unwrap();
        assert_ne!(link.camera.light().factors(), before);
    } else {
        assert_eq!(link.camera.light().factors(), before);
    }
    command(&mut link, Command::PollMode(true)).unwrap();
    let adapted = ColourBounds::new([160, 240, 60, 175, 16, 120]).unwrap();
    let seen = tracking(command(&mut link, Command::TrackColour(Some(adapted))));
    seen.pixels().is_some_and(|pixels| pixels > 0)
}

#[test]
fn a_change_of_light_blinds_a_camera_until_it_adapts_again() {
    assert!(is_tracked_after(daylight(1.0, 6_504.0), false));
    for (level, kelvin) in [(0.35, 6_504.0), (2.0, 6_504.0), (0.4, 3_200.0)] {
        let light = daylight(level, kelvin);
        assert!(!is_tracked_after(light, false), "{level} {kelvin}");
        assert!(is_tracked_after(light, true), "{level} {kelvin}");
    }
}

/// A scene, and a picture of it by another camera: the same packets, to any frame that they are scaled.
#[test]
fn a_picture_is_seen_as_the_scene_it_shows() {
    for (sensor, columns) in [(Sensor::Ov6620, 88.0), (Sensor::Ov7620, 160.0)] {
        for step in 0..20 {
            let x = 0.2 + 0.031 * f64::from(step);
            let ball = Extent::centred(x, 0.4, 0.13, 0.17);
            let drawn = Scene::with_object(ORANGE, Shape::Disc, ball);
            let filmed = Scene {
                background: Background::Picture(Arc::new(drawn.picture(0.0, 1280, 720).unwrap())),
                ..Scene::default()
            };
            let [a, b] = [drawn, filmed].map(|scene| {
                let configuration = with(|it| it.sensor = sensor);
                let mut link = frozen(configuration, scene);
                let start = Command::TrackColour(Some(orange()));
                tracked(&mut link, start).0.bounding_box().unwrap()
            });
            for (a, b) in [(a.x1, b.x1), (a.x2, b.x2), (a.y1, b.y1), (a.y2, b.y2)] {
                assert!(a.abs_diff(b) <= 1, "{sensor:?}, {x}: {a} {b}");
            }
            let middle = |x1: u8, x2: u8| (f64::from(x1) + f64::from(x2)) / 2.0 - 0.5;
            assert!(
                (middle(b.x1, b.x2) - x * columns).abs() <= 1.0,
                "{sensor:?}, {x}"
            );
        }
    }
}

/// A dump takes seconds, in which the video goes on: all its rows are of one picture. Frame
/// differencing and means see the new one.
#[test]
fn a_frame_is_of_one_picture() {
    let grey = |level: u8| {
        let scene = Scene {
            background: Background::Plain([level; 3]),
            ..Scene::default()
        };
        Background::Picture(Arc::new(scene.picture(0.0, 64, 48).unwrap()))
    };
    let configuration = Configuration::default();
    let mut camera = Emulator::new(
        configuration,
        Scene {
            background: grey(60),
            ..Scene::default()
        },
    );
    let say = |camera: &mut Emulator, from: u64, command: &str, level: u8| {
        for byte in command.bytes() {
            camera.receive(byte, from);
        }
        let mut said = Vec::new();
        for tenth in 1..=40 {
            said.extend(
                std::iter::from_fn(|| camera.transmit(from + tenth * SECOND / 10))
                    .map(|(_, byte)| byte),
            );
            camera.scene_mut().background = grey(level);
        }
        said
    };
    say(&mut camera, SECOND, "CR 19 32\r", 60);
    let frame = say(&mut camera, 10 * SECOND, "SF\r", 200);
    assert_eq!(&frame[..7], b"ACK\r\x01\x57\x8f");
    let pixels = &frame[7..frame.len() - 2];
    assert_eq!(pixels.len(), 143 * (3 * 87 + 1));
    assert!(
        pixels
            .chunks(3 * 87 + 1)
            .all(|row| row[..3 * 87].iter().all(|&level| level == frame[7]))
    );
    say(&mut camera, 20 * SECOND, "LF\r", 90);
    let packets = say(&mut camera, 30 * SECOND, "FD 10\r", 90);
    let packets = String::from_utf8(packets).unwrap();
    assert!(packets.contains("T 4 4 1 1 8 8"), "{packets:.200}");
}
