//! `host-sim keygen`

use std::{path::PathBuf, process::ExitCode};

use anyhow::Context;
use clap::Args;
use site::key_file;

use super::{file_name, files::Files, print, values};

/// Draws a new site key, into a file; with --updates, the key that signs images for updates by radio.
#[derive(Args)]
pub(super) struct Arguments {
    /// The file; it must not exist.
    #[arg(default_value = "site.sitekey", value_parser = values::result())]
    file: PathBuf,
    /// The index by which frames name the key; the next key of a site needs another one.
    #[arg(long, default_value_t = 1, value_parser = values::whole(1, u8::MAX))]
    index: u8,
    /// Draws the key that signs images for `host-sim update`, instead. Nodes get its public key with their pages.
    #[arg(long, requires = "file", conflicts_with = "index")]
    updates: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let name = file_name(&arguments.file);
    Files::default().writes([&arguments.file]).check()?;
    if arguments.updates {
        key_file::create_update_key(&arguments.file).with_context(|| name.clone())?;
        print(&format!(
            "{name}: a key that signs images\n\
             Give it to `host-sim provision --update-key`, which puts its public key into the pages of nodes. Keep it \
             secret: who has it can change the program of every node.\n"
        ))?;
        return Ok(ExitCode::SUCCESS);
    }
    key_file::create(&arguments.file, arguments.index).with_context(|| name.clone())?;
    print(&format!(
        "{name}: a site key with index {}\n\
         Keep a copy in a safe place: every node of the site needs it. Publish it nowhere.\n",
        arguments.index
    ))?;
    Ok(ExitCode::SUCCESS)
}
