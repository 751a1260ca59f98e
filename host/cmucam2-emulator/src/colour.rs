//! Levels, colours and the bounds within which a pixel is tracked.

/// The lowest level that a pixel has.
pub(super) const LEVEL_MIN: u8 = 16;
/// The highest level that a pixel has.
pub(super) const LEVEL_MAX: u8 = 240;

/// A pixel as the camera sends it: 16 to 240 in each channel; Cr, Y and Cb in YCrCb mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Colour {
    /// Channel 0.
    pub red: u8,
    /// Channel 1.
    pub green: u8,
    /// Channel 2.
    pub blue: u8,
}

impl Colour {
    /// The three channels by their numbers.
    pub fn levels(self) -> [u8; 3] {
        [self.red, self.green, self.blue]
    }
}

impl From<[u8; 3]> for Colour {
    fn from([red, green, blue]: [u8; 3]) -> Self {
        Self { red, green, blue }
    }
}

/// Bounds as they came over the wire, in the order of `TC`: any levels, in any order. Nothing lies
/// between a lower bound and an upper one below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Bounds(pub(super) [u8; 6]);

impl Bounds {
    /// Least and greatest level of each channel.
    pub(super) fn ranges(self) -> [(u8, u8); 3] {
        let [a, b, c, d, e, f] = self.0;
        [(a, b), (c, d), (e, f)]
    }

    /// So many levels to either side of a colour, within what pixels have.
    pub(super) fn around(colour: Colour, margin: u8) -> Self {
        let mut values = [0; 6];
        for (pair, level) in values
            .as_chunks_mut::<2>()
            .0
            .iter_mut()
            .zip(colour.levels())
        {
            pair[0] = level.saturating_sub(margin).clamp(LEVEL_MIN, LEVEL_MAX);
            pair[1] = level.saturating_add(margin).clamp(LEVEL_MIN, LEVEL_MAX);
        }
        Self(values)
    }

    pub(super) fn contains(self, colour: Colour) -> bool {
        self.ranges()
            .into_iter()
            .zip(colour.levels())
            .all(|((least, greatest), level)| least <= level && level <= greatest)
    }
}
