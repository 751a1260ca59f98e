//! Messages between nodes: one postcard-encoded [`Message`] in each secured frame.
//!
//! Numbers of variants are the wire format. Variants are never changed or reordered, only added at
//! the end; a node that does not know one counts and ignores it.
//!
//! A message with a number that is not finite, a sigma below zero or a matrix that is no covariance
//! does not decode.
//!
//! Everything may be lost, doubled or late. So a stop has a number that its target never uses
//! twice, and every message can be repeated without harm.
//!
//! # The thesis's packets (Appendix B) and theirs here
//! | thesis | here |
//! |---|---|
//! | trigger signal (2.3) | [`Message::Trigger`] |
//! | `20 40`, "you are in my field of view" (Fig. G) | [`Message::Look`] with [`Sight::InView`] |
//! | `20 30`, "in range, not in my field of view" (Fig. L) | [`Message::Look`] with [`Sight::NotInView`] and its kin |
//! | none: a camera counted what it saw at once | [`Message::Confirmed`] |
//! | `20 'S' x y id` (Fig. H) | [`Message::Stopped`] in [`CoordinateFrame::Site`] |
//! | `20 'M' 0 ... id`, "no location for you" (Fig. M) | [`Message::Stopped`] in [`CoordinateFrame::Own`]; a camera that is done is not asked |
//! | `id x y heading` (Fig. J) | [`Message::Report`] |
//! | counters of given and taken locations | [`StopAnswer::counted`]: the camera's own count, repeated with each answer |
//! | frames exchanged by the references (2.3) | [`Message::Bearing`] |
//! | the target's location told by node 0 (2.6.1) | [`Message::Located`] |

mod health;
mod outcome;
mod update;

pub use self::{
    health::{Eye, Health, Memory, Restart},
    outcome::CommandOutcome,
    update::UpdatePacket,
};

use calib_core::{
    Limits, Pose, Ray, Real, Refusal, Status,
    camera::Projection,
    dead_reckoning::Place,
    fit::Fit,
    joint::{ProtectionLevels, is_consensus},
    level::{Elevation, Mounting},
};
use nalgebra::{Matrix2, Point2};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use zigbee_link::wire::ShortAddress;

use crate::{arithmetic::root, limits::ROSTER};

/// Numbers the stops of one target. Never repeats.
pub type StopNumber = u16;

/// A member's [`ShortAddress`] as it travels: its number.
pub type MemberAddress = u16;

/// Contents of one secured frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Message {
    /// A member presents itself to the coordinator, after joining and when asked.
    Hello(Hello),
    /// The coordinator asks all members but these, or one, for [`Message::Hello`] and [`Message::Report`].
    WhoIsThere(heapless::Vec<MemberAddress, ROSTER>),
    /// The coordinator tells a target the cameras: these, and those of other such messages.
    Roster(heapless::Vec<MemberAddress, ROSTER>),
    /// The coordinator tells reference cameras, and former ones, which cameras the references are.
    References(References),
    /// A target stands.
    Stopped(Stopped),
    /// A camera's answer to [`Message::Stopped`].
    Look(StopAnswer),
    /// A camera without duty sees a target that does not know its place: to the coordinator.
    Trigger {
        /// Address of the target.
        target: MemberAddress,
        /// At which of its stops.
        stop: StopNumber,
    },
    /// A camera's bearing at a stop of which the target does not know the place: to the first reference
    /// camera, or, from a camera that knows its own pose, to the target.
    Bearing(StopBearing),
    /// The first reference camera tells a target its place.
    Located(TargetLocation),
    /// A pose that another node solved for a camera: the first reference camera for the second one, or a
    /// target, from all measurements, for each camera that it knows.
    Posed(Report),
    /// A camera tells its status: to the coordinator and to targets.
    Report(Report),
    /// The coordinator gives a command to a camera.
    Command(CameraCommand),
    /// Result of a [`CameraCommand`].
    Done(CommandResult),
    /// Present look of a camera that tracks for the coordinator.
    Tracked(Tracked),
    /// The coordinator asks a camera for [`Message::Sighting`]s.
    Sightings,
    /// One sighting of a camera.
    Sighting(ListedSighting),
    /// To all: names the cameras whose looks at a stop came while the target still stood there.
    Confirmed(Confirmation),
    /// A member tells the coordinator its health, after its [`Message::Hello`], which says that it is
    /// healthy.
    Health(Health),
    /// Part of an update by radio: the coordinator hands it on for the PC, and a member's answer to the PC.
    Update(UpdatePacket),
}

/// Kind of a member.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MemberKind {
    /// It looks at targets, and finds its own pose.
    Camera {
        /// Its duty as a reference, if one is configured.
        reference: Option<Reference>,
    },
    /// It walks, and tells cameras its place.
    Target,
}

/// A configured reference camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reference {
    /// Its duty as first or second.
    pub duty: Duty,
    /// Its position, x and y, if that is known. The positions of both fix the frame of the site. With one or
    /// none, the first one is the origin and the second one on the x axis.
    pub position: Option<[f32; 2]>,
}

impl Reference {
    /// Returns true if the position, if told, is finite.
    pub fn is_usable(&self) -> bool {
        all_finite(self.position.iter().flatten())
    }
}

/// Duty of each of the two reference cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Duty {
    /// The one that solves (the trigger).
    First,
    /// The one that sends its rays to the first (the helper).
    Second,
}

/// A member presents itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hello {
    /// The number by which people know the node.
    pub id: u16,
    /// Kind of the member.
    pub kind: MemberKind,
}

/// The two reference cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct References {
    /// Address of the one that solves.
    pub first: MemberAddress,
    /// Address of the one that tells the first its bearings.
    pub second: MemberAddress,
    /// Their positions, if both were told: these fix the frame of the site. If not, the first one is its
    /// origin and the second one on its x axis.
    pub positions: Option<[[f32; 2]; 2]>,
}

impl References {
    /// There are none any more: a camera that sees a target that does not know its place may become one.
    pub const NONE: Self = Self {
        first: 0,
        second: 0,
        positions: None,
    };

    /// Returns true if these are two cameras.
    pub const fn are_two(&self) -> bool {
        self.first != self.second
    }

    /// The duty of a member.
    pub const fn duty_of(&self, member: ShortAddress) -> Option<Duty> {
        if member.0 == self.first {
            Some(Duty::First)
        } else if member.0 == self.second {
            Some(Duty::Second)
        } else {
            None
        }
    }
}

/// x and y in the frame of the site, and their covariance `[xx, xy, yy]`.
pub type SitePlace = ([f32; 2], [f32; 3]);

/// A target stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stopped {
    /// Number of the stop.
    pub stop: StopNumber,
    /// The one of the cameras' colours that the target wears.
    pub colour: u8,
    /// Frame of `place`.
    pub frame: CoordinateFrame,
    /// Place of the target. Its numbers are checked when it is decoded.
    pub place: Place<f32>,
}

impl Stopped {
    /// Place of the target, if it knows it.
    pub fn told(&self) -> Option<SitePlace> {
        let (place, covariance) = (self.place.position(), self.place.covariance());
        (self.frame == CoordinateFrame::Site).then_some((
            [place.x, place.y],
            [covariance.m11, covariance.m21, covariance.m22],
        ))
    }
}

/// Frame of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CoordinateFrame {
    /// Only to other stops of this target with the same [`fix`](calib_core::dead_reckoning::PlaceParts::fix):
    /// the target does not know where it is.
    Own,
    /// To the site, the frame of the reference cameras.
    Site,
}

/// A target heard that these cameras saw it at a stop, while it stood there.
///
/// A camera does not use its looks from before: a [`Stopped`] says where the target stood when it was sent,
/// and it may have been on its way for long.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Confirmation {
    /// Number of the stop.
    pub stop: StopNumber,
    /// Cameras that saw it: the last ones if there is no room for all. The others repeat their answers.
    pub seen_by: heapless::Vec<MemberAddress, CONFIRMED>,
}

/// Cameras in one [`Confirmation`].
pub const CONFIRMED: usize = 24;

/// Result of a camera's look at a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sight {
    /// The target, whole and steady.
    InView,
    /// Nothing of the target is in view.
    NotInView,
    /// The target is cut off by the border of the picture.
    Clipped,
    /// Something that does not stand still.
    Unsteady,
    /// The camera did not look. None answers so any more, for every bearing is of use to the target.
    NotLooking,
    /// The camera does not work.
    Failed,
    /// The camera is still starting: ask again in a while.
    NotReady,
    /// The target is hidden in part, or looks too small for its distance.
    Hidden,
    /// The target is not alone, or looks too large for its distance: something else has its colour, or only a part of
    /// it has.
    Several,
}

/// A camera's answer to a stop. A camera that saw the target repeats it until it is
/// [confirmed](Confirmation). The link does not acknowledge an answer that it is not in view.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StopAnswer {
    /// Number of the stop.
    pub stop: StopNumber,
    /// Result of the look.
    pub sight: Sight,
    /// Direction of a target [in view](Sight::InView).
    pub seen: Option<Seen>,
    /// Sightings the camera has now.
    pub counted: u8,
    /// The camera needs no more stops.
    pub done: bool,
}

/// Unit of [`Seen::half_width`], radians.
const HALF_WIDTH_UNIT: f32 = 1e-4;

/// Standard deviation of a range by errors that no frame shows, as a share of it: the uncertainty of the
/// ball's size, of the camera's focal length, and of the place where a colour begins.
pub(crate) const SIZE_SHARE: f32 = 0.03;

/// A range whose standard deviation is a larger share of it is none: its error would be lopsided.
pub const RANGE_LIMIT: f32 = 0.1;

/// A direction with its sigma, radians; positive to the left of the optical axis. And the width of the target
/// there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Seen {
    /// Radians from the optical axis, positive to the left.
    pub bearing: f32,
    /// Its standard deviation, radians, above zero.
    pub sigma: f32,
    /// Half the angular width of the target, tenths of a milliradian; 0: not known. Its standard deviation is
    /// that of the bearing: one is half the sum, the other half the difference of two edges.
    pub half_width: u16,
    /// Direction above the camera's own horizontal plane, as well known as the bearing.
    pub elevation: Elevation,
}

impl Seen {
    /// A direction of a target of unknown width.
    pub const fn direction(bearing: f32, sigma: f32) -> Self {
        Self {
            bearing,
            sigma,
            half_width: 0,
            elevation: Elevation::UNKNOWN,
        }
    }

    /// The same for a target so far above the camera's own horizontal plane.
    pub const fn above(self, elevation: Elevation) -> Self {
        Self { elevation, ..self }
    }

    /// The same for a target whose edges are so far from its middle, radians.
    pub fn wide(self, half_width: f32) -> Self {
        Self {
            // The conversion saturates, and a value that is not a number becomes 0.
            half_width: (half_width / HALF_WIDTH_UNIT + 0.5) as u16,
            ..self
        }
    }

    /// Half its angular width, radians; 0: not known.
    pub fn half_angle(&self) -> f32 {
        f32::from(self.half_width) * HALF_WIDTH_UNIT
    }

    /// Distance of a ball of this radius that is seen so, and its standard deviation, both in the unit of the
    /// radius: `r / sin a` (thesis 5.2 asks for the size as a measurement). `None` if its width is not known,
    /// or not well enough to tell its range within [`RANGE_LIMIT`]; the ray from the edge to the eye touches
    /// the ball at a right angle wherever the ball is in view.
    pub fn range(&self, radius: f32) -> Option<(f32, f32)> {
        let half_width = self.half_angle();
        let (sine, cosine) = Real::sine_cosine(half_width);
        let range = radius / sine;
        let share = self.sigma * cosine / sine;
        let share = root(share * share + SIZE_SHARE * SIZE_SHARE);
        let is_known = half_width > 0.0
            && half_width < core::f32::consts::FRAC_PI_2
            && range > 0.0
            && range.is_finite()
            && share < RANGE_LIMIT;
        is_known.then_some((range, range * share))
    }

    /// Radius of a ball that is so far away in the plane, and its standard deviation, in the unit of the distance.
    /// `None` if its width is not known.
    #[inline(never)] // for less flash
    pub fn radius(&self, along: f32, mount: Option<Mount>) -> Option<(f32, f32)> {
        let range = match mount {
            Some(mount) => root(along * along + mount.height * mount.height),
            // The camera's own horizontal plane is level.
            None => along / Real::sine_cosine(self.elevation.radians().unwrap_or(0.0_f32)).1,
        };
        (self.half_width > 0).then(|| (range * self.half_angle(), range * self.sigma))
    }

    /// The direction as a ray.
    pub fn ray(&self) -> Ray<f32> {
        Ray::from_bearing(self.bearing)
    }

    /// Returns true if both numbers are finite and the sigma is above zero.
    pub fn is_usable(&self) -> bool {
        self.bearing.is_finite() && self.sigma.is_finite() && self.sigma > 0.0
    }
}

/// A camera's sighting of a target that does not know its place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StopBearing {
    /// Address of the target.
    pub target: MemberAddress,
    /// At which of its stops.
    pub stop: StopNumber,
    /// Direction in which the camera saw it.
    pub seen: Seen,
    /// The camera's own pose, if it has one.
    pub pose: Option<PoseParts>,
}

/// Place where a target stood.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TargetLocation {
    /// At which stop.
    pub stop: StopNumber,
    /// x and y in the frame of the site.
    pub position: [f32; 2],
    /// Covariance `[xx, xy, yy]`.
    pub covariance: [f32; 3],
    /// Direction of the x axis of the target's own frame in the site's, radians.
    pub frame_heading: f32,
    /// Its standard deviation.
    pub frame_heading_sigma: f32,
}

/// A [`Pose`] as it travels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PoseParts {
    /// x and y.
    pub position: [f32; 2],
    /// Direction of the optical axis in the frame of the site, radians from its x axis.
    pub heading: f32,
    /// Covariance of (x, y, heading): `xx, xy, yy, xh, yh, hh`.
    pub covariance: [f32; 6],
}

/// Status of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report {
    /// The number by which people know the camera.
    pub id: u16,
    /// It is a reference camera.
    pub duty: Option<Duty>,
    /// Sightings it has.
    pub sightings: u8,
    /// Sightings the pose uses.
    pub used: u8,
    /// Sum of the squared residuals, each over its variance.
    pub chi_squared: f32,
    /// It needs no more stops.
    pub done: bool,
    /// A target solved the pose, together with all measurements of the network: the possible effect of one
    /// wrong measurement that no test noticed.
    pub joint: Option<ProtectionLevel>,
    /// State of the camera's knowledge.
    pub state: CameraState,
    /// Its mounting, if it is not level.
    pub mount: Option<Mount>,
}

/// Bound on the error of a pose although one of the measurements that it rests on is wrong and no test
/// noticed it. The largest number there is where nothing checks one of them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ProtectionLevel {
    /// The place, in the unit of the site.
    pub position: f32,
    /// The heading, radians.
    pub heading: f32,
}

impl ProtectionLevel {
    /// Nothing checks it.
    pub const NONE: Self = Self {
        position: f32::MAX,
        heading: f32::MAX,
    };

    /// The place of a reference is given, or says what the frame is: nothing checks that.
    pub const OF_REFERENCE: Self = Self {
        heading: 0.0,
        ..Self::NONE
    };

    /// Returns true if [nothing checks it](Self::NONE).
    pub fn is_none(&self) -> bool {
        self.heading == f32::MAX
    }

    /// Returns true if a pose that may be so far off is [checked](Limits::tolerate) all the same.
    pub fn is_tolerated(&self, limits: &Limits<f32>) -> bool {
        limits.tolerate(self.position, self.heading)
    }

    /// Returns true if both numbers are finite and not below zero.
    pub fn is_usable(&self) -> bool {
        all_finite([&self.position, &self.heading]) && self.position >= 0.0 && self.heading >= 0.0
    }
}

impl From<ProtectionLevels<f32>> for ProtectionLevel {
    fn from(levels: ProtectionLevels<f32>) -> Self {
        Self {
            position: levels
                .position_bearing
                .max(levels.position_leg)
                .min(f32::MAX),
            heading: levels.heading_bearing.max(levels.heading_leg).min(f32::MAX),
        }
    }
}

/// Knowledge of a camera about itself: a [`Status`], and its data.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraState {
    /// Fewer sightings than a pose needs.
    Waiting,
    /// The sightings give no pose.
    Refused(Refusal),
    /// A pose as certain as the camera was told to be, which the sightings fit.
    Calibrated(PoseParts),
    /// A pose that the sightings fit, less certain than that.
    Weak(PoseParts),
    /// A pose that the sightings contradict.
    Doubtful(PoseParts),
    /// The sightings contradict the lens that was configured, and fit another one: the pose with that.
    OtherLens(PoseParts, FittingLens),
}

/// Mounting of a camera that is not level, as its rows tell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Mount {
    /// Angle of its optical axis below the horizon, hundredths of a degree.
    pitch: i16,
    /// Turn about the axis, positive where the left side is high, hundredths of a degree.
    roll: i16,
    /// Height above the ball, in the unit of the site.
    pub height: f32,
}

impl Mount {
    /// `None` of a level camera.
    pub fn of(mounting: Mounting<f32>, height: f32) -> Option<Self> {
        // Conversions saturate.
        let hundredths = |angle: f32| (angle.to_degrees() * 100.0) as i16;
        (!mounting.is_level()).then_some(Self {
            pitch: hundredths(mounting.pitch),
            roll: hundredths(mounting.roll),
            height,
        })
    }

    /// Pitch and roll, degrees.
    pub fn degrees(self) -> [f32; 2] {
        [self.pitch, self.roll].map(|angle| f32::from(angle) / 100.0)
    }

    /// A direction as a level camera with the same heading would see it; `None` if its row is not known.
    pub fn upright(self, seen: &Seen) -> Option<Seen> {
        let [pitch, roll] = self.degrees().map(f32::to_radians);
        let upright = Mounting { pitch, roll }.seen(seen.bearing, seen.elevation.radians()?);
        Some(Seen {
            bearing: upright.azimuth(),
            elevation: Elevation::from_radians(upright.elevation()),
            ..*seen
        })
    }
}

/// A lens, in two bytes: its field of view in tenths of a degree, and its projection in the highest
/// bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FittingLens(u16);

impl FittingLens {
    const EQUAL_ANGLE: u16 = 1 << 15;
    /// Tenths of a degree.
    const WIDEST: f32 = 3600.0;

    /// From the field of view, radians: from the middle of the first column to that of the last one.
    pub fn new(projection: Projection, field_of_view: f32) -> Self {
        let tenths = (field_of_view.to_degrees() * 10.0).clamp(0.0, Self::WIDEST) as u16;
        Self(match projection {
            Projection::PinHole => tenths,
            Projection::EqualAngle => tenths | Self::EQUAL_ANGLE,
        })
    }

    /// Projection of the lens.
    pub const fn projection(self) -> Projection {
        if self.0 & Self::EQUAL_ANGLE == 0 {
            Projection::PinHole
        } else {
            Projection::EqualAngle
        }
    }

    /// Its field of view, degrees.
    pub fn field_of_view_deg(self) -> f32 {
        f32::from(self.0 & !Self::EQUAL_ANGLE) / 10.0
    }
}

// Derived, it would compare poses in three places, each in flash.
impl PartialEq for CameraState {
    fn eq(&self, other: &Self) -> bool {
        self.status() == other.status()
            && self.refusal() == other.refusal()
            && self.lens() == other.lens()
            && self.pose() == other.pose()
    }
}

impl CameraState {
    /// A pose, judged. Numbers that are no pose's leave it undetermined.
    pub fn judged(parts: PoseParts, fit: &Fit<f32>, limits: &Limits<f32>) -> Self {
        let Some(pose) = parts.pose() else {
            return Self::Refused(Refusal::Undetermined);
        };
        match Status::of(&pose, fit, limits) {
            Status::Calibrated => Self::Calibrated(parts),
            Status::Doubtful => Self::Doubtful(parts),
            _ => Self::Weak(parts),
        }
    }

    /// The same by other limits, weak at best if it [is not tested](Report::is_tested).
    #[must_use]
    pub fn judged_again(self, limits: &Limits<f32>, is_tested: bool) -> Self {
        match self {
            Self::Calibrated(parts) | Self::Weak(parts) if is_tested => {
                Self::judged(parts, &Fit::default(), limits)
            }
            other => other.untested(),
        }
    }

    /// The same, weak at best.
    #[must_use]
    pub const fn untested(self) -> Self {
        match self {
            Self::Calibrated(parts) => Self::Weak(parts),
            other => other,
        }
    }

    /// The same, doubtful if too few of all sightings [agree](is_consensus) with a pose.
    #[must_use]
    pub fn supported(self, counting: usize, all: usize, is_checked: bool) -> Self {
        match self {
            Self::Calibrated(parts) | Self::Weak(parts)
                if !is_consensus(counting, all, is_checked) =>
            {
                Self::Doubtful(parts)
            }
            other => other,
        }
    }

    /// Status of the camera.
    pub const fn status(&self) -> Status {
        match self {
            Self::Waiting => Status::Waiting,
            Self::Refused(_) => Status::Refused,
            Self::Calibrated(_) => Status::Calibrated,
            Self::Weak(_) => Status::Weak,
            Self::Doubtful(_) | Self::OtherLens(..) => Status::Doubtful,
        }
    }

    /// Reason why there is no pose, if it was refused.
    pub const fn refusal(&self) -> Option<Refusal> {
        match self {
            Self::Refused(refusal) => Some(*refusal),
            _ => None,
        }
    }

    /// The pose, if there is one, whatever it is worth.
    pub const fn pose(&self) -> Option<&PoseParts> {
        match self {
            Self::Calibrated(pose)
            | Self::Weak(pose)
            | Self::Doubtful(pose)
            | Self::OtherLens(pose, _) => Some(pose),
            Self::Waiting | Self::Refused(_) => None,
        }
    }

    /// The lens that fits, where the one that was configured does not.
    pub const fn lens(&self) -> Option<FittingLens> {
        match self {
            Self::OtherLens(_, lens) => Some(*lens),
            _ => None,
        }
    }
}

impl Report {
    /// Returns true if more than its own sightings speak for the pose. A reference's own solve takes it for granted that
    /// neither was moved, until a target has estimated both with everything else; and of a camera an estimate may
    /// [tell no level](ProtectionLevel::NONE). Without an estimate, its sightings of a target that knows its place count.
    pub fn is_tested(&self) -> bool {
        match self.joint {
            Some(level) => self.duty.is_some() || !level.is_none(),
            None => self.duty.is_none(),
        }
    }

    /// Returns true if chi squared is finite and not below zero.
    pub fn is_usable(&self) -> bool {
        self.chi_squared.is_finite()
            && self.chi_squared >= 0.0
            && self.mount.is_none_or(|mount| mount.height.is_finite())
            && self.joint.is_none_or(|level| level.is_usable())
    }

    /// Worth of the camera's pose, or the reason why there is none.
    pub const fn status(&self) -> Status {
        self.state.status()
    }

    /// The pose, if there is one, whatever it is worth.
    pub const fn pose(&self) -> Option<&PoseParts> {
        self.state.pose()
    }

    /// Direction that the camera sees, turned upright: its pose is that of a level camera. `None` without the row of a camera that
    /// is not level.
    pub fn upright(&self, seen: Seen) -> Option<Seen> {
        self.mount.map_or(Some(seen), |mount| mount.upright(&seen))
    }
}

/// Commands of the coordinator to a camera, as those of the thesis's PC program (Appendix A).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CameraCommand {
    /// "Initialize": reset, adapt to the light, then fix gain and white balance.
    Initialise,
    /// "Object kept": learn the colour of the object in the middle of the view.
    LearnColour {
        /// Number of the colour that it becomes.
        colour: u8,
    },
    /// Take the present view as the background, for finding what differs.
    LearnBackground,
    /// "Start to track": send raw packets until told to stop.
    Track {
        /// Number of the colour in the configuration.
        colour: u8,
    },
    /// "Stop tracking": no more raw packets.
    StopTracking,
    /// Forget pose and sightings.
    Forget,
}

/// Result of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CommandResult {
    /// The command.
    pub command: CameraCommand,
    /// Its outcome.
    pub outcome: CommandOutcome,
}

/// A blob as the camera told it; all zero when nothing was tracked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TrackedBlob {
    /// Middle mass column and row.
    pub middle: [u16; 2],
    /// Left, upper, right, lower edge.
    pub edges: [u16; 4],
    /// Pixels, as the camera counts them; 0 if it does not tell.
    pub pixels: u8,
    /// Share of the rectangle that the blob fills, as the camera tells it: 256 times the share, at
    /// most 255; 0 if it does not tell.
    pub confidence: u8,
}

/// View of a camera that tracks, in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tracked {
    /// The blob, as the camera told it.
    pub blob: TrackedBlob,
    /// Age of the blob when this was sent, milliseconds.
    pub age_ms: u16,
    /// Its direction, unless nothing is in view, or only a part of it.
    pub seen: Option<Seen>,
    /// It is wider than an object of its height: there may be several in it.
    pub is_wide: bool,
}

/// A sighting that a camera has.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ListedSighting {
    /// Its number among the camera's.
    pub index: u8,
    /// Number of all sightings of the camera.
    pub count: u8,
    /// Address of the target.
    pub target: MemberAddress,
    /// At which of its stops.
    pub stop: StopNumber,
    /// Place where the target said that it stood.
    pub position: [f32; 2],
    /// Standard deviation of that place, x and y together.
    pub position_sigma: f32,
    /// Direction in which the camera saw it.
    pub seen: Seen,
}

/// Decoded values are sound, here and in the memory: their users need not doubt the numbers.
macro_rules! sound {
    ($($type:ident),+ $(,)?) => {$(
        impl Serialize for $type {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                Self::serialize(self, serializer)
            }
        }

        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let value = Self::deserialize(deserializer)?;
                let is_sound = value.is_usable().then_some(value);
                is_sound.ok_or_else(|| D::Error::custom("a number out of range"))
            }
        }
    )+};
}

sound!(
    References,
    Seen,
    TargetLocation,
    PoseParts,
    Report,
    ListedSighting
);

fn all_finite<'a>(numbers: impl IntoIterator<Item = &'a f32>) -> bool {
    numbers.into_iter().all(|number| number.is_finite())
}

/// A symmetric 2x2 matrix from `[xx, xy, yy]`.
pub(crate) fn matrix([xx, xy, yy]: [f32; 3]) -> Matrix2<f32> {
    Matrix2::new(xx, xy, xy, yy)
}

/// `[xx, xy, yy]` of a symmetric matrix.
pub(crate) fn triangle(matrix: &Matrix2<f32>) -> [f32; 3] {
    [matrix.m11, matrix.m12, matrix.m22]
}

impl References {
    /// Returns true if the positions, if told, are finite.
    pub fn is_usable(&self) -> bool {
        all_finite(self.positions.iter().flatten().flatten())
    }
}

impl TargetLocation {
    /// A place, as a person tells it. Of the target's steps it says nothing.
    pub const fn of_place((position, covariance): SitePlace) -> Self {
        Self {
            stop: 0,
            position,
            covariance,
            frame_heading: 0.0,
            frame_heading_sigma: 0.0,
        }
    }

    /// Returns true if the numbers are finite and the sigma is not below zero.
    pub fn is_usable(&self) -> bool {
        let angles = [self.frame_heading, self.frame_heading_sigma];
        all_finite(self.position.iter().chain(&self.covariance).chain(&angles))
            && self.frame_heading_sigma >= 0.0
    }
}

impl ListedSighting {
    /// Returns true if the numbers are finite and the sigma is not below zero.
    pub fn is_usable(&self) -> bool {
        all_finite(self.position.iter().chain([&self.position_sigma])) && self.position_sigma >= 0.0
    }
}

impl PoseParts {
    /// Returns true if the numbers are a pose's.
    pub fn is_usable(&self) -> bool {
        self.pose().is_some()
    }

    /// The pose, if its numbers are a pose's.
    pub fn pose(&self) -> Option<Pose<f32>> {
        Pose::from_parts(Point2::from(self.position), self.heading, self.covariance).ok()
    }
}

impl From<Pose<f32>> for PoseParts {
    fn from(pose: Pose<f32>) -> Self {
        Self {
            position: pose.position.coords.into(),
            heading: pose.heading,
            covariance: pose.covariance_triangle(),
        }
    }
}
