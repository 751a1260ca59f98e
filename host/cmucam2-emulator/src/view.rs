//! One frame, of which only those pixels are computed that are asked for.

use super::{
    blob::Filter,
    colour::{Bounds, Colour, LEVEL_MAX, LEVEL_MIN},
    scene::{Background, Patch, Scene},
    sensor::Size,
    tracked::Verdict,
};
use crate::noise::mix;

/// Columns and rows of the frame, from 0, both ends inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub x1: u8,
    /// First row.
    pub y1: u8,
    /// Last column.
    pub x2: u8,
    /// Last row.
    pub y2: u8,
}

impl Region {
    /// Number of columns.
    pub fn width(self) -> u8 {
        self.x2 - self.x1 + 1
    }

    /// Number of rows.
    pub fn height(self) -> u8 {
        self.y2 - self.y1 + 1
    }

    /// The part of half the width and half the height in the middle.
    pub(super) fn middle(self) -> Self {
        let (across, down) = (self.width() / 4, self.height() / 4);
        Self {
            x1: self.x1 + across,
            y1: self.y1 + down,
            x2: self.x2 - across,
            y2: self.y2 - down,
        }
    }
}

/// A moment as the sensor saw it. Pixels are computed from it when they are needed, always to the same values.
#[derive(Clone, Debug, Default)]
pub(super) struct Snapshot {
    /// Behind all patches; a picture with as many columns and rows as the sensor's.
    pub(super) background: Background,
    /// From back to front.
    pub(super) patches: Vec<Patch>,
    /// Factor by which each channel is multiplied.
    pub(super) factors: [f64; 3],
    /// Contrast about the middle, then brightness.
    pub(super) contrast: f64,
    pub(super) brightness: f64,
    /// The sensor is switched off.
    pub(super) dark: bool,
    /// Seed of the noise.
    pub(super) seed: u64,
}

/// Layout and processing of the pixels of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    /// Columns and rows that the whole picture would have, of which a frame may lack some.
    pub(super) picture: [u16; 2],
    /// The frame after down-sampling.
    pub(super) frame: Size,
    pub(super) down_sampling: [u8; 2],
    /// Cr, Y and Cb instead of red, green and blue.
    pub(super) luminance_chrominance: bool,
    /// Differences to the pixel on the left instead of levels.
    pub(super) difference: bool,
}

/// A colour in 1/256 levels, before noise.
type Paint = [i32; 3];

/// The snapshot of a scene, ready to be looked at.
#[derive(Debug)]
pub(super) struct View<'a> {
    background: &'a Background,
    snapshot: &'a Snapshot,
    layout: Layout,
    paints: Vec<Paint>,
    /// In 1/32 levels.
    noise: i32,
}

/// The sum of three numbers of seven bits: nearly normal.
const NOISE_BITS: u32 = 7;
const NOISE_MIDDLE: i32 = 3 * 127;

impl<'a> View<'a> {
    pub(super) fn new(scene: &'a Scene, snapshot: &'a Snapshot, layout: Layout) -> Self {
        let mut view = Self {
            background: &snapshot.background,
            snapshot,
            layout,
            paints: Vec::with_capacity(snapshot.patches.len()),
            noise: (scene.noise * 32.0).round() as i32,
        };
        for patch in &snapshot.patches {
            let paint = view.paint(patch.colour.map(f64::from));
            view.paints.push(paint);
        }
        view
    }

    pub(super) fn frame(&self) -> Size {
        self.layout.frame
    }

    fn paint(&self, colour: [f64; 3]) -> Paint {
        let Snapshot {
            factors,
            contrast,
            brightness,
            dark,
            ..
        } = self.snapshot;
        std::array::from_fn(|channel| {
            if *dark {
                return 0;
            }
            let level = (colour[channel] * factors[channel] - 128.0) * contrast + 128.0;
            ((level + brightness) * 256.0).round() as i32
        })
    }

    /// The middle of a pixel, in fractions of the picture.
    fn place(&self, index: u8, axis: usize) -> f64 {
        let sensor = u16::from(index) * u16::from(self.layout.down_sampling[axis]);
        (f64::from(sensor) + 0.5) / f64::from(self.layout.picture[axis])
    }

    /// The levels of columns `from..=to` of a row.
    pub(super) fn row(&self, y: u8, from: u8, to: u8, out: &mut Vec<Colour>) {
        out.clear();
        let down = self.place(y, 1);
        let row_seed = mix(self.snapshot.seed ^ u64::from(y) << 48);
        // Along most rows the background is the same.
        let backdrop = (!self.background.varies_along_rows())
            .then(|| self.paint(self.background.colour(0.5, down)));
        let pixel = |x: u8| {
            let across = self.place(x, 0);
            let paint = self
                .snapshot
                .patches
                .iter()
                .zip(&self.paints)
                .rev()
                .find(|(patch, _)| patch.covers(across, down))
                .map(|(_, &paint)| paint)
                .or(backdrop)
                .unwrap_or_else(|| self.paint(self.background.colour(across, down)));
            self.processed(self.with_noise(paint, row_seed ^ u64::from(x) << 24))
        };
        if !self.layout.difference {
            out.extend((from..=to).map(pixel));
            return;
        }
        let mut left = pixel(from.saturating_sub(1));
        out.extend((from..=to).map(|x| {
            let here = pixel(x);
            let difference = difference(here, left);
            left = here;
            difference
        }));
    }

    fn processed(&self, levels: Colour) -> Colour {
        if self.layout.luminance_chrominance {
            luminance_chrominance(levels)
        } else {
            levels
        }
    }

    fn with_noise(&self, paint: Paint, seed: u64) -> Colour {
        let random = if self.noise == 0 { 0 } else { mix(seed) };
        let level = |channel: usize| {
            let noise = if self.noise == 0 {
                0
            } else {
                let mask = (1_u64 << NOISE_BITS) - 1;
                let sum: u64 = (0..3)
                    .map(|part| random >> (NOISE_BITS * (3 * channel as u32 + part)) & mask)
                    .sum();
                ((2 * sum as i32 - NOISE_MIDDLE) * self.noise) >> 4
            };
            clamped(paint[channel] + noise)
        };
        Colour {
            red: level(0),
            green: level(1),
            blue: level(2),
        }
    }

    fn verdict(&self, paint: Paint, filter: &Filter) -> Verdict {
        let bounds = filter.bounds;
        let verdict = if self.layout.difference {
            Verdict::Perhaps
        } else if self.noise == 0 {
            Verdict::sure(bounds.contains(self.processed(self.with_noise(paint, 0))))
        } else if self.layout.luminance_chrominance {
            Verdict::Perhaps
        } else {
            self.despite_noise(paint, bounds)
        };
        if filter.invert {
            verdict.inverted()
        } else {
            verdict
        }
    }

    fn despite_noise(&self, paint: Paint, bounds: Bounds) -> Verdict {
        let most = ((NOISE_MIDDLE * self.noise) >> 4) + 1;
        let mut verdict = Verdict::Always;
        for ((lower, upper), level) in bounds.ranges().into_iter().zip(paint) {
            let (least, greatest) = (clamped(level - most), clamped(level + most));
            if greatest < lower || upper < least {
                return Verdict::Never;
            }
            if least < lower || upper < greatest {
                verdict = Verdict::Perhaps;
            }
        }
        verdict
    }

    /// Verdicts on the patches, from back to front.
    pub(super) fn verdicts(&self, filter: &Filter) -> impl Iterator<Item = Verdict> {
        self.paints.iter().map(|&paint| self.verdict(paint, filter))
    }

    /// Verdict on the background, if it is the same in all rows.
    pub(super) fn backdrop_verdict(&self, filter: &Filter) -> Option<Verdict> {
        match self.background {
            Background::Plain(colour) => {
                Some(self.verdict(self.paint(colour.map(f64::from)), filter))
            }
            Background::Gradient { .. } => None,
            Background::Blocks { .. } | Background::Picture(_) => Some(Verdict::Perhaps),
        }
    }

    /// Verdict on the background in a row, if it is the same in all columns.
    pub(super) fn row_verdict(&self, y: u8, filter: &Filter) -> Verdict {
        let colour = self.background.colour(0.5, self.place(y, 1));
        self.verdict(self.paint(colour), filter)
    }

    /// The index of the pixel whose middle is at a place of the picture.
    fn index(&self, place: f64, axis: usize) -> f64 {
        let step = f64::from(self.layout.down_sampling[axis]);
        (place * f64::from(self.layout.picture[axis]) - 0.5) / step
    }

    /// Rows outside of which there are none of the chosen patches.
    pub(super) fn rows_of(&self, chosen: impl Iterator<Item = bool>) -> (u8, u8) {
        let patches = self.snapshot.patches.iter().zip(chosen);
        let mut rows = (u8::MAX, 0);
        for (Patch { extent, .. }, _) in patches.filter(|(_, chosen)| *chosen) {
            // Saturating casts, and one row more for the rounding.
            let first = (self.index(extent.top, 1) as u8).saturating_sub(1);
            let last = (self.index(extent.bottom, 1) as u8).saturating_add(1);
            rows = (rows.0.min(first), rows.1.max(last));
        }
        rows
    }

    /// The columns that a patch covers in a row, both ends inside and within `from..=to`.
    pub(super) fn columns(&self, patch: usize, y: u8, from: u8, to: u8) -> Option<(u8, u8)> {
        let patch = self.snapshot.patches.get(patch)?;
        let down = self.place(y, 1);
        let [left, right] = patch.span(down)?;
        let [left, right] = [left, right].map(|edge| self.index(edge, 0));
        if is_between_pixels(left) && is_between_pixels(right) {
            let first = (left.ceil() as i32).max(from.into());
            let last = (right.floor() as i32).min(to.into());
            return (first <= last).then_some((first as u8, last as u8));
        }
        // Saturating casts, and one column more for the rounding.
        let first = (left as u8).saturating_sub(1).max(from);
        let last = (right as u8).saturating_add(1).min(to);
        let covers = |x: &u8| patch.covers(self.place(*x, 0), down);
        let first = (first..=last).find(covers)?;
        let last = (first..=last).rev().find(covers)?;
        Some((first, last))
    }
}

/// Returns true if an edge is farther from the middles of all pixels than its error can be: where a disc ends
/// above or below, the root of a rounding error of 1e-16.
fn is_between_pixels(edge: f64) -> bool {
    (edge - edge.round()).abs() > 1e-4
}

fn clamped(paint: i32) -> u8 {
    ((paint + 128) >> 8).clamp(i32::from(LEVEL_MIN), i32::from(LEVEL_MAX)) as u8
}

/// Cr, Y and Cb in the places of red, green and blue (ITU-R BT.601).
fn luminance_chrominance(colour: Colour) -> Colour {
    let [red, green, blue] = [colour.red, colour.green, colour.blue].map(f64::from);
    let luminance = 0.299 * red + 0.587 * green + 0.114 * blue;
    let level = |value: f64| {
        value
            .round()
            .clamp(f64::from(LEVEL_MIN), f64::from(LEVEL_MAX)) as u8
    };
    Colour {
        red: level(0.713 * (red - luminance) + 128.0),
        green: level(luminance),
        blue: level(0.564 * (blue - luminance) + 128.0),
    }
}

/// Difference of two pixels, from the lowest level on.
fn difference(here: Colour, left: Colour) -> Colour {
    let level = |a: u8, b: u8| (LEVEL_MIN + a.abs_diff(b)).min(LEVEL_MAX);
    Colour {
        red: level(here.red, left.red),
        green: level(here.green, left.green),
        blue: level(here.blue, left.blue),
    }
}
