//! Kinds of values that several keys have.

use super::Kind::{self, Levels, Number, Whole};
use crate::FIRST_COORDINATOR;

/// The longest length and the like: far from where f32 on the nodes loses digits.
pub(crate) const LARGE: f64 = 1e5;
/// As short as any length may be.
pub(crate) const SMALL: f64 = 1e-3;

pub(crate) const STOPS: Kind = Whole(
    3.0,
    16.0,
    ": a pose needs three sightings, and a camera keeps 16",
);
pub(crate) const LENGTH: Kind = Number(SMALL, LARGE, " in the unit of the site");
pub(crate) const COORDINATE: Kind = Number(-LARGE, LARGE, " in the unit of the site");
pub(crate) const SIGMA: Kind = Number(0.0, LARGE, " in the unit of the site");
pub(crate) const DIRECTION: Kind = Number(-360.0, 360.0, " degrees");
pub(crate) const SPREAD: Kind = Number(0.0, 180.0, " degrees");
pub(crate) const SHARE: Kind = Number(0.0, 1.0, "");
pub(crate) const SECONDS: Kind = Number(0.0, 1e7, " seconds");
pub(crate) const DURATION: Kind = Number(1e-3, 1e7, " seconds");
pub(crate) const CHANNEL: Kind = Whole(11.0, 26.0, ": a channel of the 2.4 GHz band");
pub(crate) const NODE: Kind = Whole(
    1.0,
    FIRST_COORDINATOR as f64 - 1.0,
    ": larger numbers are those of coordinators",
);
/// Of events: 0 is a coordinator.
pub(crate) const ANY_NODE: Kind = Whole(
    0.0,
    FIRST_COORDINATOR as f64 - 1.0,
    ": the `id` of a camera or a target, or 0 for the first network's coordinator",
);
pub(crate) const LEVEL: Kind = Levels(2, 0.0, 255.0, ": the lowest level and the highest one");
