//! Reasons why there are no steps.

use core::fmt;

/// A chip of the step sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Chip {
    /// The LSM6DSOX: accelerometer and gyroscope.
    Motion,
    /// The LIS3MDL: compass.
    Compass,
}

impl Chip {
    pub(super) const fn is(self, fault: SensorFault) -> SensorError {
        SensorError { chip: self, fault }
    }
}

impl fmt::Display for Chip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Motion => "LSM6DSOX (accelerometer and gyroscope)",
            Self::Compass => "LIS3MDL (compass)",
        })
    }
}

/// Fault of a chip of the step sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SensorFault {
    /// No chip answers at its address.
    Absent,
    /// The bus failed.
    Bus,
    /// Another chip is at its address.
    Identity {
        /// The identity that it answers.
        found: u8,
    },
    /// It has measured nothing for half a second: it was reset, or lost its supply.
    Silent,
    /// It gives the same numbers again and again.
    Stuck,
    /// Its data makes no sense.
    Garbled,
    /// Its acceleration at rest is not gravity in any known scale.
    Scale,
    /// Its settings change, or do not hold.
    Changed,
    /// It has measured more than was taken from it: steps may be lost.
    Overrun,
}

/// Reason why there are no steps. The texts say what to do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SensorError {
    /// The chip that is to blame.
    pub chip: Chip,
    /// Its fault.
    pub fault: SensorFault,
}

impl fmt::Display for SensorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the step sensor's {} ", self.chip)?;
        f.write_str(match self.fault {
            SensorFault::Absent => {
                "does not answer: check its supply, its wiring and its address pins"
            }
            SensorFault::Bus => "cannot be reached: check the wires of the bus, and their pull-ups",
            SensorFault::Identity { found } => {
                return write!(
                    f,
                    "is another chip (identity {found:#04x}): replace the breakout"
                );
            }
            SensorFault::Silent => "has stopped: check its supply",
            SensorFault::Stuck => "is stuck: switch it off and on",
            SensorFault::Garbled => "cannot be understood: shorten the wires of the bus",
            SensorFault::Scale => "does not measure gravity: replace the breakout",
            SensorFault::Changed => {
                "loses its settings: check its supply, and shorten the wires of the bus"
            }
            SensorFault::Overrun => "was not read for too long: steps are lost",
        })
    }
}

impl core::error::Error for SensorError {}
