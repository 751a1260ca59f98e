//! Ctrl-C, for commands that have something to finish.

use std::{
    process::ExitCode,
    sync::{Arc, atomic::AtomicBool},
};

use anyhow::Context;
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM},
    flag,
};

use super::tell;

/// Exit code that a shell reports for a program that Ctrl-C ended.
pub(super) const INTERRUPTED: u8 = 130;

/// Tells of the interruption, after all results were written.
pub(super) fn told() -> ExitCode {
    tell("interrupted");
    ExitCode::from(INTERRUPTED)
}

/// From now on Ctrl-C, and other signals that end a program, only set a flag; while it is set, a second
/// one ends the program at once.
pub(super) fn watch() -> anyhow::Result<Arc<AtomicBool>> {
    let interrupted = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        flag::register_conditional_shutdown(signal, INTERRUPTED.into(), Arc::clone(&interrupted))
            .and_then(|_| flag::register(signal, Arc::clone(&interrupted)))
            .context("Ctrl-C cannot be watched")?;
    }
    Ok(interrupted)
}
