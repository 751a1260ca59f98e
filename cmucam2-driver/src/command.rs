//! The commands as types: what can be constructed can be sent.
//!
//! A command is two letters, decimal arguments, and a carriage return. [`Command::line`] writes
//! it, [`Command::parse`] reads it as the camera does, so that an emulator understands exactly
//! what the driver sends.

mod modes;
mod parse;

pub use modes::{
    LedMode, LineMode, OutputMask, RawMode, StatisticsLines, StatisticsMask, TrackingLines,
};
pub use parse::CommandError;

use crate::{
    colour::{Channel, ColourBounds},
    geometry::{DownSampling, Sensor, Window},
    packet::PacketKind,
    register::{PAIRS_MAX, Registers},
    servo::{Servo, ServoMask, ServoParameters, ServoPosition},
    text::Line,
};

/// The most arguments a command has.
const ARGUMENTS_MAX: usize = 2 * PAIRS_MAX;

/// `CR` with all its pairs: two letters, for each argument a space and three digits, carriage
/// return.
const LINE_MAX: usize = 2 + 4 * ARGUMENTS_MAX + 1;

/// Everything the camera can be told. The letters of each command are in its description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// A bare carriage return: stops a stream, or shows that the camera is there.
    Idle,
    /// `BM`: hold one frame until [`Command::ReadFrame`], so that several commands see the same.
    BufferMode(bool),
    /// `CP`: power of the sensor module.
    CameraPower(bool),
    /// `CR`: write sensor registers, or reset them all when there is none.
    Registers(Registers),
    /// `CT`: which sensor is mounted.
    CameraType(Sensor),
    /// `DC`: the channel that frame differencing looks at.
    DifferenceChannel(Channel),
    /// `DM`: delay between two characters, bit times.
    CharacterDelay(u8),
    /// `DS`: count only every so many columns and rows.
    DownSample(DownSampling),
    /// `FD`: track what differs by more than this threshold from the reference frame.
    FrameDifference(u8),
    /// `FS`: whether [`Command::SendFrame`] goes on with further frames.
    FrameStream(bool),
    /// `GB`: whether the button was pressed since the last time.
    GetButton,
    /// `GH`: histogram of a channel.
    GetHistogram(Channel),
    /// `GI`: the four auxiliary inputs.
    GetInputs,
    /// `GM`: mean colour and deviation of the window.
    GetMean,
    /// `GS`: position of a servo.
    GetServo(Servo),
    /// `GT`: the bounds in use.
    GetTrackingBounds,
    /// `GV`: firmware version.
    GetVersion,
    /// `GW`: the window in use.
    GetWindow,
    /// `HC`: bins and scale of the histogram, as numbers of the firmware.
    HistogramConfiguration {
        /// Selects the number of bins.
        bins: u8,
        /// Selects how counts are scaled.
        scale: u8,
    },
    /// `HD`: frame differencing on a grid of 16 x 16 instead of 8 x 8.
    HighResolutionDifference(bool),
    /// `HR`: 176 x 255 instead of 88 x 143 (OV6620 only).
    HighResolution(bool),
    /// `HT`: histogram of tracked pixels only.
    HistogramTracked(bool),
    /// `L0`.
    Led0(LedMode),
    /// `L1`.
    Led1(LedMode),
    /// `LF`: take the reference frame of frame differencing.
    LoadFrame,
    /// `LM`: binary row data before each packet.
    LineMode(LineMode),
    /// `MD`: from now on ignore the blocks that differ by more than this threshold.
    MaskDifference(u8),
    /// `NF`: how many consecutive pixels it takes to count.
    NoiseFilter(u8),
    /// `OM`: which fields packets carry.
    OutputMask(OutputMask),
    /// `PD`: process differences of neighbouring pixels, so vertical edges, instead of colours.
    PixelDifference(bool),
    /// `PF`: after the target is lost send only the first empty packet.
    PacketFilter(bool),
    /// `PM`: one packet for each command, then the prompt.
    PollMode(bool),
    /// `PS`: packets skipped between two that are sent.
    PacketSkip(u8),
    /// `RF`: read a new frame into the buffer.
    ReadFrame,
    /// `RM`: binary packets and other shortcuts.
    RawMode(RawMode),
    /// `RS`: reset.
    Reset,
    /// `SD`: deep sleep.
    DeepSleep,
    /// `SF`: send a frame, of one channel or all three.
    SendFrame(Option<Channel>),
    /// `SL`: sleep.
    Sleep,
    /// `SM`: what the camera does with pan and tilt.
    ServoMask(ServoMask),
    /// `SO`: a servo pin as a digital output.
    ServoOutput(Servo, bool),
    /// `SP`: how pan and tilt follow the target.
    ServoParameters(ServoParameters),
    /// `SV`: move a servo.
    ServoPosition(Servo, ServoPosition),
    /// `ST`: set the bounds without tracking.
    SetBounds(ColourBounds),
    /// `TC`: track these bounds, or those in use.
    TrackColour(Option<ColourBounds>),
    /// `TI`: track what is outside the bounds.
    TrackInvert(bool),
    /// `TW`: learn the colour in the middle of the window and track it.
    TrackWindow,
    /// `UD`: 64 raw bytes follow, the reference of frame differencing.
    UploadDifference,
    /// `VW`: process only this part of the frame, or all of it.
    VirtualWindow(Option<Window>),
}

/// What the camera answers to a command that it accepts. `ACK` comes first unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reply {
    /// The prompt.
    Nothing,
    /// A line of so many numbers, then the prompt.
    Values(u8),
    /// The banner, then the prompt. After a reset it comes even if the `ACK` was lost.
    Banner,
    /// Packets until it is stopped; in poll mode one packet and the prompt.
    Packets(PacketKind),
    /// A frame, then the prompt; with [`Command::FrameStream`] frames until it is stopped.
    Frame,
    /// Perhaps the prompt: the camera falls asleep.
    Sleep,
    /// Nothing before 64 raw bytes were received, then the prompt.
    Upload,
}

/// A command as it goes over the line, with its carriage return.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandLine(Line<LINE_MAX>);

impl CommandLine {
    /// The bytes to send.
    pub fn as_bytes(&self) -> &[u8] {
        self.0.as_bytes()
    }
}

impl Command {
    /// The line that tells the camera this.
    pub fn line(&self) -> CommandLine {
        let mut line = Line::EMPTY;
        if let Some(letters) = self.letters() {
            line.text(letters);
        }
        self.write_arguments(&mut line);
        line.push(b'\r');
        CommandLine(line)
    }

    const fn letters(&self) -> Option<&'static [u8; 2]> {
        Some(match self {
            Self::Idle => return None,
            Self::BufferMode(_) => b"BM",
            Self::CameraPower(_) => b"CP",
            Self::Registers(_) => b"CR",
            Self::CameraType(_) => b"CT",
            Self::DifferenceChannel(_) => b"DC",
            Self::CharacterDelay(_) => b"DM",
            Self::DownSample(_) => b"DS",
            Self::FrameDifference(_) => b"FD",
            Self::FrameStream(_) => b"FS",
            Self::GetButton => b"GB",
            Self::GetHistogram(_) => b"GH",
            Self::GetInputs => b"GI",
            Self::GetMean => b"GM",
            Self::GetServo(_) => b"GS",
            Self::GetTrackingBounds => b"GT",
            Self::GetVersion => b"GV",
            Self::GetWindow => b"GW",
            Self::HistogramConfiguration { .. } => b"HC",
            Self::HighResolutionDifference(_) => b"HD",
            Self::HighResolution(_) => b"HR",
            Self::HistogramTracked(_) => b"HT",
            Self::Led0(_) => b"L0",
            Self::Led1(_) => b"L1",
            Self::LoadFrame => b"LF",
            Self::LineMode(_) => b"LM",
            Self::MaskDifference(_) => b"MD",
            Self::NoiseFilter(_) => b"NF",
            Self::OutputMask(_) => b"OM",
            Self::PixelDifference(_) => b"PD",
            Self::PacketFilter(_) => b"PF",
            Self::PollMode(_) => b"PM",
            Self::PacketSkip(_) => b"PS",
            Self::ReadFrame => b"RF",
            Self::RawMode(_) => b"RM",
            Self::Reset => b"RS",
            Self::DeepSleep => b"SD",
            Self::SendFrame(_) => b"SF",
            Self::Sleep => b"SL",
            Self::ServoMask(_) => b"SM",
            Self::ServoOutput(..) => b"SO",
            Self::ServoParameters(_) => b"SP",
            Self::ServoPosition(..) => b"SV",
            Self::SetBounds(_) => b"ST",
            Self::TrackColour(_) => b"TC",
            Self::TrackInvert(_) => b"TI",
            Self::TrackWindow => b"TW",
            Self::UploadDifference => b"UD",
            Self::VirtualWindow(_) => b"VW",
        })
    }

    fn write_arguments(&self, line: &mut Line<LINE_MAX>) {
        match *self {
            Self::Registers(registers) => {
                for (register, value) in registers.iter() {
                    line.numbers(&[register.0, value]);
                }
            }
            Self::CameraType(sensor) => line.numbers(&[match sensor {
                Sensor::Ov6620 => 0,
                Sensor::Ov7620 => 1,
            }]),
            Self::DifferenceChannel(channel)
            | Self::GetHistogram(channel)
            | Self::SendFrame(Some(channel)) => line.numbers(&[channel.number()]),
            Self::DownSample(sampling) => line.numbers(&[sampling.x(), sampling.y()]),
            Self::BufferMode(on)
            | Self::CameraPower(on)
            | Self::FrameStream(on)
            | Self::HighResolutionDifference(on)
            | Self::HighResolution(on)
            | Self::HistogramTracked(on)
            | Self::PixelDifference(on)
            | Self::PacketFilter(on)
            | Self::PollMode(on)
            | Self::TrackInvert(on) => line.numbers(&[u8::from(on)]),
            Self::CharacterDelay(value)
            | Self::FrameDifference(value)
            | Self::MaskDifference(value)
            | Self::NoiseFilter(value)
            | Self::PacketSkip(value) => line.numbers(&[value]),
            Self::GetServo(servo) => line.numbers(&[servo.number()]),
            Self::HistogramConfiguration { bins, scale } => line.numbers(&[bins, scale]),
            Self::Led0(mode) | Self::Led1(mode) => line.numbers(&[mode.number()]),
            Self::LineMode(mode) => line.numbers(&mode.numbers()),
            Self::OutputMask(mask) => line.numbers(&mask.numbers()),
            Self::RawMode(mode) => line.numbers(&[mode.bits()]),
            Self::ServoMask(mask) => line.numbers(&[mask.bits()]),
            Self::ServoOutput(servo, high) => line.numbers(&[servo.number(), u8::from(high)]),
            Self::ServoParameters(ServoParameters { pan, tilt }) => {
                line.numbers(&[pan.far, pan.near, pan.step, tilt.far, tilt.near, tilt.step]);
            }
            Self::ServoPosition(servo, position) => {
                line.numbers(&[servo.number(), position.get()]);
            }
            Self::SetBounds(bounds) | Self::TrackColour(Some(bounds)) => {
                line.numbers(&bounds.values());
            }
            Self::VirtualWindow(Some(window)) => line.numbers(&window.corners()),
            Self::Idle
            | Self::GetButton
            | Self::GetInputs
            | Self::GetMean
            | Self::GetTrackingBounds
            | Self::GetVersion
            | Self::GetWindow
            | Self::LoadFrame
            | Self::ReadFrame
            | Self::Reset
            | Self::DeepSleep
            | Self::SendFrame(None)
            | Self::Sleep
            | Self::TrackColour(None)
            | Self::TrackWindow
            | Self::UploadDifference
            | Self::VirtualWindow(None) => {}
        }
    }

    /// What comes back.
    pub const fn reply(&self) -> Reply {
        match self {
            Self::GetButton | Self::GetInputs | Self::GetServo(_) => Reply::Values(1),
            Self::GetWindow => Reply::Values(4),
            Self::GetTrackingBounds => Reply::Values(6),
            Self::GetVersion | Self::Reset => Reply::Banner,
            Self::GetMean => Reply::Packets(PacketKind::Statistics),
            Self::GetHistogram(_) => Reply::Packets(PacketKind::Histogram),
            Self::TrackColour(_) | Self::TrackWindow => Reply::Packets(PacketKind::Tracking),
            Self::FrameDifference(_) => Reply::Packets(PacketKind::Difference),
            Self::SendFrame(_) => Reply::Frame,
            Self::Sleep | Self::DeepSleep => Reply::Sleep,
            Self::UploadDifference => Reply::Upload,
            _ => Reply::Nothing,
        }
    }

    /// Whether sending the command a second time leaves the camera as the first time did.
    ///
    /// Not so: the two sleeps, which the second copy would end, and the upload, whose raw bytes
    /// a camera that refused it would take for commands.
    pub const fn is_idempotent(&self) -> bool {
        !matches!(self.reply(), Reply::Sleep | Reply::Upload)
    }
}
