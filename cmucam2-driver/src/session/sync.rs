//! Making the camera listen, whatever it was doing.

use super::{Fault, Link, Phase, Session};
use crate::{
    command::{Command, Reply},
    parser::{Event, Expectation},
};

impl Session {
    pub(super) fn synchronise_from(&mut self, now: u64) {
        self.tries = 0;
        self.heard = false;
        if self.is_frame_command() {
            self.stream = self.stream.filter(|stream| stream.reply() != Reply::Frame);
        }
        self.row_bytes = 0;
        self.parser.expect(Expectation::default());
        self.drain(now);
    }

    fn is_frame_command(&self) -> bool {
        self.command.reply() == Reply::Frame
    }

    fn carriage_return(&mut self) {
        self.line = Command::Idle.line();
        self.sent = 0;
    }

    fn drain(&mut self, now: u64) {
        self.phase = Phase::Drain { ack: false };
        self.carriage_return();
        if self.is_frame_command() && self.link == Link::Streaming {
            self.wait_at_most(now, self.policy.drain_us, self.policy.frame_us);
        } else {
            self.wait(now, self.policy.drain_us);
        }
    }

    pub(super) fn synchronise(&mut self, event: Event, now: u64) {
        match (self.phase, event) {
            (Phase::Drain { .. }, Event::Ack) => self.phase = Phase::Drain { ack: true },
            (Phase::Drain { ack }, Event::Prompt) => {
                // A running stream stops without an acknowledgement. A camera that acknowledges
                // was not in the stream any more: it has restarted, and its banner was lost.
                if ack && self.probing {
                    self.restarted();
                    if self.phase == Phase::Idle {
                        return;
                    }
                }
                self.probing = false;
                self.phase = Phase::Confirm { ack: false };
                self.carriage_return();
                self.wait(now, self.policy.drain_us);
            }
            (Phase::Confirm { .. }, Event::Ack) => self.phase = Phase::Confirm { ack: true },
            (Phase::Confirm { ack: true } | Phase::Boot, Event::Prompt) => {
                self.phase = Phase::Settle;
                self.wait(now, self.policy.settle_us);
            }
            _ => {}
        }
    }

    pub(super) fn synchronise_timeout(&mut self, now: u64) {
        if self.phase == Phase::Settle && now >= self.silence_at {
            self.link = Link::Prompt;
            return self.proceed(now);
        }
        self.tries = self.tries.saturating_add(1);
        if self.tries <= self.policy.retries {
            return self.drain(now);
        }
        self.probing = false;
        if self.is_resetting() && self.attempts == 0 {
            // It does not listen; perhaps it still obeys.
            self.attempts = 1;
            self.link = Link::Prompt;
            return self.proceed(now);
        }
        let fault = self.nothing_useful();
        self.link = Link::Unknown;
        self.fail(if self.restarts > 0 && fault == Fault::Silence {
            Fault::Restarted
        } else {
            fault
        });
    }
}
