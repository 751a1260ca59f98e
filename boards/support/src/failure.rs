//! Reasons why a node cannot go on, in words.

use flash_log::LogError;
use node_firmware::run::Failure;
use zigbee_link::{runner::RunnerError, store::StoreError};

/// Description of a failure. Not its `Display`, which brings the formatter along; a board has no room for that.
pub const fn describe<R, F>(failure: &Failure<R, F>) -> &'static str {
    match failure {
        Failure::Link(RunnerError::Radio(_)) => "the radio failed",
        Failure::Link(RunnerError::Store(error)) => match error {
            StoreError::NotProvisioned => "link: no site key",
            StoreError::Corrupt => "link: damaged",
            StoreError::Full | StoreError::Layout => "link: wrong size",
            _ => "link: the flash failed",
        },
        Failure::Facts(error) => match error {
            LogError::Corrupt | LogError::NotOpen => "memory: damaged",
            LogError::Full | LogError::Layout => "memory: wrong size",
            _ => "memory: the flash failed",
        },
        #[cfg(feature = "update")]
        Failure::Update => "the boot loader changes images",
    }
}
