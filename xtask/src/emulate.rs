//! A node on an emulated board with a real radio co-processor, and networks of emulated boards.

use anyhow::{Context, Result, ensure};
use xshell::Shell;

use crate::{
    documented::{self, Table, number},
    firmware, harness, peers,
};

const PACKAGE: &str = "mps2-an386";

/// One node, and then whole networks, beside one another: their boards mostly sleep.
pub(crate) const SUITES: [&str; 2] = ["emulated", "boards"];

/// In the documentation.
const TABLE: &str = "emulate: stack";
const MEASURED: &str = "deepest, measured";
/// What a test says behind the number of bytes.
const USED: &str = " bytes of stack were used";

/// Builds what is missing, runs the tests that need it, and tells how much stack the boards used. The
/// tests themselves fail if that is more than was computed.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let image = firmware::build(sh, PACKAGE)?;
    let bound = firmware::stack_bound(&image)?;
    let _peer = sh.push_env("OT_RCP", peers::ot_rcp(sh)?);
    let _image = sh.push_env("NODE_IMAGE", image);
    let _bound = sh.push_env("STACK_BOUND", bound.to_string());
    let mut said = String::new();
    for suite in SUITES {
        said += &harness::ignored(sh, suite)?;
    }
    let measured = most_used(&said).context("no test told how much stack was used")?;
    println!("stack, measured on emulated boards: {measured} bytes, of {bound} computed");
    ensure!(measured <= bound, "more than was computed");
    let rows = [
        ["bytes of stack, `cargo xtask emulate`", "emulated board"].map(str::to_owned),
        ["deepest, computed".to_owned(), number(bound)],
        [MEASURED.to_owned(), number(measured)],
    ];
    let table = Table {
        name: TABLE,
        rows: rows.map(Vec::from).into(),
    };
    documented::agree(sh, "emulate", &[table])
}

/// The most of what tests said.
fn most_used(said: &str) -> Option<u64> {
    let used = said.lines().filter_map(|line| {
        let (before, _) = line.split_once(USED)?;
        before.rsplit(' ').next()?.parse().ok()
    });
    used.max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deepest_counts() {
        let said = "test a ... 5100 bytes of stack were used\n7012 bytes of stack were used\nok\n";
        assert_eq!(most_used(said), Some(7012));
        assert_eq!(most_used("test a ... ok"), None);
    }
}
