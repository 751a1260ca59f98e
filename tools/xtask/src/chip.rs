//! The image that is flashed, on an emulated nRF52840 in virtual time.

use anyhow::{Context, Result, ensure};
use xshell::{Shell, cmd};

use crate::{
    cortex_m,
    documented::{self, Table, number},
    firmware,
    harness::{self, Pace, Suite},
};

const BOARD: board_facts::Board = board_facts::NRF52840_DK;
/// Networks of `host-sim` on it, which take the longest, and nodes of a site.
pub(crate) const SUITES: [Suite; 3] = [
    Suite {
        package: "host-sim",
        module: "chips",
    },
    Suite {
        package: "nrf52840-emulator",
        module: "image",
    },
    Suite {
        package: "host-sim",
        module: "chip_process",
    },
];

/// A coordinator's USB plug, on the images of a dongle and of a kit, which are built at night.
pub(crate) const PLUG: Suite = Suite {
    package: "nrf52840-emulator",
    module: "plug",
};

/// All cameras of the thesis's site, which take a fifth of the time of all others and find little more: at night.
pub(crate) const WALK: Suite = Suite {
    package: "host-sim",
    module: "chip_walk",
};

/// In the documentation, by roles.
const TABLE: &str = "chip: stack";
const ROLES: [&str; 4] = ["coordinator", "camera", "reference", "target"];
/// The current of a camera that sleeps, in the documentation, and the text that a test prints behind it.
const SLEEP: &str = "chip: sleep";
const DRAWN: &str = " mA are drawn by a camera that sleeps";
/// Text that a test prints behind a role and the number of bytes.
const USED: &str = " bytes of stack were used";

/// Compares the emulated processor with another one, and runs the image as nodes of a site, at last within a
/// simulation; tells how much stack they used there.
///
/// # Errors
/// One of that fails.
pub(crate) fn run(sh: &Shell) -> Result<()> {
    let image = firmware::build(sh, &BOARD, &[])?;
    compare(sh)?;
    let bound = firmware::stack_bound(&image)?;
    let _image = sh.push_env("NODE_IMAGE", sh.current_dir().join(image));
    let _updated = updated(sh)?;
    // A process translates the image once for each test that runs at the same time.
    let said = harness::ignored(sh, &SUITES, Pace::SideBySide)?;
    stack(sh, bound, &said)
}

/// Runs the images of a dongle and of a kit as a coordinator with a PC at the USB plug of its chip.
///
/// # Errors
/// One of that fails.
pub(crate) fn plug(sh: &Shell) -> Result<()> {
    let image = firmware::build(sh, &board_facts::PCA10059, &[])?;
    let _image = sh.push_env("NODE_PLUG", sh.current_dir().join(image));
    let kit = firmware::build_plugged(sh, &BOARD, &[])?;
    let _kit = sh.push_env("NODE_PLUG_KIT", sh.current_dir().join(kit));
    harness::ignored(sh, &[PLUG], Pace::InTurn)?;
    Ok(())
}

/// Tells tests the image that is updated by radio, and its boot loader.
fn updated(sh: &Shell) -> Result<[xshell::PushEnv<'_>; 2]> {
    let image = firmware::build_updated(sh, &BOARD, &[], 1)?;
    let loader = firmware::loader(sh)?.with_extension("bin");
    Ok([
        sh.push_env("NODE_UPDATED", sh.current_dir().join(image)),
        sh.push_env("NODE_LOADER", sh.current_dir().join(loader)),
    ])
}

/// The processor has the same arithmetic as QEMU's, which is an independent implementation.
fn compare(sh: &Shell) -> Result<()> {
    let (image, by_qemu) = cortex_m::results_of_cortex_m4f(sh)?;
    let print = harness::program(sh, "print")?;
    let by_chip = cmd!(sh, "{print} {image}").read()?;
    let count = cortex_m::same_bits(&by_chip, &by_qemu)
        .context("results of the emulated nRF52840 and of QEMU's Cortex-M4F")?;
    println!(
        "{count} results of the emulated nRF52840 have the same bits as those of QEMU's Cortex-M4F"
    );
    Ok(())
}

/// Most stack that each role used, which is less than was computed, for the documentation.
fn stack(sh: &Shell, bound: u64, said: &str) -> Result<()> {
    let mut rows = vec![
        [
            "bytes of stack, `cargo xtask test --stage chip`",
            "nRF52840",
        ]
        .map(str::to_owned),
        ["deepest, computed".to_owned(), number(bound)],
    ];
    for role in ROLES {
        let used = most_used(said, role);
        let used = used.with_context(|| format!("no test told how much stack a {role} used"))?;
        println!("stack, measured on emulated nRF52840s: {role} {used} bytes, of {bound} computed");
        ensure!(used <= bound, "more than was computed");
        rows.push([format!("{role}, measured"), number(used)]);
    }
    let drawn = drawn(said).context("no test told what a camera draws that sleeps")?;
    let current = [
        ["mA, `cargo xtask test --stage chip`", "nRF52840"],
        ["camera that sleeps, without the CMUcam2", drawn],
    ];
    let tables = [
        Table {
            name: TABLE,
            rows: rows.into_iter().map(Vec::from).collect(),
        },
        Table {
            name: SLEEP,
            rows: current.map(|row| row.map(str::to_owned).to_vec()).to_vec(),
        },
    ];
    documented::agree(sh, "test --stage chip", &tables)
}

/// The figure that a test printed before [`DRAWN`].
fn drawn(said: &str) -> Option<&str> {
    let (before, _) = said.split_once(DRAWN)?;
    before.split_whitespace().next_back()
}

/// The largest figure that tests printed for a role.
fn most_used(said: &str, role: &str) -> Option<u64> {
    let used = said.lines().filter_map(|line| {
        let (before, _) = line.split_once(USED)?;
        let (before, bytes) = before.rsplit_once(' ')?;
        before.ends_with(role).then(|| bytes.parse().ok())?
    });
    used.max()
}

/// A longer walk, speed of the emulator, currents of nodes in an hour, every cut of the power there is while nodes
/// join, and a thousand at random instants of calibrations.
///
/// # Errors
/// One of that fails.
pub(crate) fn bench(sh: &Shell) -> Result<()> {
    let image = firmware::build(sh, &BOARD, &[])?;
    let _image = sh.push_env("NODE_IMAGE", sh.current_dir().join(image));
    harness::ignored(sh, &[WALK], Pace::InTurn)?;
    let _cuts = sh.push_env("NODE_CUTS", "all");
    for (site, seconds, test) in [
        ("thesis-13", "612", "the_nodes_of_a_site_join"),
        ("lab", "3600", "what_nodes_draw"),
        ("lab", "20", "faults::power_may_go"),
    ] {
        cmd!(
            sh,
            "cargo test --locked --release --package nrf52840-emulator --test it -- --ignored --nocapture image::{test}"
        )
        .env("NODE_SITE", site)
        .env("NODE_SECONDS", seconds)
        .run()?;
    }
    let _updated = updated(sh)?;
    cmd!(
        sh,
        "cargo test --locked --release --package nrf52840-emulator --test it -- --ignored --nocapture updates_survive_losses_of_power"
    )
    .env("NODE_CUTS", "1000")
    .run()?;
    // The first of a hundred at a time may be told with `NODE_SEED`.
    cmd!(
        sh,
        "cargo test --locked --package host-sim --all-features --test it -- --ignored --nocapture power_cuts_over_a_calibration"
    )
    .env("NODE_CUTS", "1000")
    .run()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deepest_of_a_role_counts() {
        let said = "test a ... target 5100 bytes of stack were used\ntarget 7012 bytes of stack were used\n\
                    camera 9000 bytes of stack were used\nok\n";
        assert_eq!(most_used(said, "target"), Some(7012));
        assert_eq!(most_used(said, "camera"), Some(9000));
        assert_eq!(most_used(said, "coordinator"), None);
        let said = "test b ... 0.04 mA are drawn by a camera that sleeps; it listens\nok\n";
        assert_eq!((drawn(said), drawn("ok")), (Some("0.04"), None));
    }
}
