//! A scenario as its file has it.

use std::collections::BTreeMap;

use calib_core::camera::Projection;
use nalgebra::Point2;
use node_firmware::{config::LensSigma, vision::ColourWindow};
use serde::{Deserialize, Serialize};

use super::{event::ScriptedEvent, firmware::FirmwareTable, planner::Placement};
use crate::world::Variant;
use cmucam2_emulator::{Rgb, Sensor, Size};
use node_firmware::vision::CameraKind;

/// A site, and the values that only a rehearsal of it uses. Every table but `network` (or `grid`) may be
/// missing; a missing table has its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Name of the site.
    pub name: String,
    /// Description of the site.
    #[serde(default)]
    pub about: String,
    /// The seed of every random number. Default 1.
    #[serde(default = "one")]
    pub seed: u64,
    /// Number of the planned way that targets take, from 1. Default 1.
    #[serde(default = "one")]
    pub path: u64,
    /// Stops that are planned in view of each camera, 3 to 16. Default 3.
    #[serde(default = "three")]
    pub stops: usize,
    /// Method by which these are chosen: `planned` (default) or `anywhere`.
    #[serde(default)]
    pub placement: Placement,
    /// Name of the unit of length. Default `units`.
    #[serde(default = "units")]
    pub unit: String,
    /// Length of the unit, for the radio medium `log-distance` and for exports in metres. Default 1, only for
    /// `units`, `m` and `metres`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit_metres: Option<f64>,
    /// Name of the file with the site's key, next to this file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key_file: Option<String>,
    /// Distance of cameras from where this file has them.
    #[serde(default, skip_serializing_if = "ScatterTable::is_none")]
    pub scatter: ScatterTable,
    /// The seed by which cameras were moved; see [`Scenario::rehearsed`].
    #[serde(skip)]
    pub scattered_by: Option<u64>,
    /// Results of the thesis that stand beside this site's: `thesis-4.1` (the simulation's, by path) or
    /// `thesis-3.1` (the laboratory's). Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<String>,
    /// The place.
    #[serde(default)]
    pub world: WorldTable,
    /// All cameras, unless one says otherwise.
    #[serde(default)]
    pub camera: CameraTable,
    /// Gait of targets.
    #[serde(default)]
    pub walk: WalkTable,
    /// Errors of step sensors. Assumed if missing: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<SensorTable>,
    /// By how much nodes' clocks run too fast or too slow at most, millionths: each by an error of its
    /// own, evenly. Default 40, what crystals of 20 have with their temperature and age.
    #[serde(default = "forty")]
    pub clock_ppm: f64,
    /// The radio medium.
    #[serde(default)]
    pub radio: RadioTable,
    /// Configuration of the nodes.
    #[serde(default)]
    pub firmware: FirmwareTable,
    /// The networks.
    #[serde(default, rename = "network", skip_serializing_if = "Vec::is_empty")]
    pub networks: Vec<NetworkTable>,
    /// Networks to be made, in place of `network`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid: Option<GridTable>,
    /// Objects that cameras track once they are calibrated, if a run is to go on with that.
    #[serde(default, rename = "object", skip_serializing_if = "Vec::is_empty")]
    pub objects: Vec<ObjectTable>,
    /// Events by order of a script.
    #[serde(default, rename = "event", skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<ScriptedEvent>,
    /// Where it comes from.
    #[serde(skip)]
    pub(crate) source: Source,
}

/// The text of a file, to tell lines of it. Two scenarios are the same whatever they come from.
#[derive(Clone, Debug, Default)]
pub(crate) struct Source(pub(crate) std::sync::Arc<str>);

impl PartialEq for Source {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Field of view that a rehearsal assumes of a lens that is not described: the thesis's.
pub(crate) const ASSUMED_FIELD_OF_VIEW_DEG: f64 = 60.0;

fn one() -> u64 {
    1
}

fn forty() -> f64 {
    40.0
}

fn three() -> usize {
    3
}

/// Unit of a file that names none.
pub(crate) const DEFAULT_UNIT: &str = "units";

fn units() -> String {
    DEFAULT_UNIT.into()
}

/// The place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WorldTable {
    /// Its lowest corner. Default (-2, -2).
    pub low: [f64; 2],
    /// Its highest corner. Default (28, 28).
    pub high: [f64; 2],
    /// Obstacles to sight and ways.
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

/// An obstacle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WrittenObstacle")]
pub struct ObstacleTable {
    /// Its outline.
    #[serde(flatten)]
    pub outline: OutlineTable,
    /// Height of its top above the floor; up to the ceiling without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
}

/// An obstacle as a file has it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenObstacle {
    wall: Option<Vec<[f64; 2]>>,
    pillar: Option<PillarTable>,
    block: Option<Vec<[f64; 2]>>,
    height: Option<f64>,
}

impl TryFrom<WrittenObstacle> for ObstacleTable {
    type Error = &'static str;

    fn try_from(written: WrittenObstacle) -> Result<Self, Self::Error> {
        let outline = match (written.wall, written.pillar, written.block) {
            (Some(corners), None, None) => OutlineTable::Wall(corners),
            (None, Some(pillar), None) => OutlineTable::Pillar(pillar),
            (None, None, Some(corners)) => OutlineTable::Block(corners),
            _ => return Err("an obstacle is one `wall`, one `pillar` or one `block`"),
        };
        let height = written.height;
        Ok(Self { outline, height })
    }
}

/// The outline of an obstacle: `wall = [[x, y], [x, y], ...]`, `pillar = { x, y, radius }` or
/// `block = [[x, y], ...]` of three corners or more.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub enum OutlineTable {
    /// A thin wall, with two corners or more.
    Wall(Vec<[f64; 2]>),
    /// A disc.
    Pillar(PillarTable),
    /// A polygon.
    Block(Vec<[f64; 2]>),
}

/// A disc.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PillarTable {
    /// Its middle.
    pub x: f64,
    /// Its middle.
    pub y: f64,
    /// Its radius.
    pub radius: f64,
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

impl From<SensorName> for Sensor {
    fn from(name: SensorName) -> Self {
        match name {
            SensorName::Ov6620 => Self::Ov6620,
            SensorName::Ov7620 => Self::Ov7620,
        }
    }
}

/// Distances of cameras from where the file has them, standard deviations. Default: none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScatterTable {
    /// Of x and of y.
    pub position: f64,
    /// Of the heading, degrees.
    pub heading_deg: f64,
}

/// Description of all cameras.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraTable {
    /// Kind of camera: `cmucam2` (default), `pixy2`, `pixy`, `openmv` or `openmv-tags`.
    pub kind: CameraKind,
    /// Model by which its picture is made: `cmucam2` (default) or `stage`.
    pub variant: Variant,
    /// Image sensor of a CMUcam2: `ov6620` (default) or `ov7620`.
    pub sensor: SensorName,
    /// `pin-hole` or `equal-angle`. Assumed if missing: that of the variant, `equal-angle` for
    /// `stage`.
    pub projection: Option<Projection>,
    /// Angle from the middle of the first column to that of the last one, degrees. Assumed if
    /// missing: 60.
    pub field_of_view_deg: Option<f64>,
    /// k1 and k2 of its radial distortion. Default: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<[f64; 2]>,
    /// Distance up to which it sees. Default 8.
    pub range: f64,
    /// The lens that nodes believe to have, where it is not the real one.
    pub model: ModelTable,
    /// Standard deviation of the focal length that nodes believe, as a share of it; 0 if it is exact. Default:
    /// the firmware's.
    pub field_of_view_sigma: Option<f64>,
    /// Standard deviation of the column of the optical axis that nodes believe, columns; 0 if it is exact. Default:
    /// 2.
    pub principal_sigma: Option<f64>,
    /// Standard deviation of the pitch and roll of cameras that are put up level, degrees; 0 if they are exactly
    /// level. Default: the firmware's.
    pub tilt_sigma_deg: Option<f64>,
    /// Baud rate of the line between node and camera. Default: the firmware's.
    pub baud: Option<u32>,
    /// Noise of a pixel, standard deviation, levels. Default 2.
    pub noise: f64,
    /// Change of the light from frame to frame, as a fraction. Default 0.01.
    pub flicker: f64,
    /// Rate of each fault of the camera or its line, by name.
    pub faults: BTreeMap<String, f64>,
}

impl Default for CameraTable {
    fn default() -> Self {
        Self {
            kind: CameraKind::Cmucam2,
            variant: Variant::Cmucam2,
            sensor: SensorName::default(),
            projection: None,
            field_of_view_deg: None,
            distortion: None,
            range: 8.0,
            model: ModelTable::default(),
            field_of_view_sigma: None,
            principal_sigma: None,
            tilt_sigma_deg: None,
            baud: None,
            noise: 2.0,
            flicker: 0.01,
            faults: BTreeMap::new(),
        }
    }
}

/// Standard deviation of a column of the optical axis that was not measured, columns.
const PRINCIPAL_SIGMA: f64 = 2.0;

impl CameraTable {
    /// Sigmas of its lens, as its node is told.
    pub(crate) fn lens_sigma(&self) -> LensSigma {
        let lens = self.believed();
        let view = f64::from(lens.field_of_view_deg).to_radians();
        // Of the tangent, on the axis.
        let column = match lens.projection {
            Projection::PinHole => 2.0 * (view / 2.0).tan(),
            Projection::EqualAngle => view,
        } / f64::from(lens.columns.max(2) - 1);
        let principal = self.principal_sigma.unwrap_or(PRINCIPAL_SIGMA) * column;
        let mut sigma = LensSigma::UNMEASURED;
        sigma.principal_deg = principal.to_degrees().min(20.0) as f32;
        if let Some(told) = self.field_of_view_sigma {
            sigma.focal = told as f32;
        }
        if let Some(told) = self.tilt_sigma_deg {
            sigma.tilt_deg = told as f32;
        }
        sigma
    }

    /// The real lens's.
    pub fn projection(&self) -> Projection {
        self.projection.unwrap_or(match self.variant {
            Variant::Cmucam2 => Projection::PinHole,
            Variant::Stage => Projection::EqualAngle,
        })
    }

    /// The real lens's, degrees.
    pub fn field_of_view_deg(&self) -> f64 {
        let model = self.kind.model();
        let sold = model.map_or(ASSUMED_FIELD_OF_VIEW_DEG, |model| {
            model.field_of_view_deg().into()
        });
        self.field_of_view_deg.unwrap_or(sold)
    }

    /// The real lens's k1 and k2.
    pub(crate) fn distortion(&self) -> [f64; 2] {
        self.distortion.unwrap_or_default()
    }

    /// Columns and rows of its frames.
    pub fn size(&self) -> [u16; 2] {
        match self.kind.model() {
            None => {
                let size = Size::of(self.sensor.into(), false);
                [size.width, size.height].map(u16::from)
            }
            Some(model) => model.size(),
        }
    }

    /// Description of one camera.
    #[must_use]
    pub fn for_camera(&self, camera: &PlacedCamera) -> Self {
        let all = self.clone();
        Self {
            kind: camera.kind.unwrap_or(all.kind),
            sensor: camera.sensor.unwrap_or(all.sensor),
            projection: camera.projection.or(all.projection),
            field_of_view_deg: camera.field_of_view_deg.or(all.field_of_view_deg),
            distortion: camera.distortion.or(all.distortion),
            range: camera.range.unwrap_or(all.range),
            model: camera.model.unwrap_or(all.model),
            baud: camera.baud.or(all.baud),
            faults: camera.faults.clone().unwrap_or(all.faults),
            ..all
        }
    }
}

/// Lens that a node believes to have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelTable {
    /// Default: the real one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub projection: Option<Projection>,
    /// Degrees. Default: the real one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field_of_view_deg: Option<f64>,
    /// Column of the optical axis. Default: in the middle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub principal_column: Option<f64>,
    /// k1 and k2. Default: the real ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distortion: Option<[f64; 2]>,
}

/// A camera of a network.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlacedCamera {
    /// Number of its node.
    pub id: u16,
    /// Where it stands in the building. Needed of references, and of all in a rehearsal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x: Option<f64>,
    /// Where it stands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y: Option<f64>,
    /// Where it looks, degrees. Needed in a rehearsal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_deg: Option<f64>,
    /// Height of its lens above the floor, in a rehearsal. Default: that of the ball.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
    /// Angle of its optical axis below the horizon, in a rehearsal, degrees. Default: level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_deg: Option<f64>,
    /// Its turn about the optical axis, positive where the left side is high, in a rehearsal, degrees. Default: upright.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_deg: Option<f64>,
    /// In place of [`CameraTable::kind`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<CameraKind>,
    /// In place of [`CameraTable::sensor`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<SensorName>,
    /// In place of [`CameraTable::projection`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projection: Option<Projection>,
    /// In place of [`CameraTable::field_of_view_deg`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field_of_view_deg: Option<f64>,
    /// In place of [`CameraTable::distortion`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<[f64; 2]>,
    /// In place of [`CameraTable::range`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<f64>,
    /// In place of [`CameraTable::model`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelTable>,
    /// In place of [`CameraTable::baud`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// In place of [`CameraTable::faults`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub faults: Option<BTreeMap<String, f64>>,
    /// Its own parameters, over those of [`Scenario::firmware`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub firmware: Option<FirmwareTable>,
}

impl PlacedCamera {
    /// Where it stands, if the file says so.
    pub fn place(&self) -> Option<Point2<f64>> {
        Some(Point2::new(self.x?, self.y?))
    }
}

/// Gait of targets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WalkTable {
    /// Units per second. Default 0.2 (thesis 4.3).
    pub speed: f64,
    /// Most that a target may come to stand off a stop, evenly on the disc of this radius: a standard deviation
    /// of half of it along each axis. Default 0.02.
    pub arrive_within: f64,
    /// Standard deviation of the height of the ball's middle at a stop. Default 0.
    pub bob_sigma: f64,
    /// Length of a step. Default 0.1.
    pub step_length: f64,
    /// Time that a target stands when it is not told to walk on, seconds. Default 600.
    pub patience_s: f64,
    /// Number of walks. Each one visits the stops of the one before, from the last to the first. Default 1.
    pub walks: u32,
    /// Time from the begin of a walk to that of the next, seconds. Default 86,400: a day.
    pub every_s: f64,
}

impl Default for WalkTable {
    fn default() -> Self {
        Self {
            speed: 0.2,
            arrive_within: 0.02,
            bob_sigma: 0.0,
            step_length: 0.1,
            patience_s: 600.0,
            walks: 1,
            every_s: 86_400.0,
        }
    }
}

/// Errors of step sensors.
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
    /// As `leg_distance`, but not in the sigmas that the sensor tells.
    pub undeclared_distance: f64,
    /// As `leg_heading_deg`, but not in the sigmas that the sensor tells.
    pub undeclared_heading_deg: f64,
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
        undeclared_distance: 0.0,
        undeclared_heading_deg: 0.0,
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

/// A network: one coordinator and what joins it, one hop apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkTable {
    /// Its channel, 11 to 26. Default 15.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<u8>,
    /// Several channels, in place of `channel`; its coordinator takes the quietest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channels: Option<Vec<u8>>,
    /// Where its coordinator stands. Default: in the middle of its cameras.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coordinator: Option<[f64; 2]>,
    /// Numbers of further nodes that may join.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub allow: Vec<u16>,
    /// Its frame in the building, where its references have no places there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameTable>,
    /// Lowest and highest corner of where its targets may go. Default: the world's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub area: Option<[[f64; 2]; 2]>,
    /// The two that span its frame.
    pub references: ReferencesTable,
    /// Its cameras.
    #[serde(rename = "camera")]
    pub cameras: Vec<PlacedCamera>,
    /// Its targets.
    #[serde(rename = "target", default)]
    pub targets: Vec<TargetTable>,
}

impl NetworkTable {
    /// The channels that it may use.
    pub fn channels(&self) -> Vec<u8> {
        match (&self.channels, self.channel) {
            (Some(channels), _) => channels.clone(),
            (None, channel) => vec![channel.unwrap_or(15)],
        }
    }

    /// Its camera of this number.
    pub fn camera(&self, id: u16) -> Option<&PlacedCamera> {
        self.cameras.iter().find(|camera| camera.id == id)
    }
}

impl Scenario {
    /// The network whose targets bring its frame to this one, if it has none of its own.
    pub fn home_of(&self, network: &NetworkTable) -> Option<&NetworkTable> {
        let number = network.references.frame_of?;
        self.networks.get(number.checked_sub(1)?)
    }

    /// The networks to which targets of this one, counted from 0, bring its frame: counted from 0.
    pub fn visited_from(&self, network: usize) -> impl Iterator<Item = usize> {
        let networks = self.networks.iter().enumerate();
        networks
            .filter(move |(_, other)| other.references.frame_of == Some(network + 1))
            .map(|(number, _)| number)
    }

    /// The targets that come from another network to this one.
    pub fn visitors(&self, network: &NetworkTable) -> &[TargetTable] {
        self.home_of(network).map_or(&[], |home| &home.targets)
    }

    /// The targets that the cameras of a network see, in the order of their numbers.
    pub fn wearers<'a>(
        &'a self,
        network: &'a NetworkTable,
    ) -> impl Iterator<Item = &'a TargetTable> {
        self.visitors(network).iter().chain(&network.targets)
    }

    /// The network of the target with this number.
    pub fn network_of_target(&self, id: u16) -> Option<&NetworkTable> {
        let mut networks = self.networks.iter();
        networks.find(|network| network.targets.iter().any(|target| target.id == id))
    }

    /// A network's frame in the building, be it brought from another network.
    pub fn building_frame(&self, network: &NetworkTable) -> Option<crate::Frame> {
        self.home_of(network).unwrap_or(network).building_frame()
    }
}

/// Where a network's frame is in the building.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameTable {
    /// Its origin: the first reference.
    pub x: f64,
    /// Its origin.
    pub y: f64,
    /// Direction of its x axis, from the first reference to the second, degrees.
    pub heading_deg: f64,
}

/// The two cameras that span a network's frame: its origin is the first one, its x axis points to
/// the second one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferencesTable {
    /// The node numbers of the first and the second one. If they are elected, those of the cameras in whose view
    /// the walk begins.
    pub cameras: [u16; 2],
    /// They are not configured; trigger and helper are elected. Default false.
    #[serde(default)]
    pub elected: bool,
    /// There are none: cameras wait for the targets of this network, from 1, which bring its frame. The
    /// two of `cameras` are those in whose view the walk goes on. Default: there are some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame_of: Option<usize>,
    /// Their distance is known. Default: true, unless they are elected or there are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline_known: Option<bool>,
    /// Their distance as it was measured. Default: that of their places.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline: Option<f64>,
    /// Standard deviation of that distance, as a share of it; 0 if it is exact. Default: the
    /// firmware's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline_sigma: Option<f64>,
    /// Standard deviation of each one's place along each axis, in the unit of the site; 0 if it is exact. Default:
    /// 1 cm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_sigma: Option<f64>,
    /// It is known from where the step sensor's headings count. Default: true, unless the
    /// references are elected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame_heading_known: Option<bool>,
    /// Direction from which the step sensor's headings count, in the building, degrees. Default: the
    /// frame's x axis where it is known, otherwise 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compass_deg: Option<f64>,
}

impl ReferencesTable {
    /// Returns true if nodes are told that they are references.
    pub const fn are_configured(&self) -> bool {
        !self.elected && self.frame_of.is_none()
    }

    /// Returns true if nodes are told their distance.
    pub fn baseline_known(&self) -> bool {
        self.baseline_known.unwrap_or(self.are_configured())
    }

    /// Returns true if nodes are told from where headings count.
    pub fn frame_heading_known(&self) -> bool {
        self.frame_heading_known.unwrap_or(self.are_configured())
    }
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
    /// Height of the middle of its ball above the floor, in a rehearsal. Default: a metre.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
    /// Where it stops, the first one being where it begins. Default: planned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stops: Option<Vec<[f64; 2]>>,
    /// Colours that cameras see of it. Default: made of `colour` and the `colour_tolerance`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<ColourWindow>,
    /// Its own parameters, over those of [`Scenario::firmware`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub firmware: Option<FirmwareTable>,
}

/// Something of a target's colour, without a radio.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectTable {
    /// Where it goes, to and fro. Default: the way of the first network's target, each object from another
    /// of its stops.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<Vec<[f64; 2]>>,
    /// Units per second. Default: as targets walk.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Red, green and blue. Default orange.
    #[serde(default = "orange")]
    pub colour: Rgb,
    /// Radius. Default 0.15.
    #[serde(default = "radius")]
    pub radius: f64,
}

impl Default for ObjectTable {
    fn default() -> Self {
        Self {
            path: None,
            speed: None,
            colour: orange(),
            radius: radius(),
        }
    }
}

pub(crate) fn orange() -> Rgb {
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
    /// Only the first cell has references and a target, which walks through all. Default false.
    pub one_frame: bool,
}

impl Default for GridTable {
    fn default() -> Self {
        Self {
            nodes: 52,
            cell_nodes: 13,
            cell_size: 24.0,
            one_frame: false,
        }
    }
}
