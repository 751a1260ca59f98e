//! Words from before a reset.
#![allow(
    unsafe_code,
    reason = "memory outside the language, and a trampoline of an exception"
)]

use core::{cell::UnsafeCell, panic::PanicInfo};

use cortex_m::{interrupt, peripheral::SCB};
use cortex_m_rt::{ExceptionFrame, exception};

use crate::last_words::LastWords;

struct Retained(UnsafeCell<LastWords>);

// SAFETY: it is only touched by `take` and `say`, with interrupts off, and by handlers that never return.
unsafe impl Sync for Retained {}

/// In a section that start-up code does not touch.
#[unsafe(link_section = ".uninit.last_words")]
static RETAINED: Retained = Retained(UnsafeCell::new(LastWords::NONE));

/// Words from before the reset, if any. Once.
pub fn take() -> LastWords {
    interrupt::free(|_| {
        let mut words = LastWords::NONE;
        // SAFETY: nothing else touches it meanwhile.
        unsafe {
            copy(RETAINED.0.get(), &raw mut words);
            copy(&LastWords::NONE, RETAINED.0.get());
        }
        words
    })
}

/// Copies words byte by byte: volatile as a whole, each byte would be an instruction of its own.
///
/// # Safety
/// Both places are there, and nothing else touches them meanwhile.
unsafe fn copy(from: *const LastWords, to: *mut LastWords) {
    for at in 0..size_of::<LastWords>() {
        // SAFETY: within both places, and any bits are a value. Volatile, because the value is not
        // the initial one that the compiler sees.
        unsafe {
            let byte = from.cast::<u8>().add(at).read_volatile();
            to.cast::<u8>().add(at).write_volatile(byte);
        }
    }
}

/// Notes the reason for the next restart, which is told after it.
pub fn say(words: LastWords) {
    interrupt::free(|_| {
        // SAFETY: nothing else touches it meanwhile.
        unsafe { copy(&raw const words, RETAINED.0.get()) };
    });
}

/// Restarts the chip. The reason is told after that.
pub fn say_and_restart(words: LastWords) -> ! {
    interrupt::disable();
    say(words);
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    let (file, line) = info
        .location()
        .map_or(("", 0), |place| (place.file(), place.line()));
    say_and_restart(LastWords::panic(file, line, info.message().as_str()))
}

/// A stack that overflows ends here too: `flip-link` puts it where nothing is below. Where there is
/// no stack left for this handler the processor locks up: the chip restarts then, or its watchdog does
/// that.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    say_and_restart(LastWords::fault(frame.pc()))
}
