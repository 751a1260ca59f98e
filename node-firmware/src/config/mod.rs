//! Settings that a node gets before it is switched on.
//!
//! | module | job |
//! |---|---|
//! | here | [`Config`] and its parts |
//! | [`check`] | Every range, in one place: [`Config::check`], which makes a [`CheckedConfig`] |
//! | [`page`] | A configuration as a page of flash |
//!
//! Angles are degrees here, because people write them; lengths are in the target's unit, whatever
//! it is. In text formats, names are in kebab case.

pub mod check;
pub mod page;

mod key;

use calib_core::{Limits, camera::Camera, level::Tolerance};
use flash_log::Crc32;
use heapless::Vec;
use pixy_driver::Model;
use serde::{Deserialize, Serialize};
use zigbee_link::security::Protection;

pub use self::{
    check::{BaudRate, CheckedConfig, ConfigError},
    key::SiteKey,
};
use crate::limits::{COLOURS_MAX, MEMBERS};
use crate::message::{Duty, Reference};
use crate::vision::{
    CameraKind, ColourWindow, Judge, Lens, Patience, Shape, Subject, cmucam2::Cmucam2Settings,
};

/// All settings of a node, as people and pages have them: values may be out of their range. [`Config::check`]
/// makes a [`CheckedConfig`] of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Config {
    /// The number by which people know this node.
    pub id: u16,
    /// The key of the site.
    pub site_key: SiteKey,
    /// The 2.4 GHz channels the network may use: bit n is channel n, 11 to 26.
    pub channels: u32,
    /// Transmit power, dBm.
    pub tx_power: i8,
    /// Protection of frames.
    #[serde(with = "protection")]
    pub protection: Protection,
    /// Role of the node.
    pub role: RoleConfig,
    /// Devices of its network sleep while that is quiet: true of all nodes of a site, or of none.
    // Behind all else in a page, where older ones have nothing.
    #[serde(skip)]
    pub sleeps: bool,
}

/// The channels that there are.
pub(crate) const CHANNELS: u32 = 0x07FF_F800;

/// Role of a node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RoleConfig {
    /// Forms the network and collects poses.
    Coordinator(CoordinatorConfig),
    /// Has a camera, and wants to know where it stands.
    Camera(CameraConfig),
    /// Is carried about to be seen.
    Target(TargetConfig),
}

impl RoleConfig {
    /// The bit of the role in a set of roles.
    pub const fn bit(&self) -> u8 {
        match self {
            Self::Coordinator(_) => 1,
            Self::Camera(_) => 2,
            Self::Target(_) => 4,
        }
    }

    /// The roles that this build has.
    pub const BUILT: u8 = {
        let coordinator = if cfg!(feature = "coordinator") { 1 } else { 0 };
        let camera = if cfg!(feature = "camera") { 2 } else { 0 };
        let target = if cfg!(feature = "target") { 4 } else { 0 };
        coordinator | camera | target
    };
}

/// Parameters of a coordinator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct CoordinatorConfig {
    /// Numbers of the nodes that may always join.
    pub allow: Vec<u16, MEMBERS>,
    /// Time after start-up in which any device with the site key may join, seconds; 0: not at all.
    pub join_window_s: u16,
    /// Length of the unit of the site: the movements of tracked objects are known in metres.
    pub metres_per_unit: f32,
    /// Radius of these objects, in the unit of the site; 0: not known. If it is known, the width of an object
    /// in the picture tells its range.
    pub ball_radius: f32,
}

impl Default for CoordinatorConfig {
    /// Only nodes that are let in join; the unit is the metre.
    fn default() -> Self {
        Self {
            allow: Vec::new(),
            join_window_s: 0,
            metres_per_unit: 1.0,
            ball_radius: 0.0,
        }
    }
}

/// Parameters of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct CameraConfig {
    /// Kind of the camera.
    pub kind: CameraKind,
    /// Lens: directions of the columns.
    pub lens: Lens,
    /// Baud rate that the CMUcam2's jumpers select, or that is set in the others.
    pub baud: u32,
    /// Number of the first column in the CMUcam2's packets, 0 or 1. Nothing to others.
    pub first_column: u8,
    /// Appearance of the target.
    pub subjects: Subjects,
    /// True if a target of a colour is a ball: a blob that is narrower than tall is then partly
    /// hidden.
    pub round: bool,
    /// The duty of a configured reference camera.
    pub reference: Option<Reference>,
    /// True if it may become a reference when none is configured (trigger or helper).
    pub may_be_elected: bool,
    /// Distance of the two reference cameras, if it is known.
    pub baseline: Option<f32>,
    /// Direction of the x axis of the target's displacements in the frame whose x axis runs from
    /// the first to the second reference camera, degrees, if it is known.
    pub frame_heading_deg: Option<f32>,
    /// Stops after which the reference solve is first tried: 2, or 3 when something above is not
    /// known, up to [`REFERENCE_STOPS`](crate::limits::REFERENCE_STOPS).
    pub reference_stops: u8,
    /// Stops at which it wants to see the target, at least 3.
    pub stops: u8,
    /// True if it goes on refining its pose after these.
    pub refine: bool,
    /// The pose is good enough when both predicted sigmas are within these, and no more stops are
    /// wanted.
    pub good_enough: Sigmas,
    /// A predicted sigma above these makes the pose [weak](calib_core::Status::Weak), and another
    /// stop is asked for.
    pub weak: Sigmas,
    /// Standard deviation of a sighting that no frame shows, columns.
    pub sigma_floor_px: f32,
    /// Sigmas of its lens.
    pub lens_sigma: LensSigma,
}

/// Standard deviations of what is said of lenses and how cameras are put up, zero where it is exact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct LensSigma {
    /// Of the focal length, as a share of it, up to 0.5.
    pub focal: f32,
    /// Of the principal column, degrees off the axis, up to 20.
    pub principal_deg: f32,
    /// Of the pitch and roll of a camera that is put up level, degrees, up to 20.
    pub tilt_deg: f32,
}

impl LensSigma {
    /// A lens that is exactly what it is said to be, of a camera that is exactly level. Its installer promises that.
    pub const EXACT: Self = Self {
        focal: 0.0,
        principal_deg: 0.0,
        tilt_deg: 0.0,
    };

    /// A lens of which no more is known than its field of view by the sheet of its kind, of a camera on a bracket.
    pub const UNMEASURED: Self = Self {
        focal: 0.05,
        principal_deg: 1.2,
        tilt_deg: 2.0,
    };

    /// Each the larger of two.
    #[must_use]
    pub fn larger(self, other: Self) -> Self {
        Self {
            focal: self.focal.max(other.focal),
            principal_deg: self.principal_deg.max(other.principal_deg),
            tilt_deg: self.tilt_deg.max(other.tilt_deg),
        }
    }

    /// The standard deviations of a bearing's tangent: of its scale, and of what is added to it.
    pub fn of_tangent(&self) -> [f32; 2] {
        [self.focal, self.principal_deg.to_radians()]
    }

    /// Tolerance of the test whether cameras are level, for a ball that stands within this sigma.
    pub fn tolerance(&self, standing_sigma: f32) -> Tolerance<f32> {
        Tolerance {
            tilt: self.tilt_deg.to_radians(),
            bob: standing_sigma,
        }
    }
}

/// Standard deviations of the places of the references, zero where they are exact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct SurveySigma {
    /// Of their distance, as a share of it, up to 0.5: what a tape is too long or too short.
    pub baseline: f32,
    /// Of each place, along each axis, in the unit of the site, up to 1000.
    pub position: f32,
}

impl SurveySigma {
    /// References that stand exactly where they are said to stand. Their installer promises that.
    pub const EXACT: Self = Self {
        baseline: 0.0,
        position: 0.0,
    };

    /// Places that a person measured, where the unit is the metre. A tape errs by 1 % and 1 cm. But nothing in a
    /// network tests its baseline, and people also pace it, or read the tape wrongly: 2.5 % hold up to a baseline
    /// that is a tenth off. A better value can be told.
    pub const MEASURED: Self = Self {
        baseline: 0.025,
        position: 0.01,
    };
}

/// Standard deviations of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sigmas {
    /// Standard deviation of the position: [`Pose::sigma_position`](calib_core::Pose::sigma_position).
    pub position: f32,
    /// Standard deviation of the heading, degrees.
    pub heading_deg: f32,
}

impl Sigmas {
    /// As the limits of a pose.
    pub fn limits(&self) -> Limits<f32> {
        Limits {
            position: self.position,
            heading: self.heading_deg.to_radians(),
        }
    }
}

/// Appearance of the target to a camera.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Subjects {
    /// A colour for each target colour number, from 0.
    Colours(Vec<ColourWindow, COLOURS_MAX>),
    /// Whatever differs from the background by this many levels.
    Motion {
        /// Levels; 5 to 20 is usual.
        threshold: u8,
    },
    /// So many colours that the camera was taught beforehand, as a Pixy2 is: the target's colour
    /// number 0 is its signature 1, and so on.
    Signatures(u8),
    /// Tags: the target's colour number is that of its tag.
    Tags,
}

impl Subjects {
    /// A checksum of the configured colours.
    pub(crate) fn checksum(&self) -> u32 {
        let mut sum = Crc32::new();
        if let Self::Colours(windows) = self {
            for ColourWindow { red, green, blue } in windows {
                for levels in [red, green, blue] {
                    sum.add(levels);
                }
            }
        }
        sum.sum()
    }

    /// Returns true if a colour can get this number: they are numbered without gaps.
    #[cfg_attr(not(feature = "camera"), allow(dead_code))]
    pub(crate) fn has_room_for(&self, colour: u8) -> bool {
        let place = usize::from(colour);
        matches!(self, Self::Colours(windows) if place <= windows.len() && place < COLOURS_MAX)
    }

    /// Gives a colour this window, if there is room for it.
    #[cfg_attr(not(feature = "camera"), allow(dead_code))]
    pub(crate) fn learn(&mut self, colour: u8, window: ColourWindow) {
        if let Self::Colours(windows) = self {
            match windows.get_mut(usize::from(colour)) {
                Some(known) => *known = window,
                None => drop(windows.push(window)),
            }
        }
    }

    /// The subject to look for when a target of this colour number stands somewhere. `None` for a colour that
    /// is not known here.
    pub fn of_target(&self, colour: u8) -> Option<Subject> {
        match self {
            Self::Colours(windows) => windows
                .get(usize::from(colour))
                .copied()
                .map(Subject::Colour),
            &Self::Motion { threshold } => Some(Subject::Motion { threshold }),
            &Self::Signatures(taught) => {
                (colour < taught).then(|| Subject::Signature(colour.saturating_add(1)))
            }
            Self::Tags => Some(Subject::Tag(colour)),
        }
    }
}

/// Parameters of a target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct TargetConfig {
    /// Its colour number, below [`COLOURS_MAX`].
    pub colour: u8,
    /// It stands when no step came for so long, milliseconds.
    pub still_after_ms: u32,
    /// Standard deviation of the step sensor's constant error of heading, degrees.
    pub systematic_heading_deg: f32,
    /// Standard deviation of the step sensor's constant error of distance, as a share of it.
    pub systematic_scale: f32,
    /// Standing sigma: standard deviation of its place during a stop, each axis.
    pub standing_sigma: f32,
    /// Radius of the ball that cameras see, in the unit of the site; 0: not known. Its width in a picture
    /// then tells its distance.
    pub ball_radius: f32,
    /// The least time of a stop, milliseconds.
    pub dwell_least_ms: u32,
    /// The most time of a stop, milliseconds: then it may walk on, even if cameras have not answered.
    pub dwell_most_ms: u32,
    /// True if it goes over to the network of the site that it hears best, when no camera of its own saw it
    /// at a stop.
    pub roams: bool,
    /// Sigmas of the cameras' lenses.
    pub lens_sigma: LensSigma,
    /// Sigmas of the references' places.
    pub survey_sigma: SurveySigma,
    /// Of a step sensor that the board has: other boards do not look at it.
    pub sensor: SensorConfig,
}

/// Properties of an inertial step sensor and its carrier, see [`steps`](crate::steps).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct SensorConfig {
    /// Excess of the compass reading on each of its axes, uT: the magnetism of the breakout and of its
    /// carrier, worn as it is when walking.
    pub hard_iron: [f32; 3],
    /// `K` of [`StepLength`](pedestrian::StepLength): the carrier's step length, in
    /// the unit of the site over (m/s^2)^(1/4).
    pub step_length: f32,
}

impl CameraConfig {
    /// A camera of 38,400 baud that may be elected, for a ball, with usual values for the rest.
    pub fn new(lens: Lens, subjects: Subjects) -> Self {
        Self {
            kind: CameraKind::Cmucam2,
            lens,
            baud: 38_400,
            first_column: 1,
            subjects,
            round: true,
            reference: None,
            may_be_elected: true,
            baseline: None,
            frame_heading_deg: None,
            reference_stops: 3,
            stops: 3,
            refine: true,
            good_enough: Sigmas {
                position: 0.02,
                heading_deg: 0.1,
            },
            weak: Sigmas {
                position: 0.5,
                heading_deg: 10.0,
            },
            sigma_floor_px: Patience::default().sigma_floor,
            lens_sigma: LensSigma::UNMEASURED,
        }
    }

    /// A camera of the Pixy family as it is shipped, that was taught so many signatures.
    pub fn pixy(model: Model, signatures: u8) -> Self {
        let [columns, _] = model.size();
        let lens = Lens::pin_hole(columns, model.field_of_view_deg());
        let subjects = match model {
            Model::OpenMvTags => Subjects::Tags,
            _ => Subjects::Signatures(signatures),
        };
        Self {
            kind: model.into(),
            baud: Model::BAUD,
            ..Self::new(lens, subjects)
        }
    }

    /// Settings of the CMUcam2.
    pub const fn cmucam2(&self) -> Cmucam2Settings {
        Cmucam2Settings {
            first_column: self.first_column,
            ..Cmucam2Settings::new(self.lens.columns)
        }
    }

    /// Returns true if blobs have the shape of a ball. Blocks of frame differencing show none, people are not round, and
    /// tags are seen at an angle.
    pub const fn has_round_targets(&self) -> bool {
        self.round
            && matches!(
                self.subjects,
                Subjects::Colours(_) | Subjects::Signatures(_)
            )
    }

    /// The judge of the camera's frames, through the optics of its lens.
    pub fn judge(&self, optics: Camera<f32>) -> Judge {
        let patience = Patience {
            sigma_floor: self.sigma_floor_px,
            ..Patience::default()
        };
        let shape = if self.has_round_targets() {
            Shape::Round {
                rows_per_column: self.kind.rows_per_column(),
                optics: Some(optics),
            }
        } else {
            Shape::Any
        };
        Judge::new(optics, patience, shape)
    }
}

impl Default for TargetConfig {
    /// A walking person of whom nothing is known, with a step sensor: stands after 1.5 s without a
    /// step; systematic errors of 3 degrees and 8 %; waits up to two minutes.
    fn default() -> Self {
        Self {
            colour: 0,
            still_after_ms: 1_500,
            systematic_heading_deg: 3.0,
            systematic_scale: 0.08,
            standing_sigma: 0.02,
            ball_radius: 0.0,
            dwell_least_ms: 2_000,
            dwell_most_ms: 120_000,
            roams: false,
            lens_sigma: LensSigma::UNMEASURED,
            survey_sigma: SurveySigma::MEASURED,
            sensor: SensorConfig::UNCALIBRATED,
        }
    }
}

impl SensorConfig {
    /// Nothing magnetic, and an adult's step in metres.
    pub const UNCALIBRATED: Self = Self {
        hard_iron: [0.0; 3],
        step_length: 0.45,
    };
}

impl Default for SensorConfig {
    fn default() -> Self {
        Self::UNCALIBRATED
    }
}

impl Config {
    /// A node on any channel, at 0 dBm, with 64 bits of integrity in each frame. Other values are set in its fields.
    pub const fn new(id: u16, site_key: SiteKey, role: RoleConfig) -> Self {
        Self {
            id,
            site_key,
            channels: CHANNELS,
            tx_power: 0,
            protection: Protection::EncMic64,
            role,
            sleeps: false,
        }
    }

    /// k1 and k2 of a camera's lens that has a distortion.
    fn distortion(&self) -> Option<[f32; 2]> {
        match &self.role {
            RoleConfig::Camera(camera) => {
                Some(camera.lens.distortion).filter(|distortion| *distortion != [0.0; 2])
            }
            _ => None,
        }
    }

    /// Number of the owner of the facts that the [memory](crate::facts) may hold. It changes with the site,
    /// the node's number and role, and with the parts of a camera's configuration that give its sightings and
    /// its frame their meaning. Facts learnt before such a change would be false after it: addresses are
    /// those of another site, bearings those of another lens. The number does not show that a node became a
    /// member of another network of the same site: the memory is [begun
    /// anew](crate::facts::FactStore::forget) where a membership becomes void.
    pub fn owner(&self) -> u32 {
        // No configuration has this number.
        let float = |number: Option<f32>| number.unwrap_or(f32::NAN).to_le_bytes();
        let (index, key) = self.site_key.parts();
        let [id_low, id_high] = self.id.to_le_bytes();
        let kind = match &self.role {
            RoleConfig::Coordinator(_) => 0,
            RoleConfig::Camera(_) => 1,
            RoleConfig::Target(_) => 2,
        };
        let mut sum = Crc32::new();
        sum.add(key);
        sum.add(&[index, id_low, id_high, kind]);
        if let RoleConfig::Camera(camera) = &self.role {
            let lens = &camera.lens;
            let [columns_low, columns_high] = lens.columns.to_le_bytes();
            let (duty, position) = match camera.reference {
                None => (0, None),
                Some(Reference {
                    duty: Duty::First,
                    position,
                }) => (1, position),
                Some(Reference {
                    duty: Duty::Second,
                    position,
                }) => (2, position),
            };
            let projection = lens.projection as u8;
            sum.add(&[
                columns_low,
                columns_high,
                projection,
                camera.first_column,
                camera.kind as u8,
                duty,
            ]);
            for number in [
                Some(lens.field_of_view_deg),
                lens.principal_column,
                position.map(|[x, _]| x),
                position.map(|[_, y]| y),
                camera.baseline,
                camera.frame_heading_deg,
            ] {
                sum.add(&float(number));
            }
            // So that a lens without any has the number that it had before there was a distortion.
            if let Some(distortion) = self.distortion() {
                for k in distortion {
                    sum.add(&k.to_le_bytes());
                }
            }
        }
        sum.sum()
    }
}

/// A [`Protection`] as the security level of IEEE 802.15.4-2006, 7.6.2.2.1: 5 or 6.
mod protection {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};
    use zigbee_link::security::Protection;

    pub(super) fn serialize<S: Serializer>(
        protection: &Protection,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.serialize_u8(match protection {
            Protection::EncMic32 => 5,
            Protection::EncMic64 => 6,
        })
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Protection, D::Error> {
        match u8::deserialize(deserializer)? {
            5 => Ok(Protection::EncMic32),
            6 => Ok(Protection::EncMic64),
            _ => Err(D::Error::custom("the security level must be 5 or 6")),
        }
    }
}

#[cfg(test)]
pub(crate) mod examples;
