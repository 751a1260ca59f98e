//! `host-sim probe --camera pixy2`: the blobs of a signature, and where they are.

use std::{
    io::{self, Write},
    path::Path,
    time::Duration,
};

use anyhow::{anyhow, bail};
use host_sim::probe::{
    Bearing, View,
    display::Degrees,
    port::{Baud, Clock, Overheard, Port, PortError},
    record::Recording,
    stranger,
};
use indicatif::ProgressBar;
use node_firmware::vision::{
    Blob, Look, Patience, Shape, look::FRAMES_MAX, pixy2, pixy2::COLUMNS, steady::Steadiness,
};
use pixy2_driver::{
    Error, Pixy2,
    block::Block,
    packet::Signatures,
    session::{Fault, Policy},
};
use serde::Serialize;

use super::{
    Arguments, Person, is_interruption, stops,
    stops::{NotSeen, Watches},
    tell,
};

/// Rates that are tried: as it is shipped, and others that people set.
const RATES: [u32; 5] = [19_200, 115_200, 57_600, 38_400, 230_400];

/// An adapter on USB holds bytes back. So does a busy computer, where the camera is another program on it.
const PATIENT: Policy = Policy {
    reply_us: 500_000,
    pause_us: 2_000,
    busy_us: 5_000_000,
    retries: 4,
    poll_us: 500,
};

/// A line of what is seen.
#[derive(Serialize)]
struct Line {
    seconds: f64,
    blocks: usize,
    x: Option<u16>,
    y: Option<u16>,
    width: Option<u16>,
    height: Option<u16>,
    /// Bearing of an object that stood still in the last frames.
    bearing_rad: Option<f64>,
    sigma_rad: Option<f64>,
}

type Camera = Pixy2<Port, Clock>;

/// A Pixy2 with what is known about it.
struct Bench<'a> {
    arguments: &'a Arguments,
    camera: Camera,
    clock: Clock,
    view: View,
    person: Person,
}

impl Bench<'_> {
    /// The two largest blobs of the signature, the largest first.
    fn blocks(&mut self) -> anyhow::Result<Vec<Block>> {
        let of = Signatures::one(self.arguments.signature);
        let blocks = self.camera.blocks_wait(of, 2);
        let path = self.arguments.line();
        Ok(blocks.map_err(|error| failed(path, error))?.collect())
    }
}

impl Watches for Bench<'_> {
    fn arguments(&self) -> &Arguments {
        self.arguments
    }

    fn view(&self) -> &View {
        &self.view
    }

    fn person(&mut self) -> &mut Person {
        &mut self.person
    }

    /// A Pixy2 looks all the time.
    fn begin(&mut self) -> anyhow::Result<()> {
        Ok(())
    }

    fn end(&mut self) -> anyhow::Result<()> {
        Ok(())
    }

    fn next(&mut self, _: &ProgressBar) -> anyhow::Result<Result<Option<Option<Blob>>, NotSeen>> {
        Ok(Ok(Some(blob(&self.blocks()?))))
    }
}

/// The largest blob, and whether another one comes near it.
fn blob(blocks: &[Block]) -> Option<Blob> {
    let largest = blocks.first()?;
    Some(pixy2::blob(largest, blocks.get(1)))
}

pub(super) fn run(
    arguments: &Arguments,
    person: Person,
    recording: Option<(&Path, Recording)>,
) -> anyhow::Result<()> {
    let only = [
        (arguments.frame.is_some(), "--frame"),
        (arguments.colour.is_some(), "--colour"),
        (arguments.high_res, "--high-res"),
        (arguments.first_column.is_some(), "--first-column"),
    ];
    if let Some((_, option)) = only.iter().find(|(given, _)| *given) {
        bail!("{option} is for a CMUcam2");
    }
    let optics = arguments.camera.camera(COLUMNS)?;
    let path = arguments.line();
    let (mut camera, clock, rate) = connect(arguments, &person)?;
    let refused = |error| failed(path, error);
    let version = camera.version_wait().map_err(refused)?;
    let (columns, rows) = camera.resolution_wait().map_err(refused)?;
    tell(format_args!(
        "{path}: a Pixy2 at {rate} baud, firmware {}.{}.{}, blobs in {columns} x {rows}",
        version.major, version.minor, version.build
    ));
    if columns != COLUMNS {
        tell(format_args!("nodes expect {COLUMNS} columns"));
    }
    let mut bench = Bench {
        arguments,
        camera,
        clock,
        view: View::new(COLUMNS, 0, optics),
        person,
    };
    match recording {
        Some((path, mut recording)) => stops::run(&mut bench, &mut recording, path),
        None => live(&mut bench),
    }
}

/// Prints the blobs.
fn live(bench: &mut Bench<'_>) -> anyhow::Result<()> {
    let arguments = bench.arguments;
    let shape = Shape::Round {
        rows_per_column: 1.0,
    };
    let frames = usize::from(Patience::default().frames);
    let mut steadiness = Steadiness::<FRAMES_MAX>::new(frames, COLUMNS, shape);
    let clock = bench.clock.clone();
    let begin = clock.now();
    let elapsed = || clock.now().saturating_sub(begin);
    let time = arguments
        .seconds
        .map(|s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX));
    let mut told = 0;
    while arguments.count.is_none_or(|count| told < count)
        && time.is_none_or(|time| elapsed() < time)
    {
        let blocks = match bench.blocks() {
            Ok(blocks) => blocks,
            Err(error) if is_interruption(&error) => break,
            Err(error) => return Err(error),
        };
        told += 1;
        let steady = steadiness.push(blob(&blocks));
        let bearing = steady
            .as_ref()
            .ok()
            .and_then(|steady| bench.view.bearing(steady));
        let largest = blocks.first();
        let line = Line {
            seconds: elapsed().as_secs_f64(),
            blocks: blocks.len(),
            x: largest.map(|block| block.x),
            y: largest.map(|block| block.y),
            width: largest.map(|block| block.width),
            height: largest.map(|block| block.height),
            bearing_rad: bearing.map(|told| told.bearing),
            sigma_rad: bearing.map(|told| told.sigma),
        };
        let mut out = io::stdout().lock();
        if arguments.json {
            serde_json::to_writer(&mut out, &line)?;
            writeln!(out)?;
            continue;
        }
        write!(out, "{:8.3} s  ", line.seconds)?;
        match largest {
            None => write!(out, "{}", Look::Nothing)?,
            Some(block) => write!(
                out,
                "x {:3} y {:3}  {:3} x {:3}",
                block.x, block.y, block.width, block.height
            )?,
        }
        match (bearing, steady) {
            (Some(Bearing { bearing, sigma }), _) => {
                writeln!(out, "  {} deg", Degrees(bearing, sigma))?;
            }
            (None, Err(why)) if largest.is_some() => writeln!(out, "  {why}")?,
            _ => writeln!(out)?,
        }
        out.flush()?;
    }
    if told > 0 && arguments.json {
        io::stdout().flush()?;
    }
    Ok(())
}

/// Finds the camera at one of the rates.
fn connect(arguments: &Arguments, person: &Person) -> anyhow::Result<(Camera, Clock, u32)> {
    let rates = match arguments.baud {
        Baud::Rate(rate) => vec![rate],
        Baud::Auto => RATES.to_vec(),
    };
    // A camera that starts is silent for two seconds.
    for round in 0..2 {
        for &rate in &rates {
            let port = arguments.open(rate, person)?;
            let (clock, heard) = (port.clock(), port.heard());
            let policy = if round == 0 {
                Policy::default()
            } else {
                PATIENT
            };
            let mut camera = Pixy2::with_policy(port, clock.clone(), policy);
            match camera.version_wait() {
                Ok(_) => {
                    let (port, delay) = camera.release();
                    return Ok((Pixy2::with_policy(port, delay, PATIENT), clock, rate));
                }
                Err(Error::Camera(Fault::Silence | Fault::Garbled)) => {
                    let heard = heard.bytes();
                    if let Some(who) = stranger::name(&heard).filter(|who| who.is_certain()) {
                        let stranger = Overheard { rate, heard, who };
                        bail!("{}: {stranger}", arguments.line());
                    }
                }
                Err(error) => return Err(failed(arguments.line(), error)),
            }
        }
    }
    let tried: Vec<_> = rates.iter().map(u32::to_string).collect();
    Err(anyhow!(
        "{}: no Pixy2 answers at {} baud: is its data port set to UART (PixyMon: Configure, \
         Interface, \"Data out port\"), and are TX and RX crossed?",
        arguments.line(),
        tried.join(", ")
    ))
}

fn failed(port: &str, error: Error<PortError>) -> anyhow::Error {
    match error {
        Error::Uart(PortError::Interrupted) => PortError::Interrupted.into(),
        error => anyhow!("{port}: {error}"),
    }
}
