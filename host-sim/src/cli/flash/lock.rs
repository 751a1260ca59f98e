//! Closing the debug port of a board, and opening it again, which erases the chip.

use std::path::Path;

use xshell::{Cmd, Shell, cmd};

use board_facts::{Board, chip::Family};

/// `UICR.APPROTECT` of an nRF52 (Product Specification, "User information configuration
/// registers").
const APPROTECT: &str = "0x10001208";

/// Value that protects the access port on every revision of the chip. Up to E the port is open at any
/// other value; from F on it is closed at any but 0x5A, which the image writes only over a value that is
/// blank, as flash turns ones into zeros and not back.
pub(super) const ENABLED: [u8; 4] = [0x00, 0xFF, 0xFF, 0xFF];

const INSTALL_OPENOCD: &str = "OpenOCD is not installed, with which this board is locked and unlocked: on Debian \
     type `sudo apt-get install openocd`; else see https://openocd.org/pages/getting-openocd.html";

/// The program that locks a board, and what to do where it is missing; `None` if it is the program
/// that does everything else.
pub(super) const fn locked_with(board: &Board) -> Option<(&'static str, &'static str)> {
    match board.chip.family {
        Family::Nrf52 => None,
        Family::Stm32l4 => Some(("openocd", INSTALL_OPENOCD)),
    }
}

/// Closes the debug port, from the next reset or power-on. `enabled` is a file with [`ENABLED`].
pub(super) fn lock<'a>(
    board: &Board,
    sh: &'a Shell,
    probe: Option<&str>,
    options: &[&str],
    enabled: &Path,
) -> Cmd<'a> {
    match board.chip.family {
        // The pins' reset and the supply's voltage are in the same page.
        Family::Nrf52 => cmd!(
            sh,
            "probe-rs download {options...} --restore-unwritten --binary-format bin --base-address {APPROTECT} {enabled}"
        ),
        Family::Stm32l4 => open_ocd(sh, probe, "lock"),
    }
}

/// Opens the debug port, and erases all.
pub(super) fn unlock<'a>(
    board: &Board,
    sh: &'a Shell,
    probe: Option<&str>,
    options: &[&str],
) -> Cmd<'a> {
    match board.chip.family {
        Family::Nrf52 => cmd!(sh, "probe-rs erase {options...} --allow-erase-all"),
        Family::Stm32l4 => open_ocd(sh, probe, "unlock"),
    }
}

/// Step that a person has to take before a lock holds.
pub(super) const fn after_locking(board: &Board) -> &'static str {
    match board.chip.family {
        Family::Nrf52 => {
            "the debug port is closed after this reset: see for yourself that `probe-rs info` \
             is refused"
        }
        Family::Stm32l4 => {
            "the debug port is closed: take the board from its power once, as it does not start \
             while a debugger is connected"
        }
    }
}

/// RDP level 1 and back to 0 (manual of `OpenOCD`, "stm32l4x"; RM0351, "Readout protection").
fn open_ocd<'a>(sh: &'a Shell, probe: Option<&str>, action: &str) -> Cmd<'a> {
    let serial = probe.and_then(|probe| probe.splitn(3, ':').nth(2));
    let serial = serial.map(|serial| ["-c".to_owned(), format!("adapter serial {serial}")]);
    let serial = serial.iter().flatten();
    let commands =
        format!("init; reset halt; stm32l4x {action} 0; stm32l4x option_load 0; shutdown");
    cmd!(
        sh,
        "openocd -f interface/stlink.cfg {serial...} -f target/stm32l4x.cfg -c {commands}"
    )
}
