//! Direction in which the body faces.

use calib_core::{
    Real,
    angle::{wrap_positive, wrap_signed},
    lit,
};
use nalgebra::Vector3;

use crate::{ImuSample, InvalidSetting, settings::require};

/// Settings of a [`HeadingFilter`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct HeadingSettings<T> {
    /// The direction of magnetic north in the world, radians counter-clockwise from its x axis;
    /// any finite angle. Default `pi/2`: x points to magnetic east. See [`magnetic_north`].
    pub magnetic_north: T,
    /// Below this time the gyroscope is believed, above it the compass; seconds, 0.5 to 300.
    /// Default 10: long enough for magnetic disturbances in passing to average out, short enough
    /// for a gyroscope's bias to be followed.
    pub time_constant: T,
    /// Standard deviation of the compass heading of a walking person, without its constant part;
    /// radians, above zero, below 1. Default 0.087 (5 degrees).
    pub compass_sigma: T,
    /// Duration of such errors, seconds, 0.01 to 10. Default 0.5: a step.
    pub compass_correlation: T,
    /// Random walk of the integrated gyroscope, rad/sqrt(s), zero or above, below 1. Default
    /// 0.002: ten times the noise of a MEMS gyroscope, which leaves room for the errors of its
    /// scale and of the vertical in turns.
    pub gyro_noise: T,
    /// Standard deviation of the gyroscope's bias before anything is known of it, rad/s, above
    /// zero, below 1. Default 0.05 (3 degrees a second).
    pub gyro_bias_sigma: T,
    /// Time constant with which the vertical follows the accelerometer, seconds, 0.1 to 60. Default 2: a few
    /// steps, so that their accelerations average out.
    pub tilt_time_constant: T,
    /// Relative difference of the strength of the field from the usual from which on the compass counts as
    /// disturbed; above zero, at most 1. Default 0.15: noise and errors left by calibration stay within a few per
    /// cent, steel and currents do not.
    pub field_tolerance: T,
}

impl<T: Real> Default for HeadingSettings<T> {
    fn default() -> Self {
        Self {
            magnetic_north: T::frac_pi_2(),
            time_constant: lit(10.0),
            compass_sigma: lit(0.087),
            compass_correlation: lit(0.5),
            gyro_noise: lit(0.002),
            gyro_bias_sigma: lit(0.05),
            tilt_time_constant: lit(2.0),
            field_tolerance: lit(0.15),
        }
    }
}

/// The direction of magnetic north in the world, for [`HeadingSettings::magnetic_north`].
///
/// `true_north` is counter-clockwise from the world's x axis (`pi/2` if x points east);
/// `declination` is what maps print, positive when magnetic north is *east* of true north, that
/// is clockwise of it. Both radians; the result in `[0, 2 pi)`.
pub fn magnetic_north<T: Real>(true_north: T, declination: T) -> T {
    wrap_positive(true_north - declination)
}

/// Joins gyroscope and compass into a heading with an honest sigma.
///
/// **Vertical**: the mean specific force of a walking person points up, so it is low-passed. It is
/// not turned along with the gyroscope: a bias across the vertical, which nothing here observes,
/// would tilt it by bias times time constant, and the compass by twice that where the field is
/// steep; and a person's trunk leans slowly.
///
/// **Compass**: the field's part across the vertical, seen along and across the forward axis. This
/// is tilt compensation (Caruso, "Applications of magnetic sensors for low cost compass systems",
/// Honeywell; Ozyagcilar, Freescale AN4248) with vectors in place of roll and pitch. A compass
/// azimuth runs *clockwise from north*, our headings counter-clockwise from x:
/// `heading = magnetic north - azimuth`.
///
/// **Gyroscope**: the heading's rate is `(w_y u_y + w_z u_z) / (u_y^2 + u_z^2)` for rates `w` and
/// the vertical `u` in the body frame (the yaw equation of Euler angles).
///
/// **Both**: heading and gyroscope bias are a Kalman filter of two states, whose steady state is
/// a complementary filter (Higgins, "A comparison of complementary and Kalman filtering", IEEE
/// Trans. AES 11(3), 1975): with compass noise of density `r` and bias noise of density
/// `q = r / time_constant^4` its loop has the natural frequency `1 / time_constant` and a damping
/// of `1 / sqrt(2)`. The variable gains serve the beginning, when heading and bias are unknown,
/// and the end of a disturbance.
///
/// **Disturbed compass**: readings whose strength is not the usual, or that contradict the
/// filter by more than three sigma, are left out, and the sigma grows (field strength and rate of
/// change against the gyroscope: Ladetto and Merminod, "Digital magnetic compass and gyroscope
/// integration for pedestrian navigation", 2002). A field that stays different for 30 s becomes
/// the usual one.
///
/// A disturbance that is already there at the first reading cannot be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingFilter<T: Real> {
    settings: HeadingSettings<T>,
    /// Low-passed specific force, body frame.
    up: Option<Vector3<T>>,
    up_age: T,
    heading: T,
    bias: T,
    /// Covariance of (heading, bias): `p11`, `p12`, `p22`.
    p11: T,
    p12: T,
    p22: T,
    /// True once `heading` is known.
    known: bool,
    usual_field: Option<T>,
    since_compass: T,
    disturbed_for: T,
}

/// Variance of an angle of which nothing is known, that is uniform over a turn: `pi^2 / 3`.
fn unknown<T: Real>() -> T {
    T::pi() * T::pi() / lit(3.0)
}

impl<T: Real> HeadingFilter<T> {
    /// A filter that knows nothing yet.
    ///
    /// # Errors
    /// A setting out of its range.
    pub fn new(settings: HeadingSettings<T>) -> Result<Self, InvalidSetting> {
        let s = &settings;
        let within = |x: T, low: T, high: T| x >= low && x <= high;
        let fraction = |x: T| x > T::zero() && x < T::one();
        require(&[
            (s.magnetic_north.is_finite(), "magnetic_north"),
            (
                within(s.time_constant, lit(0.5), lit(300.0)),
                "time_constant",
            ),
            (fraction(s.compass_sigma), "compass_sigma"),
            (
                within(s.compass_correlation, lit(0.01), lit(10.0)),
                "compass_correlation",
            ),
            (
                s.gyro_noise >= T::zero() && s.gyro_noise < T::one(),
                "gyro_noise",
            ),
            (fraction(s.gyro_bias_sigma), "gyro_bias_sigma"),
            (
                within(s.tilt_time_constant, lit(0.1), lit(60.0)),
                "tilt_time_constant",
            ),
            (
                s.field_tolerance > T::zero() && s.field_tolerance <= T::one(),
                "field_tolerance",
            ),
        ])?;
        Ok(Self {
            settings,
            up: None,
            up_age: T::zero(),
            heading: T::zero(),
            bias: T::zero(),
            p11: unknown(),
            p12: T::zero(),
            p22: settings.gyro_bias_sigma * settings.gyro_bias_sigma,
            known: false,
            usual_field: None,
            since_compass: T::zero(),
            disturbed_for: T::zero(),
        })
    }

    /// The direction of the forward axis, radians in `[0, 2 pi)` counter-clockwise from the
    /// world's x axis. Zero, with the sigma to match, while nothing is known.
    pub fn heading(&self) -> T {
        self.heading
    }

    /// Standard deviation of [`HeadingFilter::heading`], radians, at most `pi / sqrt(3)`: that of
    /// a direction of which nothing is known. Without the constant error of the compass.
    pub fn sigma(&self) -> T {
        self.p11.sqrt()
    }

    /// Reading of the gyroscope about the vertical when the heading does not change, rad/s.
    pub fn gyro_bias(&self) -> T {
        self.bias
    }

    /// Returns true if the last compass reading was left out as disturbed.
    pub fn is_disturbed(&self) -> bool {
        self.disturbed_for > T::zero()
    }

    /// The heading is known from elsewhere: `heading` in radians, any finite value, to within
    /// `sigma`, zero or above. Other values change nothing.
    pub fn align(&mut self, heading: T, sigma: T) {
        if heading.is_finite() && sigma >= T::zero() {
            self.heading = wrap_positive(heading);
            self.p11 = (sigma * sigma).min(unknown());
            self.p12 = T::zero();
            self.known = true;
        }
    }

    /// After a gap in the samples: the heading is unknown, the gyroscope's bias is not.
    pub fn restart(&mut self) {
        self.up = None;
        self.forget_heading();
    }

    fn forget_heading(&mut self) {
        self.p11 = unknown();
        self.p12 = T::zero();
        self.known = false;
    }

    /// Takes a sample `dt` seconds after the one before, above zero and at most 1. Another `dt`,
    /// or a sample that is not usable, changes nothing.
    pub fn update(&mut self, dt: T, sample: &ImuSample<T>) {
        if !(dt > T::zero() && dt <= T::one() && sample.is_usable()) {
            return;
        }
        let up = self.follow_vertical(dt, sample);
        let level2 = up.y * up.y + up.z * up.z;
        // Also false for a vertical of length zero, in free fall.
        if level2 < lit(0.25) {
            // Forward is steeper than 60 degrees: it has no heading to speak of.
            self.forget_heading();
            return;
        }
        let rate =
            (sample.angular_rate.y * up.y + sample.angular_rate.z * up.z) / level2 - self.bias;
        self.turn(dt, rate);
        self.since_compass += dt;
        if let Some(field) = sample.magnetic_field {
            let since = self.since_compass;
            self.since_compass = T::zero();
            self.follow_compass(since, &field, &up);
        }
        // The next compass reading is independent of this one long before.
        self.since_compass = self.since_compass.min(lit(20.0));
    }

    /// The unit vector that points up, in the body frame; zero in free fall.
    fn follow_vertical(&mut self, dt: T, sample: &ImuSample<T>) -> Vector3<T> {
        let limit = self.settings.tilt_time_constant;
        self.up_age = match self.up {
            Some(_) => (self.up_age + dt).min(limit),
            None => dt,
        };
        let up = match self.up {
            Some(up) => {
                // A plain mean at first, an exponential one once there is enough.
                let gain = dt / self.up_age.max(dt);
                up + (sample.acceleration - up) * gain
            }
            None => sample.acceleration,
        };
        self.up = Some(up);
        let norm = up.norm();
        if norm > lit(1e-3) {
            up / norm
        } else {
            Vector3::zeros()
        }
    }

    /// The prediction of the Kalman filter: the heading follows the gyroscope, variances grow.
    fn turn(&mut self, dt: T, rate: T) {
        self.heading = wrap_positive(self.heading + rate * dt);
        let s = &self.settings;
        let tau2 = s.time_constant * s.time_constant;
        let prior = s.gyro_bias_sigma * s.gyro_bias_sigma;
        // Fades towards the prior: a bias never becomes less known than at the beginning.
        let drift = compass_density(s) / (tau2 * tau2) * (T::one() - self.p22 / prior);
        self.p11 += (self.p22 * dt - self.p12 - self.p12 + s.gyro_noise * s.gyro_noise) * dt;
        self.p12 -= self.p22 * dt;
        self.p22 += drift.max(T::zero()) * dt;
        if !self.known || self.p11 >= unknown() {
            self.forget_heading();
        }
    }

    /// Its correction, `since` seconds after the compass reading before.
    fn follow_compass(&mut self, since: T, field: &Vector3<T>, up: &Vector3<T>) {
        let strength = field.norm();
        let vertical = field.dot(up);
        let north = field.x - vertical * up.x;
        let west = field.y * up.z - field.z * up.y;
        let horizontal = (strength * strength - vertical * vertical)
            .max(T::zero())
            .sqrt();
        // The magnetic poles, or no field at all.
        if horizontal <= strength * lit(0.05) {
            return;
        }
        // North seen from forward, counter-clockwise, is forward seen from north, clockwise.
        let azimuth = west.atan2(north);
        let compass = self.settings.magnetic_north - azimuth;

        if !self.known {
            self.align(compass, T::one());
        }
        let usual = *self.usual_field.get_or_insert(strength);
        let s = &self.settings;
        let variance = s.compass_sigma * s.compass_sigma;
        let innovation = wrap_signed(compass - self.heading);
        let strange = (strength - usual).abs() > usual * s.field_tolerance;
        let contradicts = innovation * innovation > lit::<T>(9.0) * (self.p11 + variance);
        if strange || contradicts {
            self.disturbed_for += since;
            if strange && self.disturbed_for > lit(30.0) {
                self.usual_field = Some(strength);
                self.disturbed_for = T::zero();
            }
            return;
        }
        self.disturbed_for = T::zero();
        self.usual_field = Some(usual + (strength - usual) * (since / lit(60.0)).min(T::one()));

        // Readings closer together than their errors last share these.
        let noise = variance.max(compass_density(s) / since);
        let gain = T::one() / (self.p11 + noise);
        let (k1, k2) = (self.p11 * gain, self.p12 * gain);
        self.heading = wrap_positive(self.heading + k1 * innovation);
        self.bias += k2 * innovation;
        // Rounding must not take a variance below zero.
        self.p22 = (self.p22 - k2 * self.p12).max(T::zero());
        self.p12 -= k1 * self.p12;
        self.p11 -= k1 * self.p11;
    }
}

/// Spectral density of the compass's error, rad^2 s: an error of variance `s^2` that is forgotten
/// exponentially with time `t` moves a long mean as much as white noise of density `2 s^2 t`.
fn compass_density<T: Real>(s: &HeadingSettings<T>) -> T {
    s.compass_sigma * s.compass_sigma * (s.compass_correlation + s.compass_correlation)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;

    fn level(azimuth: f64) -> ImuSample<f64> {
        ImuSample {
            acceleration: Vector3::new(0.0, 0.0, 9.81),
            angular_rate: Vector3::zeros(),
            magnetic_field: Some(Vector3::new(
                20.0 * azimuth.cos(),
                20.0 * azimuth.sin(),
                -43.0,
            )),
        }
    }

    /// The error of a loop of natural frequency `w` and damping `1/sqrt(2)` after a step of its
    /// input is `exp(-a t) (cos a t - sin a t)` with `a = w / sqrt(2)`, from control theory.
    #[test]
    fn settled_it_is_a_complementary_filter_of_its_time_constant() {
        for tau in [5.0, 10.0, 20.0] {
            let mut filter = HeadingFilter::new(HeadingSettings {
                time_constant: tau,
                gyro_noise: 0.0,
                ..HeadingSettings::default()
            })
            .unwrap();
            let dt = 0.02;
            for _ in 0..(30.0 * tau / dt) as u32 {
                filter.update(dt, &level(1.0));
            }
            let before = filter.heading();
            for i in 1..=(4.0 * tau / dt) as u32 {
                filter.update(dt, &level(0.9));
                let at = f64::from(i) * dt / tau / 2_f64.sqrt();
                let expected = 0.1 * (-at).exp() * (at.cos() - at.sin());
                let left = before + 0.1 - filter.heading();
                assert!(
                    (left - expected).abs() < 0.002,
                    "{tau} {i}: {left} {expected}"
                );
            }
        }
    }

    #[test]
    fn the_gyroscope_bias_is_found() {
        let mut filter = HeadingFilter::new(HeadingSettings::default()).unwrap();
        let mut sample = level(1.0);
        sample.angular_rate.z = 0.04;
        for _ in 0..10_000 {
            filter.update(0.01, &sample);
        }
        assert!((filter.gyro_bias() - 0.04).abs() < 1e-4);
        assert!((filter.heading() - (core::f64::consts::FRAC_PI_2 - 1.0)).abs() < 1e-3);
    }

    /// The same attitude, turned about the vertical: any lean gives the same heading.
    #[test]
    fn lean_does_not_turn_the_compass() {
        use nalgebra::Rotation3;
        for (roll, pitch) in [(0.0, 0.0), (0.6, 0.0), (0.0, -0.8), (-0.5, 0.7), (3.1, 0.2)] {
            for yaw in [0.3_f64, 2.0, 4.0] {
                let body = Rotation3::from_euler_angles(roll, pitch, yaw).inverse();
                let rate = 0.5_f64;
                let sample = ImuSample {
                    acceleration: body * Vector3::new(0.0, 0.0, 9.81),
                    angular_rate: body * Vector3::new(0.0, 0.0, rate),
                    magnetic_field: Some(body * Vector3::new(0.0, 20.0, -43.0)),
                };
                let mut filter = HeadingFilter::new(HeadingSettings::default()).unwrap();
                filter.update(0.01, &sample);
                assert!(wrap_signed(filter.heading() - yaw).abs() < 1e-9);
                // And the gyroscope turns it by the rate about the vertical.
                let blind = ImuSample {
                    magnetic_field: None,
                    ..sample
                };
                filter.update(0.1, &blind);
                let turned = wrap_signed(filter.heading() - yaw);
                assert!((turned - 0.1 * rate).abs() < 1e-9, "{turned}");
            }
        }
    }

    #[test]
    fn straight_up_has_no_heading() {
        let mut filter = HeadingFilter::new(HeadingSettings::default()).unwrap();
        for _ in 0..1000 {
            filter.update(0.01, &level(1.0));
        }
        assert!(filter.sigma() < 0.1);
        let lying = ImuSample {
            acceleration: Vector3::new(9.81, 0.0, 0.0),
            ..level(1.0)
        };
        for _ in 0..1000 {
            filter.update(0.01, &lying);
        }
        assert!(filter.sigma() > 1.8);
    }

    #[test]
    fn hours_of_rest_in_f32_leave_it_well() {
        let mut filter = HeadingFilter::<f32>::new(HeadingSettings::default()).unwrap();
        let sample = ImuSample {
            acceleration: Vector3::new(0.0, 0.0, 9.81),
            angular_rate: Vector3::new(0.0, 0.0, 0.01),
            magnetic_field: Some(Vector3::new(0.0, -20.0, -43.0)),
        };
        for _ in 0..400_000 {
            filter.update(0.02, &sample);
        }
        let pi = core::f32::consts::PI;
        assert!(wrap_signed(filter.heading() - pi).abs() < 1e-3);
        assert!((filter.gyro_bias() - 0.01).abs() < 1e-4);
        // r sqrt(2) / tau, and a little gyroscope noise.
        let r = 2.0 * 0.087_f32.powi(2) * 0.5;
        let expected = (r * 2_f32.sqrt() / 10.0).sqrt();
        assert!((filter.sigma() / expected - 1.0).abs() < 0.05);
    }

    #[test]
    fn settings_out_of_range() {
        let refuse = |change: fn(&mut HeadingSettings<f32>), name| {
            let mut settings = HeadingSettings::default();
            change(&mut settings);
            assert_eq!(
                HeadingFilter::new(settings).unwrap_err(),
                InvalidSetting { name }
            );
        };
        refuse(|s| s.magnetic_north = f32::NAN, "magnetic_north");
        refuse(|s| s.time_constant = 0.0, "time_constant");
        refuse(|s| s.compass_sigma = 0.0, "compass_sigma");
        refuse(|s| s.compass_correlation = 100.0, "compass_correlation");
        refuse(|s| s.gyro_noise = -1.0, "gyro_noise");
        refuse(|s| s.gyro_bias_sigma = 0.0, "gyro_bias_sigma");
        refuse(
            |s| s.tilt_time_constant = f32::INFINITY,
            "tilt_time_constant",
        );
        refuse(|s| s.field_tolerance = 2.0, "field_tolerance");
    }
}
