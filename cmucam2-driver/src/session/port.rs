//! Both directions of the line, and its longest silence.

use super::Policy;
use crate::{
    command::{CommandLine, Order},
    features::FULL,
    parser::{Parser, Token},
};

/// The longest pause within a line: at 1200 baud a character and the greatest delay after it take 0.22 s.
/// Bytes that come later are another line, of a camera that restarted in the middle of the first.
const PAUSE_IN_LINE_US: u64 = 250_000;

/// Kind of the bytes that came since this was last forgotten.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    Nothing,
    /// Perhaps prompts, which noise contains, too.
    Bytes,
    /// A word, packet or number that does not come by chance.
    Words,
}

/// Raw bytes that follow a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Payload {
    None,
    Due,
    Sent,
}

/// Bytes to send, received bytes, and the time to wait. Times are microseconds.
#[derive(Clone, Debug)]
pub(super) struct Port {
    pub(super) parser: Parser,
    line: CommandLine,
    /// Bytes of `line` that are sent.
    sent: u8,
    payload: Payload,
    heard: Heard,
    /// Time when the last byte came.
    heard_at: u64,
    /// Longest silence of the line.
    silence: u32,
    silence_at: u64,
    limit_at: u64,
}

impl Port {
    pub(super) fn new() -> Self {
        Self {
            parser: Parser::default(),
            line: Order::IDLE.line(),
            sent: u8::MAX,
            payload: Payload::None,
            heard: Heard::Nothing,
            heard_at: 0,
            silence: 0,
            silence_at: 0,
            limit_at: 0,
        }
    }

    /// Bytes to send.
    pub(super) fn pending(&self) -> &[u8] {
        self.line
            .as_bytes()
            .get(usize::from(self.sent)..)
            .unwrap_or(&[])
    }

    /// So many of them are sent.
    pub(super) fn sent(&mut self, bytes: usize) {
        self.sent = self
            .sent
            .saturating_add(u8::try_from(bytes).unwrap_or(u8::MAX));
    }

    /// A command to send, instead of the one that was pending.
    pub(super) fn send(&mut self, order: &Order) {
        self.line = order.line();
        self.sent = 0;
    }

    /// Forgets the payload and the bytes heard for another command.
    pub(super) fn turn(&mut self) {
        self.payload = Payload::None;
        self.heard = Heard::Nothing;
    }

    /// The raw bytes of the command are due, unless they were sent. Returns true if they are due now.
    pub(super) fn ask_payload(&mut self) -> bool {
        let due = FULL && self.payload == Payload::None;
        if due {
            self.payload = Payload::Due;
        }
        due
    }

    pub(super) fn payload_due(&self) -> bool {
        FULL && self.payload == Payload::Due && self.pending().is_empty()
    }

    pub(super) fn payload_sent(&mut self, now: u64, policy: &Policy) {
        self.payload = Payload::Sent;
        self.wait(now, policy.reply_us);
    }

    /// Takes one byte. `waits_for_it`: a byte puts off the end of the silence.
    #[inline]
    pub(super) fn hear(&mut self, byte: u8, now: u64, waits_for_it: bool) -> Option<Token> {
        if self.heard == Heard::Nothing {
            self.heard = Heard::Bytes;
        }
        if now.saturating_sub(self.heard_at) > PAUSE_IN_LINE_US && !self.parser.is_in_image() {
            self.parser.gap();
        }
        self.heard_at = now;
        if waits_for_it {
            self.silence_at = now + u64::from(self.silence);
        }
        let token = self.parser.push(byte)?;
        if matches!(
            token,
            Token::Ack | Token::Nck | Token::Banner(_) | Token::Packet(_) | Token::Values(_)
        ) {
            self.heard = Heard::Words;
        }
        Some(token)
    }

    /// From now on only new bytes count.
    pub(super) fn listen(&mut self) {
        self.heard = Heard::Nothing;
    }

    pub(super) fn heard(&self) -> Heard {
        self.heard
    }

    /// Waits for silence of so long, or eight times that in all.
    pub(super) fn wait(&mut self, now: u64, silence: u32) {
        self.wait_at_most(now, silence, silence.saturating_mul(8));
    }

    pub(super) fn wait_at_most(&mut self, now: u64, silence: u32, limit: u32) {
        self.silence = silence;
        self.silence_at = now + u64::from(silence);
        self.limit_at = now + u64::from(limit);
    }

    /// Lets so much time pass, whatever comes.
    pub(super) fn pause(&mut self, now: u64, time: u64) {
        self.silence_at = now + time;
        self.limit_at = self.silence_at;
    }

    pub(super) fn deadline(&self) -> u64 {
        self.silence_at.min(self.limit_at)
    }

    /// Returns true if it was silent for as long as it may be.
    pub(super) fn is_silent(&self, now: u64) -> bool {
        now >= self.silence_at
    }
}
