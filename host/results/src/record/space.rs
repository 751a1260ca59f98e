//! Cameras in space: height, pitch and roll beside the pose in the plane.
//!
//! A node tells the mounting of a camera that is not level. Its accuracy, and the height of a level one, are found here
//! from the rows that the record has.

use calib_core::level::{self, Mounting, Row, Tolerance};
use nalgebra::{Isometry2, Matrix3, Matrix6};
use node_firmware::config::TargetConfig;
use serde::{
    Deserialize, Deserializer, Serialize,
    de::{DeserializeOwned, Error},
};

use super::{Estimate, Node, NodeMount};

/// Reads fields that stand among those of another structure; `None` where one is missing. Numbers that keep all their
/// digits (`arbitrary_precision`, which some dependency may switch on) are no numbers to serde's own way.
pub(super) fn flat<'de, D: Deserializer<'de>, T: DeserializeOwned>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    let fields = serde_json::Map::deserialize(deserializer)?;
    Ok(serde_json::from_value(fields.into()).ok())
}

/// The same of fields that must be there.
fn whole<'de, D: Deserializer<'de>, T: DeserializeOwned>(deserializer: D) -> Result<T, D::Error> {
    flat(deserializer)?.ok_or_else(|| D::Error::custom("z, pitch_deg and roll_deg are missing"))
}

/// Height, pitch and roll of a camera, or their errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hung {
    /// Height of its lens above the floor, or above the middle of the ball where nothing tells [that
    /// one's](super::Network::ball_height).
    pub z: f64,
    /// Angle of its optical axis below the horizon.
    pub pitch_deg: f64,
    /// Turn about that axis, positive where the left side is high.
    pub roll_deg: f64,
}

/// Height, pitch and roll of a camera, with their accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HungEstimate {
    /// Best values.
    #[serde(flatten, deserialize_with = "whole")]
    pub hung: Hung,
    /// Predicted standard deviation.
    pub sigma_z: f64,
    /// Predicted standard deviation; that of a level camera is what its installer promises.
    pub sigma_pitch_deg: f64,
    /// As of the pitch.
    pub sigma_roll_deg: f64,
    /// Upper triangle of the covariance of `(x, y, z, roll, pitch, heading)`, by rows; angles in degrees.
    pub covariance_in_space: [f64; 21],
}

/// Knowledge about the hanging of cameras beforehand, as a target is told.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    tolerance: Tolerance<f64>,
    /// Standard deviation of the angle between the optical axis and the middle of the picture, radians.
    principal: f64,
    /// Height of the ball above the floor.
    ball_height: Option<f64>,
}

impl Told {
    /// As this target is told.
    pub fn new(target: &TargetConfig, ball_height: Option<f64>) -> Self {
        let lens = &target.lens_sigma;
        let told = lens.tolerance(target.standing_sigma);
        Self {
            tolerance: Tolerance {
                tilt: told.tilt.into(),
                bob: told.bob.into(),
            },
            principal: f64::from(lens.principal_deg).to_radians(),
            ball_height,
        }
    }
}

/// Places of `(x, y, heading)` and of `(z, pitch, roll)` in the covariance in space.
pub(crate) const IN_PLANE: [usize; 3] = [0, 1, 5];
const HANGING: [usize; 3] = [2, 4, 3];

impl HungEstimate {
    /// The covariance of `(x, y, z, roll, pitch, heading)`, in units and degrees.
    pub fn matrix(&self) -> Matrix6<f64> {
        let mut numbers = self.covariance_in_space.into_iter();
        let mut matrix = Matrix6::zeros();
        for row in 0..6 {
            for column in row..6 {
                let number = numbers.next().unwrap_or_default();
                matrix[(row, column)] = number;
                matrix[(column, row)] = number;
            }
        }
        matrix
    }

    fn with_matrix(mut self, matrix: &Matrix6<f64>) -> Self {
        let upper = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
        for (number, place) in self.covariance_in_space.iter_mut().zip(upper) {
            *number = matrix[place];
        }
        self
    }

    /// The same in another frame, in which its own one is here.
    pub(super) fn moved(self, frame: &Isometry2<f64>) -> Self {
        let mut turn = Matrix6::identity();
        let rotation = frame.rotation.to_rotation_matrix();
        turn.fixed_view_mut::<2, 2>(0, 0)
            .copy_from(rotation.matrix());
        self.with_matrix(&(turn * self.matrix() * turn.transpose()))
    }
}

impl Estimate {
    /// Height, pitch and roll by these rows, of a camera of which this mounting was told. `None` where they tell none.
    fn hung_by(
        &self,
        mount: Option<&NodeMount>,
        rows: &[Row<f64>],
        told: &Told,
    ) -> Option<HungEstimate> {
        let mounting = mount.map_or(Mounting::level(), |mount| Mounting {
            pitch: mount.pitch_deg.to_radians(),
            roll: mount.roll_deg.to_radians(),
        });
        let mut found = level::hanging(&self.pose(), rows, mounting, &told.tolerance)?;
        found.covariance.m22 += told.principal * told.principal;
        let degree = 1_f64.to_degrees();
        // (height, pitch, roll), and (x, y, heading).
        let hanging = Matrix3::from_diagonal(&[1.0, degree, degree].into());
        let in_plane = Matrix3::from_diagonal(&[1.0, 1.0, degree].into());
        let own = hanging * found.covariance * hanging;
        let shared = in_plane * found.with_pose * hanging;
        let mut matrix = Matrix6::zeros();
        for row in 0..3 {
            for column in 0..3 {
                matrix[(IN_PLANE[row], IN_PLANE[column])] = self.matrix()[(row, column)];
                matrix[(HANGING[row], HANGING[column])] = own[(row, column)];
            }
        }
        let mut dependent = matrix;
        for row in 0..3 {
            for column in 0..3 {
                dependent[(IN_PLANE[row], HANGING[column])] = shared[(row, column)];
                dependent[(HANGING[column], IN_PLANE[row])] = shared[(row, column)];
            }
        }
        // Rounding, and a pose that was told before these rows, may leave no covariance.
        let slack = Matrix6::from_diagonal(&(matrix.diagonal() * 1e-9));
        if (dependent + slack).cholesky().is_some() {
            matrix = dependent;
        }
        let height = mount.map_or(found.height, |mount| mount.height);
        let [sigma_z, sigma_pitch_deg, sigma_roll_deg] = [0, 1, 2].map(|n| own[(n, n)].sqrt());
        let hung = HungEstimate {
            hung: Hung {
                z: told.ball_height.unwrap_or_default() + height,
                pitch_deg: mounting.pitch.to_degrees(),
                roll_deg: mounting.roll.to_degrees(),
            },
            sigma_z,
            sigma_pitch_deg,
            sigma_roll_deg,
            covariance_in_space: [0.0; 21],
        };
        Some(hung.with_matrix(&matrix))
    }
}

impl Node {
    /// Finds its height, pitch and roll from these rows, and compares them with the truth; after its pose and mounting.
    pub fn set_hung(&mut self, rows: &[Row<f64>], told: &Told) {
        let mount = self.mount.as_ref();
        if let Some(estimate) = &mut self.estimate {
            estimate.hung = estimate.hung_by(mount, rows, told);
        }
        self.compare_hung();
    }

    /// Compares height, pitch and roll with the truth.
    pub(super) fn compare_hung(&mut self) {
        let found = self.estimate.and_then(|estimate| estimate.hung);
        let truth = self.truth.and_then(|truth| truth.hung);
        if let Some(error) = &mut self.error {
            error.hung = found.zip(truth).map(|(found, truth)| Hung {
                z: found.hung.z - truth.z,
                pitch_deg: found.hung.pitch_deg - truth.pitch_deg,
                roll_deg: found.hung.roll_deg - truth.roll_deg,
            });
        }
    }
}
