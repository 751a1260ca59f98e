//! Reasons why there are no steps.

use core::{fmt, num::NonZeroU8};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// A chip of the step sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Chip {
    /// The LSM6DSOX: accelerometer and gyroscope.
    Motion,
    /// The LIS3MDL: compass.
    Compass,
}

impl Chip {
    /// This chip has this fault.
    pub const fn is(self, fault: SensorFault) -> SensorError {
        let code = fault as u8 | (self as u8 * COMPASS);
        SensorError(match NonZeroU8::new(code) {
            Some(code) => code,
            // No fault is numbered so.
            None => NonZeroU8::MIN,
        })
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

/// Fault of a chip of the step sensor. Its number travels: new ones are only added, at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SensorFault {
    /// No chip answers at its address.
    Absent = 1,
    /// The bus failed.
    Bus,
    /// Another chip is at its address.
    Identity,
    /// It has measured nothing for half a second: it was reset, or lost its supply.
    Silent,
    /// It gives the same numbers again and again.
    Stuck,
    /// Its data makes no sense.
    Garbled,
    /// It does not measure gravity, or the field of the earth, in any known scale.
    Scale,
    /// Its settings change, or do not hold.
    Changed,
    /// It has measured more than was taken from it: steps may be lost.
    Overrun,
}

impl SensorFault {
    /// All of them, in the order of their numbers.
    const ALL: [Self; 9] = [
        Self::Absent,
        Self::Bus,
        Self::Identity,
        Self::Silent,
        Self::Stuck,
        Self::Garbled,
        Self::Scale,
        Self::Changed,
        Self::Overrun,
    ];
}

/// The bit of a compass's faults. Those below have the number of the fault.
const COMPASS: u8 = 0x10;

/// Reason why there are no steps: a chip, and its fault. The texts say what to do about it.
///
/// It is a byte, in a message as well: so a node needs little code for it.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct SensorError(NonZeroU8);

impl SensorError {
    /// The chip that is to blame.
    pub const fn chip(self) -> Chip {
        match self.0.get() & COMPASS {
            0 => Chip::Motion,
            _ => Chip::Compass,
        }
    }

    /// Its fault.
    pub fn fault(self) -> SensorFault {
        let number = self.0.get() & !COMPASS;
        let fault = { SensorFault::ALL.iter() }.find(|fault| **fault as u8 == number);
        debug_assert!(fault.is_some(), "checked where it was decoded");
        fault.copied().unwrap_or(SensorFault::Bus)
    }
}

/// The same for people.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename = "SensorError")]
struct Named {
    chip: Chip,
    fault: SensorFault,
}

impl From<SensorError> for Named {
    fn from(error: SensorError) -> Self {
        Self {
            chip: error.chip(),
            fault: error.fault(),
        }
    }
}

impl Serialize for SensorError {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match serializer.is_human_readable() {
            true => Named::from(*self).serialize(serializer),
            false => serializer.serialize_u8(self.0.get()),
        }
    }
}

impl<'de> Deserialize<'de> for SensorError {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        if deserializer.is_human_readable() {
            let Named { chip, fault } = Named::deserialize(deserializer)?;
            return Ok(chip.is(fault));
        }
        let code = u8::deserialize(deserializer)?;
        let is_known = (1..=SensorFault::ALL.len()).contains(&usize::from(code & !COMPASS));
        let code = NonZeroU8::new(code).filter(|_| is_known);
        code.map(Self)
            .ok_or_else(|| de::Error::custom("no fault of a step sensor"))
    }
}

impl fmt::Debug for SensorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Named::from(*self).fmt(f)
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for SensorError {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{}: {}", self.chip(), self.fault());
    }
}

impl fmt::Display for SensorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the step sensor's {} ", self.chip())?;
        f.write_str(match self.fault() {
            SensorFault::Absent => {
                "does not answer: check its supply, its wiring and its address pins"
            }
            SensorFault::Bus => "cannot be reached: check the wires of the bus, and their pull-ups",
            SensorFault::Identity => "is another chip: replace the breakout",
            SensorFault::Silent => "has stopped: check its supply",
            SensorFault::Stuck => "is stuck: switch it off and on",
            SensorFault::Garbled => "cannot be understood: shorten the wires of the bus",
            SensorFault::Scale => "measures in a wrong scale: replace the breakout",
            SensorFault::Changed => {
                "loses its settings: check its supply, and shorten the wires of the bus"
            }
            SensorFault::Overrun => "was not read for too long: steps are lost",
        })
    }
}

impl core::error::Error for SensorError {}
