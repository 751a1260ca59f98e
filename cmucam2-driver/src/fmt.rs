//! One set of logging macros for `defmt`, `log` or nothing. `defmt` wins when both are on, so that
//! `--all-features` builds.

#[cfg(feature = "defmt")]
macro_rules! warning { ($($arg:tt)*) => { defmt::warn!($($arg)*) }; }
#[cfg(all(feature = "log", not(feature = "defmt")))]
macro_rules! warning { ($($arg:tt)*) => { log::warn!($($arg)*) }; }
#[cfg(not(any(feature = "defmt", feature = "log")))]
macro_rules! warning { ($text:literal $(, $arg:expr)*) => { { $( let _ = &$arg; )* } }; }

#[cfg(feature = "defmt")]
macro_rules! debug { ($($arg:tt)*) => { defmt::debug!($($arg)*) }; }
#[cfg(all(feature = "log", not(feature = "defmt")))]
macro_rules! debug { ($($arg:tt)*) => { log::debug!($($arg)*) }; }
#[cfg(not(any(feature = "defmt", feature = "log")))]
macro_rules! debug { ($text:literal $(, $arg:expr)*) => { { $( let _ = &$arg; )* } }; }

pub(crate) use {debug, warning};
