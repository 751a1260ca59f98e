//! The scalar that everything is generic over.

use nalgebra::{ComplexField, RealField};

/// A real number: `f32` on a node, `f64` on a computer.
pub trait Real: RealField + Copy {
    /// Sine and cosine of an angle in radians; not a number for an infinite one.
    fn sine_cosine(self) -> (Self, Self);

    /// A whole number, or the nearest there is.
    fn whole(number: u32) -> Self;
}

impl Real for f32 {
    /// In single precision throughout: libraries compute these in double precision, which a
    /// Cortex-M4F has to emulate. Off by no more than 1e-7, from
    /// 10,000 on by the worth of the angle's last digit.
    #[inline(never)] // for less flash
    fn sine_cosine(self) -> (Self, Self) {
        // A quarter turn in parts so short that their multiples up to 8192 are exact (reduction
        // after Cody and Waite, Software Manual for the Elementary Functions, 1980).
        const QUARTER: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];
        let angle = if self.abs() < 1e4 {
            self
        } else {
            let turns = self / core::f32::consts::TAU;
            (turns - ComplexField::floor(turns)) * core::f32::consts::TAU
        };
        let scaled = angle * core::f32::consts::FRAC_2_PI;
        let quarters = (scaled + if scaled < 0.0 { -0.5 } else { 0.5 }) as i32;
        let r = QUARTER
            .iter()
            .fold(angle, |rest, part| rest - quarters as Self * part);
        // Minimax polynomials on an eighth of a turn to both sides; found with Remez's exchange.
        let u = r * r;
        let sine = r + r * u * (-0.166_666_51 + u * (0.008_331_952 + u * -0.000_194_922_1));
        let cosine =
            1.0 - u * 0.5 + u * u * (0.041_666_646 + u * (-0.001_388_733_7 + u * 2.443_484_7e-5));
        match quarters & 3 {
            0 => (sine, cosine),
            1 => (cosine, -sine),
            2 => (-sine, -cosine),
            _ => (-cosine, sine),
        }
    }

    fn whole(number: u32) -> Self {
        number as Self
    }
}

impl Real for f64 {
    fn sine_cosine(self) -> (Self, Self) {
        ComplexField::sin_cos(self)
    }

    fn whole(number: u32) -> Self {
        number.into()
    }
}

/// The scalar nearest to a literal. Folds to a constant.
#[inline(always)]
pub fn lit<T: Real>(value: f64) -> T {
    nalgebra::convert(value)
}

/// A variance, or zero if it is below: by rounding, or because a difference of covariances is none. A value
/// that is not a number stays so, where `max` would make it zero.
#[inline(always)]
pub(crate) fn at_least_zero<T: Real>(variance: T) -> T {
    if variance < T::zero() {
        T::zero()
    } else {
        variance
    }
}

/// The standard deviation of a variance. A variance that is not a number has none: zero would be the best of
/// all.
pub(crate) fn root<T: Real>(variance: T) -> T {
    at_least_zero(variance).sqrt()
}

#[cfg(test)]
mod tests {
    use super::Real;

    fn error(angle: f32) -> f64 {
        let (sine, cosine) = angle.sine_cosine();
        let (exact_sine, exact_cosine) = f64::from(angle).sin_cos();
        let errors = [
            f64::from(sine) - exact_sine,
            f64::from(cosine) - exact_cosine,
        ];
        errors.map(f64::abs).into_iter().fold(0.0, f64::max)
    }

    #[test]
    fn sines_of_single_precision_are_those_of_double_precision() {
        // From denormal numbers to a thousand turns: every 97th float of both signs.
        for bits in (0..7000_f32.to_bits()).step_by(97) {
            let angle = f32::from_bits(bits);
            let worst = error(angle).max(error(-angle));
            assert!(worst < 1e-7, "{angle:e} errs by {worst:e}");
        }
    }

    #[test]
    fn small_angles_keep_all_digits() {
        for bits in (1e-30_f32.to_bits()..0.01_f32.to_bits()).step_by(997) {
            let angle = f32::from_bits(bits);
            let ratio = f64::from(angle.sine_cosine().0) / f64::from(angle).sin();
            assert!((ratio - 1.0).abs() < 1e-7, "{angle:e}");
        }
    }

    #[test]
    fn any_angle_has_a_direction_of_length_one() {
        for bits in (7000_f32.to_bits()..f32::INFINITY.to_bits()).step_by(997) {
            let angle = f32::from_bits(bits);
            let (sine, cosine) = angle.sine_cosine();
            assert!((sine.hypot(cosine) - 1.0).abs() < 1e-6, "{angle:e}");
            // Sure to about one unit in the last place of the angle.
            let unit = f64::from(f32::from_bits(bits + 1)) - f64::from(angle);
            assert!(error(angle) < 1e-7 + 1.5 * unit, "{angle:e}");
        }
        let (sine, cosine) = f32::INFINITY.sine_cosine();
        assert!(sine.is_nan() && cosine.is_nan());
    }
}
