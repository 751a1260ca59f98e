//! The poses of a network for other programs, simulated or real: CSV, YAML and ROS 2. Covariance and
//! status are in all of them.

use std::borrow::Cow;

use calib_core::{Refusal, Status};
use nalgebra::Matrix6;
use serde::Serialize;

use crate::record::{Estimate, Node, Role, RunRecord, Unit, space::HungEstimate};

mod ros;

pub use ros::ros_launch;

/// A pose in CSV, between columns before and behind it: a row is a tuple of such structures. Empty
/// where not known. Lengths in the unit of the site, angles in degrees, also in the covariance.
#[derive(Default, Serialize)]
struct CsvPose {
    x: Option<f64>,
    y: Option<f64>,
    heading_deg: Option<f64>,
    sigma_x: Option<f64>,
    sigma_y: Option<f64>,
    sigma_heading_deg: Option<f64>,
    cov_xx: Option<f64>,
    cov_xy: Option<f64>,
    cov_xt: Option<f64>,
    cov_yy: Option<f64>,
    cov_yt: Option<f64>,
    cov_tt: Option<f64>,
}

impl From<Option<Estimate>> for CsvPose {
    fn from(estimate: Option<Estimate>) -> Self {
        let Some(e) = estimate else {
            return Self::default();
        };
        let [cov_xx, cov_xy, cov_xt, cov_yy, cov_yt, cov_tt] = e.covariance.map(Some);
        Self {
            x: Some(e.x),
            y: Some(e.y),
            heading_deg: Some(e.heading_deg),
            sigma_x: Some(e.sigma_x),
            sigma_y: Some(e.sigma_y),
            sigma_heading_deg: Some(e.sigma_heading_deg),
            cov_xx,
            cov_xy,
            cov_xt,
            cov_yy,
            cov_yt,
            cov_tt,
        }
    }
}

/// In whose coordinates poses are exported.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// Those of each network: the first reference is the origin, the second one on the x axis.
    #[default]
    Network,
    /// Those of the building, in which the site file tells where cameras are.
    Building,
}

impl Frame {
    /// Frame in which people are told this record: the building's where that is known.
    pub fn for_people(record: &RunRecord) -> Self {
        match record.in_building() {
            Some(_) => Self::Building,
            None => Self::Network,
        }
    }

    /// The record in these coordinates; `None` if it does not know where a network is in the
    /// building.
    pub fn of(self, record: &RunRecord) -> Option<Cow<'_, RunRecord>> {
        match self {
            Self::Network => Some(Cow::Borrowed(record)),
            Self::Building => record.in_building().map(Cow::Owned),
        }
    }
}

/// Why there is no export.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The place of a network is not known.
    #[error(
        "where the network is in the building is not known: give the site file (--site), with the \
         places of both reference cameras, or take --frame network"
    )]
    NoBuilding,
    /// Error of the CSV writer.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// Error of the YAML writer.
    #[error(transparent)]
    Yaml(#[from] serde_saphyr::ser::Error),
}

/// Height, pitch and roll in CSV, empty where not known.
#[derive(Default, Serialize)]
struct CsvHung {
    z: Option<f64>,
    pitch_deg: Option<f64>,
    roll_deg: Option<f64>,
    sigma_z: Option<f64>,
    sigma_pitch_deg: Option<f64>,
    sigma_roll_deg: Option<f64>,
    true_z: Option<f64>,
    true_pitch_deg: Option<f64>,
    true_roll_deg: Option<f64>,
}

impl From<&Node> for CsvHung {
    fn from(camera: &Node) -> Self {
        let found = camera.estimate.and_then(|estimate| estimate.hung);
        let truth = camera.truth.and_then(|truth| truth.hung);
        Self {
            z: found.map(|found| found.hung.z),
            pitch_deg: found.map(|found| found.hung.pitch_deg),
            roll_deg: found.map(|found| found.hung.roll_deg),
            sigma_z: found.map(|found| found.sigma_z),
            sigma_pitch_deg: found.map(|found| found.sigma_pitch_deg),
            sigma_roll_deg: found.map(|found| found.sigma_roll_deg),
            true_z: truth.map(|truth| truth.z),
            true_pitch_deg: truth.map(|truth| truth.pitch_deg),
            true_roll_deg: truth.map(|truth| truth.roll_deg),
        }
    }
}

/// Identity of a camera, in CSV.
#[derive(Serialize)]
struct CsvCamera {
    camera: u16,
    network: u16,
    frame: Frame,
    reference: bool,
    status: Option<Status>,
    reason: Option<&'static str>,
}

/// Quality of its pose, and the measurements that it was made of.
#[derive(Serialize)]
struct CsvTruth {
    true_x: Option<f64>,
    true_y: Option<f64>,
    true_heading_deg: Option<f64>,
    error_x: Option<f64>,
    error_y: Option<f64>,
    error_heading_deg: Option<f64>,
    sightings: usize,
    used: usize,
    chi_squared: Option<f64>,
    done: bool,
    address: Option<u16>,
}

impl From<&Node> for CsvTruth {
    fn from(camera: &Node) -> Self {
        let (truth, error) = (camera.truth, camera.error);
        Self {
            true_x: truth.map(|t| t.x),
            true_y: truth.map(|t| t.y),
            true_heading_deg: truth.map(|t| t.heading_deg),
            error_x: error.map(|e| e.x),
            error_y: error.map(|e| e.y),
            error_heading_deg: error.map(|e| e.heading_deg),
            sightings: camera.sightings,
            used: camera.used,
            chi_squared: camera.chi_squared,
            done: camera.done,
            address: camera.address,
        }
    }
}

/// Protection of its pose, in CSV.
#[derive(Serialize)]
struct CsvCheck {
    checked: bool,
    protection: Option<f64>,
    protection_heading_deg: Option<f64>,
}

/// One row per camera: `camera`, `network`, `frame` (in whose coordinates the row is: `network` or
/// `building`), `reference`, `status`, `reason` (why there is no pose), the pose (`x`, `y`,
/// `heading_deg`), its sigmas (`sigma_...`), the upper triangle of its covariance (`cov_xx`,
/// `cov_xy`, `cov_xt`, `cov_yy`, `cov_yt`, `cov_tt`, headings in degrees), the truth (`true_...`) and
/// the error (`error_...`) where they are known, `sightings`, how many of them the pose uses
/// (`used`), `chi_squared`, `done` (it needs no more), its `address`, whether its pose is `checked`, and how
/// far one unnoticed wrong measurement could move and turn it (`protection`, `protection_heading_deg`; empty
/// of references, and where no target told). Then come [height, pitch and roll](crate::record::space::Hung) (`z`,
/// `pitch_deg`, `roll_deg`), their sigmas and their truth; empty where no rows tell them.
///
/// # Errors
/// [`ExportError`]
pub fn csv(record: &RunRecord, frame: Frame) -> Result<String, ExportError> {
    let record = frame.of(record).ok_or(ExportError::NoBuilding)?;
    let row = |camera: &Node| {
        let which = CsvCamera {
            camera: camera.id,
            network: camera.network,
            frame,
            reference: camera.reference,
            status: camera.status,
            reason: camera.reason.map(Refusal::name),
        };
        (
            which,
            CsvPose::from(camera.estimate),
            CsvTruth::from(camera),
            CsvCheck {
                checked: camera.is_checked(&record.limits),
                protection: camera.protection.map(|level| level.position),
                protection_heading_deg: camera.protection.map(|level| level.heading_deg),
            },
            CsvHung::from(camera),
        )
    };
    let text = to_csv(record.cameras().map(row))?;
    if text.is_empty() {
        // Without cameras, the names of the columns all the same.
        let names = to_csv(std::iter::once(row(&Node::new(0, Role::Camera))))?;
        return Ok(names.split_inclusive('\n').take(1).collect());
    }
    Ok(text)
}

/// Rows under a heading of their fields' names.
pub fn to_csv(rows: impl Iterator<Item = impl Serialize>) -> Result<String, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    let bytes = writer
        .into_inner()
        .map_err(csv::IntoInnerError::into_error)?;
    // Made of strings and numbers.
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Poses in YAML.
#[derive(Serialize)]
struct YamlPoses<'a> {
    format: u32,
    scenario: &'a str,
    seed: Option<u64>,
    frame: Frame,
    unit: &'a Unit,
    cameras: Vec<YamlCamera>,
}

#[derive(Serialize)]
struct YamlCamera {
    id: u16,
    network: u16,
    reference: bool,
    status: Option<Status>,
    reason: Option<&'static str>,
    pose: Option<YamlPose>,
}

#[derive(Serialize)]
struct YamlPose {
    x: f64,
    y: f64,
    heading_rad: f64,
    covariance: serde_saphyr::FlowSeq<[f64; 9]>,
    #[serde(flatten)]
    hung: Option<YamlHung>,
}

#[derive(Serialize)]
struct YamlHung {
    z: f64,
    pitch_rad: f64,
    roll_rad: f64,
    covariance_in_space: serde_saphyr::FlowSeq<Vec<f64>>,
}

impl YamlHung {
    fn new(found: &HungEstimate) -> Self {
        Self {
            z: found.hung.z,
            pitch_rad: found.hung.pitch_deg.to_radians(),
            roll_rad: found.hung.roll_deg.to_radians(),
            covariance_in_space: serde_saphyr::FlowSeq(in_space(found, 1.0)),
        }
    }
}

/// The covariance of (x, y, z, roll, pitch, heading) by rows: radians, and lengths of so many units each.
fn in_space(found: &HungEstimate, length: f64) -> Vec<f64> {
    let angle = 1_f64.to_radians();
    let scale = Matrix6::from_diagonal(&[length, length, length, angle, angle, angle].into());
    // Symmetric, so that columns are rows.
    { scale * found.matrix() * scale }.iter().copied().collect()
}

/// `format` (3), `scenario`, `seed` (null of a real network), `frame` (in whose coordinates poses
/// are: `network` or `building`), `unit` (`name`, `metres`), `cameras`: each with `id`, `network`,
/// `reference`, `status`, `reason` (why there is no pose) and `pose`, null without one: `x`, `y` in
/// the unit, `heading_rad`, and `covariance` of these three, 3 x 3 by rows. Where rows tell them, `z`, `pitch_rad` and
/// `roll_rad` follow, and `covariance_in_space` of x, y, z, roll, pitch and heading, 6 x 6 by rows.
///
/// # Errors
/// [`ExportError`]
pub fn yaml(record: &RunRecord, frame: Frame) -> Result<String, ExportError> {
    let record = frame.of(record).ok_or(ExportError::NoBuilding)?;
    let cameras = record.cameras().map(|camera| YamlCamera {
        id: camera.id,
        network: camera.network,
        reference: camera.reference,
        status: camera.status,
        reason: camera.reason.map(Refusal::name),
        pose: camera.estimate.map(|estimate| {
            let pose = estimate.pose();
            let c = pose.covariance;
            YamlPose {
                x: estimate.x,
                y: estimate.y,
                heading_rad: pose.heading,
                covariance: serde_saphyr::FlowSeq([
                    c.m11, c.m12, c.m13, c.m21, c.m22, c.m23, c.m31, c.m32, c.m33,
                ]),
                hung: estimate.hung.as_ref().map(YamlHung::new),
            }
        }),
    });
    let poses = YamlPoses {
        format: 3,
        scenario: &record.scenario,
        seed: record.seed,
        frame,
        unit: &record.unit,
        cameras: cameras.collect(),
    };
    let head = format!("# Camera poses: {}\n", one_line(&record.title()));
    Ok(head + &to_yaml(&poses)?)
}

/// One value per line, however long it is.
fn to_yaml(value: &impl Serialize) -> Result<String, serde_saphyr::ser::Error> {
    let options = serde_saphyr::ser_options! { prefer_block_scalars: false };
    serde_saphyr::to_string_with_options(value, options)
}

/// A name that may stand in a comment.
fn one_line(name: &str) -> String {
    name.replace(char::is_control, " ")
}
