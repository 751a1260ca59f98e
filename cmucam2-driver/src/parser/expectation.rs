//! Expected bytes.

use crate::{
    command::{StatisticsLines, StatisticsMask, TrackingLines},
    geometry::Size,
    packet::{BINS_MAX, TrackingFields},
};

/// Binary data that may come between lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ImageExpectation {
    /// Lines follow each other, with nothing between.
    #[default]
    None,
    /// A frame of so many bytes for each pixel, 1 or 3.
    Frame(u8),
    /// Rows of a line mode of tracking.
    Tracking(TrackingLines),
    /// Rows of a line mode of statistics.
    Statistics(StatisticsLines),
}

/// Expected bytes, as far as the bytes themselves do not tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Expectation {
    /// The fields of T packets.
    pub tracking: TrackingFields,
    /// The fields of S packets.
    pub statistics: StatisticsMask,
    /// The bins of H packets; `None` accepts any number.
    pub bins: Option<u8>,
    /// The frame in which T packets and images must lie.
    pub frame: Size,
    /// Binary data that may come between lines.
    pub image: ImageExpectation,
    /// True if raw packets may come.
    pub raw: bool,
    /// Number of numbers that a query answers, 1 to 6; 0 when none was made.
    pub values: u8,
    /// True to drop T packets that are not [consistent](crate::packet::Tracking::is_consistent).
    /// Right for colour tracking only: frame differencing counts blocks.
    pub strict: bool,
}

impl Default for Expectation {
    /// A camera after its reset.
    fn default() -> Self {
        Self {
            tracking: TrackingFields::ALL,
            statistics: StatisticsMask::ALL,
            bins: Some(BINS_MAX as u8),
            frame: Size::LARGEST,
            image: ImageExpectation::None,
            raw: false,
            values: 0,
            strict: false,
        }
    }
}
