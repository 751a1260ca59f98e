//! The LIS3MDL: a compass.
//!
//! After its data sheet, `DocID024204` (by the names of its registers and sections). Modelled are all rates,
//! ranges and modes; interrupts, the self-test and the thermometer are not.

use std::sync::Arc;

use super::{Chip, Noise, World, bytes};

const OFFSET_X_REG_L_M: usize = 0x05;
const WHO_AM_I: u8 = 0x0f;
const CTRL_REG1: u8 = 0x20;
const CTRL_REG2: u8 = 0x21;
const CTRL_REG3: u8 = 0x22;
const CTRL_REG4: u8 = 0x23;
const STATUS_REG: u8 = 0x27;
const OUT_X_L: u8 = 0x28;
const OUT_Z_H: u8 = 0x2d;
const INT_CFG: u8 = 0x30;

/// `CTRL_REG2`: registers as after power-on.
const SOFT_RST: u8 = 1 << 2;
/// `STATUS_REG`: all axes are new; all were overwritten before they were read.
const AVAILABLE: u8 = 0x0f;
const OVERRUN: u8 = 0xf0;

/// "Magnetic sensor characteristics": root mean square of the noise in ultra-high-performance mode at
/// 12 gauss, of x, y and z, uT.
const NOISE: f64 = 0.35;

/// An LIS3MDL.
#[derive(Debug)]
pub struct Lis3mdl {
    /// `WHO_AM_I`.
    pub identity: u8,
    /// Field of magnetic parts of the board it is on, uT.
    pub hard_iron: [f64; 3],
    /// Size of its noise, as a share of the data sheet's.
    pub noise: f64,
    world: Arc<dyn World>,
    random: Noise,
    registers: [u8; 64],
    /// The number of a register, and whether it counts up in longer transfers.
    pointer: u8,
    /// Time of the next measurement.
    next: Option<u64>,
}

impl Lis3mdl {
    /// On the bus where `SDO/SA1` is low.
    pub const ADDRESS: u32 = 0x1c;

    /// A chip in a world, with a seed of its noise.
    pub fn new(world: Arc<dyn World>, seed: u64) -> Self {
        let mut chip = Self {
            identity: 0x3d,
            hard_iron: [0.0; 3],
            noise: 1.0,
            world,
            random: Noise::new(seed),
            registers: [0; 64],
            pointer: 0,
            next: None,
        };
        chip.reset();
        chip
    }

    /// "Register mapping": the registers that are not zero.
    fn reset(&mut self) {
        self.registers = [0; 64];
        self.registers[usize::from(CTRL_REG1)] = 0x10;
        self.registers[usize::from(CTRL_REG3)] = 0x03;
        self.registers[usize::from(INT_CFG)] = 0xe8;
        self.next = None;
    }

    fn get(&self, register: u8) -> u8 {
        self.registers[usize::from(register)]
    }

    /// Time between two readings, nanoseconds: "`CTRL_REG1` (20h)" and `LP` of `CTRL_REG3`.
    fn period(&self) -> u64 {
        let [one, three] = [CTRL_REG1, CTRL_REG3].map(|register| self.get(register));
        let fast = [1000.0, 560.0, 300.0, 155.0];
        let hz = if three >> 5 & 1 != 0 {
            0.625
        } else if one >> 1 & 1 != 0 {
            fast[usize::from(one >> 5 & 3)]
        } else {
            0.625 * f64::from(1 << (one >> 2 & 7))
        };
        (1e9 / hz) as u64
    }

    /// Measures all that was due by now.
    fn catch_up(&mut self, now: u64) {
        while let Some(at) = self.next.filter(|at| *at <= now) {
            self.measure(at);
            // `MD`: continuous, or once.
            let is_continuous = self.get(CTRL_REG3) & 3 == 0;
            self.next = is_continuous.then(|| at + self.period());
            if !is_continuous {
                self.registers[usize::from(CTRL_REG3)] |= 3;
            }
        }
    }

    fn measure(&mut self, at: u64) {
        let field = self.world.at(at).field;
        let all = core::array::from_fn(|axis| field[axis] + self.hard_iron[axis]);
        // `FS`: 4, 8, 12 and 16 gauss, each of 100 uT.
        let per_gauss = [6842.0, 3421.0, 2281.0, 1711.0];
        let unit = 100.0 / per_gauss[usize::from(self.get(CTRL_REG2) >> 5 & 3)];
        let offsets: [f64; 3] = core::array::from_fn(|axis| {
            let from = OFFSET_X_REG_L_M + 2 * axis;
            let bytes = [self.registers[from], self.registers[from + 1]];
            f64::from(i16::from_le_bytes(bytes)) * unit
        });
        let all = self.random.on(all, NOISE * self.noise);
        let mut data = bytes(core::array::from_fn(|axis| all[axis] - offsets[axis]), unit);
        // `BLE`.
        if self.get(CTRL_REG4) >> 1 & 1 != 0 {
            data.as_chunks_mut::<2>()
                .0
                .iter_mut()
                .for_each(|pair| pair.reverse());
        }
        let from = usize::from(OUT_X_L);
        self.registers[from..from + data.len()].copy_from_slice(&data);
        let status = &mut self.registers[usize::from(STATUS_REG)];
        *status |= match *status & AVAILABLE {
            0 => AVAILABLE,
            _ => AVAILABLE | OVERRUN,
        };
    }

    fn register(&mut self, register: u8) -> u8 {
        match register {
            WHO_AM_I => self.identity,
            OUT_Z_H => {
                self.registers[usize::from(STATUS_REG)] = 0;
                self.get(register)
            }
            0..=0x3f => self.get(register),
            _ => 0,
        }
    }

    /// "I2C operation": the highest bit of the register's number makes it count up. From the last axis it
    /// goes to the first.
    fn count(&mut self) {
        if self.pointer >> 7 != 0 {
            self.pointer = 0x80
                | match self.pointer & 0x7f {
                    OUT_Z_H => OUT_X_L,
                    other => (other + 1) & 0x7f,
                };
        }
    }

    fn set(&mut self, register: u8, value: u8, now: u64) -> Result<(), &'static str> {
        match register {
            CTRL_REG2 if value & SOFT_RST != 0 => {
                self.reset();
                return Ok(());
            }
            // "Register mapping": registers that may be written.
            0x05..=0x0a | 0x20..=0x24 | 0x30 | 0x32..=0x33 => {}
            _ => return Err("a register of the LIS3MDL that is reserved, or only read"),
        }
        self.registers[usize::from(register)] = value;
        if matches!(register, CTRL_REG1 | CTRL_REG3) {
            let is_on = self.get(CTRL_REG3) & 3 < 2;
            self.next = is_on.then(|| now + self.period());
        }
        Ok(())
    }
}

impl Chip for Lis3mdl {
    fn write(&mut self, bytes: &[u8], now: u64) -> Result<(), &'static str> {
        self.catch_up(now);
        let Some((&register, values)) = bytes.split_first() else {
            return Ok(());
        };
        self.pointer = register;
        for &value in values {
            self.set(self.pointer & 0x7f, value, now)?;
            self.count();
        }
        Ok(())
    }

    fn read(&mut self, into: &mut [u8], now: u64) {
        self.catch_up(now);
        for byte in into {
            *byte = self.register(self.pointer & 0x7f);
            self.count();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Motion;
    use super::*;

    const MS: u64 = 1_000_000;

    /// Without noise.
    fn chip() -> Lis3mdl {
        let motion = Motion {
            field: [50.0, -25.0, 2_000.0],
            ..Motion::default()
        };
        let mut chip = Lis3mdl::new(Arc::new(motion), 0);
        chip.noise = 0.0;
        chip
    }

    fn read<const N: usize>(chip: &mut Lis3mdl, register: u8, now: u64) -> [u8; N] {
        chip.write(&[register], now).unwrap();
        let mut into = [0; N];
        chip.read(&mut into, now);
        into
    }

    fn field(chip: &mut Lis3mdl, now: u64) -> [i16; 3] {
        let [a, b, c, d, e, f] = read(chip, 0xa8, now);
        [[a, b], [c, d], [e, f]].map(i16::from_le_bytes)
    }

    #[test]
    fn registers_after_power_on() {
        let mut chip = chip();
        for (register, value) in [(0x0f, 0x3d), (0x20, 0x10), (0x22, 0x03), (0x30, 0xe8)] {
            assert_eq!(read(&mut chip, register, 0), [value], "{register:#x}");
        }
        assert_eq!(read(&mut chip, STATUS_REG, 1_000 * MS), [0]);
    }

    #[test]
    fn ranges() {
        let mut chip = chip();
        chip.hard_iron = [50.0, 0.0, 0.0];
        chip.write(&[CTRL_REG3, 0], 0).unwrap();
        let ranges = [(0, 6842), (1, 3421), (2, 2281), (3, 1711)];
        for (now, (range, one)) in (1..).zip(ranges) {
            chip.write(&[CTRL_REG2, range << 5], now * 1_000 * MS)
                .unwrap();
            let [x, y, z] = field(&mut chip, (now * 1_000 + 500) * MS);
            assert_eq!([x, y], [one, -(f64::from(one) / 4.0).round() as i16]);
            // 20 gauss are too many for any.
            assert_eq!(z, i16::MAX);
        }
    }

    #[test]
    fn rates_and_flags() {
        for (one, three, expected) in [
            (0x10, 0x00, 100),
            (0x14, 0x00, 200),
            (0x1c, 0x00, 800),
            (0x10, 0x20, 6),
            (0x02, 0x00, 10_000),
            (0x62, 0x00, 1_550),
        ] {
            let mut chip = chip();
            chip.write(&[CTRL_REG1, one], 0).unwrap();
            chip.write(&[CTRL_REG3, three], 0).unwrap();
            let mut measured = 0;
            for now in 1..=50_000 {
                let now = now * MS / 5;
                if read(&mut chip, STATUS_REG, now) == [AVAILABLE] {
                    measured += 1;
                    field(&mut chip, now);
                    assert_eq!(read(&mut chip, STATUS_REG, now), [0]);
                }
            }
            assert!(
                (expected - 1..=expected).contains(&measured),
                "{one:#x}: {measured}"
            );
        }
        let mut chip = chip();
        chip.write(&[CTRL_REG3, 0], 0).unwrap();
        assert_eq!(read(&mut chip, STATUS_REG, 250 * MS), [AVAILABLE | OVERRUN]);
    }

    #[test]
    fn a_single_reading() {
        let mut chip = chip();
        chip.write(&[CTRL_REG3, 1], 0).unwrap();
        assert_eq!(read(&mut chip, STATUS_REG, 99 * MS), [0]);
        assert_eq!(read(&mut chip, STATUS_REG, 5_000 * MS), [AVAILABLE]);
        assert_eq!(read(&mut chip, CTRL_REG3, 5_000 * MS), [3]);
    }

    /// "I2C operation".
    #[test]
    fn numbers_count_up_where_it_is_asked_for() {
        let mut chip = chip();
        chip.write(&[CTRL_REG3, 0], 0).unwrap();
        let all: [u8; 8] = read(&mut chip, 0xa8, 200 * MS);
        assert_eq!(all[..2], all[6..]);
        assert_eq!(read(&mut chip, 0x28, 200 * MS), [all[0]; 4]);
        // The same with the high byte first.
        chip.write(&[CTRL_REG4, 0x02], 200 * MS).unwrap();
        let turned: [u8; 2] = read(&mut chip, 0xa8, 400 * MS);
        assert_eq!(turned, [all[1], all[0]]);
    }

    #[test]
    fn offsets_are_taken_off() {
        let mut chip = chip();
        chip.write(&[CTRL_REG3, 0], 0).unwrap();
        let [x, ..] = field(&mut chip, 200 * MS);
        chip.write(&[0x85, 0x10, 0x01], 200 * MS).unwrap();
        assert_eq!(field(&mut chip, 400 * MS)[0], x - 0x110);
    }

    #[test]
    fn what_it_forbids_is_told() {
        let mut chip = chip();
        for register in [0x00, WHO_AM_I, 0x25, STATUS_REG, OUT_X_L, 0x40] {
            assert!(chip.write(&[register, 0], 0).is_err(), "{register:#x}");
        }
    }
}
