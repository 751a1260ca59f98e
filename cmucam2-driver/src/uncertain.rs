//! Points that the public sources of the protocol leave open, and the decisions of this driver.
//!
//! The original user guide could not be consulted. This table lists every point on which drivers, forum
//! quotations and CMU's CMUcam2-compatible program for the CMUcam3 are silent or disagree. A function of this
//! module decides the points that can be decided by one. All variants are accepted, and each has a test.
//!
//! | open | accepted |
//! |---|---|
//! | whether a space follows ACK, NCK and the last number of a line, and a line feed the carriage return | both |
//! | whether `RS` sends a blank line before the banner | both; blank lines mean nothing |
//! | whether `GV` sends a carriage return before the prompt | both; a banner is complete with its module number |
//! | the sensors that `c6` and `c7` name | [`sensor_of_module`] |
//! | the order of the six numbers of `GT` | [`bounds_from_reply`] |
//! | whether coordinates begin at 0 or 1, and whether they are relative to the window | both, see [`last_coordinate`] |
//! | whether a separator 02 leads the first row of a frame, whether one precedes its end, and whether there is any | all; rows are counted |
//! | whether `TW` sends an S packet before its first T packet | both; its mean is used if it comes |
//! | whether `GH` sends one packet or a stream | both; a stream is stopped after the first packet |
//! | whether an empty packet begins a stream under packet filter | both; silence is no error until a target was seen |
//! | whether stopping a stream answers `:` or `ACK` and `:` | both |
//! | whether the camera can be stopped within a frame | both; the rest of the frame is drained |
//! | whether the prompt follows `ACK` before sleep | both |
//! | whether `UD` answers `ACK` before or after its 64 bytes | both |
//! | the number of histogram bins that `HC` selects | 1 to 28 once it was sent, 28 before |
//! | whether `LM 1` tells the row count after `FE` | both, see [`means_are_counted`]; a first image may be lost |
//! | raw S packets, H packets and values | as raw T packets: 255, letter and bytes; for values no letter |

use crate::{
    colour::ColourBounds,
    geometry::{Sensor, Size},
};

/// The sensor that the module number of a banner names: `c6` is the OV6620, `c7` the OV7620. No
/// source says so; the numbers are those of the parts.
pub const fn sensor_of_module(module: u8) -> Option<Sensor> {
    match module {
        6 => Some(Sensor::Ov6620),
        7 => Some(Sensor::Ov7620),
        _ => None,
    }
}

/// Returns true if the first byte of the means of rows is their number, and not a level. `known`: as shown by
/// the length of the image before. Before that, the height of the frame is taken for itself.
pub const fn means_are_counted(first: u8, frame: Size, known: Option<bool>) -> bool {
    match known {
        Some(known) => known,
        None if frame.height == Size::LARGEST.height => matches!(first, 143 | 239 | 255),
        None => first == frame.height,
    }
}

/// The greatest coordinates that a packet may carry: those of a frame whose first column and row
/// are number 1. Coordinates from 0 stay below. Coordinates relative to a window are smaller than
/// those of the frame, so the whole frame is allowed in any case.
pub const fn last_coordinate(frame: Size) -> Size {
    frame
}

/// The bounds that `GT` answers. Commands take them in pairs (`Rmin Rmax Gmin Gmax Bmin Bmax`),
/// the CMUcam3's program answers first all lower and then all upper ones.
///
/// Only one order usually gives lower bounds below upper ones. If both do, the one that equals
/// the bounds that were set last counts, or else the one that spans less: bounds of one target
/// are narrow. `None` if neither order makes sense.
pub fn bounds_from_reply(values: [u8; 6], known: Option<ColourBounds>) -> Option<ColourBounds> {
    let [a, b, c, d, e, f] = values;
    let pairs = ColourBounds::new([a, b, c, d, e, f]).ok();
    let lower_first = ColourBounds::new([a, d, b, e, c, f]).ok();
    let (Some(pairs), Some(lower_first)) = (pairs, lower_first) else {
        return pairs.or(lower_first);
    };
    if known == Some(lower_first) {
        return known;
    }
    if known == Some(pairs) || span(pairs) <= span(lower_first) {
        return Some(pairs);
    }
    Some(lower_first)
}

/// The greatest extent of the box along a channel.
fn span(bounds: ColourBounds) -> u8 {
    [bounds.red, bounds.green, bounds.blue]
        .into_iter()
        .map(|range| range.max() - range.min())
        .fold(0, u8::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::Colour;

    /// Both orders of the same bounds give the same bounds, for every colour of a coarse grid
    /// whose margin is the 30 that TW uses.
    #[test]
    fn either_order_of_bounds_is_understood() {
        let levels = (16..=240).step_by(14);
        for red in levels.clone() {
            for green in levels.clone() {
                for blue in levels.clone() {
                    let colour = Colour { red, green, blue };
                    let bounds = ColourBounds::around(colour, 30);
                    let [a, b, c, d, e, f] = bounds.values();
                    for reply in [[a, b, c, d, e, f], [a, c, e, b, d, f]] {
                        assert_eq!(bounds_from_reply(reply, Some(bounds)), Some(bounds));
                    }
                }
            }
        }
    }

    #[test]
    fn bounds_that_are_not_known_are_told_by_their_order_or_width() {
        let learnt = Some(ColourBounds::new([170, 230, 70, 130, 16, 46]).unwrap());
        assert_eq!(bounds_from_reply([170, 230, 70, 130, 16, 46], None), learnt);
        assert_eq!(bounds_from_reply([170, 70, 16, 230, 130, 46], None), learnt);
        let blue = Some(ColourBounds::new([16, 76, 80, 140, 180, 240]).unwrap());
        assert_eq!(bounds_from_reply([16, 76, 80, 140, 180, 240], None), blue);
        assert_eq!(bounds_from_reply([16, 80, 180, 76, 140, 240], None), blue);
        assert_eq!(bounds_from_reply([240, 16, 0, 3, 2, 1], None), None);
    }

    #[test]
    fn modules() {
        assert_eq!(sensor_of_module(6), Some(Sensor::Ov6620));
        assert_eq!(sensor_of_module(7), Some(Sensor::Ov7620));
        assert_eq!(sensor_of_module(3), None);
    }
}
