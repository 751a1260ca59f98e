//! What was set, so that it can be set again.

use crate::{
    colour::{Channel, ColourBounds},
    command::{
        Command, LedMode, LineMode, OutputMask, RawMode, Reply, StatisticsLines, StatisticsMask,
        TrackingLines,
    },
    geometry::{DownSampling, Sensor, Size, Window},
    packet::{BINS_MAX, PacketKind, TrackingFields},
    parser::{Expectation, ImageExpectation},
    register::{PAIRS_MAX, Register, Registers},
    servo::{SERVOS, Servo, ServoMask, ServoParameters, ServoPosition},
};

/// How many different registers are remembered.
pub const REGISTERS_MAX: usize = 2 * PAIRS_MAX;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
enum ServoPin {
    #[default]
    Default,
    Position(ServoPosition),
    Output(bool),
}

/// Everything that a restart of the camera forgets, as far as it was set through the driver.
/// `None` is the default that the camera starts with.
///
/// The reference frame and mask of frame differencing live only in the camera: they are lost.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Modes {
    camera_type: Option<Sensor>,
    power: Option<bool>,
    high_resolution: Option<bool>,
    down_sampling: Option<DownSampling>,
    window: Option<Window>,
    registers: [(u8, u8); REGISTERS_MAX],
    registers_len: u8,
    buffer: Option<bool>,
    difference_channel: Option<Channel>,
    character_delay: Option<u8>,
    difference_grid: Option<bool>,
    histogram: Option<(u8, u8)>,
    histogram_tracked: Option<bool>,
    frame_stream: Option<bool>,
    led0: Option<LedMode>,
    led1: Option<LedMode>,
    tracking_lines: TrackingLines,
    statistics_lines: StatisticsLines,
    noise_filter: Option<u8>,
    tracking_mask: Option<u8>,
    statistics_mask: Option<StatisticsMask>,
    pixel_difference: Option<bool>,
    packet_filter: bool,
    poll: bool,
    packet_skip: u8,
    servo_mask: ServoMask,
    servo_parameters: Option<ServoParameters>,
    servos: [ServoPin; SERVOS as usize],
    bounds: Option<ColourBounds>,
    invert: Option<bool>,
    raw: RawMode,
}

/// How many commands it takes at most to set everything again: see [`Modes::command`].
const SLOTS: u8 = 35;

impl Modes {
    /// Takes notice of a command that the camera accepted.
    pub(crate) fn remember(&mut self, command: &Command) {
        match *command {
            Command::CameraType(sensor) => self.camera_type = Some(sensor),
            Command::CameraPower(on) => self.power = Some(on),
            Command::HighResolution(on) => self.high_resolution = Some(on),
            Command::DownSample(sampling) => self.down_sampling = Some(sampling),
            Command::VirtualWindow(window) => self.window = window,
            Command::Registers(registers) => self.remember_registers(&registers),
            Command::BufferMode(on) => self.buffer = Some(on),
            Command::DifferenceChannel(channel) => self.difference_channel = Some(channel),
            Command::CharacterDelay(delay) => self.character_delay = Some(delay),
            Command::HighResolutionDifference(on) => self.difference_grid = Some(on),
            Command::HistogramConfiguration { bins, scale } => self.histogram = Some((bins, scale)),
            Command::HistogramTracked(on) => self.histogram_tracked = Some(on),
            Command::FrameStream(on) => self.frame_stream = Some(on),
            Command::Led0(mode) => self.led0 = Some(mode),
            Command::Led1(mode) => self.led1 = Some(mode),
            Command::LineMode(LineMode::Tracking(lines)) => self.tracking_lines = lines,
            Command::LineMode(LineMode::Statistics(lines)) => self.statistics_lines = lines,
            Command::NoiseFilter(pixels) => self.noise_filter = Some(pixels),
            Command::OutputMask(OutputMask::Tracking(mask)) => self.tracking_mask = Some(mask),
            Command::OutputMask(OutputMask::Statistics(mask)) => {
                self.statistics_mask = Some(mask);
            }
            Command::PixelDifference(on) => self.pixel_difference = Some(on),
            Command::PacketFilter(on) => self.packet_filter = on,
            Command::PollMode(on) => self.poll = on,
            Command::PacketSkip(packets) => self.packet_skip = packets,
            Command::ServoMask(mask) => self.servo_mask = mask,
            Command::ServoParameters(parameters) => self.servo_parameters = Some(parameters),
            Command::ServoPosition(servo, position) => {
                self.remember_servo(servo, ServoPin::Position(position));
            }
            Command::ServoOutput(servo, high) => {
                self.remember_servo(servo, ServoPin::Output(high));
            }
            Command::SetBounds(bounds) | Command::TrackColour(Some(bounds)) => {
                self.bounds = Some(bounds);
            }
            // The camera has chosen bounds that are not known here.
            Command::TrackWindow => self.bounds = None,
            Command::TrackInvert(on) => self.invert = Some(on),
            Command::RawMode(mode) => self.raw = mode,
            Command::Reset => *self = Self::default(),
            Command::Idle
            | Command::FrameDifference(_)
            | Command::GetButton
            | Command::GetHistogram(_)
            | Command::GetInputs
            | Command::GetMean
            | Command::GetServo(_)
            | Command::GetTrackingBounds
            | Command::GetVersion
            | Command::GetWindow
            | Command::LoadFrame
            | Command::MaskDifference(_)
            | Command::ReadFrame
            | Command::DeepSleep
            | Command::SendFrame(_)
            | Command::Sleep
            | Command::TrackColour(None)
            | Command::UploadDifference => {}
        }
    }

    fn remember_servo(&mut self, servo: Servo, pin: ServoPin) {
        if let Some(known) = self.servos.get_mut(usize::from(servo.number())) {
            *known = pin;
        }
    }

    fn remember_registers(&mut self, registers: &Registers) {
        if registers.is_empty() {
            self.registers_len = 0;
        }
        for (register, value) in registers.iter() {
            let len = usize::from(self.registers_len);
            let known = self
                .registers
                .iter_mut()
                .take(len)
                .find(|(number, _)| *number == register.0);
            if let Some((_, known)) = known {
                *known = value;
            } else if let Some(free) = self.registers.get_mut(len) {
                *free = (register.0, value);
                self.registers_len += 1;
            }
        }
    }

    /// Whether all of these can be remembered.
    pub(crate) fn has_room(&self, registers: &Registers) -> bool {
        let mut next = self.clone();
        next.remember_registers(registers);
        registers
            .iter()
            .all(|(register, value)| next.register(register) == Some(value))
    }

    /// The value that a register was set to.
    pub fn register(&self, register: Register) -> Option<u8> {
        self.registers
            .iter()
            .take(usize::from(self.registers_len))
            .find(|(number, _)| *number == register.0)
            .map(|&(_, value)| value)
    }

    /// The commands that bring a camera from its reset to these modes.
    pub(crate) fn command(&self, cursor: &mut u8) -> Option<Command> {
        while *cursor < SLOTS {
            let slot = *cursor;
            *cursor += 1;
            if let Some(command) = self.slot(slot) {
                return Some(command);
            }
        }
        None
    }

    /// What the frame is comes first, because windows count in its pixels. The sensor may
    /// only be switched off when all else is set.
    fn slot(&self, slot: u8) -> Option<Command> {
        match slot {
            0 => self.camera_type.map(Command::CameraType),
            1 => self.registers(0),
            2 => self.registers(PAIRS_MAX),
            3 => self.high_resolution.map(Command::HighResolution),
            4 => self.down_sampling.map(Command::DownSample),
            5 => self
                .window
                .map(|window| Command::VirtualWindow(Some(window))),
            6 => self.buffer.map(Command::BufferMode),
            7 => self.difference_channel.map(Command::DifferenceChannel),
            8 => self.character_delay.map(Command::CharacterDelay),
            9 => self.difference_grid.map(Command::HighResolutionDifference),
            10 => self
                .histogram
                .map(|(bins, scale)| Command::HistogramConfiguration { bins, scale }),
            11 => self.histogram_tracked.map(Command::HistogramTracked),
            12 => self.frame_stream.map(Command::FrameStream),
            13 => self.led0.map(Command::Led0),
            14 => self.led1.map(Command::Led1),
            15 => (self.tracking_lines != TrackingLines::Off)
                .then_some(Command::LineMode(LineMode::Tracking(self.tracking_lines))),
            16 => (self.statistics_lines != StatisticsLines::Off).then_some(Command::LineMode(
                LineMode::Statistics(self.statistics_lines),
            )),
            17 => self.noise_filter.map(Command::NoiseFilter),
            18 => self
                .tracking_mask
                .map(|mask| Command::OutputMask(OutputMask::Tracking(mask))),
            19 => self
                .statistics_mask
                .map(|mask| Command::OutputMask(OutputMask::Statistics(mask))),
            20 => self.pixel_difference.map(Command::PixelDifference),
            21 => self.packet_filter.then_some(Command::PacketFilter(true)),
            22 => self.poll.then_some(Command::PollMode(true)),
            23 => (self.packet_skip > 0).then_some(Command::PacketSkip(self.packet_skip)),
            24 => self.servo_parameters.map(Command::ServoParameters),
            25 => (self.servo_mask != ServoMask::default())
                .then_some(Command::ServoMask(self.servo_mask)),
            26..=30 => self.servo(slot - 26),
            31 => self.bounds.map(Command::SetBounds),
            32 => self.invert.map(Command::TrackInvert),
            33 => self.power.map(Command::CameraPower),
            34 => (self.raw != RawMode::OFF).then_some(Command::RawMode(self.raw)),
            _ => None,
        }
    }

    fn servo(&self, number: u8) -> Option<Command> {
        let servo = Servo::new(number).ok()?;
        match *self.servos.get(usize::from(number))? {
            ServoPin::Default => None,
            ServoPin::Position(position) => Some(Command::ServoPosition(servo, position)),
            ServoPin::Output(high) => Some(Command::ServoOutput(servo, high)),
        }
    }

    fn registers(&self, from: usize) -> Option<Command> {
        let known = self.registers.get(..usize::from(self.registers_len))?;
        let mut chunk = Registers::DEFAULTS;
        for &(register, value) in known.iter().skip(from).take(PAIRS_MAX) {
            chunk.push(Register(register), value).ok()?;
        }
        (!chunk.is_empty()).then_some(Command::Registers(chunk))
    }

    /// The bounds that the camera tracks, if they are known.
    pub fn bounds(&self) -> Option<ColourBounds> {
        self.bounds
    }

    /// The bounds that the camera says it has.
    pub(crate) fn set_bounds(&mut self, bounds: ColourBounds) {
        self.bounds = Some(bounds);
    }

    /// The part of the frame that is processed, or all of it.
    pub fn window(&self) -> Option<Window> {
        self.window
    }

    /// One packet for each command.
    pub fn poll(&self) -> bool {
        self.poll
    }

    /// Silence while nothing is tracked.
    pub fn packet_filter(&self) -> bool {
        self.packet_filter
    }

    /// Packets skipped between two that are sent.
    pub fn packet_skip(&self) -> u8 {
        self.packet_skip
    }

    /// Whether one frame follows the other.
    pub(crate) fn frame_stream(&self) -> bool {
        self.frame_stream == Some(true)
    }

    /// The frame after down-sampling, for a sensor that the banner named.
    pub fn frame(&self, sensor: Option<Sensor>) -> Size {
        let full = match self.camera_type.or(sensor) {
            Some(sensor) => Size::of(sensor, self.high_resolution == Some(true)),
            None => Size::LARGEST,
        };
        self.down_sampling.unwrap_or(DownSampling::NONE).apply(full)
    }

    /// What may come after a command.
    pub(crate) fn expectation(
        &self,
        command: &Command,
        sensor: Option<Sensor>,
        strict: bool,
    ) -> Expectation {
        let reply = command.reply();
        let difference = reply == Reply::Packets(PacketKind::Difference);
        let grid = if self.difference_grid == Some(true) {
            16
        } else {
            8
        };
        Expectation {
            // Only colour tracking reports servos.
            tracking: TrackingFields::new(
                self.tracking_mask.unwrap_or(0xFF),
                if difference {
                    ServoMask::default()
                } else {
                    self.servo_mask
                },
            ),
            statistics: self.statistics_mask.unwrap_or(StatisticsMask::ALL),
            bins: self.histogram.is_none().then_some(BINS_MAX as u8),
            frame: if difference {
                Size {
                    width: grid,
                    height: grid,
                }
            } else {
                self.frame(sensor)
            },
            image: match (reply, command) {
                (Reply::Frame, Command::SendFrame(Some(_))) => ImageExpectation::Frame(1),
                (Reply::Frame, _) => ImageExpectation::Frame(3),
                (Reply::Packets(PacketKind::Tracking), _) => {
                    ImageExpectation::Tracking(self.tracking_lines)
                }
                (Reply::Packets(PacketKind::Statistics), _) => {
                    ImageExpectation::Statistics(self.statistics_lines)
                }
                _ => ImageExpectation::None,
            },
            raw: self.raw.output(),
            values: match reply {
                Reply::Values(count) => count,
                _ => 0,
            },
            strict: strict && reply == Reply::Packets(PacketKind::Tracking),
        }
    }
}
