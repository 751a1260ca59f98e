//! From bytes to events, one byte at a time.
//!
//! The parser holds no line: numbers are decoded as they come, so a byte costs a handful of compares and
//! nothing is read twice. It needs to be told the expected bytes ([`Expectation`]), because the protocol is
//! not self-describing: masks change the number of fields, line modes and frames put binary data between the
//! lines.
//!
//! # Resynchronisation
//! Text: a line that is wrong anywhere is dropped whole, and the next letter that can begin a line begins a
//! new attempt. Whatever came before, at least the second of two well-formed packets in a row is delivered.
//! Binary images have no checksum and may contain any byte: after a damaged header at most one image's worth
//! of bytes is taken for pixels. [`Parser::gap`] ends that early when the line falls silent, and a banner
//! ends it at once.
//!
//! # Never delivered
//! A packet with a wrong number of fields, with anything but single spaces (one may be last) and plain
//! decimal numbers up to 255, with coordinates out of order or outside the frame. [`DroppedBytes`] counts
//! dropped bytes by their reasons. For errors that cannot be detected see the [crate's](crate) description.

mod dropped;
mod expectation;
mod image;

pub use dropped::DroppedBytes;
pub use expectation::Expectation;
pub use image::{ImageHeader, ImageKind, RowState};

use crate::{
    command::StatisticsMask,
    features::FULL,
    packet::{BANNER, BINS_MAX, FirmwareVersion, Packet, PacketError, Statistics, Tracking},
    parser::{dropped::Reason, image::Image},
    servo::ServoMask,
};

/// Something that the camera said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Token {
    /// A command was accepted.
    Ack,
    /// A command was refused.
    Nck,
    /// The camera waits for a command.
    Prompt,
    /// The camera has started, or tells its version.
    Banner(FirmwareVersion),
    /// A packet whose fields are in order and inside the frame.
    Packet(Packet),
    /// The answer to a query: as many numbers as [`Expectation::values`], the rest is zero.
    Values([u8; 6]),
    /// Binary rows follow.
    Header(ImageHeader),
    /// One byte of a row, and the state of the row after it.
    Pixel(u8, RowState),
    /// A row ended after so many bytes, before it was full.
    RowCut(u16),
    /// The bytes of the row so far were none of it: it begins only now.
    RowAgain,
    /// The last row is over.
    ImageEnd {
        /// Number of rows that came.
        rows: u16,
        /// True if header, rows and end agree and every byte is possible.
        intact: bool,
    },
}

/// The value of a number before its first digit: no number reaches it.
const NO_DIGIT: u16 = u16::MAX;

/// Kind of the numbers that are being read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Tracking,
    Statistics,
    #[cfg(feature = "full")]
    Histogram,
    Values,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Word {
    Ack,
    Nck,
}

impl Word {
    const fn text(self) -> &'static [u8; 4] {
        match self {
            Self::Ack => b"ACK\r",
            Self::Nck => b"NCK\r",
        }
    }

    const fn event(self) -> Token {
        match self {
            Self::Ack => Token::Ack,
            Self::Nck => Token::Nck,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// At the beginning of a line.
    Start,
    /// Until a line begins that makes sense.
    Junk,
    /// After the letter of a packet.
    Letter(Kind),
    /// In a number or before its first digit.
    Number(Kind),
    /// In `ACK` or `NCK`: number of characters so far.
    Word(Word, u8),
    /// In the constant part of the banner: number of characters so far.
    Banner(u8),
    /// In the version before the point.
    Major,
    /// After the point: number of digits.
    Minor(u8),
    /// Before the `c`, or after it.
    Module(bool),
    /// After 255.
    RawLead,
    /// In raw numbers: number of those that are missing.
    Raw(Kind, u8),
    /// In the header or the rows of an image.
    Image,
}

/// The parser. See the [module](self).
#[derive(Clone, Debug)]
pub struct Parser {
    expectation: Expectation,
    state: State,
    /// The numbers of the line so far.
    numbers: [u8; BINS_MAX],
    len: u8,
    /// The number being read, or [`NO_DIGIT`].
    value: u16,
    /// Digits of the version before its point.
    digits: u8,
    /// Bytes of the line so far. No line that is not yet refused is longer than a histogram.
    held: u8,
    version: FirmwareVersion,
    image: Image,
    dropped: DroppedBytes,
}

impl Default for Parser {
    fn default() -> Self {
        Self::new(Expectation::default())
    }
}

impl Parser {
    /// A parser at the beginning of a line.
    pub fn new(expectation: Expectation) -> Self {
        Self {
            expectation,
            state: State::Start,
            numbers: [0; BINS_MAX],
            len: 0,
            value: NO_DIGIT,
            digits: 0,
            held: 0,
            version: FirmwareVersion {
                major: 0,
                minor: 0,
                module: None,
            },
            image: Image::NONE,
            dropped: DroppedBytes::default(),
        }
    }

    /// Takes the expected bytes from now on. An image that was begun goes on only if it is still expected.
    pub fn expect(&mut self, expectation: Expectation) {
        if self.is_in_image() && self.expectation.image != expectation.image {
            self.drop_held(Reason::Cut);
            self.state = State::Junk;
        }
        self.expectation = expectation;
    }

    /// The expected bytes.
    pub fn expectation(&self) -> &Expectation {
        &self.expectation
    }

    /// Bytes that were dropped since the parser was made.
    pub fn dropped(&self) -> &DroppedBytes {
        &self.dropped
    }

    /// Returns true if an image has begun and is not over: its rows may be far apart.
    pub(crate) fn is_in_image(&self) -> bool {
        FULL && self.state == State::Image
    }

    /// The line has been silent for longer than any pause within a line: a line that was begun will not go
    /// on.
    pub fn gap(&mut self) {
        if self.state != State::Start {
            self.drop_held(Reason::Cut);
            self.state = State::Start;
        }
    }

    /// Takes one byte.
    #[inline]
    pub fn push(&mut self, byte: u8) -> Option<Token> {
        // Nearly all bytes of a stream are digits and the spaces between numbers: these take the
        // shortest way.
        if !matches!(self.state, State::Number(_)) {
            return self.push_other(byte);
        }
        let digit = byte.wrapping_sub(b'0');
        if digit <= 9 {
            self.held = self.held.wrapping_add(1);
            self.value = match self.value {
                NO_DIGIT => u16::from(digit),
                1..=25 => self.value * 10 + u16::from(digit),
                // A leading zero, or too great in any case.
                _ => return self.refuse(Reason::Malformed, byte),
            };
            return None;
        }
        if byte == b' '
            && let Ok(value) = u8::try_from(self.value)
            && self.keep(value)
        {
            self.held = self.held.wrapping_add(1);
            self.value = NO_DIGIT;
            return None;
        }
        self.push_other(byte)
    }

    #[inline(never)] // for less flash
    fn push_other(&mut self, byte: u8) -> Option<Token> {
        match self.state {
            State::Number(kind) => self.separator(kind, byte),
            State::Image if FULL => self.image(byte),
            State::RawLead if FULL => self.raw_lead(byte),
            State::Raw(kind, missing) if FULL => self.raw(kind, missing, byte),
            _ if byte == b':' => self.prompt(),
            _ => self.text(byte),
        }
    }

    fn text(&mut self, byte: u8) -> Option<Token> {
        self.held = self.held.wrapping_add(1);
        match self.state {
            State::Start => self.start(byte),
            State::Letter(kind) => match byte {
                b' ' => self.go(State::Number(kind)),
                b'\r' => self.end(kind),
                _ => self.refuse(Reason::Malformed, byte),
            },
            State::Junk => self.junk(byte),
            State::Word(word, at) => self.word(word, at, byte),
            State::Banner(at) => self.banner(at, byte),
            State::Major => self.major(byte),
            State::Minor(digits) => self.minor(digits, byte),
            State::Module(seen) => self.module(seen, byte),
            State::Number(_) | State::RawLead | State::Raw(..) | State::Image => None,
        }
    }

    fn go(&mut self, state: State) -> Option<Token> {
        self.state = state;
        None
    }

    fn deliver(&mut self, event: Token) -> Option<Token> {
        self.state = State::Start;
        self.held = 0;
        Some(event)
    }

    fn drop_held(&mut self, reason: Reason) {
        self.dropped.count(reason);
        self.dropped.bytes = self.dropped.bytes.saturating_add(u32::from(self.held));
        self.held = 0;
    }

    fn prompt(&mut self) -> Option<Token> {
        match self.state {
            State::Start => {}
            State::Junk => self.state = State::Start,
            _ => self.drop_held(Reason::Cut),
        }
        self.deliver(Token::Prompt)
    }

    /// Drops the line, then looks whether the byte that made it impossible begins another.
    fn refuse(&mut self, reason: Reason, byte: u8) -> Option<Token> {
        self.held = self.held.saturating_sub(1);
        self.drop_held(reason);
        self.held = 1;
        self.state = State::Junk;
        self.junk(byte)
    }

    fn junk(&mut self, byte: u8) -> Option<Token> {
        if byte == b'\r' {
            self.state = State::Start;
        } else if self.begin(byte) {
            return self.begun();
        }
        self.dropped.bytes = self.dropped.bytes.saturating_add(u32::from(self.held));
        self.held = 0;
        None
    }

    fn start(&mut self, byte: u8) -> Option<Token> {
        if byte == b'\r' || byte == b'\n' {
            self.held = 0;
            return None;
        }
        if self.begin(byte) {
            return self.begun();
        }
        if byte.is_ascii_digit() && self.expectation.values > 0 {
            self.state = State::Number(Kind::Values);
            self.len = 0;
            self.value = u16::from(byte - b'0');
            return None;
        }
        self.drop_held(Reason::Noise);
        self.go(State::Junk)
    }

    /// Returns true if a line or an image begins with this byte.
    fn begin(&mut self, byte: u8) -> bool {
        let state = match byte {
            b'T' => State::Letter(Kind::Tracking),
            b'S' => State::Letter(Kind::Statistics),
            #[cfg(feature = "full")]
            b'H' => State::Letter(Kind::Histogram),
            b'A' => State::Word(Word::Ack, 1),
            b'N' => State::Word(Word::Nck, 1),
            b'C' => State::Banner(1),
            0xFF if FULL && self.expectation.raw => State::RawLead,
            _ if !FULL => return false,
            _ => match Image::begin(byte, &self.expectation, self.image.is_counted()) {
                Some(image) => {
                    self.image = image;
                    State::Image
                }
                None => return false,
            },
        };
        self.state = state;
        self.held = 1;
        self.len = 0;
        self.value = NO_DIGIT;
        true
    }

    /// The event that is due right after the first byte, if any.
    fn begun(&self) -> Option<Token> {
        if !FULL || self.state != State::Image {
            return None;
        }
        self.image.header_without_sizes().map(Token::Header)
    }

    /// Takes the byte behind the digits of a number.
    fn separator(&mut self, kind: Kind, byte: u8) -> Option<Token> {
        if byte == b':' {
            return self.prompt();
        }
        self.held = self.held.wrapping_add(1);
        // Some print a space behind each number.
        if (byte, self.value) == (b'\r', NO_DIGIT) && self.len > 0 {
            return self.end(kind);
        }
        // This is also where a number above 255, or none at all, is found.
        let (b' ' | b'\r', Ok(value)) = (byte, u8::try_from(self.value)) else {
            return self.refuse(Reason::Malformed, byte);
        };
        if !self.keep(value) {
            return self.refuse(Reason::Fields, byte);
        }
        self.value = NO_DIGIT;
        if byte == b' ' {
            return None;
        }
        self.end(kind)
    }

    /// Keeps a number unless there are too many.
    #[inline]
    fn keep(&mut self, value: u8) -> bool {
        match self.numbers.get_mut(usize::from(self.len)) {
            Some(free) => {
                *free = value;
                self.len += 1;
                true
            }
            None => false,
        }
    }

    /// All numbers are there.
    fn end(&mut self, kind: Kind) -> Option<Token> {
        match self.decode(kind) {
            Ok(event) => self.deliver(event),
            Err(error) => {
                self.drop_held(match error {
                    PacketError::FieldCount => Reason::Fields,
                    PacketError::Order | PacketError::Geometry | PacketError::Arithmetic => {
                        Reason::Impossible
                    }
                });
                self.go(State::Start)
            }
        }
    }

    fn decode(&self, kind: Kind) -> Result<Token, PacketError> {
        let numbers = self.numbers.get(..usize::from(self.len)).unwrap_or(&[]);
        let expectation = &self.expectation;
        // Only packets that the features name can have been asked for.
        let (mask, servos, statistics) = if FULL {
            (
                expectation.tracking,
                expectation.servos,
                expectation.statistics,
            )
        } else {
            (0xFF, ServoMask::NONE, StatisticsMask::ALL)
        };
        Ok(match kind {
            Kind::Tracking => {
                let tracking = Tracking::from_fields(numbers, mask, servos, expectation.frame)?;
                if expectation.strict && !tracking.is_consistent() {
                    return Err(PacketError::Arithmetic);
                }
                Token::Packet(Packet::Tracking(tracking))
            }
            Kind::Statistics => Token::Packet(Packet::Statistics(Statistics::from_fields(
                numbers, statistics,
            )?)),
            #[cfg(feature = "full")]
            Kind::Histogram => {
                if expectation.bins.is_some_and(|bins| bins != self.len) {
                    return Err(PacketError::FieldCount);
                }
                Token::Packet(Packet::Histogram(crate::packet::Histogram::new(numbers)?))
            }
            Kind::Values => {
                let mut values = [0; 6];
                match values.get_mut(..numbers.len()) {
                    Some(part) if self.len == expectation.values => part.copy_from_slice(numbers),
                    _ => return Err(PacketError::FieldCount),
                }
                Token::Values(values)
            }
        })
    }

    fn word(&mut self, word: Word, at: u8, byte: u8) -> Option<Token> {
        match word.text().get(usize::from(at)) {
            Some(&next) if next == byte && next == b'\r' => self.deliver(word.event()),
            Some(&next) if next == byte => self.go(State::Word(word, at + 1)),
            // Some print a space behind each word.
            Some(b'\r') if byte == b' ' => None,
            _ => self.refuse(Reason::Malformed, byte),
        }
    }

    fn banner(&mut self, at: u8, byte: u8) -> Option<Token> {
        match BANNER.get(usize::from(at)) {
            Some(&next) if next == byte => {}
            // `CMUcam2+`: firmware that others have extended.
            Some(b' ') if byte == b'+' => return None,
            // `CMUcam3`: its program that plays a CMUcam2.
            Some(b'2') if byte == b'3' => {}
            _ => return self.refuse(Reason::Malformed, byte),
        }
        let at = at + 1;
        if usize::from(at) == BANNER.len() {
            return self.version();
        }
        self.go(State::Banner(at))
    }

    /// The constant part of the banner is over.
    fn version(&mut self) -> Option<Token> {
        self.digits = 0;
        self.version = FirmwareVersion {
            major: 0,
            minor: 0,
            module: None,
        };
        self.go(State::Major)
    }

    fn major(&mut self, byte: u8) -> Option<Token> {
        match byte {
            b'0'..=b'9' if self.digits < 2 => {
                self.version.major = self.version.major * 10 + (byte - b'0');
                self.digits += 1;
                None
            }
            b'.' if self.digits > 0 => self.go(State::Minor(0)),
            _ => self.refuse(Reason::Malformed, byte),
        }
    }

    fn minor(&mut self, digits: u8, byte: u8) -> Option<Token> {
        match (byte, digits) {
            (b'0'..=b'9', 0) => {
                self.version.minor = (byte - b'0') * 10;
                self.go(State::Minor(1))
            }
            (b'0'..=b'9', 1) => {
                self.version.minor += byte - b'0';
                self.go(State::Minor(2))
            }
            (b' ', 1..) => self.go(State::Module(false)),
            // `v2.0+`.
            (b'+', 1..) => None,
            (b'\r', 1..) => self.deliver(Token::Banner(self.version)),
            _ => self.refuse(Reason::Malformed, byte),
        }
    }

    /// The banner is delivered with its last character, because a prompt may follow at once.
    fn module(&mut self, seen: bool, byte: u8) -> Option<Token> {
        match (seen, byte) {
            (false, b'c') => self.go(State::Module(true)),
            (true, b'0'..=b'9') => {
                self.version.module = Some(byte - b'0');
                self.deliver(Token::Banner(self.version))
            }
            _ => self.refuse(Reason::Malformed, byte),
        }
    }

    fn raw_lead(&mut self, byte: u8) -> Option<Token> {
        self.held = self.held.wrapping_add(1);
        let expectation = &self.expectation;
        if expectation.values > 0 {
            return self.raw(Kind::Values, expectation.values, byte);
        }
        let (kind, count) = match byte {
            b'T' => (
                Kind::Tracking,
                Tracking::fields(expectation.tracking, expectation.servos),
            ),
            b'S' => (
                Kind::Statistics,
                expectation.statistics.bits().count_ones() as u8,
            ),
            #[cfg(feature = "full")]
            b'H' => (Kind::Histogram, expectation.bins.unwrap_or(BINS_MAX as u8)),
            _ => return self.refuse(Reason::Malformed, byte),
        };
        if count == 0 {
            return self.end(kind);
        }
        self.go(State::Raw(kind, count))
    }

    fn raw(&mut self, kind: Kind, missing: u8, byte: u8) -> Option<Token> {
        self.held = self.held.wrapping_add(1);
        // Raw output never sends 255 as a number, so this is the beginning of the next packet.
        if byte == 0xFF || !self.keep(byte) {
            return self.refuse(Reason::Cut, byte);
        }
        if missing > 1 {
            return self.go(State::Raw(kind, missing - 1));
        }
        self.end(kind)
    }

    fn image(&mut self, byte: u8) -> Option<Token> {
        let step = self.image.push(byte, &self.expectation);
        match step {
            image::Step::Token(event) => {
                if let Token::Pixel(_, RowState::Damaged)
                | Token::RowCut(_)
                | Token::RowAgain
                | Token::ImageEnd { intact: false, .. } = event
                {
                    self.dropped.count(Reason::Image);
                }
                match event {
                    Token::ImageEnd { .. } => self.deliver(event),
                    _ => Some(event),
                }
            }
            image::Step::Nothing => None,
            image::Step::EndBefore(end) => {
                self.dropped.count(Reason::Image);
                self.state = State::Junk;
                self.held = 1;
                // Whatever begins here goes on; the event that is due is the end of the image.
                let _ = self.junk(byte);
                Some(end)
            }
            image::Step::Refuse => {
                self.held = self.held.wrapping_add(1);
                self.refuse(Reason::Image, byte)
            }
            image::Step::Banner => {
                self.dropped.count(Reason::Image);
                self.version()
            }
        }
    }
}
