//! The five servo outputs.

use crate::argument::ArgumentError;

/// Number of servo outputs.
pub const SERVOS: u8 = 5;

/// A servo output, 0 to 4. Pan is 0, tilt is 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Servo(u8);

impl Servo {
    /// The servo that turns the camera sideways.
    pub const PAN: Self = Self(0);
    /// The servo that turns the camera up and down.
    pub const TILT: Self = Self(1);

    /// # Errors
    /// The number is above 4.
    pub const fn new(number: u8) -> Result<Self, ArgumentError> {
        if number >= SERVOS {
            return Err(ArgumentError::Servo);
        }
        Ok(Self(number))
    }

    /// 0 to 4.
    pub const fn number(self) -> u8 {
        self.0
    }
}

/// A servo position, 46 to 210.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ServoPosition(u8);

impl ServoPosition {
    /// The middle of the range of travel.
    pub const CENTRE: Self = Self(128);

    /// # Errors
    /// The position is not in `46..=210`.
    pub const fn new(position: u8) -> Result<Self, ArgumentError> {
        if position < 46 || position > 210 {
            return Err(ArgumentError::ServoPosition);
        }
        Ok(Self(position))
    }

    /// 46 to 210.
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// Control and reports of pan and tilt by the camera while it tracks (`SM`).
///
/// The bits are those of CMU's CMUcam2-compatible program for the CMUcam3: 1 and 2 control,
/// 4 and 8 report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ServoMask(u8);

impl ServoMask {
    /// Neither control nor reports.
    pub const NONE: Self = Self(0);

    /// # Errors
    /// A bit above the fourth.
    pub const fn new(bits: u8) -> Result<Self, ArgumentError> {
        if bits > 15 {
            return Err(ArgumentError::Mask);
        }
        Ok(Self(bits))
    }

    /// From the four switches.
    pub const fn from_switches(
        control_pan: bool,
        control_tilt: bool,
        report_pan: bool,
        report_tilt: bool,
    ) -> Self {
        Self(
            control_pan as u8
                | (control_tilt as u8) << 1
                | (report_pan as u8) << 2
                | (report_tilt as u8) << 3,
        )
    }

    /// The number as `SM` takes it.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Returns true if colour-tracking packets end with the pan position.
    pub const fn reports_pan(self) -> bool {
        self.0 & 4 != 0
    }

    /// Returns true if colour-tracking packets end with the tilt position.
    pub const fn reports_tilt(self) -> bool {
        self.0 & 8 != 0
    }
}

/// Movement of the camera after the target along one axis: beyond `far` pixels from the middle it moves by
/// `step`, beyond `near` by half of that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ServoAxis {
    /// Distance from which on the camera makes a full step, pixels.
    pub far: u8,
    /// Distance from which on it makes half a step, pixels.
    pub near: u8,
    /// Servo positions that a full step moves by.
    pub step: u8,
}

/// Both axes, in the order of `SP`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ServoParameters {
    /// Sideways, servo 0.
    pub pan: ServoAxis,
    /// Up and down, servo 1.
    pub tilt: ServoAxis,
}

impl ServoParameters {
    pub(crate) const fn numbers(self) -> [u8; 6] {
        let Self { pan, tilt } = self;
        [pan.far, pan.near, pan.step, tilt.far, tilt.near, tilt.step]
    }
}
