//! The dialogue with the camera as a state machine: no input, no output, no clock.
//!
//! [`begin`](Session::begin) a request; send what is [pending](Session::pending); give every byte to
//! [`receive`](Session::receive), and call [`tick`](Session::tick) when the
//! [`deadline`](Session::deadline) is reached; look for the [`outcome`](Session::outcome) after each.
//! Times are microseconds from any origin and must not run backwards.
//!
//! A request that is not answered or refused, or whose answer is damaged or that to another request, is
//! repeated: the line may have made another one of it. A camera that is busy, for it starts or has no new
//! frame yet, is asked again until it has an answer, as long as [`Policy`] says.
//!
//! A camera that [streams](Model::streams) is sent nothing: a request for blocks is answered by its next picture, one
//! that came whole. At most `KEPT` blobs of it are kept. It takes no other requests.

use core::{fmt, slice};

use heapless::Vec;

use crate::{
    block::{BLOCK_BYTES, Block},
    model::Model,
    packet::{Encoded, Heard, Parser, Request, kind, u16_at},
    stream::{Event, Stream},
};

/// Blobs of a streamed picture that are kept, of those that are asked for.
const KEPT: usize = 4;

/// Bytes, zeros aside, that are no silence although they have no meaning: more than wait for the end of a block.
const NOISE: u8 = 32;

/// Errors that the camera tells.
const BUSY: i8 = -2;
const PROGRAM_CHANGING: i8 = -6;

/// Times in microseconds, and counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Policy {
    /// Silence after which a request was not heard. The camera answers within 0.1 ms.
    pub reply_us: u32,
    /// Pause before a camera that is busy or refuses is asked again.
    pub pause_us: u32,
    /// Longest time for which it may be busy. It starts in about two seconds.
    pub busy_us: u32,
    /// Number of repetitions of a request before it fails.
    pub retries: u8,
    /// Pause of the blocking driver between two looks at a UART that has nothing.
    pub poll_us: u32,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            reply_us: 50_000,
            pause_us: 2_000,
            busy_us: 5_000_000,
            retries: 3,
            poll_us: 100,
        }
    }
}

/// Reason why a request failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Fault {
    /// No answer.
    Silence,
    /// Answers, but damaged ones or of another kind.
    Garbled,
    /// The camera is busy all the time.
    Busy,
    /// The camera refuses each time: its number for why. -4 is a request that its program does not know, -5
    /// a person who holds its button.
    Refused(i8),
    /// A camera that streams was asked for something else than blocks.
    Unable,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Silence => {
                "the camera is silent: are its data port and baud rate set for a UART?"
            }
            Self::Garbled => "what the camera says is damaged: check baud rate and cable",
            Self::Unable => "the camera streams, and takes no requests",
            Self::Busy => "the Pixy2 is busy all the time: does it run color_connected_components?",
            Self::Refused(why) => {
                let hint = match why {
                    -4 => ": does it run color_connected_components?",
                    -5 => ": is its button held?",
                    _ => "",
                };
                return write!(f, "the Pixy2 refuses: error {why}{hint}");
            }
        })
    }
}

impl core::error::Error for Fault {}

/// Version of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Version {
    /// Version of the board.
    pub hardware: u16,
    /// Version of the firmware: the number before the first point.
    pub major: u8,
    /// The number after it.
    pub minor: u8,
    /// The number after the second point.
    pub build: u16,
}

/// The answer to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Answer {
    /// To [`Request::Version`].
    Version(Version),
    /// To [`Request::Resolution`]: columns and rows.
    Resolution(u16, u16),
    /// To [`Request::Blocks`]: they are in [`Session::blocks`].
    Blocks,
    /// To all others: a number.
    Result(i32),
}

/// The blobs of a frame, the largest first: see [`Session::blocks`].
#[derive(Clone, Debug)]
pub struct Blocks<'a> {
    answered: slice::Iter<'a, [u8; BLOCK_BYTES]>,
    streamed: slice::Iter<'a, Block>,
}

impl Iterator for Blocks<'_> {
    type Item = Block;

    fn next(&mut self) -> Option<Block> {
        let answered = self.answered.find_map(|block| Block::from_bytes(block));
        answered.or_else(|| self.streamed.next().copied())
    }
}

#[derive(Clone, Copy, Debug)]
enum State {
    Idle,
    /// It is to be sent, or waits for its answer.
    Asked,
    /// Until it is asked again.
    Pause,
    Over(Result<Answer, Fault>),
}

/// The state machine. See the [module](self).
#[derive(Clone, Debug)]
pub struct Session {
    policy: Policy,
    model: Model,
    parser: Parser,
    stream: Stream,
    /// Blobs of the streamed picture under way, if its beginning came and nothing of it was damaged.
    picture: Option<Vec<Block, KEPT>>,
    /// Those of the last whole one.
    told: Vec<Block, KEPT>,
    /// Zero words have come since the request.
    is_alive: bool,
    /// Bytes without a meaning in a row, zeros aside.
    noise: u8,
    state: State,
    request: Request,
    encoded: Encoded,
    sent: u8,
    deadline: u64,
    /// It is given up that is busy at this time.
    busy_until: u64,
    tries: u8,
    /// Why the request fails, if it is never answered: what came last that was no answer.
    fault: Fault,
}

impl Session {
    /// With a camera of this model, of which nothing else is known.
    pub fn new(model: Model, policy: Policy) -> Self {
        Self {
            policy,
            model,
            parser: Parser::default(),
            stream: Stream::default(),
            picture: None,
            told: Vec::new(),
            is_alive: false,
            noise: 0,
            state: State::Idle,
            request: Request::Version,
            encoded: Request::Version.encode(),
            sent: 0,
            deadline: 0,
            busy_until: 0,
            tries: 0,
            fault: Fault::Silence,
        }
    }

    /// Returns the model of the camera.
    pub fn model(&self) -> Model {
        self.model
    }

    /// Returns the times and counts.
    pub fn policy(&self) -> &Policy {
        &self.policy
    }

    /// Begins a request. One that was not finished is abandoned.
    pub fn begin(&mut self, request: Request, now: u64) {
        self.request = request;
        self.encoded = request.encode();
        self.tries = 0;
        self.fault = Fault::Silence;
        self.busy_until = now.saturating_add(self.policy.busy_us.into());
        self.ask(now);
        if self.model.streams() && !matches!(request, Request::Blocks { .. }) {
            self.state = State::Over(Err(Fault::Unable));
        }
    }

    fn ask(&mut self, now: u64) {
        self.parser.clear();
        self.sent = 0;
        self.is_alive = false;
        self.noise = 0;
        self.state = State::Asked;
        let wait = if self.model.streams() {
            self.policy.reply_us.max(self.model.tells_within_us())
        } else {
            self.policy.reply_us
        };
        self.deadline = now.saturating_add(wait.into());
    }

    /// One of its tries has failed. Tells whether it may be asked again.
    fn has_another_try(&mut self) -> bool {
        self.tries = self.tries.saturating_add(1);
        if self.tries > self.policy.retries {
            self.state = State::Over(Err(self.fault));
            return false;
        }
        true
    }

    fn ask_again(&mut self, now: u64) {
        if self.has_another_try() {
            self.ask(now);
        }
    }

    fn garbled(&mut self, now: u64) {
        self.fault = Fault::Garbled;
        self.ask_again(now);
    }

    fn pause(&mut self, now: u64) {
        self.state = State::Pause;
        self.deadline = now.saturating_add(self.policy.pause_us.into());
    }

    /// Bytes to send.
    pub fn pending(&self) -> &[u8] {
        match self.state {
            State::Asked if !self.model.streams() => {
                let rest = self.encoded.as_bytes().get(usize::from(self.sent)..);
                rest.unwrap_or_default()
            }
            _ => &[],
        }
    }

    /// So many of them are sent.
    pub fn sent(&mut self, bytes: usize) {
        let most = self.pending().len();
        self.sent = self.sent.saturating_add(bytes.min(most) as u8);
    }

    /// Time to call [`Session::tick`] at the latest. `None` when no request is under way.
    pub fn deadline(&self) -> Option<u64> {
        matches!(self.state, State::Asked | State::Pause).then_some(self.deadline)
    }

    /// The result of the request, once.
    pub fn outcome(&mut self) -> Option<Result<Answer, Fault>> {
        let State::Over(outcome) = self.state else {
            return None;
        };
        self.state = State::Idle;
        Some(outcome)
    }

    /// Blobs of the last [`Answer::Blocks`], the largest first, until the next request.
    pub fn blocks(&self) -> Blocks<'_> {
        let is_there = self.request.answered_by() == kind::BLOCKS;
        let payload = if is_there { self.parser.payload() } else { &[] };
        Blocks {
            answered: payload.as_chunks().0.iter(),
            streamed: self.told.iter(),
        }
    }

    /// Takes one byte. Bytes that come when nothing was asked are dropped, but for those of a stream: whole
    /// pictures of it take each other's place.
    pub fn receive(&mut self, byte: u8, now: u64) {
        self.noise = self.noise.saturating_add(u8::from(byte != 0));
        if self.model.streams() {
            self.stream.push(byte);
            while let Some(event) = self.stream.next_event() {
                self.noise = 0;
                self.streamed(event);
            }
            return;
        }
        if !matches!(self.state, State::Asked) {
            return;
        }
        match self.parser.push(byte) {
            // A byte of noise must not keep it waiting for ever: the time runs on.
            Heard::Nothing => {}
            Heard::Damaged => self.garbled(now),
            Heard::Packet(kind::ERROR) => match *self.parser.payload() {
                [why] => self.refused(why.cast_signed(), now),
                _ => self.garbled(now),
            },
            Heard::Packet(kind) if kind == self.request.answered_by() => match self.answer() {
                Some(answer) => self.state = State::Over(Ok(answer)),
                None => self.garbled(now),
            },
            // The answer to a request that was given up: that to this one may follow.
            Heard::Packet(_) => self.fault = Fault::Garbled,
        }
    }

    fn streamed(&mut self, event: Event) {
        match event {
            Event::Picture => {
                self.pictured();
                self.picture = Some(Vec::new());
            }
            Event::Block(block) => {
                if let Request::Blocks { of, most } = self.request
                    && let Some(picture) = &mut self.picture
                    && of.has(block.signature)
                    && picture.len() < usize::from(most)
                {
                    // The largest come first.
                    let _ = picture.push(block);
                }
            }
            Event::Zero => {
                self.is_alive = true;
                if self.picture.is_none() && self.model.zero_is_picture() {
                    self.picture = Some(Vec::new());
                }
                self.pictured();
            }
            Event::Damaged => self.damaged(),
        }
    }

    /// The picture under way is whole.
    fn pictured(&mut self) {
        if let Some(picture) = self.picture.take() {
            self.told = picture;
            if matches!(self.state, State::Asked) {
                self.state = State::Over(Ok(Answer::Blocks));
            }
        }
    }

    /// Bytes of a stream were lost or damaged: what is under way does not count.
    pub fn damaged(&mut self) {
        self.picture = None;
        self.fault = Fault::Garbled;
    }

    fn refused(&mut self, why: i8, now: u64) {
        match why {
            BUSY | PROGRAM_CHANGING if now >= self.busy_until => {
                self.state = State::Over(Err(Fault::Busy));
            }
            BUSY | PROGRAM_CHANGING => self.pause(now),
            why => {
                self.fault = Fault::Refused(why);
                if self.has_another_try() {
                    self.pause(now);
                }
            }
        }
    }

    fn answer(&self) -> Option<Answer> {
        let payload = self.parser.payload();
        let number = |at| u16_at(payload, at);
        match self.request {
            Request::Version => Some(Answer::Version(Version {
                hardware: number(0)?,
                major: *payload.get(2)?,
                minor: *payload.get(3)?,
                build: number(4)?,
            })),
            Request::Resolution => Some(Answer::Resolution(number(0)?, number(2)?)),
            Request::Blocks { of, most } => {
                let (blocks, rest) = payload.as_chunks::<BLOCK_BYTES>();
                let is_asked_for = |block: &[u8; BLOCK_BYTES]| {
                    Block::from_bytes(block).is_some_and(|block| of.has(block.signature))
                };
                let fits = rest.is_empty()
                    && blocks.len() <= usize::from(most)
                    && blocks.iter().all(is_asked_for);
                fits.then_some(Answer::Blocks)
            }
            Request::Brightness(_) | Request::Lamp { .. } | Request::FramesPerSecond => {
                let bytes = payload.first_chunk()?;
                Some(Answer::Result(i32::from_le_bytes(*bytes)))
            }
        }
    }

    /// The time has come, or not yet.
    pub fn tick(&mut self, now: u64) {
        if self.deadline().is_none_or(|deadline| now < deadline) {
            return;
        }
        // The wrong rate, or a line that is turned round.
        if self.noise >= NOISE {
            self.fault = Fault::Garbled;
        }
        match self.state {
            State::Pause => self.ask(now),
            // Nothing in view: zero words, and no picture begins.
            State::Asked if self.is_alive && self.fault == Fault::Silence => {
                self.picture = Some(Vec::new());
                self.pictured();
            }
            _ => self.ask_again(now),
        }
    }

    /// The UART failed: the request ends without an outcome.
    pub fn line_error(&mut self) {
        self.parser.clear();
        self.state = State::Idle;
    }
}
