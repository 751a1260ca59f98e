//! Steps, lamps and buttons as messages on a line, for boards that have none of their own.
//!
//! The line is lossless: a socket or a pipe of an emulator. There is no check sequence and nothing
//! is repeated. Each message is a postcard-encoded enum in a COBS frame: no byte is 0, and a 0
//! follows. What does not decode is dropped up to the next 0.
//!
//! | to the node | bytes before COBS |
//! |---|---|
//! | [`ToNode::Step`] | 0, then distance, heading and their sigmas: four f32, little-endian |
//! | [`ToNode::JoinWindow`], [`ToNode::LearnColour`] | 1, 2 |
//!
//! | from the node | bytes before COBS |
//! |---|---|
//! | [`FromNode`] | 0, then one byte each, 0 or 1: joined, target seen, calibrated, may walk |

use calib_core::dead_reckoning::Step;
use node_firmware::hardware::{Button, Indication};
use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Bytes of the longest frame, with its 0.
pub const FRAME_MAX: usize = 19;

/// How often a node tells its lamps, changed or not, milliseconds.
pub const PERIOD_MS: u32 = 1_000;

/// What happens to a node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToNode {
    /// The target makes a step.
    Step(Step<f32>),
    /// The button is pressed that lets devices join for a while.
    JoinWindow,
    /// The button is pressed that makes the camera learn a colour.
    LearnColour,
}

impl From<Button> for ToNode {
    fn from(button: Button) -> Self {
        match button {
            Button::JoinWindow => Self::JoinWindow,
            Button::LearnColour => Self::LearnColour,
        }
    }
}

/// What a node shows. Sent whenever it changes, and every [`PERIOD_MS`]: who hears nothing for much
/// longer knows that the board stalls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FromNode {
    /// Its lamps.
    Lamps {
        /// It belongs to a network.
        joined: bool,
        /// The target was seen at its last stop.
        target_seen: bool,
        /// It knows its pose, or its place.
        calibrated: bool,
        /// The target may walk on.
        may_walk: bool,
    },
}

impl From<Indication> for FromNode {
    fn from(indication: Indication) -> Self {
        Self::Lamps {
            joined: indication.joined,
            target_seen: indication.target_seen,
            calibrated: indication.calibrated,
            may_walk: indication.may_walk,
        }
    }
}

/// A message as a frame, at the start of the buffer.
pub fn frame<'a, T: Serialize>(message: &T, buffer: &'a mut [u8; FRAME_MAX]) -> &'a [u8] {
    // Every message of this module fits.
    postcard::to_slice_cobs(message, buffer).map_or(&[], |frame| frame)
}

/// Bytes to messages.
#[derive(Clone, Debug)]
pub struct Deframer {
    bytes: [u8; FRAME_MAX],
    /// Above [`FRAME_MAX`] for a frame that is too long.
    len: usize,
}

impl Deframer {
    /// Before the first byte.
    pub const fn new() -> Self {
        Self {
            bytes: [0; FRAME_MAX],
            len: 0,
        }
    }

    /// The message that ends with this byte, if one does.
    pub fn push<T: DeserializeOwned>(&mut self, byte: u8) -> Option<T> {
        match self.bytes.get_mut(self.len) {
            Some(place) => *place = byte,
            None if byte == 0 => {
                self.len = 0;
                return None;
            }
            None => return None,
        }
        self.len += 1;
        if byte != 0 {
            return None;
        }
        let frame = self.bytes.get_mut(..self.len)?;
        self.len = 0;
        postcard::from_bytes_cobs(frame).ok()
    }
}

impl Default for Deframer {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    const STEP: ToNode = ToNode::Step(Step {
        distance: 0.5,
        heading: -1.0,
        distance_sigma: 0.0,
        heading_sigma: 2.0,
    });
    const LAMPS: FromNode = FromNode::Lamps {
        joined: true,
        target_seen: false,
        calibrated: false,
        may_walk: true,
    };

    fn messages<T: DeserializeOwned>(bytes: impl IntoIterator<Item = u8>) -> Vec<T> {
        let mut deframer = Deframer::new();
        let message = |byte| deframer.push(byte);
        bytes.into_iter().filter_map(message).collect()
    }

    #[test]
    fn golden_bytes() {
        let mut buffer = [0; FRAME_MAX];
        // Written out by the rules of COBS: each count leads to the next zero.
        let step = [
            1, 1, 1, 1, 2, 0x3f, 1, 3, 0x80, 0xbf, 1, 1, 1, 1, 1, 1, 2, 0x40, 0,
        ];
        assert_eq!(frame(&STEP, &mut buffer), step);
        assert_eq!(messages::<ToNode>(step), [STEP]);
        assert_eq!(frame(&ToNode::JoinWindow, &mut buffer), [2, 1, 0]);
        assert_eq!(frame(&ToNode::LearnColour, &mut buffer), [2, 2, 0]);
        assert_eq!(frame(&LAMPS, &mut buffer), [1, 2, 1, 1, 2, 1, 0]);
    }

    #[test]
    fn frames_come_back_in_pieces_and_after_garbage() {
        let mut buffer = [0; FRAME_MAX];
        let mut line = std::vec![7; 1000];
        line.push(0);
        for message in [STEP, ToNode::LearnColour, STEP] {
            line.extend(frame(&message, &mut buffer));
        }
        assert_eq!(messages::<ToNode>(line), [STEP, ToNode::LearnColour, STEP]);
    }

    proptest! {
        #[test]
        fn a_message_follows_anything(garbage: Vec<u8>) {
            let mut buffer = [0; FRAME_MAX];
            let mut line = garbage;
            line.push(0);
            line.extend(frame(&STEP, &mut buffer));
            let messages = messages::<ToNode>(line);
            prop_assert_eq!(messages.last(), Some(&STEP));
        }
    }
}
