//! GPIOTE: pins make events, and tasks change pins.

use rigless::soc::Width;

use super::{Call, DONE, Model, gpio};

/// Its address (Product Specification, "Instantiation"), and that of the pins.
pub(crate) const BASE: u64 = 0x4000_6000;
pub(crate) const PINS: u64 = 0x5000_0000;

const CHANNELS: u16 = 8;
const CONFIG: u16 = 0x510;
const CONFIG_END: u16 = CONFIG + 4 * CHANNELS;
const PORT: u16 = 31;
/// Tasks of the first channel: that of its polarity, set, clear.
const TASKS: [u16; 3] = [0, 12, 24];

/// Registers where the pins tell the levels of connected inputs, one register a port, and that DETECT has risen.
/// Programs know nothing of these.
pub(super) const INPUTS: u16 = 0xf00;
pub(super) const DETECTED: u16 = 0xf08;

/// Use of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Disabled,
    Event,
    Task,
}

/// CONFIG of a channel.
#[derive(Clone, Copy, Debug)]
struct Channel {
    mode: Mode,
    /// Number of the pin, of both ports.
    pin: u32,
    rising: bool,
    falling: bool,
    starts_high: bool,
}

impl Channel {
    fn of(config: u32) -> Self {
        Self {
            mode: match config & 3 {
                1 => Mode::Event,
                3 => Mode::Task,
                _ => Mode::Disabled,
            },
            pin: config >> 8 & 0x3f,
            rising: config >> 16 & 1 != 0,
            falling: config >> 17 & 1 != 0,
            starts_high: config >> 20 & 1 != 0,
        }
    }

    fn bit(self) -> u64 {
        1 << self.pin
    }
}

/// Channels and the event of a port (Product Specification, "GPIOTE"). A bit a pin, of both ports.
#[derive(Debug, Default)]
pub struct Gpiote {
    inputs: u64,
    /// Pins that channels drive, and their levels; and those for which channels listen.
    driven: u64,
    levels: u64,
    heard: u64,
}

impl Gpiote {
    fn channel(number: u16, call: &Call<'_, '_>) -> Channel {
        Channel::of(call.get(CONFIG + 4 * number))
    }

    /// A task of a channel changes its pin.
    fn act(&mut self, channel: Channel, kind: usize, call: &mut Call<'_, '_>) {
        let bit = channel.bit();
        match (kind, channel.rising, channel.falling) {
            (0, true, true) => self.levels ^= bit,
            (0, true, false) | (1, ..) => self.levels |= bit,
            (0, false, true) | (2, ..) => self.levels &= !bit,
            _ => {}
        }
        self.drive(call);
    }

    /// Tells the pins.
    fn drive(&self, call: &mut Call<'_, '_>) {
        for port in 0..2 {
            let at = PINS + u64::from(gpio::DRIVEN) + 12 * port;
            for (at, bits) in [
                (at + 4, self.levels),
                (at, self.driven),
                (at + 8, self.heard),
            ] {
                let bits = bits >> (32 * port) & 0xffff_ffff;
                call.context.write_to(at, Width::W32, bits, DONE);
            }
        }
    }

    fn configure(&mut self, number: u16, call: &mut Call<'_, '_>) {
        let all = (0..CHANNELS).map(|number| Self::channel(number, call));
        let all: Vec<_> = all.filter(|one| one.mode != Mode::Disabled).collect();
        let of = |mode| all.iter().filter(move |one| one.mode == mode);
        let used = all.iter().fold(0_u64, |used, one| used | one.bit());
        if used.count_ones() as usize != all.len() {
            call.forbid("CONFIG", "two channels with the same pin (\"GPIOTE\")");
        }
        let pins = |mode| of(mode).fold(0, |pins, one| pins | one.bit());
        (self.driven, self.heard) = (pins(Mode::Task), pins(Mode::Event));
        let channel = Self::channel(number, call);
        if channel.mode == Mode::Task {
            let bit = channel.bit();
            self.levels = self.levels & !bit | if channel.starts_high { bit } else { 0 };
        }
        self.drive(call);
    }

    /// Connected inputs have these levels from now on.
    fn see(&mut self, inputs: u64, call: &mut Call<'_, '_>) {
        let (risen, fallen) = (inputs & !self.inputs, self.inputs & !inputs);
        self.inputs = inputs;
        for number in 0..CHANNELS {
            let channel = Self::channel(number, call);
            let rises = channel.rising && risen & channel.bit() != 0;
            let falls = channel.falling && fallen & channel.bit() != 0;
            if channel.mode == Mode::Event && (rises || falls) {
                call.event(number);
            }
        }
    }
}

impl Model for Gpiote {
    fn task(&mut self, number: u16, call: &mut Call<'_, '_>) {
        for (kind, first) in TASKS.into_iter().enumerate() {
            let channel = number
                .checked_sub(first)
                .filter(|channel| *channel < CHANNELS);
            let Some(channel) = channel else { continue };
            let channel = Self::channel(channel, call);
            // Of no use to a channel in another mode.
            if channel.mode == Mode::Task {
                self.act(channel, kind, call);
            }
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        match offset {
            CONFIG..CONFIG_END => self.configure((offset - CONFIG) / 4, call),
            DETECTED => call.event(PORT),
            offset if offset == INPUTS => {
                self.see(self.inputs & !0xffff_ffff | u64::from(value), call);
            }
            offset if offset == INPUTS + 4 => {
                self.see(self.inputs & 0xffff_ffff | u64::from(value) << 32, call);
            }
            _ => {}
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use rigless::{mcu::Operate, time::VirtualNanos};

    use super::*;
    use crate::{peripheral::bench::Cells, soc::Soc};

    const DETECTMODE: u64 = PINS + 0x524;
    const LATCH: u64 = PINS + 0x520;
    const PPI: u64 = 0x4001_f000;

    struct Pins(Soc, Cells);

    impl Pins {
        fn new() -> Self {
            let soc = Soc::new(0, None, None, BTreeMap::new()).unwrap();
            Self(soc, Cells::default())
        }

        fn set(&mut self, address: u64, value: u32) {
            let now = VirtualNanos(0);
            self.0
                .write(now, address, Width::W32, value.into())
                .unwrap();
            self.0.settle(&mut self.1).unwrap();
        }

        fn get(&mut self, address: u64) -> u32 {
            let value = self.0.read(VirtualNanos(0), address, Width::W32).unwrap();
            self.0.settle(&mut self.1).unwrap();
            value as u32
        }

        fn pull(&mut self, port: u8, low: u32) {
            self.0.pull(VirtualNanos(0), 0, port, low);
            self.0.settle(&mut self.1).unwrap();
        }

        fn took(&mut self, event: u16) -> bool {
            let at = BASE + 0x100 + 4 * u64::from(event);
            let flag = self.get(at) != 0;
            self.set(at, 0);
            flag
        }

        fn configure(&mut self, port: u64, pin: u64, value: u32) {
            self.set(PINS + 0x300 * port + 0x700 + 4 * pin, value);
        }

        fn channel(&mut self, number: u16, value: u32) {
            self.set(BASE + u64::from(CONFIG + 4 * number), value);
        }

        fn task(&mut self, number: u16) {
            self.set(BASE + 4 * u64::from(number), 1);
        }

        /// The pins of the first port that are driven low.
        fn low(&self) -> u32 {
            let changes = &self.0.gpio.model.changes;
            let last = changes.iter().rfind(|(_, port, _)| *port == 0);
            last.map_or(0, |(_, _, level)| !level)
        }
    }

    #[test]
    fn an_input_makes_the_events_of_its_polarity() {
        for (polarity, expected) in [
            (0, [false; 2]),
            (1, [false, true]),
            (2, [true, false]),
            (3, [true; 2]),
        ] {
            for port in 0..2 {
                let mut pins = Pins::new();
                pins.configure(port, 5, 3 << 2);
                pins.channel(2, 1 | 5 << 8 | (port as u32) << 13 | polarity << 16);
                assert!(!pins.took(2));
                for (low, expected) in [(1 << 5, expected[0]), (0, expected[1])] {
                    pins.pull(port as u8, low);
                    assert_eq!(pins.took(2), expected);
                    // It has not changed, and others are not its own.
                    pins.pull(port as u8, low | 1 << 6);
                    pins.pull(1 - port as u8, 1 << 5);
                    assert!(!pins.took(2) && !pins.took(PORT));
                    pins.pull(1 - port as u8, 0);
                    assert!(!pins.took(2));
                    pins.pull(port as u8, low);
                }
            }
        }
    }

    /// A pin that looks for a level needs a connected input. A channel connects its own, and makes it an input.
    #[test]
    fn a_channel_connects_its_input() {
        for configured in [0b00, 0b10, 0b11] {
            let mut pins = Pins::new();
            pins.configure(0, 5, configured);
            pins.channel(0, 1 | 5 << 8 | 3 << 16);
            pins.took(0);
            pins.pull(0, 1 << 5);
            assert!(pins.took(0));
            pins.channel(0, 0);
            pins.pull(0, 0);
            assert!(!pins.took(0));
        }
        let mut pins = Pins::new();
        pins.configure(0, 5, 0b10 | 3 << 16);
        pins.pull(0, 1 << 5);
        assert!(!pins.took(PORT));
        pins.configure(0, 5, 3 << 16);
        assert!(pins.took(PORT));
    }

    #[test]
    fn tasks_drive_a_pin_whatever_the_port_says() {
        let mut pins = Pins::new();
        pins.configure(0, 13, 1);
        assert_eq!(pins.low(), 1 << 13);
        // High at first, and its own task turns it round.
        pins.channel(1, 3 | 13 << 8 | 3 << 16 | 1 << 20);
        assert_eq!(pins.low(), 0);
        for expected in [1 << 13, 0, 1 << 13] {
            pins.task(1);
            assert_eq!(pins.low(), expected);
        }
        pins.task(12 + 1);
        assert_eq!(pins.low(), 0);
        pins.set(PINS + 0x50c, 1 << 13);
        assert_eq!(pins.low(), 0);
        pins.task(24 + 1);
        assert_eq!(pins.low(), 1 << 13);
        pins.task(12);
        assert_eq!(pins.low(), 1 << 13);
        pins.set(PINS + 0x508, 1 << 13);
        // The port has it back.
        pins.channel(1, 0);
        assert_eq!(pins.low(), 0);
        assert!(pins.0.drain_told().is_empty());
        pins.channel(2, 3 | 13 << 8);
        pins.channel(3, 3 | 13 << 8);
        assert_eq!(pins.0.drain_told().len(), 1);
    }

    #[test]
    fn detection_that_rises_is_an_event() {
        let mut pins = Pins::new();
        for (port, pin) in [(0, 11), (1, 12)] {
            pins.configure(port, pin, 3 << 2 | 3 << 16);
        }
        pins.pull(0, 1 << 11);
        assert!(pins.took(PORT));
        // Still there, and so is another of the same port.
        pins.configure(0, 12, 3 << 2 | 3 << 16);
        pins.pull(0, 0b11 << 11);
        assert!(!pins.took(PORT));
        pins.pull(1, 1 << 12);
        assert!(pins.took(PORT));
        pins.pull(0, 0);
        pins.pull(0, 1 << 12);
        assert!(pins.took(PORT));
        // A level that is there already when a pin begins to look for it.
        pins.configure(0, 12, 3 << 2);
        pins.configure(0, 12, 3 << 2 | 3 << 16);
        assert!(pins.took(PORT));
    }

    #[test]
    fn what_is_latched_is_detected_until_it_is_cleared() {
        let mut pins = Pins::new();
        pins.set(DETECTMODE, 1);
        pins.configure(0, 11, 3 << 2 | 3 << 16);
        pins.pull(0, 1 << 11);
        assert!(pins.took(PORT));
        pins.pull(0, 0);
        pins.pull(0, 1 << 11);
        assert!(!pins.took(PORT));
        // A level that is still there makes an event again; one that is gone does not.
        pins.set(LATCH, 1 << 11);
        assert!(pins.took(PORT));
        pins.configure(0, 11, 3 << 2);
        pins.set(LATCH, 1 << 11);
        assert!(!pins.took(PORT));
        pins.configure(0, 11, 3 << 2 | 3 << 16);
        assert!(pins.took(PORT));
    }

    /// As a button that switches a lamp without the processor.
    #[test]
    fn an_input_switches_an_output_over_ppi() {
        let mut pins = Pins::new();
        pins.configure(0, 11, 3 << 2);
        pins.channel(0, 1 | 11 << 8 | 2 << 16);
        pins.channel(7, 3 | 13 << 8 | 3 << 16 | 1 << 20);
        pins.set(PPI + 0x510, (BASE + 0x100) as u32);
        pins.set(PPI + 0x514, (BASE + 4 * 7) as u32);
        pins.set(PPI + 0x504, 1);
        pins.set(BASE + 0x304, 1);
        assert!(!pins.0.is_interrupted());
        pins.pull(0, 1 << 11);
        assert_eq!(pins.low(), 1 << 13);
        assert!(pins.0.is_interrupted());
        pins.pull(0, 0);
        assert_eq!(pins.low(), 1 << 13);
        pins.pull(0, 1 << 11);
        assert_eq!(pins.low(), 0);
    }
}
