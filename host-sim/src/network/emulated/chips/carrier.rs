//! The carrier of a target, as the sensors on the belt feel it.
//!
//! A body makes each step that the simulation's step sensor reports: it turns to where the step goes, and
//! rises and falls once, the more the longer the step is (Weinberg, as in `pedestrian::StepLength`; the page
//! has the carrier's `K`). The sensor's chips and the image measure this motion themselves. The image takes
//! a tenth of a step as its uncertainty, which no scenario changes. So the body makes a step with the error
//! with which it is reported. A scenario without measurements reports the ways from one mark on the floor
//! to the next: steps that are exactly as long reach the marks.
//!
//! Bodies do not walk 25 millimetres a step, or a tenth of one unit. Where the `K` of the page and the
//! length of the scenario's steps are not those of a person who walks, the page gets the `K` of a carrier
//! whose usual step this is, as a person who calibrates it would write there.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use calib_core::{angle::wrap_signed, dead_reckoning::Step};
use virtual_hardware::executor::Time;

use super::outside::Motion;

const SECOND: f64 = 1e9;
const GRAVITY: f64 = 9.806_65;
/// Magnetic field of the earth in the middle of Europe: to the north, and up, uT.
const FIELD: [f64; 2] = [20.0, -43.0];

/// Duration of a usual step.
const STEP: Time = 500_000_000;
/// Angular rate at which the body turns, rad/s: less than the gyroscope's range of 8.7.
const TURN: f64 = 5.0;
/// Smaller turns are left out, rad.
const STRAIGHT: f64 = 1e-4;
/// Time between two motions that are told while it moves.
const TICK: Time = 4_000_000;
/// Delay from an order to its motion: chips have gone on meanwhile.
const NOTICE: Time = 1_000_000;

/// Amplitude of the up and down of usual steps, m/s^2: an adult's. And its range for any steps: the last step
/// can still be told from standing, and the feet stay on the ground.
const USUAL: f64 = 4.0;
const SWINGS: [f64; 2] = [1.1, 9.0];
/// Share that is left of a swing at two steps a second where the `K` of a page applies: behind two low-passes
/// of 3 Hz (`cutoff` of `pedestrian::StepDetectorSettings`), of first order at 52 Hz.
const LEFT: f64 = 0.624;

/// A carrier.
#[derive(Clone, Debug)]
pub(super) struct Carrier {
    /// Its `K`, in the scenario's unit over (m/s^2)^(1/4).
    pub(super) step_length: f32,
    /// Magnetic field of its own parts, uT.
    hard_iron: [f64; 3],
    /// Direction that it faces, as the sensor counts: counter-clockwise from magnetic east.
    facing: f64,
    /// Time until which it moves.
    until: Time,
}

impl Carrier {
    /// A carrier with usual steps of this length, and with the page's values.
    pub(super) fn new(usual: f64, step_length: f32, hard_iron: [f32; 3]) -> Self {
        let amplitude = amplitude(usual, step_length.into());
        let [least, most] = SWINGS;
        let is_body = (2.0 * least..most / 1.5).contains(&amplitude);
        let own = usual / (2.0 * LEFT * USUAL).sqrt().sqrt();
        Self {
            step_length: if is_body { step_length } else { own as f32 },
            hard_iron: hard_iron.map(f64::from),
            facing: FRAC_PI_2,
            until: 0,
        }
    }

    /// Stands, from a time on.
    pub(super) fn stand(&mut self, now: Time) -> Motion {
        self.until = now;
        self.motion(now, 0.0, 0.0)
    }

    /// Makes a step once it has made those before.
    pub(super) fn step(&mut self, now: Time, step: &Step<f32>) -> Vec<Motion> {
        let mut motions = Vec::new();
        let begin = self.until.max(now + NOTICE);
        let turn = wrap_signed(f64::from(step.heading) - self.facing);
        let mut at = begin;
        if turn.abs() > STRAIGHT {
            let from = self.facing;
            let lasts = (turn.abs() / TURN * SECOND) as Time + 1;
            let rate = turn / (lasts as f64 / SECOND);
            while at < begin + lasts {
                self.facing = from + turn * ((at - begin) as f64 / lasts as f64);
                motions.push(self.motion(at, 0.0, rate));
                at += TICK;
            }
            at = begin + lasts;
            self.facing = f64::from(step.heading);
        }
        let [least, most] = SWINGS;
        let amplitude = amplitude(step.distance.into(), self.step_length.into());
        let amplitude = amplitude.clamp(least, most);
        let begin = at;
        while at < begin + STEP {
            let phase = (at - begin) as f64 / STEP as f64;
            motions.push(self.motion(at, amplitude * (TAU * phase).sin(), 0.0));
            at += TICK;
        }
        self.until = begin + STEP;
        motions.push(self.motion(self.until, 0.0, 0.0));
        motions
    }

    fn motion(&self, at: Time, rise: f64, turn: f64) -> Motion {
        let [north, up] = FIELD;
        // Direction of north, from forward to the left.
        let (left, forward) = (PI / 2.0 - self.facing).sin_cos();
        let [x, y, z] = self.hard_iron;
        Motion {
            at,
            acceleration: [0.0, 0.0, GRAVITY + rise],
            angular_rate: [0.0, 0.0, turn],
            field: [north * forward + x, north * left + y, up + z],
        }
    }
}

/// Amplitude with which a body rises and falls in such a step, m/s^2.
fn amplitude(distance: f64, step_length: f64) -> f64 {
    (distance / step_length).powi(4) / (2.0 * LEFT)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use nalgebra::{Vector2, Vector3};
    use pedestrian::{ImuSample, Pedestrian, PedestrianSettings, StepLength};

    use super::*;

    /// Steps that a person who wears the sensors makes of these motions, at 52 Hz.
    fn felt(carrier: &Carrier, motions: &[Motion], until: Time) -> Vec<Step<f64>> {
        let length = StepLength {
            k: carrier.step_length.into(),
            ..StepLength::default()
        };
        let mut settings = PedestrianSettings::default();
        settings.length = length;
        let mut person = Pedestrian::new(settings).unwrap();
        let samples = (0..until).step_by(19_200_000);
        let steps = samples.filter_map(|at| {
            let last = motions.partition_point(|motion| motion.at <= at) - 1;
            let motion = motions[last];
            let sample = ImuSample {
                acceleration: Vector3::from(motion.acceleration),
                angular_rate: Vector3::from(motion.angular_rate),
                magnetic_field: Some(
                    Vector3::from(motion.field) - Vector3::from(carrier.hard_iron),
                ),
            };
            person.update(Duration::from_nanos(at), &sample).unwrap()
        });
        steps.collect()
    }

    /// Ways of several steps in all directions are felt as they are told, up to a hundredth of them and a tenth
    /// of a step, because the first one begins at rest. This also holds where the page has a real person's `K`,
    /// and where it has none for such steps.
    #[test]
    fn what_is_told_is_felt() {
        for (usual, step_length) in [(1.0, 0.45), (0.1, 0.45), (0.7, 0.45), (0.5, 0.36)] {
            let mut carrier = Carrier::new(usual, step_length, [30.0, -20.0, 5.0]);
            let mut motions = vec![carrier.stand(0)];
            let mut now = 4_000_000_000;
            let legs = [
                (9, 0.95, 0.3),
                (7, 1.0, 2.8),
                (12, 0.92, 5.5),
                (5, 1.0, 4.0),
                (2, 0.75, 1.0),
            ];
            for (count, share, heading) in legs {
                for _ in 0..count {
                    let step = Step {
                        distance: (usual * share) as f32,
                        heading,
                        distance_sigma: 0.0,
                        heading_sigma: 0.0,
                    };
                    motions.extend(carrier.step(now, &step));
                    now += 250_000_000;
                }
                now += 10_000_000_000;
            }
            assert!(motions.is_sorted_by_key(|motion| motion.at));
            let felt = felt(&carrier, &motions, now);
            assert_eq!(felt.len(), 35, "{usual}");
            let mut steps = felt.iter();
            for (count, share, heading) in legs {
                let way = steps.by_ref().take(count).map(Step::displacement);
                let way: Vector2<f64> = way.sum();
                let told = usual * share * count as f64;
                let (sin, cos) = f64::from(heading).sin_cos();
                let off = (way.x - told * cos).hypot(way.y - told * sin);
                let allowed = 0.01 * told + 0.1 * usual;
                assert!(off < allowed, "{usual} {count} {share}: {off}");
            }
        }
    }
}
