//! Flashes with pages so small that logs are often full. Tests of other crates use this file, too.
#![allow(
    unreachable_pub,
    reason = "where it is a module of a test, nothing is public"
)]

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

pub const PAGE: usize = 256;

pub type Flash = virtual_bench::flash::Flash<PAGE>;

/// Bytes of so many pages.
pub const fn length(pages: usize) -> u32 {
    (pages * PAGE) as u32
}

/// An erased chip of so many pages, with which nobody has to wait.
pub fn chip(pages: usize, seed: u64) -> Flash {
    Flash::without_time(pages, ChaCha8Rng::seed_from_u64(seed))
}
