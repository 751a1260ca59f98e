//! Counting the instructions of one call.
//!
//! A timer's tick is many instructions, so each input is worked on [`REPEATS`] times, and so is the same input by
//! a closure that does nothing. The difference, divided and rounded, is the cost of one call: the input read
//! through a pointer, the routine, inlined or called as the compiler sees fit, and the result stored on the stack.
//! The call through a pointer, its frame and the loop are the same for both and cancel.

use core::{fmt, hint::black_box};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Different inputs per routine. Odd, so that there is a middle one.
pub const INPUTS: usize = 65;

/// Calls per input. Start and end of two runs are each off by less than one tick; with ticks of
/// up to 100 instructions this leaves less than half an instruction, which rounding removes.
pub const REPEATS: u32 = 500;

/// Steps of a routine that is counted step by step, at most.
const STEPS: usize = 2000;

/// Every routine starts from this seed: those that draw the same kind of input get the same ones.
const SEED: u64 = 2014;

/// A timer that counts instructions.
pub trait Counter {
    /// Starts from zero.
    fn start(&mut self);

    /// Instructions since [`Counter::start`], to within a tick. `None` if there were too many to
    /// count.
    fn stop(&mut self) -> Option<u64>;
}

/// Instructions of one call, over [`INPUTS`] inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// The fewest.
    pub min: u64,
    /// The middle one.
    pub median: u64,
    /// The most.
    pub max: u64,
}

/// Reason why there is no count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// The routine ran longer than the timer can count.
    TooLong,
    /// A routine of known length was counted wrongly, so no count can be trusted.
    Calibration {
        /// Instructions there are.
        expected: u64,
        /// Instructions counted.
        counted: u64,
    },
    /// The output did not take a line.
    Output,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLong => f.write_str("a routine outlasts the timer: lower REPEATS"),
            Self::Calibration { expected, counted } => write!(
                f,
                "{expected} instructions were counted as {counted}: is the emulator running with \
                 `-icount shift=0`, on the board this was built for?"
            ),
            Self::Output => f.write_str("the output does not take a line"),
        }
    }
}

impl core::error::Error for Error {}

impl From<fmt::Error> for Error {
    fn from(_: fmt::Error) -> Self {
        Self::Output
    }
}

/// Measures with a counter, prints to an output.
#[derive(Debug)]
pub struct Bench<C, W> {
    counter: C,
    output: W,
}

impl<C: Counter, W: fmt::Write> Bench<C, W> {
    /// A bench that counts with `counter` and prints to `output`.
    pub fn new(counter: C, output: W) -> Self {
        Self { counter, output }
    }

    /// Counts `work` on [`INPUTS`] inputs drawn by `draw`, and prints
    /// `instructions <name> <min> <median> <max>`.
    ///
    /// The name has no spaces. The result of `work` is computed in full, even if it is not used. Variables that
    /// `work` captures stay from call to call: a parser, a frame counter, a buffer.
    ///
    /// # Errors
    /// [`Error::TooLong`], [`Error::Output`].
    pub fn measure<I, O>(
        &mut self,
        name: &str,
        mut draw: impl FnMut(&mut ChaCha8Rng) -> I,
        mut work: impl FnMut(&I) -> O,
    ) -> Result<Counts, Error> {
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut counts = [0; INPUTS];
        for count in &mut counts {
            *count = self.count(&draw(&mut random), &mut work)?;
        }
        self.report(name, &mut counts)
    }

    /// Counts `work` as [`measure`](Self::measure) does, but once for each input: it is too long to be repeated. The
    /// cost of a call of nothing is in it, and up to a tick.
    ///
    /// # Errors
    /// [`Error::TooLong`], [`Error::Output`].
    pub fn measure_long<I, O>(
        &mut self,
        name: &str,
        mut draw: impl FnMut(&mut ChaCha8Rng) -> I,
        mut work: impl FnMut(&I) -> O,
    ) -> Result<Counts, Error> {
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut counts = [0; INPUTS];
        for count in &mut counts {
            let input = draw(&mut random);
            self.counter.start();
            black_box(work(black_box(&input)));
            *count = self.counter.stop().ok_or(Error::TooLong)?;
        }
        self.report(name, &mut counts)
    }

    /// Counts each call of `step`, which is too long to be repeated, until it says that there is no more; and
    /// prints the same line of them, then one of all together, `<name>_in_all`. The cost of a call of nothing is
    /// in it, and up to a tick.
    ///
    /// # Errors
    /// [`Error::TooLong`], also for too many steps; [`Error::Output`].
    pub fn measure_steps(
        &mut self,
        name: &str,
        mut step: impl FnMut() -> bool,
    ) -> Result<(), Error> {
        let mut counts = [0; STEPS];
        let mut taken = 0;
        let mut goes_on = true;
        while goes_on {
            let count = counts.get_mut(taken).ok_or(Error::TooLong)?;
            self.counter.start();
            goes_on = black_box(step());
            *count = self.counter.stop().ok_or(Error::TooLong)?;
            taken += 1;
        }
        let counts = &mut counts[..taken];
        let all: u64 = counts.iter().sum();
        self.report(name, counts)?;
        writeln!(self.output, "instructions {name}_in_all {all} {all} {all}")?;
        Ok(())
    }

    fn report(&mut self, name: &str, counts: &mut [u64]) -> Result<Counts, Error> {
        counts.sort_unstable();
        let counts = Counts {
            min: counts[0],
            median: counts[counts.len() / 2],
            max: counts[counts.len() - 1],
        };
        let Counts { min, median, max } = counts;
        writeln!(self.output, "instructions {name} {min} {median} {max}")?;
        Ok(counts)
    }

    /// Counts `work`, which takes `expected` instructions, and prints
    /// `calibration <expected> <counted>`.
    ///
    /// # Errors
    /// [`Error::Calibration`] if the count is off by more than one; otherwise as
    /// [`Bench::measure`].
    pub fn calibrate(&mut self, expected: u64, mut work: impl FnMut()) -> Result<(), Error> {
        let counted = self.count(&(), |()| work())?;
        writeln!(self.output, "calibration {expected} {counted}")?;
        if counted.abs_diff(expected) > 1 {
            return Err(Error::Calibration { expected, counted });
        }
        Ok(())
    }

    /// Instructions of one call of `work`.
    fn count<I, O>(&mut self, input: &I, mut work: impl FnMut(&I) -> O) -> Result<u64, Error> {
        let mut work = |input: &I| {
            black_box(work(input));
        };
        let with = repeat(&mut self.counter, black_box(&mut work), input)?;
        let without = repeat(&mut self.counter, black_box(&mut |_: &I| ()), input)?;
        let repeats = u64::from(REPEATS);
        Ok((with.saturating_sub(without) + repeats / 2) / repeats)
    }
}

/// Instructions of [`REPEATS`] calls, with everything around them.
///
/// Never inlined, and `work` called through a pointer that the compiler cannot see through: the
/// code around the call is then the same whatever `work` is, and nothing of `work` moves out of
/// the loop.
#[inline(never)]
fn repeat<I>(
    counter: &mut impl Counter,
    work: &mut dyn FnMut(&I),
    input: &I,
) -> Result<u64, Error> {
    counter.start();
    for _ in 0..REPEATS {
        work(input);
    }
    counter.stop().ok_or(Error::TooLong)
}

#[cfg(test)]
mod tests {
    use std::{cell::Cell, string::String};

    use super::*;

    /// Counts as many instructions as the work reports, in ticks of 40, after an overhead of 123,456.
    struct Told<'a> {
        spent: &'a Cell<u64>,
        limit: u64,
    }

    impl Counter for Told<'_> {
        fn start(&mut self) {
            self.spent.set(123_456);
        }

        fn stop(&mut self) -> Option<u64> {
            let ticks = self.spent.get() / 40;
            (ticks <= self.limit).then_some(ticks * 40)
        }
    }

    #[test]
    fn one_call_over_all_inputs() {
        let spent = Cell::new(0);
        let mut bench = Bench::new(
            Told {
                spent: &spent,
                limit: 1_000_000,
            },
            String::new(),
        );
        // 700, 707, ... in an order that is not sorted.
        let mut drawn = 0;
        let counts = bench.measure(
            "told",
            |_| {
                drawn += 1;
                700 + 7 * (drawn * 2 % INPUTS as u64)
            },
            |cost| spent.set(spent.get() + cost),
        );
        let expected = Counts {
            min: 700,
            median: 700 + 7 * 32,
            max: 700 + 7 * 64,
        };
        assert_eq!(counts, Ok(expected));
        assert_eq!(bench.output, "instructions told 700 924 1148\n");
    }

    #[test]
    fn a_timer_that_ran_over_is_an_error() {
        let spent = Cell::new(0);
        let mut bench = Bench::new(
            Told {
                spent: &spent,
                limit: 4_000,
            },
            String::new(),
        );
        let counts = bench.measure("long", |_| 1000, |cost| spent.set(spent.get() + cost));
        assert_eq!(counts, Err(Error::TooLong));
        assert_eq!(bench.output, "");
    }

    #[test]
    fn calibration_allows_one() {
        let spent = Cell::new(0);
        let mut bench = Bench::new(
            Told {
                spent: &spent,
                limit: 1_000_000,
            },
            String::new(),
        );
        let takes_100 = || spent.set(spent.get() + 100);
        assert_eq!(bench.calibrate(99, takes_100), Ok(()));
        assert_eq!(bench.calibrate(101, takes_100), Ok(()));
        assert_eq!(
            bench.calibrate(98, takes_100),
            Err(Error::Calibration {
                expected: 98,
                counted: 100
            })
        );
        assert!(bench.output.ends_with("calibration 98 100\n"));
    }
}
