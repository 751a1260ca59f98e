//! What can be asked of the camera.

use super::{Call, Cmucam2, Convert};
use crate::{
    colour::{ColourBounds, ColourChannel},
    command::{Command, LedMode},
    geometry::{DownSampling, Sensor, Window},
    packet::{FirmwareVersion, Packet, Statistics, Tracking},
    register::{ColourMode, FrameRate, Register, Registers},
    servo::{Servo, ServoParameters, ServoPosition},
    session::{Answer, Learn, Modes, Request, StartUp},
    uncertain,
};

fn done(_: Answer, _: &Modes) -> Option<()> {
    Some(())
}

fn answer(answer: Answer, _: &Modes) -> Option<Answer> {
    Some(answer)
}

fn version(answer: Answer, _: &Modes) -> Option<FirmwareVersion> {
    match answer {
        Answer::Version(version) => Some(version),
        _ => None,
    }
}

fn value(answer: Answer, _: &Modes) -> Option<u8> {
    match answer {
        Answer::Values([value, ..]) => Some(value),
        _ => None,
    }
}

fn button(answer: Answer, modes: &Modes) -> Option<bool> {
    value(answer, modes).map(|value| value != 0)
}

fn window(answer: Answer, _: &Modes) -> Option<Window> {
    match answer {
        Answer::Values([x, y, x2, y2, ..]) => Window::new(x, y, x2, y2).ok(),
        _ => None,
    }
}

fn bounds(answer: Answer, modes: &Modes) -> Option<ColourBounds> {
    match answer {
        Answer::Values(values) => uncertain::bounds_from_reply(values, modes.bounds()),
        Answer::Bounds(bounds) => Some(bounds),
        _ => None,
    }
}

fn packet(answer: Answer, _: &Modes) -> Option<Option<Packet>> {
    match answer {
        Answer::Packet(packet) => Some(Some(packet)),
        Answer::Quiet => Some(None),
        _ => None,
    }
}

fn tracking(answer: Answer, modes: &Modes) -> Option<Option<Tracking>> {
    match packet(answer, modes)? {
        Some(Packet::Tracking(tracking)) => Some(Some(tracking)),
        None => Some(None),
        Some(_) => None,
    }
}

fn statistics(answer: Answer, _: &Modes) -> Option<Statistics> {
    match answer {
        Answer::Packet(Packet::Statistics(statistics)) => Some(statistics),
        _ => None,
    }
}

/// Dialogues of several commands, and any command.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Resets the camera. All modes are back to their defaults, here too.
    pub fn reset(&mut self) -> Call<'_, U, D, FirmwareVersion, K> {
        self.ask(Command::Reset, version)
    }

    /// Resets the camera and sets all modes again, for one that no longer understands anything.
    /// A stream goes on with the next packet that is asked for.
    pub fn recover(&mut self) -> Call<'_, U, D, (), K> {
        self.call(Request::Recover, done)
    }

    /// Reset, adapt to the light, freeze gain and white balance: see [`StartUp`].
    pub fn start_up(&mut self, start_up: StartUp) -> Call<'_, U, D, (), K> {
        self.call(Request::StartUp(start_up), done)
    }

    /// Learns the colour of the object in view and sets it as bounds: see [`Learn`].
    pub fn learn(&mut self, how: Learn) -> Call<'_, U, D, ColourBounds, K> {
        self.call(Request::Learn { how, track: false }, bounds)
    }

    /// [`Cmucam2::learn`], then [`Cmucam2::track_colour`].
    pub fn learn_and_track(&mut self, how: Learn) -> Call<'_, U, D, ColourBounds, K> {
        self.call(Request::Learn { how, track: true }, bounds)
    }

    /// Ends the stream.
    pub fn stop(&mut self) -> Call<'_, U, D, (), K> {
        self.call(Request::Stop, done)
    }

    /// Any single command. Of one that answers with packets, one is taken and the camera is
    /// stopped if it goes on.
    #[inline(always)] // size
    pub fn command(&mut self, command: Command) -> Call<'_, U, D, Answer, K> {
        self.ask(command, answer)
    }

    /// Begins the stream of any command that answers with packets or frames, for
    /// [`Cmucam2::next_packet`].
    #[inline(always)] // size
    pub fn stream(&mut self, command: Command) -> Call<'_, U, D, (), K> {
        self.call(Request::Start(command.order()), done)
    }

    #[inline(always)] // size
    pub(super) fn simple(&mut self, command: Command) -> Call<'_, U, D, (), K> {
        self.ask(command, done)
    }

    #[inline(always)] // size
    pub(super) fn ask<T>(&mut self, command: Command, convert: Convert<T>) -> Call<'_, U, D, T, K> {
        self.call(Request::Do(command.order()), convert)
    }
}

/// Is it there, and what is it?
impl<U, D, K> Cmucam2<U, D, K> {
    /// Whether the camera listens.
    pub fn ping(&mut self) -> Call<'_, U, D, (), K> {
        self.simple(Command::Idle)
    }

    /// The firmware version.
    pub fn version(&mut self) -> Call<'_, U, D, FirmwareVersion, K> {
        self.ask(Command::GetVersion, version)
    }

    /// Tells the camera which sensor is mounted.
    pub fn sensor(&mut self, sensor: Sensor) -> Call<'_, U, D, (), K> {
        self.simple(Command::CameraType(sensor))
    }

    /// Whether the button was pressed since the last time.
    pub fn button(&mut self) -> Call<'_, U, D, bool, K> {
        self.ask(Command::GetButton, button)
    }

    /// The auxiliary inputs, one in each of the lower four bits.
    pub fn inputs(&mut self) -> Call<'_, U, D, u8, K> {
        self.ask(Command::GetInputs, value)
    }

    /// What LED 0 does.
    pub fn led0(&mut self, mode: LedMode) -> Call<'_, U, D, (), K> {
        self.simple(Command::Led0(mode))
    }

    /// What LED 1 does.
    pub fn led1(&mut self, mode: LedMode) -> Call<'_, U, D, (), K> {
        self.simple(Command::Led1(mode))
    }

    /// Sleeps until the next call, which takes about 10 ms longer.
    pub fn sleep(&mut self) -> Call<'_, U, D, (), K> {
        self.simple(Command::Sleep)
    }

    /// Sleeps deeper until the next call.
    pub fn deep_sleep(&mut self) -> Call<'_, U, D, (), K> {
        self.simple(Command::DeepSleep)
    }

    /// Power of the sensor module.
    pub fn camera_power(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::CameraPower(on))
    }
}

/// Registers of the sensor.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Writes registers, or resets all of them if there is none. At most
    /// [`REGISTERS_MAX`](crate::session::REGISTERS_MAX) different ones can be set at a time.
    pub fn registers(&mut self, registers: Registers) -> Call<'_, U, D, (), K> {
        self.simple(Command::Registers(registers))
    }

    /// Automatic gain: on after a reset.
    pub fn auto_gain(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.registers(Registers::one(Register::auto_gain(on)))
    }

    /// What the channels mean, and automatic white balance.
    pub fn colour_mode(
        &mut self,
        mode: ColourMode,
        auto_white_balance: bool,
    ) -> Call<'_, U, D, (), K> {
        self.registers(Registers::one(Register::colour_mode(
            mode,
            auto_white_balance,
        )))
    }

    /// Frames a second.
    pub fn frame_rate(&mut self, rate: FrameRate) -> Call<'_, U, D, (), K> {
        self.registers(Registers::one(Register::frame_rate(rate)))
    }
}

/// Colour tracking: begin, then ask for packets.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Tracks a colour: [`Cmucam2::next_tracking`] tells where it is.
    pub fn track_colour(&mut self, bounds: ColourBounds) -> Call<'_, U, D, (), K> {
        self.stream(Command::TrackColour(Some(bounds)))
    }

    /// Tracks the bounds that the camera has.
    pub fn track_again(&mut self) -> Call<'_, U, D, (), K> {
        self.stream(Command::TrackColour(None))
    }

    /// Learns the colour in the middle of the window and tracks it. The bounds stay unknown here,
    /// so they cannot be restored after a restart: [`Cmucam2::learn_and_track`] can.
    pub fn track_window(&mut self) -> Call<'_, U, D, (), K> {
        self.stream(Command::TrackWindow)
    }

    /// The next packet of tracking or frame differencing. `None`: under packet filter, nothing
    /// is tracked and nothing was sent.
    pub fn next_tracking(&mut self) -> Call<'_, U, D, Option<Tracking>, K> {
        self.call(Request::Next, tracking)
    }

    /// The next packet of any stream.
    pub fn next_packet(&mut self) -> Call<'_, U, D, Option<Packet>, K> {
        self.call(Request::Next, packet)
    }

    /// Sets the bounds without tracking.
    pub fn set_bounds(&mut self, bounds: ColourBounds) -> Call<'_, U, D, (), K> {
        self.simple(Command::SetBounds(bounds))
    }

    /// The bounds that the camera has.
    pub fn tracking_bounds(&mut self) -> Call<'_, U, D, ColourBounds, K> {
        self.ask(Command::GetTrackingBounds, bounds)
    }

    /// Tracks what is outside the bounds.
    pub fn track_invert(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::TrackInvert(on))
    }

    /// How many consecutive pixels it takes to count; 2 after a reset.
    pub fn noise_filter(&mut self, pixels: u8) -> Call<'_, U, D, (), K> {
        self.simple(Command::NoiseFilter(pixels))
    }

    /// Processes vertical edges instead of colours.
    pub fn pixel_difference(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::PixelDifference(on))
    }
}

/// Window and resolution.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Processes only this part of the frame, or all of it. A shorter window raises the rate.
    pub fn virtual_window(&mut self, window: Option<Window>) -> Call<'_, U, D, (), K> {
        self.simple(Command::VirtualWindow(window))
    }

    /// The window that the camera has.
    pub fn current_window(&mut self) -> Call<'_, U, D, Window, K> {
        self.ask(Command::GetWindow, window)
    }

    /// 176 x 255 instead of 88 x 143 (OV6620 only).
    pub fn high_resolution(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::HighResolution(on))
    }

    /// Counts only every so many columns and rows.
    pub fn down_sample(&mut self, sampling: DownSampling) -> Call<'_, U, D, (), K> {
        self.simple(Command::DownSample(sampling))
    }
}

/// What is sent, and when.
impl<U, D, K> Cmucam2<U, D, K> {
    /// One packet for each that is asked for, instead of a stream.
    pub fn poll_mode(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::PollMode(on))
    }

    /// Holds one frame, so that several commands see the same.
    pub fn buffer_mode(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::BufferMode(on))
    }

    /// Reads a new frame into the buffer.
    pub fn read_frame(&mut self) -> Call<'_, U, D, (), K> {
        self.simple(Command::ReadFrame)
    }

    /// Delay between two characters, bit times, for hosts without a receive buffer.
    pub fn character_delay(&mut self, bit_times: u8) -> Call<'_, U, D, (), K> {
        self.simple(Command::CharacterDelay(bit_times))
    }
}

/// Colours of the window.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Mean colour and deviation of the window, once.
    pub fn mean(&mut self) -> Call<'_, U, D, Statistics, K> {
        self.ask(Command::GetMean, statistics)
    }

    /// Mean colour and deviation as a stream, for [`Cmucam2::next_packet`].
    pub fn stream_mean(&mut self) -> Call<'_, U, D, (), K> {
        self.stream(Command::GetMean)
    }
}

/// Frame differencing (thesis 2.5): load the empty scene, then track what differs from it.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Takes the reference frame.
    pub fn load_frame(&mut self) -> Call<'_, U, D, (), K> {
        self.simple(Command::LoadFrame)
    }

    /// Tracks what differs by more than the threshold (5 to 20 is usual) from the reference frame:
    /// [`Cmucam2::next_tracking`] tells where it is, in blocks.
    pub fn track_difference(&mut self, threshold: u8) -> Call<'_, U, D, (), K> {
        self.stream(Command::FrameDifference(threshold))
    }

    /// The channel that is looked at; green after a reset.
    pub fn difference_channel(&mut self, channel: ColourChannel) -> Call<'_, U, D, (), K> {
        self.simple(Command::DifferenceChannel(channel))
    }

    /// A grid of 16 x 16 blocks instead of 8 x 8.
    pub fn high_resolution_difference(&mut self, on: bool) -> Call<'_, U, D, (), K> {
        self.simple(Command::HighResolutionDifference(on))
    }

    /// From now on ignores the blocks that differ by more than the threshold.
    pub fn mask_difference(&mut self, threshold: u8) -> Call<'_, U, D, (), K> {
        self.simple(Command::MaskDifference(threshold))
    }
}

/// The five servo outputs.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Moves a servo.
    pub fn servo_position(
        &mut self,
        servo: Servo,
        position: ServoPosition,
    ) -> Call<'_, U, D, (), K> {
        self.simple(Command::ServoPosition(servo, position))
    }

    /// Where a servo is.
    pub fn servo(&mut self, servo: Servo) -> Call<'_, U, D, u8, K> {
        self.ask(Command::GetServo(servo), value)
    }

    /// How pan and tilt follow the target.
    pub fn servo_parameters(&mut self, parameters: ServoParameters) -> Call<'_, U, D, (), K> {
        self.simple(Command::ServoParameters(parameters))
    }
}
