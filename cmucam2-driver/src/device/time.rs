//! Source of the driver's time.

/// The time, microseconds from any origin, as the driver is given it: a closure over the clock that a program has
/// anyway, `|| timer.now_us()`, or [`SummedDelays`]. It must not run backwards.
///
/// Sealed: it is no clock of its own that a board would implement.
pub trait TimeSource: sealed::Sealed {
    /// Microseconds since the origin.
    fn now(&self) -> u64;

    /// The driver has let at least so many microseconds pass. For sources that have no other time.
    fn passed(&mut self, us: u32) {
        let _ = us;
    }
}

impl<F: Fn() -> u64> TimeSource for F {
    fn now(&self) -> u64 {
        self()
    }
}

/// The sum of the driver's own delays: less than the truth, and it stands still between calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SummedDelays(u64);

impl TimeSource for SummedDelays {
    fn now(&self) -> u64 {
        self.0
    }

    fn passed(&mut self, us: u32) {
        self.0 += u64::from(us);
    }
}

mod sealed {
    pub trait Sealed {}

    impl<F: Fn() -> u64> Sealed for F {}

    impl Sealed for super::SummedDelays {}
}
