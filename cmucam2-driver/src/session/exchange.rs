//! One command and its reply.

use super::{Answer, Fault, Job, Link, Payload, Phase, Sequence, Session};
use crate::{
    command::{Command, Reply},
    fmt::debug,
    packet::Packet,
    parser::Event,
};

impl Session {
    pub(super) fn send(&mut self, command: Command, now: u64) {
        self.command = command;
        self.once = false;
        self.starting = false;
        self.repeat = false;
        self.line = command.line();
        self.sent = 0;
        self.payload = Payload::None;
        self.heard = false;
        self.answer = None;
        self.complete = false;
        self.phase = Phase::Ack;
        if command == Command::TrackWindow {
            self.window_mean = None;
        }
        self.parser.expect(
            self.modes
                .expectation(&command, self.sensor, self.policy.strict),
        );
        let patience = if command == Command::Reset {
            self.policy.reset_us
        } else {
            self.policy.reply_us
        };
        self.wait(now, patience);
    }

    /// Begins a stream. In poll mode there is none: what [`super::Request::Next`] asks for is
    /// only noted, after what must be told first. Whether that is all.
    pub(super) fn start(&mut self, command: Command, now: u64) -> bool {
        let first = match command {
            _ if !self.modes.poll() || command.reply() == Reply::Frame => Some(command),
            Command::TrackColour(bounds) => bounds.map(Command::SetBounds),
            Command::TrackWindow => Some(command),
            _ => None,
        };
        match first {
            Some(first) => {
                self.send(first, now);
                self.starting = true;
            }
            None => self.stream = Some(repeated(command)),
        }
        first.is_none()
    }

    /// The stream runs.
    fn started(&mut self, command: Command, now: u64) {
        self.starting = false;
        self.stream = Some(repeated(command));
        match self.job {
            Job::Sequence(sequence) => {
                self.step += 1;
                if self.sequence(sequence, now) {
                    self.proceed(now);
                }
            }
            _ => self.finish(Answer::Done),
        }
    }

    pub(super) fn reply(&mut self, event: Event, now: u64, row: &mut [u8]) {
        match (self.phase, event) {
            (Phase::Ack, Event::Ack) => self.acknowledged(now),
            (Phase::Ack | Phase::Reply, Event::Nck) => {
                self.phase = Phase::Refused;
                self.wait(now, self.policy.reply_us);
            }
            (Phase::Ack, Event::Packet(packet)) if self.is_expected(&packet) => {
                // The acknowledgement was damaged, but this is what it promised.
                self.accepted(now);
                if self.phase == Phase::Stream {
                    self.streamed(event, now, row);
                }
            }
            (Phase::Ack, Event::Prompt) => self.irregular(now),
            (Phase::Reply, Event::Values(values)) => self.answer = Some(Answer::Values(values)),
            (Phase::Reply, Event::Prompt) => {
                let missing = self.answer.is_none()
                    && matches!(self.command.reply(), Reply::Values(_) | Reply::Banner);
                if missing {
                    return self.irregular(now);
                }
                self.link = if self.command.reply() == Reply::Sleep {
                    // It must be woken first.
                    Link::Unknown
                } else {
                    Link::Prompt
                };
                self.completed(now);
            }
            (Phase::Refused, Event::Prompt) => {
                self.link = Link::Prompt;
                self.attempt_failed(Fault::Refused, now);
            }
            _ => {}
        }
    }

    pub(super) fn is_expected(&self, packet: &Packet) -> bool {
        match self.command.reply() {
            Reply::Packets(kind) => packet.is_of(kind),
            _ => false,
        }
    }

    fn acknowledged(&mut self, now: u64) {
        match self.command.reply() {
            Reply::Packets(_) | Reply::Frame => return self.accepted(now),
            Reply::Upload if self.payload == Payload::None => self.payload = Payload::Due,
            Reply::Nothing | Reply::Values(_) | Reply::Banner | Reply::Sleep | Reply::Upload => {}
        }
        self.phase = Phase::Reply;
        let patience = if self.command == Command::Reset {
            self.policy.reset_us
        } else {
            self.policy.reply_us
        };
        self.wait(now, patience);
    }

    /// The camera sends.
    fn accepted(&mut self, now: u64) {
        self.link = Link::Streaming;
        self.lost = true;
        self.quiet = 0;
        self.dropped_then = self.parser.dropped().bytes;
        self.row_bytes = 0;
        self.row_at = 0;
        let polled = self.modes.poll() && self.command.reply() != Reply::Frame;
        if self.starting && !polled {
            self.modes.remember(&self.command);
            return self.started(self.command, now);
        }
        if self.interrupted && matches!(self.job, Job::Next { .. }) {
            return self.fail(Fault::Restarted);
        }
        self.enter_stream(now);
    }

    /// Command, answer and prompt: all is well.
    pub(super) fn completed(&mut self, now: u64) {
        if self.conclude() {
            self.proceed(now);
        }
    }

    /// The command is done. Whether [`proceed`](Self::proceed) must follow.
    pub(super) fn conclude(&mut self) -> bool {
        self.complete = false;
        self.attempts = 0;
        let command = self.command;
        if command == Command::Reset {
            self.restore = None;
            if !matches!(self.job, Job::Sequence(Sequence::Recover)) {
                self.stream = None;
                self.modes.remember(&command);
            }
        } else if !self.once {
            self.modes.remember(&command);
        }
        if self.restore.is_some() {
            return true;
        }
        if core::mem::take(&mut self.starting) {
            self.stream = Some(repeated(command));
        }
        match self.job {
            Job::Sequence(_) => {
                self.step += 1;
                return true;
            }
            Job::Start(_) => self.finish(Answer::Done),
            _ => self.finish(self.answer.unwrap_or(Answer::Done)),
        }
        false
    }

    /// Nothing can be said of what the camera will send next.
    pub(super) fn irregular(&mut self, now: u64) {
        self.link = Link::Unknown;
        self.attempt_failed(Fault::Garbage, now);
    }

    pub(super) fn attempt_failed(&mut self, fault: Fault, now: u64) {
        self.attempts = self.attempts.saturating_add(1);
        let repeatable = self.command.is_idempotent() || fault == Fault::Refused;
        if self.attempts > self.policy.retries || !repeatable {
            return self.fail(fault);
        }
        self.retries_made = self.retries_made.saturating_add(1);
        debug!("repeated after {:?}", fault);
        self.repeat = true;
        self.phase = Phase::Pause;
        self.wait(now, self.policy.pause_us);
    }

    pub(super) fn reply_timeout(&mut self, now: u64) {
        match (self.phase, self.command.reply()) {
            (Phase::Reply, Reply::Sleep) => {
                self.link = Link::Unknown;
                self.completed(now);
            }
            (Phase::Ack, Reply::Upload) if self.payload == Payload::None => {
                self.payload = Payload::Due;
                self.wait(now, self.policy.reply_us);
            }
            (Phase::Refused, _) => {
                self.link = Link::Unknown;
                self.attempt_failed(Fault::Refused, now);
            }
            _ => {
                self.link = Link::Unknown;
                self.attempt_failed(self.nothing_useful(), now);
            }
        }
    }
}

/// The command that continues a stream: bounds are told once.
fn repeated(command: Command) -> Command {
    match command {
        Command::SetBounds(_) | Command::TrackColour(_) | Command::TrackWindow => {
            Command::TrackColour(None)
        }
        other => other,
    }
}
