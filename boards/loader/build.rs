//! Puts the boot loader into its region; a build for a computer has nothing to link.

fn main() -> std::io::Result<()> {
    board_facts::link_loader(&board_facts::NRF52840_DK)
}
