//! A node on an emulated board with a real radio co-processor, and networks of emulated boards.

use anyhow::Result;
use xshell::Shell;

use crate::{firmware, harness, peers};

const PACKAGE: &str = "mps2-an386";

/// One node, and then whole networks, beside one another: their boards mostly sleep.
pub(crate) const SUITES: [&str; 2] = ["emulated", "boards"];

/// Builds what is missing, and runs the tests that need it.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let image = firmware::build(sh, PACKAGE)?;
    let bound = firmware::stack_bound(&image)?;
    let _peer = sh.push_env("OT_RCP", peers::ot_rcp(sh)?);
    let _image = sh.push_env("NODE_IMAGE", image);
    let _bound = sh.push_env("STACK_BOUND", bound.to_string());
    SUITES
        .into_iter()
        .try_for_each(|suite| harness::ignored(sh, suite))
}
