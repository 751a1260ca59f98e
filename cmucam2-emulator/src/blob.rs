//! What is tracked: pixels within bounds, gathered to one blob.

use cmucam2_driver::{
    colour::{Colour, ColourBounds},
    packet::{BoundingBox, Tracking},
};

use super::{
    tracked::Tracked,
    view::{Region, View},
};

/// Which pixels count.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filter {
    /// `None`: no colour is within.
    pub(super) bounds: Option<ColourBounds>,
    /// Those outside count instead.
    pub(super) invert: bool,
    /// How many side by side it takes.
    pub(super) run: u8,
    /// Of a run, the pixels before the last one needed do not count.
    pub(super) tail_only: bool,
}

impl Filter {
    pub(super) fn accepts(&self, colour: Colour) -> bool {
        self.bounds.is_some_and(|bounds| bounds.contains(colour)) != self.invert
    }
}

/// Counting pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Blob {
    count: u32,
    sum_x: u32,
    sum_y: u32,
    limits: Option<BoundingBox>,
}

impl Blob {
    pub(super) fn add(&mut self, y: u8, (first, last): (u8, u8)) {
        let pixels = u32::from(last - first) + 1;
        self.count += pixels;
        self.sum_x += (u32::from(first) + u32::from(last)) * pixels / 2;
        self.sum_y += u32::from(y) * pixels;
        let row = BoundingBox {
            x1: first,
            y1: y,
            x2: last,
            y2: y,
        };
        self.limits = Some(self.limits.map_or(row, |limits| BoundingBox {
            x1: limits.x1.min(first),
            y1: limits.y1.min(y),
            x2: limits.x2.max(last),
            y2: limits.y2.max(y),
        }));
    }

    /// The blob of a region.
    pub(super) fn of(view: &View<'_>, region: Region, filter: &Filter) -> Self {
        let mut blob = Self::default();
        let mut tracked = Tracked::new(view, region, filter);
        let mut runs = Vec::new();
        for y in region.y1..=region.y2 {
            tracked.runs(y, &mut runs);
            for &run in &runs {
                blob.add(y, run);
            }
        }
        blob
    }

    /// How many pixels count.
    pub(super) fn count(&self) -> u32 {
        self.count
    }

    /// Middle of mass, from 0.
    pub(super) fn middle(&self) -> Option<(u8, u8)> {
        (self.count > 0).then(|| {
            (
                (self.sum_x / self.count) as u8,
                (self.sum_y / self.count) as u8,
            )
        })
    }

    /// The packet, with columns and rows counted from `(x, y)` as number `origin`.
    pub(super) fn packet(&self, (x, y): (u8, u8), origin: u8, pixels: u8) -> Tracking {
        let (Some((mx, my)), Some(limits)) = (self.middle(), self.limits) else {
            return Tracking::LOST;
        };
        let across = |column: u8| column - x + origin;
        let down = |row: u8| row - y + origin;
        Tracking::new([
            across(mx),
            down(my),
            across(limits.x1),
            down(limits.y1),
            across(limits.x2),
            down(limits.y2),
            pixels,
            confidence(self.count, limits.area()),
        ])
    }
}

/// `min(255, (n + 4) / 8)`.
pub(super) fn pixels(count: u32) -> u8 {
    u8::try_from((count + 4) / 8).unwrap_or(u8::MAX)
}

/// `min(255, 256 n / area)`.
pub(super) fn confidence(count: u32, area: u32) -> u8 {
    u8::try_from(256 * count / area.max(1)).unwrap_or(u8::MAX)
}
