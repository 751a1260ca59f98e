//! A node on an emulated board with a real radio co-processor, and networks of emulated boards.

use anyhow::Result;
use xshell::{Shell, cmd};

use crate::{firmware, peers};

const PACKAGE: &str = "mps2-an386";

/// Builds what is missing, and runs the tests that need it.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let image = firmware::build(sh, PACKAGE)?;
    let bound = firmware::stack_bound(&image)?;
    let _peer = sh.push_env("OT_RCP", peers::ot_rcp(sh)?);
    let _image = sh.push_env("NODE_IMAGE", image);
    let _bound = sh.push_env("STACK_BOUND", bound.to_string());
    cmd!(
        sh,
        "cargo test --package {PACKAGE} --test emulated -- --ignored --nocapture"
    )
    .run()?;
    // Whole networks, beside one another: their boards mostly sleep.
    cmd!(
        sh,
        "cargo test --package host-sim --test boards -- --ignored --nocapture"
    )
    .run()?;
    Ok(())
}
