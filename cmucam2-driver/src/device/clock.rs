//! Source of the driver's time.

/// The time, microseconds from any origin. It must not run backwards.
pub trait Clock {
    /// Microseconds since the origin.
    fn now(&self) -> u64;

    /// The driver has let at least so many microseconds pass. For clocks that have no other source.
    fn passed(&mut self, us: u32) {
        let _ = us;
    }
}

/// The clock that a program has anyway, as `|| timer.now_us()`.
impl<F: Fn() -> u64> Clock for F {
    fn now(&self) -> u64 {
        self()
    }
}

/// The sum of the driver's own delays: less than the truth, and it stands still between calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SummedDelays(u64);

impl Clock for SummedDelays {
    fn now(&self) -> u64 {
        self.0
    }

    fn passed(&mut self, us: u32) {
        self.0 += u64::from(us);
    }
}
