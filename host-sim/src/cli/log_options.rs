//! Records of happenings, of commands that run for long.

use std::env;

use anyhow::Context;
use clap::Args;
use host_sim::logging::{self, Filter};

/// Choice of the records.
#[derive(Args)]
pub(super) struct LogOptions {
    /// Records of what happens, on the standard error output: up to the level error, warn, info, debug or trace, none
    /// with off, or other levels for parts of the program, such as `info,host_sim::live=debug`. Default: what
    /// `RUST_LOG` says in the environment (docs/mqtt.md).
    #[arg(long, value_name = "FILTER")]
    log: Option<Filter>,
}

impl LogOptions {
    /// Begins to write records: without a choice, those that the command usually writes.
    pub(super) fn start(&self, usual: &str) -> anyhow::Result<()> {
        let chosen = match (&self.log, env::var("RUST_LOG")) {
            (Some(filter), _) => filter.clone(),
            (None, Ok(text)) if !text.is_empty() => text
                .parse()
                .context("RUST_LOG in the environment cannot be used")?,
            _ => Filter::default(),
        };
        Ok(logging::start(&chosen, &usual.parse()?)?)
    }
}
