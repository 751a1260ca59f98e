//! The commands as types: every command that can be constructed can be sent.
//!
//! A command is two letters, decimal arguments, and a carriage return. [`Command::line`] writes it.

mod modes;
mod order;

pub use modes::{
    LedMode, LineMode, OutputMask, RawMode, StatisticsLines, StatisticsMask, TrackingLines,
};
pub use order::Order;
pub(crate) use order::{Effect, Mode};

use crate::{
    colour::{ColourBounds, ColourChannel},
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

/// Every command of the camera. Its letters are in its description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Command {
    /// A bare carriage return: stops a stream, or shows that the camera is there.
    Idle,
    /// `BM`: hold one frame until [`Command::ReadFrame`], so that several commands see the same.
    BufferMode(bool),
    /// `CP`: power of the sensor module.
    CameraPower(bool),
    /// `CR`: write sensor registers, or reset them all when there is none.
    Registers(Registers),
    /// `CT`: the mounted sensor.
    CameraType(Sensor),
    /// `DC`: the channel that frame differencing looks at.
    DifferenceChannel(ColourChannel),
    /// `DM`: delay between two characters, bit times.
    CharacterDelay(u8),
    /// `DS`: count only every so many columns and rows.
    DownSample(DownSampling),
    /// `FD`: track blocks that differ by more than this threshold from the reference frame.
    FrameDifference(u8),
    /// `FS`: [`Command::SendFrame`] goes on with further frames.
    FrameStream(bool),
    /// `GB`: asks whether the button was pressed since the last time.
    GetButton,
    /// `GH`: histogram of a channel.
    GetHistogram(ColourChannel),
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
        /// Selects the scale of the counts.
        scale: u8,
    },
    /// `HD`: frame differencing on a grid of 16 x 16 instead of 8 x 8.
    HighResolutionDifference(bool),
    /// `HR`: 176 x 255 instead of 88 x 143 (OV6620 only).
    HighResolution(bool),
    /// `HT`: histogram of tracked pixels only.
    HistogramTracked(bool),
    /// `L0`: mode of LED 0.
    Led0(LedMode),
    /// `L1`: mode of LED 1.
    Led1(LedMode),
    /// `LF`: take the reference frame of frame differencing.
    LoadFrame,
    /// `LM`: binary row data before each packet.
    LineMode(LineMode),
    /// `MD`: from now on ignore the blocks that differ by more than this threshold.
    MaskDifference(u8),
    /// `NF`: number of consecutive pixels that it takes to count.
    NoiseFilter(u8),
    /// `OM`: the fields that packets carry.
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
    SendFrame(Option<ColourChannel>),
    /// `SL`: sleep.
    Sleep,
    /// `SM`: control and reports of pan and tilt.
    ServoMask(ServoMask),
    /// `SO`: a servo pin as a digital output.
    ServoOutput(Servo, bool),
    /// `SP`: parameters by which pan and tilt follow the target.
    ServoParameters(ServoParameters),
    /// `SV`: move a servo.
    ServoPosition(Servo, ServoPosition),
    /// `ST`: set the bounds without tracking.
    SetBounds(ColourBounds),
    /// `TC`: track these bounds, or those in use.
    TrackColour(Option<ColourBounds>),
    /// `TI`: track pixels outside the bounds.
    TrackInvert(bool),
    /// `TW`: learn the colour in the middle of the window and track it.
    TrackWindow,
    /// `UD`: 64 raw bytes follow, the reference of frame differencing.
    UploadDifference,
    /// `VW`: process only this part of the frame, or all of it.
    VirtualWindow(Option<Window>),
}

/// Answer of the camera to a command that it accepts. `ACK` comes first unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Reply {
    /// The prompt follows at once.
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

impl From<Command> for Order {
    #[inline(always)]
    fn from(command: Command) -> Self {
        command.order()
    }
}

impl Command {
    /// The line of this command.
    pub fn line(&self) -> CommandLine {
        self.order().line()
    }

    /// The same without its name, for the dialogue.
    #[inline(always)] // for less flash: of a command that is known where it is sent, nothing else is linked.
    pub fn order(&self) -> Order {
        let mode = Order::mode;
        let switch = |mode, on| Order::mode(mode, &[u8::from(on)]);
        let ask = |letters, reply| Order::bare(letters, reply, Effect::Nothing);
        match *self {
            Self::Idle => Order::IDLE,
            Self::BufferMode(on) => switch(Mode::Buffer, on),
            Self::CameraPower(on) => switch(Mode::Power, on),
            Self::Registers(registers) => {
                Order::bare(b"CR", Reply::Nothing, Effect::Registers).with(registers.numbers())
            }
            Self::CameraType(sensor) => switch(Mode::CameraType, sensor == Sensor::Ov7620),
            Self::DifferenceChannel(channel) => mode(Mode::DifferenceChannel, &[channel.number()]),
            Self::CharacterDelay(delay) => mode(Mode::CharacterDelay, &[delay]),
            Self::DownSample(sampling) => mode(Mode::DownSampling, &[sampling.x(), sampling.y()]),
            Self::FrameDifference(threshold) => {
                ask(b"FD", Reply::Packets(PacketKind::Difference)).with(&[threshold])
            }
            Self::FrameStream(on) => switch(Mode::FrameStream, on),
            Self::GetButton => ask(b"GB", Reply::Values(1)),
            Self::GetHistogram(channel) => {
                ask(b"GH", Reply::Packets(PacketKind::Histogram)).with(&[channel.number()])
            }
            Self::GetInputs => ask(b"GI", Reply::Values(1)),
            Self::GetMean => ask(b"GM", Reply::Packets(PacketKind::Statistics)),
            Self::GetServo(servo) => ask(b"GS", Reply::Values(1)).with(&[servo.number()]),
            Self::GetTrackingBounds => ask(b"GT", Reply::Values(6)),
            Self::GetVersion => ask(b"GV", Reply::Banner),
            Self::GetWindow => ask(b"GW", Reply::Values(4)),
            Self::HistogramConfiguration { bins, scale } => mode(Mode::Histogram, &[bins, scale]),
            Self::HighResolutionDifference(on) => switch(Mode::DifferenceGrid, on),
            Self::HighResolution(on) => switch(Mode::HighResolution, on),
            Self::HistogramTracked(on) => switch(Mode::HistogramTracked, on),
            Self::Led0(led) => mode(Mode::Led0, &[led.number()]),
            Self::Led1(led) => mode(Mode::Led1, &[led.number()]),
            Self::LoadFrame => ask(b"LF", Reply::Nothing),
            Self::LineMode(lines) => mode(
                match lines {
                    LineMode::Tracking(_) => Mode::TrackingLines,
                    LineMode::Statistics(_) => Mode::StatisticsLines,
                },
                &lines.numbers(),
            ),
            Self::MaskDifference(threshold) => ask(b"MD", Reply::Nothing).with(&[threshold]),
            Self::NoiseFilter(pixels) => mode(Mode::NoiseFilter, &[pixels]),
            Self::OutputMask(mask) => mode(
                match mask {
                    OutputMask::Tracking(_) => Mode::TrackingMask,
                    OutputMask::Statistics(_) => Mode::StatisticsMask,
                },
                &mask.numbers(),
            ),
            Self::PixelDifference(on) => switch(Mode::PixelDifference, on),
            Self::PacketFilter(on) => switch(Mode::PacketFilter, on),
            Self::PollMode(on) => switch(Mode::Poll, on),
            Self::PacketSkip(packets) => mode(Mode::PacketSkip, &[packets]),
            Self::ReadFrame => ask(b"RF", Reply::Nothing),
            Self::RawMode(raw) => mode(Mode::Raw, &[raw.bits()]),
            Self::Reset => Order::RESET,
            Self::DeepSleep => ask(b"SD", Reply::Sleep),
            Self::SendFrame(None) => ask(b"SF", Reply::Frame),
            Self::SendFrame(Some(channel)) => ask(b"SF", Reply::Frame).with(&[channel.number()]),
            Self::Sleep => ask(b"SL", Reply::Sleep),
            Self::ServoMask(mask) => mode(Mode::ServoMask, &[mask.bits()]),
            Self::ServoOutput(servo, high) => Order::bare(
                b"SO",
                Reply::Nothing,
                Effect::Mode(Mode::servo(servo.number())),
            )
            .with(&[servo.number(), u8::from(high)]),
            Self::ServoParameters(ServoParameters { pan, tilt }) => mode(
                Mode::ServoParameters,
                &[pan.far, pan.near, pan.step, tilt.far, tilt.near, tilt.step],
            ),
            Self::ServoPosition(servo, position) => mode(
                Mode::servo(servo.number()),
                &[servo.number(), position.get()],
            ),
            Self::SetBounds(bounds) => Order::set_bounds(&bounds.values()),
            Self::TrackColour(None) => Order::TRACK_AGAIN,
            Self::TrackColour(Some(bounds)) => Order::TRACK_AGAIN.with(&bounds.values()),
            Self::TrackInvert(on) => switch(Mode::Invert, on),
            Self::TrackWindow => Order::bare(
                b"TW",
                Reply::Packets(PacketKind::Tracking),
                Effect::OwnBounds,
            ),
            Self::UploadDifference => ask(b"UD", Reply::Upload),
            Self::VirtualWindow(None) => mode(Mode::Window, &[]),
            Self::VirtualWindow(Some(window)) => mode(Mode::Window, &window.corners()),
        }
    }

    /// The reply that comes back.
    pub fn reply(&self) -> Reply {
        self.order().reply()
    }

    /// See [`Order::is_idempotent`].
    pub fn is_idempotent(&self) -> bool {
        self.order().is_idempotent()
    }
}
