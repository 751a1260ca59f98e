//! What makes this chip different from others.

use board_support::identity::local_address;
use embassy_nrf::{Peri, pac::FICR, peripherals, rng::Rng};
use zigbee_link::wire::Eui64;

/// A true random number.
pub(crate) fn random(generator: Peri<'static, peripherals::RNG>) -> u64 {
    let mut generator = Rng::new_blocking(generator);
    generator.set_bias_correction(true);
    generator.blocking_next_u64()
}

/// Made of the 64 random bits of the factory (Product Specification, "FICR", DEVICEID).
pub(crate) fn factory_address() -> Eui64 {
    local_address(u64::from(FICR.deviceid(0).read()) << 32 | u64::from(FICR.deviceid(1).read()))
}
