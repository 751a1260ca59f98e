//! One frame, of which only those pixels are computed that are asked for.

use cmucam2_driver::{
    colour::{Colour, ColourBounds, LEVEL_MAX, LEVEL_MIN},
    geometry::Size,
};

use super::scene::{Background, Patch, Scene};

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
    /// How many columns.
    pub fn width(self) -> u8 {
        self.x2 - self.x1 + 1
    }

    /// How many rows.
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

/// What the sensor saw at one moment. Pixels are computed from it when they are needed, always to
/// the same values.
#[derive(Clone, Debug, Default)]
pub(super) struct Snapshot {
    /// From back to front.
    pub(super) patches: Vec<Patch>,
    /// What each channel is multiplied by.
    pub(super) factors: [f64; 3],
    /// Contrast about the middle, then brightness.
    pub(super) contrast: f64,
    pub(super) brightness: f64,
    /// The sensor is switched off.
    pub(super) dark: bool,
    /// Of the noise.
    pub(super) seed: u64,
}

/// How the pixels of a frame are laid out and processed.
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
            background: &scene.background,
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
            let levels = self.with_noise(paint, row_seed ^ u64::from(x) << 24);
            if self.layout.luminance_chrominance {
                luminance_chrominance(levels)
            } else {
                levels
            }
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

    /// Whether a pixel of this paint could be within bounds.
    fn may_be(&self, paint: Paint, bounds: ColourBounds) -> bool {
        let most = ((NOISE_MIDDLE * self.noise) >> 4) + 1;
        [bounds.red, bounds.green, bounds.blue]
            .into_iter()
            .zip(paint)
            .all(|(range, level)| {
                clamped(level - most) <= range.max() && range.min() <= clamped(level + most)
            })
    }

    /// The columns of a row outside of which no pixel is within bounds, both ends inside. Wider
    /// than needed at times, never too narrow.
    pub(super) fn candidates(
        &self,
        y: u8,
        from: u8,
        to: u8,
        bounds: ColourBounds,
    ) -> Option<(u8, u8)> {
        if self.layout.luminance_chrominance || self.layout.difference {
            return Some((from, to));
        }
        let down = self.place(y, 1);
        let backdrop_counts = self.background.varies_along_rows()
            || self.may_be(self.paint(self.background.colour(0.5, down)), bounds);
        if backdrop_counts {
            return Some((from, to));
        }
        let columns = f64::from(self.layout.picture[0]);
        let step = f64::from(self.layout.down_sampling[0]);
        let mut span: Option<(u8, u8)> = None;
        for (patch, &paint) in self.snapshot.patches.iter().zip(&self.paints) {
            let extent = patch.extent;
            if down < extent.top || down >= extent.bottom || !self.may_be(paint, bounds) {
                continue;
            }
            // Saturating casts: what lies outside of the frame is cut.
            let first = ((extent.left * columns / step) as u8)
                .saturating_sub(1)
                .max(from);
            let last = ((extent.right * columns / step) as u8)
                .saturating_add(1)
                .min(to);
            if first <= last {
                span = Some(match span {
                    None => (first, last),
                    Some((a, b)) => (a.min(first), b.max(last)),
                });
            }
        }
        span
    }
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

/// How much two pixels differ, from the lowest level on.
fn difference(here: Colour, left: Colour) -> Colour {
    let level = |a: u8, b: u8| (LEVEL_MIN + a.abs_diff(b)).min(LEVEL_MAX);
    Colour {
        red: level(here.red, left.red),
        green: level(here.green, left.green),
        blue: level(here.blue, left.blue),
    }
}

/// A bijection of 64 bits without visible order (the finaliser of `SplitMix64`).
pub(super) fn mix(value: u64) -> u64 {
    let value = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let value = (value ^ value >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let value = (value ^ value >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    value ^ value >> 31
}
