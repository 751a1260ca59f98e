//! How much a stop tells: Fisher information, whose inverse bounds the covariance (Cramer-Rao).

use calib_core::reference::Known;
use nalgebra::{Matrix2, Matrix2x6, Matrix3, Matrix6, Point2, SMatrix, Vector2, Vector3};

use crate::world::Camera;

/// What the planner takes for the errors to come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Of a blob's middle, columns, standard deviation.
    pub columns: f64,
    /// Of the target about the place that it tells, along each axis, standard deviation.
    pub standing: f64,
}

/// Of a place seen from a camera.
#[derive(Clone, Copy, Debug)]
struct Line {
    /// Derivative of the bearing with respect to the target's place.
    across: Vector2<f64>,
    /// Of the bearing, from the column alone.
    variance: f64,
}

impl Line {
    fn new(camera: &Camera, place: Point2<f64>, noise: &Noise) -> Self {
        let to = place - camera.place;
        let range2 = to.norm_squared();
        let lens = &camera.lens;
        let column = lens.column(calib_core::angle::wrap_signed(
            to.y.atan2(to.x) - camera.heading,
        ));
        let per_column = lens.bearing(column - 0.5) - lens.bearing(column + 0.5);
        Self {
            across: Vector2::new(-to.y, to.x) / range2,
            variance: (noise.columns * per_column).powi(2),
        }
    }
}

/// Standard deviation of a bearing, radians: of the column, and of where the target stands.
pub(super) fn bearing_sigma(camera: &Camera, place: Point2<f64>, noise: &Noise) -> f64 {
    let line = Line::new(camera, place, noise);
    (line.variance + noise.standing.powi(2) * line.across.norm_squared()).sqrt()
}

/// About `(x, y, heading)` of a camera, from one sighting of a target that tells its place.
pub(super) fn of_sighting(camera: &Camera, place: Point2<f64>, noise: &Noise) -> Matrix3<f64> {
    let line = Line::new(camera, place, noise);
    let slope = Vector3::new(-line.across.x, -line.across.y, -1.0);
    slope * slope.transpose() / bearing_sigma(camera, place, noise).powi(2)
}

/// About `(heading 0, heading 1, x, y, frame heading, baseline)`, from one stop that both references
/// see: x and y of the walk as a whole, whose displacements are known, turned about the middle of
/// the baseline.
pub(super) fn of_reference_stop(
    cameras: [&Camera; 2],
    place: Point2<f64>,
    noise: &Noise,
) -> Matrix6<f64> {
    let baseline = cameras[1].place - cameras[0].place;
    let pivot = nalgebra::center(&cameras[0].place, &cameras[1].place);
    let arm = place - pivot;
    let lines = cameras.map(|camera| Line::new(camera, place, noise));
    let across = Matrix2::from_rows(&lines.map(|line| line.across.transpose()));
    let mut slopes = Matrix2x6::zeros();
    slopes[(0, 0)] = -1.0;
    slopes[(1, 1)] = -1.0;
    slopes.fixed_columns_mut::<2>(2).copy_from(&across);
    slopes.set_column(4, &(across * Vector2::new(-arm.y, arm.x)));
    slopes[(1, 5)] = -lines[1].across.dot(&baseline.normalize());
    // Both see the target where it really stands.
    let own = Matrix2::from_diagonal(&Vector2::from(lines.map(|line| line.variance)));
    let covariance = own + across * across.transpose() * noise.standing.powi(2);
    let weight = covariance.try_inverse().unwrap_or_else(Matrix2::zeros);
    slopes.transpose() * weight * slopes
}

/// What is known of [`of_reference_stop`]'s unknowns beforehand, as information.
pub(super) fn known_beforehand(known: &Known<f64>) -> Matrix6<f64> {
    const CERTAIN: f64 = 1e12;
    let mut information = Matrix6::zeros();
    information[(4, 4)] = known.frame_heading.map_or(0.0, |_| CERTAIN);
    information[(5, 5)] = known.baseline.map_or(0.0, |_| CERTAIN);
    information
}

/// The bound on the covariance; `None` if something remains undetermined.
pub(super) fn bound<const N: usize>(
    information: &SMatrix<f64, N, N>,
) -> Option<SMatrix<f64, N, N>> {
    let inverse = information.cholesky()?.inverse();
    let sound = inverse.diagonal().iter().all(|v| v.is_finite() && *v > 0.0);
    sound.then_some(inverse)
}
