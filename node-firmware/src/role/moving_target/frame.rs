//! Frame of the estimate: two cameras, and their places in the frame of the site.

use calib_core::{
    Pose, angle,
    dead_reckoning::{Place, Systematic},
    joint::{Carrier, StopPlace},
};
use nalgebra::{Matrix2, Matrix3, Point2, RealField, Vector2};

use crate::{
    arithmetic::root,
    config::SurveySigma,
    message::{MemberAddress, StopNumber},
};

/// Largest relative error of a baseline.
const BASELINE_SHARE: f32 = 0.05;
/// Largest relative error of a baseline that was given, not measured.
const EXACT_SHARE: f32 = 1e-3;
/// Standard deviations beyond which the carrier's steps contradict the baseline. From twice as many on, the baseline is
/// as unsure as both are apart.
const APART: f32 = 2.0;

/// State that a target brings along from another network: its place at a first stop here, the direction of
/// its steps, and their scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arrival {
    pub(super) stop: StopNumber,
    place: Place<f32>,
    /// Direction of the step sensor's x axis in the frame of the site, radians.
    pub(super) heading: f32,
    /// Ratio of the sensor's reading to the true length.
    pub(super) scale: f32,
}

impl Arrival {
    pub(super) const fn new(
        stop: StopNumber,
        place: Place<f32>,
        (heading, scale): (f32, f32),
    ) -> Self {
        Self {
            stop,
            place,
            heading,
            scale,
        }
    }

    /// Standard deviations of both.
    pub(super) fn sigmas(&self) -> Systematic<f32> {
        self.place.parts().systematic
    }

    /// Covariance of the common error of all places reckoned from its last fix, at one of them.
    fn covariance(&self, at: Point2<f32>) -> Matrix2<f32> {
        let parts = self.place.parts();
        let [xx, xy, yy] = parts.fix_covariance;
        let from_fix = at - (parts.position - parts.walked);
        Matrix2::new(xx, xy, xy, yy) + parts.systematic.covariance(from_fix)
    }
}

/// Place of the estimator's frame in the frame of the site. Its unit is the told baseline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    pub(super) references: [MemberAddress; 2],
    pub(super) baseline: f32,
    origin: Point2<f32>,
    /// Direction from the first reference to the second, radians.
    pub(super) direction: f32,
    /// Lengths in the site over those in this frame.
    stretch: f32,
    errors: Errors,
    /// Sigmas of the places that were given to references.
    survey: SurveySigma,
    /// Standard deviation of the scale of the carrier's steps, as it was told.
    steps: f32,
    /// The carrier's steps contradict the baseline.
    is_contradicted: bool,
    /// Variances of their places by pitches that are not known exactly.
    hung: [f32; 2],
}

/// Errors of the place of the frame in that of the site.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Errors {
    /// Sigmas of the places of both cameras. Zero for a given place.
    References([f32; 2]),
    /// The references define the frame, and their distance is one of the unknowns.
    None,
    /// A target brought the frame along: the place of one stop, the direction of its steps, and their scale.
    Arrival {
        /// That stop, in the frame of the site.
        stop: Point2<f32>,
        covariance: Matrix2<f32>,
        /// Variances of directions, and of lengths relative.
        turned: f32,
        stretched: f32,
    },
}

/// Standard deviation of the place of a camera, without the common error of an arrival.
#[inline(never)] // once, for less flash
fn own_sigma(pose: &Pose<f32>, arrival: Option<&Arrival>) -> f32 {
    let all = pose.sigma_position();
    let common = arrival.map_or(0.0, |of| of.covariance(pose.position).trace());
    root((all * all - common).max(0.0))
}

impl Frame {
    /// Frame between two cameras. `None` if their distance is hardly known, unless they are references that define the
    /// frame of the site: then the distance is one of the unknowns. Their common error from the arrival of the target
    /// does not count.
    pub(super) fn between(
        references: [(MemberAddress, Pose<f32>); 2],
        arrival: Option<&Arrival>,
    ) -> Option<Self> {
        let [(first, from), (second, to)] = references;
        let between = to.position - from.position;
        let baseline = root(between.norm_squared());
        let sigmas = [own_sigma(&from, arrival), own_sigma(&to, arrival)];
        let sum = sigmas.iter().sum::<f32>();
        // The origin, and a place that is unknown along the x axis only.
        let is_frame = matches!(sigmas, [0.0, _]) && to.covariance.m22 == 0.0;
        let is_estimated = is_frame && arrival.is_none() && sum > baseline * EXACT_SHARE;
        let is_known = baseline > 0.0 && (is_estimated || sum <= baseline * BASELINE_SHARE);
        is_known.then_some(Self {
            references: [first, second],
            baseline,
            origin: from.position,
            direction: RealField::atan2(between.y, between.x),
            stretch: 1.0,
            errors: if is_estimated {
                Errors::None
            } else {
                Errors::References(sigmas)
            },
            survey: SurveySigma::EXACT,
            steps: f32::INFINITY,
            is_contradicted: false,
            hung: [0.0; 2],
        })
    }

    /// The same frame, with the sigmas of the surveyed places and of the scale of the steps. These do not count if a
    /// target brought its frame along, or if places were estimated: then their sigmas are known.
    pub(super) fn surveyed(self, survey: &SurveySigma, steps: f32) -> Self {
        let survey = if self.is_given() {
            *survey
        } else {
            SurveySigma::EXACT
        };
        Self {
            survey,
            steps,
            ..self
        }
    }

    /// The same frame, less sure if the steps contradict a measured baseline: one of both is wrong. `scale` is the
    /// estimated ratio of the step sensor's reading to the true length.
    pub(super) fn tested_by(mut self, scale: f32) -> Self {
        let off = scale - 1.0;
        let baseline = &mut self.survey.baseline;
        let sigma = root(self.steps * self.steps + *baseline * *baseline);
        let beyond = ((off / sigma).abs() / APART - 1.0).clamp(0.0, 1.0);
        if *baseline > 0.0 {
            let share = off * beyond;
            *baseline = root(*baseline * *baseline + share * share);
            self.is_contradicted = beyond > 0.0;
        }
        self
    }

    /// Returns true if the carrier's steps [contradict](Self::tested_by) the distance of both.
    pub(super) const fn is_contradicted(&self) -> bool {
        self.is_contradicted
    }

    /// The same frame, with the variances of the references' places because of their pitch.
    pub(super) fn hung(self, hung: [f32; 2]) -> Self {
        Self { hung, ..self }
    }

    /// The same cameras in the frame that the target brought along: the place of its stop of arrival, and the direction
    /// and the scale of its steps, stay the same.
    pub(super) fn arrived(
        self,
        arrival: &Arrival,
        stop: &StopPlace<f32>,
        carrier: &Carrier<f32>,
        inflation: f32,
    ) -> Self {
        let direction = angle::wrap_signed(arrival.heading + carrier.compass);
        let stretch = carrier.scale / arrival.scale;
        let frame = Self {
            direction,
            stretch,
            origin: Point2::origin(),
            ..self
        };
        let there = arrival.place.position();
        let sigmas = arrival.sigmas();
        let of_stop =
            angle::turned(&stop.covariance, &frame.turn()) * (inflation * stretch * stretch);
        let [turned, stretched] = [
            carrier.covariance.m22 * inflation + sigmas.heading_sigma * sigmas.heading_sigma,
            carrier.covariance.m11 * inflation / (carrier.scale * carrier.scale)
                + sigmas.scale_sigma * sigmas.scale_sigma,
        ];
        Self {
            origin: there - frame.place(stop.position).coords,
            errors: Errors::Arrival {
                stop: there,
                covariance: arrival.place.covariance() + of_stop,
                turned,
                stretched,
            },
            survey: SurveySigma::EXACT,
            ..frame
        }
    }

    /// The sum of the errors of both references, over their distance.
    pub(super) fn share(&self) -> f32 {
        match self.errors {
            Errors::References([a, b]) => (a + b) / self.baseline,
            Errors::None | Errors::Arrival { .. } => f32::INFINITY,
        }
    }

    /// Returns true if both places were given. No frame is better.
    pub(super) fn is_given(&self) -> bool {
        matches!(self.errors, Errors::References([0.0, 0.0]))
    }

    /// Returns true if the distance was given, or is one of the unknowns.
    pub(super) fn is_exact(&self) -> bool {
        self.share() <= EXACT_SHARE || !self.is_baseline_known()
    }

    /// Returns true if the distance is known.
    pub(super) fn is_baseline_known(&self) -> bool {
        !matches!(self.errors, Errors::None)
    }

    /// A place of this frame in that of the site.
    pub(super) fn place(&self, position: Point2<f32>) -> Point2<f32> {
        self.origin + self.turn() * position.coords * self.stretch
    }

    /// A covariance of this frame in that of the site, with the error of the frame there.
    pub(super) fn place_covariance(
        &self,
        position: Point2<f32>,
        covariance: &Matrix2<f32>,
    ) -> Matrix2<f32> {
        let own = angle::turned(covariance, &self.turn()) * (self.stretch * self.stretch);
        own + self.covariance(position)
    }

    /// A pose in the frame of the site, with the error of the frame.
    pub(super) fn in_site(&self, pose: &Pose<f32>) -> Pose<f32> {
        let place = self.covariance(pose.position);
        let k = self.stretch;
        let kk = k * k;
        let stretched = Matrix3::new(kk, kk, k, kk, kk, k, k, k, 1.0);
        let pose = Pose {
            position: pose.position * k,
            covariance: pose.covariance.component_mul(&stretched),
            ..*pose
        };
        let mut pose = pose.seen_from(self.origin, self.direction);
        pose.covariance += Matrix3::new(
            place.m11,
            place.m12,
            0.0,
            place.m21,
            place.m22,
            0.0,
            0.0,
            0.0,
            self.turned(),
        );
        pose
    }

    /// Error of the frame at one of its places: covariance in the frame of the site. To first order, with the
    /// baseline as the complex unit, a place `s` moves by `(1 - s) da + s db` with the references.
    pub(super) fn covariance(&self, position: Point2<f32>) -> Matrix2<f32> {
        match &self.errors {
            Errors::References(sigmas) => {
                let along = position.coords / self.baseline;
                let [a, b] = self.place_variances(sigmas);
                let from_first = along.norm_squared();
                let from_second = (along - Vector2::x()).norm_squared();
                // An error of the baseline stretches everything.
                let stretched = self.turn() * position.coords * self.survey.baseline;
                Matrix2::from_diagonal_element(from_second * a + from_first * b)
                    + stretched * stretched.transpose()
            }
            Errors::None => Matrix2::zeros(),
            Errors::Arrival {
                stop,
                covariance,
                turned,
                stretched,
            } => {
                let systematic = Systematic {
                    heading_sigma: root(*turned),
                    scale_sigma: root(*stretched),
                };
                covariance + systematic.covariance(self.place(position) - stop)
            }
        }
    }

    /// Variance of directions. If the references move by `da` and `db`, everything turns by `db - da` across the
    /// baseline.
    pub(super) fn turned(&self) -> f32 {
        match self.errors {
            Errors::References(sigmas) => {
                let [a, b] = self.place_variances(&sigmas);
                (a + b) / (self.baseline * self.baseline)
            }
            Errors::None => 0.0,
            Errors::Arrival { turned, .. } => turned,
        }
    }

    /// Variances of the references' places, along each axis.
    fn place_variances(&self, sigmas: &[f32; 2]) -> [f32; 2] {
        let surveyed = self.survey.position * self.survey.position;
        let [[a, b], [first, second]] = [sigmas.map(|sigma| sigma * sigma * 0.5), self.hung];
        [a + surveyed + first, b + surveyed + second]
    }

    fn turn(&self) -> Matrix2<f32> {
        angle::rotation(self.direction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps that agree with the baseline change nothing; those that are far off make it as wide as that. A baseline that
    /// is exact by promise stays.
    #[test]
    fn steps_test_a_baseline() {
        let at = |x| Pose {
            position: Point2::new(x, 0.0),
            heading: 0.0,
            covariance: Matrix3::zeros(),
        };
        let frame = Frame::between([(1, at(0.0)), (2, at(5.0))], None).unwrap();
        let share = |baseline, scale| {
            let survey = SurveySigma {
                baseline,
                position: 0.0,
            };
            let frame = frame.surveyed(&survey, 0.03).tested_by(scale);
            let is_off = baseline > 0.0 && (scale - 1.0_f32).abs() > 0.1;
            assert_eq!(frame.is_contradicted(), is_off, "{baseline} {scale}");
            root(frame.covariance(Point2::new(5.0, 0.0)).m11) / 5.0
        };
        for (baseline, scale, wide) in [
            (0.02, 1.05, 0.02),
            (0.02, 0.95, 0.02),
            (0.02, 1.2, 0.201),
            (0.02, 0.8, 0.201),
            (0.0, 1.2, 0.0),
        ] {
            let told = share(baseline, scale);
            assert!((told - wide).abs() < 1e-3, "{baseline} {scale}: {told}");
        }
        assert!((0.03..0.09).contains(&share(0.02, 1.1)));
    }
}
