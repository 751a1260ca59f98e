//! Frame sizes, windows and down-sampling.

use crate::argument::ArgumentError;

/// The image sensor on the camera board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sensor {
    /// Camera type 0: 88 x 143, or 176 x 255 in high resolution.
    Ov6620,
    /// Camera type 1: 160 x 239.
    Ov7620,
}

/// Columns and rows of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Size {
    /// Columns, 1 to 176.
    pub width: u8,
    /// Rows, 1 to 255.
    pub height: u8,
}

impl Size {
    /// So many columns and rows.
    pub const fn new(width: u8, height: u8) -> Self {
        Self { width, height }
    }

    /// Larger than any frame of a camera whose sensor is not known.
    pub const LARGEST: Self = Self::new(176, 255);

    /// The frame of a sensor. Only the OV6620 has a high resolution.
    pub const fn of(sensor: Sensor, high_resolution: bool) -> Self {
        match (sensor, high_resolution) {
            (Sensor::Ov6620, false) => Self::new(88, 143),
            (Sensor::Ov6620, true) => Self::LARGEST,
            (Sensor::Ov7620, _) => Self::new(160, 239),
        }
    }
}

/// Distance between two columns that count, and between two rows. Tracking and frames then count in these
/// units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DownSampling {
    x: u8,
    y: u8,
}

impl DownSampling {
    /// Every column and row.
    pub const NONE: Self = Self { x: 1, y: 1 };

    /// # Errors
    /// A factor of zero.
    pub const fn new(x: u8, y: u8) -> Result<Self, ArgumentError> {
        if x == 0 || y == 0 {
            return Err(ArgumentError::DownSampling);
        }
        Ok(Self { x, y })
    }

    /// Distance between two columns that count.
    pub const fn x(self) -> u8 {
        self.x
    }

    /// Distance between two rows that count.
    pub const fn y(self) -> u8 {
        self.y
    }

    /// The rest of a frame, rounded up.
    pub const fn apply(self, size: Size) -> Size {
        Size {
            width: divide_up(size.width, self.x),
            height: divide_up(size.height, self.y),
        }
    }
}

/// Rounded up. No factor is zero, and no branch to a panic is left where the compiler does not know that.
const fn divide_up(length: u8, factor: u8) -> u8 {
    match factor {
        0 => length,
        _ => length.div_ceil(factor),
    }
}

/// The part of the frame that is processed: two corners, both inside.
///
/// The camera cuts a window that reaches beyond the frame; the size of the frame depends on sensor,
/// resolution and down-sampling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Window {
    x: u8,
    y: u8,
    x2: u8,
    y2: u8,
}

impl Window {
    /// From the upper left corner `(x, y)` to the lower right one `(x2, y2)`.
    ///
    /// # Errors
    /// The first corner is not above and left of the second, or equal to it.
    pub const fn new(x: u8, y: u8, x2: u8, y2: u8) -> Result<Self, ArgumentError> {
        if x > x2 || y > y2 {
            return Err(ArgumentError::WindowOrder);
        }
        Ok(Self { x, y, x2, y2 })
    }

    /// `[x, y, x2, y2]`, the order of `VW` and `GW`.
    pub const fn corners(self) -> [u8; 4] {
        [self.x, self.y, self.x2, self.y2]
    }

    /// The window of half the width and half the height in the middle of a frame.
    pub const fn central(size: Size) -> Self {
        let (quarter_width, quarter_height) = (size.width / 4, size.height / 4);
        Self {
            x: quarter_width,
            y: quarter_height,
            x2: size.width - quarter_width,
            y2: size.height - quarter_height,
        }
    }
}
