//! Measurements of the worn sensors at one moment.

use core::fmt;

use nalgebra::Vector3;

use calib_core::{Real, lit};

/// One reading of the sensors, all in one body frame: x forward (the way the person walks), y
/// left, z up, right-handed. The sensor may lean from that by some ten degrees; the filters find
/// the vertical themselves.
///
/// The magnetometer is expected to be calibrated for hard and soft iron.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ImuSample<T: Real> {
    /// Specific force, m/s^2: an accelerometer at rest reads +9.8 on z. Each part below 1e4.
    pub acceleration: Vector3<T>,
    /// Angular rate, rad/s, right-handed about each axis. Each part below 1e4.
    pub angular_rate: Vector3<T>,
    /// Magnetic field in any one unit, each part below 1e9; `None` when there is no new reading.
    /// Magnetometers are often slower than the other two.
    pub magnetic_field: Option<Vector3<T>>,
}

impl<T: Real> ImuSample<T> {
    /// Returns true if every number is finite and one that a sensor can have measured.
    pub fn is_usable(&self) -> bool {
        // A comparison with NaN is false.
        let within = |v: &Vector3<T>, limit: T| v.iter().all(|x| x.abs() < limit);
        within(&self.acceleration, lit(1e4))
            && within(&self.angular_rate, lit(1e4))
            && self
                .magnetic_field
                .is_none_or(|field| within(&field, lit(1e9)))
    }
}

#[cfg(feature = "defmt")]
impl<T: Real + defmt::Format> defmt::Format for ImuSample<T> {
    fn format(&self, f: defmt::Formatter<'_>) {
        let (a, w) = (&self.acceleration, &self.angular_rate);
        defmt::write!(
            f,
            "acceleration ({}, {}, {}) rate ({}, {}, {})",
            a.x,
            a.y,
            a.z,
            w.x,
            w.y,
            w.z
        );
        if let Some(m) = &self.magnetic_field {
            defmt::write!(f, " field ({}, {}, {})", m.x, m.y, m.z);
        }
    }
}

/// Reason why a reading was not used. Nothing has changed by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ImuError {
    /// A number is not finite or larger than any sensor measures.
    NotUsable,
    /// The time is not after that of the reading before.
    TimeNotAfter,
}

impl fmt::Display for ImuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotUsable => "a sensor reading is not finite or larger than any sensor measures",
            Self::TimeNotAfter => "a sensor reading is not later than the one before",
        })
    }
}

impl core::error::Error for ImuError {}
