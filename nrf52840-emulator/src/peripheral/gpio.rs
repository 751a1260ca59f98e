//! GPIO, both ports, and peripherals of which nothing but registers is used.

use super::{Call, Model};

const PORTS: [u16; 2] = [0, 0x300];
const OUT: u16 = 0x504;
const OUTSET: u16 = 0x508;
const OUTCLR: u16 = 0x50c;
const IN: u16 = 0x510;
const DIR: u16 = 0x514;
const DIRSET: u16 = 0x518;
const DIRCLR: u16 = 0x51c;
const PIN_CNF: core::ops::RangeInclusive<u16> = 0x700..=0x77c;

/// Pins; those of inputs are high unless they are [pulled down](Self::low) (Product Specification,
/// "GPIO").
#[derive(Debug)]
pub struct Gpio {
    /// Inputs that something pulls down, per port.
    pub low: [u32; 2],
    /// When outputs changed: the port, and what its pins drive; those of inputs count as high.
    pub changes: Vec<(u64, u8, u32)>,
    driven: [u32; 2],
}

impl Default for Gpio {
    fn default() -> Self {
        Self {
            low: [0; 2],
            changes: Vec::new(),
            driven: [u32::MAX; 2],
        }
    }
}

/// The port of a register and its offset in the first one.
fn port(offset: u16) -> (usize, u16) {
    if (0x800..0xb00).contains(&offset) {
        (1, offset - PORTS[1])
    } else {
        (0, offset)
    }
}

impl Model for Gpio {
    fn read(&mut self, offset: u16, call: &mut Call<'_, '_>) -> Option<u32> {
        let (port, offset) = port(offset);
        let base = PORTS[port];
        let (out, direction) = (call.get(base + OUT), call.get(base + DIR));
        match offset {
            OUTSET | OUTCLR => Some(out),
            DIRSET | DIRCLR => Some(direction),
            IN => Some(out & direction | !direction & !self.low[port]),
            _ => None,
        }
    }

    fn write(&mut self, offset: u16, value: u32, call: &mut Call<'_, '_>) {
        let (port, offset) = port(offset);
        let base = PORTS[port];
        let (out, direction) = (call.get(base + OUT), call.get(base + DIR));
        match offset {
            OUTSET => call.set(base + OUT, out | value),
            OUTCLR => call.set(base + OUT, out & !value),
            DIRSET => call.set(base + DIR, direction | value),
            DIRCLR => call.set(base + DIR, direction & !value),
            offset if PIN_CNF.contains(&offset) => {
                let pin = (offset - PIN_CNF.start()) / 4;
                call.set(base + DIR, direction & !(1 << pin) | (value & 1) << pin);
            }
            _ => {}
        }
        let driven = call.get(base + OUT) | !call.get(base + DIR);
        if driven != self.driven[port] {
            self.driven[port] = driven;
            self.changes.push((call.now(), port as u8, driven));
        }
    }

    fn reset(&mut self) {
        self.driven = [u32::MAX; 2];
    }
}

/// Registers, and nothing happens: GPIOTE, whose channels and pins are not modelled.
#[derive(Debug, Default)]
pub struct Plain;

impl Model for Plain {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peripheral::bench::Bench;

    #[test]
    fn each_port_has_its_pins() {
        let mut bench = Bench::new(Gpio::default());
        for base in PORTS {
            bench.set(base + DIRSET, 0b11);
            bench.set(base + OUTSET, 0b110);
            bench.set(base + OUTCLR, 0b100);
            // A configured pin is an output by its lowest bit.
            bench.set(base + PIN_CNF.start() + 4 * 5, 1);
            assert_eq!(bench.get(base + DIR), 0b10_0011);
            assert_eq!(bench.get(base + OUT), 0b10);
            assert_eq!(bench.get(base + IN), !0b10_0001);
        }
        bench.chip.model.model.low = [0, 1 << 12];
        assert_eq!(bench.get(IN) >> 12 & 1, 1);
        assert_eq!(bench.get(0x300 + IN) >> 12 & 1, 0);
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
}
