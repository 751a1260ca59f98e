//! Mean colour, its deviation, and histograms.

use super::{
    blob::Filter,
    colour::{Colour, LEVEL_MAX, LEVEL_MIN},
    tracked::Tracked,
    view::{Region, View},
};

/// Bins of a histogram after a reset, and at most.
pub(super) const BINS: u8 = 28;

/// The mean colour and its mean absolute deviation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Statistics {
    pub(super) mean: Colour,
    pub(super) deviation: Colour,
}

const LEVELS: usize = (LEVEL_MAX - LEVEL_MIN) as usize + 1;

/// Number of occurrences of each level of each channel.
#[derive(Clone, Debug)]
pub(super) struct Levels {
    counts: [[u32; LEVELS]; 3],
}

impl Levels {
    pub(super) fn new() -> Self {
        Self {
            counts: [[0; LEVELS]; 3],
        }
    }

    /// All pixels of a region.
    pub(super) fn of(view: &View<'_>, region: Region) -> Self {
        let mut levels = Self::new();
        let mut pixels = Vec::new();
        for y in region.y1..=region.y2 {
            view.row(y, region.x1, region.x2, &mut pixels);
            pixels.iter().for_each(|&colour| levels.add(colour));
        }
        levels
    }

    /// The pixels of a region that are tracked.
    pub(super) fn of_tracked(view: &View<'_>, region: Region, filter: &Filter) -> Self {
        let mut levels = Self::new();
        let mut tracked = Tracked::new(view, region, filter);
        let (mut pixels, mut runs) = (Vec::new(), Vec::new());
        for y in region.y1..=region.y2 {
            tracked.runs(y, &mut runs);
            for &(first, last) in &runs {
                view.row(y, first, last, &mut pixels);
                pixels.iter().for_each(|&colour| levels.add(colour));
            }
        }
        levels
    }

    pub(super) fn add(&mut self, colour: Colour) {
        for (counts, level) in self.counts.iter_mut().zip(colour.levels()) {
            counts[usize::from(level - LEVEL_MIN)] += 1;
        }
    }

    fn channel(counts: &[u32; LEVELS]) -> impl Iterator<Item = (u32, u32)> + '_ {
        (u32::from(LEVEL_MIN)..).zip(counts.iter().copied())
    }

    /// Mean and mean absolute deviation, both rounded down; zero of no pixels.
    fn mean_and_deviation(counts: &[u32; LEVELS]) -> (u8, u8) {
        let total: u32 = counts.iter().sum();
        if total == 0 {
            return (0, 0);
        }
        let mean = Self::channel(counts)
            .map(|(level, n)| level * n)
            .sum::<u32>()
            / total;
        let deviation = Self::channel(counts)
            .map(|(level, n)| level.abs_diff(mean) * n)
            .sum::<u32>()
            / total;
        (mean as u8, deviation as u8)
    }

    pub(super) fn statistics(&self) -> Statistics {
        let [red, green, blue] = self.counts.each_ref().map(Self::mean_and_deviation);
        Statistics {
            mean: [red.0, green.0, blue.0].into(),
            deviation: [red.1, green.1, blue.1].into(),
        }
    }

    /// Each of `bins` equal bins from level 16 to 240 holds its share of the pixels in 1/256,
    /// doubled `scale` times, at most 255.
    pub(super) fn histogram(&self, channel: u8, bins: u8, scale: u8) -> Vec<u8> {
        let counts = &self.counts[usize::from(channel)];
        let total = u64::from(counts.iter().sum::<u32>()).max(1);
        let bins = usize::from(bins.clamp(1, BINS));
        let mut sums = [0_u64; BINS as usize];
        for (level, &count) in counts.iter().enumerate() {
            // The greatest level belongs to the last bin.
            sums[(level * bins / (LEVELS - 1)).min(bins - 1)] += u64::from(count);
        }
        let scaled = sums.map(|sum| (((sum * 256) << scale.min(8)) / total).min(255) as u8);
        scaled[..bins].to_vec()
    }
}
