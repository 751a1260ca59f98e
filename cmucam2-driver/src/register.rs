//! Registers of the image sensor (`CR`).

use crate::argument::ArgumentError;

/// A register of the sensor. Those whose meaning is known have names; any other can be written
/// by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Register(pub u8);

impl Register {
    /// Contrast, 0 to 255.
    pub const CONTRAST: Self = Self(5);
    /// Brightness, 0 to 255.
    pub const BRIGHTNESS: Self = Self(6);
    /// Exposure, when auto gain is off.
    pub const EXPOSURE: Self = Self(16);
    /// Clock divider, see [`FrameRate`].
    pub const CLOCK: Self = Self(17);
    /// Colour mode and automatic white balance, see [`ColourMode`].
    pub const COLOUR_MODE: Self = Self(18);
    /// Automatic gain: 33 on, 32 off.
    pub const AUTO_GAIN: Self = Self(19);

    /// This register with a value.
    pub const fn with(self, value: u8) -> RegisterValue {
        RegisterValue {
            register: self,
            value,
        }
    }

    /// Automatic gain on or off.
    pub const fn auto_gain(on: bool) -> RegisterValue {
        Self::AUTO_GAIN.with(if on { 33 } else { 32 })
    }

    /// The colour mode with automatic white balance on or off.
    pub const fn colour_mode(mode: ColourMode, auto_white_balance: bool) -> RegisterValue {
        let value = match mode {
            ColourMode::YCrCb => 32,
            ColourMode::Rgb => 40,
        };
        Self::COLOUR_MODE.with(if auto_white_balance { value + 4 } else { value })
    }

    /// The clock divider for a frame rate.
    pub const fn frame_rate(rate: FrameRate) -> RegisterValue {
        Self::CLOCK.with(rate as u8)
    }
}

/// A register and its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RegisterValue {
    /// The register.
    pub register: Register,
    /// 0 to 255; the register gives it a meaning.
    pub value: u8,
}

impl RegisterValue {
    const fn bytes(self) -> [u8; 2] {
        [self.register.0, self.value]
    }
}

/// Meaning of the three channels of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ColourMode {
    /// Red, green, blue.
    Rgb,
    /// Cr, Y, Cb: less sensitive to changes of the light.
    YCrCb,
}

/// Frames a second that the sensor delivers, and the clock divider of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[expect(missing_docs, reason = "the names are the frame rates")]
pub enum FrameRate {
    Fps50 = 0,
    Fps26 = 1,
    Fps17 = 2,
    Fps13 = 3,
    Fps11 = 4,
    Fps9 = 5,
    Fps8 = 6,
    Fps7 = 7,
    Fps6 = 8,
    Fps5 = 10,
}

/// The most pairs that one `CR` command carries: CMU's CMUcam2-compatible program for the CMUcam3
/// takes ten arguments.
pub const PAIRS_MAX: usize = 5;

/// Up to [`PAIRS_MAX`] registers with their values, for one command. None means: all defaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Registers {
    pairs: [[u8; 2]; PAIRS_MAX],
    len: u8,
}

impl Registers {
    /// Everything back to its default.
    pub const DEFAULTS: Self = Self {
        pairs: [[0; 2]; PAIRS_MAX],
        len: 0,
    };

    /// # Errors
    /// More than [`PAIRS_MAX`] pairs.
    pub fn new(values: &[RegisterValue]) -> Result<Self, ArgumentError> {
        let mut all = Self::DEFAULTS;
        for value in values {
            let free = all.pairs.get_mut(usize::from(all.len));
            *free.ok_or(ArgumentError::Registers)? = value.bytes();
            all.len += 1;
        }
        Ok(all)
    }

    /// A single register with its value.
    pub const fn one(value: RegisterValue) -> Self {
        let mut pairs = [[0; 2]; PAIRS_MAX];
        pairs[0] = value.bytes();
        Self { pairs, len: 1 }
    }

    /// Two registers with their values, in this order.
    pub const fn two(first: RegisterValue, second: RegisterValue) -> Self {
        let mut pairs = [[0; 2]; PAIRS_MAX];
        pairs[0] = first.bytes();
        pairs[1] = second.bytes();
        Self { pairs, len: 2 }
    }

    /// The arguments of `CR`.
    pub(crate) fn numbers(&self) -> &[u8] {
        self.pairs
            .get(..usize::from(self.len))
            .unwrap_or(&[])
            .as_flattened()
    }
}
