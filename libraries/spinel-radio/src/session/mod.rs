//! The dialogue with a co-processor as a state machine: no input, no output, no clock.
//!
//! 1. [`begin`](RcpSession::begin) a request;
//! 2. send the bytes of [`output`](RcpSession::output) until it gives none;
//! 3. give all bytes that come to [`input`](RcpSession::input), and call [`tick`](RcpSession::tick) when
//!    the [`deadline`](RcpSession::deadline) is reached;
//! 4. after each of these look for the [`outcome`](RcpSession::outcome), and for
//!    [received](RcpSession::receive) frames.
//!
//! The next `begin` may come at any moment; a request under way is then given up.
//!
//! # What it takes care of
//! - The first configuration resets the co-processor and checks its identity. A later one only sets the
//!   properties.
//! - A command without an answer is repeated; one that finds the co-processor too busy, after a
//!   pause.
//! - A restart of the co-processor is noticed by its message, or when it no longer wants to transmit. It is
//!   configured again before the request goes on, and a transmission is repeated: it cannot be known whether it
//!   was sent, and its receivers know a repetition.
//! - After silence the next request begins with a reset.
//! - A transmission that was given up is waited for before the next one, because a co-processor
//!   has one buffer for both.
//! - Received frames are queued. When the queue is full, a frame that arrives is lost. The address filter of the
//!   co-processor decides which of them are received.

mod arrival;
mod request;
mod setting;
mod steps;

pub use request::{Counters, RcpOutcome, RcpRequest};

use arrival::{Arrival, arrived};
use heapless::Deque;

use super::{
    fault::RcpFault,
    frame::{Body, SpinelHeader, SpinelMessage, Tid},
    hdlc::{Decoder, DroppedFrames, Encoder},
    identity::Identity,
    policy::RcpPolicy,
    property::{Property, PropertyKey},
    status::SpinelStatus,
    stream::TxFrame,
};
use zigbee_link::{
    Instant,
    radio::{FCS_LEN, FRAME_MAX, FRAME_MIN, PSDU_MAX, RadioConfig, Received},
};

/// The protocol version this is for.
const MAJOR: u32 = 4;

/// Header, command, property, and length of the PSDU; then the metadata.
const STREAM_MAX: usize = 3 + 2 + PSDU_MAX + 16;
/// The longest other command sets an extended address.
const COMMAND_MAX: usize = 16;
/// Length limit: a received frame takes 160 bytes with all its metadata. Longer content is a log.
const CONTENT_MAX: usize = 192;

/// Properties that the co-processor is asked for after a reset.
const QUESTIONS: [PropertyKey; 4] = [
    PropertyKey::PROTOCOL_VERSION,
    PropertyKey::CAPS,
    PropertyKey::HWADDR,
    PropertyKey::NCP_VERSION,
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Goal {
    None,
    Configure,
    Transmit {
        /// Number of times that the frame was given to the co-processor.
        tries: u8,
    },
    Listen,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    Idle,
    Reset,
    /// One of [`QUESTIONS`].
    Ask(u8),
    /// One of [`setting`].
    Set(u8),
    Transmit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Waiting {
    Nothing,
    /// The message of a restart.
    Restart,
    /// The answer of this exchange.
    Answer(Tid),
    /// Time to pass before the command is sent again.
    Pause,
    /// The end of a transmission that was given up.
    Previous,
}

/// Meaning of a frame of the co-processor for the dialogue.
enum Event {
    Restarted,
    Status { tid: Tid, status: SpinelStatus },
    Told { tid: Tid, key: PropertyKey },
}

/// The state machine. See the [module](self).
#[derive(Clone, Debug)]
pub struct RcpSession<const QUEUE: usize> {
    policy: RcpPolicy,
    decoder: Decoder<{ CONTENT_MAX + 2 }>,
    queue: Deque<Arrival, QUEUE>,
    counters: Counters,
    identity: Identity,
    config: Option<RadioConfig>,
    /// The co-processor works as `config` says.
    ready: bool,
    goal: Goal,
    outcome: Option<Result<RcpOutcome, RcpFault>>,
    step: Step,
    waiting: Waiting,
    deadline: Option<Instant>,
    attempts: u8,
    restarts: u8,
    tid: Tid,
    /// A transmission that was given up, and the time by which it ends.
    previous: Option<(Tid, Instant)>,
    command: [u8; COMMAND_MAX],
    command_len: usize,
    /// The command that transmits.
    stream: [u8; STREAM_MAX],
    stream_len: usize,
    /// There are bytes to be sent.
    encoder: Option<Encoder>,
}

impl<const QUEUE: usize> RcpSession<QUEUE> {
    /// With a co-processor of which nothing is known.
    pub const fn new(policy: RcpPolicy) -> Self {
        Self {
            policy,
            decoder: Decoder::new(),
            queue: Deque::new(),
            counters: Counters {
                restarts: 0,
                repeated: 0,
                malformed: 0,
                unusable: 0,
                queue_full: 0,
            },
            identity: Identity::UNKNOWN,
            config: None,
            ready: false,
            goal: Goal::None,
            outcome: None,
            step: Step::Idle,
            waiting: Waiting::Nothing,
            deadline: None,
            attempts: 0,
            restarts: 0,
            tid: Tid::UNSOLICITED,
            previous: None,
            command: [0; COMMAND_MAX],
            command_len: 0,
            stream: [0; STREAM_MAX],
            stream_len: 0,
            encoder: None,
        }
    }

    /// Identity of the co-processor, once it is configured.
    pub fn identity(&self) -> Option<&Identity> {
        self.ready.then_some(&self.identity)
    }

    /// Counts of faults that went by unnoticed.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Counts of frames on the line that were not delivered.
    pub const fn dropped(&self) -> DroppedFrames {
        self.decoder.dropped()
    }

    /// Begins a request, and gives up the one before.
    pub fn begin(&mut self, request: RcpRequest<'_>, now: Instant) {
        self.give_up();
        self.outcome = None;
        self.restarts = 0;
        let begun = match request {
            RcpRequest::Configure(config) => {
                self.begin_configuring(config, now);
                Ok(())
            }
            RcpRequest::Transmit(frame) => self.begin_transmitting(frame, now),
            RcpRequest::Listen => self.begin_listening(now),
        };
        if let Err(fault) = begun {
            self.outcome = Some(Err(fault));
        }
    }

    /// Result of the request, once.
    pub fn outcome(&mut self) -> Option<Result<RcpOutcome, RcpFault>> {
        self.outcome.take()
    }

    /// The next received frame, written to the start of `buffer`.
    pub fn receive(&mut self, buffer: &mut [u8; PSDU_MAX]) -> Option<Received> {
        self.queue
            .pop_front()
            .map(|arrival| arrival.deliver(buffer))
    }

    /// Writes the next bytes to be sent to `chunk` and returns their number, 0 if there are none.
    pub fn output(&mut self, chunk: &mut [u8]) -> usize {
        let Some(encoder) = &mut self.encoder else {
            return 0;
        };
        let content = match self.step {
            Step::Transmit => self.stream.get(..self.stream_len),
            _ => self.command.get(..self.command_len),
        };
        debug_assert!(content.is_some());
        let content = content.unwrap_or_default();
        let mut len = 0;
        for place in chunk {
            let Some(byte) = encoder.next(content) else {
                break;
            };
            *place = byte;
            len += 1;
        }
        if encoder.is_at_end() {
            self.encoder = None;
        }
        len
    }

    /// Returns true if [`output`](Self::output) has something.
    pub const fn wants_to_send(&self) -> bool {
        self.encoder.is_some()
    }

    /// Tells that bytes of [`output`](Self::output) may not have been sent.
    pub fn output_lost(&mut self, now: Instant) {
        match self.step {
            Step::Idle | Step::Transmit => {}
            Step::Reset | Step::Ask(_) | Step::Set(_) => self.send(now),
        }
    }

    /// Time when [`tick`](Self::tick) is to be called at the latest.
    pub const fn deadline(&self) -> Option<Instant> {
        self.deadline
    }

    /// Takes bytes from the line.
    pub fn input(&mut self, bytes: &[u8], now: Instant) {
        for &byte in bytes {
            let Some(content) = self.decoder.push(byte) else {
                continue;
            };
            let event = match SpinelMessage::parse(content) {
                // Another interface's, or a host's command.
                Ok(message) if message.header.interface() != 0 => None,
                Ok(SpinelMessage {
                    header,
                    body: Body::Is(property),
                }) => {
                    self.identity.learn(&property);
                    match property {
                        Property::LastStatus(status, _) if status.is_reset() => {
                            Some(Event::Restarted)
                        }
                        Property::LastStatus(status, _) => Some(Event::Status {
                            tid: header.tid,
                            status,
                        }),
                        Property::Received(frame) => {
                            if let Some(config) = &self.config {
                                arrived(&frame, config, &mut self.queue, &mut self.counters);
                            }
                            None
                        }
                        property => Some(Event::Told {
                            tid: header.tid,
                            key: property.key(),
                        }),
                    }
                }
                Ok(_) => None,
                Err(_) => {
                    count(&mut self.counters.malformed);
                    None
                }
            };
            match event {
                Some(Event::Restarted) => self.restarted(now),
                Some(Event::Status { tid, status }) => self.concluded(tid, status, now),
                Some(Event::Told { tid, key }) => self.told(tid, key, now),
                None => {}
            }
        }
    }

    /// Lets time pass.
    pub fn tick(&mut self, now: Instant) {
        if self.deadline.is_none_or(|deadline| now < deadline) {
            return;
        }
        match self.waiting {
            Waiting::Nothing => self.deadline = None,
            Waiting::Pause => self.send(now),
            Waiting::Previous => {
                self.previous = None;
                self.send(now);
            }
            Waiting::Restart | Waiting::Answer(_) => {
                if self.attempts < self.policy.retries {
                    self.attempts += 1;
                    count(&mut self.counters.repeated);
                    self.send(now);
                } else {
                    self.ready = false;
                    self.fail(RcpFault::Silent);
                }
            }
        }
    }

    fn begin_configuring(&mut self, config: RadioConfig, now: Instant) {
        let before = self.config.replace(config);
        let is_same = |before: RadioConfig| {
            let sampled = !config.sampled;
            before == RadioConfig { sampled, ..config }
        };
        // A co-processor listens always: there is nothing to tell it.
        if self.ready && self.step == Step::Idle && before.is_some_and(is_same) {
            self.outcome = Some(Ok(RcpOutcome::Configured));
            return;
        }
        self.goal = Goal::Configure;
        match self.step {
            _ if self.ready => self.enter(Step::Set(0), now),
            Step::Set(_) => self.enter(Step::Set(0), now),
            // It is being set up already.
            Step::Reset | Step::Ask(_) => self.attempts = 0,
            Step::Idle | Step::Transmit => self.enter(Step::Reset, now),
        }
    }

    fn begin_transmitting(&mut self, frame: &[u8], now: Instant) -> Result<(), RcpFault> {
        let config = self.config.ok_or(RcpFault::NotConfigured)?;
        if !(FRAME_MIN..=FRAME_MAX).contains(&frame.len()) {
            return Err(RcpFault::FrameLength);
        }
        let mut psdu = [0; PSDU_MAX];
        for (place, &byte) in psdu.iter_mut().zip(frame) {
            *place = byte;
        }
        let psdu = psdu.get(..frame.len() + FCS_LEN);
        let psdu = psdu.ok_or(RcpFault::FrameLength)?;
        let message = SpinelMessage {
            header: SpinelHeader::default(),
            body: Body::Set(Property::Send(TxFrame {
                // The frame that the host has secured is not to be changed.
                header_updated: true,
                security_processed: true,
                ..TxFrame::new(psdu, config.channel.number())
            })),
        };
        let emitted = message.emit(&mut self.stream);
        debug_assert!(emitted.is_ok(), "STREAM_MAX is too small");
        self.stream_len = emitted.unwrap_or(0);
        self.goal = Goal::Transmit { tries: 0 };
        if self.ready {
            self.enter(Step::Transmit, now);
        } else {
            self.attempts = 0;
            self.restore(now);
        }
        Ok(())
    }

    fn begin_listening(&mut self, now: Instant) -> Result<(), RcpFault> {
        if self.config.is_none() {
            return Err(RcpFault::NotConfigured);
        }
        self.goal = Goal::Listen;
        if !self.ready {
            self.restore(now);
        }
        Ok(())
    }

    /// Begins to set up the co-processor again, unless that is under way.
    fn restore(&mut self, now: Instant) {
        if self.step == Step::Idle {
            self.enter(Step::Reset, now);
        }
    }

    /// Leaves the request that the caller no longer waits for. A restoration goes on.
    fn give_up(&mut self) {
        match self.goal {
            Goal::Configure => {
                self.config = None;
                self.ready = false;
                self.halt();
            }
            Goal::Transmit { .. } if self.step == Step::Transmit => {
                if let (Waiting::Answer(tid), None, Some(deadline)) =
                    (self.waiting, &self.encoder, self.deadline)
                {
                    self.previous = Some((tid, deadline));
                }
                self.halt();
            }
            Goal::None | Goal::Transmit { .. } | Goal::Listen => {}
        }
        self.goal = Goal::None;
    }

    fn halt(&mut self) {
        self.step = Step::Idle;
        self.waiting = Waiting::Nothing;
        self.deadline = None;
        self.encoder = None;
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
