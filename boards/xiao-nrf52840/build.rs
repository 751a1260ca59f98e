//! Links for the board; a build for a computer has nothing to link.

fn main() -> std::io::Result<()> {
    board_facts::link(env!("CARGO_PKG_NAME"))
}
