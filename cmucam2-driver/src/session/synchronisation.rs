//! Making the camera listen, whatever it did before: a carriage return, all bytes up to the prompt
//! dropped, another carriage return, `ACK` and prompt required, and a moment of silence.

use super::{Policy, port::Port, request::Answer};
use crate::{command::Order, parser::Token};

/// Part of the reply that is awaited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The prompt after the first carriage return.
    Drain { ack: bool },
    /// `ACK` and prompt after the second one.
    Confirm { ack: bool },
    /// The prompt of a camera that restarts.
    Boot,
    /// Silence.
    Settle,
}

/// Purpose of the stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// So that it takes a command.
    Stop,
    /// Its stream has fallen silent: is it still in it?
    Probe,
    /// It sends a frame, which takes time to drain.
    Frame,
}

/// Progress of the synchronisation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Synchronisation {
    stage: Stage,
    purpose: Purpose,
    tries: u8,
}

/// The next step when the camera listens.
#[derive(Clone, Copy, Debug)]
pub(super) enum Resume {
    /// The next wish of the request.
    Plan,
    /// The command that was sent last is sent again.
    Repeat,
    /// That command was answered: only the prompt was missing.
    Conclude(Answer),
}

/// Outcome of silence.
pub(super) enum Outcome {
    /// It is tried again.
    Again,
    /// The camera listens.
    Listens,
    /// It does not.
    Failed,
}

impl Synchronisation {
    /// Sends the first carriage return.
    pub(super) fn begin(purpose: Purpose, port: &mut Port, policy: &Policy, now: u64) -> Self {
        let mut synchronisation = Self {
            stage: Stage::Boot,
            purpose,
            tries: 0,
        };
        synchronisation.drain(port, policy, now);
        synchronisation
    }

    /// A banner came: the prompt of that camera follows by itself.
    pub(super) fn booting(
        before: Option<Self>,
        port: &mut Port,
        policy: &Policy,
        now: u64,
    ) -> Self {
        port.wait(now, policy.reset_us);
        Self {
            stage: Stage::Boot,
            purpose: Purpose::Stop,
            tries: before.map_or(0, |before| before.tries),
        }
    }

    fn drain(&mut self, port: &mut Port, policy: &Policy, now: u64) {
        self.stage = Stage::Drain { ack: false };
        port.send(&Order::IDLE);
        if self.purpose == Purpose::Frame {
            port.wait_at_most(now, policy.drain_us, policy.frame_us);
        } else {
            port.wait(now, policy.drain_us);
        }
    }

    /// Takes a token. Returns true if it shows that the camera has restarted.
    pub(super) fn on_event(
        &mut self,
        event: &Token,
        port: &mut Port,
        policy: &Policy,
        now: u64,
    ) -> bool {
        match (&mut self.stage, event) {
            (Stage::Drain { ack } | Stage::Confirm { ack }, Token::Ack) => *ack = true,
            (&mut Stage::Drain { ack }, Token::Prompt) => {
                self.stage = Stage::Confirm { ack: false };
                port.send(&Order::IDLE);
                port.wait(now, policy.drain_us);
                // A running stream stops without an acknowledgement. A camera that acknowledges
                // was not in the stream any more: it has restarted, and its banner was lost.
                let probe = self.purpose == Purpose::Probe;
                if probe {
                    self.purpose = Purpose::Stop;
                }
                return ack && probe;
            }
            (Stage::Confirm { ack: true } | Stage::Boot, Token::Prompt) => {
                self.stage = Stage::Settle;
                port.wait(now, policy.settle_us);
            }
            _ => {}
        }
        false
    }

    /// The time is over.
    pub(super) fn on_timeout(&mut self, port: &mut Port, policy: &Policy, now: u64) -> Outcome {
        if self.stage == Stage::Settle && port.is_silent(now) {
            return Outcome::Listens;
        }
        self.tries = self.tries.saturating_add(1);
        if self.tries > policy.retries {
            return Outcome::Failed;
        }
        self.drain(port, policy, now);
        Outcome::Again
    }
}
