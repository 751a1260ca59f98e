//! Blobs as the firmware of the camera finds them.
//!
//! A row of a Pixy2 has 158 units of two columns, that of a Pixy 160. From left to right, the first core looks for two units in a row of one
//! signature, notes the second of them, leaves out the next two, and looks on. The second core makes segments of
//! the notes: from the unit before the first note to the one after the last one. So a row's last segment begins
//! where its colour does, those before it a unit later, and all end by up to three units too early.
//!
//! Segments that touch from row to row are a blob. Its box reaches from the first to the last of their
//! numbers and rows. Blobs of less than 20 units, or of two rows or less, are dropped; boxes of one
//! signature that are near one another become one.
//!
//! An OpenMV Cam looks at every pixel of 320 x 240. Blobs of less than 20 pixels are dropped, as of its script when that
//! is set for small objects; blobs of one signature whose boxes are near become one.

use std::array;

use cmucam2_emulator::{Background, Patch, Rgb, Scene, Shape};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{Model, SIGNATURES, Time};

/// Largest difference of chromaticities from the taught colour: differences of two channels as shares of the sum
/// of all.
pub const TOLERANCE: f64 = 0.1;

/// Columns and rows of units, columns of a unit, and true if all of them are looked at.
#[derive(Clone, Copy, Debug)]
struct Raster {
    units: usize,
    rows: usize,
    unit: u16,
    is_exact: bool,
}

impl Raster {
    const fn of(model: Model) -> Self {
        let [columns, rows] = model.size();
        let is_exact = matches!(model, Model::OpenMv | Model::OpenMvTags);
        let unit = if is_exact { 1 } else { 2 };
        Self {
            units: (columns / unit) as usize,
            rows: rows as usize,
            unit,
            is_exact,
        }
    }
}

/// Units that are left out after a note.
const LEFT_OUT: usize = 2;
/// Notes farther apart are of two segments.
const GAP: usize = 5;
/// A darker sum of all channels has no colour.
const DARK: f64 = 45.0;
const LEAST_AREA: usize = 20;
/// Of an OpenMV Cam, pixels.
const LEAST_PIXELS: usize = 20;
/// Columns and rows of the smallest tag that is found.
const LEAST_TAG: f64 = 10.0;
const LEAST_ROWS: usize = 2;
/// Boxes nearer than that become one.
const MERGED: u16 = 7;
/// The same of an OpenMV Cam.
const MARGIN: u16 = 5;

/// A blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// Its signature, from 1.
    pub signature: u8,
    /// First column and row, and those where it is told to end.
    pub edges: [u16; 4],
    /// Sum of the columns and of the rows of its pixels, and their number.
    mass: [u64; 3],
}

impl Found {
    fn area(&self) -> u32 {
        let [left, top, right, bottom] = self.edges.map(u32::from);
        (right - left) * (bottom - top)
    }

    /// Columns and rows, as a Pixy tells them.
    pub fn size(&self) -> [u16; 2] {
        let [left, top, right, bottom] = self.edges;
        [right - left, bottom - top]
    }

    /// The middle of its box, as a Pixy tells it.
    pub fn middle(&self) -> [u16; 2] {
        let ([left, top, ..], [width, height]) = (self.edges, self.size());
        [left + width / 2, top + height / 2]
    }

    /// Columns and rows, both ends inside.
    pub fn box_size(&self) -> [u16; 2] {
        self.size().map(|length| length + 1)
    }

    /// The middle of its mass, rounded.
    pub fn centroid(&self) -> [u16; 2] {
        let [x, y, count] = self.mass;
        [x, y].map(|sum| ((2 * sum + count) / (2 * count).max(1)) as u16)
    }
}

/// Red less green, and blue less green, as shares of the sum.
fn chromaticity([red, green, blue]: [f64; 3]) -> Option<[f64; 2]> {
    let sum = red + green + blue;
    (sum >= DARK).then(|| [(red - green) / sum, (blue - green) / sum])
}

/// Taught colours, and adaptation to the light.
#[derive(Clone, Debug)]
pub(crate) struct Sight {
    raster: Raster,
    signatures: Vec<[f64; 2]>,
    /// Light in which it started, each channel as a multiple of the mean.
    white: Option<[f64; 3]>,
    random: ChaCha8Rng,
}

impl Sight {
    pub(crate) fn new(model: Model, taught: &[Rgb], seed: u64) -> Self {
        let colours = taught.iter().take(SIGNATURES);
        let none = [f64::NAN; 2];
        let signature = |colour: &Rgb| chromaticity(colour.map(f64::from)).unwrap_or(none);
        Self {
            raster: Raster::of(model),
            signatures: colours.map(signature).collect(),
            white: None,
            random: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// The signature of a colour, from 1.
    fn signature(&self, colour: [f64; 3]) -> Option<u8> {
        let [u, v] = chromaticity(colour)?;
        let is_it = |[a, b]: &[f64; 2]| (u - a).abs() < TOLERANCE && (v - b).abs() < TOLERANCE;
        let place = self.signatures.iter().position(is_it)?;
        Some(place as u8 + 1)
    }

    /// Looks at a scene: its blobs, the largest first. Those of an original Pixy are to be told in turn of their
    /// signatures.
    pub(crate) fn look(&mut self, scene: &Scene, at: Time, frame: u64) -> Vec<Found> {
        let Raster { units, rows, .. } = self.raster;
        // Exposure follows the light, white balance does not.
        let mean = scene.light.iter().sum::<f64>() / 3.0;
        let light = scene.light.map(|channel| channel / mean.max(1e-9));
        let white = *self.white.get_or_insert(light);
        let tint: [f64; 3] = array::from_fn(|n| light[n] / white[n].max(1e-9));
        self.random.set_stream(frame);
        self.random.set_word_pos(0);
        let patches: Vec<_> = scene.patches(at as f64 * 1e-9).collect();
        let sees_all = !matches!(scene.background, Background::Plain(_))
            || self
                .signature(tinted(scene.background.colour(0.5, 0.5), tint))
                .is_some();
        let mut segments = Vec::new();
        let mut row_of = vec![0_u8; units];
        for row in 0..rows {
            let y = (row as f64 + 0.5) / rows as f64;
            let near = patches.iter().filter(|patch| {
                let extent = patch.extent;
                extent.top <= y && y < extent.bottom
            });
            let bounds = near.fold([1.0_f64, 0.0_f64], |[from, to], patch| {
                [from.min(patch.extent.left), to.max(patch.extent.right)]
            });
            let [from, to] = if sees_all { [0.0, 1.0] } else { bounds };
            if from >= to {
                continue;
            }
            row_of.fill(0);
            for (unit, signature) in row_of.iter_mut().enumerate() {
                let x = (unit as f64 + 0.5) / units as f64;
                if x < from || x >= to {
                    continue;
                }
                let patch = patches.iter().rev().find(|patch| patch.covers(x, y));
                let colour = patch.map_or_else(
                    || scene.background.colour(x, y),
                    |patch| patch.colour.map(f64::from),
                );
                let mut colour = tinted(colour, tint);
                if scene.noise > 0.0 {
                    // Nearly normal: the sum of three even ones has their standard deviation.
                    for level in &mut colour {
                        let even = || self.random.random_range(-1.0..1.0);
                        let noise: f64 = std::iter::repeat_with(even).take(3).sum();
                        *level = (*level + scene.noise * noise).clamp(0.0, 255.0);
                    }
                }
                *signature = self.signature(colour).unwrap_or(0);
            }
            if self.raster.is_exact {
                runs(&row_of, row, &mut segments);
            } else {
                segment(&row_of, row, &mut segments);
            }
        }
        let mut blobs = connected(&segments, self.raster);
        blobs.sort_by_key(|found| std::cmp::Reverse(found.area()));
        blobs
    }
}

/// Tags that are found: number, middle and size, rounded; the largest first.
pub(crate) fn tags(scene: &Scene, at: Time, size: [u16; 2]) -> Vec<[u16; 5]> {
    let [columns, rows] = size.map(f64::from);
    let patches: Vec<Patch> = scene.patches(at as f64 * 1e-9).collect();
    let mut found = Vec::new();
    for (place, patch) in patches.iter().enumerate() {
        let Shape::Tag(number) = patch.shape else {
            continue;
        };
        let e = patch.extent;
        let [width, height] = [(e.right - e.left) * columns, (e.bottom - e.top) * rows];
        let is_whole = e.left >= 0.0 && e.top >= 0.0 && e.right <= 1.0 && e.bottom <= 1.0;
        let is_hidden = patches[place + 1..].iter().any(|nearer| {
            let o = nearer.extent;
            o.left < e.right && e.left < o.right && o.top < e.bottom && e.top < o.bottom
        });
        if is_whole && !is_hidden && width.min(height) >= LEAST_TAG {
            let x = f64::midpoint(e.left, e.right) * columns - 0.5;
            let y = f64::midpoint(e.top, e.bottom) * rows - 0.5;
            let [x, y, width, height] = [x, y, width, height].map(|n| n.round() as u16);
            found.push([number, x, y, width, height]);
        }
    }
    found.sort_by_key(|[.., width, height]| {
        std::cmp::Reverse(u32::from(*width) * u32::from(*height))
    });
    found
}

/// The segments of a row in which every unit is looked at.
fn runs(units: &[u8], row: usize, segments: &mut Vec<Segment>) {
    let mut from = 0;
    for run in units.chunk_by(|a, b| a == b) {
        let to = from + run.len() - 1;
        if run[0] > 0 {
            segments.push(Segment {
                signature: run[0],
                row,
                from,
                to,
            });
        }
        from = to + 1;
    }
}

fn tinted(colour: [f64; 3], tint: [f64; 3]) -> [f64; 3] {
    array::from_fn(|n| (colour[n] * tint[n]).clamp(0.0, 255.0))
}

/// A part of a row, in units: its number where it begins, and the one where it is told to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Segment {
    signature: u8,
    row: usize,
    from: usize,
    to: usize,
}

/// The segments of a row of signatures, 0 for none.
fn segment(units: &[u8], row: usize, segments: &mut Vec<Segment>) {
    let mut under_way: Option<Segment> = None;
    let mut unit = 0;
    while unit + 1 < units.len() {
        let signature = units[unit];
        if signature == 0 {
            unit += 1;
            continue;
        }
        // The second one was looked at in any case.
        let note = unit + 1;
        unit += 2;
        if units[note] != signature {
            continue;
        }
        unit += LEFT_OUT;
        match &mut under_way {
            Some(last) if last.signature == signature && note <= last.to + GAP => {
                last.to = note + 1;
            }
            last => {
                segments.extend(last.take().map(|done| Segment {
                    from: done.from + 1,
                    ..done
                }));
                *last = Some(Segment {
                    signature,
                    row,
                    from: note - 1,
                    to: note + 1,
                });
            }
        }
    }
    segments.extend(under_way);
}

/// Blobs of segments, which are in the order of their rows.
fn connected(segments: &[Segment], raster: Raster) -> Vec<Found> {
    // The blob of each segment: the first segment of it.
    let mut first: Vec<usize> = (0..segments.len()).collect();
    fn root(first: &[usize], mut at: usize) -> usize {
        while first[at] != at {
            at = first[at];
        }
        at
    }
    for (n, lower) in segments.iter().enumerate() {
        let above = segments[..n].iter().enumerate().rev();
        let near = above.take_while(|(_, upper)| upper.row + 1 >= lower.row);
        for (m, upper) in near {
            let touch = upper.row < lower.row
                && upper.signature == lower.signature
                && upper.from <= lower.to
                && lower.from <= upper.to;
            if touch {
                let (a, b) = (root(&first, m), root(&first, n));
                first[a.max(b)] = a.min(b);
            }
        }
    }
    let mut blobs: Vec<Found> = Vec::new();
    for start in (0..segments.len()).filter(|&n| first[n] == n) {
        let members = || {
            let all = segments.iter().enumerate();
            let own = all.filter(|(n, _)| root(&first, *n) == start);
            own.map(|(_, segment)| segment)
        };
        let area: usize = members().map(|part| part.to - part.from + 1).sum();
        let most = |of: fn(&Segment) -> usize| members().map(of).max().unwrap_or(0) as u16;
        let top = segments[start].row as u16;
        let bottom = most(|part| part.row);
        let is_small = if raster.is_exact {
            area < LEAST_PIXELS
        } else {
            area < LEAST_AREA || usize::from(bottom - top) < LEAST_ROWS
        };
        if is_small {
            continue;
        }
        let mass = members().fold([0; 3], |[x, y, count], part| {
            let n = (part.to - part.from + 1) as u64;
            let columns = (part.from + part.to) as u64 * n / 2;
            [x + columns, y + part.row as u64 * n, count + n]
        });
        let left = members().map(|part| part.from).min().unwrap_or(0) as u16;
        blobs.push(Found {
            signature: segments[start].signature,
            edges: [
                left * raster.unit,
                top,
                most(|part| part.to) * raster.unit,
                bottom,
            ],
            mass,
        });
    }
    let margin = if raster.is_exact { MARGIN } else { MERGED };
    while merge(&mut blobs, margin) {}
    blobs
}

/// Makes one of two boxes of a signature that are near one another.
fn merge(blobs: &mut Vec<Found>, margin: u16) -> bool {
    for a in 0..blobs.len() {
        for b in a + 1..blobs.len() {
            let ([left, top, right, bottom], other) = (blobs[a].edges, blobs[b].edges);
            let near = left <= other[2] + margin
                && other[0] <= right + margin
                && top <= other[3] + margin
                && other[1] <= bottom + margin
                && blobs[a].signature == blobs[b].signature;
            if near {
                blobs[a].edges = [
                    left.min(other[0]),
                    top.min(other[1]),
                    right.max(other[2]),
                    bottom.max(other[3]),
                ];
                let mass = blobs.remove(b).mass;
                let merged = blobs[a].mass.iter_mut().zip(mass);
                merged.for_each(|(sum, more)| *sum += more);
                return true;
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXY2: Raster = Raster::of(Model::Pixy2);

    /// Begins and ends that are told for segments of so many units of one colour, from unit 10 on.
    fn told(count: usize) -> Vec<[usize; 2]> {
        let mut units = vec![0; 158];
        units[10..10 + count].fill(1);
        let mut segments = Vec::new();
        segment(&units, 0, &mut segments);
        segments.iter().map(|part| [part.from, part.to]).collect()
    }

    #[test]
    fn a_segment_ends_up_to_three_units_early() {
        assert!(told(1).is_empty());
        for (count, end) in [
            (2, 12),
            (3, 12),
            (4, 12),
            (5, 12),
            (6, 16),
            (7, 16),
            (10, 20),
        ] {
            assert_eq!(told(count), [[10, end]], "{count}");
        }
    }

    #[test]
    fn a_hole_of_some_units_is_bridged() {
        let row = |hole: usize| {
            let mut units = vec![1; 158];
            units[40..40 + hole].fill(0);
            let mut segments = Vec::new();
            segment(&units, 0, &mut segments);
            segments.len()
        };
        assert_eq!((row(0), row(2), row(3)), (1, 1, 2));
    }

    #[test]
    fn what_touches_is_one_and_what_is_small_is_none() {
        let bar = |from, to, rows: std::ops::Range<usize>| {
            rows.map(move |row| Segment {
                signature: 1,
                row,
                from,
                to,
            })
        };
        // A U: two bars that a lower one connects.
        let mut u: Vec<_> = bar(10, 20, 0..20).chain(bar(60, 70, 0..20)).collect();
        assert_eq!(connected(&sorted(&u), PIXY2).len(), 2);
        u.extend(bar(10, 70, 20..23));
        let one = [20, 0, 140, 22];
        assert_eq!(connected(&sorted(&u), PIXY2)[0].edges, one);
        let speck: Vec<_> = bar(10, 13, 0..4).collect();
        assert!(connected(&speck, PIXY2).is_empty());
    }

    fn sorted(segments: &[Segment]) -> Vec<Segment> {
        let mut sorted = segments.to_vec();
        sorted.sort_by_key(|part| (part.row, part.from));
        sorted
    }
}
