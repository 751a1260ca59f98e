//! Numbers that configuration, messages, facts, roles and console share.
//!
//! A number of only one format stands with it: bytes of a configuration page, of a fact, of a frame of the
//! console.

use core::ops::RangeInclusive;

/// Most members of a network, coordinator not counted. So long are its allow-list, and every table
/// of members.
pub const MEMBERS: usize = 100;

/// Most cameras that one message lists: more would not fit a frame.
pub const ROSTER: usize = 32;

/// Most targets that a camera knows at a time. The one heard least recently makes room.
pub const TARGETS: usize = 4;

/// Most target colours that a camera can tell apart.
pub const COLOURS_MAX: usize = 4;

/// Most sightings that a camera keeps.
pub const SIGHTINGS: usize = 16;

/// Most stops that a reference camera keeps until it is calibrated.
pub const REFERENCE_STOPS: usize = 12;

/// Most stops of a walk that are written down: the flash has so many places for them.
pub const WALK_STOPS: usize = 100;

/// Most stops that a target estimates together. The kept part of their equations grows with the square: 82 KB
/// for 100 stops, 25 KB for 52.
pub const ESTIMATED_STOPS: usize = if cfg!(feature = "long-walks") {
    100
} else {
    52
};

const _: () = assert!(ESTIMATED_STOPS <= WALK_STOPS, "each is written down");

/// Most bearings that a target keeps of its walk.
pub const WALK_BEARINGS: usize = 384;

/// Stops at which a camera may want to see the target: a pose needs three.
pub const STOPS_WANTED: RangeInclusive<u8> = 3..=SIGHTINGS as u8;

/// Bits per second of the line between a coordinator and its PC.
pub const CONSOLE_BAUD: u32 = 115_200;
