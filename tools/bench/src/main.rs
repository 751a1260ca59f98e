//! Computes the figures of `docs/accuracy.md`, next to their goals, and fails if one of them misses its goal.
//!
//! A figure that is known to miss its aim has no goal but an open one: the code says why.
//! `--csv` writes all figures and goals for machines.
//!
//! The full recorded sets are read from `../shared/data` beside the repository where they are
//! there; otherwise the subsets in `tests/data`, whose figures differ a little.

use std::{path::PathBuf, process::ExitCode};

use clap::{Parser, ValueEnum};

mod building;
mod camera;
mod cramer_rao;
mod figure;
mod joint;
mod months;
mod network;
mod precision;
mod recorded;
mod scale;
mod stage;
mod track;

use figure::Sheet;

/// The figures of `docs/accuracy.md`, computed again.
#[derive(Parser)]
struct Arguments {
    /// Topics of figures; all but the brief ones by default.
    #[arg(value_enum)]
    topics: Vec<Topic>,
    /// Figures and goals, one row each.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Topic {
    /// Real cameras and a real scanner: MRCLAM and Roh.
    Recorded,
    /// Blobs of the Stage simulator, for the thesis's 13 cameras.
    Stage,
    /// Simulated Gaussian bearings against the Cramer-Rao bound.
    CramerRao,
    /// Single precision against double, by conditioning.
    Precision,
    /// The line to an emulated CMUcam2: rates and corruption.
    Camera,
    /// Cameras, target and carrier together, against the batch optimum.
    Joint,
    /// Whole networks in virtual time: the thesis's 13 cameras, and a thousand.
    Network,
    /// A thousand cameras in forty networks and one frame: minutes.
    Building,
    /// Objects without a radio, tracked by a network that calibrated itself.
    Track,
    /// Cameras that are moved, in 90 days of an office: five minutes.
    Months,
    /// Speed and memory with many nodes, and networks solved again: minutes, and Linux only.
    Scale,
    /// A thousand cameras that forty publishers tell a broker, shown by one page: minutes, Linux and mosquitto only.
    Broker,
    /// The main goals again, from few runs: a minute. A goal is missed only by what chance does not
    /// explain.
    Brief,
}

fn main() -> anyhow::Result<ExitCode> {
    let Arguments { topics, csv } = Arguments::parse();
    let mut sheet = Sheet::default();
    for topic in Topic::value_variants() {
        let is_wanted = match topics.is_empty() {
            true => *topic != Topic::Brief,
            false => topics.contains(topic),
        };
        if !is_wanted {
            continue;
        }
        match topic {
            Topic::Recorded => recorded::run(&mut sheet, false)?,
            Topic::Stage => stage::run(&mut sheet, false)?,
            Topic::CramerRao => cramer_rao::run(&mut sheet, false),
            Topic::Precision => precision::run(&mut sheet, false),
            Topic::Camera => camera::run(&mut sheet)?,
            Topic::Joint => joint::run(&mut sheet)?,
            Topic::Network => network::run(&mut sheet)?,
            Topic::Building => building::run(&mut sheet)?,
            Topic::Track => track::run(&mut sheet)?,
            Topic::Months => months::run(&mut sheet)?,
            Topic::Scale => scale::run(&mut sheet)?,
            Topic::Broker => scale::broker::run(&mut sheet)?,
            Topic::Brief => {
                recorded::run(&mut sheet, true)?;
                stage::run(&mut sheet, true)?;
                cramer_rao::run(&mut sheet, true);
                precision::run(&mut sheet, true);
                network::brief(&mut sheet)?;
            }
        }
    }
    if let Some(path) = csv {
        sheet.write(&path)?;
    }
    println!("\n{} figures missed their goal", sheet.missed());
    Ok(ExitCode::from(u8::from(sheet.missed() > 0)))
}
