//! What was said before a reset.
#![allow(
    unsafe_code,
    reason = "memory outside the language, and a trampoline of an exception"
)]

use core::{cell::UnsafeCell, panic::PanicInfo};

use board_support::last_words::LastWords;
use cortex_m::{interrupt, peripheral::SCB};
use cortex_m_rt::{ExceptionFrame, exception};

struct Retained(UnsafeCell<LastWords>);

// SAFETY: it is only touched by `take`, with interrupts off, and by handlers that never return.
unsafe impl Sync for Retained {}

/// In a section that start-up code does not touch.
#[unsafe(link_section = ".uninit.last_words")]
static RETAINED: Retained = Retained(UnsafeCell::new(LastWords::NONE));

/// What was said before the reset, if anything. Once.
pub(crate) fn take() -> LastWords {
    interrupt::free(|_| {
        // SAFETY: nobody else touches it meanwhile, and any bits are a value. Volatile, because
        // the value is not the initial one that the compiler sees.
        unsafe {
            let words = RETAINED.0.get().read_volatile();
            RETAINED.0.get().write_volatile(LastWords::NONE);
            words
        }
    })
}

fn say_and_restart(words: LastWords) -> ! {
    interrupt::disable();
    // SAFETY: nothing else runs any more.
    unsafe { RETAINED.0.get().write_volatile(words) };
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
/// no stack left for this handler the processor locks up, which restarts it as well.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    say_and_restart(LastWords::fault(frame.pc()))
}
