//! Commands: golden bytes, and arguments that cannot be sent.

use cmucam2_driver::{
    Command,
    argument::ArgumentError,
    colour::{ColourBounds, ColourChannel, LevelRange},
    command::{
        LedMode, LineMode, OutputMask, RawMode, StatisticsLines, StatisticsMask, TrackingLines,
    },
    geometry::{DownSampling, Sensor, Window},
    register::{ColourMode, FrameRate, Register, Registers},
    servo::{Servo, ServoAxis, ServoMask, ServoParameters, ServoPosition},
};

pub(crate) fn orange() -> ColourBounds {
    ColourBounds::new([170, 230, 70, 130, 16, 46]).unwrap()
}

/// One line for each command of the protocol, and more that other tests use.
fn golden() -> Vec<(Command, &'static str)> {
    let axis = |far, near, step| ServoAxis { far, near, step };
    let (pan, tilt) = (axis(16, 8, 20), axis(12, 6, 10));
    let position = |position| ServoPosition::new(position).unwrap();
    let other = ColourBounds::new([20, 30, 40, 50, 60, 70]).unwrap();
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
            Command::LineMode(LineMode::Tracking(TrackingLines::Bitmap)),
            "LM 0 1",
        ),
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
        (Command::PollMode(false), "PM 0"),
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
        (Command::ServoPosition(Servo::TILT, position(46)), "SV 1 46"),
        (
            Command::ServoPosition(Servo::new(2).unwrap(), position(210)),
            "SV 2 210",
        ),
        (
            Command::ServoPosition(Servo::new(3).unwrap(), position(99)),
            "SV 3 99",
        ),
        (Command::SetBounds(orange()), "ST 170 230 70 130 16 46"),
        (
            Command::TrackColour(Some(orange())),
            "TC 170 230 70 130 16 46",
        ),
        (Command::TrackColour(Some(other)), "TC 20 30 40 50 60 70"),
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

/// The command of a golden line.
pub(crate) fn named(line: &str) -> Command {
    let found = golden().into_iter().find(|(_, text)| *text == line);
    found
        .unwrap_or_else(|| panic!("no golden line is {line:?}"))
        .0
}

#[test]
fn golden_lines() {
    for (command, text) in golden() {
        assert_eq!(command.line().as_bytes(), format!("{text}\r").as_bytes());
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
fn what_the_camera_has_no_meaning_for_cannot_be_made() {
    let six = [Register(1).with(1); 6];
    for (made, error) in [
        (
            ColourBounds::new([50, 40, 16, 240, 16, 240]).err(),
            ArgumentError::BoundsOrder,
        ),
        (
            ColourBounds::new([16, 240, 90, 80, 16, 240]).err(),
            ArgumentError::BoundsOrder,
        ),
        (LevelRange::new(101, 100).err(), ArgumentError::BoundsOrder),
        (Window::new(50, 1, 40, 2).err(), ArgumentError::WindowOrder),
        (DownSampling::new(0, 1).err(), ArgumentError::DownSampling),
        (Servo::new(5).err(), ArgumentError::Servo),
        (ServoPosition::new(45).err(), ArgumentError::ServoPosition),
        (ServoPosition::new(211).err(), ArgumentError::ServoPosition),
        (StatisticsMask::new(64).err(), ArgumentError::Mask),
        (ServoMask::new(16).err(), ArgumentError::Mask),
        (RawMode::new(8).err(), ArgumentError::Mask),
        (Registers::new(&six).err(), ArgumentError::Registers),
    ] {
        assert_eq!(made, Some(error));
    }
    assert!(LevelRange::new(100, 100).is_ok());
    assert!(LevelRange::new(0, 255).is_ok());
}
