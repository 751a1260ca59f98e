//! Chips on the bus of TWIM0, each after its data sheet, and the motion and field that act on them.

mod lis3mdl;
mod lsm6dsox;

use std::{
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

pub use self::{lis3mdl::Lis3mdl, lsm6dsox::Lsm6dsox};

/// Motion and field that act on sensors at one instant, along the axes x, y and z printed on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Specific force, m/s^2: at rest, 9.81 along the axis that points up.
    pub acceleration: [f64; 3],
    /// Angular rate, rad/s, right-handed about each axis.
    pub angular_rate: [f64; 3],
    /// Magnetic field, uT.
    pub field: [f64; 3],
}

impl Default for Motion {
    /// Lies flat and heads for magnetic north, in the middle of Europe.
    fn default() -> Self {
        Self {
            acceleration: [0.0, 0.0, STANDARD_GRAVITY],
            angular_rate: [0.0; 3],
            field: [20.0, 0.0, -43.0],
        }
    }
}

/// m/s^2.
const STANDARD_GRAVITY: f64 = 9.806_65;

/// Surroundings of sensors.
pub trait World: fmt::Debug + Send + Sync {
    /// Motion and field at an instant, nanoseconds since power came. Asked for instants that may lie seconds back,
    /// in no order.
    fn at(&self, now: u64) -> Motion;
}

/// Nothing changes.
impl World for Motion {
    fn at(&self, _: u64) -> Motion {
        *self
    }
}

/// Motions that become known while a node runs: each lasts until the next one.
#[derive(Debug, Default)]
pub struct Samples(Mutex<Vec<(u64, Motion)>>);

impl Samples {
    /// Sets the motion from this instant on, nanoseconds since power came. All that was told for later instants is
    /// void. A chip measures when it is asked: a motion for a time before the last question may come late.
    pub fn push(&self, at: u64, motion: Motion) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = all.partition_point(|&(earlier, _)| earlier < at);
        all.truncate(kept);
        all.push((at, motion));
    }
}

impl World for Samples {
    fn at(&self, now: u64) -> Motion {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = all.partition_point(|&(at, _)| at <= now);
        let last = begun.checked_sub(1).and_then(|place| all.get(place));
        last.map_or_else(Motion::default, |&(_, motion)| motion)
    }
}

/// The error of a chip that does not acknowledge a byte: the master sees that, and nothing is wrong with it.
pub const NOT_ACKNOWLEDGED: &str = "NAK";

/// A chip that is asked and told by the master of the bus.
pub trait Chip: fmt::Debug + Send {
    /// A write has ended: the first byte names a register.
    ///
    /// # Errors
    /// An action that the data sheet forbids, or that is not modelled; or [`NOT_ACKNOWLEDGED`].
    fn write(&mut self, bytes: &[u8], now: u64) -> Result<(), &'static str>;

    /// A read of so many bytes has ended.
    fn read(&mut self, into: &mut [u8], now: u64);
}

/// Three numbers as a chip gives them: two's complement, the low byte first, no more than it can tell.
fn bytes(values: [f64; 3], unit: f64) -> [u8; 6] {
    let mut all = [0; 6];
    for (bytes, value) in all.as_chunks_mut().0.iter_mut().zip(values) {
        // `as` saturates.
        *bytes = ((value / unit).round() as i16).to_le_bytes();
    }
    all
}

/// White noise, the same for the same seed.
#[derive(Clone, Debug)]
struct Noise(u64);

impl Noise {
    fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Each value with an error of this standard deviation.
    fn on(&mut self, values: [f64; 3], sigma: f64) -> [f64; 3] {
        values.map(|value| value + sigma * self.normal())
    }

    /// The sum of twelve uniform numbers, less six, has the variance of one.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }

    /// `SplitMix64` (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014).
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ mixed >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// The step sensor of a target: an [`Lsm6dsox`] and an [`Lis3mdl`] at the addresses that they have on
/// Adafruit's breakout 4517, in one world.
pub fn step_sensor(
    world: &Arc<dyn World>,
    seed: u64,
) -> std::collections::BTreeMap<u32, Box<dyn Chip>> {
    let motion: Box<dyn Chip> = Box::new(Lsm6dsox::new(Arc::clone(world), seed));
    let compass: Box<dyn Chip> = Box::new(Lis3mdl::new(Arc::clone(world), !seed));
    [(Lsm6dsox::ADDRESS, motion), (Lis3mdl::ADDRESS, compass)].into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_lasts_until_the_next() {
        let samples = Samples::default();
        let turning = |rate| Motion {
            angular_rate: [rate, 0.0, 0.0],
            ..Motion::default()
        };
        assert_eq!(samples.at(5), Motion::default());
        for (at, rate) in [(10, 1.0), (20, 2.0), (30, 3.0)] {
            samples.push(at, turning(rate));
        }
        let rates = [9, 10, 19, 20, 99].map(|at| samples.at(at).angular_rate[0]);
        assert_eq!(rates, [0.0, 1.0, 1.0, 2.0, 3.0]);
        samples.push(15, turning(4.0));
        let rates = [14, 15, 99].map(|at| samples.at(at).angular_rate[0]);
        assert_eq!(rates, [1.0, 4.0, 4.0]);
    }

    #[test]
    fn noise_has_its_mean_and_its_variance() {
        let mut noise = Noise::new(3);
        let count = 100_000;
        let all: Vec<f64> = (0..count).map(|_| noise.normal()).collect();
        let mean = all.iter().sum::<f64>() / f64::from(count);
        let variance = all.iter().map(|value| value * value).sum::<f64>() / f64::from(count);
        assert!(mean.abs() < 0.01, "{mean}");
        assert!((variance - 1.0).abs() < 0.02, "{variance}");
    }
}
