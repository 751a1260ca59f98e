//! Rate at which virtual time passes.

use std::{
    thread,
    time::{Duration, Instant},
};

use super::Time;

/// Shorter waits than this are left to add up.
const SLICE: Duration = Duration::from_millis(1);

/// Lag up to which a run catches up; a greater lag is not caught up on at all.
const LAG: Duration = Duration::from_millis(100);

/// Step before virtual time goes on.
#[derive(Debug, PartialEq)]
enum Step {
    Wait(Duration),
    Go,
    /// Go, and count from here.
    Rebase,
}

/// Step after so much real time has passed, where so much should have.
fn step(passed: Duration, due: Duration) -> Step {
    match due.checked_sub(passed) {
        Some(ahead) if ahead >= SLICE => Step::Wait(ahead),
        None if passed - due > LAG => Step::Rebase,
        _ => Step::Go,
    }
}

/// A pace for [`Executor::set_pace`](super::Executor::set_pace): `speed` times as fast as the wall clock, from now
/// on. Where the machine is too slow, time passes as fast as it can; a lag of more than a tenth of a second is not
/// caught up on.
pub fn times_real_time(speed: f64) -> impl FnMut(Time) {
    let mut begun: Option<(Instant, Time)> = None;
    move |time| {
        let (start, from) = *begun.get_or_insert_with(|| (Instant::now(), time));
        let due = Duration::from_nanos(((time - from) as f64 / speed) as u64);
        match step(start.elapsed(), due) {
            Step::Wait(ahead) => thread::sleep(ahead),
            Step::Go => {}
            Step::Rebase => begun = Some((Instant::now(), time)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_ahead_waits_and_who_is_far_behind_gives_up() {
        let ms = Duration::from_millis;
        for (passed, due, expected) in [
            (0, 6000, Step::Wait(ms(6000))),
            (499, 500, Step::Wait(ms(1))),
            (500, 500, Step::Go),
            (600, 500, Step::Go),
            (601, 500, Step::Rebase),
            (9000, 0, Step::Rebase),
        ] {
            assert_eq!(step(ms(passed), ms(due)), expected, "{passed} {due}");
        }
        let almost = ms(500) - Duration::from_nanos(1);
        assert_eq!(step(ms(499), almost), Step::Go);
    }
}
