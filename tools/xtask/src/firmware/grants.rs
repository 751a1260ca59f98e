//! Number of branches to panics that the compiler may leave in an image: none in crates of this project, and in
//! others as many as were looked at.
//!
//! A grant is for one kind of panic in one crate, and for an exact number in each image. With another version of
//! the crate or the compiler, the error tells all branches of the kind: the developer who changes the number looks
//! at them, and checks that the reason still holds.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};

use super::panics::Panic;

/// Some branches that are not taken.
struct Grant {
    /// Name of their crate.
    krate: &'static str,
    panic: &'static str,
    /// Their number in the image of each board, in the order of [`super::BOARDS`].
    counts: [usize; 2],
    reason: &'static str,
}

/// Panic that every `async fn` has, of any crate: the compiler leaves it where it did not find out by itself that
/// no caller polls a future that has ended, which neither `await` nor `join`, `select` or the executor does. They
/// are printed, and not limited.
const RESUMED: &str = "core::panicking::panic_const::panic_const_async_fn_resumed";

const BOUNDS: &str = "core::panicking::panic_bounds_check";
const BORROWED: &str = "core::cell::panic_already_borrowed";
const DIVISION: &str = "core::panicking::panic_const::panic_const_div_by_zero";
const MESSAGE: &str = "core::panicking::panic_fmt";
const SLICE: &str = "core::slice::index::slice_index_fail";
/// `assert!`, `unreachable!` and others with a text only.
const TEXT: &str = "core::panicking::panic";
const UNWRAPPED: &str = "core::option::unwrap_failed";

const LOGGER: &str = "nothing that is logged logs, and every frame is acquired and released once";
const CRITICAL: &str = "borrowed within a critical section, by code that does not come back";
const STM32: &str = "clocks, rates and the watchdog's time are constants of the board that the chip can have; numbers of pins, peripherals and pages are the library's";
const SYNC: &str = "what a channel or a pipe guards is borrowed for one call of the library, which does not come back; nothing polls a future that has ended; a ring's positions stay within it";
const WRITE: &str = "the UARTs of the boards take at least one byte, and no more than there are";
const STATICS: &str = "start-up: statics are taken once";

/// Only on input of the chip itself, of constants, or of other parts of the same library.
#[rustfmt::skip]
const GRANTS: &[Grant] = &[
    grant("cobs", BOUNDS, [2, 2], "the frame ends with its zero, and is read up to there only; tested with any bytes"),
    grant("defmt-rtt", MESSAGE, [2, 2], LOGGER),
    grant("embassy-executor", MESSAGE, [1, 1], "time is awaited by tasks of the executor only, whose wakers these are"),
    grant("embassy-hal-internal", MESSAGE, [1, 1], "start-up: the peripherals are taken once"),
    grant("embassy-nrf", BORROWED, [4, 0], CRITICAL),
    grant("embassy-nrf", TEXT, [6, 0], "transfers of a sensor are in ones and twos, as the same library split them; bytes are popped where there are some; a UART is dropped once, before it is made again; the radio is in one of the states that the chip has"),
    grant("embassy-nrf", BOUNDS, [2, 0], "ports and pins that the chip has: of a pin's type, or of a bit of one of its latches"),
    grant("embassy-nrf", MESSAGE, [5, 0], "the radio's channel is a checked one, its power the nearest of a list; a timer's register is a constant of the library; transfers of a sensor are split behind as many as there are, and no two readings follow each other"),
    grant("embassy-stm32", BORROWED, [0, 3], CRITICAL),
    grant("embassy-stm32", UNWRAPPED, [0, 5], STM32),
    grant("embassy-stm32", TEXT, [0, 12], STM32),
    grant("embassy-stm32", BOUNDS, [0, 2], STM32),
    grant("embassy-stm32", DIVISION, [0, 6], STM32),
    grant("embassy-stm32", MESSAGE, [0, 24], STM32),
    grant("embassy-stm32", SLICE, [0, 1], "groups of operations end where the list does"),
    grant("embassy-sync", BORROWED, [0, 5], "borrowed within its lock, by code that does not come back"),
    grant("embassy-sync", TEXT, [0, 2], SYNC),
    grant("embassy-sync", MESSAGE, [23, 18], SYNC),
    grant("embedded-io-async", MESSAGE, [1, 2], WRITE),
    grant("embedded-io-async", SLICE, [1, 2], WRITE),
    grant("heapless", MESSAGE, [1, 1], "the place was found in the same list, or is the first of a full one"),
    grant("nrf-pac", TEXT, [8, 0], "pins by the bit of a latch; channels and groups of the interconnect by their type; a timer's registers by constants of embassy-nrf"),
    grant("portable-atomic", MESSAGE, [1, 4], "its comparison is where a StaticCell looks whether it was taken: the first task does that, once for each"),
    grant("postcard", SLICE, [3, 3], "the buffers are as long as the longest number, and frames end with their zero"),
    grant("static_cell", MESSAGE, [1, 1], STATICS),
    grant("stm32-metapac", TEXT, [0, 1], "numbers of pins, which the libraries make themselves"),
];

const fn grant(
    krate: &'static str,
    panic: &'static str,
    counts: [usize; 2],
    reason: &'static str,
) -> Grant {
    Grant {
        krate,
        panic,
        counts,
        reason,
    }
}

/// Returns true for code of this project.
fn is_ours(panic: &Panic) -> bool {
    panic.krate.as_ref().is_some_and(|krate| krate.is_ours)
}

/// Branches of each crate and kind.
pub(super) struct Count<'a>(BTreeMap<(&'a str, &'a str), Vec<&'a Panic>>);

impl<'a> Count<'a> {
    pub(super) fn new(panics: &'a [Panic]) -> Self {
        let mut count = BTreeMap::<_, Vec<_>>::new();
        for panic in panics {
            let krate = match &panic.krate {
                _ if panic.what == RESUMED => "any",
                Some(krate) => &krate.name,
                None => "core",
            };
            count.entry((krate, &*panic.what)).or_default().push(panic);
        }
        Self(count)
    }

    /// A line for each.
    pub(super) fn lines(&self) -> impl Iterator<Item = String> {
        self.0
            .iter()
            .map(|((krate, panic), panics)| format!("{:>6} {krate}: {panic}", panics.len()))
    }

    /// Prints them all for a board whose panics are not counted.
    ///
    /// # Errors
    /// A crate of this project has one.
    pub(super) fn none_of_ours(&self, board: &str) -> Result<()> {
        println!("\nBranches to a panic in the image of {board}:");
        for line in self.lines() {
            println!("{line}");
        }
        let all = self.0.iter().filter(|((_, panic), _)| *panic != RESUMED);
        let ours = all
            .flat_map(|(_, panics)| panics)
            .filter(|panic| is_ours(panic));
        let ours: Vec<_> = ours.map(ToString::to_string).collect();
        ensure!(
            ours.is_empty(),
            "this project's code for {board} may panic:\n{}",
            ours.join("\n")
        );
        Ok(())
    }

    /// Differences from the grants, for a board by its number.
    pub(super) fn errors(&self, board: usize) -> Vec<String> {
        self.errors_but(GRANTS, board)
    }

    fn errors_but(&self, grants: &[Grant], board: usize) -> Vec<String> {
        let mut errors = Vec::new();
        for (&(krate, panic), panics) in &self.0 {
            let all = || {
                let places = panics.iter().map(|panic| format!("\n    {panic}"));
                places.collect::<String>()
            };
            let grant = grants
                .iter()
                .find(|grant| (grant.krate, grant.panic) == (krate, panic));
            let granted = grant.map_or(0, |grant| grant.counts[board]);
            if panic == RESUMED {
            } else if panics.iter().any(|panic| is_ours(panic)) {
                errors.push(format!(
                    "{krate} may panic, and is of this project:{}",
                    all()
                ));
            } else if panics.len() != granted {
                errors.push(format!(
                    "{krate} has {} branches to {panic}, where tools/xtask/src/firmware/grants.rs says {granted}:{}",
                    panics.len(),
                    all()
                ));
            }
        }
        for grant in grants {
            if grant.counts[board] > 0 && !self.0.contains_key(&(grant.krate, grant.panic)) {
                errors.push(format!(
                    "{} has no branch to {} any more, where tools/xtask/src/firmware/grants.rs says {}",
                    grant.krate, grant.panic, grant.counts[board]
                ));
            }
        }
        errors
    }

    /// Reasons why none of them is taken.
    pub(super) fn reasons() -> impl Iterator<Item = String> {
        GRANTS
            .iter()
            .map(|grant| format!("{}: {}: {}", grant.krate, grant.panic, grant.reason))
    }
}

#[cfg(test)]
mod tests {
    use super::{super::parts::Crate, *};

    const ONE: [Grant; 1] = [Grant {
        krate: "cobs",
        panic: BOUNDS,
        counts: [1, 0],
        reason: "",
    }];

    fn panic(krate: &str, is_ours: bool, what: &str) -> Panic {
        Panic {
            krate: Some(Crate {
                name: krate.to_owned(),
                is_ours,
            }),
            what: what.to_owned(),
            place: vec!["f (src/a.rs:1)".to_owned()],
        }
    }

    #[test]
    fn exactly_as_many_as_granted() {
        let one = || panic("cobs", false, BOUNDS);
        let errors =
            |panics: &[Panic], board| Count::new(panics).errors_but(&ONE, board).join("\n");
        assert_eq!(errors(&[one()], 0), "");
        assert_eq!(errors(&[], 1), "");
        assert!(errors(&[one(), one()], 0).contains("2 branches"));
        assert!(errors(&[one()], 1).contains("src/a.rs:1"));
        assert!(errors(&[], 0).contains("any more"));
        let other = panic("cobs", false, "core::panicking::panic");
        assert!(errors(&[one(), other], 0).contains("says 0"));
    }

    #[test]
    fn none_of_our_own_but_of_the_compiler() {
        let own = |what| Count::new(&[panic("cobs", true, what)]).errors_but(&ONE, 0);
        assert_eq!(own(BOUNDS).len(), 1);
        assert_eq!(own(RESUMED).len(), 1, "the one that is granted is missing");
        let resumed = [panic("zigbee-link", true, RESUMED)];
        assert!(Count::new(&resumed).errors_but(&[], 0).is_empty());
    }

    #[test]
    fn a_grant_tells_whose_and_why() {
        for (i, grant) in GRANTS.iter().enumerate() {
            let is_same = |other: &Grant| (other.krate, other.panic) == (grant.krate, grant.panic);
            assert_eq!(GRANTS.iter().position(is_same), Some(i));
            assert!(!grant.reason.is_empty() && grant.counts != [0; 2]);
        }
    }
}
