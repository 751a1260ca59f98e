//! What the chores need and a fresh machine may lack: installed where that is allowed, otherwise
//! named with what to type.

use std::{env, path::Path};

use anyhow::{Context, Result, bail, ensure};
use xshell::{Shell, cmd};

/// Processors that firmware is built for: with a floating-point unit, and without.
pub(crate) const TARGETS: [&str; 2] = ["thumbv7em-none-eabihf", "thumbv6m-none-eabi"];

/// Programs that tests run, and the Debian packages they come in.
const PROGRAMS: [(&str, &str); 5] = [
    ("qemu-system-arm", "qemu-system-arm"),
    ("tshark", "tshark"),
    ("cmake", "cmake"),
    ("ninja", "ninja-build"),
    ("c++", "g++"),
];

/// The linker of images for nodes.
pub(crate) const LINKER: &str = "flip-link";
const LINKER_VERSION: &str = "0.1.12";

/// The compiler's targets and components, of the toolchain in use.
pub(crate) fn targets(sh: &Shell) -> Result<()> {
    let sysroot = cmd!(sh, "rustc --print sysroot").quiet().read()?;
    let missing = TARGETS
        .into_iter()
        .filter(|target| {
            !Path::new(&sysroot)
                .join("lib/rustlib")
                .join(target)
                .is_dir()
        })
        .collect::<Vec<_>>();
    if !missing.is_empty() {
        let missing = &missing;
        cmd!(sh, "rustup target add {missing...}")
            .run()
            .with_context(|| {
                format!(
                    "the compiler in {sysroot} has no {}: type `rustup toolchain install` here, or \
                     install that another way",
                    missing.join(", ")
                )
            })?;
    }
    for (component, program) in [("rustfmt", "cargo-fmt"), ("clippy", "cargo-clippy")] {
        if !Path::new(&sysroot).join("bin").join(program).is_file() {
            cmd!(sh, "rustup component add {component}")
                .run()
                .with_context(|| format!("install `{component}` another way"))?;
        }
    }
    Ok(())
}

/// Whether there is a nightly compiler, which is installed if it is missing.
pub(crate) fn nightly(sh: &Shell) -> bool {
    let is_there = cmd!(sh, "cargo +nightly --version")
        .quiet()
        .ignore_stderr()
        .read()
        .is_ok();
    is_there
        || cmd!(sh, "rustup toolchain install nightly --profile minimal")
            .run()
            .is_ok()
}

/// Whether this runs where nobody reads what was left out.
pub(crate) fn is_ci() -> bool {
    env::var_os("CI").is_some_and(|value| !value.is_empty() && value != "false")
}

/// The linker of images for nodes: it puts the stack where an overflow is a fault.
pub(crate) fn linker(sh: &Shell) -> Result<()> {
    if is_on_path(LINKER) {
        return Ok(());
    }
    let package = format!("{LINKER}@{LINKER_VERSION}");
    cmd!(sh, "cargo install --locked {package}")
        .run()
        .with_context(|| {
            format!("type `cargo install --locked {package}` where there is a network")
        })?;
    ensure!(
        is_on_path(LINKER),
        "{LINKER} is installed, but not found: put the folder that cargo named above on the PATH"
    );
    Ok(())
}

/// The programs of other projects.
pub(crate) fn packages(sh: &Shell) -> Result<()> {
    let missing = PROGRAMS
        .into_iter()
        .filter(|(program, _)| !is_on_path(program))
        .map(|(_, package)| package)
        .collect::<Vec<_>>();
    if missing.is_empty() {
        return Ok(());
    }
    let by_hand = format!("type `sudo apt-get install {}`", missing.join(" "));
    if !is_on_path("apt-get") {
        bail!(
            "not installed: {}; on Debian, {by_hand}",
            missing.join(", ")
        );
    }
    let is_root = cmd!(sh, "id -u").quiet().read()? == "0";
    let may_sudo = !is_root
        && is_on_path("sudo")
        && cmd!(sh, "sudo -n true")
            .quiet()
            .ignore_stderr()
            .run()
            .is_ok();
    let before: &[&str] = match (is_root, may_sudo) {
        (true, _) => &[],
        (false, true) => &["sudo", "-n"],
        (false, false) => bail!("not installed: {}; {by_hand}", missing.join(", ")),
    };
    let env = ["env", "DEBIAN_FRONTEND=noninteractive"];
    let words = |tail: &[&'static str]| [before, &env, tail].concat();
    let install = words(&["apt-get", "install", "-y", "--no-install-recommends"]);
    let update = words(&["apt-get", "update"]);
    let (update, update_rest) = update.split_first().context("a command")?;
    let (install, install_rest) = install.split_first().context("a command")?;
    let missing = &missing;
    let failed = || format!("installing {} failed; {by_hand}", missing.join(", "));
    cmd!(sh, "{update} {update_rest...}")
        .run()
        .with_context(failed)?;
    cmd!(sh, "{install} {install_rest...} {missing...}")
        .run()
        .with_context(failed)
}

pub(crate) fn is_on_path(program: &str) -> bool {
    env::var_os("PATH")
        .is_some_and(|path| env::split_paths(&path).any(|dir| dir.join(program).is_file()))
}
