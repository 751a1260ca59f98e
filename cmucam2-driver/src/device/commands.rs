//! Requests to the camera: the dialogues, and any [`Command`].

use super::{Call, Cmucam2, Convert};
use crate::{
    colour::ColourBounds,
    command::Command,
    packet::{FirmwareVersion, Packet, Tracking},
    session::{Answer, Learn, Modes, Request, StartUp},
    uncertain,
};

pub(super) fn done(_: Answer, _: &Modes) -> Option<()> {
    Some(())
}

fn answer(answer: Answer, _: &Modes) -> Option<Answer> {
    Some(answer)
}

fn version(answer: Answer, _: &Modes) -> Option<FirmwareVersion> {
    match answer {
        Answer::Version(version) => Some(version),
        _ => None,
    }
}

fn bounds(answer: Answer, modes: &Modes) -> Option<ColourBounds> {
    match answer {
        Answer::Values(values) => uncertain::bounds_from_reply(values, modes.bounds()),
        Answer::Bounds(bounds) => Some(bounds),
        _ => None,
    }
}

fn packet(answer: Answer, _: &Modes) -> Option<Option<Packet>> {
    match answer {
        Answer::Packet(packet) => Some(Some(packet)),
        Answer::Quiet => Some(None),
        _ => None,
    }
}

fn tracking(answer: Answer, modes: &Modes) -> Option<Option<Tracking>> {
    match packet(answer, modes)? {
        Some(Packet::Tracking(tracking)) => Some(Some(tracking)),
        None => Some(None),
        Some(_) => None,
    }
}

/// Any command.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Any request to the [session](crate::session), with its answer as it is: where each kind of answer in a program of
    /// its own would take too much flash.
    #[inline(always)] // for less flash
    pub fn request(&mut self, request: Request) -> Call<'_, U, D, Answer, K> {
        self.call(request, answer)
    }

    /// A single command: a mode, a query, a servo, a lamp. The reply stands beside each [`Command`];
    /// [`Answer::Done`] if there is none. For a command that answers with packets, one is taken and the
    /// camera is stopped if it goes on.
    #[inline(always)] // for less flash
    pub fn command(&mut self, command: Command) -> Call<'_, U, D, Answer, K> {
        self.ask(command, answer)
    }

    /// The same for a command whose answer tells nothing, such as a mode.
    #[inline(always)] // for less flash
    pub fn set(&mut self, command: Command) -> Call<'_, U, D, (), K> {
        self.ask(command, done)
    }

    /// Begins the stream of any command that answers with packets or frames, for
    /// [`Cmucam2::next_packet`] and its like.
    #[inline(always)] // for less flash
    pub fn stream(&mut self, command: Command) -> Call<'_, U, D, (), K> {
        self.call(Request::Start(command.order()), done)
    }

    /// Ends the stream.
    pub fn stop(&mut self) -> Call<'_, U, D, (), K> {
        self.call(Request::Stop, done)
    }

    #[inline(always)] // for less flash
    pub(super) fn ask<T>(&mut self, command: Command, convert: Convert<T>) -> Call<'_, U, D, T, K> {
        self.call(Request::Do(command.order()), convert)
    }
}

/// From power-up to a colour.
impl<U, D, K> Cmucam2<U, D, K> {
    /// The firmware version.
    pub fn version(&mut self) -> Call<'_, U, D, FirmwareVersion, K> {
        self.ask(Command::GetVersion, version)
    }

    /// Reset, adapt to the light, freeze gain and white balance: see [`StartUp`].
    pub fn start_up(&mut self, start_up: StartUp) -> Call<'_, U, D, (), K> {
        self.call(Request::StartUp(start_up), done)
    }

    /// Learns the colour of the object in view and sets it as bounds: see [`Learn`].
    pub fn learn(&mut self, how: Learn) -> Call<'_, U, D, ColourBounds, K> {
        self.call(Request::Learn { how, track: false }, bounds)
    }

    /// [`Cmucam2::learn`], then [`Cmucam2::track_colour`].
    pub fn learn_and_track(&mut self, how: Learn) -> Call<'_, U, D, ColourBounds, K> {
        self.call(Request::Learn { how, track: true }, bounds)
    }

    /// The bounds that the camera has.
    pub fn tracking_bounds(&mut self) -> Call<'_, U, D, ColourBounds, K> {
        self.ask(Command::GetTrackingBounds, bounds)
    }
}

/// Tracking.
impl<U, D, K> Cmucam2<U, D, K> {
    /// Tracks a colour: [`Cmucam2::next_tracking`] tells its place.
    pub fn track_colour(&mut self, bounds: ColourBounds) -> Call<'_, U, D, (), K> {
        self.stream(Command::TrackColour(Some(bounds)))
    }

    /// The next packet of tracking or frame differencing. `None`: under packet filter, nothing
    /// is tracked and nothing was sent.
    pub fn next_tracking(&mut self) -> Call<'_, U, D, Option<Tracking>, K> {
        self.call(Request::Next, tracking)
    }

    /// The next packet of any stream.
    pub fn next_packet(&mut self) -> Call<'_, U, D, Option<Packet>, K> {
        self.call(Request::Next, packet)
    }
}
