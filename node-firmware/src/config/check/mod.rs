//! Every range of a configuration, in one place.

use core::fmt;

use calib_core::camera::Camera;
use zigbee_link::{
    network::{Channels, JOIN_WINDOW_MAX},
    radio::Channel,
    security::Key,
};

use super::{
    CHANNELS, CameraConfig, Config, CoordinatorConfig, LensSigma, RoleConfig, SensorConfig,
    Subjects, TargetConfig,
};
use crate::{
    limits::{COLOURS_MAX, CONSOLE_BAUD, REFERENCE_STOPS, STOPS_WANTED},
    vision::{CameraKind, ColourWindow, Lens, LensError},
};

/// A configuration in which everything is in its range, and the values that follow from it: a node runs on
/// this. [`Config::check`] makes it, and nothing changes it.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedConfig {
    config: Config,
    key: Key,
    channels: Channels,
    baud: BaudRate,
    optics: Camera<f32>,
}

impl CheckedConfig {
    /// The settings, as they were checked.
    pub const fn settings(&self) -> &Config {
        &self.config
    }

    /// The site key, as the network takes it.
    pub const fn key(&self) -> Key {
        self.key
    }

    /// The channels, as the network takes them.
    pub const fn channels(&self) -> Channels {
        self.channels
    }

    /// The rate of the UART: that of a camera's CMUcam2, or of a coordinator's console.
    pub const fn baud(&self) -> BaudRate {
        self.baud
    }

    /// Directions of a camera's columns. For a node without a camera: those of a usual one.
    pub const fn optics(&self) -> Camera<f32> {
        self.optics
    }

    /// A target's step sensor; for other nodes, which have none, any.
    pub const fn sensor(&self) -> &SensorConfig {
        match &self.config.role {
            RoleConfig::Target(target) => &target.sensor,
            RoleConfig::Coordinator(_) | RoleConfig::Camera(_) => &SensorConfig::UNCALIBRATED,
        }
    }
}

/// The rates that a CMUcam2's jumpers select, bits per second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum BaudRate {
    /// 1,200.
    B1200 = 1_200,
    /// 2,400.
    B2400 = 2_400,
    /// 4,800.
    B4800 = 4_800,
    /// 9,600.
    B9600 = 9_600,
    /// 19,200.
    B19200 = 19_200,
    /// 38,400.
    B38400 = 38_400,
    /// 57,600.
    B57600 = 57_600,
    /// 115,200.
    B115200 = 115_200,
}

impl BaudRate {
    /// All of them, the highest first.
    pub const ALL: [Self; 8] = [
        Self::B115200,
        Self::B57600,
        Self::B38400,
        Self::B19200,
        Self::B9600,
        Self::B4800,
        Self::B2400,
        Self::B1200,
    ];

    /// Bits per second.
    pub const fn bits_per_second(self) -> u32 {
        self as u32
    }

    /// That of so many bits per second.
    pub fn of(bits_per_second: u32) -> Option<Self> {
        let is_it = |rate: &Self| rate.bits_per_second() == bits_per_second;
        Self::ALL.into_iter().find(is_it)
    }
}

/// A coordinator's console, and whatever is on the line of a target.
const CONSOLE: BaudRate = BaudRate::B115200;
const _: () = assert!(CONSOLE.bits_per_second() == CONSOLE_BAUD);

/// The lens of a node without a camera.
const NO_LENS: Lens = Lens::pin_hole(88, 45.0);

/// The wrong part of a configuration. The texts say what it must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ConfigError {
    /// Index 0, or bytes that were not drawn at random.
    SiteKey,
    /// No channel, or one that there is not.
    Channels,
    /// The transmit power is not -40 to 20 dBm.
    TxPower,
    /// An EUI-64 of the allow-list is no address, or is there twice.
    Allow,
    /// The join window is longer than [`JOIN_WINDOW_MAX`].
    JoinWindow,
    /// The length of the unit.
    Unit,
    /// There is no such lens.
    Lens(LensError),
    /// The lens has more columns than the camera can count, or others.
    Columns,
    /// The CMUcam2 has no jumpers for the baud rate.
    Baud,
    /// The first column has neither number 0 nor 1.
    FirstColumn,
    /// There is no colour, or one whose lowest level is above its highest.
    Colours,
    /// The threshold of frame differencing is not 1 to 224.
    Threshold,
    /// Signatures or tags of a camera that has none, none of one that has, or too many.
    Signatures,
    /// The position of a reference is not finite.
    ReferencePosition,
    /// The baseline is not above 0.
    Baseline,
    /// The heading of the displacements' frame is more than a turn.
    FrameHeading,
    /// So many stops are too few for the reference solve, or more than are kept.
    ReferenceStops,
    /// The stops wanted are not [`STOPS_WANTED`].
    Stops,
    /// The sigmas that are good enough.
    GoodEnough,
    /// The sigmas of a weak pose.
    Weak,
    /// The floor of a sighting's sigma.
    SigmaFloor,
    /// The target's colour number is not below [`COLOURS_MAX`].
    TargetColour,
    /// The time without a step.
    StillAfter,
    /// The systematic errors of the step sensor.
    Systematic,
    /// The standing sigma of the target.
    StandingSigma,
    /// A lens is known to less than half of its focal length, or to less than 20 degrees.
    LensSigma,
    /// The references are known to less than half of their distance, or to less than 1000 units.
    SurveySigma,
    /// The radius of the ball.
    BallRadius,
    /// The times of a stop.
    Dwell,
    /// The step sensor's hard iron or step length.
    Sensor,
    /// The firmware was built without this role.
    Role,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SiteKey => {
                "site-key needs an index of 1 to 255 and 16 random bytes: make one with a key \
                 generator"
            }
            Self::Channels => "channels must have one or more of the bits 11 to 26, and no others",
            Self::TxPower => "tx-power must be -40 to 20 dBm",
            Self::Allow => "allow must hold numbers of nodes, from 1, none of them twice",
            Self::JoinWindow => "join-window-s must be 0 to 600",
            Self::Lens(error) => return write!(f, "lens: {error}"),
            Self::Columns => {
                "lens: a CMUcam2 has at most 255 columns, a Pixy2 has 316, a Pixy or an OpenMV 320, or 160 with its \
                 script for tags"
            }
            Self::Baud => "baud must be one of 115200, 57600, 38400, 19200, 9600, 4800, 2400, 1200",
            Self::FirstColumn => "first-column must be 0 or 1",
            Self::Colours => {
                "subjects: 1 to 4 colours, each lowest level not above its highest one"
            }
            Self::Threshold => "subjects: the threshold must be 1 to 224",
            Self::Signatures => {
                "subjects: only a Pixy2, a Pixy or an OpenMV looks for signatures, 1 to 4 that it was taught, and \
                 for nothing else; only an OpenMV with its script for tags looks for tags"
            }
            Self::ReferencePosition => "reference: the position must be two finite numbers",
            Self::Baseline => "baseline must be above 0, or left out if it is not known",
            Self::FrameHeading => {
                "frame-heading-deg must be -360 to 360, or left out if it is not known"
            }
            Self::ReferenceStops => {
                return write!(
                    f,
                    "reference-stops must be 2 to {REFERENCE_STOPS}, and 3 or more unless baseline \
                     and frame-heading-deg are both given"
                );
            }
            Self::Stops => {
                let (fewest, most) = (STOPS_WANTED.start(), STOPS_WANTED.end());
                return write!(f, "stops must be {fewest} to {most}");
            }
            Self::GoodEnough => {
                "good-enough: both sigmas must be above 0, the heading's at most 180"
            }
            Self::Weak => {
                "weak: both sigmas must be at least the good-enough ones, the heading's at most 180"
            }
            Self::SigmaFloor => "sigma-floor-px must be 0 to 10",
            Self::TargetColour => "colour must be 0 to 3",
            Self::StillAfter => "still-after-ms must be 100 to 60000",
            Self::Systematic => "systematic-heading-deg must be 0 to 180, systematic-scale 0 to 1",
            Self::StandingSigma => "standing-sigma must be 0 to 1000",
            Self::LensSigma => "lens-sigma: focal must be 0 to 0.5, principal-deg and tilt-deg 0 to 20",
            Self::SurveySigma => "survey-sigma: baseline must be 0 to 0.5, position 0 to 1000",
            Self::Unit => "metres-per-unit must be 0.0001 to 100000",
            Self::BallRadius => "ball-radius must be 0 to 1000, 0 if it is not known",
            Self::Dwell => "dwell-least-ms must be at most dwell-most-ms, and that at most 3600000",
            Self::Sensor => "sensor: hard-iron must be -400 to 400 uT, step-length above 0",
            Self::Role => "role: this firmware was built without it (features of `node-firmware`)",
        })
    }
}

impl core::error::Error for ConfigError {}

impl Config {
    /// The configuration, if everything is in its range.
    ///
    /// # Errors
    /// The first part that is out of its range.
    pub fn check(self) -> Result<CheckedConfig, ConfigError> {
        require(&[
            (self.channels & !CHANNELS == 0, ConfigError::Channels),
            ((-40..=20).contains(&self.tx_power), ConfigError::TxPower),
        ])?;
        let is_built = match self.role {
            RoleConfig::Coordinator(_) => cfg!(feature = "coordinator"),
            RoleConfig::Camera(_) => cfg!(feature = "camera"),
            RoleConfig::Target(_) => cfg!(feature = "target"),
        };
        if !is_built {
            return Err(ConfigError::Role);
        }
        let key = self.site_key.key().ok_or(ConfigError::SiteKey)?;
        let channels = channels(self.channels).ok_or(ConfigError::Channels)?;
        let (lens, baud) = match &self.role {
            RoleConfig::Camera(camera) => (&camera.lens, BaudRate::of(camera.baud)),
            RoleConfig::Coordinator(_) | RoleConfig::Target(_) => (&NO_LENS, Some(CONSOLE)),
        };
        let optics = lens.camera().map_err(ConfigError::Lens)?;
        let baud = baud.ok_or(ConfigError::Baud)?;
        match &self.role {
            RoleConfig::Coordinator(coordinator) => coordinator.check(),
            RoleConfig::Camera(camera) => camera.check(),
            RoleConfig::Target(target) => target.check(),
        }?;
        Ok(CheckedConfig {
            config: self,
            key,
            channels,
            baud,
            optics,
        })
    }
}

/// The channels of a mask; those that do not exist are left out.
fn channels(mask: u32) -> Option<Channels> {
    (11..=26)
        .filter(|number| mask >> number & 1 != 0)
        .filter_map(Channel::new)
        .fold(None, |all: Option<Channels>, channel| {
            Some(all.map_or(Channels::only(channel), |all| all.and(channel)))
        })
}

impl CoordinatorConfig {
    fn check(&self) -> Result<(), ConfigError> {
        let once = |number: &u16| self.allow.iter().filter(|n| *n == number).count() == 1;
        let window = u64::from(self.join_window_s);
        require(&[
            (
                self.allow.iter().all(|n| *n > 0 && once(n)),
                ConfigError::Allow,
            ),
            (window <= JOIN_WINDOW_MAX.as_secs(), ConfigError::JoinWindow),
            (
                (1e-4..=1e5).contains(&self.metres_per_unit),
                ConfigError::Unit,
            ),
            (
                (0.0..=1000.0).contains(&self.ball_radius),
                ConfigError::BallRadius,
            ),
        ])
    }
}

impl CameraConfig {
    fn check(&self) -> Result<(), ConfigError> {
        let subjects = match &self.subjects {
            Subjects::Colours(windows) => (
                !windows.is_empty() && windows.iter().all(ColourWindow::is_ordered),
                ConfigError::Colours,
            ),
            Subjects::Motion { threshold } => {
                ((1..=224).contains(threshold), ConfigError::Threshold)
            }
            Subjects::Signatures(taught) => (
                (1..=COLOURS_MAX).contains(&usize::from(*taught)),
                ConfigError::Signatures,
            ),
            Subjects::Tags => (true, ConfigError::Signatures),
        };
        let columns = self.lens.columns;
        let is_taught = matches!(self.subjects, Subjects::Signatures(_));
        let sees_tags = matches!(self.subjects, Subjects::Tags);
        let (columns_fit, subjects_fit) = match self.kind.model() {
            None => (columns <= 255, !is_taught && !sees_tags),
            Some(model) => (
                columns == model.size()[0],
                match self.kind {
                    CameraKind::OpenMvTags => sees_tags,
                    _ => is_taught,
                },
            ),
        };
        let fewest = if self.baseline.is_some() && self.frame_heading_deg.is_some() {
            2
        } else {
            3
        };
        let (good, weak) = (self.good_enough, self.weak);
        require(&[
            (columns_fit, ConfigError::Columns),
            (subjects_fit, ConfigError::Signatures),
            (self.first_column <= 1, ConfigError::FirstColumn),
            subjects,
            (
                self.reference.is_none_or(|reference| reference.is_usable()),
                ConfigError::ReferencePosition,
            ),
            (self.baseline.is_none_or(is_positive), ConfigError::Baseline),
            (
                self.frame_heading_deg
                    .is_none_or(|heading| heading.abs() <= 360.0),
                ConfigError::FrameHeading,
            ),
            (
                (fewest..=REFERENCE_STOPS).contains(&usize::from(self.reference_stops)),
                ConfigError::ReferenceStops,
            ),
            (STOPS_WANTED.contains(&self.stops), ConfigError::Stops),
            (
                is_positive(good.position)
                    && is_positive(good.heading_deg)
                    && good.heading_deg <= 180.0,
                ConfigError::GoodEnough,
            ),
            (
                weak.position.is_finite()
                    && weak.position >= good.position
                    && (good.heading_deg..=180.0).contains(&weak.heading_deg),
                ConfigError::Weak,
            ),
            (
                (0.0..=10.0).contains(&self.sigma_floor_px),
                ConfigError::SigmaFloor,
            ),
            (self.lens_sigma.is_usable(), ConfigError::LensSigma),
        ])
    }
}

impl LensSigma {
    fn is_usable(&self) -> bool {
        let degrees = [self.principal_deg, self.tilt_deg];
        (0.0..=0.5).contains(&self.focal)
            && degrees.iter().all(|sigma| (0.0..=20.0).contains(sigma))
    }
}

impl TargetConfig {
    fn check(&self) -> Result<(), ConfigError> {
        require(&[
            (
                usize::from(self.colour) < COLOURS_MAX,
                ConfigError::TargetColour,
            ),
            (
                (100..=60_000).contains(&self.still_after_ms),
                ConfigError::StillAfter,
            ),
            (
                (0.0..=180.0).contains(&self.systematic_heading_deg)
                    && (0.0..=1.0).contains(&self.systematic_scale),
                ConfigError::Systematic,
            ),
            (
                // Its square must be finite, too.
                (0.0..=1000.0).contains(&self.standing_sigma),
                ConfigError::StandingSigma,
            ),
            (self.lens_sigma.is_usable(), ConfigError::LensSigma),
            (
                (0.0..=0.5).contains(&self.survey_sigma.baseline)
                    && (0.0..=1000.0).contains(&self.survey_sigma.position),
                ConfigError::SurveySigma,
            ),
            (
                (0.0..=1000.0).contains(&self.ball_radius),
                ConfigError::BallRadius,
            ),
            (
                self.dwell_least_ms <= self.dwell_most_ms && self.dwell_most_ms <= 3_600_000,
                ConfigError::Dwell,
            ),
            (
                // The range of the compass.
                self.sensor.hard_iron.iter().all(|iron| iron.abs() <= 400.0)
                    && is_positive(self.sensor.step_length),
                ConfigError::Sensor,
            ),
        ])
    }
}

fn require(conditions: &[(bool, ConfigError)]) -> Result<(), ConfigError> {
    match conditions.iter().find(|(holds, _)| !holds) {
        Some(&(_, error)) => Err(error),
        None => Ok(()),
    }
}

fn is_positive(value: f32) -> bool {
    value > 0.0 && value.is_finite()
}

#[cfg(test)]
mod tests;
