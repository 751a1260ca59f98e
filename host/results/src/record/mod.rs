//! The record of one finished run: everything its reports, maps and exports are made of.
//!
//! The record of a real network has what its coordinator told; see [`view`](crate::view).
//!
//! A record is JSON, and its names and their meaning are an interface. Lengths are in the
//! scenario's [`unit`](RunRecord::unit), angles in degrees (headings in `[0, 360)`), times in seconds since
//! the start of the run. Values that are not known are `null`. A reader refuses a
//! [`format`](RunRecord::format) that it does not know.
//!
//! Places and headings, true ones too, are in the frame of their node's or target's
//! [`network`](Node::network): its origin is the first reference, its x axis points to the second
//! one. Each of the [`networks`](RunRecord::networks) tells where its frame is.
//!
//! Two runs of one scenario and seed give the same record, byte for byte. The time the computer
//! took is the one exception, so [`wall_seconds`](RunRecord::wall_seconds) is `null` unless it was
//! asked for.

use std::{borrow::Cow, collections::BTreeSet};

use calib_core::{
    Pose, Refusal, Sighting, Status, angle,
    camera::Projection,
    fit::Fit,
    level::{Levelness, Mounting},
};
use nalgebra::{Isometry2, Matrix3, Point2, Vector2, Vector3};
use node_firmware::message::Health;
use serde::{Deserialize, Serialize};
use site::planner::RARE;

pub mod checks;
pub mod difference;
pub mod event;
mod joined;
mod next_stop;
pub mod part;
pub mod published;
pub mod sightings;
pub mod space;
mod standing;
pub mod summary;
pub mod sweep;
pub mod verdict;

use sightings::Sightings;
use space::{Hung, HungEstimate};
use summary::Summary;

/// The format that this library writes, and the only one that it reads.
pub const FORMAT: u32 = 4;

/// One finished run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// [`FORMAT`]
    pub format: u32,
    /// Name of the scenario, or of the site.
    pub scenario: String,
    /// Number of the planned ways for its targets, from 1.
    pub path: Option<u32>,
    /// Results of the thesis that stand beside these, such as `thesis-4.1`. Left out if none, as where cameras
    /// were moved from the thesis's places.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<String>,
    /// The root of all randomness of the run; `null` of a real network.
    pub seed: Option<u64>,
    /// The unit of lengths.
    pub unit: Unit,
    /// Predicted sigmas above these make a camera weak. It is the camera that judges: these are only
    /// told.
    pub limits: Limits,
    /// The networks by ascending number.
    pub networks: Vec<Network>,
    /// Coordinator, cameras and targets by ascending number.
    pub nodes: Vec<Node>,
    /// Where the targets went.
    pub targets: Vec<Target>,
    /// Measurements of each network, by ascending number. Records of format 4 may lack them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sightings: Vec<Sightings>,
    /// Obstacles that hide targets from cameras: closed outlines, `[x, y]` a corner. In the frame of the first
    /// network.
    pub obstacles: Vec<Vec<[f64; 2]>>,
    /// Outline of where a person can walk, as the site file's `[world]` tells it, in the frame of the first
    /// network; left out where it does not.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub area: Vec<[f64; 2]>,
    /// Statistics over the cameras, always those of `nodes`.
    pub summary: Summary,
    /// Radio traffic; `null` of a real network.
    pub radio: Option<Radio>,
    /// Quality of each network's tracking after the calibration; left out where none tracked.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tracking: Vec<Tracking>,
    /// True if the last stops that the verdict asked for were made and improved nothing: it asks for no other then.
    /// Left out where it is false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stops_in_vain: bool,
    /// Duration of the run for the simulated nodes; of a real network, the time that it was listened to.
    pub sim_seconds: f64,
    /// Time that the computer took; `null` unless asked for, since it is never twice the same.
    pub wall_seconds: Option<f64>,
}

/// One network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Network {
    /// Its number, from 1.
    pub network: u16,
    /// Where the origin of its frame really is in the frame of the first network, and the direction
    /// of its x axis.
    pub frame: Place,
    /// Where the site file says that its frame is in the building.
    pub building: Option<Place>,
    /// Its PAN identifier, once it has one.
    pub pan: Option<u16>,
    /// Its channel.
    pub channel: Option<u8>,
    /// Height of the middle of its ball above the floor; left out where nothing tells it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ball_height: Option<f64>,
}

/// Quality of a network's tracking of objects without a radio, compared with where they really were. A track
/// within a metre of an object may be of it, and remains of it as long as it is so near.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    /// Number of the network.
    pub network: u16,
    /// For so long.
    pub seconds: f64,
    /// So many objects were in view of two cameras at some time.
    pub objects: usize,
    /// Looks that told a direction.
    pub looks: usize,
    /// Share of the time in which an object had a track, of all time in which two cameras saw it.
    pub covered: f64,
    /// Root mean square of the distance from track to object, at the moments when the track was told and a
    /// camera had seen it in the last half second.
    pub rms: Option<f64>,
    /// The same of the posterior Cramer-Rao bound of these looks, at the same moments, if the poses of cameras
    /// were known exactly and also which object each look shows, how fast it walks and when it turns.
    pub bound: Option<f64>,
    /// Mean of the squared error over its predicted covariance: 2 where that is right.
    pub nees: Option<f64>,
    /// Number of times that an object got another track than it had.
    pub breaks: usize,
    /// Number of times that a track went over to another object.
    pub swaps: usize,
    /// Tracks that were never of an object.
    pub ghosts: usize,
}

/// The unit of lengths.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unit {
    /// For headings and axes.
    pub name: String,
    /// Length of the unit; 1 where a scenario does not say.
    pub metres: f64,
}

/// The largest predicted sigmas of a camera that needs no further stop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Of [`Estimate::sigma_position`].
    pub sigma_position: f64,
    /// Of the heading.
    pub sigma_heading_deg: f64,
}

impl Protection {
    /// Returns true if it bounds next to nothing: the camera may look to the other side, too.
    pub fn is_boundless(&self) -> bool {
        self.heading_deg >= 90.0
    }

    /// The larger of each.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            position: self.position.max(other.position),
            heading_deg: self.heading_deg.max(other.heading_deg),
        }
    }
}

impl Limits {
    /// Returns true if a pose of this protection level is good enough to be called checked: even with one wrong
    /// measurement it errs no more than the least certain pose that is called calibrated may err by chance, 3.09
    /// sigmas, which is exceeded once in a thousand.
    pub fn tolerate(&self, level: &Protection) -> bool {
        self.share(level) <= 1.0
    }

    /// A protection level over the largest one that is tolerated.
    pub fn share(&self, level: &Protection) -> f64 {
        let position = level.position / (RARE * self.sigma_position);
        position.max(level.heading_deg / (RARE * self.sigma_heading_deg))
    }
}

/// Role of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Forms the network and collects poses.
    Coordinator,
    /// Has a camera.
    Camera,
    /// Is carried about and seen.
    Target,
}

/// One node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Node {
    /// Its number.
    pub id: u16,
    /// Of which network.
    pub network: u16,
    /// Role of the node.
    pub role: Role,
    /// True if it is one of the two cameras whose places are given or define the frame.
    pub reference: bool,
    /// True if the scenario means it to be calibrated.
    pub expected: bool,
    /// Where it really is; cameras only.
    pub truth: Option<Place>,
    /// Place of a real camera by the site file; it is not measured.
    pub planned: Option<Place>,
    /// Its field of view and range; cameras only.
    pub view: Option<View>,
    /// Its status, as it says itself; cameras only. Only `calibrated` counts as calibrated.
    pub status: Option<Status>,
    /// Why it has no pose.
    pub reason: Option<Refusal>,
    /// Where it says it is, whatever that is worth.
    pub estimate: Option<Estimate>,
    /// Estimate minus truth.
    pub error: Option<PoseError>,
    /// Most that the pose may be off because of one unnoticed wrong measurement. Left out where no target
    /// estimated it together with all that was measured, and of references.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protection: Option<Protection>,
    /// The squared error in units of the predicted covariance: 3 on average where predictions are
    /// right. `null` where part of the pose was given, since that part has no covariance.
    pub nees: Option<f64>,
    /// Number of sightings that it counted.
    pub sightings: usize,
    /// Number of sightings that its pose uses.
    pub used: usize,
    /// Sum of the squared residuals of these, each over its variance, as it says itself.
    pub chi_squared: Option<f64>,
    /// It needs no more sightings.
    pub done: bool,
    /// The lens that fits its sightings, of a camera that they tell to have another one than the
    /// configured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<NodeLens>,
    /// Its mounting, of a camera that is not level as its rows tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<NodeMount>,
    /// Its last move, if it stands or looks elsewhere than it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<NodeMove>,
    /// Each sighting against the estimate.
    pub residuals: Vec<Residual>,
    /// When it had its first pose.
    pub calibrated_seconds: Option<f64>,
    /// Time when it was last heard; `null` of a node that never was, and of nodes on emulated boards.
    pub heard_seconds: Option<f64>,
    /// It was spoken to since then, and did not answer.
    pub silent: bool,
    /// Its health, as it says itself. Left out of a node that is well.
    #[serde(default, skip_serializing_if = "is_well")]
    pub health: Health,
    /// Its address in the network, if it is a member.
    pub address: Option<u16>,
    /// Failures that kept its firmware from going on. It was then started again.
    pub failures: Vec<Failure>,
    /// Application messages it sent, each counted once, before encryption; `null` of a node on an emulated
    /// board, whose messages are not seen before encryption.
    pub payload_bytes: Option<u64>,
    /// Everything it sent, acknowledgements, retries and joining included, from preamble to check
    /// sequence; `null` of a real node.
    pub bytes_sent: Option<u64>,
    /// As `bytes_sent`, in frames.
    pub frames_sent: Option<u64>,
    /// Number of times that the most erased page of its flash was erased, formatting included; left out of nodes
    /// whose flash is not watched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub page_erasures: Option<u32>,
}

fn is_well(health: &Health) -> bool {
    *health == Health::default()
}

/// A lens, as the camera itself found it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeLens {
    /// Its projection: the way that it spreads directions over columns.
    pub projection: Projection,
    /// From the middle of the first column to that of the last one.
    pub fov_deg: f64,
}

/// Move of a camera, as the poses tell that it had before and has since.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeMove {
    /// When the former pose was told last in an earlier walk: the camera was moved after that, if it was in view of the
    /// walk that noticed it first, seconds.
    pub after_seconds: f64,
    /// When the former pose was doubted, or replaced at once: the camera was moved before that, seconds.
    pub noticed_seconds: f64,
    /// Distance between the two places.
    pub distance: f64,
    /// Turn between the two headings, counter-clockwise.
    pub turn_deg: f64,
}

/// Mounting of a camera that is not level, as its rows tell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeMount {
    /// Height above the ball.
    pub height: f64,
    /// Angle of its optical axis below the horizon.
    pub pitch_deg: f64,
    /// Turn about that axis, positive where the left side is high.
    pub roll_deg: f64,
}

impl NodeMount {
    /// `None` of a level camera.
    pub(crate) fn of(found: &Levelness<f64>) -> Option<Self> {
        let Mounting { pitch, roll } = found.mounting;
        (!found.mounting.is_level()).then(|| Self {
            height: found.height,
            pitch_deg: pitch.to_degrees(),
            roll_deg: roll.to_degrees(),
        })
    }
}

/// Why firmware could not go on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// When.
    pub seconds: f64,
    /// In words.
    pub why: String,
}

/// Where a camera, or the frame of a network, really is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// Its centre, or origin.
    pub x: f64,
    /// Its centre, or origin.
    pub y: f64,
    /// Direction of the optical axis, or of the x axis.
    pub heading_deg: f64,
    /// Of a camera in a rehearsal: how it hangs.
    #[serde(flatten, deserialize_with = "space::flat")]
    pub hung: Option<Hung>,
}

/// Field of view, range and projection of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Full angle, the optical axis in its middle.
    pub fov_deg: f64,
    /// Farthest distance.
    pub range: f64,
}

/// A pose with its predicted uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Its centre.
    pub x: f64,
    /// Its centre.
    pub y: f64,
    /// Direction of the optical axis.
    pub heading_deg: f64,
    /// Predicted standard deviation; 0 where `x` was given.
    pub sigma_x: f64,
    /// Predicted standard deviation; 0 where `y` was given.
    pub sigma_y: f64,
    /// Predicted standard deviation.
    pub sigma_heading_deg: f64,
    /// Upper triangle of the covariance of `(x, y, heading)`, by rows: xx, xy, xt, yy, yt, tt.
    /// Headings in degrees here too.
    pub covariance: [f64; 6],
    /// Height, pitch and roll, where rows tell them.
    #[serde(flatten, deserialize_with = "space::flat")]
    pub hung: Option<HungEstimate>,
}

/// Most that a pose may be off because of one unnoticed wrong measurement: at most so much in 999 of 1,000
/// cases. See [`calib_core::joint`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Protection {
    /// Its place.
    pub position: f64,
    /// Its heading.
    pub heading_deg: f64,
}

/// Estimate minus truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseError {
    /// Signed.
    pub x: f64,
    /// Signed.
    pub y: f64,
    /// Signed, in `[-180, 180)`.
    pub heading_deg: f64,
    /// Signed, where both are known.
    #[serde(flatten, deserialize_with = "space::flat")]
    pub hung: Option<Hung>,
}

impl PoseError {
    /// An error on the floor.
    pub const fn new(x: f64, y: f64, heading_deg: f64) -> Self {
        Self {
            x,
            y,
            heading_deg,
            hung: None,
        }
    }

    fn vector(&self) -> Vector3<f64> {
        Vector3::new(self.x, self.y, self.heading_deg)
    }
}

/// One sighting, and how well it fits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Of which target.
    pub target: u16,
    /// At which of its stops.
    pub stop: u32,
    /// Where it was seen, positive to the left of the optical axis; of a camera that is not level as a level one in its
    /// place would see it.
    pub bearing_deg: f64,
    /// Bearing foretold by the estimate minus the one seen; `null` without an estimate.
    pub residual_deg: Option<f64>,
    /// The same over its standard deviation, the target's share included.
    pub normalised: Option<f64>,
}

/// Where a target went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// Number of its node.
    pub id: u16,
    /// Of which network.
    pub network: u16,
    /// The places of its stops, `[x, y]` each, in their order.
    pub path: Vec<[f64; 2]>,
    /// Where it stood.
    pub stops: Vec<Stop>,
}

/// One stop of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// Its number.
    pub stop: u32,
    /// Time when it began; `null` where that was not seen.
    pub seconds: Option<f64>,
    /// Where it really was; of a real network, where the target believed to be.
    pub x: f64,
    /// As `x`.
    pub y: f64,
    /// Where the target thought it was in the end; `null` if it never knew.
    pub believed: Option<Believed>,
}

/// A place with its predicted uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Believed {
    /// Place.
    pub x: f64,
    /// Place.
    pub y: f64,
    /// Predicted standard deviation.
    pub sigma_x: f64,
    /// Predicted standard deviation.
    pub sigma_y: f64,
}

/// Radio traffic.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Radio {
    /// Frames sent by all, acknowledgements included.
    pub frames: u64,
    /// Bytes sent by all, from preamble to check sequence.
    pub bytes: u64,
    /// Receptions that failed, by reason.
    pub drops: std::collections::BTreeMap<String, u64>,
    /// Duration of all frames together, as a share of the run's time: above 1 where many send at once, as on
    /// several channels.
    pub airtime_share: f64,
    /// Transmissions that came from no node, where there was an attacker. Counted above too, but for carriers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attack: Option<Attack>,
}

/// Transmissions of an attacker without the key: frames that were forged or heard again, and carriers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Attack {
    /// Frames.
    pub frames: u64,
    /// Their bytes, from preamble to check sequence.
    pub bytes: u64,
    /// Duration of frames and carriers together, as a share of the run's time.
    pub airtime_share: f64,
}

impl Stop {
    /// Where it really was.
    pub fn place(&self) -> Point2<f64> {
        Point2::new(self.x, self.y)
    }
}

impl Believed {
    /// Variance along any axis.
    pub fn variance(&self) -> f64 {
        (self.sigma_x * self.sigma_x + self.sigma_y * self.sigma_y) / 2.0
    }
}

impl Place {
    /// Origin of a frame that is this one.
    pub const ORIGIN: Self = Self::new(0.0, 0.0, 0.0);

    /// A place on the floor.
    pub const fn new(x: f64, y: f64, heading_deg: f64) -> Self {
        Self {
            x,
            y,
            heading_deg,
            hung: None,
        }
    }

    /// Its centre.
    pub fn position(&self) -> Point2<f64> {
        Point2::new(self.x, self.y)
    }

    /// The place as a frame.
    fn isometry(&self) -> Isometry2<f64> {
        let Self {
            x, y, heading_deg, ..
        } = *self;
        Isometry2::new(Vector2::new(x, y), heading_deg.to_radians())
    }

    /// The pose, exact.
    fn pose(&self) -> Pose<f64> {
        Pose {
            position: self.position(),
            heading: angle::wrap_positive(self.heading_deg.to_radians()),
            covariance: Matrix3::zeros(),
        }
    }
}

/// Degrees in `[0, 360)` of radians in `[0, 2 pi)`, whose product may round up to a whole turn.
pub fn heading_degrees(radians: f64) -> f64 {
    let degrees = radians.to_degrees();
    if degrees < 360.0 { degrees } else { 0.0 }
}

impl Estimate {
    /// The estimate as it stands in a record; `None` if a number is not finite.
    pub fn new(pose: &Pose<f64>) -> Option<Self> {
        let per_radian = 1_f64.to_degrees();
        let c = &pose.covariance;
        let estimate = Self {
            x: pose.position.x,
            y: pose.position.y,
            heading_deg: heading_degrees(pose.heading),
            sigma_x: pose.sigma_x(),
            sigma_y: pose.sigma_y(),
            sigma_heading_deg: pose.sigma_heading().to_degrees(),
            covariance: [
                c.m11,
                c.m12,
                c.m13 * per_radian,
                c.m22,
                c.m23 * per_radian,
                c.m33 * per_radian * per_radian,
            ],
            hung: None,
        };
        let place = estimate.x + estimate.y + estimate.heading_deg;
        let all = place + estimate.covariance.iter().sum::<f64>();
        all.is_finite().then_some(estimate)
    }

    /// The covariance, in units and degrees.
    fn matrix(&self) -> Matrix3<f64> {
        let [xx, xy, xt, yy, yt, tt] = self.covariance;
        Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt)
    }

    /// The pose in radians.
    pub fn pose(&self) -> Pose<f64> {
        let per_degree = 1_f64.to_radians();
        let [xx, xy, xt, yy, yt, tt] = self.covariance;
        let (xt, yt, tt) = (
            xt * per_degree,
            yt * per_degree,
            tt * per_degree * per_degree,
        );
        Pose {
            position: Point2::new(self.x, self.y),
            heading: angle::wrap_positive(self.heading_deg.to_radians()),
            covariance: Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt),
        }
    }

    /// See [`Pose::sigma_position`].
    pub fn sigma_position(&self) -> f64 {
        self.sigma_x.hypot(self.sigma_y)
    }
}

impl Node {
    /// Returns true if all but traffic, and when it was heard, is the same.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let Self {
            id,
            network,
            role,
            reference,
            expected,
            truth,
            planned,
            view,
            status,
            reason,
            estimate,
            error,
            protection,
            nees,
            sightings,
            used,
            chi_squared,
            done,
            lens,
            mount,
            moved,
            residuals,
            calibrated_seconds,
            silent,
            health,
            address,
            failures,
            page_erasures,
            heard_seconds: _,
            payload_bytes: _,
            bytes_sent: _,
            frames_sent: _,
        } = self;
        // The most frequent changes come first.
        *sightings == other.sightings
            && *status == other.status
            && *estimate == other.estimate
            && *address == other.address
            && *used == other.used
            && *residuals == other.residuals
            && *id == other.id
            && *network == other.network
            && *role == other.role
            && *reference == other.reference
            && *expected == other.expected
            && *truth == other.truth
            && *planned == other.planned
            && *view == other.view
            && *reason == other.reason
            && *error == other.error
            && *protection == other.protection
            && *nees == other.nees
            && *chi_squared == other.chi_squared
            && *done == other.done
            && *lens == other.lens
            && *mount == other.mount
            && *moved == other.moved
            && *calibrated_seconds == other.calibrated_seconds
            && *silent == other.silent
            && *health == other.health
            && *failures == other.failures
            && *page_erasures == other.page_erasures
    }

    /// A node of the first network, of which nothing is known yet.
    pub fn new(id: u16, role: Role) -> Self {
        Self {
            id,
            network: 1,
            role,
            reference: false,
            expected: false,
            truth: None,
            planned: None,
            view: None,
            status: (role == Role::Camera).then_some(Status::Waiting),
            reason: None,
            estimate: None,
            protection: None,
            error: None,
            nees: None,
            sightings: 0,
            used: 0,
            chi_squared: None,
            done: false,
            lens: None,
            mount: None,
            moved: None,
            residuals: Vec::new(),
            calibrated_seconds: None,
            heard_seconds: None,
            silent: false,
            health: Health::default(),
            address: None,
            failures: Vec::new(),
            payload_bytes: None,
            bytes_sent: None,
            frames_sent: None,
            page_erasures: None,
        }
    }

    /// Takes a pose over and compares it with the truth.
    pub fn set_pose(&mut self, pose: &Pose<f64>) {
        self.estimate = Estimate::new(pose);
        (self.error, self.nees) = match (&self.estimate, &self.truth) {
            (Some(estimate), Some(truth)) => {
                let true_heading = truth.heading_deg.to_radians();
                let turned = angle::wrap_signed(pose.heading - true_heading);
                let (x, y) = (estimate.x - truth.x, estimate.y - truth.y);
                let error = PoseError::new(x, y, turned.to_degrees());
                let nees = pose.normalised_error(truth.position(), true_heading);
                (Some(error), nees.filter(|nees| nees.is_finite()))
            }
            _ => (None, None),
        };
    }

    /// Takes sightings over, each with the number of its target and stop, and compares them with the estimate; so
    /// [`set_pose`](Self::set_pose) first. A node tells itself how many there are: a target may have counted some
    /// that the camera did not keep.
    pub fn set_sightings<'a>(
        &mut self,
        sightings: impl IntoIterator<Item = (u16, u32, &'a Sighting<f64>)>,
    ) {
        let pose = self.estimate.map(|estimate| estimate.pose());
        let residuals = sightings.into_iter().map(|(target, stop, sighting)| {
            let off = pose.map(|pose| residual(&pose, sighting));
            Residual {
                target,
                stop,
                bearing_deg: sighting.ray.bearing().to_degrees(),
                residual_deg: off.map(|(residual, _)| residual.to_degrees()),
                normalised: off.map(|(residual, sigma)| residual / sigma),
            }
        });
        self.residuals = residuals.collect();
    }

    /// Tells its places in another frame, in which its own one is here.
    fn move_by(&mut self, frame: &Isometry2<f64>) {
        let turned = frame.rotation.angle();
        for truth in [&mut self.truth, &mut self.planned].into_iter().flatten() {
            let place = frame * truth.position();
            let heading = truth.heading_deg.to_radians() + turned;
            *truth = Place {
                x: place.x,
                y: place.y,
                heading_deg: heading_degrees(angle::wrap_positive(heading)),
                hung: truth.hung,
            };
        }
        if let Some(estimate) = self.estimate {
            let pose = estimate.pose();
            let turn = frame.rotation.to_rotation_matrix().to_homogeneous();
            self.set_pose(&Pose {
                position: frame * pose.position,
                heading: angle::wrap_positive(pose.heading + turned),
                covariance: turn * pose.covariance * turn.transpose(),
            });
            if let Some(moved) = &mut self.estimate {
                moved.hung = estimate.hung.map(|hung| hung.moved(frame));
            }
            self.compare_hung();
        }
    }

    /// Returns true if it was never part of a network: it had no node to say anything to, and is on no list of
    /// members.
    pub fn never_joined(&self) -> bool {
        let said_nothing = match self.payload_bytes {
            Some(bytes) => bytes == 0,
            None => self.address.is_none() && self.role != Role::Coordinator,
        };
        said_nothing && self.estimate.is_none()
    }

    /// Returns true if its pose is estimated, and reliable but for what is not checked. Only then it matters
    /// whether it [is checked](Self::is_checked). The place of a reference is given.
    pub fn is_checkable(&self, limits: &Limits) -> bool {
        self.expected && !self.reference && (self.is_calibrated() || self.is_untested(limits))
    }

    /// Returns true if its pose is certain enough, and all the same no more than weak: no target has estimated this
    /// reference, or the pose hangs on a single measurement where several others were wrong.
    pub fn is_untested(&self, limits: &Limits) -> bool {
        let is_certain = |estimate: &Estimate| {
            estimate.sigma_position() <= limits.sigma_position
                && estimate.sigma_heading_deg <= limits.sigma_heading_deg
        };
        self.status == Some(Status::Weak) && self.estimate.as_ref().is_some_and(is_certain)
    }

    /// Returns true if one unnoticed wrong measurement could do [no harm](Limits::tolerate) to its pose.
    pub fn is_checked(&self, limits: &Limits) -> bool {
        self.is_checkable(limits) && self.protection.is_some_and(|level| limits.tolerate(&level))
    }

    /// Returns true if it is a camera whose rows tell that it is not level.
    pub fn is_tilted(&self) -> bool {
        self.mount.is_some()
    }

    /// Returns true if it is a camera that counts as calibrated.
    pub fn is_calibrated(&self) -> bool {
        self.status == Some(Status::Calibrated)
    }

    /// Fit of all its sightings to its pose, also of those that the pose leaves out.
    pub fn fit(&self) -> Fit<f64> {
        let normalised = self.residuals.iter().filter_map(|r| r.normalised);
        let (mut count, mut chi_squared) = (0_usize, 0.0);
        for normalised in normalised {
            count += 1;
            chi_squared += normalised * normalised;
        }
        // Two references have a heading each and the target's first place in common.
        let unknowns = if self.reference { 2 } else { 3 };
        Fit {
            chi_squared,
            degrees_of_freedom: count.saturating_sub(unknowns),
        }
    }

    /// Fit of its true error to its predicted covariance, for the part of its pose that was not given; `None`
    /// without a pose and a truth.
    pub fn truth_fit(&self) -> Option<Fit<f64>> {
        if let Some(nees) = self.nees {
            return Some(Fit {
                chi_squared: nees,
                degrees_of_freedom: 3,
            });
        }
        let (estimate, error) = (self.estimate?, self.error?);
        fit_where_estimated(&error.vector(), &estimate.matrix())
    }

    /// Fit of the true error of its position alone, as [`truth_fit`](Self::truth_fit).
    pub fn position_fit(&self) -> Option<Fit<f64>> {
        let (estimate, error) = (self.estimate?, self.error?);
        let place = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
        fit_where_estimated(&error.vector(), &(place * estimate.matrix() * place))
    }

    /// True error of its heading in degrees, and the same in its sigmas; `None` where the heading was given.
    pub fn heading_error(&self) -> Option<(f64, f64)> {
        let (estimate, error) = (self.estimate?, self.error?);
        let sigma = estimate.sigma_heading_deg;
        (sigma > 0.0).then(|| (error.heading_deg.abs(), error.heading_deg.abs() / sigma))
    }

    /// Returns true if it has a camera.
    pub fn is_camera(&self) -> bool {
        self.role == Role::Camera
    }
}

/// A variance below this share of the largest is rounding: that direction was given, and not estimated.
const GIVEN: f64 = 1e-9;

/// Squared error over covariance, in the directions that have a variance. `None` if none has.
fn fit_where_estimated(error: &Vector3<f64>, covariance: &Matrix3<f64>) -> Option<Fit<f64>> {
    // Units and degrees differ in size: only correlations tell which directions have no variance.
    let scale = covariance.diagonal().map(|variance| {
        if variance > 0.0 {
            variance.sqrt().recip()
        } else {
            0.0
        }
    });
    let scaling = Matrix3::from_diagonal(&scale);
    let eigen = (scaling * covariance * scaling).symmetric_eigen();
    let error = eigen.eigenvectors.transpose() * error.component_mul(&scale);
    let least = GIVEN * eigen.eigenvalues.max();
    let estimated = error
        .iter()
        .zip(&eigen.eigenvalues)
        .filter(|(_, variance)| **variance > least);
    let one = |(error, variance): (&f64, &f64)| Fit {
        chi_squared: error * error / variance,
        degrees_of_freedom: 1,
    };
    estimated.map(one).reduce(Fit::and)
}

/// A sighting's residual and its standard deviation, radians, as the [least
/// squares](calib_core::resection) see them.
fn residual(pose: &Pose<f64>, sighting: &Sighting<f64>) -> (f64, f64) {
    let to_target = sighting.target - pose.position;
    let range = to_target.norm();
    let foretold = to_target.y.atan2(to_target.x) - pose.heading;
    let across = nalgebra::Vector2::new(-to_target.y, to_target.x) / range;
    let sideways = across.dot(&(sighting.target_covariance * across)).max(0.0) / (range * range);
    let own = sighting.bearing_sigma * sighting.bearing_sigma;
    (
        angle::wrap_signed(foretold - sighting.ray.bearing()),
        (own + sideways).sqrt(),
    )
}

/// Why a record cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// Not the JSON of a record.
    #[error("it is not the record of a run: {0}")]
    Json(#[from] serde_json::Error),
    /// A record of another version.
    #[error("it has format {0}, and only format {FORMAT} can be read: make the run again")]
    Format(u32),
    /// Two nodes, targets or networks with one number, which runs do not have.
    #[error("it has {0} twice")]
    Twice(String),
    /// A node or a target of a network that is not there.
    #[error("{0} is of network {1}, which is not there")]
    NoNetwork(String, u16),
    /// Nothing that could be calibrated.
    #[error("it has no cameras")]
    NoCameras,
}

impl RunRecord {
    /// The record as JSON, ending with a line feed. With `wall_time` also the time it took.
    ///
    /// # Errors
    /// Those of the JSON writer, which a record does not give cause for.
    pub fn to_json(&self, wall_time: bool) -> Result<String, serde_json::Error> {
        let mut text = if wall_time || self.wall_seconds.is_none() {
            serde_json::to_string_pretty(self)?
        } else {
            serde_json::to_string_pretty(&Self {
                wall_seconds: None,
                ..self.clone()
            })?
        };
        text.push('\n');
        Ok(text)
    }

    /// Reads what [`to_json`](Self::to_json) wrote. The summary is made anew: whatever stands there, the reader
    /// is told nothing else than what the nodes say.
    ///
    /// # Errors
    /// [`RecordError`]
    pub fn from_json(text: &str) -> Result<Self, RecordError> {
        #[derive(Deserialize)]
        struct Version {
            format: u32,
        }
        let Version { format } = serde_json::from_str(text)?;
        if format != FORMAT {
            return Err(RecordError::Format(format));
        }
        let mut record: Self = serde_json::from_str(text)?;
        record.check()?;
        record.summary = Summary::of(&record.nodes);
        Ok(record)
    }

    /// Checks the other things that a record relies on.
    fn check(&self) -> Result<(), RecordError> {
        let networks = self.networks.iter().map(|n| ("network", n.network));
        let nodes = self.nodes.iter().map(|n| ("node", n.id));
        let targets = self.targets.iter().map(|t| ("target", t.id));
        let sightings = self
            .sightings
            .iter()
            .map(|s| ("sightings of network", s.network));
        let mut seen = BTreeSet::new();
        for (what, id) in networks.chain(nodes).chain(targets).chain(sightings) {
            if !seen.insert((what, id)) {
                return Err(RecordError::Twice(format!("{what} {id}")));
            }
        }
        let nodes = self.nodes.iter().map(|n| ("node", n.id, n.network));
        let targets = self.targets.iter().map(|t| ("target", t.id, t.network));
        for (what, id, network) in nodes.chain(targets) {
            if !seen.contains(&("network", network)) {
                return Err(RecordError::NoNetwork(format!("{what} {id}"), network));
            }
        }
        match self.cameras().next() {
            Some(_) => Ok(()),
            None => Err(RecordError::NoCameras),
        }
    }

    /// The cameras, by ascending number.
    pub fn cameras(&self) -> impl Iterator<Item = &Node> {
        self.nodes.iter().filter(|node| node.is_camera())
    }

    /// Returns true if the coordinator of a network never spoke.
    pub(crate) fn is_unheard(&self, network: u16) -> bool {
        self.nodes.iter().any(|node| {
            let is_unheard = node.silent && node.heard_seconds.is_none();
            node.role == Role::Coordinator && node.network == network && is_unheard
        })
    }

    /// Returns true if there are several networks, each with a frame of its own.
    pub fn has_networks(&self) -> bool {
        self.networks.len() > 1
    }

    /// Where the frame of a network is in that of the first one.
    pub(crate) fn frame(&self, network: u16) -> Isometry2<f64> {
        let mut networks = self.networks.iter();
        let own = networks.find(|own| own.network == network);
        own.map_or_else(Isometry2::identity, |own| own.frame.isometry())
    }

    /// Where the frame of a network is in the building, if that is known.
    pub(crate) fn building(&self, network: u16) -> Option<Isometry2<f64>> {
        let mut networks = self.networks.iter();
        let own = networks.find(|own| own.network == network)?;
        Some(own.building?.isometry())
    }

    /// The same run with the places of all networks in the frame of the first one, each network standing where it
    /// really does. The sigmas of targets' places stay along the axes of their own network's frame.
    pub fn in_one_frame(&self) -> Self {
        self.moved(|network| self.frame(network))
    }

    /// Standard deviations, along and across the baseline, of the place that was given to a reference; `None` if the camera
    /// is none, or its place was told as exact. The baseline's share moves the second one alone.
    pub fn surveyed_sigmas(&self, camera: &Node) -> Option<[f64; 2]> {
        let measured = { self.sightings.iter() }.find(|own| own.network == camera.network)?;
        let (survey, references) = (measured.survey?, measured.references?);
        let place = references.cameras.iter().position(|id| *id == camera.id)?;
        let stretched = survey.baseline_sigma * references.baseline? * place as f64;
        let across = survey.position_sigma;
        let along = across.hypot(stretched);
        (along > 0.0).then_some([along, across])
    }

    /// The same run with all places in the coordinates of the building; `None` if it is not known where a
    /// network's frame is in it. As in [`in_one_frame`](Self::in_one_frame), sigmas of targets' places stay along
    /// the axes of their network.
    pub fn in_building(&self) -> Option<Self> {
        let all_known = self.networks.iter().all(|own| own.building.is_some());
        let frame = |network| self.building(network).unwrap_or_else(Isometry2::identity);
        all_known.then(|| {
            let mut record = self.moved(frame);
            for own in &mut record.networks {
                own.building = Some(own.frame);
            }
            record
        })
    }

    /// A node with its places in the coordinates of the building; `None` if it is not known where its network is.
    pub fn node_in_building(&self, node: &Node) -> Option<Node> {
        let mut placed = node.clone();
        placed.move_by(&self.building(node.network)?);
        Some(placed)
    }

    /// Returns true if all places are in the coordinates of the building, as [`in_building`](Self::in_building) makes
    /// them, or those are the coordinates of its only network.
    pub fn is_in_building(&self) -> bool {
        let here = Place::ORIGIN;
        self.networks.iter().all(|own| own.building == Some(here))
    }

    /// The same run as people are told of it: in the frame of the site's file, or as it is where that is not known.
    pub fn for_people(&self) -> Cow<'_, Self> {
        self.in_building().map_or(Cow::Borrowed(self), Cow::Owned)
    }

    /// The same run with the places of every network moved into one frame.
    fn moved(&self, by: impl Fn(u16) -> Isometry2<f64>) -> Self {
        let mut record = self.clone();
        for own in &mut record.networks {
            own.frame = Place::ORIGIN;
            // The former frame of the network is gone.
            own.building = None;
        }
        // Obstacles are told in the frame of the first network.
        let first = self.networks.first().map(|first| by(first.network));
        for corner in record
            .obstacles
            .iter_mut()
            .flatten()
            .chain(&mut record.area)
        {
            let place = first.unwrap_or_else(Isometry2::identity) * Point2::from(*corner);
            *corner = place.into();
        }
        for node in &mut record.nodes {
            node.move_by(&by(node.network));
        }
        for target in &mut record.targets {
            let frame = by(target.network);
            for place in &mut target.path {
                *place = (frame * Point2::from(*place)).into();
            }
            for stop in &mut target.stops {
                let truth = frame * Point2::new(stop.x, stop.y);
                (stop.x, stop.y) = (truth.x, truth.y);
                if let Some(believed) = &mut stop.believed {
                    let place = frame * Point2::new(believed.x, believed.y);
                    (believed.x, believed.y) = (place.x, place.y);
                }
            }
        }
        record.summary = Summary::of(&record.nodes);
        record
    }

    /// The outline of where a person can walk, in the frame of a network; empty if that is not told.
    pub(crate) fn area_of(&self, network: u16) -> Vec<Point2<f64>> {
        let frame = self.frame(network).inverse();
        let corners = self.area.iter().map(|&corner| frame * Point2::from(corner));
        corners.collect()
    }

    /// The outlines of the obstacles in the frame of a network.
    pub(crate) fn obstacles_of(&self, network: u16) -> Vec<Vec<Point2<f64>>> {
        let frame = self.frame(network).inverse();
        let outlines = self.obstacles.iter();
        outlines
            .map(|outline| {
                let corners = outline.iter().map(|&[x, y]| frame * Point2::new(x, y));
                corners.collect()
            })
            .collect()
    }

    /// The scenario with its path and seed, for headings.
    pub fn title(&self) -> String {
        let name = name(&self.scenario, self.path);
        match self.seed {
            Some(seed) => format!("{name}, seed {seed}"),
            None => name,
        }
    }

    /// The stop that a residual is of.
    fn stop(&self, residual: &Residual) -> Option<&Stop> {
        let mut targets = self.targets.iter();
        let target = targets.find(|target| target.id == residual.target)?;
        target.stops.iter().find(|stop| stop.stop == residual.stop)
    }
}

/// A scenario with its path.
fn name(scenario: &str, path: Option<u32>) -> String {
    let path = path.map(|path| format!(", path {path}"));
    format!("{scenario}{}", path.unwrap_or_default())
}
