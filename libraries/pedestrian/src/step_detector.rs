//! Detection of steps.

use calib_core::{Real, lit};

use crate::{InvalidSetting, settings::require};

/// Settings of a [`StepDetector`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct StepDetectorSettings<T> {
    /// Corner frequency of the low-pass, Hz, 0.5 to 20. Default 3: steps come at 1.5 to 2.2 a second, the jolt of
    /// the heel and rattling lie above.
    pub cutoff: T,
    /// The smallest swing that can be a step, m/s^2 after the low-pass, above zero. Default 0.5:
    /// slow walking swings by about 55 mg (Zhao), while the noise of a MEMS accelerometer, some
    /// 0.03 m/s^2, is below 0.1 from tip to tip after the low-pass.
    pub smallest_swing: T,
    /// The shortest time between two steps, seconds, 0.1 or more. Default 0.2 (Zhao: no person runs faster than
    /// five steps a second).
    pub shortest_interval: T,
    /// The longest time between two steps of one walk, seconds, above the shortest. Default 2 (Zhao: no person
    /// walks slower than a step in two seconds).
    pub longest_interval: T,
}

impl<T: Real> Default for StepDetectorSettings<T> {
    fn default() -> Self {
        Self {
            cutoff: lit(3.0),
            smallest_swing: lit(0.5),
            shortest_interval: lit(0.2),
            longest_interval: lit(2.0),
        }
    }
}

/// One swing of the acceleration, from a peak to the valley after it: a step, if it is not alone.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Swing<T> {
    /// `a_max - a_min` of the low-passed norm, m/s^2.
    pub amplitude: T,
    /// Seconds since the swing before; `None` when that was too long ago to be of the same walk.
    pub interval: Option<T>,
}

/// Finds the swings of walking in the norm of the acceleration, which does not depend on how the
/// sensor is worn.
///
/// The norm is low-passed; then peaks and valleys alternate, each counting only once the signal
/// has left it by a threshold (hysteresis), so no baseline and no value of gravity is needed. The
/// threshold follows the walk: 0.3 of the usual swing, so that a second bump within a step is not
/// taken for another, and never below [`StepDetectorSettings::smallest_swing`]. Dynamic threshold
/// and time window are those of N. Zhao, "Full-featured pedometer design realized with 3-axis
/// digital accelerometer", Analog Dialogue 44-06, 2010; his demand for several steps in a row is
/// made by [`Pedestrian`](crate::Pedestrian), which knows what to do with those held back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepDetector<T> {
    settings: StepDetectorSettings<T>,
    filter: Option<LowPass<T>>,
    phase: Phase,
    high: T,
    low: T,
    since_high: T,
    /// Time since the last swing that counted.
    since_swing: T,
    /// Time since the last swing, whether it counted or not.
    since_any: T,
    /// Running mean of the swings of this walk, or zero.
    usual: T,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No peak or valley yet.
    Start,
    /// Since a valley: looking for the peak.
    Rising,
    /// Since a peak: looking for the valley.
    Falling,
}

impl<T: Real> StepDetector<T> {
    /// A detector that has seen nothing yet.
    ///
    /// # Errors
    /// A setting out of its range.
    pub fn new(settings: StepDetectorSettings<T>) -> Result<Self, InvalidSetting> {
        let s = &settings;
        require(&[
            (s.cutoff >= lit(0.5) && s.cutoff <= lit(20.0), "cutoff"),
            (
                s.smallest_swing > T::zero() && s.smallest_swing.is_finite(),
                "smallest_swing",
            ),
            (s.shortest_interval >= lit(0.1), "shortest_interval"),
            (
                s.longest_interval > s.shortest_interval && s.longest_interval.is_finite(),
                "longest_interval",
            ),
        ])?;
        Ok(Self {
            settings,
            filter: None,
            phase: Phase::Start,
            high: T::zero(),
            low: T::zero(),
            since_high: T::zero(),
            since_swing: T::zero(),
            since_any: settings.longest_interval,
            usual: T::zero(),
        })
    }

    /// Forgets all but the settings: after a gap in the samples.
    pub fn restart(&mut self) {
        self.filter = None;
        self.usual = T::zero();
    }

    /// Takes the norm of the acceleration, m/s^2, `dt` seconds after the one before. Says when a
    /// swing is complete, a quarter of a step or so after its valley. A `dt` that is not above
    /// zero and finite, or a norm that is not within `[0, 1e5]`, changes nothing.
    pub fn update(&mut self, dt: T, norm: T) -> Option<Swing<T>> {
        if !(dt > T::zero() && dt.is_finite() && norm >= T::zero() && norm <= lit(1e5)) {
            return None;
        }
        let Some(filter) = &mut self.filter else {
            self.filter = Some(LowPass::at(norm));
            self.seek(norm);
            return None;
        };
        let tau = T::one() / (T::two_pi() * self.settings.cutoff);
        let x = filter.update(dt / (tau + dt), norm);

        // Bounded, so that a scalar of few digits does not stall in a long rest.
        let longest = self.settings.longest_interval;
        let bound = longest + longest;
        self.since_high = (self.since_high + dt).min(bound);
        self.since_swing = (self.since_swing + dt).min(bound);
        self.since_any = (self.since_any + dt).min(bound);
        if self.since_swing > longest {
            self.usual = T::zero();
        }

        let threshold = self.settings.smallest_swing.max(self.usual * lit::<T>(0.3));
        match self.phase {
            Phase::Start => {
                self.low = self.low.min(x);
                self.high = self.high.max(x);
                if x - self.low >= threshold {
                    self.rise_from(x);
                } else if self.high - x >= threshold {
                    self.since_high = T::zero();
                    self.fall_from(x);
                }
                None
            }
            // Standing still, or a peak with no valley after it, which was a knock.
            Phase::Rising | Phase::Falling if self.since_high > longest => {
                self.seek(x);
                None
            }
            Phase::Rising => {
                if x > self.high {
                    self.rise_from(x);
                } else if self.high - x >= threshold {
                    self.fall_from(x);
                }
                None
            }
            Phase::Falling => {
                self.low = self.low.min(x);
                if x - self.low < threshold {
                    return None;
                }
                let amplitude = self.high - self.low;
                self.rise_from(x);
                self.complete(amplitude)
            }
        }
    }

    fn complete(&mut self, amplitude: T) -> Option<Swing<T>> {
        let since_any = core::mem::replace(&mut self.since_any, T::zero());
        if since_any < self.settings.shortest_interval {
            return None;
        }
        // `usual` is zero exactly when there is no swing of the same walk before this one.
        let interval = (self.usual > T::zero()).then_some(self.since_swing);
        self.usual = match interval {
            Some(_) => self.usual + (amplitude - self.usual) * lit(0.25),
            None => amplitude,
        };
        self.since_swing = T::zero();
        Some(Swing {
            amplitude,
            interval,
        })
    }

    fn seek(&mut self, x: T) {
        self.phase = Phase::Start;
        self.low = x;
        self.high = x;
    }

    fn rise_from(&mut self, x: T) {
        self.phase = Phase::Rising;
        self.high = x;
        self.since_high = T::zero();
    }

    fn fall_from(&mut self, x: T) {
        self.phase = Phase::Falling;
        self.low = x;
    }
}

/// Two equal first-order low-passes in series: no overshoot, so a knock leaves no valley behind.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LowPass<T> {
    first: T,
    second: T,
}

impl<T: Real> LowPass<T> {
    fn at(x: T) -> Self {
        Self {
            first: x,
            second: x,
        }
    }

    fn update(&mut self, gain: T, x: T) -> T {
        self.first += (x - self.first) * gain;
        self.second += (self.first - self.second) * gain;
        self.second
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    const RATE: f64 = 100.0;

    fn swings(signal: impl Iterator<Item = f64>) -> std::vec::Vec<Swing<f64>> {
        let mut detector = StepDetector::new(StepDetectorSettings::default()).unwrap();
        signal
            .filter_map(|x| detector.update(1.0 / RATE, x))
            .collect()
    }

    fn sine(frequency: f64, amplitude: f64, seconds: f64) -> impl Iterator<Item = f64> {
        (0..(seconds * RATE) as u32).map(move |i| {
            let t = f64::from(i) / RATE;
            9.81 + amplitude * (core::f64::consts::TAU * frequency * t).sin()
        })
    }

    fn rest(seconds: f64) -> impl Iterator<Item = f64> {
        sine(0.0, 0.0, seconds)
    }

    #[test]
    fn a_swing_for_every_cycle() {
        for (frequency, seconds, cycles) in [(1.0, 12.0, 12), (1.6, 10.0, 16), (2.5, 8.0, 20)] {
            for amplitude in [1.5, -1.5, 4.0] {
                let walk = rest(2.0)
                    .chain(sine(frequency, amplitude, seconds))
                    .chain(rest(2.0));
                let found = swings(walk);
                assert_eq!(found.len(), cycles, "{frequency} Hz, {amplitude} m/s^2");
                assert_eq!(found[0].interval, None);
                for swing in &found[2..] {
                    assert!((swing.interval.unwrap() - 1.0 / frequency).abs() < 0.06);
                }
            }
        }
    }

    /// The two poles' gain is `1 / (1 + (f / f_c)^2)`, from filter theory.
    #[test]
    fn the_amplitude_is_that_of_the_low_passed_sine() {
        let found = swings(sine(1.5, 2.0, 10.0));
        let expected = 2.0 * 2.0 / (1.0 + 0.25);
        for swing in &found[2..] {
            assert!((swing.amplitude - expected).abs() < 0.05 * expected);
        }
    }

    #[test]
    fn a_long_pause_starts_another_walk() {
        let walk = || sine(2.0, 3.0, 3.0);
        let downwards = || sine(2.0, -3.0, 3.0);
        let found = swings(
            rest(1.0)
                .chain(walk())
                .chain(rest(5.0))
                .chain(downwards())
                .chain(rest(1.0)),
        );
        let starts = found.iter().filter(|s| s.interval.is_none()).count();
        assert_eq!((starts, found.len()), (2, 12));
    }

    #[test]
    fn bumps_within_a_step_do_not_count() {
        let walk = (0..1500).map(|i| {
            let phase = core::f64::consts::TAU * 1.8 * f64::from(i) / RATE;
            9.81 + 3.0 * phase.sin() + 1.5 * (2.0 * phase + 1.0).sin() + (3.0 * phase).sin()
        });
        assert_eq!(swings(walk.chain(rest(1.0))).len(), 27);
    }

    /// A smaller bump belongs to the step, a larger one is another: seen without the low-pass, which would make either smaller.
    #[test]
    fn the_threshold_is_three_tenths_of_the_swing() {
        let count = |bump: f64| {
            let mut detector = StepDetector::new(StepDetectorSettings {
                cutoff: 20.0,
                ..StepDetectorSettings::default()
            })
            .unwrap();
            // From peak to valley, a bump, the valley again, and up to the next peak.
            let corners = [10.0, 0.0, bump * 10.0, 0.0, 10.0];
            (0..20 * 1600)
                .filter(|i| {
                    let at = f64::from(i % 1600) / 400.0;
                    let corner = at as usize;
                    let way = (1.0 - (core::f64::consts::PI * at.fract()).cos()) / 2.0;
                    let x = corners[corner] + (corners[corner + 1] - corners[corner]) * way;
                    detector.update(0.001, x).is_some()
                })
                .count()
        };
        for (bump, steps) in [(0.0, 20), (0.28, 20), (0.33, 40)] {
            assert_eq!(count(bump), steps, "{bump}");
        }
    }

    #[test]
    fn trembling_faster_than_anyone_steps_is_not_walking() {
        assert!(swings(rest(1.0).chain(sine(12.0, 6.0, 10.0))).len() <= 2);
    }

    #[test]
    fn a_blow_is_at_most_one_swing() {
        let blow = |i: u32| match i {
            200..203 => 60.0,
            203..206 => -30.0,
            _ => 9.81,
        };
        assert!(swings((0..1000).map(blow)).len() <= 1);
    }

    #[test]
    fn what_is_no_reading_changes_nothing() {
        let mut detector = StepDetector::new(StepDetectorSettings::default()).unwrap();
        detector.update(0.01, 9.81);
        let before = detector;
        for (dt, norm) in [
            (0.0, 9.0),
            (-0.1, 9.0),
            (f32::NAN, 9.0),
            (f32::INFINITY, 9.0),
            (0.01, -1.0),
            (0.01, f32::NAN),
            (0.01, f32::INFINITY),
        ] {
            assert_eq!(detector.update(dt, norm), None);
            assert_eq!(detector, before);
        }
    }

    #[test]
    fn settings_out_of_range() {
        let refuse = |change: fn(&mut StepDetectorSettings<f32>), name| {
            let mut settings = StepDetectorSettings::default();
            change(&mut settings);
            assert_eq!(
                StepDetector::new(settings).unwrap_err(),
                InvalidSetting { name }
            );
        };
        refuse(|s| s.cutoff = 0.0, "cutoff");
        refuse(|s| s.smallest_swing = f32::NAN, "smallest_swing");
        refuse(|s| s.shortest_interval = 0.0, "shortest_interval");
        refuse(|s| s.longest_interval = 0.1, "longest_interval");
        refuse(|s| s.longest_interval = f32::INFINITY, "longest_interval");
    }
}
