//! GPIO, both ports.

use std::ops::Range;

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, gpiote, twim};

const PORTS: usize = 2;
/// Registers of the second port are so far behind those of the first.
const NEXT_PORT: u16 = 0x300;
const OUT: u16 = 0x504;
const OUTSET: u16 = 0x508;
const OUTCLR: u16 = 0x50c;
const IN: u16 = 0x510;
const DIR: u16 = 0x514;
const DIRSET: u16 = 0x518;
const DIRCLR: u16 = 0x51c;
const LATCH: u16 = 0x520;
const DETECTMODE: u16 = 0x524;
const PIN_CNF: core::ops::RangeInclusive<u16> = 0x700..=0x77c;

/// Registers where GPIOTE tells which pins of the first port its channels drive, then their levels, and for which
/// they listen; those of the second port follow. Programs know nothing of these.
pub(super) const DRIVEN: u16 = 0xf00;
const DRIVEN_END: u16 = DRIVEN + 12 * PORTS as u16;

/// A port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Port {
    /// A bit a pin: it is an output; its level if so.
    direction: u32,
    out: u32,
    /// Its input is connected, which no reset leaves it; is pulled down by the chip; is looked for high, or
    /// for low.
    connected: u32,
    pulled_down: u32,
    sensed: [u32; 2],
    /// An output does not drive it low, or high.
    undriven: [u32; 2],
    /// A channel of GPIOTE drives it, and to which level; or listens for it, which makes it a connected input.
    taken: u32,
    level: u32,
    heard: u32,
    /// LATCH, and true if DETECT follows it.
    latch: u32,
    is_latched: bool,
}

impl Port {
    /// Levels that its pins drive; those of inputs and of open drains that drive nothing count as high.
    fn driven(&self) -> u32 {
        self.value() | self.released()
    }

    fn value(&self) -> u32 {
        self.out & !self.taken | self.level & self.taken
    }

    /// The pins that it does not drive.
    fn released(&self) -> u32 {
        let outputs = self.direction & !self.heard | self.taken;
        let ([low, high], value) = (self.undriven, self.value());
        !outputs | !value & low | value & high
    }

    fn connected(&self) -> u32 {
        self.connected | self.heard
    }

    /// The levels of its pins. `low`: those that something outside pulls down.
    fn levels(&self, low: u32) -> u32 {
        self.driven() & !(self.released() & (low | self.pulled_down))
    }

    /// The pins that are found as they are looked for.
    fn found(&self, levels: u32) -> u32 {
        let [high, low] = self.sensed;
        self.connected() & (levels & high | !levels & low)
    }

    fn configure(&mut self, pin: u16, value: u32) {
        let set =
            |bits: &mut u32, is_so: bool| *bits = *bits & !(1 << pin) | u32::from(is_so) << pin;
        set(&mut self.direction, value & 1 != 0);
        set(&mut self.connected, value >> 1 & 1 == 0);
        set(&mut self.pulled_down, value >> 2 & 3 == 1);
        let [low, high] = &mut self.undriven;
        set(low, value >> 9 & 3 == 2);
        set(high, value >> 9 & 3 == 3);
        set(&mut self.sensed[0], value >> 16 & 3 == 2);
        set(&mut self.sensed[1], value >> 16 & 3 == 3);
    }
}

/// Something on an I2C bus holds its data line low, as a sensor does that was in the middle of a byte when
/// the chip was restarted: a fault.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Held {
    /// Time from begin to end, at most.
    pub during: Range<u64>,
    /// The pins of the lines, of the first port.
    pub data: u8,
    /// See `data`.
    pub clock: u8,
    /// Falls of the clock, while the program drives it, that end the hold, if that ends it.
    pub clocks: Option<u8>,
}

impl Held {
    fn is_at(&self, now: u64) -> bool {
        self.during.contains(&now) && self.clocks != Some(0)
    }
}

/// Change of the pins from outside: inputs of a port are pulled down, or the bus is held or let go.
#[derive(Clone, Copy, Debug)]
enum Change {
    Pulls(u8, u32),
    Bus,
}

/// Pins; inputs are high unless the chip or something outside pulls them down (Product Specification,
/// "GPIO").
#[derive(Debug)]
pub struct Gpio {
    /// Times when outputs changed: the port, and the levels that its pins drive; those of inputs count as high.
    pub changes: Vec<(u64, u8, u32)>,
    /// Inputs that something outside pulls down.
    low: [u32; PORTS],
    held: Option<Held>,
    held_low: [u32; PORTS],
    /// Coming events from outside, and their times.
    coming: Vec<(EventId, u64, Change)>,
    ports: [Port; PORTS],
    /// States that others were told: driven pins, connected inputs' levels, and DETECT.
    driven: [u32; PORTS],
    inputs: [u32; PORTS],
    detects: [bool; PORTS],
    is_held: bool,
}

impl Default for Gpio {
    fn default() -> Self {
        Self {
            changes: Vec::new(),
            low: [0; PORTS],
            held: None,
            held_low: [0; PORTS],
            coming: Vec::new(),
            ports: [Port::default(); PORTS],
            driven: [u32::MAX; PORTS],
            inputs: [0; PORTS],
            detects: [false; PORTS],
            is_held: false,
        }
    }
}

/// The port of a register and its offset in the first one.
fn port(offset: u16) -> (usize, u16) {
    if (0x800..0xb00).contains(&offset) {
        (1, offset - NEXT_PORT)
    } else {
        (0, offset)
    }
}

impl Gpio {
    /// Returns true if a pin, by its number over both ports, is an output that drives its level.
    pub(crate) fn drives(&self, pin: u32) -> bool {
        let port = self.ports.get(pin as usize / 32);
        port.is_some_and(|port| port.released() >> (pin % 32) & 1 == 0)
    }

    /// From an instant on, now if that has passed, something outside pulls these inputs of a port down, and
    /// no others.
    pub(crate) fn pull(&mut self, at: u64, port: u8, low: u32, call: &mut Call<'_, '_>) {
        self.change(at, Change::Pulls(port, low), call);
    }

    /// From an instant on something holds the bus.
    pub(crate) fn hold(&mut self, held: Held, call: &mut Call<'_, '_>) {
        let during = held.during.clone();
        self.held = Some(held);
        self.change(during.start, Change::Bus, call);
        self.change(during.end, Change::Bus, call);
    }

    fn change(&mut self, at: u64, change: Change, call: &mut Call<'_, '_>) {
        if at > call.now() {
            let id = call.at(at);
            self.coming.push((id, at, change));
            return;
        }
        let number = match change {
            Change::Pulls(port, _) => usize::from(port),
            Change::Bus => 0,
        };
        if let Change::Pulls(_, low) = change
            && let Some(known) = self.low.get_mut(number)
        {
            *known = low;
        }
        if number < PORTS {
            self.follow(number, false, call);
        }
    }

    /// Goes on after a reset: what is yet to happen outside happens, and others hear of the pins.
    pub(crate) fn go_on(&mut self, call: &mut Call<'_, '_>) {
        for (id, at, _) in &mut self.coming {
            *id = call.at((*at).max(call.now()));
        }
        for number in 0..PORTS {
            self.follow(number, false, call);
        }
    }

    fn levels(&self, number: usize) -> u32 {
        self.ports[number].levels(self.low[number] | self.held_low[number])
    }

    /// Pins of the first port that the bus's lines pull down. `before`: what its pins drove.
    fn hold_lines(&mut self, before: u32, call: &mut Call<'_, '_>) -> u32 {
        let Some(held) = &mut self.held else {
            return 0;
        };
        let has_fallen = before & !self.driven[0] & 1 << held.clock != 0;
        if has_fallen && held.is_at(call.now()) {
            held.clocks = held.clocks.map(|clocks| clocks - 1);
        }
        let is_held = held.is_at(call.now());
        let data = 1 << held.data;
        if core::mem::replace(&mut self.is_held, is_held) != is_held {
            tell(twim::BASE + u64::from(twim::HELD), is_held.into(), call);
        }
        if is_held { data } else { 0 }
    }

    /// Tells the new state of a port's pins. `again`: LATCH was cleared, which makes an edge of what is left in
    /// it.
    fn follow(&mut self, number: usize, again: bool, call: &mut Call<'_, '_>) {
        let port = &self.ports[number];
        let driven = port.driven();
        let before = core::mem::replace(&mut self.driven[number], driven);
        if driven != before {
            self.changes.push((call.now(), number as u8, driven));
        }
        self.held_low[number] = match number {
            0 => self.hold_lines(before, call),
            _ => 0,
        };
        let levels = self.levels(number);
        let port = &mut self.ports[number];
        let found = port.found(levels);
        port.latch |= found;
        let inputs = levels & port.connected();
        if inputs != self.inputs[number] {
            self.inputs[number] = inputs;
            let offset = gpiote::INPUTS + 4 * number as u16;
            tell(gpiote::BASE + u64::from(offset), inputs, call);
        }
        let detects = if port.is_latched { port.latch } else { found } != 0;
        let was = self.detects[number] && !(again && port.is_latched);
        self.detects[number] = detects;
        if detects && !was {
            tell(gpiote::BASE + u64::from(gpiote::DETECTED), 1, call);
        }
    }
}

/// Tells GPIOTE, or TWIM.
fn tell(address: u64, value: u32, call: &mut Call<'_, '_>) {
    call.context
        .write_to(address, Width::W32, value.into(), DONE);
}

impl Model for Gpio {
    fn read(&mut self, offset: u16, call: &mut Call<'_, '_>) -> Option<u32> {
        let register = offset;
        let (number, offset) = port(offset);
        let port = &self.ports[number];
        match offset {
            OUT | OUTSET | OUTCLR => Some(port.out),
            DIR | DIRSET | DIRCLR => Some(port.direction),
            LATCH => Some(port.latch),
            // "Inputs must be connected to get a valid input value."
            IN => Some(self.levels(number) & port.connected()),
            offset if PIN_CNF.contains(&offset) => {
                let pin = (offset - PIN_CNF.start()) / 4;
                let bit = |bits: u32| bits >> pin & 1;
                let others = call.get(register) & !0b11;
                Some(others | bit(!port.connected) << 1 | bit(port.direction))
            }
            _ => None,
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        if (DRIVEN..DRIVEN_END).contains(&offset) {
            let (number, which) = ((offset - DRIVEN) / 12, (offset - DRIVEN) % 12 / 4);
            let port = &mut self.ports[usize::from(number)];
            *match which {
                0 => &mut port.taken,
                1 => &mut port.level,
                _ => &mut port.heard,
            } = value;
            return self.follow(number.into(), false, call);
        }
        let (number, offset) = port(offset);
        let port = &mut self.ports[number];
        let clears = offset == LATCH && port.latch & value != 0;
        match offset {
            OUT => port.out = value,
            OUTSET => port.out |= value,
            OUTCLR => port.out &= !value,
            DIR => port.direction = value,
            DIRSET => port.direction |= value,
            DIRCLR => port.direction &= !value,
            LATCH => port.latch &= !value,
            DETECTMODE => port.is_latched = value & 1 != 0,
            offset if PIN_CNF.contains(&offset) => {
                port.configure((offset - PIN_CNF.start()) / 4, value);
            }
            _ => {}
        }
        self.follow(number, clears, call);
    }

    fn due(&mut self, id: EventId, call: &mut Call<'_, '_>) {
        let mine = |(known, ..): &(EventId, u64, Change)| *known == id;
        if let Some(place) = self.coming.iter().position(mine) {
            let (_, at, change) = self.coming.remove(place);
            self.change(at, change, call);
        }
    }

    /// Conditions outside stay, and know what the pins drove; it goes on afterwards.
    fn reset(&mut self) {
        *self = Self {
            changes: core::mem::take(&mut self.changes),
            coming: core::mem::take(&mut self.coming),
            low: self.low,
            held: self.held.take(),
            driven: self.driven,
            ..Self::default()
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::bench::Bench;

    const CONNECTED: u32 = 0;

    /// A pin that an embassy example waits for: pulled up, connected, looked for at a level.
    fn sensed(low: bool) -> u32 {
        3 << 2 | if low { 3 << 16 } else { 2 << 16 }
    }

    fn bench() -> Bench<Gpio> {
        Bench::new(Gpio::default())
    }

    fn pull(bench: &mut Bench<Gpio>, port: u8, low: u32) {
        bench.with(|gpio, call| gpio.pull(call.now(), port, low, call));
    }

    #[test]
    fn each_port_has_its_pins() {
        let mut bench = bench();
        for base in [0, NEXT_PORT] {
            for pin in 0..32 {
                let register = base + PIN_CNF.start() + 4 * pin;
                assert_eq!(bench.get(register), 0b10);
                bench.set(register, CONNECTED);
            }
            bench.set(base + DIRSET, 0b11);
            bench.set(base + OUTSET, 0b110);
            bench.set(base + OUTCLR, 0b100);
            // A configured pin is an output by its lowest bit.
            bench.set(base + PIN_CNF.start() + 4 * 5, 1);
            assert_eq!(bench.get(base + PIN_CNF.start()), 0b01);
            assert_eq!(bench.get(base + DIR), 0b10_0011);
            assert_eq!(bench.get(base + OUT), 0b10);
            assert_eq!(bench.get(base + IN), !0b10_0001);
        }
        pull(&mut bench, 1, 1 << 12);
        assert_eq!(bench.get(IN) >> 12 & 1, 1);
        assert_eq!(bench.get(NEXT_PORT + IN) >> 12 & 1, 0);
        let changes = &bench.chip.model.model.changes;
        let driven = |port| {
            { changes.iter() }
                .filter(move |(_, of, _)| *of == port)
                .map(|(_, _, level)| !level)
                .collect::<Vec<_>>()
        };
        // Outputs are low at first; what is set before it is an output is not seen.
        for port in 0..2 {
            assert_eq!(driven(port), [0b11, 0b01, 0b10_0001]);
        }
    }

    #[test]
    fn an_input_shows_who_pulls_it() {
        let mut bench = bench();
        let pin = PIN_CNF.start() + 4 * 3;
        let level = |bench: &mut Bench<Gpio>, configured: u32| {
            bench.set(pin, configured);
            bench.get(IN) >> 3 & 1
        };
        assert_eq!(level(&mut bench, 0b0010), 0);
        assert_eq!(level(&mut bench, 0b0000), 1);
        assert_eq!(level(&mut bench, 0b0100), 0);
        assert_eq!(level(&mut bench, 0b1100), 1);
        pull(&mut bench, 0, 1 << 3);
        assert_eq!(level(&mut bench, 0b1100), 0);
    }

    #[test]
    fn what_comes_comes_in_its_time() {
        let mut bench = bench();
        bench.set(*PIN_CNF.start(), CONNECTED);
        bench.with(|gpio, call| {
            gpio.pull(1_000, 0, 1, call);
            gpio.pull(2_000, 0, 0, call);
        });
        for (passes, level) in [(999, 1), (1, 0), (999, 0), (1, 1)] {
            bench.pass(passes);
            assert_eq!(bench.get(IN), level);
        }
    }

    /// S0D1: a one lets go, and a contact outside pulls it down.
    #[test]
    fn an_open_drain_is_pulled_down() {
        const OUTPUT: u32 = 1;
        let mut bench = bench();
        pull(&mut bench, 0, 1);
        for (drive, out, level) in [(0, 1, 1), (0, 0, 0), (6, 1, 0), (6, 0, 0), (7, 1, 0)] {
            bench.set(OUT, out);
            bench.set(*PIN_CNF.start(), drive << 8 | 3 << 2 | OUTPUT);
            assert_eq!(bench.get(IN) & 1, level, "{drive} {out}");
        }
        pull(&mut bench, 0, 0);
        assert_eq!(bench.get(IN) & 1, 1);
        // D0S1: the other way round.
        bench.set(OUT, 0);
        bench.set(*PIN_CNF.start(), 4 << 8 | OUTPUT);
        assert_eq!(bench.get(IN) & 1, 1);
    }

    /// The data line is low from then on, until the clock has fallen often enough, or for ever.
    #[test]
    fn who_holds_a_bus_is_clocked_free() {
        const OPEN_DRAIN: u32 = 6 << 8 | 3 << 2 | 1;
        for clocks in [Some(9), None] {
            let mut bench = bench();
            bench.set(OUT, 0b11);
            for pin in 0..2 {
                bench.set(PIN_CNF.start() + 4 * pin, OPEN_DRAIN);
            }
            let held = Held {
                during: 1_000..9_000,
                data: 0,
                clock: 1,
                clocks,
            };
            bench.with(|gpio, call| gpio.hold(held, call));
            bench.pass(999);
            bench.set(OUTCLR, 0b10);
            bench.set(OUTSET, 0b10);
            assert_eq!(bench.get(IN), 0b11);
            bench.pass(1);
            for clock in 0..9 {
                assert_eq!(bench.get(IN), 0b10, "{clock}");
                bench.set(OUTCLR, 0b10);
                bench.set(OUTSET, 0b10);
            }
            assert_eq!(bench.get(IN), 0b10 | u32::from(clocks.is_some()));
            bench.pass(8_000);
            assert_eq!(bench.get(IN), 0b11);
        }
    }

    #[test]
    fn what_is_looked_for_is_latched() {
        let mut bench = bench();
        bench.set(PIN_CNF.start() + 4 * 11, sensed(true));
        assert_eq!(bench.get(LATCH), 0);
        pull(&mut bench, 0, 1 << 11);
        assert_eq!(bench.get(LATCH), 1 << 11);
        // As long as it is there it comes back.
        bench.set(LATCH, 1 << 11);
        assert_eq!(bench.get(LATCH), 1 << 11);
        pull(&mut bench, 0, 0);
        assert_eq!(bench.get(LATCH), 1 << 11);
        bench.set(LATCH, 1 << 11);
        assert_eq!(bench.get(LATCH), 0);
    }
}
