//! Programs that the chores need and a fresh machine may lack: installed where that is allowed, otherwise named
//! with the command to type.

use std::{env, ffi::OsStr, path::Path};

use anyhow::{Context, Result, bail, ensure};
use xshell::{Shell, cmd};

use crate::publish::OTHER_TARGETS;

/// Processors that firmware is built for: with a floating-point unit, and without.
pub(crate) const TARGETS: [&str; 2] = ["thumbv7em-none-eabihf", "thumbv6m-none-eabi"];

/// Programs that tests run, and the Debian packages they come in.
const PROGRAMS: [(&str, &str); 13] = [
    ("gdb-multiarch", "gdb-multiarch"),
    ("qemu-system-arm", "qemu-system-arm"),
    ("tshark", "tshark"),
    ("ffmpeg", "ffmpeg"),
    ("cmake", "cmake"),
    ("ninja", "ninja-build"),
    ("c++", "g++"),
    ("chromium", "chromium"),
    ("chromedriver", "chromium-driver"),
    ("valgrind", "valgrind"),
    // The broker itself is where only root looks for programs.
    ("mosquitto_passwd", "mosquitto"),
    ("mosquitto_sub", "mosquitto-clients"),
    ("openssl", "openssl"),
];

/// The other browser, which only the stages of the night ask for.
const FIREFOX: [(&str, &str); 1] = [("firefox-esr", "firefox-esr")];

/// The linker of images for nodes.
pub(crate) const LINKER: &str = "flip-link";
const LINKER_VERSION: &str = "0.1.12";

/// Compiler of the images. Its figures are documented, and the names it gives to functions are those that the
/// checks of stack and panics know; a newer one makes images that are 1,184 bytes larger.
pub(crate) const IMAGE_COMPILER: &str = "1.95.0";

/// Installs the compiler of the images, if it is missing.
pub(crate) fn image_compiler(sh: &Shell, target: &str) -> Result<()> {
    let name = IMAGE_COMPILER;
    let sysroot = cmd!(sh, "rustc --print sysroot")
        .env("RUSTUP_TOOLCHAIN", name)
        .env("RUSTUP_AUTO_INSTALL", "0")
        .quiet()
        .ignore_stderr()
        .read()
        .unwrap_or_default();
    if Path::new(&sysroot)
        .join("lib/rustlib")
        .join(target)
        .is_dir()
    {
        return Ok(());
    }
    cmd!(
        sh,
        "rustup toolchain install {name} --profile minimal --target {target}"
    )
    .run()
    .with_context(|| {
        format!(
            "type `rustup toolchain install {name} --profile minimal --target {target}` where there is a network"
        )
    })
}

/// Tells where `Cargo.lock` no longer fits. No chore changes it.
pub(crate) fn locked(sh: &Shell) -> Result<()> {
    cmd!(sh, "cargo tree --locked --quiet --depth 0")
        .quiet()
        .ignore_stdout()
        .run()
        .context(
            "where Cargo.lock no longer fits, type `cargo update --workspace`, and keep what changed",
        )
}

/// The compiler's targets and components, of the toolchain in use.
pub(crate) fn targets(sh: &Shell) -> Result<()> {
    let sysroot = cmd!(sh, "rustc --print sysroot").quiet().read()?;
    add_targets(sh, &sysroot, &TARGETS)?;
    for (component, program) in [("rustfmt", "cargo-fmt"), ("clippy", "cargo-clippy")] {
        if !Path::new(&sysroot).join("bin").join(program).is_file() {
            cmd!(sh, "rustup component add {component}")
                .run()
                .with_context(|| format!("install `{component}` another way"))?;
        }
    }
    Ok(())
}

/// Targets that only libraries for others are built for.
pub(crate) fn other_targets(sh: &Shell) -> Result<()> {
    let sysroot = cmd!(sh, "rustc --print sysroot").quiet().read()?;
    add_targets(sh, &sysroot, &OTHER_TARGETS)
}

fn add_targets(sh: &Shell, sysroot: &str, targets: &[&str]) -> Result<()> {
    let is_there = |target: &&&str| {
        let folder = Path::new(sysroot).join("lib/rustlib").join(target);
        folder.is_dir()
    };
    let missing: Vec<_> = targets
        .iter()
        .filter(|target| !is_there(target))
        .copied()
        .collect();
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
    Ok(())
}

/// Returns true if this runs where no developer reads which stages were left out. Nothing else in this project
/// asks for `CI`.
pub(crate) fn is_ci() -> bool {
    says_ci(env::var_os("CI").as_deref())
}

fn says_ci(value: Option<&OsStr>) -> bool {
    value.is_some_and(|value| !["", "0", "false"].map(OsStr::new).contains(&value))
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

/// The program that finds public items that have gone since another version.
pub(crate) fn semver_checks(sh: &Shell) -> Result<()> {
    if is_on_path("cargo-semver-checks") {
        return Ok(());
    }
    let package = "cargo-semver-checks@0.50";
    cmd!(sh, "cargo install --locked {package}")
        .run()
        .with_context(|| {
            format!("type `cargo install --locked {package}` where there is a network")
        })
}

/// Installs programs of other projects that are missing.
pub(crate) fn packages(sh: &Shell) -> Result<()> {
    install(sh, &PROGRAMS)
}

/// Installs Firefox, if it is missing.
pub(crate) fn firefox(sh: &Shell) -> Result<()> {
    install(sh, &FIREFOX)
}

fn install(sh: &Shell, programs: &[(&str, &'static str)]) -> Result<()> {
    let missing = programs
        .iter()
        .filter(|(program, _)| !is_on_path(program))
        .map(|&(_, package)| package)
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
    // An update in the background may hold the lock: two minutes are enough for it to end.
    let wait = "DPkg::Lock::Timeout=120";
    let install = [
        "apt-get",
        "-o",
        wait,
        "install",
        "-y",
        "--no-install-recommends",
    ];
    let install = words(&install);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_says_that_this_is_ci() {
        for (value, is_ci) in [
            (None, false),
            (Some(""), false),
            (Some("0"), false),
            (Some("false"), false),
            (Some("1"), true),
            (Some("true"), true),
            (Some("woodpecker"), true),
        ] {
            assert_eq!(says_ci(value.map(OsStr::new)), is_ci, "{value:?}");
        }
    }

    /// A chore that changes `Cargo.lock` would test another build than users get.
    #[test]
    fn every_call_of_cargo_is_locked() {
        let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src")];
        let mut calls = 0;
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    folders.push(path);
                    continue;
                }
                let text = std::fs::read_to_string(&path).unwrap();
                // As `cmd!` has them, on the same line or the next.
                for call in text.split("cmd!(").skip(1) {
                    let command = call.split('"').nth(1).unwrap_or_default();
                    if command.starts_with("cargo ") && !command.starts_with("cargo fmt ") {
                        calls += 1;
                        assert!(command.contains(" --locked"), "{path:?}: {command}");
                    }
                }
            }
        }
        assert!(calls > 10, "{calls}");
    }
}
