//! Flashes with pages so small that logs are often full. Tests of other crates use this file, too.
#![allow(
    dead_code,
    unreachable_pub,
    unused_imports,
    reason = "where it is a module of a test, nothing is public, and no test uses all"
)]

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

pub use virtual_hardware::worn::{Fault, Faults};

pub const PAGE: usize = 256;

pub type Flash = virtual_hardware::flash::Flash<PAGE>;
pub type Faulty = virtual_hardware::worn::Worn<PAGE>;

/// Bytes of so many pages.
pub const fn length(pages: usize) -> u32 {
    (pages * PAGE) as u32
}

/// An erased chip of so many pages, whose operations take no time.
pub fn chip(pages: usize, seed: u64) -> Flash {
    Flash::without_time(pages, ChaCha8Rng::seed_from_u64(seed))
}
