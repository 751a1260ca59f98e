//! The two chips of the step sensor, after their data sheets: registers, and their effects.
//!
//! They know nothing of the driver. A register that it does not set has the value of a reset. A setting that
//! the model cannot follow ends the test.

use std::collections::VecDeque;

use nalgebra::Vector3;

/// Effects of the world on the sensors at some time, us: acceleration in m/s^2, angular rate in
/// rad/s, field in uT.
pub(crate) trait World {
    fn at(&self, time_us: f64) -> [Vector3<f64>; 3];
}

/// Numbers as a chip gives them.
fn bytes(value: Vector3<f64>, unit: f64) -> [u8; 6] {
    let mut all = [0; 6];
    for (bytes, part) in all.as_chunks_mut::<2>().0.iter_mut().zip(value.iter()) {
        // `as` saturates, and so do the chips.
        bytes.copy_from_slice(&((part / unit).round() as i16).to_le_bytes());
    }
    all
}

/// DS12814.
pub(crate) struct Lsm6dsox {
    pub(crate) identity: u8,
    /// Excess of its clock over the nominal one, in steps of 0.15 %.
    pub(crate) fine: i8,
    /// It is an LSM6DSO32, which says the same (DS13114).
    pub(crate) is_32: bool,
    registers: [u8; 128],
    fifo: VecDeque<[u8; 7]>,
    /// The word that is being read.
    word: [u8; 7],
    slot: u8,
    next_us: f64,
    lost: bool,
    stuck: Option<[[u8; 6]; 2]>,
}

const WORDS: usize = 512;

impl Lsm6dsox {
    pub(crate) fn new() -> Self {
        let mut chip = Self {
            identity: 0x6C,
            fine: 0,
            is_32: false,
            registers: [0; 128],
            fifo: VecDeque::new(),
            word: [0; 7],
            slot: 0,
            next_us: 0.0,
            lost: false,
            stuck: None,
        };
        chip.reset();
        chip
    }

    /// As after a loss of power.
    pub(crate) fn reset(&mut self) {
        self.registers = [0; 128];
        self.registers[0x12] = 0x04;
        self.registers[0x18] = 0xE0;
        self.fifo.clear();
        self.lost = false;
    }

    /// From now on it repeats its last measurement.
    pub(crate) fn stick(&mut self) {
        self.stuck = Some([[1, 2, 3, 4, 5, 6]; 2]);
    }

    pub(crate) fn unstick(&mut self) {
        self.stuck = None;
    }

    fn period_us(&self) -> f64 {
        128e6 / (6667.0 * (1.0 + 0.0015 * f64::from(self.fine)))
    }

    /// Measures until this time.
    pub(crate) fn run(&mut self, now_us: f64, world: &impl World) {
        let [xl, g] = [self.registers[0x10], self.registers[0x11]];
        while self.next_us <= now_us {
            let at = self.next_us;
            self.next_us += self.period_us();
            if xl >> 4 == 0 || g >> 4 == 0 {
                continue;
            }
            assert_eq!((xl >> 4, g >> 4), (3, 3), "only 52 Hz is modelled");
            let mg = [0.061, 0.488, 0.122, 0.244][usize::from(xl >> 2 & 3)];
            let mg = if self.is_32 { 2.0 * mg } else { mg };
            let mdps = match g >> 1 & 7 {
                0 => 8.75,
                1 => 4.375,
                2 => 17.5,
                4 => 35.0,
                6 => 70.0,
                other => panic!("no such range: {other}"),
            };
            let [acceleration, rate, _] = world.at(at);
            let [force, turn] = self.stuck.unwrap_or([
                bytes(acceleration, mg * 9.806_65e-3),
                bytes(rate, f64::to_radians(mdps * 1e-3)),
            ]);
            self.slot = (self.slot + 1) & 3;
            if self.registers[0x0A] & 7 != 6 {
                continue;
            }
            assert_eq!(self.registers[0x09], 0x33, "only 52 Hz of both is modelled");
            for (sensor, data) in [(1, turn), (2, force)] {
                let tag: u8 = sensor << 3 | self.slot << 1;
                let [a, b, c, d, e, f] = data;
                let parity = (tag.count_ones() & 1) as u8;
                if self.fifo.len() == WORDS {
                    self.fifo.pop_front();
                    self.lost = true;
                }
                self.fifo.push_back([tag | parity, a, b, c, d, e, f]);
            }
        }
    }

    /// Returns false where it does not acknowledge: a reset while its FIFO streams, as people found.
    pub(crate) fn write(&mut self, register: u8, value: u8) -> bool {
        let is_reset = register == 0x12 && value & 1 != 0;
        if is_reset && self.registers[0x0A] & 7 != 0 {
            return false;
        }
        self.registers[usize::from(register)] = value;
        if register == 0x0A && value & 7 == 0 {
            self.fifo.clear();
        }
        if is_reset {
            self.reset();
        }
        true
    }

    /// Reads a register; returns also the register that a longer read goes on with.
    pub(crate) fn read(&mut self, register: u8) -> (u8, u8) {
        let waiting = (self.fifo.len() as u16).to_le_bytes();
        let value = match register {
            0x0F => self.identity,
            0x3A => waiting[0],
            0x3B => {
                let full = u8::from(self.fifo.len() == WORDS);
                waiting[1]
                    | full << 5
                    | if std::mem::take(&mut self.lost) {
                        0x48
                    } else {
                        0
                    }
            }
            0x63 => self.fine as u8,
            0x78..=0x7E => {
                if register == 0x78 {
                    self.word = self.fifo.pop_front().unwrap_or_default();
                }
                self.word[usize::from(register - 0x78)]
            }
            other => self.registers[usize::from(other)],
        };
        let counts = self.registers[0x12] & 0x04 != 0;
        let next = match register {
            _ if !counts => register,
            0x7E => 0x78,
            other => other + 1,
        };
        (value, next)
    }
}

/// `DocID024204`.
pub(crate) struct Lis3mdl {
    pub(crate) identity: u8,
    /// Its own magnetism, uT.
    pub(crate) hard_iron: Vector3<f64>,
    registers: [u8; 64],
    out: [u8; 6],
    new: bool,
    next_us: f64,
    stuck: bool,
}

impl Lis3mdl {
    pub(crate) fn new() -> Self {
        let mut chip = Self {
            identity: 0x3D,
            hard_iron: Vector3::zeros(),
            registers: [0; 64],
            out: [0; 6],
            new: false,
            next_us: 0.0,
            stuck: false,
        };
        chip.reset();
        chip
    }

    pub(crate) fn reset(&mut self) {
        self.registers = [0; 64];
        self.registers[0x20] = 0x10;
        self.registers[0x22] = 0x03;
        self.new = false;
    }

    pub(crate) fn stick(&mut self) {
        self.stuck = true;
    }

    pub(crate) fn unstick(&mut self) {
        self.stuck = false;
    }

    pub(crate) fn run(&mut self, now_us: f64, world: &impl World) {
        while self.next_us <= now_us {
            let at = self.next_us;
            // Its clock is not that of the other chip.
            self.next_us += 50_000.0 * 1.013;
            if self.registers[0x22] & 3 != 0 {
                continue;
            }
            assert_eq!(self.registers[0x20] >> 1 & 0x0F, 0b1010, "20 Hz");
            let gauss = [6842.0, 3421.0, 2281.0, 1711.0];
            let unit = 100.0 / gauss[usize::from(self.registers[0x21] >> 5 & 3)];
            let [_, _, field] = world.at(at);
            if !self.stuck {
                self.out = bytes(field + self.hard_iron, unit);
            }
            self.new = true;
        }
    }

    pub(crate) fn write(&mut self, register: u8, value: u8) {
        self.registers[usize::from(register & 0x3F)] = value;
        if register == 0x21 && value & 4 != 0 {
            self.reset();
        }
    }

    pub(crate) fn read(&mut self, register: u8) -> (u8, u8) {
        let (counts, number) = (register & 0x80, register & 0x7F);
        let value = match number {
            0x0F => self.identity,
            0x27 => u8::from(self.new) * 0x0F,
            0x28..=0x2D => {
                self.new &= number != 0x2D;
                self.out[usize::from(number - 0x28)]
            }
            other => self.registers[usize::from(other)],
        };
        let next = match number {
            _ if counts == 0 => register,
            0x2D => 0x28 | counts,
            other => (other + 1) | counts,
        };
        (value, next)
    }
}
