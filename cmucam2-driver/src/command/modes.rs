//! Arguments that select a mode.

use super::Mode;
use crate::argument::ArgumentError;

/// Mode of a LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LedMode {
    /// Argument 0.
    Off,
    /// Argument 1.
    On,
    /// Argument 2, the default: the camera shows tracking with it.
    Auto,
}

/// Row data before each colour-tracking packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TrackingLines {
    /// Packets alone.
    #[default]
    Off,
    /// One bit for each pixel: tracked or not.
    Bitmap,
    /// Mean, least and greatest column, count and confidence of each row.
    Rows,
}

/// Row data before each statistics packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StatisticsLines {
    /// Packets alone.
    #[default]
    Off,
    /// The mean colour of each row.
    Means,
    /// The mean colour and its deviation.
    MeansAndDeviations,
}

/// A line mode (`LM`), for one of the two kinds of packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LineMode {
    /// Before T packets (type 0).
    Tracking(TrackingLines),
    /// Before S packets (type 1).
    Statistics(StatisticsLines),
}

impl LineMode {
    pub(super) const fn mode(self) -> Mode {
        match self {
            Self::Tracking(_) => Mode::TrackingLines,
            Self::Statistics(_) => Mode::StatisticsLines,
        }
    }

    pub(super) const fn numbers(self) -> [u8; 2] {
        match self {
            Self::Tracking(lines) => [0, lines as u8],
            Self::Statistics(lines) => [1, lines as u8],
        }
    }
}

/// Fields of a packet that are sent (`OM`), the first field in the lowest bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OutputMask {
    /// Type 0: the eight fields of T packets, see [`Tracking`](crate::packet::Tracking). Reported
    /// servo positions are not masked.
    Tracking(u8),
    /// Type 1: the six fields of S packets.
    Statistics(StatisticsMask),
}

/// A mask of the six fields of S packets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StatisticsMask(u8);

impl StatisticsMask {
    /// All six fields, as after a reset.
    pub const ALL: Self = Self(0b11_1111);

    /// # Errors
    /// A bit above the sixth.
    pub const fn new(bits: u8) -> Result<Self, ArgumentError> {
        if bits > Self::ALL.0 {
            return Err(ArgumentError::Mask);
        }
        Ok(Self(bits))
    }

    /// The number as `OM 1` takes it: the first field in the lowest bit.
    pub const fn bits(self) -> u8 {
        self.0
    }
}

impl OutputMask {
    pub(super) const fn mode(self) -> Mode {
        match self {
            Self::Tracking(_) => Mode::TrackingMask,
            Self::Statistics(_) => Mode::StatisticsMask,
        }
    }

    pub(super) const fn numbers(self) -> [u8; 2] {
        match self {
            Self::Tracking(mask) => [0, mask],
            Self::Statistics(mask) => [1, mask.0],
        }
    }
}

/// Raw mode (`RM`): three bits.
///
/// The driver itself only ever uses [`RawMode::OFF`] and [`RawMode::OUTPUT`]. Without `ACK` and
/// `NCK` it could not tell acceptance from refusal, and a host that restarts while raw input is
/// on cannot talk to the camera any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RawMode(u8);

impl RawMode {
    /// All is text, as after a reset.
    pub const OFF: Self = Self(0);
    /// Binary packets, text otherwise.
    pub const OUTPUT: Self = Self(1);

    /// # Errors
    /// A bit above the third.
    pub const fn new(bits: u8) -> Result<Self, ArgumentError> {
        if bits > 7 {
            return Err(ArgumentError::Mask);
        }
        Ok(Self(bits))
    }

    /// The number as `RM` takes it.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Packets and values are binary.
    pub const fn output(self) -> bool {
        self.0 & 1 != 0
    }
}
