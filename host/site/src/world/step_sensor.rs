//! Measurements that a step sensor makes of steps.

use calib_core::dead_reckoning::Step;
use nalgebra::Vector2;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::walker::Stride;

/// Errors of a step sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorErrors {
    /// It measures the way that was walked. Otherwise it reports the planned way from goal to goal, as the
    /// thesis's target does (section 4.3): it then stands a little short of each place that it tells, but that
    /// error does not grow.
    pub measures: bool,
    /// Relative error of all distances of a leg, standard deviation.
    pub leg_distance: f64,
    /// Error of all headings of a leg, standard deviation, radians.
    pub leg_heading: f64,
    /// As `leg_distance`, but not in the sigmas that it tells.
    pub undeclared_distance: f64,
    /// As `leg_heading`, but not in the sigmas that it tells.
    pub undeclared_heading: f64,
    /// Relative error of each step's distance, standard deviation.
    pub step_distance: f64,
    /// Error of each step's heading, standard deviation, radians.
    pub step_heading: f64,
    /// Relative error of all distances.
    pub scale_bias: f64,
    /// Error of all headings, radians.
    pub heading_bias: f64,
}

/// A step sensor. Its errors come from the generator that it is given and nothing else.
#[derive(Clone, Debug)]
pub struct StepSensor {
    errors: SensorErrors,
    /// Direction in the world of the x axis of its headings.
    axis: f64,
    random: ChaCha8Rng,
    /// The leg, and its errors of distance and heading.
    leg: Option<(usize, [f64; 2])>,
}

impl StepSensor {
    /// A sensor whose headings count from the direction `axis` of the world, radians.
    pub fn new(errors: SensorErrors, axis: f64, random: ChaCha8Rng) -> Self {
        Self {
            errors,
            axis,
            random,
            leg: None,
        }
    }

    /// Returns its report of a step.
    ///
    /// The sigmas are those of its random errors, less the undeclared ones. An error that a leg's steps share is given as the
    /// independent error that would grow as much over that leg; of its biases it knows nothing.
    pub fn measure(&mut self, stride: &Stride) -> Step<f32> {
        let errors = self.errors;
        let [leg_distance, leg_heading] = match self.leg {
            Some((leg, drawn)) if leg == stride.leg => drawn,
            _ => {
                let drawn = [
                    self.normal(errors.leg_distance.hypot(errors.undeclared_distance)),
                    self.normal(errors.leg_heading.hypot(errors.undeclared_heading)),
                ];
                self.leg = Some((stride.leg, drawn));
                drawn
            }
        };
        let way: Vector2<f64> = if errors.measures {
            stride.walked
        } else {
            stride.planned
        };
        let scale = 1.0 + leg_distance + errors.scale_bias + self.normal(errors.step_distance);
        let turn = leg_heading + errors.heading_bias + self.normal(errors.step_heading);
        let heading = way.y.atan2(way.x) - self.axis + turn;
        let root = (stride.of as f64).sqrt();
        let distance_sigma = (errors.leg_distance * root).hypot(errors.step_distance);
        let heading_sigma = (errors.leg_heading * root).hypot(errors.step_heading);
        Step {
            distance: (way.norm() * scale).max(0.0) as f32,
            heading: calib_core::angle::wrap_positive(heading) as f32,
            distance_sigma: (way.norm() * distance_sigma) as f32,
            heading_sigma: heading_sigma as f32,
        }
    }

    fn normal(&mut self, sigma: f64) -> f64 {
        let standard: f64 = StandardNormal.sample(&mut self.random);
        sigma * standard
    }
}
