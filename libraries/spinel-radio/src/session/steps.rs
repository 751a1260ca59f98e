//! From one command to the next.

use super::{
    Goal, MAJOR, QUESTIONS, RcpOutcome, RcpSession, Step, Waiting, count,
    setting::{Need, setting},
};
use crate::{
    fault::RcpFault,
    frame::{Body, Reset, SpinelHeader, SpinelMessage, Tid},
    hdlc::Encoder,
    property::PropertyKey,
    status::SpinelStatus,
};
use zigbee_link::{Instant, radio::TxOutcome};

impl<const QUEUE: usize> RcpSession<QUEUE> {
    pub(super) fn enter(&mut self, step: Step, now: Instant) {
        self.step = step;
        self.attempts = 0;
        if let (Step::Transmit, Goal::Transmit { tries }) = (step, &mut self.goal) {
            if *tries > self.policy.retries {
                self.fail(RcpFault::Restarting);
                return;
            }
            *tries += 1;
        }
        match (step, self.previous) {
            // A change of the channel would reach it, too.
            (Step::Transmit | Step::Set(0), Some((_, until))) => {
                self.waiting = Waiting::Previous;
                self.deadline = Some(until);
                self.encoder = None;
            }
            _ => self.send(now),
        }
    }

    /// Sends the command of the step.
    pub(super) fn send(&mut self, now: Instant) {
        let mut waiting = Waiting::Nothing;
        let mut patience = self.policy.answer;
        let body = match self.step {
            Step::Idle => None,
            Step::Reset => {
                waiting = Waiting::Restart;
                patience = self.policy.reset;
                // The gentle way spares a USB connection; the other one helps when that fails.
                Some(Body::Reset(if self.attempts < self.policy.retries {
                    Reset::Stack
                } else {
                    Reset::Platform
                }))
            }
            Step::Ask(index) => QUESTIONS.get(usize::from(index)).copied().map(Body::Get),
            Step::Set(index) => self
                .config
                .and_then(|config| setting(&config, index))
                .map(|(property, _)| Body::Set(property)),
            Step::Transmit => None,
        };
        let mut header = SpinelHeader::default();
        if self.step != Step::Reset {
            self.tid = self.tid.next();
            header = SpinelHeader::new(self.tid);
            waiting = Waiting::Answer(self.tid);
        }
        if self.step == Step::Transmit {
            patience = self.policy.transmission;
            if let Some(first) = self.stream.first_mut() {
                *first = header.to_byte();
            }
        } else if let Some(body) = body {
            let message = SpinelMessage { header, body };
            let emitted = message.emit(&mut self.command);
            debug_assert!(emitted.is_ok(), "COMMAND_MAX is too small");
            self.command_len = emitted.unwrap_or(0);
        } else {
            self.halt();
            return;
        }
        self.waiting = waiting;
        self.deadline = Some(now + patience);
        self.encoder = Some(Encoder::new());
    }

    pub(super) fn restarted(&mut self, now: Instant) {
        self.previous = None;
        if self.ready {
            count(&mut self.counters.restarts);
            self.ready = false;
        }
        if self.config.is_none() {
            return;
        }
        // One that has just got power tells that, and then the reset it is told to make.
        if self.waiting != Waiting::Restart {
            if self.restarts >= self.policy.restarts {
                self.fail(RcpFault::Restarting);
                return;
            }
            self.restarts += 1;
        }
        self.enter(Step::Ask(0), now);
    }

    pub(super) fn concluded(&mut self, tid: Tid, status: SpinelStatus, now: Instant) {
        if self.previous.is_some_and(|(previous, _)| previous == tid) {
            self.previous = None;
            if self.waiting == Waiting::Previous {
                self.send(now);
            }
            return;
        }
        if self.waiting != Waiting::Answer(tid) {
            return;
        }
        let (key, may_fail) = match self.step {
            Step::Idle | Step::Reset => return,
            Step::Ask(index) => match QUESTIONS.get(usize::from(index)) {
                Some(&key) => (key, false),
                None => return,
            },
            Step::Set(index) => match self.config.and_then(|config| setting(&config, index)) {
                Some((property, need)) => (property.key(), need == Need::Wish),
                None => return,
            },
            Step::Transmit => (PropertyKey::STREAM_RAW, false),
        };
        match (status, self.step) {
            (SpinelStatus::BUSY | SpinelStatus::NO_MEMORY, _)
                if self.attempts < self.policy.retries =>
            {
                self.attempts += 1;
                self.waiting = Waiting::Pause;
                self.deadline = Some(now + self.policy.pause);
            }
            // It was on the air, which is all that counts.
            (SpinelStatus::OK | SpinelStatus::NO_ACK, Step::Transmit) => {
                self.transmitted(TxOutcome::Sent);
            }
            (SpinelStatus::CCA_FAILURE, Step::Transmit) => self.transmitted(TxOutcome::ChannelBusy),
            (SpinelStatus::INVALID_STATE, Step::Transmit) => {
                self.ready = false;
                self.enter(Step::Reset, now);
            }
            (status, Step::Set(_)) if may_fail || status == SpinelStatus::OK => {
                self.told(tid, key, now);
            }
            (status, step) => {
                if step != Step::Transmit {
                    self.ready = false;
                }
                self.fail(RcpFault::Refused { key, status });
            }
        }
    }

    fn transmitted(&mut self, outcome: TxOutcome) {
        self.halt();
        self.goal = Goal::None;
        self.outcome = Some(Ok(RcpOutcome::Transmitted(outcome)));
    }

    /// A property was told, or set.
    pub(super) fn told(&mut self, tid: Tid, key: PropertyKey, now: Instant) {
        if self.waiting != Waiting::Answer(tid) {
            return;
        }
        match self.step {
            Step::Idle | Step::Reset | Step::Transmit => {}
            Step::Ask(index) => {
                if QUESTIONS.get(usize::from(index)) != Some(&key) {
                    return;
                }
                let version = self.identity.protocol;
                match key {
                    PropertyKey::PROTOCOL_VERSION if version.major != MAJOR => {
                        self.fail(RcpFault::Version(version));
                    }
                    PropertyKey::CAPS if !self.identity.is_radio => self.fail(RcpFault::NoRadio),
                    _ if usize::from(index) + 1 < QUESTIONS.len() => {
                        self.enter(Step::Ask(index + 1), now);
                    }
                    _ => self.enter(Step::Set(0), now),
                }
            }
            Step::Set(index) => {
                let Some(config) = self.config else {
                    return;
                };
                if setting(&config, index).is_none_or(|(property, _)| property.key() != key) {
                    return;
                }
                if setting(&config, index + 1).is_some() {
                    self.enter(Step::Set(index + 1), now);
                } else {
                    self.configured(now);
                }
            }
        }
    }

    fn configured(&mut self, now: Instant) {
        self.ready = true;
        self.restarts = 0;
        self.halt();
        match self.goal {
            Goal::None | Goal::Listen => {}
            Goal::Configure => {
                self.goal = Goal::None;
                self.outcome = Some(Ok(RcpOutcome::Configured));
            }
            Goal::Transmit { .. } => self.enter(Step::Transmit, now),
        }
    }

    pub(super) fn fail(&mut self, fault: RcpFault) {
        self.halt();
        if self.goal == Goal::Configure {
            self.config = None;
            self.ready = false;
        }
        self.goal = Goal::None;
        self.outcome = Some(Err(fault));
    }
}
