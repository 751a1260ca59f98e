//! Everything that commands set, with the values after a reset.

use cmucam2_driver::{
    colour::{ColourBounds, ColourChannel},
    command::{LedMode, RawMode, StatisticsLines, StatisticsMask, TrackingLines},
    geometry::{DownSampling, Sensor, Size, Window},
    register::Register,
    servo::{SERVOS, ServoAxis, ServoMask, ServoParameters, ServoPosition},
};

use super::{switches::Switches, view::Region};

/// Registers after a reset. The values of 5, 6 and 16 stand for "no change of the picture".
const REGISTERS: [(Register, u8); 6] = [
    (Register::CONTRAST, 128),
    (Register::BRIGHTNESS, 128),
    (Register::EXPOSURE, 128),
    (Register::CLOCK, 0),
    (Register::COLOUR_MODE, 40),
    (Register::AUTO_GAIN, 33),
];

/// How many registers the sensor has.
const REGISTER_COUNT: usize = 256;

/// What a servo pin does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServoPin {
    /// It holds this position.
    Position(ServoPosition),
    /// It is a digital output.
    Output(bool),
}

/// The bounds of colour tracking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bounds {
    Colours(ColourBounds),
    /// Accepted although a lower bound is above its upper one.
    Nothing([u8; 6]),
}

impl Bounds {
    pub(super) fn values(self) -> [u8; 6] {
        match self {
            Self::Colours(bounds) => bounds.values(),
            Self::Nothing(values) => values,
        }
    }
}

/// What was set.
#[derive(Clone, Debug)]
pub struct Modes {
    pub(super) sensor: Sensor,
    pub(super) power: bool,
    pub(super) high_resolution: bool,
    pub(super) down_sampling: DownSampling,
    pub(super) window: Option<Window>,
    registers: [u8; REGISTER_COUNT],
    pub(super) buffer: bool,
    pub(super) difference_channel: ColourChannel,
    pub(super) fine_grid: bool,
    pub(super) histogram_bins: u8,
    pub(super) histogram_scale: u8,
    pub(super) histogram_tracked: bool,
    pub(super) frame_stream: bool,
    /// What the two LEDs do.
    pub leds: [LedMode; 2],
    pub(super) tracking_lines: TrackingLines,
    pub(super) statistics_lines: StatisticsLines,
    pub(super) noise_filter: u8,
    pub(super) tracking_mask: u8,
    pub(super) statistics_mask: StatisticsMask,
    pub(super) pixel_difference: bool,
    pub(super) packet_filter: bool,
    pub(super) poll: bool,
    pub(super) packet_skip: u8,
    pub(super) servo_mask: ServoMask,
    pub(super) servo_parameters: ServoParameters,
    /// What the servo pins do.
    pub servos: [ServoPin; SERVOS as usize],
    pub(super) bounds: Bounds,
    pub(super) invert: bool,
    pub(super) raw: RawMode,
}

impl Modes {
    /// After a reset of a camera with this sensor.
    pub(super) fn new(sensor: Sensor) -> Self {
        let axis = ServoAxis {
            far: 16,
            near: 8,
            step: 5,
        };
        let mut modes = Self {
            sensor,
            power: true,
            high_resolution: false,
            down_sampling: DownSampling::NONE,
            window: None,
            registers: [0; REGISTER_COUNT],
            buffer: false,
            difference_channel: ColourChannel::Green,
            fine_grid: false,
            histogram_bins: super::statistics::BINS,
            histogram_scale: 0,
            histogram_tracked: false,
            frame_stream: false,
            leds: [LedMode::Auto; 2],
            tracking_lines: TrackingLines::Off,
            statistics_lines: StatisticsLines::Off,
            noise_filter: 2,
            tracking_mask: 0xFF,
            statistics_mask: StatisticsMask::ALL,
            pixel_difference: false,
            packet_filter: false,
            poll: false,
            packet_skip: 0,
            servo_mask: ServoMask::default(),
            servo_parameters: ServoParameters {
                pan: axis,
                tilt: axis,
            },
            servos: [ServoPin::Position(ServoPosition::CENTRE); SERVOS as usize],
            bounds: Bounds::Colours(ColourBounds::ALL),
            invert: false,
            raw: RawMode::OFF,
        };
        modes.reset_registers();
        modes
    }

    pub(super) fn reset_registers(&mut self) {
        self.registers = [0; REGISTER_COUNT];
        for (register, value) in REGISTERS {
            self.set_register(register, value);
        }
    }

    pub(super) fn set_register(&mut self, register: Register, value: u8) {
        self.registers[usize::from(register.0)] = value;
    }

    /// The value of a sensor register.
    pub fn register(&self, register: Register) -> u8 {
        self.registers[usize::from(register.0)]
    }

    pub(super) fn auto_gain(&self) -> bool {
        self.register(Register::AUTO_GAIN) & 1 != 0
    }

    pub(super) fn auto_white_balance(&self) -> bool {
        self.register(Register::COLOUR_MODE) & 4 != 0
    }

    pub(super) fn luminance_chrominance(&self) -> bool {
        self.register(Register::COLOUR_MODE) & 8 == 0
    }

    /// The sensor's frame, before down-sampling.
    pub(super) fn sensor_frame(&self, switches: &Switches) -> Size {
        let full = Size::of(self.sensor, self.high_resolution);
        let low = self.sensor == Sensor::Ov6620 && !self.high_resolution;
        Size {
            width: full.width - u8::from(low && switches.narrow == 1),
            height: full.height,
        }
    }

    /// The frame in the units of tracking.
    pub(super) fn frame(&self, switches: &Switches) -> Size {
        self.down_sampling.apply(self.sensor_frame(switches))
    }

    /// The part of the frame that is processed.
    pub(super) fn region(&self, switches: &Switches) -> Region {
        let Size { width, height } = self.frame(switches);
        let whole = Region {
            x1: 0,
            y1: 0,
            x2: width - 1,
            y2: height - 1,
        };
        let Some(window) = self.window else {
            return whole;
        };
        let [x1, y1, x2, y2] = window
            .corners()
            .map(|corner| corner.saturating_sub(switches.origin));
        Region {
            x1: x1.min(whole.x2),
            y1: y1.min(whole.y2),
            x2: x2.min(whole.x2),
            y2: y2.min(whole.y2),
        }
    }

    /// Time between two frames, nanoseconds.
    pub(super) fn frame_time(&self, switches: &Switches) -> u64 {
        /// No window makes the sensor faster than this.
        const FASTEST_SHARE: u64 = 8;
        let time = SECOND / u64::from(frames_per_second(self.register(Register::CLOCK)));
        if switches.window_rate == 0 {
            return time;
        }
        let rows = u64::from(self.region(switches).height());
        let all = u64::from(self.frame(switches).height);
        (time * rows / all).max(time / FASTEST_SHARE)
    }

    /// What a servo pin says when asked for its position.
    pub(super) fn servo_value(&self, servo: usize) -> u8 {
        match self.servos[servo] {
            ServoPin::Position(position) => position.get(),
            ServoPin::Output(high) => u8::from(high),
        }
    }
}

const SECOND: u64 = 1_000_000_000;

/// By clock divider; dividers that the reference does not list lie between their neighbours.
fn frames_per_second(divider: u8) -> u8 {
    match divider {
        0 => 50,
        1 => 26,
        2 => 17,
        3 => 13,
        4 => 11,
        5 => 9,
        6 => 8,
        7 => 7,
        8 => 6,
        9..=10 => 5,
        11.. => (50 / (divider.saturating_add(1))).max(1),
    }
}
