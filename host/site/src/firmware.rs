//! Parameters of the firmware, as a file has them.

use node_firmware::config::{CameraConfig, Config, CoordinatorConfig, Subjects, TargetConfig};
use serde::{Deserialize, Serialize};
use zigbee_link::security::Protection;

use crate::keys::{
    Key,
    Kind::{Flag, Number, Numbers, Whole},
    Used::Nodes,
    Without::{Camera, Coordinator, Is, Target},
    limits::{LARGE, SHARE, SIGMA, SPREAD, STOPS},
};

/// Most that a pixel may differ from a target's colour, levels: so far apart are light and shade on a ball.
pub(crate) const COLOUR_TOLERANCE: u8 = 45;
/// A pixel that has moved differs from the background by so many levels.
const MOTION_THRESHOLD: u8 = 12;

/// Declares each parameter once: its name and type, the field of a node's configuration that it fills, its
/// values, its default, and its meaning.
macro_rules! parameters {
    ($($configure:ident: $config:ty {$(
        $name:ident: $type:ty $(=> $($field:ident).+)?, $kind:expr, $default:expr, $what:literal;
    )+})+) => {
        /// Configuration of nodes. A missing value has the firmware's default.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct FirmwareTable {
            $($(#[doc = $what]
            #[serde(skip_serializing_if = "Option::is_none")]
            pub $name: Option<$type>,)+)+
        }

        impl FirmwareTable {
            /// A node's own parameters, or those of all nodes.
            #[must_use]
            pub fn over(self, all: Self) -> Self {
                Self { $($($name: self.$name.or(all.$name),)+)+ }
            }

            $(/// Puts the given values into a configuration.
            pub(crate) fn $configure(&self, into: &mut $config) {
                $($(put(&mut into.$($field).+, self.$name);)?)+
            })+
        }

        /// The keys of `[firmware]`.
        pub(crate) const KEYS: &[Key] = &[$($(Key {
            path: concat!("firmware.", stringify!($name)),
            kind: $kind,
            default: $default,
            used: Nodes,
            what: $what,
        },)+)+];
    };
}

#[rustfmt::skip]
parameters! {
    configure_node: Config {
        tx_power: i8 => tx_power, Whole(-40.0, 20.0, " dBm"), Is("0"), "Transmit power.";
        protection: u8 => protection, Whole(5.0, 6.0, ": a security level of IEEE 802.15.4"), Is("6"), "How frames are secured: 5 with 32 bits of integrity, 6 with 64.";
        sleep: bool => sleeps, Flag, Is("false"), "Devices sleep while the network is quiet, and are woken within 2.1 s: for nodes on batteries. The same for all nodes.";
    }
    configure_coordinator: CoordinatorConfig {
        join_window_s: u16 => join_window_s, Whole(0.0, 600.0, " seconds"), Coordinator("join-window-s"), "Coordinator: how long any device with the site's key may join after start-up.";
    }
    configure_camera: CameraConfig {
        stops: u8 => stops, STOPS, Is("`stops` of the site"), "Camera: stops at which it wants to see the target.";
        reference_stops: u8 => reference_stops, Whole(2.0, 12.0, ": 3 or more unless baseline and compass are known"), Is("`stops` of the site, at most 12"), "Reference: stops after which it first solves.";
        refine: bool => refine, Flag, Camera("refine"), "Camera: goes on refining its pose after these.";
        good_enough_position: f64 => good_enough.position, SIGMA, Camera("good-enough.position"), "Camera: wants no more stops when the sigma of its position, 0 for never, ...";
        good_enough_heading_deg: f64 => good_enough.heading_deg, SPREAD, Camera("good-enough.heading-deg"), "... and that of its heading are within these.";
        weak_sigma: f64 => weak.position, SIGMA, Camera("weak.position"), "Camera: with a larger sigma of the position its pose is weak, and it asks for another stop; ...";
        weak_heading_deg: f64 => weak.heading_deg, SPREAD, Camera("weak.heading-deg"), "... so it is with a larger one of the heading.";
        sigma_floor_px: f64 => sigma_floor_px, Number(0.0, 10.0, " columns"), Camera("sigma-floor-px"), "Camera: standard deviation of a sighting that no frame shows.";
        first_column: u8 => first_column, Whole(0.0, 1.0, ""), Camera("first-column"), "Camera: number of the first column in its packets.";
        round: bool => round, Flag, Camera("round"), "Camera: targets are balls, so a blob that is narrower than tall is partly hidden.";
        may_be_elected: bool, Flag, Is("true"), "Camera: may become a reference where these are `elected`.";
        motion: bool, Flag, Is("false"), "Camera: looks for what differs from the background instead of for a colour. It learns the background while no target is in view, and sees targets that are brighter.";
        motion_threshold: u8, Whole(1.0, 224.0, " levels"), Is("12"), "Camera: by how much it must differ; 5 to 20 is usual.";
        colour_tolerance: u8, Whole(1.0, 120.0, " levels"), Is("45"), "Camera: how far from a target's colour a pixel may be.";
    }
    configure_target: TargetConfig {
        systematic_heading_deg: f64 => systematic_heading_deg, SPREAD, Target("systematic-heading-deg"), "Target: standard deviation of its step sensor's constant error of heading. Asked for.";
        systematic_scale: f64 => systematic_scale, SHARE, Target("systematic-scale"), "Target: standard deviation of its step sensor's constant error of distance, as a share of it. Asked for.";
        standing_sigma: f64 => standing_sigma, Number(0.0, 1000.0, " in the unit of the site"), Is("2 cm"), "Target: how still it stands, and how far from where it says; each axis.";
        ball_radius: f64 => ball_radius, Number(0.0, 1000.0, " in the unit of the site"), Target("ball-radius"), "Target: radius of the ball that cameras see, as measured; 0: not known. How wide it is in a picture then tells its range.";
        still_after_ms: u32 => still_after_ms, Whole(100.0, 60_000.0, " milliseconds"), Target("still-after-ms"), "Target: stands when no step came for so long.";
        dwell_least_ms: u32 => dwell_least_ms, Whole(0.0, 3.6e6, " milliseconds, at most `dwell_most_ms`"), Target("dwell-least-ms"), "Target: the least time of a stop.";
        dwell_most_ms: u32 => dwell_most_ms, Whole(0.0, 3.6e6, " milliseconds"), Target("dwell-most-ms"), "Target: the most time of a stop, even if cameras have not answered.";
        hard_iron: [f64; 3] => sensor.hard_iron, Numbers(3, -400.0, 400.0, " uT"), Target("sensor.hard-iron"), "Target: what the compass of its board reads too much on each axis. A board needs it.";
        step_length: f64 => sensor.step_length, Number(1e-4, LARGE, " in the unit of the site"), Target("sensor.step-length"), "Target: its carrier's step length at a swing of 1 m/s^2, on a board. Asked for where the unit is not the metre.";
    }
}

impl FirmwareTable {
    /// Levels from a target's colour to the border of its window.
    pub(crate) fn colour_tolerance(&self) -> u8 {
        self.colour_tolerance.unwrap_or(COLOUR_TOLERANCE)
    }

    /// Radius of the targets' balls; 0: not known.
    pub fn ball_radius(&self) -> f32 {
        self.ball_radius.unwrap_or_default() as f32
    }

    /// Subjects of cameras that look for what moves.
    pub(crate) fn motion(&self) -> Option<Subjects> {
        let threshold = self.motion_threshold.unwrap_or(MOTION_THRESHOLD);
        (self.motion == Some(true)).then_some(Subjects::Motion { threshold })
    }
}

/// A value of a file, for a field of a configuration.
trait Given<T> {
    fn give(self) -> T;
}

impl<T> Given<T> for T {
    fn give(self) -> T {
        self
    }
}

impl Given<f32> for f64 {
    fn give(self) -> f32 {
        self as f32
    }
}

impl Given<[f32; 3]> for [f64; 3] {
    fn give(self) -> [f32; 3] {
        self.map(|axis| axis as f32)
    }
}

impl Given<Protection> for u8 {
    fn give(self) -> Protection {
        match self {
            5 => Protection::EncMic32,
            _ => Protection::EncMic64,
        }
    }
}

fn put<T>(parameter: &mut T, given: Option<impl Given<T>>) {
    if let Some(given) = given {
        *parameter = given.give();
    }
}
