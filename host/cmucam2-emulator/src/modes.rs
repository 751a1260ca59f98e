//! Everything that commands set, with the values after a reset.

use std::collections::BTreeMap;

use super::{
    colour::{Bounds, LEVEL_MAX, LEVEL_MIN},
    command::{COMMANDS, Command, Row},
    sensor::{Sensor, Size},
    statistics::BINS,
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

/// Bins that the numbers 0, 1 and 2 of `HC` select, if they do not mean themselves.
const SELECTED_BINS: [u8; 3] = [BINS, BINS / 2, BINS / 4];

/// Number of registers of the sensor.
const REGISTER_COUNT: usize = 256;

/// A position as far as a servo goes.
pub(super) fn servo_position(position: u8) -> u8 {
    position.clamp(46, 210)
}

/// Settings of the camera.
#[derive(Clone, Debug)]
pub(super) struct Modes {
    /// The last arguments of each command, by its letters as one number: they are looked up for every byte that comes.
    told: BTreeMap<u16, Vec<u8>>,
    pub(super) sensor: Sensor,
    registers: [u8; REGISTER_COUNT],
    /// Line modes of tracking, of statistics and of frame differencing.
    pub(super) line_modes: [u8; 3],
    /// Output masks of tracking and of statistics.
    pub(super) masks: [u8; 2],
    /// The servo pins: a position, or 0 or 1 of a digital output.
    pub(super) servos: [u8; SERVOS],
    pub(super) bounds: Bounds,
}

impl Modes {
    /// After a reset of a camera with this sensor.
    pub(super) fn new(sensor: Sensor) -> Self {
        let reset = |&(letters, _, reset): &Row| (u16::from_be_bytes(*letters), reset.to_vec());
        let mut modes = Self {
            told: COMMANDS.iter().map(reset).collect(),
            sensor,
            registers: [0; REGISTER_COUNT],
            line_modes: [0; 3],
            masks: [0xFF; 2],
            servos: [SERVO_CENTRE; SERVOS],
            bounds: Bounds([
                LEVEL_MIN, LEVEL_MAX, LEVEL_MIN, LEVEL_MAX, LEVEL_MIN, LEVEL_MAX,
            ]),
        };
        modes.reset_registers();
        modes
    }

    /// Sets what a command sets.
    pub(super) fn tell(&mut self, command: &Command) {
        self.told.insert(
            u16::from_be_bytes(command.letters),
            command.arguments.clone(),
        );
    }

    /// The whole frame again.
    pub(super) fn open_window(&mut self) {
        self.told.remove(&u16::from_be_bytes(*b"VW"));
    }

    /// The arguments that the command of these letters has set.
    pub(super) fn told(&self, letters: &[u8; 2]) -> &[u8] {
        let told = self.told.get(&u16::from_be_bytes(*letters));
        told.map_or(&[], Vec::as_slice)
    }

    /// The same of a command with one argument.
    pub(super) fn number(&self, letters: &[u8; 2]) -> u8 {
        self.told(letters).first().copied().unwrap_or(0)
    }

    pub(super) fn is_on(&self, letters: &[u8; 2]) -> bool {
        self.number(letters) != 0
    }

    fn bit(&self, letters: &[u8; 2], bit: u8) -> bool {
        self.number(letters) >> bit & 1 != 0
    }

    /// Packets, and perhaps values, are binary.
    pub(super) fn raw_output(&self) -> bool {
        self.bit(b"RM", 0)
    }

    pub(super) fn suppresses_replies(&self) -> bool {
        self.bit(b"RM", 1)
    }

    pub(super) fn raw_input(&self) -> bool {
        self.bit(b"RM", 2)
    }

    /// Actions of the camera on pan (0) and tilt (1): the bits of CMU's firmware.
    pub(super) fn controls(&self, servo: u8) -> bool {
        self.bit(b"SM", servo)
    }

    pub(super) fn reports(&self, servo: u8) -> bool {
        self.bit(b"SM", 2 + servo)
    }

    /// Bins of a histogram, and the number of times that their counts are doubled.
    pub(super) fn histogram(&self, switches: &Switches) -> (u8, u8) {
        let told = self.told(b"HC");
        let bins = match told.first() {
            None => BINS,
            Some(&bins) if switches.histogram_bins == 1 => bins.clamp(1, BINS),
            Some(&place) => SELECTED_BINS[usize::from(place).min(SELECTED_BINS.len() - 1)],
        };
        (bins, told.get(1).copied().unwrap_or(0))
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
    pub(super) fn register(&self, register: u8) -> u8 {
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
        let high = self.is_on(b"HR");
        let full = Size::of(self.sensor, high);
        let low = self.sensor == Sensor::Ov6620 && !high;
        Size::new(
            full.width - u8::from(low && switches.narrow == 1),
            full.height,
        )
    }

    /// The frame in the units of tracking.
    pub(super) fn frame(&self, switches: &Switches) -> Size {
        let Size { width, height } = self.sensor_frame(switches);
        let [x, y] = self.down_sampling();
        Size::new(width.div_ceil(x), height.div_ceil(y))
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
        let Ok(window) = <[u8; 4]>::try_from(self.told(b"VW")) else {
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

    /// Distance between two columns that count, and between two rows.
    pub(super) fn down_sampling(&self) -> [u8; 2] {
        self.told(b"DS").try_into().unwrap_or([1; 2])
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
