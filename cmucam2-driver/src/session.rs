//! The dialogue with the camera as a state machine: no input, no output, no clock.
//!
//! The caller gives it a [`Request`], bytes that came and the time; it gives bytes to send, the
//! time at which it wants to be called at the latest, and in the end an [`Answer`] or a [`Fault`]:
//!
//! 1. [`begin`](Session::begin) a request;
//! 2. while [`pending`](Session::pending) is not empty, send it and tell how much
//!    [was sent](Session::sent); after it the payload, if it is [due](Session::payload_due);
//! 3. give every byte that comes to [`receive`](Session::receive), and call
//!    [`tick`](Session::tick) when [`deadline`](Session::deadline) is reached;
//! 4. after each of these look for the [`outcome`](Session::outcome).
//!
//! Times are microseconds from any origin and must not run backwards.
//!
//! # What it takes care of
//! - Before the first command, after anything irregular and to end a stream: a carriage return, all
//!   bytes up to the prompt dropped, another carriage return, `ACK` and prompt required, and a
//!   moment of silence, so that no reply is taken for that of another command.
//! - `NCK`, silence and garbage: [idempotent](Command::is_idempotent) commands are repeated, at
//!   most [`Policy::retries`] times.
//! - A camera that restarts: its banner between other bytes, an `ACK` where a running stream would
//!   have been stopped without one, or a stream where poll mode was set. (An idle camera that
//!   restarts while nobody reads its banner is not noticed before that.) The [`Modes`] are set again and a colour-tracking or
//!   statistics stream is started again before the request goes on. A stream tells it with
//!   [`Fault::Restarted`], because what the camera had adapted to is lost; frame differencing has
//!   lost its reference and must be begun anew. Any other request that can be repeated just goes
//!   on: to whom the adaptation matters, [`Session::restarts`] tells.
//! - Silence under packet filter is [`Answer::Quiet`] when nothing was tracked last.

mod exchange;
mod modes;
mod policy;
mod request;
mod sequence;
mod stream;
mod sync;

pub use modes::{Modes, REGISTERS_MAX};
pub use policy::Policy;
pub use request::{Answer, Fault, Request};
pub use sequence::{Learn, StartUp};

use crate::{
    colour::Colour,
    command::{Command, CommandLine, Reply},
    fmt::{debug, warning},
    geometry::{Sensor, Size},
    packet::Version,
    parser::{Dropped, Event, Parser},
};
use sequence::{Sequence, Step};

/// The longest pause within a line: at 1200 baud a character and the greatest delay after it take
/// 0.22 s. What comes later is another line, of a camera that restarted in the middle of the first.
const PAUSE_IN_LINE_US: u64 = 250_000;

/// What is known of the camera's end of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Link {
    Unknown,
    /// It waits for a command.
    Prompt,
    /// It sends.
    Streaming,
}

/// What is being waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Idle,
    /// The prompt after the first carriage return.
    Drain {
        ack: bool,
    },
    /// `ACK` and prompt after the second one.
    Confirm {
        ack: bool,
    },
    /// Silence.
    Settle,
    /// The prompt of a camera that restarts.
    Boot,
    /// `ACK` or `NCK`.
    Ack,
    /// What follows `ACK`.
    Reply,
    /// The prompt after `NCK`.
    Refused,
    /// Packets.
    Stream,
    /// The prompt after the one packet or frame that was wanted.
    Trailing,
    /// Time to pass before a command is repeated.
    Pause,
    /// Time that a sequence lets pass.
    Wait,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Job {
    None,
    Do(Command),
    Start(Command),
    Next { row: Option<usize> },
    Stop,
    Sequence(Sequence),
}

/// Raw bytes that follow a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Payload {
    None,
    Due,
    Sent,
}

/// The state machine. See the [module](self).
#[derive(Clone, Debug)]
pub struct Session {
    parser: Parser,
    modes: Modes,
    policy: Policy,
    line: CommandLine,
    /// Bytes of `line` that are sent.
    sent: u8,
    payload: Payload,
    link: Link,
    phase: Phase,
    job: Job,
    /// Of a sequence.
    step: u8,
    /// The command in flight.
    command: Command,
    /// Whether it is one that a sequence takes back.
    once: bool,
    /// Whether it begins a stream for later requests.
    starting: bool,
    /// It must be sent again.
    repeat: bool,
    /// The stream has fallen silent: is the camera still in it?
    probing: bool,
    stream: Option<Command>,
    answer: Option<Answer>,
    /// The answer is there, only the prompt is missing.
    complete: bool,
    outcome: Option<Result<Answer, Fault>>,
    /// The camera has lost its modes: which is to be set next.
    restore: Option<u8>,
    /// It lost them while this request was under way.
    interrupted: bool,
    /// The command of this request was sent.
    asked: bool,
    attempts: u8,
    tries: u8,
    restarts: u8,
    heard: bool,
    /// When the last byte came.
    heard_at: u64,
    /// The last packet was empty, or there was none yet.
    lost: bool,
    /// Calls that ended in [`Answer::Quiet`], one after the other.
    quiet: u8,
    /// Bytes dropped when the last packet came.
    dropped_then: u32,
    row_bytes: u16,
    row_at: u16,
    /// The mean colour that TW told.
    window_mean: Option<Colour>,
    sensor: Option<Sensor>,
    silence: u32,
    silence_at: u64,
    limit_at: u64,
    restarts_seen: u16,
    retries_made: u16,
}

impl Session {
    /// A session with a camera of which nothing is known.
    pub fn new(policy: Policy) -> Self {
        Self {
            parser: Parser::default(),
            modes: Modes::default(),
            policy,
            line: Command::Idle.line(),
            sent: u8::MAX,
            payload: Payload::None,
            link: Link::Unknown,
            phase: Phase::Idle,
            job: Job::None,
            step: 0,
            command: Command::Idle,
            once: false,
            starting: false,
            repeat: false,
            probing: false,
            stream: None,
            answer: None,
            complete: false,
            outcome: None,
            restore: None,
            interrupted: false,
            asked: false,
            attempts: 0,
            tries: 0,
            restarts: 0,
            heard: false,
            heard_at: 0,
            lost: true,
            quiet: 0,
            dropped_then: 0,
            row_bytes: 0,
            row_at: 0,
            window_mean: None,
            sensor: None,
            silence: 0,
            silence_at: 0,
            limit_at: 0,
            restarts_seen: 0,
            retries_made: 0,
        }
    }

    /// What was set, and will be set again after a restart of the camera.
    pub fn modes(&self) -> &Modes {
        &self.modes
    }

    /// How patient it is.
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// The largest frame of the camera as it is set up now.
    pub fn frame(&self) -> Size {
        self.modes.frame(self.sensor)
    }

    /// What came and made no sense.
    pub fn dropped(&self) -> &Dropped {
        self.parser.dropped()
    }

    /// How often the camera was seen to restart without having been told to.
    pub fn restarts(&self) -> u16 {
        self.restarts_seen
    }

    /// How often a command was repeated.
    pub fn retries(&self) -> u16 {
        self.retries_made
    }

    /// Begins a request. One that was not finished is abandoned.
    pub fn begin(&mut self, request: Request, now: u64) {
        if !matches!(self.phase, Phase::Idle | Phase::Stream) {
            self.link = Link::Unknown;
        }
        self.job = match request {
            Request::Do(command) => Job::Do(command),
            Request::Start(command) => match command.reply() {
                Reply::Packets(_) | Reply::Frame => Job::Start(command),
                _ => Job::Do(command),
            },
            Request::Next => Job::Next { row: None },
            Request::NextPart { row } => Job::Next { row: Some(row) },
            Request::Stop => Job::Stop,
            Request::Recover => Job::Sequence(Sequence::Recover),
            Request::StartUp(start_up) => Job::Sequence(Sequence::StartUp(start_up)),
            Request::Learn { how, track } => Job::Sequence(Sequence::Learn { how, track }),
        };
        // One that cannot be begun must not leave the packets of another in its place.
        if let Job::Start(_) | Job::Sequence(Sequence::Learn { track: true, .. }) = self.job {
            self.stream = None;
        }
        self.step = 0;
        self.answer = None;
        self.complete = false;
        self.outcome = None;
        self.interrupted = self.restore.is_some() && matches!(self.job, Job::Next { .. });
        self.asked = false;
        self.attempts = 0;
        self.restarts = 0;
        self.heard = false;
        self.repeat = false;
        self.probing = false;
        self.payload = Payload::None;
        self.restore = self.restore.map(|_| 0);
        if let Job::Do(Command::Registers(registers)) = &self.job
            && !self.modes.has_room(registers)
        {
            return self.fail(Fault::TooManyRegisters);
        }
        self.proceed(now);
    }

    /// Bytes to send.
    pub fn pending(&self) -> &[u8] {
        self.line
            .as_bytes()
            .get(usize::from(self.sent)..)
            .unwrap_or(&[])
    }

    /// So many of them are sent.
    pub fn sent(&mut self, bytes: usize) {
        self.sent = self
            .sent
            .saturating_add(u8::try_from(bytes).unwrap_or(u8::MAX));
    }

    /// Whether the raw bytes that belong to the command ([`Command::UploadDifference`]) are to be
    /// sent now.
    pub fn payload_due(&self) -> bool {
        self.payload == Payload::Due && self.pending().is_empty()
    }

    /// They are sent.
    pub fn payload_sent(&mut self, now: u64) {
        self.payload = Payload::Sent;
        self.wait(now, self.policy.reply_us);
    }

    /// When to call [`Session::tick`] at the latest. `None` when no request is under way.
    pub fn deadline(&self) -> Option<u64> {
        (self.phase != Phase::Idle).then_some(self.silence_at.min(self.limit_at))
    }

    /// The result of the request, once.
    pub fn outcome(&mut self) -> Option<Result<Answer, Fault>> {
        self.outcome.take()
    }

    /// Takes one byte. `row` is the buffer of [`Request::NextPart`], empty otherwise.
    pub fn receive(&mut self, byte: u8, now: u64, row: &mut [u8]) {
        self.heard = true;
        if now.saturating_sub(self.heard_at) > PAUSE_IN_LINE_US && !self.parser.is_in_image() {
            self.parser.gap();
        }
        self.heard_at = now;
        if !matches!(self.phase, Phase::Pause | Phase::Wait) {
            self.silence_at = now + u64::from(self.silence);
        }
        let Some(event) = self.parser.push(byte) else {
            return;
        };
        if let Event::Banner(version) = event {
            return self.banner(version, now);
        }
        match self.phase {
            Phase::Drain { .. } | Phase::Confirm { .. } | Phase::Settle | Phase::Boot => {
                self.synchronise(event, now);
            }
            Phase::Ack | Phase::Reply | Phase::Refused => self.reply(event, now, row),
            Phase::Stream | Phase::Trailing => self.streamed(event, now, row),
            Phase::Idle | Phase::Pause | Phase::Wait => {}
        }
    }

    /// The time has come, or not yet.
    pub fn tick(&mut self, now: u64) {
        if self.deadline().is_none_or(|deadline| now < deadline) {
            return;
        }
        if now >= self.silence_at {
            self.parser.gap();
        }
        match self.phase {
            Phase::Idle => {}
            Phase::Drain { .. } | Phase::Confirm { .. } | Phase::Settle | Phase::Boot => {
                self.synchronise_timeout(now);
            }
            Phase::Ack | Phase::Reply | Phase::Refused => self.reply_timeout(now),
            Phase::Stream | Phase::Trailing => self.stream_timeout(now),
            Phase::Pause => self.proceed(now),
            Phase::Wait => {
                self.step += 1;
                self.proceed(now);
            }
        }
    }

    /// The UART failed: bytes are missing. The request ends without an outcome; a stream goes on.
    pub fn line_error(&mut self) {
        self.parser.gap();
        if !matches!(self.phase, Phase::Idle | Phase::Stream) {
            self.link = Link::Unknown;
        }
        self.phase = Phase::Idle;
        self.job = Job::None;
        self.outcome = None;
    }

    /// Waits for silence of so long, or eight times that in all.
    fn wait(&mut self, now: u64, silence: u32) {
        self.wait_at_most(now, silence, silence.saturating_mul(8));
    }

    fn wait_at_most(&mut self, now: u64, silence: u32, limit: u32) {
        self.silence = silence;
        self.silence_at = now + u64::from(silence);
        self.limit_at = now + u64::from(limit);
    }

    fn finish(&mut self, answer: Answer) {
        self.end(Ok(answer));
    }

    fn fail(&mut self, fault: Fault) {
        self.end(Err(fault));
    }

    fn end(&mut self, outcome: Result<Answer, Fault>) {
        self.phase = Phase::Idle;
        self.job = Job::None;
        self.complete = false;
        self.outcome = Some(outcome);
    }

    /// Silence or garbage, by whether anything was heard.
    fn nothing_useful(&self) -> Fault {
        if self.heard {
            Fault::Garbage
        } else {
            Fault::Silence
        }
    }

    /// Whether a command sets the camera back, so that what it has lost does not matter.
    fn is_resetting(&self) -> bool {
        match self.job {
            Job::Do(command) => command == Command::Reset,
            Job::Sequence(Sequence::StartUp(_) | Sequence::Recover) => self.step == 0,
            _ => false,
        }
    }

    /// Does whatever comes next: first make the camera listen, then give it back what it lost,
    /// then the request.
    fn proceed(&mut self, now: u64) {
        // Not by calling itself: the stack of a node has a bound.
        while self.advance(now) {}
    }

    /// One step of that. Whether another one follows at once.
    fn advance(&mut self, now: u64) -> bool {
        if let Job::Next { row } = self.job
            && self.restore.is_none()
        {
            if self.stream.is_none() {
                self.fail(Fault::NotStreaming);
                return false;
            }
            if self.link == Link::Streaming {
                if let Some(room) = row
                    && usize::from(self.row_bytes) > room
                {
                    self.fail(Fault::RowBuffer {
                        needed: self.row_bytes,
                    });
                    return false;
                }
                self.enter_stream(now);
                return false;
            }
        }
        if self.link != Link::Prompt {
            self.synchronise_from(now);
            return false;
        }
        if self.complete {
            return self.conclude();
        }
        if self.repeat {
            let (once, starting) = (self.once, self.starting);
            self.send(self.command, now);
            (self.once, self.starting) = (once, starting);
            return false;
        }
        if let Some(mut cursor) = self.restore
            && !self.is_resetting()
        {
            if let Some(command) = self.modes.command(&mut cursor) {
                self.restore = Some(cursor);
                self.send(command, now);
                return false;
            }
            self.restore = None;
            debug!("modes restored");
            if self.interrupted && !self.resume() {
                return false;
            }
        }
        match self.job {
            Job::None => self.phase = Phase::Idle,
            Job::Do(command) => {
                self.asked = true;
                self.send(command, now);
            }
            Job::Start(command) => {
                if self.start(command, now) {
                    self.finish(Answer::Done);
                }
            }
            Job::Next { .. } => match self.stream {
                Some(command) => self.send(command, now),
                None => self.fail(Fault::NotStreaming),
            },
            Job::Stop => {
                self.stream = None;
                self.finish(Answer::Done);
            }
            Job::Sequence(sequence) => return self.sequence(sequence, now),
        }
        false
    }

    /// After a restart: whether the request can go on. A sequence begins again.
    fn resume(&mut self) -> bool {
        match self.job {
            Job::Do(command) if self.asked && !command.is_idempotent() => {
                self.fail(Fault::Restarted);
                false
            }
            Job::Next { .. } if !self.stream_can_resume() => {
                self.stream = None;
                self.fail(Fault::Restarted);
                false
            }
            _ => true,
        }
    }

    /// Does a step of a sequence. Whether [`advance`](Self::advance) must follow at once.
    fn sequence(&mut self, sequence: Sequence, now: u64) -> bool {
        let answer = self.answer;
        let step = sequence.step(
            self.step,
            answer,
            &mut self.modes,
            self.sensor,
            self.window_mean,
        );
        match step {
            Step::Do(command) => self.send(command, now),
            Step::DoOnce(command) => {
                self.send(command, now);
                self.once = true;
            }
            Step::Start(command) => {
                if self.start(command, now) {
                    self.step += 1;
                    return true;
                }
            }
            Step::Pause(time) => {
                self.phase = Phase::Wait;
                self.silence_at = now + time;
                self.limit_at = self.silence_at;
            }
            Step::Restore => {
                self.step += 1;
                self.restore = Some(0);
                return true;
            }
            Step::Finish(answer) => self.finish(answer),
            Step::Fail(fault) => self.fail(fault),
        }
        false
    }

    /// A banner: asked for, or the camera restarted.
    fn banner(&mut self, version: Version, now: u64) {
        self.sensor = version.sensor().or(self.sensor);
        let asked = match self.command {
            Command::Reset => matches!(self.phase, Phase::Ack | Phase::Reply),
            Command::GetVersion => self.phase == Phase::Reply,
            _ => false,
        };
        if asked {
            self.answer = Some(Answer::Version(version));
            self.phase = Phase::Reply;
            return self.wait(now, self.policy.reply_us);
        }
        self.restarted();
        if self.phase == Phase::Idle {
            return;
        }
        // The prompt comes by itself.
        self.phase = Phase::Boot;
        self.wait(now, self.policy.reset_us);
    }

    /// The camera has forgotten its modes.
    fn restarted(&mut self) {
        warning!("the camera restarted");
        self.restarts_seen = self.restarts_seen.saturating_add(1);
        self.link = Link::Unknown;
        self.restore = Some(0);
        self.interrupted = true;
        self.complete = false;
        self.repeat = false;
        self.answer = None;
        self.attempts = 0;
        self.row_bytes = 0;
        if let Job::Sequence(_) = self.job {
            self.step = 0;
        }
        self.restarts = self.restarts.saturating_add(1);
        if self.restarts > self.policy.retries && self.phase != Phase::Idle {
            self.fail(Fault::Restarted);
        }
    }
}
