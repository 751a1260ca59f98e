//! Where is the target after some more steps, and how sure is that?
//!
//! A [`Track`] adds [`Step`]s to a place (thesis 2.1, 2.2: "the size and heading of each step") and
//! keeps the covariance of the result, including the common errors of different stops.
//! Steps come from whatever counts them: sensors worn by a person (the crate `pedestrian`), a step
//! counter of another make, a robot's odometry.
//!
//! # From stops to a camera's pose
//! A [`Track`] is a plain value. Between two copies of it, [`Track::since`] gives the displacement
//! `P e^{j theta}` of thesis 2.6.1 that the reference solve needs. [`Track::place`] makes the
//! [`Place`] of a stop, which goes to the cameras in a message.
//!
//! All stops of one walk inherit the errors made before them. So for a resection from several:
//! 1. Weight each sighting by the part of its place's error that it does not share with the *first* stop
//!    ([`Place::own_covariance`] for
//!    [`Sighting::target_covariance`](crate::Sighting::target_covariance)). It is positive
//!    semi-definite whatever the walk.
//! 2. [`correlate`] the pose: it takes all stops with all their cross-covariances through these
//!    weights to the pose's covariance, exact to first order, for the price of keeping the places
//!    and `n^2` small products.
//!
//! Step 2 is what makes the covariance fair. It is simpler to add the covariance at the first stop to the
//! pose's instead, and nearly right for few stops. But the walks between the stops are not independent; and a
//! heading bias or a length scale turns or stretches the whole figure of the stops, and with it the camera's
//! pose, however many stops there are. The table is for random stops in a 60 degree view, with step errors
//! that outweigh the bearings'. It gives the mean squared error in units of the covariance so predicted
//! (NEES; a fair one is 3, as that of `correlate` is in all of these):
//!
//! | stops | random step errors only | with as much systematic error |
//! |---|---|---|
//! | 3 | 3.0 | 3.2 |
//! | 4 | 3.2 | 3.7 |
//! | 6 | 3.8 | 4.7 |
//! | 10 | 5.0 | 5.8 |
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
//! let leg = track.since(&first).ok_or("found in between")?;
//! assert!((leg.vector.y - 7.0).abs() < 1e-12);
//! assert!(track.covariance().m11 > leg.covariance.m11);
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

mod correlation;
mod place;
mod track;

pub use correlation::correlate;
pub use place::{Place, PlaceParts};
pub use track::{Displacement, Step, Systematic, Track, TrackError};
