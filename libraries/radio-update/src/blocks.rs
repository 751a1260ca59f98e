//! A set of blocks.

use crate::{BLOCK, PAGE, PAGES_MAX, package::HEADER_BLOCKS};

/// Blocks of the longest package.
pub(crate) const BLOCKS_MAX: usize = HEADER_BLOCKS + PAGES_MAX * (PAGE / BLOCK);

/// Blocks that are there.
#[derive(Clone, Debug)]
pub(crate) struct Blocks([u8; BLOCKS_MAX.div_ceil(8)]);

impl Blocks {
    pub(crate) const fn new() -> Self {
        Self([0; BLOCKS_MAX.div_ceil(8)])
    }

    pub(crate) fn has(&self, block: usize) -> bool {
        let byte = self.0.get(block / 8).copied().unwrap_or(0);
        byte & (1 << (block % 8)) != 0
    }

    pub(crate) fn set(&mut self, block: usize, is_there: bool) {
        if let Some(byte) = self.0.get_mut(block / 8) {
            let bit = 1 << (block % 8);
            *byte = if is_there { *byte | bit } else { *byte & !bit };
        }
    }

    /// Number of the first `count` blocks that are missing.
    pub(crate) fn missing(&self, count: usize) -> usize {
        (0..count).filter(|&block| !self.has(block)).count()
    }

    /// The first range of missing blocks from `from` on: its start and its length.
    pub(crate) fn gap(&self, from: usize, count: usize) -> Option<(usize, usize)> {
        let start = (from..count).find(|&block| !self.has(block))?;
        let end = (start..count)
            .find(|&block| self.has(block))
            .unwrap_or(count);
        Some((start, end - start))
    }
}
