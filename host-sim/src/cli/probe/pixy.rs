//! `host-sim probe --camera pixy2` and the others of its family: the blobs of a signature, or a tag, and where they
//! are.

use std::{
    io::{self, Write},
    path::Path,
    time::Duration,
};

use anyhow::{anyhow, bail};
use calib_core::camera::Camera;
use host_sim::probe::{
    View, advice,
    display::{Degrees, Height},
    port::{Baud, Clock, Overheard, Port, PortError},
    record::Recording,
    stranger::{self, Stranger},
};
use indicatif::ProgressBar;
use node_firmware::vision::{
    Blob, Look, Patience, Shape, look::FRAMES_MAX, pixy, steady::Steadiness,
};
use pixy_driver::{
    Error, Model, Pixy,
    block::Block,
    packet::{Request, Signatures},
    session::{Fault, Policy},
};
use serde::Serialize;

use super::{
    Arguments, KindOption, Person, live, stops,
    stops::{NotSeen, Watches},
    tell, tell_search,
};

/// Rates that are tried: as it is shipped, and others that people set.
const RATES: [u32; 5] = [19_200, 115_200, 57_600, 38_400, 230_400];

/// Longest time for which a camera that was just switched on says nothing: two seconds, and some more.
const STARTS: Duration = Duration::from_millis(2_500);

/// Most looks at each rate, where garbage ends each look early.
const ROUNDS: usize = 8;

/// An adapter on USB holds bytes back. So does a busy computer, where the camera is another program on it.
fn patient() -> Policy {
    let mut policy = Policy::default();
    policy.reply_us = 500_000;
    policy.retries = 4;
    policy.poll_us = 500;
    policy
}

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
    /// Elevation of the same.
    elevation_rad: Option<f64>,
    /// Words for why there is no bearing.
    reason: Option<String>,
}

type Device = Pixy<Port, Clock>;

/// A camera with what is known about it.
struct Bench<'a> {
    arguments: &'a Arguments,
    camera: Device,
    clock: Clock,
    view: View,
    shape: Shape,
    person: Person,
}

impl Bench<'_> {
    /// The two largest blobs of the signature, the largest first.
    fn blocks(&mut self) -> anyhow::Result<Vec<Block>> {
        let of = match self.camera.model() {
            Model::OpenMvTags => Signatures::tag(self.arguments.tag.unwrap_or(0)),
            _ => Signatures::one(self.arguments.signature.unwrap_or(1)),
        };
        let blocks = self.camera.blocks(of, 2).wait();
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

    fn shape(&self) -> Shape {
        self.shape
    }

    fn tells_pixels(&self) -> bool {
        false
    }

    /// It looks all the time.
    fn begin(&mut self) -> anyhow::Result<()> {
        Ok(())
    }

    fn end(&mut self) -> anyhow::Result<()> {
        Ok(())
    }

    fn next(&mut self, _: &ProgressBar) -> anyhow::Result<Result<Option<Option<Blob>>, NotSeen>> {
        let blocks = self.blocks()?;
        Ok(Ok(Some(blob(self.camera.model(), &blocks))))
    }
}

/// The largest blob, and whether another one comes near it.
fn blob(model: Model, blocks: &[Block]) -> Option<Blob> {
    let largest = blocks.first()?;
    Some(pixy::blob(model, largest, blocks.get(1)))
}

/// The driver's model, of all but a CMUcam2.
pub(super) const fn model(kind: KindOption) -> Option<Model> {
    match kind {
        KindOption::Cmucam2 => None,
        KindOption::Pixy2 => Some(Model::Pixy2),
        KindOption::Pixy => Some(Model::Pixy),
        KindOption::OpenMv => Some(Model::OpenMv),
        KindOption::OpenMvTags => Some(Model::OpenMvTags),
    }
}

/// As people call it.
const fn name(model: Model) -> &'static str {
    match model {
        Model::Pixy2 => "Pixy2",
        Model::Pixy => "Pixy",
        Model::OpenMv => "OpenMV Cam",
        Model::OpenMvTags => "OpenMV Cam with its script for tags",
    }
}

pub(super) fn run(
    arguments: &Arguments,
    model: Model,
    person: Person,
    recording: Option<(&Path, Recording)>,
) -> anyhow::Result<()> {
    let [expected, _] = model.size();
    // What is wrong with it is told before anyone waits for the camera.
    arguments.camera.of_live::<f64>(expected)?;
    let path = arguments.line();
    let (mut camera, clock, rate) = connect(arguments, model, &person)?;
    let refused = |error| failed(path, error);
    let columns = if model.streams() {
        let [columns, rows] = model.size();
        tell(format_args!(
            "{path}: a stream of blobs at {rate} baud, taken for that of the {} in {columns} x {rows}",
            name(model)
        ));
        expected
    } else {
        let version = camera.version().wait().map_err(refused)?;
        let (columns, rows) = camera.resolution().wait().map_err(refused)?;
        tell(format_args!(
            "{path}: a Pixy2 at {rate} baud, firmware {}.{}.{}, blobs in {columns} x {rows}",
            version.major, version.minor, version.build
        ));
        if columns != expected {
            tell(format_args!("nodes expect {expected} columns"));
        }
        columns
    };
    let mut bench = Bench {
        arguments,
        camera,
        clock,
        view: View::new(columns, 0, arguments.camera.of_live(columns)?),
        shape: shape(model, arguments.camera.of_live(columns)?),
        person,
    };
    match recording {
        Some((path, mut recording)) => stops::run(&mut bench, &mut recording, path),
        None => live(&mut bench),
    }
}

/// Shape of what the camera looks for, as a node takes it that is told nothing else.
fn shape(model: Model, optics: Option<Camera<f32>>) -> Shape {
    match model {
        Model::OpenMvTags => Shape::Any,
        Model::Pixy2 | Model::Pixy | Model::OpenMv => Shape::Round {
            rows_per_column: 1.0,
            optics,
        },
    }
}

/// Prints the blobs.
fn live(bench: &mut Bench<'_>) -> anyhow::Result<()> {
    let arguments = bench.arguments;
    let model = bench.camera.model();
    let frames = usize::from(Patience::default().frames);
    let mut steadiness = Steadiness::<FRAMES_MAX>::new(frames, bench.view.columns(), bench.shape);
    let clock = bench.clock.clone();
    live::until_enough(arguments, &clock, |elapsed| {
        let blocks = bench.blocks()?;
        let steady = steadiness.push(blob(model, &blocks));
        let bearing = steady
            .as_ref()
            .ok()
            .and_then(|steady| bench.view.bearing(steady));
        let largest = blocks.first();
        let reason = match (largest, &steady) {
            (None, _) => Some(Look::Nothing.to_string()),
            (_, Err(why)) => Some(why.to_string()),
            (_, Ok(_)) if bearing.is_none() => Some("--fov-deg is not given".to_owned()),
            _ => None,
        };
        let line = Line {
            seconds: elapsed().as_secs_f64(),
            blocks: blocks.len(),
            x: largest.map(|block| block.x),
            y: largest.map(|block| block.y),
            width: largest.map(|block| block.width),
            height: largest.map(|block| block.height),
            bearing_rad: bearing.map(|told| told.bearing),
            sigma_rad: bearing.map(|told| told.sigma),
            elevation_rad: bearing.and_then(|told| told.elevation),
            reason,
        };
        let mut out = io::stdout().lock();
        if arguments.json {
            serde_json::to_writer(&mut out, &line)?;
            writeln!(out)?;
            return Ok(true);
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
            (Some(seen), _) => {
                write!(out, "  {} deg", Degrees(seen.bearing, seen.sigma))?;
                writeln!(out, "{}", Height(seen.elevation))?;
            }
            (None, Err(why)) if largest.is_some() => writeln!(out, "  {why}")?,
            _ => writeln!(out)?,
        }
        out.flush()?;
        Ok(true)
    })
}

/// Finds the camera at one of the rates.
fn connect(
    arguments: &Arguments,
    model: Model,
    person: &Person,
) -> anyhow::Result<(Device, Clock, u32)> {
    let first = if model.streams() {
        Request::Blocks {
            of: Signatures::ALL,
            most: 0,
        }
    } else {
        Request::Version
    };
    let rates = match arguments.baud {
        Baud::Rate(rate) => vec![rate],
        Baud::Auto => RATES.to_vec(),
    };
    tell_search(arguments, name(model), &rates);
    let mut looked = Duration::ZERO;
    for round in 0..ROUNDS {
        let mut is_last = false;
        for (number, &rate) in rates.iter().enumerate() {
            let port = arguments.open(rate, person)?;
            let (clock, heard) = (port.clock(), port.heard());
            let mut policy = if round == 0 {
                Policy::default()
            } else {
                patient()
            };
            // A stream is waited for long enough each time.
            if model.streams() {
                policy.retries = 0;
            }
            let mut camera = Pixy::with_policy(model, port, clock.clone(), policy);
            let begun = clock.now();
            let answer = camera.request(first).wait();
            looked += clock.now().saturating_sub(begun);
            // The first rate is the likeliest.
            is_last |= round > 0 && number == 0 && looked >= STARTS;
            match answer {
                Ok(_) => {
                    let (port, delay) = camera.release();
                    let camera = Pixy::with_policy(model, port, delay, patient());
                    return Ok((camera, clock, rate));
                }
                Err(Error::Camera(Fault::Silence | Fault::Garbled)) => {
                    let heard = heard.bytes();
                    let who = stranger::name(&heard).filter(|who| {
                        // Its stream was damaged for a while.
                        who.is_certain() && !(model.streams() && *who == Stranger::OriginalPixy)
                    });
                    if let Some(who) = who {
                        let stranger = Overheard { rate, heard, who };
                        bail!("{}: {stranger}", arguments.line());
                    }
                }
                Err(error) => return Err(failed(arguments.line(), error)),
            }
        }
        if is_last {
            break;
        }
    }
    let tried: Vec<_> = rates.iter().map(u32::to_string).collect();
    let (path, tried) = (arguments.line(), tried.join(", "));
    Err(match model {
        Model::OpenMv | Model::OpenMvTags => anyhow!(
            "{path}: no {} is heard at {tried} baud: does its script run, and is its P4 (TX) on RX?",
            name(model)
        ),
        Model::Pixy => anyhow!(
            "{path}: no Pixy is heard at {tried} baud: is its data port set to UART (PixyMon: Configure, \
             Interface, \"Data out port\"), and are TX and RX crossed?"
        ),
        Model::Pixy2 => anyhow!(
            "{path}: no Pixy2 answers at {tried} baud: is its data port set to UART (PixyMon: Configure, \
             Interface, \"Data out port\"), and are TX and RX crossed?"
        ),
    })
}

fn failed(port: &str, error: Error<PortError>) -> anyhow::Error {
    let why = match error {
        Error::Uart(PortError::Interrupted) => return PortError::Interrupted.into(),
        Error::Uart(error) => advice::of_port(&error),
        Error::Closed => advice::CLOSED.to_owned(),
        Error::Camera(fault) => fault.to_string(),
    };
    anyhow!("{port}: {why}")
}
