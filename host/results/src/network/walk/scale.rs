//! Network whose baseline is not known.

use calib_core::{
    Pose, angle,
    joint::{BearingResidual, JointSettings, Prior, Standing},
};
use nalgebra::{Matrix3, Vector3};

use super::{Part, VAGUE, Walk};
use crate::network::estimator::{self, Depth, Failure, Input, Output};

/// An excluded displacement keeps so many times its sigmas.
const EXCLUDED: f64 = 50.0;

impl Walk<'_> {
    /// The carrier's distances set the scale. In a frame of one baseline its scale is free and tells
    /// how long that is; sigmas and correlations with it go into every length.
    pub(super) fn solve_unknown_baseline(
        &self,
        depth: Depth,
    ) -> Result<(Part, Output, [f64; 2]), Failure> {
        let free = Prior {
            mean: 1.0,
            sigma: VAGUE[0],
        };
        // First in units of a leg, then in those that the carrier has.
        let lengths = self
            .legs
            .iter()
            .flatten()
            .map(|leg| leg.displacement.norm());
        let longest = lengths.fold(f64::MIN_POSITIVE, f64::max);
        let (_, output, _) = self.solve_part(longest, Some(free), depth.believing())?;
        let baseline = longest * output.carrier.scale;
        let (part, mut output, _) = self.solve_part(baseline, Some(free), depth)?;
        let scale = output.carrier.scale;
        let sigma = output.carrier.sigma_scale();
        let [own_sigma, _] = self.carrier_sigmas();
        // Change of the answers with the scale: with their covariance, it is all that ties them to it.
        let input = without(&part.input, &output);
        let at = |scale: f64| {
            let settings = JointSettings {
                scale: Prior {
                    mean: scale,
                    sigma: sigma * 1e-4,
                },
                ..input.settings
            };
            let input = Input {
                settings,
                ..input.clone()
            };
            estimator::solve(&input, Depth::Answers)
        };
        let (less, more) = (at(scale - sigma)?, at(scale + sigma)?);
        let relative = (sigma / scale).hypot(own_sigma);
        let own = scale.recip();
        for ((pose, less), more) in output.poses.iter_mut().zip(&less.poses).zip(&more.poses) {
            if let (Some(pose), Some(less), Some(more)) = (pose, less, more) {
                let apart = more.position - less.position;
                let turned = angle::wrap_signed(more.heading - less.heading);
                // Covariance with the scale, over it.
                let c = Vector3::new(apart.x, apart.y, turned) * (0.5 * sigma * own);
                let m = Vector3::new(pose.position.x, pose.position.y, 0.0);
                let with = m * c.transpose();
                pose.covariance += with + with.transpose() + m * m.transpose() * relative.powi(2);
                stretch(pose, own);
            }
        }
        for ((place, less), more) in output.places.iter_mut().zip(&less.places).zip(&more.places) {
            if let (Some(place), Some(less), Some(more)) = (place, less, more) {
                let c = (more.position - less.position) * (0.5 * sigma * own);
                let m = place.position.coords;
                let with = m * c.transpose();
                place.covariance += with + with.transpose() + m * m.transpose() * relative.powi(2);
                place.position *= scale;
                place.covariance *= scale * scale;
            }
        }
        output.carrier.scale = 1.0;
        output.carrier.covariance.m11 = own_sigma.powi(2);
        output.carrier.covariance.m12 = 0.0;
        output.carrier.covariance.m21 = 0.0;
        output.fit.degrees_of_freedom = output.fit.degrees_of_freedom.saturating_sub(1);
        let baseline = baseline * scale;
        Ok((part, output, [baseline, baseline * relative]))
    }
}

/// The same measurements without those that were left out.
fn without(input: &Input, output: &Output) -> Input {
    let mut input = input.clone();
    if output.bearings.is_empty() {
        // Nothing was looked for.
        return input;
    }
    let counts = |left: &Option<BearingResidual<f64>>| {
        left.is_some_and(|left| left.standing == Standing::Counts)
    };
    let mut left = output.bearings.iter();
    input.bearings.retain(|_| left.next().is_some_and(counts));
    for (leg, left) in input.legs.iter_mut().zip(&output.legs) {
        let is_out = left
            .as_ref()
            .is_some_and(|left| left.standing != Standing::Counts);
        let factor = output.leg_factor.unwrap_or(1.0) * if is_out { EXCLUDED } else { 1.0 };
        if let Some(leg) = leg {
            leg.covariance *= factor * factor;
        }
    }
    input
}

/// All lengths times a factor.
fn stretch(pose: &mut Pose<f64>, own: f64) {
    let factor = own.recip();
    let scale = Matrix3::from_diagonal(&Vector3::new(factor, factor, 1.0));
    pose.position *= factor;
    pose.covariance = scale * pose.covariance * scale;
}
