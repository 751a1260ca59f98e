//! The project's chores: `cargo xtask --help`.

use std::{
    env,
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    process::{Command, ExitCode},
};

use anyhow::Context;
use clap::{Parser, Subcommand};
use xshell::{Shell, cmd};

mod built;
mod chip;
mod cortex_m;
mod documented;
mod elf;
mod firmware;
mod fuzz;
mod harness;
mod peers;
mod publish;
mod qemu;
mod scale;
mod setup;
mod size;
mod test;
mod usage;
mod words;

/// The project's chores.
#[derive(Parser)]
#[command(bin_name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    Test(test::Test),
    /// Every figure of the README again, with its goal
    Bench {
        /// Passed to the bench of accuracy, for example `recorded`; or `chip`: the emulated nRF52840's; or `live`: what
        /// the page takes, in a browser
        topics: Vec<String>,
    },
    /// Random sites on which everything goes wrong, and what must hold all the same
    Campaign {
        /// Passed on: `-- --help` tells which there are
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
    /// Instructions of the node's routines on emulated processors
    CortexM,
    /// Instructions of short runs of `host-sim`, which must be those of `tools/bench/scale.json`; `UPDATE_SCALE=1` writes
    /// them down
    Scale,
    /// Flash and RAM of the link on a Cortex-M4F
    Size {
        /// Names as many of the largest functions of each image
        #[arg(long, default_value_t = 0)]
        largest: usize,
    },
    /// Images for all boards, to target/firmware, with what they take, and files for their boot loaders
    Firmware {
        /// Only of these boards
        boards: Vec<String>,
        /// Only with this role; may be given several times. Less flash and RAM, but another image for each role
        #[arg(long = "role", value_parser = firmware::ROLE_NAMES)]
        roles: Vec<String>,
        /// Images of this version that are updated by radio, and the boot loader that they need
        #[arg(long, value_name = "VERSION", conflicts_with = "usb")]
        update: Option<u32>,
        /// For a coordinator whose PC is at the USB plug of the chip, not at that of the debug probe: of kits that have
        /// both
        #[arg(long)]
        usb: bool,
    },
    /// Tests against programs of other projects, which are built from source first
    Peers,
    /// Fuzzes what reads bytes and files, guided by coverage
    ///
    /// `cargo xtask fuzz --runs 10000000` is the long form, a target at a time if its name is given.
    Fuzz {
        /// Targets; all by default
        targets: Vec<String>,
        /// Inputs to try for each
        #[arg(long, default_value_t = 10 * fuzz::BRIEF)]
        runs: u32,
    },
}

fn main() -> ExitCode {
    // A copy of this program under another name is the wrapper of the compiler.
    let program = env::current_exe().unwrap_or_default();
    let done = match (
        program.file_stem().and_then(OsStr::to_str),
        env::var_os(usage::COUNT_IN),
    ) {
        (Some(usage::WRAPPER), Some(counter)) => usage::compile(Path::new(&counter)),
        _ if env::vars_os().any(|(name, _)| is_of_this(&name)) => begin_again(&program),
        _ => run(Arguments::parse().chore),
    };
    done.unwrap_or_else(|error| {
        complain(&error);
        ExitCode::FAILURE
    })
}

/// Returns true for a variable that tells a program which package it belongs to, as `cargo run` sets them.
fn is_of_this(variable: &OsStr) -> bool {
    let name = variable.to_string_lossy();
    name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_")
}

/// Runs this program again without these variables. Build scripts look at them, so that cargo would build much again
/// for `cargo xtask`, and once more for who calls cargo without it.
fn begin_again(program: &Path) -> anyhow::Result<ExitCode> {
    let mut again = Command::new(program);
    again.args(env::args_os().skip(1));
    for (name, _) in env::vars_os().filter(|(name, _)| is_of_this(name)) {
        again.env_remove(name);
    }
    #[cfg(unix)]
    let status = Err(std::os::unix::process::CommandExt::exec(&mut again));
    #[cfg(not(unix))]
    let status = again.status();
    let status: std::process::ExitStatus =
        status.context("this program cannot be started again")?;
    Ok(if status.success() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// Path of a copy of this program that does something else by this name.
fn tool(sh: &Shell, name: &str) -> PathBuf {
    let name = format!("target/tools/{name}{}", env::consts::EXE_SUFFIX);
    sh.current_dir().join(name)
}

/// Copies this program to a path, and replaces the file there at once: another run may use it just now.
fn copy_of_this(path: &Path) -> anyhow::Result<()> {
    let folder = path.parent().context("a program is in a folder")?;
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let copy = path.with_extension(std::process::id().to_string());
    fs::copy(env::current_exe()?, &copy)
        .and_then(|_| fs::rename(&copy, path))
        .with_context(|| format!("{} cannot be written", path.display()))
}

/// Prints an error and its causes. The place in this program where it arose is of no help, even if
/// `RUST_BACKTRACE` is set.
fn complain(error: &anyhow::Error) {
    eprintln!("Error: {error}");
    for cause in error.chain().skip(1) {
        eprintln!("  caused by: {cause}");
    }
}

fn run(chore: Chore) -> anyhow::Result<ExitCode> {
    let sh = Shell::new()?;
    // Whole, because it is shown.
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .and_then(Path::parent);
    sh.change_dir(root.context("xtask is in the workspace's folder")?);
    let done = match chore {
        Chore::Test(test) => return Ok(test.run(&sh)),
        Chore::Bench { topics } if topics == ["chip"] => chip::bench(&sh),
        Chore::Bench { topics } if topics == ["live"] => bench_page(&sh),
        Chore::Bench { topics } => {
            let all = topics.is_empty();
            cmd!(
                sh,
                "cargo run --locked --release --package bench -- {topics...}"
            )
            .run()?;
            if all {
                count_instructions(&sh)?;
                measure_size(&sh, 0)?;
                bench_page(&sh)?;
                cmd!(
                    sh,
                    "cargo run --locked --release --package cmucam2-driver --example soak"
                )
                .run()?;
            }
            Ok(())
        }
        Chore::Campaign { arguments } => cmd!(
            sh,
            "cargo run --locked --release --package campaign -- {arguments...}"
        )
        .run()
        .map_err(Into::into),
        Chore::CortexM => count_instructions(&sh),
        Chore::Scale => {
            setup::packages(&sh)?;
            scale::run(&sh)
        }
        Chore::Size { largest } => measure_size(&sh, largest),
        Chore::Firmware {
            boards,
            roles,
            update: None,
            usb: true,
        } => firmware::plugged(&sh, &boards, &roles),
        Chore::Firmware {
            boards,
            roles,
            update: None,
            usb: false,
        } => firmware::run(&sh, &boards, &roles),
        Chore::Firmware {
            boards,
            roles,
            update: Some(version),
            usb: _,
        } => firmware::updated(&sh, &boards, &roles, version),
        Chore::Peers => {
            setup::packages(&sh)?;
            peers::run(&sh)
        }
        Chore::Fuzz { targets, runs } => fuzz::run(&sh, &targets, |_| runs, None),
    };
    done.map(|()| ExitCode::SUCCESS)
}

fn bench_page(sh: &Shell) -> anyhow::Result<()> {
    setup::packages(sh)?;
    cmd!(sh, "cargo bench --locked --package host-sim --bench live").run()?;
    Ok(())
}

fn count_instructions(sh: &Shell) -> anyhow::Result<()> {
    setup::targets(sh)?;
    setup::packages(sh)?;
    let measurements = cortex_m::run(sh, &cortex_m::PROCESSORS)?;
    println!("{}", cortex_m::table(&measurements));
    cortex_m::within_budget(&measurements)
}

fn measure_size(sh: &Shell, largest: usize) -> anyhow::Result<()> {
    setup::targets(sh)?;
    let measurements = size::run(sh)?;
    println!("{}", size::table(&measurements));
    if largest > 0 {
        println!("{}", size::largest(&measurements, largest)?);
    }
    size::within_budget(&measurements)
}
