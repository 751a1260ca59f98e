//! The blob of one frame.

use cmucam2_driver::packet::Tracking;

use crate::message::TrackedBlob;

/// Meaning of the numbers of a T packet.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Grid {
    /// Number of the first column and row: 0 or 1, which sources disagree on.
    pub first: u8,
    /// Width of a unit, columns: 1, or that of a block of frame differencing.
    pub cell_width: f32,
    /// Height of a unit, rows.
    pub cell_height: f32,
    /// Rows of the frame.
    pub rows: u16,
}

impl Grid {
    /// Units are columns and rows of a frame of so many rows.
    pub const fn pixels(first: u8, rows: u16) -> Self {
        Self {
            first,
            cell_width: 1.0,
            cell_height: 1.0,
            rows,
        }
    }

    /// Units are `blocks` by `blocks` blocks of a frame.
    pub fn blocks(first: u8, blocks: u8, columns: u16, rows: u16) -> Self {
        let blocks = f32::from(blocks.max(1));
        Self {
            first,
            cell_width: f32::from(columns) / blocks,
            cell_height: f32::from(rows) / blocks,
            rows,
        }
    }
}

/// The blob of one frame, in [columns](super#columns) and rows from 0 at the top.
///
/// Its edges are the outer edges of the outermost pixels that belong to it, half a column or row
/// beyond their middles. A pixel belongs to it when its middle does, so the true edge is as likely
/// anywhere within half a unit to either side.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Blob {
    /// Left edge, column.
    pub left: f32,
    /// Right edge, column.
    pub right: f32,
    /// Upper edge, row.
    pub top: f32,
    /// Lower edge, row.
    pub bottom: f32,
    /// Middle of mass, column and row, cut or rounded to a whole unit.
    pub centroid: [f32; 2],
    /// Pixels that belong to it, in eighths, at most 255: `min(255, (n + 4) / 8)`; 0: not told.
    pub pixels: u8,
    /// Share of its box that it fills: `min(255, 256 n / area)`; 0: not told.
    pub confidence: u8,
    /// Width of the unit in which its columns are known: 1, or that of a block.
    pub cell_width: f32,
    /// It reaches the upper or lower border of the frame.
    pub is_cut: bool,
    /// As the camera told it.
    pub told: TrackedBlob,
}

impl Blob {
    /// The blob of a T packet. `None` if nothing is tracked, or not all was sent.
    pub fn from_tracking(tracking: &Tracking, grid: Grid) -> Option<Self> {
        let (x, y) = tracking.centroid()?;
        let found = tracking.bounding_box()?;
        let (pixels, confidence) = (tracking.pixels()?, tracking.confidence()?);
        let first = f32::from(grid.first);
        // The near edge of unit `i` of this width, which is -0.5 for the first.
        let edge = |unit: u8, width: f32| (f32::from(unit) - first) * width - 0.5;
        let far = |unit: u8, width: f32| edge(unit, width) + width;
        let middle = |unit: u8, width: f32| edge(unit, width) + width * 0.5;
        let (top, bottom) = (
            edge(found.y1, grid.cell_height),
            far(found.y2, grid.cell_height),
        );
        Some(Self {
            left: edge(found.x1, grid.cell_width),
            right: far(found.x2, grid.cell_width),
            top,
            bottom,
            centroid: [middle(x, grid.cell_width), middle(y, grid.cell_height)],
            pixels,
            confidence,
            cell_width: grid.cell_width,
            is_cut: is_cut([top, bottom], grid.rows),
            told: TrackedBlob {
                middle: [x, y].map(u16::from),
                edges: [found.x1, found.y1, found.x2, found.y2].map(u16::from),
                pixels,
                confidence,
            },
        })
    }

    /// Column in the middle between its edges.
    pub fn middle(&self) -> f32 {
        (self.left + self.right) * 0.5
    }

    /// Returns true if it reaches the left or right border of a frame of so many columns, so that its middle
    /// is not the middle of the object.
    ///
    /// One column more counts on the left and two more on the right: frames may be a column
    /// narrower than the manual says, and may count from 0 or from 1.
    pub fn is_clipped(&self, columns: u16) -> bool {
        !(self.left > 0.0 && self.right < f32::from(columns) - 2.5)
    }
}

/// Returns true if these edges reach the upper or lower border of a frame of so many rows.
pub(super) fn is_cut([top, bottom]: [f32; 2], rows: u16) -> bool {
    !(top > 0.0 && bottom < f32::from(rows) - 2.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEEN: Tracking = Tracking::new([23, 50, 21, 41, 28, 60, 15, 200]);

    /// Counted from 1: column 21 of a packet is column 20, whose left edge is at 19.5.
    #[test]
    fn edges_are_half_a_column_outside() {
        let blob = Blob::from_tracking(&SEEN, Grid::pixels(1, 143)).unwrap();
        assert_eq!(
            (blob.left, blob.right, blob.top, blob.bottom),
            (19.5, 27.5, 39.5, 59.5)
        );
        assert_eq!((blob.middle(), blob.centroid), (23.5, [22.0, 49.0]));
        assert_eq!(blob.told.middle, [23, 50]);
        assert_eq!(blob.told.edges, [21, 41, 28, 60]);
        let from_0 = Blob::from_tracking(&SEEN, Grid::pixels(0, 143)).unwrap();
        assert_eq!(from_0.left, 20.5);
        assert_eq!(
            Blob::from_tracking(&Tracking::LOST, Grid::pixels(1, 143)),
            None
        );
        let masked = SEEN.masked(3, None, None);
        assert_eq!(Blob::from_tracking(&masked, Grid::pixels(1, 143)), None);
    }

    /// All blocks together are the whole frame, and two neighbours share an edge.
    #[test]
    fn blocks_cover_the_frame() {
        let grid = Grid::blocks(1, 16, 88, 143);
        let blocks = |x1, x2| {
            let packet = Tracking::new([x1, 1, x1, 1, x2, 16, 9, 200]);
            Blob::from_tracking(&packet, grid).unwrap()
        };
        let all = blocks(1, 16);
        assert_eq!((all.left, all.right), (-0.5, 87.5));
        assert_eq!((all.top, all.bottom), (-0.5, 142.5));
        assert_eq!(blocks(1, 4).right, blocks(5, 5).left);
        assert_eq!(blocks(5, 5).cell_width, 5.5);
        assert!(blocks(1, 4).is_clipped(88) && blocks(13, 16).is_clipped(88));
        assert!(!blocks(2, 15).is_clipped(88));
    }

    #[test]
    fn what_touches_the_border_is_clipped() {
        for (x1, x2, clipped) in [
            (0, 9, true),
            (1, 9, true),
            (2, 9, false),
            (70, 85, false),
            (70, 86, true),
            (70, 88, true),
        ] {
            let packet = Tracking::new([x1, 70, x1, 60, x2, 80, 10, 200]);
            let blob = Blob::from_tracking(&packet, Grid::pixels(1, 143)).unwrap();
            assert_eq!(blob.is_clipped(88), clipped, "{x1}..{x2}");
        }
        for (y1, y2, cut) in [(1, 90, true), (2, 140, false), (60, 141, true)] {
            let packet = Tracking::new([40, 70, 35, y1, 45, y2, 10, 200]);
            let blob = Blob::from_tracking(&packet, Grid::pixels(1, 143)).unwrap();
            assert_eq!(blob.is_cut, cut, "{y1}..{y2}");
        }
    }
}
