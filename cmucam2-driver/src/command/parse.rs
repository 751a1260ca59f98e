//! Reading commands, as the camera does.

use core::fmt;

use super::{ARGUMENTS_MAX, Command, RawMode};
use crate::{
    argument::{ArgumentError, switch},
    colour::{ColourBounds, ColourChannel},
    geometry::{DownSampling, Sensor, Window},
    register::{Register, Registers},
    servo::{Servo, ServoAxis, ServoMask, ServoParameters, ServoPosition},
    text::decimal,
};

/// Reason why a line is no command. The camera answers `NCK` to all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CommandError {
    /// No command has these letters.
    Unknown,
    /// Too few or too many arguments.
    Count,
    /// An argument is not a decimal number from 0 to 255.
    Number,
    /// The camera has no meaning for an argument.
    Argument(ArgumentError),
}

impl fmt::Display for CommandError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown => f.write_str("no command has these letters"),
            Self::Count => f.write_str("this command takes another number of arguments"),
            Self::Number => f.write_str("an argument must be a decimal number from 0 to 255"),
            Self::Argument(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for CommandError {}

impl From<ArgumentError> for CommandError {
    fn from(error: ArgumentError) -> Self {
        Self::Argument(error)
    }
}

/// Arguments behind the letters.
struct Arguments {
    values: [u8; ARGUMENTS_MAX],
    len: usize,
}

impl Arguments {
    fn parse(text: &[u8]) -> Result<Self, CommandError> {
        let mut all = Self {
            values: [0; ARGUMENTS_MAX],
            len: 0,
        };
        for word in text.split(|&byte| byte == b' ') {
            if word.is_empty() {
                continue;
            }
            let free = all.values.get_mut(all.len).ok_or(CommandError::Count)?;
            *free = decimal(word).ok_or(CommandError::Number)?;
            all.len += 1;
        }
        Ok(all)
    }

    fn as_slice(&self) -> &[u8] {
        self.values.get(..self.len).unwrap_or(&[])
    }

    /// Exactly so many.
    fn exactly<const N: usize>(&self) -> Result<[u8; N], CommandError> {
        self.as_slice().try_into().map_err(|_| CommandError::Count)
    }

    /// Exactly so many, or none.
    fn optional<const N: usize>(&self) -> Result<Option<[u8; N]>, CommandError> {
        if self.len == 0 {
            return Ok(None);
        }
        self.exactly().map(Some)
    }

    fn one(&self) -> Result<u8, CommandError> {
        self.exactly().map(|[value]| value)
    }

    fn switch(&self) -> Result<bool, CommandError> {
        Ok(switch(self.one()?)?)
    }

    fn none(&self, command: Command) -> Result<Command, CommandError> {
        self.exactly::<0>().map(|_| command)
    }
}

impl Command {
    /// Reads one line without its carriage return. Letters may have either case, several spaces
    /// count as one, and a space after the letters is not required.
    ///
    /// # Errors
    /// [`CommandError`] for lines that the camera would answer with `NCK`.
    pub fn parse(line: &[u8]) -> Result<Self, CommandError> {
        let Some((&letters, rest)) = line.split_first_chunk::<2>() else {
            return match line {
                [] => Ok(Self::Idle),
                _ => Err(CommandError::Unknown),
            };
        };
        let letters = letters.map(|letter| letter.to_ascii_uppercase());
        let a = Arguments::parse(rest)?;
        Ok(match &letters {
            b"BM" => Self::BufferMode(a.switch()?),
            b"CP" => Self::CameraPower(a.switch()?),
            b"CR" => Self::Registers(registers(a.as_slice())?),
            b"CT" => Self::CameraType(if a.switch()? {
                Sensor::Ov7620
            } else {
                Sensor::Ov6620
            }),
            b"DC" => Self::DifferenceChannel(ColourChannel::try_from(a.one()?)?),
            b"DM" => Self::CharacterDelay(a.one()?),
            b"DS" => {
                let [x, y] = a.exactly()?;
                Self::DownSample(DownSampling::new(x, y)?)
            }
            b"FD" => Self::FrameDifference(a.one()?),
            b"FS" => Self::FrameStream(a.switch()?),
            b"GB" => a.none(Self::GetButton)?,
            b"GH" => Self::GetHistogram(ColourChannel::try_from(a.one()?)?),
            b"GI" => a.none(Self::GetInputs)?,
            b"GM" => a.none(Self::GetMean)?,
            b"GS" => Self::GetServo(Servo::new(a.one()?)?),
            b"GT" => a.none(Self::GetTrackingBounds)?,
            b"GV" => a.none(Self::GetVersion)?,
            b"GW" => a.none(Self::GetWindow)?,
            b"HC" => {
                let [bins, scale] = a.exactly()?;
                Self::HistogramConfiguration { bins, scale }
            }
            b"HD" => Self::HighResolutionDifference(a.switch()?),
            b"HR" => Self::HighResolution(a.switch()?),
            b"HT" => Self::HistogramTracked(a.switch()?),
            b"L0" => Self::Led0(a.one()?.try_into()?),
            b"L1" => Self::Led1(a.one()?.try_into()?),
            b"LF" => a.none(Self::LoadFrame)?,
            b"LM" => Self::LineMode(a.exactly::<2>()?.try_into()?),
            b"MD" => Self::MaskDifference(a.one()?),
            b"NF" => Self::NoiseFilter(a.one()?),
            b"OM" => Self::OutputMask(a.exactly::<2>()?.try_into()?),
            b"PD" => Self::PixelDifference(a.switch()?),
            b"PF" => Self::PacketFilter(a.switch()?),
            b"PM" => Self::PollMode(a.switch()?),
            b"PS" => Self::PacketSkip(a.one()?),
            b"RF" => a.none(Self::ReadFrame)?,
            b"RM" => Self::RawMode(RawMode::new(a.one()?)?),
            b"RS" => a.none(Self::Reset)?,
            b"SD" => a.none(Self::DeepSleep)?,
            b"SF" => Self::SendFrame(match a.optional()? {
                Some([channel]) => Some(ColourChannel::try_from(channel)?),
                None => None,
            }),
            b"SL" => a.none(Self::Sleep)?,
            b"SM" => Self::ServoMask(ServoMask::new(a.one()?)?),
            b"SO" => {
                let [servo, high] = a.exactly()?;
                Self::ServoOutput(Servo::new(servo)?, switch(high)?)
            }
            b"SP" => Self::ServoParameters(servo_parameters(a.exactly()?)),
            b"SV" => {
                let [servo, position] = a.exactly()?;
                Self::ServoPosition(Servo::new(servo)?, ServoPosition::new(position)?)
            }
            b"ST" => Self::SetBounds(ColourBounds::new(a.exactly()?)?),
            b"TC" => Self::TrackColour(a.optional()?.map(ColourBounds::new).transpose()?),
            b"TI" => Self::TrackInvert(a.switch()?),
            b"TW" => a.none(Self::TrackWindow)?,
            b"UD" => a.none(Self::UploadDifference)?,
            b"VW" => Self::VirtualWindow(match a.optional()? {
                Some([x, y, x2, y2]) => Some(Window::new(x, y, x2, y2)?),
                None => None,
            }),
            _ => return Err(CommandError::Unknown),
        })
    }
}

fn registers(values: &[u8]) -> Result<Registers, CommandError> {
    let mut all = Registers::DEFAULTS;
    for pair in values.chunks(2) {
        let &[register, value] = pair else {
            return Err(CommandError::Count);
        };
        all.push(Register(register), value)?;
    }
    Ok(all)
}

fn servo_parameters(
    [pan_far, pan_near, pan_step, tilt_far, tilt_near, tilt_step]: [u8; 6],
) -> ServoParameters {
    ServoParameters {
        pan: ServoAxis {
            far: pan_far,
            near: pan_near,
            step: pan_step,
        },
        tilt: ServoAxis {
            far: tilt_far,
            near: tilt_near,
            step: tilt_step,
        },
    }
}
