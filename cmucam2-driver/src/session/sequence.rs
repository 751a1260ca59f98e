//! Dialogues of several commands.

use super::{Answer, Fault, modes::Modes};
use crate::{
    colour::{Colour, ColourBounds},
    command::Command,
    geometry::{Sensor, Window},
    packet::Packet,
    register::{ColourMode, Register, Registers},
    uncertain,
};

/// How far TW goes to either side of the mean.
pub(super) const WINDOW_MARGIN: u8 = 30;

/// Reset, let the camera adapt to the light, then freeze gain and white balance, so that a colour
/// stays the same colour (thesis, Appendix A: "Initialize").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StartUp {
    /// How long the camera adapts, milliseconds.
    pub adapt_ms: u32,
    /// What the channels mean from then on.
    pub colour_mode: ColourMode,
}

impl Default for StartUp {
    /// Five seconds, RGB.
    fn default() -> Self {
        Self {
            adapt_ms: 5_000,
            colour_mode: ColourMode::Rgb,
        }
    }
}

/// How to learn the colour of the object in view (thesis, Appendix A: "Object kept").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Learn {
    /// The camera takes the mean of the middle of its window, 30 levels to either side (`TW`), and
    /// is asked for the bounds it chose (`GT`).
    #[default]
    TrackWindow,
    /// The mean of a window (`GM`) and a margin to either side.
    Mean {
        /// Where the object is; `None` for the middle half of the frame.
        window: Option<Window>,
        /// Levels to either side of the mean.
        margin: u8,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sequence {
    StartUp(StartUp),
    Learn { how: Learn, track: bool },
    Recover,
}

/// What to do next.
pub(super) enum Step {
    /// Exchange a command.
    Do(Command),
    /// The same, without remembering it as a mode.
    DoOnce(Command),
    /// Begin a stream.
    Start(Command),
    /// Wait, microseconds.
    Pause(u64),
    /// Set all remembered modes again.
    Restore,
    Finish(Answer),
    Fail(Fault),
}

impl Sequence {
    /// Step `step`, after the one before was answered.
    pub(super) fn step(
        self,
        step: u8,
        answer: Option<Answer>,
        modes: &mut Modes,
        sensor: Option<Sensor>,
        window_mean: Option<Colour>,
    ) -> Step {
        match self {
            Self::StartUp(StartUp {
                adapt_ms,
                colour_mode,
            }) => {
                let light = |auto| {
                    Step::Do(Command::Registers(Registers::two(
                        Register::colour_mode(colour_mode, auto),
                        Register::auto_gain(auto),
                    )))
                };
                match step {
                    0 => Step::Do(Command::Reset),
                    1 => light(true),
                    2 => Step::Pause(u64::from(adapt_ms) * 1_000),
                    3 => light(false),
                    _ => Step::Finish(Answer::Done),
                }
            }
            Self::Recover => match step {
                0 => Step::Do(Command::Reset),
                1 => Step::Restore,
                _ => Step::Finish(Answer::Done),
            },
            Self::Learn {
                how: Learn::TrackWindow,
                track,
            } => match step {
                0 => Step::Do(Command::TrackWindow),
                1 => Step::Do(Command::GetTrackingBounds),
                2 => {
                    let known = window_mean.map(|mean| ColourBounds::around(mean, WINDOW_MARGIN));
                    let Some(Answer::Values(values)) = answer else {
                        return Step::Fail(Fault::Garbage);
                    };
                    let Some(bounds) = uncertain::bounds_from_reply(values, known) else {
                        return Step::Fail(Fault::Garbage);
                    };
                    modes.set_bounds(bounds);
                    if track {
                        return Step::Start(Command::TrackColour(Some(bounds)));
                    }
                    finish_with_bounds(modes)
                }
                _ => finish_with_bounds(modes),
            },
            Self::Learn {
                how: Learn::Mean { window, margin },
                track,
            } => match step {
                0 => {
                    // The smallest frame, if the sensor is not known, so that the window exists.
                    let frame = modes.frame(sensor.or(Some(Sensor::Ov6620)));
                    let window = window.unwrap_or_else(|| Window::central(frame));
                    Step::DoOnce(Command::VirtualWindow(Some(window)))
                }
                1 => Step::Do(Command::GetMean),
                2 => {
                    let Some(Answer::Packet(Packet::Statistics(statistics))) = answer else {
                        return Step::Fail(Fault::Garbage);
                    };
                    let Some(mean) = statistics.mean() else {
                        return Step::Fail(Fault::Masked);
                    };
                    modes.set_bounds(ColourBounds::around(mean, margin));
                    Step::Do(Command::VirtualWindow(modes.window()))
                }
                3 => match (modes.bounds(), track) {
                    (Some(bounds), true) => Step::Start(Command::TrackColour(Some(bounds))),
                    (Some(bounds), false) => Step::Do(Command::SetBounds(bounds)),
                    (None, _) => Step::Fail(Fault::Garbage),
                },
                _ => finish_with_bounds(modes),
            },
        }
    }
}

fn finish_with_bounds(modes: &Modes) -> Step {
    match modes.bounds() {
        Some(bounds) => Step::Finish(Answer::Bounds(bounds)),
        None => Step::Fail(Fault::Garbage),
    }
}
