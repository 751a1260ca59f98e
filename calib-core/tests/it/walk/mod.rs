//! A target that walks with errors of known size.

use calib_core::dead_reckoning::{Step, Systematic, Track};
use nalgebra::{Matrix2, Point2, Vector2};
use test_support::{Random, normal};

pub(crate) fn unit(angle: f64) -> Vector2<f64> {
    Vector2::new(angle.cos(), angle.sin())
}

/// Errors far smaller than a person's: the tests are of first order.
pub(crate) fn step(distance: f64, heading: f64) -> Step<f64> {
    Step {
        distance,
        heading,
        distance_sigma: 0.001 * distance,
        heading_sigma: 0.002,
    }
}

/// A target whose sensor errs: the track follows the measurements, `truth` the walk.
pub(crate) struct Walk {
    pub(crate) track: Track<f64>,
    pub(crate) truth: Point2<f64>,
    systematic: Systematic<f64>,
    bias: f64,
    scale: f64,
}

impl Walk {
    pub(crate) fn start(rng: &mut Random, systematic: Systematic<f64>) -> Self {
        let (bias, scale) = (
            systematic.heading_sigma * normal(rng),
            systematic.scale_sigma * normal(rng),
        );
        let truth = Point2::new(3.0, -1.0);
        let track = Track::start(truth, Matrix2::zeros(), systematic).unwrap();
        let mut walk = Self {
            track,
            truth,
            systematic,
            bias,
            scale,
        };
        walk.fix(rng, 0.0, 0.0);
        walk
    }

    /// The references see the target, to within these sigmas in x and y.
    pub(crate) fn fix(&mut self, rng: &mut Random, x: f64, y: f64) {
        let seen = self.truth + Vector2::new(x * normal(rng), y * normal(rng));
        let covariance = Matrix2::new(x * x, 0.0, 0.0, y * y);
        self.track
            .relocate(seen, covariance, self.systematic)
            .unwrap();
    }

    fn take(&mut self, rng: &mut Random, meant: Step<f64>) {
        self.truth += unit(meant.heading) * meant.distance;
        let measured = Step {
            distance: meant.distance * (1.0 + self.scale) + meant.distance_sigma * normal(rng),
            heading: meant.heading + self.bias + meant.heading_sigma * normal(rng),
            ..meant
        };
        self.track.advance(&measured).unwrap();
    }

    /// In a straight line, in steps of about 0.7.
    pub(crate) fn go(&mut self, rng: &mut Random, to: Point2<f64>) {
        let way = to - self.truth;
        let count = (way.norm() / 0.7).ceil().max(1.0);
        for _ in 0..count as u32 {
            self.take(rng, step(way.norm() / count, way.y.atan2(way.x)));
        }
    }

    pub(crate) fn error(&self) -> Vector2<f64> {
        self.track.position() - self.truth
    }
}

pub(crate) const SYSTEMATIC: Systematic<f64> = Systematic {
    heading_sigma: 0.001,
    scale_sigma: 0.0015,
};
