//! Which interrupt is whose (ARM application note 386, "Interrupts").
#![allow(
    unsafe_code,
    reason = "the table that the processor reads, and its switches"
)]

use cortex_m::{interrupt::InterruptNumber, peripheral::NVIC};
use semihosting::process::ExitCode;

use crate::{timer, uart};

const VECTORS: usize = 32;

/// Interrupts in use.
const USED: [u16; 8] = [0, 1, 2, 3, 4, 5, 8, 9];

#[derive(Clone, Copy)]
struct Number(u16);

// SAFETY: only made of `USED`, whose numbers are below `VECTORS`.
unsafe impl InterruptNumber for Number {
    fn number(self) -> u16 {
        self.0
    }
}

/// Lets interrupts happen. The peripherals decide whether they do.
pub(crate) fn enable() {
    for number in USED {
        // SAFETY: every shared value is behind a critical section, which this does not break.
        unsafe { NVIC::unmask(Number(number)) };
    }
}

/// After the processor's own exceptions. The order is the hardware's.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [extern "C" fn(); VECTORS] = {
    let mut table: [extern "C" fn(); VECTORS] = [unexpected; VECTORS];
    table[0] = uart0;
    table[1] = uart0;
    table[2] = uart1;
    table[3] = uart1;
    table[4] = uart2;
    table[5] = uart2;
    table[8] = timer::carry;
    table[9] = timer::alarm;
    table
};

extern "C" fn uart0() {
    uart::DEVICE.on_interrupt();
}

extern "C" fn uart1() {
    uart::RADIO.on_interrupt();
}

extern "C" fn uart2() {
    uart::PANEL.on_interrupt();
}

/// Nothing else was switched on.
extern "C" fn unexpected() {
    ExitCode::from(crate::node::BROKEN).exit_process()
}
