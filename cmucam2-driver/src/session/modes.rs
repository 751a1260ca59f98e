//! Settings that were made, so that they can be made again.

use core::ops::Range;

use crate::{
    colour::ColourBounds,
    command::{Effect, Mode, Order, RawMode, Reply, StatisticsMask},
    features::FULL,
    geometry::{DownSampling, Sensor, Size, Window},
    packet::{BINS_MAX, PacketKind},
    parser::{Expectation, ImageKind},
    register::{PAIRS_MAX, Register},
    servo::ServoMask,
};

/// Number of different registers that are remembered.
pub const REGISTERS_MAX: usize = 2 * PAIRS_MAX;

/// A pin has either a position of 46 to 210 or, as an output, 0 or 1: its value tells which.
const SERVO_POSITION: [u8; 2] = *b"SV";
const SERVO_OUTPUT: [u8; 2] = *b"SO";

/// The arguments of all modes, one after the other.
const ARGUMENTS: usize = count(&Mode::COMMANDS);

/// Number of arguments of these modes.
const fn count(mut modes: &[([u8; 2], u8)]) -> usize {
    let mut sum = 0;
    while let [(_, len), others @ ..] = modes {
        sum += *len as usize;
        modes = others;
    }
    sum
}

/// Places of the arguments of a mode.
fn place(mode: usize) -> Option<Range<usize>> {
    let from = count(Mode::COMMANDS.get(..mode)?);
    let to = count(Mode::COMMANDS.get(..=mode)?);
    Some(from..to)
}

/// Everything that a restart of the camera forgets, as far as it was set through the driver.
///
/// The reference frame and mask of frame differencing live only in the camera: they are lost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Modes {
    /// One bit for each [`Mode`] that was set; the others are as after a reset.
    set: u32,
    arguments: [u8; ARGUMENTS],
    registers: [[u8; 2]; REGISTERS_MAX],
    registers_len: u8,
    bounds: Option<ColourBounds>,
}

impl Default for Modes {
    /// A camera after its reset.
    fn default() -> Self {
        Self {
            set: 0,
            arguments: [0; ARGUMENTS],
            registers: [[0; 2]; REGISTERS_MAX],
            registers_len: 0,
            bounds: None,
        }
    }
}

/// Progress of telling a camera its lost modes again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Cursor(u8);

impl Modes {
    /// Takes notice of a command that the camera accepted.
    pub(super) fn remember(&mut self, order: &Order) {
        match order.effect() {
            Effect::Nothing => {}
            Effect::Mode(mode) => self.set(mode, order.arguments()),
            Effect::Registers => self.set_registers(order.arguments()),
            Effect::Bounds => {
                if let Ok(values) = order.arguments().try_into() {
                    self.bounds = ColourBounds::new(values).ok();
                }
            }
            // The camera has chosen bounds that the driver does not know.
            Effect::OwnBounds => self.bounds = None,
            Effect::Reset => *self = Self::default(),
        }
    }

    fn set(&mut self, mode: Mode, arguments: &[u8]) {
        let bit = 1 << mode as u32;
        let default = match mode {
            Mode::TrackingLines
            | Mode::StatisticsLines
            | Mode::PacketFilter
            | Mode::Poll
            | Mode::PacketSkip
            | Mode::ServoMask
            | Mode::Raw => arguments.last() == Some(&0),
            _ => arguments.is_empty(),
        };
        if default {
            self.set &= !bit;
            return;
        }
        self.set |= bit;
        let places = place(mode as usize).and_then(|place| self.arguments.get_mut(place));
        match places {
            Some(places) if places.len() == arguments.len() => places.copy_from_slice(arguments),
            _ => debug_assert!(false, "{mode:?} has other arguments than {arguments:?}"),
        }
    }

    fn get(&self, mode: usize) -> Option<&[u8]> {
        if self.set >> mode & 1 == 0 {
            return None;
        }
        self.arguments.get(place(mode)?)
    }

    /// The last argument of a mode that was set.
    fn value(&self, mode: Mode) -> Option<u8> {
        self.get(mode as usize)?.last().copied()
    }

    fn set_registers(&mut self, numbers: &[u8]) {
        if numbers.is_empty() {
            self.registers_len = 0;
        }
        for &[register, value] in numbers.as_chunks::<2>().0 {
            let len = usize::from(self.registers_len);
            let known = self
                .registers
                .iter_mut()
                .take(len)
                .find(|[number, _]| *number == register);
            if let Some([_, known]) = known {
                *known = value;
            } else if let Some(free) = self.registers.get_mut(len) {
                *free = [register, value];
                self.registers_len += 1;
            }
        }
    }

    /// Returns true if all of these registers can be remembered.
    pub(super) fn has_room(&self, order: &Order) -> bool {
        if order.effect() != Effect::Registers {
            return true;
        }
        let (pairs, _) = order.arguments().as_chunks::<2>();
        let known = |pair: &&[u8; 2]| self.register(Register(pair[0])).is_some();
        let new = pairs.len() - pairs.iter().filter(known).count();
        usize::from(self.registers_len) + new <= REGISTERS_MAX
    }

    /// The value that a register was set to.
    pub fn register(&self, register: Register) -> Option<u8> {
        self.registers
            .iter()
            .take(usize::from(self.registers_len))
            .find(|[number, _]| *number == register.0)
            .map(|&[_, value]| value)
    }

    /// The next of the commands that bring a camera from its reset to these modes: the camera type, the
    /// registers, the other modes, and between them, before the commands that use them, the bounds.
    pub(super) fn next(&self, cursor: &mut Cursor) -> Option<Order> {
        const REGISTERS: u8 = Mode::HighResolution as u8;
        const MORE_REGISTERS: u8 = REGISTERS + 1;
        const MODES: u8 = MORE_REGISTERS + 1;
        const BOUNDS: u8 = Mode::Invert as u8 + 2;
        const AFTER_BOUNDS: u8 = BOUNDS + 1;
        const LAST: u8 = Mode::Raw as u8 + 3;
        loop {
            let at = cursor.0;
            cursor.0 = at + 1;
            let order = match at {
                0..REGISTERS => self.mode(at),
                REGISTERS => self.registers(0),
                MORE_REGISTERS => self.registers(PAIRS_MAX),
                MODES..BOUNDS => self.mode(at - 2),
                BOUNDS => self
                    .bounds
                    .map(|bounds| Order::set_bounds(&bounds.values())),
                AFTER_BOUNDS..=LAST => self.mode(at - 3),
                _ => {
                    cursor.0 = at;
                    return None;
                }
            };
            if order.is_some() {
                return order;
            }
        }
    }

    fn mode(&self, mode: u8) -> Option<Order> {
        let arguments = self.get(usize::from(mode))?;
        let &(letters, _) = Mode::COMMANDS.get(usize::from(mode))?;
        let letters = match arguments {
            [_, 0 | 1] if FULL && letters == SERVO_POSITION => SERVO_OUTPUT,
            _ => letters,
        };
        Some(Order::bare(&letters, Reply::Nothing, Effect::Nothing).with(arguments))
    }

    fn registers(&self, from: usize) -> Option<Order> {
        let known = self.registers.get(..usize::from(self.registers_len))?;
        let chunk = known.get(from..known.len().min(from + PAIRS_MAX))?;
        if chunk.is_empty() {
            return None;
        }
        let order = Order::bare(b"CR", Reply::Nothing, Effect::Nothing);
        Some(order.with(chunk.as_flattened()))
    }

    /// The bounds that the camera tracks, if they are known.
    pub fn bounds(&self) -> Option<ColourBounds> {
        self.bounds
    }

    /// The bounds that the camera says it has.
    pub(super) fn set_bounds(&mut self, bounds: ColourBounds) {
        self.bounds = Some(bounds);
    }

    /// The part of the frame that is processed, or all of it.
    pub fn window(&self) -> Option<Window> {
        match self.get(Mode::Window as usize)? {
            &[x, y, x2, y2] => Window::new(x, y, x2, y2).ok(),
            _ => None,
        }
    }

    /// One packet for each command.
    pub fn poll(&self) -> bool {
        self.value(Mode::Poll).is_some()
    }

    /// Silence while nothing is tracked.
    pub fn packet_filter(&self) -> bool {
        FULL && self.value(Mode::PacketFilter).is_some()
    }

    /// Packets skipped between two that are sent.
    pub fn packet_skip(&self) -> u8 {
        match self.value(Mode::PacketSkip) {
            Some(packets) if FULL => packets,
            _ => 0,
        }
    }

    /// Returns true if one frame follows the other.
    pub(super) fn frame_stream(&self) -> bool {
        FULL && self.value(Mode::FrameStream) == Some(1)
    }

    /// The frame after down-sampling, for a sensor that the banner named.
    pub fn frame(&self, sensor: Option<Sensor>) -> Size {
        let told = self.value(Mode::CameraType).map(|number| match number {
            0 => Sensor::Ov6620,
            _ => Sensor::Ov7620,
        });
        let full = match told.or(sensor) {
            Some(sensor) => Size::of(sensor, self.value(Mode::HighResolution) == Some(1)),
            None => Size::LARGEST,
        };
        match self.get(Mode::DownSampling as usize) {
            Some(&[x, y]) => DownSampling::new(x, y).map_or(full, |sampling| sampling.apply(full)),
            _ => full,
        }
    }

    /// Expected bytes after a command.
    pub(super) fn expectation(
        &self,
        order: &Order,
        sensor: Option<Sensor>,
        strict: bool,
    ) -> Expectation {
        let reply = order.reply();
        let difference = reply == Reply::Packets(PacketKind::Difference);
        let grid = match self.value(Mode::DifferenceGrid) {
            Some(1) => 16,
            _ => 8,
        };
        let mut expectation = Expectation {
            frame: if difference {
                Size::new(grid, grid)
            } else {
                self.frame(sensor)
            },
            values: match reply {
                Reply::Values(count) => count,
                _ => 0,
            },
            strict: strict && reply == Reply::Packets(PacketKind::Tracking),
            ..Expectation::default()
        };
        if FULL {
            self.expect_formats(order, &mut expectation);
        }
        expectation
    }

    /// Effect of other modes on packets and images.
    fn expect_formats(&self, order: &Order, expectation: &mut Expectation) {
        let reply = order.reply();
        expectation.tracking = self.value(Mode::TrackingMask).unwrap_or(0xFF);
        // Only colour tracking reports servos.
        if reply != Reply::Packets(PacketKind::Difference) {
            let told = self.value(Mode::ServoMask);
            let servos = told.and_then(|bits| ServoMask::new(bits).ok());
            expectation.servos = servos.unwrap_or_default();
        }
        expectation.statistics = self
            .value(Mode::StatisticsMask)
            .and_then(|bits| StatisticsMask::new(bits).ok())
            .unwrap_or(StatisticsMask::ALL);
        expectation.bins = match self.value(Mode::Histogram) {
            Some(_) => None,
            None => Some(BINS_MAX as u8),
        };
        let lines = match reply {
            Reply::Packets(PacketKind::Tracking) => self.value(Mode::TrackingLines),
            Reply::Packets(PacketKind::Statistics) => self.value(Mode::StatisticsLines),
            _ => None,
        };
        expectation.image = match (reply, lines) {
            (Reply::Frame, _) if order.arguments().is_empty() => Some(ImageKind::Frame(3)),
            (Reply::Frame, _) => Some(ImageKind::Frame(1)),
            (Reply::Packets(PacketKind::Tracking), Some(1)) => Some(ImageKind::Bitmap),
            (Reply::Packets(PacketKind::Tracking), Some(2)) => Some(ImageKind::Rows),
            (_, Some(1)) => Some(ImageKind::Means(3)),
            (_, Some(2)) => Some(ImageKind::Means(6)),
            _ => None,
        };
        expectation.raw = self
            .value(Mode::Raw)
            .and_then(|bits| RawMode::new(bits).ok())
            .unwrap_or_default()
            .output();
    }
}
