//! `host-sim run`

use std::{
    fs::File,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::{Context, ensure};
use clap::{Args, ValueEnum};
use host_sim::network::{Emulation, IMAGE, Options, Progress, Simulation};
use indicatif::{ProgressBar, ProgressStyle};

use super::{
    file_name,
    report::finish,
    run_outputs::{FOR_RESULTS, RunOutputs},
    scenario_options::{FOR_SCENARIO, ScenarioOptions},
    values,
};

/// Lets a network calibrate itself in virtual time, and compares what it found with the truth.
///
/// Every node runs its firmware, over emulated cameras and a simulated radio.
#[derive(Args)]
#[command(after_help = EPILOGUE)]
pub(super) struct Arguments {
    #[command(flatten, next_help_heading = FOR_SCENARIO)]
    scenario: ScenarioOptions,
    /// The root of all randomness. Default: the scenario's.
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// `max`, `real-time`, or so many times real time, such as `10x`. Default: `max`, and
    /// `real-time` on emulated boards.
    #[arg(long, value_name = "SPEED", value_parser = values::speed)]
    speed: Option<values::Speed>,
    /// What runs the firmware of the nodes.
    #[arg(long, value_name = "WHAT", default_value = "host")]
    backend: Backend,
    /// A real camera on a serial port for a camera node, at the rate of the scenario's cameras and
    /// in real time, such as `3=/dev/ttyUSB0`. May be repeated.
    #[arg(long, value_name = "NODE=PATH", value_parser = values::port)]
    port: Vec<(u16, String)>,
    /// The image for emulated boards.
    #[arg(long, value_name = "FILE.elf", default_value = IMAGE)]
    image: PathBuf,
    #[command(flatten, next_help_heading = FOR_RESULTS)]
    outputs: RunOutputs,
    /// All frames on the air, for Wireshark.
    #[arg(long, value_name = "FILE.pcap")]
    pcap: Option<PathBuf>,
    /// What every node sends and learns, with the time.
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Backend {
    /// This program, in virtual time.
    Host,
    /// An emulated Cortex-M4F for each node, in real time: machine code in `qemu-system-arm`.
    Qemu,
}

const EPILOGUE: &str = "\
Exit codes:
  0  every camera that should be calibrated is
  1  one is not, or --check found a difference
  2  wrong options, an impossible scenario, a file could not be read or written, or an emulated
     board ended by itself";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let scenario = arguments.scenario.load(arguments.seed)?;
    let speed = arguments.speed.as_ref().and_then(|speed| speed.0);
    ensure!(
        arguments.speed.is_none()
            || speed == Some(1.0)
            || (arguments.backend == Backend::Host && arguments.port.is_empty()),
        "emulated boards and real cameras have a time of their own: leave out --speed, or say \
         `--speed real-time`"
    );
    let emulation = match arguments.backend {
        Backend::Host => None,
        Backend::Qemu => Some(Emulation::of(&arguments.image)?),
    };
    let options = Options {
        speed,
        emulation,
        pcap: arguments.pcap.as_deref().map(create).transpose()?,
        log: arguments.log.as_deref().map(create).transpose()?,
    };
    let mut simulation = Simulation::new(scenario, options)?;
    for (node, path) in &arguments.port {
        simulation.connect_camera(*node, path)?;
    }
    let bar = bar();
    let record = simulation.run(|progress| show(&bar, &progress));
    bar.finish_and_clear();
    if let Some(trouble) = simulation.trouble() {
        return Err(trouble.into());
    }
    finish(&record, &arguments.outputs)
}

fn create(path: &Path) -> anyhow::Result<Box<dyn Write>> {
    let file = File::create(path);
    let file = file.with_context(|| format!("{} cannot be written", file_name(path)))?;
    Ok(Box::new(BufWriter::new(file)))
}

/// Only where somebody looks: `indicatif` hides it otherwise.
fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} stop {pos} of {len}, {msg}");
    let bar = ProgressBar::new(0);
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

fn show(bar: &ProgressBar, progress: &Progress) {
    bar.set_length(progress.of as u64);
    bar.set_position(progress.stops as u64);
    bar.set_message(format!(
        "{} of {} cameras calibrated, {:.0} s",
        progress.calibrated, progress.cameras, progress.seconds
    ));
}
