//! Where is the target after some more steps, and how sure is that?
//!
//! Two halves that meet in the [`Step`]:
//! - [`Track`] adds steps to a place (thesis 2.1, 2.2: "the size and heading of each step") and
//!   keeps the covariance of the result, including what the errors of different stops have in
//!   common.
//! - [`Pedestrian`] makes steps from an accelerometer, a gyroscope and a compass worn on the body:
//!   a [`StepDetector`] counts, a [`StepLength`] measures, a [`HeadingFilter`] points.
//!
//! A step counter of another make, or a robot's odometry, feeds the track just as well.
//!
//! # From stops to a camera's pose
//! A [`Track`] is a plain value. Between two copies of it, [`Track::since`] gives the displacement
//! `P e^{j theta}` of thesis 2.6.1 that the reference solve needs. [`Track::place`] makes the
//! [`Place`] of a stop, which goes to the cameras in a message.
//!
//! All stops of one walk inherit the errors made before them. So for a resection from several:
//! 1. Give each sighting what its place does not share with the *first* of the stops as its own
//!    part ([`Place::own_covariance`] for
//!    [`Sighting::target_covariance`](crate::Sighting::target_covariance)). It is positive
//!    semi-definite whatever the walk.
//! 2. The covariance at the first stop, but for standing, is shared by all:
//!    [`Pose::with_shared_target_error`](crate::Pose::with_shared_target_error).
//!
//! That needs nothing but 2x2 matrices, and for a walk without [`Systematic`] errors the shared
//! part is exact. But the walks between the stops count as independent, which they are not; and a
//! heading bias or a length scale turns or stretches the whole figure of the stops, and with it
//! the camera's pose, however many stops there are. Over random stops in a 60 degree view, with
//! step errors that outweigh the bearings', the mean squared error in units of the predicted
//! covariance (NEES, 3 when fair) is
//!
//! | stops | random step errors only | with as much systematic error |
//! |---|---|---|
//! | 3 | 3.0 | 3.2 |
//! | 4 | 3.2 | 3.7 |
//! | 6 | 3.8 | 4.7 |
//! | 10 | 5.0 | 5.8 |
//!
//! that is, fair for few stops and over-confident for many. [`correlate`] replaces step 2 and is
//! fair for any number and both kinds of errors: it takes all stops with all their
//! cross-covariances through the same weights to the pose, exact to first order, for the price of
//! keeping the places and `n^2` small products.
//!
//! # Example
//! ```
//! use calib_core::dead_reckoning::{Step, Systematic, Track};
//! use nalgebra::{Matrix2, Point2};
//!
//! // The reference cameras fixed the target to 5 cm.
//! let fix = Matrix2::from_diagonal_element(0.05_f64 * 0.05);
//! let mut track = Track::start(Point2::new(2.0, 1.0), fix, Systematic::default())?;
//! let first = track;
//! for _ in 0..10 {
//!     track.advance(&Step {
//!         distance: 0.7,
//!         heading: 90_f64.to_radians(),
//!         distance_sigma: 0.05,
//!         heading_sigma: 0.1,
//!     })?;
//! }
//! let leg = track.since(&first);
//! assert!((leg.vector.y - 7.0).abs() < 1e-12);
//! assert!(track.covariance().m11 > leg.covariance.m11);
//! # Ok::<(), calib_core::dead_reckoning::TrackError>(())
//! ```
//! And from sensors to steps, see [`Pedestrian`].

mod correlation;
mod heading_filter;
mod pedestrian;
mod place;
mod sample;
mod settings;
mod step_detector;
mod step_length;
mod track;

pub use correlation::correlate;
pub use heading_filter::{HeadingFilter, HeadingSettings, magnetic_north};
pub use pedestrian::{Pedestrian, PedestrianSettings};
pub use place::{Place, PlaceParts};
pub use sample::{ImuError, ImuSample};
pub use settings::InvalidSetting;
pub use step_detector::{StepDetector, StepDetectorSettings, Swing};
pub use step_length::{StepLength, StepLengthError};
pub use track::{Displacement, Step, Systematic, Track, TrackError};
