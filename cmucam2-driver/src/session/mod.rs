//! The dialogue with the camera as a state machine: no input, no output, no clock.
//!
//! The caller gives it a [`Request`], received bytes and the time; it gives bytes to send, the time at which
//! it wants to be called at the latest, and in the end an [`Answer`] or a [`Fault`]:
//!
//! 1. [`begin`](Session::begin) a request;
//! 2. while [`pending`](Session::pending) is not empty, send it and tell how many bytes [were
//!    sent](Session::sent); after it the payload, if it is [due](Session::payload_due);
//! 3. give every byte that comes to [`receive`](Session::receive), and call
//!    [`tick`](Session::tick) when [`deadline`](Session::deadline) is reached;
//! 4. after each of these look for the [`outcome`](Session::outcome).
//!
//! Times are microseconds from any origin and must not run backwards.
//!
//! # How it is made
//! | part | holds |
//! |---|---|
//! | `port` | both directions of the line, and its longest silence |
//! | `synchronisation` | the steps that make the camera listen |
//! | `exchange` | one command and the awaited part of its reply |
//! | `stream` | packets and images as they come |
//! | `script` | the request under way, step by step |
//! | [`Modes`] | the settings, and the commands that restore them |
//! | `dialogue` | the order of all of these |
//!
//! # Its work
//! - Before the first command, after anything irregular and to end a stream: a carriage return, all
//!   bytes up to the prompt dropped, another carriage return, `ACK` and prompt required, and a
//!   moment of silence, so that no reply is taken for that of another command.
//! - `NCK`, silence and garbage: [idempotent](crate::command::Order::is_idempotent) commands are repeated, at
//!   most [`Policy::retries`] times.
//! - A camera that restarts: its banner between other bytes, an `ACK` where a running stream would have been
//!   stopped without one, or a stream where poll mode was set, twice in a row: one damaged line may look like
//!   that. (A restart of an idle camera is noticed only when its banner is read.) The [`Modes`] are set again
//!   and a colour-tracking or statistics stream is started again before the request goes on. A stream tells
//!   it with [`Fault::Restarted`], because the camera's adaptation is lost; frame differencing has lost its
//!   reference and must be begun anew. Any other request that can be repeated just goes on: a caller that
//!   depends on the adaptation asks [`Session::restarts`].
//! - Silence under packet filter is [`Answer::Quiet`] when nothing was tracked last.

mod dialogue;
mod exchange;
mod modes;
mod policy;
mod port;
mod request;
mod script;
mod stream;
mod synchronisation;

use core::ops::ControlFlow;

pub use modes::{Modes, REGISTERS_MAX};
pub use policy::Policy;
pub use request::{Answer, Fault, Request};
pub use script::{Learn, StartUp};

use crate::{geometry::Size, parser::DroppedBytes};
use dialogue::{Dialogue, Doing};
use script::Task;

/// The state machine. See the [module](self).
#[derive(Clone, Debug)]
pub struct Session {
    dialogue: Dialogue,
    state: State,
}

#[derive(Clone, Copy, Debug)]
enum State {
    Idle,
    Busy(Task, Doing),
    /// The outcome was not fetched yet.
    Over(Result<Answer, Fault>),
}

impl Session {
    /// A session with a camera of which nothing is known.
    pub fn new(policy: Policy) -> Self {
        Self {
            dialogue: Dialogue::new(policy),
            state: State::Idle,
        }
    }

    /// Settings, which will be set again after a restart of the camera.
    pub fn modes(&self) -> &Modes {
        &self.dialogue.modes
    }

    /// Time-outs and counts.
    pub fn policy(&self) -> &Policy {
        &self.dialogue.policy
    }

    /// The largest frame of the camera as it is set up now.
    pub fn frame(&self) -> Size {
        self.dialogue.modes.frame(self.dialogue.sensor)
    }

    /// Bytes that made no sense.
    pub fn dropped(&self) -> &DroppedBytes {
        self.dialogue.port.parser.dropped()
    }

    /// Number of restarts of the camera that it was not told to make.
    pub fn restarts(&self) -> u16 {
        self.dialogue.restarts
    }

    /// The answer to the last request is not of the kind that was wanted.
    pub(crate) fn unexpected(&self) -> Fault {
        self.dialogue.unexpected()
    }

    /// Number of repeated commands.
    pub fn retries(&self) -> u16 {
        self.dialogue.retries
    }

    /// Time when the last byte of the last packet that was answered was received, in the time of
    /// [`receive`](Self::receive). `None` before the first one.
    pub fn packet_at(&self) -> Option<u64> {
        self.dialogue.packet_at
    }

    /// Begins a request. One that was not finished is abandoned.
    pub fn begin(&mut self, request: Request, now: u64) {
        self.abandon();
        self.state = State::Busy(Task::new(request), Doing::Wait);
        if let State::Busy(task, doing) = &mut self.state {
            let flow = self.dialogue.begin(task, doing, now);
            self.follow(flow);
        }
    }

    /// Bytes to send.
    pub fn pending(&self) -> &[u8] {
        self.dialogue.port.pending()
    }

    /// So many of them are sent.
    pub fn sent(&mut self, bytes: usize) {
        self.dialogue.port.sent(bytes);
    }

    /// Returns true if the raw bytes that belong to the command
    /// ([`Command::UploadDifference`](crate::Command::UploadDifference)) are to be sent now.
    pub fn payload_due(&self) -> bool {
        self.dialogue.port.payload_due()
    }

    /// They are sent.
    pub fn payload_sent(&mut self, now: u64) {
        let Dialogue { port, policy, .. } = &mut self.dialogue;
        port.payload_sent(now, policy);
    }

    /// Latest time to call [`Session::tick`]. `None` when no request is under way.
    pub fn deadline(&self) -> Option<u64> {
        match self.state {
            State::Busy(..) => Some(self.dialogue.port.deadline()),
            State::Idle | State::Over(_) => None,
        }
    }

    /// The result of the request, once.
    pub fn outcome(&mut self) -> Option<Result<Answer, Fault>> {
        let State::Over(outcome) = self.state else {
            return None;
        };
        self.state = State::Idle;
        Some(outcome)
    }

    /// Takes one byte. `row` is the buffer of [`Request::NextPart`], empty otherwise.
    pub fn receive(&mut self, byte: u8, now: u64, row: &mut [u8]) {
        let waits_for_it = match self.state {
            State::Busy(_, Doing::Pause | Doing::Wait) => false,
            State::Busy(..) | State::Idle | State::Over(_) => true,
        };
        let Some(event) = self.dialogue.port.hear(byte, now, waits_for_it) else {
            return;
        };
        let flow = match &mut self.state {
            State::Busy(task, doing) => self.dialogue.on_event(task, doing, event, now, row),
            State::Idle | State::Over(_) => {
                self.dialogue.on_event_between(event);
                return;
            }
        };
        self.follow(flow);
    }

    /// The time has come, or not yet.
    pub fn tick(&mut self, now: u64) {
        if self.deadline().is_none_or(|deadline| now < deadline) {
            return;
        }
        let State::Busy(task, doing) = &mut self.state else {
            return;
        };
        let flow = self.dialogue.on_timeout(task, doing, now);
        self.follow(flow);
    }

    /// The UART failed: bytes are missing. The request ends without an outcome; a stream goes on.
    pub fn line_error(&mut self) {
        self.dialogue.port.parser.gap();
        self.abandon();
        self.state = State::Idle;
    }

    fn follow(&mut self, flow: ControlFlow<Result<Answer, Fault>>) {
        if let ControlFlow::Break(outcome) = flow {
            self.state = State::Over(outcome);
        }
    }

    /// The request under way will not be finished. The camera's next bytes cannot be foretold, unless it only
    /// sends its stream.
    fn abandon(&mut self) {
        if let State::Busy(_, doing) = &self.state {
            self.dialogue.abandon(doing);
        }
    }
}
