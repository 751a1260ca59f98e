//! The LSM6DSOX: accelerometer and gyroscope with a FIFO.
//!
//! After its data sheet, DS12814 (by the names of its registers), and its application note AN5272 ("FIFO").
//! Modelled are the page of registers after power-on, both sensors at all rates and ranges, and the FIFO in
//! bypass, FIFO and continuous mode. Filters are not, nor what the chip computes itself.

use std::{collections::VecDeque, sync::Arc};

use super::{Chip, Noise, STANDARD_GRAVITY, World, bytes};

const FUNC_CFG_ACCESS: u8 = 0x01;
const FIFO_CTRL1: u8 = 0x07;
const FIFO_CTRL2: u8 = 0x08;
const FIFO_CTRL3: u8 = 0x09;
const FIFO_CTRL4: u8 = 0x0a;
const WHO_AM_I: u8 = 0x0f;
const CTRL1_XL: u8 = 0x10;
const CTRL2_G: u8 = 0x11;
const CTRL3_C: u8 = 0x12;
const CTRL8_XL: u8 = 0x17;
const CTRL9_XL: u8 = 0x18;
const STATUS_REG: u8 = 0x1e;
const OUTX_L_G: u8 = 0x22;
const OUTX_L_A: u8 = 0x28;
const FIFO_STATUS1: u8 = 0x3a;
const FIFO_STATUS2: u8 = 0x3b;
const INTERNAL_FREQ_FINE: u8 = 0x63;
const FIFO_DATA_OUT_TAG: u8 = 0x78;
const LAST: u8 = 0x7e;

/// `CTRL3_C`: software reset, and register numbers count up in longer transfers.
const SW_RESET: u8 = 1;
const BOOT: u8 = 1 << 7;
const IF_INC: u8 = 1 << 2;

/// Words of the FIFO: 3 KiB of six bytes, without their tags.
const WORDS: usize = 512;
/// `FIFO_STATUS2`: the watermark is reached, the FIFO is full, it will be with the next samples, and it was
/// full since this was last read.
const WTM_IA: u8 = 1 << 7;
const OVR_IA: u8 = 1 << 6;
const FULL_IA: u8 = 1 << 5;
const OVR_LATCHED: u8 = 1 << 3;
/// `TAG_SENSOR`.
const GYROSCOPE: u8 = 1;
const ACCELEROMETER: u8 = 2;

/// AN5272: data rates are (6667 Hz, and 0.15 % for each step of `INTERNAL_FREQ_FINE`) by a power of two.
const CLOCK_HZ: f64 = 6_667.0;
const FINE: f64 = 0.0015;

/// "Mechanical characteristics", noise densities in high-performance mode: g and dps in a bandwidth of 1 Hz.
const ACCELERATION_NOISE: f64 = 70e-6;
const RATE_NOISE: f64 = 3.8e-3;

/// The clock is divided by this at a data rate (`ODR_XL`, `ODR_G`, `BDR_XL`, `BDR_GY`); none: off.
fn divider(rate: u8) -> Option<u64> {
    match rate {
        0 => None,
        // 12.5 Hz to 6.67 kHz.
        1..=10 => Some(1 << (10 - rate)),
        // 1.6 Hz; 6.5 Hz for the FIFO, which no model here comes to ask for.
        _ => Some(4096),
    }
}

/// An LSM6DSOX.
#[derive(Debug)]
pub struct Lsm6dsox {
    /// `WHO_AM_I`.
    pub identity: u8,
    /// `INTERNAL_FREQ_FINE`: error of its clock, in steps of 0.15 %, positive if it is fast.
    pub fine: i8,
    /// Size of its noise, as a share of the data sheet's.
    pub noise: f64,
    /// It is an LSM6DSO32, whose accelerometer has ranges twice as large (DS13114).
    pub is_32: bool,
    world: Arc<dyn World>,
    random: Noise,
    registers: [u8; 128],
    pointer: u8,
    /// Cycles of the clock so far, of which all was measured.
    cycles: u64,
    fifo: VecDeque<[u8; 7]>,
    /// The word that is being read.
    word: [u8; 7],
    /// `TAG_CNT`.
    slot: u8,
    was_full: bool,
}

impl Lsm6dsox {
    /// On the bus where `SDO/SA0` is low.
    pub const ADDRESS: u32 = 0x6a;

    /// A chip in a world, with a seed of its noise.
    pub fn new(world: Arc<dyn World>, seed: u64) -> Self {
        let mut chip = Self {
            identity: 0x6c,
            fine: 0,
            noise: 1.0,
            is_32: false,
            world,
            random: Noise::new(seed),
            registers: [0; 128],
            pointer: 0,
            cycles: 0,
            fifo: VecDeque::new(),
            word: [0; 7],
            slot: 0,
            was_full: false,
        };
        chip.reset();
        chip
    }

    /// "Register mapping": the registers that are not zero.
    fn reset(&mut self) {
        self.registers = [0; 128];
        self.registers[usize::from(CTRL3_C)] = IF_INC;
        self.registers[usize::from(CTRL9_XL)] = 0xe0;
        self.fifo.clear();
        self.was_full = false;
    }

    fn get(&self, register: u8) -> u8 {
        self.registers[usize::from(register)]
    }

    fn clock_hz(&self) -> f64 {
        CLOCK_HZ * (1.0 + FINE * f64::from(self.fine))
    }

    /// Gyroscope and accelerometer.
    fn dividers(&self) -> [Option<u64>; 2] {
        [CTRL2_G, CTRL1_XL].map(|control| divider(self.get(control) >> 4))
    }

    /// Measures all that was due by now.
    fn catch_up(&mut self, now: u64) {
        let due = (now as f64 * 1e-9 * self.clock_hz()) as u64;
        let fastest = self.dividers().into_iter().flatten().min();
        if let Some(step) = fastest {
            let mut next = (self.cycles / step + 1) * step;
            while next <= due {
                self.measure(next);
                next += step;
            }
        }
        self.cycles = self.cycles.max(due);
    }

    fn measure(&mut self, cycle: u64) {
        let at = (cycle as f64 / self.clock_hz() * 1e9) as u64;
        let motion = self.world.at(at);
        let [gyroscope, accelerometer] = self.dividers();
        let rates = self.get(FIFO_CTRL3);
        let mut batch = Vec::new();
        let is_due = |own: Option<u64>, rate: u8| {
            let own = own.filter(|own| cycle.is_multiple_of(*own))?;
            // No more often than there is something new.
            let wanted = divider(rate).map(|wanted| wanted.max(own));
            Some(wanted.is_some_and(|wanted| cycle.is_multiple_of(wanted)))
        };
        let turned = is_due(gyroscope, rates >> 4);
        let pushed = is_due(accelerometer, rates & 0x0f);
        if let Some(is_batched) = turned {
            let data = self.angular_rate(motion.angular_rate);
            self.put(OUTX_L_G, 1 << 1, data);
            batch.extend(is_batched.then_some((GYROSCOPE, data)));
        }
        if let Some(is_batched) = pushed {
            let data = self.acceleration(motion.acceleration);
            self.put(OUTX_L_A, 1, data);
            batch.extend(is_batched.then_some((ACCELEROMETER, data)));
        }
        if self.get(FIFO_CTRL4) & 7 != 0 && !batch.is_empty() {
            self.slot = (self.slot + 1) & 3;
            for (sensor, data) in batch {
                self.push(sensor, data);
            }
        }
    }

    /// Noise in half of the data rate.
    fn sigma(&self, density: f64, control: u8) -> f64 {
        let divider = divider(self.get(control) >> 4).unwrap_or(1);
        self.noise * density * (self.clock_hz() / divider as f64 / 2.0).sqrt()
    }

    fn acceleration(&mut self, acceleration: [f64; 3]) -> [u8; 6] {
        // `FS_XL`: 2, 16, 4 and 8 g.
        let unit = [0.061e-3, 0.488e-3, 0.122e-3, 0.244e-3];
        let times = if self.is_32 { 2.0 } else { 1.0 };
        let unit = times * unit[usize::from(self.get(CTRL1_XL) >> 2 & 3)];
        let sigma = self.sigma(ACCELERATION_NOISE, CTRL1_XL);
        let g = acceleration.map(|value| value / STANDARD_GRAVITY);
        bytes(self.random.on(g, sigma), unit)
    }

    fn angular_rate(&mut self, rate: [f64; 3]) -> [u8; 6] {
        let control = self.get(CTRL2_G);
        // `FS_G`: 250 to 2000 dps; `FS_125`.
        let unit = match control >> 1 & 1 {
            0 => 8.75e-3 * f64::from(1 << (control >> 2 & 3)),
            _ => 4.375e-3,
        };
        let sigma = self.sigma(RATE_NOISE, CTRL2_G);
        bytes(self.random.on(rate.map(f64::to_degrees), sigma), unit)
    }

    /// New data, and their flag.
    fn put(&mut self, register: u8, flag: u8, data: [u8; 6]) {
        let from = usize::from(register);
        self.registers[from..from + data.len()].copy_from_slice(&data);
        self.registers[usize::from(STATUS_REG)] |= flag;
    }

    fn watermark(&self) -> usize {
        usize::from(self.get(FIFO_CTRL1)) | usize::from(self.get(FIFO_CTRL2) & 1) << 8
    }

    /// Number of words there is room for: `STOP_ON_WTM`.
    fn depth(&self) -> usize {
        match self.get(FIFO_CTRL2) >> 7 {
            0 => WORDS,
            _ => self.watermark(),
        }
    }

    fn push(&mut self, sensor: u8, [a, b, c, d, e, f]: [u8; 6]) {
        let depth = self.depth();
        if self.fifo.len() >= depth {
            if self.get(FIFO_CTRL4) & 7 == 1 {
                return;
            }
            self.fifo.pop_front();
        }
        let tag = sensor << 3 | self.slot << 1;
        // `TAG_PARITY` makes the number of ones even.
        let parity = (tag.count_ones() & 1) as u8;
        self.fifo.push_back([tag | parity, a, b, c, d, e, f]);
        self.was_full |= self.fifo.len() >= depth;
    }

    fn status(&mut self) -> u8 {
        let (waiting, depth, mark) = (self.fifo.len(), self.depth(), self.watermark());
        let mut status = (waiting >> 8) as u8 & 3;
        for (bit, is_set) in [
            (WTM_IA, mark > 0 && waiting >= mark),
            (OVR_IA, waiting >= depth),
            (FULL_IA, waiting + 2 > depth),
            (OVR_LATCHED, core::mem::take(&mut self.was_full)),
        ] {
            status |= u8::from(is_set) * bit;
        }
        status
    }

    fn register(&mut self, register: u8) -> u8 {
        match register {
            WHO_AM_I => self.identity,
            FIFO_STATUS1 => self.fifo.len() as u8,
            FIFO_STATUS2 => self.status(),
            INTERNAL_FREQ_FINE => self.fine as u8,
            FIFO_DATA_OUT_TAG..=LAST => {
                if register == FIFO_DATA_OUT_TAG {
                    self.word = self.fifo.pop_front().unwrap_or_default();
                }
                self.word[usize::from(register - FIFO_DATA_OUT_TAG)]
            }
            // The high bytes tell that the data are not new any more.
            0x23 | 0x25 | 0x27 => {
                self.registers[usize::from(STATUS_REG)] &= !2;
                self.get(register)
            }
            0x29 | 0x2b | 0x2d => {
                self.registers[usize::from(STATUS_REG)] &= !1;
                self.get(register)
            }
            other => self.get(other & 0x7f),
        }
    }

    /// The next register of a longer transfer. From the last byte of a word of the FIFO it goes to the tag
    /// of the next (AN5272, "FIFO reading procedure").
    fn count(&mut self) {
        if self.get(CTRL3_C) & IF_INC != 0 {
            self.pointer = match self.pointer {
                LAST => FIFO_DATA_OUT_TAG,
                other => (other + 1) & 0x7f,
            };
        }
    }

    fn set(&mut self, register: u8, value: u8) -> Result<(), &'static str> {
        let not_modelled = Err("a function of the LSM6DSOX that is not modelled");
        match register {
            CTRL3_C if value & SW_RESET != 0 => {
                self.reset();
                return Ok(());
            }
            FUNC_CFG_ACCESS if value != 0 => return not_modelled,
            // Compression, and other data for the FIFO.
            FIFO_CTRL2 if value & 0x5e != 0 => return not_modelled,
            FIFO_CTRL4 if value & 0xf0 != 0 || !matches!(value & 7, 0 | 1 | 6) => {
                return not_modelled;
            }
            // Another meaning of the ranges.
            CTRL8_XL if value & 2 != 0 => return not_modelled,
            // "Register mapping": registers that may be written.
            0x01..=0x02 | 0x04..=0x0e | 0x10..=0x19 | 0x56..=0x62 | 0x73..=0x75 => {}
            _ => return Err("a register of the LSM6DSOX that is reserved, or only read"),
        }
        if register == FIFO_CTRL4 && value & 7 == 0 {
            self.fifo.clear();
            self.was_full = false;
        }
        let value = match register {
            CTRL3_C => value & !BOOT,
            _ => value,
        };
        self.registers[usize::from(register)] = value;
        Ok(())
    }
}

impl Chip for Lsm6dsox {
    fn write(&mut self, bytes: &[u8], now: u64) -> Result<(), &'static str> {
        self.catch_up(now);
        let Some((&register, values)) = bytes.split_first() else {
            return Ok(());
        };
        self.pointer = register & 0x7f;
        for &value in values {
            self.set(self.pointer, value)?;
            self.count();
        }
        Ok(())
    }

    fn read(&mut self, into: &mut [u8], now: u64) {
        self.catch_up(now);
        for byte in into {
            *byte = self.register(self.pointer);
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
    fn chip(motion: Motion) -> Lsm6dsox {
        let mut chip = Lsm6dsox::new(Arc::new(motion), 0);
        chip.noise = 0.0;
        chip
    }

    fn read<const N: usize>(chip: &mut Lsm6dsox, register: u8, now: u64) -> [u8; N] {
        chip.write(&[register], now).unwrap();
        let mut into = [0; N];
        chip.read(&mut into, now);
        into
    }

    fn numbers(bytes: [u8; 6]) -> [i16; 3] {
        let [a, b, c, d, e, f] = bytes;
        [[a, b], [c, d], [e, f]].map(i16::from_le_bytes)
    }

    #[test]
    fn registers_after_power_on() {
        let mut chip = chip(Motion::default());
        for (register, value) in [(0x0f, 0x6c), (0x10, 0), (0x12, 0x04), (0x18, 0xe0)] {
            assert_eq!(read(&mut chip, register, 0), [value], "{register:#x}");
        }
        // It measures nothing.
        assert_eq!(read(&mut chip, STATUS_REG, 1_000 * MS), [0]);
    }

    /// "Mechanical characteristics": 1 g, and 100 dps.
    #[test]
    fn ranges() {
        let mut chip = chip(Motion {
            acceleration: [STANDARD_GRAVITY, -STANDARD_GRAVITY, 20.0 * STANDARD_GRAVITY],
            angular_rate: [100.0_f64.to_radians(), -(100.0_f64.to_radians()), 90.0],
            ..Motion::default()
        });
        let accelerations = [(0, 16_393), (1, 2_049), (2, 8_197), (3, 4_098)];
        for (now, (range, one)) in (1..).zip(accelerations) {
            chip.write(&[CTRL1_XL, 0x30 | range << 2], now * 100 * MS)
                .unwrap();
            let data = read(&mut chip, OUTX_L_A, (now * 100 + 50) * MS);
            assert_eq!(numbers(data), [one, -one, 32_767]);
        }
        let rates = [(0, 11_429), (1, 22_857), (2, 5_714), (4, 2_857), (6, 1_429)];
        for (now, (range, hundred)) in (5..).zip(rates) {
            chip.write(&[CTRL2_G, 0x30 | range << 1], now * 100 * MS)
                .unwrap();
            let data = read(&mut chip, OUTX_L_G, (now * 100 + 50) * MS);
            let expected = match range {
                1 => 22_857,
                _ => hundred,
            };
            assert_eq!(numbers(data), [expected, -expected, 32_767]);
        }
    }

    /// AN5272: 6667 Hz by 512 and so on.
    #[test]
    fn rates() {
        for (rate, expected) in [(1, 130), (3, 520), (5, 2083), (10, 66_670)] {
            let mut chip = chip(Motion::default());
            chip.write(&[CTRL1_XL, rate << 4], 0).unwrap();
            let mut measured = 0;
            // Faster than it measures.
            for now in 1..=500_000 {
                let status = read::<1>(&mut chip, STATUS_REG, now * 20_000);
                measured += u32::from(status[0] & 1);
                read::<6>(&mut chip, OUTX_L_A, now * 20_000);
            }
            assert!(
                (expected..=expected + 1).contains(&measured),
                "{rate}: {measured}"
            );
        }
    }

    #[test]
    fn words_wait_in_the_fifo() {
        let mut chip = chip(Motion::default());
        chip.fine = 20;
        chip.write(&[FIFO_CTRL3, 0x33, 0x06], 0).unwrap();
        chip.write(&[CTRL1_XL, 0x3c, 0x34], 0).unwrap();
        // 53.6 Hz, of two sensors.
        let [low, high] = read(&mut chip, FIFO_STATUS1, 1_000 * MS);
        assert_eq!([low, high], [106, 0]);
        let words: [u8; 21] = read(&mut chip, FIFO_DATA_OUT_TAG, 1_000 * MS);
        let tags = [words[0], words[7], words[14]];
        assert_eq!(
            tags.map(|tag| (tag >> 3, tag >> 1 & 3)),
            [(1, 1), (2, 1), (1, 2)]
        );
        assert!(tags.iter().all(|tag| tag.count_ones() % 2 == 0));
        assert_eq!(words[8..14], [0, 0, 0, 0, 0x02, 0x10]);
        assert_eq!(read(&mut chip, FIFO_STATUS1, 1_000 * MS), [103, 0]);
        // Full after 4.8 s: the oldest goes.
        assert_eq!(read(&mut chip, FIFO_STATUS1, 6_000 * MS), [0, 0x6a]);
        assert_eq!(read(&mut chip, FIFO_STATUS1, 6_001 * MS), [0, 0x62]);
        // Switched off and on it is empty.
        chip.write(&[FIFO_CTRL4, 0x00], 6_001 * MS).unwrap();
        chip.write(&[FIFO_CTRL4, 0x06], 6_001 * MS).unwrap();
        assert_eq!(read(&mut chip, FIFO_STATUS1, 6_002 * MS), [0, 0]);
        // In FIFO mode the newest goes.
        chip.write(&[FIFO_CTRL4, 0x00], 6_002 * MS).unwrap();
        chip.write(&[FIFO_CTRL4, 0x01], 6_002 * MS).unwrap();
        assert_eq!(read(&mut chip, FIFO_STATUS1, 20_000 * MS), [0, 0x6a]);
        let [first]: [u8; 1] = read(&mut chip, FIFO_DATA_OUT_TAG, 20_000 * MS);
        chip.write(&[CTRL1_XL, 0, 0], 20_000 * MS).unwrap();
        assert_eq!(first >> 3, 1);
        assert_eq!(read(&mut chip, FIFO_STATUS1, 30_000 * MS), [0xff, 0x21]);
    }

    #[test]
    fn the_watermark() {
        let mut chip = chip(Motion::default());
        chip.write(&[FIFO_CTRL1, 10, 0x80, 0x03, 0x06], 0).unwrap();
        chip.write(&[CTRL1_XL, 0x30], 0).unwrap();
        assert_eq!(read(&mut chip, FIFO_STATUS1, 185 * MS), [9, FULL_IA]);
        let all = WTM_IA | OVR_IA | FULL_IA | OVR_LATCHED;
        assert_eq!(read(&mut chip, FIFO_STATUS1, 1_000 * MS), [10, all]);
    }

    #[test]
    fn a_reset_switches_it_off() {
        let mut chip = chip(Motion::default());
        chip.write(&[CTRL1_XL, 0x3c, 0x34], 0).unwrap();
        chip.write(&[CTRL3_C, 0x05], 100 * MS).unwrap();
        assert_eq!(read(&mut chip, CTRL1_XL, 200 * MS), [0, 0, 0x04]);
        assert_eq!(read(&mut chip, STATUS_REG, 200 * MS), [0]);
    }

    #[test]
    fn what_it_forbids_is_told() {
        let mut chip = chip(Motion::default());
        for (register, value) in [
            (0x00, 0),
            (WHO_AM_I, 1),
            (0x30, 1),
            (FIFO_CTRL4, 3),
            (1, 0x80),
        ] {
            assert!(chip.write(&[register, value], 0).is_err(), "{register:#x}");
        }
    }

    /// At 52 Hz: 0.36 mg, and 19 mdps.
    #[test]
    fn its_noise_is_that_of_the_data_sheet() {
        let mut chip = Lsm6dsox::new(Arc::new(Motion::default()), 5);
        chip.write(&[CTRL1_XL, 0x30, 0x30], 0).unwrap();
        let (mut force, mut turn) = (0.0, 0.0);
        let count = 2_000;
        for sample in 1..=count {
            let now = sample * 20 * MS;
            let [x, ..] = numbers(read(&mut chip, OUTX_L_A, now));
            force += (f64::from(x) * 0.061).powi(2);
            let [x, ..] = numbers(read(&mut chip, OUTX_L_G, now));
            turn += (f64::from(x) * 8.75).powi(2);
        }
        let [force, turn] = [force, turn].map(|sum| (sum / count as f64).sqrt());
        assert!((0.33..0.39).contains(&force), "{force}");
        assert!((17.5..21.5).contains(&turn), "{turn}");
    }
}
