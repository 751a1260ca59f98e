//! Numbers that configuration, messages, facts, roles and console share.
//!
//! A number of only one format stands with it: bytes of a configuration page, of a fact, of a frame of the
//! console.
//!
//! Tables of members, cameras and stops have usual sizes. The environment variables `NODE_MEMBERS`, `NODE_CAMERAS` and
//! `NODE_STOPS` make them shorter when the firmware is built, for a small network, or longer where the RAM allows. Pages,
//! messages and memory have the same format at all sizes.

use core::ops::RangeInclusive;

/// A number that an environment variable set when this was compiled, or the usual one.
const fn set(text: Option<&str>, allowed: RangeInclusive<usize>, usual: usize) -> usize {
    let Some(text) = text else { return usual };
    let (number, is_number) = match usize::from_str_radix(text, 10) {
        Ok(number) => (number, true),
        Err(_) => (0, false),
    };
    assert!(is_number, "a size of a table is no number");
    let is_allowed = *allowed.start() <= number && number <= *allowed.end();
    assert!(is_allowed, "a size of a table is out of its range");
    number
}

/// Most members that any network may have: so many places has the memory of a node.
pub const MEMBERS_MOST: usize = 100;

/// Most members of a network, coordinator not counted. So long are its allow-list, and every table
/// of members. `NODE_MEMBERS` makes them fewer.
pub const MEMBERS: usize = set(option_env!("NODE_MEMBERS"), 2..=MEMBERS_MOST, MEMBERS_MOST);

/// Most cameras of a network that take part in the estimate of its target; further ones find their poses from their own
/// sightings. `NODE_CAMERAS` makes them fewer, or more where the RAM allows.
pub const ESTIMATED_CAMERAS: usize = set(option_env!("NODE_CAMERAS"), 3..=MEMBERS_MOST, 24);

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
/// for 100 stops, 25 KB for 52. `NODE_STOPS` makes them fewer, or more where the RAM allows.
pub const ESTIMATED_STOPS: usize = {
    let usual = if cfg!(feature = "long-walks") {
        100
    } else {
        52
    };
    // Each is written down.
    set(option_env!("NODE_STOPS"), 12..=WALK_STOPS, usual)
};

/// Most bearings that a target keeps of its walk.
pub const WALK_BEARINGS: usize = 384;

/// Stops at which a camera may want to see the target: a pose needs three.
pub const STOPS_WANTED: RangeInclusive<u8> = 3..=SIGHTINGS as u8;

/// Bits per second of the line between a coordinator and its PC.
pub const CONSOLE_BAUD: u32 = 115_200;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_is_the_usual_one_unless_it_is_set() {
        assert_eq!(set(None, 2..=100, 100), 100);
        for number in [2, 8, 100] {
            assert_eq!(set(Some(&std::format!("{number}")), 2..=100, 100), number);
        }
    }

    #[test]
    #[should_panic(expected = "out of its range")]
    fn a_size_that_is_too_large_does_not_compile() {
        set(Some("101"), 2..=100, 100);
    }

    #[test]
    #[should_panic(expected = "no number")]
    fn a_size_that_is_no_number_does_not_compile() {
        set(Some("many"), 2..=100, 100);
    }
}
