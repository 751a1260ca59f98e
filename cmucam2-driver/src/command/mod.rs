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

/// Declares the commands: of each its description, its arguments, and the bytes, reply and effect that it is made of.
macro_rules! commands {
    ($(
        #[doc = $text:literal]
        $name:ident
        $(($($value:ident: $type:ty),+))?
        $({$(#[doc = $of:literal] $field:ident: $field_type:ty,)+})?
        => $order:expr;
    )+) => {
        /// Every command of the camera. Its letters are in its description.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[non_exhaustive]
        pub enum Command {
            $(
                #[doc = $text]
                $name $(($($type),+))? $({$(#[doc = $of] $field: $field_type,)+})?,
            )+
        }

        impl Command {
            /// The same without its name, for the dialogue.
            #[inline(always)] // for less flash: of a command that is known where it is sent, nothing else is linked.
            pub fn order(&self) -> Order {
                match *self {
                    $(Self::$name $(($($value),+))? $({$($field),+})? => $order,)+
                }
            }
        }
    };
}

commands! {
    /// A bare carriage return: stops a stream, or shows that the camera is there.
    Idle => Order::IDLE;
    /// `BM`: hold one frame until [`Command::ReadFrame`], so that several commands see the same.
    BufferMode(on: bool) => switch(Mode::Buffer, on);
    /// `CP`: power of the sensor module.
    CameraPower(on: bool) => switch(Mode::Power, on);
    /// `CR`: write sensor registers, or reset them all when there is none.
    Registers(registers: Registers) => Order::bare(b"CR", Reply::Nothing, Effect::Registers).with(registers.numbers());
    /// `CT`: the mounted sensor.
    CameraType(sensor: Sensor) => switch(Mode::CameraType, sensor == Sensor::Ov7620);
    /// `DC`: the channel that frame differencing looks at.
    DifferenceChannel(channel: ColourChannel) => set(Mode::DifferenceChannel, &[channel.number()]);
    /// `DM`: delay between two characters, bit times.
    CharacterDelay(delay: u8) => set(Mode::CharacterDelay, &[delay]);
    /// `DS`: count only every so many columns and rows.
    DownSample(sampling: DownSampling) => set(Mode::DownSampling, &[sampling.x(), sampling.y()]);
    /// `FD`: track blocks that differ by more than this threshold from the reference frame.
    FrameDifference(threshold: u8) => ask(b"FD", Reply::Packets(PacketKind::Difference)).with(&[threshold]);
    /// `FS`: [`Command::SendFrame`] goes on with further frames.
    FrameStream(on: bool) => switch(Mode::FrameStream, on);
    /// `GB`: asks whether the button was pressed since the last time.
    GetButton => ask(b"GB", Reply::Values(1));
    /// `GH`: histogram of a channel.
    GetHistogram(channel: ColourChannel) => ask(b"GH", Reply::Packets(PacketKind::Histogram)).with(&[channel.number()]);
    /// `GI`: the four auxiliary inputs.
    GetInputs => ask(b"GI", Reply::Values(1));
    /// `GM`: mean colour and deviation of the window.
    GetMean => ask(b"GM", Reply::Packets(PacketKind::Statistics));
    /// `GS`: position of a servo.
    GetServo(servo: Servo) => ask(b"GS", Reply::Values(1)).with(&[servo.number()]);
    /// `GT`: the bounds in use.
    GetTrackingBounds => ask(b"GT", Reply::Values(6));
    /// `GV`: firmware version.
    GetVersion => ask(b"GV", Reply::Banner);
    /// `GW`: the window in use.
    GetWindow => ask(b"GW", Reply::Values(4));
    /// `HC`: bins and scale of the histogram, as numbers of the firmware.
    HistogramConfiguration {
        /// Selects the number of bins.
        bins: u8,
        /// Selects the scale of the counts.
        scale: u8,
    } => set(Mode::Histogram, &[bins, scale]);
    /// `HD`: frame differencing on a grid of 16 x 16 instead of 8 x 8.
    HighResolutionDifference(on: bool) => switch(Mode::DifferenceGrid, on);
    /// `HR`: 176 x 255 instead of 88 x 143 (OV6620 only).
    HighResolution(on: bool) => switch(Mode::HighResolution, on);
    /// `HT`: histogram of tracked pixels only.
    HistogramTracked(on: bool) => switch(Mode::HistogramTracked, on);
    /// `L0`: mode of LED 0.
    Led0(led: LedMode) => set(Mode::Led0, &[led as u8]);
    /// `L1`: mode of LED 1.
    Led1(led: LedMode) => set(Mode::Led1, &[led as u8]);
    /// `LF`: take the reference frame of frame differencing.
    LoadFrame => ask(b"LF", Reply::Nothing);
    /// `LM`: binary row data before each packet.
    LineMode(lines: LineMode) => set(lines.mode(), &lines.numbers());
    /// `MD`: from now on ignore the blocks that differ by more than this threshold.
    MaskDifference(threshold: u8) => ask(b"MD", Reply::Nothing).with(&[threshold]);
    /// `NF`: number of consecutive pixels that it takes to count.
    NoiseFilter(pixels: u8) => set(Mode::NoiseFilter, &[pixels]);
    /// `OM`: the fields that packets carry.
    OutputMask(mask: OutputMask) => set(mask.mode(), &mask.numbers());
    /// `PD`: process differences of neighbouring pixels, so vertical edges, instead of colours.
    PixelDifference(on: bool) => switch(Mode::PixelDifference, on);
    /// `PF`: after the target is lost send only the first empty packet.
    PacketFilter(on: bool) => switch(Mode::PacketFilter, on);
    /// `PM`: one packet for each command, then the prompt.
    PollMode(on: bool) => switch(Mode::Poll, on);
    /// `PS`: packets skipped between two that are sent.
    PacketSkip(packets: u8) => set(Mode::PacketSkip, &[packets]);
    /// `RF`: read a new frame into the buffer.
    ReadFrame => ask(b"RF", Reply::Nothing);
    /// `RM`: binary packets and other shortcuts.
    RawMode(raw: RawMode) => set(Mode::Raw, &[raw.bits()]);
    /// `RS`: reset.
    Reset => Order::RESET;
    /// `SD`: deep sleep.
    DeepSleep => ask(b"SD", Reply::Sleep);
    /// `SF`: send a frame, of one channel or all three.
    SendFrame(channel: Option<ColourChannel>) => match channel {
        None => ask(b"SF", Reply::Frame),
        Some(channel) => ask(b"SF", Reply::Frame).with(&[channel.number()]),
    };
    /// `SL`: sleep.
    Sleep => ask(b"SL", Reply::Sleep);
    /// `SM`: control and reports of pan and tilt.
    ServoMask(mask: ServoMask) => set(Mode::ServoMask, &[mask.bits()]);
    /// `SO`: a servo pin as a digital output.
    ServoOutput(servo: Servo, high: bool) => Order::bare(b"SO", Reply::Nothing, Effect::Mode(Mode::servo(servo.number())))
        .with(&[servo.number(), u8::from(high)]);
    /// `SP`: parameters by which pan and tilt follow the target.
    ServoParameters(axes: ServoParameters) => set(Mode::ServoParameters, &axes.numbers());
    /// `SV`: move a servo.
    ServoPosition(servo: Servo, position: ServoPosition) => set(Mode::servo(servo.number()), &[servo.number(), position.get()]);
    /// `ST`: set the bounds without tracking.
    SetBounds(bounds: ColourBounds) => Order::set_bounds(&bounds.values());
    /// `TC`: track these bounds, or those in use.
    TrackColour(bounds: Option<ColourBounds>) => match bounds {
        None => Order::TRACK_AGAIN,
        Some(bounds) => Order::TRACK_AGAIN.with(&bounds.values()),
    };
    /// `TI`: track pixels outside the bounds.
    TrackInvert(on: bool) => switch(Mode::Invert, on);
    /// `TW`: learn the colour in the middle of the window and track it.
    TrackWindow => Order::bare(b"TW", Reply::Packets(PacketKind::Tracking), Effect::OwnBounds);
    /// `UD`: 64 raw bytes follow, the reference of frame differencing.
    UploadDifference => ask(b"UD", Reply::Upload);
    /// `VW`: process only this part of the frame, or all of it.
    VirtualWindow(window: Option<Window>) => match window {
        None => set(Mode::Window, &[]),
        Some(window) => set(Mode::Window, &window.corners()),
    };
}

/// A command that sets a mode.
#[inline(always)] // for less flash
fn set(mode: Mode, arguments: &[u8]) -> Order {
    Order::mode(mode, arguments)
}

/// A mode that is on or off.
#[inline(always)] // for less flash
fn switch(mode: Mode, on: bool) -> Order {
    Order::mode(mode, &[u8::from(on)])
}

/// A command without a lasting effect.
#[inline(always)] // for less flash
const fn ask(letters: &[u8; 2], reply: Reply) -> Order {
    Order::bare(letters, reply, Effect::Nothing)
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
pub type CommandLine = Line<LINE_MAX>;

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

    /// The reply that comes back.
    pub fn reply(&self) -> Reply {
        self.order().reply()
    }

    /// See [`Order::is_idempotent`].
    pub fn is_idempotent(&self) -> bool {
        self.order().is_idempotent()
    }
}
