//! Length of a step.

use core::fmt;

use calib_core::{Real, lit};

use crate::{InvalidSetting, settings::require};

/// Step length from the swing of the vertical acceleration: `K (a_max - a_min)^(1/4)`.
///
/// H. Weinberg, "Using the ADXL202 in pedometer and personal navigation applications", Analog
/// Devices AN-602, 2002. The hip rises and falls more in a longer step, and so does its
/// acceleration; the fourth root makes the result forgiving of errors in the swing. The swing is
/// the one after the [detector](crate::StepDetector)'s low-pass, which takes more from quick steps
/// than from slow ones: over 1.5 to 2.2 steps a second that alone is 5 % of the length. Calibrate
/// at the pace that will be walked.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StepLength<T> {
    /// `K`, above zero: a property of the person and of where the sensor is worn. Its unit is the
    /// world's unit of length over (m/s^2)^(1/4), so it also takes metres to the world's unit.
    /// Default 0.45 (metres): 0.67 m for a swing of 5 m/s^2, an adult's usual step.
    pub k: T,
    /// Standard deviation of a single step's length relative to it, zero or above. Default 0.1:
    /// no two steps are alike. The error of `k` itself is the track's, see
    /// [`Systematic::scale_sigma`](calib_core::dead_reckoning::Systematic::scale_sigma).
    pub relative_sigma: T,
}

impl<T: Real> Default for StepLength<T> {
    fn default() -> Self {
        Self {
            k: lit(0.45),
            relative_sigma: lit(0.1),
        }
    }
}

/// Reason why a calibration walk says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum StepLengthError {
    /// A distance is not a finite number above zero.
    Distance,
    /// The distances differ by more than a factor of four: not an error of step length, but of
    /// counting or of the unit.
    Implausible,
}

impl fmt::Display for StepLengthError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Distance => "both distances of a calibration walk must be finite and above zero",
            Self::Implausible => {
                "the two distances differ by more than a factor of four: check unit and step count"
            }
        })
    }
}

impl core::error::Error for StepLengthError {}

impl<T: Real> StepLength<T> {
    pub(crate) fn check(&self) -> Result<(), InvalidSetting> {
        require(&[
            (self.k > T::zero() && self.k.is_finite(), "k"),
            (
                self.relative_sigma >= T::zero() && self.relative_sigma.is_finite(),
                "relative_sigma",
            ),
        ])
    }

    /// Length of a step. `swing` in m/s^2; below zero counts as zero.
    pub fn length(&self, swing: T) -> T {
        self.k * swing.max(T::zero()).sqrt().sqrt()
    }

    /// Standard deviation of a step of that length.
    pub fn sigma(&self, length: T) -> T {
        length * self.relative_sigma
    }

    /// The model for a person who walked a known distance: straight on, 20 steps or more, at the
    /// usual pace. `reported` is the sum of the steps' lengths by the present model, to which `K`
    /// is proportional; so the one division is the whole calibration.
    ///
    /// A scale error of about `relative_sigma / sqrt(n)` remains after `n` steps, next to that of the known
    /// distance and to the way the person's gait changes from day to day.
    ///
    /// # Errors
    /// A distance that is not a finite number above zero; two that differ by more than four times.
    pub fn calibrated(self, reported: T, known: T) -> Result<Self, StepLengthError> {
        let usable = |x: T| x.is_finite() && x > T::zero();
        if !(usable(reported) && usable(known)) {
            return Err(StepLengthError::Distance);
        }
        let ratio = known / reported;
        let four = lit::<T>(4.0);
        if !(ratio < four && ratio * four > T::one()) {
            return Err(StepLengthError::Implausible);
        }
        Ok(Self {
            k: self.k * ratio,
            ..self
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_times_the_swing_is_twice_the_step() {
        let model = StepLength::<f64>::default();
        let one = model.length(1.0);
        let sigma = model.sigma(one);
        assert_eq!((one, sigma), (0.45, 0.45 * 0.1));
        assert!((model.length(16.0) - 0.9).abs() < 1e-15);
        assert_eq!(model.length(-1.0), 0.0);
    }

    #[test]
    fn calibration_makes_the_walk_as_long_as_it_was() {
        let swings = [3.0, 4.5, 5.1, 4.9, 5.3_f64];
        let walk = |m: StepLength<f64>| swings.iter().map(|&s| m.length(s)).sum::<f64>();
        let before = StepLength::default();
        let after = before.calibrated(walk(before), 4.0).unwrap();
        assert!((walk(after) - 4.0).abs() < 1e-12);
    }

    #[test]
    fn calibration_refuses_nonsense() {
        let model = StepLength::<f32>::default();
        for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(model.calibrated(bad, 1.0), Err(StepLengthError::Distance));
            assert_eq!(model.calibrated(1.0, bad), Err(StepLengthError::Distance));
        }
        let implausible = Err(StepLengthError::Implausible);
        assert_eq!(model.calibrated(10.0, 1000.0), implausible);
        assert_eq!(model.calibrated(1000.0, 10.0), implausible);
        assert!(model.calibrated(10.0, 39.0).is_ok());
    }
}
