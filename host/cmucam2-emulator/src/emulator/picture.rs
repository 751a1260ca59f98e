//! Pictures that the sensor sees.

use std::sync::Arc;

use super::{Emulator, Note, Time};
use crate::noise::mix;
use crate::{
    blob::Filter,
    colour::Colour,
    modes::register,
    scene::{Background, Extent, Patch, Scene, Shape},
    sensor::Sensor,
    view::{Layout, Snapshot, View},
};

/// Rows that a whole picture would have in high resolution, of which 255 are read.
const HIGH_RESOLUTION_ROWS: u16 = 286;
/// A register value that leaves the picture as it is.
const NEUTRAL: f64 = 128.0;
/// The mean of the scene is taken of so many places in each direction.
const METERING: u8 = 16;

impl Emulator {
    /// The sensor adapts to the light until now.
    pub(super) fn adapt(&mut self, now: Time) {
        let (gain, white) = (self.modes.auto_gain(), self.modes.auto_white_balance());
        let scene = &self.scene;
        let lit = self.modes.is_on(b"CP");
        self.light
            .adapt(now, gain && lit, white && lit, || mean(scene, now));
    }

    /// The frame at this time, or the one that buffer mode holds.
    pub(super) fn capture(&mut self, now: Time) -> Snapshot {
        if let (true, Some(held)) = (self.modes.is_on(b"BM"), &self.held) {
            return held.clone();
        }
        self.adapt(now);
        let seed = mix(self.configuration.seed ^ mix(now));
        let flicker = if self.faults.flicker.strikes() {
            self.note(|| Note::Fault("flicker"));
            if self.faults.flicker.pick(2) == 0 {
                0.5
            } else {
                1.5
            }
        } else {
            // The upper bits of the seed, as -1 to 1.
            let random = (seed >> 32) as f64 / f64::from(u32::MAX) * 2.0 - 1.0;
            1.0 + self.scene.flicker * random
        };
        let exposure = if self.modes.auto_gain() {
            1.0
        } else {
            f64::from(self.modes.register(register::EXPOSURE)) / NEUTRAL
        };
        let mut patches: Vec<Patch> = self.scene.patches(now as f64 * 1e-9).collect();
        self.turn(&mut patches);
        self.spoil(&mut patches);
        let light = self.scene.light;
        let adapted = self.light.factors();
        let background = match &self.scene.background {
            Background::Picture(picture) => {
                let [columns, rows] = self.layout().picture;
                Background::Picture(Arc::new(picture.scaled(columns, rows)))
            }
            drawn => drawn.clone(),
        };
        Snapshot {
            background,
            patches,
            factors: std::array::from_fn(|channel| {
                light[channel] * adapted[channel] * exposure * flicker
            }),
            contrast: f64::from(self.modes.register(register::CONTRAST)) / NEUTRAL,
            brightness: f64::from(self.modes.register(register::BRIGHTNESS)) - NEUTRAL,
            dark: !self.modes.is_on(b"CP"),
            seed,
        }
    }

    /// Pan and tilt carry the camera.
    fn turn(&self, patches: &mut [Patch]) {
        let step = self.scene.servo_step;
        if step == 0.0 {
            return;
        }
        let steps = |servo: usize| match self.modes.servos[servo] {
            // An output.
            0 | 1 => 0.0,
            position => f64::from(position) - 128.0,
        };
        for patch in patches {
            patch.extent = patch.extent.moved(-step * steps(0), step * steps(1));
        }
    }

    /// Blobs that are clipped or merged.
    fn spoil(&mut self, patches: &mut Vec<Patch>) {
        if patches.is_empty() {
            return;
        }
        if self.faults.clip.strikes() {
            self.note(|| Note::Fault("clip"));
            let victim = patches[self.faults.clip.pick(patches.len() as u64) as usize];
            let width = victim.extent.right - victim.extent.left;
            patches.push(Patch {
                shape: Shape::Box,
                colour: [16; 3],
                extent: Extent {
                    right: victim.extent.left + width * self.faults.clip.share(),
                    ..victim.extent
                },
            });
        }
        if self.faults.merge.strikes() {
            self.note(|| Note::Fault("merge"));
            let twin = patches[self.faults.merge.pick(patches.len() as u64) as usize];
            let width = twin.extent.right - twin.extent.left;
            let side = if self.faults.merge.pick(2) == 0 {
                1.0
            } else {
                -1.0
            };
            let away = width * (1.0 + self.faults.merge.share());
            patches.push(Patch {
                extent: twin.extent.moved(side * away, 0.0),
                ..twin
            });
        }
    }

    fn layout(&self) -> Layout {
        let modes = &self.modes;
        let switches = self.switches();
        let picture = match (modes.sensor, modes.is_on(b"HR")) {
            (Sensor::Ov6620, false) => [88, 143],
            (Sensor::Ov6620, true) => [176, HIGH_RESOLUTION_ROWS],
            (Sensor::Ov7620, _) => [160, 239],
        };
        Layout {
            picture,
            frame: modes.frame(switches),
            down_sampling: modes.down_sampling(),
            luminance_chrominance: modes.luminance_chrominance(),
            difference: modes.is_on(b"PD"),
        }
    }

    pub(super) fn view<'a>(&'a self, snapshot: &'a Snapshot) -> View<'a> {
        View::new(&self.scene, snapshot, self.layout())
    }

    pub(super) fn filter(&self) -> Filter {
        Filter {
            bounds: self.modes.bounds,
            invert: self.modes.is_on(b"TI"),
            run: self.modes.number(b"NF"),
            tail_only: self.switches().noise_run == 1,
        }
    }

    /// The picture as the camera would send it, row by row from the upper left corner: for tests
    /// and displays. It costs the camera nothing and changes nothing.
    pub fn picture(&self, now: Time) -> Vec<Vec<Colour>> {
        let mut onlooker = self.clone();
        onlooker.configuration.watched = false;
        let snapshot = onlooker.capture(now);
        let view = self.view(&snapshot);
        let region = self.modes.region(self.switches());
        (region.y1..=region.y2)
            .map(|y| {
                let mut row = Vec::new();
                view.row(y, region.x1, region.x2, &mut row);
                row
            })
            .collect()
    }
}

/// The mean colour of what is before the camera.
fn mean(scene: &Scene, now: Time) -> [f64; 3] {
    let patches: Vec<Patch> = scene.patches(now as f64 * 1e-9).collect();
    let mut sums = [0.0; 3];
    let place = |index: u8| (f64::from(index) + 0.5) / f64::from(METERING);
    for (x, y) in (0..METERING).flat_map(|y| (0..METERING).map(move |x| (x, y))) {
        let (x, y) = (place(x), place(y));
        let colour = patches
            .iter()
            .rev()
            .find(|patch| patch.covers(x, y))
            .map_or_else(
                || scene.background.colour(x, y),
                |patch| patch.colour.map(f64::from),
            );
        for (sum, (level, light)) in sums.iter_mut().zip(colour.into_iter().zip(scene.light)) {
            *sum += level * light;
        }
    }
    sums.map(|sum| sum / f64::from(METERING).powi(2))
}
