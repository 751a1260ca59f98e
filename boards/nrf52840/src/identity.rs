//! What makes this chip different from others.

use embassy_nrf::{Peri, pac::FICR, peripherals, rng::Rng};
use zigbee_link::wire::Eui64;

/// A true random number.
pub(crate) fn random(generator: Peri<'static, peripherals::RNG>) -> u64 {
    let mut generator = Rng::new_blocking(generator);
    generator.set_bias_correction(true);
    generator.blocking_next_u64()
}

/// The 64 random bits of the factory (Product Specification, "FICR", DEVICEID), as an address that
/// no manufacturer gives: locally administered, of one device.
pub(crate) fn factory_address() -> Eui64 {
    let id = u64::from(FICR.deviceid(0).read()) << 32 | u64::from(FICR.deviceid(1).read());
    let mut address = id.to_be_bytes();
    let [first, ..] = &mut address;
    *first = *first & !0x01 | 0x02;
    Eui64(address)
}
