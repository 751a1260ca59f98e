//! Requests as scripts: their steps in order.

use core::ops::ControlFlow;

use super::{Answer, Fault, Request, exchange::Purpose, modes::Modes};
use crate::{
    colour::{Colour, ColourBounds},
    command::{Command, Order},
    geometry::Sensor,
    register::{ColourMode, Register, Registers},
    uncertain,
};
#[cfg(feature = "full")]
use crate::{geometry::Window, packet::Packet};

/// Levels that TW takes to either side of the mean.
const WINDOW_MARGIN: u8 = 30;

/// Reset, let the camera adapt to the light, then freeze gain and white balance, so that a colour
/// stays the same colour (thesis, Appendix A: "Initialize").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct StartUp {
    /// Time for which the camera adapts, milliseconds.
    pub adapt_ms: u32,
    /// Meaning of the channels from then on.
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

/// Method of learning the colour of the object in view (thesis, Appendix A: "Object kept").
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Learn {
    /// The camera takes the mean of the middle of its window, 30 levels to either side (`TW`), and
    /// is asked for the bounds it chose (`GT`).
    #[default]
    TrackWindow,
    /// The mean of a window (`GM`) and a margin to either side. With the feature `full`.
    #[cfg(feature = "full")]
    Mean {
        /// Window of the object; `None` for the middle half of the frame.
        window: Option<Window>,
        /// Levels to either side of the mean.
        margin: u8,
    },
}

/// The next step.
pub(super) enum Step {
    /// Exchange a command.
    Send(Order, Purpose),
    /// Begin a stream; the request is done when it runs.
    Begin(Order),
    /// Read the stream, which does not run.
    Read,
    /// End the stream.
    Stop,
    /// Let time pass, microseconds.
    Wait(u64),
    /// Set all remembered modes again.
    #[cfg(feature = "full")]
    Restore,
    Finish(Answer),
    Fail(Fault),
}

/// Restart of the camera while a request was under way, and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interruption {
    None,
    /// Before its command was sent.
    Early,
    /// Perhaps after the camera had carried it out.
    Late,
}

/// The request under way, and its progress.
#[derive(Clone, Copy, Debug)]
pub(super) struct Task {
    pub(super) request: Request,
    step: u8,
    /// Number of failed tries since the last success.
    pub(super) failures: u8,
    /// Number of restarts of the camera.
    pub(super) restarts: u8,
    interruption: Interruption,
    /// It may have restarted: a stream came where one packet was asked for.
    is_suspected: bool,
    /// The mean colour that TW told.
    pub(super) window_mean: Option<Colour>,
}

impl Task {
    pub(super) fn new(request: Request) -> Self {
        Self {
            request: match request {
                Request::Start(order) if !order.streams() => Request::Do(order),
                request => request,
            },
            step: 0,
            failures: 0,
            restarts: 0,
            interruption: Interruption::None,
            is_suspected: false,
            window_mean: None,
        }
    }

    /// The camera has lost its modes since the request before.
    pub(super) fn on_lost_modes(&mut self) {
        if self.reads() {
            self.interruption = Interruption::Early;
        }
    }

    /// Returns true if it reads a stream.
    pub(super) fn reads(&self) -> bool {
        matches!(self.request, Request::Next | Request::NextPart { .. })
    }

    /// Room for a row, if the images between packets are wanted.
    pub(super) fn room(&self) -> Option<usize> {
        match self.request {
            Request::NextPart { row } => Some(row),
            _ => None,
        }
    }

    /// Returns true if it begins a stream in the place of another.
    pub(super) fn begins(&self) -> bool {
        matches!(
            self.request,
            Request::Start(_) | Request::Learn { track: true, .. }
        )
    }

    /// Returns true if it resets the camera next, so that lost modes do not matter.
    pub(super) fn is_resetting(&self) -> bool {
        match self.request {
            Request::Do(order) => order == Order::RESET,
            Request::StartUp(_) => self.step == 0,
            #[cfg(feature = "full")]
            Request::Recover => self.step == 0,
            _ => false,
        }
    }

    /// Returns true if the modes stay known while it resets the camera.
    pub(super) fn keeps_modes(&self) -> bool {
        #[cfg(feature = "full")]
        if self.request == Request::Recover {
            return true;
        }
        false
    }

    /// The camera restarted, perhaps (`asked`) after it had carried out the command. A script begins again.
    pub(super) fn on_restart(
        &mut self,
        asked: bool,
        retries: u8,
    ) -> ControlFlow<Result<Answer, Fault>> {
        self.step = 0;
        self.failures = 0;
        if asked {
            self.interruption = Interruption::Late;
        } else if self.interruption == Interruption::None {
            self.interruption = Interruption::Early;
        }
        self.restarts = self.restarts.saturating_add(1);
        if self.restarts > retries {
            return ControlFlow::Break(Err(Fault::Restarted));
        }
        ControlFlow::Continue(())
    }

    /// A stream came where one packet was asked for. A damaged line may look so, and a restart costs many
    /// seconds of adapting: the request is made once more, and a second stream proves the restart. Returns
    /// true if one had come already.
    pub(super) const fn is_suspected_again(&mut self) -> bool {
        core::mem::replace(&mut self.is_suspected, true)
    }

    /// Returns true if the camera restarted since the request, or before it.
    pub(super) fn was_interrupted(&self) -> bool {
        self.interruption != Interruption::None
    }

    /// Returns true if its command may be sent after a restart.
    pub(super) fn may_go_on(&self) -> bool {
        match self.request {
            Request::Do(order) => self.interruption != Interruption::Late || order.is_idempotent(),
            _ => true,
        }
    }

    /// A step is done.
    pub(super) fn advance(&mut self) {
        self.step = self.step.saturating_add(1);
    }

    /// Answer of a request when the stream that it begins runs.
    pub(super) fn begun(&self, modes: &Modes) -> Answer {
        match (self.request, modes.bounds()) {
            (Request::Learn { .. }, Some(bounds)) => Answer::Bounds(bounds),
            _ => Answer::Done,
        }
    }

    /// The next step, after the last one had this answer.
    pub(super) fn next(
        &self,
        answer: Option<Answer>,
        modes: &mut Modes,
        #[cfg_attr(
            not(feature = "full"),
            expect(unused_variables, reason = "only the mean of a window needs its frame")
        )]
        sensor: Option<Sensor>,
    ) -> Step {
        match self.request {
            Request::Do(order) => Step::Send(order, Purpose::Whole),
            Request::Start(order) => Step::Begin(order),
            Request::Next | Request::NextPart { .. } => Step::Read,
            Request::Stop => Step::Stop,
            #[cfg(feature = "full")]
            Request::Recover => match self.step {
                0 => Step::Send(Order::RESET, Purpose::Step),
                1 => Step::Restore,
                _ => Step::Finish(Answer::Done),
            },
            Request::StartUp(StartUp {
                adapt_ms,
                colour_mode,
            }) => {
                let light = |auto| {
                    let registers = Registers::two(
                        Register::colour_mode(colour_mode, auto),
                        Register::auto_gain(auto),
                    );
                    Step::Send(Command::Registers(registers).order(), Purpose::Step)
                };
                match self.step {
                    0 => Step::Send(Order::RESET, Purpose::Step),
                    1 => light(true),
                    2 => Step::Wait(u64::from(adapt_ms) * 1_000),
                    3 => light(false),
                    _ => Step::Finish(Answer::Done),
                }
            }
            Request::Learn {
                how: Learn::TrackWindow,
                track,
            } => match self.step {
                0 => Step::Send(Command::TrackWindow.order(), Purpose::Step),
                1 => Step::Send(Command::GetTrackingBounds.order(), Purpose::Step),
                _ => {
                    let around = |mean| ColourBounds::around(mean, WINDOW_MARGIN);
                    let known = self.window_mean.map(around);
                    let bounds = match answer {
                        Some(Answer::Values(values)) => uncertain::bounds_from_reply(values, known),
                        _ => None,
                    };
                    match bounds {
                        Some(bounds) => {
                            modes.set_bounds(bounds);
                            learnt(bounds, track)
                        }
                        None => Step::Fail(Fault::Unexpected { command: *b"GT" }),
                    }
                }
            },
            #[cfg(feature = "full")]
            Request::Learn {
                how: Learn::Mean { window, margin },
                track,
            } => match self.step {
                0 => {
                    // The smallest frame, if the sensor is not known, so that the window exists.
                    let frame = modes.frame(sensor.or(Some(Sensor::Ov6620)));
                    let window = window.unwrap_or_else(|| Window::central(frame));
                    let order = Command::VirtualWindow(Some(window)).order();
                    Step::Send(order, Purpose::Once)
                }
                1 => Step::Send(Command::GetMean.order(), Purpose::Step),
                2 => {
                    let Some(Answer::Packet(Packet::Statistics(statistics))) = answer else {
                        return Step::Fail(Fault::Unexpected { command: *b"GM" });
                    };
                    let Some(mean) = statistics.mean() else {
                        return Step::Fail(Fault::Masked);
                    };
                    modes.set_bounds(ColourBounds::around(mean, margin));
                    let order = Command::VirtualWindow(modes.window()).order();
                    Step::Send(order, Purpose::Step)
                }
                step => match modes.bounds() {
                    Some(bounds) if step == 3 && !track => {
                        Step::Send(Command::SetBounds(bounds).order(), Purpose::Step)
                    }
                    Some(bounds) => learnt(bounds, track),
                    None => Step::Fail(Fault::Unexpected { command: *b"GM" }),
                },
            },
        }
    }
}

/// The end of learning.
fn learnt(bounds: ColourBounds, track: bool) -> Step {
    if track {
        return Step::Begin(Command::TrackColour(Some(bounds)).order());
    }
    Step::Finish(Answer::Bounds(bounds))
}
