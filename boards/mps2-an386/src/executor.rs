//! Runs tasks, and lets the processor sleep in between.
//!
//! With WFI: the emulator takes WFE, with which `embassy-executor`'s own thread executor sleeps, for
//! an instruction that does nothing, and would keep a core of the computer busy for each board.
#![allow(
    unsafe_code,
    reason = "the executor has to be told that it is polled in one place"
)]

use core::{
    ptr,
    sync::atomic::{AtomicBool, Ordering},
};

use embassy_executor::{Spawner, raw::Executor};
use static_cell::StaticCell;

/// A task was woken.
static WOKEN: AtomicBool = AtomicBool::new(false);

#[unsafe(export_name = "__pender")]
fn wake(_: *mut ()) {
    WOKEN.store(true, Ordering::Relaxed);
}

/// Runs tasks, the ones that `begin` spawns first.
pub(crate) fn run(begin: impl FnOnce(Spawner)) -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    let executor: &'static Executor = EXECUTOR.init(Executor::new(ptr::null_mut()));
    begin(executor.spawner());
    loop {
        // SAFETY: this is the only place, and no task comes here.
        unsafe { executor.poll() };
        // An interrupt that comes after the look ends the sleep all the same.
        cortex_m::interrupt::free(|_| {
            if !WOKEN.swap(false, Ordering::Relaxed) {
                cortex_m::asm::wfi();
            }
        });
    }
}
