//! Computes the figures that the README states, next to what they are to reach.
//!
//! The full recorded sets are read from `../shared/data` beside the repository where they are
//! there; otherwise the subsets in `tests/data`, whose figures differ a little.

use clap::{Parser, ValueEnum};

mod camera;
mod cramer_rao;
mod figure;
mod network;
mod precision;
mod recorded;
mod stage;

use figure::Sheet;

/// The figures of the README, computed again.
#[derive(Parser)]
struct Arguments {
    /// Which figures; all by default.
    #[arg(value_enum)]
    topics: Vec<Topic>,
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
    /// Whole networks in virtual time: the thesis's 13 cameras, and a thousand.
    Network,
    /// Those of the above that take a few seconds.
    Brief,
}

/// What is brief.
const BRIEF: [Topic; 3] = [Topic::Recorded, Topic::Precision, Topic::Camera];

fn main() -> anyhow::Result<()> {
    let mut topics = Arguments::parse().topics;
    if topics.contains(&Topic::Brief) {
        topics.extend(BRIEF);
    }
    let mut sheet = Sheet::default();
    for topic in Topic::value_variants() {
        if !topics.is_empty() && !topics.contains(topic) {
            continue;
        }
        match topic {
            Topic::Recorded => recorded::run(&mut sheet)?,
            Topic::Stage => stage::run(&mut sheet)?,
            Topic::CramerRao => cramer_rao::run(&mut sheet),
            Topic::Precision => precision::run(&mut sheet),
            Topic::Camera => camera::run(&mut sheet)?,
            Topic::Network => network::run(&mut sheet)?,
            Topic::Brief => {}
        }
    }
    sheet.close();
    Ok(())
}
