//! Links examples for the development kit; a build for a computer has nothing to link.

fn main() -> std::io::Result<()> {
    board_facts::link("nrf52840")
}
