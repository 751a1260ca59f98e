//! A terminal and a driver at the emulated camera.

use cmucam2_driver::{
    colour::ColourBounds,
    command::Command,
    packet::{Packet, Tracking},
    session::{Answer, Fault, Policy, Request},
};
use cmucam2_emulator::{Background, Configuration, Emulator, Extent, Scene, Shape};
use cmucam2_pair::Link;

pub(crate) const SECOND: u64 = 1_000_000_000;
pub(crate) const MILLISECOND: u64 = 1_000_000;

/// The orange of every target here, and bounds that hold it and nothing else.
pub(crate) const ORANGE: [u8; 3] = [210, 105, 40];

pub(crate) fn orange() -> ColourBounds {
    ColourBounds::new([170, 240, 60, 150, 16, 90]).unwrap()
}

/// The bounds as a command takes them.
pub(crate) const ORANGE_TC: &str = "TC 170 240 60 150 16 90\r";

/// An orange box over these columns and rows, counted from 0, both ends inside, before a wall.
pub(crate) fn orange_box(columns: [u8; 2], rows: [u8; 2]) -> Scene {
    let extent = Extent::of_pixels(columns.map(f64::from), rows.map(f64::from), 88.0, 143.0);
    Scene {
        background: Background::Plain([100, 100, 100]),
        ..Scene::with_object(ORANGE, Shape::Box, extent)
    }
}

/// The usual camera but for this.
pub(crate) fn with(change: impl FnOnce(&mut Configuration)) -> Configuration {
    let mut configuration = Configuration::default();
    change(&mut configuration);
    configuration
}

/// A terminal that types and reads.
pub(crate) struct Terminal {
    pub(crate) camera: Emulator,
    pub(crate) now: u64,
}

impl Terminal {
    /// At a camera that has started.
    pub(crate) fn new(configuration: Configuration, scene: Scene) -> Self {
        let mut terminal = Self {
            camera: Emulator::new(configuration, scene),
            now: 0,
        };
        terminal.read(SECOND);
        terminal
    }

    /// Bytes that come within this time.
    pub(crate) fn read(&mut self, time: u64) -> Vec<u8> {
        self.now += time;
        std::iter::from_fn(|| self.camera.transmit(self.now))
            .map(|(_, byte)| byte)
            .collect()
    }

    /// Types, and reads for a tenth of a second.
    pub(crate) fn bytes(&mut self, text: &str) -> Vec<u8> {
        for byte in text.bytes() {
            self.now += MILLISECOND / 10;
            self.camera.receive(byte, self.now);
        }
        self.read(SECOND / 10)
    }

    /// The same as text.
    pub(crate) fn types(&mut self, text: &str) -> String {
        String::from_utf8(self.bytes(text)).unwrap()
    }

    /// Stops the exposure from drifting.
    pub(crate) fn freeze(&mut self) {
        assert_eq!(self.types("CR 18 40 19 32\r"), "ACK\r:");
    }
}

/// The driver at a camera that started before.
pub(crate) fn driver(configuration: Configuration, scene: Scene) -> Link {
    driver_with(configuration, scene, Policy::default())
}

pub(crate) fn driver_with(configuration: Configuration, scene: Scene, policy: Policy) -> Link {
    let baud = configuration.host_baud;
    let mut link = Link::new(Emulator::new(configuration, scene), policy, baud);
    link.pass(SECOND + SECOND / 2);
    while link.camera.transmit(link.now()).is_some() {}
    link
}

pub(crate) fn command(link: &mut Link, command: Command) -> Result<Answer, Fault> {
    link.ask(Request::Do(command.into()))
}

pub(crate) fn tracking(answer: Result<Answer, Fault>) -> Tracking {
    match answer {
        Ok(Answer::Packet(Packet::Tracking(tracking))) => tracking,
        other => panic!("{other:?}"),
    }
}
