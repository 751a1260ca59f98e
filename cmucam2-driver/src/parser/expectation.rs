//! Expected bytes.

use super::ImageKind;
use crate::{command::StatisticsMask, geometry::Size, packet::BINS_MAX, servo::ServoMask};

/// Expected bytes, as far as the bytes themselves do not tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Expectation {
    /// The fields of T packets: bit 0 is mx, bit 7 the confidence.
    pub tracking: u8,
    /// The servo positions behind them.
    pub servos: ServoMask,
    /// The fields of S packets.
    pub statistics: StatisticsMask,
    /// The bins of H packets; `None` accepts any number.
    pub bins: Option<u8>,
    /// The frame in which T packets and images must lie.
    pub frame: Size,
    /// Binary data that may come between lines: a frame, or the rows of a line mode.
    pub image: Option<ImageKind>,
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
            tracking: 0xFF,
            servos: ServoMask::NONE,
            statistics: StatisticsMask::ALL,
            bins: Some(BINS_MAX as u8),
            frame: Size::LARGEST,
            image: None,
            raw: false,
            values: 0,
            strict: false,
        }
    }
}
