//! A camera of the Pixy family on the clock.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use cmucam2_emulator::{Background, Scene, Time};
use pixy_emulator::{Configuration, Emulator, Model};

use super::{
    super::tell,
    Arguments, PATIENCE,
    carried::{Carried, Pixy},
    film::Film,
};

/// Its rate as it is shipped.
pub(super) const BAUD: u32 = 19_200;

/// Colour that it was taught, unless told otherwise: that of the ball of the usual scene.
const USUAL_COLOUR: Taught = Taught([225, 110, 35]);

impl Arguments {
    /// Configuration of a camera of the Pixy family.
    pub(super) fn pixy(&self, model: Model) -> Configuration {
        let taught = match &self.taught[..] {
            [] => &[USUAL_COLOUR],
            taught => taught,
        };
        Configuration {
            model,
            baud: self.baud(),
            signatures: taught.iter().map(|&Taught(colour)| colour).collect(),
            seed: self.seed,
            watched: self.verbose,
            ..Configuration::default()
        }
    }
}

/// A colour that the camera was taught.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taught([u8; 3]);

impl std::str::FromStr for Taught {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let levels: Result<Vec<u8>, _> =
            text.split(',').map(|level| level.trim().parse()).collect();
        let levels = levels.ok().and_then(|levels| levels.try_into().ok());
        levels
            .map(Self)
            .ok_or("three levels are needed: R,G,B, each 0 to 255")
    }
}

const fn name(model: Model) -> &'static str {
    match model {
        Model::Pixy2 => "Pixy2",
        Model::Pixy => "Pixy",
        Model::OpenMv => "OpenMV Cam with its script for blobs",
        Model::OpenMvTags => "OpenMV Cam with its script for tags",
    }
}

/// Serves the camera until `stop`; `power` switches it off and on.
pub(super) fn run(
    arguments: &Arguments,
    model: Model,
    scene: Scene,
    film: Option<&Film>,
    (stop, power): (&Arc<AtomicBool>, &Arc<AtomicBool>),
) -> anyhow::Result<()> {
    let mut line = arguments.line()?;
    arguments.tell_where(name(model), &line);
    let baud = arguments.baud();
    let emulator = Emulator::new(arguments.pixy(model), scene);
    let mut carried = Carried::new(Pixy::new(emulator, baud), baud);
    let start = Instant::now();
    // 584 years.
    let clock = || start.elapsed().as_nanos() as Time;
    while !stop.load(Ordering::Relaxed) {
        if power.swap(false, Ordering::Relaxed) {
            carried.camera.emulator().power_cycle(clock());
        }
        let wait = carried.next().map_or(PATIENCE, |at| {
            Duration::from_nanos(at.saturating_sub(clock())).min(PATIENCE)
        });
        let received = line.receive(wait)?;
        if let Some(rate) = arguments.other_rate(&line, carried.host_baud())? {
            carried.set_host_baud(rate);
        }
        if let Some(picture) = film.map(Film::take).transpose()?.flatten() {
            carried.camera.emulator().scene_mut().background = Background::Picture(picture);
        }
        let now = clock();
        carried.hear(&received, now);
        line.send(&carried.advance(now))?;
        while let Some(note) = carried.camera.emulator().take_note() {
            tell(format_args!("{:9.3} {note}", start.elapsed().as_secs_f64()));
        }
    }
    Ok(())
}
