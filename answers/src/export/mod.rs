//! The poses of a run for other programs: CSV, YAML and ROS 2. Covariance is in all of them.

use serde::Serialize;

use crate::record::{Estimate, Node, RunRecord, Unit};

mod ros;

pub use ros::ros_launch;

/// A pose in CSV, between columns before and behind it: a row is a tuple of such structures. Empty
/// where not known. Lengths in the unit of the site, angles in degrees, also in the covariance.
#[derive(Default, Serialize)]
pub struct CsvPose {
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

/// Which camera of a run, in CSV.
#[derive(Serialize)]
struct CsvCamera {
    camera: u16,
    network: u16,
    reference: bool,
    status: &'static str,
}

/// How right its pose is.
#[derive(Serialize)]
struct CsvTruth {
    true_x: Option<f64>,
    true_y: Option<f64>,
    true_heading_deg: Option<f64>,
    error_x: Option<f64>,
    error_y: Option<f64>,
    error_heading_deg: Option<f64>,
    sightings: usize,
}

/// `calibrated`, or why not: `contradicted` by its sightings, a refusal's name, or `no_pose`.
fn status(record: &RunRecord, camera: &Node) -> &'static str {
    match (&camera.estimate, camera.refusal) {
        (Some(_), _) if camera.contradicted(&record.limits).is_some() => "contradicted",
        (Some(_), _) => "calibrated",
        (None, Some(refusal)) => refusal.name(),
        (None, None) => "no_pose",
    }
}

/// One row per camera: `camera`, `network` (in whose frame the row is), `reference`, `status`
/// (`calibrated`, or why not), the pose (`x`, `y`, `heading_deg`), its sigmas (`sigma_...`), the upper triangle of its covariance (`cov_xx`,
/// `cov_xy`, `cov_xt`, `cov_yy`, `cov_yt`, `cov_tt`, headings in degrees), the truth
/// (`true_...`), the error (`error_...`), and `sightings`.
///
/// # Errors
/// Those of the CSV writer.
pub fn csv(record: &RunRecord) -> Result<String, csv::Error> {
    to_csv(record.cameras().map(|camera| {
        let (truth, error) = (camera.truth, camera.error);
        let which = CsvCamera {
            camera: camera.id,
            network: camera.network,
            reference: camera.reference,
            status: status(record, camera),
        };
        let rightness = CsvTruth {
            true_x: truth.map(|t| t.x),
            true_y: truth.map(|t| t.y),
            true_heading_deg: truth.map(|t| t.heading_deg),
            error_x: error.map(|e| e.x),
            error_y: error.map(|e| e.y),
            error_heading_deg: error.map(|e| e.heading_deg),
            sightings: camera.sightings,
        };
        (which, CsvPose::from(camera.estimate), rightness)
    }))
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
    seed: u64,
    unit: &'a Unit,
    cameras: Vec<YamlCamera>,
}

#[derive(Serialize)]
struct YamlCamera {
    id: u16,
    network: u16,
    reference: bool,
    status: &'static str,
    pose: Option<YamlPose>,
}

#[derive(Serialize)]
struct YamlPose {
    x: f64,
    y: f64,
    heading_rad: f64,
    covariance: serde_saphyr::FlowSeq<[f64; 9]>,
}

/// `format` (2), `scenario`, `seed`, `unit` (`name`, `metres`), `cameras`: each with `id`,
/// `network` (in whose frame it is), `reference`, `status` (`calibrated`, or why not) and `pose`, null without one: `x`, `y` in the
/// unit, `heading_rad`, and `covariance` of these three, 3 x 3 by rows.
///
/// # Errors
/// Those of the YAML writer.
pub fn yaml(record: &RunRecord) -> Result<String, serde_saphyr::ser::Error> {
    let cameras = record.cameras().map(|camera| YamlCamera {
        id: camera.id,
        network: camera.network,
        reference: camera.reference,
        status: status(record, camera),
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
            }
        }),
    });
    let poses = YamlPoses {
        format: 2,
        scenario: &record.scenario,
        seed: record.seed,
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
