//! Colours and the bounds within which a pixel counts as the target.

use crate::argument::ArgumentError;

/// The lowest level a pixel has (thesis 3.2.2); bounds may be lower.
pub const LEVEL_MIN: u8 = 16;
/// The highest level a pixel has (thesis 3.2.2); bounds may be higher.
pub const LEVEL_MAX: u8 = 240;

/// One of the three colour channels. In YCrCb mode they carry Cr, Y and Cb.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ColourChannel {
    /// Channel 0; Cr in YCrCb mode.
    Red,
    /// Channel 1; Y in YCrCb mode.
    Green,
    /// Channel 2; Cb in YCrCb mode.
    Blue,
}

impl ColourChannel {
    /// The number that the camera gives this channel.
    pub const fn number(self) -> u8 {
        self as u8
    }
}

/// A colour as the camera measured it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Colour {
    /// Level of channel 0.
    pub red: u8,
    /// Level of channel 1.
    pub green: u8,
    /// Level of channel 2.
    pub blue: u8,
}

impl Colour {
    /// Of these levels.
    pub const fn new(red: u8, green: u8, blue: u8) -> Self {
        Self { red, green, blue }
    }

    /// The three channels by their numbers.
    pub const fn levels(self) -> [u8; 3] {
        [self.red, self.green, self.blue]
    }
}

/// The levels of one channel that count as the target: `min <= max`, 0 to 255 as the camera takes
/// them, although no pixel is below 16 or above 240.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LevelRange {
    min: u8,
    max: u8,
}

impl LevelRange {
    /// Every level that a pixel has: 16 to 240.
    pub const ALL: Self = Self {
        min: LEVEL_MIN,
        max: LEVEL_MAX,
    };

    /// # Errors
    /// `min` above `max`: cameras accept that, and then track pixels that are not known.
    pub const fn new(min: u8, max: u8) -> Result<Self, ArgumentError> {
        if min > max {
            return Err(ArgumentError::BoundsOrder);
        }
        Ok(Self { min, max })
    }

    /// `level - margin ..= level + margin`, cut to the levels there are.
    pub fn around(level: u8, margin: u8) -> Self {
        Self {
            min: level.saturating_sub(margin).clamp(LEVEL_MIN, LEVEL_MAX),
            max: level.saturating_add(margin).clamp(LEVEL_MIN, LEVEL_MAX),
        }
    }

    const fn widened(self, by: u8) -> Self {
        Self {
            min: self.min.saturating_sub(by),
            max: self.max.saturating_add(by),
        }
    }

    /// The lowest level that counts.
    pub const fn min(self) -> u8 {
        self.min
    }

    /// The highest level that counts.
    pub const fn max(self) -> u8 {
        self.max
    }
}

/// The box in colour space within which a pixel counts as the target (thesis 3.2.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ColourBounds {
    /// Levels of channel 0.
    pub red: LevelRange,
    /// Levels of channel 1.
    pub green: LevelRange,
    /// Levels of channel 2.
    pub blue: LevelRange,
}

impl ColourBounds {
    /// Every colour that a pixel has: 16 to 240 in each channel.
    pub const ALL: Self = Self {
        red: LevelRange::ALL,
        green: LevelRange::ALL,
        blue: LevelRange::ALL,
    };

    /// From `[Rmin, Rmax, Gmin, Gmax, Bmin, Bmax]`, the order of `TC` and `ST`.
    ///
    /// # Errors
    /// As [`LevelRange::new`].
    pub const fn new(values: [u8; 6]) -> Result<Self, ArgumentError> {
        let [red_min, red_max, green_min, green_max, blue_min, blue_max] = values;
        // `?` is not allowed in a const function.
        match (
            LevelRange::new(red_min, red_max),
            LevelRange::new(green_min, green_max),
            LevelRange::new(blue_min, blue_max),
        ) {
            (Ok(red), Ok(green), Ok(blue)) => Ok(Self { red, green, blue }),
            (Err(error), _, _) | (_, Err(error), _) | (_, _, Err(error)) => Err(error),
        }
    }

    /// `margin` levels to either side of a colour, cut to the levels there are.
    pub fn around(colour: Colour, margin: u8) -> Self {
        Self {
            red: LevelRange::around(colour.red, margin),
            green: LevelRange::around(colour.green, margin),
            blue: LevelRange::around(colour.blue, margin),
        }
    }

    /// So many levels more at both ends of each channel, as far as the camera takes them.
    #[must_use]
    pub const fn widened(self, by: u8) -> Self {
        Self {
            red: self.red.widened(by),
            green: self.green.widened(by),
            blue: self.blue.widened(by),
        }
    }

    /// `[Rmin, Rmax, Gmin, Gmax, Bmin, Bmax]`.
    pub const fn values(self) -> [u8; 6] {
        [
            self.red.min,
            self.red.max,
            self.green.min,
            self.green.max,
            self.blue.min,
            self.blue.max,
        ]
    }

    /// Returns true if a pixel of this colour counts.
    pub const fn contains(self, colour: Colour) -> bool {
        self.red.min <= colour.red
            && colour.red <= self.red.max
            && self.green.min <= colour.green
            && colour.green <= self.green.max
            && self.blue.min <= colour.blue
            && colour.blue <= self.blue.max
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn margins_are_cut_at_the_ends() {
        let bounds = ColourBounds::around(Colour::new(230, 100, 0), 30);
        assert_eq!(bounds.values(), [200, 240, 70, 130, 16, 30]);
        assert_eq!(bounds.widened(16).values(), [184, 255, 54, 146, 0, 46]);
    }
}
