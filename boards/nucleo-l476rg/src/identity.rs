//! Chance.

use embassy_stm32::{Peri, pac::RNG, peripherals, rcc};

/// A true random number. Never returns if the chip cannot make one.
pub(crate) fn random(_generator: Peri<'static, peripherals::RNG>) -> u64 {
    rcc::enable_and_reset::<peripherals::RNG>();
    // The first one after the start is not to be used (reference manual RM0351, "RNG operation").
    let _ = word();
    let random = u64::from(word()) << 32 | u64::from(word());
    rcc::disable::<peripherals::RNG>();
    random
}

fn word() -> u32 {
    loop {
        let state = RNG.sr().read();
        if state.seis() || state.ceis() {
            // Begins anew with another seed (the same, "Error management").
            RNG.sr().write(|state| {
                state.set_seis(false);
                state.set_ceis(false);
            });
            RNG.cr().modify(|control| control.set_rngen(false));
        } else if state.drdy() {
            return RNG.dr().read();
        }
        RNG.cr().modify(|control| control.set_rngen(true));
    }
}
