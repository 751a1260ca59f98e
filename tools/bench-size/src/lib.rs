//! Common parts of the images for measuring: `cargo xtask size` builds them and compares each with the empty one.
//!
//! Radio, flash and clock are stubs that the compiler cannot see through, so that everything an
//! application could reach is in the image and nothing of a driver is. RAM is the future of the
//! whole node, kept in a static as an executor does; the stack is not counted.
#![no_std]
#![forbid(unsafe_code)]

mod stub;
pub mod task;

use core::{future::Future, sync::atomic::AtomicU8};

pub use self::stub::idle;

/// Place where an executor would keep a task of `LEN` bytes.
pub struct Place<const LEN: usize>([AtomicU8; LEN]);

impl<const LEN: usize> Place<LEN> {
    /// A place.
    #[expect(clippy::new_without_default, reason = "only for statics")]
    pub const fn new() -> Self {
        Self([const { AtomicU8::new(0) }; LEN])
    }
}

/// Bytes of the future of a task.
pub const fn size_of_task<F: Future>(_: &impl Fn() -> F) -> usize {
    size_of::<F>()
}

/// The binary of a task.
#[macro_export]
macro_rules! image {
    ($task:path) => {
        #[cfg(target_os = "none")]
        #[used]
        static TASK: $crate::Place<{ $crate::size_of_task(&$task) }> = $crate::Place::new();

        #[cfg(target_os = "none")]
        #[cortex_m_rt::entry]
        fn main() -> ! {
            embassy_futures::block_on($task());
            $crate::idle()
        }

        #[cfg(target_os = "none")]
        #[panic_handler]
        fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
            $crate::idle()
        }

        #[cfg(not(target_os = "none"))]
        fn main() {
            eprintln!("this is only measured: type `cargo xtask size`");
            std::process::exit(1);
        }
    };
}
