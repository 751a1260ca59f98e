//! Everything that commands set, with the values after a reset.

use super::{
    colour::{Bounds, LEVEL_MAX, LEVEL_MIN},
    sensor::{Sensor, Size},
    switches::Switches,
    view::Region,
};

/// Sensor registers whose effect is known.
pub(super) mod register {
    pub(crate) const CONTRAST: u8 = 5;
    pub(crate) const BRIGHTNESS: u8 = 6;
    pub(crate) const EXPOSURE: u8 = 16;
    pub(crate) const CLOCK: u8 = 17;
    pub(crate) const COLOUR_MODE: u8 = 18;
    pub(crate) const AUTO_GAIN: u8 = 19;
}

/// Servo outputs.
const SERVOS: usize = 5;
/// The middle of a servo's travel.
const SERVO_CENTRE: u8 = 128;

/// Registers after a reset. The values of 5, 6 and 16 stand for "no change of the picture".
const REGISTERS: [(u8, u8); 6] = [
    (register::CONTRAST, 128),
    (register::BRIGHTNESS, 128),
    (register::EXPOSURE, 128),
    (register::CLOCK, 0),
    (register::COLOUR_MODE, 40),
    (register::AUTO_GAIN, 33),
];

/// Number of registers of the sensor.
const REGISTER_COUNT: usize = 256;

/// Use of a servo pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServoPin {
    /// It holds this position, 46 to 210.
    Position(u8),
    /// It is a digital output.
    Output(bool),
}

impl ServoPin {
    /// A position as far as the servo goes.
    pub(super) fn at(position: u8) -> Self {
        Self::Position(position.clamp(46, 210))
    }
}

/// Way in which the camera follows a target along one axis: beyond `far` pixels from the middle by `step`, beyond
/// `near` by half of that.
#[derive(Clone, Copy, Debug)]
pub(super) struct ServoAxis {
    pub(super) far: u8,
    pub(super) near: u8,
    pub(super) step: u8,
}

/// Actions of the camera on pan and tilt (`SM`): the bits of CMU's firmware.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ServoMask(pub(super) u8);

impl ServoMask {
    pub(super) fn controls(self, servo: u8) -> bool {
        self.0 >> servo & 1 != 0
    }

    pub(super) fn reports(self, servo: u8) -> bool {
        self.0 >> (2 + servo) & 1 != 0
    }
}

/// Raw mode (`RM`).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RawMode(pub(super) u8);

impl RawMode {
    pub(super) fn output(self) -> bool {
        self.0 & 1 != 0
    }

    pub(super) fn suppresses_replies(self) -> bool {
        self.0 & 2 != 0
    }

    pub(super) fn input(self) -> bool {
        self.0 & 4 != 0
    }
}

/// Settings of the camera.
#[derive(Clone, Debug)]
pub struct Modes {
    pub(super) sensor: Sensor,
    pub(super) power: bool,
    pub(super) high_resolution: bool,
    pub(super) down_sampling: [u8; 2],
    pub(super) window: Option<[u8; 4]>,
    registers: [u8; REGISTER_COUNT],
    pub(super) buffer: bool,
    pub(super) difference_channel: u8,
    pub(super) fine_grid: bool,
    pub(super) histogram_bins: u8,
    pub(super) histogram_scale: u8,
    pub(super) histogram_tracked: bool,
    pub(super) frame_stream: bool,
    /// States of the two LEDs: 0 off, 1 on, 2 as the camera likes.
    pub leds: [u8; 2],
    /// Line modes of tracking, of statistics and of frame differencing.
    pub(super) line_modes: [u8; 3],
    pub(super) noise_filter: u8,
    pub(super) tracking_mask: u8,
    pub(super) statistics_mask: u8,
    pub(super) pixel_difference: bool,
    pub(super) packet_filter: bool,
    pub(super) poll: bool,
    pub(super) packet_skip: u8,
    pub(super) servo_mask: ServoMask,
    pub(super) servo_axes: [ServoAxis; 2],
    /// Uses of the servo pins.
    pub servos: [ServoPin; SERVOS],
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
            down_sampling: [1; 2],
            window: None,
            registers: [0; REGISTER_COUNT],
            buffer: false,
            difference_channel: 1,
            fine_grid: false,
            histogram_bins: super::statistics::BINS,
            histogram_scale: 0,
            histogram_tracked: false,
            frame_stream: false,
            leds: [2; 2],
            line_modes: [0; 3],
            noise_filter: 2,
            tracking_mask: 0xFF,
            statistics_mask: 0xFF,
            pixel_difference: false,
            packet_filter: false,
            poll: false,
            packet_skip: 0,
            servo_mask: ServoMask::default(),
            servo_axes: [axis; 2],
            servos: [ServoPin::Position(SERVO_CENTRE); SERVOS],
            bounds: Bounds([
                LEVEL_MIN, LEVEL_MAX, LEVEL_MIN, LEVEL_MAX, LEVEL_MIN, LEVEL_MAX,
            ]),
            invert: false,
            raw: RawMode::default(),
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

    pub(super) fn set_register(&mut self, register: u8, value: u8) {
        self.registers[usize::from(register)] = value;
    }

    /// The value of a sensor register.
    pub fn register(&self, register: u8) -> u8 {
        self.registers[usize::from(register)]
    }

    pub(super) fn auto_gain(&self) -> bool {
        self.register(register::AUTO_GAIN) & 1 != 0
    }

    pub(super) fn auto_white_balance(&self) -> bool {
        self.register(register::COLOUR_MODE) & 4 != 0
    }

    pub(super) fn luminance_chrominance(&self) -> bool {
        self.register(register::COLOUR_MODE) & 8 == 0
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
        let Size { width, height } = self.sensor_frame(switches);
        let [x, y] = self.down_sampling;
        Size {
            width: width.div_ceil(x),
            height: height.div_ceil(y),
        }
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
        let [x1, y1, x2, y2] = window.map(|corner| corner.saturating_sub(switches.origin));
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
        let time = SECOND / u64::from(frames_per_second(self.register(register::CLOCK)));
        if switches.window_rate == 0 {
            return time;
        }
        let rows = u64::from(self.region(switches).height());
        let all = u64::from(self.frame(switches).height);
        (time * rows / all).max(time / FASTEST_SHARE)
    }

    /// Answer of a servo pin when asked for its position.
    pub(super) fn servo_value(&self, servo: usize) -> u8 {
        match self.servos[servo] {
            ServoPin::Position(position) => position,
            ServoPin::Output(high) => u8::from(high),
        }
    }
}

const SECOND: u64 = 1_000_000_000;

/// Frames a second by clock divider; dividers that the reference does not list lie between their neighbours.
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
