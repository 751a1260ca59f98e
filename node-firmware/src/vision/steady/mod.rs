//! When a blob stands still, where its edges are, and how sure that is.
//!
//! # Direction
//! The direction is the mean of the *angles* of the left and the right edge. A ball of angular
//! radius `a` at bearing `b` has its edges at `b + a` and `b - a` wherever it is, while in a
//! pin-hole's picture its middle of mass and the middle of its box lie further out than its centre.
//! Two edges also halve the step in which the direction is known: to half a column.
//!
//! The sum of four variances: rounding of both edges to whole columns, `1/12` each, so `1/24` for their mean
//! (0.204 columns), which a blob that stands still does not average out; the scatter of the median over the
//! frames, `pi / 2n` times that of one frame; the doubt by the shape (below); and a floor for errors that no
//! frame shows, such as those of the lens.
//!
//! # Shape
//! Two things tell that a target is partly hidden, or joined by something else of its colour. They
//! widen the sigma, or refuse the blob:
//! - Its middle of mass is off the middle of its box. A disc that is cut by a vertical edge has it off by
//!   0.08 of its remaining width. Then the direction is wrong by about 3 times (a quarter of the diameter
//!   hidden) to 7 times (half of it) as much. The CMUcam2 tells the middle of mass in whole columns, cut or
//!   rounded, so only the excess over that counts: this finds large blobs, and two that are taken for one.
//! - A [round](Shape::Round) target is narrower than tall. The direction is wrong by half of the missing
//!   width. The last sliver of a hidden target looks like a small one.
//! - It is wider than tall: it may be two, and the direction is wrong by up to half of what it has too much. A
//!   pin-hole's picture of a ball is wider than tall far from the axis, and that is taken into account.
//! - Its pixels fill little of its box: something else has its colour, or it has only a part of it.

use core::fmt;

use calib_core::{Real, camera::Camera, level::Elevation};
use heapless::{Deque, Vec};
use nalgebra::ComplexField;

use super::Blob;
use crate::{arithmetic::sort, message::Seen};

/// Frames that may be without a usable blob: one in this many.
const UNUSABLE: usize = 10;

/// Most distance between the middles of most frames, units.
const SPREAD: f32 = 2.0;

/// Variance of the mean of two edges that are rounded to whole units.
const ROUNDING: f32 = 1.0 / 24.0;

/// The middle of mass may lie so far to the left of its number, as against the middle of the box,
/// without any doubt, units: half for rounding, half for the pixels of the outline.
const CENTROID_LEFT: f32 = 1.0;

/// The same to the right: 1 for numbers that are cut, half for the pixels of the outline.
const CENTROID_RIGHT: f32 = 1.5;

/// Units that a round target's box may be narrower than tall for its pixels: one in its width, half
/// in its height.
const NARROW: f32 = 1.5;

/// Units that it may be wider than tall: of single colours, cameras tell less often than of light, so that those of
/// a picture run sideways.
const WIDE: f32 = 2.5;

/// Share of its width that a round target may lack, or have too much.
const HIDDEN: f32 = 0.2;

/// Least share of its box that a round target fills, 256 times the share. A ball fills 201.
const SPARSE: u8 = 128;

/// The same of a target of any shape.
const SPARSE_ANY: u8 = 50;

/// Units of width below which the pixels of a target's outline decide how much of its box it fills.
const SMALL: f32 = 5.0;

/// Columns by which the direction may be wrong for one by which the middle of mass is off.
const DOUBT: f32 = 4.0;

/// Share of the width by which the middle of mass may be off.
const LOPSIDED: f32 = 0.04;

/// The highest row of a picture above its middle, over the number of columns: of a picture of 4:3, or a CMUcam2's.
const HIGHEST: f32 = 0.4;

/// Shape of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Shape {
    /// Not known: width and height tell nothing.
    Any,
    /// As wide as tall: a ball.
    Round {
        /// Number of rows that are as much as a column, above 0.
        rows_per_column: f32,
        /// The lens, which stretches the picture away from the axis, if it is known.
        optics: Option<Camera<f32>>,
    },
}

/// Waits until a blob is steady, then tells its place. Looks at up to `N` frames.
#[derive(Clone, Debug)]
pub struct Steadiness<const N: usize> {
    columns: u16,
    shape: Shape,
    frames: usize,
    window: Deque<Option<Blob>, N>,
    is_unanimous: bool,
}

/// A blob that stood still.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Steady {
    /// Median of its left edges, column.
    pub left: f32,
    /// Median of its right edges, column.
    pub right: f32,
    /// Its upper and lower edge above the middle row, in columns' widths, if they are known.
    pub above: Option<[f32; 2]>,
    /// Standard deviation of the middle between them, columns.
    pub column_sigma: f32,
    /// Frames with it.
    pub frames: u16,
    /// Median of [`Blob::pixels`].
    pub pixels: u8,
    /// Median of [`Blob::confidence`].
    pub confidence: u8,
}

/// View of a [`Steadiness::glance`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Glance {
    /// Its place in this frame.
    pub steady: Steady,
    /// It is wider than an object of its height: there may be several in it.
    pub is_wide: bool,
}

/// Reason why the blob is not steady yet.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Unsteady {
    /// Not enough frames came.
    Few,
    /// Nothing was tracked.
    Lost {
        /// Frames in which nothing was tracked.
        lost: u16,
        /// Frames in all.
        frames: u16,
    },
    /// The blob reaches the left or right border; a round one also the upper or lower one.
    Clipped,
    /// The middles are too far apart.
    Moving {
        /// Leftmost of most middles, column.
        from: f32,
        /// Rightmost of most middles, column.
        to: f32,
    },
    /// The middle of mass is too far from the middle of the box, or the box too narrow.
    Lopsided {
        /// The excess over rounding, or so much too narrow, columns.
        by: f32,
    },
    /// It is wider than tall.
    Wide {
        /// So much too wide, columns.
        by: f32,
    },
    /// It fills little of its box.
    Sparse {
        /// 256 times the share.
        filled: u8,
    },
}

impl fmt::Display for Unsteady {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Few => f.write_str("too few packets came"),
            Self::Lost { lost, frames } => write!(
                f,
                "nothing is tracked: is the object in view and lit as when its colour was learnt? \
                 ({lost} of {frames} packets were empty)"
            ),
            Self::Clipped => f.write_str(
                "the object is cut off by the border of the picture, so its middle is not to be \
                 seen: move it or the camera, or take a smaller object",
            ),
            Self::Moving { from, to } => write!(
                f,
                "the object moves: its middle goes from column {from} to {to}"
            ),
            Self::Lopsided { by } => write!(
                f,
                "the object is partly hidden, or something else has its colour: its blob is out \
                 of shape by {by:.1} columns"
            ),
            Self::Wide { by } => write!(
                f,
                "the object is wider than tall by {by:.1} columns: it may be two, or something else has its colour"
            ),
            Self::Sparse { filled } => write!(
                f,
                "the tracked pixels fill {} % of their box: something else in view has this colour, or only \
                 a part of the object has it",
                u16::from(*filled) * 100 / 256
            ),
        }
    }
}

impl core::error::Error for Unsteady {}

impl<const N: usize> Steadiness<N> {
    /// For a blob of this shape in so many frames in a row, 2 to `N`, of so many columns.
    pub fn new(frames: usize, columns: u16, shape: Shape) -> Self {
        const { assert!(N >= 2 && N <= u16::MAX as usize) };
        Self {
            columns,
            shape,
            frames: frames.clamp(2, N),
            window: Deque::new(),
            is_unanimous: false,
        }
    }

    /// Forgets all frames.
    pub fn clear(&mut self) {
        self.window.clear();
        self.is_unanimous = false;
    }

    /// Takes the blob of a frame, and judges the last ones.
    ///
    /// # Errors
    /// The reason why the blob is not steady yet.
    pub fn push(&mut self, blob: Option<Blob>) -> Result<Steady, Unsteady> {
        if self.window.len() >= self.frames {
            self.window.pop_front();
        }
        let pushed = self.window.push_back(blob);
        debug_assert!(pushed.is_ok(), "a place was just made");
        self.judge()
    }

    /// Returns true if all the frames looked at say the same: nothing in view, or all of it clipped.
    pub const fn is_unanimous(&self) -> bool {
        self.is_unanimous
    }

    fn judge(&mut self) -> Result<Steady, Unsteady> {
        let frames = self.window.len();
        if frames < self.frames {
            return Err(Unsteady::Few);
        }
        let (mut lost, mut cut) = (0, 0);
        let mut whole = Vec::<&Blob, N>::new();
        for blob in &self.window {
            match blob {
                None => lost += 1,
                Some(blob) if self.is_cut(blob) => cut += 1,
                Some(blob) => {
                    // As many as there are frames.
                    let _ = whole.push(blob);
                }
            }
        }
        self.is_unanimous = lost == frames || cut == frames;
        let allowed = frames / UNUSABLE;
        if lost > allowed {
            return Err(Unsteady::Lost {
                lost: lost as u16,
                frames: frames as u16,
            });
        }
        let Some(last) = whole.last().filter(|_| cut <= allowed) else {
            return Err(Unsteady::Clipped);
        };
        let middles = sorted::<N>(&whole, Blob::middle);
        moving::<N>(&whole, &middles, last.cell_width)?;
        let median_of = |of| median(&sorted::<N>(&whole, of));
        let typical = Blob {
            left: median_of(|blob| blob.left),
            right: median_of(|blob| blob.right),
            top: median_of(|blob| blob.top),
            bottom: median_of(|blob| blob.bottom),
            centroid: [median_of(|blob| blob.centroid[0]), last.centroid[1]],
            pixels: median_of(|blob| f32::from(blob.pixels)) as u8,
            confidence: median_of(|blob| f32::from(blob.confidence)) as u8,
            ..**last
        };
        let doubt = self.doubt(&typical)?;
        Ok(Steady {
            frames: whole.len() as u16,
            ..Steady::new(&typical, median_variance(&middles) + doubt * doubt)
        })
    }

    /// The object of one frame for itself, which may move. `None`: it is cut off or partly hidden.
    pub fn glance(&self, blob: &Blob) -> Option<Glance> {
        if self.is_cut(blob) {
            return None;
        }
        // The look of two objects in one box is no reason to doubt one of them.
        let is_wide = is_wide(blob, self.lack(blob));
        let doubt = if is_wide { 0.0 } else { self.doubt(blob).ok()? };
        let steady = Steady::new(blob, doubt * doubt);
        Some(Glance { steady, is_wide })
    }

    /// Returns true if the border cuts a part off: of a round object at any side, for its row counts too.
    fn is_cut(&self, blob: &Blob) -> bool {
        let is_round = self.shape != Shape::Any;
        let is_high_enough = blob.rows.is_none() || blob.whole_rows().is_some();
        blob.is_clipped(self.columns) || is_round && !is_high_enough
    }

    /// Standard deviation of the direction by doubts on the shape, columns.
    ///
    /// # Errors
    /// [`Unsteady::Lopsided`], [`Unsteady::Wide`], [`Unsteady::Sparse`].
    fn doubt(&self, blob: &Blob) -> Result<f32, Unsteady> {
        let width = blob.right - blob.left;
        let lack = self.lack(blob);
        let off = beyond(blob.centroid[0], blob.middle(), blob.cell_width);
        for (by, most) in [(off, width * LOPSIDED), (lack, (width + lack) * HIDDEN)] {
            if by > most.max(0.0) {
                return Err(Unsteady::Lopsided { by });
            }
        }
        if is_wide(blob, lack) {
            return Err(Unsteady::Wide { by: -lack });
        }
        let least = match self.shape {
            Shape::Any => SPARSE_ANY,
            Shape::Round { .. } => SPARSE,
        };
        let filled = blob.confidence;
        // Blocks of frame differencing need not touch each other.
        if (1..least).contains(&filled) && width >= SMALL && blob.cell_width < 2.0 {
            return Err(Unsteady::Sparse { filled });
        }
        Ok((DOUBT * off).max(lack.abs() * 0.5))
    }

    /// Width that a round target lacks, columns; below 0 if it is too wide, and 0 if that may be rounding.
    fn lack(&self, blob: &Blob) -> f32 {
        let Shape::Round {
            rows_per_column,
            optics,
        } = &self.shape
        else {
            return 0.0;
        };
        let row = above(blob).map_or(0.0, |[top, bottom]| (top + bottom) * 0.5);
        let stretch = optics.map_or(1.0, |optics| optics.stretch(blob.middle(), row));
        let height = (blob.bottom - blob.top) / rows_per_column;
        let lack = height * stretch - (blob.right - blob.left);
        if lack.abs() > NARROW * blob.cell_width {
            lack
        } else {
            0.0
        }
    }
}

/// Returns true if a target that lacks so much of its width is so much wider than tall that it may be two.
fn is_wide(blob: &Blob, lack: f32) -> bool {
    -lack > (HIDDEN * (blob.right - blob.left)).max(WIDE * blob.cell_width)
}

impl Steady {
    /// That of one frame, or of a typical one, whose middle has this variance beside that of rounding.
    fn new(blob: &Blob, variance: f32) -> Self {
        let unit = blob.cell_width;
        Self {
            left: blob.left,
            right: blob.right,
            above: above(blob),
            column_sigma: ComplexField::sqrt(ROUNDING * unit * unit + variance),
            frames: 1,
            pixels: blob.pixels,
            confidence: blob.confidence,
        }
    }

    /// The column in the middle between its edges.
    pub fn middle(&self) -> f32 {
        (self.left + self.right) * 0.5
    }

    /// The direction in which a camera sees it, and its width. `floor` is the standard deviation of errors
    /// that no frame shows, columns, from 0.
    pub fn seen(&self, camera: &Camera<f32>, floor: f32) -> Seen {
        let Direction {
            bearing,
            sigma,
            half_width,
            elevation,
        } = self.direction(camera, floor);
        let seen = Seen::direction(bearing, sigma).wide(half_width);
        match elevation {
            Some(elevation) => seen.above(Elevation::from_radians(elevation)),
            None => seen,
        }
    }

    /// The same in any precision.
    pub fn direction<T: Real>(&self, camera: &Camera<T>, floor: f32) -> Direction<T> {
        let real = |value: f32| nalgebra::convert::<f64, T>(f64::from(value));
        let half = real(0.5);
        let (left, right) = (real(self.left), real(self.right));
        let edges = self.above.map(|edges| edges.map(real));
        let row = edges.map_or_else(T::zero, |[top, bottom]| (top + bottom) * half);
        let bearings = |row| [left, right].map(|column| camera.bearing_above(column, row));
        let [from, to] = bearings(row);
        let bearing = (from + to) * half;
        let column_sigma = real(ComplexField::sqrt(
            self.column_sigma * self.column_sigma + floor * floor,
        ));
        let mut sigma = (camera.bearing_sigma(left, column_sigma)
            + camera.bearing_sigma(right, column_sigma))
            * half;
        if edges.is_none() && !camera.distortion().is_none() {
            // It may be in any row.
            let [highest_from, highest_to] = bearings(camera.last_column() * real(HIGHEST));
            let off = (highest_from + highest_to) * half - bearing;
            sigma = (sigma * sigma + off * off * half).sqrt();
        }
        Direction {
            bearing,
            sigma,
            half_width: from - bearing,
            elevation: edges.map(|rows| camera.elevation(bearing, (left + right) * half, rows)),
        }
    }
}

/// Direction of an object, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction<T> {
    /// The mean of the bearings of its edges, positive to the left of the optical axis.
    pub bearing: T,
    /// Standard deviation of the bearing.
    pub sigma: T,
    /// Half of the angle between its edges.
    pub half_width: T,
    /// Angle above the camera's own horizontal plane, if the rows of its edges are known.
    pub elevation: Option<T>,
}

impl fmt::Display for Steady {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "column {} +/- {:.2} ({} packets, pixels {}, confidence {})",
            self.middle(),
            self.column_sigma,
            self.frames,
            self.pixels,
            self.confidence
        )
    }
}

/// The upper and lower edge of a blob above the middle row, columns' widths.
fn above(blob: &Blob) -> Option<[f32; 2]> {
    let rows = blob.whole_rows()?;
    Some([blob.top, blob.bottom].map(|row| rows.above_middle(row)))
}

/// Returns an error if most of the middles, which are sorted, are far apart, or the later ones are elsewhere than the
/// earlier ones.
fn moving<const N: usize>(blobs: &[&Blob], middles: &[f32], unit: f32) -> Result<(), Unsteady> {
    let cut = middles.len() / UNUSABLE;
    let most = middles.get(cut..middles.len().saturating_sub(cut));
    let (Some(&[from, .., to]), Some((earlier, later))) =
        (most, blobs.split_at_checked(blobs.len() / 2))
    else {
        return Err(Unsteady::Few);
    };
    let [earlier, later] = [earlier, later].map(|part| median(&sorted::<N>(part, Blob::middle)));
    let spread = SPREAD * unit;
    if to - from > spread || (earlier - later).abs() >= spread {
        return Err(Unsteady::Moving { from, to });
    }
    Ok(())
}

/// Distance of a middle of mass from the middle of its box, beyond rounding.
fn beyond(centroid: f32, middle: f32, unit: f32) -> f32 {
    let off = middle - centroid;
    (off - CENTROID_RIGHT * unit)
        .max(-off - CENTROID_LEFT * unit)
        .max(0.0)
}

/// One value of each blob, the least first; at most `N`.
fn sorted<const N: usize>(blobs: &[&Blob], of: fn(&Blob) -> f32) -> Vec<f32, N> {
    let mut sorted = Vec::new();
    for blob in blobs {
        // As many as there are frames.
        let _ = sorted.push(of(blob));
    }
    sort(&mut sorted, |a, b| a.total_cmp(b).is_lt());
    sorted
}

/// The middle of sorted values, or the mean of the two in the middle; 0 of none.
fn median(sorted: &[f32]) -> f32 {
    let at = |place: usize| sorted.get(place).copied().unwrap_or(0.0);
    let half = sorted.len() / 2;
    if sorted.len().is_multiple_of(2) {
        (at(half.saturating_sub(1)) + at(half)) * 0.5
    } else {
        at(half)
    }
}

/// Variance of the median of noisy values: `pi / 2n` times theirs.
fn median_variance(values: &[f32]) -> f32 {
    let count = values.len().max(1) as f32;
    let mean = values.iter().sum::<f32>() / count;
    let squares: f32 = values
        .iter()
        .map(|value| (value - mean) * (value - mean))
        .sum();
    core::f32::consts::FRAC_PI_2 * squares / (count - 1.0).max(1.0) / count
}

#[cfg(test)]
mod tests;
