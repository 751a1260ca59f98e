//! Tracked pixels: those within bounds, gathered to one blob.

use super::{
    colour::{Bounds, Colour},
    tracked::Tracked,
    view::{Region, View},
};

/// Choice of the pixels that count.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filter {
    pub(super) bounds: Bounds,
    /// Those outside count instead.
    pub(super) invert: bool,
    /// Number of pixels side by side that a run takes.
    pub(super) run: u8,
    /// True if the pixels of a run before the last one needed do not count.
    pub(super) tail_only: bool,
}

impl Filter {
    pub(super) fn accepts(&self, colour: Colour) -> bool {
        self.bounds.contains(colour) != self.invert
    }
}

/// Counting pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Blob {
    count: u32,
    sum_x: u32,
    sum_y: u32,
    /// Least column and row, greatest column and row.
    limits: Option<[u8; 4]>,
}

impl Blob {
    pub(super) fn add(&mut self, y: u8, (first, last): (u8, u8)) {
        let pixels = u32::from(last - first) + 1;
        self.count += pixels;
        self.sum_x += (u32::from(first) + u32::from(last)) * pixels / 2;
        self.sum_y += u32::from(y) * pixels;
        let [x1, y1, x2, y2] = self.limits.unwrap_or([first, y, last, y]);
        self.limits = Some([x1.min(first), y1.min(y), x2.max(last), y2.max(y)]);
    }

    /// The blob of a region.
    pub(super) fn of(view: &View<'_>, region: Region, filter: &Filter) -> Self {
        let mut blob = Self::default();
        let mut tracked = Tracked::new(view, region, filter);
        let mut runs = Vec::new();
        for y in tracked.rows() {
            tracked.runs(y, &mut runs);
            for &run in &runs {
                blob.add(y, run);
            }
        }
        blob
    }

    /// Number of pixels that count.
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

    /// The eight numbers of its packet, all zero without a pixel; columns and rows count from
    /// `(x, y)` as number `origin`.
    pub(super) fn numbers(&self, (x, y): (u8, u8), origin: u8, pixels: u8) -> [u8; 8] {
        let (Some((mx, my)), Some([x1, y1, x2, y2])) = (self.middle(), self.limits) else {
            return [0; 8];
        };
        let across = |column: u8| column - x + origin;
        let down = |row: u8| row - y + origin;
        let area = (u32::from(x2 - x1) + 1) * (u32::from(y2 - y1) + 1);
        [
            across(mx),
            down(my),
            across(x1),
            down(y1),
            across(x2),
            down(y2),
            pixels,
            confidence(self.count, area),
        ]
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
