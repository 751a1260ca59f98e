//! How fast virtual time passes.

use std::{
    thread,
    time::{Duration, Instant},
};

use super::Time;

/// Shorter waits than this are left to add up.
const SLICE: Duration = Duration::from_millis(1);

/// A pace for [`Executor::set_pace`](super::Executor::set_pace): `speed` times as fast as the wall
/// clock, from now on. Where the machine is too slow, time passes as fast as it can, without
/// catching up on what was lost.
pub fn times_real_time(speed: f64) -> impl FnMut(Time) {
    let mut begun: Option<(Instant, Time)> = None;
    move |time| {
        let (start, from) = *begun.get_or_insert_with(|| (Instant::now(), time));
        let due = Duration::from_nanos(((time - from) as f64 / speed) as u64);
        let passed = start.elapsed();
        match due.checked_sub(passed) {
            Some(ahead) if ahead >= SLICE => thread::sleep(ahead),
            Some(_) => {}
            None => begun = Some((Instant::now(), time)),
        }
    }
}
