//! Commands: golden bytes, refusals, round trips.

use cmucam2_driver::{
    Command,
    argument::ArgumentError,
    colour::{ColourBounds, ColourChannel},
    command::{
        CommandError, LedMode, LineMode, OutputMask, RawMode, StatisticsLines, StatisticsMask,
        TrackingLines,
    },
    geometry::{DownSampling, Sensor, Window},
    register::{ColourMode, FrameRate, Register, Registers},
    servo::{Servo, ServoAxis, ServoMask, ServoParameters, ServoPosition},
};
use proptest::prelude::*;

fn bounds() -> ColourBounds {
    ColourBounds::new([170, 230, 70, 130, 16, 46]).unwrap()
}

/// One line for each command of the protocol.
fn golden() -> Vec<(Command, &'static str)> {
    let axis = |far, near, step| ServoAxis { far, near, step };
    let (pan, tilt) = (axis(16, 8, 20), axis(12, 6, 10));
    vec![
        (Command::Idle, ""),
        (Command::BufferMode(true), "BM 1"),
        (Command::CameraPower(false), "CP 0"),
        (
            Command::Registers(Registers::two(
                Register::colour_mode(ColourMode::Rgb, true),
                Register::auto_gain(true),
            )),
            "CR 18 44 19 33",
        ),
        (
            Command::Registers(Registers::two(
                Register::colour_mode(ColourMode::YCrCb, false),
                Register::auto_gain(false),
            )),
            "CR 18 32 19 32",
        ),
        (
            Command::Registers(Registers::one(Register::frame_rate(FrameRate::Fps5))),
            "CR 17 10",
        ),
        (Command::Registers(Registers::DEFAULTS), "CR"),
        (Command::CameraType(Sensor::Ov7620), "CT 1"),
        (Command::DifferenceChannel(ColourChannel::Blue), "DC 2"),
        (Command::CharacterDelay(255), "DM 255"),
        (
            Command::DownSample(DownSampling::new(2, 4).unwrap()),
            "DS 2 4",
        ),
        (Command::FrameDifference(15), "FD 15"),
        (Command::FrameStream(true), "FS 1"),
        (Command::GetButton, "GB"),
        (Command::GetHistogram(ColourChannel::Green), "GH 1"),
        (Command::GetInputs, "GI"),
        (Command::GetMean, "GM"),
        (Command::GetServo(Servo::TILT), "GS 1"),
        (Command::GetTrackingBounds, "GT"),
        (Command::GetVersion, "GV"),
        (Command::GetWindow, "GW"),
        (
            Command::HistogramConfiguration { bins: 1, scale: 2 },
            "HC 1 2",
        ),
        (Command::HighResolutionDifference(true), "HD 1"),
        (Command::HighResolution(true), "HR 1"),
        (Command::HistogramTracked(true), "HT 1"),
        (Command::Led0(LedMode::Auto), "L0 2"),
        (Command::Led1(LedMode::On), "L1 1"),
        (Command::LoadFrame, "LF"),
        (
            Command::LineMode(LineMode::Tracking(TrackingLines::Rows)),
            "LM 0 2",
        ),
        (
            Command::LineMode(LineMode::Statistics(StatisticsLines::Means)),
            "LM 1 1",
        ),
        (Command::MaskDifference(20), "MD 20"),
        (Command::NoiseFilter(2), "NF 2"),
        (Command::OutputMask(OutputMask::Tracking(3)), "OM 0 3"),
        (
            Command::OutputMask(OutputMask::Statistics(StatisticsMask::ALL)),
            "OM 1 63",
        ),
        (Command::PixelDifference(true), "PD 1"),
        (Command::PacketFilter(true), "PF 1"),
        (Command::PollMode(true), "PM 1"),
        (Command::PacketSkip(9), "PS 9"),
        (Command::ReadFrame, "RF"),
        (Command::RawMode(RawMode::OUTPUT), "RM 1"),
        (Command::Reset, "RS"),
        (Command::DeepSleep, "SD"),
        (Command::SendFrame(None), "SF"),
        (Command::SendFrame(Some(ColourChannel::Red)), "SF 0"),
        (Command::Sleep, "SL"),
        (
            Command::ServoMask(ServoMask::from_switches(true, true, false, true)),
            "SM 11",
        ),
        (Command::ServoOutput(Servo::new(4).unwrap(), true), "SO 4 1"),
        (
            Command::ServoParameters(ServoParameters { pan, tilt }),
            "SP 16 8 20 12 6 10",
        ),
        (
            Command::ServoPosition(Servo::PAN, ServoPosition::CENTRE),
            "SV 0 128",
        ),
        (Command::SetBounds(bounds()), "ST 170 230 70 130 16 46"),
        (
            Command::TrackColour(Some(bounds())),
            "TC 170 230 70 130 16 46",
        ),
        (Command::TrackColour(None), "TC"),
        (Command::TrackInvert(true), "TI 1"),
        (Command::TrackWindow, "TW"),
        (Command::UploadDifference, "UD"),
        (
            Command::VirtualWindow(Some(Window::new(1, 2, 88, 143).unwrap())),
            "VW 1 2 88 143",
        ),
        (Command::VirtualWindow(None), "VW"),
    ]
}

#[test]
fn golden_lines() {
    for (command, text) in golden() {
        assert_eq!(command.line().as_bytes(), format!("{text}\r").as_bytes());
        assert_eq!(Command::parse(text.as_bytes()), Ok(command), "{text}");
        let lower = text.to_ascii_lowercase();
        assert_eq!(Command::parse(lower.as_bytes()), Ok(command), "{lower}");
    }
}

/// The table of the protocol names 49 commands.
#[test]
fn the_whole_command_set_is_there() {
    let mut letters: Vec<&str> = golden()
        .iter()
        .filter_map(|(_, text)| text.get(..2))
        .collect();
    letters.dedup();
    let all = "BM CP CR CT DC DM DS FD FS GB GH GI GM GS GT GV GW HC HD HR HT L0 L1 LF LM MD NF OM \
               PD PF PM PS RF RM RS SD SF SL SM SO SP SV ST TC TI TW UD VW";
    assert_eq!(letters, all.split(' ').collect::<Vec<_>>());
}

#[test]
fn what_the_camera_refuses() {
    let argument = |error| Err(CommandError::Argument(error));
    for (text, expected) in [
        ("X", Err(CommandError::Unknown)),
        ("XX 1", Err(CommandError::Unknown)),
        ("PM", Err(CommandError::Count)),
        ("PM 1 1", Err(CommandError::Count)),
        ("GV 1", Err(CommandError::Count)),
        ("CR 18", Err(CommandError::Count)),
        ("TC 1 2 3", Err(CommandError::Count)),
        ("PM x", Err(CommandError::Number)),
        ("PM -1", Err(CommandError::Number)),
        ("PS 256", Err(CommandError::Number)),
        ("PS 0000", Err(CommandError::Number)),
        ("PM 2", argument(ArgumentError::Switch)),
        (
            "ST 50 40 16 240 16 240",
            argument(ArgumentError::BoundsOrder),
        ),
        ("VW 50 1 40 2", argument(ArgumentError::WindowOrder)),
        ("DS 0 1", argument(ArgumentError::DownSampling)),
        ("SV 5 128", argument(ArgumentError::Servo)),
        ("SV 0 45", argument(ArgumentError::ServoPosition)),
        ("SV 0 211", argument(ArgumentError::ServoPosition)),
        ("DC 3", argument(ArgumentError::Channel)),
        ("OM 1 64", argument(ArgumentError::Mask)),
        ("OM 2 1", argument(ArgumentError::Mode)),
        ("LM 0 3", argument(ArgumentError::Mode)),
        ("L0 3", argument(ArgumentError::Mode)),
        ("SM 16", argument(ArgumentError::Mask)),
        ("RM 8", argument(ArgumentError::Mask)),
        ("CR 1 1 2 2 3 3 4 4 5 5 6 6", Err(CommandError::Count)),
    ] {
        assert_eq!(Command::parse(text.as_bytes()), expected, "{text}");
    }
}

/// Any command, from the golden ones with other arguments.
fn any_line() -> impl Strategy<Value = String> {
    let letters = prop::sample::select(golden()).prop_map(|(_, text)| text.get(..2).unwrap_or(""));
    (letters, prop::collection::vec(0_u16..=300, 0..=11)).prop_map(|(letters, numbers)| {
        let mut line = letters.to_owned();
        for number in numbers {
            line += &format!(" {number}");
        }
        line
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    /// Every accepted line means the same when it is written and read again.
    #[test]
    fn what_is_accepted_comes_back(line in any_line()) {
        if let Ok(command) = Command::parse(line.as_bytes()) {
            let again = command.line();
            let (end, text) = again.as_bytes().split_last().unwrap();
            prop_assert_eq!(*end, b'\r');
            prop_assert_eq!(text, line.as_bytes());
            prop_assert_eq!(Command::parse(text), Ok(command));
        }
    }

    #[test]
    fn bounds_come_back(values in prop::array::uniform6(16_u8..=240)) {
        let [a, b, c, d, e, f] = values;
        let ordered = [a.min(b), a.max(b), c.min(d), c.max(d), e.min(f), e.max(f)];
        let command = Command::TrackColour(Some(ColourBounds::new(ordered).unwrap()));
        let line = command.line();
        prop_assert_eq!(Command::parse(line.as_bytes().trim_ascii_end()), Ok(command));
    }

    #[test]
    fn any_bytes_are_read_without_a_panic(line in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = Command::parse(&line);
    }
}
