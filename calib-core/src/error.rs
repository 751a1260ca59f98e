//! One type for functions that meet several errors.

use core::fmt;

use crate::{
    PoseError, Refusal, camera::CameraError, dead_reckoning::TrackError, joint::JointError,
};

/// Any error of this crate, for functions that build a camera and solve for its pose.
///
/// # Example
/// ```
/// use calib_core::{Error, Pose, Sighting, camera::Camera, nalgebra::Point2, resection};
///
/// fn place(places: [[f32; 2]; 3], columns: [f32; 3]) -> Result<Pose<f32>, Error> {
///     let camera = Camera::pin_hole(88, 1.0)?;
///     let seen: [_; 3] = core::array::from_fn(|n| {
///         let (ray, sigma) = (camera.ray(columns[n]), camera.whole_pixel_sigma(columns[n]));
///         Sighting::new(Point2::from(places[n]), ray, sigma)
///     });
///     Ok(resection::solve(&seen)?.pose)
/// }
/// assert!(place([[1.0, 2.0]; 3], [40.0; 3]).is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Error {
    /// There is no such camera.
    Camera(CameraError),
    /// These numbers are no pose.
    Pose(PoseError),
    /// The question has no answer.
    Refused(Refusal),
    /// The joint estimation takes no more, or has no answer.
    Joint(JointError),
    /// A step cannot be counted.
    Track(TrackError),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Camera(error) => error.fmt(f),
            Self::Pose(error) => error.fmt(f),
            Self::Refused(refusal) => refusal.fmt(f),
            Self::Joint(error) => error.fmt(f),
            Self::Track(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for Error {}

impl From<CameraError> for Error {
    fn from(error: CameraError) -> Self {
        Self::Camera(error)
    }
}

impl From<PoseError> for Error {
    fn from(error: PoseError) -> Self {
        Self::Pose(error)
    }
}

impl From<Refusal> for Error {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

impl From<JointError> for Error {
    fn from(error: JointError) -> Self {
        Self::Joint(error)
    }
}

impl From<TrackError> for Error {
    fn from(error: TrackError) -> Self {
        Self::Track(error)
    }
}
