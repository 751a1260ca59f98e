//! Information of a stop: Fisher information, whose inverse bounds the covariance (Cramer-Rao).

use calib_core::{Ray, Sighting, angle, reference::Known, resection};
use nalgebra::{Matrix2, Matrix2x6, Matrix3, Matrix6, Point2, SMatrix, Vector2, Vector3};

use crate::world::Camera;

/// Errors to come, as the planner assumes them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation of a blob's middle, columns.
    pub columns: f64,
    /// Standard deviation of the target about the place that it tells, along each axis.
    pub standing: f64,
}

impl Noise {
    /// Noise that the planner assumes before anything is seen: a column that is uniform within itself, at both
    /// edges of a blob, and a little noise.
    pub const COLUMNS: f64 = 0.25;

    /// Standard deviation of a bearing of a target at a place, radians: of the column alone.
    pub fn sigma(&self, camera: &Camera, place: Point2<f64>) -> f64 {
        sighting(camera, place, self).bearing_sigma
    }
}

/// Angle of one column of a camera's picture at a bearing, radians.
pub fn column_angle(camera: &Camera, bearing: f64) -> f64 {
    let lens = &camera.lens;
    let column = lens.column(bearing);
    lens.bearing(column - 0.5) - lens.bearing(column + 0.5)
}

/// A target that a camera would see there.
fn sighting(camera: &Camera, place: Point2<f64>, noise: &Noise) -> Sighting<f64> {
    let to = place - camera.place;
    let bearing = angle::wrap_signed(to.y.atan2(to.x) - camera.heading);
    let sigma = noise.columns * column_angle(camera, bearing);
    Sighting::new(place, Ray::from_bearing(bearing), sigma).with_target_sigma(noise.standing)
}

/// About `(x, y, heading)` of a camera, from one sighting of a target that tells its place.
pub fn of_sighting(camera: &Camera, place: Point2<f64>, noise: &Noise) -> Matrix3<f64> {
    resection::information(camera.place, &sighting(camera, place, noise))
}

/// Standard deviation of a bearing, radians: of the column, and of where the target stands.
pub(super) fn bearing_sigma(camera: &Camera, place: Point2<f64>, noise: &Noise) -> f64 {
    of_sighting(camera, place, noise).m33.sqrt().recip()
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
    // Derivatives of the bearings with respect to the target's place.
    let across = cameras.map(|camera| {
        let to = place - camera.place;
        Vector2::new(-to.y, to.x) / to.norm_squared()
    });
    let own = cameras.map(|camera| sighting(camera, place, noise).bearing_sigma.powi(2));
    let across = Matrix2::from_rows(&across.map(|across| across.transpose()));
    let mut slopes = Matrix2x6::zeros();
    slopes[(0, 0)] = -1.0;
    slopes[(1, 1)] = -1.0;
    slopes.fixed_columns_mut::<2>(2).copy_from(&across);
    slopes.set_column(4, &(across * Vector2::new(-arm.y, arm.x)));
    slopes[(1, 5)] = -across.row(1).transpose().dot(&baseline.normalize());
    // Both see the target where it really stands.
    let own = Matrix2::from_diagonal(&Vector2::from(own));
    let covariance = own + across * across.transpose() * noise.standing.powi(2);
    let weight = covariance.try_inverse().unwrap_or_else(Matrix2::zeros);
    slopes.transpose() * weight * slopes
}

/// Prior knowledge of [`of_reference_stop`]'s unknowns, as information.
pub(super) fn known_beforehand(known: &Known<f64>) -> Matrix6<f64> {
    const CERTAIN: f64 = 1e12;
    let mut information = Matrix6::zeros();
    information[(4, 4)] = known.frame_heading.map_or(0.0, |_| CERTAIN);
    information[(5, 5)] = known.baseline.map_or(0.0, |_| CERTAIN);
    information
}

/// The bound on the covariance; `None` if something remains undetermined.
pub(crate) fn bound<const N: usize>(
    information: &SMatrix<f64, N, N>,
) -> Option<SMatrix<f64, N, N>> {
    let inverse = information.cholesky()?.inverse();
    let sound = inverse.diagonal().iter().all(|v| v.is_finite() && *v > 0.0);
    sound.then_some(inverse)
}

/// Diagonal of [`bound`] for a pose, by its minors: many choices are tried.
pub(super) fn variances(information: &Matrix3<f64>) -> Option<Vector3<f64>> {
    let [a, b, c] = [information.m11, information.m22, information.m33];
    let [ab, ac, bc] = [information.m12, information.m13, information.m23];
    let minors = Vector3::new(b * c - bc * bc, a * c - ac * ac, a * b - ab * ab);
    let determinant = a * minors.x + ab * (ac * bc - ab * c) + ac * (ab * bc - b * ac);
    let variances = minors / determinant;
    let is_positive = a > 0.0 && minors.z > 0.0 && determinant > 0.0;
    let sound = is_positive && variances.iter().all(|v| v.is_finite() && *v > 0.0);
    sound.then_some(variances)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Of one direction to each of some places: two of them leave something open.
    #[test]
    fn variances_are_the_diagonal_of_the_bound() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for count in [2, 3, 8].repeat(50) {
            let rows = (0..count).map(|_| {
                let row = Vector3::from_fn(|_, _| random.random_range(-9.0..9.0));
                row * row.transpose()
            });
            let information: Matrix3<f64> = rows.sum();
            let (found, expected) = (variances(&information), bound(&information));
            if count == 2 {
                let is_open = |found: Option<Vector3<f64>>| found.is_none_or(|v| v.sum() > 1e9);
                assert!(is_open(found) && is_open(expected.map(|v| v.diagonal())));
            } else {
                let (found, expected) = (found.unwrap(), expected.unwrap().diagonal());
                assert!((found - expected).norm() < 1e-6 * expected.norm());
            }
        }
        assert_eq!(variances(&Matrix3::zeros()), None);
        assert_eq!(variances(&-Matrix3::identity()), None);
    }
}
