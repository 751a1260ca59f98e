//! Frame differencing: a grid of block means against a reference (thesis 2.5).

use super::{
    blob::Blob,
    view::{Region, View},
};

/// Blocks across and down in high resolution.
const FINE: u8 = 16;
/// Blocks across and down otherwise.
const COARSE: u8 = 8;

/// The mean of one channel in each block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Grid {
    side: u8,
    means: Vec<u8>,
}

impl Grid {
    /// Nothing was loaded.
    pub(super) fn dark(fine: bool) -> Self {
        let side = if fine { FINE } else { COARSE };
        Self {
            side,
            means: vec![0; usize::from(side) * usize::from(side)],
        }
    }

    /// The blocks of a region. A block without a pixel of its own is dark.
    pub(super) fn of(view: &View<'_>, region: Region, channel: u8, fine: bool) -> Self {
        let mut grid = Self::dark(fine);
        let mut sums = vec![(0_u32, 0_u32); grid.means.len()];
        let mut pixels = Vec::new();
        for y in region.y1..=region.y2 {
            view.row(y, region.x1, region.x2, &mut pixels);
            for (x, colour) in (0..).zip(&pixels) {
                let block = grid.index(
                    grid.block(x, region.width()),
                    grid.block(y - region.y1, region.height()),
                );
                sums[block].0 += u32::from(colour.levels()[usize::from(channel)]);
                sums[block].1 += 1;
            }
        }
        for (mean, (sum, count)) in grid.means.iter_mut().zip(sums) {
            *mean = (sum / count.max(1)) as u8;
        }
        grid
    }

    /// From the 64 means that were uploaded.
    pub(super) fn uploaded(blocks: &[u8; 64], fine: bool) -> Self {
        let mut grid = Self::dark(fine);
        let blocks_per = grid.side / COARSE;
        for y in 0..grid.side {
            for x in 0..grid.side {
                let from = y / blocks_per * COARSE + x / blocks_per;
                let to = grid.index(x, y);
                grid.means[to] = blocks[usize::from(from)];
            }
        }
        grid
    }

    fn block(&self, pixel: u8, pixels: u8) -> u8 {
        (u16::from(pixel) * u16::from(self.side) / u16::from(pixels)) as u8
    }

    fn index(&self, x: u8, y: u8) -> usize {
        usize::from(y) * usize::from(self.side) + usize::from(x)
    }

    /// Blocks that differ from another grid by more than a threshold. Grids of different resolution have nothing
    /// in common.
    pub(super) fn differing(&self, other: &Self, threshold: u8) -> Vec<bool> {
        if self.side != other.side {
            return vec![true; self.means.len()];
        }
        self.means
            .iter()
            .zip(&other.means)
            .map(|(a, b)| a.abs_diff(*b) > threshold)
            .collect()
    }

    /// Difference of each block from another grid; nothing is known of grids of different resolution.
    pub(super) fn deltas(&self, other: &Self) -> Vec<u8> {
        let same = self.side == other.side;
        self.means
            .iter()
            .enumerate()
            .map(|(block, mean)| {
                if same {
                    mean.abs_diff(other.means[block])
                } else {
                    *mean
                }
            })
            .collect()
    }

    /// Blocks across, and down.
    pub(super) fn side(&self) -> u8 {
        self.side
    }

    /// The blob of the blocks that differ and are not masked.
    pub(super) fn blob(&self, reference: &Self, masked: &[bool], threshold: u8) -> Blob {
        let differing = self.differing(reference, threshold);
        let mut blob = Blob::default();
        for y in 0..self.side {
            for x in 0..self.side {
                let block = self.index(x, y);
                let is_masked = masked.len() == differing.len() && masked[block];
                if differing[block] && !is_masked {
                    blob.add(y, (x, x));
                }
            }
        }
        blob
    }
}
