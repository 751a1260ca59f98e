//! Goodness of fit: do residuals agree with the sigmas they were predicted with?
//!
//! One test, everywhere: [`Fit::is_bad`]. It asks about all residuals of an answer together. Other
//! limits in this crate and in those that use it ask other questions: the gate of
//! [`solve_rejecting`](crate::resection::solve_rejecting) whether *one* sighting belongs to the
//! others, and that of a compass whether one reading is worth taking.

use crate::{
    Real,
    numerics::real::{lit, root},
};

/// Sigmas that a normal error exceeds once in a thousand, to one side.
pub const RARE: f64 = 3.09;

/// Agreement of measurements with an answer.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fit<T> {
    /// Sum of the squared residuals, each over its variance.
    pub chi_squared: T,
    /// Measurements beyond the unknowns. Chi squared averages as much when the sigmas are right.
    pub degrees_of_freedom: usize,
}

impl<T: Real> Default for Fit<T> {
    /// No measurement, which fits.
    fn default() -> Self {
        Self {
            chi_squared: T::zero(),
            degrees_of_freedom: 0,
        }
    }
}

impl<T: Real> Fit<T> {
    /// Returns true if only one in a thousand fits would be as bad by chance: chi squared is above
    /// [`one_in_a_thousand`], or not a number.
    pub fn is_bad(&self) -> bool {
        !(self.chi_squared <= one_in_a_thousand(self.degrees_of_freedom))
    }

    /// Agreement of both sets of measurements together, as far as they are independent.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            chi_squared: self.chi_squared + other.chi_squared,
            degrees_of_freedom: self.degrees_of_freedom + other.degrees_of_freedom,
        }
    }

    /// Ratio of the residuals to the predicted ones: about 1 if all is well. `None` without a degree of
    /// freedom.
    pub fn ratio(&self) -> Option<T> {
        (self.degrees_of_freedom > 0)
            .then(|| root(self.chi_squared / whole(self.degrees_of_freedom)))
    }

    /// The factor by which covariances are too small, as far as the residuals prove it: 1 unless the
    /// fit [is bad](Fit::is_bad), and then chi squared per degree of freedom.
    pub fn inflation(&self) -> T {
        if self.is_bad() {
            self.chi_squared / whole(self.degrees_of_freedom.max(1))
        } else {
            T::one()
        }
    }
}

/// The chi squared that only one in a thousand exceeds by chance, for this number of degrees of freedom.
/// Without one, measurements always fit, so they must fit well: the limit is that of one degree.
///
/// After Wilson and Hilferty, "The distribution of chi-square", PNAS 17(12), 1931: the cube root of
/// chi squared over its degrees of freedom is nearly normal. A term fitted to exact quantiles makes
/// the 3 % that this is off at one degree 0.1 %, and less for all others.
#[inline(never)] // for less flash
pub fn one_in_a_thousand<T: Real>(degrees_of_freedom: usize) -> T {
    let degrees: T = whole(degrees_of_freedom.max(1));
    // A normal number exceeds the first term once in a thousand.
    let quantile = lit::<T>(3.090_232_3) - (lit::<T>(17.0) + degrees * lit(3.6)).recip();
    let variance = (degrees * lit(4.5)).recip();
    let cube_root = T::one() - variance + quantile * root(variance);
    degrees * cube_root * cube_root * cube_root
}

fn whole<T: Real>(number: usize) -> T {
    T::whole(u32::try_from(number).unwrap_or(u32::MAX))
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    /// From the regularised incomplete gamma function, to the last digit.
    const EXACT: [(usize, f64); 36] = [
        (1, 10.827_566),
        (2, 13.815_511),
        (3, 16.266_236),
        (4, 18.466_827),
        (5, 20.515_006),
        (6, 22.457_744),
        (7, 24.321_886),
        (8, 26.124_482),
        (9, 27.877_165),
        (10, 29.588_298),
        (11, 31.264_134),
        (12, 32.909_49),
        (13, 34.528_179),
        (14, 36.123_274),
        (15, 37.697_298),
        (16, 39.252_355),
        (17, 40.790_217),
        (18, 42.312_396),
        (19, 43.820_196),
        (20, 45.314_747),
        (21, 46.797_038),
        (22, 48.267_942),
        (23, 49.728_232),
        (24, 51.178_598),
        (25, 52.619_656),
        (26, 54.051_962),
        (27, 55.476_02),
        (28, 56.892_285),
        (29, 58.301_173),
        (30, 59.703_064),
        (50, 86.660_815),
        (100, 149.449_25),
        (300, 381.425_25),
        (1_000, 1_143.917_1),
        (10_000, 10_442.731),
        (100_000, 101_387.7),
    ];

    #[test]
    fn the_limit_is_the_exact_quantile_but_for_a_thousandth() {
        for (degrees, exact) in EXACT {
            let double = one_in_a_thousand::<f64>(degrees) / exact - 1.0;
            let single = f64::from(one_in_a_thousand::<f32>(degrees)) / exact - 1.0;
            assert!(double.abs() < 0.001_2, "{degrees}: {double:e}");
            assert!((single - double).abs() < 1e-6, "{degrees}: {single:e}");
        }
    }

    /// For an even number of degrees the share above a limit is a sum: that of a Poisson variable.
    #[test]
    fn one_in_a_thousand_is_above_it() {
        for half in 1..=20 {
            let mean = one_in_a_thousand::<f64>(2 * half) / 2.0;
            let mut term = (-mean).exp();
            let mut share = 0.0;
            for n in 1..=half {
                share += term;
                term *= mean / n as f64;
            }
            assert!((share - 0.001).abs() < 0.000_01, "{half}: {share}");
        }
    }

    #[test]
    fn what_always_fits_must_fit() {
        let bad = |chi_squared, degrees_of_freedom| {
            Fit::<f32> {
                chi_squared,
                degrees_of_freedom,
            }
            .is_bad()
        };
        assert!(!bad(10.8, 0) && bad(10.9, 0));
        assert!(!bad(10.8, 1) && bad(10.9, 1));
        assert!(!bad(16.2, 3) && bad(16.3, 3));
        assert!(bad(f32::NAN, 3) && bad(f32::INFINITY, 3));
        assert!(!Fit::<f64>::default().is_bad());
        // More than are ever counted.
        assert!(!bad(1e9, usize::MAX));
    }

    #[test]
    fn covariances_grow_only_with_a_bad_fit() {
        let fit = |chi_squared: f64, degrees_of_freedom| Fit {
            chi_squared,
            degrees_of_freedom,
        };
        assert_eq!(fit(18.4, 4).inflation(), 1.0);
        assert_eq!(fit(20.0, 4).inflation(), 5.0);
        assert_eq!(fit(20.0, 0).inflation(), 20.0);
        assert_eq!(fit(36.0, 4).ratio(), Some(3.0));
        assert_eq!(fit(36.0, 0).ratio(), None);
        assert_eq!(fit(20.0, 1).and(fit(16.0, 3)), fit(36.0, 4));
    }
}
