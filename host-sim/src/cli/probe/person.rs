//! Input of the person at the keyboard.

use std::{
    io::{self, BufRead, IsTerminal, Write},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError},
    },
    thread,
    time::Duration,
};

use anyhow::Context;
use host_sim::probe::port::PortError;

use super::super::interrupt;

/// Longest time for which Ctrl-C goes unnoticed while a line is awaited.
const PATIENCE: Duration = Duration::from_millis(50);

/// Lines from the standard input, and Ctrl-C.
pub(super) struct Person {
    interrupted: Arc<AtomicBool>,
    lines: Option<Receiver<io::Result<String>>>,
}

impl Person {
    /// From now on Ctrl-C only sets a flag.
    pub(super) fn new() -> anyhow::Result<Self> {
        Ok(Self {
            interrupted: interrupt::watch()?,
            lines: None,
        })
    }

    /// Set by Ctrl-C.
    pub(super) fn interrupted(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupted)
    }

    /// Returns true if a person can type.
    pub(super) fn is_there() -> bool {
        io::stdin().is_terminal()
    }

    /// The next line, asked for with `question` if a person can type; `None` at the end.
    pub(super) fn line(&mut self, question: &str) -> anyhow::Result<Option<String>> {
        if Self::is_there() {
            let mut out = io::stderr();
            // A failure here cannot be told anywhere.
            let _ = write!(out, "{question} ").and_then(|()| out.flush());
        }
        let lines = self.lines.get_or_insert_with(read_lines);
        loop {
            match lines.recv_timeout(PATIENCE) {
                Ok(line) => return line.map(Some).context("the standard input failed"),
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {
                    if self.interrupted.load(Ordering::Relaxed) {
                        return Err(PortError::Interrupted.into());
                    }
                }
            }
        }
    }
}

/// Reads in a thread of its own, because a read cannot be interrupted.
fn read_lines() -> Receiver<io::Result<String>> {
    let (to, from) = mpsc::sync_channel(1);
    thread::spawn(move || {
        for line in io::stdin().lock().lines() {
            if to.send(line).is_err() {
                break;
            }
        }
    });
    from
}
