//! How long what grows takes: `cargo xtask bench scale`.

use crate::figure::Sheet;

mod solve_network;

pub(crate) fn run(sheet: &mut Sheet) -> anyhow::Result<()> {
    solve_network::run(sheet)
}
