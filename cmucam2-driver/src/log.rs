//! Logs to `log`, to `defmt`, to both or to neither. Arguments are `Display` and `defmt::Format`.
//!
//! `cmucam2-driver`, `zigbee-link` and `node-firmware` have this same file: none needs another for it.
#![allow(unused_macros, unused_imports, reason = "the same file in each crate")]

macro_rules! warning {
    ($text:literal $(, $argument:expr)* $(,)?) => {{
        #[cfg(feature = "log")]
        ::log::warn!($text $(, $argument)*);
        #[cfg(feature = "defmt")]
        ::defmt::warn!($text $(, $argument)*);
        #[cfg(not(any(feature = "log", feature = "defmt")))]
        let _ = ($(&$argument,)*);
    }};
}

macro_rules! debug {
    ($text:literal $(, $argument:expr)* $(,)?) => {{
        #[cfg(feature = "log")]
        ::log::debug!($text $(, $argument)*);
        #[cfg(feature = "defmt")]
        ::defmt::debug!($text $(, $argument)*);
        #[cfg(not(any(feature = "log", feature = "defmt")))]
        let _ = ($(&$argument,)*);
    }};
}

pub(crate) use {debug, warning};
