//! The whole command set of the driver, in every position of every switch.

use std::collections::BTreeSet;

use cmucam2_driver::{
    colour::{ColourBounds, ColourChannel},
    command::{
        Command, LedMode, LineMode, OutputMask, RawMode, StatisticsLines, StatisticsMask,
        TrackingLines,
    },
    geometry::{DownSampling, Sensor, Window},
    packet::{BoundingBox, Packet, Tracking},
    parser::ImageKind,
    register::{ColourMode, FrameRate, Register, Registers},
    servo::{Servo, ServoAxis, ServoMask, ServoParameters, ServoPosition},
    session::{Answer, Learn, Request, StartUp},
};
use cmucam2_emulator::{Note, Switches};
use cmucam2_pair::Link;

use crate::support::{self, driver, orange, orange_box};

/// The target, counted from 0, both ends inside.
const COLUMNS: [u8; 2] = [30, 49];
const ROWS: [u8; 2] = [40, 79];

/// Requirements on an answer.
#[derive(Clone, Copy, Debug)]
enum Expect {
    Done,
    /// One number that is this.
    Value(u8),
    /// The whole frame, or this window.
    Window(Option<[u8; 4]>),
    /// These bounds in some order, that the driver understands.
    Bounds(ColourBounds),
    Version,
    /// The target where it is.
    Target,
    /// The same with only the middle of mass.
    Middle,
    /// The same in units of half and a third.
    Sampled,
    /// The same with both servo positions.
    Servos,
    Lost,
    /// Some target.
    Anything,
    /// The whole grid differs.
    WholeGrid(u8),
    /// The mean of a wall with a target.
    Mean,
    Red,
    Bins,
    /// An image of this kind and row length, and then a packet or, for frames, nothing.
    Image(ImageKind, u16),
}

/// Requests, in an order in which one camera can do all of them.
fn steps() -> Vec<(Request, Expect)> {
    use Expect as E;
    let axis = |step| ServoAxis {
        far: 10,
        near: 5,
        step,
    };
    let servo = Servo::new(3).unwrap();
    let position = ServoPosition::new(99).unwrap();
    let track = Command::TrackColour(Some(orange()));
    let again = Command::TrackColour(None);
    let mut steps = vec![
        (Request::StartUp(StartUp::default()), E::Done),
        (
            Request::Do(Command::CameraType(Sensor::Ov6620).into()),
            E::Done,
        ),
    ];
    let mut with = |command: Command, expect: E| steps.push((Request::Do(command.into()), expect));
    with(Command::Idle, E::Done);
    with(Command::GetVersion, E::Version);
    with(Command::GetWindow, E::Window(None));
    with(Command::GetButton, E::Value(0));
    with(Command::GetInputs, E::Value(0));
    // Servos and lights.
    with(Command::ServoPosition(servo, position), E::Done);
    with(Command::GetServo(servo), E::Value(99));
    with(Command::ServoOutput(servo, true), E::Done);
    with(
        Command::ServoParameters(ServoParameters {
            pan: axis(0),
            tilt: axis(0),
        }),
        E::Done,
    );
    with(Command::Led0(LedMode::On), E::Done);
    with(Command::Led1(LedMode::Off), E::Done);
    // Tracking.
    with(Command::NoiseFilter(1), E::Done);
    with(track, E::Target);
    with(Command::GetTrackingBounds, E::Bounds(orange()));
    with(Command::SetBounds(ColourBounds::ALL), E::Done);
    with(Command::GetTrackingBounds, E::Bounds(ColourBounds::ALL));
    with(Command::SetBounds(orange()), E::Done);
    with(again, E::Target);
    with(Command::NoiseFilter(21), E::Done);
    with(again, E::Lost);
    with(Command::NoiseFilter(0), E::Done);
    with(Command::TrackInvert(true), E::Done);
    with(again, E::Anything);
    with(Command::TrackInvert(false), E::Done);
    with(Command::PixelDifference(true), E::Done);
    with(again, E::Lost);
    with(Command::PixelDifference(false), E::Done);
    with(Command::ServoMask(ServoMask::new(12).unwrap()), E::Done);
    with(again, E::Servos);
    with(Command::ServoMask(ServoMask::default()), E::Done);
    with(Command::OutputMask(OutputMask::Tracking(3)), E::Done);
    with(again, E::Middle);
    with(Command::OutputMask(OutputMask::Tracking(255)), E::Done);
    // Modes of packets.
    with(Command::PollMode(true), E::Done);
    with(again, E::Target);
    with(Command::GetMean, E::Mean);
    with(Command::GetHistogram(ColourChannel::Green), E::Bins);
    with(Command::PollMode(false), E::Done);
    with(Command::PacketSkip(2), E::Done);
    with(again, E::Target);
    with(Command::PacketSkip(0), E::Done);
    with(Command::PacketFilter(true), E::Done);
    with(again, E::Target);
    with(Command::PacketFilter(false), E::Done);
    with(Command::BufferMode(true), E::Done);
    with(Command::ReadFrame, E::Done);
    with(again, E::Target);
    with(Command::BufferMode(false), E::Done);
    with(Command::CharacterDelay(4), E::Done);
    with(again, E::Target);
    with(Command::CharacterDelay(0), E::Done);
    with(Command::RawMode(RawMode::OUTPUT), E::Done);
    with(again, E::Target);
    with(Command::GetMean, E::Mean);
    with(Command::GetHistogram(ColourChannel::Blue), E::Bins);
    with(Command::GetWindow, E::Window(None));
    with(Command::GetTrackingBounds, E::Bounds(orange()));
    with(Command::RawMode(RawMode::OFF), E::Done);
    // The frame.
    let window = Window::new(20, 30, 60, 100).unwrap();
    with(Command::VirtualWindow(Some(window)), E::Done);
    with(Command::GetWindow, E::Window(Some(window.corners())));
    with(again, E::Target);
    with(Command::VirtualWindow(None), E::Done);
    with(
        Command::DownSample(DownSampling::new(2, 3).unwrap()),
        E::Done,
    );
    with(again, E::Sampled);
    with(Command::DownSample(DownSampling::NONE), E::Done);
    with(Command::HighResolution(true), E::Done);
    with(again, E::Anything);
    with(Command::HighResolution(false), E::Done);
    with(
        Command::Registers(Registers::one(Register::frame_rate(FrameRate::Fps26))),
        E::Done,
    );
    with(again, E::Target);
    // Statistics.
    with(Command::GetMean, E::Mean);
    let red = StatisticsMask::new(0b00_1001).unwrap();
    with(Command::OutputMask(OutputMask::Statistics(red)), E::Done);
    with(Command::GetMean, E::Red);
    with(
        Command::OutputMask(OutputMask::Statistics(StatisticsMask::ALL)),
        E::Done,
    );
    with(Command::GetHistogram(ColourChannel::Red), E::Bins);
    with(Command::HistogramTracked(true), E::Done);
    with(Command::GetHistogram(ColourChannel::Red), E::Bins);
    with(Command::HistogramTracked(false), E::Done);
    with(
        Command::HistogramConfiguration { bins: 1, scale: 2 },
        E::Done,
    );
    with(Command::GetHistogram(ColourChannel::Red), E::Bins);
    // Frame differencing.
    with(Command::DifferenceChannel(ColourChannel::Red), E::Done);
    with(Command::LoadFrame, E::Done);
    with(Command::FrameDifference(10), E::Lost);
    with(Command::UploadDifference, E::Done);
    with(Command::FrameDifference(10), E::WholeGrid(8));
    with(Command::MaskDifference(10), E::Done);
    with(Command::FrameDifference(10), E::Lost);
    with(Command::HighResolutionDifference(true), E::Done);
    with(Command::FrameDifference(10), E::WholeGrid(16));
    with(Command::HighResolutionDifference(false), E::Done);
    // Images.
    let lines = |lines| Command::LineMode(LineMode::Tracking(lines));
    let means = |lines| Command::LineMode(LineMode::Statistics(lines));
    for (set, start, kind, bytes, back) in [
        (
            lines(TrackingLines::Bitmap),
            again,
            ImageKind::Bitmap,
            11,
            lines(TrackingLines::Off),
        ),
        (
            lines(TrackingLines::Rows),
            again,
            ImageKind::Rows,
            5,
            lines(TrackingLines::Off),
        ),
        (
            means(StatisticsLines::Means),
            Command::GetMean,
            ImageKind::Means(3),
            3,
            means(StatisticsLines::Off),
        ),
        (
            means(StatisticsLines::MeansAndDeviations),
            Command::GetMean,
            ImageKind::Means(6),
            6,
            means(StatisticsLines::Off),
        ),
        (
            Command::FrameStream(true),
            Command::SendFrame(Some(ColourChannel::Green)),
            ImageKind::Frame(1),
            88,
            Command::FrameStream(false),
        ),
        (
            Command::FrameStream(false),
            Command::SendFrame(None),
            ImageKind::Frame(3),
            264,
            Command::FrameStream(false),
        ),
    ] {
        steps.push((Request::Do(set.into()), E::Done));
        steps.push((Request::Start(start.into()), E::Image(kind, bytes)));
        steps.push((Request::Stop, E::Done));
        steps.push((Request::Do(back.into()), E::Done));
    }
    // Streams.
    steps.push((Request::Start(track.into()), E::Done));
    steps.push((Request::Next, E::Target));
    steps.push((Request::Next, E::Target));
    steps.push((Request::Do(Command::GetVersion.into()), E::Version));
    steps.push((Request::Next, E::Target));
    steps.push((Request::Stop, E::Done));
    steps.push((Request::Do(Command::PacketFilter(true).into()), E::Done));
    let nothing = ColourBounds::new([16, 20, 230, 240, 16, 20]).unwrap();
    let nowhere = Command::TrackColour(Some(nothing));
    steps.push((Request::Start(nowhere.into()), E::Done));
    steps.push((Request::Do(Command::GetButton.into()), E::Value(0)));
    steps.push((Request::Do(Command::PacketFilter(false).into()), E::Done));
    steps.push((Request::Next, E::Lost));
    steps.push((Request::Stop, E::Done));
    // Learning, sleep, and the end.
    for how in [
        Learn::TrackWindow,
        Learn::Mean {
            window: None,
            margin: 30,
        },
    ] {
        steps.push((Request::Learn { how, track: true }, E::Anything));
        steps.push((Request::Next, E::Anything));
    }
    for command in [
        Command::Sleep,
        Command::GetButton,
        Command::DeepSleep,
        Command::GetButton,
    ] {
        let expect = match command {
            Command::GetButton => E::Value(0),
            _ => E::Done,
        };
        steps.push((Request::Do(command.into()), expect));
    }
    for (command, expect) in [
        (Command::CameraPower(false), E::Done),
        (Command::TrackColour(Some(orange())), E::Lost),
        (Command::CameraPower(true), E::Done),
        (
            Command::Registers(Registers::one(Register::colour_mode(
                ColourMode::YCrCb,
                false,
            ))),
            E::Done,
        ),
        // Red in Cr, middling in Y, low in Cb: orange lies within these bounds here, too.
        (Command::TrackColour(None), E::Target),
        (Command::Registers(Registers::DEFAULTS), E::Done),
    ] {
        steps.push((Request::Do(command.into()), expect));
    }
    steps.push((Request::Recover, E::Done));
    steps.push((Request::Do(Command::Reset.into()), E::Version));
    steps
}

/// Returns true if this is the answer of a camera with these switches.
fn is_right(expect: Expect, answer: &Answer, switches: &Switches, window: Option<Window>) -> bool {
    let origin = switches.origin;
    let tracking = match answer {
        Answer::Packet(Packet::Tracking(tracking)) => Some(tracking),
        _ => None,
    };
    let statistics = match answer {
        Answer::Packet(Packet::Statistics(statistics)) => Some(statistics),
        _ => None,
    };
    // The column and row from which coordinates count, from 0.
    let (left, top) = match window {
        Some(window) if switches.window_relative == 1 => {
            let [x, y, ..] = window.corners();
            (x - origin, y - origin)
        }
        _ => (0, 0),
    };
    let numbers = |[from, to]: [u8; 2], first: u8| [from - first + origin, to - first + origin];
    let ([x1, x2], [y1, y2]) = (numbers(COLUMNS, left), numbers(ROWS, top));
    let drawn = BoundingBox { x1, y1, x2, y2 };
    let middle = (x1 + (x2 - x1) / 2, y1 + (y2 - y1) / 2);
    match expect {
        Expect::Done => matches!(answer, Answer::Done),
        Expect::Value(value) => *answer == Answer::Values([value, 0, 0, 0, 0, 0]),
        Expect::Window(window) => {
            let narrow = switches.narrow;
            let [a, b, c, d] =
                window.unwrap_or([origin, origin, 87 - narrow + origin, 142 + origin]);
            *answer == Answer::Values([a, b, c, d, 0, 0])
        }
        Expect::Bounds(bounds) => matches!(answer, Answer::Values(values)
            if cmucam2_driver::uncertain::bounds_from_reply(*values, Some(bounds)) == Some(bounds)),
        Expect::Version => {
            matches!(answer, Answer::Version(version) if (1..=2).contains(&version.major))
        }
        Expect::Target => tracking.is_some_and(|tracking| {
            tracking.bounding_box() == Some(drawn)
                && tracking.centroid() == Some(middle)
                && tracking
                    .confidence()
                    .is_some_and(|confidence| confidence >= 254)
                && tracking.is_consistent()
        }),
        Expect::Middle => tracking.is_some_and(|tracking| {
            tracking.centroid() == Some(middle) && tracking.bounding_box().is_none()
        }),
        // Columns 15 to 24 and rows 14 to 26 of a frame of every second and third one.
        Expect::Sampled => tracking.is_some_and(|tracking| {
            let [x1, x2, y1, y2] = [15, 24, 14, 26].map(|number| number + origin);
            tracking.bounding_box() == Some(BoundingBox { x1, y1, x2, y2 })
        }),
        Expect::Servos => tracking.is_some_and(|tracking| {
            tracking.pan() == Some(128)
                && tracking.tilt() == Some(128)
                && tracking.centroid() == Some(middle)
        }),
        Expect::Lost => tracking.is_some_and(Tracking::is_lost),
        Expect::Anything => {
            tracking.is_some_and(|tracking| !tracking.is_lost())
                || matches!(answer, Answer::Bounds(_))
        }
        Expect::WholeGrid(side) => tracking.is_some_and(|tracking| {
            let last = side - 1 + origin;
            tracking.bounding_box()
                == Some(BoundingBox {
                    x1: origin,
                    y1: origin,
                    x2: last,
                    y2: last,
                })
        }),
        // The start-up has made the picture as a whole grey and of middle brightness; the target
        // differs from the wall in red, hardly in green.
        Expect::Mean => statistics
            .and_then(|statistics| Some((statistics.mean()?, statistics.deviation()?)))
            .is_some_and(|(mean, deviation)| {
                let levels = [mean.red, mean.green, mean.blue];
                levels.iter().all(|level| level.abs_diff(128) <= 4)
                    && deviation.red > 4 * deviation.green.max(1)
            }),
        Expect::Red => statistics.is_some_and(|statistics| statistics.mean().is_none()),
        // The echo of `GH 0` reads as a histogram of one bin.
        Expect::Bins => matches!(answer, Answer::Packet(Packet::Histogram(histogram))
            if switches.echo == 1 || histogram.bins().iter().any(|bin| *bin > 0)),
        Expect::Image(..) => *answer == Answer::Done,
    }
}

/// Reads an image to its end, and the packet after it.
fn read_image(link: &mut Link, kind: ImageKind, row_bytes: u16, narrow: u8) -> Result<(), String> {
    let mut row = [0; 600];
    let mut rows = 0;
    let length = row.len();
    let row_bytes = match kind {
        ImageKind::Frame(bytes) => row_bytes - u16::from(bytes) * u16::from(narrow),
        _ => row_bytes,
    };
    loop {
        let request = Request::NextPart { row: length };
        match link.ask_with(request, &mut row, &[]) {
            Ok(Answer::Header(header)) if header.kind == kind && header.row_bytes == row_bytes => {}
            Ok(Answer::Row {
                bytes,
                intact: true,
            }) if bytes == row_bytes => rows += 1,
            Ok(Answer::End {
                rows: 143,
                intact: true,
            }) if rows == 143 => break,
            // Packets from before the stream was read.
            Ok(Answer::Packet(_)) if rows == 0 => {}
            other => return Err(format!("{other:?} after {rows} rows")),
        }
    }
    if matches!(kind, ImageKind::Frame(_)) {
        return Ok(());
    }
    match link.ask(Request::Next) {
        Ok(Answer::Packet(_)) => Ok(()),
        other => Err(format!("{other:?} instead of a packet")),
    }
}

/// All steps with one camera; returns the letters that it was sent.
fn run(switches: Switches) -> Result<BTreeSet<[u8; 2]>, String> {
    let configuration = support::with(|it| {
        it.switches = switches;
        it.watched = true;
    });
    let mut link = driver(configuration, orange_box(COLUMNS, ROWS));
    let mut letters = BTreeSet::new();
    for (request, expect) in steps() {
        let window = link.session.modes().window();
        let answer = link.ask_with(request, &mut [], &[200; 64]);
        match (&answer, expect) {
            (Ok(answer), _) if is_right(expect, answer, &switches, window) => {}
            _ => return Err(format!("{request:?}: {answer:?} is not {expect:?}")),
        }
        if let Expect::Image(kind, bytes) = expect {
            read_image(&mut link, kind, bytes, switches.narrow)
                .map_err(|error| format!("{request:?}: {error}"))?;
        }
        while let Some(note) = link.camera.take_note() {
            if let Note::Command(command) = note {
                letters.insert(command.letters);
            }
        }
    }
    if link.session.retries() > 0 || link.session.restarts() > 0 {
        return Err(format!(
            "{} retries and {} restarts on a good line",
            link.session.retries(),
            link.session.restarts()
        ));
    }
    Ok(letters)
}

/// The letters of every command there is.
fn all_letters() -> BTreeSet<[u8; 2]> {
    let all = "BM CP CR CT DC DM DS FD FS GB GH GI GM GS GT GV GW HC HD HR HT L0 L1 LF LM MD NF OM \
               PD PF PM PS RF RM RS SD SF SL SM SO SP SV ST TC TI TW UD VW";
    all.split(' ')
        .map(|letters| letters.as_bytes().try_into().unwrap())
        .collect()
}

#[test]
fn the_driver_understands_every_position_of_every_switch() {
    let mut wrong = Vec::new();
    let all = all_letters();
    assert_eq!(all.len(), 48, "as many as the reference lists");
    for switch in Switches::TABLE {
        for position in 0..=switch.greatest {
            let mut switches = Switches::default();
            switches.set(switch.name, position).unwrap();
            match run(switches) {
                Ok(letters) if letters == all => {}
                Ok(letters) => {
                    let missing: Vec<_> = all
                        .difference(&letters)
                        .map(|letters| String::from_utf8_lossy(letters).into_owned())
                        .collect();
                    wrong.push(format!(
                        "{}={position}: never sent {missing:?}",
                        switch.name
                    ));
                }
                Err(error) => wrong.push(format!("{}={position}: {error}", switch.name)),
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// All switches at once in a position that is not the default. A version that ends in neither a
/// module number nor a carriage return is the one combination that the driver cannot read.
#[test]
fn the_driver_understands_a_camera_that_is_different_in_everything() {
    let mut switches = Switches::default();
    for switch in Switches::TABLE {
        let position = match switch.name {
            // A reset of a second.
            "boot_time" => 10,
            _ => u8::from(switch.default == 0),
        };
        switches.set(switch.name, position).unwrap();
    }
    run(switches).unwrap();
}
