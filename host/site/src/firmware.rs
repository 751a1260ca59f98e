//! Parameters of the firmware, as a file has them.

use node_firmware::config::{CameraConfig, Sigmas, Subjects, TargetConfig};
use serde::{Deserialize, Serialize};

/// Most that a pixel may differ from a target's colour, levels: so far apart are light and shade on a ball.
pub(crate) const COLOUR_TOLERANCE: u8 = 45;
/// A pixel that has moved differs from the background by so many levels.
const MOTION_THRESHOLD: u8 = 12;

macro_rules! parameters {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:ty,)+) => {
        /// Configuration of nodes. A missing value has the firmware's default.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct FirmwareTable {
            $($(#[doc = $doc])+
            #[serde(skip_serializing_if = "Option::is_none")]
            pub $name: Option<$kind>,)+
        }

        impl FirmwareTable {
            /// A node's own parameters, or those of all nodes.
            #[must_use]
            pub fn over(self, all: Self) -> Self {
                Self { $($name: self.$name.or(all.$name),)+ }
            }
        }
    };
}

parameters! {
    /// Transmit power, dBm. Default 0.
    tx_power: i8,
    /// Security level of IEEE 802.15.4, 5 or 6. Default 6.
    protection: u8,
    /// Time after start-up in which any device with the site's key may join a coordinator, seconds.
    join_window_s: u16,
    /// Stops at which a camera wants to see the target. Default: [`Scenario::stops`](crate::Scenario::stops).
    stops: u8,
    /// Stops after which the reference solve is first tried. Default: as `stops`, at most 12.
    reference_stops: u8,
    /// Cameras go on refining their poses after these.
    refine: bool,
    /// It may become a reference where these are elected. Default true.
    may_be_elected: bool,
    /// A target of a colour is a ball.
    round: bool,
    /// Number of the first column in the camera's packets, 0 or 1.
    first_column: u8,
    /// A pose whose sigma of the position is larger is weak: another stop is asked for.
    weak_sigma: f64,
    /// The same of the heading, degrees.
    weak_heading_deg: f64,
    /// A pose needs no more stops when this sigma of the position, 0 for never, ...
    good_enough_position: f64,
    /// ... and this one of the heading, degrees, are reached.
    good_enough_heading_deg: f64,
    /// Standard deviation of a sighting that no frame shows, columns.
    sigma_floor_px: f64,
    /// Cameras look for what differs from the background instead of for a colour. Default false.
    motion: bool,
    /// By how many levels it must differ then. Default 12.
    motion_threshold: u8,
    /// Most that a pixel may differ from the target's colour, levels. Default 45.
    colour_tolerance: u8,
    /// A target stands when no step came for so long, milliseconds.
    still_after_ms: u32,
    /// Standard deviation of a step sensor's constant error of heading, degrees. Assumed if missing:
    /// the firmware's.
    systematic_heading_deg: f64,
    /// Standard deviation of a step sensor's constant error of distance, as a share of it. Assumed
    /// if missing: the firmware's.
    systematic_scale: f64,
    /// Distance that a target may stand off the place that it tells, standard deviation of each axis.
    standing_sigma: f64,
    /// Radius of the ball as the installer measured it, in the unit of the site; 0: not measured.
    ball_radius: f64,
    /// The least time of a stop, milliseconds.
    dwell_least_ms: u32,
    /// The most time of a stop, milliseconds.
    dwell_most_ms: u32,
    /// Excess that the compass of a board's step sensor reads on each axis, uT.
    hard_iron: [f64; 3],
    /// The carrier's step length at a swing of 1 m/s^2, in the unit of the site.
    step_length: f64,
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

    /// Puts the given values into a camera's configuration.
    pub(crate) fn configure_camera(&self, camera: &mut CameraConfig) {
        put(&mut camera.stops, self.stops);
        put(&mut camera.reference_stops, self.reference_stops);
        put(&mut camera.refine, self.refine);
        put(&mut camera.round, self.round);
        put(&mut camera.first_column, self.first_column);
        put_f32(&mut camera.weak.position, self.weak_sigma);
        put_f32(&mut camera.weak.heading_deg, self.weak_heading_deg);
        put_f32(&mut camera.sigma_floor_px, self.sigma_floor_px);
        let Sigmas {
            position,
            heading_deg,
        } = &mut camera.good_enough;
        // No camera reaches 0; a configuration has no such value.
        let never = f64::from(f32::MIN_POSITIVE);
        put_f32(position, self.good_enough_position.map(|s| s.max(never)));
        put_f32(
            heading_deg,
            self.good_enough_heading_deg.map(|s| s.max(never)),
        );
    }

    /// Puts the given values into a target's configuration.
    pub(crate) fn configure_target(&self, target: &mut TargetConfig) {
        put(&mut target.still_after_ms, self.still_after_ms);
        put_f32(
            &mut target.systematic_heading_deg,
            self.systematic_heading_deg,
        );
        put_f32(&mut target.systematic_scale, self.systematic_scale);
        put_f32(&mut target.standing_sigma, self.standing_sigma);
        put_f32(&mut target.ball_radius, self.ball_radius);
        put(&mut target.dwell_least_ms, self.dwell_least_ms);
        put(&mut target.dwell_most_ms, self.dwell_most_ms);
        let iron = self.hard_iron.map(|iron| iron.map(|axis| axis as f32));
        put(&mut target.sensor.hard_iron, iron);
        put_f32(&mut target.sensor.step_length, self.step_length);
    }
}

fn put<T>(parameter: &mut T, given: Option<T>) {
    if let Some(given) = given {
        *parameter = given;
    }
}

fn put_f32(parameter: &mut f32, given: Option<f64>) {
    put(parameter, given.map(|given| given as f32));
}
