//! GPIO, both ports.

use rigless::{soc::Width, time::EventId};

use super::{Call, DONE, Model, gpiote};

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

/// Where GPIOTE tells which pins of the first port its channels drive, then their levels, and for which
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
    /// A channel of GPIOTE drives it, and to which level; or listens for it, which makes it a connected input.
    taken: u32,
    level: u32,
    heard: u32,
    /// LATCH, and whether it is what DETECT follows.
    latch: u32,
    is_latched: bool,
}

impl Port {
    /// What its pins drive; those of inputs count as high.
    fn driven(&self) -> u32 {
        let out = self.out & !self.taken | self.level & self.taken;
        out | self.inputs()
    }

    fn inputs(&self) -> u32 {
        !(self.direction & !self.heard | self.taken)
    }

    fn connected(&self) -> u32 {
        self.connected | self.heard
    }

    /// The levels of its pins. `low`: those of inputs that something outside pulls down.
    fn levels(&self, low: u32) -> u32 {
        self.driven() & !(self.inputs() & (low | self.pulled_down))
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
        set(&mut self.sensed[0], value >> 16 & 3 == 2);
        set(&mut self.sensed[1], value >> 16 & 3 == 3);
    }
}

/// Pins; inputs are high unless the chip or something outside pulls them down (Product Specification,
/// "GPIO").
#[derive(Debug)]
pub struct Gpio {
    /// When outputs changed: the port, and what its pins drive; those of inputs count as high.
    pub changes: Vec<(u64, u8, u32)>,
    /// Inputs that something outside pulls down.
    low: [u32; PORTS],
    /// What becomes of these, and when.
    coming: Vec<(EventId, u8, u32)>,
    ports: [Port; PORTS],
    /// What others were told: what pins drive, connected inputs' levels, and DETECT.
    driven: [u32; PORTS],
    inputs: [u32; PORTS],
    detects: [bool; PORTS],
}

impl Default for Gpio {
    fn default() -> Self {
        Self {
            changes: Vec::new(),
            low: [0; PORTS],
            coming: Vec::new(),
            ports: [Port::default(); PORTS],
            driven: [u32::MAX; PORTS],
            inputs: [0; PORTS],
            detects: [false; PORTS],
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
    /// From an instant on, now if that has passed, something outside pulls these inputs of a port down, and
    /// no others.
    pub(crate) fn pull(&mut self, at: u64, port: u8, low: u32, call: &mut Call<'_, '_>) {
        if at > call.now() {
            let id = call.at(at);
            self.coming.push((id, port, low));
        } else if let Some(known) = self.low.get_mut(usize::from(port)) {
            *known = low;
            self.follow(port.into(), false, call);
        }
    }

    /// Tells what has become of a port's pins. `again`: LATCH was cleared, which makes an edge of what is
    /// left in it.
    fn follow(&mut self, number: usize, again: bool, call: &mut Call<'_, '_>) {
        let port = &mut self.ports[number];
        let driven = port.driven();
        if driven != self.driven[number] {
            self.driven[number] = driven;
            self.changes.push((call.now(), number as u8, driven));
        }
        let levels = port.levels(self.low[number]);
        let found = port.found(levels);
        port.latch |= found;
        let inputs = levels & port.connected();
        if inputs != self.inputs[number] {
            self.inputs[number] = inputs;
            tell(gpiote::INPUTS + 4 * number as u16, inputs, call);
        }
        let detects = if port.is_latched { port.latch } else { found } != 0;
        let was = self.detects[number] && !(again && port.is_latched);
        self.detects[number] = detects;
        if detects && !was {
            tell(gpiote::DETECTED, 1, call);
        }
    }
}

/// Tells GPIOTE.
fn tell(offset: u16, value: u32, call: &mut Call<'_, '_>) {
    let address = gpiote::BASE + u64::from(offset);
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
            IN => Some(port.levels(self.low[number]) & port.connected()),
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
        let mine = |(known, ..): &(EventId, u8, u32)| *known == id;
        if let Some(place) = self.coming.iter().position(mine) {
            let (_, port, low) = self.coming.remove(place);
            self.pull(call.now(), port, low, call);
        }
    }

    /// What is outside goes on.
    fn reset(&mut self) {
        *self = Self {
            changes: core::mem::take(&mut self.changes),
            coming: core::mem::take(&mut self.coming),
            low: self.low,
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
