//! A command as the dialogue needs it.

use super::{ARGUMENTS_MAX, CommandLine, Reply};
use crate::text::Line;

/// A command without its name: its bytes, its reply, and its lasting effect on the camera.
///
/// Made by [`Command::order`](super::Command::order) where the command is known, so that an image
/// holds only the commands that it sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Order {
    letters: Option<[u8; 2]>,
    arguments: [u8; ARGUMENTS_MAX],
    len: u8,
    reply: Reply,
    effect: Effect,
}

/// Lasting effect of a command on the camera, until it restarts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) enum Effect {
    Nothing,
    /// The arguments, or the default if there are none.
    Mode(Mode),
    /// Registers of the sensor with their values, or all defaults if there are none.
    Registers,
    /// Colour bounds, if there are any.
    Bounds,
    /// Colour bounds that the camera chooses.
    OwnBounds,
    /// All is back to the defaults.
    Reset,
}

/// Declares the modes: of each its name, and the letters and number of arguments of its command.
macro_rules! modes {
    ($(#[$attribute:meta])* $($name:ident $letters:literal $arguments:literal,)+) => {
        $(#[$attribute])*
        pub(crate) enum Mode {
            $($name,)+
        }

        impl Mode {
            /// Letters and number of arguments of the command of each.
            pub(crate) const COMMANDS: [([u8; 2], u8); 32] = [$((*$letters, $arguments),)+];
        }
    };
}

modes! {
    /// Settings, except registers and bounds, in the order in which a camera that has lost everything is told
    /// them again: those that define the frame come first, because windows count in its pixels; the sensor may
    /// only be switched off when all else is set.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    CameraType b"CT" 1,
    HighResolution b"HR" 1,
    DownSampling b"DS" 2,
    Window b"VW" 4,
    Buffer b"BM" 1,
    DifferenceChannel b"DC" 1,
    CharacterDelay b"DM" 1,
    DifferenceGrid b"HD" 1,
    Histogram b"HC" 2,
    HistogramTracked b"HT" 1,
    FrameStream b"FS" 1,
    Led0 b"L0" 1,
    Led1 b"L1" 1,
    TrackingLines b"LM" 2,
    StatisticsLines b"LM" 2,
    NoiseFilter b"NF" 1,
    TrackingMask b"OM" 2,
    StatisticsMask b"OM" 2,
    PixelDifference b"PD" 1,
    PacketFilter b"PF" 1,
    Poll b"PM" 1,
    PacketSkip b"PS" 1,
    ServoParameters b"SP" 6,
    ServoMask b"SM" 1,
    Servo0 b"SV" 2,
    Servo1 b"SV" 2,
    Servo2 b"SV" 2,
    Servo3 b"SV" 2,
    Servo4 b"SV" 2,
    Invert b"TI" 1,
    Power b"CP" 1,
    Raw b"RM" 1,
}

impl Mode {
    /// That of a servo's pin.
    pub(super) const fn servo(number: u8) -> Self {
        match number {
            0 => Self::Servo0,
            1 => Self::Servo1,
            2 => Self::Servo2,
            3 => Self::Servo3,
            _ => Self::Servo4,
        }
    }
}

impl Order {
    /// A bare carriage return.
    pub(crate) const IDLE: Self = Self {
        letters: None,
        arguments: [0; ARGUMENTS_MAX],
        len: 0,
        reply: Reply::Nothing,
        effect: Effect::Nothing,
    };

    /// `RS`.
    pub(crate) const RESET: Self = Self::bare(b"RS", Reply::Banner, Effect::Reset);

    /// `TC` with the bounds that the camera has.
    pub(crate) const TRACK_AGAIN: Self = Self::bare(
        b"TC",
        Reply::Packets(crate::packet::PacketKind::Tracking),
        Effect::Bounds,
    );

    pub(crate) const fn bare(letters: &[u8; 2], reply: Reply, effect: Effect) -> Self {
        Self {
            letters: Some(*letters),
            reply,
            effect,
            ..Self::IDLE
        }
    }

    /// With arguments.
    pub(crate) fn with(mut self, arguments: &[u8]) -> Self {
        debug_assert!(arguments.len() <= ARGUMENTS_MAX, "{arguments:?}");
        self.len = 0;
        for (place, &argument) in self.arguments.iter_mut().zip(arguments) {
            *place = argument;
            self.len += 1;
        }
        self
    }

    /// A command that sets a mode.
    pub(crate) fn mode(mode: Mode, arguments: &[u8]) -> Self {
        let letters = Mode::COMMANDS
            .get(mode as usize)
            .map(|(letters, _)| *letters);
        Self {
            letters,
            effect: Effect::Mode(mode),
            ..Self::IDLE
        }
        .with(arguments)
    }

    /// `ST`: bounds without tracking.
    pub(crate) fn set_bounds(bounds: &[u8]) -> Self {
        Self::bare(b"ST", Reply::Nothing, Effect::Bounds).with(bounds)
    }

    /// The line of this command.
    pub fn line(&self) -> CommandLine {
        let mut line = Line::EMPTY;
        if let Some(letters) = &self.letters {
            line.text(letters);
        }
        line.numbers(self.arguments());
        line.push(b'\r');
        line
    }

    /// Its name; spaces for a bare carriage return.
    pub(crate) fn letters(&self) -> [u8; 2] {
        self.letters.unwrap_or(*b"  ")
    }

    /// The reply that comes back.
    pub const fn reply(&self) -> Reply {
        self.reply
    }

    /// Returns true if sending it a second time leaves the camera as the first time did.
    ///
    /// False for the two sleeps, which the second copy would end, and for the upload: a camera that refused
    /// it would take its raw bytes for commands.
    pub const fn is_idempotent(&self) -> bool {
        !matches!(self.reply, Reply::Sleep | Reply::Upload)
    }

    /// Returns true if packets or a frame come back.
    pub(crate) const fn streams(&self) -> bool {
        matches!(self.reply, Reply::Packets(_) | Reply::Frame)
    }

    pub(crate) const fn effect(&self) -> Effect {
        self.effect
    }

    pub(crate) fn arguments(&self) -> &[u8] {
        self.arguments.get(..usize::from(self.len)).unwrap_or(&[])
    }

    /// The order that continues the stream that this began: bounds are told once.
    pub(crate) fn continued(self) -> Self {
        match self.effect {
            Effect::Bounds | Effect::OwnBounds => Self::TRACK_AGAIN,
            _ => self,
        }
    }
}
