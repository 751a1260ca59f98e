//! Joint estimation: all cameras, the target's places, the carrier that measured its way and the
//! references' headings from all measurements together.
//!
//! Two references define the frame: camera 0 is the origin, camera 1 at `(baseline, 0)`; their
//! headings are unknown. So is the baseline, if asked ([`JointSettings::is_baseline_known`]). A target walks from stop to stop. Its carrier measures every displacement,
//! with a scale and a compass of its own, and cameras that see it measure its bearing. Unknown are the places
//! of all stops, the pose of every camera, the two headings, and the carrier's scale and compass offset, of
//! which a prior is known.
//!
//! # Why together
//! Solved one after the other, each answer is believed by the next: an error of the carrier is one of every
//! camera. Solved together, cameras correct the carrier. With a carrier of which only priors are known the
//! errors are a half to a sixth (`docs/accuracy.md`), and redundancy shows contradictions.
//!
//! # How
//! **Cameras are eliminated, carrier and stops are kept.** Whitened and linearised around the present
//! estimates, every measurement is a row of `J x = r`. No row has unknowns of two cameras, so each camera's
//! block, three unknowns or four with its lens, is eliminated by itself (Schur complement; Triggs et al.,
//! "Bundle adjustment: a modern synthesis", 2000). The kept part is as large as the walk, whatever the number
//! of cameras and of their unknowns: a packed matrix. Cholesky's factor replaces it, and the inverse replaces
//! the factor. So one pass gives the step. Its last factor gives all covariances: of cameras, stops and
//! carrier, and the share of each measurement's error that shows. Residual tests, leaving out and protection
//! levels are closed forms of these, without a pass of their own. Each pass begins with the raw measurements,
//! so all is linearised anew, and any measurement can be taken out or put back at no cost.
//!
//! **In single precision** normal equations as they stand lose up to a whole posterior sigma where legs are
//! much surer than cameras. Two things prevent that. Legs are not rows but unknowns: the solver finds the
//! error of each leg, in its sigmas, so that the legs' information is the identity and that of the cameras is not
//! lost beside it. And a camera is eliminated by orthogonal rows, so that its own square is never subtracted
//! from itself. Steps then err by some thousandths of a posterior sigma, sigmas by less than 0.3 %, walks
//! with hardly any redundancy included.
//!
//! Walks too long for that, of many hundreds of stops on a computer, have all unknowns solved together by a
//! [`Solver`] of the caller's.
//!
//! Closed forms propose where to begin: the [reference solve](mod@crate::reference) over the stops
//! that both references saw, dead reckoning, and for each camera the [consensus of
//! three](crate::resection::solve_rejecting) as soon as it has seen enough.
//!
//! **A leg that was not measured cuts the walk in two.** The stops after it are placed as one part, so that the bearings of
//! cameras with a pose, a range or a mark fit it best. Until something does, sightings at these stops do not count.
//!
//! # The models
//! A bearing is `atan2(p - c) - heading` plus noise. If asked, each camera's focal length is estimated too
//! ([`JointSettings::lens`]): then the tangent of that angle is the measured one's times a scale of which a
//! prior is known. For a camera seen three times the prior decides, from some six on its own bearings do. A
//! displacement is the carrier's reading: the true one, turned by its compass offset and stretched by its
//! scale, plus noise of the covariance that the caller gives. A range is `|p - c|` plus noise. A visit to a
//! mark says that a place is that of the mark, which is unknown too: visited twice, it closes a loop.
//!
//! **Without a baseline** the place of camera 1 along the x axis is an unknown, and what the carrier reads sets all
//! lengths. Nothing tells its scale then but its prior: the scale stays what that says, and the error of it, common to
//! all lengths, is in the covariances that are told.
//!
//! # Contradictions
//! [`check`](JointEstimator::check) finds the bearing, the leg or the camera that contradicts the rest most,
//! names it, and solves without it; it comes back if it agrees later. A camera that was moved is [another
//! one](JointEstimator::split) from then on, with a pose of its own; references are watched like all others,
//! and their earlier sightings hold the frame. Where the last bearings of a camera are off,
//! either it was moved or the way there was not as measured: both are tried. Where no other camera saw the
//! target there, that [cannot be told](JointEstimator::is_ambiguous). A prior of the carrier that everything
//! together contradicts is widened to its error.
//! [`protect`](JointEstimator::protect) tells how far a pose may be off because of one fault that no test can
//! see: many sigmas where nothing checks its measurements. A path walked there and back checks every leg.
//!
//! # In slices
//! [`begin`](JointEstimator::begin) begins a [`Round`], and each call of [`step`](JointEstimator::step) does
//! at most one pass of it, a part of a pass where the walk is long, or a camera's tests, so that a slow processor can do
//! something else in between.
//! [`solve`](JointEstimator::solve) and the others are rounds at one stretch. Measurements that come during a
//! round count from the next one on. Once it is over, poses, headings, the carrier and the last place are
//! told without another pass.
//!
//! # Degenerate cases
//! The pivots tell which direction is not determined: an unknown without a pivot, or with one that is
//! rounding, is named ([`JointEstimator::undetermined`]), and all that moves with it is
//! [`Refusal::Undetermined`], never a number. Before the references have seen three stops together there is
//! no frame ([`JointError::Start`]). A camera
//! in poor geometry is not admitted, and one that loses what it was admitted for is put back.
//!
//! # Cost
//! A pass takes a sixth of the cube of the kept unknowns (two for each stop, and two of the carrier),
//! covariances twice as much; for cameras each pair of sights of one of them. [`Capacity::workspace`] tells
//! how many numbers an estimator keeps beside the measurements themselves: half the square of the kept
//! unknowns, and some for each bearing.
//!
//! # Example
//! ```
//! use calib_core::joint::{Capacity, JointEstimator, JointMemory, JointSettings, Leg, Prior};
//! use nalgebra::{Matrix2, Point2, Vector2};
//!
//! // Two references 10 units apart, another camera, and a carrier that reads 4 % too much.
//! let cameras = [(0.0, 0.0, 0.8), (10.0, 0.0, 2.3), (5.0, 9.0, 4.7_f64)];
//! let walk = [(4.0, 3.0), (6.0, 3.5), (5.0, 5.0), (4.0, 4.0), (6.0, 5.0), (3.6, 5.1)];
//! let mut settings = JointSettings::default();
//! settings.scale = Prior { mean: 1.0, sigma: 0.08 };
//! const ROOM: Capacity = Capacity { cameras: 3, stops: 8, bearings: 32, marks: 0 };
//! let memory = JointMemory {
//!     cameras: &mut [Default::default(); 3],
//!     stops: &mut [Default::default(); 8],
//!     bearings: &mut [Default::default(); 32],
//!     marks: &mut [],
//!     visits: &mut [],
//!     workspace: &mut [0.0; ROOM.workspace()],
//! };
//! let mut joint = JointEstimator::new(memory, 10.0, settings)?;
//! let mut before = None;
//! for (x, y) in walk {
//!     let place = Point2::new(x, y);
//!     let leg = before.map(|before: Point2<f64>| Leg {
//!         displacement: (place - before) * 1.04,
//!         covariance: Matrix2::from_diagonal_element(1e-4),
//!     });
//!     before = Some(place);
//!     let stop = joint.add_stop(leg)?;
//!     for (camera, (cx, cy, heading)) in cameras.into_iter().enumerate() {
//!         let bearing = (y - cy).atan2(x - cx) - heading;
//!         joint.add_bearing(stop, camera, bearing, 0.002)?;
//!     }
//! }
//! joint.solve()?;
//! let pose = joint.pose(2)?;
//! assert!((pose.position - Point2::new(5.0, 9.0)).norm() < 0.01);
//! let carrier = joint.carrier()?;
//! assert!((carrier.scale - 1.04).abs() < 0.001);
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

use core::fmt;

use nalgebra::{Matrix2, Point2, Vector2};

use crate::{Limits, Real, Refusal, fit::Fit, numerics::real::lit};

mod admission;
mod answers;
mod covariance;
mod descent;
mod equations;
mod estimator;
mod integrity;
mod keeping;
mod kept;
mod placing;
mod problem;
mod residuals;
mod round;
mod start;
mod triangle;
mod whole;

pub use estimator::{JointEstimator, JointMemory};
pub use keeping::{Measured, RestoredLeg, StopTag};
pub use problem::{
    Quantity, REFERENCES, Sight as BearingStorage, Standing, Stop as StopStorage,
    Unknown as UnknownStorage, Visit as VisitStorage,
};
pub use round::{Progress, Round};
pub use whole::Solver;

/// Room of an estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capacity {
    /// Cameras, references included.
    pub cameras: usize,
    /// Stops.
    pub stops: usize,
    /// Bearings and ranges.
    pub bearings: usize,
    /// Marks.
    pub marks: usize,
}

impl Capacity {
    /// Numbers of the [workspace](JointMemory::workspace). A larger one lets [`check`](JointEstimator::check)
    /// look at more than the last 32 sights of a camera together: it takes half the square of their number.
    pub const fn workspace(&self) -> usize {
        self.layout(problem::LENS).workspace()
    }

    /// The same where lenses are estimated ([`JointSettings::lens`], [`JointSettings::principal`]).
    pub const fn workspace_with_lenses(&self) -> usize {
        self.layout(problem::BLOCK).workspace()
    }

    /// The same beside a [`Solver`], lenses included.
    pub const fn workspace_beside_solver(&self) -> usize {
        self.layout(problem::BLOCK).without_kept().workspace()
    }

    const fn layout(&self, block: usize) -> equations::Layout {
        equations::Layout::new(self.cameras, self.stops, self.bearings, self.marks, block)
    }
}

/// Returns true if a camera is believed of which so many of all its sightings count: two of three. Fewer agree by
/// chance, as those of a camera that hangs upside down. Where nothing checks the pose it takes four of five: half of
/// the places that a camera saw before it was turned fit a pose that is neither the former nor the present one.
pub const fn is_consensus(counting: usize, all: usize, is_checked: bool) -> bool {
    if is_checked || all < MANY {
        3 * counting >= 2 * all
    } else {
        5 * counting >= 4 * all
    }
}

/// With fewer sightings, one that is left out is more than a fifth of them.
const MANY: usize = 5;

/// An unknown that the measurements do not determine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Undetermined {
    /// The carrier's scale.
    Scale,
    /// Its compass offset.
    Compass,
    /// The place of this stop, and of those that hang on it.
    Stop(u16),
    /// The place of this mark.
    Mark(u16),
    /// The pose of this camera.
    Camera(u16),
}

/// Knowledge about a number beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Prior<T> {
    /// Its most probable value.
    pub mean: T,
    /// Standard deviation, above zero; large where nothing is known.
    pub sigma: T,
}

/// Knowledge beforehand, and requirements for a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct JointSettings<T> {
    /// Length that the carrier reads over the true one; its mean is above zero.
    pub scale: Prior<T>,
    /// Direction that the carrier reads less the true one, in the frame whose x axis is the
    /// baseline, radians.
    pub compass: Prior<T>,
    /// Standing sigma: standard deviation of the target's place at a stop, each axis, when a camera looks. It
    /// is another error for each look, and not one of the way. Zero or above.
    pub standing: T,
    /// Standard deviation of the pitch and roll of a camera that is put up level, radians. Rows tell one that is not:
    /// then its pitch and roll are found from them. Zero if cameras are exactly level, or rows are not to be looked at.
    pub tilt: T,
    /// Standard deviation of every camera's focal length, relative: then it is estimated too, and
    /// takes [`Capacity::workspace_with_lenses`]. `None`, or zero, if lenses are what they are said to be.
    pub lens: Option<T>,
    /// Standard deviation of every camera's principal column, as the tangent of the angle that it is off: columns
    /// over the focal length in columns. It is estimated and takes room as the focal length does.
    pub principal: Option<T>,
    /// True if ranges are those of the size of the target in the picture: a lens that is wider than told makes them
    /// shorter. False if something else measures them.
    pub are_ranges_seen: bool,
    /// Camera 1 stands as far from camera 0 as the estimator was told. If not, the distance is estimated from no
    /// prior, what was told is a guess, and the carrier's [scale](Self::scale) sets all lengths. Ranges say nothing then.
    pub is_baseline_known: bool,
    /// Sigmas up to which a camera takes part: those that all bearings together give it, without the error of a
    /// carrier's scale that sets all lengths.
    pub limits: Limits<T>,
}

impl<T: Real> Default for JointSettings<T> {
    /// A carrier that reads 5 % and 2 degrees wrong at one sigma; cameras up to half a unit and 5
    /// degrees.
    fn default() -> Self {
        Self {
            scale: Prior {
                mean: T::one(),
                sigma: lit(0.05),
            },
            compass: Prior {
                mean: T::zero(),
                sigma: lit(0.034_906_585),
            },
            standing: T::zero(),
            tilt: T::zero(),
            lens: None,
            principal: None,
            are_ranges_seen: false,
            is_baseline_known: true,
            limits: Limits {
                position: lit(0.5),
                heading: lit(0.087_266_463),
            },
        }
    }
}

/// The way by which the target came to a stop, from the stop before, as its carrier measured it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Leg<T: Real> {
    /// The displacement, in the frame of the carrier.
    pub displacement: Vector2<T>,
    /// Its covariance, positive definite, as far as it is this leg's own. The common errors of all legs are
    /// the carrier's scale and compass.
    pub covariance: Matrix2<T>,
}

/// Place of a stop.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StopPlace<T: Real> {
    /// The place.
    pub position: Point2<T>,
    /// Its covariance, symmetric; to first order.
    pub covariance: Matrix2<T>,
}

/// Systematic errors of the carrier.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Carrier<T: Real> {
    /// Length that it reads over the true one.
    pub scale: T,
    /// Direction that it reads less the true one, radians.
    pub compass: T,
    /// Covariance of `(scale, compass)`.
    pub covariance: Matrix2<T>,
}

/// Lens of a camera. A focal length that is shorter than believed makes the true tangents of bearings larger
/// than the measured ones.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lens<T> {
    /// The true tangent of a bearing over the measured one: the focal length that was believed over
    /// the true one.
    pub scale: T,
    /// Its standard deviation.
    pub sigma: T,
    /// Distance of the bearings' own result from one, in sigmas of that and of the prior together. Zero if
    /// they say nothing.
    pub off: T,
}

/// Headings of the references.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ReferenceHeadings<T: Real> {
    /// Headings of camera 0 and camera 1, radians in `[0, 2 pi)`.
    pub headings: [T; 2],
    /// Their covariance.
    pub covariance: Matrix2<T>,
}

/// Residual of a bearing, or of a range.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BearingResidual<T> {
    /// The stop.
    pub stop: usize,
    /// The camera.
    pub camera: usize,
    /// Quantity that it is of.
    pub quantity: Quantity,
    /// World bearing of the place, less the camera's heading and the bearing, radians; or distance of
    /// the place, less the range.
    pub residual: T,
    /// The share of the bearing's error that shows in the residual, from 0 (nothing checks it) to 1.
    pub redundancy: T,
    /// The residual over its standard deviation; `None` for a bearing that nothing checks.
    pub normalised: Option<T>,
    /// Standing of the bearing: counted or left out.
    pub standing: Standing,
}

/// Residual of a leg.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LegResidual<T> {
    /// The stop that it leads to.
    pub stop: usize,
    /// Chi squared of its checked directions.
    pub chi_squared: T,
    /// Number of checked directions: 2, 1, or 0 for a leg that nothing checks.
    pub degrees_of_freedom: usize,
    /// The sum of its squared residuals, each over the sigma that the leg claims.
    pub squared: T,
    /// Expectation of that sum: the sum of its redundancy numbers, 0 to 2.
    pub redundancy: T,
    /// Standing of the leg: counted or left out.
    pub standing: Standing,
}

/// A contradiction to the rest, which was left out.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Finding<T> {
    /// One bearing.
    Bearing {
        /// At this stop.
        stop: usize,
        /// By this camera.
        camera: usize,
        /// Sigmas that it is off.
        off: T,
    },
    /// One range.
    Range {
        /// At this stop.
        stop: usize,
        /// By this camera.
        camera: usize,
        /// Sigmas that it is off.
        off: T,
    },
    /// The leg to a stop: the carrier slipped, or a step was not counted.
    Leg {
        /// The stop that it leads to.
        stop: usize,
        /// Its error, as chi squared of two degrees of freedom or one.
        chi_squared: T,
    },
    /// All that a camera has seen from a stop on: it was moved, or is stuck.
    Camera {
        /// The camera.
        camera: usize,
        /// The first stop at which it is off.
        from: usize,
        /// Its error, as chi squared.
        chi_squared: T,
    },
}

/// A move of a camera during the walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Move {
    /// The first stop whose sightings are not of its former pose.
    pub since: usize,
    /// The camera that it has become, if that was [told](JointEstimator::split).
    pub successor: Option<usize>,
}

/// Bound on the error of a camera's pose although one measurement is wrong and no test notices it: at most so
/// much in 999 of 1,000 cases. Many times its sigmas where nothing checks a measurement on which it rests.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ProtectionLevels<T> {
    /// Its place, if a bearing is wrong.
    pub position_bearing: T,
    /// Its place, if a leg is wrong.
    pub position_leg: T,
    /// Its heading, radians, if a bearing is wrong.
    pub heading_bearing: T,
    /// Its heading, radians, if a leg is wrong.
    pub heading_leg: T,
}

impl<T: Real> Default for ProtectionLevels<T> {
    /// Protection against nothing.
    fn default() -> Self {
        let zero = T::zero();
        Self {
            position_bearing: zero,
            position_leg: zero,
            heading_bearing: zero,
            heading_leg: zero,
        }
    }
}

/// Result of a solve.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct JointSolution<T> {
    /// Fit of all measurements that count.
    pub fit: Fit<T>,
    /// Cameras that have a pose, references included.
    pub cameras: usize,
    /// Passes over the measurements.
    pub passes: usize,
}

/// Reason why there is no joint answer, or a measurement is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum JointError {
    /// The capacity for stops, or for bearings, or for visits, is used up. The measurements so far stay.
    Full,
    /// There is less memory than two references need, or a smaller workspace than [`Capacity::workspace`]
    /// says, or more stops or cameras than 16 bits count.
    Memory,
    /// There is no such stop, camera or mark.
    Unknown,
    /// This camera is not free to be the successor of another one.
    Taken,
    /// A number is not finite, a sigma is not above zero or a covariance is not positive definite.
    NotFinite,
    /// The references' own sightings do not give a frame, for this reason.
    Start(Refusal),
    /// The passes came to no end, for this reason. Estimates are the best that were found: contradictions may
    /// be left out ([`JointEstimator::check`]).
    Solve(Refusal),
}

impl fmt::Display for JointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full => f.write_str("no more fits in: solve in two parts"),
            Self::Memory => f.write_str("the memory is not one for an estimator: make its workspace larger"),
            Self::Unknown => f.write_str("there is no stop, camera or mark of this number"),
            Self::Taken => f.write_str("this camera is in use: take one of which nothing is known"),
            Self::NotFinite => f.write_str(
                "a number is not finite, a sigma not above zero or a covariance not positive definite: correct it",
            ),
            Self::Start(Refusal::TooFew) => f.write_str(
                "no frame: stop the target at three places, or more, that both references see",
            ),
            Self::Start(why) => write!(f, "no frame from what both references saw: {why}"),
            Self::Solve(why) => write!(f, "no joint solution: {why}"),
        }
    }
}

impl core::error::Error for JointError {}
