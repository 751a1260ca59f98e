//! A scenario as its file has it.

use std::collections::BTreeMap;

use calib_core::camera::Projection;
use serde::{Deserialize, Serialize};

use super::{event::ScriptedEvent, planner::Placement};
use crate::world::Variant;
use cmucam2_emulator::Rgb;

/// A scenario. Every table but `network` (or `grid`) may be missing; what is missing has its
/// default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// What it is called.
    pub name: String,
    /// What it is.
    #[serde(default)]
    pub about: String,
    /// The seed of every random number. Default 1.
    #[serde(default = "one")]
    pub seed: u64,
    /// Which of the planned ways targets take, from 1. Default 1.
    #[serde(default = "one")]
    pub path: u64,
    /// Stops that are planned in view of each camera, 3 to 16. Default 3.
    #[serde(default = "three")]
    pub stops: usize,
    /// How these are chosen: `planned` (default) or `anywhere`.
    #[serde(default)]
    pub placement: Placement,
    /// Name of the unit of length. Default `units`.
    #[serde(default = "units")]
    pub unit: String,
    /// How long it is, for the radio medium `log-distance` and for exports in metres. Default 1,
    /// only for `units` and `metres`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit_metres: Option<f64>,
    /// How far cameras stand from where this file has them.
    #[serde(default, skip_serializing_if = "ScatterTable::is_none")]
    pub scatter: ScatterTable,
    /// Which of the thesis's results stand beside this site's: `thesis-4.1` (the simulation's, by
    /// path) or `thesis-3.1` (the laboratory's). Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<String>,
    /// The place.
    #[serde(default)]
    pub world: WorldTable,
    /// All cameras, unless one says otherwise.
    #[serde(default)]
    pub camera: CameraTable,
    /// How targets walk.
    #[serde(default)]
    pub walk: WalkTable,
    /// How step sensors err.
    #[serde(default)]
    pub sensor: SensorTable,
    /// The radio medium.
    #[serde(default)]
    pub radio: RadioTable,
    /// What the nodes are configured to.
    #[serde(default)]
    pub firmware: FirmwareTable,
    /// The networks.
    #[serde(default, rename = "network", skip_serializing_if = "Vec::is_empty")]
    pub networks: Vec<NetworkTable>,
    /// Networks to be made, in place of `network`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid: Option<GridTable>,
    /// What happens by order of a script.
    #[serde(default, rename = "event", skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<ScriptedEvent>,
}

fn one() -> u64 {
    1
}

fn three() -> usize {
    3
}

fn units() -> String {
    "units".into()
}

/// The place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WorldTable {
    /// Its lowest corner. Default (-2, -2).
    pub low: [f64; 2],
    /// Its highest corner. Default (28, 28).
    pub high: [f64; 2],
    /// What blocks sight and ways.
    #[serde(rename = "obstacle", skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<ObstacleTable>,
}

impl Default for WorldTable {
    fn default() -> Self {
        Self {
            low: [-2.0; 2],
            high: [28.0; 2],
            obstacles: Vec::new(),
        }
    }
}

/// An obstacle: `wall = [[x, y], [x, y]]`, `pillar = { x, y, radius }` or
/// `block = [[x, y], ...]` of three corners or more.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum ObstacleTable {
    /// A thin wall.
    Wall([[f64; 2]; 2]),
    /// A disc.
    #[serde(rename_all = "kebab-case")]
    Pillar {
        /// Its middle.
        x: f64,
        /// Its middle.
        y: f64,
        /// Its radius.
        radius: f64,
    },
    /// A polygon.
    Block(Vec<[f64; 2]>),
}

/// The image sensor of the camera board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorName {
    /// 88 columns.
    #[default]
    Ov6620,
    /// 160 columns.
    Ov7620,
}

/// How far cameras stand from where the file has them, standard deviations. Default: not at all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScatterTable {
    /// Of x and of y.
    pub position: f64,
    /// Of the heading, degrees.
    pub heading_deg: f64,
}

/// What all cameras are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraTable {
    /// How its picture comes about: `cmucam2` (default) or `stage`.
    pub variant: Variant,
    /// Its image sensor: `ov6620` (default) or `ov7620`.
    pub sensor: SensorName,
    /// `pin-hole` or `equal-angle`. Default: that of the variant, `equal-angle` for `stage`.
    pub projection: Option<Projection>,
    /// Angle from the middle of the first column to that of the last one, degrees. Default 60.
    pub field_of_view_deg: f64,
    /// How far it sees. Default 8.
    pub range: f64,
    /// The lens that nodes believe to have, where it is not the real one.
    pub model: ModelTable,
    /// Baud rate of the line between node and camera. Default 38400.
    pub baud: u32,
    /// Noise of a pixel, standard deviation, levels. Default 2.
    pub noise: f64,
    /// Change of the light from frame to frame, as a fraction. Default 0.01.
    pub flicker: f64,
    /// How often a fault of the camera or its line happens, by name.
    pub faults: BTreeMap<String, f64>,
}

impl Default for CameraTable {
    fn default() -> Self {
        Self {
            variant: Variant::Cmucam2,
            sensor: SensorName::default(),
            projection: None,
            field_of_view_deg: 60.0,
            range: 8.0,
            model: ModelTable::default(),
            baud: 38_400,
            noise: 2.0,
            flicker: 0.01,
            faults: BTreeMap::new(),
        }
    }
}

impl CameraTable {
    /// The real lens's.
    pub fn projection(&self) -> Projection {
        self.projection.unwrap_or(match self.variant {
            Variant::Cmucam2 => Projection::PinHole,
            Variant::Stage => Projection::EqualAngle,
        })
    }

    /// What one camera is.
    #[must_use]
    pub fn for_camera(&self, camera: &PlacedCamera) -> Self {
        let own = self.clone();
        Self {
            field_of_view_deg: camera.field_of_view_deg.unwrap_or(own.field_of_view_deg),
            range: camera.range.unwrap_or(own.range),
            model: camera.model.unwrap_or(own.model),
            faults: camera.faults.clone().unwrap_or(own.faults),
            ..own
        }
    }
}

/// What a node believes its lens to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelTable {
    /// Default: the real one.
    pub projection: Option<Projection>,
    /// Degrees. Default: the real one.
    pub field_of_view_deg: Option<f64>,
}

/// A camera of a network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlacedCamera {
    /// Number of its node.
    pub id: u16,
    /// True place.
    pub x: f64,
    /// True place.
    pub y: f64,
    /// True heading, degrees.
    pub heading_deg: f64,
    /// In place of [`CameraTable::field_of_view_deg`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field_of_view_deg: Option<f64>,
    /// In place of [`CameraTable::range`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<f64>,
    /// In place of [`CameraTable::model`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelTable>,
    /// In place of [`CameraTable::faults`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub faults: Option<BTreeMap<String, f64>>,
}

/// How targets walk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WalkTable {
    /// Units per second. Default 0.2 (thesis 4.3).
    pub speed: f64,
    /// How far off a stop a target may come to stand, evenly on the disc of this radius: a standard
    /// deviation of half of it along each axis. Default 0.02.
    pub arrive_within: f64,
    /// How far a step goes. Default 0.1.
    pub step_length: f64,
    /// How long a target stands when nobody tells it to walk on, seconds. Default 600.
    pub patience_s: f64,
}

impl Default for WalkTable {
    fn default() -> Self {
        Self {
            speed: 0.2,
            arrive_within: 0.02,
            step_length: 0.1,
            patience_s: 600.0,
        }
    }
}

/// How step sensors err.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorTable {
    /// They measure what was walked; otherwise they report the way from goal to goal, as in the
    /// thesis. Default false.
    pub measures: bool,
    /// Relative error of a leg's distances, standard deviation.
    pub leg_distance: f64,
    /// Error of a leg's headings, standard deviation, degrees.
    pub leg_heading_deg: f64,
    /// Relative error of each step's distance, standard deviation.
    pub step_distance: f64,
    /// Error of each step's heading, standard deviation, degrees.
    pub step_heading_deg: f64,
    /// Constant relative error of distances.
    pub scale_bias: f64,
    /// Constant error of headings, degrees.
    pub heading_bias_deg: f64,
}

impl SensorTable {
    /// 1 % of the distance and 0.5 degrees of heading per leg.
    pub const DRIFT: Self = Self {
        measures: true,
        leg_distance: 0.01,
        leg_heading_deg: 0.5,
        step_distance: 0.0,
        step_heading_deg: 0.0,
        scale_bias: 0.0,
        heading_bias_deg: 0.0,
    };
}

/// The radio medium.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case", tag = "medium")]
pub enum RadioTable {
    /// Everybody within a distance is heard, less a share of the frames.
    UnitDisk {
        /// Distance, in the scenario's unit.
        range: f64,
        /// Share of frames lost, 0 to 1. Default 0.
        #[serde(default)]
        loss: f64,
    },
    /// Path loss with the logarithm of the distance, shadowing, capture.
    LogDistance {
        /// 2 in free space. Default 3.
        #[serde(default = "three_point")]
        exponent: f64,
        /// Standard deviation for each link, dB. Default 4.
        #[serde(default = "four_point")]
        shadowing_db: f64,
        /// Share of frames lost besides, 0 to 1. Default 0.
        #[serde(default)]
        loss: f64,
    },
}

impl RadioTable {
    pub(super) fn set_loss(&mut self, share: f64) {
        match self {
            Self::UnitDisk { loss, .. } | Self::LogDistance { loss, .. } => *loss = share,
        }
    }
}

fn three_point() -> f64 {
    3.0
}

fn four_point() -> f64 {
    4.0
}

impl Default for RadioTable {
    /// One hop reaches all over the thesis's world.
    fn default() -> Self {
        Self::UnitDisk {
            range: 45.0,
            loss: 0.0,
        }
    }
}

/// What the nodes are configured to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FirmwareTable {
    /// Stops at which a camera wants to see the target. Default: the scenario's `stops`.
    pub stops: Option<u8>,
    /// Cameras go on refining their poses after these. Default true.
    pub refine: bool,
    /// A pose whose sigma of the position is larger is weak: another stop is asked for. Default
    /// 0.15.
    pub weak_sigma: f64,
    /// A pose needs no more stops when this sigma of the position, 0 for never, ...
    pub good_enough_position: f64,
    /// ... and this one of the heading, degrees, are reached.
    pub good_enough_heading_deg: f64,
    /// How far a target may stand off the place that it tells, standard deviation of each axis.
    /// Default: what `walk.arrive_within` makes of it.
    pub standing_sigma: Option<f64>,
    /// Cameras look for what differs from the background instead of for a colour. Default false.
    pub motion: bool,
}

impl Default for FirmwareTable {
    fn default() -> Self {
        Self {
            stops: None,
            refine: true,
            weak_sigma: 0.15,
            good_enough_position: 0.0,
            good_enough_heading_deg: 0.0,
            standing_sigma: None,
            motion: false,
        }
    }
}

/// A network: one coordinator and what joins it, one hop apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkTable {
    /// Its channel, 11 to 26.
    #[serde(default = "channel")]
    pub channel: u8,
    /// Where its coordinator stands. Default: in the middle of its cameras.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coordinator: Option<[f64; 2]>,
    /// Lowest and highest corner of where its targets may go. Default: the world's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area: Option<[[f64; 2]; 2]>,
    /// The two that span its frame.
    pub references: ReferencesTable,
    /// Its cameras.
    #[serde(rename = "camera")]
    pub cameras: Vec<PlacedCamera>,
    /// Its targets.
    #[serde(rename = "target")]
    pub targets: Vec<TargetTable>,
}

fn channel() -> u8 {
    15
}

/// The two cameras that span a network's frame: its origin is the first one, its x axis points to
/// the second one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferencesTable {
    /// The node numbers of the first and the second one. Where they are elected: of those in whose
    /// view the walk begins.
    pub cameras: [u16; 2],
    /// They are not configured; trigger and helper are elected. Default false.
    #[serde(default)]
    pub elected: bool,
    /// Their distance is known. Default true.
    #[serde(default = "yes")]
    pub baseline_known: bool,
    /// The step sensor's headings count from the frame's x axis. Default true.
    #[serde(default = "yes")]
    pub frame_heading_known: bool,
    /// Direction of the step sensor's x axis in the world where it is not that of the frame,
    /// degrees. Default 0.
    #[serde(default)]
    pub compass_deg: f64,
}

fn yes() -> bool {
    true
}

/// A target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetTable {
    /// Number of its node.
    pub id: u16,
    /// Red, green and blue. Default orange.
    #[serde(default = "orange")]
    pub colour: Rgb,
    /// Radius. Default 0.15: as wide as the thesis's robot.
    #[serde(default = "radius")]
    pub radius: f64,
    /// Where it stops, the first one being where it begins. Default: planned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stops: Option<Vec<[f64; 2]>>,
}

fn orange() -> Rgb {
    [230, 105, 35]
}

fn radius() -> f64 {
    0.15
}

/// Networks to be made: see [`super::grid`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GridTable {
    /// Cameras in all, 2 or more. Default 52.
    pub nodes: usize,
    /// Cameras of a cell, 2 to 30. Default 13.
    pub cell_nodes: usize,
    /// Side of a cell. Default 24.
    pub cell_size: f64,
}

impl Default for GridTable {
    fn default() -> Self {
        Self {
            nodes: 52,
            cell_nodes: 13,
            cell_size: 24.0,
        }
    }
}
