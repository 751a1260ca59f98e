//! Share of the background that has the colour of an object that was just learnt.
//!
//! Every pixel of the colour counts for the box of a blob. So another thing of that colour in view moves the
//! edges, and with them the direction. Two looks tell it while the object is still in the middle:
//! - Where all pixels of the colour are in one box that they fill, as a ball fills its box by pi / 4,
//!   and that is no wall, nothing else has the colour.
//! - Otherwise the pixels along the four borders of the view are counted, an eighth of it on each side:
//!   an object whose colour is learnt fills the middle half.

use core::fmt;

use cmucam2_driver::{
    geometry::{Size, Window},
    packet::Tracking,
};
use serde::{Deserialize, Serialize};

/// A colour that so much of the background has is not looked for, thousandths. A ball a tenth as wide as the
/// view covers 1 %: from there on most of the tracked pixels are background.
const HOPELESS: u16 = 10;

/// Least share of its box that an object fills, 256 times the share. A ball fills 201.
pub(super) const COMPACT: u8 = 160;

/// The part of the background that has a colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BackgroundShare {
    /// Thousandths, 0 to 1000; a share above nothing is at least 1.
    pub thousandths: u16,
}

impl BackgroundShare {
    /// Nothing has it.
    pub const NONE: Self = Self { thousandths: 0 };

    /// So many pixels of so many.
    pub fn new(pixels: u32, of: u32) -> Self {
        let share = pixels.saturating_mul(1_000).div_ceil(of.max(1)).min(1_000);
        Self {
            thousandths: share as u16,
        }
    }

    /// Returns true if an object of this colour cannot be told from its background.
    pub const fn is_hopeless(self) -> bool {
        self.thousandths >= HOPELESS
    }
}

/// In percent.
impl fmt::Display for BackgroundShare {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (whole, tenth) = (self.thousandths / 10, self.thousandths % 10);
        write!(f, "{whole}.{tenth} %")
    }
}

/// Pixels of the colour in the part of the view that was looked at, from a T packet: that tells eighths up to
/// 2,040, and beyond that the share of the box that they fill.
pub fn pixels(seen: &Tracking) -> u32 {
    let (Some(eighths), Some(filled)) = (seen.pixels(), seen.confidence()) else {
        return 0;
    };
    if seen.is_lost() {
        0
    } else if eighths < u8::MAX {
        (u32::from(eighths) * 8).max(1)
    } else {
        box_area(seen) * (u32::from(filled) + 1) / 256
    }
}

fn box_area(seen: &Tracking) -> u32 {
    seen.bounding_box().map_or(0, |found| {
        let side = |from: u8, to: u8| u32::from(to.saturating_sub(from)) + 1;
        side(found.x1, found.x2) * side(found.y1, found.y2)
    })
}

fn area(frame: Size) -> u32 {
    u32::from(frame.width) * u32::from(frame.height)
}

/// Returns true if all pixels of the colour in the view are one object, and none is background.
pub fn is_one_object(seen: &Tracking, frame: Size) -> bool {
    seen.is_lost()
        || seen.confidence().is_some_and(|filled| filled >= COMPACT)
            && 2 * box_area(seen) < area(frame)
}

/// Number of [parts](part) of a view.
pub const PARTS: u8 = 5;

/// A part of a view whose first column and row have the number `first`. Parts 0 to 3 are its outer eighths: left,
/// right, above and below; the last one is its middle.
pub fn part(frame: Size, first: u8, part: u8) -> Option<Window> {
    let Size { width, height } = frame;
    let (across, down) = (width / 8, height / 8);
    let (right, low) = (width - across, height - down);
    // From here to before there, counted from 0.
    let [x, y, x2, y2] = match part {
        0 => [0, 0, across, height],
        1 => [right, 0, width, height],
        2 => [across, 0, right, down],
        3 => [across, low, right, height],
        _ => [across, down, right, low],
    };
    let last = |end: u8| end.saturating_sub(1).saturating_add(first);
    let [x, y] = [x, y].map(|from| from.saturating_add(first));
    Window::new(x, y, last(x2), last(y2)).ok()
}

/// Pixels of the outer [parts](part).
pub fn surrounding_pixels(frame: Size) -> u32 {
    let inner = |side: u8| u32::from(side - side / 8 * 2);
    area(frame) - inner(frame.width) * inner(frame.height)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    const FRAME: Size = Size {
        width: 88,
        height: 143,
    };

    /// Every pixel is in the middle or in one of the four, and in no two.
    #[test]
    fn surroundings_are_all_but_the_middle() {
        for (width, height) in [(88, 143), (87, 143), (176, 255), (160, 239)] {
            let frame = Size { width, height };
            for first in [0, 1] {
                let [windows @ .., middle] =
                    [0, 1, 2, 3, 4].map(|n| part(frame, first, n).unwrap());
                let within = |x: u8, y: u8| {
                    let has = |window: &&Window| {
                        let [x1, y1, x2, y2] = window.corners();
                        (x1..=x2).contains(&x) && (y1..=y2).contains(&y)
                    };
                    windows.iter().filter(has).count()
                };
                let last = |side: u8| side - 1 + first;
                let mut count = 0;
                for x in first..=last(width) {
                    for y in first..=last(height) {
                        let times = within(x, y);
                        assert!(times <= 1, "{x} {y}: {times}");
                        count += times as u32;
                    }
                }
                assert_eq!(count, surrounding_pixels(frame));
                let [x1, y1, x2, y2] = middle.corners();
                let inner = u32::from(x2 - x1 + 1) * u32::from(y2 - y1 + 1);
                assert_eq!(count + inner, area(frame));
                assert_eq!(within(x1, y1) + within(x2, y2), 0);
                assert_eq!(within(width / 2, height / 2), 0);
            }
        }
    }

    /// `min(255, (n + 4) / 8)` and `min(255, 256 n / area)` are the numbers that are told for n pixels.
    #[test]
    fn pixels_are_those_that_were_counted() {
        for n in [1_u32, 3, 4, 100, 1_000, 2_000, 3_000, 6_000, 12_584] {
            let told = [
                ((n + 4) / 8).min(255) as u8,
                (256 * n / (88 * 143)).min(255) as u8,
            ];
            let seen = Tracking::new([44, 70, 1, 1, 88, 143, told[0], told[1]]);
            let found = pixels(&seen);
            // Eighths, or 256ths of the box.
            let coarse = if n < 2_036 { 4 } else { 50 };
            assert!(found.abs_diff(n) <= coarse, "{found} for {n}");
        }
        assert_eq!(pixels(&Tracking::LOST), 0);
    }

    #[test]
    fn one_object_is_compact_and_no_wall() {
        let seen = |numbers| is_one_object(&Tracking::new(numbers), FRAME);
        assert!(seen([44, 70, 34, 52, 53, 91, 78, 200]), "a ball");
        assert!(!seen([50, 70, 34, 52, 88, 91, 90, 90]), "a ball and a book");
        assert!(!seen([44, 72, 1, 1, 88, 143, 255, 255]), "a wall");
        assert!(is_one_object(&Tracking::LOST, FRAME));
    }

    #[test]
    fn shares() {
        let share = |pixels, of| BackgroundShare::new(pixels, of);
        assert_eq!(share(0, 9_000), BackgroundShare::NONE);
        assert_eq!(share(1, 9_000).to_string(), "0.1 %");
        assert_eq!(share(4_000, 9_000).to_string(), "44.5 %");
        assert_eq!(share(9_001, 9_000).to_string(), "100.0 %");
        assert!(!share(80, 9_000).is_hopeless() && share(90, 9_000).is_hopeless());
        assert_eq!(share(7, 0).thousandths, 1_000);
    }
}
