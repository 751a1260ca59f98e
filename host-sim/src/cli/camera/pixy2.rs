//! A Pixy2 on the clock.

use std::{
    collections::VecDeque,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use anyhow::bail;
use cmucam2_emulator::{Background, Scene, Time};
use pixy2_emulator::{Configuration, Emulator};

use super::{Arguments, BYTE_BITS, PATIENCE, SECOND, film::Film};

/// The rate of one as it is shipped.
pub(super) const BAUD: u32 = 19_200;

impl Arguments {
    /// What only a CMUcam2 has is refused.
    pub(super) fn pixy2(&self) -> anyhow::Result<Configuration> {
        if !(self.switch.is_empty() && self.fault.is_empty()) {
            bail!("--switch and --fault are those of a CMUcam2");
        }
        Ok(Configuration {
            baud: self.baud(),
            signatures: self.taught.iter().map(|&Taught(colour)| colour).collect(),
            seed: self.seed,
            ..Configuration::default()
        })
    }
}

/// A colour that it was taught.
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

/// Serves it until `stop`; `power` switches it off and on.
pub(super) fn run(
    arguments: &Arguments,
    scene: Scene,
    film: Option<&Film>,
    (stop, power): (&Arc<AtomicBool>, &Arc<AtomicBool>),
) -> anyhow::Result<()> {
    let mut line = arguments.line()?;
    arguments.tell_where("Pixy2", &line);
    let mut emulator = Emulator::new(arguments.pixy2()?, scene);
    let start = Instant::now();
    // 584 years.
    let clock = || start.elapsed().as_nanos() as Time;
    let byte_time = BYTE_BITS * SECOND / Time::from(arguments.baud());
    let mut incoming: VecDeque<(Time, u8)> = VecDeque::new();
    let mut host_baud = arguments.baud();
    while !stop.load(Ordering::Relaxed) {
        if power.swap(false, Ordering::Relaxed) {
            emulator.power_cycle(clock());
        }
        let arrival = incoming.front().map(|&(at, _)| at);
        let next = arrival.into_iter().chain(emulator.next_deadline()).min();
        let wait = next.map_or(PATIENCE, |at| {
            Duration::from_nanos(at.saturating_sub(clock())).min(PATIENCE)
        });
        let mut received = line.receive(wait)?;
        host_baud = arguments.other_rate(&line, host_baud)?.unwrap_or(host_baud);
        if host_baud != arguments.baud() {
            // At another rate no request is one.
            received.clear();
        }
        if let Some(picture) = film.map(Film::take).transpose()?.flatten() {
            emulator.scene_mut().background = Background::Picture(picture);
        }
        let now = clock();
        for byte in received {
            let free_at = incoming.back().map_or(now, |&(at, _)| at.max(now));
            incoming.push_back((free_at + byte_time, byte));
        }
        while let Some((at, byte)) = incoming.pop_front_if(|(at, _)| *at <= now) {
            emulator.receive(byte, at);
        }
        let sent: Vec<u8> = std::iter::from_fn(|| emulator.transmit(now))
            .map(|(_, byte)| byte)
            .collect();
        line.send(&sent)?;
    }
    Ok(())
}
