//! The LSM6DSOX: accelerometer and gyroscope, and the FIFO in which their samples wait.
//!
//! Facts are those of its datasheet, DS12814, by the names of its sections and registers, and of its
//! application note AN5272.

use nalgebra::Vector3;

use super::{
    fault::{Chip, SensorError, SensorFault},
    triple, vector, warning,
};

/// Bytes of a word of the FIFO, the tag first ("FIFO reading procedure").
pub(super) const WORD: usize = 7;
/// Bytes of a word without its tag.
pub(super) const DATA: usize = 6;

/// "`FIFO_CTRL4` (0Ah)": the FIFO is off. A chip whose FIFO streams, of a board that was restarted alone, may
/// refuse its reset.
pub(super) const BYPASS: [u8; 2] = [0x0A, 0x00];

/// "`CTRL3_C` (12h)": bit 0 resets, bit 2 counts register numbers up in longer reads and writes.
pub(super) const RESET: [u8; 2] = [0x12, 0x05];

/// After a reset, when the FIFO is off.
pub(super) const SETTINGS: [[u8; 2]; 6] = [
    // "`CTRL9_XL` (18h)": as after a reset, and bit 1: no I3C on this bus.
    [0x18, 0xE2],
    // "`CTRL3_C` (12h)": bit 6, both bytes of a number are of one sample; bit 2 as above.
    [0x12, 0x44],
    // "`FIFO_CTRL3` (09h)": both sensors into the FIFO at 52 Hz.
    [0x09, 0x33],
    // "`FIFO_CTRL4` (0Ah)": continuous mode, the oldest goes when it is full.
    [0x0A, 0x06],
    // "`CTRL1_XL` (10h)": 52 Hz; 8 g, more than a heel makes at the hip.
    [0x10, 0x3C],
    // "`CTRL2_G` (11h)": 52 Hz; 500 degrees a second, faster than a person turns.
    [0x11, 0x34],
];

/// "`FIFO_STATUS1` (3Ah)" and "`FIFO_STATUS2` (3Bh)": words in the FIFO, 10 bits, the low byte first;
/// in the second byte, bit 3: something was lost since the last read, bit 6: now.
pub(super) const FIFO_STATUS: u8 = 0x3A;
const LOST: u8 = 0x48;
/// "`FIFO_DATA_OUT_TAG` (78h)" and the six bytes of a word. After the last of these a read goes on
/// with the tag of the next word (AN5272; Linux's driver `st_lsm6dsx` reads it so).
pub(super) const FIFO_OUT: u8 = 0x78;
/// "`INTERNAL_FREQ_FINE` (63h)": excess of its clock over the nominal one, signed, in steps of 0.15 %.
pub(super) const FREQUENCY: u8 = 0x63;
const FREQUENCY_STEP: f32 = 0.0015;
/// The usual time between two samples: the nominal clock has 6,667 Hz, and 52 Hz is its 128th part
/// (AN5272, `ODR_Coeff`).
const PERIOD_US: f32 = 128e6 / 6667.0;

const STANDARD_GRAVITY: f32 = 9.806_65;
/// "Mechanical characteristics": 0.244 mg at 8 g, 17.5 mdps at 500 dps.
const ACCELERATION: f32 = 0.244e-3 * STANDARD_GRAVITY;
const ANGULAR_RATE: f32 = 17.5e-3 * core::f32::consts::PI / 180.0;

/// The time between two samples, us, from the register of the frequency.
pub(super) fn period_us(fine: u8) -> u64 {
    let faster = f32::from(i8::from_le_bytes([fine])) * FREQUENCY_STEP;
    (PERIOD_US / (1.0 + faster)) as u64
}

/// Number of words that wait in the FIFO, from its status.
pub(super) fn waiting([low, high]: [u8; 2]) -> Result<u16, SensorError> {
    if high & LOST != 0 {
        return Err(Chip::Motion.is(SensorFault::Overrun));
    }
    Ok(u16::from_le_bytes([low, high & 0x03]))
}

/// Angular rate and acceleration of a slot's data.
pub(super) fn in_si(data: &[u8; 2 * DATA]) -> (Vector3<f32>, Vector3<f32>) {
    let (rate, force) = data.split_at(DATA);
    let part = |bytes: &[u8], unit| {
        let numbers = bytes.first_chunk().map(triple).unwrap_or_default();
        vector(numbers, unit)
    };
    (part(rate, ANGULAR_RATE), part(force, ACCELERATION))
}

/// Of an LSM6DSO32, which says that it is an LSM6DSOX: all its ranges are twice as large (DS13114, "Mechanical
/// characteristics").
const SCALE_OF_32: f32 = 2.0;
/// Samples over which gravity is measured: two seconds. Steps make of it a little more at most.
const WEIGHED: u8 = 104;
/// Of gravity, half of which the one chip measures where the other one measures it.
const LEAST: f32 = 0.7 * STANDARD_GRAVITY;
const MOST: f32 = 2.0 * LEAST;

/// The scale of the accelerometer, which gravity tells.
#[derive(Debug)]
pub(super) struct Scale {
    factor: f32,
    weighing: Weighing,
}

#[derive(Debug, Default)]
struct Weighing {
    sum: f32,
    count: u8,
}

impl Default for Scale {
    fn default() -> Self {
        Self {
            factor: 1.0,
            weighing: Weighing::default(),
        }
    }
}

impl Scale {
    /// Gravity is measured again. Until then the scale is as it was.
    pub(super) fn weigh(&mut self) {
        self.weighing = Weighing::default();
    }

    /// Returns true if gravity was measured, and fits.
    pub(super) const fn is_weighed(&self) -> bool {
        self.weighing.count == WEIGHED
    }

    /// An acceleration in this scale. None where this showed that the chip has another one: from now on it
    /// has that.
    pub(super) fn apply(
        &mut self,
        acceleration: Vector3<f32>,
    ) -> Result<Option<Vector3<f32>>, SensorError> {
        let scaled = acceleration * self.factor;
        if self.is_weighed() {
            return Ok(Some(scaled));
        }
        self.weighing.sum += scaled.norm();
        self.weighing.count += 1;
        if self.weighing.count < WEIGHED {
            return Ok(Some(scaled));
        }
        let gravity = self.weighing.sum / f32::from(WEIGHED);
        let is_32 = self.factor > 1.0;
        if (LEAST..MOST).contains(&gravity) {
            return Ok(Some(scaled));
        }
        self.weigh();
        if (LEAST / 2.0..LEAST).contains(&gravity) && !is_32 {
            warning!("the accelerometer is an LSM6DSO32's: its scale is taken");
            self.factor = SCALE_OF_32;
            return Ok(None);
        }
        if (MOST..2.0 * MOST).contains(&gravity) {
            // More than steps can make, if it was taken for the other chip.
            if is_32 {
                self.factor = 1.0;
                return Ok(None);
            }
            return Ok(Some(scaled));
        }
        Err(Chip::Motion.is(SensorFault::Scale))
    }
}

/// Puts the two words of a slot of time together.
#[derive(Debug, Default)]
pub(super) struct Slots {
    /// Two bits that count slots.
    number: u8,
    gyroscope: Option<[u8; DATA]>,
    accelerometer: Option<[u8; DATA]>,
    /// Number of the last slot that was complete.
    complete: Option<u8>,
}

impl Slots {
    /// Takes a word. When its slot is complete, returns its data: the gyroscope's and the accelerometer's,
    /// and its distance from the last complete slot, 1 to 4.
    pub(super) fn take(
        &mut self,
        word: &[u8; WORD],
    ) -> Result<Option<([u8; 2 * DATA], u64)>, SensorError> {
        let [tag, data @ ..] = *word;
        // "`FIFO_DATA_OUT_TAG` (78h)": sensor, number of the slot, parity.
        let number = tag >> 1 & 0x03;
        if number != self.number {
            self.number = number;
            self.gyroscope = None;
            self.accelerometer = None;
        }
        match tag >> 3 {
            1 => self.gyroscope = Some(data),
            2 => self.accelerometer = Some(data),
            _ => return Err(Chip::Motion.is(SensorFault::Garbled)),
        }
        let (Some(rate), Some(force)) = (self.gyroscope, self.accelerometer) else {
            return Ok(None);
        };
        self.gyroscope = None;
        self.accelerometer = None;
        let last = self.complete.replace(number);
        let after = last.map_or(1, |last| number.wrapping_sub(last) & 0x03);
        let mut both = [0; 2 * DATA];
        for (to, from) in both.iter_mut().zip(rate.iter().chain(&force)) {
            *to = *from;
        }
        Ok(Some((both, if after == 0 { 4 } else { after.into() })))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 6667 Hz by 128, and 0.15 % for each step.
    #[test]
    fn the_clock_of_the_chip() {
        assert_eq!(period_us(0), 19_199);
        assert_eq!(period_us(20), 18_639);
        assert_eq!(period_us(0xEC), 19_792);
    }

    #[test]
    fn numbers_in_si() {
        let data = [1, 0, 0xFF, 0xFF, 0, 0x80, 0, 0x10, 0, 0xF0, 0xFF, 0x7F];
        let (rate, force) = in_si(&data);
        let dps = 17.5e-3_f32.to_radians();
        assert_eq!(rate, Vector3::new(dps, -dps, -32_768.0 * dps));
        // 4096 are a little less than 1 g, and the most a little less than 8 g.
        let g = 4096.0 * 0.244e-3 * 9.806_65;
        let expected = Vector3::new(g, -g, 32_767.0 / 4096.0 * g);
        assert!((force - expected).norm() < 1e-4, "{force}");
    }

    #[test]
    fn slots_are_told_by_their_numbers() {
        let word = |sensor: u8, slot: u8| [sensor << 3 | slot << 1, slot, 0, 0, 0, 0, sensor];
        let mut slots = Slots::default();
        let mut take = |sensor, slot| {
            slots
                .take(&word(sensor, slot))
                .map(|taken| taken.map(|(data, after)| (data[0], data[5], data[11], after)))
        };
        assert_eq!(take(1, 3), Ok(None));
        assert_eq!(take(2, 3), Ok(Some((3, 1, 2, 1))));
        // In either order.
        assert_eq!(take(2, 0), Ok(None));
        assert_eq!(take(1, 0), Ok(Some((0, 1, 2, 1))));
        // Half of a slot, and then two are missing.
        assert_eq!(take(1, 1), Ok(None));
        assert_eq!(take(2, 3), Ok(None));
        assert_eq!(take(1, 3), Ok(Some((3, 1, 2, 3))));
        // Three are missing.
        assert_eq!(take(1, 3), Ok(None));
        assert_eq!(take(2, 3), Ok(Some((3, 1, 2, 4))));
        let garbled = Err(Chip::Motion.is(SensorFault::Garbled));
        assert_eq!(take(0, 0), garbled);
        assert_eq!(take(3, 0), garbled);
    }

    #[test]
    fn what_was_lost_is_noticed() {
        assert_eq!(waiting([5, 0]), Ok(5));
        assert_eq!(waiting([0xFF, 0x81]), Ok(511));
        for lost in [0x08, 0x40, 0xFF] {
            assert_eq!(
                waiting([5, lost]),
                Err(Chip::Motion.is(SensorFault::Overrun))
            );
        }
    }
}
