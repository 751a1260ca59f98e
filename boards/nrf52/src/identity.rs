//! Chance.

use embassy_nrf::{Peri, peripherals, rng::Rng};

/// A true random number.
pub(crate) fn random(generator: Peri<'static, peripherals::RNG>) -> u64 {
    let mut generator = Rng::new_blocking(generator);
    generator.set_bias_correction(true);
    generator.blocking_next_u64()
}
