//! Statistics over the cameras of a run.

use calib_core::fit::Fit;
use serde::{Deserialize, Serialize};

use super::{Node, PoseError};
use crate::accuracy::{Spread, WithinSigmas};

/// Statistics over the cameras of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Cameras that are meant to be calibrated, references included.
    pub expected: usize,
    /// Number of them that are: their [status](Node::status) is `calibrated`.
    pub calibrated: usize,
    /// Cameras that are no references; `null` if none of them can be compared.
    pub cameras: Option<Statistics>,
    /// All cameras, as in the thesis's Tables 4.3 to 4.5.
    pub all: Option<Statistics>,
    /// Fit of the sightings of all cameras to their poses.
    pub fit: Fit<f64>,
}

/// Statistics of errors, over the cameras with a pose and a truth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Number of cameras.
    pub count: usize,
    /// Signed errors.
    pub x: Errors,
    /// Signed errors.
    pub y: Errors,
    /// Distances between estimate and truth.
    pub position: Errors,
    /// Signed errors.
    pub heading_deg: Errors,
    /// Shares of the errors within 1, 2 and 3 predicted sigmas.
    pub within_sigmas: Within,
    /// Mean squared error in units of the predicted covariance: 3 where predictions are right.
    pub mean_nees: Option<f64>,
}

/// Statistics of one component of the error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Root of the mean square.
    pub rms: f64,
    /// Mean, signed errors cancelling. As in the thesis; no measure of accuracy.
    pub mean: f64,
    /// Standard deviation about the mean (n - 1); `null` of a single one.
    pub standard_deviation: Option<f64>,
    /// Half of the absolute errors are below.
    pub median: f64,
    /// Nine of ten of the absolute errors are below.
    pub p90: f64,
}

/// Shares of errors within 1, 2 and 3 predicted sigmas; 0.683, 0.954 and 0.997 are foretold.
/// `null` where everything was given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Within {
    /// Of x.
    pub x: Option<[f64; 3]>,
    /// Of y.
    pub y: Option<[f64; 3]>,
    /// Of the heading.
    pub heading: Option<[f64; 3]>,
}

impl Summary {
    /// Of a run's nodes.
    pub fn of(nodes: &[Node]) -> Self {
        let cameras = || nodes.iter().filter(|node| node.is_camera());
        let expected = || cameras().filter(|camera| camera.expected);
        Self {
            expected: expected().count(),
            calibrated: expected().filter(|c| c.is_calibrated()).count(),
            cameras: Statistics::of(cameras().filter(|camera| !camera.reference)),
            all: Statistics::of(cameras()),
            fit: cameras().map(Node::fit).fold(Fit::default(), Fit::and),
        }
    }
}

impl Statistics {
    /// Over cameras of one run or of many; `None` if none of them has both pose and truth.
    pub fn of<'a>(cameras: impl IntoIterator<Item = &'a Node>) -> Option<Self> {
        let mut errors: [Vec<f64>; 4] = Default::default();
        let mut within = [WithinSigmas::default(); 3];
        let (mut nees_sum, mut nees_count) = (0.0, 0_u32);
        for camera in cameras {
            let (
                Some(estimate),
                Some(PoseError {
                    x, y, heading_deg, ..
                }),
            ) = (&camera.estimate, camera.error)
            else {
                continue;
            };
            for (all, error) in errors.iter_mut().zip([x, y, x.hypot(y), heading_deg]) {
                all.push(error);
            }
            let compared = [
                (x, estimate.sigma_x),
                (y, estimate.sigma_y),
                (heading_deg, estimate.sigma_heading_deg),
            ];
            for (within, (error, sigma)) in within.iter_mut().zip(compared) {
                // A given value is not an estimate.
                if sigma > 0.0 {
                    within.add(error.abs() / sigma);
                }
            }
            if let Some(nees) = camera.nees {
                nees_sum += nees;
                nees_count += 1;
            }
        }
        let [x, y, position, heading_deg] = errors;
        let [within_x, within_y, within_heading] = within.map(|within| within.shares());
        Some(Self {
            count: x.len(),
            x: Errors::of(&x)?,
            y: Errors::of(&y)?,
            position: Errors::of(&position)?,
            heading_deg: Errors::of(&heading_deg)?,
            within_sigmas: Within {
                x: within_x,
                y: within_y,
                heading: within_heading,
            },
            mean_nees: (nees_count > 0).then(|| nees_sum / f64::from(nees_count)),
        })
    }
}

impl Errors {
    /// Of signed errors; `None` of none.
    pub fn of(signed: &[f64]) -> Option<Self> {
        let mut absolute: Vec<f64> = signed.iter().map(|e| e.abs()).collect();
        let spread = Spread::of(&mut absolute)?;
        let n = signed.len() as f64;
        let mean = signed.iter().sum::<f64>() / n;
        let squares: f64 = signed.iter().map(|e| (e - mean).powi(2)).sum();
        Some(Self {
            rms: spread.rms,
            mean,
            standard_deviation: (signed.len() > 1).then(|| (squares / (n - 1.0)).sqrt()),
            median: spread.median,
            p90: spread.p90,
        })
    }
}
